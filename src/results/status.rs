//! The status of a measurement and the phase of a collision.

use super::named::named_enum;

named_enum! {
    /// The status of a measurement at one point or of one body.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::results::PointStatus;
    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
    ///
    /// // Only valid rows are measured; the others have a reason instead of numbers, or a predicted position.
    /// let rows = recording.truth()?.collect::<Result<Vec<_>, _>>()?;
    /// assert!(rows.iter().all(|row| row.status == PointStatus::Valid));
    /// // A status has a name in tables and files, and a number on the bus.
    /// assert_eq!("out-of-frame".parse::<PointStatus>(), Ok(PointStatus::OutOfFrame));
    /// assert_eq!(PointStatus::from_number(8), Some(PointStatus::Predicted));
    /// assert_eq!(PointStatus::ALL.map(PointStatus::as_str).len(), 9);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[derive(Default)]
    PointStatus: "status" {
        /// Measured; the numbers in the row hold.
        #[default]
        Valid = 0 "valid",
        /// Too little texture, or a saturated subset.
        LowContrast = 1 "low-contrast",
        /// The ZNCC of the best match is below the limit, or the refinement did not converge.
        LowCorrelation = 2 "low-correlation",
        /// Two matches are about equally good, as on a regular grid.
        Ambiguous = 3 "ambiguous",
        /// Measured, but the neighbours disagree; a collision: measured, but no fixed surface and no fall explains it.
        Outlier = 4 "outlier",
        /// Covered by something in front of it.
        Occluded = 5 "occluded",
        /// The subset or the body reaches over the edge of the image.
        OutOfFrame = 6 "out-of-frame",
        /// The body was not found, or the frame was lost.
        Lost = 7 "lost",
        /// The body was not found, but followed shortly before; the position is predicted, not measured.
        Predicted = 8 "predicted",
    }
}

named_enum! {
    /// The phase of a collision a body was in when its sample was published.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::results::Phase;
    /// # let recording = ricochet::recording::Recording::open("recordings/lacrosse.mcap".as_ref())?;
    ///
    /// let rows = recording.truth()?.collect::<Result<Vec<_>, _>>()?;
    /// let contact: Vec<u64> = rows.iter().filter(|row| row.phase == Phase::Contact).map(|row| row.frame).collect();
    /// // At 10 000 frames per second, the contact begins 1.4 ms after the first frame.
    /// assert_eq!(contact.first(), Some(&14));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[derive(Default)]
    Phase: "phase" {
        /// Not known: no surface, or too few samples yet.
        #[default]
        Unknown = 0 "unknown",
        /// Free flight.
        Flight = 1 "flight",
        /// Touching the surface.
        Contact = 2 "contact",
        /// Free flight after a contact.
        Rebound = 3 "rebound",
    }
}
