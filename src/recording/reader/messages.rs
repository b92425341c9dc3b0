//! The messages of some channels, in the order of their log time.

use super::byte_source::{Source, Unreadable};
use super::chunk_section::{self, Found};
use super::scan::{Coding, IndexRef, Section};
use super::{RecordedFile, Recording, RecordingError, read_error};
use crate::recording::Topic;
use crate::recording::record::MessageHeader;
use bytes::Bytes;
use std::sync::Arc;

/// The offset in an entry of a section that cannot be read.
const UNREADABLE: u64 = u64::MAX;
/// The size of an entry in memory, bytes.
const ENTRY_BYTES: u64 = size_of::<Entry>() as u64;
/// Memory that an index may take on top of twice the file's size, bytes.
const SPARE_BYTES: u64 = 32 << 20;

/// A section of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    file: u32,
    section: u32,
}

/// The place of a message, ordered by time, then by file and offset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    log_time_ns: u64,
    place: Place,
    offset: u64,
}

/// A message as it is in the file.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    /// The number of its file.
    pub(crate) file: u32,
    pub(crate) header: MessageHeader,
    pub(crate) data: Bytes,
    /// Whether a CRC of the file covers it.
    pub(crate) is_checked: bool,
}

/// Reads messages one by one, with one chunk in memory at a time.
///
/// A damaged chunk returns one error. Reading continues after it.
#[derive(Debug)]
pub(crate) struct Messages {
    /// The files, each with the channels to read.
    files: Vec<(Arc<RecordedFile>, Vec<u16>)>,
    entries: std::vec::IntoIter<Entry>,
    /// The section in memory.
    loaded: Option<(Place, Source)>,
    /// The section that cannot be read.
    failed: Option<Place>,
    /// Sections with an index that lists no message of the channels, checked at the end.
    unlisted: Vec<Place>,
}

impl Messages {
    /// Finds the messages of the given channels of each file.
    pub(super) fn new(files: Vec<(Arc<RecordedFile>, Vec<u16>)>) -> Result<Self, RecordingError> {
        let mut entries = Vec::new();
        for (number, (inner, channels)) in (0..).zip(&files) {
            Self::collect_entries(inner, number, channels, &mut entries)?;
        }
        entries.sort_unstable();
        Ok(Self { files, entries: entries.into_iter(), loaded: None, failed: None, unlisted: Vec::new() })
    }

    /// Also checks, after the last message, that chunks whose index lists none of the channels have no such message.
    ///
    /// This reads the heads of all records, so it is for readers of most of a file.
    pub(super) fn with_hidden_checked(mut self) -> Self {
        for (file, (inner, channels)) in (0..).zip(&self.files).filter(|(_, (_, channels))| !channels.is_empty()) {
            let is_unlisted = |section: &Section| {
                let mut listed = section.index.iter().filter(|index| index.entries > 0);
                !section.index.is_empty() && !listed.any(|index| channels.contains(&index.channel))
            };
            let sections = (0..).zip(&inner.structure.sections).filter(|(_, section)| is_unlisted(section));
            self.unlisted.extend(sections.map(|(section, _)| Place { file, section }));
        }
        self
    }

    /// Checks the chunks that seem to have nothing to read, from the last on, and returns the first error. `None` once
    /// all are checked.
    fn next_hidden(&mut self) -> Option<RecordingError> {
        while let Some(place) = self.unlisted.pop() {
            let (inner, channels) = &self.files[place.file as usize];
            let section = &inner.structure.sections[place.section as usize];
            let records = match section.coding {
                Coding::Plain => Ok(Source::File { offset: section.offset, bytes: section.bytes }),
                Coding::Zstd | Coding::Lz4 => chunk_section::load_records(&inner.file, inner.file_bytes, section),
            };
            let checked = records.and_then(|records| check_index(inner, section, channels, &records));
            if let Err(error) = checked {
                return Some(read_error(&inner.path, error));
            }
        }
        None
    }

