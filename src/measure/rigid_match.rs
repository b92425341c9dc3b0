//! Rigid matches of whole bodies against a reference that their block keeps.
//!
//! Poses against one reference do not accumulate errors from frame to frame. The step
//! between two frames is the difference of their poses, which cancels the noise of the
//! reference.

use std::ops::Range;

use crate::dic::{BodyMotion, OcclusionMap, PlanarMotion, Point, PreparedFrame, Region, RigidBody};
use crate::results::{BodyStep, Circle, FieldPoint, MotionMethod, OutlineShape, PointStatus, RigidStep};

use super::outline::RIM_CLEARANCE;
use super::pending_frame::{BodyKey, Interval, Target};

/// The maximum error of the predicted position of a body that continues its motion, px.
pub(super) const MAX_PREDICTION_ERROR_PX: f64 = 2.0;
/// The rotation against the reference from which it is renewed even if the body is occluded, deg.
const RENEW_OCCLUDED_DEG: f64 = 10.0;
/// The visible fraction from which a body counts as not occluded.
const UNOCCLUDED_FRACTION: f64 = 0.97;
/// The maximum occluded fraction of a subset. Only occluded pixels at a moving edge are detected in the step from the
/// reference's own frame.
const MAX_OCCLUDED_FRACTION: f64 = 0.003;
/// The uncertainty of the effect of light, relative to what its removal changes: light multiplies the pattern, and
/// highlights have edges, but the removed field is smooth and added.
const LIGHT_ERROR: f64 = 2.0;
/// The minimum rotation that the effect of light is related to, deg.
const MIN_TURN_DEG: f64 = 0.05;
/// The maximum difference between a rotation over several references and a direct match to the first that corrects it,
/// sigmas.
const SAME_ROTATION_SIGMAS: f64 = 4.0;
/// The rotations after which a match to the first reference bounds the error that it does not correct, deg.
///
/// The pattern has then left its place, and light that stays in the room no longer holds it back.
const COMPARED_DEG: Range<f64> = 15.0..45.0;
/// The difference that noise explains, sigmas.
const COMPARED_SIGMAS: f64 = 2.0;
/// The maximum fraction of a body that does not match while nothing hides its rim. Highlights cover less.
const MAX_MISFIT_FRACTION: f64 = 0.15;
/// The part of the area that a straight occluder hides, relative to that of the rim.
const AREA_PER_RIM: f64 = 2.0;
/// The share of the texture in one octant of a body above which it is hardly more than a highlight.
const MAX_OCTANT_SHARE: f64 = 0.5;
/// The number of occluded pixels that is always allowed, since a pixel may be stuck.
const FREE_OCCLUDED_PIXELS: f64 = 2.0;

/// Returns the pixels by which a ball is matched as a whole: all but its rim.
pub fn matched_region(circle: &Circle) -> Region {
    Region::Disc { x_px: circle.x_px, y_px: circle.y_px, radius_px: circle.radius_px * (1.0 - RIM_CLEARANCE) }
}

/// Whether something occludes a part of a ball, judged by its rim.
pub(super) fn is_occluded(circle: &Circle) -> bool {
    circle.visible_fraction < UNOCCLUDED_FRACTION
}

/// The position of the reference's centre in a frame, and the rotation of the body.
#[derive(Debug, Clone, Copy)]
struct Pose {
    frame: u64,
    x_px: f64,
    y_px: f64,
    angle_deg: f64,
    /// The standard uncertainties of x, y and the angle.
    sigma: [f64; 3],
    pixels: u32,
    /// The rotation by which light was found to have held back all matches since the first reference, deg.
    light_deg: f64,
    /// The visible fraction of the reference; `None` for the reference itself.
    visible_fraction: Option<f64>,
    /// The share of the matched texture in one octant.
    octant_share: f64,
}

