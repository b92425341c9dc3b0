//! The `impact` row: what a collision did to a body.

use super::columns::{Cell, Column};
use super::named::named_enum;
use super::{Estimate, PointStatus};

named_enum! {
    /// The contact law that describes the collision best.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::results::ForceLaw;
    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
    ///
    /// let impact = recording.truth_impacts()?.next().unwrap()?;
    /// assert_eq!(impact.force_law, ForceLaw::KelvinVoigt);
    /// // Without a law, the times of a collision come from the motion alone.
    /// assert_eq!(ForceLaw::default().as_str(), "none");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[derive(Default)]
    ForceLaw: "force_law" {
        /// No law was accepted; the times come from the motion alone.
        #[default]
        None = 0 "none",
        /// Spring and dashpot, F = k y + c v.
        KelvinVoigt = 1 "kelvin-voigt",
        /// F = k y^1.5 (1 + c v).
        HuntCrossley = 2 "hunt-crossley",
        /// F = k y^n (1 + c v), n free.
        PowerLaw = 3 "power-law",
    }
}

/// Passes the measured numbers of the `impact` row to a macro, in the order of the table: each with its number in the protobuf
/// message, and its standard uncertainty with its own. A `Moment` counts from [`Impact::origin_ns`].
macro_rules! impact_row {
    ($derive:ident) => {
        $derive! {
            /// The start of the force, s.
            start_s: Moment = 10, sigma_start_s = 11;
            /// The time at which the normal velocity crosses zero, s.
            deepest_s: Moment = 12, sigma_deepest_s = 13;
            /// The end of the force, s.
            end_s: Moment = 14, sigma_end_s = 15;
            /// The normal velocity at the start (negative: towards the surface), m/s.
            vn_before_m_s: Quantity = 16, sigma_vn_before_m_s = 17;
            /// The normal velocity at the end, m/s.
            vn_after_m_s: Quantity = 18, sigma_vn_after_m_s = 19;
            /// The tangential velocity at the start, m/s.
            vt_before_m_s: Quantity = 20, sigma_vt_before_m_s = 21;
            /// The tangential velocity at the end, m/s.
            vt_after_m_s: Quantity = 22, sigma_vt_after_m_s = 23;
            /// The spin before, counter-clockwise positive, rad/s.
            omega_before_rad_s: Quantity = 24, sigma_omega_before_rad_s = 25;
            /// The spin after, counter-clockwise positive, rad/s.
            omega_after_rad_s: Quantity = 26, sigma_omega_after_rad_s = 27;
            /// The normal speed after over the normal speed before (no unit).
            restitution: Quantity = 28, sigma_restitution = 29;
            /// The tangential restitution -(s after)/(s before), s the tangential speed of the contact point (no unit).
            restitution_tangential: Quantity = 30, sigma_restitution_tangential = 31;
            /// The tangential impulse over the normal impulse (no unit).
            impulse_ratio: Quantity = 32, sigma_impulse_ratio = 33;
            /// The duration of the contact, end minus start, s.
            contact_time_s: Quantity = 34, sigma_contact_time_s = 35;
            /// The deepest point of the centre below its position at the start, mm.
            compression_max_mm: Quantity = 36, sigma_compression_max_mm = 37;
            /// The highest normal acceleration, m/s².
            acceleration_max_m_s2: Quantity = 38, sigma_acceleration_max_m_s2 = 39;
            /// The time at which the contact point stops slipping, s.
            slip_end_s: Moment = 40, sigma_slip_end_s = 41;
            /// The time at which the force rises above 2 % of its peak, s.
            force_start_s: Moment = 42, sigma_force_start_s = 43;
            /// The time at which it falls below that again, s.
            force_end_s: Moment = 44, sigma_force_end_s = 45;
            /// The highest normal force, if the mass is known, N.
            force_max_n: Quantity = 46, sigma_force_max_n = 47;
            /// The kinetic energy that the centre's motion lost, without that of the spin, if the mass is known, J.
            energy_lost_j: Quantity = 48, sigma_energy_lost_j = 49;
            /// The acceleration along gravity in the free flights on both sides, m/s². Compared with gravity itself it
            /// checks the scale.
            gravity_m_s2: Quantity = 50, sigma_gravity_m_s2 = 51;
            /// The relative growth of the body's image per second in the flight before: it came nearer to the camera, or
            /// went to where the lens draws it larger. The other numbers are those of a body at its distance at first touch.
            growth_before_per_s: Quantity = 53, sigma_growth_before_per_s = 54;
            /// The relative growth of the body's image per second in the flight after.
            growth_after_per_s: Quantity = 55, sigma_growth_after_per_s = 56;
        }
    };
}
pub(crate) use impact_row;

