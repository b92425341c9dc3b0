//! The ring of frames: bytes with a header, written once and read by all.
#![expect(unsafe_code, reason = "slots of the ring are lent to cameras, which write them through a pointer")]

use super::{Bus, BusError, Limits, failure, memory};
use crate::camera::Slot;
use crate::message::FrameHeader;
use iceoryx2::port::LoanError;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{AllocationStrategy, ipc};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use std::mem::MaybeUninit;
use std::ptr::NonNull;

const TOPIC: &str = "frames";

type Service = PortFactory<ipc::Service, [u8], FrameHeader>;
type Loan = SampleMutUninit<ipc::Service, [MaybeUninit<u8>], FrameHeader>;

/// Publishes frames into the ring.
pub struct FramePublisher {
    // Loans are dropped before the port that owns their memory.
    loans: Vec<Option<Loan>>,
    port: Publisher<ipc::Service, [u8], FrameHeader>,
    _service: Service,
    slot_bytes: usize,
}

impl FramePublisher {
    /// Lends a slot of the ring to a camera; `None` when readers hold all slots, or the camera as many as it may.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn lend(&mut self) -> Result<Option<Slot>, BusError> {
        let mut loan = match self.port.loan_slice_uninit(self.slot_bytes) {
            Ok(loan) => loan,
            Err(LoanError::OutOfMemory | LoanError::ExceedsMaxLoans) => return Ok(None),
            Err(error) => return Err(BusError::new("lend a slot of", TOPIC, error)),
        };
        let Some(memory) = NonNull::new(loan.payload_mut().as_mut_ptr().cast::<u8>()) else {
            return Ok(None);
        };
        let token = self.loans.iter().position(Option::is_none).unwrap_or(self.loans.len());
        if token == self.loans.len() {
            self.loans.push(None);
        }
        self.loans[token] = Some(loan);
        // SAFETY: the loan stays in `loans` until the slot comes back, so its memory is valid and nobody else's.
        Ok(Some(unsafe { Slot::new(memory, self.slot_bytes, token) }))
    }

    /// Publishes a filled slot of this ring with its header.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used, or the slot is not lent by this ring.
    pub fn send(&mut self, slot: Slot, header: FrameHeader) -> Result<(), BusError> {
        let Some(mut loan) = self.loans.get_mut(slot.token()).and_then(Option::take) else {
            return Err(BusError::new("publish", TOPIC, "a slot of another ring"));
        };
        *loan.user_header_mut() = header;
        // SAFETY: shared memory is zeroed by the system and pre-touched, so every byte is initialised.
        let sample = unsafe { loan.assume_init() };
        sample.send().map(|_| ()).map_err(failure("publish", TOPIC))
    }

    /// Returns a lent slot to the ring without publishing it.
    pub fn take_back(&mut self, slot: Slot) {
        if let Some(loan) = self.loans.get_mut(slot.token()) {
            *loan = None;
        }
    }

    /// Returns all lent slots to the ring without publishing them, after the camera that held them is gone.
    pub fn take_all_back(&mut self) {
        self.loans.clear();
    }

    /// Connects to readers that joined since the last frame, so that they receive the next one.
    pub fn update_connections(&self) {
        let _ = self.port.update_connections();
    }

    /// Touches all pages of the ring, so that the first frames cause no page faults.
    ///
    /// Does nothing while no slot is free.
    ///
    /// # Errors
    ///
    /// [`BusError::Memory`] when there is less memory than the ring needs, [`BusError::Service`] when shared memory
    /// cannot be used.
    pub fn touch(&mut self) -> Result<(), BusError> {
        if let Some(slot) = self.lend()? {
            let address = slot.as_ptr() as usize;
            self.take_back(slot);
            memory::populate(address)?;
        }
        Ok(())
    }
}

/// A frame in the ring; the slot is free again when it is dropped.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
/// use ricochet::image::{Frame, Image};
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let frames = bus.listen_newest_frame()?;
/// let mut image = Image::default();
/// if let Some(sample) = frames.take()? {
///     let meta = sample.header().meta().ok_or("unknown pixel format")?;
///     Frame { meta, bytes: sample.bytes() }.unpack(&mut image)?;
/// }
/// // The slot is free again; `image` is a copy.
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct FrameSample(Sample<ipc::Service, [u8], FrameHeader>);

