//! `[record]`, `[workers]`: what is recorded, and how the work is divided.

use super::check::Table;
use super::error::ConfigError;
use super::raw::{RawRecord, RawWorkers};
use std::path::PathBuf;

/// The compression of a recording's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// No compression, the fastest to write.
    None,
    /// Zstandard: about a quarter smaller for noisy images, several times slower to write.
    Zstd,
}

/// `[record]`: the recordings. Without this table nothing is recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// The folder of the recordings, required; created if missing. A relative path starts at the working directory.
    pub directory: PathBuf,
    /// The compression, `none` or `zstd`, default `none`.
    pub compression: Compression,
    /// Whether the frames are kept, default true. If false, only the results are kept, and the recording cannot be
    /// analysed again.
    pub raw_frames: bool,
    /// The maximum size of the ring of frames in memory, 1048576 (1 MiB) to 1099511627776 bytes (1 TiB). It must hold
    /// `trigger.pre_s`. Default: limited by the machine's memory only.
    pub ring_bytes_max: Option<u64>,
    /// The number of finished recordings of this rig to keep in the folder, 1 to 1000000. The oldest are deleted first.
    /// Default: all.
    pub keep_last: Option<u32>,
    /// The maximum total size of the recordings of this rig in the folder, including the one being written, 1048576 (1 MiB)
    /// to 1125899906842624 bytes (1 PiB). The oldest are deleted until the rest fits, but never the newest finished one.
    /// Other files, results of `analyze` and unfinished recordings are never deleted and do not count. Default: limited
    /// by the disk only.
    pub max_bytes: Option<u64>,
    /// The maximum size of one file, 1048576 (1 MiB) to 1125899906842624 bytes (1 PiB). A larger recording `NAME.mcap`
    /// continues in `NAME_0001.mcap` and so on. Each file is complete by itself. They count as one recording. Default:
    /// one file.
    pub split_bytes: Option<u64>,
}

/// `[workers]`: the division of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Workers {
    /// The number of correlation processes, 0 to 64. Default: one less than the machine has processors, but two if it has
    /// two. Results do not depend on it. With 0, frames are filmed and recorded, but not measured.
    pub count: u32,
    /// The number of frames that a worker measures together, 4 to 256 frames, default 16. Results depend on it, because
    /// each block is measured on its own.
    pub block_frames: u32,
    /// Whether the processes are set up for the most frames per second or for the shortest delay, `throughput` or
    /// `latency`, default `throughput`. Results do not depend on it.
    pub mode: WorkerMode,
}

/// The aim of the processes that measure. Results do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WorkerMode {
    /// The most frames per second: processes sleep until they are woken, at most once per millisecond.
    #[default]
    Throughput,
    /// The shortest time from a frame to its row: each worker stays on a processor of its own, and workers and tracker look
    /// for work every 50 us.
    Latency,
}

/// The default number of frames per block.
///
/// A ball is searched from scratch at the start of a block, which takes five times as long as to track it. Longer blocks save
/// less and less.
pub const DEFAULT_BLOCK_FRAMES: u32 = 64;

/// The maximum number of correlation processes.
const MAX_WORKERS: u32 = 64;

/// Checks the recordings. Their folder is required.
pub(super) fn check_record(table: &Table<'_>, raw: RawRecord) -> Result<Record, ConfigError> {
    let directory = table.single_line("directory", raw.directory)?;
    let words = [("none", Compression::None), ("zstd", Compression::Zstd)];
    Ok(Record {
        directory: directory.ok_or_else(|| table.refuse("directory", "the path of a folder"))?.into(),
        compression: table.choice("compression", raw.compression.as_deref(), &words)?.unwrap_or(Compression::None),
        raw_frames: raw.raw_frames.unwrap_or(true),
        ring_bytes_max: table.integer("ring_bytes_max", raw.ring_bytes_max, 1 << 20..=1 << 40, "bytes")?,
        keep_last: table.integer("keep_last", raw.keep_last, 1..=1_000_000, "recordings")?,
        max_bytes: table.integer("max_bytes", raw.max_bytes, 1 << 20..=1 << 50, "bytes")?,
        split_bytes: table.integer("split_bytes", raw.split_bytes, 1 << 20..=1 << 50, "bytes")?,
    })
}

/// Checks the division of the work. The default number of workers depends on this machine.
pub(super) fn check_workers(table: &Table<'_>, raw: &RawWorkers) -> Result<Workers, ConfigError> {
    let modes = [("throughput", WorkerMode::Throughput), ("latency", WorkerMode::Latency)];
    Ok(Workers {
        count: table.integer("count", raw.count, 0..=i64::from(MAX_WORKERS), "")?.unwrap_or_else(default_worker_count),
        block_frames: table
            .integer("block_frames", raw.block_frames, 4..=256, "frames")?
            .unwrap_or(DEFAULT_BLOCK_FRAMES),
        mode: table.choice("mode", raw.mode.as_deref(), &modes)?.unwrap_or_default(),
    })
}

/// Returns the default number of workers of this machine.
///
/// One processor is for the camera, the tracker and the recorder. Of two, none is, because these processes are idle most of
/// the time and a collision is reported twice as soon.
fn default_worker_count() -> u32 {
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    u32::try_from(processors.min(2).max(processors - 1)).map_or(MAX_WORKERS, |count| count.min(MAX_WORKERS))
}
