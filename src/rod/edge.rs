//! A straight edge to a fraction of a pixel: one blurred step through many profiles of grey levels.

mod paint;

use self::paint::{LEAST_PAINT, Level, Paint, one_paint, quantile};
use crate::image::{ImageView, is_saturated};
use crate::results::{Estimate, PointStatus};
use nalgebra::{SMatrix, SVector};

/// Fewest profiles an edge rests on.
const LEAST_PROFILES: usize = 5;
/// And at least this share of those that were looked at.
const LEAST_SHARE: f64 = 0.12;
/// Share of levels that lie less far out than the paint of a side, speckles lying nearer to the other side's.
const PAINT: f64 = 0.85;
/// Nearer to the edge than this, and than so many times the blur, levels are not the paint's.
const BLURRED_PX: f64 = 2.0;
const BLURRED_SIGMAS: f64 = 3.2;
/// Levels that are taken for paint may differ from it by this share of the contrast at first, then by so many sigmas.
const PAINT_SHARE: f64 = 0.1;
const PAINT_SIGMAS: f64 = 3.0;
/// The level of speckled paint is known to this share of the contrast, or, where a clean tape of about the same level
/// is in the picture, to the second beyond what is known of that; it may be further out by these shares.
const FREE_PAINT: f64 = 0.05;
const ALIKE_PAINT: f64 = 0.006;
const ALIKE: std::ops::RangeInclusive<f64> = -0.03..=0.12;
/// What is known is tied so firmly.
const FIXED: f64 = 1e9;
/// Levels nearer to the edge than this place it, and so many times the blur.
const CORE_PX: f64 = 2.0;
const CORE_SIGMAS: f64 = 2.2;
/// A profile has something else in it if one of those is off by so many sigmas, and by this share of the contrast in
/// each round of choosing.
const OFF_SIGMAS: f64 = 3.5;
const OFF_SHARES: [f64; 4] = [0.4, 0.12, 0.06, 0.05];
/// With this share of profiles that look like an edge no better place is looked for.
const ENOUGH_SHARE: f64 = 0.3;
/// An edge whose contrast is less than so many times the noise is not told from it.
const LEAST_SIGMAS: f64 = 8.0;
/// Profiles reach at least so far to either side, and an edge is no further from where it should be, px.
const LEAST_DEPTH_PX: f64 = 5.0;
const ASTRAY_PX: f64 = 3.0;
/// Standard deviations of the blur that are tried, px; an edge at the upper end is too soft to be placed.
const BLUR_PX: [f64; 2] = [0.25, 1.8];
/// Where the search for the blur begins, px.
const START_BLUR_PX: f64 = 0.8;
/// Steps of one solution at most, and the change under which it is found, px.
const STEPS: usize = 20;
const SETTLED_PX: f64 = 1e-5;
/// Tukey's constant.
const TUKEY: f64 = 4.685;
/// What a real edge differs from the model, common to all its profiles, px.
const MODEL_PX: f64 = 0.002;
/// The same where what is left of speckles shades some of them, px, and the share of what it makes of the paint: it
/// pulls one way only.
const SPECKLED_PX: f64 = 0.005;
const SHADED_SHARE: f64 = 0.5;
/// And where the lighter paint is clipped: up to three times too long an exposure moves edges towards the dark by up to
/// 0.7 px, px.
const CLIPPED_PX: f64 = 0.5;
/// Paint is, with some of its levels, from this share of the brightest level on.
const CLIPPED_SHARE: f64 = 0.99;

/// Which way an edge runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Course {
    /// Along the rows: profiles are pieces of columns.
    Rows,
    /// Along the columns: profiles are pieces of rows.
    Columns,
}

/// Where an edge should be. Positions count along it and across it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    pub(super) course: Course,
    /// Profiles along it, first and one past the last.
    pub(super) along: [usize; 2],
    /// Where along it its place is told.
    pub(super) middle: f64,
    /// Its place across, to about 2 px.
    pub(super) near: f64,
    /// How far it goes across for each pixel along.
    pub(super) slope: f64,
    /// How far profiles reach before and behind it, where there is room.
    pub(super) depth: [usize; 2],
    /// First and last place across that may be looked at.
    pub(super) room: [usize; 2],
    /// 1 where it gets lighter across, -1 where it gets darker.
    pub(super) sign: f64,
    /// What clean edges of the same picture have told.
    pub(super) known: Option<Known>,
}

