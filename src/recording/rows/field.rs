//! The rows of `/field`, a message per body and pair of frames.

use super::Row;
use crate::recording::schema::proto::message;
use crate::results::{Displacement, FieldPoint, PairField, PointStatus, field_row};

/// Derives the protobuf message from the columns of the row.
macro_rules! field_file {
    (
        position { $($(#[$position_doc:meta])* $position:ident = $position_tag:tt,)* }
        displacement { $($(#[$part_doc:meta])* $part:ident = $part_tag:tt,)* }
        sigmas { $($(#[$sigma_doc:meta])* $sigma:ident = $sigma_tag:tt,)* }
        scores { $($(#[$score_doc:meta])* $score:ident = $score_tag:tt,)* }
        status = $status_tag:tt,
    ) => {
        message! {
            /// The displacement field of one body from one frame to a later one. All arrays have one entry per subset, in
            /// the same order. They cannot leave entries out: a number that was not measured is NaN, and `status` says why.
            Field {
                [uint64] frame: u64 = 1,
                [uint64] target_frame: u64 = 2,
                [fixed64] stamp_ns: u64 = 3,
                [uint32] body: u32 = 4,
                $([float, repeated] $position: Vec<f32> = $position_tag,)*
                $([float, repeated] $part: Vec<f32> = $part_tag,)*
                $([float, repeated] $sigma: Vec<f32> = $sigma_tag,)*
                $([float, repeated] $score: Vec<f32> = $score_tag,)*
                [enumeration = "PointStatus", repeated] status: Vec<i32> = $status_tag,
            }
        }

        impl Row for PairField {
            type Message = Field;

            fn to_message(&self) -> Field {
                let column = |number: fn(&FieldPoint) -> Option<f32>| -> Vec<f32> {
                    self.points.iter().map(|point| number(point).unwrap_or(f32::NAN)).collect()
                };
                Field {
                    frame: self.frame,
                    target_frame: self.target_frame,
                    stamp_ns: self.stamp_ns,
                    body: self.body,
                    $($position: column(|point| Some(point.$position)),)*
                    $($part: column(|point| point.displacement.map(|d| d.$part)),)*
                    $($sigma: column(|point| point.displacement.map(|d| d.$sigma)),)*
                    $($score: column(|point| point.$score),)*
                    status: self.points.iter().map(|point| point.status as i32).collect(),
                }
            }

            fn from_message(message: Field) -> Result<Self, String> {
                let count = message.status.len();
                let columns = [
                    $((stringify!($position), &message.$position),)*
                    $((stringify!($part), &message.$part),)*
                    $((stringify!($sigma), &message.$sigma),)*
                    $((stringify!($score), &message.$score),)*
                ];
                if let Some((name, column)) = columns.into_iter().find(|(_, column)| column.len() != count) {
                    return Err(format!("field of frame {}: {count} entries of status but {} of {name}", message.frame, column.len()));
                }
                let present = |value: f32| (!value.is_nan()).then_some(value);
                let point = |i: usize| {
                    let displacement = || {
                        Some(Displacement {
                            $($part: present(message.$part[i])?,)*
                            $($sigma: present(message.$sigma[i])?,)*
                        })
                    };
                    let number = message.status[i];
                    Ok(FieldPoint {
                        $($position: message.$position[i],)*
                        displacement: displacement(),
                        $($score: present(message.$score[i]),)*
                        status: PointStatus::try_from(number).map_err(|()| format!("unknown status number {number}"))?,
                    })
                };
                Ok(Self {
                    frame: message.frame,
                    target_frame: message.target_frame,
                    stamp_ns: message.stamp_ns,
                    body: message.body,
                    points: (0..count).map(point).collect::<Result<_, String>>()?,
                })
            }
        }
    };
}

field_row!(field_file);
