//! The `velocity` and `track` topics: a message per frame and body.

use super::layout::described;
use super::{Number, RodMessage};
use crate::results::{
    BodyVelocity, MotionSample, Part, Phase, PointStatus, TrackSample, VelocitySample, track_row, velocity_row,
};
use iceoryx2::prelude::ZeroCopySend;

/// Derives the message of a row per frame and body from its description.
///
/// Its layout: the run and the frame, then the names and counts as `u32`, then the numbers, each in the order of the description.
macro_rules! sample_message {
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
        described! {
            $type_name
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
            #[repr(C)]
            pub struct $Message {
                /// The start of the acquire process that the frame belongs to.
                pub run_id: u64,
                /// The sequence number of the frame.
                pub sequence: u64,
                /// The start of the exposure, ns since the Unix epoch.
                pub stamp_ns: u64,
                /// The index of the body in the rig's configuration.
                pub body: u32,
                /// The number of the `PointStatus`.
                pub status: u32,
                $($(#[$name_doc])* pub $name: u32,)*
                $($(#[$reason_doc])* pub $reason: u32,)*
                $($($(#[$count_doc])* pub $count: u32,)*)*
                $($(#[$number_doc])* pub $number: Number,)*
                $($($(#[$part_doc])* pub $part: Number,)*)*
                $($(#[$later_doc])* pub $later: Number,)*
                $($(#[$nested_doc])* pub $nested: $NestedMessage,)*
            }
        }

        impl $Message {
            /// Creates the message of a sample of this run; `run_id` is the start of the acquire process.
            pub fn new(sample: &$Row, run_id: u64) -> Self {
                Self {
                    run_id,
                    sequence: sample.frame,
                    stamp_ns: sample.stamp_ns,
                    body: sample.body,
                    status: sample.status as u32,
                    $($name: sample.$name as u32,)*
                    $($reason: sample.$reason as u32,)*
                    $($($count: sample.$group.map_or(0, |group| group.$count),)*)*
                    $($number: sample.$number.into(),)*
                    $($($part: sample.$group.and_then(|group| Part::known(group.$part)).into(),)*)*
                    $($later: sample.$later.into(),)*
                    $($nested: sample.$nested.into(),)*
                }
            }

            /// Returns the sample; `None` when the number of a name, status or reason is unknown.
            ///
            /// A group is `None` when a number is missing that it cannot be without.
            pub fn sample(&self) -> Option<$Row> {
                $(
                    let $group = || {
                        Some($Group {
                            $($part: <$Part as Part>::from_number(self.$part.into())?,)*
                            $($count: self.$count,)*
                        })
                    };
                )*
                Some($Row {
                    frame: self.sequence,
                    body: self.body,
                    stamp_ns: self.stamp_ns,
                    $($number: self.$number.into(),)*
                    $($group: $group(),)*
                    $($later: self.$later.into(),)*
                    $($name: $Name::from_number(self.$name)?,)*
                    $($reason: PointStatus::from_number(self.$reason)?,)*
                    $($nested: self.$nested.into(),)*
                    status: PointStatus::from_number(self.status)?,
                })
            }
        }
    };
}

velocity_row!(sample_message);
track_row!(sample_message);
