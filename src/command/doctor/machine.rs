//! Processors, clock and huge pages.

use super::Finding;
use super::host::Host;
use rustix::thread::sched_getaffinity;

/// The folder of the clock sources.
const CLOCK: &str = "/sys/devices/system/clocksource/clocksource0";
/// The file with the use of huge pages in shared memory.
const HUGE_PAGES: &str = "/sys/kernel/mm/transparent_hugepage/shmem_enabled";
/// The folder of the processors.
const PROCESSORS: &str = "/sys/devices/system/cpu";
/// Clock sources that are read in tens of nanoseconds, best first. Others take microseconds.
const FAST_CLOCKS: [&str; 5] = ["tsc", "kvm-clock", "arch_sys_counter", "hyperv_clocksource_tsc_page", "xen"];

/// Examines processors, frequency control, clock and huge pages.
pub(super) fn examine(host: &Host) -> Vec<Finding> {
    let findings =
        [Some(examine_processors(host)), examine_governor(host), examine_clock(host), examine_huge_pages(host)];
    findings.into_iter().flatten().collect()
}

/// Examines whether this process may use all processors of the machine, and more than one.
fn examine_processors(host: &Host) -> Finding {
    let count = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let found = format!("{count} usable");
    let online = host.read(&format!("{PROCESSORS}/online")).unwrap_or_default();
    let of_machine = count_listed(&online);
    match sched_getaffinity(None).map_or(of_machine, |allowed| allowed.count() as usize) {
        allowed if allowed < of_machine => {
            let found = format!("{found}, and this program may run on {allowed} of {of_machine}");
            Finding::advice("processors", found, format!("taskset -pc {online} $$"))
        }
        _ if count == 1 => {
            Finding { fix: None, ..Finding::advice("processors", found + "; a rig has at least four processes", "") }
        }
        _ => Finding::good("processors", found),
    }
}

/// Returns the number of processors in a list of the kernel such as `0-3,6`; 0 for any other text.
fn count_listed(list: &str) -> usize {
    let count = |range: &str| {
        let (first, last) = range.split_once('-').unwrap_or((range, range));
        Some(last.parse::<usize>().ok()?.checked_sub(first.parse().ok()?)? + 1)
    };
    list.split(',').map(count).sum::<Option<usize>>().unwrap_or(0)
}

/// Examines the frequency control; `None` where the processors have none.
fn examine_governor(host: &Host) -> Option<Finding> {
    let file = |name: &str| format!("{PROCESSORS}/{name}/cpufreq/scaling_governor");
    let named: Vec<(String, String)> =
        host.names(PROCESSORS).into_iter().filter_map(|name| Some((host.read(&file(&name))?, name))).collect();
    let slow: Vec<&(String, String)> = named.iter().filter(|(governor, _)| governor != "performance").collect();
    match (named.is_empty(), slow.first()) {
        (true, _) => None,
        (false, None) => Some(Finding::good("frequency", "performance")),
        (false, Some((governor, _))) => {
            let found =
                format!("{governor} on {} of {} processors; frames wait while they speed up", slow.len(), named.len());
            let files = host.path(&format!("{PROCESSORS}/cpu*/cpufreq/scaling_governor"));
            let fix = format!("for file in {}; do echo performance > $file; done", files.display());
            Some(Finding::advice("frequency", found, fix))
        }
    }
}

/// Examines the clock source; `None` where the kernel does not state it.
fn examine_clock(host: &Host) -> Option<Finding> {
    let current = host.read(&format!("{CLOCK}/current_clocksource"))?;
    if FAST_CLOCKS.contains(&current.as_str()) {
        return Some(Finding::good("clock", current));
    }
    let available = host.read(&format!("{CLOCK}/available_clocksource")).unwrap_or_default();
    let better = FAST_CLOCKS.iter().find(|clock| available.split_whitespace().any(|word| word == **clock));
    let found = format!("{current}, slow to read");
    Some(match better {
        Some(clock) => {
            Finding::advice("clock", found, host.write_command(&format!("{CLOCK}/current_clocksource"), clock))
        }
        None => Finding::advice("clock", found, "add clocksource=tsc to the kernel's command line"),
    })
}

/// Examines the pages of shared memory; `None` where the kernel does not state them. The chosen word is in brackets.
fn examine_huge_pages(host: &Host) -> Option<Finding> {
    let text = host.read(HUGE_PAGES)?;
    let chosen = text.split_once('[')?.1.split_once(']')?.0.to_owned();
    Some(match chosen.as_str() {
        "always" | "within_size" | "force" => Finding::good("huge pages", chosen),
        _ => {
            let found = format!("{chosen} in shared memory; the ring of frames then has 4 KiB pages");
            Finding::advice("huge pages", found, host.write_command(HUGE_PAGES, "within_size"))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_processors_are_counted() {
        assert_eq!(["0", "0-3", "0-3,6,8-9", "", "3-1", "x"].map(count_listed), [1, 4, 7, 0, 0, 0]);
    }
}
