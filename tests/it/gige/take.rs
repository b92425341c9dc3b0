//! The program's own camera, receiving what is sent.

use super::camera::FRAME_BYTES;
use crate::genicam::draw;
use crate::slots::Slots;
use ricochet::camera::genicam::GenicamCamera;
use ricochet::camera::{Camera, CameraError, Next};
use ricochet::config;
use ricochet::image::FrameMeta;
use std::time::{Duration, Instant};

/// The longest wait of a failing test for a frame.
const PATIENCE: Duration = Duration::from_secs(10);

/// More slots than any of these tests leaves unread.
const SLOTS: usize = 512;

/// Received frames.
#[derive(Debug, Default)]
pub struct Taken {
    /// Complete frames, with the index in their pixels.
    pub whole: Vec<(FrameMeta, u64)>,
    /// The reasons of the torn ones.
    pub torn: Vec<String>,
}

impl Taken {
    /// Sequence and index of the complete frames.
    pub fn places(&self) -> Vec<(u64, u64)> {
        self.whole.iter().map(|(meta, index)| (meta.sequence, *index)).collect()
    }

    /// Indices of the complete frames.
    pub fn indices(&self) -> Vec<u64> {
        self.whole.iter().map(|(_, index)| *index).collect()
    }
}

/// An open and started camera with its slots.
pub struct Eye {
    // Dropped before the memory that it writes to.
    pub camera: GenicamCamera,
    slots: Slots,
    image: Vec<u8>,
}

impl Eye {
    pub fn open(settings: &config::Camera) -> Self {
        Self::try_open(settings).unwrap()
    }

    pub fn try_open(settings: &config::Camera) -> Result<Self, CameraError> {
        let mut camera = GenicamCamera::open(settings)?;
        let bytes = camera.format().slot_bytes();
        let mut slots = Slots::new(SLOTS, bytes + 64);
        slots.queue_all(&mut camera);
        let mut eye = Self { camera, slots, image: vec![0; bytes] };
        eye.camera.start()?;
        Ok(eye)
    }

    /// Receives until there are this many frames, complete or torn.
    pub fn take(&mut self, frames: usize) -> Taken {
        let (mut taken, deadline) = (Taken::default(), Instant::now() + PATIENCE);
        while taken.whole.len() + taken.torn.len() < frames && Instant::now() < deadline {
            self.look(&mut taken, Duration::from_millis(250)).unwrap();
        }
        taken
    }

    /// Receives until nothing more arrives.
    pub fn take_all(&mut self) -> Result<Taken, CameraError> {
        let mut taken = Taken::default();
        // Longer than the library keeps an incomplete frame.
        while self.look(&mut taken, Duration::from_millis(250))? {}
        Ok(taken)
    }

    /// Receives what is there now.
    pub fn take_now(&mut self) -> Result<Taken, CameraError> {
        let mut taken = Taken::default();
        while self.look(&mut taken, Duration::ZERO)? {}
        Ok(taken)
    }

    /// Waits for one frame and compares a complete one byte for byte with the frame of its index.
    fn look(&mut self, taken: &mut Taken, patience: Duration) -> Result<bool, CameraError> {
        match self.camera.next(patience)? {
            Next::Frame(mut slot, meta) => {
                let (pixels, beyond) = slot.bytes_mut().split_at(meta.size_bytes());
                let index = u64::from_le_bytes(pixels[..8].try_into().unwrap());
                draw(index, &mut self.image);
                assert!(pixels == self.image, "frame {index} differs from what was sent");
                assert!(beyond.iter().all(|byte| *byte == Slots::JUNK), "written beyond frame {index}");
                taken.whole.push((meta, index));
                self.slots.give_back(slot, &mut self.camera);
            }
            Next::Incomplete(slot, cause) => {
                taken.torn.push(cause);
                self.slots.give_back(slot, &mut self.camera);
            }
            Next::Timeout => return Ok(false),
            Next::End => panic!("a live camera does not end"),
        }
        Ok(true)
    }
}

#[test]
fn the_frames_of_these_tests_have_the_size_of_their_format() {
    assert_eq!(FRAME_BYTES, 8192);
}
