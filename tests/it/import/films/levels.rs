//! Depths, ranges and colours.

use super::maker::{Film, frame, frames, has_ffmpeg, open};
use ricochet::image::PixelFormat;

#[test]
fn every_depth_keeps_its_levels() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let depths = [
        ("gray", 8, PixelFormat::Mono8),
        ("gray10le", 10, PixelFormat::Mono10),
        ("gray12le", 12, PixelFormat::Mono12),
        ("gray16le", 16, PixelFormat::Mono16),
    ];
    for (layout, bits, format) in depths {
        let pixels = |number: u32| -> Vec<u8> {
            if bits == 8 {
                return frame(number);
            }
            // The lowest bits are in use.
            let levels =
                frame(number).into_iter().zip(0_u16..).map(|(level, at)| (u16::from(level) << (bits - 8)) | (at % 4));
            levels.flat_map(u16::to_le_bytes).collect()
        };
        for ending in ["mkv", "nut", "avi"] {
            let codec = format!("-c:v ffv1 -pix_fmt {layout}");
            let film = Film { ending, codec: &codec, layout, numbers: (0..3).collect(), ..Film::default() };
            let footage = open(&film.write_pixels(folder.path(), pixels));
            assert_eq!((footage.format, footage.provenance.bits), (format, bits), "{layout} {ending}");
            assert_eq!(frames(footage)[1].1, pixels(1), "{layout} {ending}");
        }
    }
}

/// Black, grey and white of a limited and of a full range have the same levels.
#[test]
fn limited_and_full_range_come_out_alike() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let bars = |_: u32| -> Vec<u8> { (0..64 * 48_u32).map(|at| [0, 60, 128, 255][(at % 64 / 16) as usize]).collect() };
    let cases = [
        ("mkv", "-c:v ffv1 -pix_fmt yuv420p", "scale=out_range=tv", "16 and white 235"),
        ("mkv", "-c:v ffv1 -pix_fmt yuv420p -color_range pc", "scale=out_range=pc", "the luma"),
        ("mp4", "-c:v libx264 -crf 1 -pix_fmt yuv420p", "scale=out_range=tv", "16 and white 235"),
        ("avi", "-c:v mjpeg -q:v 1 -pix_fmt yuvj422p", "null", "the luma"),
        ("mkv", "-c:v ffv1 -pix_fmt yuv422p10le", "scale=out_range=tv", "16 and white 235"),
        ("mov", "-c:v png -pix_fmt rgb24", "null", "0.299 R"),
        ("mkv", "-c:v ffv1 -pix_fmt bgr0", "null", "0.299 R"),
        ("mov", "-c:v png -pix_fmt rgba", "null", "without its transparency"),
        ("gif", "-c:v gif", "null", "0.299 R"),
        ("mpg", "-c:v mpeg2video -q:v 1 -pix_fmt yuv420p", "scale=out_range=tv", "16 and white 235"),
        ("mxf", "-c:v mpeg2video -q:v 1 -pix_fmt yuv422p", "scale=out_range=tv", "16 and white 235"),
    ];
    for (ending, codec, filters, rule) in cases {
        let film = Film { ending, codec, filters, numbers: (0..2).collect(), rate: "25", ..Film::default() };
        let footage = open(&film.write_pixels(folder.path(), bars));
        let summary = footage.summary();
        println!("{codec}: {summary}");
        assert!(summary.contains(rule), "{codec}: {summary}");
        let bytes = footage.format.bytes_per_pixel();
        let full = f64::from((1_u32 << footage.format.bits()) - 1);
        let pixels = frames(footage).remove(0).1;
        let level = |x: usize| match bytes {
            1 => f64::from(pixels[24 * 64 + x]),
            _ => f64::from(u16::from_le_bytes([pixels[(24 * 64 + x) * 2], pixels[(24 * 64 + x) * 2 + 1]])),
        };
        for (x, expected) in [(8, 0.0), (24, 60.0), (40, 128.0), (56, 255.0)] {
            let off = level(x) / full * 255.0 - expected;
            assert!(off.abs() < 2.6, "{codec}: {off} at {x}");
        }
    }
}

#[test]
fn colours_become_grey_by_the_stated_weights() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let colours = [[200, 0, 0], [0, 200, 0], [0, 0, 200], [120, 80, 30]];
    let bars = |_: u32| -> Vec<u8> { (0..64 * 48_u32).flat_map(|at| colours[(at % 64 / 16) as usize]).collect() };
    for (ending, codec) in [("mov", "-c:v png -pix_fmt rgb24"), ("mkv", "-c:v ffv1 -pix_fmt gbrp16le")] {
        let film = Film { ending, codec, layout: "rgb24", numbers: (0..2).collect(), ..Film::default() };
        let footage = open(&film.write_pixels(folder.path(), bars));
        let bytes = footage.format.bytes_per_pixel();
        let pixels = frames(footage).remove(0).1;
        for (bar, [red, green, blue]) in colours.iter().enumerate() {
            let expected = 0.299 * f64::from(*red) + 0.587 * f64::from(*green) + 0.114 * f64::from(*blue);
            let at = (24 * 64 + 16 * bar + 8) * bytes;
            // The upper byte of a word of 16 bits.
            let level = f64::from(pixels[at + bytes - 1]);
            assert!((level - expected).abs() < 2.0, "{codec}, {bar}: {level}, expected {expected}");
        }
    }
}
