//! The kinds of bodies.

/// The kind of body, as far as its motion is concerned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// It rotates, and touches the surface at one radius from its centre.
    Ball,
    /// It stays upright and strikes with its end; it has no spin and no radius.
    Rod,
    /// It rotates, but its contact point is unknown; it has no radius.
    Patch,
}
