//! Every container with every kind of film: the right value, or a refusal that names the cause.
//!
//! A cell is empty only where no encoder writes such a film, which is listed.

use super::maker::{Film, HEIGHT, WIDTH, frame, frames, has_ffmpeg, open, patched_matrix, recognised, refusal};
use ricochet::import;
use std::path::Path;

/// A container, with the encoders that fill it.
struct Container {
    ending: &'static str,
    /// Encoder of grey films of 8 bits.
    codec: &'static str,
    /// Options that give the encoder a fine clock; empty where the container has a constant rate.
    clock: &'static str,
    /// Largest error of a time by the clock of the container, s: its step, in GIF with the rounding of durations.
    tick_s: f64,
    /// Encoder of films of two fields; empty without one.
    interlaced: &'static str,
    /// Encoders of films of more than 8 bits: number of bits and options.
    deep: &'static [(u32, &'static str)],
}

const X264: &str = "-c:v libx264 -crf 8 -pix_fmt yuv420p";
const X264_FINE: &str = "-c:v libx264 -crf 8 -pix_fmt yuv420p -video_track_timescale 90000";
const FINE: &str = "-enc_time_base 1:90000";
const MPEG2: &str = "-c:v mpeg2video -q:v 2";
const FIELDS: &str = "-c:v mpeg2video -q:v 2 -flags +ildct+ilme";
const DEEP_FFV1: &[(u32, &str)] =
    &[(10, "-c:v ffv1 -pix_fmt gray10le"), (12, "-c:v ffv1 -pix_fmt gray12le"), (16, "-c:v ffv1 -pix_fmt gray16le")];
const DEEP_MPEG: &[(u32, &str)] = &[
    (10, "-c:v libx264 -crf 4 -pix_fmt yuv420p10le"),
    (12, "-c:v libx265 -x265-params log-level=none -crf 4 -pix_fmt yuv420p12le"),
];

const CONTAINERS: [Container; 12] = [
    Container {
        ending: "avi",
        codec: "-c:v mjpeg -q:v 2",
        clock: "-enc_time_base 1:1000",
        tick_s: 0.001,
        interlaced: FIELDS,
        deep: DEEP_FFV1,
    },
    Container {
        ending: "mp4",
        codec: X264_FINE,
        clock: FINE,
        tick_s: 1.0 / 90_000.0,
        interlaced: "-c:v libx264 -pix_fmt yuv420p -x264opts tff=1",
        deep: &[
            (10, "-c:v libx264 -crf 4 -pix_fmt yuv420p10le"),
            (12, "-c:v libx265 -x265-params log-level=none -crf 4 -pix_fmt yuv420p12le"),
            (16, "-c:v png -pix_fmt gray16be"),
        ],
    },
    Container {
        ending: "mov",
        codec: "-c:v mjpeg -q:v 2 -video_track_timescale 90000",
        clock: FINE,
        tick_s: 1.0 / 90_000.0,
        interlaced: "-c:v prores_ks -flags +ildct",
        deep: &[
            (10, "-c:v prores_ks -profile:v 3 -pix_fmt yuv422p10le"),
            (12, "-c:v libx265 -x265-params log-level=none -crf 4 -pix_fmt yuv420p12le"),
            (16, "-c:v png -pix_fmt gray16be"),
        ],
    },
    Container {
        ending: "mkv",
        codec: "-c:v ffv1",
        clock: FINE,
        tick_s: 0.001,
        interlaced: "-c:v ffv1 -flags +ildct+ilme",
        deep: DEEP_FFV1,
    },
    Container {
        ending: "webm",
        codec: "-c:v libvpx-vp9 -b:v 1M -deadline realtime",
        clock: FINE,
        tick_s: 0.001,
        interlaced: "",
        deep: &[
            (10, "-c:v libvpx-vp9 -profile:v 2 -crf 4 -b:v 0 -pix_fmt yuv420p10le"),
            (12, "-c:v libvpx-vp9 -profile:v 2 -crf 4 -b:v 0 -pix_fmt yuv420p12le"),
        ],
    },
    Container { ending: "ts", codec: X264, clock: FINE, tick_s: 1.0 / 90_000.0, interlaced: FIELDS, deep: DEEP_MPEG },
    Container {
        ending: "m2ts",
        codec: X264,
        clock: FINE,
        tick_s: 1.0 / 90_000.0,
        interlaced: "-c:v libx264 -pix_fmt yuv420p -x264opts tff=1",
        deep: DEEP_MPEG,
    },
    Container { ending: "gif", codec: "-c:v gif", clock: FINE, tick_s: 0.015, interlaced: "", deep: &[] },
    Container {
        ending: "nut",
        codec: "-c:v ffv1",
        clock: FINE,
        tick_s: 1.0 / 90_000.0,
        interlaced: FIELDS,
        deep: DEEP_FFV1,
    },
    Container {
        ending: "flv",
        codec: "-c:v flv -q:v 2",
        clock: FINE,
        tick_s: 0.001,
        interlaced: "-c:v libx264 -pix_fmt yuv420p -x264opts tff=1",
        deep: &[(10, "-c:v libx264 -crf 4 -pix_fmt yuv420p10le")],
    },
    Container {
        ending: "mpg",
        codec: MPEG2,
        clock: "-enc_time_base 1:50",
        tick_s: 0.02,
        interlaced: FIELDS,
        deep: &[],
    },
    Container {
        ending: "mxf",
        codec: MPEG2,
        clock: "",
        tick_s: 0.02,
        interlaced: FIELDS,
        deep: &[
            (10, "-c:v libopenjpeg -pix_fmt gray10le"),
            (12, "-c:v libopenjpeg -pix_fmt gray12le"),
            (16, "-c:v libopenjpeg -pix_fmt gray16le"),
        ],
    },
];

