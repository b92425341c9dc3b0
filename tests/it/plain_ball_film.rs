//! A plain ball that bounces three times, filmed by a phone: restitutions by the outline, and no spin.
//!
//! The film is drawn here by sampling, not by the simulator: a lit ball with a highlight, its shadow on the floor, motion
//! blur, noise and the compression of H.264.

use crate::support::{Rig, csv, is_required, succeed};
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

const SIZE: [usize; 2] = [1280, 720];
const RATE_HZ: f64 = 240.0;
const RADIUS_PX: f64 = 20.0;
const FLOOR_PX: f64 = 600.0;
const RESTITUTION: f64 = 0.75;
/// The drop before the first bounce, px. One px is one mm.
const DROP_PX: f64 = 250.0;
/// The motion blur, as a fraction of the frame period, and its samples.
const EXPOSURE: f64 = 0.2;
const BLUR: [f64; 4] = [-0.375, -0.125, 0.125, 0.375];
const NOISE_DN: f64 = 2.0;
/// The maximum error of a restitution.
const MAX_ERROR: f64 = 0.03;

const RIG: &str = r#"
[scale]
mm_per_px = 1.0
[surface]
angle_deg = 0
[[body]]
name = "ball"
kind = "ball"
diameter_mm = 40.0
"#;

/// The light and the tone of a film.
#[derive(Clone, Copy)]
struct Light {
    ball_dn: f64,
    ground_dn: f64,
    /// The slope of the light to one side.
    side: f64,
    start_x_px: f64,
}

/// A flight: its start, and the height and vertical speed then; px and frames.
struct Flight {
    start: f64,
    y_px: f64,
    vy_px: f64,
}

fn gravity_px() -> f64 {
    9806.65 / (RATE_HZ * RATE_HZ)
}

/// The flights of a ball that is dropped and bounces three times, and the number of frames.
fn flights() -> (Vec<Flight>, usize) {
    let (g, contact_px) = (gravity_px(), FLOOR_PX - RADIUS_PX);
    let mut flights = vec![Flight { start: 0.0, y_px: contact_px - DROP_PX, vy_px: 0.0 }];
    let (mut touch, mut speed) = ((2.0 * DROP_PX / g).sqrt(), (2.0 * DROP_PX * g).sqrt());
    for _ in 0..3 {
        speed *= RESTITUTION;
        flights.push(Flight { start: touch, y_px: contact_px, vy_px: -speed });
        touch += 2.0 * speed / g;
    }
    (flights, touch as usize - 2)
}

/// A linear congruential generator of nearly normal numbers.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (self.0 >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let sum: f64 = (0..4).map(|_| uniform()).sum();
        sum * 3.0_f64.sqrt()
    }
}

/// The grey level of a point of the room, with the shadow of the ball on the floor.
fn room(light: Light, x: f64, y: f64, ball: [f64; 2]) -> f64 {
    if y < FLOOR_PX {
        return light.ground_dn + 6.0 * (x / 37.0).sin() * (y / 53.0).cos() + 10.0 * x / SIZE[0] as f64;
    }
    let height = FLOOR_PX - RADIUS_PX - ball[1];
    let far = ((x - ball[0]) / (RADIUS_PX * (1.0 + height / 40.0))).powi(2) + ((y - FLOOR_PX - 3.0) / 6.0).powi(2);
    (110.0 + 4.0 * (x / 11.0).sin()) * (1.0 - 0.6 * (-far - height / 40.0).exp())
}

/// The grey level of a ball at a point relative to its centre, in radii.
fn lit(light: Light, x: f64, y: f64) -> f64 {
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    let lambert = (-light.side * x - 0.6 * y + 0.7 * z).max(0.0) / (light.side.powi(2) + 0.85).sqrt();
    let highlight = 60.0 * (-((x + 0.3).powi(2) + (y + 0.35).powi(2)) / 0.012).exp();
    light.ball_dn * (0.45 + 0.55 * lambert) + highlight
}

/// The ball far away from the picture.
const AWAY_PX: [f64; 2] = [-1e4, -1e4];
/// The distance from the ball within which the room changes, px.
const NEAR_PX: f64 = 160.0;

/// Draws the grey levels of the room without the ball.
fn empty(light: Light) -> Vec<f64> {
    (0..SIZE[0] * SIZE[1]).map(|at| room(light, (at % SIZE[0]) as f64, (at / SIZE[0]) as f64, AWAY_PX)).collect()
}

