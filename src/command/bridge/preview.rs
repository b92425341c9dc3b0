//! The thread that publishes small pictures of the live frames while somebody reads them.

use super::session::key;
use crate::bus::{Bus, BusError};
use crate::image::Frame;
use crate::process::Stop;
use crate::serve::PictureEncoder;
use serde_json::json;
use std::thread::JoinHandle;
use std::time::Duration;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

/// The maximum side of a picture, px.
const SIDE_PX: usize = 320;
/// The period of the pictures.
const PERIOD: Duration = Duration::from_millis(100);
/// Interval of looking for a frame, a reader or a rig.
const RETRY: Duration = Duration::from_millis(200);
/// The number of periods without a frame after which the rig is searched for again.
const MAX_LOOKS: u32 = 10;

/// Starts the thread; it ends when a stop is requested.
///
/// # Errors
///
/// That of Zenoh when the key cannot be declared.
pub(super) fn start(session: &Session, rig: &str, stop: &Stop) -> zenoh::Result<JoinHandle<()>> {
    let publisher = session
        .declare_publisher(key(rig, "preview"))
        .encoding(Encoding::IMAGE_JPEG)
        .congestion_control(CongestionControl::Drop)
        // Rows go first.
        .priority(Priority::Background)
        .wait()?;
    let (rig, stop) = (rig.to_owned(), stop.clone());
    Ok(std::thread::spawn(move || {
        while !stop.requested() {
            match publish_run(&rig, &publisher, &stop) {
                Ok(()) | Err(BusError::NoRig { .. }) => {}
                Err(error) => log::warn!("{error}; trying again"),
            }
            std::thread::sleep(RETRY);
        }
    }))
}

/// Publishes pictures of one run of the rig while it lasts and somebody reads them.
///
/// # Errors
///
/// [`BusError::NoRig`] while the rig does not run.
fn publish_run(rig: &str, publisher: &Publisher<'_>, stop: &Stop) -> Result<(), BusError> {
    let is_read = || publisher.matching_status().wait().is_ok_and(|status| status.matching());
    if !is_read() || !Bus::is_running(rig) {
        return Ok(());
    }
    let bus = Bus::join(rig, "bridge")?;
    let frames = bus.listen_newest_frame()?;
    let mut encoder = PictureEncoder::new(SIDE_PX);
    let mut looks = 0;
    while !stop.requested() && is_read() && looks < MAX_LOOKS {
        std::thread::sleep(PERIOD);
        looks += 1;
        let Some(sample) = frames.take()? else { continue };
        let Some(meta) = sample.header().meta() else { continue };
        let Some(picture) = encoder.encode(&Frame { meta, bytes: sample.bytes() }) else { continue };
        drop(sample);
        looks = 0;
        let about = json!({ "frame": meta.sequence, "stamp_ns": meta.stamp_ns, "scale": picture.scale });
        if let Err(error) = publisher.put(picture.jpeg).attachment(about.to_string()).wait() {
            log::warn!("a picture was not published: {error}");
        }
    }
    Ok(())
}
