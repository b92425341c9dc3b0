//! Videos written and read by an installed ffmpeg.

use super::samples;
use crate::support::{ricochet, run, succeed};
use ricochet::command::export::{self, ExportOptions, Format};
use ricochet::console::Overwrite;
use ricochet::image::{Frame, FrameMeta, PixelFormat};
use ricochet::import;
use ricochet::recording::{Recording, RecordingWriter, WriterOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const SIZE: [u32; 2] = [48, 33];
const FRAMES: u64 = 7;

/// Whether ffmpeg is installed. Reports that the test was left out if not.
pub fn has_ffmpeg() -> bool {
    let is_there = Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success());
    if !is_there {
        let required = crate::support::is_required("FFMPEG");
        assert!(!required, "ffmpeg is required but not installed");
        eprintln!("left out: ffmpeg is not installed");
    }
    is_there
}

/// A smooth image that differs from frame to frame.
fn pixels(number: u64) -> Vec<u8> {
    let level = |x: u32, y: u32| {
        let (x, y) = (f64::from(x) - 20.0 - number as f64, f64::from(y) - 16.0);
        (40.0 + 180.0 * (-(x * x + y * y) / 150.0).exp() + f64::from(number as u32)).round() as u8
    };
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| level(x, y))).collect()
}

fn recording(path: &Path) {
    let mut writer = RecordingWriter::create(path, &samples::info(), &WriterOptions::default()).unwrap();
    for sequence in 0..FRAMES {
        let bytes = pixels(sequence);
        let meta = FrameMeta {
            sequence,
            stamp_ns: samples::START_NS + sequence * 100_000,
            width_px: SIZE[0],
            height_px: SIZE[1],
            stride_bytes: SIZE[0],
            format: PixelFormat::Mono8,
            ..FrameMeta::default()
        };
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        writer.write_track(&samples::track(sequence)).unwrap();
    }
    writer.finish().unwrap();
}

fn options(file: &Path, topic: &str, format: Format, output: &Path) -> ExportOptions {
    ExportOptions {
        file: file.into(),
        topic: topic.into(),
        camera: None,
        format,
        output: Some(output.into()),
        film: Vec::new(),
        playback_hz: 25.0,
        overwrite: Overwrite::ALLOWED,
    }
}

/// Encodes raw frames with ffmpeg itself.
fn encode(to: &Path, kind: &str, rate: &str, codec: &[&str], frames: &[Vec<u8>]) {
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "rawvideo", "-pixel_format", kind, "-video_size", &size, "-framerate", rate])
        .args(["-i", "pipe:0"])
        .args(codec)
        .arg(to)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = ffmpeg.stdin.take().unwrap();
    frames.iter().for_each(|frame| pipe.write_all(frame).unwrap());
    drop(pipe);
    assert!(ffmpeg.wait().unwrap().success());
}

/// Small videos, with their file extensions.
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Vec<u8>> = (0..3).map(pixels).collect();
    let kinds = [(".avi", ["-c:v", "rawvideo"]), (".mkv", ["-c:v", "ffv1"]), (".mov", ["-c:v", "png"])];
    let seed = |(ending, codec): (&'static str, [&str; 2])| {
        let path = folder.path().join(format!("film{ending}"));
        encode(&path, "gray", "25", &codec, &frames);
        (ending, std::fs::read(path).unwrap())
    };
    kinds.map(seed).into()
}

fn imported(path: &Path, fps: Option<f64>) -> (Vec<String>, Vec<(FrameMeta, Vec<u8>)>) {
    let footage = import::open(&[path.to_path_buf()], fps).unwrap();
    let (count, warnings) = (footage.count, footage.warnings.clone());
    let frames: Vec<_> = footage.map(Result::unwrap).collect();
    assert_eq!(frames.len() as u64, count);
    (warnings, frames)
}

