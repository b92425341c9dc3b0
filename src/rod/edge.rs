//! A straight edge to a fraction of a pixel: one blurred step through many profiles of grey levels.

use crate::image::ImageView;
use crate::results::{Estimate, PointStatus};

/// Fewest profiles an edge rests on.
const LEAST_PROFILES: usize = 5;
/// And at least this share of those that were looked at.
const LEAST_SHARE: f64 = 0.12;
/// A profile with less than this share of the good ones' contrast has something else in it, a speckle mostly.
const LEAST_CONTRAST: f64 = 0.8;
/// What the good ones are: this share of profiles has less contrast, of levels lie less far out.
const GOOD: f64 = 0.85;
/// Nearer to the edge than this, levels are not the paint's, px.
const BLURRED_PX: f64 = 2.0;
/// Levels beyond that may differ from the paint's by this share of the contrast, or by so many times the noise.
const PAINT_SHARE: f64 = 0.1;
const PAINT_SIGMAS: f64 = 3.5;
/// An edge whose contrast is less than so many times what is left over the step is not told from noise.
const LEAST_SIGMAS: f64 = 8.0;
/// A profile with so many times the median misfit has something else in it.
const MOST_MISFIT: f64 = 2.0;
/// Standard deviations of the blur that are tried, px; an edge at the upper end is too soft to be placed.
const BLUR_PX: [f64; 2] = [0.25, 2.5];
/// Where the search for the blur begins, px.
const START_BLUR_PX: f64 = 0.8;
/// Steps of one solution at most, and the change under which it is found, px.
const STEPS: usize = 20;
const SETTLED_PX: f64 = 1e-5;
/// Rounds of choosing profiles anew.
const ROUNDS: usize = 4;
/// Tukey's constant.
const TUKEY: f64 = 4.685;
/// What a real edge differs from the model, common to all its profiles, px.
const MODEL_PX: f64 = 0.002;

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
    /// How far profiles reach to either side.
    pub(super) reach: usize,
    /// First and last place across that may be looked at.
    pub(super) room: [usize; 2],
    /// 1 where it gets lighter across, -1 where it gets darker.
    pub(super) sign: f64,
}

/// An edge that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Edge {
    /// Its place across, at the middle, px.
    pub(super) at: Estimate,
    /// How far it goes across for each pixel along.
    pub(super) slope: Estimate,
}

/// Grey levels across the edge.
struct Profile {
    /// Along the edge, from its middle.
    along: f64,
    /// Place of the first level across.
    first: f64,
    levels: Vec<f64>,
    /// Nothing but paint on either side.
    is_clean: bool,
    weight: f64,
}

/// Place, slope and blur under iteration.
#[derive(Clone, Copy)]
struct Step {
    at: f64,
    slope: f64,
    blur: f64,
}

