//! The largest piece of memory that was asked for.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

#[global_allocator]
static WATCHED: Watched = Watched;

static LARGEST_BYTES: AtomicUsize = AtomicUsize::new(0);

/// The system's memory, with a note of the largest request.
struct Watched;

fn note(bytes: usize) {
    if bytes > LARGEST_BYTES.load(Ordering::Relaxed) {
        LARGEST_BYTES.fetch_max(bytes, Ordering::Relaxed);
    }
}

#[expect(unsafe_code, reason = "an allocator is unsafe by its trait; this one only counts")]
// SAFETY: every request goes to the system's allocator as it is.
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        note(bytes);
        // SAFETY: the caller keeps the contract.
        unsafe { System.realloc(pointer, layout, bytes) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Runs something and gives the largest piece of memory that any thread asked for meanwhile, bytes.
pub fn largest_bytes<T>(run: impl FnOnce() -> T) -> (T, usize) {
    LARGEST_BYTES.store(0, Ordering::Relaxed);
    let result = run();
    (result, LARGEST_BYTES.load(Ordering::Relaxed))
}