#[test]
fn a_lossless_video_is_read_exactly_at_its_own_rate_or_the_given_one() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Vec<u8>> = (0..FRAMES).map(pixels).collect();
    for (name, codec) in [("film.avi", "ffv1"), ("film.mkv", "ffv1"), ("film.mov", "png"), ("raw.avi", "rawvideo")] {
        let path = folder.path().join(name);
        encode(&path, "gray", "250", &["-r", "250", "-c:v", codec, "-pix_fmt", "gray"], &frames);
        let (warnings, read) = imported(&path, None);
        assert!(warnings.len() == 1 && warnings[0].contains("plays at 250 frames/s"), "{name}: {warnings:?}");
        for (k, (meta, bytes)) in (0_u64..).zip(&read) {
            assert_eq!((meta.width_px, meta.height_px, meta.format), (SIZE[0], SIZE[1], PixelFormat::Mono8), "{name}");
            assert_eq!((meta.sequence, meta.stamp_ns), (k, k * 4_000_000), "{name}");
            assert_eq!(bytes, &frames[k as usize], "{name}, frame {k}");
        }
        let (warnings, read) = imported(&path, Some(10_000.0));
        assert_eq!((warnings.len(), read[3].0.stamp_ns), (0, 300_000), "{name}: {warnings:?}");
    }
    // A file whose name looks like a URL, and one that only pretends to be a video.
    let odd = folder.path().join("http:--a.avi");
    std::fs::copy(folder.path().join("film.avi"), &odd).unwrap();
    assert_eq!(imported(&odd, None).1.len() as u64, FRAMES);
    std::fs::write(&odd, "#EXTM3U\nhttp://localhost/film.ts\n").unwrap();
    let message = import::open(&[odd], None).unwrap_err().to_string();
    assert!(message.contains("http:--a.avi") && !message.contains('\n'), "{message}");
}

#[test]
fn a_16_bit_video_keeps_its_levels_and_a_colour_video_is_reported() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let deep = folder.path().join("deep.mkv");
    let frames: Vec<Vec<u8>> =
        (0..3).map(|k| pixels(k).iter().flat_map(|level| (u16::from(*level) * 257).to_le_bytes()).collect()).collect();
    encode(&deep, "gray16le", "100", &["-c:v", "ffv1", "-pix_fmt", "gray16le"], &frames);
    let read = imported(&deep, None).1;
    assert!(read.iter().zip(&frames).all(|(read, bytes)| read.0.format == PixelFormat::Mono16 && read.1 == *bytes));

    let colours = folder.path().join("colours.mp4");
    let even: Vec<Vec<u8>> = (0..FRAMES).map(pixels).collect();
    encode(&colours, "gray", "100", &["-vf", "pad=48:34", "-pix_fmt", "yuv420p", "-crf", "5"], &even);
    let (warnings, read) = imported(&colours, None);
    assert!(warnings.len() == 2 && warnings[1].contains("yuv420p"), "{warnings:?}");
    assert!(off(&read, &even) < 2.0);
}

/// The mean difference of the grey levels, over the rows that both have.
fn off(read: &[(FrameMeta, Vec<u8>)], frames: &[Vec<u8>]) -> f64 {
    assert_eq!(read.len(), frames.len());
    let pairs = read.iter().zip(frames).flat_map(|((_, bytes), frame)| bytes.iter().zip(frame));
    let (sum, count) = pairs.fold((0.0, 0.0), |(sum, n), (a, b)| (sum + f64::from(a.abs_diff(*b)), n + 1.0));
    sum / count
}

#[test]
fn an_mp4_holds_every_frame_at_the_requested_rate() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (shot, film) = (folder.path().join("shot.mcap"), folder.path().join("-film.mp4"));
    recording(&shot);
    let asked = ExportOptions { playback_hz: 12.5, ..options(&shot, "frames", Format::Mp4, &film) };
    assert_eq!(export::run(&asked).unwrap().rows, FRAMES);
    let (warnings, read) = imported(&film, None);
    assert!(warnings[0].contains("plays at 12.5 frames/s"), "{warnings:?}");
    // An odd height gets one more row, because players require even sizes.
    assert_eq!((read[0].0.width_px, read[0].0.height_px), (48, 34));
    let frames: Vec<Vec<u8>> = (0..FRAMES).map(pixels).collect();
    let off = off(&read, &frames);
    println!("mean error {off:.2} of 255 levels");
    assert!(off < 1.5, "{off}");
    // With the results drawn over the frames.
    let drawn = folder.path().join("drawn.mp4");
    assert_eq!(export::run(&options(&shot, "track", Format::Mp4, &drawn)).unwrap().rows, FRAMES);
    let large = imported(&drawn, None).1;
    assert_eq!((large[0].0.width_px, large[0].0.height_px), (4 * 48, 4 * 33), "enlarged like the PNG images");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "nothing else was written");
}

