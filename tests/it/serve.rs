//! The operator's page and the streams: real rigs, an HTTP client, a browser, and attacks.

mod access;
mod chromium;
mod drawing;
mod foxglove;
mod listeners;
mod mqtt;
mod mqtt_login;
mod page;
mod replay;
mod socket;
mod streams;
mod udp;

use crate::support::{Background, NO_PAGE, Rig, ricochet, wait_until};
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
        let mut server = Self::from_process(Background::start(ricochet(["serve".as_ref(), config.as_os_str()])));
        server.address = server.printed("page: http://");
        server
    }

    /// A server that has not printed its address yet.
    pub fn from_process(process: Background) -> Self {
        Self { process, address: String::new() }
    }

    /// Starts a rig with its page, which prints its address to standard error.
    pub fn start_rig(config: &Path) -> Self {
        let mut process = Background::start(ricochet(["run".as_ref(), config.as_os_str()]));
        let stderr = process.0.stderr.as_mut().unwrap();
        let address = loop {
            let line = next_line(stderr);
            assert!(!line.is_empty(), "the rig prints no address");
            if let Some(address) = address_in(&line, "page: http://") {
                break address;
            }
        };
        Self { process, address }
    }

    /// Reads the next line of the server, an address behind these words.
    pub fn printed(&mut self, words: &str) -> String {
        let line = next_line(self.process.0.stdout.as_mut().unwrap());
        address_in(&line, words).unwrap_or_else(|| panic!("not an address: {line:?}"))
    }

    pub fn url(&self, path: &str) -> String {
        format!("http://{}{path}", self.address)
    }

    /// The status and the body of an answer.
    pub fn get(&self, path: &str) -> (u16, String) {
        let (status, bytes) = self.get_bytes(path);
        // A picture is no text.
        (status, String::from_utf8_lossy(&bytes).into_owned())
    }

    /// The status and the body of an answer, as bytes.
    pub fn get_bytes(&self, path: &str) -> (u16, Vec<u8>) {
        let mut answer = agent().get(self.url(path)).call().unwrap();
        (answer.status().as_u16(), answer.body_mut().read_to_vec().unwrap())
    }

    pub fn json(&self, path: &str) -> Value {
        serde_json::from_str(&self.get(path).1).unwrap()
    }

    pub fn post(&self, path: &str, body: &str) -> (u16, Value) {
        self.post_as(None, path, body)
    }

    /// Sends a request as a page of this name, or as a program without one.
    pub fn post_as(&self, page: Option<&str>, path: &str, body: &str) -> (u16, Value) {
        let mut request = agent().post(self.url(path));
        if let Some(page) = page {
            request = request.header("x-ricochet-page", page);
        }
        let mut answer = request.send(body).unwrap();
        let text = answer.body_mut().read_to_string().unwrap();
        (answer.status().as_u16(), serde_json::from_str(&text).unwrap_or(Value::Null))
    }

    /// Waits until the rig is in this state, and returns it.
    pub fn wait_for(&self, word: &str) -> Value {
        wait_until(word, || Some(self.json("/api/status")).filter(|status| status["state"] == word))
    }
}

/// Returns the next line of a pipe, with its end; empty at the end of the pipe.
pub fn next_line(pipe: &mut impl Read) -> String {
    // Byte by byte, so that the rest of the output stays in the pipe.
    let (mut line, mut byte) = (Vec::new(), [0]);
    while !line.ends_with(b"\n") && pipe.read(&mut byte).unwrap() == 1 {
        line.push(byte[0]);
    }
    String::from_utf8(line).unwrap()
}

/// Returns the address behind these words.
fn address_in(line: &str, words: &str) -> Option<String> {
    line.trim().strip_prefix(words)?.strip_suffix('/').map(str::to_owned)
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
    let text = std::fs::read_to_string(config).unwrap().replace("[serve]\nhttp = \"127.0.0.1:0\"\n", NO_PAGE);
    let alone = rig.file("run.toml", &text);
    Background::start(ricochet(["run".as_ref(), alone.as_os_str()]))
}

/// The frame rate of [`small_drift`], Hz.
pub const FAST_HZ: f64 = 1000.0;

/// The film of a drifting disc, so small that any computer measures each frame in time.
pub fn small_drift(frames: u64) -> String {
    small_drift_at(frames, FAST_HZ)
}

/// [`small_drift`] at a frame rate of one's own, Hz.
pub fn small_drift_at(frames: u64, rate_hz: f64) -> String {
    let mut scenario: ricochet::synth::Scenario = toml::from_str(&crate::pipeline::drift(frames, rate_hz)).unwrap();
    (scenario.camera.width_px, scenario.camera.height_px, scenario.scale.mm_per_px) = (80, 72, 1.0);
    if let ricochet::synth::MotionSetup::Constant { start_px, .. } = &mut scenario.motion {
        *start_px = [30.0, 32.0];
    }
    toml::to_string(&scenario).unwrap()
}
