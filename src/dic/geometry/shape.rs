//! The shape functions and the outlines of subsets.

/// The shape function: the deformation of a subset between reference and target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Translation (2 parameters).
    Translation,
    /// Translation and rotation (3).
    Rigid,
    /// Translation and linear deformation (6).
    Affine,
    /// Translation and second-order deformation (12).
    Quadratic,
}

/// The outline of a subset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowShape {
    /// The whole square.
    Square,
    /// The inscribed disc.
    Circle,
    /// The disc without its inner half.
    Ring,
}

impl Shape {
    /// The names in configurations and on the command line.
    pub const WORDS: [(&str, Self); 4] = [
        ("translation", Self::Translation),
        ("rigid", Self::Rigid),
        ("affine", Self::Affine),
        ("quadratic", Self::Quadratic),
    ];

    /// Returns the number of parameters.
    pub(in crate::dic) fn parameter_count(self) -> usize {
        match self {
            Self::Translation => 2,
            Self::Rigid => 3,
            Self::Affine => 6,
            Self::Quadratic => 12,
        }
    }
}

impl WindowShape {
    /// The names in configurations and on the command line.
    pub const WORDS: [(&str, Self); 3] = [("square", Self::Square), ("circle", Self::Circle), ("ring", Self::Ring)];
}
