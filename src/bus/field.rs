//! The `field` topic: the step of one body and its displacement field.

use super::{Bus, BusError, Limits, failure, memory};
use crate::message::{FieldHeader, FieldPointMessage};
use crate::results::PairField;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, ipc};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

const TOPIC: &str = "field";
/// The size of most messages, bytes: some hundred subsets.
const USUAL_BYTES: usize = 4096;

type Service = PortFactory<ipc::Service, [FieldPointMessage], FieldHeader>;

/// Publishes fields.
#[derive(Debug)]
pub struct FieldPublisher {
    port: Publisher<ipc::Service, [FieldPointMessage], FieldHeader>,
    _service: Service,
    max_points: usize,
}

impl FieldPublisher {
    /// Publishes a step and the points of its field, none for `None`.
    ///
    /// Returns `false`, without publishing, if shared memory is full.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used, or the field has more points than the rig allows.
    pub fn send(&self, header: &FieldHeader, field: Option<&PairField>) -> Result<bool, BusError> {
        let points = field.map_or(&[][..], |field| &field.points);
        if points.len() > self.max_points {
            let reason = format!("the field has {} points, at most {} fit", points.len(), self.max_points);
            return Err(BusError::new("publish", TOPIC, reason));
        }
        // The pool is not reserved, because most fields are much smaller than the largest.
        let needed_bytes = std::mem::size_of_val(points) + size_of::<FieldHeader>() + 4096;
        if memory::require(needed_bytes as u64).is_err() {
            return Ok(false);
        }
        let mut sample = self.port.loan_slice_uninit(points.len()).map_err(failure("publish", TOPIC))?;
        *sample.user_header_mut() = *header;
        let sample = sample.write_from_fn(|index| FieldPointMessage::from(&points[index]));
        sample.send().map(|_| true).map_err(failure("publish", TOPIC))
    }

    /// Touches the pages that `count` messages of usual size take, so that they cause no page faults while the ring fills.
    ///
    /// The pool gives back the place that was freed last, so a queue that is full needs no others.
    fn touch(&self, count: usize) {
        let [Ok(one), Ok(next)] = [0, 1].map(|_| self.port.loan_slice_uninit(self.max_points)) else { return };
        let [one, next] = [one, next].map(|sample| sample.payload().as_ptr() as usize);
        memory::populate_heads(one.min(next), one.abs_diff(next), count, USUAL_BYTES);
    }
}

/// Receives fields.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let fields = bus.listen_field()?;
/// while let Some((header, field)) = fields.take()? {
///     // A step has no field where nothing was matched with a later frame.
///     let Some(field) = field else { continue };
///     let measured = field.points.iter().filter(|point| point.displacement.is_some()).count();
///     println!("body {} in frame {}: {measured} subsets measured", header.body, header.sequence);
/// }
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct FieldSubscriber {
    port: Subscriber<ipc::Service, [FieldPointMessage], FieldHeader>,
    _service: Service,
}

impl FieldSubscriber {
    /// Returns the oldest unread step and its field, if there is one. The field is `None` for a step without a field.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn take(&self) -> Result<Option<(FieldHeader, Option<PairField>)>, BusError> {
        let sample = self.port.receive().map_err(failure("read", TOPIC))?;
        Ok(sample.map(|sample| (*sample.user_header(), sample.user_header().field(sample.payload()))))
    }

    /// Returns the oldest unread step, with its field only if it is a step of this frame, since reading a field takes time.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn take_of(&self, frame: u64) -> Result<Option<(FieldHeader, Option<PairField>)>, BusError> {
        let sample = self.port.receive().map_err(failure("read", TOPIC))?;
        Ok(sample.map(|sample| {
            let header = *sample.user_header();
            (header, (header.sequence == frame).then(|| header.field(sample.payload())).flatten())
        }))
    }

    /// Connects to writers that joined since the last call; consumes nothing.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn update_connections(&self) {
        let _ = self.port.update_connections();
    }
}

impl Bus {
    /// Opens the service of the fields, or creates it with these limits.
    pub(super) fn field_service(&self, limits: &Limits) -> Result<Service, BusError> {
        self.node()
            .service_builder(&self.service_name(TOPIC)?)
            .publish_subscribe::<[FieldPointMessage]>()
            .user_header::<FieldHeader>()
            .enable_safe_overflow(true)
            .max_publishers(limits.workers as usize + 4)
            .max_subscribers(12)
            .max_nodes(64)
            .subscriber_max_buffer_size(limits.field_depth())
            .subscriber_max_borrowed_samples(4)
            .history_size(0)
            .open_or_create()
            .map_err(self.failure("create", TOPIC))
    }

    /// Creates the publisher of fields of one worker.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn field_publisher(&self, limits: &Limits) -> Result<FieldPublisher, BusError> {
        let service = self.field_service(limits)?;
        let chunks = 2 * limits.field_depth() + 64;
        let port = service
            .publisher_builder()
            .initial_max_slice_len(limits.field_points)
            .allocation_strategy(AllocationStrategy::Static)
            .max_loaned_samples(2)
            .override_sample_preallocation(move |worst| worst.min(chunks))
            .create()
            .map_err(self.failure("write", TOPIC))?;
        let publisher = FieldPublisher { port, _service: service, max_points: limits.field_points };
        publisher.touch(limits.field_depth());
        Ok(publisher)
    }

    /// Creates a subscriber of fields for a process of the rig.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn field_subscriber(&self, limits: &Limits) -> Result<FieldSubscriber, BusError> {
        self.subscribe_to_field(self.field_service(limits)?, limits.field_depth())
    }

    /// Creates a subscriber of fields for any other program, whose queue holds 64 fields.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] when the rig is not running; [`BusError::Service`] or [`BusError::Memory`] when shared
    /// memory cannot be used.
    pub fn listen_field(&self) -> Result<FieldSubscriber, BusError> {
        self.rejoin_present_domain()?;
        let service = self
            .node()
            .service_builder(&self.service_name(TOPIC)?)
            .publish_subscribe::<[FieldPointMessage]>()
            .user_header::<FieldHeader>()
            .open()
            .map_err(|error| self.open_error(TOPIC, error))?;
        self.subscribe_to_field(service, 64)
    }

    /// Creates a subscriber whose queue holds `depth` fields.
    fn subscribe_to_field(&self, service: Service, depth: usize) -> Result<FieldSubscriber, BusError> {
        let port = service.subscriber_builder().buffer_size(depth).create().map_err(self.failure("read", TOPIC))?;
        Ok(FieldSubscriber { port, _service: service })
    }
}
