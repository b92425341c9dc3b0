//! A round spot on a sphere in parallel projection.
//!
//! The spot is a spherical cap. At the centre of the ball it appears as a disc, elsewhere as an ellipse that is
//! narrower along the radius. If it crosses the rim, the front part is visible.

use super::blurred_edge::REACH_SIGMA;
use super::occluder::{Chord, divide_into_chords};
use crate::numeric::normal_cdf;
use std::f64::consts::{FRAC_PI_2, TAU};

/// The size of a cap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SphericalCap {
    /// The radius of the ball, px.
    pub(crate) ball_px: f64,
    /// The radius of the cap's circle, px.
    pub(crate) radius_px: f64,
}

impl SphericalCap {
    /// Returns the distance of the cap's plane from the ball's centre, px.
    fn plane_distance_px(&self) -> f64 {
        (self.ball_px * self.ball_px - self.radius_px * self.radius_px).sqrt()
    }

    /// Returns the angle between the centre and the edge of the cap, seen from the centre of the ball, rad.
    pub(crate) fn opening_rad(&self) -> f64 {
        (self.radius_px / self.ball_px).asin()
    }

    /// Returns the distance of the cap's origin from the ball's centre in the image, px, at `tilt_rad` off the line
    /// of sight.
    pub(crate) fn origin_px(&self, tilt_rad: f64) -> f64 {
        self.plane_distance_px() * tilt_rad.sin()
    }

    /// Returns half the width of the visible part, across the radius, px, at `tilt_rad` off the line of sight.
    pub(crate) fn half_width_px(&self, tilt_rad: f64) -> f64 {
        let behind = (tilt_rad - FRAC_PI_2).max(0.0).cos();
        let part = self.plane_distance_px() / (self.ball_px * behind);
        self.ball_px * (1.0 - part * part).max(0.0).sqrt()
    }

    /// Returns the ends of the chord along the radius, at `across_px` from it, px from the origin outwards; `None`
    /// where no part is visible.
    pub(crate) fn chord_ends_px(&self, tilt_rad: f64, across_px: f64) -> Option<[f64; 2]> {
        // The section of the sphere along the radius is a circle, from which the cap's plane cuts an arc.
        let circle = (self.ball_px * self.ball_px - across_px * across_px).sqrt();
        let part = self.plane_distance_px() / circle;
        if part >= 1.0 {
            return None;
        }
        let arc = part.acos();
        let origin = self.origin_px(tilt_rad);
        let (inner, outer) = (tilt_rad - arc, (tilt_rad + arc).min(FRAC_PI_2));
        (inner < outer).then(|| [circle * inner.sin() - origin, circle * outer.sin() - origin])
    }

    /// Divides the visible part into chords along the radius.
    fn chords(&self, tilt_rad: f64, sigma_px: f64) -> Vec<Chord> {
        divide_into_chords(self.half_width_px(tilt_rad), sigma_px, &[], |across| self.chord_ends_px(tilt_rad, across))
    }
}

/// The grid of a [`CapTable`] in the image, px.
const STEP_PX: f64 = 0.125;
/// The maximum shift of an edge of the ellipse from one tilt to the next, px.
const TILT_STEP_PX: f64 = 0.1;
/// The spacing of tilts where the rim cuts the cap: the maximum of their squared difference times the ball's radius,
/// px.
///
/// There the ends of the cap move along circles.
const RIM_BEND_PX: f64 = 0.004;

/// The value of a covered pixel, finer than any camera resolves.
const FULL_COVERAGE: f32 = 65_535.0;

/// The coverage of a pixel by the visible part of a cap, tabulated over its tilt and the position from its origin.
///
/// At one tilt the table is symmetric about the radius and rotates with the cap. A ball that rotates in the image plane
/// therefore moves rigidly, however coarse the table.
#[derive(Debug, Clone)]
pub(crate) struct CapTable {
    cap: SphericalCap,
    reach_px: f64,
    /// The first tilt, the pages per radian and the number of pages before, for caps fully visible and cut by the rim.
    zones: [(f64, f64, f64); 2],
    last_page: f64,
    columns: usize,
    /// One page per tilt. The rows are positions along the radius, from `-reach_px` outwards, the columns positions
    /// across. Each cell holds the value of this page and of the next one, in units of [`FULL_COVERAGE`].
    values: Vec<[u16; 2]>,
}

