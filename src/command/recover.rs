//! `ricochet recover`: a whole file out of what is left of one.

use crate::recording::{RecordingError, Recovered, recover};
use std::io::{self, Write as _};
use std::path::PathBuf;

/// What to recover, and where to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecoverOptions {
    /// The damaged or unfinished recording; it is left as it is.
    pub file: PathBuf,
    /// The new one; it may not exist yet.
    pub output: PathBuf,
}

/// Recovers, and prints what was saved and what was not.
///
/// # Errors
///
/// [`RecordingError`] when the file cannot be opened or the new one not written.
pub fn run(options: &RecoverOptions) -> Result<Recovered, RecordingError> {
    let recovered = recover(&options.file, &options.output)?;
    let mut text = format!(
        "{}: {} frames and {} other messages\n",
        recovered.path.display(),
        recovered.frames,
        recovered.messages - recovered.frames
    );
    for reason in &recovered.skipped {
        text.push_str(&format!("not recovered: {reason}\n"));
    }
    let written = io::stdout().lock().write_all(text.as_bytes());
    written.map_err(|source| RecordingError::Io { action: "print", path: options.file.clone(), source })?;
    Ok(recovered)
}