#[test]
fn a_gif_keeps_the_grey_levels() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (shot, film) = (folder.path().join("shot.mcap"), folder.path().join("film.gif"));
    recording(&shot);
    for topic in ["field", "frames"] {
        assert_eq!(export::run(&options(&shot, topic, Format::Gif, &film)).unwrap().rows, FRAMES);
    }
    let decoded = Command::new("ffmpeg")
        .args(["-v", "error", "-i"])
        .arg(&film)
        .args(["-f", "rawvideo", "-pix_fmt", "gray", "pipe:1"])
        .output()
        .unwrap();
    let expected: Vec<u8> = (0..FRAMES).flat_map(pixels).collect();
    assert_eq!(decoded.stdout.len(), expected.len());
    assert!(decoded.stdout.iter().zip(&expected).all(|(a, b)| a.abs_diff(*b) <= 1), "grey by way of RGB");
}

#[test]
fn without_ffmpeg_a_video_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let (shot, film) = (folder.path().join("shot.mcap"), folder.path().join("film.mp4"));
    recording(&shot);
    let command = ["export".as_ref(), shot.as_os_str(), "--topic".as_ref(), "frames".as_ref()];
    let format = ["--format".as_ref(), "mp4".as_ref(), "-o".as_ref(), film.as_os_str()];
    let output = ricochet(command.into_iter().chain(format)).env("PATH", "").output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), message.lines().count()), (Some(2), 1), "{message}");
    assert!(message.contains("--format mp4") && message.contains("ffmpeg"), "{message}");
    assert!(!film.exists());
    std::fs::write(folder.path().join("film.avi"), "RIFF").unwrap();
    let import = ["import".into(), folder.path().join("film.avi"), "-o".into(), folder.path().join("a.mcap")];
    let output = ricochet(import).env("PATH", "").output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && message.contains("film.avi") && message.contains("ffmpeg"), "{message}");
    assert_eq!(message.lines().count(), 1, "{message}");
}

#[test]
fn a_video_that_cannot_be_written_is_reported_with_the_reason() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let shot = folder.path().join("shot.mcap");
    recording(&shot);
    let to = folder.path().join("missing/film.mp4");
    let message = export::run(&options(&shot, "frames", Format::Mp4, &to)).unwrap_err().to_string();
    assert!(
        message.contains("film.mp4") && message.contains("its folder does not exist") && !message.contains('\n'),
        "{message}"
    );
}

#[test]
fn a_video_is_measured_like_any_other_input() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = folder.path().join("film.avi");
    encode(&film, "gray", "30", &["-c:v", "ffv1", "-pix_fmt", "gray"], &(0..FRAMES).map(pixels).collect::<Vec<_>>());
    let shot: PathBuf = folder.path().join("shot.mcap");
    let words = ["import".as_ref(), film.as_os_str(), "--fps".as_ref(), "10000".as_ref(), "-o".as_ref()];
    succeed(words.into_iter().chain([shot.as_os_str()]));
    let recording = Recording::open(&shot).unwrap();
    assert_eq!((recording.frame_count(), recording.metadata()["codec"].as_str()), (FRAMES, "ffv1"));
    assert_eq!(recording.metadata()["frame_rate_hz"], "10000");
    let read: Vec<Vec<u8>> = recording.frames().unwrap().map(|frame| frame.unwrap().1).collect();
    assert_eq!(read, (0..FRAMES).map(pixels).collect::<Vec<_>>());
    // A truncated video gives one line, or is measured as far as it can be read.
    let bytes = std::fs::read(&film).unwrap();
    std::fs::write(&film, &bytes[..300]).unwrap();
    let output = run(["import".as_ref(), film.as_os_str(), "-o".as_ref(), folder.path().join("b.mcap").as_os_str()]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && message.contains("film.avi"), "{message}");
}