/// The rigid matches of one body in one block.
#[derive(Debug)]
struct RigidTrack {
    key: BodyKey,
    reference: RigidBody,
    /// The pose of the reference.
    origin: Pose,
    /// The first reference and its pose, once it was renewed.
    first: Option<(RigidBody, Pose)>,
    /// The variance of the angle of the reference relative to the first one, deg^2.
    drift_variance: f64,
    /// The largest fraction of the rotation that light may have held back.
    rotation_error: Option<f64>,
    /// The largest distance from the centre of the point that light or stripes may hold in place, px.
    pull_px: Option<f64>,
    radius_px: f64,
    /// Whether nothing occluded the body in the reference.
    is_unoccluded: bool,
    /// In frame order.
    poses: Vec<Pose>,
    /// The occlusion maps of the frames in which the body was occluded.
    occlusions: Vec<OccludedFrame>,
    /// The first and the last of the successive frames in which the rim contradicted the match.
    contradicted: Option<[u64; 2]>,
}

/// The occlusion of a body in a frame, relative to its reference at that time.
#[derive(Debug)]
struct OccludedFrame {
    frame: u64,
    origin: Pose,
    center: Point,
    map: OcclusionMap,
}

/// The step measured by a match of the whole body.
#[derive(Debug, Clone, Copy)]
pub(super) struct RigidMatch {
    /// The motion of the circle's centre, per frame.
    pub(super) step: RigidStep,
    /// The visible fraction of the body in the first of the two frames, if known.
    pub(super) visible_fraction: Option<f64>,
    /// The motion that a dilatation of 1 adds, px, px and deg, if the body is not occluded.
    pub(super) lever: Option<[f64; 3]>,
    /// The share by which light may have held back the rotation.
    pub(super) light_fraction: Option<f64>,
    /// The distance from the centre of the point that light or stripes may hold in place, px.
    pub(super) pull_px: Option<f64>,
}

impl RigidMatch {
    /// Replaces the motion of the subsets in a step by that of the match, corrected for the dilatation.
    ///
    /// Writes the effect of light as well, and the visible fraction if it is known; that of the rim is kept apart.
    pub(super) fn write_to(&self, step: &mut BodyStep) {
        let [x, y, angle] = match (self.lever, step.growth_fraction) {
            (Some(lever), Some(grown)) => lever.map(|lever| lever * grown.value),
            _ => [0.0; 3],
        };
        let RigidStep { dx_px, dy_px, dtheta_deg, .. } = self.step;
        let own = RigidStep { dx_px: dx_px - x, dy_px: dy_px - y, dtheta_deg: dtheta_deg - angle, ..self.step };
        (step.motion, step.method) = (Some(own), MotionMethod::WholeBody);
        (step.light_fraction, step.pull_px) = (self.light_fraction, self.pull_px);
        if let (Some(outline), Some(fraction)) = (&mut step.outline, self.visible_fraction)
            && let OutlineShape::Circle(circle) = &mut outline.shape
        {
            outline.rim_fraction = Some(circle.visible_fraction);
            circle.visible_fraction = fraction;
        }
    }
}

/// The rigid matches of all bodies in the current blocks.
#[derive(Debug, Default)]
pub(super) struct RigidMatcher {
    tracks: Vec<RigidTrack>,
    /// Discarded references, kept for reuse of their memory.
    spare: Vec<RigidBody>,
}

impl RigidMatcher {
    /// Discards everything.
    pub(super) fn clear(&mut self) {
        self.retain(|_| false);
    }

