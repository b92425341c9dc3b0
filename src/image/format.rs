//! How a camera lays out its pixels.

/// Pixel layout of a raw frame.
///
/// The numbers are the codes of the GenICam Pixel Format Naming Convention, so
/// a header can be read without this library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum PixelFormat {
    /// One byte a pixel.
    #[default]
    Mono8 = 0x0108_0001,
    /// 10 significant bits in a little-endian 16-bit word.
    Mono10 = 0x0110_0003,
    /// 12 significant bits in a little-endian 16-bit word.
    Mono12 = 0x0110_0005,
    /// A little-endian 16-bit word a pixel.
    Mono16 = 0x0110_0007,
}

/// Grey levels at which common sensors saturate, DN.
const SATURATED_LEVELS: [f32; 5] = [255.0, 1023.0, 4095.0, 16383.0, 65535.0];

/// Whether pixels of this level, the highest of a picture, are as bright as a camera tells: brighter ones look alike.
pub fn is_saturated(highest: f32) -> bool {
    SATURATED_LEVELS.iter().any(|level| (level - highest).abs() < 0.5)
}

impl PixelFormat {
    /// Every format this program reads.
    pub const ALL: [Self; 4] = [Self::Mono8, Self::Mono10, Self::Mono12, Self::Mono16];

    /// The name used in configurations and by GenICam.
    pub fn word(self) -> &'static str {
        match self {
            Self::Mono8 => "Mono8",
            Self::Mono10 => "Mono10",
            Self::Mono12 => "Mono12",
            Self::Mono16 => "Mono16",
        }
    }

    /// The format of this name, if there is one.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.word() == word)
    }

    /// The format of this GenICam code, if it is one of ours.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|format| *format as u32 == code)
    }

    /// Bytes one pixel takes in memory.
    pub fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Mono8 => 1,
            Self::Mono10 | Self::Mono12 | Self::Mono16 => 2,
        }
    }

    /// Significant bits, hence the largest grey level `2^bits - 1`.
    pub fn bits(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10 => 10,
            Self::Mono12 => 12,
            Self::Mono16 => 16,
        }
    }
}
