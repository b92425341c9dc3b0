//! Films of others: null frames, slow motion, turned phones, variable rates, repeats.
//!
//! Each kind is measured in the film that was reported, where the folder of real data is named, and in two of our own.

use crate::import::films::scene::{Ball, stack};
use crate::import::films::{Film, has_ffmpeg, patched_matrix};
use crate::support::run;
use ricochet::recording::Recording;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

const RIG: &str = "[rig]\nname = \"field-films\"\n[camera]\nsource = \"recording\"\nid = \"x.mcap\"\nexposure_us = 0.001\n\
    [scale]\nmm_per_px = 0.5\n[surface]\nangle_deg = 0\n[[body]]\nname = \"ball\"\nkind = \"ball\"\ndiameter_mm = 30.0\n\
    [correlation]\nsubset_size_px = 21\nstep_px = 6\n[velocity]\ngravity_m_s2 = 0\n";
/// The motion of the ball in all these films, per frame: 0.4 mm to the right, 0.15 mm down, half a degree.
const PER_FRAME: [f64; 3] = [0.4e-3, -0.15e-3, std::f64::consts::PI / 360.0];

/// A film that was measured.
struct Measured {
    /// The standard error of the program.
    said: String,
    /// Values and standard uncertainties of vx, vy and omega: the medians of the film.
    values: [[f64; 2]; 3],
    /// Number of measured frames.
    frames: usize,
}

fn measured(film: &Path, fps: Option<&str>) -> Measured {
    let folder = tempfile::tempdir().unwrap();
    let (rig, results) = (folder.path().join("rig.toml"), folder.path().join("out.mcap"));
    std::fs::write(&rig, RIG).unwrap();
    let mut arguments: Vec<&OsStr> = vec!["analyze".as_ref(), film.as_os_str(), "--config".as_ref(), rig.as_os_str()];
    arguments.extend::<[&OsStr; 2]>(["-o".as_ref(), results.as_os_str()]);
    if let Some(fps) = fps {
        arguments.extend::<[&OsStr; 2]>(["--fps".as_ref(), fps.as_ref()]);
    }
    let output = run(arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    println!("{}: {said}", film.display());
    let rows: Vec<_> = Recording::open(&results).unwrap().velocities().unwrap().map(Result::unwrap).collect();
    let velocities: Vec<_> = rows.iter().filter_map(|row| row.velocity).collect();
    let median = |of: &dyn Fn(usize) -> f64| {
        let mut values: Vec<f64> = (0..velocities.len()).map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let sigma_v = median(&|k| velocities[k].sigma_v_m_s);
    let values = [
        [median(&|k| velocities[k].vx_m_s), sigma_v],
        [median(&|k| velocities[k].vy_m_s), sigma_v],
        [
            median(&|k| velocities[k].omega_rad_s.unwrap_or(f64::NAN)),
            median(&|k| velocities[k].sigma_omega_rad_s.unwrap_or(f64::NAN)),
        ],
    ];
    Measured { said, values, frames: velocities.len() }
}

impl Measured {
    /// Requires the right values within three standard uncertainties and 1 %.
    fn is_right(&self, rate_hz: f64) {
        for ([value, sigma], per_frame) in self.values.iter().zip(PER_FRAME) {
            let right = per_frame * rate_hz;
            println!("  {value:.5} +- {sigma:.5}, right {right:.5}");
            let off = (value - right).abs();
            assert!(
                off <= 3.0 * sigma && off <= 0.01 * right.abs(),
                "{value} +- {sigma}, right {right}: {}",
                self.said
            );
        }
    }

    /// Requires that the program printed this.
    fn names(&self, text: &str) {
        assert!(self.said.contains(text), "{text} is not in: {}", self.said);
    }
}

/// A file that was reported; `None` where the folder of real data is not named.
fn reported(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("RICOCHET_REAL_DATA").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("left out: RICOCHET_REAL_DATA does not name the folder of real recordings");
    }
    folder.map(|folder| folder.join("field").join(name)).filter(|path| path.exists())
}

/// A film of the ball, one picture for each number.
fn film<'a>(ending: &'a str, codec: &'a str, rate: &'a str) -> Film<'a> {
    Film { ending, codec, rate, size: Ball::SIZE, numbers: (0..36).collect(), ..Film::default() }
}

fn picture(number: u32) -> Vec<u8> {
    Ball::default().picture(f64::from(number), number)
}

/// Numbers that a camera lost.
const LOST: [u32; 5] = [10, 11, 19, 25, 30];

fn stored() -> Vec<u32> {
    (0..36).filter(|number| !LOST.contains(number)).collect()
}

/// Filters that give each stored picture its time.
fn times(rate: &str) -> String {
    // The numbers after the lost ones, counted in stored pictures.
    format!("settb=1/90000,setpts=(N+2*gte(N\\,10)+gte(N\\,17)+gte(N\\,22)+gte(N\\,26))/{rate}/TB")
}

#[test]
fn null_frames_of_an_avi_film_are_lost_frames() {
    if !has_ffmpeg() {
        return;
    }
    if let Some(path) = reported("avi-null-frames/null.avi") {
        let film = measured(&path, Some("5000"));
        film.is_right(5000.0);
        assert_eq!(film.frames, 31);
        film.names("data were lost: 5");
        film.names("5 frames missing in ");
    }
    let folder = tempfile::tempdir().unwrap();
    let times = times("25");
    for (codec, fps) in [("-c:v mjpeg -q:v 2 -enc_time_base 1:25", 3000.0), ("-c:v ffv1 -enc_time_base 1:25", 12_000.0)]
    {
        let made = Film { numbers: stored(), filters: &times, ..film("avi", codec, "25") };
        let film = measured(&made.write_pixels(folder.path(), picture), Some(&fps.to_string()));
        film.is_right(fps);
        film.names("5 frames missing in 4 places");
    }
}

