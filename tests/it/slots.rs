//! Plain memory lent to a camera as slots.
#![expect(unsafe_code, reason = "a slot is raw memory")]

use ricochet::camera::{Camera, Slot};
use std::ptr::NonNull;

/// Memory for slots. It must outlive the camera, so make it first.
pub struct Slots {
    memory: Vec<Box<[u8]>>,
}

impl Slots {
    /// The content of the memory before its first use.
    pub const JUNK: u8 = 0xa5;

    /// This many slots of this size, filled with junk.
    pub fn new(count: usize, bytes: usize) -> Self {
        Self { memory: (0..count).map(|_| vec![Self::JUNK; bytes].into_boxed_slice()).collect() }
    }

    /// Lends every slot to the camera.
    pub fn queue_all(&mut self, camera: &mut (impl Camera + ?Sized)) {
        for (token, memory) in self.memory.iter_mut().enumerate() {
            let pointer = NonNull::new(memory.as_mut_ptr()).unwrap();
            // SAFETY: the memory lives as long as `self`, and is accessed only through its slot.
            camera.queue(unsafe { Slot::new(pointer, memory.len(), token) });
        }
    }

    /// Lends a returned slot again.
    pub fn give_back(&self, slot: Slot, camera: &mut (impl Camera + ?Sized)) {
        assert!(slot.token() < self.memory.len());
        camera.queue(slot);
    }
}
