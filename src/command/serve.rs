//! `ricochet serve`: the operator's page and the streams of a rig.

use super::rig::{SupervisedOptions, load};
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::process::Stop;
use crate::serve::{self, Offer};
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
/// # Errors
///
/// When the rig file turns the page off, or the address cannot be used.
pub fn run(options: &ServeOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let config = load(&options.config, options.supervised.origin.as_deref())?;
    let Some(address) = config.serve.http else {
        let origin = &config.origin;
        return Err(UsageError(format!("{origin}: nothing to serve: serve.http = \"off\"")).into());
    };
    let launch = options.supervised.launch(stop);
    let announce = |offer| match offer {
        Offer::Page(bound) => print_line(&format!("page: http://{bound}/")),
        Offer::Foxglove(bound) => print_line(&format!("foxglove: ws://{bound}/")),
    };
    serve::run(&serve::Service { config: &config, address, launch: &launch }, stop, announce)?;
    Ok(Outcome::Clean)
}
