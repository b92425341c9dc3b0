//! Retention of recordings: the oldest of this rig are removed to make room for new ones.

use super::Recorder;
use crate::config::Record;
use crate::failure::Failure;
use crate::message::EventKind;
use crate::process::clock::PeriodicTimer;
use crate::recording::{Recording, files_of};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Interval of checking the size of the open recording.
const PERIOD: Duration = Duration::from_secs(1);
/// Digits of the date, the time and the milliseconds in a recording's name.
const STAMP_DIGITS: [usize; 3] = [8, 6, 3];

/// Keeps the folder of the recordings within its limits.
#[derive(Debug)]
pub(super) struct Retention {
    directory: PathBuf,
    rig: String,
    keep_last: Option<usize>,
    max_bytes: Option<u64>,
    /// Finished by this recorder, oldest first; this order does not depend on the clock.
    made: Vec<PathBuf>,
    /// Recordings that cannot be removed; each is reported once.
    stuck: BTreeSet<PathBuf>,
    timer: PeriodicTimer,
}

/// A finished recording of this rig.
#[derive(Debug)]
struct Kept {
    /// Its first file.
    path: PathBuf,
    /// Its further files.
    later: Vec<PathBuf>,
    /// Total size.
    bytes: u64,
}

/// A recording that is being written.
#[derive(Debug, Clone, Copy)]
pub(super) struct UnderWay<'a> {
    /// Its first file, which is complete if the recording was split.
    pub(super) path: &'a Path,
    /// Size of its files so far.
    pub(super) bytes: u64,
}

impl Retention {
    pub(super) fn new(record: &Record, rig: &str) -> Self {
        Self {
            directory: record.directory.clone(),
            rig: rig.to_owned(),
            keep_last: record.keep_last.and_then(|count| usize::try_from(count).ok()),
            max_bytes: record.max_bytes,
            made: Vec::new(),
            stuck: BTreeSet::new(),
            timer: PeriodicTimer::new(PERIOD),
        }
    }

    /// Adds a finished recording, the newest one.
    pub(super) fn add(&mut self, path: &Path) {
        self.made.push(path.to_path_buf());
    }

    /// Removes the oldest recordings until the rest, with an open recording, keeps the limits. Returns one line for
    /// each removed recording, and once for each that cannot be removed.
    ///
    /// The newest finished recording is never removed.
    pub(super) fn enforce(&mut self, under_way: Option<UnderWay<'_>>) -> Vec<String> {
        if self.keep_last.is_none() && self.max_bytes.is_none() {
            return Vec::new();
        }
        let mut kept = self.finished();
        kept.retain(|kept| under_way.is_none_or(|under_way| under_way.path != kept.path));
        let written_bytes = under_way.map_or(0, |under_way| under_way.bytes);
        let mut count = kept.len();
        let mut bytes = kept.iter().fold(written_bytes, |sum, kept| sum.saturating_add(kept.bytes));
        let mut removed = Vec::new();
        for oldest in &kept {
            let reason = match (self.keep_last, self.max_bytes) {
                _ if count <= 1 => break,
                (Some(last), _) if count > last => format!("keep_last = {last}"),
                (_, Some(max)) if bytes > max => format!("max_bytes = {max}"),
                _ => break,
            };
            count -= 1;
            bytes -= oldest.bytes;
            // An event has room for 200 bytes; the folder is known from the rig file.
            let name = oldest.path.file_name().unwrap_or_default().to_string_lossy();
            // The first file goes last: while it exists, it leads to the others.
            let mut files = oldest.later.iter().rev().chain([&oldest.path]);
            match files.try_for_each(fs::remove_file) {
                Ok(()) => {
                    removed.push(format!("removed {name}, {} bytes: {reason}", oldest.bytes));
                    self.made.retain(|path| *path != oldest.path);
                }
                // No newer one is removed instead.
                Err(error) if self.stuck.insert(oldest.path.clone()) => {
                    log::warn!("cannot remove {name}: {error}");
                    removed.push(format!("cannot remove {name}: {error}"));
                }
                Err(_) => {}
            }
        }
        removed
    }

    /// Enforces the limit on the size, at most once per [`PERIOD`], while a recording is open; see
    /// [`enforce`](Self::enforce).
    pub(super) fn enforce_periodically(&mut self, under_way: UnderWay<'_>) -> Vec<String> {
        if self.max_bytes.is_none() || !self.timer.restart_if_due() {
            return Vec::new();
        }
        self.enforce(Some(under_way))
    }

