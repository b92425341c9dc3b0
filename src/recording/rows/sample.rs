//! The rows per frame and body: `/velocity`, `/truth` and `/track`.

use super::{Row, unknown_name};
use crate::recording::schema::proto::{Rod, message};
use crate::results::{
    BodyVelocity, MotionSample, Part, PointStatus, TrackSample, VelocitySample, track_row, velocity_row,
};

/// Derives the protobuf message of a row per frame and body from its description.
macro_rules! sample_file {
    (
        $(#[$doc:meta])*
        $Row:ident ($Message:ident, $type_name:tt, $File:ident) {
            numbers { $($(#[$number_doc:meta])* $number:ident = $number_tag:tt,)* }
            groups {
                $(
                    $(#[$group_doc:meta])*
                    $group:ident: $Group:ident {
                        numbers { $($(#[$part_doc:meta])* $part:ident: $Part:ty = $part_tag:tt,)* }
                        counts { $($(#[$count_doc:meta])* $count:ident = $count_tag:tt,)* }
                    }
                )*
            }
            numbers { $($(#[$later_doc:meta])* $later:ident = $later_tag:tt,)* }
            names { $($(#[$name_doc:meta])* $name:ident: $Name:ident = $name_tag:tt,)* }
            status = $status_tag:tt,
            reasons { $($(#[$reason_doc:meta])* $reason:ident = $reason_tag:tt,)* }
            nested { $($(#[$nested_doc:meta])* $nested:ident: $Nested:ident, $NestedMessage:ident = $nested_tag:tt,)* }
        }
    ) => {
        message! {
            $(#[$doc])*
            $File {
                [uint64] frame: u64 = 1,
                [uint32] body: u32 = 2,
                [fixed64] stamp_ns: u64 = 3,
                $([double, optional] $number: Option<f64> = $number_tag,)*
                $(
                    $([double, optional] $part: Option<f64> = $part_tag,)*
                    $([uint32, optional] $count: Option<u32> = $count_tag,)*
                )*
                $([double, optional] $later: Option<f64> = $later_tag,)*
                $([string] $name: String = $name_tag,)*
                [string] status: String = $status_tag,
                $([string] $reason: String = $reason_tag,)*
                $([message, optional] $nested: Option<$Nested> = $nested_tag,)*
            }
        }

        impl Row for $Row {
            type Message = $File;

            fn to_message(&self) -> $File {
                $File {
                    frame: self.frame,
                    body: self.body,
                    stamp_ns: self.stamp_ns,
                    $($number: self.$number,)*
                    $(
                        $($part: self.$group.and_then(|group| Part::known(group.$part)),)*
                        $($count: self.$group.map(|group| group.$count),)*
                    )*
                    $($later: self.$later,)*
                    $($name: self.$name.as_str().into(),)*
                    status: self.status.as_str().into(),
                    $($reason: self.$reason.as_str().into(),)*
                    $($nested: self.$nested.as_ref().map(Row::to_message),)*
                }
            }

            fn from_message(message: $File) -> Result<Self, String> {
                $(
                    let $group = || {
                        Some($Group {
                            $($part: <$Part as Part>::from_number(message.$part)?,)*
                            $($count: message.$count?,)*
                        })
                    };
                )*
                Ok(Self {
                    frame: message.frame,
                    body: message.body,
                    stamp_ns: message.stamp_ns,
                    $($number: message.$number,)*
                    $($group: $group(),)*
                    $($later: message.$later,)*
                    $($name: message.$name.parse().map_err(unknown_name)?,)*
                    $($reason: if message.$reason.is_empty() { PointStatus::Valid } else { message.$reason.parse().map_err(unknown_name)? },)*
                    $($nested: message.$nested.map(Row::from_message).transpose()?,)*
                    status: message.status.parse().map_err(unknown_name)?,
                })
            }
        }
    };
}

velocity_row!(sample_file);
track_row!(sample_file);