    /// Discards the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.retain(|track| track.key.block >= block);
    }

    /// Keeps the tracks that fulfil a condition and the memory of the others.
    fn retain(&mut self, is_kept: impl Fn(&RigidTrack) -> bool) {
        self.spare.extend(self.tracks.extract_if(.., |track| !is_kept(track)).map(|track| track.reference));
    }

    /// Discards reference and poses of one body in one block, since another object or pattern was matched.
    pub(super) fn forget(&mut self, key: BodyKey) {
        self.retain(|track| track.key != key);
    }

    /// Discards the pose of one body in one frame.
    pub(super) fn forget_frame(&mut self, key: BodyKey, frame: u64) {
        if let Some(track) = self.tracks.iter_mut().find(|track| track.key == key) {
            track.poses.retain(|pose| pose.frame != frame || pose.frame == track.origin.frame);
        }
    }

    /// Returns the matches of a body in a block.
    fn find_track(&self, key: BodyKey) -> Option<&RigidTrack> {
        self.tracks.iter().find(|track| track.key == key)
    }

    /// Whether there is a reference of a body in a block.
    pub(super) fn has_reference(&self, key: BodyKey) -> bool {
        self.find_track(key).is_some()
    }

    /// Whether a body was matched in a frame, or the frame is its reference.
    pub(super) fn has_match(&self, key: BodyKey, frame: u64) -> bool {
        self.find_track(key).is_some_and(|track| track.pose_in(frame).is_some())
    }

    /// Whether a body was matched in a frame with at least 97 % of the pixels of its reference visible; false in the
    /// frame of the reference itself.
    pub(super) fn is_fully_visible(&self, key: BodyKey, frame: u64) -> bool {
        let fraction = self.find_track(key).and_then(|track| track.pose_in(frame)?.visible_fraction);
        fraction.is_some_and(|fraction| fraction >= UNOCCLUDED_FRACTION)
    }

    /// Returns the largest fraction of a body's rotation that light may have held back in a block, if it is known.
    pub(super) fn rotation_error(&self, key: BodyKey) -> Option<f64> {
        self.find_track(key)?.rotation_error
    }

    /// Marks the subsets that show an occluder in one of two matched frames; returns whether there are any.
    pub(super) fn mask_occluded(
        &self,
        key: BodyKey,
        frames: Interval,
        points: &mut [FieldPoint],
        subset_px: u32,
    ) -> bool {
        let Some(track) = self.find_track(key).filter(|track| !track.occlusions.is_empty()) else { return false };
        let (Some(from), Some(_)) = (track.pose_in(frames.from), track.pose_in(frames.to)) else { return false };
        let mut any_occluded = false;
        for point in points.iter_mut().filter(|point| point.displacement.is_some()) {
            if track.is_occluded(&from, frames.to, point, subset_px) {
                (point.displacement, point.status, any_occluded) = (None, PointStatus::Occluded, true);
            }
        }
        any_occluded
    }

    /// Makes a frame the reference of a body in a block that has none.
    ///
    /// Without texture, or at the image border, there is no reference and only the subsets are measured.
    pub(super) fn set_reference(&mut self, key: BodyKey, frame: u64, prepared: &PreparedFrame, circle: &Circle) {
        if self.has_reference(key) {
            return;
        }
        let (region, radius_px) = (matched_region(circle), circle.radius_px * (1.0 - RIM_CLEARANCE));
        let mut reference = self.spare.pop().unwrap_or_default();
        if reference.renew(prepared, &region).is_err() {
            self.spare.push(reference);
            return;
        }
        let pixels = reference.pixels() as u32;
        let (x_px, y_px) = (circle.x_px, circle.y_px);
        let origin = Pose {
            frame,
            x_px,
            y_px,
            angle_deg: 0.0,
            sigma: [0.0; 3],
            pixels,
            light_deg: 0.0,
            visible_fraction: None,
            octant_share: 0.0,
        };
        let is_unoccluded = !is_occluded(circle);
        self.tracks.push(RigidTrack {
            key,
            reference,
            origin,
            first: None,
            drift_variance: 0.0,
            rotation_error: None,
            pull_px: None,
            radius_px,
            is_unoccluded,
            poses: vec![origin],
            occlusions: Vec::new(),
            contradicted: None,
        });
    }

    /// Measures the step of a body from one frame of a block to a later one, near the motion `rate` per frame.
    ///
    /// `None` if there is no reference or one of the frames does not match it, or if the rim contradicts the match.
    pub(super) fn measure_step(
        &mut self,
        key: BodyKey,
        from: Target<'_>,
        to: Target<'_>,
        circle: &Circle,
        rate: &RigidStep,
    ) -> Option<RigidMatch> {
        let track = self.tracks.iter_mut().find(|track| track.key == key)?;
        let first = match track.pose_in(from.sequence) {
            Some(pose) => pose,
            None => {
                let nearest = *track.poses.iter().rev().find(|pose| pose.frame < from.sequence)?;
                track.match_frame(from, nearest.predicted(circle, rate, (from.sequence - nearest.frame) as f64))?
            }
        };
        if track.is_contradicted_by_rim(&first, circle) {
            return None;
        }
        let frames = (to.sequence - from.sequence) as f64;
        let second = match track.pose_in(to.sequence) {
            Some(pose) => pose,
            None => track.match_frame(to, first.predicted(circle, rate, frames))?,
        };
        let is_visible = track.is_unoccluded
            && [first, second]
                .iter()
                .all(|pose| pose.visible_fraction.is_none_or(|fraction| fraction >= UNOCCLUDED_FRACTION));
        Some(RigidMatch {
            step: first.step_to(&second, circle, frames),
            visible_fraction: first.visible_fraction.filter(|_| track.is_unoccluded),
            lever: is_visible.then(|| track.reference.dilatation_error()),
            light_fraction: larger(first.light_fraction(&second), track.rotation_error),
            pull_px: track.pull_px,
        })
    }
}