/// What a step leaves over in one profile.
struct Leftover {
    contrast: f64,
    /// Sum of the squared residuals.
    squares: f64,
    /// Residuals times and derivatives times derivatives, by place and blur, levels eliminated.
    by_place: f64,
    by_blur: f64,
    place_place: f64,
    place_blur: f64,
    blur_blur: f64,
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

impl Profile {
    /// The levels B + A P((y - place)/blur) that fit best, and what they leave over.
    fn leftover(&self, step: &Step) -> Leftover {
        let place = step.at + step.slope * self.along;
        let count = self.levels.len() as f64;
        let z = |index: usize| (self.first + index as f64 - place) / step.blur;
        let (mut p1, mut pp, mut v1, mut pv) = (0.0, 0.0, 0.0, 0.0);
        for (index, level) in self.levels.iter().enumerate() {
            let (p, _) = normal(z(index));
            (p1, pp, v1, pv) = (p1 + p, pp + p * p, v1 + level, pv + p * level);
        }
        let spread = (pp - p1 * p1 / count).max(1e-9);
        let contrast = (pv - p1 * v1 / count) / spread;
        let (p_mean, v_mean) = (p1 / count, v1 / count);
        // The derivatives lose what a change of the levels could do as well.
        let (mut sums, mut own) = ([0.0; 2], [0.0; 2]);
        for index in 0..self.levels.len() {
            let (p, density) = normal(z(index));
            let by_place = -contrast * density / step.blur;
            for (k, derivative) in [by_place, by_place * z(index)].into_iter().enumerate() {
                sums[k] += derivative;
                own[k] += derivative * (p - p_mean);
            }
        }
        let mut left = Leftover {
            contrast,
            squares: 0.0,
            by_place: 0.0,
            by_blur: 0.0,
            place_place: 0.0,
            place_blur: 0.0,
            blur_blur: 0.0,
        };
        for (index, level) in self.levels.iter().enumerate() {
            let (p, density) = normal(z(index));
            let residual = level - v_mean - contrast * (p - p_mean);
            let by_place = -contrast * density / step.blur;
            let free = |k: usize, derivative: f64| derivative - sums[k] / count - own[k] / spread * (p - p_mean);
            let (dp, db) = (free(0, by_place), free(1, by_place * z(index)));
            left.squares += residual * residual;
            left.by_place += residual * dp;
            left.by_blur += residual * db;
            left.place_place += dp * dp;
            left.place_blur += dp * db;
            left.blur_blur += db * db;
        }
        left
    }
}

/// Fits the edge that should be there.
///
/// # Errors
///
/// [`PointStatus::OutOfFrame`] where it leaves the room, [`PointStatus::Lost`] where there is none,
/// [`PointStatus::LowContrast`] where it is too faint or too soft to be placed, and
/// [`PointStatus::LowCorrelation`] where its profiles do not agree.
pub(super) fn fit(image: ImageView<'_>, expected: &Expected) -> Result<Edge, PointStatus> {
    let mut profiles = profiles(image, expected)?;
    let looked_at = profiles.len();
    choose_by_paint(&mut profiles, expected)?;
    let mut step = Step { at: expected.near, slope: expected.slope, blur: START_BLUR_PX };
    for _ in 0..ROUNDS {
        step = solve(&profiles, step)?;
        reweigh(&mut profiles, &step, expected.sign);
    }
    step = solve(&profiles, step)?;
    let kept = profiles.iter().filter(|profile| profile.weight > 0.0).count();
    if kept < LEAST_PROFILES || (kept as f64) < LEAST_SHARE * looked_at as f64 {
        return Err(PointStatus::LowCorrelation);
    }
    if (step.at - expected.near).abs() > expected.reach as f64 {
        return Err(PointStatus::Lost);
    }
    judged(&profiles, &step)
}

/// The profiles about the expected edge, those that leave the room left out.
fn profiles(image: ImageView<'_>, expected: &Expected) -> Result<Vec<Profile>, PointStatus> {
    let reach = expected.reach as f64;
    let [first, last] = expected.room.map(|place| place as f64);
    let level = |along: usize, across: usize| match expected.course {
        Course::Rows => image.at(along, across),
        Course::Columns => image.at(across, along),
    };
    let one = |along: usize| {
        let from_middle = along as f64 - expected.middle;
        let center = (expected.near + expected.slope * from_middle).round();
        if !(center - reach >= first && center + reach <= last) {
            return None;
        }
        let start = (center - reach) as usize;
        let levels = (start..=start + 2 * expected.reach).map(|across| level(along, across).map(f64::from));
        Some(Profile { along: from_middle, first: start as f64, levels: levels.collect::<Option<_>>()?, is_clean: true, weight: 1.0 })
    };
    let all = expected.along[1].saturating_sub(expected.along[0]);
    let profiles: Vec<Profile> = (expected.along[0]..expected.along[1]).filter_map(one).collect();
    if 2 * profiles.len() <= all || profiles.len() < LEAST_PROFILES {
        return Err(PointStatus::OutOfFrame);
    }
    Ok(profiles)
}

/// The level that this share of all of them is under.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// Keeps the profiles with nothing but paint on both sides of the edge.
///
/// Speckles are nearer in shade to what lies across the edge than the paint they are on, so the paint of a side is
/// what is furthest out; the side without speckles tells the noise.
fn choose_by_paint(profiles: &mut [Profile], expected: &Expected) -> Result<(), PointStatus> {
    let distance = |profile: &Profile, index: usize| {
        profile.first + index as f64 - expected.near - expected.slope * profile.along
    };
    let side = |of: f64| {
        let mut levels: Vec<f64> = profiles
            .iter()
            .flat_map(|profile| profile.levels.iter().enumerate().map(move |(index, level)| (profile, index, *level)))
            .filter(|(profile, index, _)| of * distance(profile, *index) >= BLURRED_PX)
            .map(|(_, _, level)| level)
            .collect();
        levels.sort_by(f64::total_cmp);
        if levels.is_empty() { Err(PointStatus::OutOfFrame) } else { Ok(levels) }
    };
    let sides = [side(-1.0)?, side(1.0)?];
    // Before it is dark and behind it light where the sign is 1.
    let paint: [f64; 2] = std::array::from_fn(|k| {
        let is_light = (k == 1) == (expected.sign > 0.0);
        quantile(&sides[k], if is_light { GOOD } else { 1.0 - GOOD })
    });
    let contrast = expected.sign * (paint[1] - paint[0]);
    if contrast <= 0.0 {
        return Err(PointStatus::Lost);
    }
    let noise = sides.map(|levels| 0.7413 * (quantile(&levels, 0.75) - quantile(&levels, 0.25)));
    let tolerance = (PAINT_SHARE * contrast).max(PAINT_SIGMAS * noise[0].min(noise[1]));
    for profile in profiles.iter_mut() {
        let is_paint = |(index, level): (usize, &f64)| {
            let distance = distance(profile, index);
            distance.abs() < BLURRED_PX || (level - paint[usize::from(distance > 0.0)]).abs() <= tolerance
        };
        profile.is_clean = profile.levels.iter().enumerate().all(is_paint);
        profile.weight = f64::from(u8::from(profile.is_clean));
    }
    Ok(())
}

/// Gauss-Newton steps over place, slope and blur.
fn solve(profiles: &[Profile], start: Step) -> Result<Step, PointStatus> {
    let mut step = start;
    for _ in 0..STEPS {
        let (normal, right, _) = equations(profiles, &step);
        let inverse = invert(&normal).ok_or(PointStatus::Lost)?;
        let change: [f64; 3] = std::array::from_fn(|i| (0..3).map(|j| inverse[i][j] * right[j]).sum());
        if !change.iter().all(|x| x.is_finite()) {
            return Err(PointStatus::Lost);
        }
        step.at += change[0].clamp(-1.0, 1.0);
        step.slope += change[1].clamp(-0.05, 0.05);
        step.blur = (step.blur + change[2].clamp(-0.4, 0.4)).clamp(BLUR_PX[0], BLUR_PX[1]);
        if change[0].abs() < SETTLED_PX && change[1].abs() < 0.1 * SETTLED_PX {
            break;
        }
    }
    Ok(step)
}

type Matrix = [[f64; 3]; 3];

/// Normal equations by place, slope and blur, and the sum of squared residuals.
fn equations(profiles: &[Profile], step: &Step) -> (Matrix, [f64; 3], f64) {
    let (mut normal, mut right, mut squares) = ([[0.0; 3]; 3], [0.0; 3], 0.0);
    for profile in profiles.iter().filter(|profile| profile.weight > 0.0) {
        let left = profile.leftover(step);
        let (w, a) = (profile.weight, profile.along);
        let row = [
            [left.place_place, a * left.place_place, left.place_blur],
            [a * left.place_place, a * a * left.place_place, a * left.place_blur],
            [left.place_blur, a * left.place_blur, left.blur_blur],
        ];
        for (to, from) in normal.iter_mut().flatten().zip(row.iter().flatten()) {
            *to += w * from;
        }
        for (to, from) in right.iter_mut().zip([left.by_place, a * left.by_place, left.by_blur]) {
            *to += w * from;
        }
        squares += w * left.squares;
    }
    (normal, right, squares)
}

fn invert(m: &Matrix) -> Option<Matrix> {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum();
    let scale = (m[0][0] * m[1][1] * m[2][2]).abs();
    // Also false for NaN.
    let is_regular = determinant.abs() > 1e-9 * scale;
    is_regular.then(|| std::array::from_fn(|i| std::array::from_fn(|j| cofactor(j, i) / determinant)))
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
}

/// Weights of the profiles anew, by contrast, misfit and distance from the common line.
fn reweigh(profiles: &mut [Profile], step: &Step, sign: f64) {
    let left: Vec<Leftover> = profiles.iter().map(|profile| profile.leftover(step)).collect();
    let clean = left.iter().zip(profiles.iter()).filter(|(_, profile)| profile.is_clean);
    let mut contrasts: Vec<f64> = clean.map(|(left, _)| sign * left.contrast).collect();
    if contrasts.is_empty() {
        return;
    }
    let of_used = |value: &dyn Fn(&Leftover) -> f64, profiles: &[Profile]| {
        median(left.iter().zip(profiles).filter(|(_, p)| p.weight > 0.0).map(|(l, _)| value(l)).collect())
    };
    let misfit = of_used(&|left| left.squares, profiles);
    let off = |left: &Leftover| left.by_place / left.place_place.max(1e-9);
    let scatter = 1.4826 * of_used(&|left| off(left).abs(), profiles);
    contrasts.sort_by(f64::total_cmp);
    let good = quantile(&contrasts, GOOD);
    for (profile, left) in profiles.iter_mut().zip(&left) {
        let is_whole = profile.is_clean
            && sign * left.contrast >= LEAST_CONTRAST * good
            && left.squares <= MOST_MISFIT.powi(2) * misfit;
        let far = off(left) / (TUKEY * scatter.max(1e-4));
        profile.weight = if is_whole && far.abs() < 1.0 { (1.0 - far * far).powi(2) } else { 0.0 };
    }
}

/// Refuses an edge that is too faint or too soft; else its place with what its profiles scatter.
fn judged(profiles: &[Profile], step: &Step) -> Result<Edge, PointStatus> {
    let used: Vec<&Profile> = profiles.iter().filter(|profile| profile.weight > 0.0).collect();
    let (normal, _, squares) = equations(profiles, step);
    let inverse = invert(&normal).ok_or(PointStatus::Lost)?;
    let levels: f64 = used.iter().map(|profile| profile.weight * (profile.levels.len() as f64 - 2.0)).sum();
    let variance = squares / (levels - 3.0).max(1.0);
    let left: Vec<Leftover> = used.iter().map(|profile| profile.leftover(step)).collect();
    let contrast = median(left.iter().map(|left| left.contrast.abs()).collect());
    let is_soft = step.blur >= 0.98 * BLUR_PX[1];
    if contrast < LEAST_SIGMAS * variance.sqrt() || is_soft {
        return Err(PointStatus::LowContrast);
    }
    // Texture along the edge is no noise of single pixels: the profiles' own scatter counts where it is larger.
    let chi2: f64 = left.iter().zip(&used).map(|(l, p)| p.weight * l.by_place.powi(2) / l.place_place).sum();
    let excess = (chi2 / variance.max(1e-12) / (used.len() as f64 - 2.0).max(1.0)).max(1.0);
    let sigma = |k: usize| (variance * excess * inverse[k][k]).max(0.0).sqrt();
    Ok(Edge {
        at: Estimate { value: step.at, sigma: sigma(0).hypot(MODEL_PX) },
        slope: Estimate { value: step.slope, sigma: sigma(1) },
    })
}

#[cfg(test)]
mod tests;