    /// Returns the recordings of this rig with their final names, oldest first; empty if the folder cannot be read.
    fn finished(&self) -> Vec<Kept> {
        let Ok(entries) = fs::read_dir(&self.directory) else { return Vec::new() };
        let mut kept: Vec<((usize, SystemTime, PathBuf), Kept)> = entries
            .filter_map(|entry| {
                let entry = entry.ok()?;
                // Links are not followed: their targets do not belong to this folder.
                let metadata = entry.metadata().ok().filter(fs::Metadata::is_file)?;
                let path = entry.path();
                let of_this_rig =
                    is_recording_name(entry.file_name().to_str()?, &self.rig) && names_rig(&path, &self.rig);
                // Recordings of earlier processes come first, by time. Those of this one follow in order.
                let rank = self.made.iter().position(|made| *made == path).map_or(0, |at| at + 1);
                let modified = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                of_this_rig.then(|| {
                    let later: Vec<PathBuf> = files_of(&path).into_iter().skip(1).collect();
                    let of_later = |path: &PathBuf| fs::symlink_metadata(path).map_or(0, |metadata| metadata.len());
                    let bytes = metadata.len() + later.iter().map(of_later).sum::<u64>();
                    ((rank, modified, path.clone()), Kept { path, later, bytes })
                })
            })
            .collect();
        kept.sort_by(|a, b| a.0.cmp(&b.0));
        kept.into_iter().map(|(_, kept)| kept).collect()
    }
}

/// Whether a recorder of this rig uses such names: `RIG-20261121-083000-123.mcap`, or that with `-2`, `-3`, ...
fn is_recording_name(name: &str, rig: &str) -> bool {
    let stamp = name.strip_prefix(rig).and_then(|rest| rest.strip_prefix('-')).and_then(|r| r.strip_suffix(".mcap"));
    let Some(stamp) = stamp else { return false };
    let parts: Vec<&str> = stamp.split('-').collect();
    let are_digits = parts.iter().all(|part| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit()));
    are_digits && (3..=4).contains(&parts.len()) && parts.iter().zip(STAMP_DIGITS).all(|(part, n)| part.len() == n)
}

/// Whether the file's metadata names this rig.
fn names_rig(path: &Path, rig: &str) -> bool {
    // Called every second while a stream is written, so only the head of each file is read.
    let metadata = Recording::peek_metadata(path).ok().flatten();
    metadata.is_some_and(|entries| entries.get("rig").is_some_and(|name| name == rig))
}

