//! The rows of `/impact` and `/truth_impact`.

use super::{Row, unknown_name};
use crate::recording::schema::proto::message;
use crate::results::{Estimate, impact_row};

/// Derives the protobuf message from the numbers of the row.
macro_rules! impact_file {
    ($($(#[$doc:meta])* $number:ident: $Meaning:ident = $tag:tt, $sigma:ident = $sigma_tag:tt;)+) => {
        message! {
            /// One collision of one body. Each number X comes with its standard uncertainty sigma_X: both, or none.
            Impact {
                [uint32] body: u32 = 1,
                [uint32] number: u32 = 2,
                [uint32] revision: u32 = 3,
                [fixed64] origin_ns: u64 = 4,
                $([double, optional] $number: Option<f64> = $tag, [double, optional] $sigma: Option<f64> = $sigma_tag,)+
                [string] force_law: String = 5,
                [double, optional] force_law_probability: Option<f64> = 52,
                [string] status: String = 6,
            }
        }

        impl Row for crate::results::Impact {
            type Message = Impact;

            fn to_message(&self) -> Impact {
                Impact {
                    body: self.body,
                    number: self.number,
                    revision: self.revision,
                    origin_ns: self.origin_ns,
                    $($number: self.$number.map(|e| e.value), $sigma: self.$number.map(|e| e.sigma),)+
                    force_law: self.force_law.as_str().into(),
                    force_law_probability: self.force_law_probability,
                    status: self.status.as_str().into(),
                }
            }

            fn from_message(message: Impact) -> Result<Self, String> {
                let estimate = |value: Option<f64>, sigma| value.zip(sigma).map(|(value, sigma)| Estimate { value, sigma });
                Ok(Self {
                    body: message.body,
                    number: message.number,
                    revision: message.revision,
                    origin_ns: message.origin_ns,
                    $($number: estimate(message.$number, message.$sigma),)+
                    force_law: message.force_law.parse().map_err(unknown_name)?,
                    force_law_probability: message.force_law_probability,
                    status: message.status.parse().map_err(unknown_name)?,
                })
            }
        }
    };
}

impact_row!(impact_file);
