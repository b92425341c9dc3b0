//! The `ricochet` program: every role and every command.

use ricochet::cli::{self, Ending, Parsed};
use ricochet::failure;
use ricochet::interrupt;
use ricochet::process::Stop;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io::{self, Write};
use std::process::ExitCode;

fn main() -> ExitCode {
    let command = match cli::parse() {
        Parsed::Run(command) => command,
        Parsed::Printed(code) => return ExitCode::from(code),
    };
    // Zenoh logs the errors that it also returns.
    let filter = env_logger::Env::default().default_filter_or("warn,zenoh=off");
    env_logger::Builder::from_env(filter).format_timestamp(None).init();
    let ending = Ending::of(&command);
    let stop = Stop::default();
    if let Err(error) = handle_signals(ending, &stop) {
        report(&format!("cannot install signal handlers: {error}"));
        return failure::ExitCode::Internal.into();
    }
    let outcome = cli::run(command, &stop);
    interrupt::settle();
    match outcome {
        Ok(outcome) => {
            // The supervisor reports the losses of its processes together with its own.
            if let Some(losses) = outcome.losses().filter(|_| ending != Ending::Supervised) {
                report(&losses);
            }
            outcome.exit_code().map_or(ExitCode::SUCCESS, Into::into)
        }
        Err(failure) if failure.is_closed_output() => ExitCode::SUCCESS,
        Err(failure) => {
            if !failure.is_reported() {
                report(&failure.to_string());
            }
            failure.exit_code().into()
        }
    }
}

/// Makes Ctrl-C and the termination signal end the command in its way.
fn handle_signals(ending: Ending, stop: &Stop) -> io::Result<()> {
    if ending == Ending::AtOnce {
        interrupt::allow_end();
    }
    // A process with a supervisor ends when its supervisor says so. A signal to all processes at once, as a service manager
    // sends it, must not end them before the frames that others still publish.
    let stop = (ending != Ending::Supervised).then(|| stop.clone());
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    std::thread::spawn(move || {
        for signal in signals.forever() {
            stop.iter().for_each(Stop::request);
            interrupt::end(signal);
        }
    });
    Ok(())
}

/// Prints an error. If standard error is full or closed, the exit code alone shows it.
fn report(message: &str) {
    let _ = writeln!(std::io::stderr(), "ricochet: {message}");
}
