//! The topics at a real MQTT broker, Debian's mosquitto.

use super::{FAST_HZ as RATE_HZ, SERVED, Server, run_alone, small_drift};
use crate::support::{Background, Rig, is_required, wait_until};
use ricochet::bus::{Bus, BusError};
use ricochet::message::VelocityMessage;
use rumqttc::{Client, Event, MqttOptions, Packet, QoS};
use serde_json::Value;
use std::collections::BTreeMap;
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A broker at a port of its own.
pub struct Broker {
    program: &'static str,
    config: PathBuf,
    port: u16,
    process: Background,
}

impl Broker {
    /// Starts a broker; reports that the test was left out without one.
    fn start(rig: &Rig) -> Option<Self> {
        Self::start_with(rig, "")
    }

    /// Starts a broker with further lines of its configuration, those of another listener.
    pub fn start_with(rig: &Rig, lines: &str) -> Option<Self> {
        let can_run = |name: &&str| Command::new(name).arg("-h").output().is_ok();
        let Some(program) = ["mosquitto", "/usr/sbin/mosquitto"].into_iter().find(can_run) else {
            assert!(!is_required("MQTT"), "mosquitto is required but not installed");
            eprintln!("left out: mosquitto is not installed");
            return None;
        };
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        // It holds nothing back from its subscribers, and keeps their sessions when it ends.
        let text = format!(
            "per_listener_settings true\nuser root\npersistence true\npersistence_location {}/\n\
             max_inflight_messages 0\nmax_queued_messages 0\nset_tcp_nodelay true\nlog_type error\n\
             listener {port} 127.0.0.1\nallow_anonymous true\n{lines}",
            rig.path("").display()
        );
        let config = rig.file("mosquitto.conf", &text);
        let process = Self::process(program, &config, port);
        Some(Self { program, config, port, process })
    }

    fn process(program: &str, config: &std::path::Path, port: u16) -> Background {
        let mut command = Command::new(program);
        command.arg("-c").arg(config);
        let process = Background::start(command);
        wait_until("the broker listens", || TcpStream::connect(("127.0.0.1", port)).ok());
        process
    }

    /// Ends the broker and starts it again after a while.
    fn interrupt(&mut self, duration: Duration) {
        self.process.signal(15);
        self.process.0.wait().unwrap();
        std::thread::sleep(duration);
        self.process = Self::process(self.program, &self.config, self.port);
    }
}

/// The messages of each topic that a subscriber has received, with their times of arrival.
pub type Messages = Vec<(Instant, String, Value)>;

/// A subscriber to every topic of a rig, which connects again when the broker comes back.
pub struct Subscriber {
    is_over: Arc<AtomicBool>,
    thread: JoinHandle<Messages>,
}

impl Subscriber {
    /// Subscribes to all topics below `ricochet/{rig}`.
    pub fn start(broker: &Broker, rig: &str) -> Self {
        static SUBSCRIBERS: AtomicU32 = AtomicU32::new(0);
        let id = format!("subscriber-{}", SUBSCRIBERS.fetch_add(1, Ordering::Relaxed));
        let mut options = MqttOptions::new(id, "127.0.0.1", broker.port);
        options.set_keep_alive(Duration::from_secs(5)).set_max_packet_size(1 << 20, 1 << 20);
        // Rows that the broker gets before this subscriber is back must not count as a loss of the server.
        options.set_clean_session(false);
        let (client, mut connection) = Client::new(options, 10);
        let is_over = Arc::new(AtomicBool::new(false));
        let (over, filter) = (Arc::clone(&is_over), format!("ricochet/{rig}/#"));
        let (ready, is_ready) = std::sync::mpsc::channel();
        let thread = std::thread::spawn(move || {
            let mut messages = Messages::new();
            while !over.load(Ordering::Relaxed) {
                match connection.recv_timeout(Duration::from_millis(50)) {
                    Ok(Ok(Event::Incoming(Packet::ConnAck(_)))) => client.subscribe(&filter, QoS::AtLeastOnce).unwrap(),
                    Ok(Ok(Event::Incoming(Packet::SubAck(_)))) => ready.send(()).unwrap_or(()),
                    Ok(Ok(Event::Incoming(Packet::Publish(publish)))) => {
                        let row = serde_json::from_slice(&publish.payload).unwrap();
                        messages.push((Instant::now(), publish.topic, row));
                    }
                    Ok(Err(_)) => std::thread::sleep(Duration::from_millis(20)),
                    Ok(Ok(_)) | Err(_) => {}
                }
            }
            messages
        });
        is_ready.recv_timeout(Duration::from_secs(60)).unwrap();
        Self { is_over, thread }
    }

