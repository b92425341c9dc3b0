//! Parts of a recording as files of their own.

use super::samples;
use crate::support::python;
use ricochet::command::export::{self, ExportOptions, Format};
use ricochet::console::Overwrite;
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{Recording, RecordingWriter, WriterOptions};
use std::path::Path;

fn export_as(format: Format, topic: &str, file: &Path, output: &Path) -> Result<u64, String> {
    let (topic, output) = (topic.to_owned(), Some(output.to_owned()));
    let options = ExportOptions {
        file: file.into(),
        topic,
        format,
        camera: None,
        output,
        film: Vec::new(),
        playback_hz: 25.0,
        overwrite: Overwrite::ALLOWED,
    };
    export::run(&options).map(|exported| exported.rows).map_err(|error| error.to_string())
}

#[test]
fn exported_results_are_the_same_rows_without_the_frames() {
    let folder = tempfile::tempdir().unwrap();
    let (shot, results) = (folder.path().join("shot.mcap"), folder.path().join("results.mcap"));
    samples::write(&shot, &WriterOptions::default(), 60, [64, 48]).finish().unwrap();
    let messages = export_as(Format::Mcap, "results", &shot, &results).unwrap();
    let (whole, part) = (Recording::open(&shot).unwrap(), Recording::open(&results).unwrap());
    assert_eq!((part.truncated(), part.verify().unwrap()), (None, Vec::new()));
    let rows = |recording: &Recording| {
        let mut topics = recording.topics();
        topics.retain(|topic| !topic.topic.starts_with("/camera/image") && topic.topic != "/camera/frame_info");
        topics
    };
    assert_eq!(rows(&part), part.topics(), "no frames");
    assert_eq!(part.topics(), rows(&whole));
    assert_eq!(part.topics().iter().map(|topic| topic.messages).sum::<u64>(), messages);
    for topic in export::TABLES {
        let table = |recording: &Recording| {
            let mut text = Vec::new();
            export::write_table(recording, topic, &mut text, "memory").unwrap();
            text
        };
        if !matches!(topic, "velocity" | "track" | "field") {
            assert_eq!(table(&part), table(&whole), "{topic}");
        }
    }
    let collect = |recording: &Recording| {
        let velocities: Vec<_> = recording.velocities().unwrap().map(Result::unwrap).collect();
        let fields: Vec<_> = recording.fields().unwrap().map(Result::unwrap).collect();
        (velocities, fields)
    };
    assert_eq!(collect(&part), collect(&whole));
    assert_eq!((part.config_toml(), part.bodies()), (whole.config_toml(), whole.bodies()));
    assert_eq!((part.metadata(), part.attachments()), (whole.metadata(), whole.attachments()));
    assert!(part.bytes() * 2 < whole.bytes(), "{} of {} bytes", part.bytes(), whole.bytes());
    assert!(part.frames().unwrap_err().to_string().contains("no image topic"));
    let again = export_as(Format::Mcap, "results", &shot, &results).unwrap_err();
    assert!(again.contains("never overwritten"), "{again}");
}

#[test]
fn results_of_a_damaged_recording_are_refused_and_leave_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let (shot, results) = (folder.path().join("shot.mcap"), folder.path().join("results.mcap"));
    samples::write(&shot, &WriterOptions::default(), 20, [8, 8]).finish().unwrap();
    let mut bytes = std::fs::read(&shot).unwrap();
    // In the first chunk of rows, behind the schema of a velocity.
    let at = bytes.windows(17).position(|window| window == b"ricochet.Velocity").unwrap();
    bytes[at + 3] ^= 1;
    std::fs::write(&shot, &bytes).unwrap();
    let message = export_as(Format::Mcap, "results", &shot, &results).unwrap_err();
    assert!(message.contains("shot.mcap") && message.contains("CRC"), "{message}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn frames_for_ros_2_read_back_with_their_pixels_and_times() {
    let folder = tempfile::tempdir().unwrap();
    for (format, size, padding) in
        [(PixelFormat::Mono8, [20, 10], 0), (PixelFormat::Mono12, [7, 5], 0), (PixelFormat::Mono8, [21, 4], 3)]
    {
        let name = format!("{}-{padding}", format.as_str());
        let (shot, bag) = (folder.path().join(format!("{name}.mcap")), folder.path().join(format!("{name}-ros.mcap")));
        let mut writer = RecordingWriter::create(&shot, &samples::info(), &WriterOptions::default()).unwrap();
        let frames: Vec<_> = (0..9).map(|k| samples::frame(k, format, size, padding)).collect();
        for (meta, bytes) in &frames {
            writer.write_frame(&Frame { meta: *meta, bytes }).unwrap();
        }
        writer.finish().unwrap();
        assert_eq!(export_as(Format::Ros2, "frames", &shot, &bag).unwrap(), 9);
        let recording = Recording::open(&bag).unwrap();
        assert_eq!((recording.truncated(), recording.verify().unwrap()), (None, Vec::new()));
        let topics = recording.topics();
        assert_eq!((topics.len(), topics[0].topic.as_str()), (1, "/camera/image_raw"));
        assert_eq!((topics[0].schema.as_str(), topics[0].encoding.as_str()), ("sensor_msgs/msg/Image", "cdr"));
        for (read, (meta, bytes)) in recording.frames().unwrap().map(Result::unwrap).zip(&frames) {
            assert_eq!(read.0.stamp_ns, meta.stamp_ns);
            assert_eq!((read.0.width_px, read.0.height_px, read.0.stride_bytes), (size[0], size[1], meta.stride_bytes));
            assert_eq!(&read.1, bytes);
        }
        // A reader that knows ROS 2 and nothing of this program.
        let Some(message) = python(include_str!("read_ros2.py"), &[&bag]) else { continue };
        let encoding = if format == PixelFormat::Mono8 { "mono8" } else { "mono16" };
        let expected: Vec<String> = frames
            .iter()
            .map(|(meta, bytes)| {
                let [width, height] = size;
                let (crc, step) = (crc32fast::hash(bytes), meta.stride_bytes);
                format!("{} {} camera {width}x{height} {encoding} 0 {step} {crc:08x}", meta.stamp_ns, meta.stamp_ns)
            })
            .collect();
        assert_eq!(message.lines().collect::<Vec<_>>(), expected);
    }
}

#[test]
fn a_recording_without_frames_gives_no_ros_2_file() {
    let folder = tempfile::tempdir().unwrap();
    let shot = folder.path().join("shot.mcap");
    RecordingWriter::create(&shot, &samples::info(), &WriterOptions::default()).unwrap().finish().unwrap();
    let message = export_as(Format::Ros2, "frames", &shot, &folder.path().join("bag.mcap")).unwrap_err();
    assert!(message.contains("no image topic"), "{message}");
    let message = export_as(Format::Ros2, "velocity", &shot, &folder.path().join("bag.mcap")).unwrap_err();
    assert_eq!(message, "--topic velocity: not one of frames");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}
