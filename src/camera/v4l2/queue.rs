//! Exchange of buffers with the driver.
//!
//! If the driver accepts our memory and its pixels have the layout of the ring, slots are queued directly and nothing
//! is copied. Otherwise the driver fills its own buffers, and each frame is copied once.

use super::device::{Device, Memory};
use super::kernel::Mapping;
use super::pixel_layout::BufferLayout;
use super::sys;
use super::timestamps::{BufferInfo, monotonic_ns};
use crate::camera::Slot;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;

/// Maximum number of buffers (`VIDEO_MAX_FRAME`).
pub(super) const BUFFERS_MAX: usize = 32;
/// Minimum number of buffers of a gapless stream.
pub(super) const BUFFERS_MIN: usize = 4;
/// Number of consecutive refused buffers after which the stream counts as broken.
const MAX_REFUSALS: usize = 64;
/// Pause if waiting returns at once and nothing can be done yet.
const PAUSE: Duration = Duration::from_millis(1);

/// The outcome of dequeueing.
#[derive(Debug)]
pub(super) enum Dequeued {
    /// A buffer, which may hold an incomplete frame.
    Filled(Slot, BufferInfo),
    /// A slot that the driver did not accept.
    Refused(Slot, String),
    /// No buffer within the timeout.
    Timeout,
}

/// The buffers of one stream.
#[derive(Debug)]
pub(super) struct Queue {
    buffer: BufferLayout,
    memory: Memory,
    /// Slots that are not queued.
    waiting: VecDeque<Slot>,
    /// Queued slots by buffer index, if the driver accepts slots.
    lent: Vec<Option<Slot>>,
    /// The driver's buffers, if it does not accept slots.
    mapped: Vec<Mapping>,
    /// Indices of the buffers that are not queued.
    free: Vec<u32>,
    /// Slots that the driver did not accept, with the reasons.
    refused: VecDeque<(Slot, String)>,
    /// Number of refusals since the last filled buffer.
    refusals: usize,
    started: bool,
    /// When the stream started, ns on the kernel's monotonic clock.
    start_ns: u64,
}

impl Queue {
    pub fn new(buffer: BufferLayout) -> Self {
        Self {
            buffer,
            memory: Memory::Mapped,
            waiting: VecDeque::new(),
            lent: Vec::new(),
            mapped: Vec::new(),
            free: Vec::new(),
            refused: VecDeque::new(),
            refusals: 0,
            started: false,
            start_ns: 0,
        }
    }

    /// Whether frames are copied from buffers of the driver; also `true` before the start.
    pub fn copies(&self) -> bool {
        self.memory == Memory::Mapped
    }

    /// Returns when the stream started, ns on the kernel's monotonic clock; 0 before.
    pub fn start_ns(&self) -> u64 {
        self.start_ns
    }

    /// Accepts a slot of at least the layout's `slot_bytes`, and queues free buffers if the stream has started.
    ///
    /// # Panics
    ///
    /// If the slot is too small: the driver would write beyond it.
    pub fn push(&mut self, device: &Device, slot: Slot) {
        assert!(slot.len() >= self.buffer.slot_bytes(), "a slot of {} bytes is too small", slot.len());
        self.waiting.push_back(slot);
        if self.started {
            self.queue_free(device);
        }
    }

    /// Allocates buffers and starts the stream: with the slots as buffers if possible, else with the driver's.
    ///
    /// # Errors
    ///
    /// The driver's error, or the reason why its buffers cannot be used.
    pub fn start(&mut self, device: &Device) -> io::Result<()> {
        let count = self.waiting.len().clamp(BUFFERS_MIN, BUFFERS_MAX) as u32;
        if !(self.buffer.matches_ring() && self.lend_slots(device, count)) {
            self.map_buffers(device, count)?;
        }
        self.start_ns = monotonic_ns();
        device.stream_on()?;
        self.started = true;
        Ok(())
    }

    /// Tries to queue the waiting slots as `count` buffers, and returns whether the driver accepts them.
    ///
    /// If not, the slots wait again, unless the driver keeps those that it accepted.
    fn lend_slots(&mut self, device: &Device, count: u32) -> bool {
        let Ok(count) = device.request_buffers(Memory::User, count) else { return false };
        self.memory = Memory::User;
        self.lent = (0..count).map(|_| None).collect();
        self.free = (0..count).rev().collect();
        // Drivers that cannot access this memory refuse the first buffer, not the request.
        self.queue_free(device);
        if self.refused.is_empty() {
            return true;
        }
        self.waiting.extend(std::mem::take(&mut self.refused).into_iter().map(|(slot, _)| slot));
        self.refusals = 0;
        // Frees what was queued before the refusal; the driver then holds none of our memory.
        if device.request_buffers(Memory::User, 0).is_ok() {
            self.waiting.extend(self.lent.drain(..).flatten());
            self.free.clear();
        }
        false
    }

    /// Allocates, maps and queues about `count` buffers of the driver, as many as it gives.
    ///
    /// # Errors
    ///
    /// The driver's error; or that it has no buffers, too small ones, or keeps slots that it refused to use.
    fn map_buffers(&mut self, device: &Device, count: u32) -> io::Result<()> {
        if !self.lent.is_empty() {
            return Err(io::Error::other("the driver keeps memory that it refused to use"));
        }
        self.memory = Memory::Mapped;
        let count = device.request_buffers(Memory::Mapped, count)?;
        if count == 0 {
            return Err(io::Error::other("the driver has no buffers"));
        }
        self.mapped = (0..count).map(|index| device.map(index)).collect::<io::Result<_>>()?;
        if let Some(small) = self.mapped.iter().find(|mapping| mapping.len() < self.buffer.min_bytes()) {
            let (len, wanted) = (small.len(), self.buffer.min_bytes());
            return Err(io::Error::other(format!("buffers of {len} bytes are too small for frames of {wanted} bytes")));
        }
        self.free.clear();
        (0..count).try_for_each(|index| device.enqueue_mapped(index))
    }