    /// Adds the entries of the messages on these channels to `all`. `file` is the number of the file.
    ///
    /// A section that cannot be read adds one entry, which makes reading return the error at its place.
    ///
    /// # Errors
    ///
    /// [`RecordingError`] when the system fails, or there are more messages than a file of this size can have.
    fn collect_entries(
        inner: &RecordedFile,
        file: u32,
        channels: &[u16],
        all: &mut Vec<Entry>,
    ) -> Result<(), RecordingError> {
        let mut entries = Vec::new();
        for (number, section) in (0..).zip(&inner.structure.sections) {
            let before = entries.len();
            let place = Place { file, section: number };
            let found = if section.index.is_empty() {
                entries_by_scan(inner, section, place, channels, &mut entries)
            } else {
                entries_by_index(inner, section, place, channels, &mut entries)
            };
            match found {
                Ok(()) => {}
                Err(Unreadable::Io(error)) => return Err(inner.io(error)),
                Err(Unreadable::Damaged(_)) => {
                    // The entry makes reading return the error at this place.
                    entries.truncate(before);
                    let log_time_ns = entries.last().map_or(0, |entry: &Entry| entry.log_time_ns);
                    entries.push(Entry { log_time_ns, place, offset: UNREADABLE });
                }
            }
            if entries.len() as u64 * ENTRY_BYTES > 2 * inner.file_bytes + SPARE_BYTES {
                return Err(inner.invalid(format!(
                    "{} messages in {} bytes are too many",
                    entries.len(),
                    inner.file_bytes
                )));
            }
        }
        all.append(&mut entries);
        Ok(())
    }

    /// Returns the number of messages left to read.
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Skips all but the last `count` messages.
    pub(super) fn keep_last(&mut self, count: usize) {
        let skip = self.entries.len().saturating_sub(count);
        if skip > 0 {
            self.entries.nth(skip - 1);
        }
    }

    /// Skips the next `count` messages; beyond the end, all.
    pub(super) fn skip_next(&mut self, count: usize) {
        if count > 0 {
            self.entries.nth(count - 1);
        }
    }

    /// Returns the file of this number, from 0.
    pub(super) fn file(&self, file: u32) -> &RecordedFile {
        &self.files[file as usize].0
    }

    /// Whether every message of the file of this number was read or skipped.
    pub(super) fn is_over(&self, file: u32) -> bool {
        self.entries.as_slice().iter().all(|entry| entry.place.file != file)
    }

    /// Reads the message of an entry. Loads its section and checks the section's index, unless it is in memory.
    fn read(&mut self, entry: Entry) -> Result<Message, Unreadable> {
        let place = entry.place;
        let (inner, channels) = &self.files[place.file as usize];
        let section = &inner.structure.sections[place.section as usize];
        if self.loaded.as_ref().is_none_or(|(loaded, _)| *loaded != place) {
            self.loaded = None;
            let records = chunk_section::load_records(&inner.file, inner.file_bytes, section)?;
            check_index(inner, section, channels, &records)?;
            self.loaded = Some((place, records));
        }
        let found = match &self.loaded {
            Some((_, records)) => chunk_section::read_message(&inner.file, records, entry.offset)?,
            None => None,
        };
        let (header, data) = found
            .filter(|(header, _)| header.log_time_ns == entry.log_time_ns && channels.contains(&header.channel))
            .ok_or_else(|| {
                Unreadable::Damaged(format!(
                    "the chunk with records from byte {}: its index points at byte {}, which has no such message",
                    section.offset, entry.offset
                ))
            })?;
        Ok(Message { file: place.file, header, data, is_checked: section.crc != 0 })
    }
}

impl Iterator for Messages {
    type Item = Result<Message, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let Some(entry) = self.entries.next() else { return self.next_hidden().map(Err) };
            let Place { file, .. } = entry.place;
            if self.failed == Some(entry.place) {
                continue;
            }
            return Some(self.read(entry).map_err(|error| {
                self.failed = Some(entry.place);
                read_error(&self.file(file).path, error)
            }));
        }
    }
}

impl Recording {
    /// Returns the number of sections in the first file.
    pub(in super::super) fn section_count(&self) -> usize {
        self.inner.structure.sections.len()
    }

    /// Returns the channels of a section by its index; `None` without a section of this number (from 0) or without an
    /// index.
    pub(in super::super) fn section_channels(&self, number: usize) -> Option<Vec<u16>> {
        let index = &self.inner.structure.sections.get(number)?.index;
        (!index.is_empty()).then(|| index.iter().map(|entry| entry.channel).collect())
    }

