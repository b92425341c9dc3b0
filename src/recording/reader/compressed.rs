//! Compressed images in files of other programs: PNG and JPEG.

use crate::image::{PixelFormat, grey_pixels};
use bytes::Bytes;
use foxglove::messages::{CompressedImage, RawImage, Timestamp};
use image::{ImageFormat, ImageReader, Limits};
use prost::Message as _;
use std::io::Cursor;

/// The schema of a compressed image in protobuf.
pub(super) const SCHEMA_NAME: &str = "foxglove.CompressedImage";

/// Maximum size of a decoded picture, bytes. A small file may announce a huge one.
const MAX_PICTURE_BYTES: u64 = 256 << 20;

/// Decodes a `foxglove.CompressedImage` to grey levels.
pub(super) fn decode_image(message: Bytes) -> Result<RawImage, String> {
    let image = CompressedImage::decode(message).map_err(|error| error.to_string())?;
    decode_picture(&image.data, image.timestamp)
}

/// Decodes a PNG or JPEG picture to grey levels of 8 or 16 bits, whatever format the message names. The timestamp is
/// passed on.
///
/// # Errors
///
/// The reason when the picture has another format, is in colour, or does not decode.
pub(super) fn decode_picture(payload: &[u8], timestamp: Option<Timestamp>) -> Result<RawImage, String> {
    let format = image::guess_format(payload).ok();
    let Some(format @ (ImageFormat::Png | ImageFormat::Jpeg)) = format else {
        return Err("the image is neither PNG nor JPEG, the only supported compressions".into());
    };
    let mut reader = ImageReader::with_format(Cursor::new(payload), format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| error.to_string())?;
    let (width, height) = (picture.width(), picture.height());
    let (format, pixels) = grey_pixels(picture).ok_or("not a grey image of 8 or 16 bit")?;
    let encoding = if format == PixelFormat::Mono8 { "mono8" } else { "mono16" };
    let step = u32::try_from(u64::from(width) * format.bytes_per_pixel() as u64).map_err(|error| error.to_string())?;
    let (encoding, data) = (encoding.to_owned(), pixels.into());
    Ok(RawImage { timestamp, frame_id: String::new(), width, height, encoding, step, data })
}
