//! The topics of a recording and their schemas.

pub(super) mod proto;

use super::rows::{Field, Impact, Track, Velocity};
use crate::results::named_enum;
use foxglove::Encode;
use foxglove::messages::{ImageAnnotations, RawImage};
use std::borrow::Cow;

named_enum! {
    /// A topic of a recording.
    Topic: "topic" {
        /// The frames, as `foxglove.RawImage`.
        Image = 0 "/camera/image",
        /// The metadata of a frame that an image message cannot hold.
        FrameInfo = 1 "/camera/frame_info",
        /// Circles and vectors to draw over the frames, as `foxglove.ImageAnnotations`.
        Annotations = 2 "/camera/annotations",
        /// Displacement fields.
        Field = 3 "/field",
        /// Positions of the bodies.
        Track = 4 "/track",
        /// Velocities of the bodies.
        Velocity = 5 "/velocity",
        /// Collisions.
        Impact = 6 "/impact",
        /// Status of the rig's processes.
        Status = 7 "/status",
        /// Triggers and changes of state.
        Events = 8 "/events",
        /// The velocities a simulated camera drew.
        Truth = 9 "/truth",
        /// The collisions a simulated camera drew.
        TruthImpact = 10 "/truth_impact",
    }
}

impl Topic {
    /// Whether a channel of this name is this topic's, of whichever camera.
    pub fn is_named_by(self, channel: &str) -> bool {
        let camera = channel.strip_suffix(self.as_str());
        camera.is_some_and(|camera| camera.is_empty() || (camera.starts_with('/') && !camera[1..].contains('/')))
    }

    /// Returns the name of the schema of its messages.
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

    /// Returns its schema: a serialised protobuf `FileDescriptorSet`.
    pub fn schema_data(self) -> Cow<'static, [u8]> {
        let schema = |file: &str, messages: &[(&str, &[proto::Field])]| Cow::Owned(proto::schema(file, messages));
        match self {
            Self::Image => RawImage::get_schema().map(|schema| schema.data).unwrap_or_default(),
            Self::Annotations => ImageAnnotations::get_schema().map(|schema| schema.data).unwrap_or_default(),
            Self::FrameInfo => schema("frame_info", &[("FrameInfo", proto::FrameInfo::FIELDS)]),
            Self::Field => schema("field", &[("Field", Field::FIELDS)]),
            Self::Track => schema(
                "track",
                &[("RodEdge", proto::RodEdge::FIELDS), ("Rod", proto::Rod::FIELDS), ("Track", Track::FIELDS)],
            ),
            Self::Velocity | Self::Truth => schema("velocity", &[("Velocity", Velocity::FIELDS)]),
            Self::Impact | Self::TruthImpact => schema("impact", &[("Impact", Impact::FIELDS)]),
            Self::Status => schema("status", &[("Reading", proto::Reading::FIELDS), ("Status", proto::Status::FIELDS)]),
            Self::Events => schema("event", &[("Event", proto::Event::FIELDS)]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    #[test]
    fn the_schemas_are_complete() {
        for topic in Topic::ALL {
            let set = prost_types::FileDescriptorSet::decode(topic.schema_data().as_ref()).unwrap();
            for file in set.file.iter().filter(|file| file.package() == "ricochet") {
                let messages = file.message_type.iter().map(|message| message.name());
                let names: Vec<&str> = messages.chain(file.enum_type.iter().map(|values| values.name())).collect();
                for field in file.message_type.iter().flat_map(|message| &message.field) {
                    let name = field.type_name().strip_prefix(".ricochet.");
                    assert!(field.type_name.is_none() || name.is_some_and(|name| names.contains(&name)), "{field:?}");
                }
            }
        }
    }

    #[test]
    fn every_schema_is_a_descriptor_set_that_defines_its_message() {
        for topic in Topic::ALL {
            let set = prost_types::FileDescriptorSet::decode(topic.schema_data().as_ref()).unwrap();
            let names: Vec<String> = set
                .file
                .iter()
                .flat_map(|file| file.message_type.iter().map(|m| format!("{}.{}", file.package(), m.name())))
                .collect();
            assert!(names.iter().any(|name| name == topic.schema_name()), "{}: {names:?}", topic.as_str());
        }
    }
}