/// What edges without speckles tell those with them, whose place, blur and paint are hard to tell apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// Standard deviation of the blur, px: the lens blurs all edges alike.
    pub(super) blur_px: f64,
    /// The darker and the lighter paint at the edge, DN: tapes are of one material.
    pub(super) paints_dn: [Estimate; 2],
}

/// An edge that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Edge {
    /// Its place across, at the middle, px.
    pub(super) at: Estimate,
    /// How far it goes across for each pixel along.
    pub(super) slope: Estimate,
    /// Standard deviation of the blur, px.
    pub(super) blur_px: f64,
    /// The darker and the lighter paint, DN.
    pub(super) paints_dn: [Estimate; 2],
    /// Whether there are speckles on one side.
    pub(super) is_speckled: bool,
}

/// Grey levels across the edge.
struct Profile {
    /// Along the edge, from its middle.
    along: f64,
    /// Place of the first level across.
    first: f64,
    levels: Vec<f64>,
    weight: f64,
}

/// Place, slope and blur under iteration, and both paints.
#[derive(Clone, Copy)]
struct Step {
    at: f64,
    slope: f64,
    blur: f64,
    is_blur_known: bool,
    paints: [Paint; 2],
    /// What the levels near the edge have moved the paints by, DN.
    moved: [f64; 2],
}

/// Integral and density of the normal distribution.
///
/// M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, 7.1.26: error below 1e-7.
fn normal(x: f64) -> (f64, f64) {
    const COEFFICIENTS: [f64; 5] = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs() * std::f64::consts::FRAC_1_SQRT_2);
    let bell = (-0.5 * x * x).exp();
    let tail = 0.5 * COEFFICIENTS.iter().fold(0.0, |sum, c| sum * t + c) * t * bell;
    (if x >= 0.0 { 1.0 - tail } else { tail }, bell / std::f64::consts::TAU.sqrt())
}

impl Step {
    /// How far a level of a profile is behind the edge, px.
    fn behind(&self, profile: &Profile, index: usize) -> f64 {
        profile.first + index as f64 - self.at - self.slope * profile.along
    }

    fn contrast(&self) -> f64 {
        self.paints[1].at(0.0) - self.paints[0].at(0.0)
    }

    /// The noise of a level near the edge: that of the side with more of it.
    fn noise(&self) -> f64 {
        self.paints[0].noise.max(self.paints[1].noise)
    }

    /// How firmly the paint of a side ties its level, in terms of the levels near the edge.
    fn tie(&self, side: usize) -> f64 {
        (self.noise() / self.paints[side].sigma).powi(2)
    }

    /// Levels of a profile that place the edge: what is left of each over the model, and its derivatives by place,
    /// slope, blur and the levels of both sides.
    fn core<'p>(&'p self, profile: &'p Profile) -> impl Iterator<Item = (f64, Vector)> + 'p {
        let reach = CORE_PX.max(CORE_SIGMAS * self.blur);
        let [before, after] = self.paints.map(|paint| paint.at(profile.along));
        profile.levels.iter().enumerate().filter_map(move |(index, level)| {
            let behind = self.behind(profile, index);
            let (p, density) = normal(behind / self.blur);
            let by_place = -(after - before) * density / self.blur;
            let by_blur = by_place * behind / self.blur;
            let left = level - before - (after - before) * p;
            let derivatives = Vector::from([by_place, by_place * profile.along, by_blur, 1.0 - p, p]);
            (behind.abs() <= reach).then_some((left, derivatives))
        })
    }

    /// How far the edge of one profile is from the common one, px.
    fn off(&self, profile: &Profile) -> f64 {
        let (mut right, mut normal) = (0.0, 0.0);
        for (left, derivatives) in self.core(profile) {
            right += left * derivatives[0];
            normal += derivatives[0] * derivatives[0];
        }
        right / normal.max(1e-9)
    }
}

type Vector = SVector<f64, 5>;
type Matrix = SMatrix<f64, 5, 5>;

