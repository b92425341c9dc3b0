//! Collisions against simulated truth.

use ricochet::measure::{Tracker, TrackerParams, TrackerRows};
use ricochet::motion::MotionParams;
use ricochet::results::{BodyStep, Estimate, ForceLaw, Impact};

use crate::bounce::{Experiment, Noise, Truth, lacrosse, rod, tennis};

pub fn track(steps: &[BodyStep], params: &MotionParams) -> TrackerRows {
    let mut rows = TrackerRows::default();
    let mut tracker = Tracker::new(&TrackerParams { motion: vec![params.clone()], contact: true });
    for step in steps {
        tracker.push(step, &mut rows);
    }
    tracker.finish(&mut rows);
    rows
}

/// Error and error over sigma, noise seed by noise seed.
#[derive(Default)]
struct Errors {
    error: Vec<f64>,
    pull: Vec<f64>,
}

impl Errors {
    fn push(&mut self, estimate: Option<Estimate>, truth: f64, unit: f64) {
        let e = estimate.expect("measured");
        self.error.push((e.value - truth) / unit);
        self.pull.push((e.value - truth).abs() / e.sigma);
    }

    fn bias(&self) -> f64 {
        self.error.iter().sum::<f64>() / self.error.len() as f64
    }

    fn rms(&self) -> f64 {
        (self.error.iter().map(|e| e * e).sum::<f64>() / self.error.len() as f64).sqrt()
    }

    fn worst(&self) -> f64 {
        self.error.iter().map(|e| e.abs()).fold(0.0, f64::max)
    }

    fn covered(&self, sigmas: f64) -> f64 {
        self.pull.iter().filter(|p| **p <= sigmas).count() as f64 / self.pull.len() as f64
    }
}

const NAMES: [&str; 11] =
    ["start", "deepest", "end", "e", "vn before", "vn after", "vt after", "omega", "depth", "accel", "impulse"];

fn compare(errors: &mut [Errors; 11], impact: &Impact, truth: &Truth) {
    let period = 1.0 / truth.experiment.frame_rate_hz;
    let [vn, vt, omega] = truth.before;
    let gravity = 9.81 * (truth.end - truth.start) * period;
    let push = |e: &mut Errors, x, t, unit| e.push(x, t, unit);
    push(&mut errors[0], impact.start_s, truth.start * period, period);
    push(&mut errors[1], impact.deepest_s, truth.deepest * period, period);
    push(&mut errors[2], impact.end_s, truth.end * period, period);
    push(&mut errors[3], impact.restitution, -truth.after[0] / vn, 0.01);
    push(&mut errors[4], impact.vn_before_m_s, vn, vn.abs() / 100.0);
    push(&mut errors[5], impact.vn_after_m_s, truth.after[0], vn.abs() / 100.0);
    push(&mut errors[6], impact.vt_after_m_s, truth.after[1], vn.abs() / 100.0);
    push(&mut errors[7], impact.omega_after_rad_s, truth.after[2], (truth.after[2] - omega).abs().max(1.0) / 100.0);
    push(&mut errors[8], impact.compression_max_mm, truth.depth_mm, truth.depth_mm / 100.0);
    push(&mut errors[9], impact.acceleration_max_m_s2, truth.acceleration, truth.acceleration / 100.0);
    push(&mut errors[10], impact.impulse_ratio, (truth.after[1] - vt) / (truth.after[0] - vn + gravity), 0.01);
}

struct Study {
    errors: [Errors; 11],
    laws: Vec<ForceLaw>,
}

fn study(experiment: &Experiment, seeds: u64, interval: usize) -> Study {
    let mut errors: [Errors; 11] = Default::default();
    let mut laws = Vec::new();
    for seed in 0..seeds {
        let mut noise = Noise::new(seed + 1);
        let truth = experiment.simulate(noise.uniform());
        let params = MotionParams { interval_frames: interval as u32, ..experiment.params() };
        let rows = track(&truth.steps(interval, &mut noise), &params);
        let impact = rows.impacts.last().unwrap_or_else(|| panic!("{} seed {seed}: no impact", experiment.name));
        assert!(rows.impacts.iter().all(|i| i.number == 0), "{} seed {seed}: {:?}", experiment.name, rows.impacts);
        compare(&mut errors, impact, &truth);
        laws.push(impact.force_law);
    }
    println!("{} interval {interval}: bias / rms / worst, covered at 1 and 2 sigma", experiment.name);
    for (name, e) in NAMES.iter().zip(&errors) {
        let cover = (e.covered(1.0), e.covered(2.0));
        println!("  {name:10} {:8.4} {:8.4} {:8.4}   {:.2} {:.2}", e.bias(), e.rms(), e.worst(), cover.0, cover.1);
    }
    let count = |law: ForceLaw| laws.iter().filter(|l| **l == law).count();
    println!("  laws {:?}", ForceLaw::ALL.map(|l| (l.word(), count(l))));
    Study { errors, laws }
}

#[test]
fn figures() {
    for experiment in [lacrosse(false), lacrosse(true), tennis(false), tennis(true), rod(false), rod(true)] {
        let s = study(&experiment, 60, 1);
        assert_eq!(s.laws.len(), 60);
        assert!(s.errors[0].worst() < 1.0);
    }
}
