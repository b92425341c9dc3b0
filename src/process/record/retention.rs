//! How many recordings stay: the oldest of this rig make room for new ones.

use super::Recorder;
use crate::config::Record;
use crate::message::EventKind;
use crate::process::clock::Every;
use crate::recording::Recording;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// How often the size of a recording under way is looked at.
const PERIOD: Duration = Duration::from_secs(1);
/// Digits of the date, the time and the milliseconds in a recording's name.
const STAMP_DIGITS: [usize; 3] = [8, 6, 3];

/// Keeps the folder of the recordings within its bounds.
#[derive(Debug)]
pub(super) struct Retention {
    directory: PathBuf,
    rig: String,
    keep_last: Option<usize>,
    max_bytes: Option<u64>,
    /// Finished by this recorder, oldest first: their order does not hang on the clock.
    made: Vec<PathBuf>,
    /// Could not be removed; told once.
    stuck: BTreeSet<PathBuf>,
    every: Every,
}

/// A finished recording of this rig.
#[derive(Debug)]
struct Kept {
    path: PathBuf,
    bytes: u64,
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
            every: Every::new(PERIOD),
        }
    }

    /// A recording was finished: it is the newest.
    pub(super) fn add(&mut self, path: &Path) {
        self.made.push(path.to_path_buf());
    }

    /// Removes what is too much, beside `written_bytes` of a recording under way; one line for each file.
    ///
    /// The newest finished recording stays, whatever its size.
    pub(super) fn enforce(&mut self, written_bytes: u64) -> Vec<String> {
        if self.keep_last.is_none() && self.max_bytes.is_none() {
            return Vec::new();
        }
        let kept = self.finished();
        let mut count = kept.len();
        let mut bytes = kept.iter().fold(written_bytes, |sum, kept| sum.saturating_add(kept.bytes));
        let mut told = Vec::new();
        for oldest in &kept {
            let reason = match (self.keep_last, self.max_bytes) {
                _ if count <= 1 => break,
                (Some(last), _) if count > last => format!("keep_last = {last}"),
                (_, Some(most)) if bytes > most => format!("max_bytes = {most}"),
                _ => break,
            };
            count -= 1;
            bytes -= oldest.bytes;
            // An event has room for 200 bytes; the folder is that of the rig file.
            let name = oldest.path.file_name().unwrap_or_default().to_string_lossy();
            match fs::remove_file(&oldest.path) {
                Ok(()) => {
                    told.push(format!("removed {name}, {} bytes: {reason}", oldest.bytes));
                    self.made.retain(|path| *path != oldest.path);
                }
                // No newer one goes in its place.
                Err(error) if self.stuck.insert(oldest.path.clone()) => {
                    log::warn!("cannot remove {name}: {error}");
                    told.push(format!("cannot remove {name}: {error}"));
                }
                Err(_) => {}
            }
        }
        told
    }

    /// As [`enforce`](Self::enforce), when it is time again.
    pub(super) fn look(&mut self, part: &Path) -> Vec<String> {
        if self.max_bytes.is_none() || !self.every.due() {
            return Vec::new();
        }
        self.enforce(part.metadata().map_or(0, |about| about.len()))
    }

    /// The finished recordings of this rig, oldest first.
    fn finished(&self) -> Vec<Kept> {
        let Ok(entries) = fs::read_dir(&self.directory) else { return Vec::new() };
        let mut kept: Vec<((usize, SystemTime, PathBuf), Kept)> = entries
            .filter_map(|entry| {
                let entry = entry.ok()?;
                // Links are not followed: what they lead to is not this folder's.
                let about = entry.metadata().ok().filter(fs::Metadata::is_file)?;
                let path = entry.path();
                let of_this_rig = is_name(entry.file_name().to_str()?, &self.rig) && is_from(&path, &self.rig);
                let rank = self.made.iter().position(|made| *made == path).map_or(0, |at| at + 1);
                let modified = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                of_this_rig.then(|| ((rank, modified, path.clone()), Kept { path, bytes: about.len() }))
            })
            .collect();
        kept.sort_by(|a, b| a.0.cmp(&b.0));
        kept.into_iter().map(|(_, kept)| kept).collect()
    }
}

