//! The resources that a process has used, as the system counts them.

use std::path::PathBuf;

/// The resources that a process has used since its start, and its memory. All threads that still run are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Usage {
    /// Processor time, ns.
    pub(super) cpu_ns: u64,
    /// Pages that were mapped on their first use, or read from a disk.
    pub(super) page_faults: u64,
    /// Times that a thread went to sleep.
    pub(super) voluntary_switches: u64,
    /// Times that a thread lost its processor to another one.
    pub(super) involuntary_switches: u64,
    /// Memory of its own in use, bytes.
    pub(super) private_bytes: u64,
    /// Maximum memory that was mapped at once, shared memory included, bytes.
    pub(super) peak_bytes: u64,
}

impl Usage {
    /// Reads the resources of a process; `None` if it has ended.
    pub(super) fn read(pid: u32) -> Option<Self> {
        let process = PathBuf::from(format!("/proc/{pid}"));
        let status = std::fs::read_to_string(process.join("status")).ok()?;
        let stat = std::fs::read_to_string(process.join("stat")).ok()?;
        // The fields that follow the name, from the state on; see proc_pid_stat(5).
        let fields: Vec<&str> = stat.rsplit_once(") ")?.1.split(' ').collect();
        let field = |number: usize| fields.get(number - 3)?.parse::<u64>().ok();
        let kib = |key| Some(number_of(&status, key)? * 1024);
        let mut usage = Self {
            page_faults: field(10)? + field(12)?,
            private_bytes: kib("RssAnon:")?,
            peak_bytes: kib("VmHWM:")?,
            ..Self::default()
        };
        for thread in std::fs::read_dir(process.join("task")).ok()?.flatten() {
            // A thread may have ended since.
            usage.add_thread(&thread.path());
        }
        Some(usage)
    }

    /// Adds the processor time and the switches of a thread, if it still runs.
    fn add_thread(&mut self, thread: &std::path::Path) -> Option<()> {
        let time = std::fs::read_to_string(thread.join("schedstat")).ok()?;
        let status = std::fs::read_to_string(thread.join("status")).ok()?;
        self.cpu_ns += time.split(' ').next()?.parse::<u64>().ok()?;
        self.voluntary_switches += number_of(&status, "voluntary_ctxt_switches:")?;
        self.involuntary_switches += number_of(&status, "nonvoluntary_ctxt_switches:")?;
        Some(())
    }

    /// Returns the resources used since `earlier`; memory as it is now.
    pub(super) fn since(&self, earlier: &Self) -> Self {
        Self {
            cpu_ns: self.cpu_ns.saturating_sub(earlier.cpu_ns),
            page_faults: self.page_faults.saturating_sub(earlier.page_faults),
            voluntary_switches: self.voluntary_switches.saturating_sub(earlier.voluntary_switches),
            involuntary_switches: self.involuntary_switches.saturating_sub(earlier.involuntary_switches),
            ..*self
        }
    }
}

/// Returns the number behind this key, which begins a line, in a file of lines `KEY NUMBER [UNIT]`.
fn number_of(text: &str, key: &str) -> Option<u64> {
    text.lines().find_map(|line| line.strip_prefix(key)?.split_whitespace().next()?.parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_and_memory_of_this_process_are_counted() {
        let before = Usage::read(std::process::id()).unwrap();
        let mut block = vec![1_u8; 32 << 20];
        while Usage::read(std::process::id()).unwrap().since(&before).cpu_ns < 5_000_000 {
            block.iter_mut().for_each(|byte| *byte = byte.wrapping_mul(3).wrapping_add(1));
            std::hint::black_box(&block);
        }
        let used = Usage::read(std::process::id()).unwrap().since(&before);
        assert!(used.page_faults > 0 && used.private_bytes > 32 << 20, "{used:?}");
        assert!(used.peak_bytes >= used.private_bytes, "{used:?}");
        assert_eq!(Usage::read(u32::MAX), None);
    }
}
