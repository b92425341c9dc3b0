//! Scatter and mean error of every result over many films.

use super::monte_carlo::FilmSimulation;
use super::pose_noise::PoseNoise;
use super::rig::Rig;
use crate::config::BodyKind;
use crate::failure::Failure;
use crate::numeric::quantile;
use crate::results::{BodyVelocity, Impact, Phase, VelocitySample};
use crate::synth::SimulatedFilm;
use crate::track::TrackerRows;
use std::num::NonZeroUsize;

/// Minimum fraction of the films with a result; otherwise it is not predicted.
const MIN_FRACTION: f64 = 0.5;

/// The predicted uncertainty of one result.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// The name: a column of the `impact` table, or a velocity column prefixed by its phase.
    pub name: String,
    /// The unit.
    pub unit: &'static str,
    /// Standard deviation over films, without outliers.
    pub sigma: f64,
    /// Mean error; its root mean square over frames for a velocity.
    pub offset: f64,
    /// True value; the mean absolute value for a velocity.
    pub truth: f64,
    /// Fraction of the films that have the result.
    pub fraction: f64,
    /// Fraction of those that are outliers, excluded from scatter and mean.
    pub outliers: f64,
}

/// A column of the `velocity` table.
struct VelocityColumn {
    name: &'static str,
    value: fn(&BodyVelocity) -> Option<f64>,
}

const VELOCITIES: [VelocityColumn; 3] = [
    VelocityColumn { name: "vn_m_s", value: |velocity| Some(velocity.vn_m_s) },
    VelocityColumn { name: "vt_m_s", value: |velocity| Some(velocity.vt_m_s) },
    VelocityColumn { name: "omega_rad_s", value: |velocity| velocity.omega_rad_s },
];

/// The phases of a film; `Unknown` is that of a motion without an impact.
const PHASES: [(Phase, &str); 4] =
    [(Phase::Unknown, "motion"), (Phase::Flight, "flight"), (Phase::Contact, "contact"), (Phase::Rebound, "rebound")];

/// Outlier threshold, in multiples of the scatter.
const OUTLIER_SIGMAS: f64 = 5.0;

/// Probability of a normal distribution within one sigma.
const ONE_SIGMA: f64 = 0.682_7;

/// Errors of one result over films.
#[derive(Debug, Clone, Default)]
struct Errors(Vec<f64>);

/// The statistics of the errors.
struct Scatter {
    mean: f64,
    variance: f64,
    /// Fraction of outliers.
    outliers: f64,
}

impl Errors {
    /// Computes mean and sample variance without outliers; `None` for fewer than two errors.
    ///
    /// Outliers are further from the median than five times the 68.27 % quantile of that distance.
    /// A single film that selects another contact law would dominate the plain variance, although it also reports a
    /// large sigma.
    fn scatter(&self) -> Option<Scatter> {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        let median = quantile(&mut sorted, 0.5)?;
        let mut apart: Vec<f64> = sorted.iter().map(|error| (error - median).abs()).collect();
        let most = OUTLIER_SIGMAS * quantile(&mut apart, ONE_SIGMA)?;
        sorted.retain(|error| (error - median).abs() <= most);
        let count = sorted.len() as f64;
        let mean = sorted.iter().sum::<f64>() / count;
        let squares: f64 = sorted.iter().map(|error| (error - mean).powi(2)).sum();
        let outliers = 1.0 - count / self.0.len() as f64;
        (count >= 2.0).then(|| Scatter { mean, variance: squares / (count - 1.0), outliers })
    }
}

/// Computes scatter and mean error over films with known truth.
///
/// A velocity is pooled over the frames of a phase in which most films have it.
pub fn spread(
    truth: &[VelocitySample],
    impact: Option<&Impact>,
    films: &[TrackerRows],
    kind: BodyKind,
) -> Vec<Expected> {
    let is_rod = kind == BodyKind::Rod;
    let mut rows = Vec::new();
    for (phase, prefix) in PHASES {
        for column in VELOCITIES.iter().filter(|column| !(is_rod && column.name == "omega_rad_s")) {
            let expected = velocity_scatter(column, phase, truth, films);
            rows.extend(expected.map(|expected| Expected { name: format!("{prefix}.{}", column.name), ..expected }));
        }
    }
    let Some(impact) = impact else { return rows };
    for (name, exact) in impact.numbers() {
        let is_spin = name.starts_with("omega") || name == "restitution_tangential" || name == "slip_end_s";
        if let Some(exact) = exact.filter(|_| !(is_rod && is_spin)) {
            rows.extend(impact_scatter(name, exact.value, films));
        }
    }
    rows
}

