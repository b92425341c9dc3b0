//! A whole file again out of what is left of one.

use super::reader::{Channel, Message, Schema};
use super::schema::proto;
use super::writer::Copied;
use super::{RECOVERED_NAME, Recording, RecordingError, RecordingWriter, Topic, WriterOptions, part};
use foxglove::messages::RawImage;
use prost::Message as _;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What could be saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// The new file.
    pub path: PathBuf,
    /// Frames in it.
    pub frames: u64,
    /// Messages in it, frames included.
    pub messages: u64,
    /// What could not be saved, and why.
    pub skipped: Vec<String>,
}

/// Copies every message that can be trusted into a new, whole file.
///
/// Also those behind the header of the chunk that was being written when the
/// file was cut off; there each frame's own checksum decides. The old file is
/// left as it is, and nothing is overwritten. Works on other people's files too.
///
/// # Errors
///
/// [`RecordingError`] when the old file cannot be opened or the new one not written.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecordingError> {
    let recording = Recording::open(from)?;
    let mut writer = RecordingWriter::start(to, part::recovering_path(to), &WriterOptions::default())?;
    let mut skipped: Vec<String> = recording.truncated().map(str::to_owned).into_iter().collect();
    describe(&recording, &mut writer, &mut skipped)?;
    let mut copier = Copier { recording: &recording, writer, channels: BTreeMap::new(), info: None, messages: 0 };
    for number in 0..recording.section_count() {
        let mut torn = 0;
        let damage = recording.visit_section(number, |message| {
            let is_saved = copier.message(message)?;
            torn += u64::from(!is_saved);
            Ok(())
        })?;
        skipped.extend(damage);
        if torn > 0 {
            skipped.push(format!("{torn} messages that are incomplete or fail their checksum"));
        }
        // A chunk for a chunk keeps frames and rows apart.
        copier.writer.call(mcap::Writer::flush)?;
        copier.info = None;
    }
    let messages = copier.messages;
    let finished = copier.writer.finish()?;
    Ok(Recovered { path: finished.path, frames: finished.frames, messages, skipped })
}

/// Copies metadata and attachments, and says that the file was recovered.
fn describe(
    recording: &Recording,
    writer: &mut RecordingWriter,
    skipped: &mut Vec<String>,
) -> Result<(), RecordingError> {
    for (name, entries) in recording.metadata_records() {
        writer.metadata(name, entries.clone())?;
    }
    let from = recording.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
    let reason = recording.truncated().unwrap_or("the file was whole").to_owned();
    writer.metadata(RECOVERED_NAME, BTreeMap::from([("from".into(), from), ("reason".into(), reason)]))?;
    for attachment in recording.attachments() {
        match recording.attachment(&attachment.name) {
            Ok(content) => writer.attach(&attachment.name, &attachment.media_type, &content)?,
            Err(error) => skipped.push(error.to_string()),
        }
    }
    Ok(())
}

struct Copier<'a> {
    recording: &'a Recording,
    writer: RecordingWriter,
    /// Channels of the old file to those of the new one.
    channels: BTreeMap<u16, u16>,
    /// Frame information that waits for its image.
    info: Option<Message>,
    messages: u64,
}

impl Copier<'_> {
    /// Copies a message; whether it could be trusted.
    fn message(&mut self, message: Message) -> Result<bool, RecordingError> {
        let Some(channel) = self.recording.channels().get(&message.channel) else { return Ok(false) };
        let topic = |topic: Topic| channel.topic == topic.name() && self.recording.is_ours();
        if !message.is_checked && topic(Topic::FrameInfo) {
            self.info = Some(message);
            return Ok(true);
        }
        let is_frame = self.recording.is_image(message.channel);
        if !message.is_checked && topic(Topic::Image) {
            let Some(info) = self.info.take().filter(|info| belongs(info, &message)) else { return Ok(false) };
            self.write(&info, false)?;
        }
        self.write(&message, is_frame)?;
        Ok(true)
    }

    fn write(&mut self, message: &Message, is_frame: bool) -> Result<(), RecordingError> {
        let channel = self.channel(message.channel)?;
        self.messages += 1;
        let copied = Copied {
            sequence: message.sequence,
            log_time_ns: message.log_time_ns,
            publish_time_ns: message.publish_time_ns,
            data: &message.data,
            is_frame,
        };
        self.writer.copy(channel, &copied)
    }

    fn channel(&mut self, old: u16) -> Result<u16, RecordingError> {
        if let Some(new) = self.channels.get(&old) {
            return Ok(*new);
        }
        let empty = (Channel::default(), Schema::default());
        let channel = self.recording.channels().get(&old).unwrap_or(&empty.0);
        let schema = self.recording.schemas().get(&channel.schema);
        let new = self.writer.call(|mcap| {
            let schema = match schema {
                Some(schema) => mcap.add_schema(&schema.name, &schema.encoding, &schema.data)?,
                None => 0,
            };
            mcap.add_channel(schema, &channel.topic, &channel.encoding, &channel.metadata)
        })?;
        self.channels.insert(old, new);
        Ok(new)
    }
}

/// Whether this is the information of this image, and its checksum that of these pixels.
fn belongs(info: &Message, image: &Message) -> bool {
    let pair = proto::FrameInfo::decode(info.data.clone()).ok().zip(RawImage::decode(image.data.clone()).ok());
    (info.sequence, info.log_time_ns) == (image.sequence, image.log_time_ns)
        && pair.is_some_and(|(info, image)| crc32fast::hash(&image.data) == info.pixels_crc32)
}