/// A cap at one tilt.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CapView<'a> {
    page: &'a [[u16; 2]],
    part: f32,
    columns: usize,
    reach_px: f32,
}

impl CapTable {
    /// Tabulates a cap over all tilts at which a part of it is visible. `sigma_px` is the blur.
    pub(crate) fn new(cap: SphericalCap, sigma_px: f64) -> Self {
        let reach_px = cap.radius_px + REACH_SIGMA * sigma_px;
        let columns = (reach_px / STEP_PX).ceil() as usize + 2;
        let opening = cap.opening_rad();
        let full_rad = FRAC_PI_2 - opening;
        let full = (full_rad * cap.radius_px / TILT_STEP_PX).ceil().max(16.0);
        let cut = (2.0 * opening / (RIM_BEND_PX / cap.ball_px).sqrt()).ceil().max(2.0);
        let tilts = (0..full as usize).map(|index| full_rad * index as f64 / full);
        // One extra page, so that there is always a next.
        let tilts = tilts.chain((0..=cut as usize + 1).map(|index| full_rad + 2.0 * opening * index as f64 / cut));
        let pages: Vec<Vec<u16>> =
            tilts.map(|tilt| tabulate_page(&cap.chords(tilt, sigma_px), reach_px, columns, sigma_px)).collect();
        let both =
            |pair: &[Vec<u16>]| pair[0].iter().zip(&pair[1]).map(|(here, next)| [*here, *next]).collect::<Vec<_>>();
        let values = pages.windows(2).flat_map(both).collect();
        let zones = [(0.0, full / full_rad, 0.0), (full_rad, 0.5 * cut / opening, full)];
        Self { cap, reach_px, zones, last_page: full + cut, columns, values }
    }

    /// The distance from its origin beyond which the cap is neglected.
    pub(crate) fn reach_px(&self) -> f64 {
        self.reach_px
    }

    /// The tabulated cap.
    pub(crate) fn cap(&self) -> &SphericalCap {
        &self.cap
    }

    /// Returns the cap at `tilt_rad` off the line of sight.
    pub(crate) fn tilted(&self, tilt_rad: f64) -> CapView<'_> {
        let (first_rad, pages_per_rad, before) = self.zones[usize::from(tilt_rad >= self.zones[1].0)];
        let place = (before + (tilt_rad - first_rad) * pages_per_rad).clamp(0.0, self.last_page);
        let page = 2 * self.columns * self.columns;
        let start = place as usize * page;
        CapView {
            page: &self.values[start..start + page],
            part: place.fract() as f32,
            columns: self.columns,
            reach_px: self.reach_px as f32,
        }
    }
}

impl CapView<'_> {
    /// Returns the coverage at a position along the radius and across it, from the origin, 0 to 1.
    #[inline]
    pub(crate) fn coverage_at(&self, outward_px: f32, across_px: f32) -> f32 {
        const STEPS_PER_PX: f32 = (1.0 / STEP_PX) as f32;
        let row = ((outward_px + self.reach_px) * STEPS_PER_PX).clamp(0.0, (2 * self.columns - 2) as f32);
        let column = (across_px.abs() * STEPS_PER_PX).min((self.columns - 2) as f32);
        let (down, right) = (row.fract(), column.fract());
        let cell = row as usize * self.columns + column as usize;
        let at = |cell: usize| {
            let [here, next] = self.page[cell].map(f32::from);
            here + self.part * (next - here)
        };
        let across = |cell: usize| {
            let left = at(cell);
            left + right * (at(cell + 1) - left)
        };
        let (here, below) = (across(cell), across(cell + self.columns));
        (here + down * (below - here)) * (1.0 / FULL_COVERAGE)
    }
}

