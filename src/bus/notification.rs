//! Notifications that wake readers, at most about once per millisecond and never once per frame.
//!
//! To wake a sleeping reader costs the writer some ten microseconds. At 10 000 frames per second that would be a core.
//! Readers also wake by themselves every few milliseconds, so a skipped notification loses nothing.

use super::{Bus, BusError};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::prelude::ipc;
use iceoryx2::service::port_factory::event::PortFactory;
use std::time::{Duration, Instant};

type Service = PortFactory<ipc::Service>;

/// The minimum time between notifications: less than a millisecond, so that each row of 1000 per second wakes its readers.
const MIN_INTERVAL: Duration = Duration::from_micros(800);

/// Wakes the readers of a topic.
#[derive(Debug)]
pub struct TopicNotifier {
    port: Notifier<ipc::Service>,
    _service: Service,
    /// The time of the last notification.
    last: Option<Instant>,
}

impl TopicNotifier {
    /// Wakes the readers, unless this notifier did so less than 0.8 ms ago.
    pub fn notify(&mut self) {
        #[expect(clippy::disallowed_methods, reason = "decides when readers wake, never what they measure")]
        let now = Instant::now();
        if self.last.is_none_or(|last| now.duration_since(last) >= MIN_INTERVAL) {
            let _ = self.port.notify();
            self.last = Some(now);
        }
    }
}

/// Waits for the notifications of a topic.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
/// use ricochet::message::VelocityMessage;
/// use std::time::Duration;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let velocities = bus.listen::<VelocityMessage>()?;
/// // `frames`, `field` and `velocity` have notifications.
/// let listener = bus.listener("velocity")?;
/// while bus.is_alive() {
///     listener.wait(Duration::from_millis(5));
///     while let Some(message) = velocities.take()? {
///         println!("frame {}", message.sequence);
///     }
/// }
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct TopicListener {
    port: Listener<ipc::Service>,
    _service: Service,
}

impl TopicListener {
    /// Sleeps until the next notification, at most `timeout`.
    pub fn wait(&self, timeout: Duration) {
        // An interrupted wait is only shorter.
        let _ = self.port.timed_wait(|_| (), timeout);
    }
}

impl Bus {
    /// Opens the service of the notifications of this topic, or creates it.
    pub(super) fn notification_service(&self, topic: &str) -> Result<Service, BusError> {
        self.node()
            .service_builder(&self.service_name(topic)?)
            .event()
            .max_notifiers(72)
            .max_listeners(80)
            .max_nodes(80)
            .event_id_max_value(15)
            .disable_deadline()
            .open_or_create()
            .map_err(self.failure("create the notifications of", topic))
    }

    /// Creates the notifier of this topic.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn notifier(&self, topic: &str) -> Result<TopicNotifier, BusError> {
        let service = self.notification_service(topic)?;
        let port = service.notifier_builder().create().map_err(self.failure("notify readers of", topic))?;
        Ok(TopicNotifier { port, _service: service, last: None })
    }

    /// Creates a listener for the notifications of this topic, in the rig's present domain.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] or [`BusError::Memory`] when shared memory cannot be used.
    pub fn listener(&self, topic: &str) -> Result<TopicListener, BusError> {
        self.rejoin_present_domain()?;
        self.notification_subscriber(topic)
    }

    /// Creates a listener for the notifications of this topic for a process of the rig.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn notification_subscriber(&self, topic: &str) -> Result<TopicListener, BusError> {
        let service = self.notification_service(topic)?;
        let port = service.listener_builder().create().map_err(self.failure("wait for", topic))?;
        Ok(TopicListener { port, _service: service })
    }
}
