//! Buffers between the driver and the ring's slots.
//!
//! Where the driver takes memory of ours and its pixels lie as the ring wants them,
//! slots go to the driver itself and nothing is copied. Otherwise the driver fills
//! buffers of its own and each frame is copied once.

use super::device::{Device, Memory};
use super::kernel::Mapping;
use super::layout::Shape;
use super::stamp::monotonic_ns;
use super::sys;
use crate::camera::Slot;
use std::collections::VecDeque;
use std::io;
use std::time::Duration;

/// Most buffers the kernel gives (`VIDEO_MAX_FRAME`).
pub(super) const BUFFERS_MAX: usize = 32;
/// Fewest with which a stream runs without a gap.
pub(super) const BUFFERS_MIN: usize = 4;
/// Buffers refused one after the other, after which the stream counts as broken.
const REFUSALS_MAX: usize = 64;
/// Pause where waiting ends at once and nothing can be done yet.
const PAUSE: Duration = Duration::from_millis(1);

/// What the driver says of a buffer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Info {
    pub sequence: u32,
    /// `V4L2_BUF_FLAG_...`.
    pub flags: u32,
    pub stamp_ns: u64,
    pub bytes: usize,
    /// Why the pixels could not be taken out of it.
    pub damage: Option<String>,
}

/// What came out of the queue.
#[derive(Debug)]
pub(super) enum Out {
    /// A buffer: whether it holds a whole frame is for the taker to judge.
    Filled(Slot, Info),
    /// A slot that the driver did not take.
    Refused(Slot, String),
    /// Nothing yet.
    Nothing,
}

/// The buffers of one stream.
#[derive(Debug)]
pub(super) struct Queue {
    shape: Shape,
    memory: Memory,
    /// Slots that are not with the driver.
    waiting: VecDeque<Slot>,
    /// Slots with the driver, by buffer; only where it takes them.
    lent: Vec<Option<Slot>>,
    /// The driver's buffers; only where it takes no slots.
    mapped: Vec<Mapping>,
    /// Buffers that are not with the driver.
    free: Vec<u32>,
    refused: VecDeque<(Slot, String)>,
    refusals: usize,
    started: bool,
    /// When the stream was started, ns on the kernel's monotonic clock.
    began_ns: u64,
}

impl Queue {
    pub fn new(shape: Shape) -> Self {
        Self {
            shape,
            memory: Memory::Mapped,
            waiting: VecDeque::new(),
            lent: Vec::new(),
            mapped: Vec::new(),
            free: Vec::new(),
            refused: VecDeque::new(),
            refusals: 0,
            started: false,
            began_ns: 0,
        }
    }

    /// Whether frames are copied from buffers of the driver.
    pub fn copies(&self) -> bool {
        self.memory == Memory::Mapped
    }

    /// When the stream was started, ns on the kernel's monotonic clock.
    pub fn began_ns(&self) -> u64 {
        self.began_ns
    }

    /// Takes a slot of at least the shape's `slot_bytes`.
    ///
    /// # Panics
    ///
    /// If the slot is too small: the driver would write beyond it.
    pub fn push(&mut self, device: &Device, slot: Slot) {
        assert!(slot.len() >= self.shape.slot_bytes(), "a slot of {} bytes is too small", slot.len());
        self.waiting.push_back(slot);
        if self.started {
            self.feed(device);
        }
    }

    /// Shares buffers with the driver and starts the stream.
    pub fn start(&mut self, device: &Device) -> io::Result<()> {
        let count = self.waiting.len().clamp(BUFFERS_MIN, BUFFERS_MAX) as u32;
        if !(self.shape.is_plain() && self.lend_slots(device, count)) {
            self.map_buffers(device, count)?;
        }
        self.began_ns = monotonic_ns();
        device.stream_on()?;
        self.started = true;
        Ok(())
    }

    /// Whether the driver takes slots.
    fn lend_slots(&mut self, device: &Device, count: u32) -> bool {
        let Ok(count) = device.request_buffers(Memory::User, count) else { return false };
        self.memory = Memory::User;
        self.lent = (0..count).map(|_| None).collect();
        self.free = (0..count).rev().collect();
        // Drivers that cannot reach this memory say so at the first buffer, not before.
        self.feed(device);
        if self.refused.is_empty() {
            return true;
        }
        self.waiting.extend(std::mem::take(&mut self.refused).into_iter().map(|(slot, _)| slot));
        self.refusals = 0;
        // Frees what was taken before the refusal; the driver then holds none of our memory.
        if device.request_buffers(Memory::User, 0).is_ok() {
            self.waiting.extend(self.lent.drain(..).flatten());
            self.free.clear();
        }
        false
    }

