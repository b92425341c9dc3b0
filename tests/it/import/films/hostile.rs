//! Damaged films.

use super::maker::{Film, has_ffmpeg};
use ricochet::import;

/// Bytes of the headers of films are changed one after the other: every outcome is an error of one line, or frames that
/// are no more than the file can hold.
#[test]
fn damaged_headers_give_one_line_or_frames() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for (ending, codec) in [("mp4", "-c:v mjpeg"), ("avi", "-c:v rawvideo -pix_fmt gray"), ("mkv", "-c:v ffv1")] {
        let film = Film { ending, codec, numbers: (0..3).collect(), ..Film::default() };
        let path = film.write(folder.path());
        let whole = std::fs::read(&path).unwrap();
        let header = match ending {
            "mp4" => whole.windows(4).position(|name| name == b"moov").unwrap(),
            _ => 0,
        };
        let places = (0..16).map(|k| header + k * (whole.len() - header).min(600) / 16);
        for at in places {
            let mut bytes = whole.clone();
            bytes[at..(at + 4).min(whole.len())].iter_mut().for_each(|byte| *byte ^= 0x5A);
            std::fs::write(&path, bytes).unwrap();
            let Ok(footage) = import::open(std::slice::from_ref(&path), None).inspect_err(|error| {
                assert!(!error.to_string().contains('\n'), "{error}");
            }) else {
                continue;
            };
            let read = footage.take_while(Result::is_ok).count();
            assert!(read <= whole.len(), "{ending}, byte {at}: {read} frames");
        }
    }
}
