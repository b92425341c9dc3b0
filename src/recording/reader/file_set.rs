//! Several files as one recording: one that was split by size, or the parts of one stream.

use super::{RecordedFile, Recording};
use crate::recording::{CONTINUED_NAME, RecordingError, part_path, split};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The files of a recording after the first.
#[derive(Debug, Default)]
pub(super) struct Rest {
    pub(super) files: Vec<Arc<RecordedFile>>,
    /// Why a later file, or their sequence, ends early.
    pub(super) truncated: Option<String>,
    /// Damage of all files, each with its name.
    pub(super) damage: Vec<String>,
}

/// Returns the existing files of the recording that begins in `first`, in order, up to the first gap in their numbers.
pub fn files_of(first: &Path) -> Vec<PathBuf> {
    let about = |path: &Path| Recording::peek_metadata(path).ok().flatten();
    let name = about(first).and_then(|entries| split::first_name(&entries).map(str::to_owned));
    let Some(name) = name else { return vec![first.to_path_buf()] };
    let later = (1..).map(|number| (number, split::numbered(first, number)));
    let belongs =
        |(number, path): &(u32, PathBuf)| about(path).is_some_and(|found| split::is_part(&found, *number, &name));
    std::iter::once(first.to_path_buf()).chain(later.take_while(belongs).map(|(_, path)| path)).collect()
}

impl Recording {
    /// Opens a recording and reads its structure, but no frames.
    ///
    /// The first file of a split recording opens the later ones too. A file that was cut off opens as far as it is
    /// readable. [`truncated`](Self::truncated) reports it, and reports a missing later file.
    ///
    /// # Errors
    ///
    /// [`RecordingError::Io`] when there is no such file or the system fails; [`RecordingError::Invalid`] when it is
    /// not an MCAP file.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let mut files = vec![Self::open_one(path)?];
        let mut missing = None;
        let Some(name) = files[0].split_name() else { return Ok(files.remove(0)) };
        let (name, mut number) = (name.to_owned(), 0);
        while files.last().is_some_and(Self::is_continued) {
            number += 1;
            let next = split::numbered(path, number);
            let known = Self::peek_metadata(&next).ok().flatten();
            let belongs = known.is_some_and(|entries| split::is_part(&entries, number, &name));
            if !belongs {
                let next = next.file_name().unwrap_or_default().to_string_lossy().into_owned();
                let is_cut = part_path(&split::numbered(path, number)).exists();
                let found = if is_cut { "unfinished; `ricochet recover` completes it" } else { "missing" };
                missing = Some(format!("it continues in {next}, which is {found}"));
                break;
            }
            files.push(Self::open_one(&next)?);
        }
        Ok(Self::from_files(files, missing))
    }

    /// Opens several recordings. A later file of a split recording is merged with its first file.
    ///
    /// # Errors
    ///
    /// The errors of [`open`](Self::open).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn open_all(paths: &[PathBuf]) -> Result<Vec<Self>, RecordingError> {
        let all = paths.iter().map(|path| Self::open(path)).collect::<Result<Vec<_>, _>>()?;
        let place = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
        let later = all.iter().flat_map(|recording| recording.files().skip(1).map(place)).collect::<BTreeSet<_>>();
        Ok(all.into_iter().filter(|recording| !later.contains(&place(recording.path()))).collect())
    }

    /// Joins several recordings to one, with messages in the order of their time; `None` without any.
    ///
    /// The caller decides whether they belong together.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn joined(recordings: Vec<Self>) -> Option<Self> {
        let missing = recordings.iter().find_map(|recording| recording.rest.truncated.clone());
        let singles = recordings.iter().flat_map(Self::singles).collect::<Vec<_>>();
        (!singles.is_empty()).then(|| Self::from_files(singles, missing))
    }

    /// Returns the paths of the files in order.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.all_files().map(|inner| inner.path.as_path())
    }

    /// Returns each file as a recording of its own.
    pub(in super::super) fn singles(&self) -> impl Iterator<Item = Self> {
        self.all_files().map(Self::single)
    }

    /// Returns all files in order.
    pub(super) fn all_files(&self) -> impl Iterator<Item = &Arc<RecordedFile>> {
        std::iter::once(&self.inner).chain(&self.rest.files)
    }

    /// Prefixes a text about one of several files with the name of the file.
    pub(super) fn named(&self, inner: &RecordedFile, text: &str) -> String {
        let name = inner.path.file_name().unwrap_or_default().to_string_lossy();
        if self.rest.files.is_empty() { text.to_owned() } else { format!("{name}: {text}") }
    }

    /// Returns one file as a recording of its own.
    fn single(inner: &Arc<RecordedFile>) -> Self {
        Self { inner: Arc::clone(inner), rest: Arc::default() }
    }

    /// Joins files to one recording. `missing` is the reason why a later file was not opened; a file that was cut off
    /// outranks it.
    ///
    /// # Panics
    ///
    /// When there is no file.
    fn from_files(files: Vec<Self>, missing: Option<String>) -> Self {
        let mut all_files = files.into_iter().map(|file| file.inner).collect::<Vec<_>>();
        let inner = all_files.remove(0);
        let whole = Self { inner, rest: Arc::new(Rest { files: all_files, ..Rest::default() }) };
        let collect = |of: fn(&RecordedFile) -> Vec<String>| -> Vec<String> {
            let named =
                |inner: &Arc<RecordedFile>| of(inner).into_iter().map(|text| whole.named(inner, &text)).collect();
            whole.all_files().flat_map::<Vec<String>, _>(named).collect()
        };
        let cut = collect(|inner| inner.structure.truncated.iter().cloned().collect());
        let rest = Rest {
            truncated: cut.into_iter().next().or(missing),
            damage: collect(|inner| inner.damage.clone()),
            files: whole.rest.files.clone(),
        };
        Self { inner: whole.inner, rest: Arc::new(rest) }
    }

    /// Returns the name of the first file, by which the files of a split recording refer to it, if this is that file.
    fn split_name(&self) -> Option<&str> {
        split::first_name(self.metadata())
    }

    /// Whether the file ends with a note that it continues in a next one.
    fn is_continued(&self) -> bool {
        self.metadata_records().iter().any(|(name, _)| name == CONTINUED_NAME)
    }
}
