//! Why a number is there, or is not.

/// What became of a measurement at one point or of one body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum PointStatus {
    /// Measured; the numbers beside it hold.
    #[default]
    Valid = 0,
    /// Too little texture (or a saturated subset) to measure anything.
    LowContrast = 1,
    /// The best match is not similar enough (ZNCC under the limit), or the refinement did not converge.
    LowCorrelation = 2,
    /// Two matches are about equally good, as on a regular grid.
    Ambiguous = 3,
    /// Measured, but its neighbours disagree.
    Outlier = 4,
    /// Hidden behind something.
    Occluded = 5,
    /// The subset or the body reaches over the edge of the image.
    OutOfFrame = 6,
    /// The body was not found, or the frame was lost.
    Lost = 7,
}

impl PointStatus {
    /// Every status, in the order of its number.
    pub const ALL: [Self; 8] = [
        Self::Valid,
        Self::LowContrast,
        Self::LowCorrelation,
        Self::Ambiguous,
        Self::Outlier,
        Self::Occluded,
        Self::OutOfFrame,
        Self::Lost,
    ];

    /// The word used in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::LowContrast => "low-contrast",
            Self::LowCorrelation => "low-correlation",
            Self::Ambiguous => "ambiguous",
            Self::Outlier => "outlier",
            Self::Occluded => "occluded",
            Self::OutOfFrame => "out-of-frame",
            Self::Lost => "lost",
        }
    }

    /// The status with this word, if there is one.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.word() == word)
    }

    /// The status with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|status| *status as u32 == number)
    }
}

/// Where in a collision a body was when its sample was published.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(u32)]
pub enum Phase {
    /// Not known: no surface, or too few samples yet.
    #[default]
    Unknown = 0,
    /// Free flight.
    Flight = 1,
    /// Touching the surface.
    Contact = 2,
    /// Free flight after a contact.
    Rebound = 3,
}

impl Phase {
    /// Every phase, in the order of its number.
    pub const ALL: [Self; 4] = [Self::Unknown, Self::Flight, Self::Contact, Self::Rebound];

    /// The word used in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Flight => "flight",
            Self::Contact => "contact",
            Self::Rebound => "rebound",
        }
    }

    /// The phase with this word, if there is one.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|phase| phase.word() == word)
    }

    /// The phase with this number, if there is one.
    pub fn from_number(number: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|phase| *phase as u32 == number)
    }
}
