//! The private folder of a user: locks, and what processes need to find the shared memory of a rig.
//!
//! Nobody else can enter it, so nobody else can take a role, take a name, or put something in place of what is read
//! there.

use super::BusError;
use std::fs::{DirBuilder, File, OpenOptions};
use std::os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// The variable that replaces the folder.
const VARIABLE: &str = "RICOCHET_RUNTIME_DIR";
/// The maximum length of its path: the address of a local socket in it has at most 107 bytes.
const MAX_PATH_BYTES: usize = 35;

/// Returns the runtime folders in which rigs of this user may be found, the one for new rigs first; never empty.
///
/// A process without a login session, such as a service, has no session folder. So a rig may be in any of them.
pub(super) fn candidate_folders() -> Vec<PathBuf> {
    if let Some(path) = std::env::var_os(VARIABLE).filter(|path| !path.is_empty()) {
        return vec![path.into()];
    }
    let user = rustix::process::geteuid().as_raw();
    let session = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    let login = Some(PathBuf::from(format!("/run/user/{user}")));
    // The session folder of another user remains in the environment of `su` and `sudo`.
    let own = |path: &PathBuf| path.metadata().is_ok_and(|found| found.is_dir() && found.uid() == user);
    let mut folders: Vec<PathBuf> =
        session.into_iter().chain(login).filter(own).map(|path| path.join("ricochet")).collect();
    folders.dedup();
    folders.push(Path::new("/tmp").join(format!("ricochet-{user}")));
    folders
}

/// Creates the folder for new rigs, or checks that nobody else can enter it, and returns its path.
///
/// # Errors
///
/// [`BusError::Folder`] if it cannot be created, belongs to another user, can be entered by others, or has a path of
/// more than [`MAX_PATH_BYTES`].
pub(super) fn open_folder() -> Result<PathBuf, BusError> {
    let path = candidate_folders().swap_remove(0);
    ensure_private(&path)?;
    if is_too_long(&path) {
        return Err(BusError::Folder { path, reason: FolderFault::TooLong.to_string() });
    }
    Ok(path)
}

/// A reason why a folder is not one that only this user can enter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FolderFault {
    /// A file or a link has its name.
    #[error("it is no folder")]
    NoFolder,
    /// It belongs to the first of these users, not to the second, this one.
    #[error("it belongs to user {0}, not to user {1}")]
    Owner(u32, u32),
    /// Others can enter it by this mode.
    #[error("others can enter it (mode {0:o}, must be 700)")]
    Open(u32),
    /// An address in it would be too long.
    #[error("its path is longer than {MAX_PATH_BYTES} bytes")]
    TooLong,
}

/// Returns the folder for new rigs, and the reason why it cannot be used; `None` where nothing speaks against it, or it
/// does not exist yet.
pub fn examine_runtime_folder() -> (PathBuf, Option<FolderFault>) {
    let path = candidate_folders().swap_remove(0);
    let fault = if is_too_long(&path) { Some(FolderFault::TooLong) } else { fault_of(&path).ok().flatten() };
    (path, fault)
}

/// Whether the address of a socket in a runtime folder would be too long.
fn is_too_long(path: &Path) -> bool {
    path.as_os_str().len() > MAX_PATH_BYTES
}

/// Returns the reason why others could enter a folder or replace it; `None` if only this user can.
fn fault_of(path: &Path) -> std::io::Result<Option<FolderFault>> {
    let found = path.symlink_metadata()?;
    let (user, owner, mode) = (rustix::process::geteuid().as_raw(), found.uid(), found.mode() & 0o7777);
    Ok(match () {
        () if !found.is_dir() => Some(FolderFault::NoFolder),
        () if owner != user => Some(FolderFault::Owner(owner, user)),
        () if mode & 0o077 != 0 => Some(FolderFault::Open(mode)),
        () => None,
    })
}

/// Creates a folder that only this user can enter, or checks that an existing one is such a folder.
///
/// # Errors
///
/// [`BusError::Folder`] if it cannot be created, is a link or a file, belongs to another user, or others can enter it.
pub(super) fn ensure_private(path: &Path) -> Result<(), BusError> {
    let fail = |reason: String| BusError::Folder { path: path.to_owned(), reason };
    let created = DirBuilder::new().mode(0o700).create(path);
    if let Some(error) = created.err().filter(|error| error.kind() != std::io::ErrorKind::AlreadyExists) {
        return Err(fail(error.to_string()));
    }
    match fault_of(path).map_err(|error| fail(error.to_string()))? {
        None => Ok(()),
        Some(fault) => Err(fail(fault.to_string())),
    }
}

/// Opens a file of a private folder for reading and writing; keeps its content, and creates it if needed.
pub(super) fn open_file(path: &Path) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(path)
}

/// Returns twelve random hexadecimal digits.
pub(super) fn random_name() -> std::io::Result<String> {
    let mut bytes = [0; 6];
    std::io::Read::read_exact(&mut File::open("/dev/urandom")?, &mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn a_folder_that_others_can_enter_or_that_is_a_link_is_refused() {
        let parent = std::env::temp_dir().join(format!("ricochet-test-{}", std::process::id()));
        ensure_private(&parent).unwrap();
        let (open, link) = (parent.join("open"), parent.join("link"));
        ensure_private(&open).unwrap();
        ensure_private(&open).unwrap();
        std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o750)).unwrap();
        assert!(ensure_private(&open).unwrap_err().to_string().contains("others can enter it (mode 750"));
        std::os::unix::fs::symlink(&parent, &link).unwrap();
        assert!(ensure_private(&link).unwrap_err().to_string().contains("it is no folder"));
        std::fs::remove_dir_all(&parent).unwrap();
    }
}
