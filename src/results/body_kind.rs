//! The kinds of bodies.

use super::named::named_enum;

named_enum! {
    /// The kind of a body.
    BodyKind: "kind" {
        /// A speckled ball. Its outline is a circle.
        Ball = 0 "ball",
        /// An upright rod with two tapes around it, one of them speckled.
        Rod = 1 "rod",
        /// The pixels inside a polygon that is drawn in the first frame of the stream.
        Patch = 2 "patch",
    }
}
