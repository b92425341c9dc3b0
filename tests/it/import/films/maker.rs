//! Films whose frames are recognised after any compression.

use ricochet::image::FrameMeta;
use ricochet::import::{self, Footage};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

pub use crate::recording::film::has_ffmpeg;

pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 48;
/// Side of the squares of one grey level that a frame consists of, pixels.
const SQUARE: u32 = 8;

/// The frame with this number: squares of random grey levels.
pub fn frame(number: u32) -> Vec<u8> {
    let level = |x: u32, y: u32| {
        let seed =
            number.wrapping_mul(7919) ^ (x / SQUARE).wrapping_mul(104_729) ^ (y / SQUARE).wrapping_mul(1_299_709);
        let mixed = (seed ^ (seed >> 7)).wrapping_mul(0x9E37_79B1);
        50 + ((mixed >> 16) % 150) as u8
    };
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| level(x, y))).collect()
}

/// A film to be made.
#[derive(Debug, Clone)]
pub struct Film<'a> {
    /// File ending.
    pub ending: &'a str,
    /// Options of the encoder.
    pub codec: &'a str,
    /// Numbers of the frames that are stored.
    pub numbers: Vec<u32>,
    /// Rate, frames per second.
    pub rate: &'a str,
    /// Filters, such as `setpts` for other times.
    pub filters: &'a str,
    /// Layout of the pixels that `pixels` returns.
    pub layout: &'a str,
    /// Size of a frame, pixels.
    pub size: [u32; 2],
}

impl Default for Film<'_> {
    fn default() -> Self {
        Self {
            ending: "mkv",
            codec: "-c:v ffv1",
            numbers: (0..12).collect(),
            rate: "50",
            filters: "null",
            layout: "gray",
            size: [WIDTH, HEIGHT],
        }
    }
}

impl Film<'_> {
    /// Writes the film into a folder.
    pub fn write(&self, folder: &Path) -> PathBuf {
        self.write_pixels(folder, frame)
    }

    /// Writes a film of other frames.
    pub fn write_pixels(&self, folder: &Path, pixels: impl Fn(u32) -> Vec<u8>) -> PathBuf {
        let path = folder.join(format!("film.{}", self.ending));
        let size = format!("{}x{}", self.size[0], self.size[1]);
        let mut ffmpeg = Command::new("ffmpeg")
            .args(["-v", "error", "-y", "-f", "rawvideo", "-pixel_format", self.layout, "-video_size", &size])
            .args(["-framerate", self.rate, "-i", "pipe:0", "-vf", self.filters, "-fps_mode", "passthrough"])
            .args(self.codec.split_whitespace())
            .arg(&path)
            .stdin(Stdio::piped())
            .spawn()
            .unwrap();
        let mut pipe = ffmpeg.stdin.take().unwrap();
        for number in &self.numbers {
            pipe.write_all(&pixels(*number)).unwrap();
        }
        drop(pipe);
        assert!(ffmpeg.wait().unwrap().success(), "{self:?}");
        path
    }
}

pub fn open(path: &Path) -> Footage {
    import::open(&[path.to_path_buf()], None).unwrap_or_else(|error| panic!("{error}"))
}

pub fn frames(footage: Footage) -> Vec<(FrameMeta, Vec<u8>)> {
    footage.map(|frame| frame.unwrap_or_else(|error| panic!("{error}"))).collect()
}

/// The reason why a film is refused.
pub fn refusal(path: &Path) -> String {
    let error = match import::open(&[path.to_path_buf()], None) {
        Err(error) => error,
        Ok(footage) => footage.map(|frame| frame.map(|_| ())).find_map(Result::err).expect("it is refused"),
    };
    error.to_string()
}

/// The number of the drawn frame that is nearest to a decoded one.
pub fn recognised(pixels: &[u8]) -> u32 {
    let distance = |number: &u32| -> u64 {
        frame(*number).iter().zip(pixels).map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum()
    };
    (0..40).min_by_key(distance).unwrap()
}

/// An MP4 or MOV film with another display matrix: `[a, b, c, d]` takes (x, y) to (a x + c y, b x + d y), y down.
pub fn patched_matrix(path: &Path, matrix: [i32; 4]) {
    let mut bytes = std::fs::read(path).unwrap();
    let header = bytes.windows(4).position(|name| name == b"tkhd").unwrap();
    let at = header + 4 + 40;
    for (entry, value) in [0, 1, 3, 4].into_iter().zip(matrix) {
        bytes[at + 4 * entry..][..4].copy_from_slice(&(value << 16).to_be_bytes());
    }
    std::fs::write(path, bytes).unwrap();
}
