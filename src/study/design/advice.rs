//! The changes to a rig that reduce its uncertainty most.

use super::rig::Rig;
use super::scatter::{Expected, Prediction};
use crate::config::BodyKind;
use crate::failure::Failure;
use crate::motion::{Rotation, Scale};
use crate::synth::{MotionSetup, PatternSetup};

/// Patterns to try instead of the rig's own.
const PATTERNS: [&str; 5] = ["a-III", "b-III", "e-I", "e-II", "f-II"];

/// The relative magnification to try.
const MAGNIFICATION: f64 = 1.5;

/// The maximum relative scatter after a change that helps.
const MAX_HELPFUL_RATIO: f64 = 0.97;

/// A change to a rig.
struct Change {
    /// Its description.
    description: String,
    /// The changed rig.
    rig: Rig,
}

/// A change that was tried.
#[derive(Debug, Clone)]
pub(super) struct Advice {
    /// The description of the change.
    pub(super) description: String,
    /// Scatter of each number of [`judged_numbers`] after the change, relative to the present one.
    pub(super) ratios: Vec<(String, f64)>,
    /// Geometric mean of the ratios.
    pub(super) mean: f64,
}

impl Advice {
    /// Whether the change reduces the scatter noticeably.
    pub(super) fn helps(&self) -> bool {
        self.mean < MAX_HELPFUL_RATIO
    }
}

/// Returns the names of the predicted numbers that a change is judged by.
pub(super) fn judged_numbers(rows: &[Expected]) -> Vec<String> {
    let wanted = [
        "motion.vn_m_s",
        "motion.omega_rad_s",
        "flight.vn_m_s",
        "flight.omega_rad_s",
        "restitution",
        "start_s",
        "end_s",
    ];
    let is_predicted = |name: &&&str| rows.iter().any(|row| row.name == ***name && row.sigma > 0.0);
    wanted.iter().filter(is_predicted).map(|name| (*name).to_owned()).collect()
}

/// Predicts the rig after every change and returns the feasible changes, best first.
///
/// Each prediction takes `films` films. `tick` is called after each change. A change that makes the rig unusable is
/// left out.
///
/// # Errors
///
/// When the rig itself cannot be predicted.
pub(super) fn try_changes(rig: &Rig, films: u64, mut tick: impl FnMut()) -> Result<Vec<Advice>, Failure> {
    let now = Prediction::compute(rig, films)?;
    let names = judged_numbers(&now.rows);
    let mut found = Vec::new();
    for Change { description, rig: changed } in changes(rig) {
        // A change that makes the rig unusable is left out.
        if let Ok(then) = Prediction::compute(&changed, films) {
            found.extend(compare(description, &names, &now, &then));
        }
        tick();
    }
    found.sort_by(|a: &Advice, b: &Advice| a.mean.total_cmp(&b.mean));
    Ok(found)
}

/// Returns the ratios of the predicted scatter `then`, after a change, to that of `now`, and their geometric mean.
///
/// `names` are the compared numbers. `None` if one of them cannot be predicted.
fn compare(description: String, names: &[String], now: &Prediction, then: &Prediction) -> Option<Advice> {
    let ratio = |name: &String| Some((name.clone(), then.sigma(name)? / now.sigma(name)?));
    let ratios = names.iter().map(ratio).collect::<Option<Vec<_>>>()?;
    let logs: f64 = ratios.iter().map(|(_, ratio)| ratio.max(1e-6).ln()).sum();
    let mean = (logs / ratios.len().max(1) as f64).exp();
    Some(Advice { description, ratios, mean })
}

/// Returns the number of changes that are tried for a rig.
pub(super) fn change_count(rig: &Rig) -> u64 {
    changes(rig).len() as u64
}

