//! A rig that films for long: a drop every ten seconds, a random death every minute, memory and descriptors watched.
//!
//! `RICOCHET_SOAK_SECONDS` is the duration of the ignored test, an hour without it.

use super::{children, number, start};
use crate::pipeline::drift;
use crate::pipeline_faults::{analysis, tables};
use crate::recording::recover::xorshift;
use crate::support::{Rig, frames, kill, process, run, status, wait_until};
use ricochet::recording::Recording;
use ricochet::results::PointStatus;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const ROLES: [(&str, u64); 5] = [("acquire", 0), ("correlate", 0), ("correlate", 1), ("track", 0), ("record", 0)];

/// Times of a soak.
struct Plan {
    duration: Duration,
    between_drops: Duration,
    between_deaths: Duration,
    rate_hz: f64,
    /// The growth of the settled processes' memory from the first to the second half that passes.
    growth_percent: u64,
}

#[test]
#[ignore = "five minutes"]
fn five_minutes_of_drops_and_deaths_leak_nothing() {
    let seconds = Duration::from_secs;
    soak(&Plan {
        duration: seconds(300),
        between_drops: seconds(10),
        between_deaths: seconds(60),
        rate_hz: 200.0,
        growth_percent: 40,
    });
}

#[test]
#[ignore = "an hour, or RICOCHET_SOAK_SECONDS"]
fn an_hour_of_drops_and_deaths_leaks_nothing() {
    let duration = std::env::var("RICOCHET_SOAK_SECONDS").map_or(3600, |text| text.parse().unwrap());
    let seconds = Duration::from_secs;
    soak(&Plan {
        duration: seconds(duration),
        between_drops: seconds(10),
        between_deaths: seconds(60),
        rate_hz: 1000.0,
        growth_percent: 2,
    });
}

/// The memory of a process that is not shared, kB, and its open descriptors.
fn usage(pid: u32) -> Option<[u64; 2]> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let anonymous = text.lines().find_map(|line| line.strip_prefix("RssAnon:")?.trim().strip_suffix(" kB"))?;
    Some([anonymous.parse().ok()?, std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?.count() as u64])
}

/// The role of a process, with the index of a worker.
fn role(pid: u32) -> Option<String> {
    let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).ok()?;
    let words: Vec<&str> = line.split('\0').collect();
    let index = words.iter().position(|word| *word == "--worker").map_or("", |at| words[at + 1]);
    Some(format!("{}{index}", words.get(1)?))
}

/// The usage of the processes of each role. One that has just begun needs less, so each counts once it is settled.
struct Usage {
    settling: Duration,
    seen: BTreeMap<u32, Instant>,
    samples: BTreeMap<String, Vec<(Instant, [u64; 2])>>,
}

impl Usage {
    fn sample(&mut self, pids: &[u32]) {
        for pid in pids {
            let first_seen = *self.seen.entry(*pid).or_insert_with(Instant::now);
            if first_seen.elapsed() < self.settling {
                continue;
            }
            if let (Some(role), Some(usage)) = (role(*pid), usage(*pid)) {
                self.samples.entry(role).or_default().push((Instant::now(), usage));
            }
        }
    }

    /// The medians of each role before and after `middle`, where it has samples in both.
    fn halves(&self, middle: Instant) -> BTreeMap<&str, [[u64; 2]; 2]> {
        let median = |samples: &[(Instant, [u64; 2])], is_late: bool, k: usize| {
            let half = samples.iter().filter(|(at, _)| (*at > middle) == is_late);
            let mut values: Vec<u64> = half.map(|(_, usage)| usage[k]).collect();
            values.sort_unstable();
            values.get(values.len() / 2).copied()
        };
        let halves = self.samples.iter().filter_map(|(role, samples)| {
            let mut medians = [[0; 2]; 2];
            for (half, k) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                medians[half][k] = median(samples, half == 1, k)?;
            }
            Some((role.as_str(), medians))
        });
        halves.collect()
    }
}

