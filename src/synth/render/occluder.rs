//! Occluders of a ball, and the visible parts of its speckles.

use super::half_plane::HalfPlane;
use crate::numeric::{QuadratureNode, gauss_legendre, normal_cdf};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::LazyLock;

/// The outline of a ball in front of another ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DiscOutline {
    /// The centre, px.
    pub(crate) center_px: [f64; 2],
    /// The radius, px.
    pub(crate) radius_px: f64,
}

/// An object in front of a ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Occluder {
    /// A half-plane.
    Edge(HalfPlane),
    /// Another ball.
    Ball(DiscOutline),
}

impl Occluder {
    /// Returns the distance of a point outside the occluder, negative inside, px, and the outward normal there.
    pub(crate) fn distance_and_normal(&self, x_px: f64, y_px: f64) -> (f64, [f64; 2]) {
        match self {
            Self::Edge(edge) => (edge.distance_px(x_px, y_px), edge.normal),
            Self::Ball(DiscOutline { center_px, radius_px }) => {
                let (dx, dy) = (x_px - center_px[0], y_px - center_px[1]);
                let distance = dx.hypot(dy).max(1e-9);
                (distance - radius_px, [dx / distance, dy / distance])
            }
        }
    }

    /// Returns the shift of the blurred outline because of its curvature, px: sigma^2 / 2 R.
    pub(crate) fn curvature_shift_px(&self, sigma_px: f64) -> f64 {
        match self {
            Self::Edge(_) => 0.0,
            Self::Ball(DiscOutline { radius_px, .. }) => 0.5 * sigma_px * sigma_px / radius_px,
        }
    }

    /// Returns the occluder with positions relative to `corner_px`.
    pub(crate) fn relative_to(&self, corner_px: [f64; 2]) -> Self {
        let moved = |[x, y]: [f64; 2]| [x - corner_px[0], y - corner_px[1]];
        match self {
            Self::Edge(edge) => Self::Edge(HalfPlane { point_px: moved(edge.point_px), ..*edge }),
            Self::Ball(disc) => Self::Ball(DiscOutline { center_px: moved(disc.center_px), ..*disc }),
        }
    }

    /// Returns the occluded interval of a straight line, px along the unit vector `along` from `from_px`; `None` if
    /// it is visible.
    fn occluded_interval_px(&self, from_px: [f64; 2], along: [f64; 2]) -> Option<[f64; 2]> {
        match self {
            Self::Edge(edge) => {
                let outside = edge.distance_px(from_px[0], from_px[1]);
                let slope = along[0] * edge.normal[0] + along[1] * edge.normal[1];
                let cut = -outside / slope;
                match () {
                    () if slope > 1e-12 => Some([f64::NEG_INFINITY, cut]),
                    () if slope < -1e-12 => Some([cut, f64::INFINITY]),
                    () => (outside < 0.0).then_some([f64::NEG_INFINITY, f64::INFINITY]),
                }
            }
            Self::Ball(DiscOutline { center_px, radius_px }) => {
                let (dx, dy) = (center_px[0] - from_px[0], center_px[1] - from_px[1]);
                let middle = dx * along[0] + dy * along[1];
                let across = dx * along[1] - dy * along[0];
                let half = radius_px * radius_px - across * across;
                (half > 0.0).then(|| [middle - half.sqrt(), middle + half.sqrt()])
            }
        }
    }
}

/// The axes of a speckle in the image: its origin, and the unit vectors along and across its chords.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Axes {
    /// The origin, px.
    pub(crate) origin_px: [f64; 2],
    /// The direction of the chords.
    pub(crate) along: [f64; 2],
    /// The direction from chord to chord.
    pub(crate) across: [f64; 2],
}

impl Axes {
    /// Creates axes with chords along `along`; the other axis is perpendicular.
    pub(crate) fn new(origin_px: [f64; 2], along: [f64; 2]) -> Self {
        Self { origin_px, along, across: [-along[1], along[0]] }
    }