#[test]
fn slow_motion_of_a_phone_has_the_rate_of_its_tag() {
    if !has_ffmpeg() {
        return;
    }
    if let Some(path) = reported("mp4-android-slow-motion/slowmo.mp4") {
        let film = measured(&path, None);
        film.is_right(240.0);
        film.names("240 frames/s by the file's com.android.capture.fps");
    }
    let folder = tempfile::tempdir().unwrap();
    for (ending, rate, tag) in [("mp4", "30", 960.0), ("mov", "24", 120.0)] {
        let codec = format!(
            "-c:v libx264 -crf 10 -pix_fmt yuv420p -movflags use_metadata_tags -metadata com.android.capture.fps={tag}"
        );
        let film = measured(&film(ending, &codec, rate).write_pixels(folder.path(), picture), None);
        film.is_right(tag);
        film.names("com.android.capture.fps");
    }
}

#[test]
fn a_turned_phone_film_is_measured_upright() {
    if !has_ffmpeg() {
        return;
    }
    if let Some(path) = reported("mp4-turned-phone/phone.mp4") {
        let film = measured(&path, Some("5000"));
        film.is_right(5000.0);
        film.names("turned by 90 deg clockwise");
    }
    let folder = tempfile::tempdir().unwrap();
    let upside_down = |number: u32| -> Vec<u8> { picture(number).into_iter().rev().collect() };
    let path = film("mp4", "-c:v libx264 -crf 10 -pix_fmt yuv420p", "240").write_pixels(folder.path(), upside_down);
    patched_matrix(&path, [-1, 0, 0, -1]);
    measured(&path, None).is_right(240.0);
    // Stored by columns, as a phone held upright and mirrored does.
    let [width, height] = Ball::SIZE;
    let by_columns = |number: u32| -> Vec<u8> {
        let upright = picture(number);
        (0..width).flat_map(|x| (0..height).map(move |y| y * width + x)).map(|at| upright[at as usize]).collect()
    };
    let made = Film { size: [height, width], ..film("mov", "-c:v png -pix_fmt gray", "240") };
    let path = made.write_pixels(folder.path(), by_columns);
    patched_matrix(&path, [0, 1, 1, 0]);
    measured(&path, None).is_right(240.0);
}

#[test]
fn a_variable_rate_is_measured_by_the_time_of_each_frame() {
    if !has_ffmpeg() {
        return;
    }
    if let Some(path) = reported("mp4-variable-rate/phone.mp4") {
        let film = measured(&path, None);
        film.is_right(240.0);
        film.names("data were lost: 5");
        film.names("5 frames missing in 2 places");
    }
    let folder = tempfile::tempdir().unwrap();
    // Times in milliseconds.
    let times = times("240");
    let film_ms = Film { numbers: stored(), filters: &times, ..film("mkv", "-c:v ffv1", "240") };
    let film_ms = measured(&film_ms.write_pixels(folder.path(), picture), None);
    film_ms.is_right(240.0);
    film_ms.names("data were lost: 5");
    // Every interval another one.
    let filters = "settb=1/90000,setpts=(N+0.3*sin(2.3*N))/120/TB";
    let codec = "-c:v libx264 -crf 10 -pix_fmt yuv420p -enc_time_base 1:90000 -video_track_timescale 90000";
    let irregular = |number: u32| {
        let time = f64::from(number) + 0.3 * (2.3 * f64::from(number)).sin();
        Ball::default().picture(time, number)
    };
    let path = Film { filters, ..film("mp4", codec, "120") }.write_pixels(folder.path(), irregular);
    let irregular = measured(&path, None);
    irregular.is_right(120.0);
    irregular.names("the rate varies");
}

#[test]
fn repeated_frames_are_named_and_not_measured_as_rest() {
    if let Some(path) = reported("frames-repeated/dup.npy") {
        let film = measured(&path, Some("5000"));
        film.is_right(5000.0);
        film.names("7 frames repeat the one before");
        film.names("mostly 5 apart");
    }
    let folder = tempfile::tempdir().unwrap();
    let repeated =
        |number: u32| if LOST.contains(&number) { if number == 11 { 9 } else { number - 1 } } else { number };
    let path = stack(folder.path(), (0..36).map(|number| picture(repeated(number))));
    let film_npy = measured(&path, Some("2000"));
    film_npy.is_right(2000.0);
    film_npy.names("5 frames repeat the one before");
    if !has_ffmpeg() {
        return;
    }
    let codec = "-c:v libx264 -crf 16 -pix_fmt yuv420p";
    let path = film("mp4", codec, "240").write_pixels(folder.path(), |number| picture(repeated(number)));
    let film = measured(&path, None);
    film.is_right(240.0);
    film.names("5 frames repeat the one before");
}

/// A film of 30 frames per second whose ball is too small to be measured: its line is right all the same.
#[test]
fn a_film_of_a_small_ball_is_read_with_its_rate() {
    let Some(path) = reported("real-ball-toss-all-lost/toss.mkv").filter(|_| has_ffmpeg()) else { return };
    let footage = ricochet::import::open(&[path], None).unwrap();
    println!("{} {:?}", footage.summary(), footage.warnings);
    assert_eq!((footage.frame_rate_hz, footage.count, footage.provenance.missing), (30.0, 32, 0));
    assert_eq!(footage.map(Result::unwrap).count(), 32);
}
