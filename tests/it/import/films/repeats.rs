//! Frames that repeat the one before.

use super::maker::{Film, frames, has_ffmpeg, open, recognised, refusal};
use crate::import::films::scene::{Ball, stack};
use ricochet::import;
use std::path::Path;
use std::process::Command;

/// Numbers of the frames that come out, and the warnings.
fn numbers_and_findings(path: &Path) -> (Vec<u64>, Vec<String>) {
    let footage = import::open(&[path.to_path_buf()], Some(100.0)).unwrap();
    let findings = footage.findings.clone();
    let numbers = frames(footage).iter().map(|(meta, _)| meta.sequence).collect();
    (numbers, findings.warnings())
}

#[test]
fn a_repeat_is_a_missing_frame_in_every_container() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let stored: Vec<u32> = vec![0, 1, 2, 3, 4, 4, 6, 7, 8, 8, 8, 11, 12, 13, 14, 15, 16, 16];
    let kept = [0, 1, 2, 3, 4, 6, 7, 8, 11, 12, 13, 14, 15, 16];
    let codecs = [
        ("avi", "-c:v mjpeg -q:v 3"),
        ("mp4", "-c:v libx264 -crf 20 -pix_fmt yuv420p"),
        ("mkv", "-c:v ffv1"),
        ("webm", "-c:v libvpx-vp9 -b:v 1M -deadline realtime"),
        ("ts", "-c:v mpeg2video -q:v 3 -bf 2"),
        ("mov", "-c:v png"),
        ("mpg", "-c:v mpeg2video -q:v 3 -bf 2"),
        ("mxf", "-c:v mpeg2video -q:v 3 -bf 2"),
    ];
    for (ending, codec) in codecs {
        let footage = open(&Film { ending, codec, numbers: stored.clone(), ..Film::default() }.write(folder.path()));
        let findings = footage.findings.clone();
        let read = frames(footage);
        println!("{ending}: {:?}", findings.warnings());
        let numbers: Vec<u64> = read.iter().map(|(meta, _)| meta.sequence).collect();
        assert_eq!(numbers, kept, "{ending}");
        assert!(read.iter().all(|(meta, pixels)| u64::from(recognised(pixels)) == meta.sequence), "{ending}");
        assert!(findings.warnings()[0].contains("4 frames repeat"), "{:?}", findings.warnings());
    }
}

/// A strong compression changes a repeated frame, and hides it where the motion changes the picture as little.
#[test]
fn a_repeat_under_strong_compression_is_left_out() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let stored: Vec<u32> =
        vec![0, 1, 2, 3, 4, 5, 5, 7, 8, 9, 10, 11, 11, 11, 14, 15, 16, 17, 18, 19, 19, 21, 22, 23, 24];
    let kept: Vec<u64> =
        stored.iter().zip(0..).filter(|(at, index)| *at == index).map(|(at, _)| u64::from(*at)).collect();
    for (crf, speeds) in [(26, [1.0, 2.5]), (30, [1.0, 2.5]), (33, [1.7, 2.5])] {
        for (speed, frames_between) in speeds.into_iter().flat_map(|speed| [(speed, 0), (speed, 3)]) {
            let codec = format!("-c:v libx264 -crf {crf} -bf {frames_between} -pix_fmt yuv420p");
            let film =
                Film { ending: "mp4", codec: &codec, size: Ball::SIZE, numbers: stored.clone(), ..Film::default() };
            let ball = Ball { step_px: [0.9, 0.4], ..Ball::default() };
            let path = film.write_pixels(folder.path(), |at| ball.picture(speed * f64::from(at), at));
            let (numbers, findings) = numbers_and_findings(&path);
            println!("crf {crf}, {speed} px per frame, {frames_between} frames between: {findings:?}");
            assert_eq!(numbers, kept, "crf {crf}, {speed} px per frame, {frames_between} frames between");
        }
    }
}

