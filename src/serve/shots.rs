//! The recordings of a rig: their numbers, their collisions, and the shots that a person has rejected.

use super::numbers::status_reason;
use super::series::Series;
use super::shot_facts::ShotFacts;
use crate::config::Config;
use crate::recording::Recording;
use crate::results::Impact;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// The ending of recordings.
const ENDING: &str = ".mcap";
/// The ending of the file next to a recording that rejects it; its text is the reason.
const REJECTED: &str = ".rejected";
/// The maximum number of shots whose numbers are read and shown, the newest.
const MAX_SHOTS: usize = 200;
/// The maximum length of a reason, bytes.
const MAX_REASON_BYTES: usize = 500;

/// A request about a shot that cannot be fulfilled.
#[derive(Debug, thiserror::Error)]
pub(super) enum ShotError {
    /// No recording of the rig has this name.
    #[error("no recording of this name")]
    Unknown,
    /// The reason is not acceptable.
    #[error("a reason has 1 to {MAX_REASON_BYTES} bytes")]
    Reason,
    /// The file with the reason cannot be written.
    #[error("cannot write the reason: {0}")]
    Io(#[from] std::io::Error),
}

/// A file, as the folder lists it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Listed {
    modified: SystemTime,
    bytes: u64,
}

/// A recording with its number since the start of the server.
#[derive(Debug, Clone)]
struct Shot {
    number: u32,
    listed: Listed,
    /// `None` until the file was read.
    facts: Option<ShotFacts>,
    /// The reason why a person has rejected it.
    rejected: Option<String>,
}

/// The shots by their file names.
#[derive(Debug, Default)]
struct ShotList {
    shots: BTreeMap<String, Shot>,
    /// The number of the next new recording.
    next_number: u32,
    /// Rises with every change.
    revision: u64,
}

/// The recordings in the folder of a rig.
#[derive(Debug)]
pub(super) struct Shots {
    directory: Option<PathBuf>,
    rig: String,
    list: Mutex<ShotList>,
}

impl Shots {
    pub(super) fn new(config: &Config) -> Self {
        let directory = config.record.as_ref().map(|record| record.directory.clone());
        let list = Mutex::new(ShotList { next_number: 1, ..ShotList::default() });
        Self { directory, rig: config.rig.name.clone(), list }
    }

    /// Locks the list of the shots.
    fn lock_list(&self) -> MutexGuard<'_, ShotList> {
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a number that rises whenever a shot was added, removed, read, rejected or accepted.
    pub(super) fn revision(&self) -> u64 {
        self.lock_list().revision
    }

    /// Lists the folder, numbers new recordings from 1 in the order of their times, and returns the newest number, 0
    /// without any. Removed recordings leave the list; changed ones are read again later.
    pub(super) fn list(&self) -> u32 {
        let listed = self.read_folder();
        let mut list = self.lock_list();
        let mut fresh: Vec<_> = listed.iter().filter(|(name, _)| !list.shots.contains_key(*name)).collect();
        fresh.sort_by_key(|(name, listed)| (listed.modified, (*name).clone()));
        let before = list.shots.len();
        list.shots.retain(|name, _| listed.contains_key(name));
        list.revision += u64::from(before != list.shots.len() || !fresh.is_empty());
        for (name, listed) in fresh {
            let number = list.next_number;
            list.next_number += 1;
            list.shots.insert(name.clone(), Shot { number, listed: *listed, facts: None, rejected: None });
        }
        for (name, shot) in &mut list.shots {
            if listed.get(name).is_some_and(|listed| *listed != shot.listed) {
                (shot.listed, shot.facts) = (listed[name], None);
            }
        }
        list.next_number.saturating_sub(1)
    }

    /// Returns the recordings of this rig in the folder by their names. Links and files of other programs are left out.
    fn read_folder(&self) -> BTreeMap<String, Listed> {
        let Some(entries) = self.directory.as_ref().and_then(|directory| fs::read_dir(directory).ok()) else {
            return BTreeMap::new();
        };
        let listed = |entry: fs::DirEntry| {
            let name = entry.file_name().into_string().ok()?;
            let about = entry.metadata().ok().filter(fs::Metadata::is_file)?;
            let listed = Listed { modified: about.modified().ok()?, bytes: about.len() };
            name.ends_with(ENDING).then_some((name, listed))
        };
        let mut all: BTreeMap<_, _> = entries.flatten().filter_map(listed).collect();
        let known = self.lock_list().shots.keys().cloned().collect::<Vec<_>>();
        all.retain(|name, _| known.contains(name) || self.is_first_file(name));
        all
    }

