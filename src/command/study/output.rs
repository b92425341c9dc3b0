//! The files of a study.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::pairs::{self, Files};
use super::tell::Study;
use crate::command::UsageError;
use crate::command::field::{FieldError, folder};

/// A file that is open for writing, and its name.
#[derive(Debug)]
struct Opened {
    path: PathBuf,
    file: File,
}

/// The table and the figure in a directory.
#[derive(Debug)]
pub(super) struct Output {
    table: Opened,
    figure: Opened,
}

impl Output {
    /// Makes the directory and both files; files of these names are replaced.
    ///
    /// # Errors
    ///
    /// One line when the directory is a file, or when one of the files is an input or cannot be made.
    pub(super) fn open(directory: &Path, inputs: Option<&Files>) -> anyhow::Result<Self> {
        folder::make("--output", directory)?;
        let paths = ["convergence.csv", "convergence.svg"].map(|name| directory.join(name));
        if let Some(path) = paths.iter().find(|path| pairs::is_input(inputs, path)) {
            let told = format!("{}: is one of the images, and would be overwritten", path.display());
            return Err(UsageError(told).into());
        }
        let open = |path: PathBuf| match File::create(&path) {
            Ok(file) => Ok(Opened { path, file }),
            Err(error) => Err(FieldError::write(&path, error)),
        };
        let [table, figure] = paths.map(open);
        Ok(Self { table: table?, figure: figure? })
    }

    /// Writes what came out.
    ///
    /// # Errors
    ///
    /// One line naming the file that cannot be written.
    pub(super) fn write(self, study: &Study<'_>) -> anyhow::Result<()> {
        let Self { table, mut figure } = self;
        study.write_csv(table.file).map_err(|error| FieldError::write(&table.path, error))?;
        let written = figure.file.write_all(study.figure().as_bytes());
        written.map_err(|error| FieldError::write(&figure.path, error))?;
        Ok(())
    }
}
