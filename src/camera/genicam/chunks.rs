//! What a camera sends behind each picture: its own time and number of the frame (chunk data).

use super::device::Device;
use super::handle::{Library, Object, checked};
use super::library::one_at_a_time;
use super::sys::{ArvBuffer, ArvChunkParser};
use std::ffi::CStr;

/// Registers of the clock's ticks a second, upper and lower half (GigE Vision bootstrap registers).
const TICKS_REGISTERS: [u64; 2] = [0x93c, 0x940];

/// A frame's own stamp and that of its header come from one clock, and are taken within this.
const AGREEMENT_NS: u64 = 1_000_000_000;

/// Id and size behind each chunk.
const TAG_BYTES: usize = 8;

/// What chunks of a frame told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Told {
    /// `ChunkTimestamp`, ns.
    pub stamp_ns: Option<u64>,
    /// `ChunkFrameID`.
    pub frame_id: Option<u64>,
}

/// Reads the chunks of a camera whose settings are final.
#[derive(Debug)]
pub struct Chunks {
    aravis: Library,
    parser: Object<ArvChunkParser>,
    has_stamp: bool,
    has_frame_id: bool,
    /// Ticks of the stamps a second.
    ticks_hz: u64,
    /// Whether a frame's header tells the same clock's time.
    has_header_stamp: bool,
    is_big_endian: bool,
}

impl Chunks {
    /// The chunks a camera was set to send; nothing when it sends none.
    ///
    /// # Errors
    ///
    /// The camera's words.
    pub fn of(device: &Device) -> Result<Option<Self>, String> {
        if !device.has("ChunkModeActive") || !device.boolean("ChunkModeActive")? {
            return Ok(None);
        }
        let is_on = |chunk: &str| {
            let chunks = device.words("ChunkSelector").unwrap_or_default();
            let is_known = chunks.iter().any(|known| known == chunk) && device.has("ChunkEnable");
            is_known && device.boolean_of("ChunkEnable", "ChunkSelector", chunk).unwrap_or(false)
        };
        let aravis = device.aravis;
        let turn = one_at_a_time();
        // SAFETY: an open camera; the parser is made for us and has a description of its own.
        let parser = unsafe { Object::owned(aravis, aravis.arv_camera_create_chunk_parser(device.camera.as_ptr())) };
        drop(turn);
        let is_gige = device.is_gige();
        // Other cameras count in ns, and so does this clock where it does not tell.
        let ticks_hz = if is_gige { device.ticks_hz().unwrap_or(0) } else { 1_000_000_000 };
        let chunks = Self {
            aravis,
            parser: parser.ok_or("its chunk data cannot be read")?,
            has_stamp: is_on("Timestamp"),
            has_frame_id: is_on("FrameID"),
            ticks_hz: if ticks_hz == 0 { 1_000_000_000 } else { ticks_hz },
            has_header_stamp: ticks_hz != 0,
            is_big_endian: is_gige,
        };
        Ok(Some(chunks))
    }

    /// What they tell of each frame, for a person.
    pub fn words(&self) -> &'static str {
        match (self.has_stamp, self.has_frame_id) {
            (true, true) => "times frames by their ChunkTimestamp and counts them by their ChunkFrameID",
            (true, false) => "times frames by their ChunkTimestamp",
            (false, true) => "counts frames by their ChunkFrameID",
            (false, false) => "sends chunk data without Timestamp and FrameID, which is not used",
        }
    }

    /// Reads the chunks of a whole frame.
    ///
    /// `payload` are its bytes, `image_bytes` what the picture in front must have,
    /// `header_ns` the stamp of its header.
    ///
    /// # Errors
    ///
    /// Why the frame is not what it was set to be.
    ///
    /// # Safety
    ///
    /// `buffer` is a filled buffer of the stream that nobody else touches.
    pub unsafe fn read(
        &self,
        buffer: *mut ArvBuffer,
        payload: &[u8],
        image_bytes: usize,
        header_ns: u64,
    ) -> Result<Told, String> {
        match first_bytes(payload, self.is_big_endian) {
            Some(bytes) if bytes == image_bytes => {}
            Some(bytes) => return Err(format!("a picture of {bytes} bytes of {image_bytes} before its chunks")),
            None => return Err("chunks that do not fit together".into()),
        }
        // SAFETY: the caller's promise.
        let value = |name: &CStr| unsafe { self.value(buffer, name) };
        let mut told = Told::default();
        if self.has_frame_id {
            told.frame_id = Some(value(c"ChunkFrameID")?);
        }
        if self.has_stamp {
            let stamp_ns = nanoseconds(value(c"ChunkTimestamp")?, self.ticks_hz);
            if self.has_header_stamp && stamp_ns.abs_diff(header_ns) > AGREEMENT_NS {
                return Err(format!("its ChunkTimestamp tells {stamp_ns} ns, its header {header_ns} ns"));
            }
            told.stamp_ns = Some(stamp_ns);
        }
        Ok(told)
    }

    /// # Safety
    ///
    /// As [`read`](Self::read).
    unsafe fn value(&self, buffer: *mut ArvBuffer, name: &CStr) -> Result<u64, String> {
        let aravis = self.aravis;
        // SAFETY: a live parser, the caller's buffer, a terminated name.
        let value = checked(aravis, |error| unsafe {
            aravis.arv_chunk_parser_get_integer_value(self.parser.as_ptr(), buffer, name.as_ptr(), error)
        })
        .map_err(|reason| format!("{}: {reason}", name.to_string_lossy()))?;
        // The library's integers have a sign, a camera's counters have none.
        Ok(value.cast_unsigned())
    }
}

