//! Films a scene, through the compression of a film if it has one.

use super::draw::Scene;
use crate::support::is_required;
use ricochet::synth::SimulatedFilm;
use std::io::Write as _;
use std::process::{Command, Stdio};
use std::sync::LazyLock;

/// Whether ffmpeg can write H.264.
static HAS_FFMPEG: LazyLock<bool> = LazyLock::new(|| {
    let listed = Command::new("ffmpeg").args(["-v", "error", "-encoders"]).output();
    let has = listed.is_ok_and(|listed| String::from_utf8_lossy(&listed.stdout).contains("libx264"));
    assert!(has || !is_required("FFMPEG"), "ffmpeg with libx264 is required but not installed");
    if !has {
        eprintln!("compressed scenes are left out: ffmpeg with libx264 is not installed");
    }
    has
});

/// Returns the frames of a scene; `None` if they cannot be compressed here.
pub fn frames(scene: &Scene, world: &SimulatedFilm) -> Option<Vec<Vec<u8>>> {
    let drawn = (0..world.frames()).map(|index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        bytes
    });
    let drawn: Vec<_> = drawn.collect();
    match scene.crf {
        None => Some(drawn),
        Some(crf) => HAS_FFMPEG.then(|| compressed(&drawn, world, crf)),
    }
}

/// Encodes the frames as H.264 and imports the film.
fn compressed(frames: &[Vec<u8>], world: &SimulatedFilm, crf: u32) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("film.mp4");
    let (size, crf) = (format!("{}x{}", world.width_px(), world.height_px()), crf.to_string());
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "rawvideo", "-pixel_format", "gray", "-video_size", &size, "-framerate", "30"])
        .args(["-i", "pipe:0", "-c:v", "libx264", "-crf", &crf, "-pix_fmt", "yuv420p", "-threads", "1"])
        .arg(&path)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = ffmpeg.stdin.take().unwrap();
    frames.iter().for_each(|bytes| pipe.write_all(bytes).unwrap());
    drop(pipe);
    assert!(ffmpeg.wait().unwrap().success());
    let film = ricochet::import::open(&[path], Some(world.frame_rate_hz())).unwrap();
    let read: Vec<_> = film.map(|frame| frame.unwrap().1).collect();
    assert_eq!((read.len(), read[0].len()), (frames.len(), frames[0].len()), "frames of the film");
    read
}
