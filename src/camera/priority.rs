//! Threads that must not wait for others.
#![expect(unsafe_code, reason = "the scheduler is spoken to through a structure of C")]

/// Of the thread that receives a camera's packets, among real-time threads, 1 to 99.
pub const RECEIVING: i32 = 20;
/// Of the thread that hands its frames on.
pub const HANDING_ON: i32 = 10;

/// Lets this thread run before all that have no real-time priority; threads that it starts do not inherit it.
///
/// # Errors
///
/// When this user may not: it takes root, `CAP_SYS_NICE`, or a limit on real-time priorities that allows it.
pub fn raise(priority: i32) -> std::io::Result<()> {
    let parameter = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 means this thread; the parameter lives through the call.
    let done = unsafe { libc::sched_setscheduler(0, libc::SCHED_RR | libc::SCHED_RESET_ON_FORK, &raw const parameter) };
    if done == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) }
}
