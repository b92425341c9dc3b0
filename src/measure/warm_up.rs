//! Warm-up of a measurer with a few drawn frames.

use super::error::MeasureError;
use super::measurer::Measurer;
use super::params::{BodyParams, ImageSize};
use crate::ball::BallParams;
use crate::image::{Frame, FrameMeta, PixelFormat};

/// The number of drawn frames: a ball is found in the first, its motion in the second, then it is followed.
const WARM_UP_FRAMES: u64 = 6;
/// The grey levels of the background, the ball and its speckles, DN.
const LEVELS_DN: [u8; 3] = [30, 180, 90];
/// The side of a speckle, px.
const SPECKLE_PX: usize = 4;

impl Measurer {
    /// Measures a drawn ball and discards the results, so that the first real frame takes no longer than later ones.
    ///
    /// Memory is then allocated and code is cached. Later results do not change. Does nothing without a ball or with a
    /// patch.
    ///
    /// # Errors
    ///
    /// See [`Measurer::push`].
    pub fn warm_up(&mut self) -> Result<(), MeasureError> {
        let ball = self.params.bodies.iter().find_map(|body| match body {
            BodyParams::Ball(ball) => Some(ball.clone()),
            _ => None,
        });
        let Some(ball) = ball.filter(|_| !self.needs_reference()) else { return Ok(()) };
        let ImageSize { width, height } = self.size;
        let mut bytes = vec![0; width * height];
        let mut measured = Vec::new();
        let first = u64::from(self.share.index) * u64::from(self.params.block_frames);
        for frame in 0..WARM_UP_FRAMES.min(self.params.block_frames.into()) {
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

/// Draws a speckled ball in the middle of its search region, shifted to the right by some pixels.
fn draw(ball: &BallParams, size: ImageSize, right_px: usize, bytes: &mut [u8]) {
    let ImageSize { width, height } = size;
    let [x, y, w, h] = ball.roi_px.unwrap_or([0, 0, width as u32, height as u32]).map(|px| px as usize);
    let (center_x, center_y) = (x + w / 2, y + h / 2);
    let radius = (0.5 * (ball.min_radius_px + ball.max_radius_px)) as usize;
    bytes.fill(LEVELS_DN[0]);
    for y in center_y.saturating_sub(radius)..(center_y + radius + 1).min(height) {
        let row = &mut bytes[y * width..][..width];
        for x in center_x.saturating_sub(radius)..(center_x + radius + 1).min(width.saturating_sub(right_px)) {
            if x.abs_diff(center_x).pow(2) + y.abs_diff(center_y).pow(2) <= radius * radius {
                // The cells are dark according to a hash of their position.
                let cell = (x / SPECKLE_PX).wrapping_mul(0x9E37_79B9) ^ (y / SPECKLE_PX).wrapping_mul(0x85EB_CA6B);
                let is_dark = (cell.wrapping_mul(0xC2B2_AE35) >> 16) & 3 == 0;
                row[x + right_px] = LEVELS_DN[if is_dark { 2 } else { 1 }];
            }
        }
    }
}
