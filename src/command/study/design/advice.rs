//! What to change first.

use super::rig::Rig;
use super::spread::{Expected, Foreseen};
use crate::config::BodyKind;
use crate::motion::{Rotation, Scale};
use crate::process::Stop;
use crate::synth::{MotionSetup, PatternSetup};

/// Patterns that are tried in place of the rig's own.
const PATTERNS: [&str; 5] = ["a-III", "b-III", "e-I", "e-II", "f-II"];

/// How much larger the body is tried in the picture.
const LARGER: f64 = 1.5;

/// Scatter is not halved by less than this.
const WORTH: f64 = 0.97;

/// A change that was tried.
#[derive(Debug, Clone)]
pub(super) struct Advice {
    /// What to do.
    pub(super) words: String,
    /// Scatter of each number of [`judged`] after it, as a share of what it is now.
    pub(super) shares: Vec<(String, f64)>,
    /// Geometric mean of the shares.
    pub(super) mean: f64,
}

impl Advice {
    /// Whether it is worth its while.
    pub(super) fn helps(&self) -> bool {
        self.mean < WORTH
    }
}

/// Numbers that a change is judged by.
pub(super) fn judged(rows: &[Expected]) -> Vec<String> {
    let wanted = [
        "motion.vn_m_s",
        "motion.omega_rad_s",
        "flight.vn_m_s",
        "flight.omega_rad_s",
        "restitution",
        "start_s",
        "end_s",
    ];
    let is_told = |name: &&&str| rows.iter().any(|row| row.name == ***name && row.sigma > 0.0);
    wanted.iter().filter(is_told).map(|name| (*name).to_owned()).collect()
}

/// Tries every change there is, best first; those that cannot be made are left out. `None` after a stop.
pub(super) fn advice(
    rig: &Rig,
    films: u64,
    stop: &Stop,
    mut tick: impl FnMut(),
) -> anyhow::Result<Option<Vec<Advice>>> {
    let Some(now) = Foreseen::of(rig, films, stop)? else { return Ok(None) };
    let names = judged(&now.rows);
    let mut found = Vec::new();
    for (words, changed) in changes(rig) {
        // A change that leads to a rig that cannot film is no advice.
        match Foreseen::of(&changed, films, stop) {
            Ok(None) => return Ok(None),
            Ok(Some(then)) => found.extend(compare(words, &names, &now, &then)),
            Err(_) => {}
        }
        tick();
    }
    found.sort_by(|a: &Advice, b: &Advice| a.mean.total_cmp(&b.mean));
    Ok(Some(found))
}

fn compare(words: String, names: &[String], now: &Foreseen, then: &Foreseen) -> Option<Advice> {
    let share = |name: &String| Some((name.clone(), then.sigma(name)? / now.sigma(name)?));
    let shares = names.iter().map(share).collect::<Option<Vec<_>>>()?;
    let logs: f64 = shares.iter().map(|(_, share)| share.max(1e-6).ln()).sum();
    let mean = (logs / shares.len().max(1) as f64).exp();
    Some(Advice { words, shares, mean })
}

/// Number of changes that are tried.
pub(super) fn count(rig: &Rig) -> u64 {
    changes(rig).len() as u64
}

/// The changes, each with what the rig would be.
fn changes(rig: &Rig) -> Vec<(String, Rig)> {
    let camera = &rig.scenario.camera;
    let mut changes = vec![faster(rig)];
    let mut change = |words: String, edit: &dyn Fn(&mut Rig)| {
        let mut changed = rig.clone();
        edit(&mut changed);
        changes.push((words, changed));
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
        let words = format!(
            "half the exposure ({} us, {:.2} px of motion in place of {blur_px:.2}) with twice the light",
            0.5 * camera.exposure_us,
            0.5 * blur_px
        );
        change(words, &|rig| set_exposure(rig, 0.5 * rig.scenario.camera.exposure_us));
    }
    if camera.blur_px > 0.5 {
        let sharp_px = (camera.blur_px / 1.4).max(0.5);
        change(format!("a sharper picture (blur {sharp_px:.2} px in place of {:.2})", camera.blur_px), &|rig| {
            rig.scenario.camera.blur_px = sharp_px;
        });
    }
    change("more contrast: body at 0.9 of full scale, speckles at 0.05".into(), &|rig| {
        (rig.scenario.shade.ball, rig.scenario.shade.speckle) = (0.9, 0.05);
    });
    changes.extend(patterns(rig));
    changes.extend(longer(rig));
    changes.extend(by_method(rig));
    changes.extend(larger(rig));
    changes
}

