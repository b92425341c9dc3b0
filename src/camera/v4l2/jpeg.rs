//! Decoding the luma of motion JPEG images.

use super::modes::FrameSize;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Size of an empty image: start and end markers.
pub(super) const MIN_BYTES: usize = START.len() + END.len();

/// The start and the end marker of an image (ITU-T T.81, Annex B).
const START: [u8; 2] = [0xff, 0xd8];
const END: [u8; 2] = [0xff, 0xd9];

/// The AVI1 segment, by which AVI files declare that omitted Huffman tables are those of the standard's Annex K.
///
/// Cameras omit both.
const ANNEX_K: [u8; 18] = *b"\xff\xe0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0";

/// Ones, which no Huffman code consists of. Inserted before the end marker, they stop a decoder that still expects
/// data.
///
/// The decoder would fill a truncated image with grey and report success.
const ONES: [u8; 128] = {
    let mut ones = [0; 128];
    let mut at = 0;
    while at < ones.len() {
        ones[at] = 0xff;
        at += 2;
    }
    ones
};

/// Decodes the luma of an image of this size into `to`, row by row without padding, 0 to 255, as it was encoded.
///
/// # Errors
///
/// The defect: truncated, damaged, of another size, or without luma.
pub(super) fn decode_luma(image: &[u8], size: FrameSize, to: &mut [u8]) -> Result<(), String> {
    let Some(body) = image.strip_prefix(&START) else { return Err("no JPEG start marker".into()) };
    // Some cameras pad their packets behind the end marker. Inside an image it cannot occur: zeros follow each
    // 0xff.
    let Some(end) = body.windows(END.len()).rposition(|pair| pair == END) else {
        return Err("no JPEG end marker".into());
    };
    let complete = [START.as_slice(), ANNEX_K.as_slice(), &body[..end], ONES.as_slice(), END.as_slice()].concat();
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::Luma)
        .set_strict_mode(true)
        .set_max_width(1 << 16)
        .set_max_height(1 << 16);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(complete), options);
    let damaged = |error: &dyn std::fmt::Display| format!("a damaged JPEG: {}", error.to_string().trim_end());
    decoder.decode_headers().map_err(|error| damaged(&error))?;
    let info = decoder.info().ok_or("a JPEG without a size")?;
    let decoded = FrameSize { width_px: info.width.into(), height_px: info.height.into() };
    if decoded != size {
        return Err(format!("a JPEG of {decoded} px instead of {size} px"));
    }
    if decoder.output_buffer_size() != Some(to.len()) {
        return Err("a JPEG without luma".into());
    }
    decoder.decode_into(to).map_err(|error| damaged(&error))
}

#[cfg(test)]
#[path = "jpeg/sample.rs"]
mod sample;
#[cfg(test)]
#[path = "jpeg/tests.rs"]
mod tests;
