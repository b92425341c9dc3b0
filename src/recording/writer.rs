//! Writer of a recording.

mod info;
mod options;
mod rows;
mod split_state;

use super::container::{Compression, Container, Payload, Settings};
use super::disk_sync::DiskSync;
use super::part_file::PartFile;
use super::record::{Channel, MessageHeader, Schema};
use super::row_batch::Batch;
use super::schema::Topic;
use super::{RecordingError, VIEW_KEY, frame_message, part_file};
use crate::image::Frame;
use crate::interrupt::{self, Unfinished};
pub use info::{RecordingInfo, ViewInfo};
pub use options::{FinishedRecording, WriterOptions};
use split_state::SplitState;
use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Bytes written between two syncs to the disk.
const SYNC_BYTES: u64 = 64 << 20;
/// Recorded time between two syncs to the disk, however little was written.
const SYNC_NS: u64 = 1_000_000_000;
/// Maximum recorded time that small messages are held back, so that a crash loses little.
const BATCH_NS: u64 = 100_000_000;
/// Size at which held-back rows are written, bytes.
const ROWS_BYTES: usize = 1 << 20;
/// Size at which held-back fields are written, bytes.
const FIELDS_BYTES: usize = 4 << 20;

/// The channels of a camera before its first message.
const NO_CHANNELS: [Option<u16>; Topic::ALL.len()] = [None; Topic::ALL.len()];

/// Writes a recording as `<path>.part` and renames it when it is complete.
///
/// Frames, fields and all other rows go into separate chunks. Every call may block on the disk. A writer that is
/// dropped without [`finish`](Self::finish) leaves the part file, which is readable up to the last call.
///
/// # Examples
///
/// ```
/// use ricochet::image::{Frame, FrameMeta};
/// use ricochet::recording::{Recording, RecordingInfo, RecordingWriter, WriterOptions};
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("shot.mcap");
///
/// let mut writer = RecordingWriter::create(&path, &RecordingInfo::default(), &WriterOptions::default())?;
/// let meta = FrameMeta { width_px: 4, height_px: 2, stride_bytes: 4, ..FrameMeta::default() };
/// for sequence in 0..3 {
///     // The time of a frame is that of the start of its exposure.
///     let meta = FrameMeta { sequence, stamp_ns: 100_000 * sequence, ..meta };
///     writer.write_frame(&Frame { meta, bytes: &[50; 8] })?;
/// }
/// assert_eq!(writer.finish()?.frames, 3);
/// assert_eq!(Recording::open(&path)?.frame_rate_hz()?, Some(10_000.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct RecordingWriter {
    path: PathBuf,
    part: PathBuf,
    /// The note that removes the part file if a signal ends the program.
    unfinished: Unfinished,
    /// `None` when the file is complete.
    container: Option<Container>,
    /// Whether frames are written before their chunk ends.
    is_direct: bool,
    handle: File,
    disk_sync: DiskSync,
    /// The channels of each camera by topic, once they are written.
    channels: Vec<[Option<u16>; Topic::ALL.len()]>,
    /// Names of the additional cameras.
    views: Vec<String>,
    /// The camera whose frames and rows are written: 0 for the first, then those of `views`.
    camera: usize,
    rows: Batch,
    fields: Batch,
    scratch: Vec<u8>,
    frames: u64,
    /// The number of frames that are completely in the file.
    safe_frames: u64,
    unsynced_bytes: u64,
    /// Stamp of the frame before the last sync.
    synced_ns: Option<u64>,
    split: Option<SplitState>,
    /// Whether the current file has messages.
    has_messages: bool,
}

impl RecordingWriter {
    /// Creates the part file of the recording `path` and writes its description.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Refused`] when the file or its part exists; [`RecordingError::Io`] when the system fails.
    pub fn create(path: &Path, info: &RecordingInfo, options: &WriterOptions) -> Result<Self, RecordingError> {
        let mut writer = Self::start(path, part_file::part_path(path), options)?;
        writer.views = info.views.iter().map(|view| view.name.clone()).collect();
        writer.channels = vec![NO_CHANNELS; 1 + info.views.len()];
        writer.split = options.split_bytes.map(|bytes| SplitState::new(path, bytes, info, options));
        let from_file = writer.split.as_ref().map(SplitState::info);
        writer.describe(from_file.as_ref().unwrap_or(info)).map(|()| writer)
    }

    /// Creates the part file of a recording without a description.
    pub(super) fn start(path: &Path, part: PathBuf, options: &WriterOptions) -> Result<Self, RecordingError> {
        let ((container, handle), unfinished) = open_part(path, &part, options)?;
        Ok(Self {
            path: path.to_path_buf(),
            part,
            unfinished,
            container: Some(container),
            is_direct: options.compression == Compression::None,
            handle,
            disk_sync: DiskSync::default(),
            channels: vec![NO_CHANNELS],
            views: Vec::new(),
            camera: 0,
            rows: Batch::default(),
            fields: Batch::default(),
            scratch: Vec::new(),
            frames: 0,
            safe_frames: 0,
            unsynced_bytes: 0,
            synced_ns: None,
            split: None,
            has_messages: false,
        })
    }

