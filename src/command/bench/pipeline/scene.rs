//! The film of the benchmark: a body that swings across the image.

use crate::console::UsageError;
use crate::dic::grid;
use crate::synth::{BodySetup, CameraSetup, MotionSetup, PartSetup, ScaleSetup, Scenario};

/// The part of the radius on which subsets lie, as in a measurement.
const SUBSET_RADIUS: f64 = 0.96;
/// The distances between subsets that are considered, px.
const STEPS_PX: std::ops::RangeInclusive<u32> = 2..=60;
/// The largest ball, px, and the largest as a share of the image's shorter side.
const DIAMETER_PX: f64 = 120.0;
const DIAMETER_SHARE: f64 = 0.75;
/// The displacement of the ball in the middle of the film, px per frame, and its rotation, deg per frame.
const BALL_PEAK_PX: [f64; 2] = [0.37, -0.21];
const BALL_PEAK_DEG: f64 = 0.13;
/// The displacement of the rod in the middle of the film, px per frame: that of 1 m/s at 40 000 frames/s.
const ROD_PEAK_PX: [f64; 2] = [0.0, 0.09];
/// The width of the rod, the height of its speckled tape and the room that it needs, px.
const ROD_PX: f64 = 30.0;
const TAPE_PX: f64 = 50.0;
const ROD_ROOM_PX: [u32; 2] = [64, 160];
/// The speckled tape in the middle of its way, above the middle of the image, px.
const TAPE_ABOVE_PX: f64 = 24.0;
/// The number of frames that are drawn, and the memory that they may take, bytes.
const FILM_FRAMES: u64 = 256;
const FILM_BYTES: u64 = 1 << 30;

/// The body that is filmed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum BenchBody {
    /// A speckled ball, with its outline and the match of the whole ball.
    #[default]
    Ball,
    /// The steel rod of the built-in scenario, with the edges of its tapes.
    Rod,
}

/// The image and the body in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scene {
    side_px: [u32; 2],
    body: BenchBody,
    /// The diameter of the body, px.
    diameter_px: f64,
}

/// A grid of subsets on the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SubsetGrid {
    /// The distance of neighbouring subsets, px.
    pub(super) step_px: u32,
    /// The number of subsets.
    pub(super) subsets: usize,
}

impl Scene {
    /// Returns a scene of this image size in px, with the largest ball that fits, or with the rod.
    ///
    /// # Errors
    ///
    /// [`UsageError`] if the image has no room for the rod.
    pub(super) fn new(body: BenchBody, side_px: [u32; 2]) -> Result<Self, UsageError> {
        let shorter_px = f64::from(side_px[0].min(side_px[1]));
        let diameter_px = match body {
            BenchBody::Ball => DIAMETER_PX.min(DIAMETER_SHARE * shorter_px),
            BenchBody::Rod => ROD_PX,
        };
        let [width, height] = ROD_ROOM_PX;
        if body == BenchBody::Rod && (side_px[0] < width || side_px[1] < height) {
            return Err(UsageError(format!("--size: a rod needs at least {width}x{height} px")));
        }
        Ok(Self { side_px, body, diameter_px })
    }

    /// Describes the body.
    pub(super) fn description(&self) -> String {
        match self.body {
            BenchBody::Ball => format!("ball of {:.0} px matched as a whole", self.diameter_px),
            BenchBody::Rod => format!("rod of {:.0} px with two tapes", self.diameter_px),
        }
    }