    /// Returns the origin of the chord at this position across the chords, px.
    fn chord_origin_px(&self, across_px: f64) -> [f64; 2] {
        [self.origin_px[0] + across_px * self.across[0], self.origin_px[1] + across_px * self.across[1]]
    }

    /// Returns the positions across the chords at which an occluder begins or ends to occlude them, px.
    ///
    /// The chords reach `half_px` along.
    fn chord_breaks_px(&self, half_px: f64, occluder: &Occluder) -> Vec<f64> {
        let crossings = [-half_px, 0.0, half_px].into_iter().flat_map(|along_px| {
            let from = [self.origin_px[0] + along_px * self.along[0], self.origin_px[1] + along_px * self.along[1]];
            occluder.occluded_interval_px(from, self.across).unwrap_or([f64::INFINITY; 2])
        });
        let touching = match occluder {
            Occluder::Edge(_) => None,
            Occluder::Ball(DiscOutline { center_px, radius_px }) => {
                let (dx, dy) = (center_px[0] - self.origin_px[0], center_px[1] - self.origin_px[1]);
                let middle = dx * self.across[0] + dy * self.across[1];
                Some([middle - radius_px, middle + radius_px])
            }
        };
        crossings.chain(touching.into_iter().flatten()).collect()
    }
}

/// One chord of a speckle with the width that it represents.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Chord {
    /// The position across the chords, px.
    pub(crate) across_px: f64,
    /// The represented width, px.
    pub(crate) width_px: f64,
    /// The ends, px.
    pub(crate) ends_px: [f64; 2],
}

static RULE: LazyLock<[QuadratureNode; 16]> = LazyLock::new(gauss_legendre);

/// Divides a shape that reaches `half_px` to either side into chords; `ends` gives the ends of each.
///
/// `splits` are the positions across at which the ends have a kink or a jump. The nodes are denser near the ends of an
/// ellipse. A finer blur `sigma_px` gives more chords.
pub(crate) fn divide_into_chords(
    half_px: f64,
    sigma_px: f64,
    splits: &[f64],
    ends: impl Fn(f64) -> Option<[f64; 2]>,
) -> Vec<Chord> {
    let mut bounds: Vec<f64> =
        splits.iter().filter(|split| split.abs() < half_px).map(|split| (split / half_px).asin()).collect();
    bounds.extend([-FRAC_PI_2, FRAC_PI_2]);
    bounds.sort_by(f64::total_cmp);
    let mut chords = Vec::new();
    for pair in bounds.windows(2).filter(|pair| pair[1] - pair[0] > 1e-9) {
        let panels = ((pair[1] - pair[0]) * half_px / (6.0 * sigma_px)).ceil().max(1.0);
        let half = 0.5 * (pair[1] - pair[0]) / panels;
        for panel in 0..panels as usize {
            let middle = pair[0] + half * (2 * panel + 1) as f64;
            for QuadratureNode { at: node, weight } in RULE.iter() {
                let (sin, cos) = (middle + half * node).sin_cos();
                let across_px = half_px * sin;
                if let Some(ends_px) = ends(across_px).filter(|ends| ends[1] > ends[0]) {
                    chords.push(Chord { across_px, width_px: half_px * cos * half * weight, ends_px });
                }
            }
        }
    }
    chords
}

/// Divides the visible part of a shape that fits a square of side 2 `half_px` into chords; `ends` gives the ends of
/// each.
pub(crate) fn visible_chords(
    half_px: f64,
    sigma_px: f64,
    axes: &Axes,
    occluders: &[Occluder],
    ends: impl Fn(f64) -> Option<[f64; 2]>,
) -> Vec<Chord> {
    let splits: Vec<f64> = occluders.iter().flat_map(|occluder| axes.chord_breaks_px(half_px, occluder)).collect();
    let mut visible = divide_into_chords(half_px, sigma_px, &splits, ends);
    for occluder in occluders {
        visible = visible
            .into_iter()
            .flat_map(|chord| {
                let [low, high] = chord.ends_px;
                let occluded = occluder.occluded_interval_px(axes.chord_origin_px(chord.across_px), axes.along);
                let [start, end] = occluded.unwrap_or([f64::INFINITY; 2]);
                [[low, high.min(start)], [low.max(end), high]].map(|ends_px| Chord { ends_px, ..chord })
            })
            .filter(|chord| chord.ends_px[1] > chord.ends_px[0])
            .collect();
    }
    visible
}

