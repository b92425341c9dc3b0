//! Patches: pixels inside a polygon drawn in one image, tracked as a rigid body.
//!
//! Every pose is a match with that image, so errors do not accumulate from frame to frame.
//! Occluded pixels are left out of each match separately.

use crate::dic::{
    BodyMotion, Patch, PlanarMotion, Point, PreparedFrame, Region, RigidBody, find_occluded_within_angle,
};
use crate::results::{Circle, Estimate, PointStatus, RigidStep};
use std::f64::consts::TAU;

/// The range of rotations searched in every frame for a lost patch, deg; all rotations are searched once per block.
const SEARCH_ANGLE_DEG: f64 = 6.0;

/// The minimum ZNCC of the visible pixels.
const MIN_ZNCC: f64 = 0.6;

/// The minimum visible fraction of a patch that is found from scratch, unless enough pixels are visible.
const MIN_VISIBLE_FRACTION: f64 = 0.4;

/// The number of visible pixels that do not match by chance.
const MIN_VISIBLE_PIXELS: u32 = 400;

/// The visible fraction times the ZNCC from which no other rotation of a patch can match better.
const COMPLETE_MATCH: f64 = 0.85;

/// The shifts at which a patch is compared with its own image, relative to the radius of a disc of its area, in this many
/// directions.
const SELF_SHIFTS: [f64; 2] = [0.3, 0.6];
const SELF_DIRECTIONS: u32 = 8;

/// The distance from which a match of a patch with its own image is another place, px.
const OTHER_PLACE_PX: f64 = 2.0;

/// The ZNCC of an image with itself, up to rounding.
const SELF_ZNCC: f64 = 0.999_999;

/// The error of a step from the reference image itself, relative to its noise.
///
/// All other poses share the error of interpolation at sharp edges, which the reference does not have.
const REFERENCE_ERROR: f64 = 3.0;

/// Whether the visible pixels may match by chance.
fn is_chance_match(visible_fraction: f64, pixels: u32) -> bool {
    visible_fraction < MIN_VISIBLE_FRACTION && pixels < MIN_VISIBLE_PIXELS
}

/// A frame as part of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameKey {
    pub(super) block: u64,
    pub(super) frame: u64,
}

/// The rotations among which a patch is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AngleRange {
    Small,
    Full,
}

/// The pose of a patch in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PatchPose {
    /// The position of the reported point, px, and the rotation since the reference image, deg.
    pose: [f64; 3],
    sigma: [f64; 3],
    visible_fraction: f64,
    pixels: u32,
    /// The radius of a disc of the same area, px.
    radius_px: f64,
    /// The distance from the reported point to the farthest corner, px.
    reach_px: f64,
    /// Whether it is the pose in the reference image itself, which matches exactly.
    is_reference: bool,
}

impl PatchPose {
    pub(super) fn center_px(&self) -> (f64, f64) {
        (self.pose[0], self.pose[1])
    }

    /// Returns the rotation since the reference image, deg.
    pub(super) fn angle_deg(&self) -> Estimate {
        Estimate { value: self.pose[2], sigma: self.sigma[2] }
    }

    /// Returns a disc of the same area about the reported point.
    pub(super) fn circle(&self) -> Circle {
        Circle {
            x_px: self.pose[0],
            y_px: self.pose[1],
            radius_px: self.radius_px,
            sigma_center_px: self.sigma[0].hypot(self.sigma[1]) * std::f64::consts::FRAC_1_SQRT_2,
            sigma_radius_px: 0.0,
            visible_fraction: self.visible_fraction,
        }
    }

    /// Returns a disc that contains the whole patch.
    pub(super) fn enclosing_circle(&self) -> Circle {
        Circle { radius_px: self.reach_px, ..self.circle() }
    }

    /// Returns the pose predicted by a motion over some frames.
    pub(super) fn predicted(&self, rate: &RigidStep, frames: f64) -> Self {
        let [x, y, angle] = self.pose;
        let pose = [x + frames * rate.dx_px, y + frames * rate.dy_px, angle + frames * rate.dtheta_deg];
        let propagated = |sigma: f64, rate: f64| sigma.hypot(frames * rate);
        let sigma = [
            propagated(self.sigma[0], rate.sigma_dx_px),
            propagated(self.sigma[1], rate.sigma_dy_px),
            propagated(self.sigma[2], rate.sigma_dtheta_deg),
        ];
        Self { pose, sigma, ..*self }
    }