impl RigidTrack {
    /// Returns the pose in a frame, if the body was matched there or the frame is its reference.
    fn pose_in(&self, frame: u64) -> Option<Pose> {
        self.poses.iter().rev().find(|pose| pose.frame == frame).copied()
    }

    /// Whether more of a frame does not match than is hidden at its rim, and of the frame before: marks that light outweighs
    /// look like an occluder. The rotations that were measured before are then those of the light.
    fn is_contradicted_by_rim(&mut self, pose: &Pose, circle: &Circle) -> bool {
        if !self.is_unoccluded || !pose.contradicts_rim(circle) {
            return false;
        }
        let first = self.contradicted.filter(|[_, last]| pose.frame <= last + 1).map_or(pose.frame, |[first, _]| first);
        self.contradicted = Some([first, pose.frame]);
        let is_repeated = pose.frame > first;
        if is_repeated {
            self.rotation_error = larger(self.rotation_error, Some(1.0));
        }
        is_repeated
    }

    /// Matches a frame near a pose and stores the result. Makes the frame the new reference if the old one is stale.
    ///
    /// `None` if the frame does not match, or lies farther from the prediction than the frame is prepared.
    fn match_frame(&mut self, target: Target<'_>, guess: Pose) -> Option<Pose> {
        let Target { sequence: frame, prepared: target, is_narrow } = target;
        let origin = self.origin;
        let near = PlanarMotion {
            u_px: guess.x_px - origin.x_px,
            v_px: guess.y_px - origin.y_px,
            angle_deg: guess.angle_deg - origin.angle_deg,
        };
        let found = self.reference.find_visible(target, Point::new(origin.x_px, origin.y_px), near).ok()?;
        let BodyMotion { motion, visible_fraction, light_deg, .. } = found;
        let mut pose = Pose {
            frame,
            x_px: origin.x_px + motion.u_px,
            y_px: origin.y_px + motion.v_px,
            angle_deg: origin.angle_deg + motion.angle_deg,
            sigma: [motion.sigma_u_px, motion.sigma_v_px, motion.sigma_angle_deg],
            pixels: motion.points,
            light_deg: origin.light_deg + light_deg,
            visible_fraction: Some(visible_fraction),
            octant_share: found.octant_share,
        };
        // Farther off, pixels outside the prepared box would count as occluded.
        let is_predicted = (pose.x_px - guess.x_px).hypot(pose.y_px - guess.y_px) <= MAX_PREDICTION_ERROR_PX;
        if is_narrow && !is_predicted {
            return None;
        }
        let is_occluded = visible_fraction < UNOCCLUDED_FRACTION;
        // An occluder in the reference that moves with the body would be matched as a part of it.
        let is_renewed = found.is_stale() && (!is_occluded || motion.angle_deg.abs() > RENEW_OCCLUDED_DEG);
        if is_renewed {
            self.drift_variance += pose.sigma[2].powi(2);
            let kept = if is_occluded { 1.0 } else { self.anchor(target, &mut pose) };
            let share = kept * found.misfit_deg / motion.angle_deg.abs();
            self.rotation_error = larger(self.rotation_error, Some(share).filter(|share| share.is_finite()));
            let pull_px = found.misfit_px / motion.angle_deg.to_radians().abs();
            self.pull_px = larger(self.pull_px, Some(pull_px.min(self.radius_px)).filter(|pull_px| *pull_px > 0.0));
        }
        let place = self.poses.partition_point(|other| other.frame < frame);
        self.poses.insert(place, pose);
        let center = self.reference.center();
        self.occlusions.extend(self.reference.occlusion_map().map(|map| OccludedFrame { frame, origin, center, map }));
        if is_renewed {
            let region = Region::Disc { x_px: pose.x_px, y_px: pose.y_px, radius_px: self.radius_px };
            if let Ok(reference) = RigidBody::new(target, &region) {
                let last =
                    (std::mem::replace(&mut self.reference, reference), std::mem::replace(&mut self.origin, pose));
                self.first.get_or_insert(last);
                self.is_unoccluded = self.is_unoccluded && !is_occluded;
            }
        }
        Some(pose)
    }

