//! Topics of fixed-size messages.

use super::{Bus, BusError, Limits, failure};
use crate::message::{Event, ImpactMessage, Progress, StatusMessage, TrackMessage, VelocityMessage};
use iceoryx2::port::publisher::Publisher as Port;
use iceoryx2::port::subscriber::Subscriber as SubscriberPort;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{ZeroCopySend, ipc};
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use std::fmt::Debug;

/// A message that has a topic of its own.
///
/// # Examples
///
/// ```
/// use ricochet::bus::Topic;
/// use ricochet::message::{Event, VelocityMessage};
///
/// assert_eq!(VelocityMessage::NAME, "velocity");
/// // A listener that comes late still receives the last events.
/// assert_eq!((Event::NAME, Event::HISTORY), ("events", 16));
/// ```
pub trait Topic: ZeroCopySend + Debug + Copy + 'static {
    /// The last part of the service's name.
    const NAME: &'static str;
    /// The number of past messages that a new reader receives.
    const HISTORY: usize;
}

impl Topic for TrackMessage {
    const NAME: &'static str = "track";
    const HISTORY: usize = 16;
}
impl Topic for VelocityMessage {
    const NAME: &'static str = "velocity";
    const HISTORY: usize = 16;
}
impl Topic for ImpactMessage {
    const NAME: &'static str = "impact";
    const HISTORY: usize = 16;
}
impl Topic for Event {
    const NAME: &'static str = "events";
    const HISTORY: usize = 16;
}
impl Topic for StatusMessage {
    const NAME: &'static str = "status";
    const HISTORY: usize = 1;
}
impl Topic for Progress {
    const NAME: &'static str = "progress";
    const HISTORY: usize = 1;
}

type Service<T> = PortFactory<ipc::Service, T, ()>;

/// Publishes a topic.
#[derive(Debug)]
pub struct Publisher<T: Topic> {
    port: Port<ipc::Service, T, ()>,
    _service: Service<T>,
}

impl<T: Topic> Publisher<T> {
    /// Publishes a message.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn send(&self, message: &T) -> Result<(), BusError> {
        self.port.send_copy(*message).map(|_| ()).map_err(failure("publish", T::NAME))
    }

    /// Sends the history to readers that joined since the last message.
    pub fn update_connections(&self) {
        let _ = self.port.update_connections();
    }
}

/// Receives a topic.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
/// use ricochet::message::VelocityMessage;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let velocities = bus.listen::<VelocityMessage>()?;
/// let mut next_frame = None;
/// // `None` means that there is no message now. Another one may come.
/// while let Some(message) = velocities.take()? {
///     // With one body, a jump of the frame numbers is a loss.
///     if next_frame.is_some_and(|expected| message.sequence > expected) {
///         eprintln!("frames before {} were lost", message.sequence);
///     }
///     next_frame = Some(message.sequence + 1);
/// }
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct Subscriber<T: Topic> {
    port: SubscriberPort<ipc::Service, T, ()>,
    _service: Service<T>,
}

impl<T: Topic> Subscriber<T> {
    /// Returns the oldest unread message, if there is one.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn take(&self) -> Result<Option<T>, BusError> {
        let sample = self.port.receive().map_err(failure("read", T::NAME))?;
        Ok(sample.map(|sample| *sample.payload()))
    }
}

impl Bus {
    /// Opens the service of this topic, or creates it with these limits.
    pub(super) fn topic_service<T: Topic>(&self, limits: &Limits) -> Result<Service<T>, BusError> {
        let writers = 2 * limits.workers as usize + 16;
        self.node()
            .service_builder(&self.service_name(T::NAME)?)
            .publish_subscribe::<T>()
            .enable_safe_overflow(true)
            .max_publishers(writers)
            .max_subscribers(32)
            .max_nodes(64)
            .subscriber_max_buffer_size(Limits::small_depth())
            .subscriber_max_borrowed_samples(2)
            .history_size(T::HISTORY)
            .open_or_create()
            .map_err(self.failure("create", T::NAME))
    }

    /// Creates a publisher of this topic.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn publisher<T: Topic>(&self, limits: &Limits) -> Result<Publisher<T>, BusError> {
        self.publish_to(self.topic_service::<T>(limits)?)
    }

    /// Creates a publisher of this topic for a process that does not know the limits of the rig.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] when the rig is not running, [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn guest_publisher<T: Topic>(&self) -> Result<Publisher<T>, BusError> {
        self.publish_to(self.existing_service::<T>()?)
    }

    /// Creates a publisher on an open service.
    fn publish_to<T: Topic>(&self, service: Service<T>) -> Result<Publisher<T>, BusError> {
        let port = service
            .publisher_builder()
            .max_loaned_samples(2)
            .override_sample_preallocation(|worst| worst.min(2 * Limits::small_depth()))
            .create()
            .map_err(self.failure("write", T::NAME))?;
        Ok(Publisher { port, _service: service })
    }

    /// Creates a subscriber of this topic for a process of the rig.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn subscriber<T: Topic>(&self, limits: &Limits) -> Result<Subscriber<T>, BusError> {
        self.subscribe_to(self.topic_service::<T>(limits)?)
    }

    /// Creates a subscriber of this topic for any other program, in the rig's present domain.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] when the rig is not running; [`BusError::Service`] or [`BusError::Memory`] when shared
    /// memory cannot be used.
    pub fn listen<T: Topic>(&self) -> Result<Subscriber<T>, BusError> {
        self.rejoin_present_domain()?;
        self.subscribe_to(self.existing_service::<T>()?)
    }

    /// Opens the service of this topic with the limits that it has.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] if it does not exist, [`BusError::Service`] if it cannot be opened.
    fn existing_service<T: Topic>(&self) -> Result<Service<T>, BusError> {
        let opened = self.node().service_builder(&self.service_name(T::NAME)?).publish_subscribe::<T>().open();
        opened.map_err(|error| self.open_error(T::NAME, error))
    }

    /// Returns the error of a topic that cannot be opened: no rig runs, or it has another version of the topic.
    pub(super) fn open_error(&self, topic: &str, error: PublishSubscribeOpenError) -> BusError {
        match error {
            // The last two: its processes have just been killed or are ending.
            PublishSubscribeOpenError::DoesNotExist
            | PublishSubscribeOpenError::IsMarkedForDestruction
            | PublishSubscribeOpenError::ServiceInCorruptedState => self.no_rig_error(topic),
            other => BusError::new("open", &self.full_name(topic), other),
        }
    }

    /// Returns the error of a rig that does not run.
    pub(super) fn no_rig_error(&self, topic: &str) -> BusError {
        BusError::NoRig { rig: self.rig.clone(), service: self.full_name(topic) }
    }

    /// Creates a subscriber on an open service, which first receives the history.
    fn subscribe_to<T: Topic>(&self, service: Service<T>) -> Result<Subscriber<T>, BusError> {
        let port = service
            .subscriber_builder()
            .buffer_size(Limits::small_depth())
            .history_request(T::HISTORY)
            .create()
            .map_err(self.failure("read", T::NAME))?;
        Ok(Subscriber { port, _service: service })
    }
}