/// Returns scatter and mean error of a velocity, both root mean squares over the frames of a phase; `None` if no frame
/// has enough films with it.
fn velocity_scatter(
    column: &VelocityColumn,
    phase: Phase,
    truth: &[VelocitySample],
    films: &[TrackerRows],
) -> Option<Expected> {
    let (mut variance, mut offset, mut size, mut frames, mut fraction, mut outliers) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for (index, row) in truth.iter().enumerate().filter(|(_, row)| row.phase == phase) {
        let Some(exact) = row.velocity.as_ref().and_then(column.value) else { continue };
        let measured = films.iter().filter_map(|film| film.velocities.get(index)?.velocity.as_ref());
        let errors = Errors(measured.filter_map(|velocity| Some((column.value)(velocity)? - exact)).collect());
        let count = errors.0.len() as f64;
        let Some(own) = errors.scatter().filter(|_| count >= MIN_FRACTION * films.len() as f64) else { continue };
        variance += own.variance;
        // The residual noise of the mean over films is not an offset.
        offset += (own.mean.powi(2) - own.variance / count).max(0.0);
        (size, frames, fraction, outliers) =
            (size + exact.abs(), frames + 1.0, fraction + count / films.len() as f64, outliers + own.outliers);
    }
    (frames > 0.0).then(|| Expected {
        name: column.name.into(),
        unit: unit_of(column.name),
        sigma: f64::sqrt(variance / frames),
        offset: f64::sqrt(offset / frames),
        truth: size / frames,
        fraction: fraction / frames,
        outliers: outliers / frames,
    })
}

/// Returns scatter and mean error of a number of the first impact, in its last revision; `None` if too few films have
/// it.
fn impact_scatter(name: &'static str, exact: f64, films: &[TrackerRows]) -> Option<Expected> {
    let measured = films.iter().filter_map(|film| {
        let last = film.impacts.iter().filter(|impact| impact.number == 0).max_by_key(|impact| impact.revision)?;
        last.get(name)
    });
    let errors = Errors(measured.map(|measured| measured.value - exact).collect());
    let fraction = errors.0.len() as f64 / films.len() as f64;
    let Scatter { mean, variance, outliers } = errors.scatter().filter(|_| fraction >= MIN_FRACTION)?;
    Some(Expected {
        name: name.into(),
        unit: unit_of(name),
        sigma: variance.sqrt(),
        offset: mean,
        truth: exact,
        fraction,
        outliers,
    })
}

/// Returns the unit from the end of a column's name; empty for a number without a unit.
fn unit_of(name: &str) -> &'static str {
    let units = [("_rad_s", "rad/s"), ("_m_s2", "m/s^2"), ("_m_s", "m/s"), ("_mm", "mm"), ("_s", "s")];
    units.iter().find(|(end, _)| name.ends_with(end)).map_or("", |(_, unit)| unit)
}

/// The noise of a rig's poses and the predicted uncertainty of its results.
#[derive(Debug, Clone)]
pub(super) struct Prediction {
    pub(super) noise: PoseNoise,
    pub(super) rows: Vec<Expected>,
}

impl Prediction {
    /// Predicts a rig from `films` films.
    ///
    /// # Errors
    ///
    /// When the rig cannot film or track the body.
    pub(super) fn compute(rig: &Rig, films: u64) -> Result<Self, Failure> {
        rig.check()?;
        let film = rig.film()?;
        let noise = PoseNoise::estimate(rig, &film)?;
        let simulation = FilmSimulation::new(rig, &film, noise.clone());
        let films = simulate_films(&simulation, films)?;
        let rows = spread(&true_velocities(&film), film.impact().as_ref(), &films, rig.config.bodies[0].kind);
        Ok(Self { noise, rows })
    }

    /// Returns the predicted scatter of the result with this name; `None` if it is not predicted.
    pub(super) fn sigma(&self, name: &str) -> Option<f64> {
        self.rows.iter().find(|row| row.name == name).map(|row| row.sigma)
    }
}

/// Returns the true velocity in each frame of a film.
fn true_velocities(film: &SimulatedFilm) -> Vec<VelocitySample> {
    (0..film.frames()).map(|index| film.truth(index)).collect()
}

/// Simulates all films on all cores and returns their rows in order.
///
/// # Errors
///
/// When a thread panics.
fn simulate_films(simulation: &FilmSimulation, films: u64) -> Result<Vec<TrackerRows>, Failure> {
    let threads = std::thread::available_parallelism().map_or(1, NonZeroUsize::get).min(films.max(1) as usize);
    let share = |thread: usize| (thread as u64..films).step_by(threads);
    let measured = std::thread::scope(|scope| {
        let work = |thread| {
            scope.spawn(move || share(thread).map(|film| (film, simulation.simulate(film))).collect::<Vec<_>>())
        };
        let workers: Vec<_> = (0..threads).map(work).collect();
        workers.into_iter().map(std::thread::ScopedJoinHandle::join).collect::<Result<Vec<_>, _>>()
    });
    let mut measured = measured.map_err(|_| Failure::internal("a prediction thread panicked"))?.concat();
    measured.sort_by_key(|(film, _)| *film);
    Ok(measured.into_iter().map(|(_, rows)| rows).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_outlier_does_not_change_the_scatter() {
        let mut errors: Vec<f64> = (0..99).map(|k| f64::from(k - 49) / 28.6).collect();
        let plain = Errors(errors.clone()).scatter().unwrap();
        assert!((plain.variance - 1.0).abs() < 0.05 && plain.outliers.abs() < 1e-12, "{}", plain.variance);
        errors.push(40.0);
        let outliers = Errors(errors).scatter().unwrap();
        assert!((outliers.variance - plain.variance).abs() < 0.02 && (outliers.outliers - 0.01).abs() < 1e-9);
        assert!(Errors(vec![1.0]).scatter().is_none() && Errors(Vec::new()).scatter().is_none());
    }
}
