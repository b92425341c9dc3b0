//! The server for Foxglove viewers: the live picture with what is measured in it, the topics as JSON, and the commands.
//!
//! It has no access by token, so it is bound to this computer alone.

mod log;
mod parameters;

use super::app::App;
use super::control;
use super::feed::Feed;
use super::picture::Picture;
use super::picture_feed::field_example;
use super::rows::{self, RowContext};
use crate::message::{Command, Event, ImpactMessage, ReplyCode, VelocityMessage};
use foxglove::messages::{CircleAnnotation, Color, CompressedImage, ImageAnnotations, Point2, Timestamp};
use foxglove::websocket::Capability;
use foxglove::websocket::service::{Service, ServiceSchema};
use foxglove::{Channel, ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer};
use parameters::{Parameters, publish_armed};
use serde_json::{Map, Value, json};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{sleep, timeout};

/// The number of messages that wait for a slow viewer. With pictures of at most 100 kB these are 6 MB.
const BACKLOG: usize = 64;
/// Interval of asking whether anybody watches a channel.
const IDLE: Duration = Duration::from_millis(100);
/// The frame of reference of pictures and annotations.
const FRAME_ID: &str = "camera";
/// The commands that viewers can send.
const COMMANDS: [Command; 3] = [Command::Arm, Command::Disarm, Command::Trigger];
/// The colour of the outlines.
const OUTLINE_COLOR: Color = Color { r: 0.2, g: 0.9, b: 0.4, a: 1.0 };

/// Starts the server on the runtime that calls it, and returns the address that it has taken.
///
/// # Errors
///
/// When the address cannot be used.
pub(super) async fn start(app: &Arc<App>, address: SocketAddr) -> Result<SocketAddr, FoxgloveError> {
    let context = Context::new();
    let bodies = app.config.bodies.iter().map(|body| body.name.clone()).collect();
    let row = RowContext { bodies, origin_ns: None };
    let topics = [
        ("/velocity", rows::velocity_row(&VelocityMessage::default(), &row), app.velocity.clone()),
        ("/impact", rows::impact_row(&ImpactMessage::default(), &row), app.impact.clone()),
        (
            "/events",
            rows::event_row(&Event::new(crate::message::EventKind::Started, 0, 0, 0, ""), &row),
            app.events.clone(),
        ),
    ];
    for (topic, example, feed) in topics {
        let channel = json_channel(&context, topic, &example.unwrap_or_default())?;
        tokio::spawn(send_rows(channel, feed));
    }
    let log = ChannelBuilder::new("/log").context(&context).build();
    tokio::spawn(log::send_log(log, app.events.clone()));
    let channels = PictureChannels {
        image: ChannelBuilder::new("/camera/image").context(&context).build(),
        annotations: ChannelBuilder::new("/camera/annotations").context(&context).build(),
        field: json_channel(&context, "/field", &field_example())?,
    };
    // The channels end with their context.
    let pictures = send_pictures(Arc::clone(app), channels);
    let kept = Arc::clone(&context);
    tokio::spawn(async move {
        pictures.await;
        drop(kept);
    });
    let server = WebSocketServer::new()
        .name(format!("ricochet {}", app.config.rig.name))
        .bind(address.ip().to_string(), address.port())
        .context(&context)
        .message_backlog_size(BACKLOG)
        .supported_encodings(["json"])
        .services(COMMANDS.map(|command| command_service(app, command)))
        .capabilities([Capability::Parameters])
        .parameter_handler(Arc::new(Parameters::new(Arc::clone(app))))
        .start()
        .await?;
    let port = server.port();
    tokio::spawn(publish_armed(server, Arc::clone(app)));
    Ok(SocketAddr::new(address.ip(), port))
}

/// Opens a channel of JSON rows, whose schema has the columns of `example`: texts as strings, lists as lists of objects,
/// everything else as numbers.
fn json_channel(
    context: &Arc<Context>,
    topic: &str,
    example: &Map<String, Value>,
) -> Result<Arc<RawChannel>, FoxgloveError> {
    let schema = object_schema(example).to_string();
    let schema = Schema::new(format!("ricochet{}", topic.replace('/', ".")), "jsonschema", schema.into_bytes());
    ChannelBuilder::new(topic).context(context).message_encoding("json").schema(schema).build_raw()
}

/// Returns the JSON schema of an object with the names and types of this one.
fn object_schema(example: &Map<String, Value>) -> Value {
    let kind = |value: &Value| match value {
        Value::Array(list) => {
            let items = list.first().and_then(Value::as_object).map(object_schema);
            json!({ "type": "array", "items": items.unwrap_or_else(|| json!({})) })
        }
        Value::String(_) => json!({ "type": "string" }),
        _ => json!({ "type": "number" }),
    };
    let properties: Map<String, Value> = example.iter().map(|(name, value)| (name.clone(), kind(value))).collect();
    json!({ "type": "object", "properties": properties })
}

/// Sends the rows of a topic to its channel while anybody watches it, until the topic ends.
async fn send_rows(channel: Arc<RawChannel>, feed: Feed) {
    loop {
        if !channel.has_sinks() {
            sleep(IDLE).await;
            continue;
        }
        let mut follower = feed.follow();
        while channel.has_sinks() {
            match timeout(IDLE, follower.next()).await {
                Err(_) => {}
                Ok(None) => return,
                Ok(Some(delivery)) => {
                    for row in &delivery.batch.rows {
                        channel.log_with_meta(row.as_bytes(), PartialMetadata { log_time: stamp_of(row) });
                    }
                }
            }
        }
    }
}

