//! The processor on which a worker runs.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// Moves this thread to the processor of worker `index`, if the system allows it several. Errors are ignored.
///
/// The system may move it away again at any time. It does not by itself move one of two workers away from a shared
/// processor to the one of the camera, which it takes for busy because it never sleeps for longer than a frame.
pub(super) fn move_to_own(index: u32) {
    let Ok(allowed) = sched_getaffinity(None) else { return };
    let Some(own) = processor_of(index, &allowed) else { return };
    let mut only = CpuSet::new();
    only.set(own);
    if sched_setaffinity(None, &only).is_ok() {
        let _ = sched_setaffinity(None, &allowed);
    }
}

/// Binds this thread to the processor of worker `index`, if the system allows it several. Errors are ignored.
pub(super) fn bind_to_own(index: u32) {
    let Ok(allowed) = sched_getaffinity(None) else { return };
    let Some(own) = processor_of(index, &allowed) else { return };
    let mut only = CpuSet::new();
    only.set(own);
    let _ = sched_setaffinity(None, &only);
}

/// Returns the processor of worker `index` among the allowed ones, the last for the first worker; `None` if there is
/// only one.
fn processor_of(index: u32, allowed: &CpuSet) -> Option<usize> {
    let mut processors: Vec<usize> = (0..CpuSet::MAX_CPU).filter(|processor| allowed.is_set(*processor)).collect();
    processors.reverse();
    (processors.len() > 1).then(|| processors[index as usize % processors.len()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_have_processors_of_their_own_as_long_as_there_are_enough() {
        let mut allowed = CpuSet::new();
        assert_eq!(processor_of(0, &allowed), None);
        allowed.set(3);
        assert_eq!(processor_of(0, &allowed), None, "one is no choice");
        [5, 70].iter().for_each(|processor| allowed.set(*processor));
        assert_eq!([0, 1, 2, 3].map(|index| processor_of(index, &allowed)), [70, 5, 3, 70].map(Some));
    }

    #[test]
    fn the_allowed_processors_stay_the_same() {
        let before = sched_getaffinity(None).unwrap();
        (0..4).for_each(move_to_own);
        assert!(sched_getaffinity(None).unwrap() == before);
    }
}
