//! The protobuf messages of a recording, each declared once: the struct that is encoded and the schema in the file.
//!
//! Versioning: a field never changes its number, type, unit or meaning, and a number is never used again. New fields
//! get new numbers; readers skip those they do not know. A number that could not be measured is absent, never NaN or 0.
//! Image axes: x right, y down. Physical axes: x right, y up. Rotations are counter-clockwise as seen on the screen.

use crate::results::PointStatus;
use prost::Message as _;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    FileDescriptorSet, OneofDescriptorProto,
};

/// The package of all messages.
const PACKAGE: &str = "ricochet";

/// A field of a message as it is declared.
#[derive(Debug, Clone, Copy)]
pub(in crate::recording) struct Field {
    pub(in crate::recording) name: &'static str,
    pub(in crate::recording) number: i32,
    /// The arguments of its `prost` attribute: the protobuf type, then the label.
    pub(in crate::recording) kind: &'static str,
    /// Its type in Rust.
    pub(in crate::recording) rust_type: &'static str,
}

/// Declares a message: `[protobuf type, label] name: Rust type = number`.
macro_rules! message {
    ($(#[$doc:meta])* $Name:ident {
        $($(#[$field_doc:meta])* [$($kind:tt)+] $field:ident: $type:ty = $number:tt,)*
    }) => {
        $(#[$doc])*
        #[derive(Clone, PartialEq, prost::Message)]
        pub struct $Name {
            $($(#[$field_doc])* #[prost($($kind)+, tag = $number)] pub $field: $type,)*
        }

        impl $Name {
            pub(in crate::recording) const FIELDS: &'static [$crate::recording::schema::proto::Field] = &[
                $($crate::recording::schema::proto::Field {
                    name: stringify!($field),
                    number: $number,
                    kind: stringify!($($kind)+),
                    rust_type: stringify!($type),
                },)*
            ];
        }
    };
}
pub(in crate::recording) use message;

message! {
    /// The part of a frame that its image message cannot hold; written right before the image, in the same chunk.
    FrameInfo {
        /// Counts the camera's frames, lost ones included; a jump is a loss.
        [uint64] sequence: u64 = 1,
        /// Raised each time the camera is opened again.
        [uint32] epoch: u32 = 2,
        /// The start of the exposure, ns since the Unix epoch.
        [fixed64] stamp_ns: u64 = 3,
        /// The camera's own clock at the start of the exposure, ns; 0 when it has none.
        [uint64] device_ns: u64 = 4,
        /// The code of the GenICam Pixel Format Naming Convention.
        [uint32] pixel_format: u32 = 5,
        /// The CRC-32 (ISO-HDLC, as everywhere in MCAP) of the image's data bytes.
        [fixed32] pixels_crc32: u32 = 6,
    }
}

message! {
    /// An event: a trigger, a change of state, a loss.
    Event {
        /// The time, ns since the Unix epoch.
        [fixed64] stamp_ns: u64 = 1,
        /// The kind: `triggered`, `armed`, `lost`, ... as on the bus.
        [string] kind: String = 2,
        /// The rest, for people.
        [string] text: String = 3,
    }
}

message! {
    /// One number of a process, with its unit in the name.
    Reading {
        [string] name: String = 1,
        [double, optional] value: Option<f64> = 2,
    }
}

message! {
    /// The state of a process of the rig, a few times per second.
    Status {
        /// The time, ns since the Unix epoch.
        [fixed64] stamp_ns: u64 = 1,
        /// The process: `acquire`, `correlate`, `track`, `record`, ...
        [string] process: String = 2,
        /// Its state in one word.
        [string] state: String = 3,
        [message, repeated] readings: Vec<Reading> = 4,
    }
}

message! {
    /// An edge of a rod's tape.
    RodEdge {
        /// The position where it crosses the middle of the rod; with its standard uncertainty, or both absent.
        [double, optional] y_px: Option<f64> = 1,
        [double, optional] sigma_y_px: Option<f64> = 2,
        /// The name of its `PointStatus`.
        [string] status: String = 3,
    }
}

message! {
    /// An upright rod with tapes around it.
    Rod {
        /// The edges of its tapes, from the top downwards.
        [message, repeated] edges: Vec<RodEdge> = 1,
        /// The middle between its sides, and the point that moves with it.
        [double, optional] x_px: Option<f64> = 2,
        [double, optional] sigma_x_px: Option<f64> = 3,
        [double, optional] y_px: Option<f64> = 4,
        [double, optional] sigma_y_px: Option<f64> = 5,
        [double, optional] half_width_px: Option<f64> = 6,
        [double, optional] sigma_half_width_px: Option<f64> = 7,
        /// The tilt from upright.
        [double, optional] tilt_deg: Option<f64> = 8,
        [double, optional] sigma_tilt_deg: Option<f64> = 9,
    }
}

/// A message of a schema: its name and its fields.
type Declared<'a> = (&'a str, &'a [Field]);

/// Returns the serialised `FileDescriptorSet` of a schema, as `protoc` makes it from the file `FILE.proto` with these
/// messages. Their statuses add the enumeration of statuses.
pub(super) fn schema(file: &str, messages: &[Declared<'_>]) -> Vec<u8> {
    let has_status = messages.iter().flat_map(|(_, fields)| *fields).any(|field| field.kind.starts_with("enumeration"));
    let file = FileDescriptorProto {
        name: Some(format!("{file}.proto")),
        package: Some(PACKAGE.into()),
        message_type: messages.iter().map(|(name, fields)| message_type(name, fields)).collect(),
        enum_type: has_status.then(point_status).into_iter().collect(),
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

/// Returns the descriptor of a message, as `protoc` makes it.
fn message_type(name: &str, fields: &[Field]) -> DescriptorProto {
    let optional: Vec<&Field> = fields.iter().filter(|field| field.kind.ends_with("optional")).collect();
    let field = |field: &Field| {
        let protobuf_type = match field.kind.split([',', ' ']).next() {
            Some("double") => Type::Double,
            Some("float") => Type::Float,
            Some("uint64") => Type::Uint64,
            Some("uint32") => Type::Uint32,
            Some("fixed64") => Type::Fixed64,
            Some("fixed32") => Type::Fixed32,
            Some("message") => Type::Message,
            Some("enumeration") => Type::Enum,
            _ => Type::String,
        };
        let label = if field.kind.ends_with("repeated") { Label::Repeated } else { Label::Optional };
        let type_name = match protobuf_type {
            Type::Message => field.rust_type.split(['<', '>']).nth(1).map(str::trim),
            Type::Enum => Some("PointStatus"),
            _ => None,
        };
        // An optional field of proto3 is the only one of a "oneof" of its own.
        let oneof_index = optional.iter().position(|other| other.number == field.number).map(|index| index as i32);
        FieldDescriptorProto {
            name: Some(field.name.into()),
            number: Some(field.number),
            label: Some(label.into()),
            r#type: Some(protobuf_type.into()),
            type_name: type_name.map(|name| format!(".{PACKAGE}.{name}")),
            oneof_index,
            json_name: Some(json_name(field.name)),
            proto3_optional: oneof_index.map(|_| true),
            ..FieldDescriptorProto::default()
        }
    };
    let oneof = |field: &&Field| OneofDescriptorProto { name: Some(format!("_{}", field.name)), options: None };
    DescriptorProto {
        name: Some(name.into()),
        field: fields.iter().map(field).collect(),
        oneof_decl: optional.iter().map(oneof).collect(),
        ..DescriptorProto::default()
    }
}

/// Returns the name of a field in JSON: camel case, as in the protobuf specification (language guide, JSON mapping).
fn json_name(name: &str) -> String {
    let mut words = name.split('_');
    let first = words.next().unwrap_or_default().to_owned();
    words.fold(first, |name, word| {
        let (initial, rest) = word.split_at(word.len().min(1));
        name + &initial.to_uppercase() + rest
    })
}

/// Returns the descriptor of the enumeration of statuses.
fn point_status() -> EnumDescriptorProto {
    let value = |status: PointStatus| EnumValueDescriptorProto {
        name: Some(format!("POINT_STATUS_{}", status.as_str().to_uppercase().replace('-', "_"))),
        number: Some(status as i32),
        options: None,
    };
    EnumDescriptorProto {
        name: Some("PointStatus".into()),
        value: PointStatus::ALL.map(value).to_vec(),
        ..EnumDescriptorProto::default()
    }
}