fn soak(plan: &Plan) {
    let rig = Rig::new();
    let scenario = rig.file("long.toml", &drift(10_000_000, plan.rate_hz));
    let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = true", scenario.display());
    let trigger = "[trigger]\nmode = \"software\"\npre_s = 0.2\npost_s = 0.3\nrearm = true";
    let config = rig.config(&camera, &format!("[scale]\nmm_per_px = 0.5\n[workers]\ncount = 2\n{trigger}"));
    let service = start(&config);
    let supervisor = service.0.id();
    wait_until("it films", || (number(&status(&rig.name)?, "track", "given") > 500).then_some(()));
    let mut random = xorshift(0x9e37_79b9_7f4a_7c15);
    let (began, mut last_death, mut drops, mut deaths) = (Instant::now(), Instant::now(), 0, 0);
    let mut usage = Usage { settling: plan.between_deaths, seen: BTreeMap::new(), samples: BTreeMap::new() };
    while began.elapsed() < plan.duration {
        std::thread::sleep(plan.between_drops);
        if last_death.elapsed() >= plan.between_deaths {
            let (role, index) = ROLES[random(ROLES.len())];
            let pid = wait_until("the process reports", || process(&status(&rig.name)?, role, index)?["pid"].as_u64());
            kill(u32::try_from(pid).unwrap(), 9);
            (last_death, deaths) = (Instant::now(), deaths + 1);
        }
        usage.sample(&[children(&rig), vec![supervisor]].concat());
        let before = rig.recordings();
        wait_until("a trigger is accepted", || {
            run(["trigger", "--rig", rig.name.as_str()]).status.success().then_some(())
        });
        let path = wait_until("the drop is recorded", || rig.recordings().into_iter().find(|p| !before.contains(p)));
        let film = frames(&path);
        let missing = film.last().unwrap().0.sequence + 1 - film[0].0.sequence - film.len() as u64;
        let ((_, analysed), recorded) = (analysis(&rig, &path, "1"), tables(&path));
        let is_equal = analysed == recorded;
        // The rows of a dead worker, or of one that fell behind, are lost, although its frames are in the file.
        let rows = Recording::open(&path).unwrap().velocities().unwrap().map(Result::unwrap);
        let lost = rows.filter(|row| row.status == PointStatus::Lost).count();
        let differs = || {
            let lines = recorded.iter().zip(&analysed).flat_map(|(one, other)| one.lines().zip(other.lines()));
            lines.filter(|(one, other)| one != other).last().map(|(one, other)| format!("\n{one}\n{other}"))
        };
        assert!(is_equal || lost > 0, "{path:?} differs from its analysis: {:?}", differs());
        println!(
            "{:.0} s: {} frames, {missing} missing, {lost} rows lost, equal: {is_equal}",
            began.elapsed().as_secs_f64(),
            film.len()
        );
        std::fs::remove_file(&path).unwrap();
        drops += 1;
    }
    service.signal(2);
    let (code, _, stderr) = service.end();
    assert_eq!(code, Some(if deaths > 0 { 6 } else { 0 }), "{stderr}");
    assert!(children(&rig).is_empty());
    println!("{drops} drops, {deaths} deaths; {stderr}");
    let halves = usage.halves(began + plan.duration / 2);
    for (role, [early, late]) in &halves {
        println!("{role}: memory {} to {} kB, descriptors {} to {}", early[0], late[0], early[1], late[1]);
    }
    let sum = |half: usize, k: usize| halves.values().map(|medians| medians[half][k]).sum::<u64>();
    let (first, last, percent) = (sum(0, 0), sum(1, 0), plan.growth_percent);
    assert!(first > 0 && last * 100 <= first * (100 + percent), "memory grows from {first} to {last} kB");
    assert!(sum(1, 1) <= sum(0, 1) + 8, "descriptors grow from {} to {}", sum(0, 1), sum(1, 1));
}
