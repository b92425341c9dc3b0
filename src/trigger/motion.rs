//! Something moves in the picture.

use crate::image::FrameMeta;

/// Fires when the mean absolute change of grey level from one frame to the next exceeds a threshold.
///
/// It looks at every second pixel of every second row of its region: a body that
/// matters covers hundreds of pixels, and the answer must come before the next frame.
#[derive(Debug)]
pub struct MotionTrigger {
    threshold_dn: f64,
    roi_px: Option<[u32; 4]>,
    before: Vec<u16>,
    now: Vec<u16>,
    shape: (u32, u32),
    above: bool,
}

impl MotionTrigger {
    /// A trigger for changes above `threshold_dn` digital numbers within `roi_px` (x, y, width, height; `None` = all).
    pub fn new(threshold_dn: f64, roi_px: Option<[u32; 4]>) -> Self {
        Self { threshold_dn, roi_px, before: Vec::new(), now: Vec::new(), shape: (0, 0), above: false }
    }

    /// Looks at the next frame; `true` when motion begins in it.
    ///
    /// It fires once for each time the change rises above the threshold. The
    /// first frame, and the first of another shape, only serve for comparison.
    pub fn push(&mut self, meta: &FrameMeta, bytes: &[u8]) -> bool {
        self.sample(meta, bytes);
        let comparable = self.shape == (meta.width_px, meta.height_px) && self.before.len() == self.now.len();
        let change = if comparable { mean_change(&self.before, &self.now) } else { 0.0 };
        self.shape = (meta.width_px, meta.height_px);
        std::mem::swap(&mut self.before, &mut self.now);
        let above = change > self.threshold_dn;
        let fires = above && !self.above;
        self.above = above;
        fires
    }

    fn sample(&mut self, meta: &FrameMeta, bytes: &[u8]) {
        let [x, y, width, height] = self.roi_px.unwrap_or([0, 0, meta.width_px, meta.height_px]);
        let columns = x..(x + width).min(meta.width_px);
        let size = meta.format.bytes_per_pixel();
        self.now.clear();
        for row in (y..(y + height).min(meta.height_px)).step_by(2) {
            let start = row as usize * meta.stride_bytes as usize;
            let Some(line) = bytes.get(start..start + meta.width_px as usize * size) else { break };
            self.now.extend(columns.clone().step_by(2).map(|column| match size {
                1 => u16::from(line[column as usize]),
                _ => u16::from_le_bytes([line[2 * column as usize], line[2 * column as usize + 1]]),
            }));
        }
    }
}

/// Mean absolute difference, 0 for nothing.
fn mean_change(before: &[u16], now: &[u16]) -> f64 {
    let sum: u64 = before.iter().zip(now).map(|(before, now)| u64::from(before.abs_diff(*now))).sum();
    sum as f64 / before.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meta() -> FrameMeta {
        FrameMeta { width_px: 8, height_px: 8, stride_bytes: 8, ..FrameMeta::default() }
    }

    #[test]
    fn fires_once_when_motion_begins_and_again_after_rest() {
        let mut trigger = MotionTrigger::new(5.0, None);
        let (dark, bright) = ([10; 64], [30; 64]);
        let fired: Vec<bool> =
            [dark, dark, bright, dark, dark, bright].iter().map(|bytes| trigger.push(&meta(), bytes)).collect();
        assert_eq!(fired, [false, false, true, false, false, true]);
    }

    #[test]
    fn change_outside_the_region_or_under_the_threshold_does_not_fire() {
        let mut trigger = MotionTrigger::new(5.0, Some([0, 0, 4, 4]));
        let mut moved = [10; 64];
        moved[32..].fill(200);
        assert!(!trigger.push(&meta(), &[10; 64]));
        assert!(!trigger.push(&meta(), &moved));
        let mut trigger = MotionTrigger::new(5.0, None);
        assert!(!trigger.push(&meta(), &[10; 64]));
        assert!(!trigger.push(&meta(), &[14; 64]));
    }

    #[test]
    fn a_short_frame_is_no_motion() {
        let mut trigger = MotionTrigger::new(5.0, None);
        assert!(!trigger.push(&meta(), &[10; 64]));
        assert!(!trigger.push(&meta(), &[200; 7]));
    }
}
