//! Whether the frames of a film were predicted from each other by an encoder.

use std::collections::BTreeMap;

/// The metadata of a recording that names the codec of the film that it was imported from.
const CODEC: &str = "codec";
/// The metadata that states the coding, and its value for predicted frames.
const KEY: &str = "coding";
const PREDICTED: &str = "predicted";

/// The codecs, by their names in ffmpeg, that predict frames from others and drop small differences.
const PREDICTING: [&str; 29] = [
    "av1",
    "flv1",
    "h261",
    "h263",
    "h263i",
    "h263p",
    "h264",
    "hevc",
    "mpeg1video",
    "mpeg2video",
    "mpeg4",
    "msmpeg4v1",
    "msmpeg4v2",
    "msmpeg4v3",
    "rv10",
    "rv20",
    "rv30",
    "rv40",
    "svq1",
    "svq3",
    "theora",
    "vc1",
    "vp6",
    "vp8",
    "vp9",
    "vvc",
    "wmv1",
    "wmv2",
    "wmv3",
];

/// The form in which frames were stored before they came here.
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
    pub fn of_metadata(metadata: &BTreeMap<String, String>) -> Self {
        match (metadata.get(KEY).map(String::as_str), metadata.get(CODEC)) {
            (Some(PREDICTED), _) => Self::Predicted,
            (_, Some(codec)) => Self::of_codec(codec),
            _ => Self::Independent,
        }
    }

    /// Returns the metadata that state it; `None` for frames stored by themselves.
    pub fn metadata(self) -> Option<(String, String)> {
        (self == Self::Predicted).then(|| (KEY.to_owned(), PREDICTED.to_owned()))
    }

    /// Returns the coding of a codec by its name in ffmpeg. Unknown ones store each frame by itself.
    pub fn of_codec(name: &str) -> Self {
        if PREDICTING.contains(&name) { Self::Predicted } else { Self::Independent }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codecs_of_phones_predict_frames_and_those_of_cameras_do_not() {
        assert!(
            ["h264", "hevc", "vp9", "av1", "mpeg4"]
                .iter()
                .all(|name| FrameCoding::of_codec(name) == FrameCoding::Predicted)
        );
        assert!(
            ["mjpeg", "ffv1", "rawvideo", "prores", ""]
                .iter()
                .all(|name| FrameCoding::of_codec(name) == FrameCoding::Independent)
        );
    }
}
