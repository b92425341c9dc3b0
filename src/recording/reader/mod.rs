//! Reader of recordings: complete, unfinished, cut off, or written by other programs.
//!
//! Every length is checked against the file, every chunk against its CRC before a message is taken from it, and no size
//! in the file is allocated unchecked. A hostile file is therefore refused without a crash or exhausted memory.

mod byte_source;
mod camera_view;
mod chunk_section;
mod compressed;
mod file_set;
mod frames;
mod messages;
mod ros2;
mod scan;
mod topics;

pub use file_set::files_of;
pub use frames::Frames;
pub(super) use messages::Message;
pub use topics::{Rows, TopicSummary};

use super::{CONFIG_NAME, METADATA_NAME, RecordingError};
use byte_source::{Source, Unreadable};
use chunk_section::Found;
use scan::{AttachmentRef, Coding, Structure};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum size of an attachment that is read, bytes.
const MAX_ATTACHMENT_BYTES: u64 = 64 << 20;

/// An attachment: name, type and size.
///
/// # Examples
///
/// ```
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
/// let attachment = &recording.attachments()[0];
/// assert_eq!((attachment.name.as_str(), attachment.bytes), ("config.toml", 3091));
/// let content = recording.attachment(&attachment.name)?;
/// assert_eq!(content, recording.config_toml().unwrap().as_bytes());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// File name.
    pub name: String,
    /// Media type.
    pub media_type: String,
    /// Size, bytes.
    pub bytes: u64,
}

/// A recording opened for reading, of one file or of several that continue each other; cheap to clone.
///
/// Metadata, configuration and attachments are those of the first file.
///
/// # Examples
///
/// ```
/// use ricochet::recording::Recording;
///
/// let recording = Recording::open("recordings/lacrosse.mcap".as_ref())?;
/// // The file is complete and undamaged.
/// assert_eq!(recording.truncated(), None);
/// assert!(recording.damage().is_empty() && recording.verify()?.is_empty());
/// assert_eq!((recording.frame_count(), recording.frame_rate_hz()?), (100, Some(10_000.0)));
/// assert_eq!(recording.metadata()["scale"], "0.5142 mm/px");
/// // It does not record an exposure time.
/// assert_eq!(recording.exposure_us(), 0.0);
/// // Rows name a body by its index.
/// assert_eq!(recording.body_name(0), "ball");
/// let impact = recording.truth_impacts()?.next().unwrap()?;
/// assert_eq!((impact.body, impact.status.as_str()), (0, "valid"));
/// # Ok::<(), ricochet::recording::RecordingError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Recording {
    /// The first file.
    inner: Arc<RecordedFile>,
    rest: Arc<file_set::Rest>,
}

/// One file of a recording and the content that every reader needs.
#[derive(Debug)]
struct RecordedFile {
    path: PathBuf,
    file: File,
    file_bytes: u64,
    structure: Structure,
    /// Messages by channel.
    counts: BTreeMap<u16, u64>,
    metadata: BTreeMap<String, String>,
    bodies: Vec<String>,
    config_toml: Option<String>,
    damage: Vec<String>,
}

/// Returns the error for a part of a file that cannot be read.
fn read_error(path: &Path, error: Unreadable) -> RecordingError {
    match error {
        Unreadable::Io(error) => RecordingError::io("read", path, error),
        Unreadable::Damaged(reason) => RecordingError::invalid(path, reason),
    }
}

