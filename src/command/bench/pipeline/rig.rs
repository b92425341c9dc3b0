//! The rig that is timed: its film, its rig file and its folder.

use super::Plan;
use crate::bus;
use crate::config::{Config, DEFAULT_BLOCK_FRAMES, WorkerMode};
use crate::dic::grid;
use crate::failure::Failure;
use crate::synth::{BodySetup, CameraSetup, MotionSetup, PartSetup, ScaleSetup, Scenario};
use std::path::{Path, PathBuf};

/// The rig's name. It is fixed, so that two benchmarks at once, which would disturb each other, are refused.
const NAME: &str = "bench-live";
/// The size of subsets, px.
pub(super) const SUBSET_PX: u32 = 31;
/// The part of the radius on which subsets lie, as in a measurement.
const SUBSET_RADIUS: f64 = 0.96;
/// The distances between subsets that are considered, px.
const STEPS_PX: std::ops::RangeInclusive<u32> = 2..=60;
/// The largest ball, px, and the largest as a share of the image's shorter side.
const DIAMETER_PX: f64 = 120.0;
const DIAMETER_SHARE: f64 = 0.75;
/// The displacement in the middle of the film, px per frame, and the rotation, deg per frame.
const PEAK_PX: [f64; 2] = [0.37, -0.21];
const PEAK_DEG: f64 = 0.13;
/// The number of frames that are drawn, and the memory that they may take, bytes.
const FILM_FRAMES: u64 = 256;
const FILM_BYTES: u64 = 1 << 30;
/// Scale, mm per px; any.
const MM_PER_PX: f64 = 0.5;
/// The share of the free memory that the ring may take by default.
const MEMORY_SHARE: u64 = 4;
/// The memory of a frame besides its pixels, bytes.
const HEADER_BYTES: u64 = 192;
/// The maximum time that a rig keeps before a trigger, s.
const MAX_PRE_S: f64 = 60.0;
/// Frames of the ring besides those before a trigger: a block, and the time for a decision, s.
const BLOCK_FRAMES: f64 = DEFAULT_BLOCK_FRAMES as f64;
const DECISION_S: f64 = 0.25;

/// A folder for the files of a benchmark, removed with all its content when it is dropped.
#[derive(Debug)]
pub(super) struct Folder(PathBuf);

impl Folder {
    /// Creates the folder, named after this process, where temporary files belong.
    ///
    /// # Errors
    ///
    /// When it cannot be created.
    pub(super) fn create() -> std::io::Result<Self> {
        let path = std::env::temp_dir().join(format!("ricochet-bench-{}", std::process::id()));
        // One of a killed benchmark with the same process id; not of another user, whose folder cannot be removed.
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir(&path)?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Nothing can be done about a folder that cannot be removed.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The image and the ball in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scene {
    side_px: [u32; 2],
    diameter_px: f64,
}

/// A grid of subsets on the ball.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SubsetGrid {
    /// The distance of neighbouring subsets, px.
    pub(super) step_px: u32,
    /// The number of subsets.
    pub(super) subsets: usize,
}

impl Scene {
    /// Returns a scene of this image size in px, with the largest ball that fits.
    pub(super) fn new(side_px: [u32; 2]) -> Self {
        let shorter_px = f64::from(side_px[0].min(side_px[1]));
        Self { side_px, diameter_px: DIAMETER_PX.min(DIAMETER_SHARE * shorter_px) }
    }

    /// Returns the diameter of the ball, px.
    pub(super) fn diameter_px(&self) -> f64 {
        self.diameter_px
    }

    /// Returns the bytes of a frame.
    fn frame_bytes(&self) -> u64 {
        u64::from(self.side_px[0]) * u64::from(self.side_px[1])
    }

    /// Counts the subsets of a ball in the middle of the image on a grid of this step, px.
    fn count_subsets(&self, step_px: u32) -> usize {
        let [width, height] = self.side_px.map(|side| side as usize);
        let [x, y] = self.side_px.map(|side| 0.5 * f64::from(side));
        grid::disc(x, y, SUBSET_RADIUS * 0.5 * self.diameter_px, step_px, SUBSET_PX, width, height).len()
    }

    /// Returns the grid whose number of subsets is closest to `wanted`.
    pub(super) fn closest_grid(&self, wanted: usize) -> SubsetGrid {
        let grids = STEPS_PX.map(|step_px| SubsetGrid { step_px, subsets: self.count_subsets(step_px) });
        let closest = grids.min_by_key(|grid| grid.subsets.abs_diff(wanted));
        closest.unwrap_or(SubsetGrid { step_px: *STEPS_PX.start(), subsets: 0 })
    }

