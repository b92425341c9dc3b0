//! Directories that results are written into.

use std::path::Path;

use super::FieldError;

/// Makes a directory that is not there yet.
///
/// # Errors
///
/// One line when something else has its name, or it cannot be made.
pub(in crate::command) fn make(option: &str, path: &Path) -> Result<(), FieldError> {
    if path.exists() && !path.is_dir() {
        return Err(FieldError::Usage(format!("{option} {}: is a file, a directory is needed", path.display())));
    }
    std::fs::create_dir_all(path).map_err(|error| FieldError::write(path, error))
}
