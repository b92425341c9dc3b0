//! Turned, mirrored, stretched, interlaced and changing pictures.

use super::maker::{Film, HEIGHT, WIDTH, frame, frames, has_ffmpeg, open, patched_matrix, refusal};
use std::process::Command;

/// The display matrix, and the stored column and row of a displayed pixel.
type Turn = ([i32; 4], fn(u32, u32) -> [u32; 2]);

/// The eight orientations of a phone film, by their display matrices.
#[test]
fn a_film_is_turned_and_mirrored_as_players_display_it() {
    if !has_ffmpeg() {
        return;
    }
    const W: u32 = WIDTH - 1;
    const H: u32 = HEIGHT - 1;
    let turns: [Turn; 8] = [
        ([1, 0, 0, 1], |x, y| [x, y]),
        ([-1, 0, 0, 1], |x, y| [W - x, y]),
        ([-1, 0, 0, -1], |x, y| [W - x, H - y]),
        ([1, 0, 0, -1], |x, y| [x, H - y]),
        ([0, 1, 1, 0], |x, y| [y, x]),
        ([0, 1, -1, 0], |x, y| [y, H - x]),
        ([0, -1, -1, 0], |x, y| [W - y, H - x]),
        ([0, -1, 1, 0], |x, y| [W - y, x]),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (ending, codec) in [("mov", "-c:v png -pix_fmt gray"), ("mp4", "-c:v libx264 -crf 4 -pix_fmt yuv420p")] {
        let film = Film { ending, codec, numbers: (0..2).collect(), ..Film::default() };
        let path = film.write(folder.path());
        for (matrix, stored) in turns {
            patched_matrix(&path, matrix);
            let footage = open(&path);
            let [width, height] = [footage.width_px, footage.height_px];
            println!("{ending} {matrix:?}: {}", footage.summary());
            let drawn = frame(1);
            let pixels = &frames(footage)[1].1;
            let mut worst = 0;
            for (at, level) in (0..).zip(pixels) {
                let [x, y] = stored(at % width, at / width);
                worst = worst.max(drawn[(y * WIDTH + x) as usize].abs_diff(*level));
            }
            assert_eq!(width * height, WIDTH * HEIGHT);
            assert!(worst <= if ending == "mov" { 0 } else { 12 }, "{ending} {matrix:?}: {worst}");
        }
    }
}

#[test]
fn a_picture_turned_by_no_quarter_is_measured_as_stored_with_a_warning() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = Film { ending: "mov", codec: "-c:v png -pix_fmt gray", ..Film::default() };
    let path = film.write(folder.path());
    patched_matrix(&path, [1, 1, -1, 1]);
    let footage = open(&path);
    assert!(footage.warnings.iter().any(|warning| warning.contains("45 degrees")), "{:?}", footage.warnings);
}

#[test]
fn pixels_that_are_not_square_are_made_so() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("mkv", "-c:v ffv1", "setsar=4/3", [85, 48]),
        ("mp4", "-c:v libx264 -pix_fmt yuv420p", "setsar=16/15", [68, 48]),
        ("mov", "-c:v png -pix_fmt gray", "setsar=8/9", [64, 54]),
        ("ts", "-c:v libx264 -pix_fmt yuv420p", "setsar=2/1", [128, 48]),
        ("avi", "-c:v mjpeg", "setsar=1/2", [64, 96]),
        ("webm", "-c:v libvpx-vp9 -deadline realtime", "setsar=3/2", [96, 48]),
        ("mpg", "-c:v mpeg2video", "setsar=4/3", [85, 48]),
        ("mxf", "-c:v mpeg2video", "setsar=4/3", [85, 48]),
    ];
    for (ending, codec, filters, size) in cases {
        let footage = open(&Film { ending, codec, filters, ..Film::default() }.write(folder.path()));
        println!("{ending}: {}", footage.summary());
        assert_eq!([footage.width_px, footage.height_px], size, "{ending}: {}", footage.summary());
        assert!(footage.summary().contains("made square"), "{}", footage.summary());
        assert_eq!(frames(footage)[0].1.len() as u32, size[0] * size[1]);
    }
}

#[test]
fn interlaced_films_are_refused_with_a_cure_that_works() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("mkv", "-c:v ffv1 -flags +ildct+ilme", "setfield=tff"),
        ("ts", "-c:v mpeg2video -q:v 2 -flags +ildct+ilme", "setfield=tff"),
        ("mp4", "-c:v libx264 -pix_fmt yuv420p -x264opts bff=1", "setfield=bff"),
        ("mov", "-c:v prores_ks -flags +ildct", "setfield=tff"),
        ("mpg", "-c:v mpeg2video -q:v 2 -flags +ildct+ilme", "setfield=tff"),
        ("mxf", "-c:v mpeg2video -q:v 2 -flags +ildct+ilme", "setfield=bff"),
    ];
    for (ending, codec, filters) in cases {
        let film = Film { ending, codec, filters, ..Film::default() };
        let path = film.write(folder.path());
        let line = refusal(&path);
        assert!(line.contains("two fields") && line.contains("bwdif"), "{ending}: {line}");
        let cured = folder.path().join("cured.mkv");
        for (filters, count) in [("bwdif=mode=send_field", 24), ("setfield=prog", 12)] {
            let cure = Command::new("ffmpeg")
                .args(["-v", "error", "-y", "-i"])
                .arg(&path)
                .args(["-vf", filters, "-fps_mode", "passthrough", "-c:v", "ffv1"])
                .arg(&cured)
                .output()
                .unwrap();
            assert!(cure.status.success());
            assert_eq!(open(&cured).count, count, "{ending}, {filters}");
        }
    }
}

#[test]
fn a_size_that_changes_within_the_film_is_refused() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let codec = "-c:v mpeg2video -q:v 2";
    let mut list = String::new();
    for (name, size) in [("small", [64, 48]), ("large", [96, 64])] {
        let part = folder.path().join(name);
        std::fs::create_dir(&part).unwrap();
        let film = Film { ending: "ts", codec, size, numbers: (0..4).collect(), ..Film::default() };
        let pixels = |number: u32| (0..size[0] * size[1]).map(|at| (at * 7 + number * 40) as u8).collect();
        list += &format!("file '{}'\n", film.write_pixels(&part, pixels).display());
    }
    let (parts, path) = (folder.path().join("parts.txt"), folder.path().join("joined.ts"));
    std::fs::write(&parts, list).unwrap();
    let mut join = Command::new("ffmpeg");
    join.args(["-v", "error", "-f", "concat", "-safe", "0", "-i"]).arg(&parts).args(["-c", "copy"]).arg(&path);
    assert!(join.status().unwrap().success());
    let line = refusal(&path);
    assert!(line.contains("size changes"), "{line}");
}

#[test]
fn odd_sizes_are_read_whole() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let size = [53, 37];
    let pixels = |number: u32| -> Vec<u8> { (0..53 * 37).map(|at: u32| (at * 3 + number * 50) as u8).collect() };
    for (ending, codec) in [("mkv", "-c:v ffv1"), ("mov", "-c:v png"), ("avi", "-c:v rawvideo -pix_fmt gray")] {
        let film = Film { ending, codec, size, ..Film::default() };
        let read = frames(open(&film.write_pixels(folder.path(), pixels)));
        assert_eq!((read[2].0.width_px, read[2].0.height_px), (53, 37));
        assert_eq!(read[2].1, pixels(2), "{ending}");
    }
}
