//! The operator's page, and the topics of a rig as streams for other programs.
//!
//! One thread per topic waits on shared memory and hands over to the server, which is a single thread. A client that is
//! slow, stalled or gone loses its own oldest rows. It never slows the threads, and the threads never slow the rig,
//! because they are readers of the bus like any other.

mod access;
mod api;
mod app;
mod clock;
mod control;
mod datagrams;
mod drawing;
mod feed;
mod files;
mod foxglove;
mod guard;
mod heartbeat;
mod login;
mod mqtt;
mod numbers;
mod outlets;
mod page;
mod picture;
mod picture_feed;
mod replay;
mod rig_file;
mod rig_state;
mod routes;
mod rows;
mod series;
mod server;
mod shot_facts;
mod shots;
mod snapshot;
mod streams;
mod topics;
mod watcher;

pub use access::TokenError;
#[cfg(feature = "zenoh")]
pub(crate) use picture::PictureEncoder;
pub use rows::json_cells;

use crate::config::Config;
use crate::failure::{ExitCode, Failure, Fatal};
use crate::process::{Launch, Stop};
use access::Token;
use app::App;
use clock::now;
use datagrams::Datagrams;
use heartbeat::TurnCounter;
use login::Login;
use rows::RowContext;
use shots::Shots;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant, SystemTime};
use topics::{Link, VelocityOutputs};
use watcher::{Outputs, Watcher};

/// The nice value of the server, so that it yields to the processes that film and measure.
const NICE: i32 = 5;
/// Minimum time between two reads of a folder of recordings that has changed.
const LIST_PERIOD: Duration = Duration::from_secs(2);
/// Time for the page of the previous run to end.
const SUCCESSION_TIMEOUT: Duration = Duration::from_secs(5);
/// Interval of trying to take the address.
const RETRY: Duration = Duration::from_millis(100);
/// Time for open requests at the end.
const END_TIMEOUT: Duration = Duration::from_secs(1);

/// The address of the page cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot serve the page at {address}: {reason}; set [serve] http to another address, or to \"off\"")]
pub struct AddressError {
    address: SocketAddr,
    reason: std::io::Error,
}

impl Fatal for AddressError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

/// The address for Foxglove viewers cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot serve Foxglove at {address}: {reason}; set [serve] foxglove to another address, or to \"off\"")]
struct FoxgloveAddressError {
    address: SocketAddr,
    reason: String,
}

impl Fatal for FoxgloveAddressError {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Usage
    }
}

/// An address at which the server can be reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Offer {
    /// The page, and the streams of topics.
    Page(SocketAddr),
    /// The server for Foxglove viewers.
    Foxglove(SocketAddr),
}

/// A page to serve.
#[derive(Debug)]
pub struct Service<'a> {
    /// The rig.
    pub config: &'a Config,
    /// The address of the page.
    pub address: SocketAddr,
    /// Whether a supervisor started the process.
    pub launch: &'a Launch,
}

impl Service<'_> {
    /// Binds the address. The page of a run that has just died may still have it for a moment.
    ///
    /// # Errors
    ///
    /// [`AddressError`] if the address cannot be used, or is still taken after [`SUCCESSION_TIMEOUT`].
    fn listen(&self, stop: &Stop) -> Result<TcpListener, AddressError> {
        let began = now();
        loop {
            match TcpListener::bind(self.address) {
                Err(error) if error.kind() == ErrorKind::AddrInUse && self.may_wait(began, stop) => {
                    std::thread::sleep(RETRY);
                }
                bound => return bound.map_err(|reason| AddressError { address: self.address, reason }),
            }
        }
    }

    /// Starts the server for Foxglove viewers, after waiting for its address as in [`listen`](Self::listen), and
    /// returns the address that it has taken.
    async fn start_foxglove(
        &self,
        app: &Arc<App>,
        address: SocketAddr,
        stop: &Stop,
    ) -> Result<SocketAddr, FoxgloveAddressError> {
        let began = now();
        let is_taken = || TcpListener::bind(address).is_err_and(|error| error.kind() == ErrorKind::AddrInUse);
        while is_taken() && self.may_wait(began, stop) {
            tokio::time::sleep(RETRY).await;
        }
        let bound = foxglove::start(app, address).await;
        bound.map_err(|error| FoxgloveAddressError { address, reason: error.to_string() })
    }

    /// Whether to wait further for an address: the page belongs to a supervised run, whose predecessor may have it.
    fn may_wait(&self, began: Instant, stop: &Stop) -> bool {
        self.launch.domain.is_some() && began.elapsed() < SUCCESSION_TIMEOUT && !stop.requested()
    }
}

