//! The pixels of a page: stored samples to grey levels.

use crate::image::PixelFormat;
use crate::import::shape::Shape;
use crate::import::still::DisplayInfo;
use crate::import::{ImportError, Orientation, grey, unpack_msb_first};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use tiff::decoder::Decoder;
use tiff::decoder::ifd::Value;
use tiff::tags::{ByteOrder, SampleFormat, Tag};
use tiff::{ColorType, TiffError, TiffResult};

type Tiff = Decoder<BufReader<File>>;

/// `Compression` without any.
const UNCOMPRESSED: u32 = 1;
/// `PhotometricInterpretation` of negatives.
const WHITE_IS_ZERO: u32 = 0;
/// `PhotometricInterpretation` of indices into a table of colours.
const PALETTE: u32 = 3;

/// The meaning of the samples of a pixel.
#[derive(Debug, Clone, PartialEq)]
enum Colors {
    /// A grey level, followed by samples that are left out.
    Grey,
    /// Red, green and blue, followed by samples that are left out.
    Rgb,
    /// An index into a table of grey levels.
    Palette(Vec<u16>),
}

/// The layout of a page.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Page {
    width_px: u32,
    height_px: u32,
    /// Bits and number of the samples of a pixel.
    bits: u32,
    samples: usize,
    colors: Colors,
    /// Number of planes; 1 when the samples of a pixel follow each other.
    planes: usize,
    is_swapped: bool,
    /// Whether the samples are read as they are stored, because the decoder does not read them.
    is_stored: bool,
}

impl Page {
    /// Reads the layout of the current page; the inner error is the reason why it cannot be measured.
    pub(super) fn new(decoder: &mut Tiff) -> TiffResult<Result<Self, String>> {
        if decoder.find_tag_unsigned::<u32>(Tag::PhotometricInterpretation)? == Some(PALETTE) {
            return Self::from_palette(decoder);
        }
        let (width_px, height_px) = decoder.dimensions()?;
        let color = decoder.colortype()?;
        let layout = decoder.image_buffer_layout()?;
        let (samples, colors) = match color {
            ColorType::Gray(_) => (1, Colors::Grey),
            ColorType::GrayA(_) | ColorType::Multiband { num_samples: 2, .. } => (2, Colors::Grey),
            ColorType::RGB(_) => (3, Colors::Rgb),
            ColorType::RGBA(_) => (4, Colors::Rgb),
            ColorType::Multiband { num_samples, .. } => {
                return Ok(Err(format!("{num_samples} channels per pixel; save one of them, or colours as RGB")));
            }
            other => return Ok(Err(format!("colours of kind {other:?}; save it in grey or as RGB"))),
        };
        let bits = u32::from(color.bit_depth());
        let compression = decoder.find_tag_unsigned::<u32>(Tag::Compression)?.unwrap_or(UNCOMPRESSED);
        let is_packed = (9..=15).contains(&bits);
        if is_packed && (compression != UNCOMPRESSED || is_tiled_or_inverted(decoder)?) {
            let cure = "save it with 16 bits, or uncompressed in strips";
            return Ok(Err(format!("{bits} bits per pixel, compressed, in tiles or with white as 0; {cure}")));
        }
        let cure = match layout.sample_format {
            SampleFormat::Uint | SampleFormat::Void => None,
            SampleFormat::Int => Some("signed numbers; add 2^(bits-1) and save them as unsigned ones"),
            _ => Some("floating-point numbers; scale them to 0 to 65535 and save them with 16 bits"),
        };
        let is_deep = bits > 16 || (colors != Colors::Grey && !matches!(bits, 8 | 16));
        Ok(match cure {
            Some(cure) => Err(cure.to_owned()),
            None if is_deep && colors == Colors::Grey => {
                Err(format!("{bits} bits per pixel; save it with 8 or 16 bits"))
            }
            None if is_deep => Err(format!("{bits} bits per colour; save it with 8 or 16 bits")),
            None => {
                let (is_swapped, planes) = (decoder.byte_order() != native_byte_order(), layout.planes.max(1));
                Ok(Self { width_px, height_px, bits, samples, colors, planes, is_swapped, is_stored: is_packed })
            }
        })
    }