    /// Corrects the rotation to a frame that becomes the next reference by a match to the first one. Returns the share of
    /// its error that remains.
    ///
    /// Whatever stands in the room and looks the same in neighbouring frames holds every short rotation back by the same
    /// share, and these errors add up over the references. A direct match to the first one has a single error, since the
    /// pattern has left its place. Both are weighted by their variances, as in a Kalman filter. If they contradict each
    /// other, their difference bounds the error of the rotation instead.
    fn anchor(&mut self, target: &PreparedFrame, pose: &mut Pose) -> f64 {
        let variance = self.drift_variance;
        let Some((reference, origin)) = self.first.as_mut() else { return 1.0 };
        let turned_deg = pose.angle_deg - origin.angle_deg;
        let (u_px, v_px) = (pose.x_px - origin.x_px, pose.y_px - origin.y_px);
        let near = PlanarMotion { u_px, v_px, angle_deg: turned_deg };
        let found = reference.find_visible(target, Point::new(origin.x_px, origin.y_px), near);
        let Ok(direct) = found else { return 1.0 };
        let apart_deg = direct.motion.angle_deg - turned_deg;
        let apart_deg = apart_deg - 360.0 * (apart_deg / 360.0).round();
        let both = variance + direct.motion.sigma_angle_deg.powi(2);
        if !direct.is_similar() || apart_deg.powi(2) > SAME_ROTATION_SIGMAS.powi(2) * both {
            let error_deg = (apart_deg.powi(2) - COMPARED_SIGMAS.powi(2) * both).max(0.0).sqrt();
            // A pattern that turns out of the image plane looks different soon.
            let is_comparable = COMPARED_DEG.contains(&turned_deg.abs());
            let error = Some(error_deg / turned_deg.abs()).filter(|_| is_comparable);
            self.rotation_error = larger(self.rotation_error, error);
            return 1.0;
        }
        let gain = variance / both;
        pose.angle_deg += gain * apart_deg;
        // The step to this frame removes the error that has added up before it.
        pose.sigma[2] = pose.sigma[2].hypot((gain * variance).sqrt());
        self.drift_variance = (1.0 - gain) * variance;
        1.0 - gain
    }
}

/// Returns the larger of two shares, of which both may be unknown.
fn larger(one: Option<f64>, other: Option<f64>) -> Option<f64> {
    one.into_iter().chain(other).reduce(f64::max)
}

