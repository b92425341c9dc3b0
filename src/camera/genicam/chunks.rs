//! Chunk data: the camera's own timestamp and frame counter behind each image.

use super::device::Device;
use super::feature::Selector;
use super::handle::{Library, Object, checked};
use super::library::discovery_lock;
use super::sys::{ArvBuffer, ArvChunkParser};
use std::ffi::CStr;

/// Registers of the timestamp tick frequency, upper and lower half (GigE Vision bootstrap registers).
const TICKS_REGISTERS: [u64; 2] = [0x93c, 0x940];

/// Maximum difference between `ChunkTimestamp` and the timestamp of the header, which come from one clock, ns.
const MAX_STAMP_DIFFERENCE_NS: u64 = 1_000_000_000;

/// Size of the id and length behind each chunk.
const TAG_BYTES: usize = 8;

/// The values of a frame's chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChunkValues {
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
    /// Timestamp tick frequency, Hz.
    ticks_hz: u64,
    /// Whether the frame header has a timestamp of the same clock.
    has_header_stamp: bool,
    /// Decodes the size of a chunk.
    decode_size: fn([u8; 4]) -> u32,
}

impl Chunks {
    /// Prepares reading the chunks that a camera was set to send; `None` if it sends none.
    ///
    /// # Errors
    ///
    /// The camera's message.
    pub fn from_device(device: &Device) -> Result<Option<Self>, String> {
        if !device.has("ChunkModeActive") || !device.boolean("ChunkModeActive")? {
            return Ok(None);
        }
        let is_on = |chunk: &str| {
            let is_known =
                device.enum_entries("ChunkSelector").is_ok_and(|chunks| chunks.iter().any(|known| known == chunk));
            let selector = Selector { name: "ChunkSelector", entry: chunk };
            is_known && device.has("ChunkEnable") && device.selected_boolean("ChunkEnable", selector).unwrap_or(false)
        };
        let aravis = device.aravis;
        let guard = discovery_lock();
        // SAFETY: an open camera; the parser is ours and has its own copy of the description.
        let parser = unsafe { Object::owned(aravis, aravis.arv_camera_create_chunk_parser(device.camera.as_ptr())) };
        drop(guard);
        let is_gige = device.is_gige();
        // USB3 Vision cameras count in ns, and so does this clock if the camera gives no frequency.
        let ticks_hz = if is_gige { device.ticks_hz().unwrap_or(0) } else { 1_000_000_000 };
        let chunks = Self {
            aravis,
            parser: parser.ok_or("its chunk data cannot be read")?,
            has_stamp: is_on("Timestamp"),
            has_frame_id: is_on("FrameID"),
            ticks_hz: if ticks_hz == 0 { 1_000_000_000 } else { ticks_hz },
            has_header_stamp: ticks_hz != 0,
            decode_size: if is_gige { u32::from_be_bytes } else { u32::from_le_bytes },
        };
        Ok(Some(chunks))
    }

    /// Returns a phrase that describes their use, to follow "the camera".
    pub fn description(&self) -> &'static str {
        match (self.has_stamp, self.has_frame_id) {
            (true, true) => "times frames by their ChunkTimestamp and counts them by their ChunkFrameID",
            (true, false) => "times frames by their ChunkTimestamp",
            (false, true) => "counts frames by their ChunkFrameID",
            (false, false) => "sends chunk data without Timestamp and FrameID, which is not used",
        }
    }

    /// Reads the timestamp and the frame counter in the chunks of a complete frame, if the camera sends them.
    ///
    /// `payload` holds the frame's bytes, `image_bytes` is the expected size of the image at its beginning, and
    /// `header_ns` is the timestamp of its header.
    ///
    /// # Errors
    ///
    /// The reason why the frame does not match the camera's settings.
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
    ) -> Result<ChunkValues, String> {
        match image_chunk_bytes(payload, self.decode_size) {
            Some(bytes) if bytes == image_bytes => {}
            Some(bytes) => return Err(format!("an image of {bytes} bytes instead of {image_bytes}")),
            None => return Err("inconsistent chunk sizes".into()),
        }
        // SAFETY: the caller's promise.
        let integer = |name: &CStr| unsafe { self.integer(buffer, name) };
        let mut values = ChunkValues::default();
        if self.has_frame_id {
            values.frame_id = Some(integer(c"ChunkFrameID")?);
        }
        if self.has_stamp {
            let stamp_ns = ticks_to_ns(integer(c"ChunkTimestamp")?, self.ticks_hz);
            if self.has_header_stamp && stamp_ns.abs_diff(header_ns) > MAX_STAMP_DIFFERENCE_NS {
                return Err(format!("ChunkTimestamp is {stamp_ns} ns, but the header has {header_ns} ns"));
            }
            values.stamp_ns = Some(stamp_ns);
        }
        Ok(values)
    }

    /// Returns the value of one integer chunk, such as `ChunkFrameID`, without its sign.
    ///
    /// # Errors
    ///
    /// The name of the chunk and the library's message.
    ///
    /// # Safety
    ///
    /// See [`read`](Self::read).
    unsafe fn integer(&self, buffer: *mut ArvBuffer, name: &CStr) -> Result<u64, String> {
        let aravis = self.aravis;
        // SAFETY: a live parser, the caller's buffer, a terminated name.
        let value = checked(aravis, |error| unsafe {
            aravis.arv_chunk_parser_get_integer_value(self.parser.as_ptr(), buffer, name.as_ptr(), error)
        })
        .map_err(|reason| format!("{}: {reason}", name.to_string_lossy()))?;
        // The library's integers are signed, a camera's counters are not.
        Ok(value.cast_unsigned())
    }
}

