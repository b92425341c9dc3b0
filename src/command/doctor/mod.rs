//! `ricochet doctor`: finds what on this machine keeps a rig from working well, with the command that mends it.

mod cameras;
mod host;
mod machine;
mod network;
mod storage;
mod tools;
mod user;

use crate::config::Config;
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use host::Host;
use serde_json::json;
use std::path::PathBuf;

/// The options of `ricochet doctor`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct DoctorOptions {
    /// Rig file whose needs are compared with the machine [default: those of a small rig].
    pub config: Option<PathBuf>,
    /// Folder of the recordings [default: that of the rig file, else the working directory].
    #[arg(long, value_name = "FOLDER")]
    pub directory: Option<PathBuf>,
    /// Folder that stands for /, to examine another system's files.
    #[arg(long, default_value = "/", value_name = "FOLDER")]
    pub root: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// The state of one property of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum State {
    /// Nothing to change.
    Good,
    /// A rig works, but not as well as it could.
    Advice,
    /// Something does not work.
    Bad,
}

impl State {
    /// Returns the word that is printed.
    fn as_str(self) -> &'static str {
        match self {
            Self::Good => "ok",
            Self::Advice => "could be better",
            Self::Bad => "WRONG",
        }
    }
}

/// A property of the machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Finding {
    /// The name, one for each property.
    pub name: &'static str,
    /// The state.
    pub state: State,
    /// The value, with what is needed.
    pub found: String,
    /// The command that mends it; `None` if there is none, or nothing to mend.
    pub fix: Option<String>,
}

impl Finding {
    /// Returns a property that is as it should be.
    fn good(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, state: State::Good, found: found.into(), fix: None }
    }

    /// Returns a property that could be better, with the command that improves it.
    fn advice(name: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, state: State::Advice, found: found.into(), fix: Some(fix.into()) }
    }

    /// Returns a property that keeps a rig from working, with the command that mends it.
    fn bad(name: &'static str, found: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { name, state: State::Bad, found: found.into(), fix: Some(fix.into()) }
    }
}

/// Examines the machine and prints each property, with a command for each that is not as it should be.
///
/// # Errors
///
/// A refused rig file, or properties that keep a rig from working.
pub fn run(options: &DoctorOptions) -> Result<Outcome, Failure> {
    let config = options.config.as_ref().map(Config::load).transpose()?;
    let host = Host::new(&options.root);
    let directory = options.directory.clone();
    let directory = directory.or(config.as_ref().and_then(|config| Some(config.record.as_ref()?.directory.clone())));
    let directory = directory.unwrap_or_else(|| PathBuf::from("."));
    let mut findings = storage::examine(&host, config.as_ref(), &directory);
    findings.extend(machine::examine(&host));
    findings.extend(user::examine());
    findings.extend(network::examine(&host));
    findings.extend(cameras::examine(&host));
    findings.extend(tools::examine());
    if options.json {
        let list: Vec<_> = findings.iter().map(finding_as_json).collect();
        print_line(&json!({ "findings": list }).to_string());
    } else {
        print_findings(&findings);
    }
    match findings.iter().filter(|finding| finding.state == State::Bad).count() {
        0 => Ok(Outcome::Clean),
        count => Err(UsageError(format!("{count} of {} properties of this machine are wrong", findings.len())).into()),
    }
}

/// Returns a property as JSON.
fn finding_as_json(finding: &Finding) -> serde_json::Value {
    let state = match finding.state {
        State::Good => "good",
        State::Advice => "advice",
        State::Bad => "bad",
    };
    json!({ "name": finding.name, "state": state, "found": finding.found, "fix": finding.fix })
}

/// Prints every property, then the commands.
fn print_findings(findings: &[Finding]) {
    for finding in findings {
        print_line(&format!("{:<17}{:<17}{}", finding.name, finding.state.as_str(), finding.found));
    }
    let fixes: Vec<_> = findings.iter().filter(|finding| finding.fix.is_some()).collect();
    if !fixes.is_empty() {
        print_line("\nCommands that mend it, as root where they need it:");
    }
    for finding in fixes {
        print_line(&format!("  {:<16}{}", finding.name, finding.fix.as_deref().unwrap_or_default()));
    }
}
