//! A film of another program. The first byte selects the kind of file; the others are its content.
#![no_main]

use libfuzzer_sys::fuzz_target;

const ENDINGS: [&str; 8] = ["cine", "tif", "npy", "npz", "cihx", "png", "jpg", "bmp"];

fuzz_target!(|bytes: &[u8]| {
    let Some((first, content)) = bytes.split_first() else { return };
    let ending = ENDINGS[usize::from(*first) % ENDINGS.len()];
    let path = std::env::temp_dir().join(format!("ricochet-fuzz-{}.{ending}", std::process::id()));
    if std::fs::write(&path, content).is_err() {
        return;
    }
    if let Ok(film) = ricochet::import::open(&[path.clone()], Some(100.0)) {
        let _ = film.take(64).filter(Result::is_ok).count();
    }
    let _ = std::fs::remove_file(path);
});