fn set_exposure(rig: &mut Rig, exposure_us: f64) {
    rig.scenario.camera.exposure_us = exposure_us;
    rig.config.camera.exposure_us = Some(exposure_us);
}

/// Other speckles.
fn patterns(rig: &Rig) -> Vec<(String, Rig)> {
    let own = &rig.scenario.body.pattern;
    let words = |pattern: &PatternSetup| {
        let share = 100.0 * pattern.coverage;
        format!("of {} to {} px^2 on {share:.0} %", pattern.area_min_px2, pattern.area_max_px2)
    };
    let with = |name: &str| {
        let pattern = PatternSetup::paper(name).filter(|pattern| pattern != own)?;
        let mut changed = rig.clone();
        // A rod has no lines.
        let lines = if rig.scenario.body.rod.is_some() { 0 } else { pattern.lines };
        let told = format!("speckles {} (pattern {name}) in place of those {}", words(&pattern), words(own));
        changed.scenario.body.pattern = PatternSetup { lines, ..pattern };
        Some((told, changed))
    };
    PATTERNS.iter().filter_map(|name| with(name)).collect()
}

/// Twice the frames of the same motion.
fn faster(rig: &Rig) -> (String, Rig) {
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
        if shorter { format!(", exposed for {exposure_us:.0} us with as much more light") } else { String::new() };
    (format!("twice the frame rate ({rate_hz:.0} Hz){exposed}"), changed)
}

/// More of the flight, before a collision and after.
fn longer(rig: &Rig) -> Option<(String, Rig)> {
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
    Some(("film longer: twice the flight before, as much more after".into(), changed))
}

/// Settings of the measurement that could be better.
fn by_method(rig: &Rig) -> Vec<(String, Rig)> {
    let mut changes = Vec::new();
    if let Some(window) = rig.config.velocity.window_frames {
        let mut wider = rig.clone();
        wider.config.velocity.window_frames = Some(2 * window + 1);
        changes.push((format!("velocity.window_frames = {} in place of {window}", 2 * window + 1), wider));
        let mut free = rig.clone();
        free.config.velocity.window_frames = None;
        changes.push(("velocity.window_frames left out: the fit chooses its window".into(), free));
    }
    if matches!(rig.config.rotation, Rotation::Field | Rotation::Center) && rig.config.bodies[0].kind == BodyKind::Ball
    {
        let mut rigid = rig.clone();
        rigid.config.rotation = Rotation::Rigid;
        changes.push(("rotation.method = \"rigid\": every pixel in one match".into(), rigid));
    }
    changes
}

/// The same scene on more pixels.
fn larger(rig: &Rig) -> Option<(String, Rig)> {
    let mut changed = rig.clone();
    let Rig { config, scenario } = &mut changed;
    if scenario.body.rod.is_some() {
        return None;
    }
    let scaled = |length: u32| (f64::from(length) * LARGER).round() as u32;
    let camera = &mut scenario.camera;
    (camera.width_px, camera.height_px) = (scaled(camera.width_px), scaled(camera.height_px));
    scenario.scale.mm_per_px /= LARGER;
    let pattern = &mut scenario.body.pattern;
    (pattern.area_min_px2, pattern.area_max_px2) =
        (pattern.area_min_px2 * LARGER * LARGER, pattern.area_max_px2 * LARGER * LARGER);
    if let Some(occluder) = &mut scenario.occluder {
        occluder.point_px = occluder.point_px.map(|point| point.map(|at| at * LARGER));
        occluder.speed_px_frame *= LARGER;
    }
    scenario.rescale_motion(LARGER, 1.0);
    let camera = &scenario.camera;
    (config.camera.width_px, config.camera.height_px) = (Some(camera.width_px), Some(camera.height_px));
    if let Some(Scale::MmPerPx(mm_per_px)) = &mut config.scale {
        *mm_per_px /= LARGER;
    }
    for body in &mut config.bodies {
        [&mut body.min_radius_px, &mut body.max_radius_px].into_iter().flatten().for_each(|radius| *radius *= LARGER);
        body.roi_px = body.roi_px.map(|roi| roi.map(scaled));
    }
    let diameter_px = 2.0 * scenario.radius_px();
    Some((
        format!("the body {LARGER} times as large in the picture ({diameter_px:.0} px), its speckles with it"),
        changed,
    ))
}