    /// Reads the layout of a page of indices, which the decoder does not read.
    ///
    /// ImageJ shows grey levels through such a table. There the indices are the levels.
    fn from_palette(decoder: &mut Tiff) -> TiffResult<Result<Self, String>> {
        let (width_px, height_px) = decoder.dimensions()?;
        let bits = decoder.find_tag_unsigned_vec::<u32>(Tag::BitsPerSample)?.unwrap_or_default();
        let compression = decoder.find_tag_unsigned::<u32>(Tag::Compression)?.unwrap_or(UNCOMPRESSED);
        if bits != [8] || compression != UNCOMPRESSED || is_tiled_or_inverted(decoder)? {
            return Ok(
                Err("a table of colours with other than 8 bits, compressed or in tiles; save it in grey".into()),
            );
        }
        let text = decoder.find_tag(Tag::ImageDescription)?.and_then(|tag| tag.into_string().ok()).unwrap_or_default();
        let colors = if text.starts_with("ImageJ=") { Colors::Grey } else { Colors::Palette(palette_levels(decoder)?) };
        Ok(Ok(Self { width_px, height_px, bits: 8, samples: 1, colors, planes: 1, is_swapped: false, is_stored: true }))
    }

    /// Reads the layout of a page whose samples of 8 or 16 bits lie uncompressed in one piece, and the offset of that
    /// piece. `None` for any other page.
    pub(super) fn raw(decoder: &mut Tiff) -> TiffResult<Option<(Self, u64)>> {
        let Ok(page) = Self::new(decoder)? else { return Ok(None) };
        let compression = decoder.find_tag_unsigned::<u32>(Tag::Compression)?.unwrap_or(UNCOMPRESSED);
        let offsets = decoder.find_tag_unsigned_vec::<u64>(Tag::StripOffsets)?.unwrap_or_default();
        let counts = decoder.find_tag_unsigned_vec::<u64>(Tag::StripByteCounts)?.unwrap_or_default();
        let follow = offsets.iter().zip(&counts).map(|(offset, count)| offset.saturating_add(*count));
        let is_one_piece = follow.zip(offsets.iter().skip(1)).all(|(end, next)| end == *next);
        let is_raw = compression == UNCOMPRESSED && is_one_piece && page.planes == 1 && matches!(page.bits, 8 | 16);
        Ok(offsets.first().filter(|_| is_raw).map(|start| (page, *start)))
    }

    /// Returns the size of the stored samples, bytes, for 8 or 16 bits per sample and without gaps.
    pub(super) fn bytes(&self) -> u64 {
        let pixels = u64::from(self.width_px) * u64::from(self.height_px);
        pixels.saturating_mul(self.samples as u64 * u64::from(self.bits / 8))
    }

    /// Returns the size of the stored samples, bytes, with rows that end at a byte.
    fn stored_bytes(&self) -> usize {
        (self.width_px as usize * self.samples * self.bits as usize).div_ceil(8) * self.height_px as usize
    }

    /// Returns the size of the samples, bytes, when each takes one byte, or two above 8 bits.
    pub(super) fn decoded_bytes(&self) -> u64 {
        let pixels = u64::from(self.width_px) * u64::from(self.height_px);
        pixels.saturating_mul(self.samples as u64 * if self.bits > 8 { 2 } else { 1 })
    }

    /// Returns size and pixel layout of the grey image.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for an image without pixels, or a larger one than is supported.
    pub(super) fn shape(&self, path: &Path) -> Result<Shape, ImportError> {
        let format = match self.bits {
            ..=8 => PixelFormat::Mono8,
            10 => PixelFormat::Mono10,
            12 => PixelFormat::Mono12,
            _ => PixelFormat::Mono16,
        };
        Shape::new(path, self.width_px.into(), self.height_px.into(), format)
    }

    /// Reads orientation and shape of a pixel for the display of the page, and returns them with the significant bits,
    /// at least 8, and the rule of the grey levels.
    ///
    /// # Errors
    ///
    /// [`ImportError::Invalid`] for an orientation that TIFF does not define.
    pub(super) fn display_info(&self, decoder: &mut Tiff, path: &Path) -> Result<DisplayInfo, ImportError> {
        let mut number = |tag: Tag| decoder.find_tag(tag).ok().flatten();
        let tag = number(Tag::Orientation).and_then(|value| value.into_u16().ok()).unwrap_or(1);
        let orientation = Orientation::from_tag(tag)
            .ok_or_else(|| ImportError::invalid(path, format!("Orientation {tag}; 1 to 8 are defined")))?;
        let (x, y) =
            (number(Tag::XResolution).and_then(positive_ratio), number(Tag::YResolution).and_then(positive_ratio));
        let pixel_aspect = x.zip(y).map_or(1.0, |(x, y)| y / x);
        let grey_rule = match &self.colors {
            Colors::Grey => None,
            Colors::Rgb | Colors::Palette(_) => Some(grey::LUMA),
        };
        Ok(DisplayInfo { orientation, pixel_aspect, bits: self.bits.max(8), grey_rule, ..DisplayInfo::default() })
    }

