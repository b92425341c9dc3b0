//! `ricochet recover`: recovers the complete messages of a damaged recording.

use crate::console::progress;
use crate::recording::{RecordingError, Recovered, recover_with_progress};
use std::io::{self, Write as _};
use std::path::PathBuf;

/// The steps of the progress bar.
const STEPS: u64 = 1000;

/// The options of `ricochet recover`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct RecoverOptions {
    /// Recording that was cut off; it is not changed.
    pub file: PathBuf,
    /// Recording to write.
    #[arg(short, long)]
    pub output: PathBuf,
}

/// Recovers a recording and prints a summary.
///
/// # Errors
///
/// [`RecordingError`] when the file cannot be opened or the new recording cannot be written.
pub fn run(options: &RecoverOptions) -> Result<Recovered, RecordingError> {
    let bar = progress::bar(STEPS, "recover");
    let report = |share: f64| bar.set_position((share * STEPS as f64) as u64);
    let recovered = recover_with_progress(&options.file, &options.output, report)?;
    bar.finish_and_clear();
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
