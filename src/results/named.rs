//! Enums whose values have a number on the bus and a name in tables and files.

use std::fmt;

/// Declares an enum: each value with its number and its name.
///
/// Adds `ALL`, `as_str`, `from_number` and [`FromStr`](std::str::FromStr). The text after the enum's name is the noun for a
/// value in errors.
macro_rules! named_enum {
    (
        $(#[$meta:meta])*
        $Enum:ident: $noun:literal { $($(#[$value_meta:meta])* $Value:ident = $number:literal $name:literal,)+ }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u32)]
        pub enum $Enum {
            $($(#[$value_meta])* $Value = $number,)+
        }

        impl $Enum {
            /// Every value, in the order of its number.
            pub const ALL: [Self; [$($number),+].len()] = [$(Self::$Value),+];

            /// Returns the name used in tables, files and configurations.
            pub fn as_str(self) -> &'static str {
                match self {
                    $(Self::$Value => $name,)+
                }
            }

            /// Returns the value with this number, if there is one.
            pub fn from_number(number: u32) -> Option<Self> {
                Self::ALL.into_iter().find(|value| *value as u32 == number)
            }
        }

        impl TryFrom<i32> for $Enum {
            type Error = ();

            fn try_from(number: i32) -> Result<Self, ()> {
                u32::try_from(number).ok().and_then(Self::from_number).ok_or(())
            }
        }

        impl std::str::FromStr for $Enum {
            type Err = $crate::results::UnknownName;

            fn from_str(name: &str) -> Result<Self, Self::Err> {
                let value = Self::ALL.into_iter().find(|value| value.as_str() == name);
                value.ok_or_else(|| $crate::results::UnknownName {
                    noun: $noun,
                    name: name.to_owned(),
                    known: &[$($name),+],
                })
            }
        }
    };
}
pub(crate) use named_enum;

/// A name that is none of those of an enum.
///
/// # Examples
///
/// ```
/// use ricochet::results::PointStatus;
///
/// let error = "seen".parse::<PointStatus>().unwrap_err();
/// assert_eq!((error.noun, error.name.as_str()), ("status", "seen"));
/// assert!(error.known.contains(&"occluded"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownName {
    /// The thing that was to be named: `status`, `phase`, ...
    pub noun: &'static str,
    /// The name that was given.
    pub name: String,
    /// The names there are.
    pub known: &'static [&'static str],
}

impl fmt::Display for UnknownName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unknown {} {:?}: not one of {}", self.noun, self.name, self.known.join(", "))
    }
}

impl std::error::Error for UnknownName {}
