//! Rows as tables: columns with names and types, and the macro that derives a row from its description.
//!
//! Each row of a topic is described once, by a macro such as `velocity_row!` that hands its columns to another macro. The
//! row itself is derived from it by `sample_row!` below, its shared-memory message in `message`, its protobuf message in
//! `recording`. CSV, Parquet, NumPy and JSON tables follow from [`Sample::COLUMNS`].

/// The type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A whole number.
    Integer,
    /// Nanoseconds since the Unix epoch.
    Stamp,
    /// A number in double precision, or none.
    Double,
    /// A number in single precision, or none.
    Single,
    /// Text.
    Text,
}

/// The value of one column in one row.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A whole number.
    Integer(i128),
    /// Nanoseconds since the Unix epoch.
    Stamp(u64),
    /// A number in double precision, or none.
    Double(Option<f64>),
    /// A number in single precision, or none.
    Single(Option<f32>),
    /// Text.
    Text(String),
}

/// Writes a number as the shortest text that reads back as the same number, and nothing for one that is missing or not
/// finite.
impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Integer(number) => number.fmt(f),
            Self::Stamp(stamp_ns) => stamp_ns.fmt(f),
            Self::Double(number) => number.filter(|number| number.is_finite()).map_or(Ok(()), |number| number.fmt(f)),
            Self::Single(number) => number.filter(|number| number.is_finite()).map_or(Ok(()), |number| number.fmt(f)),
            Self::Text(text) => f.write_str(text),
        }
    }
}

/// The name and the type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heading {
    /// The name, which ends in the unit.
    pub name: &'static str,
    /// The type.
    pub kind: Kind,
}

/// A column of the rows `R`.
#[derive(Debug, Clone, Copy)]
pub struct Column<R> {
    /// The name and the type.
    pub heading: Heading,
    /// Returns its value in a row.
    pub cell: fn(&R) -> Cell,
}

impl<R> Column<R> {
    /// Returns a column with numbers in double precision, read from a row by `cell`.
    pub const fn double(name: &'static str, cell: fn(&R) -> Cell) -> Self {
        Self { heading: Heading { name, kind: Kind::Double }, cell }
    }

    /// Returns a column with numbers in single precision, read from a row by `cell`.
    pub const fn single(name: &'static str, cell: fn(&R) -> Cell) -> Self {
        Self { heading: Heading { name, kind: Kind::Single }, cell }
    }

    /// Returns a column with text, read from a row by `cell`.
    pub const fn text(name: &'static str, cell: fn(&R) -> Cell) -> Self {
        Self { heading: Heading { name, kind: Kind::Text }, cell }
    }
}

/// A number of a group, which may be missing on its own.
pub trait Part: Copy {
    /// Returns the number; `None` if it was not measured.
    fn known(self) -> Option<f64>;

    /// Creates the part of a measured group from its number, `None` for a missing one.
    ///
    /// Returns `None` if the number is missing and the group cannot be without it.
    fn from_number(number: Option<f64>) -> Option<Self>;
}

impl Part for f64 {
    fn known(self) -> Option<f64> {
        Some(self)
    }

    fn from_number(number: Option<f64>) -> Option<Self> {
        number
    }
}

impl Part for Option<f64> {
    fn known(self) -> Option<f64> {
        self
    }

    fn from_number(number: Option<f64>) -> Option<Self> {
        Some(number)
    }
}

/// A row per frame and body.
pub trait Sample: Sized + 'static {
    /// The columns behind frame, body and time.
    const COLUMNS: &'static [Column<Self>];

    /// Returns the sequence number of the frame.
    fn frame(&self) -> u64;

    /// Returns the index of the body in the configuration.
    fn body(&self) -> u32;

    /// Returns the start of the exposure, ns since the Unix epoch.
    fn stamp_ns(&self) -> u64;
}

/// Derives a row per frame and body from its description: the struct, its groups of numbers, and its table.
macro_rules! sample_row {
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
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $Row {
            /// The sequence number of the frame.
            pub frame: u64,
            /// The index of the body in the configuration.
            pub body: u32,
            /// The start of the exposure, ns since the Unix epoch.
            pub stamp_ns: u64,
            $($(#[$number_doc])* pub $number: Option<f64>,)*
            $(
                #[doc = concat!("The [`", stringify!($Group), "`]; `None` where it was not measured.")]
                pub $group: Option<$Group>,
            )*
            $($(#[$later_doc])* pub $later: Option<f64>,)*
            $($(#[$name_doc])* pub $name: $Name,)*
            $($(#[$reason_doc])* pub $reason: $crate::results::PointStatus,)*
            $($(#[$nested_doc])* pub $nested: Option<$Nested>,)*
            /// The status of the measurement.
            pub status: $crate::results::PointStatus,
        }

        $(
            $(#[$group_doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Default)]
            pub struct $Group {
                $($(#[$part_doc])* pub $part: $Part,)*
                $($(#[$count_doc])* pub $count: u32,)*
            }
        )*

        impl $crate::results::Sample for $Row {
            const COLUMNS: &'static [$crate::results::Column<Self>] = {
                use $crate::results::{Cell, Column};
                &[
                    $(Column::double(stringify!($number), |row| Cell::Double(row.$number)),)*
                    $($(Column::double(stringify!($part), |row| Cell::Double(row.$group.and_then(|group| $crate::results::Part::known(group.$part)))),)*)*
                    $(Column::double(stringify!($later), |row| Cell::Double(row.$later)),)*
                    $(Column::text(stringify!($name), |row| Cell::Text(row.$name.as_str().into())),)*
                    Column::text("status", |row| Cell::Text(row.status.as_str().into())),
                    $(Column::text(stringify!($reason), |row| Cell::Text(row.$reason.as_str().into())),)*
                ]
            };

            fn frame(&self) -> u64 {
                self.frame
            }

            fn body(&self) -> u32 {
                self.body
            }

            fn stamp_ns(&self) -> u64 {
                self.stamp_ns
            }
        }
    };
}
pub(crate) use sample_row;
