//! The files in which a system describes itself.

use std::path::{Path, PathBuf};

/// A system, by the folder that stands for its root.
pub(super) struct Host {
    root: PathBuf,
}

impl Host {
    /// Returns the system whose root is this folder.
    pub fn new(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Returns the path of a file of the system, below the root folder.
    pub fn path(&self, path: &str) -> PathBuf {
        self.root.join(path.trim_start_matches('/'))
    }

    /// Reads a file; `None` if there is none or it cannot be read.
    pub fn read(&self, path: &str) -> Option<String> {
        std::fs::read_to_string(self.path(path)).ok().map(|text| text.trim().to_owned())
    }

    /// Reads a file that holds one whole number; `None` for any other.
    pub fn number(&self, path: &str) -> Option<u64> {
        self.read(path)?.parse().ok()
    }

    /// Returns the names in a folder, sorted; none if it does not exist.
    pub fn names(&self, path: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(path)).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        names.sort();
        names
    }

    /// Returns the command that writes a word into a file of the system.
    pub fn write_command(&self, path: &str, word: &str) -> String {
        format!("echo {word} > {}", self.path(path).display())
    }
}