    fn map_buffers(&mut self, device: &Device, count: u32) -> io::Result<()> {
        if !self.lent.is_empty() {
            return Err(io::Error::other("the driver keeps memory it refused to use"));
        }
        self.memory = Memory::Mapped;
        let count = device.request_buffers(Memory::Mapped, count)?;
        if count == 0 {
            return Err(io::Error::other("the driver has no buffers"));
        }
        self.mapped = (0..count).map(|index| device.map(index)).collect::<io::Result<_>>()?;
        if let Some(small) = self.mapped.iter().find(|mapping| mapping.len() < self.shape.whole_bytes()) {
            let (len, wanted) = (small.len(), self.shape.whole_bytes());
            return Err(io::Error::other(format!("buffers of {len} bytes where a frame has {wanted}")));
        }
        self.free.clear();
        (0..count).try_for_each(|index| device.enqueue_mapped(index))
    }

    /// Gives the driver whatever it can fill.
    fn feed(&mut self, device: &Device) {
        while let Some(index) = self.free.pop() {
            if let Err(error) = self.feed_one(device, index) {
                self.free.push(index);
                self.refusals += 1;
                log::debug!("buffer {index}: {error}");
                return;
            }
            if self.memory == Memory::User && self.lent[index as usize].is_none() {
                // No slot was left for it.
                self.free.push(index);
                return;
            }
        }
    }

    fn feed_one(&mut self, device: &Device, index: u32) -> io::Result<()> {
        if self.memory == Memory::Mapped {
            return device.enqueue_mapped(index);
        }
        let Some(slot) = self.waiting.pop_front() else { return Ok(()) };
        let bytes = u32::try_from(slot.len()).unwrap_or(u32::MAX);
        // SAFETY: the slot is exclusive and valid while we hold it: it stays in `lent` until the driver gives the
        // buffer back, and the device is closed before the queue is dropped.
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

    /// Waits for the next buffer, at most `timeout`.
    ///
    /// # Errors
    ///
    /// When the stream is broken.
    pub fn next(&mut self, device: &Device, timeout: Duration) -> io::Result<Out> {
        self.feed(device);
        if self.refusals > REFUSALS_MAX {
            return Err(io::Error::other(format!("the driver refused {} buffers in a row", self.refusals)));
        }
        if let Some((slot, reason)) = self.refused.pop_front() {
            return Ok(Out::Refused(slot, reason));
        }
        if self.copies() && self.waiting.is_empty() {
            // Nowhere to copy to: what comes meanwhile stays with the driver, or is a gap in its count.
            std::thread::sleep(PAUSE.min(timeout));
            return Ok(Out::Nothing);
        }
        if !device.wait(timeout)? {
            return Ok(Out::Nothing);
        }
        match device.dequeue(self.memory) {
            Ok(buffer) => self.take(device, &buffer),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                std::thread::sleep(PAUSE.min(timeout));
                Ok(Out::Nothing)
            }
            Err(error) => Err(error),
        }
    }

    fn take(&mut self, device: &Device, buffer: &sys::v4l2_buffer) -> io::Result<Out> {
        let stranger =
            || io::Error::other(format!("the driver gave back buffer {}, which it did not have", buffer.index));
        let place = buffer.index as usize;
        let mut info = Info {
            sequence: buffer.sequence,
            flags: buffer.flags,
            stamp_ns: nanoseconds(&buffer.timestamp),
            bytes: buffer.bytesused as usize,
            damage: None,
        };
        self.refusals = 0;
        if self.memory == Memory::User {
            let slot = self.lent.get_mut(place).and_then(Option::take).ok_or_else(stranger)?;
            info.bytes = info.bytes.min(slot.len());
            self.free.push(buffer.index);
            self.feed(device);
            return Ok(Out::Filled(slot, info));
        }
        let mapping = self.mapped.get(place).ok_or_else(stranger)?;
        let mut slot = self.waiting.pop_front().ok_or_else(|| io::Error::other("no slot to copy to"))?;
        info.bytes = info.bytes.min(mapping.len());
        let whole = self.shape.whole_bytes();
        if info.flags & sys::V4L2_BUF_FLAG_ERROR == 0 && info.bytes >= whole {
            info.damage = self.shape.copy(mapping.bytes(info.bytes), slot.bytes_mut()).err();
        }
        self.free.push(buffer.index);
        self.feed(device);
        Ok(Out::Filled(slot, info))
    }

    /// Stops the stream, as far as the driver still can.
    pub fn stop(&mut self, device: &Device) {
        if self.started {
            // Nothing can be done about a driver that refuses: closing the device ends its stream.
            let _ = device.stream_off();
            self.started = false;
        }
    }
}

fn nanoseconds(time: &sys::timeval) -> u64 {
    let (Ok(seconds), Ok(micros)) = (u64::try_from(time.tv_sec), u64::try_from(time.tv_usec)) else { return 0 };
    seconds.saturating_mul(1_000_000_000).saturating_add(micros.saturating_mul(1000))
}

#[cfg(test)]
#[path = "queue/tests.rs"]
mod tests;