impl Container {
    /// A film of 24 frames with the encoder of this container.
    fn film<'a>(&'a self, codec: &'a str) -> Film<'a> {
        let rate = if self.ending == "mxf" { "25" } else { "50" };
        Film { ending: self.ending, codec, rate, numbers: (0..24).collect(), ..Film::default() }
    }

    fn rate_hz(&self) -> f64 {
        if self.ending == "mxf" { 25.0 } else { 50.0 }
    }
}

/// Opens a film, or checks that the refusal is one of those named.
fn open_or_refuse(path: &Path, reasons: &[&str]) -> Option<import::Footage> {
    match import::open(&[path.to_path_buf()], None) {
        Ok(footage) => Some(footage),
        Err(error) => {
            let line = error.to_string();
            assert!(reasons.iter().any(|reason| line.contains(reason)), "{line}");
            println!("  refused: {line}");
            None
        }
    }
}

/// The moments of frames, in periods, are those of the film: constant, late, with a gap, with an odd first interval, and
/// irregular.
#[test]
fn the_times_of_every_container_are_those_of_its_film() {
    if !has_ffmpeg() {
        return;
    }
    /// The time of a frame in periods, and its number.
    type Moment = fn(f64) -> (f64, f64);
    let kinds: [(&str, &str, Moment); 5] = [
        ("constant", "N", |n| (n, n)),
        ("late", "N+37", |n| (n, n)),
        ("gap", "N+3*gte(N\\,6)", |n| if n < 6.0 { (n, n) } else { (n + 3.0, n + 3.0) }),
        ("odd first interval", "N+0.6*gte(N\\,1)", |n| if n < 1.0 { (n, n) } else { (n + 0.6, n + 1.0) }),
        ("irregular", "N+0.35*sin(2.1*N)", |n| (n + 0.35 * (2.1 * n).sin(), n)),
    ];
    for (kind, expression, moment) in kinds {
        // AVI has no time of its first frame, MXF none of any.
        let stores = |ending| kind == "constant" || ending != "mxf" && (kind != "late" || ending != "avi");
        for container in CONTAINERS.iter().filter(|container| stores(container.ending)) {
            let folder = tempfile::tempdir().unwrap();
            let filters = format!("settb=1/90000,setpts=round(({expression})/50/TB)");
            let codec = format!("{} {}", container.codec, container.clock);
            let mut film = container.film(&codec);
            if !container.clock.is_empty() {
                film.filters = &filters;
            }
            let path = film.write(folder.path());
            println!("{kind}, {}", container.ending);
            let Some(footage) = open_or_refuse(&path, &["which is unknown"]) else { continue };
            println!("  {} {:?}", footage.summary(), footage.warnings);
            let summary = footage.summary();
            let read = frames(footage);
            assert_eq!(read.len(), 24, "{summary}");
            for (n, (meta, pixels)) in (0..).zip(&read) {
                assert_eq!(recognised(pixels), n, "{summary}");
                let (time, number) = moment(f64::from(n));
                let expected_s = (time - moment(0.0).0) / container.rate_hz();
                let off_s = meta.stamp_ns as f64 / 1e9 - expected_s;
                assert!(off_s.abs() <= container.tick_s + 1e-6, "frame {n}: {off_s} s off; {summary}");
                // A clock of half a period or coarser rounds irregular times, which changes the numbers of their frames.
                let is_exact = container.tick_s < 0.01 || kind == "constant" || kind == "gap";
                assert!(meta.sequence as f64 == number || !is_exact, "frame {n}: {}; {summary}", meta.sequence);
            }
        }
    }
}

