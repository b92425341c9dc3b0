//! The frames of a recording.

use super::messages::{Message, Messages};
use super::{RecordedFile, Recording, compressed, ros2};
use crate::image::{FrameMeta, PixelFormat};
use crate::recording::schema::proto;
use crate::recording::{RecordingError, Topic};
use crate::results::FrameCoding;
use bytes::Bytes;
use foxglove::messages::RawImage;
use prost::Message as _;
use std::sync::Arc;

/// The maximum number of a frame, so that counting on never overflows.
const MAX_SEQUENCE: u64 = 1 << 62;

/// Frames in the order of their time, with one chunk in memory at a time.
///
/// Frames of our own files have their full header. Those of other programs are numbered from 0, and their stamp is the
/// timestamp of the image, or its log time without one.
///
/// # Examples
///
/// ```
/// use ricochet::image::{Frame, Image};
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
///
/// let mut frames = recording.frames()?;
/// frames.skip_frames(98);
/// assert!(frames.left() >= 2);
/// let mut image = Image::default();
/// for frame in frames {
///     let (meta, bytes) = frame?;
///     assert!(meta.sequence >= 98);
///     Frame { meta, bytes: &bytes }.unpack(&mut image)?;
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Frames {
    messages: Messages,
    /// The channels with frame information, by file.
    info_channels: Vec<Vec<u16>>,
    /// Sequence, log time and content of the last frame information.
    info: Option<(u32, u64, proto::FrameInfo)>,
    /// The number of the last frame that was returned.
    last: Option<FrameNumber>,
    index: u64,
}

/// The number of a frame as its file states it.
#[derive(Debug, Clone, Copy)]
struct FrameNumber {
    file: u32,
    epoch: u32,
    sequence: u64,
}

impl FrameNumber {
    /// Whether no camera gives this number after the number `last`: numbers rise within an epoch, and epochs never
    /// fall.
    fn contradicts(&self, last: &Self) -> bool {
        self.epoch < last.epoch || (self.epoch == last.epoch && self.sequence <= last.sequence)
    }
}

impl Recording {
    /// Whether the messages of this channel are images.
    pub(in super::super) fn is_image(&self, channel: u16) -> bool {
        self.inner.image_kind(channel).is_some()
    }

    /// Returns the number of frames in all files; a file without exactly one image topic counts 0.
    pub fn frame_count(&self) -> u64 {
        self.all_files().map(|inner| inner.frame_count()).sum()
    }

    /// Returns an iterator over the frames.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when there is no image topic, more than one, or no frame in it. The iterator returns
    /// an error for a damaged chunk, and for a frame with an unsupported size or encoding.
    pub fn frames(&self) -> Result<Frames, RecordingError> {
        let inner = &self.inner;
        let mut files = Vec::new();
        let mut info_channels = Vec::new();
        for inner in self.all_files() {
            let mut channels = match inner.image_channels() {
                Ok(channels) => channels,
                // One of several files may have rows only.
                Err(_) if inner.frame_count() < self.frame_count() => Vec::new(),
                Err(error) => return Err(error),
            };
            // Only our own files have frame information; elsewhere a topic of that name has another meaning.
            let info = if inner.is_ours() { inner.channels_of(Topic::FrameInfo)? } else { Vec::new() };
            channels.extend(&info);
            files.push((Arc::clone(inner), channels));
            info_channels.push(info);
        }
        if self.frame_count() == 0 {
            let cut = self.truncated().map(|reason| format!(" ({reason})")).unwrap_or_default();
            return Err(inner.invalid(format!("it has no frames{cut}")));
        }
        Ok(Frames {
            messages: Messages::new(files)?.with_hidden_checked(),
            info_channels,
            info: None,
            last: None,
            index: 0,
        })
    }

    /// Returns the header of the first frame.
    ///
    /// # Errors
    ///
    /// The errors of [`frames`](Self::frames).
    pub fn first_frame(&self) -> Result<FrameMeta, RecordingError> {
        let first = self.frames()?.next_shared();
        Ok(first.ok_or_else(|| self.inner.invalid("it has no frames"))??.0)
    }

