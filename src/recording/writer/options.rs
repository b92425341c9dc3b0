//! The options of a writer, and the recording that it returns.

use crate::recording::Compression;
use std::path::PathBuf;

/// Options of a recording writer.
///
/// # Examples
///
/// ```
/// use ricochet::image::{Frame, FrameMeta};
/// use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("shot.mcap");
///
/// // Begins a next file after 100 000 bytes.
/// let options = WriterOptions { split_bytes: Some(100_000), ..WriterOptions::default() };
/// let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &options)?;
/// let meta = FrameMeta { width_px: 256, height_px: 256, stride_bytes: 256, ..FrameMeta::default() };
/// for sequence in 0..4 {
///     let meta = FrameMeta { sequence, stamp_ns: 1_000_000 * sequence, ..meta };
///     writer.write_frame(&Frame { meta, bytes: &[50; 256 * 256] })?;
/// }
/// let recording = Recording::open(&writer.finish()?.path)?;
/// assert!(recording.files().count() > 1);
/// assert_eq!(recording.frame_count(), 4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriterOptions {
    /// The compression of chunks.
    pub compression: Compression,
    /// Size at which a chunk is closed, bytes. A reader that seeks loads one chunk.
    pub chunk_bytes: u64,
    /// Maximum size of a file, bytes; then the recording continues in a next one. A larger message exceeds it.
    pub split_bytes: Option<u64>,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self { compression: Compression::None, chunk_bytes: 1 << 20, split_bytes: None }
    }
}

/// A finished recording.
///
/// # Examples
///
/// ```
/// use ricochet::recording::{RecordingInfo, RecordingWriter, WriterOptions};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("shot.mcap");
///
/// let writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default())?;
/// let finished = writer.finish()?;
/// assert_eq!((&finished.path, finished.frames), (&path, 0));
/// assert_eq!(finished.bytes, std::fs::metadata(&path)?.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FinishedRecording {
    /// Its final name; that of the first file when it was split.
    pub path: PathBuf,
    /// The number of frames in it.
    pub frames: u64,
    /// Its size, all files together.
    pub bytes: u64,
}