    pub fn end(self) -> Messages {
        self.is_over.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// Reads the velocities of a rig from shared memory until its end, each frame with the time of its arrival.
fn read_bus(rig: &str) -> JoinHandle<BTreeMap<u64, Instant>> {
    let rig = rig.to_owned();
    std::thread::spawn(move || {
        let bus = Bus::join(&rig, "test").unwrap();
        let topic = wait_until("the rig runs", || match bus.listen::<VelocityMessage>() {
            Err(BusError::NoRig { .. }) => None,
            topic => Some(topic.unwrap()),
        });
        let mut frames = BTreeMap::new();
        while bus.is_alive() {
            while let Some(message) = topic.take().unwrap() {
                frames.insert(message.sequence, Instant::now());
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        frames
    })
}

/// A rig that films at 1000 frames per second for a while, its server, and what reached a subscriber and the bus.
struct Trial {
    rig: Rig,
    broker: Broker,
    server: Server,
    run: Background,
    subscriber: Subscriber,
    bus: JoinHandle<BTreeMap<u64, Instant>>,
}

impl Trial {
    fn start(seconds: f64) -> Option<Self> {
        let rig = Rig::new();
        let broker = Broker::start(&rig)?;
        let subscriber = Subscriber::start(&broker, &rig.name);
        let film = rig.file("drift.toml", &small_drift((seconds * RATE_HZ) as u64));
        let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", film.display());
        let served = SERVED.replace("[trigger]", &format!("mqtt = \"localhost:{}\"\n[trigger]", broker.port));
        let config = rig.config(&camera, &format!("{served}[scale]\nmm_per_px = 1\n[workers]\ncount = 1"));
        let server = Server::start(&config);
        wait_until("the broker is connected", || {
            (server.json("/api/status")["mqtt"]["connected"] == true).then_some(())
        });
        let alone = rig.file("alone.toml", &std::fs::read_to_string(&config).unwrap().replace("mqtt = ", "# mqtt = "));
        let bus = read_bus(&rig.name);
        let run = run_alone(&rig, &alone);
        Some(Self { rig, broker, server, run, subscriber, bus })
    }

    /// Waits for the end of the film and judges what has arrived.
    fn end(self) -> Arrived {
        let (code, _, stderr) = self.run.end();
        assert!(matches!(code, Some(0 | 6)), "{stderr}");
        let sent = self.bus.join().unwrap();
        let status = wait_until("the server has noticed the end of the rig", || {
            Some(self.server.json("/api/status")).filter(|status| status["state"] == "FAULT")
        });
        // All that was sent is on its way. The status of the end comes last.
        std::thread::sleep(Duration::from_secs(1));
        let messages = self.subscriber.end();
        Arrived { rig: self.rig.name.clone(), sent, messages, lost: status["mqtt"]["lost"].as_u64().unwrap() }
    }
}

/// The rows that were sent and those that arrived.
struct Arrived {
    rig: String,
    sent: BTreeMap<u64, Instant>,
    messages: Messages,
    /// The number of rows that the server reports as lost.
    lost: u64,
}

impl Arrived {
    fn rows(&self, topic: &str) -> impl Iterator<Item = (Instant, &Value)> {
        let topic = format!("ricochet/{}/{topic}", self.rig);
        self.messages.iter().filter(move |(_, of, _)| *of == topic).map(|(at, _, row)| (*at, row))
    }

    /// The first arrival of each frame.
    fn frames(&self) -> BTreeMap<u64, Instant> {
        let mut frames = BTreeMap::new();
        for (at, row) in self.rows("velocity") {
            if let Some(frame) = row["frame"].as_u64() {
                frames.entry(frame).or_insert(at);
            }
        }
        frames
    }

    /// The frames that were sent after the first one that arrived, and have not arrived.
    fn missing(&self) -> u64 {
        let frames = self.frames();
        let first = frames.keys().next().copied().unwrap();
        self.sent.range(first..).filter(|(frame, _)| !frames.contains_key(frame)).count() as u64
    }

    /// Median and maximum of the time from shared memory to the subscriber, ms.
    fn ages_ms(&self) -> (f64, f64) {
        let frames = self.frames();
        let age = |(frame, sent): (&u64, &Instant)| {
            Some(1e3 * frames.get(frame)?.saturating_duration_since(*sent).as_secs_f64())
        };
        let mut ages: Vec<f64> = self.sent.iter().filter_map(age).collect();
        ages.sort_by(f64::total_cmp);
        (ages[ages.len() / 2], ages[ages.len() - 1])
    }
}

/// Publishes 1000 rows per second for a while, all of which must arrive.
fn check_without_loss(seconds: f64) {
    let Some(trial) = Trial::start(seconds) else { return };
    let arrived = trial.end();
    let (median_ms, max_ms) = arrived.ages_ms();
    let (sent, frames) = (arrived.sent.len(), arrived.frames().len());
    println!("{sent} rows in {seconds} s: {frames} arrived, age median {median_ms:.2} ms, maximum {max_ms:.1} ms");
    assert!(sent as f64 > 0.9 * seconds * RATE_HZ, "the rig measures too little: {sent} rows");
    assert!(frames as f64 > 0.99 * sent as f64, "the server has missed the start: {frames} of {sent} rows");
    assert_eq!((arrived.missing(), arrived.lost), (0, 0));
    assert!(median_ms < 5.0, "{median_ms} ms");
    let rows: Vec<&Value> = arrived.rows("velocity").map(|(_, row)| row).collect();
    for name in ["body", "stamp_ns", "t_s", "vn_m_s", "sigma_omega_rad_s", "status"] {
        assert!(rows[0].get(name).is_some(), "{name}");
    }
    let kinds: Vec<&Value> = arrived.rows("events").map(|(_, row)| &row["kind"]).collect();
    assert!(kinds.contains(&&"started".into()) && kinds.contains(&&"ended".into()), "{kinds:?}");
    let states: Vec<&Value> = arrived.rows("status").map(|(_, row)| &row["state"]).collect();
    assert!(states.contains(&&"READY".into()), "{states:?}");
}

#[test]
fn a_broker_gets_1000_rows_per_second_without_loss() {
    check_without_loss(10.0);
}

#[test]
#[ignore = "takes a minute"]
fn a_broker_gets_1000_rows_per_second_for_a_minute_without_loss() {
    check_without_loss(60.0);
}

#[test]
fn rows_go_on_after_a_broker_was_away_and_those_it_missed_are_counted() {
    let Some(mut trial) = Trial::start(14.0) else { return };
    trial.server.wait_for("READY");
    std::thread::sleep(Duration::from_secs(3));
    trial.broker.interrupt(Duration::from_secs(2));
    let back = Instant::now();
    let arrived = trial.end();
    let (missing, lost) = (arrived.missing(), arrived.lost);
    let notices: u64 = arrived.rows("velocity").filter_map(|(_, row)| row["lost"].as_u64()).sum();
    let later = arrived.rows("velocity").filter(|(at, _)| *at > back + Duration::from_secs(2)).count();
    println!("broker away for 2 s: {missing} rows are missing, {lost} counted, {notices} reported to subscribers");
    assert!(later > 2000, "rows go on: {later}");
    assert_eq!((missing, notices), (lost, lost), "each missing row is counted and reported");
}

#[test]
fn a_subscriber_that_comes_later_gets_the_state_and_the_end_of_the_server() {
    let Some(trial) = Trial::start(5.0) else { return };
    trial.server.wait_for("READY");
    let late = Subscriber::start(&trial.broker, &format!("{}/status", trial.rig.name));
    trial.server.process.signal(15);
    let (rig, broker) = (trial.rig.name.clone(), trial.broker);
    wait_until("the broker has the last will", || {
        let probe = Subscriber::start(&broker, &rig);
        std::thread::sleep(Duration::from_millis(100));
        probe.end().iter().any(|(_, _, row)| row["state"] == "OFFLINE").then_some(())
    });
    let states: Vec<Value> = late.end().into_iter().map(|(_, _, row)| row["state"].clone()).collect();
    assert!(states.first().is_some_and(|state| *state != "OFFLINE"), "the present state comes first: {states:?}");
    assert_eq!(states.last(), Some(&"OFFLINE".into()));
    trial.run.signal(15);
}
