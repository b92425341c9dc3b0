//! Topics and pictures as streams: server-sent events and WebSockets.

use super::app::App;
use super::control::parse_page_name;
use super::feed::{Delivery, Feed, Follower};
use axum::body::{Body, Bytes};
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::{SinkExt, Stream, stream};
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{sleep, timeout};

/// Interval of a sign of life on a stream without rows, so that a client that is gone is noticed.
const KEEP_ALIVE_PERIOD: Duration = Duration::from_secs(10);
/// Time in which server-sent events gather, because a write for each row would cost most of the server's time. Rows by
/// WebSocket go out at once.
const GATHER_TIME: Duration = Duration::from_millis(10);
/// The maximum size of events that are sent together, bytes, so that a burst does not fill the memory.
const MAX_GATHERED_BYTES: usize = 64 << 10;
/// The maximum size of a message from a client, bytes. Messages of clients are ignored.
const MAX_MESSAGE_BYTES: usize = 1024;
/// Time for the first picture.
const PICTURE_TIMEOUT: Duration = Duration::from_secs(2);

/// Answers with server-sent events, as a stream of their text.
fn event_stream(stream: impl Stream<Item = Result<Bytes, Infallible>> + Send + 'static) -> Response {
    ([(header::CONTENT_TYPE, "text/event-stream")], Body::from_stream(stream)).into_response()
}

/// Answers with the rows of a topic as server-sent events. Rows that the client was too slow for are reported by an
/// event `lost`.
fn topic_events(feed: &Feed) -> Response {
    event_stream(stream::unfold(feed.follow(), |mut follower| async move {
        let bytes = match timeout(KEEP_ALIVE_PERIOD, follower.next()).await {
            Err(_) => Bytes::from_static(b":\n\n"),
            Ok(None) => return None,
            Ok(Some(first)) => gather_events(first, &mut follower).await,
        };
        Some((Ok(bytes), follower))
    }))
}

/// Returns a delivery and those within [`GATHER_TIME`] after it as server-sent events.
async fn gather_events(first: Delivery, follower: &mut Follower) -> Bytes {
    sleep(GATHER_TIME).await;
    let mut bytes = Vec::new();
    let mut next = Some(first);
    while let Some(Delivery { lost, batch }) = next {
        if lost > 0 {
            bytes.extend_from_slice(format!("event: lost\ndata: {{\"lost\":{lost}}}\n\n").as_bytes());
        }
        bytes.extend_from_slice(&batch.events);
        next = if bytes.len() < MAX_GATHERED_BYTES { follower.try_next() } else { None };
    }
    bytes.into()
}

/// Answers with the rows of `velocity` as server-sent events.
pub(super) async fn velocity_events(State(app): State<Arc<App>>) -> Response {
    topic_events(&app.velocity)
}

/// Answers with the rows of `impact` as server-sent events.
pub(super) async fn impact_events(State(app): State<Arc<App>>) -> Response {
    topic_events(&app.impact)
}

/// Answers with the rows of `events` as server-sent events.
pub(super) async fn event_events(State(app): State<Arc<App>>) -> Response {
    topic_events(&app.events)
}

/// Sends the state of the rig now, and whenever it is published. With `?page=NAME` the connection stands for an open
/// page, which takes control if no page has it.
pub(super) async fn state_events(State(app): State<Arc<App>>, request: Request) -> Response {
    let page = request.uri().query().and_then(|query| query.strip_prefix("page=")).and_then(parse_page_name);
    let open = page.map(|page| app.control.open(page));
    let mut receiver = app.state.subscribe();
    receiver.mark_changed();
    event_stream(stream::unfold((receiver, open), |(mut receiver, open)| async move {
        receiver.changed().await.ok()?;
        let bytes = receiver.borrow_and_update().event.clone();
        Some((Ok(bytes), (receiver, open)))
    }))
}

/// Answers with the rows of a topic from now on over a WebSocket.
fn topic_socket(feed: &Feed, upgrade: WebSocketUpgrade) -> Response {
    let follower = feed.follow();
    limit_messages(upgrade).on_upgrade(|socket| send_rows(socket, follower))
}

/// Limits the size of the messages that a client may send.
fn limit_messages(upgrade: WebSocketUpgrade) -> WebSocketUpgrade {
    upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES)
}

/// Answers with the rows of `velocity` over a WebSocket.
pub(super) async fn velocity_socket(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    topic_socket(&app.velocity, upgrade)
}

/// Answers with the rows of `impact` over a WebSocket.
pub(super) async fn impact_socket(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    topic_socket(&app.impact, upgrade)
}

/// Answers with the rows of `events` over a WebSocket.
pub(super) async fn event_socket(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    topic_socket(&app.events, upgrade)
}

/// Sends rows until the client is gone; `{"lost": N}` stands for rows that it was too slow for.
async fn send_rows(mut socket: WebSocket, mut follower: Follower) {
    loop {
        let delivery = tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(_)) => continue,
            },
            delivery = timeout(KEEP_ALIVE_PERIOD, follower.next()) => delivery,
        };
        let sent = match delivery {
            Err(_) => socket.send(Message::Ping(Bytes::new())).await,
            Ok(None) => return,
            Ok(Some(delivery)) => send_delivery(&mut socket, &delivery).await,
        };
        if sent.is_err() {
            return;
        }
    }
}

/// Sends a batch of rows, one message each, after the number of rows that were lost before it.
async fn send_delivery(socket: &mut WebSocket, delivery: &Delivery) -> Result<(), axum::Error> {
    if delivery.lost > 0 {
        socket.feed(Message::text(format!("{{\"lost\":{}}}", delivery.lost))).await?;
    }
    for row in &delivery.batch.rows {
        socket.feed(Message::Text(row.clone())).await?;
    }
    socket.flush().await
}

/// Sends the newest picture whenever there is one, as fast as the client takes them.
pub(super) async fn picture_socket(State(app): State<Arc<App>>, upgrade: WebSocketUpgrade) -> Response {
    let mut receiver = app.pictures.subscribe();
    limit_messages(upgrade).on_upgrade(|mut socket| async move {
        loop {
            tokio::select! {
                message = socket.recv() => match message {
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                    Some(Ok(_)) => {}
                },
                changed = receiver.changed() => {
                    let picture = receiver.borrow_and_update().clone();
                    let Some(picture) = picture.filter(|_| changed.is_ok()) else { return };
                    if socket.send(Message::Binary(picture.message.clone())).await.is_err() {
                        return;
                    }
                }
            }
        }
    })
}

/// Answers with the next picture as a JPEG file, or with 503 if none comes within [`PICTURE_TIMEOUT`].
pub(super) async fn picture(State(app): State<Arc<App>>) -> Response {
    let mut receiver = app.pictures.subscribe();
    let changed = timeout(PICTURE_TIMEOUT, receiver.changed()).await;
    let picture = receiver.borrow().clone();
    match picture.filter(|_| matches!(changed, Ok(Ok(())))) {
        Some(picture) => ([(header::CONTENT_TYPE, "image/jpeg")], Body::from(picture.jpeg.clone())).into_response(),
        None => (StatusCode::SERVICE_UNAVAILABLE, "no frame comes\n").into_response(),
    }
}
