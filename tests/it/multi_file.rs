//! Several recordings of one stream are measured as one.

use crate::pipeline::drift;
use crate::support::{Rig, csv, frames, run, succeed};
use ricochet::image::{Frame, FrameMeta};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
use std::path::{Path, PathBuf};

type Film = Vec<(FrameMeta, Vec<u8>)>;

fn write(path: &Path, film: &Film, range: std::ops::Range<usize>, config_toml: &str, like: &Recording) {
    let metadata = like.metadata().clone();
    let info = RecordingInfo { config_toml: config_toml.into(), metadata, ..RecordingInfo::default() };
    let mut writer = RecordingWriter::create(path, &info, &WriterOptions::default()).unwrap();
    for (meta, bytes) in &film[range] {
        writer.write_frame(&Frame { meta: *meta, bytes }).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn files_of_one_stream_are_measured_as_one_and_others_are_refused() {
    let rig = Rig::new();
    let scenario = rig.file("drift.toml", &drift(90, 1000.0));
    let source = rig.path("film.mcap");
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), source.as_os_str()]);
    let (film, like) = (frames(&source), Recording::open(&source).unwrap());
    let config = like.config_toml().unwrap();
    // No file ends at the end of a block.
    let parts: Vec<PathBuf> = ["c", "a", "b"].iter().map(|name| rig.path(&format!("{name}.mcap"))).collect();
    for (path, range) in parts.iter().zip([0..37, 37..41, 41..90]) {
        write(path, &film, range, config, &like);
    }
    let analyze = |inputs: &[&PathBuf], to: &str| {
        let mut words: Vec<PathBuf> = vec!["analyze".into()];
        words.extend(inputs.iter().map(|path| (*path).clone()));
        words.extend(["-o".into(), rig.path(to)]);
        run(words)
    };
    assert!(analyze(&[&source], "whole.mcap").status.success());
    // The order of the arguments does not matter, because the stamps give the order.
    assert!(analyze(&[&parts[1], &parts[2], &parts[0]], "parts.mcap").status.success());
    for topic in ["velocity", "field", "track"] {
        assert_eq!(csv(&rig.path("parts.mcap"), topic), csv(&rig.path("whole.mcap"), topic), "{topic}");
    }
    let gap = analyze(&[&parts[0], &parts[2]], "gap.mcap");
    assert_eq!(gap.status.code(), Some(6), "the four missing frames are reported");
    assert!(String::from_utf8_lossy(&gap.stderr).contains('4'), "{}", String::from_utf8_lossy(&gap.stderr));

    let refused = |inputs: &[&PathBuf], reason: &str| {
        let output = analyze(inputs, "none.mcap");
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), stderr.lines().count()), (Some(2), 1), "{stderr}");
        assert!(stderr.contains(reason), "{stderr}");
    };
    refused(&[&source, &parts[0]], "do not follow the last frame");
    let other = rig.path("other.mcap");
    write(&other, &film, 37..90, &format!("{config}\n# changed\n"), &like);
    refused(&[&parts[0], &other], "its attached config.toml differs");
}
