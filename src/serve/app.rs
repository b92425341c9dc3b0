//! The state that all requests share.

use super::access::Token;
use super::control::Control;
use super::feed::Feed;
use super::outlets::Outlets;
use super::picture_feed::Pictures;
use super::rig_file::RigFile;
use super::shots::Shots;
use super::snapshot::{StateText, States};
use crate::config::Config;
use std::sync::Arc;
use tokio::sync::{Semaphore, watch};

/// The number of blocking jobs at a time: reports, requests to the rig.
const JOBS: usize = 1;

/// The state that all requests share.
pub(super) struct App {
    pub(super) config: Arc<Config>,
    /// The file of the rig; `None` if it has none that can be written.
    pub(super) rig_file: Option<RigFile>,
    /// The token that requests must carry; `None` if none is configured.
    pub(super) token: Option<Token>,
    pub(super) control: Control,
    pub(super) velocity: Feed,
    pub(super) impact: Feed,
    pub(super) events: Feed,
    /// The state of the rig.
    pub(super) state: States,
    pub(super) outlets: Arc<Outlets>,
    pub(super) pictures: Pictures,
    pub(super) shots: Arc<Shots>,
    /// Reports are made one at a time, because each takes a processor and the memory of its curves.
    pub(super) reports: Semaphore,
    /// Requests to the rig go one at a time.
    pub(super) requests: Semaphore,
}

impl App {
    pub(super) fn new(config: Arc<Config>, token: Option<Token>) -> Self {
        Self {
            token,
            rig_file: RigFile::find(&config),
            control: Control::default(),
            velocity: Feed::default(),
            impact: Feed::default(),
            events: Feed::default(),
            state: watch::channel(StateText::new("{}")).0,
            outlets: Arc::default(),
            pictures: watch::channel(None).0,
            shots: Arc::new(Shots::new(&config)),
            reports: Semaphore::new(JOBS),
            requests: Semaphore::new(JOBS),
            config,
        }
    }
}
