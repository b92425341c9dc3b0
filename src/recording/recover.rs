//! Recovery of a complete recording from a damaged or unfinished one.

use super::message_copy::Copier;
use super::reader::Message;
use super::schema::proto;
use super::{RECOVERED_NAME, Recording, RecordingError, RecordingWriter, Topic, WriterOptions, part_file};
use foxglove::messages::RawImage;
use prost::Message as _;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The result of a recovery.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// The new file.
    pub path: PathBuf,
    /// The number of frames in it.
    pub frames: u64,
    /// The number of messages in it, frames included.
    pub messages: u64,
    /// The parts that could not be saved, with the reason.
    pub skipped: Vec<String>,
}

/// Copies every message that passes its checksum into a new, complete file.
///
/// This includes the messages of the chunk that was open when the file was cut off. There the checksum of each frame
/// decides. The old file stays unchanged, and no file is overwritten. Files of other programs are recovered too.
///
/// # Errors
///
/// [`RecordingError`] when the old file cannot be opened or the new one cannot be written.
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, RecordingError> {
    recover_with_progress(from, to, |_| {})
}

/// Recovers a file as [`recover`], and reports the share of it that is done, 0 to 1, after each chunk.
///
/// # Errors
///
/// Those of [`recover`].
pub fn recover_with_progress(from: &Path, to: &Path, report: impl Fn(f64)) -> Result<Recovered, RecordingError> {
    let recording = Recording::open_one(from)?;
    let mut writer = RecordingWriter::start(to, part_file::recovering_path(to), &WriterOptions::default())?;
    let mut skipped: Vec<String> = recording.truncated().map(str::to_owned).into_iter().collect();
    copy_description(&recording, &mut writer, &mut skipped)?;
    let mut filter = MessageFilter { copier: Copier::new(&recording, &mut writer), info: None };
    for number in 0..recording.section_count() {
        let mut torn = 0;
        let damage = recording.visit_section(number, |message| {
            let is_saved = filter.copy_intact(message)?;
            torn += u64::from(!is_saved);
            Ok(())
        })?;
        skipped.extend(damage);
        if torn > 0 {
            skipped.push(format!("{torn} messages are incomplete or fail their checksum"));
        }
        filter.copier.end_chunk()?;
        filter.info = None;
        report((number + 1) as f64 / recording.section_count() as f64);
    }
    let messages = filter.copier.messages();
    let finished = writer.finish()?;
    Ok(Recovered { path: finished.path, frames: finished.frames, messages, skipped })
}

/// Copies metadata and attachments, and records that the file was recovered. Damaged attachments are added to
/// `skipped`.
fn copy_description(
    recording: &Recording,
    writer: &mut RecordingWriter,
    skipped: &mut Vec<String>,
) -> Result<(), RecordingError> {
    for (name, entries) in recording.metadata_records() {
        writer.write_metadata(name, entries.clone())?;
    }
    let from = recording.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
    let reason = recording.truncated().unwrap_or("the file was whole").to_owned();
    writer.write_metadata(RECOVERED_NAME, BTreeMap::from([("from".into(), from), ("reason".into(), reason)]))?;
    for attachment in recording.attachments() {
        match recording.attachment(&attachment.name) {
            Ok(content) => writer.attach(&attachment.name, &attachment.media_type, &content)?,
            Err(error) => skipped.push(error.to_string()),
        }
    }
    Ok(())
}

/// Separates intact messages from damaged ones.
struct MessageFilter<'a> {
    copier: Copier<'a>,
    /// Frame information whose image has not come yet.
    info: Option<Message>,
}

impl MessageFilter<'_> {
    /// Copies a message if it is intact; returns whether it is copied or may still be.
    ///
    /// Without a CRC of the chunk, frame information waits for its image, whose pixels are checked against it.
    fn copy_intact(&mut self, message: Message) -> Result<bool, RecordingError> {
        let recording = self.copier.recording();
        let Some(channel) = recording.channels().get(&message.header.channel) else { return Ok(false) };
        let topic = |topic: Topic| topic.is_named_by(&channel.topic) && recording.is_ours();
        if !message.is_checked && topic(Topic::FrameInfo) {
            self.info = Some(message);
            return Ok(true);
        }
        if !message.is_checked && topic(Topic::Image) {
            let Some(info) = self.info.take().filter(|info| is_intact_pair(info, &message)) else { return Ok(false) };
            self.copier.write(&info)?;
        }
        self.copier.write(&message)?;
        Ok(true)
    }
}

/// Whether the information belongs to the image, and its checksum matches the pixels.
fn is_intact_pair(info: &Message, image: &Message) -> bool {
    let pair = proto::FrameInfo::decode(info.data.clone()).ok().zip(RawImage::decode(image.data.clone()).ok());
    (info.header.sequence, info.header.log_time_ns) == (image.header.sequence, image.header.log_time_ns)
        && pair.is_some_and(|(info, image)| crc32fast::hash(&image.data) == info.pixels_crc32)
}