    /// Whether this rig has made the file, and it is the first of its recording.
    fn is_first_file(&self, name: &str) -> bool {
        let Some(directory) = &self.directory else { return false };
        let metadata = Recording::peek_metadata(&directory.join(name)).ok().flatten().unwrap_or_default();
        let is_own = metadata.get("rig").is_some_and(|rig| *rig == self.rig);
        is_own && metadata.get("part").is_none_or(|part| part == "0")
    }

    /// Reads those of the newest [`MAX_SHOTS`] recordings that were not read yet, one at a time, and the reasons why
    /// they were rejected.
    pub(super) fn read(&self) {
        let Some(directory) = &self.directory else { return };
        let mut newest: Vec<(u32, String)> =
            self.lock_list().shots.iter().map(|(name, shot)| (shot.number, name.clone())).collect();
        newest.sort_by_key(|(number, _)| std::cmp::Reverse(*number));
        for (_, name) in newest.into_iter().take(MAX_SHOTS) {
            let rejected = fs::read_to_string(rejection_path_of(directory, &name)).ok();
            let rejected = rejected.map(|text| text.trim().to_owned());
            let is_unread = self.lock_list().shots.get(&name).is_some_and(|shot| shot.facts.is_none());
            // Read without the lock, because a request must not wait for a file.
            let facts = is_unread.then(|| ShotFacts::read(&directory.join(&name)));
            let mut list = self.lock_list();
            let Some(shot) = list.shots.get_mut(&name) else { continue };
            let is_news = facts.is_some() || shot.rejected != rejected;
            shot.rejected = rejected;
            if facts.is_some() {
                shot.facts = facts;
            }
            list.revision += u64::from(is_news);
        }
    }

    /// Returns the path of a recording of this rig, its first file; only names in the list have one.
    ///
    /// # Errors
    ///
    /// [`ShotError::Unknown`] for any other name.
    pub(super) fn path(&self, name: &str) -> Result<PathBuf, ShotError> {
        let directory = self.directory.as_ref().ok_or(ShotError::Unknown)?;
        let listed = self.lock_list().shots.keys().find(|known| *known == name).cloned().ok_or(ShotError::Unknown)?;
        Ok(directory.join(listed))
    }

    /// Rejects a shot for the reason `text`, which a file next to it keeps as one line.
    ///
    /// # Errors
    ///
    /// [`ShotError`] if there is no such shot, the reason is empty or too long, or the file cannot be written.
    pub(super) fn reject(&self, name: &str, text: &str) -> Result<(), ShotError> {
        let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
        if line.is_empty() || line.len() > MAX_REASON_BYTES {
            return Err(ShotError::Reason);
        }
        fs::write(rejection_path(&self.path(name)?), format!("{line}\n"))?;
        self.set_rejected(name, Some(line));
        Ok(())
    }

    /// Accepts a rejected shot again. A shot that is not rejected stays as it is.
    ///
    /// # Errors
    ///
    /// [`ShotError`] if there is no such shot, or the file with the reason cannot be removed.
    pub(super) fn accept(&self, name: &str) -> Result<(), ShotError> {
        match fs::remove_file(rejection_path(&self.path(name)?)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error.into()),
            _ => self.set_rejected(name, None),
        }
        Ok(())
    }

    /// Marks a shot in the list as rejected for a reason, or as accepted if `None`.
    fn set_rejected(&self, name: &str, rejected: Option<String>) {
        let mut list = self.lock_list();
        if let Some(shot) = list.shots.get_mut(name) {
            shot.rejected = rejected;
        }
        list.revision += 1;
    }

    /// Returns the size of the newest recording's first file, bytes; `None` without recordings.
    pub(super) fn newest_bytes(&self) -> Option<u64> {
        let list = self.lock_list();
        list.shots.values().max_by_key(|shot| shot.number).map(|shot| shot.listed.bytes)
    }

    /// Returns the folder of the recordings; `None` for a rig that records nothing.
    pub(super) fn directory(&self) -> Option<&Path> {
        self.directory.as_deref()
    }

    /// Returns the newest [`MAX_SHOTS`] shots as JSON, the newest first, and the mean and spread of the numbers of
    /// those that are not rejected.
    pub(super) fn as_json(&self) -> Value {
        let list = self.lock_list();
        let mut shots: Vec<(&String, &Shot)> = list.shots.iter().collect();
        shots.sort_by_key(|(_, shot)| std::cmp::Reverse(shot.number));
        shots.truncate(MAX_SHOTS);
        let impacts: Vec<_> = shots.iter().map(|(_, shot)| shot.impact()).collect();
        let accepted: Vec<_> =
            shots.iter().map(|(_, shot)| shot.impact().filter(|_| shot.rejected.is_none())).collect();
        let series = Series::new(&accepted);
        let rows: Vec<Value> = (shots.iter().zip(&impacts).enumerate())
            .map(|(at, ((name, shot), impact))| shot.as_json(name, series.numbers(at, *impact)))
            .collect();
        json!({ "revision": list.revision, "shots": rows, "series": series.as_json() })
    }
}

