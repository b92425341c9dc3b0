//! Permissions of cameras.

use super::Finding;
use super::host::Host;
use std::fs::File;

/// Examines the cameras of the kernel; nothing without any.
pub(super) fn examine(host: &Host) -> Option<Finding> {
    let is_camera = |name: &String| name.strip_prefix("video").is_some_and(|rest| rest.parse::<u32>().is_ok());
    let paths: Vec<_> =
        host.names("/dev").into_iter().filter(is_camera).map(|name| host.path(&format!("/dev/{name}"))).collect();
    let refused = |path: &&std::path::PathBuf| {
        let opened = File::options().read(true).write(true).open(path);
        opened.is_err_and(|error| error.kind() == std::io::ErrorKind::PermissionDenied)
    };
    let refused: Vec<String> = paths.iter().filter(refused).map(|path| path.display().to_string()).collect();
    match (paths.len(), refused.len()) {
        (0, _) => None,
        (count, 0) => Some(Finding::good("video devices", format!("{count} can be opened"))),
        _ => {
            let found = format!(
                "no permission for {}; after `usermod -aG video USER` and a new login it lasts",
                refused.join(", ")
            );
            Some(Finding::bad("video devices", found, format!("chmod a+rw {}", refused.join(" "))))
        }
    }
}
