//! Rates, gaps, odd intervals and capture rates.

use super::maker::{Film, frames, has_ffmpeg, open, recognised, refusal};
use ricochet::import::{self, RateSource};

/// Containers for broadcasts and discs, which store a constant rate.
#[test]
fn containers_of_a_constant_rate_are_read() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (ending, rate) in [("mxf", "25"), ("mpg", "50"), ("m2ts", "60000/1001")] {
        let codec = "-c:v mpeg2video -q:v 2 -bf 2";
        let footage =
            open(&Film { ending, codec, rate, numbers: (0..16).collect(), ..Film::default() }.write(folder.path()));
        let (over, under) = rate.split_once('/').unwrap_or((rate, "1"));
        let rate_hz = over.parse::<f64>().unwrap() / under.parse::<f64>().unwrap();
        println!("{ending}: {}", footage.summary());
        assert_eq!((footage.frame_rate_hz, footage.provenance.missing), (rate_hz, 0), "{}", footage.summary());
        for (n, (meta, pixels)) in (0..).zip(frames(footage)) {
            assert_eq!((recognised(&pixels), meta.sequence), (n, n.into()), "{ending}");
        }
    }
}

/// An MPEG stream stores no time with small frames, which share a packet; MXF has no times at all.
#[test]
fn a_gap_among_frames_without_times_is_refused_and_any_other_is_found() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (mut found, mut refused) = (0, 0);
    for ending in ["mpg", "mpeg", "ts", "m2ts"] {
        for (codec, size) in [
            ("-c:v mpeg2video -q:v 2 -bf 2 -enc_time_base 1:50", [256, 192]),
            ("-c:v mpeg2video -q:v 2 -bf 0 -enc_time_base 1:50", [256, 192]),
            ("-c:v mpeg2video -q:v 12 -bf 2 -enc_time_base 1:50", [64, 48]),
            ("-c:v mpeg2video -q:v 12 -bf 0 -enc_time_base 1:50", [64, 48]),
        ] {
            let filters = "settb=1/90000,setpts=round((N+3*gte(N\\,9))/50/TB)";
            let film = Film { ending, codec, size, filters, numbers: (0..40).collect(), ..Film::default() };
            let pixels = |number: u32| {
                let level = |at: u32| (at * 7 + number * 40).wrapping_mul(0x9E37_79B1) >> 27;
                (0..size[0] * size[1]).map(|at| 60 + level(at) as u8 + (at % size[0]) as u8 / 4).collect()
            };
            let path = film.write_pixels(folder.path(), pixels);
            match import::open(std::slice::from_ref(&path), None) {
                Ok(footage) => {
                    println!("{ending} {codec}: {} {:?}", footage.summary(), footage.warnings);
                    let numbers: Vec<u64> = frames(footage).iter().map(|(meta, _)| meta.sequence).collect();
                    let expected: Vec<u64> = (0..40).map(|n| if n < 9 { n } else { n + 3 }).collect();
                    assert_eq!(numbers, expected, "{ending} {codec}");
                    found += 1;
                }
                Err(_) => {
                    let line = refusal(&path);
                    println!("{line}");
                    assert!(line.contains("frames are missing there, and which is unknown"), "{line}");
                    refused += 1;
                }
            }
        }
    }
    assert!(found >= 6 && refused >= 2, "{found} found, {refused} refused");
}

/// The moments of a phone film, whose frames come irregularly.
#[test]
fn frames_at_irregular_times_keep_them() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let codec = "-c:v libx264 -crf 12 -pix_fmt yuv420p -enc_time_base 1:90000 -video_track_timescale 90000";
    let filters = "settb=1/90000,setpts=(N+0.35*sin(2.1*N))/50/TB";
    let film = Film { ending: "mp4", codec, filters, numbers: (0..30).collect(), ..Film::default() };
    let footage = open(&film.write(folder.path()));
    println!("{} {:?}", footage.summary(), footage.warnings);
    assert!(footage.warnings.iter().any(|warning| warning.contains("the rate varies")));
    for (n, (meta, _)) in (0_u32..).zip(frames(footage)) {
        let expected_s = (f64::from(n) + 0.35 * (2.1 * f64::from(n)).sin()) / 50.0;
        assert!((meta.stamp_ns as f64 / 1e9 - expected_s).abs() < 2e-5, "frame {n}");
    }
}

/// Chunks without bytes, as VirtualDub writes them in place of dropped frames.
#[test]
fn an_empty_chunk_of_an_avi_film_is_a_missing_frame() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = Film { ending: "avi", codec: "-c:v rawvideo", numbers: (0..10).collect(), ..Film::default() };
    let path = film.write(folder.path());
    let mut bytes = std::fs::read(&path).unwrap();
    // The fifth chunk ends at once; what it held becomes a chunk that is skipped.
    let movie = bytes.windows(4).position(|name| name == b"movi").unwrap();
    let chunks = bytes.windows(4).enumerate().skip(movie).filter(|(_, name)| *name == b"00dc" || *name == b"00db");
    let at = chunks.map(|(at, _)| at).nth(4).unwrap();
    let size = u32::from_le_bytes(bytes[at + 4..at + 8].try_into().unwrap());
    bytes[at + 4..at + 8].fill(0);
    bytes[at + 8..at + 12].copy_from_slice(b"JUNK");
    bytes[at + 12..at + 16].copy_from_slice(&(size - 8).to_le_bytes());
    let index = bytes.windows(4).position(|name| name == b"idx1").unwrap();
    bytes[index + 8 + 16 * 4 + 12..index + 8 + 16 * 5].fill(0);
    std::fs::write(&path, bytes).unwrap();
    let footage = open(&path);
    println!("{}", footage.summary());
    assert_eq!((footage.provenance.missing, footage.provenance.gaps), (1, 1));
    let numbers: Vec<u64> = frames(footage).iter().map(|(meta, _)| meta.sequence).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 5, 6, 7, 8, 9]);
}