/// Frames that a capture program stored twice have numbers that are missing.
#[test]
fn repeated_frames_of_every_container_are_left_out() {
    if !has_ffmpeg() {
        return;
    }
    let repeats = [7, 8, 15];
    for container in &CONTAINERS {
        let folder = tempfile::tempdir().unwrap();
        let film = container.film(container.codec);
        let shown = |n: u32| n - repeats.iter().filter(|repeat| **repeat <= n).count() as u32;
        let path = film.write_pixels(folder.path(), |n| frame(shown(n)));
        println!("{}", container.ending);
        let Some(footage) = open_or_refuse(&path, &["which is unknown"]) else { continue };
        println!("  {}", footage.summary());
        let findings = footage.findings.clone();
        let read = frames(footage);
        let expected: Vec<u32> = (0..24).filter(|n| !repeats.contains(n)).collect();
        let numbers: Vec<u32> = read.iter().map(|(meta, _)| meta.sequence as u32).collect();
        println!("  {findings:?}");
        assert_eq!(numbers, expected, "{}", container.ending);
        for (n, (_, pixels)) in expected.iter().zip(&read) {
            assert_eq!(recognised(pixels), shown(*n), "{}", container.ending);
        }
    }
}

/// The display matrix of MP4 and MOV turns by quarters and mirrors; no other container stores one.
#[test]
fn turned_and_mirrored_films_are_shown_upright() {
    if !has_ffmpeg() {
        return;
    }
    for container in CONTAINERS.iter().filter(|container| ["mp4", "mov"].contains(&container.ending)) {
        for (matrix, is_tall) in [([0, 1, -1, 0], true), ([0, -1, 1, 0], true), ([-1, 0, 0, 1], false)] {
            let folder = tempfile::tempdir().unwrap();
            let path = container.film(container.codec).write(folder.path());
            patched_matrix(&path, matrix);
            let footage = open(&path);
            println!("{} {matrix:?}: {}", container.ending, footage.summary());
            assert!(!footage.summary().contains("as stored"), "{}", footage.summary());
            let width = footage.width_px;
            assert_eq!(width, if is_tall { HEIGHT } else { WIDTH });
            let drawn = frame(3);
            for (at, level) in (0..).zip(&frames(footage)[3].1) {
                let [x, y] = [at % width, at / width];
                let [column, row] = match matrix {
                    [0, 1, -1, 0] => [y, HEIGHT - 1 - x],
                    [0, -1, 1, 0] => [WIDTH - 1 - y, x],
                    _ => [WIDTH - 1 - x, y],
                };
                assert!(drawn[(row * WIDTH + column) as usize].abs_diff(*level) < 24, "{at}");
            }
        }
    }
}