impl Shot {
    /// Returns the first collision, if the file was read and has one.
    fn impact(&self) -> Option<&Impact> {
        self.facts.as_ref()?.impact.as_ref()
    }

    /// Returns the shot as JSON, with the reason why its numbers are missing or doubtful.
    fn as_json(&self, name: &str, numbers: Vec<Value>) -> Value {
        let facts = self.facts.as_ref();
        let reason = match (facts, self.impact()) {
            (None, _) => Some("not read yet".to_owned()),
            (Some(facts), None) => facts.reason.clone(),
            (_, Some(impact)) => status_reason(impact.status).map(str::to_owned),
        };
        json!({
            "number": self.number, "name": name, "bytes": self.listed.bytes, "rejected": self.rejected,
            "time": facts.map(|facts| facts.time.as_str()), "reason": reason, "numbers": numbers,
            "stamp_ns": facts.map(|facts| facts.stamp_ns),
        })
    }
}

/// Returns the path of the file that keeps the reason why a shot was rejected.
fn rejection_path_of(directory: &Path, name: &str) -> PathBuf {
    rejection_path(&directory.join(name))
}

/// Returns the path of that file next to a recording.
fn rejection_path(recording: &Path) -> PathBuf {
    let mut path = recording.as_os_str().to_owned();
    path.push(REJECTED);
    path.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{RecordingInfo, RecordingWriter, WriterOptions};

    fn recording(directory: &Path, name: &str, rig: &str) {
        let metadata = BTreeMap::from([("rig".to_owned(), rig.to_owned())]);
        let info = RecordingInfo { metadata, ..RecordingInfo::default() };
        RecordingWriter::create(&directory.join(name), &info, &WriterOptions::default()).unwrap().finish().unwrap();
    }

    fn shots(directory: &Path) -> Shots {
        Shots { directory: Some(directory.into()), rig: "a".into(), list: Mutex::default() }
    }

    #[test]
    fn only_recordings_of_the_rig_have_a_path() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        recording(at, "a.mcap", "a");
        recording(at, "b.mcap", "b");
        fs::write(at.join("notes.txt"), "mine").unwrap();
        std::os::unix::fs::symlink(at.join("a.mcap"), at.join("link.mcap")).unwrap();
        let shots = shots(at);
        shots.list();
        assert_eq!(shots.path("a.mcap").unwrap(), at.join("a.mcap"));
        for name in ["b.mcap", "notes.txt", "link.mcap", "../a.mcap", "./a.mcap", "", ".", "/etc/passwd"] {
            assert!(matches!(shots.path(name), Err(ShotError::Unknown)), "{name}");
        }
    }

    #[test]
    fn a_rejected_shot_keeps_its_file_and_counts_no_more() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        recording(at, "a.mcap", "a");
        let shots = shots(at);
        shots.list();
        shots.read();
        shots.reject("a.mcap", " it <b>slipped</b>\n off ").unwrap();
        shots.read();
        assert_eq!(shots.as_json()["shots"][0]["rejected"], "it <b>slipped</b> off");
        assert!(at.join("a.mcap").exists() && at.join("a.mcap.rejected").exists());
        assert!(matches!(shots.reject("a.mcap", " \n"), Err(ShotError::Reason)));
        assert!(matches!(shots.reject("b.mcap", "x"), Err(ShotError::Unknown)));
        shots.accept("a.mcap").unwrap();
        shots.accept("a.mcap").unwrap();
        assert_eq!(shots.as_json()["shots"][0]["rejected"], Value::Null);
    }

    #[test]
    fn numbers_stay_when_older_shots_are_deleted() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        recording(at, "a-1.mcap", "a");
        let shots = Shots { list: Mutex::new(ShotList { next_number: 1, ..ShotList::default() }), ..shots(at) };
        assert_eq!(shots.list(), 1);
        recording(at, "a-2.mcap", "a");
        assert_eq!(shots.list(), 2);
        fs::remove_file(at.join("a-1.mcap")).unwrap();
        assert_eq!(shots.list(), 2);
        assert_eq!(shots.as_json()["shots"][0]["number"], 2);
        let revision = shots.revision();
        shots.list();
        assert_eq!(shots.revision(), revision, "nothing has changed");
    }
}
