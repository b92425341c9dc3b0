//! The compared methods: each measures the motion of the ball's centre from two frames.

use super::film::FramePair;
use super::plain_correlation::PlainCorrelator;
use crate::ball::{BallFinder, BallParams};
use crate::console::UsageError;
use crate::dic::{
    self, CenterVector, CenteredFrame, CorrelationParams, Correlator, GridPoint, Point, PolarCorrelator, PreparedFrame,
    Radii, Region, RigidBody, RigidMotion, Start, center_fit,
};
use crate::dic::{grid, rigid_fit};
use crate::failure::Failure;
use crate::results::{Circle, FieldPoint, PointStatus};

/// Spline points between two pixels, as in the paper.
const SPLINE_POINTS: u32 = 5;

/// Search range, px: twice the fastest film's displacement plus that of the rim by rotation.
const SEARCH_PX: u32 = 8;

/// Margin between subsets and the rim, as a fraction of the radius, as in a measurement.
const RIM_CLEARANCE: f64 = 0.04;

/// Inner radius of the ring, as a fraction of the ball's, as in a measurement.
const RING_SHARE: f64 = 0.35;

/// Range of radii in the ball search, px.
const RADII_PX: [f64; 2] = [48.0, 72.0];

/// Minimum number of windows for a motion.
const MIN_WINDOWS: usize = 3;

/// A compared method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    /// The paper's method: windows splined with 5 points, the highest grid point of their correlation.
    Paper,
    /// The same with a peak fit.
    PaperFit,
    /// Plain windows, and a spline through the peak of the normalised correlation.
    PeakSpline,
    /// Plain windows, correlated by Eq. 4 without normalisation by the overlap; 5 points on the peak.
    PeakPlain,
    /// Subsets refined by IC-GN, and the rigid motion that fits them best.
    IcGn,
    /// The centre by IC-GN subsets, the rotation by a ring of pixels around it.
    Ring,
    /// The whole ball in one match.
    Rigid,
}

impl Method {
    /// Names on the command line and in tables.
    pub(super) const WORDS: [(&str, Self); 7] = [
        ("paper", Self::Paper),
        ("paper-fit", Self::PaperFit),
        ("peak-spline", Self::PeakSpline),
        ("peak-plain", Self::PeakPlain),
        ("ic-gn", Self::IcGn),
        ("ring", Self::Ring),
        ("rigid", Self::Rigid),
    ];

    pub(super) fn as_str(self) -> &'static str {
        Self::WORDS.iter().find(|(_, method)| *method == self).map_or("", |(word, _)| word)
    }

    /// Returns the label in a legend.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Paper => "paper: splined windows, highest point",
            Self::PaperFit => "splined windows, peak fitted",
            Self::PeakSpline => "peak splined, normalised",
            Self::PeakPlain => "peak splined, as Eq. 4",
            Self::IcGn => "IC-GN windows",
            Self::Ring => "ring around the centre",
            Self::Rigid => "whole ball, rigid",
        }
    }
}

/// Size and grid step of the windows, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Windows {
    pub(super) subset_size_px: u32,
    pub(super) step_px: u32,
}

/// The result of one method on one pair of frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    /// Displacement of the ball's centre along x and y, px, and rotation, deg.
    pub(super) step: Option<[f64; 3]>,
    /// Their standard uncertainties, if the method estimates them.
    pub(super) sigma: Option<[f64; 3]>,
    /// Number of windows or pixels used.
    pub(super) points: u32,
    pub(super) status: PointStatus,
}

/// The plan and buffers of one thread.
pub(super) struct Evaluator {
    methods: Vec<(Method, Engine)>,
    finder: BallFinder,
    windows: Windows,
    side_px: usize,
    field: Vec<FieldPoint>,
    frames: [PreparedFrame; 2],
    ring: PolarCorrelator,
}

/// The correlator of a method.
enum Engine {
    Correlator(Box<Correlator>),
    Plain(PlainCorrelator),
}

