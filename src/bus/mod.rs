//! Shared memory between the processes of a rig. This is the only room that opens iceoryx2.
//!
//! Services are named `ricochet/RIG/TOPIC`. All limits are set here and never left to a default, because all processes
//! must request the same. The processes of a rig derive them from one configuration (`Limits`); other programs open
//! the services that exist.
//!
//! Each topic overflows safely. A slow, dead or absent reader loses its own oldest messages, detects that by the
//! sequence numbers, and never slows a writer.
//!
//! Another program joins a rig with [`Bus::join`] and reads its topics with [`Bus::listen`].

mod claim;
mod control;
mod domain;
mod error;
mod field;
mod frames;
mod limits;
mod memory;
mod notification;
mod runtime;
mod topic;

pub use control::{ControlClient, PendingReply};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use control::{ControlServer, PendingRequest};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use domain::{Domain, TakenRole};
pub use error::BusError;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use field::FieldPublisher;
pub use field::FieldSubscriber;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use frames::FramePublisher;
pub use frames::{FrameSample, FrameSubscriber};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use limits::Limits;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use memory::{check_room, free_bytes, lock_if_unlimited};
pub use notification::TopicListener;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use notification::TopicNotifier;
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use runtime::{FolderFault, examine_runtime_folder};
#[cfg_attr(all(doc, not(internals)), doc(hidden))]
pub use topic::Publisher;
pub use topic::{Subscriber, Topic};

use claim::Claim;
use domain::{Member, Renewal};
use iceoryx2::prelude::{LogLevel, Node, NodeBuilder, NodeName, ServiceName, SignalHandlingMode, ipc};
use std::any::Any;

use std::cell::{Ref, RefCell};
use std::fmt::Debug;
use std::path::PathBuf;
use std::time::Duration;

/// The membership of a process in a rig.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
/// use ricochet::message::VelocityMessage;
///
/// // All rigs of this user that run, or one by its name.
/// for rig in Bus::running_rigs() {
///     // The second name only shows who has joined.
///     let bus = Bus::join(&rig, "example")?;
///     let velocities = bus.listen::<VelocityMessage>()?;
///     while bus.is_alive() {
///         while let Some(message) = velocities.take()? {
///             println!("{} frame {}", bus.rig(), message.sequence);
///         }
///     }
/// }
/// assert!(!Bus::is_running("no-such-rig"));
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct Bus {
    link: RefCell<Link>,
    rig: String,
    role: String,
    _claims: Vec<Claim>,
}

/// The connection to a domain.
#[derive(Debug)]
struct Link {
    // Drop order: the domain may be removed once its node is gone.
    node: Node<ipc::Service>,
    member: Member,
}

impl Link {
    /// Registers this process in a domain, under the name `ricochet-RIG-ROLE`.
    ///
    /// # Errors
    ///
    /// [`BusError::Memory`] when shared memory has too little room for a process, [`BusError::Service`] when iceoryx2
    /// refuses.
    fn new(member: Member, rig: &str, role: &str) -> Result<Self, BusError> {
        memory::require(memory::JOIN_BYTES)?;
        iceoryx2::prelude::set_log_level_from_env_or(LogLevel::Fatal);
        let name =
            NodeName::new(&format!("ricochet-{rig}-{role}")).map_err(|error| BusError::new("name", rig, error))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&member.domain().config()?)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| BusError::new("join", rig, error))?;
        Ok(Self { node, member })
    }
}

impl Bus {
    /// Joins the present domain of a rig, or creates one if it has none, without taking a role.
    ///
    /// `role` only names the process in `iox2 node list`.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] for a name that no rig can have; [`BusError::Service`], [`BusError::Memory`] or
    /// [`BusError::Folder`] when shared memory or the private folder cannot be used.
    pub fn join(rig: &str, role: &str) -> Result<Self, BusError> {
        Self::new(domain::join_or_create(rig)?, rig, role, Vec::new())
    }

    /// Registers this process in a domain, with the claims on the roles that it has taken.
    fn new(member: Member, rig: &str, role: &str, claims: Vec<Claim>) -> Result<Self, BusError> {
        let link = RefCell::new(Link::new(member, rig, role)?);
        Ok(Self { link, rig: rig.to_owned(), role: role.to_owned(), _claims: claims })
    }

