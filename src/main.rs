//! The `ricochet` program: every role and every command.

use ricochet::cli::{self, Parsed};
use ricochet::failure;
use ricochet::process::Stop;
use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;

fn main() -> ExitCode {
    let command = match cli::parse() {
        Parsed::Run(command) => command,
        Parsed::Printed(code) => return ExitCode::from(code),
    };
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn")).format_timestamp(None).init();
    let is_supervised = cli::is_supervised(&command);
    let stop = Stop::default();
    // A process with a supervisor ends when its supervisor says so. A signal to all processes at once, as a service manager
    // sends it, must not end them before the frames that others still publish.
    let flag = if is_supervised { Arc::default() } else { stop.flag() };
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, Arc::clone(&flag)) {
            report(&format!("cannot install signal handlers: {error}"));
            return failure::ExitCode::Internal.into();
        }
    }
    match cli::run(command, &stop) {
        Ok(outcome) => {
            // The supervisor reports the losses of its processes together with its own.
            if let Some(losses) = outcome.losses().filter(|_| !is_supervised) {
                report(&losses);
            }
            outcome.exit_code().map_or(ExitCode::SUCCESS, Into::into)
        }
        Err(failure) => {
            if !failure.is_reported() {
                report(&failure.to_string());
            }
            failure.exit_code().into()
        }
    }
}

/// Prints an error. If standard error is full or closed, the exit code alone shows it.
fn report(message: &str) {
    let _ = writeln!(std::io::stderr(), "ricochet: {message}");
}
