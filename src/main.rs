//! The `ricochet` program: every role and every command.

use ricochet::cli::{self, Parsed};
use ricochet::failure;
use ricochet::process::Stop;
use std::process::ExitCode;

fn main() -> ExitCode {
    let command = match cli::parse() {
        Parsed::Run(command) => command,
        Parsed::Printed(code) => return ExitCode::from(code),
    };
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn")).format_timestamp(None).init();
    let is_supervised = cli::is_supervised(&command);
    let stop = if is_supervised { Stop::with_parent() } else { Stop::default() };
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, stop.flag()) {
            eprintln!("ricochet: cannot install signal handlers: {error}");
            return failure::ExitCode::Internal.into();
        }
    }
    match cli::run(command, &stop) {
        Ok(outcome) => {
            // The supervisor reports the losses of its processes together with its own.
            if let Some(losses) = outcome.losses().filter(|_| !is_supervised) {
                eprintln!("ricochet: {losses}");
            }
            outcome.exit_code().map_or(ExitCode::SUCCESS, Into::into)
        }
        Err(failure) => {
            if !failure.is_reported() {
                eprintln!("ricochet: {failure}");
            }
            failure.exit_code().into()
        }
    }
}
