//! Memory of the ring, lent to a camera.
#![expect(unsafe_code, reason = "a slot is memory shared with other processes and filled by a C library")]

use std::ptr::NonNull;

/// A piece of the ring that one frame fits into, lent to a camera until it comes back.
#[derive(Debug)]
pub struct Slot {
    memory: NonNull<u8>,
    bytes: usize,
    token: usize,
}

// SAFETY: a slot is the only handle to its memory while it is lent, so moving it to another thread moves the access.
unsafe impl Send for Slot {}

impl Slot {
    /// Wraps memory that the caller keeps alive until the slot comes back.
    ///
    /// `token` tells the caller which piece this is.
    ///
    /// # Safety
    ///
    /// `memory` must stay valid for reads and writes of `bytes` bytes, and nobody
    /// else may touch it, until the slot is given back or dropped.
    pub unsafe fn new(memory: NonNull<u8>, bytes: usize, token: usize) -> Self {
        Self { memory, bytes, token }
    }

    /// Which piece of the ring this is.
    pub fn token(&self) -> usize {
        self.token
    }

    /// Address of its first byte, for libraries that fill it in the background.
    pub fn as_ptr(&self) -> *mut u8 {
        self.memory.as_ptr()
    }

    /// Size in bytes.
    pub fn len(&self) -> usize {
        self.bytes
    }

    /// Whether it has no room at all.
    pub fn is_empty(&self) -> bool {
        self.bytes == 0
    }

    /// The memory, to write a frame into.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: `new` promised exclusive, valid memory of this size; initialised because the ring pre-touches it.
        unsafe { std::slice::from_raw_parts_mut(self.memory.as_ptr(), self.bytes) }
    }
}
