//! Requests to a running rig: arm, disarm, trigger, status.

use super::{Bus, BusError, failure};
use crate::message::{Command, Reply, Request};
use iceoryx2::port::client::Client;
use iceoryx2::port::server::Server;
use iceoryx2::prelude::ipc;
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
    /// Answers all pending requests.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn answer(&self, mut reply: impl FnMut(Option<Command>) -> Reply) -> Result<(), BusError> {
        while let Some(request) = self.port.receive().map_err(failure("read", TOPIC))? {
            let answer = reply(Command::from_number(request.command));
            // The client may be gone by now.
            let _ = request.send_copy(answer);
        }
        Ok(())
    }
}

/// The client side, which sends requests.
#[derive(Debug)]
pub struct ControlClient {
    port: Client<ipc::Service, Request, (), Reply, ()>,
    _service: Service,
}

impl ControlClient {
    /// Sends a request and waits at most `patience` for the answer; `None` when nobody answers.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn ask(&self, command: Command, patience: Duration) -> Result<Option<Reply>, BusError> {
        let request = Request { command: command as u32, reserved: 0 };
        let pending = self.port.send_copy(request).map_err(failure("ask", TOPIC))?;
        #[expect(clippy::disallowed_methods, reason = "limits how long a person waits")]
        let asked = Instant::now();
        while asked.elapsed() < patience {
            if let Some(reply) = pending.receive().map_err(failure("ask", TOPIC))? {
                return Ok(Some(*reply));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        Ok(None)
    }
}

impl Bus {
    pub(super) fn control_service(&self) -> Result<Service, BusError> {
        self.node
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

    /// Creates the server.
    ///
    /// # Errors
    ///
    /// [`BusError::Service`] when shared memory cannot be used.
    pub fn control_server(&self) -> Result<ControlServer, BusError> {
        let service = self.control_service()?;
        let port = service.server_builder().create().map_err(self.failure("answer", TOPIC))?;
        Ok(ControlServer { port, _service: service })
    }

    /// Creates a client.
    ///
    /// # Errors
    ///
    /// [`BusError::NoRig`] when the rig is not running.
    pub fn control_client(&self) -> Result<ControlClient, BusError> {
        let service = self
            .node
            .service_builder(&self.service_name(TOPIC)?)
            .request_response::<Request, Reply>()
            .open()
            .map_err(|_| BusError::NoRig { rig: self.rig.clone(), service: self.full_name(TOPIC) })?;
        let port = service.client_builder().create().map_err(self.failure("ask", TOPIC))?;
        Ok(ControlClient { port, _service: service })
    }
}
