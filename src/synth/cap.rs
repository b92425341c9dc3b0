//! A round spot on a sphere, as it is seen from far away.
//!
//! It is a cap: what a plane cuts off. In the middle of the ball it is a disc, off the middle an ellipse, narrower
//! along the radius; where it reaches over the rim, the part in front is seen.

use super::blur::{REACH_SIGMA, normal_cdf};
use super::cover::{Chord, chords};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A cap's size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cap {
    /// Radius of the ball, px.
    pub(crate) ball_px: f64,
    /// Radius of the cap's circle, px.
    pub(crate) radius_px: f64,
}

impl Cap {
    /// Distance of the cap's plane from the ball's centre, px.
    fn plane_px(&self) -> f64 {
        (self.ball_px * self.ball_px - self.radius_px * self.radius_px).sqrt()
    }

    /// Angle between its middle and its edge, seen from the ball's centre, rad.
    pub(crate) fn opening_rad(&self) -> f64 {
        (self.radius_px / self.ball_px).asin()
    }

    /// Distance of its origin from the ball's centre in the picture, px, when its middle is `tilt_rad` off the view.
    pub(crate) fn origin_px(&self, tilt_rad: f64) -> f64 {
        self.plane_px() * tilt_rad.sin()
    }

    /// How far its visible part reaches across the radius, px.
    pub(crate) fn half_px(&self, tilt_rad: f64) -> f64 {
        let behind = (tilt_rad - FRAC_PI_2).max(0.0).cos();
        let part = self.plane_px() / (self.ball_px * behind);
        self.ball_px * (1.0 - part * part).max(0.0).sqrt()
    }

    /// Ends of the chord along the radius, from the origin outwards, px; `across_px` from the radius.
    pub(crate) fn ends_px(&self, tilt_rad: f64, across_px: f64) -> Option<[f64; 2]> {
        // The sphere cut along the radius is a circle; the cap's plane cuts an arc off it.
        let circle = (self.ball_px * self.ball_px - across_px * across_px).sqrt();
        let part = self.plane_px() / circle;
        if part >= 1.0 {
            return None;
        }
        let arc = part.acos();
        let origin = self.origin_px(tilt_rad);
        let (inner, outer) = (tilt_rad - arc, (tilt_rad + arc).min(FRAC_PI_2));
        (inner < outer).then(|| [circle * inner.sin() - origin, circle * outer.sin() - origin])
    }

    fn chords(&self, tilt_rad: f64, sigma_px: f64) -> Vec<Chord> {
        chords(self.half_px(tilt_rad), sigma_px, &[], |across| self.ends_px(tilt_rad, across))
    }
}

/// Grid of a [`CapTable`] in the picture, px.
const STEP_PX: f64 = 0.125;
/// From tilt to tilt an edge of the ellipse moves by no more than this, px.
const TILT_STEP_PX: f64 = 0.1;
/// Where the rim cuts the cap, its ends move along circles: two tilts may be apart by the angle whose square, times the
/// ball's radius, is this, px.
const RIM_BEND_PX: f64 = 0.004;

/// A pixel that is covered; finer than any camera tells.
const WHOLE: f32 = 65_535.0;

/// Share of light that the visible part of a cap takes, tabulated over its tilt and the place from its origin.
///
/// At one tilt the table is symmetric about the radius and turns with the cap, so however coarse it is, a ball that
/// turns in the picture's plane moves as a rigid thing.
#[derive(Debug, Clone)]
pub(crate) struct CapTable {
    cap: Cap,
    reach_px: f64,
    /// First tilt of each zone, its pages a radian and how many there are before it: in sight, and cut by the rim.
    zones: [(f64, f64, f64); 2],
    last_page: f64,
    columns: usize,
    /// A page a tilt; in it a row a place along the radius, from `-reach_px` outwards, a column a place across; and at
    /// each place what this page has and what the next one has, of [`WHOLE`].
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
    pub(crate) fn new(cap: Cap, sigma_px: f64) -> Self {
        let reach_px = cap.radius_px + REACH_SIGMA * sigma_px;
        let columns = (reach_px / STEP_PX).ceil() as usize + 2;
        let opening = cap.opening_rad();
        let whole_rad = FRAC_PI_2 - opening;
        let whole = (whole_rad * cap.radius_px / TILT_STEP_PX).ceil().max(16.0);
        let cut = (2.0 * opening / (RIM_BEND_PX / cap.ball_px).sqrt()).ceil().max(2.0);
        let tilts = (0..whole as usize).map(|index| whole_rad * index as f64 / whole);
        // One more behind the last, so that there is always a next.
        let tilts = tilts.chain((0..=cut as usize + 1).map(|index| whole_rad + 2.0 * opening * index as f64 / cut));
        let pages: Vec<Vec<u16>> =
            tilts.map(|tilt| page(&cap.chords(tilt, sigma_px), reach_px, columns, sigma_px)).collect();
        let both =
            |pair: &[Vec<u16>]| pair[0].iter().zip(&pair[1]).map(|(here, next)| [*here, *next]).collect::<Vec<_>>();
        let values = pages.windows(2).flat_map(both).collect();
        let zones = [(0.0, whole / whole_rad, 0.0), (whole_rad, 0.5 * cut / opening, whole)];
        Self { cap, reach_px, zones, last_page: whole + cut, columns, values }
    }

