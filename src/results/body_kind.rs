//! The kinds of bodies.

use super::named::named_enum;

named_enum! {
    /// The kind of a body.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::results::{BodyKind, PointStatus};
    ///
    /// let kind: BodyKind = "patch".parse()?;
    /// assert_eq!(kind, BodyKind::Patch);
    /// // The keys of the rig file that help depend on the kind.
    /// let reason = PointStatus::Lost.reason(kind).unwrap();
    /// assert_eq!(reason.keys, ["body.polygon_px"]);
    /// # Ok::<(), ricochet::results::UnknownName>(())
    /// ```
    BodyKind: "kind" {
        /// A speckled ball. Its outline is a circle.
        Ball = 0 "ball",
        /// An upright rod with two tapes around it, one of them speckled.
        Rod = 1 "rod",
        /// The pixels inside a polygon that is drawn in the first frame of the stream.
        Patch = 2 "patch",
    }
}
