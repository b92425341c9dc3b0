//! The packages of Foxglove and Lichtblick read our files.

use super::samples;
use ricochet::image::PixelFormat;
use ricochet::recording::{Compression, WriterOptions};
use std::process::Command;

/// The script's output for a recording, or `None` and a line without the packages.
fn node(path: &std::path::Path) -> Option<String> {
    let needed = "require('@mcap/core'); require('@mcap/support'); require('@foxglove/schemas/internal')";
    if !Command::new("node").args(["-e", needed]).output().is_ok_and(|output| output.status.success()) {
        let required = crate::support::is_required("NODE");
        assert!(!required, "node with @mcap/core, @mcap/support and @foxglove/schemas is required but not installed");
        eprintln!("left out: node with the packages @mcap/core, @mcap/support and @foxglove/schemas is not installed");
        return None;
    }
    let output = Command::new("node").args(["-e", include_str!("read_recording.js")]).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn the_packages_of_the_viewers_read_pixels_and_numbers() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Zstd1] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let options = WriterOptions { compression, ..WriterOptions::default() };
        samples::write(&path, &options, 10, [20, 10]).finish().unwrap();
        let Some(text) = node(&path) else { return };
        let mut expected = vec![
            format!("attachment config.toml {}", samples::info().config_toml.len()),
            "attachment calibration.json 2".into(),
            "metadata ricochet simulated".into(),
            "fields true".into(),
        ];
        for k in 0..10 {
            let (meta, pixels) = samples::frame(k, PixelFormat::Mono8, [20, 10], 0);
            let crc = crc32fast::hash(&pixels);
            expected.push(format!("image {} 20x10 mono8 step 20 {} bytes {crc:08x}", meta.stamp_ns, pixels.len()));
            let sample = samples::velocity(k, 0);
            let bits = sample.velocity.map_or("none".into(), |v| format!("{:016x}", v.vx_m_s.to_bits()));
            expected.push(format!("velocity {k} {} {bits} {}", sample.stamp_ns, sample.status.as_str()));
        }
        let mut lines: Vec<&str> = text.lines().collect();
        // Messages with equal times come in the order of the file, where frames and rows have separate chunks.
        lines[4..].sort_unstable();
        expected[4..].sort_unstable();
        assert_eq!(lines, expected, "{compression:?}");
    }
}
