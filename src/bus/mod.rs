//! Shared memory between the processes of a rig. This is the only room that opens iceoryx2.
//!
//! Services are named `ricochet/RIG/TOPIC`. All limits are set here and never left to a default, because all processes
//! must request the same. The processes of a rig derive them from one configuration ([`Limits`]); other programs open the
//! services that exist.
//!
//! Each topic overflows safely. A slow, dead or absent reader loses its own oldest messages, detects that by the sequence
//! numbers, and never slows a writer.

mod bell;
mod claim;
mod control;
mod error;
mod field;
mod frames;
mod limits;
mod memory;
mod topic;

pub use bell::{Bell, Ear};
pub use control::{ControlClient, ControlServer, PendingReply, PendingRequest};
pub use error::BusError;
pub use field::{FieldPublisher, FieldSubscriber};
pub use frames::{FramePublisher, FrameSample, FrameSubscriber};
pub use limits::Limits;
pub use topic::{Publisher, Subscriber, Topic};

use iceoryx2::prelude::{LogLevel, Node, NodeBuilder, NodeName, ServiceName, SignalHandlingMode, ipc};
use std::any::Any;
use std::fmt::Debug;
use std::time::Duration;

/// The membership of a process in a rig.
#[derive(Debug)]
pub struct Bus {
    node: Node<ipc::Service>,
    rig: String,
    _claim: Option<claim::Claim>,
}

impl Bus {
    /// Joins the rig of this name. `iox2 node list` shows the `role`.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn join(rig: &str, role: &str) -> Result<Self, BusError> {
        iceoryx2::prelude::set_log_level_from_env_or(LogLevel::Fatal);
        let name =
            NodeName::new(&format!("ricochet-{rig}-{role}")).map_err(|error| BusError::new("name", rig, error))?;
        let node = NodeBuilder::new()
            .name(&name)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|error| BusError::new("join", rig, error))?;
        Ok(Self { node, rig: rig.to_owned(), _claim: None })
    }

    /// Joins in a role that only one process of a rig has at a time. Waits at most `patience` for one that is ending.
    ///
    /// # Errors
    ///
    /// [`BusError::Taken`] when another process has the role; [`BusError::Service`] when shared memory cannot be used.
    pub fn join_as(rig: &str, role: &str, patience: Duration) -> Result<Self, BusError> {
        let claim = claim::Claim::take(rig, role, patience)?;
        Ok(Self { _claim: Some(claim), ..Self::join(rig, role)? })
    }

    /// Frees the resources of processes that were killed.
    pub fn clean_up_dead(&self) {
        let _ = self.node.try_cleanup_dead_nodes();
    }

    /// Whether any process of this rig is alive, listeners aside.
    pub fn is_alive(&self) -> bool {
        claim::any(&self.rig)
    }

    /// Returns the name of the rig.
    pub fn rig(&self) -> &str {
        &self.rig
    }

    fn service_name(&self, topic: &str) -> Result<ServiceName, BusError> {
        let name = format!("ricochet/{}/{topic}", self.rig);
        ServiceName::new(&name).map_err(|error| BusError::new("name", &name, error))
    }

    fn full_name(&self, topic: &str) -> String {
        format!("ricochet/{}/{topic}", self.rig)
    }

    /// Returns the conversion of an error of iceoryx2 in an action on the service of a topic.
    fn failure<E: Debug>(&self, action: &'static str, topic: &str) -> impl FnOnce(E) -> BusError + use<E> {
        failure(action, self.full_name(topic))
    }

    /// Opens all services of a rig and keeps them open, so that a process that dies and is restarted finds the same limits.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when a service exists with other limits, or shared memory cannot be used.
    pub fn hold(&self, limits: &Limits) -> Result<Vec<Box<dyn Any>>, BusError> {
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
            Box::new(self.bell_service("frames")?),
            Box::new(self.bell_service("field")?),
            Box::new(self.bell_service("velocity")?),
        ])
    }
}

/// Returns the conversion of an error of iceoryx2 in an action on a service.
fn failure<E: Debug>(action: &'static str, service: impl Into<String>) -> impl FnOnce(E) -> BusError {
    let service = service.into();
    move |error| BusError::new(action, &service, error)
}