/// Whether a number is a time on the recording's clock.
#[derive(Clone, Copy, PartialEq)]
enum Meaning {
    Moment,
    Quantity,
}

/// Derives the row from its numbers: the struct and its columns.
macro_rules! impact_struct {
    ($($(#[$doc:meta])* $number:ident: $Meaning:ident = $tag:tt, $sigma:ident = $sigma_tag:tt;)+) => {
        /// The number of measured numbers of an [`Impact`].
        ///
        /// # Examples
        ///
        /// ```
        /// use ricochet::results::IMPACT_NUMBERS;
        /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
        /// # let impact = recording.truth_impacts()?.next().unwrap()?;
        ///
        /// assert_eq!(impact.numbers().len(), IMPACT_NUMBERS);
        /// let measured = impact.numbers().into_iter().filter(|(_, number)| number.is_some()).count();
        /// // A simulation states no force. A measured collision has one if the rig file has the mass.
        /// assert!(measured < IMPACT_NUMBERS);
        /// # Ok::<(), Box<dyn std::error::Error>>(())
        /// ```
        pub const IMPACT_NUMBERS: usize = [$(stringify!($number)),+].len();

        /// One collision of one body.
        ///
        /// # Examples
        ///
        /// ```
        /// use ricochet::results::Impact;
        /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
        ///
        /// let impact = recording.truth_impacts()?.next().unwrap()?;
        /// // Moments are in s after the first frame of the stream, velocities in m/s.
        /// let [start, velocity] = [impact.start_s, impact.vn_before_m_s].map(Option::unwrap);
        /// assert_eq!(impact.origin_ns + (1e9 * start.value).round() as u64, 1_700_000_000_001_400_000);
        /// // The ball moves towards the surface.
        /// assert!(velocity.value < 0.0);
        /// // The same numbers by the names of their columns; `None` for one that was not measured.
        /// assert_eq!(impact.get("start_s"), Some(start));
        /// assert_eq!(impact.get("energy_lost_j"), None);
        /// assert!(Impact::is_moment("start_s") && !Impact::is_moment("contact_time_s"));
        /// # Ok::<(), Box<dyn std::error::Error>>(())
        /// ```
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Impact {
            /// The index of the body in the configuration.
            pub body: u32,
            /// Counts the collisions of this body from 0.
            pub number: u32,
            /// Counts up each time the same collision is published again with better numbers.
            pub revision: u32,
            /// The origin of the `_s` moments below, ns since the Unix epoch: the stream's first frame.
            pub origin_ns: u64,
            $($(#[$doc])* pub $number: Option<Estimate>,)+
            /// The contact law behind the times.
            pub force_law: ForceLaw,
            /// The probability of that law among those that follow the motion, 0 to 1; `None` where none was fitted.
            pub force_law_probability: Option<f64>,
            /// The status of the measurement.
            pub status: PointStatus,
        }

        impl Impact {
            /// The columns of the numbers, in the order of the table.
            const VALUES: [Column<Self>; IMPACT_NUMBERS] =
                [$(Column::double(stringify!($number), |row| Cell::Double(row.$number.map(|e| e.value)))),+];

            /// The columns of their standard uncertainties.
            const SIGMAS: [Column<Self>; IMPACT_NUMBERS] =
                [$(Column::double(stringify!($sigma), |row| Cell::Double(row.$number.map(|e| e.sigma)))),+];

            /// Returns revision 0 of a collision of which nothing is known yet, with the status [`PointStatus::Lost`].
            ///
            /// `body` is the index of the body, `number` that of its collision, both from 0.
            #[cfg_attr(all(doc, not(internals)), doc(hidden))]
            pub fn unknown(body: u32, number: u32, origin_ns: u64) -> Self {
                Self {
                    body,
                    number,
                    revision: 0,
                    origin_ns,
                    $($number: None,)+
                    force_law: ForceLaw::None,
                    force_law_probability: None,
                    status: PointStatus::Lost,
                }
            }

            /// Adds `shift_s` to every measured moment, to count it from that much earlier.
            ///
            /// Durations and `origin_ns` stay as they are.
            #[cfg_attr(all(doc, not(internals)), doc(hidden))]
            #[must_use]
            pub fn shifted(mut self, shift_s: f64) -> Self {
                $(
                    if let (Meaning::Moment, Some(moment)) = (Meaning::$Meaning, &mut self.$number) {
                        moment.value += shift_s;
                    }
                )+
                self
            }

            /// Whether the column of this name holds a moment, which counts from [`Impact::origin_ns`].
            ///
            /// `false` for every other number, columns of uncertainties, and unknown names.
            pub fn is_moment(name: &str) -> bool {
                [$((stringify!($number), Meaning::$Meaning)),+].contains(&(name, Meaning::Moment))
            }

            /// Returns every number with the name of its column, in the order of `impact_row!`; `None` for one that was
            /// not measured.
            pub fn numbers(&self) -> [(&'static str, Option<Estimate>); IMPACT_NUMBERS] {
                [$((stringify!($number), self.$number)),+]
            }
        }
    };
}

impact_row!(impact_struct);

/// The numbers up to the end of slip, which stand before `status`, with their uncertainties behind it. Numbers added later
/// stand last, each next to its uncertainty, so that no column of the table ever moves.
const FIRST_NUMBERS: usize = 16;

impl Impact {
    const FORCE_LAW: Column<Self> = Column::text("force_law", |row| Cell::Text(row.force_law.as_str().into()));
    const PROBABILITY: Column<Self> =
        Column::double("force_law_probability", |row| Cell::Double(row.force_law_probability));
    const STATUS: Column<Self> = Column::text("status", |row| Cell::Text(row.status.as_str().into()));

    /// Returns the number and standard uncertainty of the column with this name.
    ///
    /// `None` if no number has this name, or it was not measured.
    pub fn get(&self, name: &str) -> Option<Estimate> {
        self.numbers().into_iter().find(|(column, _)| *column == name).and_then(|(_, number)| number)
    }

    /// Returns the columns of the table behind those of the body and the collision's number, in their order.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn table() -> Vec<Column<Self>> {
        let [values, sigmas] = [Self::VALUES, Self::SIGMAS];
        let (first, later) = values.split_at(FIRST_NUMBERS);
        let (motion, slip) = first.split_at(FIRST_NUMBERS - 1);
        let (first_sigmas, later_sigmas) = sigmas.split_at(FIRST_NUMBERS);
        let mut columns = [motion, &[Self::FORCE_LAW], slip, &[Self::STATUS], first_sigmas].concat();
        columns.extend(later.iter().zip(later_sigmas).flat_map(|(value, sigma)| [*value, *sigma]));
        columns.push(Self::PROBABILITY);
        columns
    }

    /// Returns the columns of a JSON object: each number next to its uncertainty, then the law, its probability, the
    /// status.
    #[cfg_attr(all(doc, not(internals)), doc(hidden))]
    pub fn json_columns() -> Vec<Column<Self>> {
        let pairs = Self::VALUES.into_iter().zip(Self::SIGMAS).flat_map(|(value, sigma)| [value, sigma]);
        pairs.chain([Self::FORCE_LAW, Self::PROBABILITY, Self::STATUS]).collect()
    }
}