    /// Returns the body as a word.
    pub(super) fn body_name(&self) -> &'static str {
        match self.body {
            BenchBody::Ball => "ball",
            BenchBody::Rod => "rod",
        }
    }

    /// Returns the full width of a subset, px.
    pub(super) fn subset_size_px(&self) -> u32 {
        match self.body {
            BenchBody::Ball => 31,
            BenchBody::Rod => 25,
        }
    }

    /// Returns the bytes of a frame.
    pub(super) fn frame_bytes(&self) -> u64 {
        u64::from(self.side_px[0]) * u64::from(self.side_px[1])
    }

    /// Counts the subsets of a body in the middle of the image on a grid of this step, px.
    fn count_subsets(&self, step_px: u32) -> usize {
        let [width, height] = self.side_px.map(|side| side as usize);
        let [x, y] = self.side_px.map(|side| 0.5 * f64::from(side));
        let size_px = self.subset_size_px();
        match self.body {
            BenchBody::Ball => {
                grid::disc(x, y, SUBSET_RADIUS * 0.5 * self.diameter_px, step_px, size_px, width, height).len()
            }
            BenchBody::Rod => grid::rectangle([0, 0, ROD_PX as u32, TAPE_PX as u32], step_px, size_px).len(),
        }
    }

    /// Returns the grid whose number of subsets is closest to `wanted`.
    pub(super) fn closest_grid(&self, wanted: usize) -> SubsetGrid {
        let grids = STEPS_PX.map(|step_px| SubsetGrid { step_px, subsets: self.count_subsets(step_px) });
        let closest = grids.min_by_key(|grid| grid.subsets.abs_diff(wanted));
        closest.unwrap_or(SubsetGrid { step_px: *STEPS_PX.start(), subsets: 0 })
    }

    /// Returns the tables of the rig file about the body and its subsets.
    pub(super) fn rig_tables(&self, mm_per_px: f64, step_px: u32) -> String {
        let (name, diameter_mm, size_px) = (self.body_name(), mm_per_px * self.diameter_px, self.subset_size_px());
        let shape = if self.body == BenchBody::Rod { "shape = \"translation\"\n" } else { "" };
        // The body swings along the surface. Where it turns it would otherwise seem to be in contact.
        let [right_px, down_px] = match self.body {
            BenchBody::Ball => BALL_PEAK_PX,
            BenchBody::Rod => ROD_PEAK_PX,
        };
        let angle_deg = (-down_px).atan2(right_px).to_degrees();
        format!(
            "[[body]]\nname = \"{name}\"\nkind = \"{name}\"\ndiameter_mm = {diameter_mm:?}\n\
             [surface]\nangle_deg = {angle_deg:?}\n[correlation]\nsubset_size_px = {size_px}\nstep_px = {step_px}\n{shape}"
        )
    }

    /// Returns the film: a body that swings across the image, at rest in the first and in the last frame.
    pub(super) fn film(&self, mm_per_px: f64) -> Scenario {
        let frames = FILM_FRAMES.min(FILM_BYTES / self.frame_bytes()).max(2);
        // The speed is a half wave of a sine over the steps, whose sum is this.
        let steps_sum = frames as f64 * 2.0 / std::f64::consts::PI;
        let (peak_px, peak_deg) = match self.body {
            BenchBody::Ball => (self.ball_peak_px(steps_sum), BALL_PEAK_DEG),
            BenchBody::Rod => (ROD_PEAK_PX, 0.0),
        };
        let part = |step: u64| {
            let speed = (std::f64::consts::PI * (step + 1) as f64 / frames as f64).sin();
            PartSetup {
                frames: 1.0,
                vx_px_frame: speed * peak_px[0],
                vy_px_frame: speed * peak_px[1],
                omega_deg_frame: speed * peak_deg,
                tilt_deg_frame: [0.0; 2],
            }
        };
        let start = |axis: usize| 0.5 * (f64::from(self.side_px[axis]) - steps_sum * peak_px[axis]);
        let base = self.base();
        let above_px = if self.body == BenchBody::Rod { TAPE_ABOVE_PX } else { 0.0 };
        let [width_px, height_px] = self.side_px;
        Scenario {
            name: "swing".into(),
            camera: CameraSetup { width_px, height_px, frames, ..base.camera },
            scale: ScaleSetup { mm_per_px, ..base.scale },
            body: BodySetup { diameter_mm: mm_per_px * self.diameter_px, ..base.body },
            motion: MotionSetup::Piecewise {
                start_px: [start(0), start(1) - above_px],
                parts: (0..frames).map(part).collect(),
            },
            ..base
        }
    }

    /// Returns the scenario that gives the film its body and its light.
    fn base(&self) -> Scenario {
        let plain = Scenario::translation(0.0, 0.0, 0.0);
        match (self.body, Scenario::built_in("rod")) {
            // Without the surface that it strikes.
            (BenchBody::Rod, Some(rod)) => Scenario { occluder: plain.occluder, ..rod },
            _ => plain,
        }
    }

    /// Returns the displacement of the ball in the middle of the film, px per frame: slower where it would leave the image.
    fn ball_peak_px(&self, steps_sum: f64) -> [f64; 2] {
        let room_px = self.side_px.map(|side| 0.5 * (f64::from(side) - self.diameter_px));
        let fit = |axis: usize| (room_px[axis] / (steps_sum * BALL_PEAK_PX[axis].abs())).min(1.0);
        BALL_PEAK_PX.map(|peak| fit(0).min(fit(1)) * peak)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::SimulatedFilm;

    fn scene(body: BenchBody, side_px: [u32; 2]) -> Scene {
        Scene::new(body, side_px).unwrap_or_else(|error| panic!("{}", error.0))
    }

    #[test]
    fn the_ball_swings_about_the_middle_and_rests_where_the_film_turns() {
        for side_px in [[512, 512], [160, 128], [64, 64]] {
            let scene = scene(BenchBody::Ball, side_px);
            let film = scene.film(0.5);
            let MotionSetup::Piecewise { start_px, parts } = &film.motion else { panic!("piecewise") };
            let steps = &parts[..parts.len() - 1];
            let way = |of: fn(&PartSetup) -> f64| steps.iter().map(of).sum::<f64>();
            let ends = [start_px[0] + way(|part| part.vx_px_frame), start_px[1] + way(|part| part.vy_px_frame)];
            for axis in 0..2 {
                assert!((start_px[axis] + ends[axis] - f64::from(side_px[axis])).abs() < 1e-3, "{start_px:?} {ends:?}");
                let nearest = start_px[axis].min(ends[axis]) - 0.5 * scene.diameter_px;
                assert!(nearest > 0.0, "{side_px:?}: {nearest}");
            }
            // The first step is as large as the change from step to step.
            assert!(steps[0].vx_px_frame < 0.02 && steps[steps.len() - 1].vx_px_frame < 0.02);
            SimulatedFilm::new(&film).unwrap();
        }
    }

    #[test]
    fn the_rod_shows_all_edges_of_its_tapes_and_needs_room() {
        for side_px in [[64, 160], [128, 160], [512, 512]] {
            let film = scene(BenchBody::Rod, side_px).film(0.3);
            let MotionSetup::Piecewise { start_px, .. } = &film.motion else { panic!("piecewise") };
            // The tape's upper edge, and the lower edge of the clean tape, at both ends of the way of 15 px.
            assert!(start_px[1] > 26.0 && start_px[1] + 15.0 + 67.0 < f64::from(side_px[1]), "{start_px:?}");
            SimulatedFilm::new(&film).unwrap();
        }
        assert!(Scene::new(BenchBody::Rod, [64, 128]).is_err());
    }

    #[test]
    fn the_grid_has_about_as_many_subsets_as_wanted() {
        for (body, wanted) in [(BenchBody::Ball, [16, 64, 256]), (BenchBody::Rod, [6, 12, 18])] {
            for wanted in wanted {
                let found = scene(body, [512, 512]).closest_grid(wanted).subsets;
                assert!(found.abs_diff(wanted) * 5 <= wanted, "{wanted}: {found}");
            }
        }
    }
}
