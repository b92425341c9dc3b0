//! Domains: the shared memory of one run of a rig, apart from that of every other run, rig and user.
//!
//! Names in `/dev/shm` are visible to every user, and anyone can take a name that is not taken yet. The names of a
//! domain therefore begin with random digits, and each run of a rig has its own domain. So a process that a dead run
//! left behind reaches nobody in the next one.

use super::claim::{self, Claim};
use super::{BusError, runtime};
use iceoryx2::prelude::{Config, FileName, NodeBuilder, Path as BusPath, SemanticString, SignalHandlingMode, ipc};
use std::fs::File;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The folder of shared memory.
const MEMORY: &str = "/dev/shm";
/// Number of attempts to create a domain whose names nobody else takes.
const MAX_TRIES: u32 = 3;
/// The file of a rig that leads to its domain; also the configuration of other programs of iceoryx2.
const POINTER: &str = "iceoryx2.toml";
/// The file that the members of a domain lock.
const MEMBERS: &str = "members";
/// The lock of the process that decides on the domain of a rig.
const SUPERVISOR: &str = "run";
/// The lock of a process that looks for the domain of a rig, and creates one if there is none.
const LOCK: &str = "lock";
/// The maximum wait for a supervisor that has stopped its rig and is about to exit.
const EXIT_TIMEOUT: Duration = Duration::from_secs(1);
/// The maximum wait for the process that has the lock of a rig.
const LOCK_TIMEOUT: Duration = Duration::from_secs(5);
/// The file of a domain whose processes end with their supervisor.
const SUPERVISED: &str = "supervised";

/// The shared memory of one run of a rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Domain {
    /// Its private folder, named after it.
    folder: PathBuf,
}

/// A role of a rig and the process that has it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct TakenRole {
    /// The role, with the index of a worker.
    pub name: String,
    /// The process; 0 while it takes the role.
    pub pid: u32,
}

/// The membership of a domain. The last member removes all that the domain has left.
#[derive(Debug)]
pub(super) struct Member {
    domain: Domain,
    lock: Option<File>,
}

impl Domain {
    /// Returns the domain in this folder, which another process returned from [`folder`](Self::folder).
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Returns its private folder, which lasts as long as the domain has members.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the beginning of all names of the domain in shared memory.
    fn prefix(&self) -> String {
        format!("{}_", self.folder.file_name().unwrap_or_default().to_string_lossy())
    }

    /// Returns the configuration of iceoryx2 for this domain. Configuration files of iceoryx2 are not read.
    pub(super) fn config(&self) -> Result<Config, BusError> {
        let fail = |error: &dyn std::fmt::Debug| BusError::new("name", &self.folder.to_string_lossy(), error);
        let mut config = Config::default();
        let folder = BusPath::new(self.folder.as_os_str().as_encoded_bytes()).map_err(|error| fail(&error))?;
        config.global.set_root_path(&folder);
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(|error| fail(&error))?;
        Ok(config)
    }

    /// Joins the domain; `None` if it was removed, or its file of members cannot be locked.
    pub(super) fn join(&self) -> Option<Member> {
        let path = self.folder.join(MEMBERS);
        let lock = File::open(&path).ok()?;
        lock.lock_shared().ok()?;
        // The last member may have removed it in the meantime.
        path.exists().then(|| Member { domain: self.clone(), lock: Some(lock) })
    }

    /// Takes a role of a rig, and waits for the process that has it as [`Claim::take`] does; `None` if it keeps it.
    ///
    /// # Errors
    ///
    /// [`BusError::Folder`] if the folder of the claims or the claim's file cannot be used.
    pub(super) fn claim(&self, rig: &str, role: &str, timeout: Duration) -> Result<Option<Claim>, BusError> {
        let claims = self.folder.join("claims");
        runtime::ensure_private(&claims)?;
        Claim::take(&claims.join(format!("{rig}.{role}")), timeout)
    }

    /// Returns the roles of a rig that processes have taken or are taking, in no particular order.
    pub(super) fn claims(&self, rig: &str) -> Vec<TakenRole> {
        let entries = std::fs::read_dir(self.folder.join("claims")).into_iter().flatten().flatten();
        let claimed = |path: PathBuf| {
            let name = path.file_name()?.to_str()?.strip_prefix(rig)?.strip_prefix('.')?.to_owned();
            Some(TakenRole { name, pid: claim::holder_pid(&path)? })
        };
        entries.filter_map(|entry| claimed(entry.path())).collect()
    }

