//! Requests to a running rig: arm, disarm, trigger, status.

use super::{Bus, BusError, failure};
use crate::message::{Command, Reply, Request};
use iceoryx2::active_request::ActiveRequest;
use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::ipc;
use iceoryx2::service::builder::request_response::RequestResponseOpenError;
use iceoryx2::service::port_factory::request_response::PortFactory;
use std::time::{Duration, Instant};

const TOPIC: &str = "control";

type Service = PortFactory<ipc::Service, Request, (), Reply, ()>;

/// The server side, which answers requests.
#[derive(Debug)]
pub struct ControlServer {
    port: Server<ipc::Service, Request, (), Reply, ()>,
    _service: Service,
}

impl ControlServer {
    /// Returns the oldest pending request, if there is one.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn take(&self) -> Result<Option<PendingRequest>, BusError> {
        self.port.receive().map(|request| request.map(PendingRequest)).map_err(failure("read", TOPIC))
    }
}

/// A request that waits for its answer.
#[derive(Debug)]
pub struct PendingRequest(ActiveRequest<ipc::Service, Request, (), Reply, ()>);

impl PendingRequest {
    /// Returns the command; `None` if it is unknown.
    pub fn command(&self) -> Option<Command> {
        Command::from_number(self.0.command)
    }

    /// Sends the answer. It is discarded if the client has ended.
    pub fn answer(self, reply: Reply) {
        let _ = self.0.send_copy(reply);
    }
}

/// The client side, which sends requests.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
/// use ricochet::message::Command;
/// use std::time::Duration;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let client = bus.control_client()?;
/// match client.ask(Command::Status, Duration::from_secs(2))? {
///     Some(reply) => println!("armed: {}, recordings: {}", reply.armed == 1, reply.recordings),
///     // The rig exists, but nobody answered in time.
///     None => println!("no answer"),
/// }
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct ControlClient {
    port: Client<ipc::Service, Request, (), Reply, ()>,
    _service: Service,
}

impl ControlClient {
    /// Sends a request and waits at most `timeout` for the answer; `None` if no rig answers.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn ask(&self, command: Command, timeout: Duration) -> Result<Option<Reply>, BusError> {
        self.send(command)?.wait(timeout)
    }

    /// Sends a request without waiting for the answer. Dropping the result withdraws the request.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn send(&self, command: Command) -> Result<PendingReply, BusError> {
        let request = Request { command: command as u32, reserved: 0 };
        self.port.send_copy(request).map(PendingReply).map_err(failure("ask", TOPIC))
    }
}

/// The answer to a request that was sent.
///
/// # Examples
///
/// ```no_run
/// use ricochet::bus::Bus;
/// use ricochet::message::Command;
/// use std::time::Duration;
///
/// let bus = Bus::join("lacrosse", "example")?;
/// let client = bus.control_client()?;
/// let pending = client.send(Command::Trigger)?;
/// // The request is on its way; other work can be done here.
/// let reply = pending.wait(Duration::from_secs(2))?;
/// assert!(reply.is_some(), "no answer in time");
/// # Ok::<(), ricochet::bus::BusError>(())
/// ```
#[derive(Debug)]
pub struct PendingReply(PendingResponse<ipc::Service, Request, (), Reply, ()>);

impl PendingReply {
    /// Waits at most `timeout` for the answer; `None` if no rig answers.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn wait(&self, timeout: Duration) -> Result<Option<Reply>, BusError> {
        #[expect(clippy::disallowed_methods, reason = "limits how long a person waits")]
        let asked = Instant::now();
        loop {
            if let Some(reply) = self.0.receive().map_err(failure("ask", TOPIC))? {
                return Ok(Some(*reply));
            }
            if asked.elapsed() >= timeout {
                return Ok(None);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Bus {
    /// Opens the service of the requests, or creates it.
    pub(super) fn control_service(&self) -> Result<Service, BusError> {
        self.node()
            .service_builder(&self.service_name(TOPIC)?)
            .request_response::<Request, Reply>()
            .max_servers(2)
            .max_clients(16)
            .max_nodes(64)
            .max_active_requests_per_client(2)
            .max_response_buffer_size(2)
            .enable_safe_overflow_for_requests(true)
            .enable_safe_overflow_for_responses(true)
            .open_or_create()
            .map_err(self.failure("create", TOPIC))
    }

    /// Creates the server, which answers the requests to this rig.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn control_server(&self) -> Result<ControlServer, BusError> {
        let service = self.control_service()?;
        let port = service.server_builder().create().map_err(self.failure("answer", TOPIC))?;
        Ok(ControlServer { port, _service: service })
    }

    /// Creates a client, which sends requests to the rig as it runs now.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] when the rig is not running; [`BusError::Service`] or [`BusError::Memory`] when shared
    /// memory cannot be used.
    pub fn control_client(&self) -> Result<ControlClient, BusError> {
        self.rejoin_present_domain()?;
        let service = self
            .node()
            .service_builder(&self.service_name(TOPIC)?)
            .request_response::<Request, Reply>()
            .open()
            .map_err(|error| match error {
                // The last two: its processes have just been killed or are ending.
                RequestResponseOpenError::DoesNotExist
                | RequestResponseOpenError::IsMarkedForDestruction
                | RequestResponseOpenError::ServiceInCorruptedState => self.no_rig_error(TOPIC),
                other => BusError::new("open", &self.full_name(TOPIC), other),
            })?;
        let port = service.client_builder().create().map_err(self.failure("ask", TOPIC))?;
        Ok(ControlClient { port, _service: service })
    }
}
