//! Aravis, opened at run time so that nothing needs it to build.

use super::sys::Aravis;
use crate::camera::CameraError;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

/// File name of the library, version of its interface included.
const LIBRARY: &str = "libaravis-0.8.so.0";

/// The package of Debian and Ubuntu that holds it.
const PACKAGE: &str = "libaravis-0.8-0";

/// The library, opened on the first call and never closed.
///
/// # Errors
///
/// [`CameraError::LibraryMissing`] when it is not installed or not version 0.8.
pub fn library() -> Result<&'static Aravis, CameraError> {
    static OPENED: OnceLock<&'static Aravis> = OnceLock::new();
    if let Some(aravis) = OPENED.get() {
        return Ok(aravis);
    }
    let aravis = open_library(LIBRARY)?;
    Ok(OPENED.get_or_init(|| aravis))
}

/// The right to look for cameras and to read their descriptions, which the library cannot do on two threads at once:
/// it keeps one list of cameras for the process, and its reader of descriptions falls over.
pub fn one_at_a_time() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Opens the library of this file name and keeps it open for good: GLib cannot be unloaded.
fn open_library(name: &str) -> Result<&'static Aravis, CameraError> {
    let missing =
        |reason: String| CameraError::LibraryMissing { library: name.into(), package: PACKAGE.into(), reason };
    // SAFETY: loading runs the library's constructors, which set up GLib and nothing of ours.
    let aravis = unsafe { Aravis::new(name) }.map_err(|error| missing(words(&error)))?;
    // SAFETY: these three take nothing and return constants.
    let (major, minor) = unsafe { (aravis.arv_get_major_version(), aravis.arv_get_minor_version()) };
    if (major, minor) != (0, 8) {
        return Err(missing(format!("it is version {major}.{minor}, not 0.8")));
    }
    Ok(Box::leak(Box::new(aravis)))
}

/// What the loader said, with its reason.
fn words(error: &libloading::Error) -> String {
    use std::error::Error;
    error.source().map_or_else(|| error.to_string(), |source| source.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_library_is_told_with_its_package() {
        let error = open_library("libaravis-0.8-of-nowhere.so.0").err().unwrap();
        assert!(matches!(error, CameraError::LibraryMissing { .. }));
        let line = error.to_string();
        assert!(line.starts_with("load libaravis-0.8-of-nowhere.so.0: "), "{line}");
        assert!(line.ends_with("install the package libaravis-0.8-0"), "{line}");
    }

    #[test]
    fn a_library_that_is_not_aravis_is_refused() {
        let error = open_library("libc.so.6").err().unwrap();
        assert!(matches!(error, CameraError::LibraryMissing { .. }), "{error}");
    }
}
