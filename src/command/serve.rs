//! `ricochet serve`: the operator's page and the streams of a rig.

use crate::config::Config;
use crate::console::{Outcome, UsageError, print_line};
use crate::failure::Failure;
use crate::process::Stop;
use crate::serve::{self, Offer};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// The options of `ricochet serve`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct ServeOptions {
    /// Rig file.
    pub config: PathBuf,
    /// Whether `ricochet run` started the process, so that it ends with its standard input.
    #[arg(long, hide = true)]
    pub supervised: bool,
}

/// Serves the page of a rig, whether it runs already or not, until a stop is requested.
///
/// # Errors
///
/// When the rig file turns the page off, or the address cannot be used.
pub fn run(options: &ServeOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let config = Config::load(&options.config)?;
    let Some(address) = config.serve.http else {
        let origin = &config.origin;
        return Err(UsageError(format!("{origin}: nothing to serve: serve.http = \"off\"")).into());
    };
    if options.supervised {
        let stop = stop.clone();
        std::thread::spawn(move || {
            // The end of the input is the end of `run`, however it ends.
            let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
            stop.request();
        });
    }
    serve::run(&config, address, stop, |offer| match offer {
        Offer::Page(bound) => print_line(&format!("page: http://{bound}/")),
        Offer::Foxglove(bound) => print_line(&format!("foxglove: ws://{bound}/")),
    })?;
    Ok(Outcome::Clean)
}

/// The server of a rig's page in a process of its own, which ends when this is dropped.
#[derive(Debug)]
pub struct PageProcess(Child);

impl PageProcess {
    /// Starts the server if the rig file has a `[serve]` table that does not turn it off.
    ///
    /// The process prints its address, or the reason why it cannot serve. The rig runs without a page as well.
    ///
    /// # Errors
    ///
    /// When the process cannot be started.
    pub fn start(config: &Config, path: &Path) -> Result<Option<Self>, Failure> {
        if !config.serve.is_given || config.serve.http.is_none() {
            return Ok(None);
        }
        let mut command = Command::new(std::env::current_exe()?);
        command.arg("serve").arg(path).arg("--supervised").stdin(Stdio::piped());
        // An interrupt from the terminal reaches only `run`, and the page stays until the rig has ended.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        Ok(Some(Self(command.spawn()?)))
    }
}

impl Drop for PageProcess {
    fn drop(&mut self) {
        drop(self.0.stdin.take());
        // It ends by itself within its time for open requests. It has nothing that could be lost.
        let _ = self.0.wait();
    }
}
