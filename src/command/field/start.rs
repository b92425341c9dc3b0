//! The initial guess of the subset search.

use super::FieldOptions;
use crate::console::UsageError;
use crate::dic::{
    BodyMotion, CorrelationParams, Method, Point, PreparedFrame, Region, Shape, Start, find_at_any_angle,
};
use crate::failure::Failure;
use crate::results::PointStatus;

/// The initial guess of the subset search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begin {
    /// The result of a neighbour, or a search of the whole range where there is none.
    Neighbor,
    /// A search of the whole range.
    Search,
    /// The motion of the whole region, found by searching every angle and the whole target.
    AnyAngle,
}

impl Begin {
    /// Names on the command line.
    pub const WORDS: [(&str, Self); 3] =
        [("neighbor", Self::Neighbor), ("search", Self::Search), ("any-angle", Self::AnyAngle)];
}

/// Minimum radius of a disc to search, px; a smaller one may match by chance.
const MIN_RADIUS_PX: f64 = 20.0;

/// Margin at the edge of the image when no region is given, px.
const MARGIN_PX: f64 = 8.0;

/// ZNCC above which no further part of the region is tried.
const CERTAIN_ZNCC: f64 = 0.9;

/// An initial guess, and a note for the user if it was searched.
pub(super) struct Found {
    pub(super) start: Start,
    pub(super) note: Option<String>,
}

/// Checks that subsets can rotate if the search covers every angle.
///
/// # Errors
///
/// [`UsageError`] naming the method or the shape.
pub(super) fn check(options: &FieldOptions) -> Result<(), UsageError> {
    match options.begin {
        Begin::AnyAngle => check_turns("--start any-angle", &options.params),
        Begin::Neighbor | Begin::Search => Ok(()),
    }
}

/// Checks that subsets can rotate.
///
/// # Errors
///
/// [`UsageError`] naming the feature that needs it, and the method or the shape.
pub(super) fn check_turns(needed: &str, params: &CorrelationParams) -> Result<(), UsageError> {
    let refuse = |key: &str, word: &str, range: &str| {
        Err(UsageError(format!("{needed}: needs subsets that can rotate, but {key} is {word}; allowed: {range}")))
    };
    if params.method != Method::IcGn {
        let word = Method::WORDS.iter().find(|(_, method)| *method == params.method).map_or("", |(word, _)| word);
        return refuse("the method", word, "ic-gn");
    }
    if params.shape == Shape::Translation {
        return refuse("the shape", "translation", "rigid, affine, quadratic");
    }
    Ok(())
}

/// Finds the initial guess that the options ask for; only `any-angle` searches one here.
///
/// # Errors
///
/// [`UsageError`] when the region is not found in the target.
pub(super) fn find_start(
    options: &FieldOptions,
    reference: &PreparedFrame,
    target: &PreparedFrame,
) -> Result<Found, Failure> {
    match options.begin {
        Begin::Neighbor => Ok(Found { start: Start::Neighbor, note: None }),
        Begin::Search => Ok(Found { start: Start::Search, note: None }),
        Begin::AnyAngle => search_any_angle(options, reference, target),
    }
}

/// Searches the region at every angle in the whole target: first as a whole, then parts of it.
///
/// It takes the match with the highest ZNCC, and searches no further from [`CERTAIN_ZNCC`] on.
///
/// # Errors
///
/// [`UsageError`] when no part is found with a sufficient ZNCC.
fn search_any_angle(
    options: &FieldOptions,
    reference: &PreparedFrame,
    target: &PreparedFrame,
) -> Result<Found, Failure> {
    let rectangle = searched_rectangle(options, reference);
    let Point { x_px, y_px } = rectangle.center();
    let (mut best, mut why): (Option<BodyMotion>, Option<PointStatus>) = (None, None);
    for region in options.region.iter().cloned().chain(candidate_regions(&rectangle)) {
        match find_at_any_angle(reference, target, &region, Point { x_px, y_px }) {
            Ok(found) if best.is_none_or(|best| found.zncc > best.zncc) => best = Some(found),
            Ok(_) => {}
            // `Ambiguous` explains more than that a part was out of frame.
            Err(status) => {
                why = Some(if why == Some(PointStatus::Ambiguous) { PointStatus::Ambiguous } else { status })
            }
        }
        if best.is_some_and(|best| best.zncc >= CERTAIN_ZNCC) {
            break;
        }
    }
    let Some(BodyMotion { motion, zncc, .. }) = best.filter(|best| best.zncc >= options.params.min_zncc) else {
        return Err(not_found_error(options, best, why).into());
    };
    let (u_px, v_px, angle_deg) = (motion.u_px, motion.v_px, motion.angle_deg);
    let note = format!(
        "start: rotation {angle_deg:.3} deg, displacement of ({x_px:.1}, {y_px:.1}) u {u_px:.3} px, v {v_px:.3} px, ZNCC {zncc:.3}"
    );
    Ok(Found { start: Start::Motion { x_px, y_px, u_px, v_px, angle_deg }, note: Some(note) })
}