    /// Returns the film: a ball that swings across the image, at rest in the first and in the last frame.
    fn film(&self) -> Scenario {
        let frames = FILM_FRAMES.min(FILM_BYTES / self.frame_bytes()).max(2);
        // The speed is a half wave of a sine over the steps, whose sum is this.
        let steps_sum = frames as f64 * 2.0 / std::f64::consts::PI;
        let room_px = self.side_px.map(|side| 0.5 * (f64::from(side) - self.diameter_px));
        let fit = |axis: usize| (room_px[axis] / (steps_sum * PEAK_PX[axis].abs())).min(1.0);
        let scale = fit(0).min(fit(1));
        let part = |step: u64| {
            let speed = (std::f64::consts::PI * (step + 1) as f64 / frames as f64).sin();
            PartSetup {
                frames: 1.0,
                vx_px_frame: scale * speed * PEAK_PX[0],
                vy_px_frame: scale * speed * PEAK_PX[1],
                omega_deg_frame: speed * PEAK_DEG,
                tilt_deg_frame: [0.0; 2],
            }
        };
        let start = |axis: usize| 0.5 * (f64::from(self.side_px[axis]) - steps_sum * scale * PEAK_PX[axis]);
        let base = Scenario::translation(0.0, 0.0, 0.0);
        let [width_px, height_px] = self.side_px;
        Scenario {
            name: "swing".into(),
            camera: CameraSetup { width_px, height_px, frames, ..base.camera },
            scale: ScaleSetup { mm_per_px: MM_PER_PX, ..base.scale },
            body: BodySetup { diameter_mm: MM_PER_PX * self.diameter_px, ..base.body },
            motion: MotionSetup::Piecewise { start_px: [start(0), start(1)], parts: (0..frames).map(part).collect() },
            ..base
        }
    }

    /// Returns the ring that the free memory allows by default, at most `wanted` frames.
    ///
    /// The recorder may hold as many frames again while it writes, so a rig needs twice the memory of its ring.
    pub(super) fn default_ring_frames(&self, wanted: u64) -> u64 {
        let free_bytes = bus::free_bytes().min(available_bytes());
        wanted.min(free_bytes / MEMORY_SHARE / (2 * (self.frame_bytes() + HEADER_BYTES)))
    }
}

/// Returns the memory that the system can give to programs, bytes; `u64::MAX` if it is unknown.
fn available_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let kib = text.lines().find_map(|line| line.strip_prefix("MemAvailable:")?.trim().strip_suffix(" kB"));
    kib.and_then(|kib| kib.parse::<u64>().ok()).map_or(u64::MAX, |kib| kib * 1024)
}

/// Writes the film's scenario into the folder, and returns the rig that films it.
///
/// # Errors
///
/// When the scenario cannot be written, or the rig file refuses a value.
pub(super) fn build(plan: &Plan, folder: &Folder) -> Result<Config, Failure> {
    let path = folder.0.join("swing.toml");
    let scenario = toml::to_string(&plan.scene.film()).map_err(|error| Failure::internal(error.to_string()))?;
    std::fs::write(&path, scenario)?;
    Ok(Config::parse(&rig_text(plan, &path, &folder.0), "the rig file of the benchmark")?)
}

/// Returns the rig file. Its recorder waits for a trigger, so that its queue is the ring.
fn rig_text(plan: &Plan, scenario: &Path, shots: &Path) -> String {
    let (rate_hz, step_px) = (plan.rate_hz, plan.step_px);
    let before = plan.ring_frames as f64 - BLOCK_FRAMES - (DECISION_S * rate_hz).ceil();
    let pre_s = (before.max(1.0) / rate_hz).min(MAX_PRE_S);
    let diameter_mm = MM_PER_PX * plan.scene.diameter_px;
    let count = plan.workers.map_or_else(String::new, |count| format!("count = {count}\n"));
    let block = plan.block_frames.map_or_else(String::new, |frames| format!("block_frames = {frames}\n"));
    let mode = if plan.mode == WorkerMode::Latency { "mode = \"latency\"\n" } else { "" };
    format!(
        "[rig]\nname = \"{NAME}\"\n[camera]\nsource = \"simulated\"\nscenario = {:?}\nendless = true\n\
         frame_rate_hz = {rate_hz:?}\n[scale]\nmm_per_px = {MM_PER_PX:?}\n[[body]]\nname = \"ball\"\nkind = \"ball\"\n\
         diameter_mm = {diameter_mm:?}\n[correlation]\nsubset_size_px = {SUBSET_PX}\nstep_px = {step_px}\n\
         [trigger]\nmode = \"software\"\npre_s = {pre_s:?}\n[record]\ndirectory = {:?}\n[workers]\n{count}{block}{mode}",
        scenario.display().to_string(),
        shots.display().to_string(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth::SimulatedFilm;

    #[test]
    fn the_ball_swings_about_the_middle_and_rests_where_the_film_turns() {
        for side_px in [[512, 512], [160, 128], [64, 64]] {
            let scene = Scene::new(side_px);
            let film = scene.film();
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
    fn the_grid_has_about_as_many_subsets_as_wanted() {
        let scene = Scene::new([512, 512]);
        for wanted in [16, 64, 256] {
            let found = scene.closest_grid(wanted).subsets;
            assert!(found.abs_diff(wanted) * 5 <= wanted, "{wanted}: {found}");
        }
    }
}
