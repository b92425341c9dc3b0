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
        ///
        /// # Examples
        ///
        /// ```
        /// use ricochet::results::Displacement;
        ///
        /// let displacement = Displacement { u_px: 1.5, v_px: -0.25, sigma_u_px: 0.01, sigma_v_px: 0.01 };
        /// // y points down, so this subset has moved up.
        /// assert!(displacement.v_px < 0.0);
        /// // It has certainly moved: by far more than its standard uncertainty.
        /// assert!(displacement.v_px.abs() > 5.0 * displacement.sigma_v_px);
        /// ```
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Displacement {
            $($(#[$part_doc])* pub $part: f32,)*
            $($(#[$sigma_doc])* pub $sigma: f32,)*
        }

        /// The result of one subset: its position in the reference frame and its displacement.
        ///
        /// # Examples
        ///
        /// ```
        /// use ricochet::results::{Displacement, FieldPoint, PointStatus};
        ///
        /// let point = FieldPoint {
        ///     x_px: 40.0,
        ///     y_px: 25.0,
        ///     displacement: Some(Displacement { u_px: 1.5, v_px: -0.25, sigma_u_px: 0.01, sigma_v_px: 0.01 }),
        ///     zncc: Some(0.98),
        ///     peak_ratio: Some(3.1),
        ///     status: PointStatus::Valid,
        /// };
        /// // A subset at x in the reference frame is at x + u in the target frame.
        /// let target_px = point.displacement.map(|moved| [point.x_px + moved.u_px, point.y_px + moved.v_px]);
        /// assert_eq!(target_px, Some([41.5, 24.75]));
        /// ```
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
            #[cfg_attr(all(doc, not(internals)), doc(hidden))]
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
///
/// # Examples
///
/// ```no_run
/// use ricochet::recording::Recording;
///
/// for field in Recording::open("shot.mcap".as_ref())?.fields()? {
///     let field = field?;
///     let interval_frames = field.target_frame - field.frame;
///     for point in &field.points {
///         match point.displacement {
///             Some(moved) => println!("{} px/frame", moved.u_px / interval_frames as f32),
///             None => println!("not measured: {}", point.status.as_str()),
///         }
///     }
/// }
/// # Ok::<(), ricochet::recording::RecordingError>(())
/// ```
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