impl Device {
    /// Reads the timestamp tick frequency of a GigE Vision camera, Hz; 0 if the camera gives none.
    ///
    /// # Errors
    ///
    /// The library's message, if the registers cannot be read.
    fn ticks_hz(&self) -> Result<u64, String> {
        let mut halves = [0_u32; 2];
        for (address, half) in TICKS_REGISTERS.into_iter().zip(&mut halves) {
            // SAFETY: an open device, and an integer of ours to write to.
            checked(self.aravis, |error| unsafe {
                self.aravis.arv_device_read_register(self.as_ptr(), address, half, error)
            })?;
        }
        Ok(u64::from(halves[0]) << 32 | u64::from(halves[1]))
    }
}

/// Converts ticks of a clock to ns, rounded down; more than 64 bits can hold become `u64::MAX`.
fn ticks_to_ns(ticks: u64, ticks_hz: u64) -> u64 {
    let whole = u128::from(ticks) * 1_000_000_000 / u128::from(ticks_hz.max(1));
    u64::try_from(whole).unwrap_or(u64::MAX)
}

/// Returns the size of the first chunk, which is the image; `None` if the chunk sizes are inconsistent.
///
/// Each chunk has its id and its size behind it, so the chunks are followed from the end. `decode_size` decodes a size
/// in the byte order of the camera.
fn image_chunk_bytes(payload: &[u8], decode_size: fn([u8; 4]) -> u32) -> Option<usize> {
    let mut end = payload.len();
    loop {
        let tag = end.checked_sub(TAG_BYTES)?;
        let size = decode_size(payload[tag + 4..end].try_into().ok()?) as usize;
        end = tag.checked_sub(size)?;
        if end == 0 {
            return Some(size);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a chunk of `bytes` bytes with its tag, which states a size of `stated` bytes.
    fn chunk(bytes: usize, stated: u32) -> Vec<u8> {
        [vec![9; bytes], 5_u32.to_be_bytes().to_vec(), stated.to_be_bytes().to_vec()].concat()
    }

    #[test]
    fn the_image_is_the_first_chunk() {
        let payload = [chunk(100, 100), chunk(8, 8), chunk(0, 0), chunk(4, 4)].concat();
        assert_eq!(image_chunk_bytes(&payload, u32::from_be_bytes), Some(100));
        assert_eq!(image_chunk_bytes(&chunk(100, 100), u32::from_be_bytes), Some(100));
    }

    #[test]
    fn inconsistent_chunk_sizes_are_detected() {
        for payload in [
            vec![],
            vec![0; 7],
            chunk(100, 101),
            [chunk(100, 100), chunk(8, 9)].concat(),
            [chunk(100, 100), chunk(8, u32::MAX)].concat(),
            [chunk(100, 100), vec![0xff; 5]].concat(),
        ] {
            assert_eq!(image_chunk_bytes(&payload, u32::from_be_bytes), None, "{} bytes", payload.len());
        }
    }

    #[test]
    fn ticks_of_any_clock_become_nanoseconds_without_overflow() {
        assert_eq!(ticks_to_ns(125_000_000, 125_000_000), 1_000_000_000);
        assert_eq!(ticks_to_ns(7, 1_000_000_000), 7);
        assert_eq!(ticks_to_ns(u64::MAX, 1_000_000_000), u64::MAX);
        assert_eq!(ticks_to_ns(u64::MAX / 2, 1), u64::MAX);
    }
}