impl FrameSample {
    /// Returns the header of the frame.
    pub fn header(&self) -> &FrameHeader {
        self.0.user_header()
    }

    /// Returns the bytes of the slot: the pixels row by row, with the row padding, and any unused bytes behind them.
    pub fn bytes(&self) -> &[u8] {
        self.0.payload()
    }
}

/// Receives frames from the ring.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let frames = bus.listen_newest_frame()?;
/// // `None` means that no frame came since the last call.
/// if let Some(sample) = frames.take()? {
///     let header = sample.header();
///     println!("frame {}: {} x {} px", header.sequence, header.width_px, header.height_px);
/// }
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct FrameSubscriber {
    port: Subscriber<ipc::Service, [u8], FrameHeader>,
    _service: Service,
}

impl FrameSubscriber {
    /// Returns the oldest unread frame, if there is one.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn take(&self) -> Result<Option<FrameSample>, BusError> {
        self.port.receive().map(|sample| sample.map(FrameSample)).map_err(failure("read", TOPIC))
    }

    /// Connects to writers that joined since the last call; consumes nothing.
    ///
    /// Without it, a reader that only waits loses all frames when the writer dies.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn update_connections(&self) {
        let _ = self.port.update_connections();
    }
}

impl Bus {
    /// Opens the service of the frames, or creates it with these limits.
    pub(super) fn frames_service(&self, limits: &Limits) -> Result<Service, BusError> {
        self.node()
            .service_builder(&self.service_name(TOPIC)?)
            .publish_subscribe::<[u8]>()
            .user_header::<FrameHeader>()
            .enable_safe_overflow(true)
            .max_publishers(2)
            .max_subscribers(limits.workers as usize + 1 + Limits::SPARE_READERS)
            .max_nodes(64)
            .subscriber_max_buffer_size(limits.ring_frames)
            .subscriber_max_borrowed_samples(limits.ring_frames + limits.held_frames)
            .history_size(0)
            .open_or_create()
            .map_err(self.failure("create", TOPIC))
    }

    /// Creates the publisher of the ring, with slots of `slot_bytes`.
    ///
    /// # Errors
    ///
    /// [`BusError::Memory`] when the ring does not fit, [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn frame_publisher(&self, limits: &Limits, slot_bytes: usize) -> Result<FramePublisher, BusError> {
        let chunks = limits.frame_chunks();
        memory::require(limits.ring_bytes(slot_bytes))?;
        let service = self.frames_service(limits)?;
        let port = service
            .publisher_builder()
            .initial_max_slice_len(slot_bytes)
            .allocation_strategy(AllocationStrategy::Static)
            .max_loaned_samples(Limits::CAMERA_SLOTS)
            .override_sample_preallocation(move |_worst| chunks)
            .create()
            .map_err(self.failure("write", TOPIC))?;
        Ok(FramePublisher { loans: Vec::new(), port, _service: service, slot_bytes })
    }

    /// Creates a subscriber of frames for a process of the rig, whose queue is as long as the ring.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn frame_subscriber(&self, limits: &Limits) -> Result<FrameSubscriber, BusError> {
        let service = self.frames_service(limits)?;
        let port = service
            .subscriber_builder()
            .buffer_size(limits.ring_frames)
            .create()
            .map_err(self.failure("read", TOPIC))?;
        Ok(FrameSubscriber { port, _service: service })
    }

    /// Creates a subscriber of frames for any other program, whose queue holds the newest frame alone.
    ///
    /// Unlike [`listen`](Self::listen), it stays in the domain that this process has joined.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] when the rig is not running, [`BusError::Service`] when shared memory cannot be used.
    pub fn listen_newest_frame(&self) -> Result<FrameSubscriber, BusError> {
        let service = self
            .node()
            .service_builder(&self.service_name(TOPIC)?)
            .publish_subscribe::<[u8]>()
            .user_header::<FrameHeader>()
            .open()
            .map_err(|error| self.open_error(TOPIC, error))?;
        let port = service.subscriber_builder().buffer_size(1).create().map_err(self.failure("read", TOPIC))?;
        Ok(FrameSubscriber { port, _service: service })
    }
}
