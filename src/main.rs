//! The `ricochet` program: every role and every command.

use ricochet::cli::{self, Parsed};
use ricochet::console::Outcome;
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
        Ok(Outcome::Clean) => ExitCode::SUCCESS,
        Ok(Outcome::Lost { count, cause }) => {
            // The supervisor reports the losses of its processes together with its own.
            if !is_supervised {
                let cause = cause.map_or_else(String::new, |cause| format!("; {cause}"));
                eprintln!("ricochet: finished, but data were lost: {count}{cause}");
            }
            failure::ExitCode::DataLost.into()
        }
        Err(failure) => {
            if !failure.is_reported() {
                eprintln!("ricochet: {failure}");
            }
            failure.exit_code().into()
        }
    }
}