impl Evaluator {
    /// Plans the methods for square frames.
    ///
    /// # Errors
    ///
    /// When the window size or step is out of range, or there is no room for a window.
    pub(super) fn new(methods: &[Method], windows: Windows, side_px: u32) -> Result<Self, Failure> {
        let side_px = side_px as usize;
        let engine = |method: &Method| -> Result<(Method, Engine), Failure> {
            Ok((*method, plan_engine(*method, windows, side_px)?))
        };
        Ok(Self {
            methods: methods.iter().map(engine).collect::<Result<_, Failure>>()?,
            finder: BallFinder::new(&BallParams::new(RADII_PX[0], RADII_PX[1]), side_px, side_px)?,
            windows,
            side_px,
            field: Vec::new(),
            frames: Default::default(),
            ring: PolarCorrelator::default(),
        })
    }

    /// Checks that more than three windows fit on a ball of this diameter in the middle of a frame.
    ///
    /// # Errors
    ///
    /// [`UsageError`] naming the options.
    pub(super) fn check_room(&self, diameter_px: f64) -> Result<(), UsageError> {
        let middle = 0.5 * self.side_px as f64;
        let radius_px = 0.5 * diameter_px;
        let circle = Circle {
            x_px: middle,
            y_px: middle,
            radius_px,
            sigma_center_px: 0.0,
            sigma_radius_px: 0.0,
            visible_fraction: 1.0,
        };
        let Windows { subset_size_px, step_px } = self.windows;
        let count = window_centers(&circle, self.windows, self.side_px).len();
        if count > MIN_WINDOWS {
            return Ok(());
        }
        Err(UsageError(format!(
            "--subset {subset_size_px} --step {step_px}: {count} windows fit into a ball of {diameter_px} px, more than \
             {MIN_WINDOWS} are needed"
        )))
    }

    /// Measures two frames with every method, in the planned order.
    ///
    /// The ball is detected in the first frame; only the range of its radius is known in advance.
    pub(super) fn measure(&mut self, pair: FramePair<'_>) -> Vec<Answer> {
        let Some(circle) = self.finder.find(pair.before) else {
            let lost = Answer { step: None, sigma: None, points: 0, status: PointStatus::Lost };
            return vec![lost; self.methods.len()];
        };
        let Self { methods, windows, field, frames, side_px, ring, .. } = self;
        let [reference, target] = frames;
        // All methods share the interpolation.
        for (image, frame) in [(pair.before, &mut *reference), (pair.after, &mut *target)] {
            let prepared = methods.iter().find_map(|(_, engine)| match engine {
                Engine::Correlator(correlator) => Some(correlator),
                Engine::Plain(_) => None,
            });
            if let Some(correlator) = prepared {
                correlator.prepare_into(image, frame);
            }
        }
        let points = window_centers(&circle, *windows, *side_px);
        let answer = |(method, engine): &mut (Method, Engine)| {
            match engine {
                Engine::Correlator(correlator) => {
                    correlator.correlate(reference, target, &points, Start::Search, field);
                }
                Engine::Plain(plain) => {
                    let vectors: Vec<CenterVector> =
                        points.iter().filter_map(|at| plain.displacement(pair, *at, &circle)).collect();
                    return evaluate_like_paper(&vectors, *windows, PointStatus::LowCorrelation);
                }
            }
            let status = most_frequent_failure(field);
            if matches!(method, Method::Paper | Method::PaperFit | Method::PeakSpline | Method::PeakPlain) {
                let center = Point::new(circle.x_px, circle.y_px);
                let vectors: Vec<_> =
                    field.iter().filter_map(|point| CenterVector::from_point(point, center)).collect();
                return evaluate_like_paper(&vectors, *windows, status);
            }
            let Some(near) = rigid_fit(field, circle.x_px, circle.y_px, windows.subset_size_px) else {
                return no_answer(status);
            };
            match method {
                Method::Ring => answer_with_ring(ring, reference, target, &circle, near),
                Method::Rigid => match_whole_ball(reference, target, &circle, &near),
                _ => answer_from(&near),
            }
        };
        methods.iter_mut().map(answer).collect()
    }