#[test]
fn pixels_of_every_container_become_square() {
    if !has_ffmpeg() {
        return;
    }
    for container in &CONTAINERS {
        let folder = tempfile::tempdir().unwrap();
        let film = Film { filters: "setsar=4/3", ..container.film(container.codec) };
        let footage = open(&film.write(folder.path()));
        println!("{}: {}", container.ending, footage.summary());
        // The encoder of FLV stores no aspect ratio.
        let expected = if container.ending == "flv" { WIDTH } else { 85 };
        assert_eq!(footage.width_px, expected, "{}: {}", container.ending, footage.summary());
    }
}

#[test]
fn films_of_two_fields_are_refused_in_every_container() {
    if !has_ffmpeg() {
        return;
    }
    for container in CONTAINERS.iter().filter(|container| !container.interlaced.is_empty()) {
        let folder = tempfile::tempdir().unwrap();
        let film = Film { filters: "setfield=tff", ..container.film(container.interlaced) };
        println!("{}", container.ending);
        let line = refusal(&film.write(folder.path()));
        assert!(line.contains("two fields"), "{}: {line}", container.ending);
    }
}

/// A ramp over all levels, of which a film of 8 bits would show 256.
#[test]
fn every_depth_of_every_container_keeps_its_levels() {
    if !has_ffmpeg() {
        return;
    }
    const LAST: u32 = WIDTH * HEIGHT - 1;
    let ramp = |_: u32| -> Vec<u8> { (0..=LAST).flat_map(|at| ((at * 65_535 / LAST) as u16).to_le_bytes()).collect() };
    for container in &CONTAINERS {
        for (bits, codec) in container.deep {
            let folder = tempfile::tempdir().unwrap();
            let film = Film { layout: "gray16le", ..container.film(codec) };
            let footage = open(&film.write_pixels(folder.path(), ramp));
            println!("{}, {bits} bit: {}", container.ending, footage.summary());
            assert_eq!((footage.provenance.bits, footage.format.bits()), (*bits, *bits), "{}", footage.summary());
            let pixels = frames(footage).remove(1).1;
            let levels: Vec<u16> = pixels.chunks_exact(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect();
            let full = f64::from((1_u32 << bits) - 1);
            let off = |(at, level): (u32, &u16)| (f64::from(*level) / full - f64::from(at) / f64::from(LAST)).abs();
            let worst = (0..).zip(&levels).map(off).fold(0.0, f64::max);
            let distinct = levels.iter().collect::<std::collections::BTreeSet<_>>().len();
            println!("  worst {worst:.4}, {distinct} levels");
            assert!(worst < 0.01 && distinct > 300, "{}, {bits} bit: {worst} {distinct}", container.ending);
        }
    }
}

/// Red, green, blue and skin as grey by the weights 0.299, 0.587, 0.114 of the stated rule.
#[test]
fn colours_of_every_container_become_the_stated_grey() {
    if !has_ffmpeg() {
        return;
    }
    let colours = [[200, 0, 0], [0, 200, 0], [0, 0, 200], [120, 80, 30]];
    let bars = |_: u32| -> Vec<u8> { (0..WIDTH * HEIGHT).flat_map(|at| colours[(at % WIDTH / 16) as usize]).collect() };
    for container in &CONTAINERS {
        let folder = tempfile::tempdir().unwrap();
        let film = Film { layout: "rgb24", ..container.film(container.codec) };
        let footage = open(&film.write_pixels(folder.path(), bars));
        let summary = footage.summary();
        println!("{}: {summary}", container.ending);
        assert!(summary.contains("luma") || summary.contains("0.299 R"), "{summary}");
        let pixels = frames(footage).remove(0).1;
        for (bar, [red, green, blue]) in colours.iter().enumerate() {
            let expected = 0.299 * f64::from(*red) + 0.587 * f64::from(*green) + 0.114 * f64::from(*blue);
            let level = f64::from(pixels[(HEIGHT / 2 * WIDTH) as usize + 16 * bar + 8]);
            // The encoder of GIF has 256 colours for all films.
            let limit = if container.ending == "gif" { 16.0 } else { 4.0 };
            assert!((level - expected).abs() < limit, "{}, bar {bar}: {level}, expected {expected}", container.ending);
        }
    }
}