    /// Creates a domain in the runtime folder, and returns its first member.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] if another user takes its names again and again, [`BusError::Folder`] if the folder cannot
    /// be used.
    fn create(runtime: &Path) -> Result<Member, BusError> {
        for _ in 0..MAX_TRIES {
            let name = runtime::random_name();
            let fail = |error: std::io::Error| BusError::Folder { path: runtime.to_owned(), reason: error.to_string() };
            let domain = Self { folder: runtime.join(name.map_err(&fail)?) };
            runtime::ensure_private(&domain.folder)?;
            runtime::open_file(&domain.folder.join(MEMBERS)).map_err(fail)?;
            let Some(member) = domain.join() else { continue };
            // Creates the counter of the domain's processes.
            let node = NodeBuilder::new()
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .config(&domain.config()?)
                .create::<ipc::Service>();
            drop(node.map_err(|error| BusError::new("create", &domain.folder.to_string_lossy(), error))?);
            if domain.restrict_to_user().is_ok() {
                return Ok(member);
            }
        }
        Err(BusError::new("create", MEMORY, "another user takes its names"))
    }

    /// Replaces every file that the domain has in shared memory by a copy that only this user can open.
    ///
    /// The library lets every user write its counter of processes. A change of the mode would not affect a process that
    /// has already opened the file.
    fn restrict_to_user(&self) -> std::io::Result<()> {
        for path in self.memory_files() {
            let content = std::fs::read(&path)?;
            std::fs::remove_file(&path)?;
            let mut options = std::fs::OpenOptions::new();
            let mut copy = options.write(true).create_new(true).mode(0o600).open(&path)?;
            std::io::Write::write_all(&mut copy, &content)?;
        }
        Ok(())
    }

    /// Returns the paths of its files in shared memory.
    pub(super) fn memory_files(&self) -> Vec<PathBuf> {
        let prefix = self.prefix();
        let entries = std::fs::read_dir(MEMORY).into_iter().flatten().flatten();
        let is_own = |entry: &std::fs::DirEntry| entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes());
        entries.filter(is_own).map(|entry| entry.path()).collect()
    }

    /// Removes the shared memory and the folder of the domain, unless it has members.
    fn remove_if_empty(&self) {
        let members = self.folder.join(MEMBERS);
        let Ok(lock) = File::open(&members) else { return };
        if lock.try_lock().is_ok() {
            let _ = std::fs::remove_file(members);
            self.memory_files().iter().for_each(|path| drop(std::fs::remove_file(path)));
            let _ = std::fs::remove_dir_all(&self.folder);
        }
    }
}

impl Member {
    pub(super) fn domain(&self) -> &Domain {
        &self.domain
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        self.lock = None;
        self.domain.remove_if_empty();
    }
}

/// Returns the folder of a rig in a runtime folder; `None` for a name that no rig can have.
fn rig_folder(runtime: &Path, rig: &str) -> Option<PathBuf> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (!rig.is_empty() && rig.chars().all(is_plain)).then(|| runtime.join("rigs").join(rig))
}

/// Returns the domain that the rig's file in this runtime folder leads to.
///
/// `None` if the rig has no such file, the file names no domain, or others can enter the runtime folder. The domain may
/// have been removed since.
fn read_pointer(runtime: &Path, rig: &str) -> Option<Domain> {
    runtime::ensure_private(runtime).ok()?;
    let pointer = std::fs::read_to_string(rig_folder(runtime, rig)?.join(POINTER)).ok()?;
    let name = pointer.lines().find_map(|line| line.strip_prefix("prefix = \"")?.strip_suffix("_\""))?;
    Some(Domain { folder: runtime.join(name) })
}

/// Returns the names of all rigs that this user has run since the runtime folders were created, in alphabetical order.
pub(super) fn known_rigs() -> Vec<String> {
    let is_ours = |folder: &PathBuf| folder.is_dir() && runtime::ensure_private(folder).is_ok();
    let folders = runtime::candidate_folders().into_iter().filter(is_ours);
    let entries = folders.flat_map(|folder| std::fs::read_dir(folder.join("rigs")).into_iter().flatten().flatten());
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    names.dedup();
    names
}

/// Returns the rig's present domain: that of the runtime folder in which processes of the rig run, else the first one.
/// `None` if it has none.
pub(super) fn present_domain(rig: &str) -> Option<Domain> {
    let folders = runtime::candidate_folders();
    let found = || folders.iter().filter(|folder| folder.is_dir()).filter_map(|folder| read_pointer(folder, rig));
    let is_alive = |domain: &Domain| !domain.claims(rig).is_empty();
    found().find(is_alive).or_else(|| found().next())
}

/// Joins the rig's present domain, or creates one if there is none that can be joined.
///
/// # Errors
///
/// [`BusError::NoRig`] for a name that no rig can have, [`BusError::Folder`] if a folder cannot be used,
/// [`BusError::Service`] if the domain cannot be created.
pub(super) fn join_or_create(rig: &str) -> Result<Member, BusError> {
    if let Some(member) = present_domain(rig).and_then(|domain| domain.join()) {
        return Ok(member);
    }
    let RigFolders { runtime, folder } = open_rig_folder(rig)?;
    let _lock = lock_rig(&folder)?;
    match read_pointer(&runtime, rig).and_then(|domain| domain.join()) {
        Some(member) => Ok(member),
        None => {
            let member = Domain::create(&runtime)?;
            write_pointer(&folder, &member.domain)?;
            Ok(member)
        }
    }
}

