//! Speckles on a full sphere, which can rotate about any axis.

use super::occluder::{Axes, Occluder, chord_coverage, visible_chords};
use super::patch::{Canvas, splat};
use super::speckle_pattern::{MAX_TRIALS, draw_sizes, size_areas_px2};
use super::spherical_cap::{CapTable, SphericalCap};
use crate::numeric::Stream;
use crate::synth::orientation::Orientation;
use crate::synth::scenario::{PatternSetup, ScenarioError};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// One speckle on the sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spot {
    /// Its direction from the ball's centre, in the axes of the ball: x right, y up, z towards the camera at angle 0.
    pub(crate) direction: [f64; 3],
    /// The index of its size.
    pub(crate) size: usize,
}

/// A speckled sphere; no two speckles overlap.
#[derive(Debug, Clone)]
pub(crate) struct SpeckledSphere {
    pub(crate) spots: Vec<Spot>,
    pub(crate) tables: Vec<CapTable>,
    ball_px: f64,
    sigma_px: f64,
}

impl SpeckledSphere {
    /// Places random speckles on the whole sphere until they reach the coverage. `sigma_px` is the blur of their
    /// tables.
    ///
    /// # Errors
    ///
    /// Returns [`ScenarioError::TooDense`] if they do not fit.
    pub(crate) fn scatter(
        setup: &PatternSetup,
        ball_px: f64,
        sigma_px: f64,
        mut stream: Stream,
    ) -> Result<Self, ScenarioError> {
        let areas = size_areas_px2(setup);
        let caps: Vec<SphericalCap> =
            areas.iter().map(|area| SphericalCap { ball_px, radius_px: (area / PI).sqrt() }).collect();
        let whole_px2 = 4.0 * PI * ball_px * ball_px;
        let wanted_px2 = setup.coverage * whole_px2;
        let mut placement = Placement::new(&caps);
        let mut usable = caps.len();
        while placement.covered_px2 < wanted_px2 {
            if usable == 0 {
                return Err(ScenarioError::TooDense {
                    wanted: setup.coverage,
                    reached: placement.covered_px2 / whole_px2,
                });
            }
            let mut batch = draw_sizes(&areas[..usable], wanted_px2 - placement.covered_px2, &mut stream);
            // Large ones first, since small ones still fit between them.
            batch.sort_unstable_by(|left, right| right.cmp(left));
            for size in batch {
                if size < usable && !placement.place_speckle(size, &mut stream) {
                    usable = size;
                }
            }
        }
        let spots = placement.spots;
        let tables = caps.iter().map(|cap| CapTable::new(*cap, sigma_px)).collect();
        Ok(Self { spots, tables, ball_px, sigma_px })
    }

    /// Adds the visible part of every speckle to the ink; positions are relative to the patch's corner.
    pub(crate) fn draw(
        &self,
        orientation: &Orientation,
        center_px: [f64; 2],
        occluders: &[Occluder],
        canvas: &mut Canvas<'_>,
    ) {
        for spot in &self.spots {
            let [x, y, z] = orientation.rotate(spot.direction);
            let table = &self.tables[spot.size];
            let cap = table.cap();
            let tilt_rad = z.clamp(-1.0, 1.0).acos();
            if tilt_rad >= FRAC_PI_2 + cap.opening_rad() {
                continue;
            }
            let radial = x.hypot(y);
            let outward = if radial > 0.0 { [x / radial, -y / radial] } else { [1.0, 0.0] };
            let reach = cap.origin_px(tilt_rad);
            let place = [center_px[0] + reach * outward[0], center_px[1] + reach * outward[1]];
            self.draw_spot(table, tilt_rad, &Axes::new(place, outward), occluders, canvas);
        }
    }

    /// Adds the visible part of one speckle, tilted by `tilt_rad` off the line of sight; `axes` lead from its origin
    /// outwards.
    fn draw_spot(&self, table: &CapTable, tilt_rad: f64, axes: &Axes, occluders: &[Occluder], canvas: &mut Canvas<'_>) {
        let (cap, [x, y]) = (table.cap(), axes.origin_px);
        // The visible part of a speckle on the rim lies slightly off its origin.
        let extent = cap.radius_px * (1.0 + cap.radius_px / self.ball_px);
        let outside =
            occluders.iter().map(|occluder| occluder.distance_and_normal(x, y).0).fold(f64::INFINITY, f64::min);
        if outside <= -extent {
            return;
        }
        let project = |dx: f32, dy: f32, [ex, ey]: [f64; 2]| dx * ex as f32 + dy * ey as f32;
        if outside < extent {
            let chords = visible_chords(cap.half_width_px(tilt_rad), self.sigma_px, axes, occluders, |across| {
                cap.chord_ends_px(tilt_rad, across)
            });
            splat([x, y], table.reach_px(), canvas, |dx, dy| {
                let (along, across) = (project(dx, dy, axes.along), project(dx, dy, axes.across));
                chord_coverage(&chords, f64::from(along), f64::from(across), self.sigma_px) as f32
            });
        } else {
            let view = table.tilted(tilt_rad);
            splat([x, y], table.reach_px(), canvas, |dx, dy| {
                view.coverage_at(project(dx, dy, axes.along), project(dx, dy, axes.across))
            });
        }
    }
}