/// A repeat that the compression changes as much as the motion does is not silently measured as rest.
#[test]
fn a_film_whose_compression_hides_repeats_is_named() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let repeats = [6, 12, 13, 20, 27, 33];
    let shown = |number: u32| (0..=number).rev().find(|at| !repeats.contains(at)).unwrap();
    for (crf, frames_between) in [20, 23, 26, 30, 33].into_iter().flat_map(|crf| [(crf, 0), (crf, 3)]) {
        for speed in [0.13, 0.28, 0.6, 1.1] {
            let codec = format!("-c:v libx264 -crf {crf} -bf {frames_between} -pix_fmt yuv420p");
            let numbers = (0..40).collect();
            let film = Film { ending: "mp4", codec: &codec, size: Ball::SIZE, numbers, ..Film::default() };
            let ball = Ball { step_px: [0.9, 0.4], ..Ball::default() };
            let moment = |number: u32| speed * f64::from(shown(number));
            let path = film.write_pixels(folder.path(), |number| ball.picture(moment(number), shown(number)));
            let (numbers, findings) = numbers_and_findings(&path);
            let measured = repeats.iter().filter(|repeat| numbers.contains(&u64::from(**repeat))).count();
            println!("crf {crf}, {speed} px per frame, {frames_between} between: {measured} measured, {findings:?}");
            let is_named = findings.iter().any(|finding| finding.contains("cannot be excluded"));
            assert!(measured == 0 || is_named, "crf {crf}, {speed} px per frame, {frames_between} frames between");
            assert!(!is_named || speed < 1.0 || crf > 26, "a good film is not doubted");
        }
    }
}

#[test]
fn a_repeat_in_a_noisy_film_is_left_out_wherever_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball::default();
    // The first pictures are the same, one in five is, and the last ones are.
    let stored = [0, 0, 2, 3, 4, 4, 6, 7, 8, 9, 9, 11, 12, 12, 12];
    let path = stack(folder.path(), stored.iter().map(|number| ball.picture(f64::from(*number), *number)));
    let (numbers, findings) = numbers_and_findings(&path);
    assert_eq!(numbers, [0, 2, 3, 4, 6, 7, 8, 9, 11, 12]);
    assert!(findings[0].contains("5 frames repeat the one before"), "{findings:?}");
}

/// A drawn film without noise: the ball waits, moves, and rests again.
#[test]
fn what_stands_still_in_a_film_without_noise_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball { noise: 0, ..Ball::default() };
    let moving = |at: u32| f64::from(at.clamp(8, 20));
    let path = stack(folder.path(), (0..40).map(|at| ball.picture(moving(at), at)));
    let (numbers, findings) = numbers_and_findings(&path);
    assert_eq!(numbers, (0..40).collect::<Vec<u64>>(), "{findings:?}");
    assert!(findings.is_empty(), "{findings:?}");
}

#[test]
fn a_standstill_within_a_motion_without_noise_is_a_repeat() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball { noise: 0, ..Ball::default() };
    let stored = [0, 1, 2, 3, 4, 5, 5, 7, 8, 9, 10, 10, 10, 13, 14];
    let path = stack(folder.path(), stored.iter().map(|at| ball.picture(f64::from(*at), 0)));
    let (numbers, findings) = numbers_and_findings(&path);
    assert_eq!(numbers, [0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 13, 14], "{findings:?}");
}

/// Before and after a turning point, a picture can be the same by chance; and a motion can come to rest and go on.
#[test]
fn a_turning_point_without_noise_is_no_repeat() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball { noise: 0, ..Ball::default() };
    let bounce = |at: u32| (f64::from(at) - 9.5).abs();
    let thrown = |at: u32| 0.1 * (f64::from(at) - 9.5).powi(2);
    for place in [&bounce as &dyn Fn(u32) -> f64, &thrown] {
        let path = stack(folder.path(), (0..20).map(|at| ball.picture(place(at), 0)));
        let (numbers, findings) = numbers_and_findings(&path);
        assert_eq!(numbers, (0..20).collect::<Vec<u64>>(), "{findings:?}");
    }
}