/// The domain of a rig whose supervisor starts.
pub(super) enum Renewal<'a> {
    /// A new one.
    New,
    /// That of another rig, which the same supervisor runs.
    Of(&'a Domain),
}

/// Starts a run of a rig: takes the role of its supervisor, and points its file to the domain of the run.
///
/// Waits up to [`EXIT_TIMEOUT`] for a previous supervisor to exit, and removes the domains without members. Returns
/// the membership of the domain and the claim on the supervisor's role. `role` names the supervisor in error messages.
///
/// # Errors
///
/// [`BusError::Taken`] if the rig has a supervisor, or processes without one. [`BusError::Folder`] if a folder cannot
/// be used, or the domain of the other rig is gone. [`BusError::Service`] if the new domain cannot be created.
pub(super) fn renew(rig: &str, role: &str, renewal: &Renewal<'_>) -> Result<(Member, Claim), BusError> {
    let taken = |role: &str| BusError::Taken { rig: rig.to_owned(), role: role.to_owned() };
    let RigFolders { runtime, folder } = open_rig_folder(rig)?;
    let claim = Claim::take(&folder.join(SUPERVISOR), EXIT_TIMEOUT)?.ok_or_else(|| taken(role))?;
    let _lock = lock_rig(&folder)?;
    if let Some(domain) = present_domain(rig) {
        // The processes of a dead supervisor end by themselves. Processes started one by one keep their roles.
        if let (Some(role), false) = (domain.claims(rig).first(), domain.folder.join(SUPERVISED).exists()) {
            return Err(taken(&role.name));
        }
    }
    remove_empty_domains(&runtime);
    let member = match renewal {
        Renewal::New => Domain::create(&runtime)?,
        Renewal::Of(domain) => domain.join().ok_or_else(|| ended_error(domain))?,
    };
    let fail = |error: std::io::Error| BusError::Folder { path: folder.clone(), reason: error.to_string() };
    runtime::open_file(&member.domain.folder.join(SUPERVISED)).map_err(fail)?;
    write_pointer(&folder, &member.domain)?;
    Ok((member, claim))
}

/// Returns the error of a process that joins a domain which was removed at the end of its run.
pub(super) fn ended_error(domain: &Domain) -> BusError {
    BusError::Folder { path: domain.folder.clone(), reason: "the run of the rig is over".into() }
}

/// The folders that hold the files of a rig.
struct RigFolders {
    /// The runtime folder of the user.
    runtime: PathBuf,
    /// The rig's own folder in it.
    folder: PathBuf,
}

/// Creates the runtime folder and the folder of a rig in it, if needed.
///
/// # Errors
///
/// [`BusError::NoRig`] for a name that no rig can have, [`BusError::Folder`] if a folder is not private.
fn open_rig_folder(rig: &str) -> Result<RigFolders, BusError> {
    let runtime = runtime::open_folder()?;
    let Some(folder) = rig_folder(&runtime, rig) else {
        return Err(BusError::NoRig { rig: rig.to_owned(), service: format!("ricochet/{rig}") });
    };
    runtime::ensure_private(&runtime.join("rigs"))?;
    runtime::ensure_private(&folder)?;
    Ok(RigFolders { runtime, folder })
}

/// Takes the right to decide on the domain of a rig, which a process has for milliseconds.
///
/// # Errors
///
/// [`BusError::Folder`] if another process keeps it.
fn lock_rig(folder: &Path) -> Result<Claim, BusError> {
    let path = folder.join(LOCK);
    Claim::take(&path, LOCK_TIMEOUT)?
        .ok_or_else(|| BusError::Folder { path, reason: "a process that hangs has locked it".into() })
}

/// Points the rig's file, in the rig's `folder`, to a domain.
///
/// The file is replaced as a whole, so that no reader sees half of it.
fn write_pointer(folder: &Path, domain: &Domain) -> Result<(), BusError> {
    let text = format!(
        "# Other programs that use iceoryx2 find this rig with this configuration.\n\
         [global]\nroot-path = \"{}\"\nprefix = \"{}\"\n",
        domain.folder.display(),
        domain.prefix()
    );
    let (path, part) = (folder.join(POINTER), folder.join(format!("{POINTER}.{}", std::process::id())));
    std::fs::write(&part, text)
        .and_then(|()| std::fs::rename(&part, &path))
        .map_err(|error| BusError::Folder { path, reason: error.to_string() })
}

/// Removes the domains without members in a runtime folder, which are left behind by runs that were killed.
fn remove_empty_domains(runtime: &Path) {
    let entries = std::fs::read_dir(runtime).into_iter().flatten().flatten();
    let domains = entries.map(|entry| entry.path()).filter(|path| path.join(MEMBERS).exists());
    domains.for_each(|folder| Domain { folder }.remove_if_empty());
}
