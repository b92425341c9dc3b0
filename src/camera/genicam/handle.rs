//! Owners of the C library's objects, and conversion of its errors and strings.

use super::sys::{Aravis, GError, gpointer};
use std::ffi::{CStr, CString, c_char};
use std::ptr::{self, NonNull};

/// One counted reference to an object of the library, released on drop.
#[derive(Debug)]
pub struct Object<T> {
    aravis: Library,
    pointer: NonNull<T>,
}

/// The loaded library, without its function pointers in debug output.
#[derive(Clone, Copy)]
pub struct Library(pub &'static Aravis);

impl std::fmt::Debug for Library {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("Aravis")
    }
}

impl std::ops::Deref for Library {
    type Target = Aravis;

    fn deref(&self) -> &Aravis {
        self.0
    }
}

// SAFETY: reference counts are atomic, and cameras and streams of Aravis lock themselves; neither is bound to a
// thread.
unsafe impl<T> Send for Object<T> {}

impl<T> Object<T> {
    /// Takes over one reference; returns `None` for a null pointer.
    ///
    /// # Safety
    ///
    /// `pointer` is null or a GObject of which the caller owns a reference.
    pub unsafe fn owned(aravis: Library, pointer: *mut T) -> Option<Self> {
        Some(Self { aravis, pointer: NonNull::new(pointer)? })
    }

    /// Returns the object for calls of the library; valid while this owner lives.
    pub fn as_ptr(&self) -> *mut T {
        self.pointer.as_ptr()
    }
}

impl<T> Drop for Object<T> {
    fn drop(&mut self) {
        // SAFETY: `owned` took over a reference that nobody else releases.
        unsafe { self.aravis.g_object_unref(self.pointer.as_ptr().cast()) }
    }
}

/// Makes a call that reports errors through a GError, and returns its result.
///
/// # Errors
///
/// The library's message.
pub fn checked<R>(aravis: Library, call: impl FnOnce(*mut *mut GError) -> R) -> Result<R, String> {
    let mut error: *mut GError = ptr::null_mut();
    let result = call(&raw mut error);
    if error.is_null() {
        return Ok(result);
    }
    // SAFETY: a GError that was set holds a terminated message and is ours to free.
    unsafe {
        let message = text((*error).message).unwrap_or_else(|| "unknown reason".into());
        aravis.g_error_free(error);
        Err(message)
    }
}

/// Copies a string that the library owns; returns `None` for a null pointer.
///
/// # Safety
///
/// `string` is null or points to a terminated string.
pub unsafe fn text(string: *const c_char) -> Option<String> {
    if string.is_null() {
        return None;
    }
    // SAFETY: the caller guarantees a terminated string.
    Some(unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned())
}

/// Converts a string for the library.
///
/// # Errors
///
/// If it contains a zero byte.
pub fn c_text(string: &str) -> Result<CString, String> {
    CString::new(string).map_err(|_| format!("{string:?} contains a zero byte"))
}

/// Frees memory that the library allocated.
///
/// # Safety
///
/// `memory` is null or was allocated by GLib and is not used any more.
pub unsafe fn free<T>(aravis: Library, memory: *mut T) {
    // SAFETY: guaranteed by the caller.
    unsafe { aravis.g_free(memory.cast::<std::ffi::c_void>() as gpointer) }
}