/// Fits the edge that should be there.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] where it leaves the room, [`PointStatus::Lost`] where there is none,
/// [`PointStatus::LowContrast`] where it is too faint or too soft to be placed, and
/// [`PointStatus::LowCorrelation`] where its profiles do not agree.
pub(super) fn fit(image: ImageView<'_>, expected: &Expected) -> Result<Edge, PointStatus> {
    let mut profiles = profiles(image, expected)?;
    let paints = [Paint::default(); 2];
    let known = expected.known;
    let blur = known.map_or(START_BLUR_PX, |known| known.blur_px);
    let mut step = Step {
        at: expected.near,
        slope: expected.slope,
        blur,
        is_blur_known: known.is_some(),
        paints,
        moved: [0.0; 2],
    };
    step.paints = paint(&profiles, &step, expected)?;
    step.at = nearer(&profiles, &step);
    for share in OFF_SHARES {
        step.paints = paint(&profiles, &step, expected)?;
        reweigh(&mut profiles, &step, share);
        let kept = profiles.iter().filter(|profile| profile.weight > 0.0).count();
        if kept < LEAST_PROFILES || (kept as f64) < LEAST_SHARE * profiles.len() as f64 {
            return Err(PointStatus::LowCorrelation);
        }
        step = solve(&profiles, step)?;
        if (step.at - expected.near).abs() > ASTRAY_PX {
            return Err(PointStatus::Lost);
        }
    }
    judged(&profiles, &step)
}

/// The profiles about the expected edge, those that leave the room left out.
fn profiles(image: ImageView<'_>, expected: &Expected) -> Result<Vec<Profile>, PointStatus> {
    let [before, behind] = expected.depth.map(|depth| depth as f64);
    let [first, last] = expected.room.map(|place| place as f64);
    let level = |along: usize, across: usize| match expected.course {
        Course::Rows => image.at(along, across),
        Course::Columns => image.at(across, along),
    };
    let one = |along: usize| {
        let from_middle = along as f64 - expected.middle;
        let center = (expected.near + expected.slope * from_middle).round();
        if !(center - LEAST_DEPTH_PX >= first && center + LEAST_DEPTH_PX <= last) {
            return None;
        }
        let start = (center - before).max(first) as usize;
        let end = (center + behind).min(last) as usize;
        let levels = (start..=end).map(|across| level(along, across).map(f64::from));
        Some(Profile { along: from_middle, first: start as f64, levels: levels.collect::<Option<_>>()?, weight: 1.0 })
    };
    let all = expected.along[1].saturating_sub(expected.along[0]);
    let profiles: Vec<Profile> = (expected.along[0]..expected.along[1]).filter_map(one).collect();
    if 2 * profiles.len() <= all || profiles.len() < LEAST_PROFILES {
        return Err(PointStatus::OutOfFrame);
    }
    Ok(profiles)
}

/// The paint of both sides.
///
/// Speckles are nearer in shade to what lies across the edge than the paint they are on, so the paint of a side is
/// what is furthest out; the side without speckles tells how much it varies.
fn paint(profiles: &[Profile], step: &Step, expected: &Expected) -> Result<[Paint; 2], PointStatus> {
    let sign = expected.sign;
    let clear = BLURRED_PX.max(BLURRED_SIGMAS * step.blur);
    let side = |of: f64| -> Vec<Level> {
        let levels = |profile: &Profile| {
            let along = profile.along;
            let all = profile.levels.iter().enumerate();
            let placed = all.map(|(index, level)| Level { along, behind: step.behind(profile, index), level: *level });
            placed.filter(|level| of * level.behind >= clear).collect::<Vec<_>>()
        };
        profiles.iter().flat_map(levels).collect()
    };
    let sides = [side(-1.0), side(1.0)];
    if sides.iter().any(|levels| levels.len() < LEAST_PAINT) {
        return Err(PointStatus::OutOfFrame);
    }
    let sorted = sides.each_ref().map(|levels| {
        let mut levels: Vec<f64> = levels.iter().map(|level| level.level).collect();
        levels.sort_by(f64::total_cmp);
        levels
    });
    // Before the edge it is dark and behind it light where the sign is 1.
    let start: [f64; 2] = std::array::from_fn(|k| {
        let is_light = (k == 1) == (sign > 0.0);
        quantile(&sorted[k], if is_light { PAINT } else { 1.0 - PAINT })
    });
    let contrast = sign * (start[1] - start[0]);
    if contrast <= 0.0 {
        return Err(PointStatus::Lost);
    }
    let noise = sorted.each_ref().map(|levels| 0.7413 * (quantile(levels, 0.75) - quantile(levels, 0.25)));
    let tolerance = (PAINT_SHARE * contrast).max(PAINT_SIGMAS * noise[0].min(noise[1]));
    let outward = |k: usize| if (k == 1) == (sign > 0.0) { 1.0 } else { -1.0 };
    let mut paints = [Paint::default(); 2];
    for (k, paint) in paints.iter_mut().enumerate() {
        *paint = one_paint(&sides[k], start[k], tolerance, outward(k))?;
        if let Some(known) = expected.known.filter(|_| paint.is_speckled) {
            let other = known.paints_dn[usize::from(outward(k) > 0.0)];
            let further = outward(k) * (other.value - paint.at(0.0)) / contrast;
            // Speckles pull what is seen of the paint towards the other side; else it is another paint.
            if ALIKE.contains(&further) {
                let sigma = other.sigma.hypot(ALIKE_PAINT * contrast);
                *paint = Paint { coefficients: [other.value, 0.0, 0.0, 0.0], sigma, ..*paint };
            } else {
                paint.sigma = paint.sigma.max(FREE_PAINT * contrast);
            }
        }
    }
    Ok(paints)
}