/// Returns the changes to try for a rig.
fn changes(rig: &Rig) -> Vec<Change> {
    let camera = &rig.scenario.camera;
    let mut changes = vec![double_frame_rate(rig)];
    let mut change = |description: String, edit: &dyn Fn(&mut Rig)| {
        let mut changed = rig.clone();
        edit(&mut changed);
        changes.push(Change { description, rig: changed });
    };
    if camera.noise_dn > 0.0 {
        change(
            format!("half the noise ({} grey levels): more light or a better sensor", 0.5 * camera.noise_dn),
            &|rig| {
                rig.scenario.camera.noise_dn *= 0.5;
            },
        );
    }
    let blur_px = 1e-6 * camera.exposure_us * rig.speed_px_s();
    if blur_px > 0.0 {
        let description = format!(
            "half the exposure ({} us, {:.2} px of motion blur instead of {blur_px:.2}) with twice the light",
            0.5 * camera.exposure_us,
            0.5 * blur_px
        );
        change(description, &|rig| set_exposure(rig, 0.5 * rig.scenario.camera.exposure_us));
    }
    if camera.blur_px > 0.5 {
        let sharp_px = (camera.blur_px / 1.4).max(0.5);
        change(format!("a sharper image (blur {sharp_px:.2} px instead of {:.2})", camera.blur_px), &|rig| {
            rig.scenario.camera.blur_px = sharp_px;
        });
    }
    change("more contrast: body at 0.9 of full scale, speckles at 0.05".into(), &|rig| {
        (rig.scenario.shade.ball, rig.scenario.shade.speckle) = (0.9, 0.05);
    });
    changes.extend(exchange_pattern(rig));
    changes.push(lengthen_film(rig));
    changes.extend(change_method(rig));
    changes.extend(magnify(rig));
    changes
}

/// Sets the exposure of scenario and configuration.
fn set_exposure(rig: &mut Rig, exposure_us: f64) {
    rig.scenario.camera.exposure_us = exposure_us;
    rig.config.camera.exposure_us = Some(exposure_us);
}

/// Returns the rig with each of [`PATTERNS`] instead of its own.
fn exchange_pattern(rig: &Rig) -> Vec<Change> {
    let own = &rig.scenario.body.pattern;
    let describe = |pattern: &PatternSetup| {
        let share = 100.0 * pattern.coverage;
        format!("of {} to {} px^2 covering {share:.0} %", pattern.area_min_px2, pattern.area_max_px2)
    };
    let with = |name: &str| {
        let pattern = PatternSetup::paper(name).filter(|pattern| pattern != own)?;
        let mut changed = rig.clone();
        // A rod has no lines.
        let lines = if rig.scenario.body.rod.is_some() { 0 } else { pattern.lines };
        let description = format!("speckles {} (pattern {name}) instead of {}", describe(&pattern), describe(own));
        changed.scenario.body.pattern = PatternSetup { lines, ..pattern };
        Some(Change { description, rig: changed })
    };
    PATTERNS.iter().filter_map(|name| with(name)).collect()
}

/// Returns the rig with twice the frame rate for the same motion, exposed for at most the time between two frames.
fn double_frame_rate(rig: &Rig) -> Change {
    let mut changed = rig.clone();
    let camera = &mut changed.scenario.camera;
    camera.frame_rate_hz *= 2.0;
    camera.frames *= 2;
    let (rate_hz, exposure_us) = (camera.frame_rate_hz, camera.exposure_us.min(1e6 / camera.frame_rate_hz));
    changed.config.camera.frame_rate_hz = Some(rate_hz);
    set_exposure(&mut changed, exposure_us);
    changed.scenario.rescale_motion(1.0, 0.5);
    let shorter = exposure_us < rig.scenario.camera.exposure_us;
    let exposed =
        if shorter { format!(", exposure {exposure_us:.0} us with correspondingly more light") } else { String::new() };
    Change { description: format!("twice the frame rate ({rate_hz:.0} Hz){exposed}"), rig: changed }
}

