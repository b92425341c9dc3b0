//! The figures of the runs as tables and as JSON.

use super::trial::{ProcessFigures, Trial};
use crate::console::{print_line, table};
use crate::message::Role;
use serde_json::{Value, json};

/// The rate for which the processors are counted, Hz.
const TARGET_HZ: f64 = 10_000.0;

/// Prints a run: what it filmed, its processes, its latencies and the verdict.
pub(super) fn print_trial(trial: &Trial) {
    print_line(&headline(trial));
    print_line("");
    print_line(&table(&process_rows(trial)));
    print_line("");
    print_line(&latency_line(trial));
    print_line(&memory_line(trial));
    print_line(&verdict(trial));
}

/// Prints the highest rates for several numbers of subsets.
pub(super) fn print_rates(trials: &[Trial]) {
    if let Some(first) = trials.first() {
        print_line(&format!("{}\n", setup_line(first)));
    }
    let header = ["subsets", "frames/s", "CPU us/frame", "median ms", "99 % ms", "max ms", "cores for 10 000/s"];
    let row = |trial: &Trial| {
        let cpu_us = trial.cpu_us_per_frame();
        vec![
            trial.plan.subsets.to_string(),
            format!("{:.0}", trial.plan.rate_hz),
            format!("{cpu_us:.0}"),
            ms(trial.latency.median_s),
            ms(trial.latency.p99_s),
            ms(trial.latency.max_s),
            format!("{:.1}", cpu_us * 1e-6 * TARGET_HZ),
        ]
    };
    let header = header.map(str::to_owned).to_vec();
    print_line(&table(&std::iter::once(header).chain(trials.iter().map(row)).collect::<Vec<_>>()));
    print_line("");
    for trial in trials {
        print_line(&verdict(trial));
    }
}

/// Returns the runs as JSON.
pub(super) fn as_json(trials: &[Trial]) -> Value {
    json!({ "live": trials.iter().map(trial_as_json).collect::<Vec<_>>() })
}

/// Describes the rig that is timed.
fn setup_line(trial: &Trial) -> String {
    let [width_px, height_px] = trial.plan.side_px;
    let bytes = u64::from(width_px) * u64::from(height_px) * trial.ring_frames;
    format!(
        "{width_px} x {height_px} px, {}, {} workers, blocks of {} frames, ring of {} frames ({} MiB)",
        trial.plan.scene.description(),
        trial.workers,
        trial.block_frames,
        trial.ring_frames,
        bytes >> 20,
    )
}

/// Describes a run.
fn headline(trial: &Trial) -> String {
    let (subsets, rate_hz) = (trial.plan.subsets, trial.plan.rate_hz);
    let (seconds, size_px) = (trial.frames as f64 / rate_hz, trial.plan.scene.subset_size_px());
    format!(
        "{}\n{subsets} subsets of {size_px} x {size_px} px, {rate_hz} frames/s for {seconds:.1} s",
        setup_line(trial)
    )
}

/// Returns a line for each process, below a header.
fn process_rows(trial: &Trial) -> Vec<Vec<String>> {
    let header = [
        "process",
        "in",
        "out",
        "lost",
        "CPU us/frame",
        "CPU %",
        "faults",
        "sleeps/s",
        "preempted/s",
        "own MiB",
        "peak MiB",
    ];
    let row = |process: &ProcessFigures| {
        let (status, used) = (&process.status, &process.used);
        vec![
            name(process),
            status.taken.to_string(),
            status.given.to_string(),
            (status.lost + status.dropped).to_string(),
            process.cpu_us_per_frame().map_or("-".into(), |us| format!("{us:.1}")),
            format!("{:.1}", 1e-7 * process.per_s(used.cpu_ns)),
            used.page_faults.to_string(),
            format!("{:.0}", process.per_s(used.voluntary_switches)),
            format!("{:.0}", process.per_s(used.involuntary_switches)),
            (used.private_bytes >> 20).to_string(),
            (used.peak_bytes >> 20).to_string(),
        ]
    };
    let header = header.map(str::to_owned).to_vec();
    std::iter::once(header).chain(ordered(trial).into_iter().map(row)).collect()
}

