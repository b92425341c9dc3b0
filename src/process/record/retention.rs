//! How many recordings stay: the oldest of this rig make room for new ones.

use super::Recorder;
use crate::config::Record;
use crate::message::EventKind;
use crate::process::clock::Every;
use crate::recording::{Recording, files_of};
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
    /// Its first file.
    path: PathBuf,
    /// The files it goes on in.
    later: Vec<PathBuf>,
    /// What all of them take.
    bytes: u64,
}

/// A recording that is being written.
#[derive(Debug, Clone, Copy)]
pub(super) struct UnderWay<'a> {
    /// Its first file, which is finished when it was split.
    pub(super) path: &'a Path,
    /// What its files take so far.
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
            every: Every::new(PERIOD),
        }
    }

    /// A recording was finished: it is the newest.
    pub(super) fn add(&mut self, path: &Path) {
        self.made.push(path.to_path_buf());
    }

    /// Removes what is too much, beside a recording under way; one line for each recording.
    ///
    /// The newest finished recording stays, whatever its size.
    pub(super) fn enforce(&mut self, under_way: Option<UnderWay<'_>>) -> Vec<String> {
        if self.keep_last.is_none() && self.max_bytes.is_none() {
            return Vec::new();
        }
        let mut kept = self.finished();
        kept.retain(|kept| under_way.is_none_or(|under_way| under_way.path != kept.path));
        let written_bytes = under_way.map_or(0, |under_way| under_way.bytes);
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
            // The first goes last: while it is there, so is what leads to the others.
            let mut files = oldest.later.iter().rev().chain([&oldest.path]);
            match files.try_for_each(fs::remove_file) {
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
    pub(super) fn look(&mut self, under_way: UnderWay<'_>) -> Vec<String> {
        if self.max_bytes.is_none() || !self.every.due() {
            return Vec::new();
        }
        self.enforce(Some(under_way))
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
                of_this_rig.then(|| {
                    let later: Vec<PathBuf> = files_of(&path).into_iter().skip(1).collect();
                    let of_later = |path: &PathBuf| fs::symlink_metadata(path).map_or(0, |about| about.len());
                    let bytes = about.len() + later.iter().map(of_later).sum::<u64>();
                    ((rank, modified, path.clone()), Kept { path, later, bytes })
                })
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
            self.event(EventKind::Storage, &text)?;
        }
        Ok(())
    }

    /// Sees that a recording under way leaves the folder within its bounds.
    pub(super) fn look_at_retention(&mut self) -> anyhow::Result<()> {
        let Some(active) = &self.shot else { return Ok(()) };
        let under_way = UnderWay { path: active.shot.path(), bytes: active.shot.written_bytes() };
        let told = self.retention.look(under_way);
        self.tell_removed(told)
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
        let told = retention.enforce(None);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].contains("a-20261124-000000-000.mcap") && told[0].ends_with("keep_last = 2"), "{told:?}");
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
            // Made by a recorder before this one: their times tell the order.
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

    /// A recording of this rig that was split into files of at most 100 kB.
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
            writer.frame(&Frame { meta, bytes: &[7; 20_000] }).unwrap();
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
        let told = retention.enforce(Some(UnderWay { path: &first[0], bytes: 0 }));
        assert_eq!(told, Vec::<String>::new());
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
    fn a_recording_under_way_drives_old_ones_out_as_it_grows() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let mut retention = Retention::new(&record(at, None, Some(450_000)), "a");
        for k in 0..3 {
            retention.add(&recording(at, &format!("a-2026112{k}-000000-000.mcap"), "a", 100_000));
        }
        let part = at.join("a-20261125-000000-000.mcap.part");
        fs::write(&part, vec![0; 200_000]).unwrap();
        let told = retention.look(UnderWay { path: &part, bytes: 200_000 });
        assert!(told.len() == 1 && told[0].contains("a-20261120-000000-000.mcap"), "{told:?}");
        let grown = UnderWay { path: &part, bytes: 10_000_000 };
        assert_eq!(retention.look(grown), Vec::<String>::new(), "not before it is time again");
        assert!(part.exists() && names(at).len() == 3);
    }
}