    /// Creates the next file, without a description, after the current one is complete.
    pub(super) fn begin_file(
        &mut self,
        path: &Path,
        part: PathBuf,
        options: &WriterOptions,
    ) -> Result<(), RecordingError> {
        let ((container, handle), unfinished) = open_part(path, &part, options)?;
        (self.container, self.handle, self.part, self.unfinished) = (Some(container), handle, part, unfinished);
        (self.path, self.disk_sync) = (path.to_path_buf(), DiskSync::default());
        (self.channels, self.has_messages) = (vec![NO_CHANNELS; 1 + self.views.len()], false);
        Ok(())
    }

    /// Writes the description at the beginning of the file; removes the file if that fails.
    pub(super) fn describe(&mut self, info: &RecordingInfo) -> Result<(), RecordingError> {
        // Metadata after a channel would close a chunk without messages, which some readers refuse.
        let described = self.describe_all(info);
        if described.is_err() {
            // The file has no message yet, so nothing is lost.
            let _ = std::fs::remove_file(&self.part);
        }
        described
    }

    /// Writes metadata, configurations and attachments of all cameras, and ends the chunk.
    fn describe_all(&mut self, info: &RecordingInfo) -> Result<(), RecordingError> {
        let mut entries = info::with_bodies(&info.metadata, &info.bodies);
        for (index, view) in info.views.iter().enumerate() {
            entries.insert(format!("{VIEW_KEY}.{index}"), view.name.clone());
        }
        self.write_metadata(super::METADATA_NAME, entries)?;
        for view in &info.views {
            let name = format!("{}/{}", super::METADATA_NAME, view.name);
            self.write_metadata(&name, info::with_bodies(&view.metadata, &view.bodies))?;
            let name = format!("{}/{}", view.name, super::CONFIG_NAME);
            self.attach(&name, "application/toml", view.config_toml.as_bytes())?;
        }
        if !info.config_toml.is_empty() {
            self.attach(super::CONFIG_NAME, "application/toml", info.config_toml.as_bytes())?;
        }
        for (name, media_type, content) in &info.attachments {
            self.attach(name, media_type, content)?;
        }
        self.flush()
    }

    /// Writes a metadata record.
    pub(super) fn write_metadata(
        &mut self,
        name: &str,
        entries: BTreeMap<String, String>,
    ) -> Result<(), RecordingError> {
        self.with_container(|container| container.write_metadata(name, &entries))
    }

    /// Writes an attachment with this media type.
    pub(super) fn attach(&mut self, name: &str, media_type: &str, content: &[u8]) -> Result<(), RecordingError> {
        self.with_container(|container| container.attach(name, media_type, content))
    }

    /// Writes a frame, its information first. Starts a sync once enough was written or enough time was recorded.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Refused`] when the bytes do not fit the shape; [`RecordingError::Io`] when the disk is full or
    /// gone.
    pub fn write_frame(&mut self, frame: &Frame<'_>) -> Result<(), RecordingError> {
        let meta = &frame.meta;
        let row_bytes = u64::from(meta.width_px) * meta.format.bytes_per_pixel() as u64;
        if u64::from(meta.stride_bytes) < row_bytes || frame.bytes.len() != meta.size_bytes() {
            return Err(RecordingError::refused(
                &self.path,
                format!(
                    "frame {}: {} bytes with stride {} are not {}x{} {}",
                    meta.sequence,
                    frame.bytes.len(),
                    meta.stride_bytes,
                    meta.width_px,
                    meta.height_px,
                    meta.format.as_str()
                ),
            ));
        }
        self.write_due_batches(meta.stamp_ns)?;
        self.make_room(frame_message::expected_bytes(frame))?;
        let mut message = std::mem::take(&mut self.scratch);
        let body_crc = crc32fast::hash(frame.bytes);
        frame_message::encode_info(frame, body_crc, &mut message);
        let mut result =
            self.write_message(Topic::FrameInfo, meta.sequence, meta.stamp_ns, &Payload::from_bytes(&message));
        if result.is_ok() {
            frame_message::encode_image_head(frame, &mut message);
            let image = Payload { head: &message, body: frame.bytes, body_crc };
            result = self.write_message(Topic::Image, meta.sequence, meta.stamp_ns, &image);
        }
        self.scratch = message;
        result?;
        self.frames += 1;
        self.count_safe(frame.bytes.len());
        let synced_ns = *self.synced_ns.get_or_insert(meta.stamp_ns);
        if self.unsynced_bytes >= SYNC_BYTES || meta.stamp_ns.saturating_sub(synced_ns) >= SYNC_NS {
            self.synced_ns = Some(meta.stamp_ns);
            return self.start_sync();
        }
        Ok(())
    }

