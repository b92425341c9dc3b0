//! The luma of pictures that a webcam compresses one by one (motion JPEG).

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Beginning and end of a picture, without anything between.
pub(super) const LEAST_BYTES: usize = START.len() + END.len();

const START: [u8; 2] = [0xff, 0xd8];
const END: [u8; 2] = [0xff, 0xd9];

/// The segment by which AVI files say that Huffman tables left out are those of the standard's Annex K.
///
/// Cameras leave them out without it.
const ANNEX_K: [u8; 18] = *b"\xff\xe0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0";

/// Ones, which no Huffman code consists of: put before the end, they stop whoever still wants blocks there.
///
/// The decoder would fill a picture that is cut off with grey, and call it good.
const ONES: [u8; 128] = {
    let mut ones = [0; 128];
    let mut at = 0;
    while at < ones.len() {
        ones[at] = 0xff;
        at += 2;
    }
    ones
};

/// Decodes the luma of a picture of this width and height into `to`, 0 to 255, as it was encoded.
///
/// # Errors
///
/// What is wrong with it: cut off, damaged, of another size, or without luma.
pub(super) fn luma(picture: &[u8], (width, height): (usize, usize), to: &mut [u8]) -> Result<(), String> {
    let Some(body) = picture.strip_prefix(&START) else { return Err("it does not begin as a JPEG".into()) };
    // Some cameras fill their packets up behind the end, and inside a picture no end can stand: zeros follow each 0xff.
    let Some(end) = body.windows(END.len()).rposition(|pair| pair == END) else {
        return Err("a JPEG without its end".into());
    };
    let whole = [START.as_slice(), ANNEX_K.as_slice(), &body[..end], ONES.as_slice(), END.as_slice()].concat();
    let options = DecoderOptions::default()
        .jpeg_set_out_colorspace(ColorSpace::Luma)
        .set_strict_mode(true)
        .set_max_width(1 << 16)
        .set_max_height(1 << 16);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(whole), options);
    let words = |error: &dyn std::fmt::Display| format!("a damaged JPEG: {}", error.to_string().trim_end());
    decoder.decode_headers().map_err(|error| words(&error))?;
    match decoder.info() {
        Some(info) if (usize::from(info.width), usize::from(info.height)) == (width, height) => {}
        Some(info) => return Err(format!("a JPEG of {} x {} px, not {width} x {height}", info.width, info.height)),
        None => return Err("a JPEG without a size".into()),
    }
    if decoder.output_buffer_size() != Some(to.len()) {
        return Err("a JPEG without luma".into());
    }
    decoder.decode_into(to).map_err(|error| words(&error))
}

#[cfg(test)]
#[path = "jpeg/sample.rs"]
mod sample;
#[cfg(test)]
#[path = "jpeg/tests.rs"]
mod tests;
