//! `ricochet completions` and `ricochet man`: files for the shell and the manual.

use crate::console::{Outcome, UsageError};
use crate::failure::Failure;
use clap::Command;
use std::io::Write;
use std::path::Path;

/// Prints the completions of a shell.
///
/// # Errors
///
/// When standard output is closed.
pub fn completions(shell: clap_complete::Shell, mut program: Command) -> Result<Outcome, Failure> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut program, "ricochet", &mut text);
    std::io::stdout().lock().write_all(&text)?;
    Ok(Outcome::Clean)
}

/// Prints the manual page of the program or of a command, or writes all pages into a folder.
///
/// # Errors
///
/// An unknown command, or a folder that takes no file.
pub fn manual(command: Option<&str>, folder: Option<&Path>, mut program: Command) -> Result<Outcome, Failure> {
    program.build();
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder)?;
        clap_mangen::generate_to(program, folder)?;
        return Ok(Outcome::Clean);
    }
    let page = match command {
        None => program,
        Some(name) => {
            let found = program.find_subcommand(name).cloned();
            found.ok_or_else(|| UsageError(format!("no command {name:?}; see `ricochet --help`")))?
        }
    };
    Ok(clap_mangen::Man::new(page).render(&mut std::io::stdout().lock()).map(|()| Outcome::Clean)?)
}
