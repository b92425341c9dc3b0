//! The one program: every role and every command.

use ricochet::cli::{self, Parsed};
use ricochet::command::Outcome;
use ricochet::process::Stop;
use std::process::ExitCode;

/// The one table of exit codes: 0 clean, 1 internal, 2 usage or configuration, 3 camera, 4 bus, 5 recording,
/// 6 finished but data were lost.
fn code(error: &anyhow::Error) -> u8 {
    use ricochet::{ball, bus, camera, command, config, dic, import, measure, process, recording, synth};
    for cause in error.chain() {
        if let Some(failure) = cause.downcast_ref::<process::ChildFailure>() {
            return u8::try_from(failure.code).unwrap_or(1);
        }
        if cause.is::<config::ConfigError>() || cause.is::<command::UsageError>() || cause.is::<synth::ScenarioError>()
        {
            return 2;
        }
        if cause.is::<measure::MeasureError>() || cause.is::<dic::CorrelationError>() || cause.is::<ball::BallError>() {
            return 2;
        }
        if let Some(error) = cause.downcast_ref::<camera::CameraError>() {
            return if matches!(error, camera::CameraError::Recording(_)) { 5 } else { 3 };
        }
        if cause.is::<bus::BusError>() {
            return 4;
        }
        if let Some(error) = cause.downcast_ref::<command::export::ExportError>() {
            return if matches!(error, command::export::ExportError::Usage(_)) { 2 } else { 5 };
        }
        if let Some(error) = cause.downcast_ref::<import::ImportError>() {
            return if matches!(error, import::ImportError::FrameRate { .. }) { 2 } else { 5 };
        }
        if cause.is::<recording::RecordingError>() {
            return 5;
        }
    }
    1
}

fn main() -> ExitCode {
    let command = match cli::parse() {
        Parsed::Run(command) => command,
        Parsed::Told(code) => return ExitCode::from(code),
    };
    env_logger::Builder::from_env(env_logger::Env::default().default_filter_or("warn")).format_timestamp(None).init();
    let stop = if cli::is_supervised(&command) { Stop::with_parent() } else { Stop::default() };
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        if let Err(error) = signal_hook::flag::register(signal, stop.flag()) {
            eprintln!("ricochet: listen for signals: {error}");
            return ExitCode::from(1);
        }
    }
    match cli::run(command, &stop) {
        Ok(Outcome::Clean) => ExitCode::SUCCESS,
        Ok(Outcome::Lost(count)) => {
            eprintln!("ricochet: finished, but data were lost: {count}");
            ExitCode::from(6)
        }
        Err(error) => {
            eprintln!("ricochet: {error:#}");
            ExitCode::from(code(&error))
        }
    }
}
