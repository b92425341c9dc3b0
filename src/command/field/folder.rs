//! Output directories.

use std::path::Path;

use super::FieldError;

/// Creates a directory if it is missing.
///
/// # Errors
///
/// When a file has this name, or the directory cannot be created.
pub(crate) fn make(option: &str, path: &Path) -> Result<(), FieldError> {
    if path.exists() && !path.is_dir() {
        return Err(FieldError::Usage(format!("{option} {}: is a file, expected a directory", path.display())));
    }
    std::fs::create_dir_all(path).map_err(|error| FieldError::write(path, error))
}
