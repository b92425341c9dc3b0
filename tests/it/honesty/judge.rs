//! Compares the rows of a scene with its truth.

use super::draw::Scene;
use super::film;
use crate::measured_world::rows_of_film;
use ricochet::config::BodyKind;
use ricochet::image::Image;
use ricochet::results::{FrameCoding, PointStatus, TrackSample, VelocitySample};
use ricochet::synth::{Layout, SimulatedFilm};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// A row is wrong if a number of it is off by more than this many of its standard uncertainties.
pub const MAX_SIGMAS: f64 = 5.0;
/// A wrong row is misleading if the number is also off by more than this.
const MAX_CENTER_PX: f64 = 0.2;
const MAX_STEP_PX: f64 = 0.02;
const MAX_STEP_DEG: f64 = 0.02;
/// The error of a spin, and of a number of the impact, relative to the truth.
const MAX_RELATIVE: f64 = 0.01;
/// The visible share from which a person could measure a ball: a struck one sinks into the flat.
const MIN_VISIBLE: f64 = 0.9;
/// The contrast at the rim, in standard deviations of the noise, and the share of the rim that has it.
const MIN_CONTRAST: f64 = 4.0;
const MIN_RIM: f64 = 0.6;
/// The noise that compression leaves, DN.
const COMPRESSION_DN: f64 = 2.0;

/// Numbers that could be measured, and those that were.
#[derive(Debug, Clone, Copy, Default)]
pub struct Share {
    pub possible: usize,
    pub measured: usize,
}

impl Share {
    fn count(&mut self, is_possible: bool, is_measured: bool) {
        self.possible += usize::from(is_possible);
        self.measured += usize::from(is_possible && is_measured);
    }
}

/// The largest error of a number in a scene.
#[derive(Debug, Clone, Copy)]
pub struct Worst {
    pub frame: u64,
    pub found: f64,
    pub truth: f64,
    pub sigma: f64,
    /// The rows in which the number is off by more than [`MAX_SIGMAS`].
    pub wrong: usize,
}

impl Worst {
    pub fn sigmas(&self) -> f64 {
        (self.found - self.truth).abs() / self.sigma
    }
}

/// The rows of a scene compared with the truth.
pub struct Verdict {
    pub seed: u64,
    pub tags: Vec<&'static str>,
    pub positions: Share,
    pub rotations: Share,
    pub impacts: Share,
    /// The rows that a person could measure and that were refused, by their status.
    pub refused: BTreeMap<&'static str, usize>,
    /// Valid rows, those with a wrong number, and those with a misleading one.
    pub rows: usize,
    pub wrong: usize,
    pub misleading: usize,
    /// The largest error of each number.
    pub worst: BTreeMap<&'static str, Worst>,
}

/// A number of a row and its truth.
struct Number {
    name: &'static str,
    found: Option<f64>,
    sigma: Option<f64>,
    truth: Option<f64>,
    /// The error that matters.
    limit: f64,
}

/// Measures a scene and compares every row; `None` if it cannot be filmed here.
pub fn judged(scene: &Scene) -> Option<Verdict> {
    let world = SimulatedFilm::new(&scene.scenario).unwrap();
    let frames = film::frames(scene, &world)?;
    // The import of a film states its codec, which these frames do not carry.
    let coding = if scene.crf.is_some() { FrameCoding::Predicted } else { FrameCoding::Independent };
    let rows = rows_of_film(frames.into_iter(), &world, &scene.rig, coding);
    let mut verdict = Verdict {
        seed: scene.seed,
        tags: scene.tags.clone(),
        positions: Share::default(),
        rotations: Share::default(),
        impacts: Share::default(),
        refused: BTreeMap::new(),
        rows: 0,
        wrong: 0,
        misleading: 0,
        worst: BTreeMap::new(),
    };
    let (mut shows_rim, turns) = (false, shows_rotation(scene, &world));
    for (row, track) in rows.velocities.iter().zip(&rows.tracks) {
        let truth = world.truth(row.frame);
        if row.frame % 8 == 0 {
            shows_rim = scene.kind != BodyKind::Ball || has_contrast(scene, &world, &truth);
        }
        let is_seen = shows_rim && is_seen(scene, &truth);
        let is_valid = row.status == PointStatus::Valid;
        verdict.positions.count(is_seen, is_valid && track.center_x_px.is_some());
        if is_seen && !is_valid {
            *verdict.refused.entry(row.status.as_str()).or_default() += 1;
        }
        let turned = row.motion.is_some_and(|step| step.dtheta_deg.is_some());
        let has_next = row.frame + 1 < world.frames();
        verdict.rotations.count(is_seen && turns && has_next, is_valid && turned);
        if is_valid {
            verdict.rows += 1;
            verdict.compare(row.frame, &numbers(scene, row, track, &truth));
        }
    }
    judge_impact(&mut verdict, &rows.impacts, &world);
    Some(verdict)
}

