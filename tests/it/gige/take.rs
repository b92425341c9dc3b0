//! The product's own camera, looking at what is sent.

use super::camera::FRAME_BYTES;
use crate::genicam::draw;
use crate::slots::Slots;
use ricochet::camera::genicam::{GenicamCamera, GenicamSettings};
use ricochet::camera::{Camera, CameraError, Next};
use ricochet::image::FrameMeta;
use std::time::{Duration, Instant};

/// Longest wait for a frame; only a failing test waits that long.
const PATIENCE: Duration = Duration::from_secs(10);

/// More than any of these tests leaves lying.
const SLOTS: usize = 512;

/// What came.
#[derive(Debug, Default)]
pub struct Taken {
    /// Whole frames, with the index that their pixels hold.
    pub whole: Vec<(FrameMeta, u64)>,
    /// Why others were not whole.
    pub torn: Vec<String>,
}

impl Taken {
    /// Sequence and index of the whole frames.
    pub fn places(&self) -> Vec<(u64, u64)> {
        self.whole.iter().map(|(meta, index)| (meta.sequence, *index)).collect()
    }

    /// Indices of the whole frames.
    pub fn indices(&self) -> Vec<u64> {
        self.whole.iter().map(|(_, index)| *index).collect()
    }
}

/// An open and started camera with its slots.
pub struct Eye {
    // Dropped before the memory it writes to.
    pub camera: GenicamCamera,
    slots: Slots,
    image: Vec<u8>,
}

impl Eye {
    pub fn open(settings: &GenicamSettings) -> Self {
        Self::try_open(settings).unwrap()
    }

    pub fn try_open(settings: &GenicamSettings) -> Result<Self, CameraError> {
        let mut camera = GenicamCamera::open(settings)?;
        let bytes = camera.format().slot_bytes();
        let mut slots = Slots::new(SLOTS, bytes + 64);
        slots.queue_all(&mut camera);
        let mut eye = Self { camera, slots, image: vec![0; bytes] };
        eye.camera.start()?;
        Ok(eye)
    }

    /// What comes until so many frames came, whole or torn.
    pub fn take(&mut self, frames: usize) -> Taken {
        let (mut taken, deadline) = (Taken::default(), Instant::now() + PATIENCE);
        while taken.whole.len() + taken.torn.len() < frames && Instant::now() < deadline {
            self.look(&mut taken, Duration::from_millis(250)).unwrap();
        }
        taken
    }

    /// What comes until nothing comes any more.
    pub fn take_all(&mut self) -> Result<Taken, CameraError> {
        let mut taken = Taken::default();
        // Longer than the library keeps a frame that is not complete.
        while self.look(&mut taken, Duration::from_millis(250))? {}
        Ok(taken)
    }

    /// What is there now.
    pub fn take_now(&mut self) -> Result<Taken, CameraError> {
        let mut taken = Taken::default();
        while self.look(&mut taken, Duration::ZERO)? {}
        Ok(taken)
    }

    /// Waits for one frame; a whole one is compared with what it says it is, byte for byte.
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
            Next::Torn(slot, cause) => {
                taken.torn.push(cause);
                self.slots.give_back(slot, &mut self.camera);
            }
            Next::Nothing => return Ok(false),
            Next::End => panic!("a live camera does not end"),
        }
        Ok(true)
    }
}

#[test]
fn the_frames_of_these_tests_have_the_size_they_say() {
    assert_eq!(FRAME_BYTES, 8192);
}
