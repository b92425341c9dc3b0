//! Rerun opens our files.

use super::samples;
use ricochet::image::PixelFormat;
use ricochet::recording::{Compression, WriterOptions};
use std::path::Path;
use std::process::Command;

/// The script's output for a recording, or `None` and a line without Rerun.
fn rerun(path: &Path) -> Option<String> {
    let importable = Command::new("python3").args(["-c", "import rerun.chunk"]).output();
    if !importable.is_ok_and(|output| output.status.success()) {
        let required = crate::support::is_required("RERUN");
        assert!(!required, "python3 with rerun-sdk 0.41 is required but not installed");
        eprintln!("left out: python3 with rerun-sdk 0.41 is not installed");
        return None;
    }
    let output = Command::new("python3").arg("-c").arg(include_str!("read_rerun.py")).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(String::from_utf8(output.stdout).unwrap())
}

#[test]
fn rerun_loads_pixels_as_images_and_numbers_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Zstd1] {
        let path = folder.path().join(format!("{compression:?}.mcap"));
        let options = WriterOptions { compression, ..WriterOptions::default() };
        samples::write(&path, &options, 10, [20, 10]).finish().unwrap();
        let Some(text) = rerun(&path) else { return };
        let mut expected = Vec::new();
        for k in 0..10 {
            let (meta, pixels) = samples::frame(k, PixelFormat::Mono8, [20, 10], 0);
            let crc = crc32fast::hash(&pixels);
            expected.push(format!("image {} 20x10 {} bytes {crc:08x}", meta.stamp_ns, pixels.len()));
            let sample = samples::velocity(k, 0);
            let bits = sample.velocity.map_or("none".into(), |v| format!("{:016x}", v.vx_m_s.to_bits()));
            expected.push(format!("velocity {k} {} {bits} {}", sample.stamp_ns, sample.status.as_str()));
        }
        let mut lines: Vec<&str> = text.lines().collect();
        lines.sort_unstable();
        expected.sort_unstable();
        assert_eq!(lines, expected, "{compression:?}");
    }
}