impl Device {
    /// Ticks of its clock a second; 0 when it does not tell.
    fn ticks_hz(&self) -> Result<u64, String> {
        let mut halves = [0_u32; 2];
        for (address, half) in TICKS_REGISTERS.into_iter().zip(&mut halves) {
            // SAFETY: an open device and a number of ours to write to.
            checked(self.aravis, |error| unsafe {
                self.aravis.arv_device_read_register(self.as_ptr(), address, half, error)
            })?;
        }
        Ok(u64::from(halves[0]) << 32 | u64::from(halves[1]))
    }
}

fn nanoseconds(ticks: u64, ticks_hz: u64) -> u64 {
    let whole = u128::from(ticks) * 1_000_000_000 / u128::from(ticks_hz.max(1));
    u64::try_from(whole).unwrap_or(u64::MAX)
}

/// Size of the first chunk, the picture: each has its size behind it, so they are followed from the end.
///
/// Nothing when they do not lead to the beginning.
fn first_bytes(payload: &[u8], is_big_endian: bool) -> Option<usize> {
    let mut end = payload.len();
    loop {
        let tag = end.checked_sub(TAG_BYTES)?;
        let size: [u8; 4] = payload[tag + 4..end].try_into().ok()?;
        let size = if is_big_endian { u32::from_be_bytes(size) } else { u32::from_le_bytes(size) } as usize;
        end = tag.checked_sub(size)?;
        if end == 0 {
            return Some(size);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk(bytes: usize, told: u32) -> Vec<u8> {
        [vec![9; bytes], 5_u32.to_be_bytes().to_vec(), told.to_be_bytes().to_vec()].concat()
    }

    #[test]
    fn the_picture_is_the_chunk_that_the_others_lead_to() {
        let payload = [chunk(100, 100), chunk(8, 8), chunk(0, 0), chunk(4, 4)].concat();
        assert_eq!(first_bytes(&payload, true), Some(100));
        assert_eq!(first_bytes(&chunk(100, 100), true), Some(100));
    }

    #[test]
    fn chunks_that_do_not_lead_to_the_beginning_are_found() {
        for payload in [
            vec![],
            vec![0; 7],
            chunk(100, 101),
            [chunk(100, 100), chunk(8, 9)].concat(),
            [chunk(100, 100), chunk(8, u32::MAX)].concat(),
            [chunk(100, 100), vec![0xff; 5]].concat(),
        ] {
            assert_eq!(first_bytes(&payload, true), None, "{} bytes", payload.len());
        }
    }

    #[test]
    fn ticks_of_any_clock_become_nanoseconds_without_overflow() {
        assert_eq!(nanoseconds(125_000_000, 125_000_000), 1_000_000_000);
        assert_eq!(nanoseconds(7, 1_000_000_000), 7);
        assert_eq!(nanoseconds(u64::MAX, 1_000_000_000), u64::MAX);
        assert_eq!(nanoseconds(u64::MAX / 2, 1), u64::MAX);
    }
}
