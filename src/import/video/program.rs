//! The programs ffmpeg and ffprobe: started, read line by line, and stopped.

use super::super::ImportError;
use crate::interrupt::{self, Unfinished};
use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

/// Maximum length of a line, bytes. The rest of a longer one is skipped.
const MAX_LINE_BYTES: u64 = 4 << 10;
/// Number of lines that may wait to be read.
const MAX_WAITING_LINES: usize = 256;
/// Maximum time without output, after which a program hangs.
const HANG_TIMEOUT: Duration = Duration::from_secs(60);

/// A running program. It is stopped when it is dropped.
pub(super) struct Program {
    child: Child,
    name: &'static str,
    path: PathBuf,
    _unfinished: Unfinished,
}

impl Program {
    /// Starts `name` with `options` separated by spaces, then with `arguments`.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the program is not installed or does not start.
    pub(super) fn start(
        name: &'static str,
        options: &str,
        arguments: &[OsString],
        path: &Path,
    ) -> Result<Self, ImportError> {
        let mut command = Command::new(name);
        command.args(options.split_whitespace()).args(arguments);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let (child, unfinished) = interrupt::program(|| command.spawn()).map_err(|error| match error.kind() {
            ErrorKind::NotFound => ImportError::invalid(
                path,
                format!("needs the program {name}, which is not installed (Debian, Ubuntu: apt install ffmpeg)"),
            ),
            _ => ImportError::invalid(path, format!("needs the program {name}, which does not start: {error}")),
        })?;
        Ok(Self { child, name, path: path.to_path_buf(), _unfinished: unfinished })
    }

    /// Takes the pipe of the program's output; `None` if it was taken.
    pub(super) fn stdout(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Takes the pipe of the program's messages; `None` if it was taken.
    pub(super) fn stderr(&mut self) -> Option<ChildStderr> {
        self.child.stderr.take()
    }

    /// Receives what a thread reads from the program; `None` when the program has closed its output.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] when the program hangs.
    pub(super) fn receive<T>(&self, from: &Receiver<T>) -> Result<Option<T>, ImportError> {
        match from.recv_timeout(HANG_TIMEOUT) {
            Ok(item) => Ok(Some(item)),
            Err(RecvTimeoutError::Disconnected) => Ok(None),
            Err(RecvTimeoutError::Timeout) => {
                let reason = format!("{} hangs: no output for {} s", self.name, HANG_TIMEOUT.as_secs());
                Err(ImportError::invalid(&self.path, reason))
            }
        }
    }

    /// Waits for the end of a program that has closed its output, and returns whether it succeeded.
    pub(super) fn has_succeeded(&mut self) -> Result<bool, ImportError> {
        let status = self.child.wait().map_err(|error| ImportError::io("read", &self.path, error))?;
        Ok(status.success())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Reads the lines of a pipe on a thread of its own and returns the channel that they come by. [`MAX_WAITING_LINES`]
/// may wait to be taken.
pub(super) fn spawn_line_reader(pipe: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = sync_channel(MAX_WAITING_LINES);
    std::thread::spawn(move || {
        let mut pipe = BufReader::new(pipe);
        while let Some(line) = read_line(&mut pipe) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

/// Reads a pipe to its end on a thread of its own, so that the program never stops at a full one, and sends the first
/// `bytes` of its text.
pub(super) fn spawn_text_reader(mut pipe: impl Read + Send + 'static, bytes: u64) -> Receiver<String> {
    let (sender, receiver) = sync_channel(1);
    std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = pipe.by_ref().take(bytes).read_to_end(&mut text);
        let _ = std::io::copy(&mut pipe, &mut std::io::sink());
        let _ = sender.send(String::from_utf8_lossy(&text).into_owned());
    });
    receiver
}

/// Reads the next line without trailing white space. Its part beyond [`MAX_LINE_BYTES`] is skipped. `None` at the end,
/// or if the pipe cannot be read.
pub(super) fn read_line(pipe: &mut impl BufRead) -> Option<String> {
    let mut line = Vec::new();
    let read = pipe.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line);
    read.ok().filter(|bytes| *bytes > 0)?;
    if !line.ends_with(b"\n") && line.len() as u64 == MAX_LINE_BYTES {
        let _ = pipe.skip_until(b'\n');
    }
    Some(String::from_utf8_lossy(&line).trim_end().to_owned())
}

/// Returns the URL of a file, which keeps ffmpeg from reading its name as an option or a protocol.
pub(super) fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}