    /// Decodes all samples of the current page, in the byte order of the machine; samples that the decoder does not
    /// read stay packed as they are stored.
    pub(super) fn decode(&self, decoder: &mut Tiff) -> TiffResult<Vec<u8>> {
        if self.is_stored {
            let mut samples = vec![0; self.stored_bytes()];
            read_strips(decoder, &mut samples)?;
            return Ok(samples);
        }
        let layout = decoder.image_buffer_layout()?;
        // The limits of the decoder hold for the buffers of its own.
        if layout.complete_len as u64 > self.decoded_bytes() {
            return Err(TiffError::LimitsExceeded);
        }
        let mut samples = vec![0; layout.complete_len];
        decoder.read_image_bytes(&mut samples)?;
        Ok(samples)
    }

    /// Swaps samples of 16 bits, which were read from the file as they are, to the byte order of the machine. Other
    /// samples stay as they are.
    pub(super) fn to_native_byte_order(&self, mut samples: Vec<u8>) -> Vec<u8> {
        if self.is_swapped && self.bits == 16 {
            swap_pairs(&mut samples);
        }
        samples
    }

    /// Computes packed little-endian grey levels from decoded samples. Transparency and further samples are left out.
    ///
    /// # Errors
    ///
    /// The reason when there are too few samples.
    pub(super) fn grey(&self, samples: Vec<u8>) -> Result<Vec<u8>, String> {
        let pixels = self.width_px as usize * self.height_px as usize;
        let samples = self.spread_to_bytes(samples);
        let bytes = if self.bits <= 8 { 1 } else { 2 };
        let wanted = pixels * bytes * self.samples;
        // A grey page that is one plane of several leaves out the others.
        let is_short =
            samples.len() < if self.planes > 1 && self.colors == Colors::Grey { pixels * bytes } else { wanted };
        if is_short {
            return Err(format!("{} bytes are decoded, expected {wanted}", samples.len()));
        }
        Ok(match &self.colors {
            Colors::Grey if self.planes > 1 => samples[..pixels * bytes].to_vec(),
            Colors::Grey => leading_bytes(&samples, bytes * self.samples, bytes),
            Colors::Rgb => {
                let format = if bytes == 1 { PixelFormat::Mono8 } else { PixelFormat::Mono16 };
                match self.planes {
                    1 => grey::luma(format, &leading_bytes(&samples, bytes * self.samples, 3 * bytes)),
                    _ => grey::luma_of_planes(format, &samples[..3 * pixels * bytes]),
                }
            }
            // The table has levels of 16 bits.
            Colors::Palette(levels) => {
                let index = |sample: &[u8]| match *sample {
                    [low] => usize::from(low),
                    _ => usize::from(u16::from_le_bytes([sample[0], sample[1]])),
                };
                let level = |sample: &[u8]| levels.get(index(sample)).copied().unwrap_or(0);
                match bytes {
                    1 => samples.chunks_exact(1).map(|sample| (level(sample) >> 8) as u8).collect(),
                    _ => samples.chunks_exact(2).flat_map(|sample| level(sample).to_le_bytes()).collect(),
                }
            }
        })
    }

