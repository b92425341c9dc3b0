//! The files of a sequence: as they are given, in a folder, or by a pattern with wildcards.

use crate::import::{ImportError, extension};
use std::fs;
use std::path::{Path, PathBuf};

/// Maximum number of images of a folder or a pattern.
const MAX_FILES: usize = 1 << 20;

/// Files, and who put them in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Listed {
    pub(super) paths: Vec<PathBuf>,
    pub(super) by: Lister,
}

/// The source of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Lister {
    /// The user, or the user's shell.
    User,
    /// A folder or a pattern, which has none.
    Disk,
}

impl Listed {
    /// Replaces a folder, or a pattern with wildcards, by the images in it, sorted by their paths. Single files keep
    /// the order in which they are given.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for a folder or a pattern with no images or several kinds of them, or next to other
    /// inputs.
    pub(super) fn expand(inputs: &[PathBuf]) -> Result<Self, ImportError> {
        let [input] = inputs else {
            return match inputs.iter().find(|input| is_collection(input)) {
                Some(input) => {
                    Err(ImportError::invalid(input, "a folder or a pattern is a whole sequence; pass it alone"))
                }
                None => Ok(Self { paths: inputs.to_vec(), by: Lister::User }),
            };
        };
        if !is_collection(input) {
            return Ok(Self { paths: inputs.to_vec(), by: Lister::User });
        }
        let mut paths = if input.is_dir() { images_in_folder(input)? } else { images_of_pattern(input)? };
        paths.sort();
        check_one_kind(input, &paths)?;
        Ok(Self { paths, by: Lister::Disk })
    }
}

/// Whether an input is a folder, or a pattern with wildcards and no file of that name.
pub(in crate::import) fn is_collection(input: &Path) -> bool {
    input.is_dir() || (input.to_string_lossy().contains(['*', '?', '[']) && !input.exists())
}

/// Whether the ending is that of a still image.
pub(in crate::import) fn is_image(path: &Path) -> bool {
    matches!(extension(path).as_str(), "png" | "tif" | "tiff" | "jpg" | "jpeg" | "bmp" | "pgm")
}

/// Lists the images in a folder in any order, without hidden files.
///
/// # Errors
///
/// [`ImportError::Invalid`] for more than [`MAX_FILES`] images; [`ImportError::Io`] when the folder cannot be read.
fn images_in_folder(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let io = |error| ImportError::io("read", folder, error);
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if is_image(&path) && !is_hidden {
            paths.push(path);
        }
        if paths.len() > MAX_FILES {
            return Err(ImportError::invalid(folder, format!("more than {MAX_FILES} images")));
        }
    }
    Ok(paths)
}

/// Lists the first [`MAX_FILES`] images whose paths match a pattern with wildcards.
fn images_of_pattern(pattern: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let found = glob::glob(&pattern.to_string_lossy());
    let found =
        found.map_err(|error| ImportError::invalid(pattern, format!("not a pattern of file names: {error}")))?;
    Ok(found.filter_map(Result::ok).filter(|path| is_image(path)).take(MAX_FILES).collect())
}

/// Checks that there are images, all of one kind.
fn check_one_kind(input: &Path, paths: &[PathBuf]) -> Result<(), ImportError> {
    let kind = |path: &Path| match extension(path).as_str() {
        "tiff" => "tif".to_owned(),
        "jpeg" => "jpg".to_owned(),
        other => other.to_owned(),
    };
    let Some(first) = paths.first() else {
        return Err(ImportError::invalid(input, "no images; png, tif, jpg, bmp and pgm are read"));
    };
    match paths.iter().find(|path| kind(path) != kind(first)) {
        Some(other) => {
            let (one, other) = (kind(first), kind(other));
            let reason = format!("images that end in {one} and in {other}; pass one kind, such as '*.{one}'");
            Err(ImportError::invalid(input, reason))
        }
        None => Ok(()),
    }
}
