//! `[record]`, `[workers]`: what is kept, and who does the work.

use super::check::Table;
use super::error::ConfigError;
use super::raw::{RawRecord, RawWorkers};
use std::path::PathBuf;

/// How the image chunks of a recording are packed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compression {
    /// As they are: the fastest to write.
    None,
    /// Zstandard: about a quarter smaller for noisy pictures, several times slower to write.
    Zstd,
}

/// `[record]`: where recordings go; without this table nothing is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Folder of the recordings, made when missing; must be given. A relative path starts at the working directory.
    pub directory: PathBuf,
    /// `none` or `zstd`, default `none`.
    pub compression: Compression,
    /// Whether the frames themselves are kept, default true; false keeps only what was measured, and such a
    /// recording cannot be analysed again.
    pub raw_frames: bool,
    /// Largest size of the ring of frames in memory, 1048576 (1 MiB) to 1099511627776 bytes (1 TiB). `trigger.pre_s`
    /// that does not fit is refused. Left out: no bound but the machine's memory.
    pub ring_bytes_max: Option<u64>,
    /// How many finished recordings of this rig stay in the folder, 1 to 1000000: when one more is finished, the
    /// oldest is removed. Left out: all.
    pub keep_last: Option<u32>,
    /// Bytes that the recordings of this rig may take in the folder, the one being written included, 1048576 (1 MiB)
    /// to 1125899906842624 (1 PiB): the oldest are removed until the rest fits. The newest finished one stays
    /// whatever its size. Other files, results of `analyze` and unfinished recordings are never removed and do not
    /// count. Left out: no bound but the disk.
    pub max_bytes: Option<u64>,
    /// Largest size of one file, 1048576 (1 MiB) to 1125899906842624 bytes (1 PiB): a recording that is larger goes on
    /// in a next file, `NAME.mcap` in `NAME_0001.mcap` and so on, each whole by itself. They count as one recording.
    /// Left out: one file.
    pub split_bytes: Option<u64>,
}

/// `[workers]`: how the measuring is shared out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Workers {
    /// Number of correlation processes, 0 to 64; default: one less than the machine has processors, but two where it has two.
    /// Results do not depend on it. With 0 nothing is measured: frames are only filmed and recorded.
    pub count: u32,
    /// Frames a worker measures in one go, 4 to 256 frames, default 16. Results depend on it, which is why it stands
    /// in the file: each block is measured on its own.
    pub block_frames: u32,
}

const WORKERS_MAX: u32 = 64;

pub(super) fn record(table: &Table<'_>, raw: RawRecord) -> Result<Record, ConfigError> {
    let directory = table.filled("directory", raw.directory)?;
    let words = [("none", Compression::None), ("zstd", Compression::Zstd)];
    Ok(Record {
        directory: directory.ok_or_else(|| table.refuse("directory", "the path of a folder"))?.into(),
        compression: table.choice("compression", raw.compression.as_deref(), &words)?.unwrap_or(Compression::None),
        raw_frames: raw.raw_frames.unwrap_or(true),
        ring_bytes_max: table.whole("ring_bytes_max", raw.ring_bytes_max, 1 << 20..=1 << 40, "bytes")?,
        keep_last: table.whole("keep_last", raw.keep_last, 1..=1_000_000, "recordings")?,
        max_bytes: table.whole("max_bytes", raw.max_bytes, 1 << 20..=1 << 50, "bytes")?,
        split_bytes: table.whole("split_bytes", raw.split_bytes, 1 << 20..=1 << 50, "bytes")?,
    })
}

pub(super) fn workers(table: &Table<'_>, raw: &RawWorkers) -> Result<Workers, ConfigError> {
    Ok(Workers {
        count: table.whole("count", raw.count, 0..=i64::from(WORKERS_MAX), "")?.unwrap_or_else(count_for_this_machine),
        block_frames: table.whole("block_frames", raw.block_frames, 4..=256, "frames")?.unwrap_or(16),
    })
}

/// One processor is left to the camera, the tracker and the recorder; of two, none, since these are idle most of the time
/// and a collision is told half as late.
fn count_for_this_machine() -> u32 {
    let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    u32::try_from(processors.min(2).max(processors - 1)).map_or(WORKERS_MAX, |count| count.min(WORKERS_MAX))
}