/// Serves the page of a rig until a stop is requested. `announce` gets each address once it can be opened.
///
/// # Errors
///
/// When the address or the token cannot be used, or shared memory fails.
pub fn run(service: &Service<'_>, stop: &Stop, announce: impl Fn(Offer)) -> Result<(), Failure> {
    let config = service.config;
    let token = config.serve.token_file.as_deref().map(Token::read).transpose()?;
    let login = config.serve.mqtt.as_ref().map(Login::read).transpose()?;
    let listener = service.listen(stop)?;
    listener.set_nonblocking(true)?;
    let bound = listener.local_addr()?;
    if let Err(error) = rustix::process::nice(NICE) {
        log::info!("the page is served without a lower priority: {error}");
    }
    let app = Arc::new(App::new(Arc::new(config.clone()), token));
    let link = Link::new(stop);
    let turns = service.launch.domain.as_ref().map(|_| TurnCounter::default());
    let open = |address| Datagrams::open(address, Arc::clone(&app.outlets));
    let datagrams = config.serve.udp.map(open).transpose()?;
    let (recorded, wake) = sync_channel(1);
    let outputs = Outputs {
        impact: app.impact.clone(),
        events: app.events.clone(),
        state: app.state.clone(),
        outlets: Arc::clone(&app.outlets),
        recorded,
        turns: turns.clone(),
    };
    std::thread::scope(|scope| {
        let (app, link) = (&app, &link);
        scope.spawn(move || read_shots(&app.shots, &wake, stop));
        scope.spawn(move || {
            let bodies = app.config.bodies.iter().map(|body| body.name.clone()).collect();
            let context = RowContext { bodies, origin_ns: None };
            let outputs = VelocityOutputs { feed: &app.velocity, datagrams };
            topics::send_velocities(&app.config.rig.name, context, outputs, link);
        });
        scope.spawn(|| picture_feed::run(&app.config, &app.pictures, link));
        scope.spawn(|| Watcher::new(&app.config, link, &app.shots, &app.control, outputs).run());
        announce(Offer::Page(bound));
        let served =
            run_server(listener, app, &Server { service, stop, login, turns: turns.unwrap_or_default() }, &announce);
        // The threads end too.
        stop.request();
        served
    })
}

/// The server's thread: what it serves, and until when.
struct Server<'a> {
    service: &'a Service<'a>,
    stop: &'a Stop,
    /// The way into the MQTT broker, if there is one.
    login: Option<Login>,
    turns: TurnCounter,
}

/// Runs the server on the thread that calls it, until a stop is requested. `announce` gets the address for Foxglove
/// viewers.
fn run_server(
    listener: TcpListener,
    app: &Arc<App>,
    server: &Server<'_>,
    announce: &impl Fn(Offer),
) -> Result<(), Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
    runtime.block_on(async {
        let listener = tokio::net::TcpListener::from_std(listener)?;
        tokio::spawn(server.turns.clone().count_turns());
        if let Some(login) = server.login.clone() {
            mqtt::start(app, login);
        }
        if let Some(address) = app.config.serve.foxglove {
            announce(Offer::Foxglove(server.service.start_foxglove(app, address, server.stop).await?));
        }
        server::serve(listener, routes::router(Arc::clone(app)), server.stop).await;
        Ok::<(), Failure>(())
    })?;
    runtime.shutdown_timeout(END_TIMEOUT);
    Ok(())
}

/// Reads recordings when one was made, and lists them again when the folder has changed, until a stop is requested.
fn read_shots(shots: &Shots, wake: &Receiver<()>, stop: &Stop) {
    let mut seen = None::<SystemTime>;
    let mut listed = None;
    while !stop.requested() {
        let is_due = listed.is_none_or(|at: std::time::Instant| at.elapsed() >= LIST_PERIOD);
        let changed = shots.directory().and_then(|path| std::fs::metadata(path).ok()?.modified().ok());
        if is_due && changed != seen {
            (seen, listed) = (changed, Some(now()));
            shots.list();
            shots.read();
        }
        match wake.recv_timeout(Duration::from_millis(100)) {
            Ok(()) => shots.read(),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(Duration::from_millis(100)),
        }
    }
}