    /// Returns the header of the last frame; of a file that was cut off, the last complete one of the last two.
    ///
    /// # Errors
    ///
    /// The errors of [`frames`](Self::frames).
    pub fn last_frame(&self) -> Result<FrameMeta, RecordingError> {
        let mut frames = self.frames()?;
        let messages = frames.messages_per_frame();
        frames.index = (frames.messages.len() as u64 / messages).saturating_sub(1);
        if self.truncated().is_some() {
            // The last pair may be incomplete, so the last complete one of two pairs counts.
            frames.messages.keep_last(2 * messages as usize);
            let last = std::iter::from_fn(|| frames.next_shared()).filter_map(Result::ok).last();
            return Ok(last.ok_or_else(|| self.inner.invalid("it has no complete frame at its end"))?.0);
        }
        frames.messages.keep_last(messages as usize);
        let last = frames.next_shared();
        Ok(last.ok_or_else(|| self.inner.invalid("it has no frames"))??.0)
    }

    /// Returns the mean frame rate from the first to the last frame, with lost frames counted where they are known.
    ///
    /// `None` for a single frame, when the camera was reopened in between, or when numbers or stamps do not rise.
    ///
    /// # Errors
    ///
    /// The errors of [`frames`](Self::frames).
    pub fn frame_rate_hz(&self) -> Result<Option<f64>, RecordingError> {
        let (first, last) = (self.first_frame()?, self.last_frame()?);
        if first.epoch != last.epoch || last.sequence <= first.sequence || last.stamp_ns <= first.stamp_ns {
            return Ok(None);
        }
        let (frames, ns) = (last.sequence - first.sequence, last.stamp_ns - first.stamp_ns);
        Ok(Some(frames as f64 * 1e9 / ns as f64))
    }

    /// Returns the exposure time from the metadata, us; 0 when they have none that is finite and not negative.
    pub fn exposure_us(&self) -> f64 {
        let recorded = self.metadata().get("exposure_us").and_then(|text| text.parse().ok());
        recorded.filter(|exposure_us: &f64| exposure_us.is_finite() && *exposure_us >= 0.0).unwrap_or(0.0)
    }

    /// Returns the coding of the film that the frames come from.
    pub fn coding(&self) -> FrameCoding {
        FrameCoding::of_metadata(self.metadata())
    }
}

/// The encoding of an image topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ImageKind {
    /// `foxglove.RawImage` in protobuf.
    Foxglove,
    /// `sensor_msgs/msg/Image` in CDR.
    Ros2,
    /// `foxglove.CompressedImage` in protobuf.
    FoxgloveCompressed,
    /// `sensor_msgs/msg/CompressedImage` in CDR.
    Ros2Compressed,
}

impl RecordedFile {
    /// Returns the number of images in this file; 0 when there is not exactly one image topic.
    pub(super) fn frame_count(&self) -> u64 {
        let channels = self.image_channels().unwrap_or_default();
        channels.iter().filter_map(|id| self.counts.get(id)).sum()
    }

    /// Returns the encoding of the images on a channel; `None` when its messages are no images.
    fn image_kind(&self, channel: u16) -> Option<ImageKind> {
        let channel = self.structure.channels.get(&channel)?;
        match (channel.encoding.as_str(), self.schema_name(channel.schema)) {
            ("protobuf", schema) if schema == Topic::Image.schema_name() => Some(ImageKind::Foxglove),
            ("cdr", ros2::SCHEMA_NAME) => Some(ImageKind::Ros2),
            ("protobuf", compressed::SCHEMA_NAME) => Some(ImageKind::FoxgloveCompressed),
            ("cdr", ros2::COMPRESSED_SCHEMA_NAME) => Some(ImageKind::Ros2Compressed),
            _ => None,
        }
    }

