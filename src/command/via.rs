//! The option of the commands that also reach rigs of other hosts.

/// The option of the commands that also reach rigs of other hosts.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct RemoteOptions {
    /// Reach the rig of another host, where `ricochet bridge` runs: a Zenoh endpoint such as tcp/10.0.0.5:7447, or a file of
    /// Zenoh's configuration.
    #[arg(long, value_name = "ENDPOINT")]
    pub via: Option<String>,
}
