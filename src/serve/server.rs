//! Connections: limits of their number and of the time for their headers, and an end for those that request nothing.

use crate::process::Stop;
use axum::Router;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;

/// The maximum number of connections.
const MAX_CONNECTIONS: usize = 256;
/// Time for the headers of a request, and for the next request of an open connection.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// The maximum size of a request's headers, bytes.
const MAX_HEADER_BYTES: usize = 16 << 10;
/// Interval of asking whether to stop.
const TICK: Duration = Duration::from_millis(50);
/// Time before connections are accepted again after the system has refused one.
const PAUSE: Duration = Duration::from_millis(50);

/// An open connection.
struct Connection {
    task: JoinHandle<()>,
    /// Whether the client has made a request.
    has_requested: Arc<AtomicBool>,
}

/// Accepts connections until a stop is requested. Beyond [`MAX_CONNECTIONS`], one replaces the oldest idle connection
/// or is refused.
pub(super) async fn serve(listener: TcpListener, router: Router, stop: &Stop) {
    let mut connections: VecDeque<Connection> = VecDeque::new();
    while !stop.requested() {
        let Ok(accepted) = tokio::time::timeout(TICK, listener.accept()).await else { continue };
        let Ok((stream, _)) = accepted else {
            tokio::time::sleep(PAUSE).await;
            continue;
        };
        connections.retain(|connection| !connection.task.is_finished());
        if connections.len() >= MAX_CONNECTIONS && !end_idle(&mut connections) {
            log::warn!("a connection was refused: {MAX_CONNECTIONS} are in use");
            continue;
        }
        connections.push_back(serve_connection(stream, router.clone()));
    }
}

/// Ends the oldest connection that has not made a request; returns whether there was one.
fn end_idle(connections: &mut VecDeque<Connection>) -> bool {
    let oldest = connections.iter().position(|connection| !connection.has_requested.load(Ordering::Relaxed));
    let ended = oldest.and_then(|at| connections.remove(at));
    ended.is_some_and(|connection| {
        connection.task.abort();
        true
    })
}

/// Starts a task that answers the requests of a connection until it ends, within the limits of time and size.
fn serve_connection(stream: TcpStream, router: Router) -> Connection {
    // Rows are small and must not wait for each other.
    let _ = stream.set_nodelay(true);
    let has_requested = Arc::new(AtomicBool::new(false));
    let requested = Arc::clone(&has_requested);
    let answer = TowerToHyperService::new(router);
    let service = service_fn(move |request| {
        requested.store(true, Ordering::Relaxed);
        answer.call(request)
    });
    let task = tokio::spawn(async move {
        let mut builder = http1::Builder::new();
        builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_buf_size(MAX_HEADER_BYTES);
        // An error is the client's, who learns of it by the end of the connection.
        let _ = builder.serve_connection(TokioIo::new(stream), service).with_upgrades().await;
    });
    Connection { task, has_requested }
}