    /// Returns the channels of the image topic, which must be the only one. In our own files it is that of the first
    /// camera.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when there is no image topic or more than one.
    pub(super) fn image_channels(&self) -> Result<Vec<u16>, RecordingError> {
        let ours = self.is_ours();
        let images: Vec<_> = (self.structure.channels.iter())
            .filter(|(id, _)| self.image_kind(**id).is_some())
            .filter(|(_, c)| !ours || c.topic == Topic::Image.as_str())
            .collect();
        let Some((_, first)) = images.first() else {
            let topics = self.structure.channels.values();
            let mut held: Vec<_> = topics.map(|c| format!("{} ({})", c.topic, self.schema_name(c.schema))).collect();
            held.sort();
            let held = if held.is_empty() { "no topics".into() } else { held.join(", ") };
            let known = "foxglove.RawImage, sensor_msgs/msg/Image or CompressedImage of either";
            return Err(self.invalid(format!("no image topic ({known}); it has {held}")));
        };
        if images.iter().any(|(_, c)| c.topic != first.topic) {
            let mut topics: Vec<_> = images.iter().map(|(_, c)| c.topic.as_str()).collect();
            topics.sort_unstable();
            topics.dedup();
            return Err(self.invalid(format!("more than one image topic: {}", topics.join(", "))));
        }
        Ok(images.iter().map(|(id, _)| **id).collect())
    }
}

impl Frames {
    /// Returns the number of messages per frame: 2 in our own files, information and image, and 1 in others.
    fn messages_per_frame(&self) -> u64 {
        if self.info_channels.iter().all(Vec::is_empty) { 1 } else { 2 }
    }

    /// Returns an upper bound of the number of frames left.
    pub fn left(&self) -> usize {
        self.messages.len().div_ceil(self.messages_per_frame() as usize)
    }

    /// Skips `count` frames without reading them; beyond the end, all.
    ///
    /// The next frame reads one chunk.
    pub fn skip_frames(&mut self, count: u64) {
        let messages = self.messages_per_frame().saturating_mul(count);
        self.messages.skip_next(usize::try_from(messages).unwrap_or(usize::MAX));
        self.index = self.index.saturating_add(count);
        (self.info, self.last) = (None, None);
    }

    /// Returns the next frame; its pixels share the memory of their chunk. `None` after the last.
    pub(crate) fn next_shared(&mut self) -> Option<Result<(FrameMeta, Bytes), RecordingError>> {
        loop {
            let message = match self.messages.next()? {
                Ok(message) => message,
                Err(error) => return Some(Err(error)),
            };
            let file = message.file;
            let frame = if self.info_channels[file as usize].contains(&message.header.channel) {
                self.keep_info(message).map(|()| None)
            } else {
                self.decode_frame(message)
            };
            match frame.map_err(|reason| self.messages.file(file).invalid(reason)) {
                Ok(None) => {}
                Ok(Some(frame)) => return Some(Ok(frame)),
                Err(error) => return Some(Err(error)),
            }
        }
    }

    /// Checks a frame number against the one before it in the same file, and keeps it for the next check. Numbers rise,
    /// unless the camera was opened again.
    ///
    /// # Errors
    ///
    /// The reason when they do not, or the number exceeds [`MAX_SEQUENCE`].
    fn check_number(&mut self, file: u32, info: &proto::FrameInfo) -> Result<(), String> {
        if info.sequence > MAX_SEQUENCE {
            return Err(format!("number {} is larger than {MAX_SEQUENCE}", info.sequence));
        }
        let number = FrameNumber { file, epoch: info.epoch, sequence: info.sequence };
        let last = self.last.replace(number);
        match last.filter(|last| last.file == file && number.contradicts(last)) {
            None => Ok(()),
            Some(last) => Err(format!(
                "number {} in epoch {} comes after number {} in epoch {}, but numbers rise",
                number.sequence, number.epoch, last.sequence, last.epoch
            )),
        }
    }

    /// Decodes the frame information and keeps it for the image that follows it.
    fn keep_info(&mut self, message: Message) -> Result<(), String> {
        let info = proto::FrameInfo::decode(message.data).map_err(|error| {
            format!("frame information at {} ns does not decode: {error}", message.header.log_time_ns)
        })?;
        self.info = Some((message.header.sequence, message.header.log_time_ns, info));
        Ok(())
    }