    /// Joins in a role that only one process of a rig has at a time.
    ///
    /// Waits up to `timeout`, and at least some tries long, for a process that is ending. `domain` is that of the
    /// supervisor. A process without one (`None`) joins the rig's present domain or creates one.
    ///
    /// # Errors
    ///
    /// [`BusError::Taken`] when another process keeps the role, [`BusError::Folder`] when the run of that domain is
    /// over. Otherwise as in [`join`](Self::join).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn join_as(rig: &str, role: &str, timeout: Duration, domain: Option<&Domain>) -> Result<Self, BusError> {
        let member = match domain {
            Some(domain) => domain.join().ok_or_else(|| domain::ended_error(domain))?,
            None => domain::join_or_create(rig)?,
        };
        let taken = || BusError::Taken { rig: rig.to_owned(), role: role.to_owned() };
        let claim = member.domain().claim(rig, role, timeout)?.ok_or_else(taken)?;
        Self::new(member, rig, role, vec![claim])
    }

    /// Joins as the supervisor of a rig, and creates a domain for it.
    ///
    /// With `first`, another rig of the same supervisor, it joins the domain of that rig instead.
    ///
    /// # Errors
    ///
    /// [`BusError::Taken`] when the rig runs already. Otherwise as in [`join`](Self::join).
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn join_as_supervisor(rig: &str, role: &str, first: Option<&Self>) -> Result<Self, BusError> {
        memory::require(memory::JOIN_BYTES)?;
        let domain = first.map(Self::domain);
        let (member, place) = domain::renew(rig, role, &domain.as_ref().map_or(Renewal::New, Renewal::Of))?;
        let claim = member.domain().claim(rig, role, Duration::ZERO)?;
        Self::new(member, rig, role, claim.into_iter().chain([place]).collect())
    }

    /// Returns the domain of the rig, for processes that this one starts.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn domain(&self) -> Domain {
        self.link.borrow().member.domain().clone()
    }

    /// Returns the path of a file of this rig in the private folder of its domain; the file need not exist.
    ///
    /// No other user can reach it, and it lasts as long as the domain.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn private_file(&self, name: &str) -> PathBuf {
        self.domain().folder().join(format!("{}-{name}", self.rig))
    }

    /// Reserves the memory of the small files that the rig's domain has in shared memory by now.
    ///
    /// # Errors
    ///
    /// [`BusError::Memory`] when there is not enough.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn reserve(&self) -> Result<(), BusError> {
        memory::reserve(&self.domain().memory_files())
    }

    /// Leaves the domain for the rig's present one, if the rig was started again since. Stays if that one is gone too.
    ///
    /// # Errors
    ///
    /// [`BusError::Memory`] or [`BusError::Service`] when shared memory cannot be used.
    fn rejoin_present_domain(&self) -> Result<(), BusError> {
        let present = domain::present_domain(&self.rig);
        let Some(domain) = present.filter(|domain| *domain != self.domain()) else { return Ok(()) };
        if let Some(member) = domain.join() {
            let link = Link::new(member, &self.rig, &self.role)?;
            self.link.replace(link);
        }
        Ok(())
    }

    fn node(&self) -> Ref<'_, Node<ipc::Service>> {
        Ref::map(self.link.borrow(), |link| &link.node)
    }

    /// Frees the resources of processes that were killed.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn clean_up_dead(&self) {
        let _ = self.node().try_cleanup_dead_nodes();
    }

    /// Whether a rig of this name runs. Unlike [`join`](Self::join), this creates nothing.
    pub fn is_running(rig: &str) -> bool {
        domain::present_domain(rig).is_some_and(|domain| !domain.claims(rig).is_empty())
    }

    /// Returns the names of this user's rigs that run, in alphabetical order.
    pub fn running_rigs() -> Vec<String> {
        let mut names = domain::known_rigs();
        names.retain(|name| Self::is_running(name));
        names
    }

    /// Whether any process has a role of this rig in the domain that this process has joined; listeners have none.
    pub fn is_alive(&self) -> bool {
        !self.domain().claims(&self.rig).is_empty()
    }

    /// Returns the roles of this rig that processes have, with or without a heartbeat, in alphabetical order.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn roles(&self) -> Vec<TakenRole> {
        let mut roles = self.domain().claims(&self.rig);
        roles.sort();
        roles
    }

    /// Returns the name of the rig.
    pub fn rig(&self) -> &str {
        &self.rig
    }

    /// Returns the name of a topic's service in the type of iceoryx2.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] if the name is too long.
    fn service_name(&self, topic: &str) -> Result<ServiceName, BusError> {
        let name = self.full_name(topic);
        ServiceName::new(&name).map_err(|error| BusError::new("name", &name, error))
    }

    /// Returns the name of a topic's service, `ricochet/RIG/TOPIC`.
    fn full_name(&self, topic: &str) -> String {
        format!("ricochet/{}/{topic}", self.rig)
    }

    /// Returns a function that turns an error of iceoryx2 into that of `action` on the service of a topic of this rig.
    fn failure<E: Debug>(&self, action: &'static str, topic: &str) -> impl FnOnce(E) -> BusError + use<E> {
        failure(action, self.full_name(topic))
    }

    /// Opens all services of a rig, which stay open until the result is dropped. A process that dies and is restarted
    /// thus finds the same limits.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when a service exists with other limits, or shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn open_services(&self, limits: &Limits) -> Result<Vec<Box<dyn Any>>, BusError> {
        use crate::message::{Event, ImpactMessage, Progress, StatusMessage, TrackMessage, VelocityMessage};
        Ok(vec![
            Box::new(self.frames_service(limits)?),
            Box::new(self.field_service(limits)?),
            Box::new(self.topic_service::<TrackMessage>(limits)?),
            Box::new(self.topic_service::<VelocityMessage>(limits)?),
            Box::new(self.topic_service::<ImpactMessage>(limits)?),
            Box::new(self.topic_service::<Event>(limits)?),
            Box::new(self.topic_service::<StatusMessage>(limits)?),
            Box::new(self.topic_service::<Progress>(limits)?),
            Box::new(self.control_service()?),
            Box::new(self.notification_service("frames")?),
            Box::new(self.notification_service("field")?),
            Box::new(self.notification_service("velocity")?),
        ])
    }
}

/// Returns a function that turns an error of iceoryx2 into that of `action` on a service.
fn failure<E: Debug>(action: &'static str, service: impl Into<String>) -> impl FnOnce(E) -> BusError {
    let service = service.into();
    move |error| BusError::new(action, &service, error)
}
