//! Domains: the shared memory of one run of a rig, apart from that of every other run, rig and user.
//!
//! Names in `/dev/shm` are visible to every user, and anyone can take a name that is not taken yet. The names of a domain
//! therefore begin with random digits, and each run of a rig has its own domain. So a process that a dead run left behind
//! reaches nobody in the next one.

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
/// Time for a supervisor that has stopped its rig to leave.
const LEAVING: Duration = Duration::from_secs(1);
const LOCK_PATIENCE: Duration = Duration::from_secs(5);
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
    /// The domain in this folder, as passed on by [`folder`](Self::folder).
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Returns its private folder, which lasts as long as the domain has members.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    fn prefix(&self) -> String {
        format!("{}_", self.folder.file_name().unwrap_or_default().to_string_lossy())
    }

    /// Returns the configuration of iceoryx2. Files in the working directory or the home folder change nothing.
    pub(super) fn config(&self) -> Result<Config, BusError> {
        let fail = |error: &dyn std::fmt::Debug| BusError::new("name", &self.folder.to_string_lossy(), error);
        let mut config = Config::default();
        let folder = BusPath::new(self.folder.as_os_str().as_encoded_bytes()).map_err(|error| fail(&error))?;
        config.global.set_root_path(&folder);
        config.global.prefix = FileName::new(self.prefix().as_bytes()).map_err(|error| fail(&error))?;
        Ok(config)
    }

    /// Joins the domain, unless it is gone.
    pub(super) fn join(&self) -> Option<Member> {
        let path = self.folder.join(MEMBERS);
        let lock = File::open(&path).ok()?;
        lock.lock_shared().ok()?;
        // The last member may have removed it in the meantime.
        path.exists().then(|| Member { domain: self.clone(), lock: Some(lock) })
    }

    /// Takes a role, and waits at most `patience` for the process that has it; `None` if it keeps it.
    pub(super) fn claim(&self, rig: &str, role: &str, patience: Duration) -> Result<Option<Claim>, BusError> {
        let claims = self.folder.join("claims");
        runtime::private(&claims)?;
        Claim::take(&claims.join(format!("{rig}.{role}")), patience)
    }

    /// Returns the roles of a rig that are taken.
    pub(super) fn claims(&self, rig: &str) -> Vec<TakenRole> {
        let entries = std::fs::read_dir(self.folder.join("claims")).into_iter().flatten().flatten();
        let claimed = |path: PathBuf| {
            let name = path.file_name()?.to_str()?.strip_prefix(rig)?.strip_prefix('.')?.to_owned();
            Some(TakenRole { name, pid: claim::holder(&path)? })
        };
        entries.filter_map(|entry| claimed(entry.path())).collect()
    }

    /// Creates a domain; the result is its first member.
    fn create(runtime: &Path) -> Result<Member, BusError> {
        for _ in 0..MAX_TRIES {
            let name = runtime::random_name();
            let fail = |error: std::io::Error| BusError::Folder { path: runtime.to_owned(), reason: error.to_string() };
            let domain = Self { folder: runtime.join(name.map_err(&fail)?) };
            runtime::private(&domain.folder)?;
            runtime::file(&domain.folder.join(MEMBERS)).map_err(fail)?;
            let Some(member) = domain.join() else { continue };
            // Creates the counter of the domain's processes.
            let node = NodeBuilder::new()
                .signal_handling_mode(SignalHandlingMode::Disabled)
                .config(&domain.config()?)
                .create::<ipc::Service>();
            drop(node.map_err(|error| BusError::new("create", &domain.folder.to_string_lossy(), error))?);
            if domain.close_to_others().is_ok() {
                return Ok(member);
            }
        }
        Err(BusError::new("create", MEMORY, "another user takes its names"))
    }

    /// Replaces every file that others may write by one that they may not.
    ///
    /// The library opens the counter of processes to every user. Changing its mode would not close it to a process that
    /// has opened it already.
    fn close_to_others(&self) -> std::io::Result<()> {
        for path in self.memory() {
            let content = std::fs::read(&path)?;
            std::fs::remove_file(&path)?;
            let mut options = std::fs::OpenOptions::new();
            let mut closed = options.write(true).create_new(true).mode(0o600).open(&path)?;
            std::io::Write::write_all(&mut closed, &content)?;
        }
        Ok(())
    }

    /// Returns the paths of its shared memory.
    pub(super) fn memory(&self) -> Vec<PathBuf> {
        let prefix = self.prefix();
        let entries = std::fs::read_dir(MEMORY).into_iter().flatten().flatten();
        let is_own = |entry: &std::fs::DirEntry| entry.file_name().as_encoded_bytes().starts_with(prefix.as_bytes());
        entries.filter(is_own).map(|entry| entry.path()).collect()
    }

    /// Removes everything of a domain without members.
    fn sweep(&self) {
        let members = self.folder.join(MEMBERS);
        let Ok(lock) = File::open(&members) else { return };
        if lock.try_lock().is_ok() {
            let _ = std::fs::remove_file(members);
            self.memory().iter().for_each(|path| drop(std::fs::remove_file(path)));
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
        self.domain.sweep();
    }
}