impl Verdict {
    fn compare(&mut self, frame: u64, numbers: &[Number]) {
        let (mut is_wrong, mut is_misleading) = (false, false);
        for number in numbers {
            let Some(((found, sigma), truth)) = number.found.zip(number.sigma).zip(number.truth) else { continue };
            let here = Worst { frame, found, truth, sigma, wrong: 0 };
            let beyond = here.sigmas() > MAX_SIGMAS;
            is_wrong |= beyond;
            is_misleading |= beyond && (found - truth).abs() > number.limit;
            let worst = self.worst.entry(number.name).or_insert(here);
            let wrong = worst.wrong + usize::from(beyond);
            *worst = Worst { wrong, ..if here.sigmas() > worst.sigmas() { here } else { *worst } };
        }
        self.wrong += usize::from(is_wrong);
        self.misleading += usize::from(is_misleading);
    }
}

/// The numbers of a valid row.
fn numbers(scene: &Scene, row: &VelocitySample, track: &TrackSample, truth: &VelocitySample) -> Vec<Number> {
    let number = |name, found, sigma, truth, limit| Number { name, found, sigma, truth, limit };
    let center = |name, found, truth| number(name, found, track.sigma_center_px, truth, MAX_CENTER_PX);
    let mut numbers =
        vec![center("x", track.center_x_px, truth.center_x_px), center("y", track.center_y_px, truth.center_y_px)];
    let spin_limit = |truth: f64, unit: f64| (MAX_STEP_DEG * unit).max(MAX_RELATIVE * truth.abs());
    if let Some((step, exact)) = row.motion.zip(truth.motion) {
        let turned = exact.dtheta_deg;
        numbers.extend([
            number("dx", Some(step.dx_px), Some(step.sigma_dx_px), Some(exact.dx_px), MAX_STEP_PX),
            number("dy", Some(step.dy_px), Some(step.sigma_dy_px), Some(exact.dy_px), MAX_STEP_PX),
            number("dtheta", step.dtheta_deg, step.sigma_dtheta_deg, turned, spin_limit(turned.unwrap_or(0.0), 1.0)),
        ]);
    }
    if let Some((v, exact)) = row.velocity.zip(truth.velocity) {
        let rate_hz = scene.scenario.camera.frame_rate_hz;
        let limit = MAX_STEP_PX * 1e-3 * scene.scenario.scale.mm_per_px * rate_hz;
        let spin = spin_limit(exact.omega_rad_s.unwrap_or(0.0), 1_f64.to_radians() * rate_hz);
        numbers.extend([
            number("vx", Some(v.vx_m_s), Some(v.sigma_v_m_s), Some(exact.vx_m_s), limit),
            number("vy", Some(v.vy_m_s), Some(v.sigma_v_m_s), Some(exact.vy_m_s), limit),
            number("omega", v.omega_rad_s, v.sigma_omega_rad_s, exact.omega_rad_s, spin),
        ]);
    }
    numbers
}

