//! The topics of the rig at an MQTT broker, `ricochet/RIG/velocity` and so on, one JSON object per message.
//!
//! Every message has quality of service 1: the broker acknowledges it. With 0, a message that was on its way when the
//! connection broke would be lost without a trace. 2 takes two more messages for each row, and a row that comes twice is
//! recognised by its frame and body.
//!
//! While the broker is away, rows wait in the feed of their topic, which holds at least two seconds of one row per
//! millisecond. Beyond that the oldest rows are lost and counted.

use super::app::App;
use super::feed::Feed;
use super::login::{Login, is_refusal};
use super::outlets::Outlets;
use axum::body::Bytes;
use rumqttc::{
    AsyncClient, ClientError, Event, EventLoop, LastWill, MqttOptions, NetworkOptions, Packet, QoS, Request,
};
use serde_json::json;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::sleep;

/// The quality of service: at least once.
const QUALITY: QoS = QoS::AtLeastOnce;
/// The maximum number of messages that wait for their acknowledgement.
const MAX_IN_FLIGHT: u16 = 100;
/// The number of messages between the topics and the connection: none, so that all that wait are counted by their feed.
const QUEUE: usize = 0;
/// The silence after which the connection is tested.
const KEEP_ALIVE: Duration = Duration::from_secs(5);
/// Time to connect, s.
const CONNECT_TIMEOUT_S: u64 = 3;
/// Interval of trying to connect.
const RETRY: Duration = Duration::from_millis(200);
/// Interval of trying again after the broker has refused the user. Brokers count such attempts.
const REFUSED_RETRY: Duration = Duration::from_secs(5);
/// Interval of the status: four times per second at most.
const STATUS_PERIOD: Duration = Duration::from_millis(250);
/// The maximum size of a message, bytes. A status is the largest.
const MAX_MESSAGE_BYTES: usize = 256 << 10;

/// Starts the tasks that publish the topics, on the runtime that calls it. They go on until the runtime ends, whether the
/// broker is there or not. The broker then publishes the last will, a status with the state OFFLINE.
pub(super) fn start(app: &Arc<App>, login: Login) {
    let rig = &app.config.rig.name;
    let topic = |name: &str| format!("ricochet/{rig}/{name}");
    let offline = json!({ "rig": rig, "state": "OFFLINE" }).to_string();
    // Another server of the same rig is another client.
    let id = format!("ricochet-{rig}-{}", std::process::id());
    let mut options = MqttOptions::new(id, &login.broker.host, login.broker.port);
    login.apply(&mut options);
    options.set_keep_alive(KEEP_ALIVE).set_inflight(MAX_IN_FLIGHT);
    options.set_max_packet_size(MAX_MESSAGE_BYTES, MAX_MESSAGE_BYTES);
    options.set_last_will(LastWill::new(topic("status"), offline, QUALITY, true));
    let (client, mut connection) = AsyncClient::new(options, QUEUE);
    let mut network = NetworkOptions::new();
    // Rows are small and must not wait for each other.
    network.set_tcp_nodelay(true);
    network.set_connection_timeout(CONNECT_TIMEOUT_S);
    connection.set_network_options(network);
    for (name, feed) in [("velocity", &app.velocity), ("impact", &app.impact), ("events", &app.events)] {
        tokio::spawn(publish_rows(client.clone(), topic(name), feed.clone(), Arc::clone(&app.outlets)));
    }
    tokio::spawn(publish_status(client, topic("status"), Arc::clone(app)));
    tokio::spawn(keep_connected(connection, login, Arc::clone(&app.outlets)));
}

/// Publishes the rows of a feed, each as a message. `{"lost": N}` stands for rows that the broker was too slow for.
async fn publish_rows(
    client: AsyncClient,
    topic: String,
    feed: Feed,
    outlets: Arc<Outlets>,
) -> Result<(), ClientError> {
    let mut follower = feed.follow();
    while let Some(delivery) = follower.next().await {
        if delivery.lost > 0 {
            outlets.add_lost(delivery.lost);
            let notice = json!({ "lost": delivery.lost }).to_string();
            client.publish(&topic, QUALITY, false, notice).await?;
        }
        for row in &delivery.batch.rows {
            client.publish_bytes(&topic, QUALITY, false, Bytes::from(row.clone())).await?;
        }
    }
    Ok(())
}