/// Whether a recorder of this rig gives such names: `RIG-20261121-083000-123.mcap`, or that with `-2`, `-3`, ...
fn is_name(name: &str, rig: &str) -> bool {
    let stamp = name.strip_prefix(rig).and_then(|rest| rest.strip_prefix('-')).and_then(|r| r.strip_suffix(".mcap"));
    let Some(stamp) = stamp else { return false };
    let parts: Vec<&str> = stamp.split('-').collect();
    let are_digits = parts.iter().all(|part| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit()));
    are_digits && (3..=4).contains(&parts.len()) && parts.iter().zip(STAMP_DIGITS).all(|(part, n)| part.len() == n)
}

/// Whether the file says itself that this rig recorded it.
fn is_from(path: &Path, rig: &str) -> bool {
    // Every second while a stream is written: the front of each file is all that may be read.
    let metadata = Recording::peek_metadata(path).ok().flatten();
    metadata.is_some_and(|entries| entries.get("rig").is_some_and(|name| name == rig))
}

impl Recorder<'_> {
    /// Tells which recordings made room.
    pub(super) fn tell_removed(&mut self, told: Vec<String>) -> anyhow::Result<()> {
        for text in told {
            self.reporter.event(EventKind::Storage, self.newest.0, self.newest.1, &text)?;
        }
        Ok(())
    }

    /// Sees that a recording under way leaves the folder within its bounds.
    pub(super) fn look_at_retention(&mut self) -> anyhow::Result<()> {
        let Some(active) = &self.shot else { return Ok(()) };
        let told = self.retention.look(active.shot.part());
        self.tell_removed(told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Compression;
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
        }
    }

    /// A recording of this rig with an attachment of so many bytes.
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
    fn only_names_that_a_recorder_gives_are_its_own() {
        for name in ["a-20261121-083000-123.mcap", "a-20261121-083000-123-2.mcap", "a-20261121-083000-123-10.mcap"] {
            assert!(is_name(name, "a"), "{name}");
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
            assert!(!is_name(name, "a"), "{name}");
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
        // Of our form and name, but another rig says that it is its own.
        recording(at, "a-20200101-000000-002.mcap", "b", 0);
        let target = recording(at, "target", "a", 0);
        std::os::unix::fs::symlink(&target, at.join("a-20200101-000000-003.mcap")).unwrap();
        let told = retention.enforce(0);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].contains("a-20261124-000000-000.mcap") && told[0].ends_with("keep_last = 2"), "{told:?}");
        let left = names(at);
        for name in foreign.iter().chain(&["a-20261122-000000-000.mcap", "a-20261121-000000-000.mcap", "target"]) {
            assert!(left.contains(&(*name).to_owned()), "{name} of {left:?}");
        }
        assert_eq!(left.len(), 9, "{left:?}");
        assert_eq!(retention.enforce(0), Vec::<String>::new());
    }

    #[test]
    fn bytes_are_bounded_with_those_being_written_but_the_newest_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        for k in 0..5 {
            // Made by a recorder before this one: their times tell the order.
            let path = recording(at, &format!("a-2026112{k}-000000-000.mcap"), "a", 100_000);
            let time = SystemTime::UNIX_EPOCH + Duration::from_secs(1000 + k);
            fs::File::options().append(true).open(path).unwrap().set_modified(time).unwrap();
        }
        let left = |written_bytes: u64| {
            Retention::new(&record(at, None, Some(450_000)), "a").enforce(written_bytes);
            names(at).into_iter().map(|name| name[9..10].to_owned()).collect::<String>()
        };
        assert_eq!(left(0), "1234");
        assert_eq!(left(150_000), "34");
        assert_eq!(left(10_000_000), "4");
    }

    #[test]
    fn a_recording_under_way_drives_old_ones_out_as_it_grows() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let mut retention = Retention::new(&record(at, None, Some(450_000)), "a");
        for k in 0..3 {
            retention.add(&recording(at, &format!("a-2026112{k}-000000-000.mcap"), "a", 100_000));
        }
        let part = at.join("a-20261125-000000-000.mcap.part");
        fs::write(&part, vec![0; 200_000]).unwrap();
        let told = retention.look(&part);
        assert!(told.len() == 1 && told[0].contains("a-20261120-000000-000.mcap"), "{told:?}");
        fs::write(&part, vec![0; 10_000_000]).unwrap();
        assert_eq!(retention.look(&part), Vec::<String>::new(), "not before it is time again");
        assert!(part.exists() && names(at).len() == 3);
    }
}