/// Gauss-Newton steps over place, slope, blur and the levels of both sides, which their paint ties.
fn solve(profiles: &[Profile], start: Step) -> Result<Step, PointStatus> {
    let mut step = start;
    step.moved = [0.0; 2];
    for _ in 0..STEPS {
        let (normal, mut right, _) = equations(profiles, &step);
        for (k, moved) in step.moved.iter().enumerate() {
            // What the levels have moved already counts against their paint.
            right[3 + k] -= moved * step.tie(k);
        }
        let change = normal.try_inverse().ok_or(PointStatus::Lost)? * right;
        if !change.iter().all(|x| x.is_finite()) {
            return Err(PointStatus::Lost);
        }
        step.at += change[0].clamp(-1.0, 1.0);
        step.slope += change[1].clamp(-0.05, 0.05);
        step.blur = (step.blur + change[2].clamp(-0.4, 0.4)).clamp(BLUR_PX[0], BLUR_PX[1]);
        for k in 0..2 {
            step.moved[k] += change[3 + k];
            step.paints[k].coefficients[0] += change[3 + k];
        }
        if change[0].abs() < SETTLED_PX && change[1].abs() < 0.1 * SETTLED_PX {
            break;
        }
    }
    Ok(step)
}

/// Normal equations of one pass, and the sum of squared residuals.
fn equations(profiles: &[Profile], step: &Step) -> (Matrix, Vector, f64) {
    let (mut normal, mut right, mut squares) = (Matrix::zeros(), Vector::zeros(), 0.0);
    for profile in profiles.iter().filter(|profile| profile.weight > 0.0) {
        for (left, derivatives) in step.core(profile) {
            normal += derivatives * derivatives.transpose() * profile.weight;
            right += derivatives * (profile.weight * left);
            squares += profile.weight * left * left;
        }
    }
    for k in 0..2 {
        normal[(3 + k, 3 + k)] += step.tie(k);
    }
    if step.is_blur_known {
        normal[(2, 2)] += FIXED * normal[(0, 0)];
    }
    (normal, right, squares)
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
}

/// Weights of the profiles anew: by what does not fit the model, and by their distance from the common line.
fn reweigh(profiles: &mut [Profile], step: &Step, share: f64) {
    let limit = (share * step.contrast().abs()).max(OFF_SIGMAS * step.noise());
    let is_clean: Vec<bool> =
        profiles.iter().map(|profile| step.core(profile).all(|(left, _)| left.abs() <= limit)).collect();
    let off: Vec<f64> = profiles.iter().map(|profile| step.off(profile)).collect();
    let of_clean = off.iter().zip(&is_clean).filter(|(_, clean)| **clean).map(|(off, _)| *off);
    let middle = median(of_clean.clone().collect());
    let scatter = 1.4826 * median(of_clean.map(|off| (off - middle).abs()).collect());
    for ((profile, off), clean) in profiles.iter_mut().zip(off).zip(is_clean) {
        let far = (off - middle) / (TUKEY * scatter.max(1e-4));
        profile.weight = if clean && far.abs() < 1.0 { (1.0 - far * far).powi(2) } else { 0.0 };
    }
}