/// Publishes the state of the rig whenever it changes, at most once per [`STATUS_PERIOD`]. It is retained, so that a
/// subscriber gets it at once.
async fn publish_status(client: AsyncClient, topic: String, app: Arc<App>) -> Result<(), ClientError> {
    let mut state = app.state.subscribe();
    state.mark_changed();
    while state.changed().await.is_ok() {
        let text = state.borrow_and_update().json();
        client.publish_bytes(&topic, QUALITY, true, text).await?;
        sleep(STATUS_PERIOD).await;
    }
    Ok(())
}

/// Connects to the broker, and again whenever the connection breaks. Messages without an acknowledgement are sent again.
async fn keep_connected(mut connection: EventLoop, login: Login, outlets: Arc<Outlets>) {
    let mut unacknowledged = VecDeque::new();
    let mut was_reported = false;
    loop {
        match connection.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => {
                log::info!("the MQTT broker is connected");
                outlets.connect();
                was_reported = false;
                let kept: VecDeque<_> = unacknowledged.drain(..).filter(is_publication).collect();
                outlets.add_lost(kept.len().saturating_sub(MAX_IN_FLIGHT.into()) as u64);
                connection.pending.extend(kept.into_iter().take(MAX_IN_FLIGHT.into()));
            }
            Ok(_) => {}
            Err(error) => {
                // A new session has no place for them, so that the client would drop them when it connects.
                unacknowledged.extend(std::mem::take(&mut connection.pending));
                outlets.disconnect();
                if !was_reported {
                    log::warn!("{}; trying again", login.explain(&error));
                    was_reported = true;
                }
                sleep(if is_refusal(&error) { REFUSED_RETRY } else { RETRY }).await;
            }
        }
    }
}

/// Whether a request to the client publishes a message.
fn is_publication(request: &Request) -> bool {
    matches!(request, Request::Publish(_))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Map, Value};

    /// The payloads of the messages that wait for a connection.
    fn waiting(connection: &mut EventLoop) -> Vec<String> {
        connection.clean();
        let publications = connection.pending.drain(..).filter_map(|request| match request {
            Request::Publish(publish) => Some(String::from_utf8_lossy(&publish.payload).into_owned()),
            _ => None,
        });
        publications.collect()
    }

    #[test]
    fn rows_that_waited_too_long_for_the_broker_are_counted_and_reported() {
        let row = |frame: u64| -> Map<String, Value> { [("frame".to_owned(), json!(frame))].into_iter().collect() };
        // With a queue, whose content can be read without a broker.
        let (client, mut connection) = AsyncClient::new(MqttOptions::new("test", "localhost", 1883), 10);
        let (feed, outlets) = (Feed::default(), Arc::<Outlets>::default());
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let received = runtime.block_on(async {
            tokio::spawn(publish_rows(client, "topic".into(), feed.clone(), Arc::clone(&outlets)));
            tokio::task::yield_now().await;
            feed.send(&[row(0)]);
            tokio::task::yield_now().await;
            (1..5000).for_each(|frame| feed.send(&[row(frame)]));
            let mut received = Vec::new();
            for _ in 0..20_000 {
                tokio::task::yield_now().await;
                received.extend(waiting(&mut connection));
            }
            received
        });
        let rows: Vec<Value> = received.iter().map(|text| serde_json::from_str(text).unwrap()).collect();
        let frames: Vec<u64> = rows.iter().filter_map(|row| row["frame"].as_u64()).collect();
        let lost: u64 = rows.iter().filter_map(|row| row["lost"].as_u64()).sum();
        assert_eq!((lost, frames.last()), (5000 - frames.len() as u64, Some(&4999)));
        assert!(lost > 2000, "{lost}");
        assert_eq!(outlets.lost(), lost);
    }
}
