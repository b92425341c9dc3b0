//! Scatter and mean error of every number, over many films.

use super::course::Course;
use super::noise::Noise;
use super::rig::Rig;
use crate::measure::TrackerRows;
use crate::process::Stop;
use crate::results::{BodyVelocity, Impact, Phase, VelocitySample};
use crate::synth::World;
use std::num::NonZeroUsize;

/// Share of the films in which a number has to be told, or it is not foreseen.
const LEAST_TOLD: f64 = 0.5;

/// What is foreseen of one number.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    /// Its name: a column of the `impact` table, or that of a velocity with its phase before it.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Standard deviation from film to film.
    pub sigma: f64,
    /// Mean error: of a number in many frames, its root mean square over them.
    pub offset: f64,
    /// Its true value; of a number in many frames, the mean size.
    pub truth: f64,
    /// Share of the films that tell it.
    pub told: f64,
}

/// A column of `velocity`: name, unit, number.
type OfVelocity = (&'static str, &'static str, fn(&BodyVelocity) -> f64);

const VELOCITIES: [OfVelocity; 3] = [
    ("vn_m_s", "m/s", |velocity| velocity.vn_m_s),
    ("vt_m_s", "m/s", |velocity| velocity.vt_m_s),
    ("omega_rad_s", "rad/s", |velocity| velocity.omega_rad_s),
];

const PHASES: [(&str, Phase); 4] =
    [("motion", Phase::Unknown), ("flight", Phase::Flight), ("contact", Phase::Contact), ("rebound", Phase::Rebound)];

/// Sums over films of one number.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    count: f64,
    error: f64,
    squares: f64,
}

impl Sums {
    fn take(&mut self, error: f64) {
        self.count += 1.0;
        self.error += error;
        self.squares += error * error;
    }

    fn mean(&self) -> f64 {
        self.error / self.count
    }

    fn variance(&self) -> Option<f64> {
        let spread = self.squares - self.count * self.mean().powi(2);
        (self.count >= 2.0).then(|| (spread / (self.count - 1.0)).max(0.0))
    }
}

/// Scatter and mean error of films of which the truth is known.
///
/// A number in many frames is pooled over the frames of a phase in which most films tell it.
pub fn spread(truth: &[VelocitySample], impact: Option<&Impact>, films: &[TrackerRows], is_rod: bool) -> Vec<Expected> {
    let mut rows = Vec::new();
    for (word, phase) in PHASES {
        for column in VELOCITIES.iter().filter(|column| !(is_rod && column.0 == "omega_rad_s")) {
            rows.extend(of_velocity(word, phase, column, truth, films));
        }
    }
    let Some(impact) = impact else { return rows };
    for (name, exact) in impact.numbers() {
        let is_spin = name.starts_with("omega") || name == "restitution_tangential" || name == "slip_end_s";
        if let Some(exact) = exact.filter(|_| !(is_rod && is_spin)) {
            rows.extend(of_impact(name, exact.value, films));
        }
    }
    rows
}

fn of_velocity(
    word: &str,
    phase: Phase,
    (name, unit, number): &OfVelocity,
    truth: &[VelocitySample],
    films: &[TrackerRows],
) -> Option<Expected> {
    let (mut variance, mut offset, mut size, mut frames, mut told) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (index, row) in truth.iter().enumerate().filter(|(_, row)| row.phase == phase) {
        let Some(exact) = row.velocity.as_ref().map(number) else { continue };
        let mut sums = Sums::default();
        for film in films {
            let measured = film.velocities.get(index).and_then(|row| row.velocity.as_ref());
            measured.into_iter().for_each(|velocity| sums.take(number(velocity) - exact));
        }
        let Some(own) = sums.variance().filter(|_| sums.count >= LEAST_TOLD * films.len() as f64) else { continue };
        variance += own;
        // What is left of the noise in the mean over the films is no offset.
        offset += (sums.mean().powi(2) - own / sums.count).max(0.0);
        (size, frames, told) = (size + exact.abs(), frames + 1.0, told + sums.count / films.len() as f64);
    }
    (frames > 0.0).then(|| Expected {
        name: format!("{word}.{name}"),
        unit,
        sigma: f64::sqrt(variance / frames),
        offset: f64::sqrt(offset / frames),
        truth: size / frames,
        told: told / frames,
    })
}