    /// Queues the free buffers until one is refused, which counts as a refusal, or no slot is left for the next.
    fn queue_free(&mut self, device: &Device) {
        while let Some(index) = self.free.pop() {
            if let Err(error) = self.queue_buffer(device, index) {
                self.free.push(index);
                self.refusals += 1;
                log::debug!("cannot queue buffer {index}: {error}");
                return;
            }
            if self.memory == Memory::User && self.lent[index as usize].is_none() {
                // No slot was left.
                self.free.push(index);
                return;
            }
        }
    }

    /// Queues the buffer of this index: the mapped one, or a waiting slot. Queues nothing if no slot is waiting.
    ///
    /// # Errors
    ///
    /// The driver's error. A slot that it refused goes to `refused`.
    fn queue_buffer(&mut self, device: &Device, index: u32) -> io::Result<()> {
        if self.memory == Memory::Mapped {
            return device.enqueue_mapped(index);
        }
        let Some(slot) = self.waiting.pop_front() else { return Ok(()) };
        let bytes = u32::try_from(slot.len()).unwrap_or(u32::MAX);
        // SAFETY: the slot is exclusive and valid while we hold it. It stays in `lent` until the driver returns
        // the buffer, and the device is closed before the queue is dropped.
        match unsafe { device.enqueue_user(index, slot.as_ptr(), bytes) } {
            Ok(()) => {
                self.lent[index as usize] = Some(slot);
                Ok(())
            }
            Err(error) => {
                self.refused.push_back((slot, format!("the driver refused the buffer: {error}")));
                Err(error)
            }
        }
    }

    /// Waits at most `timeout` for the next filled buffer or refused slot, after queueing the free buffers.
    ///
    /// # Errors
    ///
    /// If the driver reports an error, has refused more than [`MAX_REFUSALS`] buffers in a row, or returns a buffer
    /// that was not queued.
    pub fn next(&mut self, device: &Device, timeout: Duration) -> io::Result<Dequeued> {
        self.queue_free(device);
        if self.refusals > MAX_REFUSALS {
            return Err(io::Error::other(format!("the driver refused {} buffers in a row", self.refusals)));
        }
        if let Some((slot, reason)) = self.refused.pop_front() {
            return Ok(Dequeued::Refused(slot, reason));
        }
        if self.copies() && self.waiting.is_empty() {
            // No slot to copy to: frames stay with the driver meanwhile, or become a gap in its count.
            std::thread::sleep(PAUSE.min(timeout));
            return Ok(Dequeued::Timeout);
        }
        if !device.wait(timeout)? {
            return Ok(Dequeued::Timeout);
        }
        match device.dequeue(self.memory) {
            Ok(buffer) => self.accept(device, &buffer),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                std::thread::sleep(PAUSE.min(timeout));
                Ok(Dequeued::Timeout)
            }
            Err(error) => Err(error),
        }
    }

    /// Returns the slot of a dequeued buffer, after copying the frame if it is in the driver's memory, and queues the
    /// next buffers.
    ///
    /// An incomplete or damaged frame is not copied; `info` shows the defect.
    ///
    /// # Errors
    ///
    /// If the driver returns a buffer that was not queued, or no slot waits for the copy.
    fn accept(&mut self, device: &Device, buffer: &sys::v4l2_buffer) -> io::Result<Dequeued> {
        let unknown = || io::Error::other(format!("the driver returned buffer {}, which was not queued", buffer.index));
        let index = buffer.index as usize;
        let mut info = BufferInfo {
            sequence: buffer.sequence,
            flags: buffer.flags,
            stamp_ns: timeval_ns(&buffer.timestamp),
            bytes: buffer.bytesused as usize,
            damage: None,
        };
        self.refusals = 0;
        if self.memory == Memory::User {
            let slot = self.lent.get_mut(index).and_then(Option::take).ok_or_else(unknown)?;
            info.bytes = info.bytes.min(slot.len());
            self.free.push(buffer.index);
            self.queue_free(device);
            return Ok(Dequeued::Filled(slot, info));
        }
        let mapping = self.mapped.get(index).ok_or_else(unknown)?;
        let mut slot = self.waiting.pop_front().ok_or_else(|| io::Error::other("no slot to copy to"))?;
        info.bytes = info.bytes.min(mapping.len());
        if info.flags & sys::V4L2_BUF_FLAG_ERROR == 0 && info.bytes >= self.buffer.min_bytes() {
            info.damage = self.buffer.extract_grey(mapping.bytes(info.bytes), slot.bytes_mut()).err();
        }
        self.free.push(buffer.index);
        self.queue_free(device);
        Ok(Dequeued::Filled(slot, info))
    }

    /// Stops the stream if it has started. An error of the driver is ignored.
    pub fn stop(&mut self, device: &Device) {
        if self.started {
            // A driver that refuses is closed next, which ends its stream.
            let _ = device.stream_off();
            self.started = false;
        }
    }
}

/// Converts a time of the kernel to nanoseconds; 0 if it is negative.
fn timeval_ns(time: &sys::timeval) -> u64 {
    let (Ok(seconds), Ok(micros)) = (u64::try_from(time.tv_sec), u64::try_from(time.tv_usec)) else { return 0 };
    seconds.saturating_mul(1_000_000_000).saturating_add(micros.saturating_mul(1000))
}

#[cfg(test)]
#[path = "queue/tests.rs"]
mod tests;
