//! The rig that is timed: its film, its rig file and its folder.

use super::Plan;
use crate::bus;
use crate::config::{Config, DEFAULT_BLOCK_FRAMES, WorkerMode};
use crate::failure::Failure;
use std::path::{Path, PathBuf};

/// The rig's name. It is fixed, so that two benchmarks at once, which would disturb each other, are refused.
const NAME: &str = "bench-live";
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

/// Returns the ring that the free memory allows by default for frames of this size, at most `wanted` frames.
///
/// The recorder may hold as many frames again while it writes, so a rig needs twice the memory of its ring.
pub(super) fn default_ring_frames(frame_bytes: u64, wanted: u64) -> u64 {
    let free_bytes = bus::free_bytes().min(available_bytes());
    wanted.min(free_bytes / MEMORY_SHARE / (2 * (frame_bytes + HEADER_BYTES)))
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
    let scenario =
        toml::to_string(&plan.scene.film(MM_PER_PX)).map_err(|error| Failure::internal(error.to_string()))?;
    std::fs::write(&path, scenario)?;
    Ok(Config::parse(&rig_text(plan, &path, &folder.0), "the rig file of the benchmark")?)
}

/// Returns the rig file. Its recorder waits for a trigger, so that its queue is the ring.
fn rig_text(plan: &Plan, scenario: &Path, shots: &Path) -> String {
    let rate_hz = plan.rate_hz;
    let before = plan.ring_frames as f64 - BLOCK_FRAMES - (DECISION_S * rate_hz).ceil();
    let pre_s = (before.max(1.0) / rate_hz).min(MAX_PRE_S);
    let body = plan.scene.rig_tables(MM_PER_PX, plan.step_px);
    let count = plan.workers.map_or_else(String::new, |count| format!("count = {count}\n"));
    let block = plan.block_frames.map_or_else(String::new, |frames| format!("block_frames = {frames}\n"));
    let lag = plan.lag_frames.map_or_else(String::new, |frames| format!("[velocity]\nlag_frames = {frames}\n"));
    let mode = if plan.mode == WorkerMode::Latency { "mode = \"latency\"\n" } else { "" };
    format!(
        "[rig]\nname = \"{NAME}\"\n[camera]\nsource = \"simulated\"\nscenario = {:?}\nendless = true\n\
         frame_rate_hz = {rate_hz:?}\n[scale]\nmm_per_px = {MM_PER_PX:?}\n{body}{lag}[trigger]\nmode = \"software\"\npre_s = {pre_s:?}\n[record]\ndirectory = {:?}\n[workers]\n{count}{block}{mode}",
        scenario.display().to_string(),
        shots.display().to_string(),
    )
}