    /// Selects the camera of the following frames and rows: 0 is the first, then the additional ones in order.
    ///
    /// # Panics
    ///
    /// When `camera` exceeds the number of additional cameras.
    pub fn select_camera(&mut self, camera: usize) {
        assert!(camera <= self.views.len(), "camera {camera} of {}", 1 + self.views.len());
        self.camera = camera;
    }

    /// Returns the path of the part file.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn part(&self) -> &Path {
        &self.part
    }

    /// Returns the size of the files so far, bytes, without messages that are held back.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn written_bytes(&self) -> u64 {
        let finished = self.split.as_ref().map_or(0, |split| split.finished_bytes);
        finished + self.handle.metadata().map_or(0, |about| about.len())
    }

    /// Returns the final name of the recording; that of its first file when it is split.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn path(&self) -> &Path {
        self.split.as_ref().map_or(&self.path, |split| split.first())
    }

    /// Returns the number of frames added so far.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Returns the number of frames that stay readable if this process dies; of a removed part file none.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn safe_frames(&self) -> u64 {
        let finished = self.split.as_ref().map_or(0, |split| split.finished_frames);
        if part_file::is_in_place(&self.part, &self.handle) { self.safe_frames } else { finished }
    }

    /// Writes the buffered end of the last frame; for a pause without another frame.
    ///
    /// The end of each frame is buffered until the next one, so that writes are large and aligned.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Io`] when the disk is full or gone.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn write_buffered(&mut self) -> Result<(), RecordingError> {
        self.with_container(Container::write_buffered)?;
        self.count_safe(0);
        Ok(())
    }

    /// Writes everything that is held back and syncs it to the disk.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Io`] when the disk is full or gone, or the file was removed.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn sync(&mut self) -> Result<(), RecordingError> {
        self.start_sync()?;
        self.disk_sync.wait().map_err(|error| RecordingError::io("sync", &self.part, error))
    }

    /// Completes the recording: index, footer, sync, final name, sync of the directory.
    ///
    /// # Errors
    ///
    /// [`RecordingError`] with the step that failed; the part file stays.
    pub fn finish(mut self) -> Result<FinishedRecording, RecordingError> {
        self.write_batches()?;
        let last = self.complete()?;
        let (path, bytes) = match &self.split {
            Some(split) => (split.first().to_path_buf(), split.finished_bytes + last),
            None => (self.path.clone(), last),
        };
        Ok(FinishedRecording { path, frames: self.frames, bytes })
    }
}

impl RecordingWriter {
    /// Completes the current file, gives it its final name and returns its size, bytes.
    pub(super) fn complete(&mut self) -> Result<u64, RecordingError> {
        if let Some(container) = self.container.take() {
            container.finish().map_err(|error| RecordingError::io("write", &self.part, error))?;
        }
        self.check_in_place()?;
        self.unsynced_bytes = 0;
        let io = |error| RecordingError::io("sync", &self.part, error);
        self.disk_sync.wait().and_then(|()| self.handle.sync_all()).map_err(io)?;
        let bytes = self.handle.metadata().map_err(io)?.len();
        part_file::publish(&self.path, &self.part)?;
        Ok(bytes)
    }

    /// Writes everything that is held back and starts a sync in the background; the next sync returns its error.
    fn start_sync(&mut self) -> Result<(), RecordingError> {
        self.write_batches()?;
        self.flush()?;
        self.unsynced_bytes = 0;
        self.check_in_place()?;
        self.disk_sync.start(&self.handle).map_err(|error| RecordingError::io("sync", &self.part, error))
    }

    /// Writes the rows and fields that are held back, if either are large or old enough.
    fn write_due_batches(&mut self, now_ns: u64) -> Result<(), RecordingError> {
        if self.rows.is_due(now_ns, ROWS_BYTES, BATCH_NS) || self.fields.is_due(now_ns, FIELDS_BYTES, BATCH_NS) {
            return self.write_batches();
        }
        Ok(())
    }

    /// Writes the rows and fields that are held back, each kind in chunks of its own.
    fn write_batches(&mut self) -> Result<(), RecordingError> {
        for mut batch in [std::mem::take(&mut self.rows), std::mem::take(&mut self.fields)] {
            if batch.is_empty() {
                continue;
            }
            self.make_room(batch.expected_bytes())?;
            self.flush()?;
            let camera = self.camera;
            for message in batch.iter() {
                self.camera = message.camera;
                self.write_message(message.topic, 0, message.log_time_ns, &Payload::from_bytes(message.bytes))?;
            }
            self.camera = camera;
            self.flush()?;
            batch.clear();
        }
        Ok(())
    }