/// Returns the blurred coverage by the shape of these chords at a position along and across them, 0 to 1.
pub(crate) fn chord_coverage(chords: &[Chord], along_px: f64, across_px: f64, sigma_px: f64) -> f64 {
    let scale = 1.0 / sigma_px;
    let sum: f64 = chords
        .iter()
        .map(|chord| {
            let distance = (across_px - chord.across_px) * scale;
            if distance.abs() > 6.0 {
                return 0.0;
            }
            let [low, high] = chord.ends_px.map(|end| normal_cdf((end - along_px) * scale));
            chord.width_px * (-0.5 * distance * distance).exp() * (high - low)
        })
        .sum();
    sum * scale / TAU.sqrt()
}

/// Returns the ends of the chord of a disc at `across_px` from its centre, from the middle of the chord, px.
pub(crate) fn disc_chord(radius_px: f64, across_px: f64) -> [f64; 2] {
    let half = (radius_px * radius_px - across_px * across_px).max(0.0).sqrt();
    [-half, half]
}

/// Returns the fraction of the area of a disc that several occluders leave visible, 0 to 1, by numerical integration.
pub(crate) fn visible_fraction(disc: &DiscOutline, occluders: &[Occluder]) -> f64 {
    let radius = disc.radius_px;
    let [x, y] = disc.center_px;
    if occluders.iter().all(|occluder| occluder.distance_and_normal(x, y).0 >= radius) {
        return 1.0;
    }
    let axes = Axes::new(disc.center_px, [1.0, 0.0]);
    // A fine blur gives many chords.
    let visible = visible_chords(radius, 0.02 * radius, &axes, occluders, |across| Some(disc_chord(radius, across)));
    let area: f64 = visible.iter().map(|chord| chord.width_px * (chord.ends_px[1] - chord.ends_px[0])).sum();
    (area / (std::f64::consts::PI * radius * radius)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disc_behind_another_shows_what_their_lens_leaves() {
        let disc = DiscOutline { center_px: [10.0, 20.0], radius_px: 30.0 };
        let front = |x: f64| Occluder::Ball(DiscOutline { center_px: [x, 20.0], radius_px: 30.0 });
        // The lens of two equal discs is 2 acos(d / 2 r) - (d / 2 r) sqrt(4 - (d / r)^2), over pi.
        for distance in [0.0f64, 1.0, 15.0, 59.0, 60.0, 80.0] {
            let part = (distance / 60.0).min(1.0);
            let lens = (2.0 * part.acos() - 2.0 * part * (1.0 - part * part).sqrt()) / std::f64::consts::PI;
            let visible = visible_fraction(&disc, &[front(10.0 + distance)]);
            assert!((visible - (1.0 - lens)).abs() < 1e-5, "{distance}: {visible} {}", 1.0 - lens);
        }
        let edge = HalfPlane { point_px: [10.0, 20.0], normal: [0.6, -0.8] };
        assert!((visible_fraction(&disc, &[Occluder::Edge(edge)]) - 0.5).abs() < 1e-6);
        assert!((visible_fraction(&disc, &[Occluder::Edge(edge), front(10.0)])).abs() < 1e-12);
    }

    #[test]
    fn overlapping_occluders_occlude_no_more_than_one() {
        let disc = DiscOutline { center_px: [0.0, 0.0], radius_px: 20.0 };
        let one = Occluder::Ball(DiscOutline { center_px: [21.0, 3.0], radius_px: 15.0 });
        let once = visible_fraction(&disc, &[one]);
        assert!(once < 0.9 && (visible_fraction(&disc, &[one, one]) - once).abs() < 1e-9);
    }
}
