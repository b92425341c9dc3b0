//! A trigger on motion in the image.

use crate::image::FrameMeta;

/// Fires when the mean absolute change of grey level from one frame to the next exceeds a threshold.
///
/// It reads every second row of its region. A body that matters covers hundreds of pixels, and the answer must come
/// before the next frame.
#[derive(Debug)]
pub struct MotionTrigger {
    threshold_dn: f64,
    roi_px: Option<[u32; 4]>,
    /// The pixels that are read of the previous frame, row by row without padding.
    previous: Vec<u8>,
    /// Width and height (px) and bytes per pixel of the previous frame.
    shape: (u32, u32, usize),
    /// Whether the change to the previous frame was above the threshold.
    is_above: bool,
}

impl MotionTrigger {
    /// Creates a trigger for changes above `threshold_dn` grey levels within `roi_px` (x, y, width, height; `None` =
    /// all).
    pub fn new(threshold_dn: f64, roi_px: Option<[u32; 4]>) -> Self {
        Self { threshold_dn, roi_px, previous: Vec::new(), shape: (0, 0, 0), is_above: false }
    }

    /// Adds the next frame and returns whether motion begins in it.
    ///
    /// The trigger fires once each time the change rises above the threshold. The first frame, and the first frame of
    /// another shape, are only the reference of the next one.
    pub fn push(&mut self, meta: &FrameMeta, bytes: &[u8]) -> bool {
        let shape = (meta.width_px, meta.height_px, meta.format.bytes_per_pixel());
        if std::mem::replace(&mut self.shape, shape) != shape {
            self.previous.clear();
        }
        let is_above = self.mean_change_dn(meta, bytes) > self.threshold_dn;
        let was_above = std::mem::replace(&mut self.is_above, is_above);
        is_above && !was_above
    }

    /// Returns the mean absolute change since the previous frame, DN, over every second row of the region, and keeps
    /// this frame for the next call.
    ///
    /// The change is 0 where the two cannot be compared.
    fn mean_change_dn(&mut self, meta: &FrameMeta, bytes: &[u8]) -> f64 {
        let pixel_bytes = meta.format.bytes_per_pixel();
        let [x, y, width, height] = self.roi_px.unwrap_or([0, 0, meta.width_px, meta.height_px]);
        let (begin, end) = (x.min(meta.width_px) as usize, (x + width).min(meta.width_px) as usize);
        let columns = begin * pixel_bytes..end * pixel_bytes;
        let (mut sum, mut at) = (0_u64, 0);
        for row in (y..(y + height).min(meta.height_px)).step_by(2) {
            let start = row as usize * meta.stride_bytes as usize;
            let Some(line) = bytes.get(start + columns.start..start + columns.end) else { break };
            match self.previous.get_mut(at..at + line.len()) {
                Some(previous) => {
                    sum += match pixel_bytes {
                        1 => sum_of_changes_8(previous, line),
                        _ => sum_of_changes_16(previous, line),
                    };
                    previous.copy_from_slice(line);
                }
                None => self.previous.extend_from_slice(line),
            }
            at += line.len();
        }
        let is_complete = at == self.previous.len();
        self.previous.truncate(at);
        if is_complete { sum as f64 / (at / pixel_bytes).max(1) as f64 } else { 0.0 }
    }
}

/// Returns the sum of the absolute changes between two rows of 8-bit pixels, DN.
fn sum_of_changes_8(before: &[u8], now: &[u8]) -> u64 {
    // A row has at most 65535 pixels, whose differences fit 32 bits.
    u64::from(before.iter().zip(now).map(|(before, now)| u32::from(before.abs_diff(*now))).sum::<u32>())
}

/// Returns the sum of the absolute changes between two rows of 16-bit pixels (little-endian), DN.
fn sum_of_changes_16(before: &[u8], now: &[u8]) -> u64 {
    let level = |pair: &[u8]| u16::from_le_bytes([pair[0], pair[1]]);
    let pairs = before.chunks_exact(2).zip(now.chunks_exact(2));
    pairs.map(|(before, now)| u64::from(level(before).abs_diff(level(now)))).sum()
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
    fn two_bytes_a_pixel_are_compared_as_one_number() {
        let meta = FrameMeta { stride_bytes: 16, format: crate::image::PixelFormat::Mono12, ..meta() };
        // From 255 to 256: the low byte changes by 255, the grey level by 1.
        let (before, after) = ([255, 0].repeat(64), [0, 1].repeat(64));
        let fires = |threshold_dn: f64| {
            let mut trigger = MotionTrigger::new(threshold_dn, None);
            trigger.push(&meta, &before) || trigger.push(&meta, &after)
        };
        assert!(fires(0.9) && !fires(1.1));
    }

    #[test]
    fn a_short_frame_is_no_motion() {
        let mut trigger = MotionTrigger::new(5.0, None);
        assert!(!trigger.push(&meta(), &[10; 64]));
        assert!(!trigger.push(&meta(), &[200; 7]));
    }
}