    /// Visits every intact message of a section of the first file, in the order of the file.
    ///
    /// A chunk that fails its checksum is searched for frames, which have checksums of their own. After a power cut the
    /// end of a chunk can be on the disk while a part of its middle is not. Returns the damage, if any.
    ///
    /// # Errors
    ///
    /// The error of `visit`; [`RecordingError::Io`] when the system fails.
    pub(in super::super) fn visit_section(
        &self,
        number: usize,
        mut visit: impl FnMut(Message) -> Result<(), RecordingError>,
    ) -> Result<Option<String>, RecordingError> {
        let inner = &*self.inner;
        let Some(section) = inner.structure.sections.get(number) else { return Ok(None) };
        let (records, damage) = match chunk_section::load_records(&inner.file, inner.file_bytes, section) {
            Ok(records) => (records, None),
            Err(Unreadable::Damaged(reason)) if section.coding == Coding::Plain && inner.is_ours() => {
                (Source::File { offset: section.offset, bytes: section.bytes }, Some(reason))
            }
            Err(Unreadable::Damaged(reason)) => return Ok(Some(reason)),
            Err(Unreadable::Io(error)) => return Err(inner.io(error)),
        };
        let is_checked = section.crc != 0 && damage.is_none();
        let has_own_checksum = |channel: u16| {
            let topic = inner.structure.channels.get(&channel).map_or("", |channel| channel.topic.as_str());
            [Topic::Image, Topic::FrameInfo].iter().any(|frame| frame.is_named_by(topic))
        };
        let mut refusal = None;
        let scanned = chunk_section::scan_records(&inner.file, &records, |found| {
            let Found::Message { at, header } = found else { return Ok(()) };
            if damage.is_some() && !has_own_checksum(header.channel) {
                return Ok(());
            }
            let visited = match chunk_section::read_message(&inner.file, &records, at) {
                Ok(Some((header, data))) => visit(Message { file: 0, header, data, is_checked }),
                Ok(None) => Ok(()),
                Err(error) => Err(inner.io(error)),
            };
            visited.map_err(|error| {
                refusal = Some(error);
                String::new()
            })
        });
        match (refusal, scanned) {
            (Some(error), _) => Err(error),
            (None, Ok(_) | Err(Unreadable::Damaged(_))) if damage.is_some() => Ok(damage),
            (None, Err(Unreadable::Io(error))) => Err(inner.io(error)),
            (None, Err(Unreadable::Damaged(reason))) => Ok(Some(reason)),
            (None, Ok(bytes)) if bytes < records.len() => {
                Ok(Some(format!("the records from byte {} on do not parse", section.offset + bytes)))
            }
            (None, Ok(_)) => Ok(None),
        }
    }
}

/// Checks that the index of a chunk lists as many messages of the channels as the chunk has. A chunk without an index
/// passes.
fn check_index(inner: &RecordedFile, section: &Section, channels: &[u16], records: &Source) -> Result<(), Unreadable> {
    if section.index.is_empty() {
        return Ok(());
    }
    let mut present = 0_u64;
    chunk_section::scan_records(&inner.file, records, |found| {
        present += u64::from(matches!(found, Found::Message { header, .. } if channels.contains(&header.channel)));
        Ok(())
    })?;
    let is_wanted = |index: &&IndexRef| channels.contains(&index.channel);
    let listed: u64 = section.index.iter().filter(is_wanted).map(|index| index.entries).sum();
    if present == listed {
        return Ok(());
    }
    Err(Unreadable::Damaged(format!(
        "the chunk with records from byte {}: it has {present} of these messages, but its index lists {listed}",
        section.offset
    )))
}

/// Adds the entries of a section's messages on these channels from its index, 16 bytes per message: log time and
/// offset.
fn entries_by_index(
    inner: &RecordedFile,
    section: &Section,
    place: Place,
    channels: &[u16],
    entries: &mut Vec<Entry>,
) -> Result<(), Unreadable> {
    for index in section.index.iter().filter(|index| channels.contains(&index.channel)) {
        let stored = Source::File { offset: index.offset, bytes: index.entries * 16 };
        let bytes = stored.read(&inner.file, 0, stored.len())?;
        entries.extend(bytes.chunks_exact(16).map(|pair| {
            let mut fields = crate::recording::record::Fields(pair);
            let log_time_ns = fields.u64().unwrap_or(0);
            Entry { log_time_ns, place, offset: fields.u64().unwrap_or(UNREADABLE) }
        }));
    }
    Ok(())
}

/// Adds the entries of a section's messages on these channels by reading the heads of all records.
fn entries_by_scan(
    inner: &RecordedFile,
    section: &Section,
    place: Place,
    channels: &[u16],
    entries: &mut Vec<Entry>,
) -> Result<(), Unreadable> {
    let records = chunk_section::load_records(&inner.file, inner.file_bytes, section)?;
    chunk_section::scan_records(&inner.file, &records, |found| {
        if let Found::Message { at, header } = found
            && channels.contains(&header.channel)
        {
            entries.push(Entry { log_time_ns: header.log_time_ns, place, offset: at });
        }
        Ok(())
    })?;
    Ok(())
}