impl Recording {
    /// Opens a single file of a recording.
    ///
    /// # Errors
    ///
    /// The errors of [`open`](Self::open).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn open_one(path: &Path) -> Result<Self, RecordingError> {
        let io = |error| RecordingError::io("open", path, error);
        let file = crate::input::open(path).map_err(io)?;
        let about = file.metadata().map_err(io)?;
        let structure = scan::scan(&file, about.len()).map_err(|error| read_error(path, error))?;
        let mut inner = RecordedFile {
            path: path.to_path_buf(),
            file,
            file_bytes: about.len(),
            structure,
            counts: BTreeMap::new(),
            metadata: BTreeMap::new(),
            bodies: Vec::new(),
            config_toml: None,
            damage: Vec::new(),
        };
        inner.count_messages()?;
        inner.describe()?;
        Ok(Self { inner: Arc::new(inner), rest: Arc::default() })
    }

    /// Reads the metadata record `ricochet` from the beginning of a file; `None` for files of other programs.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Io`] when there is no such file or the system fails. Damage counts as no metadata.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn peek_metadata(path: &Path) -> Result<Option<BTreeMap<String, String>>, RecordingError> {
        let io = |error| RecordingError::io("open", path, error);
        let file = File::open(path).map_err(io)?;
        let bytes = file.metadata().map_err(io)?.len();
        match scan::leading_metadata(&file, bytes, METADATA_NAME) {
            Err(Unreadable::Damaged(_)) => Ok(None),
            found => found.map_err(|error| read_error(path, error)),
        }
    }

    /// Returns the path of the first file.
    pub fn path(&self) -> &Path {
        &self.inner.path
    }

    /// Returns the size of all files, bytes.
    pub fn bytes(&self) -> u64 {
        self.all_files().map(|inner| inner.file_bytes).sum()
    }

    /// Returns the name and version of the program that wrote the first file, as its header states them.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn library(&self) -> &str {
        &self.inner.structure.library
    }

    /// Returns the reason why the file ends early, with its place; `None` when it is complete.
    pub fn truncated(&self) -> Option<&str> {
        self.rest.truncated.as_deref().or(self.inner.structure.truncated.as_deref())
    }

    /// Returns the damage found while opening; [`verify`](Self::verify) checks everything.
    pub fn damage(&self) -> &[String] {
        if self.rest.files.is_empty() { &self.inner.damage } else { &self.rest.damage }
    }

    /// Whether ricochet wrote the recording.
    pub fn is_ours(&self) -> bool {
        self.inner.is_ours()
    }

    /// Returns the attached configuration of the rig; `None` if there is none or it is damaged.
    pub fn config_toml(&self) -> Option<&str> {
        self.inner.config_toml.as_deref()
    }

    /// Returns the entries of the metadata record `ricochet`; none in files of other programs.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.inner.metadata
    }

    /// Returns every metadata record: its name and entries.
    pub fn metadata_records(&self) -> &[(String, BTreeMap<String, String>)] {
        &self.inner.structure.metadata
    }

    /// Returns the names of the bodies, by index.
    pub fn bodies(&self) -> &[String] {
        &self.inner.bodies
    }

    /// Returns the name of the body with this index; its number where the recording does not name it.
    pub fn body_name(&self, body: u32) -> String {
        self.inner.bodies.get(body as usize).cloned().unwrap_or_else(|| body.to_string())
    }

    /// Returns name, type and size of every attachment.
    pub fn attachments(&self) -> Vec<Attachment> {
        let attachment = |a: &AttachmentRef| Attachment {
            name: a.name.clone(),
            media_type: a.media_type.clone(),
            bytes: a.content_bytes,
        };
        self.inner.structure.attachments.iter().map(attachment).collect()
    }

    /// Returns the content of the attachment of this name, checked against its CRC.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when there is none, or it is damaged or larger than 64 MiB.
    pub fn attachment(&self, name: &str) -> Result<Vec<u8>, RecordingError> {
        let found = self.inner.structure.attachments.iter().find(|a| a.name == name);
        let found = found.ok_or_else(|| self.inner.invalid(format!("it has no attachment {name:?}")))?;
        self.inner.attachment(found)
    }

    /// Reads all files and lists all damage other than a missing end.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Io`] when the system fails.
    pub fn verify(&self) -> Result<Vec<String>, RecordingError> {
        let mut damage = Vec::new();
        for inner in self.all_files() {
            damage.extend(inner.verify()?.into_iter().map(|reason| self.named(inner, &reason)));
        }
        Ok(damage)
    }
}

impl RecordedFile {
    /// Reads the whole file and lists its damage: chunks, attachments and data that fail their CRC-32.
    fn verify(&self) -> Result<Vec<String>, RecordingError> {
        let mut damage = self.damage.clone();
        for section in &self.structure.sections {
            match chunk_section::load_records(&self.file, self.file_bytes, section) {
                Ok(_) => {}
                Err(Unreadable::Damaged(reason)) if damage.contains(&reason) => {}
                Err(Unreadable::Damaged(reason)) => damage.push(reason),
                Err(Unreadable::Io(error)) => return Err(self.io(error)),
            }
        }
        for attachment in &self.structure.attachments {
            if let Err(error @ RecordingError::Invalid { .. }) = self.attachment(attachment) {
                damage.push(error.to_string());
            }
        }
        if let Some((end, crc)) = self.structure.data_end.filter(|(_, crc)| *crc != 0) {
            let data = Source::File { offset: 0, bytes: end };
            let got = chunk_section::streamed_crc(&self.file, &data).map_err(|error| self.io(error))?;
            if got != crc {
                damage.push(format!("bytes 0 to {end}: CRC {crc:08x} expected, got {got:08x}"));
            }
        }
        Ok(damage)
    }

    /// Whether ricochet wrote the file.
    fn is_ours(&self) -> bool {
        self.structure.metadata.iter().any(|(name, _)| name == METADATA_NAME)
    }

    /// Returns the error that this file is damaged or of another format, for this reason.
    fn invalid(&self, reason: impl Into<String>) -> RecordingError {
        RecordingError::invalid(&self.path, reason)
    }

