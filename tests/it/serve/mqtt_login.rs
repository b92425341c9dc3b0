//! A broker that asks for a user and a password, with and without encryption.

use super::mqtt::{Broker, Subscriber};
use super::{Server, next_line};
use crate::support::{Rig, is_required, wait_until};
use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

const USER: &str = "rig";
const PASSWORD: &str = "correct horse battery";

/// Runs a program that belongs to the broker, and returns whether it is there and succeeds.
fn runs(program: &str, arguments: &[&str]) -> bool {
    let output = Command::new(program).args(arguments).output();
    let is_done = output.is_ok_and(|output| output.status.success());
    assert!(is_done || !is_required("MQTT"), "{program} is required but does not run");
    is_done
}

/// A broker with a second port that asks for user and password, and for a certificate if it is encrypted.
struct Guarded {
    rig: Rig,
    broker: Broker,
    port: u16,
    password: PathBuf,
    ca: Option<PathBuf>,
}

impl Guarded {
    /// Starts a broker; `None` without one.
    fn start(is_encrypted: fn(&Rig) -> Option<PathBuf>) -> Option<Self> {
        let rig = Rig::new();
        let users = rig.path("users").display().to_string();
        if !runs("mosquitto_passwd", &["-b", "-c", &users, USER, PASSWORD]) {
            eprintln!("left out: mosquitto_passwd is not installed");
            return None;
        }
        let ca = is_encrypted(&rig);
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut lines = format!("listener {port} 127.0.0.1\nallow_anonymous false\npassword_file {users}\n");
        if let Some(ca) = &ca {
            let [certificate, key] = ["broker.crt", "broker.key"].map(|name| rig.path(name).display().to_string());
            lines += &format!("cafile {}\ncertfile {certificate}\nkeyfile {key}\n", ca.display());
        }
        let broker = Broker::start_with(&rig, &lines)?;
        let password = rig.file("password", &format!("{PASSWORD}\n"));
        Some(Self { rig, broker, port, password, ca })
    }

    /// Starts a server that publishes at the guarded port.
    fn serve(&self, user: &str, password: &std::path::Path) -> Server {
        let mut rest = format!(
            "[serve]\nhttp = \"127.0.0.1:0\"\nmqtt = \"localhost:{}\"\nmqtt_user = \"{user}\"\nmqtt_password_file = \"{}\"\n",
            self.port,
            password.display()
        );
        if let Some(ca) = &self.ca {
            rest += &format!("mqtt_ca_file = \"{}\"\n", ca.display());
        }
        Server::start(&self.rig.config("source = \"simulated\"", &rest))
    }

    /// Starts a server with the right password, and checks that its state reaches a subscriber of the broker.
    fn check_that_messages_arrive(&self) {
        let subscriber = Subscriber::start(&self.broker, &self.rig.name);
        let server = self.serve(USER, &self.password);
        wait_until("the broker is connected", || {
            (server.json("/api/status")["mqtt"]["connected"] == true).then_some(())
        });
        std::thread::sleep(Duration::from_millis(600));
        let rig = server.json("/api/status")["rig"].clone();
        server.process.signal(15);
        let (code, printed, logged) = server.process.end();
        assert_eq!((code, printed.contains(PASSWORD), logged.contains(PASSWORD)), (Some(0), false, false));
        let messages = subscriber.end();
        assert!(messages.iter().any(|(_, topic, row)| topic.ends_with("/status") && row["rig"] == rig));
    }
}

/// Makes an authority and a certificate of it for localhost; `None` without openssl.
fn certificates(rig: &Rig) -> Option<PathBuf> {
    let at = |name: &str| rig.path(name).display().to_string();
    let names = rig.file("names", "subjectAltName=DNS:localhost").display().to_string();
    let (ca, ca_key, request) = (at("ca.crt"), at("ca.key"), at("broker.csr"));
    let new = ["req", "-newkey", "rsa:2048", "-nodes", "-keyout"];
    let is_made =
        runs("openssl", &[&new[..], &[&ca_key, "-x509", "-days", "9", "-subj", "/CN=authority", "-out", &ca]].concat())
            && runs("openssl", &[&new[..], &[&at("broker.key"), "-subj", "/CN=localhost", "-out", &request]].concat())
            && runs(
                "openssl",
                &[
                    "x509",
                    "-req",
                    "-in",
                    &request,
                    "-CA",
                    &ca,
                    "-CAkey",
                    &ca_key,
                    "-CAcreateserial",
                    "-days",
                    "9",
                    "-extfile",
                    &names,
                    "-out",
                    &at("broker.crt"),
                ],
            );
    is_made.then(|| rig.path("ca.crt"))
}

#[test]
fn a_broker_with_passwords_takes_the_right_one_and_a_wrong_one_is_one_line() {
    let Some(guarded) = Guarded::start(|_| None) else { return };
    guarded.check_that_messages_arrive();
    let wrong = guarded.rig.file("wrong", "incorrect horse\n");
    let mut server = guarded.serve(USER, &wrong);
    let line = next_line(server.process.0.stderr.as_mut().unwrap());
    let expected =
        format!("the MQTT broker localhost:{} refuses the user \"{USER}\": check serve.mqtt_user", guarded.port);
    assert!(line.contains(&expected), "{line}");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(server.json("/api/status")["mqtt"]["connected"], false);
    server.process.signal(15);
    let (_, printed, logged) = server.process.end();
    assert_eq!((printed.as_str(), logged.as_str()), ("", ""), "one line is enough");
    assert!(!line.contains("horse"), "{line}");
}

#[test]
fn a_broker_is_reached_by_tls_and_one_with_a_foreign_certificate_is_not() {
    let Some(mut guarded) = Guarded::start(certificates) else { return };
    if guarded.ca.is_none() {
        eprintln!("left out: openssl is not installed");
        return;
    }
    guarded.check_that_messages_arrive();
    let foreign = Rig::new();
    guarded.ca = certificates(&foreign);
    let mut server = guarded.serve(USER, &guarded.password);
    let line = next_line(server.process.0.stderr.as_mut().unwrap());
    assert!(line.contains("by TLS: ") && line.contains("check serve.mqtt_ca_file"), "{line}");
    assert_eq!(server.json("/api/status")["mqtt"]["connected"], false);
    server.process.signal(15);
}
