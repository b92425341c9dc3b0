//! Recordings that continue in further files.

use super::samples;
use crate::support::{frames, run, succeed};
use ricochet::image::{Frame, PixelFormat};
use ricochet::recording::{FinishedRecording, Recording, RecordingWriter, WriterOptions, files_of, recover};
use std::path::Path;
use tempfile::TempDir;

const FRAMES: u64 = 60;
const LIMIT_BYTES: u64 = 200_000;

/// Records frames and rows of every kind; without a limit into one file.
fn record(path: &Path, split_bytes: Option<u64>) -> FinishedRecording {
    let options = WriterOptions { split_bytes, chunk_bytes: 30_000, ..WriterOptions::default() };
    let mut writer = RecordingWriter::create(path, &samples::info(), &options).unwrap();
    for sequence in 0..FRAMES {
        let (meta, bytes) = samples::frame(sequence, PixelFormat::Mono8, [128, 96], 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
        // Rows come later than their frames and go to the file that is open then.
        if let Some(late) = sequence.checked_sub(20) {
            writer.write_velocity(&samples::velocity(late, 0)).unwrap();
            writer.write_track(&samples::track(late)).unwrap();
            writer.write_field(&samples::field(late)).unwrap();
        }
    }
    for late in FRAMES - 20..FRAMES {
        writer.write_velocity(&samples::velocity(late, 0)).unwrap();
        writer.write_track(&samples::track(late)).unwrap();
        writer.write_field(&samples::field(late)).unwrap();
    }
    writer.write_impact(&samples::impact(1, 0)).unwrap();
    writer.finish().unwrap()
}

/// Everything in a recording, in reading order.
fn content(recording: &Recording) -> Vec<String> {
    let mut all: Vec<String> = recording.frames().unwrap().map(|frame| format!("{:?}", frame.unwrap())).collect();
    all.extend(recording.velocities().unwrap().map(|row| format!("{:?}", row.unwrap())));
    all.extend(recording.tracks().unwrap().map(|row| format!("{:?}", row.unwrap())));
    all.extend(recording.fields().unwrap().map(|row| format!("{:?}", row.unwrap())));
    all.extend(recording.impacts().unwrap().map(|row| format!("{:?}", row.unwrap())));
    all
}

#[test]
fn a_split_recording_reads_like_an_unsplit_one_and_each_file_is_complete() {
    let folder = TempDir::new().unwrap();
    let (one, set) = (folder.path().join("one.mcap"), folder.path().join("set.mcap"));
    let finished = [record(&one, None), record(&set, Some(LIMIT_BYTES))];
    let files = files_of(&set);
    assert!(files.len() >= 5, "{files:?}");
    assert_eq!(files[1].file_name().unwrap(), "set_0001.mcap");
    let bytes: Vec<u64> = files.iter().map(|path| path.metadata().unwrap().len()).collect();
    assert!(bytes.iter().all(|bytes| *bytes <= LIMIT_BYTES), "{bytes:?}");
    assert_eq!((finished[1].frames, finished[1].bytes), (FRAMES, bytes.iter().sum()));
    assert_eq!(finished[1].path, set);
    assert_eq!(files_of(&one), std::slice::from_ref(&one));

    let [whole, split] = [&one, &set].map(|path| Recording::open(path).unwrap());
    assert_eq!((split.truncated(), split.damage().len(), split.verify().unwrap().len()), (None, 0, 0));
    assert!(split.files().eq(&files));
    assert_eq!(content(&split), content(&whole));
    assert_eq!((split.frame_count(), split.topics()), (whole.frame_count(), whole.topics()));
    assert_eq!(split.last_frame().unwrap(), whole.last_frame().unwrap());
    assert_eq!(split.frame_rate_hz().unwrap(), whole.frame_rate_hz().unwrap());
    for skip in [0, 1, 17, FRAMES - 1] {
        let mut rest = [&whole, &split].map(|recording| recording.frames().unwrap());
        rest.iter_mut().for_each(|frames| frames.skip_frames(skip));
        let [whole, split] = rest.map(|frames| frames.map(Result::unwrap).collect::<Vec<_>>());
        assert!(split == whole && split.len() as u64 == FRAMES - skip, "{skip}");
    }

    let alone: Vec<Recording> = files.iter().map(|path| Recording::open_one(path).unwrap()).collect();
    // The last rows may have a file of their own.
    let with_frames = alone.iter().filter(|file| file.frame_count() > 0);
    let all = with_frames.flat_map(|file| file.frames().unwrap()).map(|frame| frame.unwrap().0.sequence);
    assert!(all.eq(0..FRAMES), "no frame lost or doubled at a seam");
    for file in &alone {
        assert_eq!((file.truncated(), file.verify().unwrap().len()), (None, 0));
        assert_eq!((file.config_toml(), file.bodies()), (whole.config_toml(), whole.bodies()));
    }
}

#[test]
fn a_missing_or_unfinished_file_is_reported() {
    let folder = TempDir::new().unwrap();
    let set = folder.path().join("set.mcap");
    record(&set, Some(LIMIT_BYTES));
    let files = files_of(&set);
    let last = files.last().unwrap();
    let [count, rows] = [frames(&set).len(), Recording::open(&set).unwrap().velocities().unwrap().count()];
    let moved = folder.path().join("elsewhere");
    std::fs::rename(last, &moved).unwrap();
    let recording = Recording::open(&set).unwrap();
    let message = recording.truncated().unwrap();
    assert!(message.contains(last.file_name().unwrap().to_str().unwrap()) && message.ends_with("missing"), "{message}");
    assert!(recording.velocities().unwrap().count() < rows);
    let output = run(["info".as_ref(), set.as_os_str()]);
    assert_eq!(output.status.code(), Some(6));
    // A file of another recording with that name is not accepted.
    record(last, None);
    assert!(Recording::open(&set).unwrap().truncated().is_some());
    std::fs::remove_file(last).unwrap();
    // A part file left by a killed recorder: once recovered, the set is complete again.
    let part = ricochet::recording::part_path(last);
    let bytes = std::fs::read(&moved).unwrap();
    // Only the magic bytes at the end are missing, so that everything can be recovered.
    std::fs::write(&part, &bytes[..bytes.len() - 8]).unwrap();
    assert!(Recording::open(&set).unwrap().truncated().unwrap().contains("unfinished"));
    recover(&part, last).unwrap();
    let again = Recording::open(&set).unwrap();
    assert_eq!((again.truncated(), frames(&set).len(), again.velocities().unwrap().count()), (None, count, rows));
}

#[test]
fn info_and_export_take_a_set_by_its_first_file() {
    let folder = TempDir::new().unwrap();
    let (one, set) = (folder.path().join("one.mcap"), folder.path().join("set.mcap"));
    record(&one, None);
    record(&set, Some(LIMIT_BYTES));
    let info = |path: &Path| -> serde_json::Value {
        serde_json::from_str(&succeed(["info".as_ref(), path.as_os_str(), "--json".as_ref()])).unwrap()
    };
    let [whole, split] = [info(&one), info(&set)];
    assert_eq!(split["later_files"].as_array().unwrap().len() + 1, files_of(&set).len());
    for key in ["frames", "topics", "bodies", "attachments", "truncated", "damage"] {
        assert_eq!(split[key], whole[key], "{key}");
    }
    let results = [&one, &set].map(|path| {
        let to = path.with_extension("results.mcap");
        let arguments = [
            "export".as_ref(),
            path.as_os_str(),
            "--topic".as_ref(),
            "results".as_ref(),
            "--format".as_ref(),
            "mcap".as_ref(),
            "-o".as_ref(),
        ];
        succeed(arguments.into_iter().chain([to.as_os_str()]));
        to
    });
    let rows = results.map(|path| {
        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.truncated(), None);
        recording.velocities().unwrap().map(|row| format!("{:?}", row.unwrap())).collect::<Vec<_>>()
    });
    assert!(rows[0] == rows[1] && rows[0].len() as u64 == FRAMES);
}