    /// Returns the motion to a later pose, per frame; both poses contain the noise of the reference.
    pub(super) fn step_to(&self, later: &Self, frames: f64) -> RigidStep {
        let rotation_deg = later.pose[2] - self.pose[2];
        // The angle of a patch that was found again may be off by full turns.
        let rotation_deg = rotation_deg - 360.0 * (rotation_deg / 360.0).round();
        let factor = if self.is_reference != later.is_reference { REFERENCE_ERROR } else { 1.0 };
        // Errors of interpolation, which sharp print adds to the noise, are not common to two poses.
        let sigma = |k: usize| factor * self.sigma[k].hypot(later.sigma[k]) / frames;
        RigidStep {
            dx_px: (later.pose[0] - self.pose[0]) / frames,
            dy_px: (later.pose[1] - self.pose[1]) / frames,
            dtheta_deg: rotation_deg / frames,
            sigma_dx_px: sigma(0),
            sigma_dy_px: sigma(1),
            sigma_dtheta_deg: sigma(2),
            points: self.pixels.min(later.pixels),
        }
    }
}

/// The finder and tracker of one patch.
#[derive(Debug)]
pub(super) struct PatchFinder {
    patch: Patch,
    center_px: (f64, f64),
    radius_px: f64,
    reach_px: f64,
    /// The image that it was drawn in, or the reason why there is none.
    reference: Result<(PreparedFrame, Box<RigidBody>), PointStatus>,
    /// The poses found in frames of the current blocks.
    found: Vec<(FrameKey, Result<PatchPose, PointStatus>)>,
}

impl PatchFinder {
    /// Prepares the finder of a patch, which is lost until its reference image is set.
    pub(super) fn new(patch: &Patch) -> Self {
        let (area, centroid) = patch.area_and_centroid();
        let center = patch.center_px.unwrap_or(centroid);
        let reach = |[x, y]: &[f64; 2]| (x - center[0]).hypot(y - center[1]);
        Self {
            patch: patch.clone(),
            center_px: center.into(),
            radius_px: (area / std::f64::consts::PI).sqrt(),
            reach_px: patch.outline_px.iter().map(reach).fold(0.0, f64::max),
            reference: Err(PointStatus::Lost),
            found: Vec::new(),
        }
    }

    /// Sets the image that the polygon was drawn in. A patch that repeats itself in it stays ambiguous.
    pub(super) fn set_reference(&mut self, reference: &PreparedFrame) {
        let body = RigidBody::new(reference, &self.patch.region());
        self.reference = body.map(|body| (reference.clone(), Box::new(body)));
        if self.repeats_itself() {
            self.reference = Err(PointStatus::Ambiguous);
        }
    }

    /// Returns the reason why the patch can be found in no frame, if its own image is ambiguous.
    pub(super) fn refusal(&self) -> Option<PointStatus> {
        self.reference.as_ref().err().copied().filter(|status| *status == PointStatus::Ambiguous)
    }

    /// Whether the patch matches its own image at another place as well, as stripes do.
    ///
    /// Its position is then not determined by its image, however small the noise.
    fn repeats_itself(&mut self) -> bool {
        let (x, y) = self.center_px;
        let Ok((reference, body)) = &mut self.reference else { return false };
        let directions = (0..SELF_DIRECTIONS).map(|part| f64::from(part) * TAU / f64::from(SELF_DIRECTIONS));
        let shifts: Vec<(f64, f64)> = directions
            .flat_map(|direction| SELF_SHIFTS.map(|shift| (direction.cos() * shift, direction.sin() * shift)))
            .collect();
        shifts.into_iter().any(|(dx, dy)| {
            let [u_px, v_px] = [dx, dy].map(|part| part * self.radius_px);
            let found = body.find_visible(reference, Point::new(x, y), PlanarMotion { u_px, v_px, angle_deg: 0.0 });
            found.is_ok_and(|BodyMotion { motion, zncc, visible_fraction, .. }| {
                motion.u_px.hypot(motion.v_px) > OTHER_PLACE_PX && zncc * visible_fraction > COMPLETE_MATCH
            })
        })
    }

