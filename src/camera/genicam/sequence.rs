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

/// Unwraps the ids of one stream into a sequence that starts at 0 with the first id seen.
///
/// A gap in the ids is the same gap in the sequence, so each lost frame shows. A
/// silence of 32768 frames or more in 16-bit ids cannot be told from a step back:
/// the wire does not say more.
#[derive(Debug)]
pub struct FrameIds {
    counting: Counting,
    last: Option<(u64, u64)>,
}

impl FrameIds {
    /// For a stream whose ids may have 16 bits (GigE Vision) or always have 64 (USB3 Vision).
    pub fn new(gige: bool) -> Self {
        Self { counting: if gige { Counting::Short } else { Counting::Long }, last: None }
    }

    /// The place in the sequence of the frame with this id.
    ///
    /// Nothing when the id says nothing: 0 where it is invalid, or not later than
    /// the frame before (a duplicate, or a camera that restarted its count).
    pub fn unwrap_id(&mut self, id: u64) -> Option<u64> {
        if id > SHORT_IDS {
            // A camera with extended ids starts at 1 too: only the size tells.
            self.counting = Counting::Long;
        }
        if id == 0 && self.counting == Counting::Short {
            return None;
        }
        let Some((last_id, last_sequence)) = self.last else {
            self.last = Some((id, 0));
            return Some(0);
        };
        let ahead = match self.counting {
            Counting::Long => id.checked_sub(last_id)?,
            Counting::Short => (id + SHORT_IDS - last_id) % SHORT_IDS,
        };
        // The farther half of the circle is the past.
        if ahead == 0 || (self.counting == Counting::Short && ahead > SHORT_IDS / 2) {
            return None;
        }
        self.last = Some((id, last_sequence + ahead));
        Some(last_sequence + ahead)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(gige: bool, ids: &[u64]) -> Vec<Option<u64>> {
        let mut frame_ids = FrameIds::new(gige);
        ids.iter().map(|id| frame_ids.unwrap_id(*id)).collect()
    }

    #[test]
    fn sixteen_bit_ids_go_on_counting_over_the_wrap_and_skip_zero() {
        assert_eq!(sequence(true, &[65_534, 65_535, 1, 2]), [Some(0), Some(1), Some(2), Some(3)]);
    }

    #[test]
    fn three_laps_of_sixteen_bit_ids_are_one_unbroken_count() {
        let mut ids = FrameIds::new(true);
        for count in 0..3 * SHORT_IDS {
            assert_eq!(ids.unwrap_id((65_400 + count) % SHORT_IDS + 1), Some(count));
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
}
