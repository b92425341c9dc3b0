//! A slot of the ring, lent to a camera.
#![expect(unsafe_code, reason = "a slot is memory shared with other processes and filled by a C library")]

use std::ptr::NonNull;

/// Memory for one frame in the ring, lent to a camera until it comes back.
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
    /// `token` identifies the slot to the caller.
    ///
    /// # Safety
    ///
    /// `memory` must stay valid for reads and writes of `bytes` bytes, and nobody else may touch it, until the slot is
    /// given back or dropped.
    pub unsafe fn new(memory: NonNull<u8>, bytes: usize, token: usize) -> Self {
        Self { memory, bytes, token }
    }

    /// Returns the caller's identifier of this slot.
    pub fn token(&self) -> usize {
        self.token
    }

    /// Returns the address of the first byte, for libraries that fill the slot in the background.
    pub fn as_ptr(&self) -> *mut u8 {
        self.memory.as_ptr()
    }

    /// Returns the size in bytes.
    pub fn len(&self) -> usize {
        self.bytes
    }

    /// Whether the slot has no bytes.
    pub fn is_empty(&self) -> bool {
        self.bytes == 0
    }

    /// Returns the memory to write a frame into.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: `new` promised exclusive, valid memory of this size; initialised because the ring pre-touches it.
        unsafe { std::slice::from_raw_parts_mut(self.memory.as_ptr(), self.bytes) }
    }
}
