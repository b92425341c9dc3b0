//! A recording: whatever its bytes are, it is read or refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use ricochet::recording::Recording;

fuzz_target!(|bytes: &[u8]| {
    let path = std::env::temp_dir().join(format!("ricochet-fuzz-{}.mcap", std::process::id()));
    if std::fs::write(&path, bytes).is_err() {
        return;
    }
    if let Ok(recording) = Recording::open(&path) {
        let _ = recording.frames().map(|frames| frames.take(64).filter(Result::is_ok).count());
        let _ = recording.velocities().map(Iterator::count);
        let _ = recording.tracks().map(Iterator::count);
        let _ = recording.fields().map(Iterator::count);
        let _ = recording.impacts().map(Iterator::count);
        let _ = recording.events().map(Iterator::count);
        let _ = ricochet::command::info::inspect(&recording);
    }
    let _ = std::fs::remove_file(path);
});
