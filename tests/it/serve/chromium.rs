//! Headless Chromium, driven through its debugging protocol.

use super::socket::Socket;
use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;

/// A browser with one tab.
pub struct Chromium {
    child: Child,
    socket: Socket,
    calls: u64,
    _profile: TempDir,
}

impl Chromium {
    /// Starts a browser, or reports that the test was left out if there is none.
    pub fn start() -> Option<Self> {
        let program = crate::browser::program()?;
        let profile = tempfile::tempdir().unwrap();
        let mut command = Command::new(program);
        command.args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--remote-debugging-port=0"]);
        command.arg(format!("--user-data-dir={}", profile.path().display())).arg("about:blank");
        let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let mut listening = lines.map(|line| line.unwrap());
        let line = listening.find(|line| line.contains("DevTools listening on ws://")).expect("Chromium listens");
        // The rest is read, so that the browser never waits for it.
        std::thread::spawn(move || listening.for_each(drop));
        let address = line.split("ws://").nth(1).unwrap().split('/').next().unwrap().to_owned();
        let list =
            ureq::get(format!("http://{address}/json/list")).call().unwrap().body_mut().read_to_string().unwrap();
        let tabs: Vec<Value> = serde_json::from_str(&list).unwrap();
        let tab = tabs.iter().find(|tab| tab["type"] == "page").unwrap()["id"].as_str().unwrap().to_owned();
        let socket = Socket::open(&address, &format!("/devtools/page/{tab}"), "").unwrap();
        Some(Self { child, socket, calls: 0, _profile: profile })
    }

    fn call(&mut self, method: &str, params: &Value) -> Value {
        self.calls += 1;
        self.socket.send(&json!({ "id": self.calls, "method": method, "params": params }).to_string());
        loop {
            let message = self.socket.json();
            if message["id"] == self.calls {
                assert!(message["error"].is_null(), "{method}: {message}");
                return message["result"].clone();
            }
        }
    }

    /// Sets the size of the window, px, and the scheme of its colours, `light` or `dark`.
    pub fn resize(&mut self, size_px: [u32; 2], scheme: &str) {
        let [width, height] = size_px;
        let metrics = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600 });
        self.call("Emulation.setDeviceMetricsOverride", &metrics);
        let feature = json!({ "name": "prefers-color-scheme", "value": scheme });
        self.call("Emulation.setEmulatedMedia", &json!({ "features": [feature] }));
    }

    pub fn open(&mut self, address: &str) {
        self.call("Page.navigate", &json!({ "url": address }));
    }

    /// Evaluates an expression, and waits for its promise.
    pub fn evaluate(&mut self, expression: &str) -> Value {
        let params = json!({ "expression": expression, "returnByValue": true, "awaitPromise": true });
        self.call("Runtime.evaluate", &params)["result"]["value"].clone()
    }

    /// The text of the first element of a selector; empty when there is none.
    pub fn text(&mut self, selector: &str) -> String {
        let found = self.evaluate(&format!("document.querySelector({selector:?})?.innerText ?? ''"));
        found.as_str().unwrap_or_default().to_owned()
    }

    pub fn click(&mut self, selector: &str) {
        self.evaluate(&format!("document.querySelector({selector:?}).click()"));
    }

    /// Presses a key.
    pub fn press(&mut self, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", &json!({ "type": kind, "key": key, "text": key }));
        }
    }

    /// Presses a key that writes nothing.
    pub fn press_named(&mut self, key: &str) {
        for kind in ["rawKeyDown", "keyUp"] {
            let code = match key {
                "ArrowRight" => 39,
                "ArrowDown" => 40,
                _ => 0,
            };
            let event = json!({ "type": kind, "key": key, "code": key, "windowsVirtualKeyCode": code });
            self.call("Input.dispatchKeyEvent", &event);
        }
    }

    /// Moves or clicks the mouse at a place of the window, px.
    pub fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let button = if kind == "mouseMoved" { "none" } else { "left" };
        let event = json!({ "type": kind, "x": x, "y": y, "button": button, "buttons": 1, "clickCount": 1 });
        self.call("Input.dispatchMouseEvent", &event);
    }

    /// Touches the window at these places, px.
    pub fn touch(&mut self, kind: &str, places: &[[f64; 2]]) {
        let points: Vec<Value> = places.iter().map(|[x, y]| json!({ "x": x, "y": y })).collect();
        self.call("Input.dispatchTouchEvent", &json!({ "type": kind, "touchPoints": points }));
    }

    /// The visible page as a PNG file.
    pub fn screenshot(&mut self) -> Vec<u8> {
        let data = self.call("Page.captureScreenshot", &json!({ "format": "png" }));
        BASE64_STANDARD.decode(data["data"].as_str().unwrap()).unwrap()
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
