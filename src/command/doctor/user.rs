//! The rights of this user: the private folder of rigs, real-time priority, open files.

use super::Finding;
use super::storage::quoted;
use crate::bus::{FolderFault, examine_runtime_folder};
use crate::camera::realtime_priority;
use rustix::process::{Resource, getrlimit};

/// The number of files that a rig with 16 bodies and 8 cameras needs. It has about 500 open.
const OPEN_FILES: u64 = 1024;

/// Examines the private folder, the real-time priority and the limit of open files.
pub(super) fn examine() -> Vec<Finding> {
    vec![examine_private_folder(), examine_real_time(), examine_open_files()]
}

/// Examines the folder in which the processes of a rig find each other.
fn examine_private_folder() -> Finding {
    let (path, fault) = examine_runtime_folder();
    let name = quoted(&path);
    let Some(fault) = fault else { return Finding::good("private folder", path.display().to_string()) };
    let found = format!("{}: {fault}", path.display());
    let fix = match fault {
        FolderFault::NoFolder => format!("rm {name}"),
        FolderFault::Owner(_, user) => format!("chown -R {user} {name} && chmod 700 {name}"),
        FolderFault::Open(_) => format!("chmod 700 {name}"),
        FolderFault::TooLong => "unset RICOCHET_RUNTIME_DIR XDG_RUNTIME_DIR".to_owned(),
    };
    Finding::bad("private folder", found, fix)
}

/// Examines whether a thread of this user gets the priority of a camera's.
fn examine_real_time() -> Finding {
    let priority = realtime_priority::RECEIVING;
    // A thread of its own, so that the others keep theirs.
    let raised = std::thread::spawn(move || realtime_priority::raise(priority)).join();
    match raised {
        Ok(Ok(())) => Finding::good("real time", format!("priority {priority} is allowed")),
        _ => {
            let found = format!(
                "priority {priority} is refused, so frames wait for other programs; a line \"USER - rtprio 50\" in \
                 /etc/security/limits.d lasts"
            );
            Finding::advice("real time", found, "ulimit -r 50")
        }
    }
}

/// Examines the limit of open files per process.
fn examine_open_files() -> Finding {
    match getrlimit(Resource::Nofile).current {
        Some(count) if count < OPEN_FILES => {
            let found = format!("at most {count}, and a large rig needs {OPEN_FILES}");
            Finding::bad("open files", found, format!("ulimit -n {OPEN_FILES}"))
        }
        Some(count) => Finding::good("open files", format!("at most {count}")),
        None => Finding::good("open files", "no limit"),
    }
}