impl Recorder<'_> {
    /// Publishes the lines about removed recordings as events.
    pub(super) fn publish_removed(&mut self, removed: Vec<String>) -> Result<(), Failure> {
        for text in removed {
            self.publish_event(EventKind::Storage, &text)?;
        }
        Ok(())
    }

    /// Removes old recordings if the open one needs room.
    pub(super) fn check_retention(&mut self) -> Result<(), Failure> {
        let Some(open) = &self.shot else { return Ok(()) };
        let under_way = UnderWay { path: open.shot.path(), bytes: open.shot.written_bytes() };
        let removed = self.retention.enforce_periodically(under_way);
        self.publish_removed(removed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Compression;
    use crate::image::{Frame, FrameMeta};
    use crate::recording::{RecordingInfo, RecordingWriter, WriterOptions};
    use std::collections::BTreeMap;

    fn record(directory: &Path, keep_last: Option<u32>, max_bytes: Option<u64>) -> Record {
        Record {
            directory: directory.to_path_buf(),
            compression: Compression::None,
            raw_frames: true,
            ring_bytes_max: None,
            keep_last,
            max_bytes,
            split_bytes: None,
        }
    }

    /// Creates a recording of this rig with an attachment of this size.
    fn recording(directory: &Path, name: &str, rig: &str, bytes: usize) -> PathBuf {
        let path = directory.join(name);
        let info = RecordingInfo {
            metadata: BTreeMap::from([("rig".to_owned(), rig.to_owned())]),
            attachments: vec![("filler".into(), String::new(), vec![0; bytes])],
            ..RecordingInfo::default()
        };
        RecordingWriter::create(&path, &info, &WriterOptions::default()).unwrap().finish().unwrap();
        path
    }

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn only_names_that_a_recorder_uses_are_its_own() {
        for name in ["a-20261121-083000-123.mcap", "a-20261121-083000-123-2.mcap", "a-20261121-083000-123-10.mcap"] {
            assert!(is_recording_name(name, "a"), "{name}");
        }
        for name in [
            "a.mcap",
            "b-20261121-083000-123.mcap",
            "a-20261121-083000-123.mcap.part",
            "a-20261121-083000-123.results-1.mcap",
            "a-b-20261121-083000-123.mcap",
            "a-20261121-083000.mcap",
            "a-20261121-083000-123-2-3.mcap",
            "a-20261121-083000-123-.mcap",
            "a-20261121-08300x-123.mcap",
            "a-20261121-83000-123.mcap",
        ] {
            assert!(!is_recording_name(name, "a"), "{name}");
        }
    }

    #[test]
    fn the_newest_stay_and_what_is_not_this_rigs_is_never_touched() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let mut retention = Retention::new(&record(at, Some(2), None), "a");
        // The clock steps backwards: the order in which they were made counts.
        for day in ["20261124", "20261123", "20261122", "20261121"] {
            let path = recording(at, &format!("a-{day}-000000-000.mcap"), "a", 0);
            retention.add(&path);
        }
        let foreign = [
            "a-20200101-000000-000.results-1.mcap",
            "a-20200101-000000-000.mcap.part",
            "a-20200101-000000-001.mcap",
            "notes.mcap",
        ];
        for name in foreign {
            fs::write(at.join(name), "mine").unwrap();
        }
        // Of this form and name, but its metadata names another rig.
        recording(at, "a-20200101-000000-002.mcap", "b", 0);
        let target = recording(at, "target", "a", 0);
        std::os::unix::fs::symlink(&target, at.join("a-20200101-000000-003.mcap")).unwrap();
        let removed = retention.enforce(None);
        assert_eq!(removed.len(), 2, "{removed:?}");
        assert!(
            removed[0].contains("a-20261124-000000-000.mcap") && removed[0].ends_with("keep_last = 2"),
            "{removed:?}"
        );
        let left = names(at);
        for name in foreign.iter().chain(&["a-20261122-000000-000.mcap", "a-20261121-000000-000.mcap", "target"]) {
            assert!(left.contains(&(*name).to_owned()), "{name} of {left:?}");
        }
        assert_eq!(left.len(), 9, "{left:?}");
        assert_eq!(retention.enforce(None), Vec::<String>::new());
    }

    #[test]
    fn bytes_are_bounded_with_those_being_written_but_the_newest_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        for k in 0..5 {
            // Made by a previous recorder: their times give the order.
            let path = recording(at, &format!("a-2026112{k}-000000-000.mcap"), "a", 100_000);
            let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1000 + k);
            fs::File::options().append(true).open(path).unwrap().set_modified(time).unwrap();
        }
        let left = |written_bytes: u64| {
            let under_way = UnderWay { path: Path::new("shot"), bytes: written_bytes };
            Retention::new(&record(at, None, Some(450_000)), "a").enforce(Some(under_way));
            names(at).into_iter().map(|name| name[9..10].to_owned()).collect::<String>()
        };
        assert_eq!(left(0), "1234");
        assert_eq!(left(150_000), "34");
        assert_eq!(left(10_000_000), "4");
    }

    /// Creates a recording of this rig that is split into files of at most 100 kB.
    fn split(directory: &Path, name: &str) -> Vec<PathBuf> {
        let path = directory.join(name);
        let metadata = BTreeMap::from([("rig".to_owned(), "a".to_owned())]);
        let options = WriterOptions { split_bytes: Some(100_000), ..WriterOptions::default() };
        let info = RecordingInfo { metadata, ..RecordingInfo::default() };
        let mut writer = RecordingWriter::create(&path, &info, &options).unwrap();
        for sequence in 0..4 {
            let meta = FrameMeta {
                sequence,
                stamp_ns: sequence,
                width_px: 100,
                height_px: 200,
                stride_bytes: 100,
                ..FrameMeta::default()
            };
            writer.write_frame(&Frame { meta, bytes: &[7; 20_000] }).unwrap();
        }
        writer.finish().unwrap();
        files_of(&path)
    }

    #[test]
    fn a_split_recording_counts_and_goes_as_one() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let mut retention = Retention::new(&record(at, Some(2), None), "a");
        let first = split(at, "a-20261121-000000-000.mcap");
        assert!(first.len() > 2 && first.iter().all(|path| path.metadata().unwrap().len() < 100_000), "{first:?}");
        let second = split(at, "a-20261122-000000-000.mcap");
        let third = recording(at, "a-20261123-000000-000.mcap", "a", 0);
        for path in [&first[0], &second[0], &third] {
            retention.add(path);
        }
        // The files of a recording that is being written are not touched, however many there are.
        let removed = retention.enforce(Some(UnderWay { path: &first[0], bytes: 0 }));
        assert_eq!(removed, Vec::<String>::new());
        assert_eq!(retention.enforce(None).len(), 1);
        assert!(first.iter().all(|path| !path.exists()) && second.iter().all(|path| path.exists()));
        let bytes = |paths: &[PathBuf]| paths.iter().map(|path| path.metadata().unwrap().len()).sum::<u64>();
        let both = bytes(&second) + bytes(std::slice::from_ref(&third));
        let mut tight = Retention::new(&record(at, None, Some(both)), "a");
        assert_eq!(tight.enforce(None), Vec::<String>::new(), "all its files count, none twice");
        let mut tighter = Retention::new(&record(at, None, Some(both - 1)), "a");
        assert_eq!(tighter.enforce(None).len(), 1);
        assert_eq!(names(at).len(), 1);
    }

    #[test]
    fn an_open_recording_displaces_old_ones_as_it_grows() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let mut retention = Retention::new(&record(at, None, Some(450_000)), "a");
        for k in 0..3 {
            retention.add(&recording(at, &format!("a-2026112{k}-000000-000.mcap"), "a", 100_000));
        }
        let part = at.join("a-20261125-000000-000.mcap.part");
        fs::write(&part, vec![0; 200_000]).unwrap();
        let removed = retention.enforce_periodically(UnderWay { path: &part, bytes: 200_000 });
        assert!(removed.len() == 1 && removed[0].contains("a-20261120-000000-000.mcap"), "{removed:?}");
        let grown = UnderWay { path: &part, bytes: 10_000_000 };
        assert_eq!(retention.enforce_periodically(grown), Vec::<String>::new(), "not before the period is over");
        assert!(part.exists() && names(at).len() == 3);
    }
}