#[test]
fn times_in_milliseconds_of_a_fast_film_are_named_and_its_rate_decides() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = Film { rate: "5000", ..Film::default() };
    let path = film.write(folder.path());
    let footage = open(&path);
    // Twelve frames within 2 ms, by clocks of milliseconds.
    assert!((4000.0..7000.0).contains(&footage.frame_rate_hz), "{}", footage.summary());
    assert!(footage.warnings.iter().any(|warning| warning.contains("too coarse")), "{:?}", footage.warnings);
    let rate_hz = footage.frame_rate_hz;
    let read = frames(footage);
    assert!(read.iter().map(|(meta, _)| meta.sequence).eq(0..12));
    assert!((read[11].0.stamp_ns as f64 / 1e9 * rate_hz - 11.0).abs() < 1e-3);
    let read: Vec<_> = import::open(&[path], Some(20_000.0)).unwrap().map(Result::unwrap).collect();
    assert_eq!(read[11].0.stamp_ns, 550_000);
}

#[test]
fn a_tag_of_the_rate_of_capture_stretches_the_times_of_playback() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let x264 = "-c:v libx264 -pix_fmt yuv420p -movflags use_metadata_tags -metadata com.android.capture.fps=";
    let cases = [
        // Played at 30, captured at 240 and at 959.8: slow motion.
        ("30", "240.000000", 240.0, "com.android.capture.fps"),
        ("30", "959.8", 959.8, "com.android.capture.fps"),
        // A film that plays in real time.
        ("240", "240", 240.0, "times"),
        // A camera that lowered its rate in the dark.
        ("24", "30", 24.0, "times"),
    ];
    for (rate, tag, expected_hz, source) in cases {
        let codec = format!("{x264}{tag}");
        // A gap of two frames stays one.
        let filters = format!("setpts=(N+2*gte(N\\,5))/{rate}/TB");
        let film = Film { ending: "mp4", codec: &codec, rate, filters: &filters, ..Film::default() };
        let path = film.write(folder.path());
        let footage = open(&path);
        println!("{rate} {tag}: {} {:?}", footage.summary(), footage.warnings);
        assert!((footage.frame_rate_hz / expected_hz - 1.0).abs() < 1e-9, "{}", footage.summary());
        assert!(footage.provenance.rate.to_string().contains(source), "{}", footage.summary());
        assert_eq!(footage.provenance.missing, 2);
        assert!(!footage.warnings.iter().any(|warning| warning.contains("--fps")), "{:?}", footage.warnings);
        let read = frames(footage);
        let last_s = read[11].0.stamp_ns as f64 / 1e9;
        assert!((last_s * expected_hz - 13.0).abs() < 1e-3, "{last_s}");
        // The rate of the user stands above the tag.
        let footage = import::open(&[path], Some(1000.0)).unwrap();
        assert_eq!((footage.frame_rate_hz, &footage.provenance.rate), (1000.0, &RateSource::Option));
        assert_eq!(footage.map(Result::unwrap).last().unwrap().0.stamp_ns, 13_000_000);
    }
}

/// Sony cameras store an XML text next to the film.
#[test]
fn a_rate_of_capture_in_xml_is_found() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let film = Film { ending: "mp4", codec: "-c:v libx264 -pix_fmt yuv420p", rate: "25", ..Film::default() };
    let path = film.write(folder.path());
    let xml = b"<VideoFrame videoCodec=\"AVC\" captureFps=\"100.00p\" formatFps=\"25p\"/>";
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.extend((8 + xml.len() as u32).to_be_bytes());
    bytes.extend(b"uuid");
    bytes.extend(xml);
    std::fs::write(&path, bytes).unwrap();
    let footage = open(&path);
    assert_eq!(footage.frame_rate_hz, 100.0, "{}", footage.summary());
    assert!(footage.summary().contains("captureFps"), "{}", footage.summary());
}

/// Browsers play frames of 10 ms for 100 ms. The film was stored at 100 frames/s.
#[test]
fn the_frames_of_a_fast_gif_have_the_times_that_it_stores() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let footage = open(&Film { ending: "gif", codec: "-c:v gif", rate: "100", ..Film::default() }.write(folder.path()));
    println!("{} {:?}", footage.summary(), footage.warnings);
    assert_eq!(footage.frame_rate_hz, 100.0, "{}", footage.summary());
    for (n, (meta, _)) in (0..).zip(frames(footage)) {
        assert_eq!((meta.sequence, meta.stamp_ns), (n, n * 10_000_000));
    }
}
