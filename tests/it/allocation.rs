//! The largest allocation of a run, and the memory that a thread holds.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

#[global_allocator]
static WATCHED: Recorded = Recorded;

static LARGEST_BYTES: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// The memory that this thread has requested less that which it has freed, bytes.
    static HELD_BYTES: Cell<isize> = const { Cell::new(0) };
}

/// The system allocator, with a record of the largest request and of the memory that each thread holds.
struct Recorded;

fn note(bytes: usize) {
    add(bytes.cast_signed());
    if bytes > LARGEST_BYTES.load(Ordering::Relaxed) {
        LARGEST_BYTES.fetch_max(bytes, Ordering::Relaxed);
    }
}

fn add(bytes: isize) {
    // A thread that ends has no counter any more.
    let _ = HELD_BYTES.try_with(|held| held.set(held.get() + bytes));
}

#[expect(unsafe_code, reason = "an allocator is unsafe by its trait; this one only counts")]
// SAFETY: every request goes to the system allocator unchanged.
unsafe impl GlobalAlloc for Recorded {
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
        add(-layout.size().cast_signed());
        note(bytes);
        // SAFETY: the caller keeps the contract.
        unsafe { System.realloc(pointer, layout, bytes) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        add(-layout.size().cast_signed());
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Runs something and returns the largest allocation of any thread meanwhile, bytes.
pub fn largest_bytes<T>(run: impl FnOnce() -> T) -> (T, usize) {
    LARGEST_BYTES.store(0, Ordering::Relaxed);
    let result = run();
    (result, LARGEST_BYTES.load(Ordering::Relaxed))
}

/// Returns the memory that this thread has requested less that which it has freed, bytes.
pub fn held_bytes() -> isize {
    HELD_BYTES.with(Cell::get)
}
