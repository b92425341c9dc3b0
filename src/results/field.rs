//! Displacement fields.

use super::PointStatus;
use super::columns::{Cell, Column};

/// Passes the columns of the `field` table to a macro, each with its number in the protobuf message.
macro_rules! field_row {
    ($derive:ident) => {
        $derive! {
            position {
                /// The centre of the subset in the reference frame along x, px.
                x_px = 5,
                /// The centre of the subset in the reference frame along y (down), px.
                y_px = 6,
            }
            displacement {
                /// The displacement along x (right), px.
                u_px = 7,
                /// The displacement along y (down), px.
                v_px = 8,
            }
            sigmas {
                /// The standard uncertainty of `u_px`, px.
                sigma_u_px = 9,
                /// The standard uncertainty of `v_px`, px.
                sigma_v_px = 10,
            }
            scores {
                /// The zero-mean normalised cross-correlation at the result, -1 to 1.
                zncc = 11,
                /// The ratio of the highest correlation peak to the second highest.
                peak_ratio = 12,
            }
            status = 13,
        }
    };
}
pub(crate) use field_row;

/// Derives the row from its columns: the structs and the table.
macro_rules! field_structs {
    (
        position { $($(#[$position_doc:meta])* $position:ident = $position_tag:tt,)* }
        displacement { $($(#[$part_doc:meta])* $part:ident = $part_tag:tt,)* }
        sigmas { $($(#[$sigma_doc:meta])* $sigma:ident = $sigma_tag:tt,)* }
        scores { $($(#[$score_doc:meta])* $score:ident = $score_tag:tt,)* }
        status = $status_tag:tt,
    ) => {
        /// The displacement of one point, with its standard uncertainty.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Displacement {
            $($(#[$part_doc])* pub $part: f32,)*
            $($(#[$sigma_doc])* pub $sigma: f32,)*
        }

        /// The result of one subset: its position in the reference frame and its displacement.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct FieldPoint {
            $($(#[$position_doc])* pub $position: f32,)*
            /// The displacement to the target frame; `None` for the reason in `status`.
            pub displacement: Option<Displacement>,
            $($(#[$score_doc])* pub $score: Option<f32>,)*
            /// The status of the subset.
            pub status: PointStatus,
        }

        impl FieldPoint {
            /// The columns of the table behind the frame.
            pub const COLUMNS: &'static [Column<Self>] = &[
                $(Column::single(stringify!($position), |row| Cell::Single(Some(row.$position))),)*
                $(Column::single(stringify!($part), |row| Cell::Single(row.displacement.map(|d| d.$part))),)*
                $(Column::single(stringify!($sigma), |row| Cell::Single(row.displacement.map(|d| d.$sigma))),)*
                $(Column::single(stringify!($score), |row| Cell::Single(row.$score)),)*
                Column::text("status", |row| Cell::Text(row.status.as_str().into())),
            ];
        }
    };
}

field_row!(field_structs);

/// The displacement field of one body from one frame to a later one.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PairField {
    /// The sequence number of the reference frame.
    pub frame: u64,
    /// The sequence number of the target frame.
    pub target_frame: u64,
    /// The start of the reference frame's exposure, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// The index of the body in the configuration.
    pub body: u32,
    /// The subsets, row by row.
    pub points: Vec<FieldPoint>,
}