impl RigidTrack {
    /// Whether a subset of the frame of `from` shows an occluder in that frame or another.
    fn is_occluded(&self, from: &Pose, to_frame: u64, point: &FieldPoint, subset_px: u32) -> bool {
        let offset = (f64::from(point.x_px) - from.x_px, f64::from(point.y_px) - from.y_px);
        let max_pixels = (MAX_OCCLUDED_FRACTION * f64::from(subset_px).powi(2)).max(FREE_OCCLUDED_PIXELS);
        let mut near = self.occlusions.iter().filter(|occlusion| [from.frame, to_frame].contains(&occlusion.frame));
        near.any(|OccludedFrame { origin, center, map, .. }| {
            let (x, y) = rotate(offset.0, offset.1, origin.angle_deg - from.angle_deg);
            let place = Point::new(origin.x_px + x - center.x_px, origin.y_px + y - center.y_px);
            f64::from(map.occluded_pixels(place, subset_px)) > max_pixels
        })
    }
}

impl Pose {
    /// Returns the pose predicted by the motion of a circle per frame, `frames` frames later.
    fn predicted(&self, circle: &Circle, rate: &RigidStep, frames: f64) -> Self {
        let angle_deg = frames * rate.dtheta_deg;
        let (dx, dy) = rotate(self.x_px - circle.x_px, self.y_px - circle.y_px, angle_deg);
        Self {
            x_px: circle.x_px + frames * rate.dx_px + dx,
            y_px: circle.y_px + frames * rate.dy_px + dy,
            angle_deg: self.angle_deg + angle_deg,
            ..*self
        }
    }

    /// Whether more of the body does not match than an occluder hides that hides this much of its rim, while what matches
    /// is hardly more than a highlight.
    fn contradicts_rim(&self, circle: &Circle) -> bool {
        let hidden_fraction = MAX_MISFIT_FRACTION + AREA_PER_RIM * (1.0 - circle.visible_fraction);
        self.octant_share > MAX_OCTANT_SHARE
            && self.visible_fraction.is_some_and(|visible| 1.0 - visible > hidden_fraction)
    }

    /// Returns the fraction by which light may have held back the rotation to a later pose: twice its effect on the
    /// match. `None` for rotations up to 0.05 deg and without an effect.
    fn light_fraction(&self, later: &Self) -> Option<f64> {
        let turned_deg = (later.angle_deg - self.angle_deg).abs();
        let light_deg = (later.light_deg - self.light_deg).abs();
        (light_deg > 0.0 && turned_deg > MIN_TURN_DEG).then(|| LIGHT_ERROR * light_deg / turned_deg)
    }

    /// Returns the step of the circle's centre to a later pose, per frame.
    fn step_to(&self, later: &Self, circle: &Circle, frames: f64) -> RigidStep {
        let angle_deg = later.angle_deg - self.angle_deg;
        let (dx, dy) = rotate(circle.x_px - self.x_px, circle.y_px - self.y_px, angle_deg);
        // Both poses contain the noise of the reference, unless one is the reference.
        let sigma = |k: usize| match (self.visible_fraction, later.visible_fraction) {
            (Some(_), Some(_)) => (0.5 * (self.sigma[k].powi(2) + later.sigma[k].powi(2))).sqrt(),
            _ => self.sigma[k].max(later.sigma[k]),
        };
        RigidStep {
            dx_px: (later.x_px + dx - circle.x_px) / frames,
            dy_px: (later.y_px + dy - circle.y_px) / frames,
            dtheta_deg: angle_deg / frames,
            sigma_dx_px: sigma(0) / frames,
            sigma_dy_px: sigma(1) / frames,
            sigma_dtheta_deg: sigma(2) / frames,
            points: self.pixels.min(later.pixels),
        }
    }
}

/// Rotates an offset counter-clockwise on the screen.
fn rotate(dx: f64, dy: f64, angle_deg: f64) -> (f64, f64) {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    (dx * cos + dy * sin, dy * cos - dx * sin)
}