    /// Ends the chunk and writes it with everything buffered.
    pub(super) fn flush(&mut self) -> Result<(), RecordingError> {
        self.with_container(Container::flush)?;
        self.safe_frames = self.frames;
        Ok(())
    }

    /// Updates the number of frames that are completely in the file, after a frame of `bytes` or, with 0, a flush.
    fn count_safe(&mut self, bytes: usize) {
        let buffered = self.container.as_ref().map_or(0, Container::buffered_bytes);
        match buffered {
            _ if !self.is_direct => {}
            0 => self.safe_frames = self.frames,
            // Only a part of the last frame is buffered.
            buffered if buffered < bytes => self.safe_frames = self.frames - 1,
            _ => {}
        }
    }

    /// Checks that the part file still has its name.
    fn check_in_place(&self) -> Result<(), RecordingError> {
        if part_file::is_in_place(&self.part, &self.handle) {
            return Ok(());
        }
        let gone = std::io::Error::new(std::io::ErrorKind::NotFound, "the file was removed while it was written");
        Err(RecordingError::io("write", &self.part, gone))
    }

    /// Writes a message of the selected camera on a topic, at a time in ns since the Unix epoch.
    fn write_message(
        &mut self,
        topic: Topic,
        sequence: u64,
        time_ns: u64,
        message: &Payload<'_>,
    ) -> Result<(), RecordingError> {
        let channel = self.register_topic(topic)?;
        // The header has room for the low half only. FrameInfo has the whole number.
        let sequence = (sequence & u64::from(u32::MAX)) as u32;
        let header = MessageHeader { channel, sequence, log_time_ns: time_ns, publish_time_ns: time_ns };
        self.unsynced_bytes += message.len() as u64;
        self.has_messages = true;
        if let Some(split) = &mut self.split {
            split.add(message.len());
        }
        self.with_container(|container| container.write_message(&header, message))
    }

    /// Returns the channel of a topic of the selected camera, written with its schema if it is new.
    fn register_topic(&mut self, topic: Topic) -> Result<u16, RecordingError> {
        let camera = self.camera;
        if let Some(id) = self.channels[camera][topic as usize] {
            return Ok(id);
        }
        let schema = Schema {
            name: topic.schema_name().into(),
            encoding: "protobuf".into(),
            data: topic.schema_data().into_owned(),
        };
        if let Some(split) = &mut self.split {
            // The schema is written before the messages and repeated at the end.
            split.add(2 * schema.data.len());
        }
        let prefix = camera.checked_sub(1).map_or_else(String::new, |view| format!("/{}", self.views[view]));
        let id = self.with_container(|container| {
            let (topic, encoding) = (prefix + topic.as_str(), schema.encoding.clone());
            let schema = container.register_schema(&schema)?;
            container.register_channel(&Channel { schema, topic, encoding, metadata: BTreeMap::new() })
        })?;
        self.channels[camera][topic as usize] = Some(id);
        Ok(id)
    }

    /// Writes a message of another file byte by byte, on the channel of this file that its header names.
    pub(super) fn copy_message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), RecordingError> {
        self.unsynced_bytes += data.len() as u64;
        self.with_container(|container| container.write_message(header, &Payload::from_bytes(data)))
    }

    /// Counts a copied message as a frame.
    pub(super) fn count_frame(&mut self) {
        self.frames += 1;
    }

    /// Runs an action on the container of the current file.
    ///
    /// # Errors
    ///
    /// The error of the action; [`RecordingError::Refused`] after [`complete`](Self::complete).
    pub(super) fn with_container<T>(
        &mut self,
        action: impl FnOnce(&mut Container) -> io::Result<T>,
    ) -> Result<T, RecordingError> {
        match &mut self.container {
            Some(container) => action(container).map_err(|error| RecordingError::io("write", &self.part, error)),
            None => Err(RecordingError::refused(&self.path, "the recording is finished")),
        }
    }
}

impl Drop for RecordingWriter {
    /// Writes what is held back. An error here cannot be returned.
    fn drop(&mut self) {
        if self.container.is_some() {
            let _ = self.write_batches().and_then(|()| self.flush());
        }
    }
}

/// Creates a part file and returns its container, a second handle of it for syncs, and its note for signals.
fn open_part(
    path: &Path,
    part: &Path,
    options: &WriterOptions,
) -> Result<((Container, File), Unfinished), RecordingError> {
    let (file, unfinished) = interrupt::file(part, || part_file::create(path, part))?;
    let handle = file.try_clone().map_err(|error| RecordingError::io("open", part, error))?;
    let settings = Settings { profile: "", compression: options.compression, chunk_bytes: options.chunk_bytes };
    let container = Container::create(PartFile::new(file), settings);
    Ok(((container.map_err(|error| RecordingError::io("write", part, error))?, handle), unfinished))
}