    /// Correlates the windows of the method with this index again, for a timing; returns their number.
    ///
    /// `pair` must be the pair measured last, whose prepared frames are used. 0 if no ball is found in it.
    pub(super) fn correlate_again(&mut self, method: usize, pair: FramePair<'_>) -> usize {
        let Some(circle) = self.finder.find(pair.before) else { return 0 };
        let points = window_centers(&circle, self.windows, self.side_px);
        match &mut self.methods[method].1 {
            Engine::Correlator(correlator) => {
                correlator.correlate(&self.frames[0], &self.frames[1], &points, Start::Search, &mut self.field);
            }
            Engine::Plain(plain) => {
                let found = points.iter().filter_map(|at| plain.displacement(pair, *at, &circle));
                std::hint::black_box(found.count());
            }
        }
        points.len()
    }
}

/// Plans the correlator of a method for square frames of this side, px.
///
/// # Errors
///
/// When the size or the step of the windows is out of range.
fn plan_engine(method: Method, windows: Windows, side_px: usize) -> Result<Engine, Failure> {
    let correlation = match method {
        Method::Paper | Method::PaperFit => dic::Method::SplineFft,
        Method::PeakSpline | Method::PeakPlain => dic::Method::PeakSpline,
        // A whole-body match starts from the motion of the subsets.
        Method::IcGn | Method::Ring | Method::Rigid => dic::Method::IcGn,
    };
    let params = CorrelationParams {
        method: correlation,
        spline_points: if correlation == dic::Method::SplineFft { SPLINE_POINTS } else { 0 },
        subset_size_px: windows.subset_size_px,
        step_px: windows.step_px,
        search_px: SEARCH_PX,
        ..CorrelationParams::default()
    };
    let correlator = Correlator::new(&params, side_px, side_px)?;
    Ok(match method {
        Method::PeakPlain => Engine::Plain(PlainCorrelator::new(windows.subset_size_px, SPLINE_POINTS)),
        Method::Paper => Engine::Correlator(Box::new(correlator.without_peak_fit())),
        _ => Engine::Correlator(Box::new(correlator)),
    })
}

/// Returns the centres of the windows on a ball.
fn window_centers(circle: &Circle, windows: Windows, side_px: usize) -> Vec<GridPoint> {
    let radius_px = circle.radius_px * (1.0 - RIM_CLEARANCE);
    grid::disc(circle.x_px, circle.y_px, radius_px, windows.step_px, windows.subset_size_px, side_px, side_px)
}

/// Returns the motion of the windows, `near`, with its rotation replaced by that of the ring around the centre.
///
/// Without a rotation of the ring there is no answer.
fn answer_with_ring(
    ring: &mut PolarCorrelator,
    reference: &PreparedFrame,
    target: &PreparedFrame,
    circle: &Circle,
    near: RigidMotion,
) -> Answer {
    let from = CenteredFrame { frame: reference, center: Point::new(circle.x_px, circle.y_px) };
    let moved = Point::new(circle.x_px + near.u_px, circle.y_px + near.v_px);
    let radii = Radii { inner_px: RING_SHARE * circle.radius_px, outer_px: circle.radius_px * (1.0 - RIM_CLEARANCE) };
    let turn = ring.rotation(from, CenteredFrame { frame: target, center: moved }, radii, Some(near.angle_deg));
    turn.map_or_else(no_answer, |turn| {
        answer_from(&RigidMotion { angle_deg: turn.angle_deg, sigma_angle_deg: turn.sigma_deg, ..near })
    })
}

/// Matches all pixels of the ball but its rim, starting from the motion of the windows.
fn match_whole_ball(reference: &PreparedFrame, target: &PreparedFrame, circle: &Circle, near: &RigidMotion) -> Answer {
    let radius_px = circle.radius_px * (1.0 - RIM_CLEARANCE);
    let region = Region::Disc { x_px: circle.x_px, y_px: circle.y_px, radius_px };
    let center = Point::new(circle.x_px, circle.y_px);
    let found = RigidBody::new(reference, &region).and_then(|mut body| body.find(target, center, near.planar()));
    found.map_or_else(no_answer, |found| answer_from(&found.motion))
}