/// Returns the time of a row of any topic, ns since the Unix epoch: its stamp, or the origin of a collision's times.
/// `None` if it has neither.
fn stamp_of(row: &str) -> Option<u64> {
    let row: Map<String, Value> = serde_json::from_str(row).ok()?;
    ["stamp_ns", "origin_ns"].iter().find_map(|key| row.get(*key)?.as_u64())
}

/// The channels of the picture and of what is measured in it.
struct PictureChannels {
    image: Channel<CompressedImage>,
    annotations: Channel<ImageAnnotations>,
    field: Arc<RawChannel>,
}

impl PictureChannels {
    /// Whether anybody watches one of them.
    fn are_watched(&self) -> bool {
        self.image.has_sinks() || self.annotations.has_sinks() || self.field.has_sinks()
    }

    /// Sends a picture with its annotations, and the field of each body in it.
    fn send(&self, picture: &Picture) {
        self.annotations.log(&annotations_of(picture));
        self.image.log(&image_of(picture));
        let log_time = picture.header["stamp_ns"].as_u64();
        for field in &picture.fields {
            self.field.log_with_meta(field.to_string().as_bytes(), PartialMetadata { log_time });
        }
    }
}

/// Sends each new picture while anybody watches it, until the pictures end.
async fn send_pictures(app: Arc<App>, channels: PictureChannels) {
    loop {
        if !channels.are_watched() {
            sleep(IDLE).await;
            continue;
        }
        let mut receiver = app.pictures.subscribe();
        while channels.are_watched() {
            match timeout(IDLE, receiver.changed()).await {
                Err(_) => {}
                Ok(Err(_)) => return,
                Ok(Ok(())) => {
                    let picture = receiver.borrow_and_update().clone();
                    if let Some(picture) = picture {
                        channels.send(&picture);
                    }
                }
            }
        }
    }
}

/// Returns the time of the picture's frame; `None` if it does not fit into Foxglove's 32-bit seconds.
fn timestamp(picture: &Picture) -> Option<Timestamp> {
    let stamp_ns = picture.header["stamp_ns"].as_u64()?;
    let seconds = u32::try_from(stamp_ns / 1_000_000_000).ok()?;
    Some(Timestamp::new(seconds, (stamp_ns % 1_000_000_000) as u32))
}

/// Returns the picture as a Foxglove message.
fn image_of(picture: &Picture) -> CompressedImage {
    CompressedImage {
        timestamp: timestamp(picture),
        frame_id: FRAME_ID.into(),
        data: picture.jpeg.clone(),
        format: "jpeg".into(),
    }
}

/// Returns the circles of the bodies, in pixels of the picture, whose first pixel has its centre at (0.5, 0.5).
fn annotations_of(picture: &Picture) -> ImageAnnotations {
    let scale = picture.header["scale"].as_f64().unwrap_or(1.0);
    let bodies = picture.header["bodies"].as_array().into_iter().flatten();
    let circle = |body: &Value| {
        let number = |key: &str| body[key].as_f64();
        let (x, y, radius) = (number("x_px")?, number("y_px")?, number("radius_px")?);
        Some(CircleAnnotation {
            timestamp: timestamp(picture),
            // The first pixel's centre is (0, 0) in the header, and (0.5, 0.5) in Foxglove.
            position: Some(Point2 { x: (x + 0.5) / scale, y: (y + 0.5) / scale }),
            diameter: 2.0 * radius / scale,
            thickness: 1.0,
            outline_color: Some(OUTLINE_COLOR),
            ..CircleAnnotation::default()
        })
    };
    ImageAnnotations {
        timestamp: timestamp(picture),
        circles: bodies.filter_map(circle).collect(),
        ..ImageAnnotations::default()
    }
}

/// Returns the service of a command. It sends the command to the rig, and answers with `accepted` and a sentence.
fn command_service(app: &Arc<App>, command: Command) -> Service {
    let empty = || Schema::new("ricochet.Request", "jsonschema", br#"{"type":"object"}"#.to_vec());
    let answer = br#"{"type":"object","properties":{"accepted":{"type":"boolean"},"answer":{"type":"string"}}}"#;
    let schema = ServiceSchema::new(format!("ricochet.{}", command.as_str()))
        .with_request("json", empty())
        .with_response("json", Schema::new("ricochet.Reply", "jsonschema", answer.to_vec()));
    let app = Arc::clone(app);
    Service::builder(format!("/{}", command.as_str()), schema).blocking_handler_fn(move |_request| {
        let reply = control::ask(&app.config.rig.name, command).map_err(|error| error.to_string())?;
        let reply = reply.ok_or_else(|| "the rig does not answer".to_owned())?;
        let code = ReplyCode::from_number(reply.code).unwrap_or(ReplyCode::Unknown);
        let answer = json!({ "accepted": code == ReplyCode::Accepted, "answer": code.as_str() });
        Ok::<_, String>(answer.to_string().into_bytes())
    })
}
