//! `ricochet serve`: the operator's page and the streams of a rig.

use super::rig::{SupervisedOptions, load};
use crate::console::{Outcome, UsageError, print_line, print_note};
use crate::failure::Failure;
use crate::process::Stop;
use crate::serve::{self, AddressError, Offer};
use std::path::PathBuf;

/// The options of `ricochet serve`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct ServeOptions {
    /// Rig file.
    pub config: PathBuf,
    /// The options of a process with a supervisor.
    #[command(flatten)]
    pub supervised: SupervisedOptions,
}

/// Serves the page of a rig, whether it runs already or not, until a stop is requested.
///
/// The page of a supervised run prints to standard error, since the standard output of `run` has the paths of its
/// recordings alone. If its address cannot be used, it prints a warning and ends, because the rig also runs without it.
///
/// # Errors
///
/// When the rig file turns the page off, or the address of a page without a supervisor cannot be used.
pub fn run(options: &ServeOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let config = load(&options.config, options.supervised.origin.as_deref())?;
    let Some(address) = config.serve.http else {
        let origin = &config.origin;
        return Err(UsageError(format!("{origin}: nothing to serve: serve.http = \"off\"")).into());
    };
    let launch = options.supervised.launch(stop);
    let is_supervised = launch.domain.is_some();
    let print = if is_supervised { print_note } else { print_line };
    let announce = |offer| match offer {
        Offer::Page(bound) => print(&format!("page: http://{bound}/")),
        Offer::Foxglove(bound) => print(&format!("foxglove: ws://{bound}/")),
    };
    match serve::run(&serve::Service { config: &config, address, launch: &launch }, stop, announce) {
        Err(failure) if is_supervised && failure.is::<AddressError>() => {
            print_note(&format!("warning: {failure}; the rig runs without it"));
            Ok(Outcome::Clean)
        }
        served => served.map(|()| Outcome::Clean),
    }
}
