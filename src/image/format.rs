//! Pixel formats of cameras.

use crate::results::named_enum;

named_enum! {
    /// The pixel layout of a raw frame.
    ///
    /// The numbers are the codes of the GenICam Pixel Format Naming Convention, so that a header can be read without
    /// this library. The names are GenICam's.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::image::PixelFormat;
    ///
    /// let format: PixelFormat = "Mono12".parse()?;
    /// assert_eq!((format.bytes_per_pixel(), format.bits()), (2, 12));
    /// let max_level_dn = (1 << format.bits()) - 1;
    /// assert_eq!(max_level_dn, 4095);
    /// # Ok::<(), ricochet::results::UnknownName>(())
    /// ```
    #[derive(Default)]
    PixelFormat: "pixel format" {
        /// One byte per pixel.
        #[default]
        Mono8 = 0x0108_0001 "Mono8",
        /// 10 significant bits in a little-endian 16-bit word.
        Mono10 = 0x0110_0003 "Mono10",
        /// 12 significant bits in a little-endian 16-bit word.
        Mono12 = 0x0110_0005 "Mono12",
        /// One little-endian 16-bit word per pixel.
        Mono16 = 0x0110_0007 "Mono16",
    }
}

/// The grey levels at which common sensors saturate, DN.
const SATURATED_LEVELS: [f32; 5] = [255.0, 1023.0, 4095.0, 16383.0, 65535.0];

/// Whether `highest`, the highest grey level of an image (DN), is the full scale of 8, 10, 12, 14 or 16 bit.
///
/// Brighter pixels would look the same. The level may differ from full scale by less than 0.5 DN.
pub fn is_saturated(highest: f32) -> bool {
    SATURATED_LEVELS.iter().any(|level| (level - highest).abs() < 0.5)
}

impl PixelFormat {
    /// Returns the number of bytes per pixel.
    pub fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Mono8 => 1,
            Self::Mono10 | Self::Mono12 | Self::Mono16 => 2,
        }
    }

    /// Returns the number of significant bits. The maximum grey level is `2^bits - 1`.
    pub fn bits(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10 => 10,
            Self::Mono12 => 12,
            Self::Mono16 => 16,
        }
    }
}