    /// Returns the polygon at a pose.
    pub(super) fn region_at(&self, pose: &PatchPose) -> Region {
        let [x, y, angle_deg] = pose.pose;
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let moved = |corners: &Vec<[f64; 2]>| -> Vec<[f64; 2]> {
            let place = |[px, py]: &[f64; 2]| {
                let (dx, dy) = (px - self.center_px.0, py - self.center_px.1);
                [x + dx * cos + dy * sin, y + dy * cos - dx * sin]
            };
            corners.iter().map(place).collect()
        };
        let holes_px = self.patch.holes_px.iter().map(moved).collect();
        Region::Polygon { outline_px: moved(&self.patch.outline_px), holes_px }
    }

    /// Discards the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.found.retain(|(key, _)| key.block >= block);
    }

    /// Returns the stored pose in a frame of a block, or the reason why there is none; `None` if it was not searched.
    pub(super) fn cached(&self, key: FrameKey) -> Option<Result<PatchPose, PointStatus>> {
        self.found.iter().rev().find(|(searched, _)| *searched == key).map(|(_, found)| *found)
    }

    /// Searches the patch near its predicted pose, unless it was found in this frame already.
    ///
    /// # Errors
    ///
    /// Returns the reason why it was not found.
    pub(super) fn follow(
        &mut self,
        key: FrameKey,
        target: &PreparedFrame,
        near: &PatchPose,
    ) -> Result<PatchPose, PointStatus> {
        if let Some(Ok(known)) = self.cached(key) {
            return Ok(known);
        }
        let found = self.match_near(target, near.pose);
        self.store(key, found);
        found
    }

    /// Stores the result of a frame and replaces an earlier one.
    fn store(&mut self, key: FrameKey, found: Result<PatchPose, PointStatus>) {
        self.found.retain(|(searched, _)| *searched != key);
        self.found.push((key, found));
    }

    /// Searches the patch in a full frame from scratch.
    ///
    /// Tries its reference position, then all positions at small rotations and, for the full range, at all rotations.
    ///
    /// # Errors
    ///
    /// Returns the reason why it was not found.
    pub(super) fn find(
        &mut self,
        key: FrameKey,
        target: &PreparedFrame,
        angles: AngleRange,
    ) -> Result<PatchPose, PointStatus> {
        let (x, y) = self.center_px;
        let mut found = self.match_near(target, [x, y, 0.0]);
        if found.is_ok_and(|pose| is_chance_match(pose.visible_fraction, pose.pixels)) {
            found = Err(PointStatus::LowCorrelation);
        }
        if let (Err(_), Ok((reference, _))) = (&found, &self.reference) {
            let (region, center) = (self.patch.region(), Point::new(x, y));
            let mut start = find_occluded_within_angle(reference, target, &region, center, SEARCH_ANGLE_DEG);
            // A part of the patch may resemble another part turned by a larger angle.
            let is_complete = start.is_ok_and(|found| found.visible_fraction * found.zncc > COMPLETE_MATCH);
            if angles == AngleRange::Full && !is_complete {
                start = find_occluded_within_angle(reference, target, &region, center, 180.0);
            }
            let start = start.and_then(|found| {
                let is_chance = is_chance_match(found.visible_fraction, found.motion.points);
                if is_chance { Err(PointStatus::LowCorrelation) } else { Ok(found) }
            });
            found = start.and_then(|BodyMotion { motion, .. }| {
                self.match_near(target, [x + motion.u_px, y + motion.v_px, motion.angle_deg])
            });
        }
        self.store(key, found);
        found
    }

    /// Matches the visible pixels near a pose (px, px, deg).
    ///
    /// # Errors
    ///
    /// Returns the reason why the patch was not found.
    fn match_near(&mut self, target: &PreparedFrame, pose: [f64; 3]) -> Result<PatchPose, PointStatus> {
        let [x, y, angle_deg] = pose;
        let (cx, cy) = self.center_px;
        let (_, body) = self.reference.as_mut().map_err(|status| *status)?;
        let BodyMotion { motion, zncc, visible_fraction, .. } =
            body.find_visible(target, Point::new(cx, cy), PlanarMotion { u_px: x - cx, v_px: y - cy, angle_deg })?;
        if zncc < MIN_ZNCC {
            return Err(PointStatus::LowCorrelation);
        }
        Ok(PatchPose {
            pose: [cx + motion.u_px, cy + motion.v_px, motion.angle_deg],
            sigma: [motion.sigma_u_px, motion.sigma_v_px, motion.sigma_angle_deg],
            visible_fraction,
            pixels: motion.points,
            radius_px: self.radius_px,
            reach_px: self.reach_px,
            is_reference: zncc > SELF_ZNCC,
        })
    }
}
