//! A film of a speckled ball with a known velocity, drawn in the test, and its measurement by the program.

use crate::support::{ricochet, run};
use ricochet::recording::Recording;
use std::path::Path;

/// Scale of the films, mm per pixel, and the diameter of the ball, mm.
const MM_PER_PX: f64 = 0.5;
const RADIUS_PX: f64 = 30.0;

/// A ball that moves and turns evenly.
#[derive(Debug, Clone, Copy)]
pub struct Ball {
    pub size: [u32; 2],
    /// Centre in frame 0, px.
    pub start: [f64; 2],
    /// Velocity along x and up, m/s, and spin, rad/s.
    pub vx: f64,
    pub vy: f64,
    pub omega: f64,
    /// Frames per second.
    pub rate_hz: f64,
}

impl Ball {
    /// The ball of the reports.
    pub const REPORTED: Self =
        Self { size: [144, 112], start: [45.0, 42.0], vx: 2.0, vy: -0.75, omega: 43.633, rate_hz: 5000.0 };

    /// Grey levels from 0 to 1 at a time, row by row.
    pub fn levels(&self, time_s: f64) -> Vec<f64> {
        let per_s = 1000.0 / MM_PER_PX;
        let center = [self.start[0] + self.vx * per_s * time_s, self.start[1] - self.vy * per_s * time_s];
        let (sin, cos) = (self.omega * time_s).sin_cos();
        let level = |x: u32, y: u32| {
            let (dx, dy) = (f64::from(x) - center[0], f64::from(y) - center[1]);
            // Counter-clockwise on the screen, where y points down.
            let (u, v) = (cos * dx - sin * dy, sin * dx + cos * dy);
            let texture: f64 = WAVES.iter().map(|[a, b, phase]| (a * u + b * v + phase).sin()).sum();
            let inside = (RADIUS_PX + 0.5 - dx.hypot(dy)).clamp(0.0, 1.0);
            0.08 + inside * (0.5 + 0.06 * texture)
        };
        (0..self.size[1]).flat_map(|y| (0..self.size[0]).map(move |x| level(x, y))).collect()
    }

    /// The frames with these numbers, 8 bit.
    pub fn frames(&self, numbers: impl IntoIterator<Item = u32>) -> Vec<Vec<u8>> {
        let frame = |number: u32| {
            let levels = self.levels(f64::from(number) / self.rate_hz);
            levels.iter().enumerate().map(|(at, level)| (255.0 * level + noise(number, at)).round() as u8).collect()
        };
        numbers.into_iter().map(frame).collect()
    }

    /// The same frames with `bits`, as little-endian words.
    pub fn deep_frames(&self, numbers: impl IntoIterator<Item = u32>, bits: u32) -> Vec<Vec<u8>> {
        let highest = f64::from((1_u32 << bits) - 1);
        let frame = |number: u32| -> Vec<u8> {
            let levels = self.levels(f64::from(number) / self.rate_hz);
            let levels = levels.iter().enumerate();
            let word = |(at, level): (usize, &f64)| (highest * (level + noise(number, at) / 255.0)).round() as u16;
            levels.map(word).flat_map(u16::to_le_bytes).collect()
        };
        numbers.into_iter().map(frame).collect()
    }
}

/// Waves of the texture: px^-1 along both axes, and a phase.
const WAVES: [[f64; 3]; 7] = [
    [0.9, 0.2, 0.3],
    [-0.35, 0.85, 1.1],
    [0.55, 0.6, 2.3],
    [0.7, -0.5, 4.0],
    [0.15, 1.05, 5.2],
    [1.1, -0.1, 0.9],
    [-0.6, 0.45, 3.3],
];

/// Repeatable noise of about one grey level of 8 bits.
fn noise(number: u32, at: usize) -> f64 {
    let mut mixed = (u64::from(number) << 32 | at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((mixed ^ mixed >> 32) % 1000) as f64 / 250.0 - 2.0
}

/// The rig file of the films.
pub const RIG: &str = "[camera]\nsource = \"recording\"\nid = \"x.mcap\"\nexposure_us = 0.001\n[scale]\nmm_per_px = 0.5\n\
    [surface]\nangle_deg = 0\n[[body]]\nname = \"ball\"\nkind = \"ball\"\ndiameter_mm = 30.0\n[correlation]\n\
    subset_size_px = 21\nstep_px = 6\n[velocity]\ngravity_m_s2 = 0\n";

/// The outcome of `ricochet analyze`.
pub struct Measured {
    pub messages: String,
    /// vx and vy, m/s, omega, rad/s, and the sigmas of speed and spin, of each frame that was measured.
    pub rows: Vec<[f64; 5]>,
    pub frames: usize,
}

/// Measures inputs in a folder with the program; wildcards are expanded as a shell does.
pub fn analyze(folder: &Path, rig: &Path, arguments: &str) -> Measured {
    let results = tempfile::tempdir().unwrap();
    let output = results.path().join("out.mcap");
    let line = format!("exec \"$0\" analyze {arguments} --config \"{}\" -o \"{}\"", rig.display(), output.display());
    let mut shell = std::process::Command::new("sh");
    let program = ricochet([""; 0]).get_program().to_owned();
    let done = shell.args(["-c", &line]).arg(program).current_dir(folder).env("LC_ALL", "C").output().unwrap();
    let messages = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(output.exists(), "{arguments}: {}: {messages}", done.status);
    let rows: Vec<_> = Recording::open(&output).unwrap().velocities().unwrap().map(Result::unwrap).collect();
    let row = |velocity: ricochet::results::BodyVelocity| {
        let (v, omega) = (velocity.sigma_v_m_s, velocity.sigma_omega_rad_s.unwrap());
        [velocity.vx_m_s, velocity.vy_m_s, velocity.omega_rad_s.unwrap(), v, omega]
    };
    Measured { messages, frames: rows.len(), rows: rows.iter().filter_map(|row| row.velocity).map(row).collect() }
}

/// The program's refusal of a command line.
pub fn refusal(arguments: &[&str]) -> String {
    let done = run(arguments);
    assert!(!done.status.success(), "{arguments:?} is refused");
    String::from_utf8_lossy(&done.stderr).into_owned()
}

impl Measured {
    /// Checks every frame against the truth within 3 sigma and 1 % of the largest value of its kind.
    pub fn check(&self, truth: [f64; 3], stored: usize, missing: usize) {
        let (messages, measured) = (&self.messages, self.rows.len());
        let is_whole = self.frames == stored + missing && measured + 2 >= stored;
        assert!(is_whole, "{measured} of {} rows, {stored} frames: {messages}", self.frames);
        let speed = truth[0].hypot(truth[1]);
        for row in &self.rows {
            for (index, scale) in [speed, speed, truth[2].abs()].into_iter().enumerate() {
                let off = (row[index] - truth[index]).abs();
                let sigma = if index < 2 { row[3] } else { row[4] };
                assert!(off < (3.0 * sigma).max(0.01 * scale), "{row:?}, expected {truth:?}: {messages}");
            }
        }
        for index in 0..3 {
            let mut values: Vec<f64> = self.rows.iter().map(|row| row[index]).collect();
            values.sort_by(f64::total_cmp);
            let median = values[values.len() / 2];
            let scale = if index < 2 { speed } else { truth[2].abs() };
            assert!((median - truth[index]).abs() < 0.01 * scale, "median {median}, expected {truth:?}: {messages}");
        }
    }

    /// Checks that the line of the importer, or a warning, holds these words.
    pub fn says(&self, words: &[&str]) {
        words.iter().for_each(|words| assert!(self.messages.contains(words), "{words:?} in {}", self.messages));
    }
}
