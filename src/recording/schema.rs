//! Which topics a recording holds, and the schema each is written with.

use foxglove::Encode;
use foxglove::messages::{ImageAnnotations, RawImage};
use std::borrow::Cow;

/// The messages of `schema/*.proto`.
pub(super) mod proto {
    #![allow(clippy::all, reason = "generated from the .proto files")]
    include!(concat!(env!("OUT_DIR"), "/ricochet.rs"));
}

/// A topic of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Topic {
    /// The frames, as `foxglove.RawImage`.
    Image,
    /// What an image message cannot hold of a frame.
    FrameInfo,
    /// Circles and vectors to draw over the frames, as `foxglove.ImageAnnotations`.
    Annotations,
    /// Displacement fields.
    Field,
    /// Where the bodies are.
    Track,
    /// How fast they move.
    Velocity,
    /// What the collisions did.
    Impact,
    /// How the rig's processes are doing.
    Status,
    /// Triggers and changes of state.
    Events,
    /// The velocities a simulated camera drew.
    Truth,
    /// The collisions a simulated camera drew.
    TruthImpact,
}

impl Topic {
    /// Every topic.
    pub const ALL: [Self; 11] = [
        Self::Image,
        Self::FrameInfo,
        Self::Annotations,
        Self::Field,
        Self::Track,
        Self::Velocity,
        Self::Impact,
        Self::Status,
        Self::Events,
        Self::Truth,
        Self::TruthImpact,
    ];

    /// Its name in the file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Image => "/camera/image",
            Self::FrameInfo => "/camera/frame_info",
            Self::Annotations => "/camera/annotations",
            Self::Field => "/field",
            Self::Track => "/track",
            Self::Velocity => "/velocity",
            Self::Impact => "/impact",
            Self::Status => "/status",
            Self::Events => "/events",
            Self::Truth => "/truth",
            Self::TruthImpact => "/truth_impact",
        }
    }

    /// Whether a channel of this name is this topic's, of whichever camera.
    pub fn is_named_by(self, channel: &str) -> bool {
        let camera = channel.strip_suffix(self.name());
        camera.is_some_and(|camera| camera.is_empty() || (camera.starts_with('/') && !camera[1..].contains('/')))
    }

    /// The name of its messages' schema.
    pub fn schema_name(self) -> &'static str {
        match self {
            Self::Image => "foxglove.RawImage",
            Self::FrameInfo => "ricochet.FrameInfo",
            Self::Annotations => "foxglove.ImageAnnotations",
            Self::Field => "ricochet.Field",
            Self::Track => "ricochet.Track",
            Self::Velocity | Self::Truth => "ricochet.Velocity",
            Self::Impact | Self::TruthImpact => "ricochet.Impact",
            Self::Status => "ricochet.Status",
            Self::Events => "ricochet.Event",
        }
    }

    /// Its schema: a serialised protobuf `FileDescriptorSet`.
    pub fn schema_data(self) -> Cow<'static, [u8]> {
        macro_rules! compiled {
            ($name:literal) => {
                Cow::Borrowed(include_bytes!(concat!(env!("OUT_DIR"), "/", $name, ".bin")).as_slice())
            };
        }
        match self {
            Self::Image => RawImage::get_schema().map(|schema| schema.data).unwrap_or_default(),
            Self::Annotations => ImageAnnotations::get_schema().map(|schema| schema.data).unwrap_or_default(),
            Self::FrameInfo => compiled!("frame_info"),
            Self::Field => compiled!("field"),
            Self::Track => compiled!("track"),
            Self::Velocity | Self::Truth => compiled!("velocity"),
            Self::Impact | Self::TruthImpact => compiled!("impact"),
            Self::Status => compiled!("status"),
            Self::Events => compiled!("event"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    #[test]
    fn every_schema_is_a_descriptor_set_that_defines_its_message() {
        for topic in Topic::ALL {
            let set = prost_types::FileDescriptorSet::decode(topic.schema_data().as_ref()).unwrap();
            let names: Vec<String> = set
                .file
                .iter()
                .flat_map(|file| file.message_type.iter().map(|m| format!("{}.{}", file.package(), m.name())))
                .collect();
            assert!(names.iter().any(|name| name == topic.schema_name()), "{}: {names:?}", topic.name());
        }
    }
}
