//! Whether the frames of a film were predicted from each other by an encoder.

use std::collections::BTreeMap;

/// The metadata of a recording that names the codec of the film that it was imported from.
const CODEC: &str = "codec";
/// The metadata that states the coding, and its value for predicted frames.
const KEY: &str = "coding";
const PREDICTED: &str = "predicted";

/// The codecs, by their names in ffmpeg, that store each frame by itself, or its exact difference from another.
///
/// Any other is taken to predict frames and to drop small differences, as most codecs of films do: a step that is called
/// too uncertain misleads nobody.
const INDEPENDENT: &str = "\
    012v aic amv apng asv1 asv2 avrp avui ayuv bitpacked bmp cfhd cljr cllc dnxhd dpx dvvideo dxv exr ffv1 ffvhuff \
    fits flic fraps gif hap hq_hqa hqx huffyuv hymt jpeg2000 jpegls jpegxl lagarith ljpeg loco magicyuv mjpeg \
    mjpegb msrle mszh notchlc pam pbm pgm pgmyuv pixlet png ppm prores prores_raw qoi qtrle r10k r210 rawvideo sgi \
    sheervideo speedhq sunrast targa tiff utvideo v210 v210x v308 v408 v410 vble webp wrapped_avframe y41p ylc \
    yuv4 zlib zmbv";

/// The form in which frames were stored before they came here.
///
/// # Examples
///
/// ```
/// use ricochet::results::FrameCoding;
/// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
///
/// assert_eq!(recording.coding(), FrameCoding::Independent);
/// // The codec of an imported film decides, by its name in ffmpeg.
/// assert_eq!(FrameCoding::of_codec("h264"), FrameCoding::Predicted);
/// assert_eq!(FrameCoding::of_codec("ffv1"), FrameCoding::Independent);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrameCoding {
    /// Each frame by itself, as cameras and most formats of high-speed footage do.
    #[default]
    Independent,
    /// Parts of other frames, moved by steps of a quarter of a pixel or more, and a difference that may be left out. The
    /// motion from frame to frame is then the encoder's as much as the body's.
    Predicted,
}

impl FrameCoding {
    /// Returns the coding that the metadata of a recording state: of an imported film by its codec, and of what was
    /// recorded or measured from such a film by itself.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn of_metadata(metadata: &BTreeMap<String, String>) -> Self {
        match (metadata.get(KEY).map(String::as_str), metadata.get(CODEC)) {
            (Some(PREDICTED), _) => Self::Predicted,
            (_, Some(codec)) => Self::of_codec(codec),
            _ => Self::Independent,
        }
    }

    /// Returns the metadata that state it; `None` for frames stored by themselves.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn metadata(self) -> Option<(String, String)> {
        (self == Self::Predicted).then(|| (KEY.to_owned(), PREDICTED.to_owned()))
    }

    /// Returns the coding of a codec by its name in ffmpeg.
    pub fn of_codec(name: &str) -> Self {
        if INDEPENDENT.split(' ').any(|codec| codec == name) { Self::Independent } else { Self::Predicted }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codecs_of_phones_predict_frames_and_those_of_cameras_do_not() {
        for name in ["h264", "hevc", "vp9", "av1", "mpeg4", "cinepak", "unknown", ""] {
            assert_eq!(FrameCoding::of_codec(name), FrameCoding::Predicted, "{name}");
        }
        for name in ["mjpeg", "ffv1", "rawvideo", "prores", "012v", "zmbv", "hap", "jpeg2000"] {
            assert_eq!(FrameCoding::of_codec(name), FrameCoding::Independent, "{name}");
        }
    }
}
