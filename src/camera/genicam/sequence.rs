//! Frame ids of the wire as a count that never wraps.

/// Ids before GigE Vision 2 have 16 bits and never are 0.
const SHORT_IDS: u64 = 65_535;

/// How ids of one stream count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Counting {
    /// 1 to 65535, then 1 again.
    Short,
    /// 64 bits.
    Long,
}

/// Ids this far ahead are no gap but nonsense.
const FARTHEST: u64 = 1 << 32;

/// Unwraps the ids of one stream into a sequence that starts at 0 with the first id seen.
///
/// A gap in the ids is the same gap in the sequence, so each lost frame shows. A
/// silence of 32768 frames or more in 16-bit ids cannot be told from a step back:
/// the wire does not say more.
///
/// Where the camera puts a counter of its own into each frame, frames that it took
/// and never sent show too: of the two gaps the larger counts.
#[derive(Debug)]
pub struct FrameIds {
    counting: Counting,
    last: Option<(u64, u64)>,
    /// Only torn frames were seen so far: their ids may be as damaged as they are.
    is_guess: bool,
    counter: Option<u64>,
}

impl FrameIds {
    /// For a stream whose ids may have 16 bits (GigE Vision) or always have 64 (USB3 Vision).
    pub fn new(gige: bool) -> Self {
        let counting = if gige { Counting::Short } else { Counting::Long };
        Self { counting, last: None, is_guess: true, counter: None }
    }

    /// Notes a frame that did not arrive whole: the sequence may begin with it, but never follows it.
    pub fn torn(&mut self, id: u64) {
        // 0: its first packet never came.
        if self.last.is_none() && id != 0 {
            self.last = Some((id, 0));
        }
    }

    /// The place in the sequence of a whole frame with this id, and with this number of the camera's own counter.
    ///
    /// # Errors
    ///
    /// Why it has none: an id that is invalid, or not later than that of the frame
    /// before (a duplicate, or a camera that restarted its count).
    pub fn whole(&mut self, id: u64, counter: Option<u64>) -> Result<u64, String> {
        if id > SHORT_IDS {
            // A camera with extended ids starts at 1 too: only the size tells.
            self.counting = Counting::Long;
        }
        if id == 0 && self.counting == Counting::Short {
            return Err("no valid id".into());
        }
        let ahead = self.last.map_or(Some((0, 0)), |(last, sequence)| Some((self.ahead(id, last)?, sequence)));
        let (ahead, sequence) = match ahead {
            Some(place) => place,
            None if self.is_guess => (0, 0),
            None => return Err("not later than the one before".into()),
        };
        let counted = self.counter.zip(counter).map(|(last, counter)| counter.checked_sub(last));
        if counted == Some(Some(0)) {
            return Err("by the camera's own counter it is the frame before again".into());
        }
        // A counter that goes back began anew, or is shorter than 64 bits: then the id alone counts.
        let counted = counted.flatten().filter(|counted| *counted < FARTHEST).unwrap_or(0);
        let sequence = sequence + ahead.max(counted);
        self.last = Some((id, sequence));
        self.is_guess = false;
        self.counter = counter;
        Ok(sequence)
    }

    /// Frames from one id to a later one; nothing when it is not later.
    fn ahead(&self, id: u64, last: u64) -> Option<u64> {
        match self.counting {
            Counting::Long => id.checked_sub(last).filter(|ahead| (1..FARTHEST).contains(ahead)),
            // The farther half of the circle is the past.
            Counting::Short => {
                let ahead = (id + SHORT_IDS - last) % SHORT_IDS;
                (1..=SHORT_IDS / 2).contains(&ahead).then_some(ahead)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(gige: bool, ids: &[u64]) -> Vec<Option<u64>> {
        let mut frame_ids = FrameIds::new(gige);
        ids.iter().map(|id| frame_ids.whole(*id, None).ok()).collect()
    }

    #[test]
    fn sixteen_bit_ids_go_on_counting_over_the_wrap_and_skip_zero() {
        assert_eq!(sequence(true, &[65_534, 65_535, 1, 2]), [Some(0), Some(1), Some(2), Some(3)]);
    }

    #[test]
    fn three_laps_of_sixteen_bit_ids_are_one_unbroken_count() {
        let mut ids = FrameIds::new(true);
        for count in 0..3 * SHORT_IDS {
            assert_eq!(ids.whole((65_400 + count) % SHORT_IDS + 1, None), Ok(count));
        }
    }

    #[test]
    fn a_gap_in_the_ids_is_the_same_gap_in_the_sequence_over_the_wrap_too() {
        assert_eq!(sequence(true, &[10, 13, 14]), [Some(0), Some(3), Some(4)]);
        assert_eq!(sequence(true, &[65_533, 3]), [Some(0), Some(5)]);
    }

    #[test]
    fn the_past_and_the_invalid_id_have_no_place() {
        assert_eq!(sequence(true, &[100, 99, 100, 0, 101]), [Some(0), None, None, None, Some(1)]);
    }

    #[test]
    fn ids_of_64_bits_do_not_wrap_and_may_start_at_zero() {
        assert_eq!(sequence(false, &[0, 1, 70_000]), [Some(0), Some(1), Some(70_000)]);
        assert_eq!(sequence(true, &[65_535, 65_536, 65_540]), [Some(0), Some(1), Some(5)]);
    }

    #[test]
    fn a_torn_frame_may_begin_the_count_but_its_id_is_not_trusted() {
        let mut ids = FrameIds::new(true);
        ids.torn(0);
        ids.torn(10);
        ids.torn(60_000);
        assert_eq!(ids.whole(12, None), Ok(2));
        ids.torn(30_000);
        assert_eq!(ids.whole(13, None), Ok(3));
        let mut ids = FrameIds::new(true);
        ids.torn(5000);
        assert_eq!(ids.whole(1, None), Ok(0));
        assert_eq!(ids.whole(2, None), Ok(1));
    }

    #[test]
    fn an_id_out_of_all_reach_has_no_place_and_spoils_none() {
        let mut ids = FrameIds::new(true);
        assert_eq!(ids.whole(70_000, None), Ok(0));
        assert!(ids.whole(u64::MAX, None).is_err());
        assert_eq!(ids.whole(70_001, None), Ok(1));
    }

    #[test]
    fn frames_the_camera_never_sent_show_in_its_own_counter() {
        let mut ids = FrameIds::new(true);
        assert_eq!(ids.whole(1, Some(0)), Ok(0));
        assert_eq!(ids.whole(2, Some(1)), Ok(1));
        assert_eq!(ids.whole(3, Some(5)), Ok(5));
        assert_eq!(ids.whole(6, Some(8)), Ok(8));
        assert!(ids.whole(7, Some(8)).is_err());
        // Begun anew.
        assert_eq!(ids.whole(8, Some(0)), Ok(10));
        assert_eq!(ids.whole(9, Some(1)), Ok(11));
    }
}