    /// Spreads the samples to whole little-endian bytes. Fewer than 8 bits are scaled to 0 to 255, more than 8 keep
    /// their levels in 16-bit words. Rows of packed samples end at a byte.
    fn spread_to_bytes(&self, samples: Vec<u8>) -> Vec<u8> {
        let row_samples = self.width_px as usize * if self.planes > 1 { 1 } else { self.samples };
        let row_bytes = (row_samples * self.bits as usize).div_ceil(8).max(1);
        match self.bits {
            8 => samples,
            16 => {
                let words = samples.chunks_exact(2).map(|pair| u16::from_ne_bytes([pair[0], pair[1]]));
                words.flat_map(u16::to_le_bytes).collect()
            }
            bits @ ..8 => {
                // 1 bit becomes 0 or 255, and so do 4 bits.
                let (per_byte, highest) = (8 / bits as usize, (1_u32 << bits) - 1);
                let level = |row: &[u8], x: usize| {
                    let shift = 8 - bits * (x % per_byte + 1) as u32;
                    (255 * (u32::from(row[x / per_byte]) >> shift & highest) / highest) as u8
                };
                let row = |row: &[u8]| (0..row_samples).map(|x| level(row, x)).collect();
                samples.chunks_exact(row_bytes).flat_map::<Vec<u8>, _>(row).collect()
            }
            bits => {
                let row = |row: &[u8]| {
                    let mut words = unpack_msb_first(row, bits);
                    words.truncate(2 * row_samples);
                    words
                };
                samples.chunks_exact(row_bytes).flat_map(row).collect()
            }
        }
    }
}

/// Whether the samples of the current page are stored in tiles, or with white as 0.
fn is_tiled_or_inverted(decoder: &mut Tiff) -> TiffResult<bool> {
    let is_tiled = decoder.find_tag(Tag::TileWidth)?.is_some();
    Ok(is_tiled || decoder.find_tag_unsigned::<u32>(Tag::PhotometricInterpretation)? == Some(WHITE_IS_ZERO))
}

/// Fills `into` with the uncompressed strips of the current page, one after the other. The decoder itself unpacks whole
/// bytes only.
///
/// # Errors
///
/// [`TiffError::IoError`] when the strips are shorter than `into` or cannot be read.
fn read_strips(decoder: &mut Tiff, mut into: &mut [u8]) -> TiffResult<()> {
    let offsets = decoder.find_tag_unsigned_vec::<u64>(Tag::StripOffsets)?.unwrap_or_default();
    let counts = decoder.find_tag_unsigned_vec::<u64>(Tag::StripByteCounts)?.unwrap_or_default();
    for (offset, count) in offsets.into_iter().zip(counts) {
        let (strip, rest) = into.split_at_mut(usize::try_from(count).unwrap_or(usize::MAX).min(into.len()));
        let reader = decoder.inner();
        reader.seek(SeekFrom::Start(offset))?;
        reader.read_exact(strip)?;
        into = rest;
    }
    match into.len() {
        0 => Ok(()),
        missing => Err(TiffError::IoError(std::io::Error::other(format!("{missing} bytes of the page are missing")))),
    }
}

/// Returns the first `kept` bytes of every `every` bytes. Bytes at the end that are fewer than `every` are dropped.
fn leading_bytes(samples: &[u8], every: usize, kept: usize) -> Vec<u8> {
    match every == kept {
        true => samples.to_vec(),
        false => samples.chunks_exact(every).flat_map(|pixel| &pixel[..kept]).copied().collect(),
    }
}

/// Swaps the bytes of every 16-bit word.
fn swap_pairs(bytes: &mut [u8]) {
    bytes.chunks_exact_mut(2).for_each(<[u8]>::reverse);
}

/// Reads the table of colours of a palette as grey levels of 16 bits (TIFF 6.0, section 5).
fn palette_levels(decoder: &mut Tiff) -> TiffResult<Vec<u16>> {
    let table = decoder.find_tag_unsigned_vec::<u16>(Tag::ColorMap)?.unwrap_or_default();
    let colors = table.len() / 3;
    let color = |index: usize| [table[index], table[colors + index], table[2 * colors + index]];
    let words: Vec<u8> = (0..colors).flat_map(color).flat_map(u16::to_le_bytes).collect();
    let levels = grey::luma(PixelFormat::Mono16, &words);
    Ok(levels.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect())
}

/// Returns the value of a rational number; `None` for another type, or when it is not positive.
fn positive_ratio(value: Value) -> Option<f64> {
    let Value::Rational(numerator, denominator) = value else { return None };
    (numerator > 0 && denominator > 0).then(|| f64::from(numerator) / f64::from(denominator))
}

/// Returns the byte order of this machine.
fn native_byte_order() -> ByteOrder {
    if cfg!(target_endian = "big") { ByteOrder::BigEndian } else { ByteOrder::LittleEndian }
}
