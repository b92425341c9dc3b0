//! Rendering of an upright rod with its tapes: strips and speckles in closed form.

use super::ball::Moment;
use super::blurred_edge::{REACH_SIGMA, total_sigma_px};
use super::body_light::BodyLight;
use super::patch::{Canvas, Patch, splat};
use super::speckle_pattern::{Pattern, SpeckleRegion};
use crate::numeric::normal_cdf;
use crate::synth::scenario::{RodSetup, Scenario};
use std::ops::Range;

/// The properties of the rod that do not change from frame to frame.
#[derive(Debug, Clone)]
pub(crate) struct Rod {
    half_width_px: f64,
    sigma_px: f64,
    /// The distance of the lower end below the mark, px.
    end_px: f64,
    /// The upper and lower edges of both tapes, from the mark downwards, px.
    tapes_px: [[f64; 2]; 2],
    pattern: Pattern,
    rod_dn: f32,
    tape_dn: f32,
    speckle_dn: f32,
    light: BodyLight,
}

impl Rod {
    /// Returns the speckled patch, a rectangle around the mark as wide as the rod.
    pub(crate) fn speckle_region(scenario: &Scenario, setup: &RodSetup) -> SpeckleRegion {
        SpeckleRegion::Rectangle([scenario.radius_px(), 0.5 * (setup.patch_px[1] - setup.patch_px[0])])
    }

    /// Returns the height of the mark, the middle of the patch, above the lower end, px.
    pub(crate) fn mark_height_px(setup: &RodSetup) -> f64 {
        0.5 * (setup.patch_px[0] + setup.patch_px[1])
    }

    /// Prepares the drawing of a rod with speckles of `pattern`. `full_dn` is the maximum grey level.
    pub(crate) fn new(scenario: &Scenario, setup: &RodSetup, pattern: Pattern, full_dn: f32) -> Self {
        let mark_px = Self::mark_height_px(setup);
        let below = |[low, high]: [f64; 2]| [mark_px - high, mark_px - low];
        Self {
            half_width_px: scenario.radius_px(),
            sigma_px: total_sigma_px(scenario.camera.blur_px),
            end_px: mark_px,
            tapes_px: [below(setup.tape_px), below(setup.patch_px)],
            pattern,
            rod_dn: full_dn * setup.shade as f32,
            tape_dn: full_dn * scenario.shade.ball as f32,
            speckle_dn: full_dn * scenario.shade.speckle as f32,
            light: BodyLight::new(scenario, full_dn),
        }
    }

    /// Draws the mean over several moments of equal weight, within these rows of an image of this width.
    pub(crate) fn draw(&self, moments: &[Moment], width: usize, rows: Range<usize>) -> Patch {
        let (top, height) = (rows.start, rows.len());
        let size = width * height;
        // The rod extends beyond the image, and so does its rectangle.
        let mut patch = Patch { left: 0, top, width, height, coverage: vec![0.0; size], light_dn: vec![0.0; size] };
        let weight = 1.0 / moments.len() as f32;
        let mut ink = vec![0.0; size];
        for moment in moments {
            ink.fill(0.0);
            let [x, y] = moment.pose.center_px;
            for speckle in &self.pattern.speckles {
                let disc = &self.pattern.discs[speckle.size];
                let place = [x + speckle.x_px, y + speckle.y_px - top as f64];
                splat(place, disc.reach_px(), &mut Canvas { patch: &patch, ink: &mut ink }, |dx, dy| {
                    disc.coverage_at(dx * dx + dy * dy)
                });
            }
            self.paint_moment(moment, &ink, weight, &mut patch);
        }
        patch
    }

    /// Adds coverage and light of the rod at one moment to the patch, both multiplied by `weight`. `ink` is that of
    /// the speckles.
    fn paint_moment(&self, moment: &Moment, ink: &[f32], weight: f32, patch: &mut Patch) {
        let [x, y] = moment.pose.center_px;
        // The surface occludes the part that has sunk into it; both edges lie along the rows.
        let end = moment.occluder.map_or(y + self.end_px, |flat| flat.point_px[1].min(y + self.end_px));
        let below = |edge: f64, place: f64| normal_cdf((place - edge) / self.sigma_px);
        // Coverage, diffuse light and reflection of the lamp: equal along an upright cylinder.
        let across: Vec<[f32; 3]> = (0..patch.width)
            .map(|column| {
                let column = column as f64;
                let covered = (below(x - self.half_width_px, column) - below(x + self.half_width_px, column)) as f32;
                let dx = (column - x) as f32;
                [covered, self.light.diffuse_at(dx, 0.0), self.light.gloss_dn(dx, 0.0)]
            })
            .collect();
        let last = (end + REACH_SIGMA * self.sigma_px).ceil() - patch.top as f64;
        for row in 0..last.clamp(0.0, patch.height as f64) as usize {
            let place = (patch.top + row) as f64;
            let rod = 1.0 - below(end, place) as f32;
            let tape: f32 = self
                .tapes_px
                .iter()
                .map(|[upper, lower]| (below(y + upper, place) - below(y + lower, place)) as f32)
                .sum();
            let light = self.rod_dn * rod + (self.tape_dn - self.rod_dn) * tape;
            let cells = row * patch.width..(row + 1) * patch.width;
            let target = patch.coverage[cells.clone()].iter_mut().zip(&mut patch.light_dn[cells.clone()]);
            for ((coverage, light_dn), ([across, diffuse, gloss_dn], ink)) in target.zip(across.iter().zip(&ink[cells]))
            {
                *coverage += weight * across * rod;
                *light_dn += weight * (across * light - (self.tape_dn - self.speckle_dn) * ink) * diffuse;
                *light_dn += weight * across * rod * gloss_dn;
            }
        }
    }
}
