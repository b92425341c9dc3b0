//! A few drawn frames for a measurer that has seen none.

use super::block::Measurer;
use super::error::MeasureError;
use super::outline::BodyParams;
use crate::ball::BallParams;
use crate::image::{Frame, FrameMeta, PixelFormat};

/// Frames that are drawn: in the first a ball is looked for, in the second its motion, then it is followed.
const FRAMES: u64 = 6;
/// Grey levels around the ball, of the ball, and of its speckles, DN.
const LEVELS: [u8; 3] = [30, 180, 90];
/// Side of a speckle, px.
const SPECKLE_PX: usize = 4;

impl Measurer {
    /// Measures a drawn ball and forgets it: memory and instructions that a first frame needs are then there, and it takes
    /// no longer than later ones. What is measured afterwards is the same.
    ///
    /// Without a ball among the bodies, or with a patch, nothing is done.
    ///
    /// # Errors
    ///
    /// As [`Measurer::push`].
    pub fn rehearse(&mut self) -> Result<(), MeasureError> {
        let ball = self.params.bodies.iter().find_map(|body| match body {
            BodyParams::Ball(ball) => Some(ball.clone()),
            _ => None,
        });
        let Some(ball) = ball.filter(|_| !self.needs_reference()) else { return Ok(()) };
        let (width, height) = self.size;
        let mut bytes = vec![0; width * height];
        let mut measured = Vec::new();
        let first = u64::from(self.share.index) * u64::from(self.params.block_frames);
        for frame in 0..FRAMES.min(self.params.block_frames.into()) {
            draw(&ball, self.size, frame as usize, &mut bytes);
            let meta = FrameMeta {
                sequence: first + frame,
                epoch: 0,
                stamp_ns: frame,
                device_ns: 0,
                width_px: width as u32,
                height_px: height as u32,
                stride_bytes: width as u32,
                format: PixelFormat::Mono8,
            };
            self.push(&Frame { meta, bytes: &bytes }, &mut measured)?;
        }
        self.reset();
        Ok(())
    }
}

/// A speckled ball in the middle of where it is looked for, some px to the right.
fn draw(ball: &BallParams, (width, height): (usize, usize), right_px: usize, bytes: &mut [u8]) {
    let [x, y, w, h] = ball.roi_px.unwrap_or([0, 0, width as u32, height as u32]).map(|px| px as usize);
    let (center_x, center_y) = (x + w / 2, y + h / 2);
    let radius = (0.5 * (ball.min_radius_px + ball.max_radius_px)) as usize;
    bytes.fill(LEVELS[0]);
    for y in center_y.saturating_sub(radius)..(center_y + radius + 1).min(height) {
        let row = &mut bytes[y * width..][..width];
        for x in center_x.saturating_sub(radius)..(center_x + radius + 1).min(width.saturating_sub(right_px)) {
            if x.abs_diff(center_x).pow(2) + y.abs_diff(center_y).pow(2) <= radius * radius {
                // Cells are dark by a hash of their place.
                let cell = (x / SPECKLE_PX).wrapping_mul(0x9E37_79B9) ^ (y / SPECKLE_PX).wrapping_mul(0x85EB_CA6B);
                let is_dark = (cell.wrapping_mul(0xC2B2_AE35) >> 16) & 3 == 0;
                row[x + right_px] = LEVELS[if is_dark { 2 } else { 1 }];
            }
        }
    }
}
