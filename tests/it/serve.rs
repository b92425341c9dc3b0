//! The operator's page and the streams: real rigs, an HTTP client, a browser, and attacks.

mod access;
mod chromium;
mod foxglove;
mod page;
mod socket;
mod streams;

use crate::support::{Background, Rig, ricochet, wait_until};
use serde_json::Value;
use std::io::Read;
use std::path::Path;

/// A server next to a rig.
pub struct Server {
    pub process: Background,
    /// Address and port.
    pub address: String,
}

impl Server {
    /// Starts a server with the rig file, whose `[serve] http` must have port 0.
    pub fn start(config: &Path) -> Self {
        Self::start_by("serve", config)
    }

    /// Starts a command that prints the address of its server first.
    pub fn start_by(command: &str, config: &Path) -> Self {
        let process = Background::start(ricochet([command.as_ref(), config.as_os_str()]));
        let mut server = Self { process, address: String::new() };
        server.address = server.printed("page: http://");
        server
    }

    /// Reads the next line of the server, an address behind these words.
    pub fn printed(&mut self, words: &str) -> String {
        // Byte by byte, so that the rest of the output stays in the pipe.
        let output = self.process.0.stdout.as_mut().unwrap();
        let (mut line, mut byte) = (Vec::new(), [0]);
        while output.read(&mut byte).unwrap() == 1 && byte != *b"\n" {
            line.push(byte[0]);
        }
        let line = String::from_utf8(line).unwrap();
        let address = line.trim().strip_prefix(words).and_then(|rest| rest.strip_suffix('/'));
        address.unwrap_or_else(|| panic!("not an address: {line:?}")).to_owned()
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    /// The status and the body of an answer.
    pub fn get(&self, path: &str) -> (u16, String) {
        let mut answer = agent().get(self.url(path)).call().unwrap();
        // A picture is no text.
        (answer.status().as_u16(), String::from_utf8_lossy(&answer.body_mut().read_to_vec().unwrap()).into_owned())
    }

    pub fn json(&self, path: &str) -> Value {
        serde_json::from_str(&self.get(path).1).unwrap()
    }

    pub fn post(&self, path: &str, body: &str) -> (u16, Value) {
        let mut answer = agent().post(self.url(path)).send(body).unwrap();
        let text = answer.body_mut().read_to_string().unwrap();
        (answer.status().as_u16(), serde_json::from_str(&text).unwrap_or(Value::Null))
    }

    /// Waits until the rig is in this state, and returns it.
    pub fn wait_for(&self, word: &str) -> Value {
        wait_until(word, || Some(self.json("/api/status")).filter(|status| status["state"] == word))
    }
}

/// A client that reads the answer of a refusal instead of failing.
fn agent() -> ureq::Agent {
    ureq::Agent::config_builder().http_status_as_error(false).build().into()
}

/// The rest of a rig file with a server at a free port and a trigger on command.
pub const SERVED: &str = "[serve]\nhttp = \"127.0.0.1:0\"\n[trigger]\nmode = \"software\"\n";

/// Starts a rig with a simulated film of a drifting disc in real time: `frames` frames at `rate_hz`.
pub fn drifting(rig: &Rig, frames: u64, rate_hz: f64, rest: &str) -> (std::path::PathBuf, Background) {
    let film = rig.file("drift.toml", &crate::pipeline::drift(frames, rate_hz));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
    let config = rig.config(&camera, &format!("{SERVED}{rest}\n[scale]\nmm_per_px = 0.5\n[workers]\ncount = 1"));
    let run = run_alone(rig, &config);
    (config, run)
}

/// Runs the rig of a file without the page that the file asks for.
pub fn run_alone(rig: &Rig, config: &Path) -> Background {
    let text = std::fs::read_to_string(config).unwrap().replace("[serve]\nhttp = \"127.0.0.1:0\"\n", "");
    let alone = rig.file("run.toml", &text);
    Background::start(ricochet(["run".as_ref(), alone.as_os_str()]))
}
