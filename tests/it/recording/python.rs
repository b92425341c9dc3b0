//! The Python `mcap` library reads our files, and we read its.

use super::samples;
use crate::support::python;
use ricochet::image::PixelFormat;
use ricochet::recording::{Recording, WriterOptions};

#[test]
fn the_python_library_reads_pixels_rows_and_the_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("shot.mcap");
    samples::write(&path, &WriterOptions::default(), 10, [20, 10]).finish().unwrap();
    let Some(text) = python(include_str!("read_recording.py"), &[&path]) else { return };
    let mut expected = vec![format!("config.toml {:?}", samples::info().config_toml)];
    expected.push("metadata simulated ball".into());
    for k in 0..10 {
        let (meta, pixels) = samples::frame(k, PixelFormat::Mono8, [20, 10], 0);
        let crc = crc32fast::hash(&pixels);
        expected.push(format!("image {} 20x10 mono8 step 20 {} bytes {crc:08x}", meta.stamp_ns, pixels.len()));
    }
    for k in 0..10 {
        let sample = samples::velocity(k, 0);
        let bits = sample.velocity.map_or("none".into(), |v| format!("{:016x}", v.vx_m_s.to_bits()));
        expected.push(format!("velocity {k} {} {bits} {}", sample.stamp_ns, sample.status.as_str()));
    }
    let field = samples::field(0);
    let measured = field.points.iter().filter(|point| point.displacement.is_some()).count();
    expected.push(format!("field {} points {measured} measured", field.points.len()));
    expected.push("impact 0.0125 1e-06 None".into());
    assert_eq!(text.lines().collect::<Vec<_>>(), expected);
}

#[test]
fn a_file_of_the_python_library_with_nothing_but_images_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("python.mcap");
    // The schema comes from a recording of this program, so that no third package is needed.
    let schema = folder.path().join("python.mcap.schema");
    std::fs::write(&schema, ricochet::recording::Topic::Image.schema_data()).unwrap();
    if python(include_str!("write_images.py"), &[&path]).is_none() {
        return;
    }
    let recording = Recording::open(&path).unwrap();
    assert_eq!(recording.truncated(), None);
    let frames: Vec<_> = recording.frames().unwrap().map(Result::unwrap).collect();
    assert_eq!(frames.len(), 5);
    for (index, (meta, pixels)) in (0_u64..).zip(frames) {
        assert_eq!((meta.sequence, meta.stamp_ns), (index, 2_000_000_000 + index * 1_000_000));
        assert_eq!((meta.width_px, meta.height_px, meta.format), (6, 4, PixelFormat::Mono8));
        let expected: Vec<u8> = (0..24).map(|k| (k * 7 + index * 13) as u8).collect();
        assert_eq!(pixels, expected);
    }
}