/// A sphere that is being covered, divided into slices of equal height to find neighbours.
struct Placement<'a> {
    caps: &'a [SphericalCap],
    slices: Vec<Vec<usize>>,
    /// The maximum distance of neighbours, in slices.
    near: usize,
    spots: Vec<Spot>,
    covered_px2: f64,
}

impl<'a> Placement<'a> {
    /// Prepares an empty sphere with slices about as high as the largest cap; `caps` are the sizes of the speckles.
    fn new(caps: &'a [SphericalCap]) -> Self {
        let widest = caps.iter().map(SphericalCap::opening_rad).fold(0.0, f64::max);
        // The heights of two touching spots differ by at most the angle between them.
        let slices = ((1.0 / widest).ceil() as usize).clamp(1, 10_000);
        let near = (widest * slices as f64).ceil() as usize + 1;
        Self { caps, slices: vec![Vec::new(); slices], near, spots: Vec::new(), covered_px2: 0.0 }
    }

    /// Returns the index of the slice that contains a direction, counted from z = -1.
    fn slice_index(&self, direction: &[f64; 3]) -> usize {
        ((0.5 * (direction[2] + 1.0) * self.slices.len() as f64) as usize).min(self.slices.len() - 1)
    }

    /// Places a speckle of this size in a random free direction. Returns whether one was found.
    fn place_speckle(&mut self, size: usize, stream: &mut Stream) -> bool {
        let cap = &self.caps[size];
        for _ in 0..MAX_TRIALS {
            let (z, around) = (stream.between(-1.0, 1.0), stream.between(0.0, TAU));
            let radial = (1.0 - z * z).max(0.0).sqrt();
            let spot = Spot { direction: [radial * around.cos(), radial * around.sin(), z], size };
            if !self.is_free(&spot) {
                continue;
            }
            // The area of the cap itself, not of its plane.
            self.covered_px2 += TAU * cap.ball_px * cap.ball_px * (1.0 - cap.opening_rad().cos());
            let slice = self.slice_index(&spot.direction);
            self.slices[slice].push(self.spots.len());
            self.spots.push(spot);
            return true;
        }
        false
    }

    /// Whether a speckle overlaps no other one.
    fn is_free(&self, spot: &Spot) -> bool {
        let slice = self.slice_index(&spot.direction);
        let opening = self.caps[spot.size].opening_rad();
        let slices = slice.saturating_sub(self.near)..(slice + self.near + 1).min(self.slices.len());
        self.slices[slices].iter().flatten().all(|index| {
            let other = &self.spots[*index];
            let cosine: f64 = spot.direction.iter().zip(&other.direction).map(|(left, right)| left * right).sum();
            cosine <= (opening + self.caps[other.size].opening_rad()).cos()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speckles_reach_the_coverage_on_every_side_and_never_overlap() {
        let setup = PatternSetup { area_min_px2: 4.0, area_max_px2: 80.0, coverage: 0.5, ..PatternSetup::default() };
        let sphere = SpeckledSphere::scatter(&setup, 40.0, 0.76, Stream::new(7)).unwrap();
        let area = |spot: &Spot| TAU * (1.0 - sphere.tables[spot.size].cap().opening_rad().cos());
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                let there = |spot: &&Spot| side * spot.direction[axis] > 0.0;
                let reached = sphere.spots.iter().filter(there).map(area).sum::<f64>() / TAU;
                assert!((reached - 0.5).abs() < 0.04, "axis {axis}, side {side}: {reached}");
            }
        }
        for (index, left) in sphere.spots.iter().enumerate() {
            for right in &sphere.spots[..index] {
                let cosine: f64 = left.direction.iter().zip(&right.direction).map(|(l, r)| l * r).sum();
                let apart = [left, right].map(|spot| sphere.tables[spot.size].cap().opening_rad());
                assert!(cosine.clamp(-1.0, 1.0).acos() >= apart[0] + apart[1] - 1e-9);
            }
        }
        let packed = PatternSetup { area_min_px2: 240.0, area_max_px2: 240.0, coverage: 0.6, ..setup };
        assert!(matches!(
            SpeckledSphere::scatter(&packed, 40.0, 0.76, Stream::new(7)),
            Err(ScenarioError::TooDense { .. })
        ));
    }
}
