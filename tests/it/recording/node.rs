//! The packages that Foxglove and Lichtblick are made of read our files.

use super::samples;
use ricochet::image::PixelFormat;
use ricochet::recording::{Compression, WriterOptions};
use std::process::Command;

/// What the script prints of a recording; `None`, and a line, where the packages are not there.
fn node(path: &std::path::Path) -> Option<String> {
    let needed = "require('@mcap/core'); require('@mcap/support'); require('@foxglove/schemas/internal')";
    if !Command::new("node").args(["-e", needed]).output().is_ok_and(|output| output.status.success()) {
        let required = crate::support::is_required("NODE");
        assert!(!required, "node with @mcap/core, @mcap/support and @foxglove/schemas is required and not there");
        eprintln!("left out: node with the packages @mcap/core, @mcap/support and @foxglove/schemas is not there");
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
            expected.push(format!("velocity {k} {} {bits} {}", sample.stamp_ns, sample.status.word()));
        }
        let mut told: Vec<&str> = text.lines().collect();
        // Messages of one time come in the order of the file: frames and rows stand in chunks of their own.
        told[4..].sort_unstable();
        expected[4..].sort_unstable();
        assert_eq!(told, expected, "{compression:?}");
    }
}