    /// Beyond this distance from its origin it is no longer seen.
    pub(crate) fn reach_px(&self) -> f64 {
        self.reach_px
    }

    /// The cap it is of.
    pub(crate) fn cap(&self) -> &Cap {
        &self.cap
    }

    /// The cap whose middle is `tilt_rad` off the view.
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
    /// Share at a place along the radius and across it, from the origin, 0 to 1.
    #[inline]
    pub(crate) fn at(&self, outward_px: f32, across_px: f32) -> f32 {
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
        (here + down * (below - here)) * (1.0 / WHOLE)
    }
}

/// One page of a table: the chords' profiles along the radius, spread across it.
fn page(chords: &[Chord], reach_px: f64, columns: usize, sigma_px: f64) -> Vec<u16> {
    let scale = 1.0 / sigma_px;
    let spread: Vec<f64> = chords
        .iter()
        .flat_map(|chord| {
            (0..columns).map(move |column| {
                let far = (column as f64 * STEP_PX - chord.across_px) * scale;
                chord.width_px * scale * (-0.5 * far * far).exp() / TAU.sqrt()
            })
        })
        .collect();
    let (mut line, mut values) = (vec![0.0; columns], Vec::with_capacity(2 * columns * columns));
    for row in 0..2 * columns {
        let outward = row as f64 * STEP_PX - reach_px;
        line.fill(0.0);
        for (chord, spread) in chords.iter().zip(spread.chunks_exact(columns)) {
            let [low, high] = chord.ends_px.map(|end| (end - outward) * scale);
            if low > 6.0 || high < -6.0 {
                continue;
            }
            let profile = normal_cdf(high) - normal_cdf(low);
            line.iter_mut().zip(spread).for_each(|(sum, spread)| *sum += profile * spread);
        }
        values.extend(line.iter().map(|value| (value.clamp(0.0, 1.0) * f64::from(WHOLE)).round() as u16));
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn area_px2(cap: &Cap, tilt_rad: f64) -> f64 {
        let chords = cap.chords(tilt_rad, 0.2);
        chords.iter().map(|chord| chord.width_px * (chord.ends_px[1] - chord.ends_px[0])).sum()
    }

    #[test]
    fn a_cap_in_sight_is_an_ellipse_narrowed_by_the_cosine_of_its_tilt() {
        let cap = Cap { ball_px: 60.0, radius_px: 5.0 };
        for tilt in [0.0f64, 0.4, 1.0, 1.48] {
            assert!((area_px2(&cap, tilt) - PI * 25.0 * tilt.cos()).abs() < 1e-6, "{tilt}");
            let [inner, outer] = cap.ends_px(tilt, 0.0).unwrap();
            assert!((inner + 5.0 * tilt.cos()).abs() < 1e-9 && (outer - 5.0 * tilt.cos()).abs() < 1e-9, "{tilt}");
        }
    }

    #[test]
    fn a_cap_on_the_rim_shows_its_half_in_front_and_vanishes_behind() {
        let cap = Cap { ball_px: 60.0, radius_px: 5.0 };
        // Seen from the side the cap is a segment of the ball's outline.
        let half = (5.0f64 / 60.0).asin();
        let segment = 3600.0 * (half - half.sin() * half.cos());
        assert!((area_px2(&cap, FRAC_PI_2) - segment).abs() < 1e-6);
        assert!(area_px2(&cap, FRAC_PI_2 + 0.99 * half) < 1e-3 * segment);
        assert!(area_px2(&cap, FRAC_PI_2 + 1.01 * half) < 1e-12);
    }

    #[test]
    fn the_table_keeps_the_light_of_the_visible_part_at_every_tilt() {
        let cap = Cap { ball_px: 30.0, radius_px: 3.2 };
        let table = CapTable::new(cap, 0.76);
        for tilt in [0.0, 0.31, 0.9, 1.4, 1.52, 1.6, 1.65] {
            let (view, step) = (table.tilted(tilt), 0.05);
            let count = (table.reach_px() / step) as i32;
            let light: f64 = (-count..=count)
                .flat_map(|row| (-count..=count).map(move |column| (row, column)))
                .map(|(row, column)| {
                    f64::from(view.at((f64::from(row) * step) as f32, (f64::from(column) * step) as f32))
                })
                .sum();
            let (seen, area) = (light * step * step, area_px2(&cap, tilt));
            assert!((seen - area).abs() < 0.01 + 2e-3 * area, "{tilt}: {seen} of {area}");
        }
    }
}
