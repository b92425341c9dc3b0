//! The reason behind each status of a body, and the keys of the rig file that change it.

use super::{BodyKind, PointStatus};

/// The reason why a body was not measured in a frame.
///
/// # Examples
///
/// ```
/// use ricochet::results::{BodyKind, PointStatus};
///
/// let reason = PointStatus::Occluded.reason(BodyKind::Ball).unwrap();
/// assert_eq!(reason.text, "something covers the body");
/// println!("{}; {} ({})", reason.text, reason.advice, reason.keys.join(", "));
/// // A valid measurement needs no reason.
/// assert_eq!(PointStatus::Valid.reason(BodyKind::Ball), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reason {
    /// The reason in a few words.
    pub text: &'static str,
    /// The keys of the rig file that change it, the most likely first. Those of a body begin with `body.`.
    pub keys: &'static [&'static str],
    /// The change that helps.
    pub advice: &'static str,
}

impl PointStatus {
    /// Returns the reason why a body of this kind has this status, and the change that helps; `None` if it is valid.
    #[must_use]
    pub fn reason(self, kind: BodyKind) -> Option<Reason> {
        let reason = |text, keys, advice| Some(Reason { text, keys, advice });
        match self {
            Self::Valid => None,
            Self::LowContrast => reason(
                "too little texture on the body, or saturated pixels",
                &["correlation.subset_size_px"],
                "make it larger, so that a subset holds more texture",
            ),
            Self::LowCorrelation => reason(
                "the subsets were not found again in the next frame",
                &["correlation.search_px", "correlation.min_zncc"],
                "search farther than the body moves between two frames, or accept weaker matches",
            ),
            Self::Ambiguous => reason(
                "the outline is not where the motion leads",
                match kind {
                    BodyKind::Patch => &["body.polygon_px", "correlation.subset_size_px"],
                    BodyKind::Ball | BodyKind::Rod => &["body.roi_px", "correlation.subset_size_px"],
                },
                "exclude other things that look like the body",
            ),
            Self::Outlier => reason(
                "the subsets contradict each other",
                &["correlation.subset_size_px"],
                "make it larger, so that a subset is unique",
            ),
            Self::Occluded => reason(
                "something covers the body",
                match kind {
                    BodyKind::Patch => &["body.polygon_px"],
                    BodyKind::Ball | BodyKind::Rod => &["body.roi_px"],
                },
                "follow a part that stays visible",
            ),
            Self::OutOfFrame => reason(
                "the body reaches over the edge of the image",
                match kind {
                    BodyKind::Patch => &["body.polygon_px"],
                    BodyKind::Ball | BodyKind::Rod => &["body.roi_px"],
                },
                "measure the part of the film in which all of it is visible",
            ),
            Self::Lost => match kind {
                BodyKind::Ball => reason(
                    "no outline of a ball was found",
                    &["body.min_radius_px", "body.max_radius_px", "body.roi_px"],
                    "search the radius that the ball has in the image, where it is",
                ),
                BodyKind::Rod => reason(
                    "no tapes of a rod were found",
                    &["body.edges", "body.roi_px"],
                    "follow as many tape edges as are visible, where they are",
                ),
                BodyKind::Patch => reason(
                    "the pixels of the patch were not found again",
                    &["body.polygon_px"],
                    "draw it around texture that is visible in the first frame",
                ),
            },
            Self::Predicted => reason(
                "no outline was found, so the position is predicted from the frames before",
                match kind {
                    BodyKind::Ball => &["body.min_radius_px", "body.max_radius_px", "body.roi_px"],
                    BodyKind::Rod => &["body.edges", "body.roi_px"],
                    BodyKind::Patch => &["body.polygon_px"],
                },
                "make the rim stand out from the background, or put speckles on the body",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_status_but_valid_has_a_reason_and_a_key_for_every_kind() {
        for (status, kind) in PointStatus::ALL.into_iter().flat_map(|s| BodyKind::ALL.map(|kind| (s, kind))) {
            let reason = status.reason(kind);
            assert_eq!(reason.is_some(), status != PointStatus::Valid, "{status:?} {kind:?}");
            assert!(reason.is_none_or(|reason| !reason.keys.is_empty()), "{status:?} {kind:?}");
        }
    }
}