/// The nearest place about the expected one where enough profiles look like an edge; else that with the most.
fn nearer(profiles: &[Profile], step: &Step) -> f64 {
    const SHIFTS_PX: [f64; 9] = [0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0];
    let limit = OFF_SHARES[0] * step.contrast().abs();
    let likely = |shift: f64| {
        let moved = Step { at: step.at + shift, ..*step };
        profiles.iter().filter(|profile| moved.core(profile).all(|(left, _)| left.abs() <= limit)).count()
    };
    let enough = (ENOUGH_SHARE * profiles.len() as f64).max(LEAST_PROFILES as f64) as usize;
    let tried = SHIFTS_PX.map(|shift| (likely(shift), shift));
    let most = tried.iter().fold((0, 0.0), |best, next| if next.0 > best.0 { *next } else { best });
    step.at + tried.iter().find(|(count, _)| *count >= enough).unwrap_or(&most).1
}

/// Refuses an edge that is too faint or too soft; else its place with what its profiles scatter.
fn judged(profiles: &[Profile], step: &Step) -> Result<Edge, PointStatus> {
    let used: Vec<&Profile> = profiles.iter().filter(|profile| profile.weight > 0.0).collect();
    let (normal, _, squares) = equations(profiles, step);
    let count: f64 = used.iter().map(|profile| profile.weight * step.core(profile).count() as f64).sum();
    let variance = (squares / (count - 5.0).max(1.0)).max(1e-9);
    if step.contrast().abs() < LEAST_SIGMAS * variance.sqrt() || step.blur >= 0.98 * BLUR_PX[1] {
        return Err(PointStatus::LowContrast);
    }
    let inverse = normal.try_inverse().ok_or(PointStatus::Lost)?;
    // Texture along the edge is no noise of single pixels: the profiles' own scatter counts where it is larger.
    let chi2: f64 = used
        .iter()
        .map(|profile| {
            let information: f64 = step.core(profile).map(|(_, derivatives)| derivatives[0].powi(2)).sum();
            profile.weight * step.off(profile).powi(2) * information
        })
        .sum();
    let excess = (chi2 / variance / (used.len() as f64 - 2.0).max(1.0)).max(1.0);
    let levels = step.paints.map(|paint| paint.at(0.0));
    let sigma = |k: usize| (variance * excess * inverse[(k, k)]).max(0.0).sqrt();
    let paint = |k: usize| Estimate { value: levels[k], sigma: sigma(3 + k) };
    let is_speckled = step.paints.iter().any(|paint| paint.is_speckled);
    let model_px = match is_clipped(profiles, levels[0].max(levels[1]) + step.noise()) {
        true => CLIPPED_PX,
        false if is_speckled => SPECKLED_PX.hypot(SHADED_SHARE * shaded(step, &inverse)),
        false => MODEL_PX,
    };
    Ok(Edge {
        at: Estimate { value: step.at, sigma: sigma(0).hypot(model_px) },
        slope: Estimate { value: step.slope, sigma: sigma(1) },
        blur_px: step.blur,
        paints_dn: if step.contrast() > 0.0 { [paint(0), paint(1)] } else { [paint(1), paint(0)] },
        is_speckled,
    })
}

/// How far off an edge is whose own levels tell its paint, if the paint is what it was taken for, px.
fn shaded(step: &Step, inverse: &Matrix) -> f64 {
    (0..2).map(|k| step.moved[k] * inverse[(0, 3 + k)] / inverse[(3 + k, 3 + k)]).sum()
}

/// Whether paint of this level, its noise on top, is as bright as a pixel can be.
fn is_clipped(profiles: &[Profile], paint_dn: f64) -> bool {
    let highest = profiles.iter().flat_map(|profile| &profile.levels).copied().fold(0.0, f64::max);
    is_saturated(highest as f32) && paint_dn > CLIPPED_SHARE * highest
}

#[cfg(test)]
mod tests;