    /// Returns the error that reading this file failed, from the system's error.
    fn io(&self, error: std::io::Error) -> RecordingError {
        RecordingError::io("read", &self.path, error)
    }

    /// Counts the messages by the index of each section, or by reading sections without an index or with unknown
    /// channels. An uncompressed section is shortened to its readable part; damage is listed.
    fn count_messages(&mut self) -> Result<(), RecordingError> {
        let mut sections = std::mem::take(&mut self.structure.sections);
        for section in &mut sections {
            let known = section.index.iter().all(|index| self.structure.channels.contains_key(&index.channel));
            if known && !section.index.is_empty() {
                for index in &section.index {
                    *self.counts.entry(index.channel).or_default() += index.entries;
                }
                continue;
            }
            match self.scan_section(section) {
                Ok(parsed_bytes) if section.coding == Coding::Plain => {
                    if section.whole && parsed_bytes < section.bytes {
                        self.damage
                            .push(format!("the records from byte {} on do not parse", section.offset + parsed_bytes));
                    }
                    section.bytes = parsed_bytes;
                }
                Ok(_) => {}
                Err(Unreadable::Damaged(reason)) => self.damage.push(reason),
                Err(Unreadable::Io(error)) => return Err(self.io(error)),
            }
        }
        self.structure.sections = sections;
        Ok(())
    }

    /// Counts the messages of a section by reading it, and adds its schemas and channels; returns the parsed bytes.
    fn scan_section(&mut self, section: &scan::Section) -> Result<u64, Unreadable> {
        let records = match section.coding {
            // The CRC is checked when a message is read.
            Coding::Plain => Source::File { offset: section.offset, bytes: section.bytes },
            Coding::Zstd | Coding::Lz4 => chunk_section::load_records(&self.file, self.file_bytes, section)?,
        };
        let (structure, counts) = (&mut self.structure, &mut self.counts);
        chunk_section::scan_records(&self.file, &records, |found| match found {
            Found::Message { header, .. } => {
                *counts.entry(header.channel).or_default() += 1;
                Ok(())
            }
            Found::Description { opcode, body } => {
                structure.count_description(body.len() as u64)?;
                structure.describe(opcode, body).ok_or_else(|| "a schema or channel does not parse".into())
            }
        })
    }

    /// Extracts the metadata, bodies and configuration that every reader needs. A damaged configuration is listed as
    /// damage.
    fn describe(&mut self) -> Result<(), RecordingError> {
        if let Some((_, entries)) = self.structure.metadata.iter().find(|(name, _)| name == METADATA_NAME) {
            self.metadata = entries.clone();
        }
        self.bodies = (0..).map_while(|index| self.metadata.get(&format!("body.{index}")).cloned()).collect();
        let Some(config) = self.structure.attachments.iter().find(|a| a.name == CONFIG_NAME) else { return Ok(()) };
        match self.attachment(config) {
            Ok(content) => match String::from_utf8(content) {
                Ok(text) => self.config_toml = Some(text),
                Err(_) => self.damage.push(format!("attachment {CONFIG_NAME} is not UTF-8")),
            },
            Err(RecordingError::Invalid { reason, .. }) => self.damage.push(reason),
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Reads the content of an attachment and checks its CRC-32, unless that is 0 (none).
    ///
    /// # Errors
    ///
    /// [`RecordingError::Invalid`] when it is damaged or exceeds [`MAX_ATTACHMENT_BYTES`]; [`RecordingError::Io`] when
    /// the system fails.
    fn attachment(&self, attachment: &AttachmentRef) -> Result<Vec<u8>, RecordingError> {
        if attachment.content_bytes > MAX_ATTACHMENT_BYTES {
            return Err(self.invalid(format!(
                "attachment {:?} has {} bytes; at most {MAX_ATTACHMENT_BYTES} are read",
                attachment.name, attachment.content_bytes
            )));
        }
        let checked_bytes = attachment.header_bytes + attachment.content_bytes;
        let body = Source::File { offset: attachment.body, bytes: checked_bytes + 4 };
        let bytes = body.read(&self.file, 0, checked_bytes + 4).map_err(|error| self.io(error))?;
        let (checked, crc) = bytes.split_at(checked_bytes as usize);
        let crc = crc.try_into().map_or(0, u32::from_le_bytes);
        let got = crc32fast::hash(checked);
        if crc != 0 && crc != got {
            return Err(self.invalid(format!(
                "attachment {:?} at byte {} is damaged: CRC {crc:08x} expected, got {got:08x}",
                attachment.name, attachment.body
            )));
        }
        Ok(checked[attachment.header_bytes as usize..].to_vec())
    }
}
