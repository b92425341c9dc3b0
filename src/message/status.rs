//! The `status` topic, and the progress of readers that paces on-demand sources.

use super::layout::described;
use crate::results::named_enum;
use iceoryx2::prelude::ZeroCopySend;

named_enum! {
    /// A process of a rig; its name is the subcommand that runs it.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::Role;
    ///
    /// assert_eq!(Role::from_number(2), Some(Role::Correlate));
    /// assert_eq!(Role::Supervise.as_str(), "run");
    /// ```
    Role: "role" {
        /// Fills the ring.
        Acquire = 1 "acquire",
        /// Measures blocks of frames.
        Correlate = 2 "correlate",
        /// Puts the results in order.
        Track = 3 "track",
        /// Writes recordings.
        Record = 4 "record",
        /// Supervises the others.
        Supervise = 5 "run",
        /// Serves the operator's page.
        Serve = 6 "serve",
    }
}

described! {
    "ricochet.Status.v2"
    /// The state of one process of the rig, a few times per second. All counts begin with the process.
    ///
    /// # Examples
    ///
    /// ```no_run
    /// use ricochet::bus::Bus;
    /// use ricochet::message::{Role, StatusMessage};
    ///
    /// let bus = Bus::join("lacrosse", "example")?;
    /// let statuses = bus.listen::<StatusMessage>()?;
    /// while let Some(status) = statuses.take()? {
    ///     let role = Role::from_number(status.role).map_or("?", Role::as_str);
    ///     println!("{role} {}: {} Hz, {} lost", status.index, status.rate_hz, status.lost + status.dropped);
    /// }
    /// # Ok::<(), ricochet::bus::BusError>(())
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct StatusMessage {
        /// The start of the acquire process that it works on.
        pub run_id: u64,
        /// The number of the `Role`.
        pub role: u32,
        /// The index among several processes of the role (workers), from 0.
        pub index: u32,
        /// The process id.
        pub pid: u32,
        /// For the camera, the epoch of its frames. For a worker, k if it measures every k-th of its blocks because it is too
        /// slow. For the recorder, 1 when armed, plus 2 when recordings would not fit or cannot be written. For the
        /// supervisor, the number of its running processes.
        pub state: u32,
        /// The newest sequence number that was processed.
        pub sequence: u64,
        /// The newest stamp that was processed, ns since the Unix epoch.
        pub stamp_ns: u64,
        /// The number of frames (or rows) received.
        pub taken: u64,
        /// The number of frames (or rows) published.
        pub given: u64,
        /// The number lost before they arrived here: camera gaps, overrun queues.
        pub lost: u64,
        /// The number lost here: no free slot, torn frames, late rows.
        pub dropped: u64,
        /// The number of processes that were restarted (supervisor).
        pub restarts: u64,
        /// The length of this process's queue at the last check.
        pub waiting: u64,
        /// The capacity of that queue.
        pub capacity: u64,
        /// The number of frames per second since the last status.
        pub rate_hz: f64,
        /// The latency, host time minus the stamp of the last processed frame, s; 0 when the source is not live.
        pub latency_s: f64,
        /// The median time from the stamp of a frame to the publication of its velocity in this run, s; this and the
        /// following are 0 for other processes than the tracker, and when the source is not live.
        pub row_latency_median_s: f64,
        /// Its 99 % quantile, s.
        pub row_latency_p99_s: f64,
        /// Its 99.9 % quantile, s.
        pub row_latency_p999_s: f64,
        /// Its maximum, s.
        pub row_latency_max_s: f64,
        /// Its standard deviation, the jitter, s.
        pub row_latency_deviation_s: f64,
    }
}

impl StatusMessage {
    /// Returns the k of a worker that measures every k-th of its blocks; 1 if it measures all, and for other processes.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    #[must_use]
    pub fn measured_every(&self) -> u32 {
        if self.role == Role::Correlate as u32 { self.state.max(1) } else { 1 }
    }

    /// Whether the status is that of an armed recorder.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.role == Role::Record as u32 && self.state & 1 != 0
    }

    /// Whether the status is that of a recorder whose recordings would not fit or cannot be written.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        self.role == Role::Record as u32 && self.state & 2 != 0
    }
}

described! {
    "ricochet.Progress.v1"
    /// The progress of one reader of the frames.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct Progress {
        /// The start of the acquire process that it is attached to.
        pub run_id: u64,
        /// One past the newest frame that it has finished.
        pub next_sequence: u64,
        /// The number of the `Role`.
        pub role: u32,
        /// The index among several processes of the role (workers), from 0.
        pub index: u32,
        /// 1 when it will receive no more frames.
        pub done: u32,
        /// Zero.
        pub reserved: u32,
    }
}