/// Returns the processes in the order in which a frame passes them.
fn ordered(trial: &Trial) -> Vec<&ProcessFigures> {
    let mut processes: Vec<&ProcessFigures> = trial.processes.iter().collect();
    processes.sort_by_key(|process| (process.child.role as u32, process.child.index));
    processes
}

/// Returns the name of a process.
fn name(process: &ProcessFigures) -> String {
    match process.child.role {
        Role::Correlate => format!("correlate {}", process.child.index),
        role => role.as_str().to_owned(),
    }
}

/// Describes the latencies.
fn latency_line(trial: &Trial) -> String {
    let latency = &trial.latency;
    format!(
        "from a frame to its velocity: median {} ms, 99 % within {}, 99.9 % within {}, longest {}, jitter {} rms",
        ms(latency.median_s),
        ms(latency.p99_s),
        ms(latency.p999_s),
        ms(latency.max_s),
        ms(latency.deviation_s),
    )
}

/// Compares the frames with what one core can copy.
fn memory_line(trial: &Trial) -> String {
    let (frames, copied) = (1e-9 * trial.frame_bytes_per_s(), 1e-9 * trial.copied_bytes_per_s);
    let percent = 100.0 * frames / copied;
    format!("frames: {frames:.2} GB/s, {percent:.0} % of the {copied:.1} GB/s that one core copies (memcpy)")
}

/// States whether the machine keeps up, and what is missing.
fn verdict(trial: &Trial) -> String {
    let (rate_hz, subsets) = (trial.plan.rate_hz, trial.plan.subsets);
    let shortfalls = trial.shortfalls();
    match shortfalls.is_empty() {
        true => format!("this machine keeps up with {rate_hz:.0} frames/s at {subsets} subsets"),
        false => format!(
            "this machine does not keep up with {rate_hz:.0} frames/s at {subsets} subsets: {}",
            shortfalls.join("; ")
        ),
    }
}

/// Formats a time in milliseconds.
fn ms(seconds: f64) -> String {
    format!("{:.2}", 1e3 * seconds)
}

/// Returns a run as JSON.
fn trial_as_json(trial: &Trial) -> Value {
    let (plan, latency) = (&trial.plan, &trial.latency);
    let shortfalls = trial.shortfalls();
    json!({
        "width_px": plan.side_px[0], "height_px": plan.side_px[1], "body": plan.scene.body_name(), "subsets": plan.subsets,
        "subset_size_px": plan.scene.subset_size_px(), "step_px": plan.step_px, "rate_hz": plan.rate_hz,
        "seconds": trial.frames as f64 / plan.rate_hz, "workers": trial.workers, "block_frames": trial.block_frames, "ring_frames": trial.ring_frames,
        "frames": trial.frames, "rows": trial.rows, "lost": trial.lost, "not_measured": trial.not_measured, "causes": trial.summary.causes,
        "behind_s": trial.behind_s, "keeps_up": shortfalls.is_empty(), "shortfalls": shortfalls,
        "cpu_us_per_frame": trial.cpu_us_per_frame(),
        "frame_bytes_per_s": trial.frame_bytes_per_s(), "memcpy_bytes_per_s": trial.copied_bytes_per_s,
        "latency_s": {
            "median": latency.median_s, "p99": latency.p99_s, "p999": latency.p999_s, "max": latency.max_s,
            "deviation": latency.deviation_s,
        },
        "processes": ordered(trial).into_iter().map(process_as_json).collect::<Vec<_>>(),
    })
}

/// Returns the figures of a process as JSON.
fn process_as_json(process: &ProcessFigures) -> Value {
    let (status, used) = (&process.status, &process.used);
    json!({
        "process": process.child.role.as_str(), "index": process.child.index, "in": status.taken,
        "out": status.given, "lost": status.lost, "dropped": status.dropped,
        "measured_frames": process.measured_frames, "measured_s": process.measured_s,
        "cpu_us_per_frame": process.cpu_us_per_frame(), "cpu_s": 1e-9 * used.cpu_ns as f64,
        "page_faults": used.page_faults, "voluntary_switches": used.voluntary_switches,
        "involuntary_switches": used.involuntary_switches, "private_bytes": used.private_bytes,
        "peak_bytes": used.peak_bytes,
    })
}
