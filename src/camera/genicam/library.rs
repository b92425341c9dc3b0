//! Loading of Aravis at run time, so that the build does not need it.

use super::sys::Aravis;
use crate::camera::CameraError;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// File name of the library, including the version of its interface.
const LIBRARY: &str = "libaravis-0.8.so.0";

/// The Debian and Ubuntu package that contains it.
const PACKAGE: &str = "libaravis-0.8-0";

/// Returns the library. It is loaded on the first call and never unloaded.
///
/// # Errors
///
/// [`CameraError::LibraryMissing`] if it is not installed or not version 0.8.
pub fn library() -> Result<&'static Aravis, CameraError> {
    static OPENED: OnceLock<&'static Aravis> = OnceLock::new();
    if let Some(aravis) = OPENED.get() {
        return Ok(aravis);
    }
    let aravis = open_library(LIBRARY)?;
    Ok(OPENED.get_or_init(|| aravis))
}

/// Locks discovery and the parsing of camera descriptions, neither of which is thread-safe in the library.
///
/// It keeps one list of cameras per process, and its description parser crashes on two threads.
pub fn discovery_lock() -> MutexGuard<'static, ()> {
    static LOCK: Mutex<()> = Mutex::new(());
    LOCK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Loads the library of this file name for good: GLib cannot be unloaded.
///
/// # Errors
///
/// [`CameraError::LibraryMissing`] if it cannot be loaded or is not version 0.8.
fn open_library(name: &str) -> Result<&'static Aravis, CameraError> {
    let missing =
        |reason: String| CameraError::LibraryMissing { library: name.into(), package: PACKAGE.into(), reason };
    // SAFETY: loading runs the library's constructors, which set up GLib and nothing of ours.
    let aravis = unsafe { Aravis::new(name) }.map_err(|error| missing(loader_message(&error)))?;
    // SAFETY: these two take no arguments and return constants.
    let (major, minor) = unsafe { (aravis.arv_get_major_version(), aravis.arv_get_minor_version()) };
    if (major, minor) != (0, 8) {
        return Err(missing(format!("it is version {major}.{minor}, not 0.8")));
    }
    Ok(Box::leak(Box::new(aravis)))
}

/// Returns the system's reason why a library cannot be loaded, or the loader's own message if the system gave none.
fn loader_message(error: &libloading::Error) -> String {
    use std::error::Error;
    error.source().map_or_else(|| error.to_string(), |source| source.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_reported_with_its_package() {
        let error = open_library("libaravis-0.8-of-nowhere.so.0").err().unwrap();
        assert!(matches!(error, CameraError::LibraryMissing { .. }));
        let line = error.to_string();
        assert!(line.starts_with("cannot load libaravis-0.8-of-nowhere.so.0: "), "{line}");
        assert!(line.ends_with("install the package libaravis-0.8-0"), "{line}");
    }

    #[test]
    fn a_library_that_is_not_aravis_is_refused() {
        let error = open_library("libc.so.6").err().unwrap();
        assert!(matches!(error, CameraError::LibraryMissing { .. }), "{error}");
    }
}
