//! The output files of the convergence study.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use crate::command::field::{FieldError, folder};
use crate::console::UsageError;
use crate::failure::Failure;
use crate::study::convergence::Study;
use crate::study::convergence::{Files, image_pairs};

/// An open file and its path.
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
    /// Creates the directory and both files, replacing existing ones.
    ///
    /// # Errors
    ///
    /// When the directory is a file, a file is an input, or a file cannot be created.
    pub(super) fn open(directory: &Path, inputs: Option<Files<'_>>) -> Result<Self, Failure> {
        folder::make("--output", directory)?;
        let paths = ["convergence.csv", "convergence.svg"].map(|name| directory.join(name));
        if let Some(path) = paths.iter().find(|path| image_pairs::is_input(inputs, path)) {
            let reason = format!("{}: cannot write: it would overwrite one of the images", path.display());
            return Err(UsageError(reason).into());
        }
        let open = |path: PathBuf| match File::create(&path) {
            Ok(file) => Ok(Opened { path, file }),
            Err(error) => Err(FieldError::write(&path, error)),
        };
        let [table, figure] = paths.map(open);
        Ok(Self { table: table?, figure: figure? })
    }

    /// Writes the results.
    ///
    /// # Errors
    ///
    /// [`FieldError`] naming the file that cannot be written.
    pub(super) fn write(self, study: &Study<'_>) -> Result<(), Failure> {
        let Self { table, mut figure } = self;
        study.write_csv(table.file).map_err(|error| FieldError::write(&table.path, error))?;
        let written = figure.file.write_all(study.figure().as_bytes());
        written.map_err(|error| FieldError::write(&figure.path, error))?;
        Ok(())
    }
}