/// A rectangle of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    pub(super) x_px: f64,
    pub(super) y_px: f64,
    pub(super) width_px: f64,
    pub(super) height_px: f64,
}

impl From<[f64; 4]> for Rectangle {
    fn from([x_px, y_px, width_px, height_px]: [f64; 4]) -> Self {
        Self { x_px, y_px, width_px, height_px }
    }
}

impl Rectangle {
    /// Returns the centre, px. Pixel centres are at integers, so the last one is one less than the size away.
    fn center(&self) -> Point {
        Point { x_px: self.x_px + 0.5 * (self.width_px - 1.0), y_px: self.y_px + 0.5 * (self.height_px - 1.0) }
    }

    /// Returns the region of whole pixels.
    pub(super) fn region(&self) -> Region {
        let (left, top) = (self.x_px - 0.5, self.y_px - 0.5);
        let (right, bottom) = (self.x_px + self.width_px - 0.5, self.y_px + self.height_px - 0.5);
        Region::Polygon {
            outline_px: vec![[left, top], [right, top], [right, bottom], [left, bottom]],
            holes_px: Vec::new(),
        }
    }
}

/// Returns the rectangle that holds the region, or else the image without a margin.
fn searched_rectangle(options: &FieldOptions, reference: &PreparedFrame) -> Rectangle {
    let (width, height) = (reference.width() as f64, reference.height() as f64);
    let bounds = options.region.as_ref().and_then(Region::bounds_px);
    match (options.roi_px, bounds) {
        (_, Some([left, top, right, bottom])) => [left, top, right - left + 1.0, bottom - top + 1.0].into(),
        (Some(roi), None) => roi.map(f64::from).into(),
        (None, None) => [MARGIN_PX, MARGIN_PX, width - 2.0 * MARGIN_PX, height - 2.0 * MARGIN_PX].into(),
    }
}

/// Returns the error of a region that no match was good enough for: `best`, or else the reason why there is none.
fn not_found_error(options: &FieldOptions, best: Option<BodyMotion>, why: Option<PointStatus>) -> UsageError {
    let min_zncc = options.params.min_zncc;
    let why = match (best, why) {
        (Some(best), _) => format!("the best match has a ZNCC of {:.3}, below min_zncc = {min_zncc}", best.zncc),
        (None, Some(status)) => status.as_str().to_owned(),
        (None, None) => format!("the region is smaller than {} px", 2.0 * MIN_RADIUS_PX),
    };
    UsageError(format!(
        "--start any-angle: cannot find the region of {} in {}: {why}",
        options.reference.display(),
        options.target.display()
    ))
}

/// Returns the rectangle and parts of it, the largest first; none with a radius below [`MIN_RADIUS_PX`].
///
/// The whole rectangle determines the angle best but fits into the image at few angles only. Discs can rotate freely,
/// and small ones are still visible when a part has left the image.
fn candidate_regions(rectangle: &Rectangle) -> Vec<Region> {
    let Rectangle { width_px: width, height_px: height, .. } = *rectangle;
    let Point { x_px: cx, y_px: cy } = rectangle.center();
    let large = 0.5 * (width.min(height) - 1.0);
    let disc = |x_px: f64, y_px: f64, radius_px: f64| Region::Disc { x_px, y_px, radius_px };
    let (right, down) = (0.5 * (width - 1.0), 0.5 * (height - 1.0));
    let corners = |radius_px: f64| {
        [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
            .map(|(a, b)| disc(cx + a * (right - radius_px), cy + b * (down - radius_px), radius_px))
    };
    let discs = [disc(cx, cy, large)].into_iter().chain(corners(0.7 * large));
    let discs = discs.chain([disc(cx, cy, 0.5 * large)]).chain(corners(0.5 * large));
    let is_large = |region: &Region| !matches!(region, Region::Disc { radius_px, .. } if *radius_px < MIN_RADIUS_PX);
    let all = (large >= MIN_RADIUS_PX).then(|| rectangle.region());
    all.into_iter().chain(discs.filter(is_large)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_lies_in_the_rectangle_and_none_is_too_small() {
        let parts = candidate_regions(&[10.0, 20.0, 200.0, 100.0].into());
        assert_eq!(parts.len(), 11);
        for part in &parts {
            let [left, top, right, bottom] = part.bounds_px().unwrap();
            assert!(left >= 9.5 && top >= 19.5 && right <= 209.5 && bottom <= 119.5, "{part:?}");
            assert!(right - left >= 2.0 * MIN_RADIUS_PX, "{part:?}");
        }
        assert_eq!(candidate_regions(&[0.0, 0.0, 60.0, 60.0].into()).len(), 6, "half of it is too small");
        assert!(candidate_regions(&[0.0, 0.0, 30.0, 200.0].into()).is_empty());
    }
}