/// Computes one page of a table, `2 * columns` rows of `columns` values: the profiles of the chords along the radius,
/// blurred across it, in units of [`FULL_COVERAGE`].
fn tabulate_page(chords: &[Chord], reach_px: f64, columns: usize, sigma_px: f64) -> Vec<u16> {
    let scale = 1.0 / sigma_px;
    let blurred: Vec<f64> = chords
        .iter()
        .flat_map(|chord| {
            (0..columns).map(move |column| {
                let distance = (column as f64 * STEP_PX - chord.across_px) * scale;
                chord.width_px * scale * (-0.5 * distance * distance).exp() / TAU.sqrt()
            })
        })
        .collect();
    let (mut line, mut values) = (vec![0.0; columns], Vec::with_capacity(2 * columns * columns));
    for row in 0..2 * columns {
        let outward = row as f64 * STEP_PX - reach_px;
        line.fill(0.0);
        for (chord, blurred) in chords.iter().zip(blurred.chunks_exact(columns)) {
            let [low, high] = chord.ends_px.map(|end| (end - outward) * scale);
            if low > 6.0 || high < -6.0 {
                continue;
            }
            let profile = normal_cdf(high) - normal_cdf(low);
            line.iter_mut().zip(blurred).for_each(|(sum, weight)| *sum += profile * weight);
        }
        values.extend(line.iter().map(|value| (value.clamp(0.0, 1.0) * f64::from(FULL_COVERAGE)).round() as u16));
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn area_px2(cap: &SphericalCap, tilt_rad: f64) -> f64 {
        let chords = cap.chords(tilt_rad, 0.2);
        chords.iter().map(|chord| chord.width_px * (chord.ends_px[1] - chord.ends_px[0])).sum()
    }

    #[test]
    fn a_visible_cap_is_an_ellipse_narrowed_by_the_cosine_of_its_tilt() {
        let cap = SphericalCap { ball_px: 60.0, radius_px: 5.0 };
        for tilt in [0.0f64, 0.4, 1.0, 1.48] {
            assert!((area_px2(&cap, tilt) - PI * 25.0 * tilt.cos()).abs() < 1e-6, "{tilt}");
            let [inner, outer] = cap.chord_ends_px(tilt, 0.0).unwrap();
            assert!((inner + 5.0 * tilt.cos()).abs() < 1e-9 && (outer - 5.0 * tilt.cos()).abs() < 1e-9, "{tilt}");
        }
    }

    #[test]
    fn a_cap_on_the_rim_shows_its_half_in_front_and_vanishes_behind() {
        let cap = SphericalCap { ball_px: 60.0, radius_px: 5.0 };
        // Seen from the side, the cap is a segment of the ball's outline.
        let half = (5.0f64 / 60.0).asin();
        let segment = 3600.0 * (half - half.sin() * half.cos());
        assert!((area_px2(&cap, FRAC_PI_2) - segment).abs() < 1e-6);
        assert!(area_px2(&cap, FRAC_PI_2 + 0.99 * half) < 1e-3 * segment);
        assert!(area_px2(&cap, FRAC_PI_2 + 1.01 * half) < 1e-12);
    }

    #[test]
    fn the_table_keeps_the_light_of_the_visible_part_at_every_tilt() {
        let cap = SphericalCap { ball_px: 30.0, radius_px: 3.2 };
        let table = CapTable::new(cap, 0.76);
        for tilt in [0.0, 0.31, 0.9, 1.4, 1.52, 1.6, 1.65] {
            let (view, step) = (table.tilted(tilt), 0.05);
            let count = (table.reach_px() / step) as i32;
            let light: f64 = (-count..=count)
                .flat_map(|row| (-count..=count).map(move |column| (row, column)))
                .map(|(row, column)| {
                    f64::from(view.coverage_at((f64::from(row) * step) as f32, (f64::from(column) * step) as f32))
                })
                .sum();
            let (light, area) = (light * step * step, area_px2(&cap, tilt));
            assert!((light - area).abs() < 0.01 + 2e-3 * area, "{tilt}: {light} of {area}");
        }
    }
}
