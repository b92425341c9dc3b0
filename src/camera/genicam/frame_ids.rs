//! Conversion of frame ids, which may wrap, to a sequence number.

/// Number of ids before GigE Vision 2: they have 16 bits and are never 0.
const SHORT_IDS: u64 = 65_535;

/// The range of a stream's ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counting {
    /// From 1 to 65535, then 1 again; larger ids show that the stream has 64-bit ids.
    Short,
    /// 64 bits.
    Long,
}

/// Maximum gap in the ids; ids farther ahead are invalid.
const MAX_GAP: u64 = 1 << 32;

/// Converts the ids of one stream to a sequence that starts at 0 with the first id.
///
/// A gap in the ids is the same gap in the sequence, so every lost frame shows. In 16-bit ids, a gap of 32768 frames or
/// more cannot be distinguished from a step back.
///
/// A frame counter in the chunk data also shows frames that the camera captured and never sent. Of the two gaps the
/// larger counts.
#[derive(Debug)]
pub struct FrameIds {
    counting: Counting,
    /// Id and sequence number of the newest frame.
    last: Option<(u64, u64)>,
    /// Whether only incomplete frames were received so far, whose ids may be damaged too.
    is_provisional: bool,
    /// The camera's own counter at the newest complete frame, if it sends one.
    counter: Option<u64>,
}

impl FrameIds {
    /// Starts a count: short for ids that may have 16 bits (GigE Vision), long for ids of 64 bits (USB3 Vision).
    pub fn new(counting: Counting) -> Self {
        Self { counting, last: None, is_provisional: true, counter: None }
    }

    /// Records an incomplete frame with this id, 0 if unknown. The sequence may begin with it but never continues from
    /// it: only the first id is kept.
    pub fn add_incomplete(&mut self, id: u64) {
        // 0: its first packet was lost.
        if self.last.is_none() && id != 0 {
            self.last = Some((id, 0));
        }
    }

    /// Returns the sequence number of a complete frame with this id, and records both.
    ///
    /// `counter` is the camera's own count of frames; `None` if it sends none.
    ///
    /// # Errors
    ///
    /// The reason why it has none: an invalid id, or one that is not later than the previous frame's (a duplicate, or a
    /// camera that restarted its count).
    pub fn add_complete(&mut self, id: u64, counter: Option<u64>) -> Result<u64, String> {
        if id > SHORT_IDS {
            // A camera with extended ids starts at 1 too, so only a large id distinguishes them.
            self.counting = Counting::Long;
        }
        if id == 0 && self.counting == Counting::Short {
            return Err("invalid id 0".into());
        }
        let ahead = self.last.map_or(Some((0, 0)), |(last, sequence)| Some((self.frames_ahead(id, last)?, sequence)));
        let (ahead, sequence) = match ahead {
            Some(ahead) => ahead,
            None if self.is_provisional => (0, 0),
            None => return Err("not later than the previous frame".into()),
        };
        let counted = self.counter.zip(counter).map(|(last, counter)| counter.checked_sub(last));
        if counted == Some(Some(0)) {
            return Err("its own counter repeats that of the previous frame".into());
        }
        // A counter that steps back was reset or has less than 64 bits: then the id alone counts.
        let counted = counted.flatten().filter(|counted| *counted < MAX_GAP).unwrap_or(0);
        let sequence = sequence + ahead.max(counted);
        self.last = Some((id, sequence));
        self.is_provisional = false;
        self.counter = counter;
        Ok(sequence)
    }

    /// Returns the number of frames from the id `last` to a later `id`.
    ///
    /// `None` if it is not later, or [`MAX_GAP`] or more ahead; of short ids, the farther half counts as earlier.
    fn frames_ahead(&self, id: u64, last: u64) -> Option<u64> {
        match self.counting {
            Counting::Long => id.checked_sub(last).filter(|ahead| (1..MAX_GAP).contains(ahead)),
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

    fn sequence(counting: Counting, ids: &[u64]) -> Vec<Option<u64>> {
        let mut frame_ids = FrameIds::new(counting);
        ids.iter().map(|id| frame_ids.add_complete(*id, None).ok()).collect()
    }

    #[test]
    fn sixteen_bit_ids_go_on_counting_over_the_wrap_and_skip_zero() {
        assert_eq!(sequence(Counting::Short, &[65_534, 65_535, 1, 2]), [Some(0), Some(1), Some(2), Some(3)]);
    }

    #[test]
    fn three_laps_of_sixteen_bit_ids_are_one_unbroken_count() {
        let mut ids = FrameIds::new(Counting::Short);
        for count in 0..3 * SHORT_IDS {
            assert_eq!(ids.add_complete((65_400 + count) % SHORT_IDS + 1, None), Ok(count));
        }
    }

    #[test]
    fn a_gap_in_the_ids_is_the_same_gap_in_the_sequence_over_the_wrap_too() {
        assert_eq!(sequence(Counting::Short, &[10, 13, 14]), [Some(0), Some(3), Some(4)]);
        assert_eq!(sequence(Counting::Short, &[65_533, 3]), [Some(0), Some(5)]);
    }

    #[test]
    fn the_past_and_the_invalid_id_have_no_place() {
        assert_eq!(sequence(Counting::Short, &[100, 99, 100, 0, 101]), [Some(0), None, None, None, Some(1)]);
    }

    #[test]
    fn ids_of_64_bits_do_not_wrap_and_may_start_at_zero() {
        assert_eq!(sequence(Counting::Long, &[0, 1, 70_000]), [Some(0), Some(1), Some(70_000)]);
        assert_eq!(sequence(Counting::Short, &[65_535, 65_536, 65_540]), [Some(0), Some(1), Some(5)]);
    }

    #[test]
    fn a_torn_frame_may_begin_the_count_but_its_id_is_not_trusted() {
        let mut ids = FrameIds::new(Counting::Short);
        ids.add_incomplete(0);
        ids.add_incomplete(10);
        ids.add_incomplete(60_000);
        assert_eq!(ids.add_complete(12, None), Ok(2));
        ids.add_incomplete(30_000);
        assert_eq!(ids.add_complete(13, None), Ok(3));
        let mut ids = FrameIds::new(Counting::Short);
        ids.add_incomplete(5000);
        assert_eq!(ids.add_complete(1, None), Ok(0));
        assert_eq!(ids.add_complete(2, None), Ok(1));
    }

    #[test]
    fn an_id_out_of_all_reach_has_no_place_and_spoils_none() {
        let mut ids = FrameIds::new(Counting::Short);
        assert_eq!(ids.add_complete(70_000, None), Ok(0));
        assert!(ids.add_complete(u64::MAX, None).is_err());
        assert_eq!(ids.add_complete(70_001, None), Ok(1));
    }

    #[test]
    fn frames_the_camera_never_sent_show_in_its_own_counter() {
        let mut ids = FrameIds::new(Counting::Short);
        assert_eq!(ids.add_complete(1, Some(0)), Ok(0));
        assert_eq!(ids.add_complete(2, Some(1)), Ok(1));
        assert_eq!(ids.add_complete(3, Some(5)), Ok(5));
        assert_eq!(ids.add_complete(6, Some(8)), Ok(8));
        assert!(ids.add_complete(7, Some(8)).is_err());
        // The counter was reset.
        assert_eq!(ids.add_complete(8, Some(0)), Ok(10));
        assert_eq!(ids.add_complete(9, Some(1)), Ok(11));
    }
}