    /// Decodes an image and completes it by the frame information kept for it, against whose CRC-32 the pixels are
    /// checked. `None` for the last image of a file that was cut off before its frame information.
    fn decode_frame(&mut self, message: Message) -> Result<Option<(FrameMeta, Bytes)>, String> {
        let index = self.index;
        self.index += 1;
        let named = |reason: String| format!("frame {index}: {reason}");
        let file = message.file;
        let image = match self.messages.file(file).image_kind(message.header.channel) {
            Some(ImageKind::Ros2) => ros2::decode_image(&message.data),
            Some(ImageKind::FoxgloveCompressed) => compressed::decode_image(message.data.clone()),
            Some(ImageKind::Ros2Compressed) => ros2::decode_compressed_image(&message.data),
            _ => RawImage::decode(message.data.clone()).map_err(|error| error.to_string()),
        };
        let image = image.map_err(|reason| named(format!("does not decode: {reason}")))?;
        let mut meta = frame_shape(&image).map_err(named)?;
        if self.info_channels[file as usize].is_empty() {
            meta.sequence = index;
            meta.stamp_ns = stamp_ns(&image).unwrap_or(message.header.log_time_ns);
            return Ok(Some((meta, image.data)));
        }
        let info = self
            .info
            .take()
            .filter(|(low, time, _)| (*low, *time) == (message.header.sequence, message.header.log_time_ns));
        let is_cut = |messages: &Messages| messages.file(file).structure.truncated.is_some() && messages.is_over(file);
        let (_, _, info) = match info {
            None if is_cut(&self.messages) => return Ok(None),
            info => info.ok_or_else(|| named("its frame information is missing".into()))?,
        };
        meta.format = PixelFormat::from_number(info.pixel_format)
            .filter(|format| format.bytes_per_pixel() == meta.format.bytes_per_pixel())
            .ok_or_else(|| {
                named(format!("pixel format {:#010x} does not match encoding {}", info.pixel_format, image.encoding))
            })?;
        if crc32fast::hash(&image.data) != info.pixels_crc32 {
            return Err(named("its pixels are damaged: the CRC differs".into()));
        }
        self.check_number(file, &info).map_err(named)?;
        meta.sequence = info.sequence;
        meta.epoch = info.epoch;
        meta.stamp_ns = info.stamp_ns;
        meta.device_ns = info.device_ns;
        Ok(Some((meta, image.data)))
    }
}

impl Iterator for Frames {
    type Item = Result<(FrameMeta, Vec<u8>), RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_shared().map(|frame| frame.map(|(meta, pixels)| (meta, pixels.to_vec())))
    }
}

/// Returns the shape of a frame if its bytes fill it exactly, with the numbers and times left 0.
///
/// # Errors
///
/// The reason when the encoding is unsupported or the size differs.
fn frame_shape(image: &RawImage) -> Result<FrameMeta, String> {
    let format = match image.encoding.as_str() {
        "mono8" | "8UC1" => PixelFormat::Mono8,
        "mono16" | "16UC1" => PixelFormat::Mono16,
        other => return Err(format!("encoding {other:?} is not supported, only mono8, 8UC1, mono16 and 16UC1")),
    };
    let (width, height, step) = (image.width, image.height, image.step);
    let row_bytes = u64::from(width) * format.bytes_per_pixel() as u64;
    let fits = row_bytes > 0 && height > 0 && u64::from(step) >= row_bytes;
    if !fits || u64::from(step) * u64::from(height) != image.data.len() as u64 {
        let bytes = image.data.len();
        return Err(format!("{bytes} bytes are not {width}x{height} {} with step {step}", image.encoding));
    }
    Ok(FrameMeta { width_px: width, height_px: height, stride_bytes: step, format, ..FrameMeta::default() })
}

/// Returns the timestamp of an image, ns since the Unix epoch; `None` for none and for 0.
fn stamp_ns(image: &RawImage) -> Option<u64> {
    let timestamp = image.timestamp?;
    let ns = u64::from(timestamp.sec()) * 1_000_000_000 + u64::from(timestamp.nsec());
    (ns != 0).then_some(ns)
}