/// Returns the folder of a rig in a runtime folder; `None` for a name that no rig can have.
fn rig_folder(runtime: &Path, rig: &str) -> Option<PathBuf> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (!rig.is_empty() && rig.chars().all(is_plain)).then(|| runtime.join("rigs").join(rig))
}

/// Returns the domain that the rig has in this runtime folder.
fn existing(runtime: &Path, rig: &str) -> Option<Domain> {
    runtime::private(runtime).ok()?;
    let pointer = std::fs::read_to_string(rig_folder(runtime, rig)?.join(POINTER)).ok()?;
    let name = pointer.lines().find_map(|line| line.strip_prefix("prefix = \"")?.strip_suffix("_\""))?;
    Some(Domain { folder: runtime.join(name) })
}

/// Returns the names of all rigs that this user has run since the runtime folders were created, in alphabetical order.
pub(super) fn known_rigs() -> Vec<String> {
    let is_ours = |folder: &PathBuf| folder.is_dir() && runtime::private(folder).is_ok();
    let folders = runtime::candidates().into_iter().filter(is_ours);
    let entries = folders.flat_map(|folder| std::fs::read_dir(folder.join("rigs")).into_iter().flatten().flatten());
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    names.dedup();
    names
}

/// Returns the rig's present domain: that of the runtime folder in which it is alive.
pub(super) fn of_rig(rig: &str) -> Option<Domain> {
    let folders = runtime::candidates();
    let found = || folders.iter().filter(|folder| folder.is_dir()).filter_map(|folder| existing(folder, rig));
    let is_alive = |domain: &Domain| !domain.claims(rig).is_empty();
    found().find(is_alive).or_else(|| found().next())
}

/// Joins the rig's present domain, or creates one.
pub(super) fn join_or_create(rig: &str) -> Result<Member, BusError> {
    if let Some(member) = of_rig(rig).and_then(|domain| domain.join()) {
        return Ok(member);
    }
    let (runtime, folder) = open_rig(rig)?;
    let _lock = lock(&folder)?;
    match existing(&runtime, rig).and_then(|domain| domain.join()) {
        Some(member) => Ok(member),
        None => {
            let member = Domain::create(&runtime)?;
            point(&folder, &member.domain)?;
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

/// Gives a rig whose supervisor starts its domain, and takes the supervisor's place.
///
/// # Errors
///
/// [`BusError::Taken`] if the rig has a supervisor, or processes without one.
pub(super) fn renew(rig: &str, role: &str, renewal: &Renewal<'_>) -> Result<(Member, Claim), BusError> {
    let taken = |role: &str| BusError::Taken { rig: rig.to_owned(), role: role.to_owned() };
    let (runtime, folder) = open_rig(rig)?;
    let claim = Claim::take(&folder.join(SUPERVISOR), LEAVING)?.ok_or_else(|| taken(role))?;
    let _lock = lock(&folder)?;
    if let Some(domain) = of_rig(rig) {
        // The processes of a dead supervisor end by themselves. Processes started one by one keep their roles.
        if let (Some(role), false) = (domain.claims(rig).first(), domain.folder.join(SUPERVISED).exists()) {
            return Err(taken(&role.name));
        }
    }
    sweep_all(&runtime);
    let member = match renewal {
        Renewal::New => Domain::create(&runtime)?,
        Renewal::Of(domain) => domain.join().ok_or_else(|| gone(domain))?,
    };
    let fail = |error: std::io::Error| BusError::Folder { path: folder.clone(), reason: error.to_string() };
    runtime::file(&member.domain.folder.join(SUPERVISED)).map_err(fail)?;
    point(&folder, &member.domain)?;
    Ok((member, claim))
}

/// The error of a process that comes after the end of its run.
pub(super) fn gone(domain: &Domain) -> BusError {
    BusError::Folder { path: domain.folder.clone(), reason: "the run of the rig is over".into() }
}

fn open_rig(rig: &str) -> Result<(PathBuf, PathBuf), BusError> {
    let runtime = runtime::open()?;
    let Some(folder) = rig_folder(&runtime, rig) else {
        return Err(BusError::NoRig { rig: rig.to_owned(), service: format!("ricochet/{rig}") });
    };
    runtime::private(&runtime.join("rigs"))?;
    runtime::private(&folder)?;
    Ok((runtime, folder))
}

/// Takes the right to decide on the domain of a rig, which a process has for milliseconds.
fn lock(folder: &Path) -> Result<Claim, BusError> {
    let path = folder.join(LOCK);
    Claim::take(&path, LOCK_PATIENCE)?
        .ok_or_else(|| BusError::Folder { path, reason: "a process that hangs has locked it".into() })
}

/// Lets the rig's file lead to a domain.
fn point(folder: &Path, domain: &Domain) -> Result<(), BusError> {
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

/// Removes the domains of runs that were killed.
fn sweep_all(runtime: &Path) {
    let entries = std::fs::read_dir(runtime).into_iter().flatten().flatten();
    let domains = entries.map(|entry| entry.path()).filter(|path| path.join(MEMBERS).exists());
    domains.for_each(|folder| Domain { folder }.sweep());
}