/// Returns the mean grey level of a pixel over the exposure.
fn exposed(light: Light, centers: [[f64; 2]; 4], x: f64, y: f64) -> f64 {
    let level = |center: &[f64; 2]| {
        let [dx, dy] = [x - center[0], y - center[1]];
        let covered = (RADIUS_PX - dx.hypot(dy) + 0.5).clamp(0.0, 1.0);
        let ground = room(light, x, y, *center);
        covered * lit(light, dx / RADIUS_PX, dy / RADIUS_PX) + (1.0 - covered) * ground
    };
    0.25 * centers.iter().map(level).sum::<f64>()
}

fn frame(light: Light, empty: &[f64], centers: [[f64; 2]; 4], noise: &[f64]) -> Vec<u8> {
    let level = |at: usize| {
        let (x, y) = ((at % SIZE[0]) as f64, (at / SIZE[0]) as f64);
        let is_near = (x - centers[0][0]).abs() < NEAR_PX && (y - centers[0][1]).abs() < NEAR_PX;
        let mean = if is_near { exposed(light, centers, x, y) } else { empty[at] };
        (mean + NOISE_DN * noise[at]).round().clamp(0.0, 255.0) as u8
    };
    (0..SIZE[0] * SIZE[1]).map(level).collect()
}

/// Films the ball: H.264 that plays at 30 frames/s.
fn film(light: Light, to: &Path) {
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "rawvideo", "-pixel_format", "gray", "-video_size", &size, "-framerate", "30"])
        .args(["-i", "pipe:0", "-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p", "-threads", "1"])
        .arg(to)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut pipe = ffmpeg.stdin.take().unwrap();
    let (flights, frames) = flights();
    let (empty, mut random) = (empty(light), Noise(7));
    let pixels = SIZE[0] * SIZE[1];
    // One field of noise, read from another place for each frame.
    let noise: Vec<f64> = (0..2 * pixels).map(|_| random.next()).collect();
    for k in 0..frames {
        let centers = BLUR.map(|part| {
            let time = k as f64 + 0.5 + EXPOSURE * part;
            let flight = flights.iter().rev().find(|flight| flight.start <= time).unwrap();
            let since = time - flight.start;
            let y = flight.y_px + flight.vy_px * since + 0.5 * gravity_px() * since * since;
            [light.start_x_px + 0.6 * time, y]
        });
        let from = (k * 104_729) % pixels;
        pipe.write_all(&frame(light, &empty, centers, &noise[from..from + pixels])).unwrap();
    }
    drop(pipe);
    assert!(ffmpeg.wait().unwrap().success());
}

#[test]
fn three_bounces_of_a_plain_ball_in_a_phone_film_have_their_restitution_and_no_spin() {
    let listed = Command::new("ffmpeg").args(["-v", "error", "-encoders"]).output();
    let has = listed.is_ok_and(|listed| String::from_utf8_lossy(&listed.stdout).contains("libx264"));
    assert!(has || !is_required("FFMPEG"), "ffmpeg with libx264 is required but not installed");
    if !has {
        eprintln!("left out: ffmpeg with libx264 is not installed");
        return;
    }
    for light in [
        Light { ball_dn: 215.0, ground_dn: 50.0, side: 0.2, start_x_px: 420.3 },
        Light { ball_dn: 200.0, ground_dn: 60.0, side: 0.4, start_x_px: 700.8 },
    ] {
        let rig = Rig::new();
        let (movie, config, results) = (rig.path("phone.mp4"), rig.file("rig.toml", RIG), rig.path("results.mcap"));
        film(light, &movie);
        let [movie, config, out] = [&movie, &config, &results].map(|path| path.to_str().unwrap());
        println!("{}", succeed(["analyze", movie, "--fps", "240", "--config", config, "-o", out]));
        let table = csv(&results, "impact");
        let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let names = lines.next().unwrap();
        let column = |name: &str| names.iter().position(|other| *other == name).unwrap();
        let impacts: Vec<_> = lines.collect();
        assert_eq!(impacts.len(), 3, "{table}");
        for impact in &impacts {
            let number = |name: &str| impact[column(name)].parse::<f64>();
            let (found, sigma) = (number("restitution").unwrap(), number("sigma_restitution").unwrap());
            println!("{found:.4} +- {sigma:.4}, {}", impact[column("status")]);
            let off = (found - RESTITUTION).abs();
            assert!(off < MAX_ERROR && off < 2.0 * sigma, "{found} +- {sigma}");
            assert!(
                number("omega_before_rad_s").is_err() && number("omega_after_rad_s").is_err(),
                "a spin: {impact:?}"
            );
        }
        let velocities = csv(&results, "velocity");
        let spins = velocities.lines().skip(1).filter(|line| !line.split(',').nth(17).unwrap().is_empty());
        assert_eq!(spins.count(), 0, "{velocities}");
    }
}