fn of_impact(name: &'static str, exact: f64, films: &[TrackerRows]) -> Option<Expected> {
    let mut sums = Sums::default();
    for film in films {
        let last = film.impacts.iter().filter(|impact| impact.number == 0).max_by_key(|impact| impact.revision);
        let told = last.and_then(|impact| impact.numbers().into_iter().find(|(column, _)| *column == name)?.1);
        told.into_iter().for_each(|told| sums.take(told.value - exact));
    }
    let told = sums.count / films.len() as f64;
    let sigma = sums.variance().filter(|_| told >= LEAST_TOLD)?.sqrt();
    Some(Expected { name: name.into(), unit: unit(name), sigma, offset: sums.mean(), truth: exact, told })
}

/// The unit that ends the name of a column.
fn unit(name: &str) -> &'static str {
    let units = [("_rad_s", "rad/s"), ("_m_s2", "m/s^2"), ("_m_s", "m/s"), ("_mm", "mm"), ("_s", "s")];
    units.iter().find(|(end, _)| name.ends_with(end)).map_or("", |(_, unit)| unit)
}

/// What a rig's pictures leave uncertain, and what that comes to.
#[derive(Debug, Clone)]
pub(super) struct Foreseen {
    pub(super) noise: Noise,
    pub(super) rows: Vec<Expected>,
}

impl Foreseen {
    /// Of a rig, over `films` films; `None` after a stop.
    ///
    /// # Errors
    ///
    /// One line when the rig cannot film or follow the body.
    pub(super) fn of(rig: &Rig, films: u64, stop: &Stop) -> anyhow::Result<Option<Self>> {
        rig.check()?;
        let world = rig.world()?;
        let noise = Noise::of(rig, &world)?;
        let course = Course::new(rig, &world, noise.clone());
        let Some(films) = all(&course, films, stop)? else { return Ok(None) };
        let rows = spread(&truth(&world), world.impact().as_ref(), &films, rig.scenario.body.rod.is_some());
        Ok(Some(Self { noise, rows }))
    }

    /// Scatter of a number.
    pub(super) fn sigma(&self, name: &str) -> Option<f64> {
        self.rows.iter().find(|row| row.name == name).map(|row| row.sigma)
    }
}

fn truth(world: &World) -> Vec<VelocitySample> {
    (0..world.frames()).map(|index| world.truth(index)).collect()
}

/// Every film, on all cores, in order.
fn all(course: &Course, films: u64, stop: &Stop) -> anyhow::Result<Option<Vec<TrackerRows>>> {
    let threads = std::thread::available_parallelism().map_or(1, NonZeroUsize::get).min(films.max(1) as usize);
    let share = |thread: usize| (thread as u64..films).step_by(threads);
    let measured = std::thread::scope(|scope| {
        let work = |thread| {
            scope.spawn(move || {
                let films = share(thread).take_while(|_| !stop.requested());
                films.map(|film| (film, course.rows(film))).collect::<Vec<_>>()
            })
        };
        let workers: Vec<_> = (0..threads).map(work).collect();
        workers.into_iter().map(std::thread::ScopedJoinHandle::join).collect::<Result<Vec<_>, _>>()
    });
    let mut measured = measured.map_err(|_| anyhow::anyhow!("a thread that foresees panicked"))?.concat();
    measured.sort_by_key(|(film, _)| *film);
    let is_whole = measured.len() as u64 == films;
    Ok(is_whole.then(|| measured.into_iter().map(|(_, rows)| rows).collect()))
}
