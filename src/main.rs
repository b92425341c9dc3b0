//! The `ricochet` program: every role and every command.

use ricochet::cli::{self, Parsed};
use ricochet::console::Outcome;
use ricochet::process::{ChildFailure, Stop};
use std::process::ExitCode;

/// Returns the exit code: 0 clean, 1 internal, 2 usage or configuration, 3 camera, 4 bus, 5 recording, 6 finished but
/// data were lost.
fn code(error: &anyhow::Error) -> u8 {
    error.chain().find_map(code_of).unwrap_or(1)
}

/// Returns the exit code of one cause; `None` when it does not decide.
fn code_of(cause: &(dyn std::error::Error + 'static)) -> Option<u8> {
    use ricochet::{ball, bus, camera, command, config, console, dic, import, measure, process, recording, synth};
    let is_usage = cause.is::<config::ConfigError>()
        || cause.is::<console::UsageError>()
        || cause.is::<synth::ScenarioError>()
        || cause.is::<measure::MeasureError>()
        || cause.is::<dic::CorrelationError>()
        || cause.is::<ball::BallError>();
    if is_usage {
        return Some(2);
    }
    if let Some(failure) = cause.downcast_ref::<process::ChildFailure>() {
        return Some(u8::try_from(failure.code).unwrap_or(1));
    }
    if let Some(error) = cause.downcast_ref::<camera::CameraError>() {
        return Some(match error {
            camera::CameraError::Recording(_) => 5,
            camera::CameraError::Scenario { .. } => 2,
            _ => 3,
        });
    }
    if cause.is::<command::check::NotReady>() {
        return Some(3);
    }
    if let Some(error) = cause.downcast_ref::<command::export::ExportError>() {
        return Some(if matches!(error, command::export::ExportError::Usage(_)) { 2 } else { 5 });
    }
    if let Some(error) = cause.downcast_ref::<command::field::FieldError>() {
        use command::field::FieldError;
        return Some(if matches!(error, FieldError::Usage(_) | FieldError::Correlation(_)) { 2 } else { 5 });
    }
    let of_footage = |error: &import::ImportError| match error {
        import::ImportError::FrameRate { .. } | import::ImportError::Nothing => 2,
        _ => 5,
    };
    if let Some(error) = cause.downcast_ref::<import::ImportError>() {
        return Some(of_footage(error));
    }
    if let Some(failure) = cause.downcast_ref::<command::import::Failure>() {
        return Some(match failure {
            command::import::Failure::Import(error) => of_footage(error),
            command::import::Failure::Recording(_) => 5,
        });
    }
    if cause.is::<recording::RecordingError>() {
        return Some(5);
    }
    cause.is::<bus::BusError>().then_some(4)
}

/// Joins the error and its causes into one line; a cause that the line already ends with is not repeated.
fn line(error: &anyhow::Error) -> String {
    let flat =
        |text: String| if text.contains('\n') { text.split_whitespace().collect::<Vec<_>>().join(" ") } else { text };
    error.chain().map(|cause| flat(cause.to_string())).fold(String::new(), |line, cause| match line {
        line if line.ends_with(&cause) => line,
        line if line.is_empty() => cause,
        line => format!("{line}: {cause}"),
    })
}

fn main() -> ExitCode {
    let command = match cli::parse() {
        Parsed::Run(command) => command,
        Parsed::Printed(code) => return ExitCode::from(code),
    };
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn")).format_timestamp(None).init();
    let stop = if cli::is_supervised(&command) { Stop::with_parent() } else { Stop::default() };
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, stop.flag()) {
            eprintln!("ricochet: cannot install signal handlers: {error}");
            return ExitCode::from(1);
        }
    }
    // The supervisor reports the losses of its processes together with its own.
    let is_supervised = cli::is_supervised(&command);
    match cli::run(command, &stop) {
        Ok(Outcome::Clean) => ExitCode::SUCCESS,
        Ok(Outcome::Lost { .. }) if is_supervised => ExitCode::from(6),
        Ok(Outcome::Lost { count, cause }) => {
            let cause = cause.map_or_else(String::new, |cause| format!("; {cause}"));
            eprintln!("ricochet: finished, but data were lost: {count}{cause}");
            ExitCode::from(6)
        }
        Err(error) => {
            // A process of the rig that failed has printed its error on the same standard error.
            let is_reported = error.downcast_ref::<ChildFailure>().is_some_and(|failure| failure.is_reported);
            if !is_reported {
                eprintln!("ricochet: {}", line(&error));
            }
            ExitCode::from(code(&error))
        }
    }
}
