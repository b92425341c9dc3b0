//! The `impact` topic.

use super::layout::described;
use crate::results::{Estimate, ForceLaw, Impact, PointStatus, impact_row};
use iceoryx2::prelude::ZeroCopySend;

described! {
    "ricochet.Estimate.v1"
    /// A number that may be missing, with its standard uncertainty.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::EstimateMessage;
    /// use ricochet::results::Estimate;
    ///
    /// let measured = EstimateMessage { value: 0.798, sigma: 0.004, known: 1 };
    /// assert_eq!(Option::from(measured), Some(Estimate { value: 0.798, sigma: 0.004 }));
    /// // A missing number is zero in memory, but not a measured zero.
    /// assert_eq!(Option::<Estimate>::from(EstimateMessage::default()), None);
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct EstimateMessage {
        /// The number; 0 and meaningless unless `known` is 1.
        pub value: f64,
        /// Its standard uncertainty.
        pub sigma: f64,
        /// 1 when measured, 0 when missing.
        pub known: u64,
    }
}

impl From<Option<Estimate>> for EstimateMessage {
    fn from(estimate: Option<Estimate>) -> Self {
        estimate.map_or_else(Self::default, |Estimate { value, sigma }| Self { value, sigma, known: 1 })
    }
}

impl From<EstimateMessage> for Option<Estimate> {
    fn from(message: EstimateMessage) -> Self {
        (message.known == 1).then_some(Estimate { value: message.value, sigma: message.sigma })
    }
}

/// Derives the message from the numbers of the row.
macro_rules! impact_message {
    ($($(#[$doc:meta])* $number:ident: $Meaning:ident = $tag:tt, $sigma:ident = $sigma_tag:tt;)+) => {
        described! {
            "ricochet.Impact.v4"
            /// One collision of one body. It is published again with a higher revision when its numbers improve.
            ///
            /// # Examples
            ///
            /// ```
            /// use ricochet::message::ImpactMessage;
            /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
            /// # let impact = recording.truth_impacts()?.next().unwrap()?;
            ///
            /// let message = ImpactMessage::new(&impact, 0);
            /// // The first publication of the first collision of the first body.
            /// assert_eq!((message.body, message.number, message.revision), (0, 0, 0));
            /// // Numbers that were not measured are `None` in the row.
            /// assert_eq!(message.force_max_n.known, 0);
            /// let row = message.impact().unwrap();
            /// assert_eq!((row.start_s, row.force_max_n), (impact.start_s, None));
            /// # Ok::<(), Box<dyn std::error::Error>>(())
            /// ```
            #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
            #[repr(C)]
            pub struct ImpactMessage {
                /// The start of the acquire process that the frames belong to.
                pub run_id: u64,
                /// The origin of the `_s` moments, ns since the Unix epoch.
                pub origin_ns: u64,
                /// The index of the body in the rig's configuration.
                pub body: u32,
                /// Counts the collisions of this body from 0.
                pub number: u32,
                /// Counts up each time the same collision is published again.
                pub revision: u32,
                /// The number of the `ForceLaw`.
                pub force_law: u32,
                /// The number of the `PointStatus`.
                pub status: u32,
                /// The probability of that law among those that follow the motion, 0 to 1; 0 where none was fitted.
                pub force_law_probability: f32,
                $($(#[$doc])* pub $number: EstimateMessage,)+
            }
        }

        impl ImpactMessage {
            /// Creates the message of a collision of this run; `run_id` is the start of the acquire process.
            pub fn new(impact: &Impact, run_id: u64) -> Self {
                Self {
                    run_id,
                    origin_ns: impact.origin_ns,
                    body: impact.body,
                    number: impact.number,
                    revision: impact.revision,
                    force_law: impact.force_law as u32,
                    status: impact.status as u32,
                    force_law_probability: impact.force_law_probability.unwrap_or_default() as f32,
                    $($number: impact.$number.into(),)+
                }
            }

            /// Returns the collision; `None` when the number of a law or status is unknown.
            pub fn impact(&self) -> Option<Impact> {
                let probability = f64::from(self.force_law_probability);
                Some(Impact {
                    body: self.body,
                    number: self.number,
                    revision: self.revision,
                    origin_ns: self.origin_ns,
                    $($number: self.$number.into(),)+
                    force_law: ForceLaw::from_number(self.force_law)?,
                    force_law_probability: (probability > 0.0).then_some(probability),
                    status: PointStatus::from_number(self.status)?,
                })
            }
        }
    };
}

impact_row!(impact_message);