/// Returns the rig with a longer flight before and after a collision, or a film of twice the length without one.
fn lengthen_film(rig: &Rig) -> Change {
    let mut changed = rig.clone();
    let camera = &mut changed.scenario.camera;
    let film_s = camera.frames as f64 / camera.frame_rate_hz;
    match &mut changed.scenario.motion {
        MotionSetup::Constant { .. } | MotionSetup::Piecewise { .. } => camera.frames *= 2,
        MotionSetup::Impact(impact) => {
            let flight_s = impact.contact_start_s;
            impact.contact_start_s *= 2.0;
            camera.frames = ((film_s + 2.0 * flight_s) * camera.frame_rate_hz).round() as u64;
        }
    }
    Change {
        description: "a longer film: twice the flight before contact, and as much more after it".into(),
        rig: changed,
    }
}

/// Returns the rig with each other setting of the measurement that is worth a try: the window of velocities, and a
/// match of the whole ball instead of its subsets.
fn change_method(rig: &Rig) -> Vec<Change> {
    let mut changes = Vec::new();
    if let Some(window) = rig.config.velocity.window_frames {
        let mut wider = rig.clone();
        wider.config.velocity.window_frames = Some(2 * window + 1);
        let description = format!("velocity.window_frames = {} instead of {window}", 2 * window + 1);
        changes.push(Change { description, rig: wider });
        let mut free = rig.clone();
        free.config.velocity.window_frames = None;
        let description = "velocity.window_frames omitted: the fit chooses its window".into();
        changes.push(Change { description, rig: free });
    }
    if matches!(rig.config.rotation, Rotation::Field | Rotation::Center) && rig.config.bodies[0].kind == BodyKind::Ball
    {
        let mut rigid = rig.clone();
        rigid.config.rotation = Rotation::Rigid;
        changes.push(Change { description: "rotation.method = \"rigid\": all pixels in one match".into(), rig: rigid });
    }
    changes
}

/// Returns the rig with the scene magnified by [`MAGNIFICATION`], image and speckles included; `None` for a rod.
fn magnify(rig: &Rig) -> Option<Change> {
    let mut changed = rig.clone();
    let Rig { config, scenario } = &mut changed;
    if scenario.body.rod.is_some() {
        return None;
    }
    let scaled = |length: u32| (f64::from(length) * MAGNIFICATION).round() as u32;
    let camera = &mut scenario.camera;
    (camera.width_px, camera.height_px) = (scaled(camera.width_px), scaled(camera.height_px));
    scenario.scale.mm_per_px /= MAGNIFICATION;
    let pattern = &mut scenario.body.pattern;
    (pattern.area_min_px2, pattern.area_max_px2) =
        (pattern.area_min_px2 * MAGNIFICATION * MAGNIFICATION, pattern.area_max_px2 * MAGNIFICATION * MAGNIFICATION);
    if let Some(occluder) = &mut scenario.occluder {
        occluder.point_px = occluder.point_px.map(|point| point.map(|at| at * MAGNIFICATION));
        occluder.speed_px_frame *= MAGNIFICATION;
    }
    scenario.rescale_motion(MAGNIFICATION, 1.0);
    let camera = &scenario.camera;
    (config.camera.width_px, config.camera.height_px) = (Some(camera.width_px), Some(camera.height_px));
    if let Some(Scale::MmPerPx(mm_per_px)) = &mut config.scale {
        *mm_per_px /= MAGNIFICATION;
    }
    for body in &mut config.bodies {
        [&mut body.min_radius_px, &mut body.max_radius_px]
            .into_iter()
            .flatten()
            .for_each(|radius| *radius *= MAGNIFICATION);
        body.roi_px = body.roi_px.map(|roi| roi.map(scaled));
    }
    let diameter_px = 2.0 * scenario.radius_px();
    let description = format!("{MAGNIFICATION} times the magnification (body of {diameter_px:.0} px, larger speckles)");
    Some(Change { description, rig: changed })
}
