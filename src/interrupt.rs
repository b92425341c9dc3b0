//! The end of the program by Ctrl-C or a termination signal: nothing unfinished is left.
//!
//! A command that works on files ends at the signal, wherever it is: in a long computation, in a read from a slow disk,
//! while another program decodes a film. Whatever must not outlast it is noted here while it is unfinished: [`file()`],
//! [`note`], [`program`]. A command that runs a rig ends in order instead, since others depend on what it still has to do.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::Child;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::failure::{ExitCode, Fatal};
use rustix::process::{Pid, Signal, kill_process};

/// A thing that must not outlast the program.
enum Item {
    /// A file that is not complete.
    File(PathBuf),
    /// A program that works for this one.
    Program(Pid),
}

/// Everything that is unfinished at present.
struct Register {
    next: u64,
    items: BTreeMap<u64, Item>,
    advice: &'static str,
    /// Whether a signal may end the program at any moment.
    may_end: bool,
}

static REGISTER: Mutex<Register> = Mutex::new(Register { next: 0, items: BTreeMap::new(), advice: "", may_end: false });

/// Opens the register, also after a thread that had it open has panicked.
fn open_register() -> MutexGuard<'static, Register> {
    REGISTER.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file or a program that is unfinished as long as this exists.
#[derive(Debug)]
pub struct Unfinished(u64);

impl Drop for Unfinished {
    fn drop(&mut self) {
        open_register().items.remove(&self.0);
    }
}

impl Register {
    fn note(&mut self, item: Item) -> Unfinished {
        self.next += 1;
        self.items.insert(self.next, item);
        Unfinished(self.next)
    }
}

/// The error of a command that stops a camera or a rig in order when it is interrupted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted; nothing unfinished is left")]
pub struct Interrupted;

impl Fatal for Interrupted {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Interrupted
    }
}

/// Creates a file with `create`, and notes its path as unfinished. Both happen at once for a signal.
///
/// # Errors
///
/// Those of `create`; then nothing is noted.
pub fn file<T, E>(path: &Path, create: impl FnOnce() -> Result<T, E>) -> Result<(T, Unfinished), E> {
    let mut register = open_register();
    let created = create()?;
    Ok((created, register.note(Item::File(path.to_owned()))))
}

/// Notes a file that no other program creates, such as one with the number of this process in its name, or one of
/// several that are complete only together.
pub fn note(path: &Path) -> Unfinished {
    open_register().note(Item::File(path.to_owned()))
}

/// Starts a program with `start`, and notes it as unfinished. Both happen at once for a signal.
///
/// # Errors
///
/// Those of `start`; then nothing is noted.
pub fn program(start: impl FnOnce() -> io::Result<Child>) -> io::Result<(Child, Unfinished)> {
    let mut register = open_register();
    let child = start()?;
    let pid = Pid::from_child(&child);
    Ok((child, register.note(Item::Program(pid))))
}

/// Lets a signal end the program at any moment from now on, since nothing needs an orderly end.
pub fn allow_end() {
    open_register().may_end = true;
}

/// Sets what the user is advised after an interruption, such as how the work can be continued.
pub fn set_advice(advice: &'static str) {
    open_register().advice = advice;
}

/// Waits for the end of the program if it is about to end at a signal, so that the errors which that causes are not
/// reported.
pub fn settle() {
    drop(open_register());
}

/// Ends the program as `signal` does by default, after the unfinished files are removed and the programs stopped. Has no
/// effect before [`allow_end`].
///
/// A shell reports 128 plus the number of the signal, and ends a script at Ctrl-C.
pub fn end(signal: i32) {
    // Never given back, so that no other thread creates or completes anything any more.
    let register = open_register();
    if !register.may_end {
        return;
    }
    for item in register.items.values() {
        match item {
            Item::File(path) => drop(std::fs::remove_file(path)),
            Item::Program(pid) => drop(kill_process(*pid, Signal::KILL)),
        }
    }
    let advice = if register.advice.is_empty() { "nothing unfinished is left" } else { register.advice };
    // From the beginning of the line, which a progress bar or ^C may have taken.
    let _ = writeln!(io::stderr(), "\rricochet: interrupted; {advice}");
    let _ = signal_hook::low_level::emulate_default_handler(signal);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_noted(path: &Path) -> bool {
        open_register().items.values().any(|item| matches!(item, Item::File(noted) if noted == path))
    }

    #[test]
    fn a_file_is_noted_as_long_as_its_guard_exists_and_not_if_it_was_not_created() {
        let path = Path::new("unfinished-file-of-a-test");
        let ((), guard) = file(path, || Ok::<(), io::Error>(())).unwrap();
        assert!(is_noted(path));
        drop(guard);
        assert!(!is_noted(path));
        assert!(file(path, || Err::<(), _>(io::Error::other("no space"))).is_err());
        assert!(!is_noted(path));
    }
}
