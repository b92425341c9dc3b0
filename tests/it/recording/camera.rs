//! A recording played like a camera.

use super::samples;
use ricochet::camera::replay::{Playback, PlaybackRate, ReplayCamera};
use ricochet::camera::{Camera, CameraError, Next, Pace, Slot};
use ricochet::image::{Frame, FrameMeta, PixelFormat};
use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::time::{Duration, Instant};

const SIZE: [u32; 2] = [16, 12];

fn recorded(folder: &Path, sequences: &[u64]) -> PathBuf {
    let path = folder.join("shot.mcap");
    let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default()).unwrap();
    for sequence in sequences {
        let (meta, bytes) = samples::frame(*sequence, PixelFormat::Mono8, SIZE, 0);
        writer.write_frame(&Frame { meta, bytes: &bytes }).unwrap();
    }
    writer.finish().unwrap();
    path
}

/// Replays a recording at this rate.
fn replay(path: &Path, rate: PlaybackRate) -> Result<ReplayCamera, CameraError> {
    ReplayCamera::new(Recording::open(path)?, Playback { rate, ..Playback::default() })
}

/// The next frame, in a slot of exactly the size that the camera asks for.
#[expect(unsafe_code, reason = "slots are lent memory")]
fn next(camera: &mut ReplayCamera) -> Option<(FrameMeta, Vec<u8>)> {
    let mut memory = vec![0xa5_u8; camera.format().slot_bytes()];
    // SAFETY: `memory` outlives the slot, which is gone when this function returns.
    camera.queue(unsafe { Slot::new(NonNull::new(memory.as_mut_ptr()).unwrap(), memory.len(), 0) });
    match camera.next(Duration::from_secs(5)).unwrap() {
        Next::Frame(mut slot, meta) => Some((meta, slot.bytes_mut().to_vec())),
        Next::End => None,
        other => panic!("{other:?}"),
    }
}

#[test]
fn at_max_every_frame_has_its_recorded_stamp_and_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), &[4, 5, 9]);
    let mut camera = replay(&path, PlaybackRate::Max).unwrap();
    assert_eq!(camera.pace(), Pace::OnDemand);
    assert_eq!(camera.format().frame_rate_hz.round(), 10_000.0);
    camera.start().unwrap();
    for sequence in [4, 5, 9] {
        assert_eq!(next(&mut camera).unwrap(), samples::frame(sequence, PixelFormat::Mono8, SIZE, 0));
    }
    assert!(next(&mut camera).is_none());
}

#[test]
#[expect(clippy::disallowed_methods, reason = "the pace is what is tested")]
fn a_paced_recording_takes_its_recorded_time() {
    let folder = tempfile::tempdir().unwrap();
    // 0.1 ms per number: 20 ms from first to last, 40 ms at half speed.
    let path = recorded(folder.path(), &[0, 100, 200]);
    let mut camera = replay(&path, PlaybackRate::Times(0.5)).unwrap();
    assert_eq!(camera.pace(), Pace::Live);
    camera.start().unwrap();
    let start = Instant::now();
    while next(&mut camera).is_some() {}
    assert!(start.elapsed() >= Duration::from_millis(40), "{:?}", start.elapsed());
}

#[test]
fn no_frame_is_early_and_none_is_lost_by_waiting() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), &[0, 2000]);
    let mut camera = replay(&path, PlaybackRate::Times(1.0)).unwrap();
    camera.start().unwrap();
    assert!(matches!(camera.next(Duration::ZERO).unwrap(), Next::Timeout), "no slot");
    assert_eq!(next(&mut camera).unwrap().0.sequence, 0);
    assert!(matches!(camera.next(Duration::from_millis(1)).unwrap(), Next::Timeout), "0.2 s early, and no slot");
    assert_eq!(next(&mut camera).unwrap().0.sequence, 2000);
}

#[test]
fn an_impossible_rate_and_a_file_that_is_no_recording_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = recorded(folder.path(), &[0]);
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(replay(&path, PlaybackRate::Times(rate)).is_err());
    }
    let missing = folder.path().join("missing.mcap");
    let error = replay(&missing, PlaybackRate::Max).unwrap_err().to_string();
    assert!(error.contains("missing.mcap"), "{error}");
}