/// Evaluates a field like the paper: interpolated at the ball's centre, with the mean rotation of the windows about
/// it.
///
/// Returns the status `otherwise` if there are too few vectors.
fn evaluate_like_paper(valid: &[CenterVector], windows: Windows, otherwise: PointStatus) -> Answer {
    // The paper reports no uncertainty.
    let answer = |motion: RigidMotion| Answer { sigma: None, ..answer_from(&motion) };
    center_fit(valid, windows.step_px, windows.subset_size_px).map_or_else(|| no_answer(otherwise), answer)
}

/// Converts a rigid motion to a valid answer.
fn answer_from(motion: &RigidMotion) -> Answer {
    Answer {
        step: Some([motion.u_px, motion.v_px, motion.angle_deg]),
        sigma: Some([motion.sigma_u_px, motion.sigma_v_px, motion.sigma_angle_deg]),
        points: motion.points,
        status: PointStatus::Valid,
    }
}

/// Returns the answer without a motion, for the reason `status`.
fn no_answer(status: PointStatus) -> Answer {
    Answer { step: None, sigma: None, points: 0, status }
}

/// Returns the most frequent status of the windows without an answer; `Lost` if all have one or there are none.
fn most_frequent_failure(field: &[FieldPoint]) -> PointStatus {
    let count = |status: PointStatus| field.iter().filter(|point| point.status == status).count();
    let failures = PointStatus::ALL.into_iter().filter(|status| *status != PointStatus::Valid);
    failures.max_by_key(|status| count(*status)).filter(|status| count(*status) > 0).unwrap_or(PointStatus::Lost)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_reports_a_frame_without_a_ball_as_lost() {
        let methods = Method::WORDS.map(|(_, method)| method);
        let mut evaluator = Evaluator::new(&methods, Windows { subset_size_px: 25, step_px: 12 }, 160).unwrap();
        let image = crate::image::Image::new(160, 160);
        let answers = evaluator.measure(FramePair { before: image.view(), after: image.view() });
        assert_eq!(answers.len(), methods.len());
        assert!(answers.iter().all(|answer| answer.status == PointStatus::Lost && answer.step.is_none()));
    }

    #[test]
    fn only_the_papers_method_as_it_reads_takes_a_slow_ball_for_a_resting_one() {
        use super::super::film::{self, Filming, SIDE_PX};
        use super::super::films_plan::{Case, Film, Speeds, Velocity};
        let filming = Filming { frames: 2, noise_dn: 2.0, blur_px: 0.7, seed: 1 };
        let velocity = Velocity { px_frame: [0.06, 0.06], deg_frame: 0.0 };
        let plan = Film { pattern: 13, speeds: Speeds::OffGrid, number: 3, case: Case::TwoAxes, velocity, level: 0 };
        let rendered = film::moving_ball(&film::static_ball(13, &filming).unwrap(), &plan, &filming).unwrap();
        let (mut bytes, mut images) = (Vec::new(), [crate::image::Image::default(), crate::image::Image::default()]);
        for (index, image) in images.iter_mut().enumerate() {
            rendered.draw(index as u64, &mut bytes, image).unwrap();
        }
        let methods = [Method::Paper, Method::PaperFit, Method::IcGn, Method::Rigid];
        let mut evaluator = Evaluator::new(&methods, Windows { subset_size_px: 25, step_px: 20 }, SIDE_PX).unwrap();
        let answers = evaluator.measure(FramePair { before: images[0].view(), after: images[1].view() });
        let steps: Vec<[f64; 3]> = answers.iter().map(|answer| answer.step.unwrap()).collect();
        assert!(steps[0].iter().all(|part| part.abs() < 1e-12), "the grid's nearest point is 0: {steps:?}");
        for (step, most_px) in steps[1..].iter().zip([0.015, 0.005, 0.004]) {
            assert!((step[0] - 0.06).abs() < most_px && (step[1] - 0.06).abs() < most_px, "{steps:?}");
        }
    }
}
