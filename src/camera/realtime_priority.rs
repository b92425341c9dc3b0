//! Real-time scheduling of acquisition threads.
#![expect(unsafe_code, reason = "the scheduler takes a structure of C")]

/// Real-time priority (1 to 99) of the thread that receives the camera's packets.
pub const RECEIVING: i32 = 20;
/// Real-time priority (1 to 99) of the thread that publishes the frames.
pub const PUBLISHING: i32 = 10;

/// Gives this thread a real-time priority, 1 to 99, in round-robin scheduling (`SCHED_RR`).
///
/// Threads that it starts do not inherit it.
///
/// # Errors
///
/// The system's, if the user lacks the permission or the priority is out of range. The permission is root,
/// `CAP_SYS_NICE`, or a sufficient `RLIMIT_RTPRIO`.
pub fn raise(priority: i32) -> std::io::Result<()> {
    let parameter = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 means this thread; the parameter lives through the call.
    let done = unsafe { libc::sched_setscheduler(0, libc::SCHED_RR | libc::SCHED_RESET_ON_FORK, &raw const parameter) };
    if done == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}