/// Compares the collision, whose row is the last revision; there is one or none.
fn judge_impact(verdict: &mut Verdict, impacts: &[ricochet::results::Impact], world: &SimulatedFilm) {
    let found: BTreeMap<u32, _> = impacts.iter().map(|impact| (impact.number, impact)).collect();
    let valid: Vec<_> = found.values().filter(|impact| impact.status == PointStatus::Valid).collect();
    let truth = world.impact();
    verdict.impacts.count(truth.is_some(), !valid.is_empty());
    for impact in valid {
        verdict.rows += 1;
        let Some(truth) = &truth else {
            // A collision that never happened.
            (verdict.wrong, verdict.misleading) = (verdict.wrong + 1, verdict.misleading + 1);
            let never = Worst { frame: 0, found: 1.0, truth: 0.0, sigma: 0.01, wrong: 1 };
            verdict.worst.insert("an impact that never was", never);
            continue;
        };
        let numbers: Vec<Number> = impact
            .numbers()
            .into_iter()
            .zip(truth.numbers())
            .map(|((name, found), (_, truth))| {
                let truth = truth.map(|truth| truth.value);
                let limit = MAX_RELATIVE * truth.unwrap_or(0.0).abs();
                let [found, sigma] = [found.map(|found| found.value), found.map(|found| found.sigma)];
                Number { name, found, sigma, truth, limit }
            })
            .collect();
        verdict.compare(0, &numbers);
    }
}

/// Whether the whole body is in the frame.
fn is_seen(scene: &Scene, truth: &VelocitySample) -> bool {
    if scene.kind == BodyKind::Patch {
        // A striped board looks the same wherever it is along its stripes.
        let is_striped = scene.scenario.body.pattern.layout == Layout::Stripes;
        return !is_striped
            && truth.center_x_px.zip(truth.center_y_px).is_some_and(|(x, y)| patch_is_inside(scene, [x, y]));
    }
    truth.status == PointStatus::Valid && truth.visible_fraction.is_none_or(|visible| visible > MIN_VISIBLE)
}

/// Whether a patch around this point is in the image.
fn patch_is_inside(scene: &Scene, at_px: [f64; 2]) -> bool {
    let (camera, reach_px) = (&scene.scenario.camera, scene.patch_radius_px);
    let inside = |at: f64, length: u32| at > reach_px && at < f64::from(length) - 1.0 - reach_px;
    inside(at_px[0], camera.width_px) && inside(at_px[1], camera.height_px)
}

/// Whether the paint shows a rotation without ambiguity.
fn shows_rotation(scene: &Scene, world: &SimulatedFilm) -> bool {
    let pattern = &scene.scenario.body.pattern;
    let is_plain = pattern.layout == Layout::Random && pattern.coverage <= 0.0 && pattern.lines == 0;
    let turned_deg = (1..world.frames()).map(|k| (world.angle_deg(k) - world.angle_deg(k - 1)).abs());
    let most_deg = turned_deg.fold(0.0, f64::max);
    let repeats = f64::from(pattern.repeats);
    scene.kind != BodyKind::Rod
        && match pattern.layout {
            Layout::Random | Layout::Football => !is_plain,
            Layout::Stripes => scene.kind == BodyKind::Ball && most_deg < 60.0,
            Layout::Sectors | Layout::Dots => most_deg < 90.0 / repeats,
        }
}

/// Whether enough of a ball's rim differs from the ground by more than noise.
fn has_contrast(scene: &Scene, world: &SimulatedFilm, truth: &VelocitySample) -> bool {
    let (Some(x), Some(y), Some(radius_px)) = (truth.center_x_px, truth.center_y_px, truth.radius_px) else {
        return false;
    };
    let camera = &scene.scenario.camera;
    let image = world.render_light(truth.frame);
    let noise_dn = if scene.crf.is_some() { camera.noise_dn.max(COMPRESSION_DN) } else { camera.noise_dn };
    let apart_px = 2.0 * camera.blur_px + scene.scenario.body.fuzz_px;
    let at = |image: &Image, radius_px: f64, angle: f64| {
        let [x, y] = [x + radius_px * angle.cos(), y + radius_px * angle.sin()].map(f64::round);
        (x >= 0.0 && y >= 0.0).then(|| image.view().at(x as usize, y as usize)).flatten()
    };
    let differs = |angle: &f64| {
        let sides = [radius_px - apart_px, radius_px + apart_px].map(|radius_px| at(&image, radius_px, *angle));
        let [Some(inside), Some(outside)] = sides else { return false };
        f64::from((inside - outside).abs()) > MIN_CONTRAST * noise_dn
    };
    let angles = (0..48).map(|part| f64::from(part) * TAU / 48.0);
    angles.filter(differs).count() as f64 >= 48.0 * MIN_RIM
}