/// Films of 24 or 25 frames per second at 30 or 60, whose repeats took no time.
#[test]
fn inserted_repeats_are_refused_with_a_cure_that_works() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball::default();
    for (periods, rate) in
        [([0, 1, 2, 3, 3].as_slice(), 4.0 / 5.0), (&[0, 1, 2, 3, 4, 4], 5.0 / 6.0), (&[0, 0, 1, 1, 1], 0.4)]
    {
        let pictures = periods[periods.len() - 1] + 1;
        let at = |k: u32| k / periods.len() as u32 * pictures + periods[k as usize % periods.len()];
        let path = stack(folder.path(), (0..60).map(|k| ball.picture(f64::from(at(k)) * 0.8, at(k))));
        let line = refusal_at(&path, 100.0);
        println!("{line}");
        assert!(line.contains("converted to a higher rate") && line.contains("mpdecimate"), "{line}");
        let named: f64 = line.split("setpts=N/").nth(1).unwrap().split('/').next().unwrap().parse().unwrap();
        assert!((named / (100.0 * rate) - 1.0).abs() < 0.1, "{line}");
    }
    // Each picture twice needs no cure: the times are right.
    let path = stack(folder.path(), (0..40_u32).map(|k| ball.picture(f64::from(k / 2), k / 2)));
    let (numbers, findings) = numbers_and_findings(&path);
    assert_eq!(numbers, (0..20).map(|k| 2 * k).collect::<Vec<u64>>());
    assert!(findings[0].contains("mostly 2 apart"), "{findings:?}");
    if !has_ffmpeg() {
        return;
    }
    let size = Ball::SIZE;
    let film = Film { ending: "avi", rate: "30", size, numbers: (0..60).collect(), ..Film::default() };
    let at = |k: u32| k / 5 * 4 + (k % 5).min(3);
    let path = film.write_pixels(folder.path(), |k| ball.picture(f64::from(at(k)), at(k)));
    let line = refusal(&path);
    let options = line.split("ffmpeg -i FILM ").nth(1).unwrap().split(" NEW.avi").next().unwrap();
    let new = folder.path().join("new.avi");
    let cure =
        Command::new("ffmpeg").args(["-v", "error", "-i"]).arg(&path).args(options.split(' ')).arg(&new).output();
    assert!(cure.unwrap().status.success(), "{line}");
    let footage = open(&new);
    assert!((footage.frame_rate_hz / 24.0 - 1.0).abs() < 0.06, "{}", footage.summary());
    assert_eq!(frames(footage).len(), 48);
}

fn refusal_at(path: &Path, fps: f64) -> String {
    let footage = import::open(&[path.to_path_buf()], Some(fps)).unwrap();
    footage.map(|frame| frame.map(|_| ())).find_map(Result::err).expect("it is refused").to_string()
}

#[test]
fn blended_frames_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball::default();
    let blended = |k: u32| -> Vec<u8> {
        let [a, b] = [k / 2, k / 2 + 1].map(|at| ball.picture(2.0 * f64::from(at), at));
        if k.is_multiple_of(2) {
            a
        } else {
            a.iter().zip(&b).map(|(a, b)| (u16::from(*a) + u16::from(*b)).div_ceil(2) as u8).collect()
        }
    };
    let path = stack(folder.path(), (0..40).map(blended));
    let (numbers, findings) = numbers_and_findings(&path);
    assert_eq!(numbers.len(), 40);
    assert!(findings.iter().any(|finding| finding.contains("blended")), "{findings:?}");
    // A film that moves less than a pixel per frame is no blend, nor is a compressed one.
    let path = stack(folder.path(), (0..40_u32).map(|k| ball.picture(0.2 * f64::from(k), k)));
    assert!(numbers_and_findings(&path).1.is_empty());
    if !has_ffmpeg() {
        return;
    }
    for speed in [0.3, 1.0, 2.0] {
        for crf in ["12", "23"] {
            let codec = format!("-c:v libx264 -crf {crf} -pix_fmt yuv420p");
            let film =
                Film { ending: "mp4", codec: &codec, size: Ball::SIZE, numbers: (0..40).collect(), ..Film::default() };
            let path = film.write_pixels(folder.path(), |k| ball.picture(speed * f64::from(k).min(30.0), k));
            let (numbers, findings) = numbers_and_findings(&path);
            println!("{speed} {crf}: {} {findings:?}", numbers.len());
            assert!(!findings.iter().any(|finding| finding.contains("blended")), "{speed} {crf}: {findings:?}");
            assert_eq!(numbers.len(), 40, "{speed} {crf}: {findings:?}");
        }
    }
}
