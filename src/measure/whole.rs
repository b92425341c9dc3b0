//! Bodies matched as wholes, against a reference that their block keeps.
//!
//! Poses against one reference do not add up errors from frame to frame: the
//! step between two frames is the difference of their poses, and the noise of
//! the reference is in neither.

use crate::dic::{BodyMotion, Prepared, Region, RigidBody, Veil};
use crate::results::{BodyStep, Circle, FieldPoint, PointStatus, RigidStep};

use super::known::FORETOLD_PX;
use super::outline::RIM_CLEARANCE;
use super::target::Target;

/// Rotation against the reference from which on one that hides something is renewed all the same, deg.
const RENEW_HIDDEN_DEG: f64 = 10.0;
/// Share in sight from which on a body counts as unhidden.
const WHOLE: f64 = 0.97;
/// Share of a subset's pixels that may be out of sight, and how many may be, since a pixel may be stuck. In the step from
/// the reference's own frame only those are seen to be which an edge moves over.
const MOST_HIDDEN: f64 = 0.003;
const FEW_HIDDEN: f64 = 2.0;

/// The pixels that a ball is matched by as a whole: all but its rim.
pub fn whole_region(circle: &Circle) -> Region {
    Region::Disc { x_px: circle.x_px, y_px: circle.y_px, radius_px: circle.radius_px * (1.0 - RIM_CLEARANCE) }
}

/// Whether something hides a part of a ball, by its rim.
pub(super) fn is_hidden(circle: &Circle) -> bool {
    circle.visible_fraction < WHOLE
}

/// Where the reference's centre is in a frame, and how the body is turned.
#[derive(Debug, Clone, Copy)]
struct Pose {
    frame: u64,
    x_px: f64,
    y_px: f64,
    angle_deg: f64,
    /// Of x, y and the angle.
    sigma: [f64; 3],
    pixels: u32,
    /// Share of the reference in sight; `None` for the reference itself.
    share: Option<f64>,
}

/// One body in one block.
#[derive(Debug)]
struct Kept {
    body: usize,
    block: u64,
    reference: RigidBody,
    /// The reference's own pose.
    origin: Pose,
    radius_px: f64,
    /// Whether nothing hid the body in the reference.
    is_whole: bool,
    /// In the order of their frames.
    poses: Vec<Pose>,
    /// What hid the body, in frames in which something did.
    veils: Vec<Veiled>,
}

/// What hid a body in a frame, of its reference then.
#[derive(Debug)]
struct Veiled {
    frame: u64,
    origin: Pose,
    center_px: (f64, f64),
    veil: Veil,
}

/// What a match of the whole body says of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct WholeStep {
    /// The motion of the circle's centre, per frame.
    pub(super) step: RigidStep,
    /// Share of the body in sight in the first of the two frames, if that is known.
    pub(super) visible_fraction: Option<f64>,
    /// What growth by 1 adds to the motion, px, px and deg, where nothing hides the body.
    pub(super) lever: Option<[f64; 3]>,
}

impl WholeStep {
    /// Puts it in the place of what subsets say.
    pub(super) fn tell(&self, step: &mut BodyStep) {
        let [x, y, angle] = match (self.lever, step.growth_fraction) {
            (Some(lever), Some(grown)) => lever.map(|lever| lever * grown.value),
            _ => [0.0; 3],
        };
        let RigidStep { dx_px, dy_px, dtheta_deg, .. } = self.step;
        let own = RigidStep { dx_px: dx_px - x, dy_px: dy_px - y, dtheta_deg: dtheta_deg - angle, ..self.step };
        (step.step, step.is_whole) = (Some(own), true);
        if let (Some(circle), Some(share)) = (&mut step.circle, self.visible_fraction) {
            step.rim_fraction = Some(circle.visible_fraction);
            circle.visible_fraction = share;
        }
    }
}

/// The references of all bodies in the blocks at hand.
#[derive(Debug, Default)]
pub(super) struct Wholes {
    kept: Vec<Kept>,
    /// Memory of references that were forgotten.
    spare: Vec<RigidBody>,
}

impl Wholes {
    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.keep(|_| false);
    }

    /// Forgets the blocks before this one.
    pub(super) fn forget_before(&mut self, block: u64) {
        self.keep(|kept| kept.block >= block);
    }

    fn keep(&mut self, is_kept: impl Fn(&Kept) -> bool) {
        self.spare.extend(self.kept.extract_if(.., |kept| !is_kept(kept)).map(|kept| kept.reference));
    }

    /// Forgets one body in one block: something is wrong with its reference.
    pub(super) fn forget(&mut self, body: usize, block: u64) {
        self.keep(|kept| (kept.body, kept.block) != (body, block));
    }

    /// Whether there is a reference of a body in a block.
    pub(super) fn knows(&self, body: usize, block: u64) -> bool {
        self.kept.iter().any(|kept| (kept.body, kept.block) == (body, block))
    }

    /// Whether a body was matched in a frame.
    pub(super) fn sees(&self, (body, block): (usize, u64), frame: u64) -> bool {
        let kept = self.kept.iter().find(|kept| (kept.body, kept.block) == (body, block));
        kept.is_some_and(|kept| kept.pose(frame).is_some())
    }

    /// Whether nothing more hides a body in a frame that it was matched in than in its reference.
    pub(super) fn sees_all(&self, (body, block): (usize, u64), frame: u64) -> bool {
        let kept = self.kept.iter().find(|kept| (kept.body, kept.block) == (body, block));
        kept.and_then(|kept| kept.pose(frame)).is_some_and(|pose| pose.share.is_some_and(|share| share >= WHOLE))
    }

    /// Marks the subsets that show what hid a body in one of two frames, which it was matched in; tells whether there are any.
    pub(super) fn leave_out(
        &self,
        (body, block): (usize, u64),
        (from, to): (u64, u64),
        points: &mut [FieldPoint],
        subset_px: u32,
    ) -> bool {
        let kept = self.kept.iter().find(|kept| (kept.body, kept.block) == (body, block) && !kept.veils.is_empty());
        let Some(kept) = kept else { return false };
        let (Some(from), Some(to)) = (kept.pose(from), kept.pose(to)) else { return false };
        let mut any = false;
        for point in points.iter_mut().filter(|point| point.displacement.is_some()) {
            if kept.is_veiled([&from, &to], point, subset_px) {
                (point.displacement, point.status, any) = (None, PointStatus::Occluded, true);
            }
        }
        any
    }

    /// Takes a frame as the reference of a body in a block that has none.
    pub(super) fn begin(&mut self, (body, block): (usize, u64), frame: u64, prepared: &Prepared, circle: &Circle) {
        if self.knows(body, block) {
            return;
        }
        let (region, radius_px) = (whole_region(circle), circle.radius_px * (1.0 - RIM_CLEARANCE));
        // Without texture, or at the edge of the picture, there is none: subsets are measured alone then.
        let mut reference = self.spare.pop().unwrap_or_default();
        if reference.renew(prepared, &region).is_err() {
            self.spare.push(reference);
            return;
        }
        let pixels = reference.pixels() as u32;
        let (x_px, y_px) = (circle.x_px, circle.y_px);
        let origin = Pose { frame, x_px, y_px, angle_deg: 0.0, sigma: [0.0; 3], pixels, share: None };
        let is_whole = !is_hidden(circle);
        self.kept.push(Kept {
            body,
            block,
            reference,
            origin,
            radius_px,
            is_whole,
            poses: vec![origin],
            veils: Vec::new(),
        });
    }

    /// The step of a body from one frame of a block to a later one, looked for near `rate` a frame.
    pub(super) fn step(
        &mut self,
        (body, block): (usize, u64),
        from: Target<'_>,
        to: Target<'_>,
        circle: &Circle,
        rate: &RigidStep,
    ) -> Option<WholeStep> {
        let kept = self.kept.iter_mut().find(|kept| (kept.body, kept.block) == (body, block))?;
        let first = match kept.pose(from.sequence) {
            Some(pose) => pose,
            None => {
                let nearest = *kept.poses.iter().rev().find(|pose| pose.frame < from.sequence)?;
                kept.find(from, nearest.moved(circle, rate, (from.sequence - nearest.frame) as f64))?
            }
        };
        let frames = (to.sequence - from.sequence) as f64;
        let second = match kept.pose(to.sequence) {
            Some(pose) => pose,
            None => kept.find(to, first.moved(circle, rate, frames))?,
        };
        let is_seen = kept.is_whole && [first, second].iter().all(|pose| pose.share.is_none_or(|share| share >= WHOLE));
        Some(WholeStep {
            step: first.step_to(&second, circle, frames),
            visible_fraction: first.share.filter(|_| kept.is_whole),
            lever: is_seen.then(|| kept.reference.growth_lever()),
        })
    }
}

impl Kept {
    fn pose(&self, frame: u64) -> Option<Pose> {
        self.poses.iter().rev().find(|pose| pose.frame == frame).copied()
    }

    /// Matches a frame near a pose; renews the reference by it when that no longer serves.
    fn find(&mut self, target: Target<'_>, guess: Pose) -> Option<Pose> {
        let Target { sequence: frame, prepared: target, is_narrow } = target;
        let origin = self.origin;
        let near = (guess.x_px - origin.x_px, guess.y_px - origin.y_px, guess.angle_deg - origin.angle_deg);
        let found = self.reference.find_visible(target, (origin.x_px, origin.y_px), near).ok()?;
        let BodyMotion { motion, visible_fraction, .. } = found;
        let pose = Pose {
            frame,
            x_px: origin.x_px + motion.u_px,
            y_px: origin.y_px + motion.v_px,
            angle_deg: origin.angle_deg + motion.angle_deg,
            sigma: [motion.sigma_u_px, motion.sigma_v_px, motion.sigma_angle_deg],
            pixels: motion.points,
            share: Some(visible_fraction),
        };
        // Farther off, what lies outside of the part made ready would pass for hidden.
        let is_foretold = (pose.x_px - guess.x_px).hypot(pose.y_px - guess.y_px) <= FORETOLD_PX;
        if is_narrow && !is_foretold {
            return None;
        }
        let place = self.poses.partition_point(|other| other.frame < frame);
        self.poses.insert(place, pose);
        let center_px = self.reference.center_px();
        self.veils.extend(self.reference.veil().map(|veil| Veiled { frame, origin, center_px, veil }));
        let is_hidden = visible_fraction < WHOLE;
        // Something in the reference that moves as the body does would be taken for it.
        if found.is_stale() && (!is_hidden || motion.angle_deg.abs() > RENEW_HIDDEN_DEG) {
            let region = Region::Disc { x_px: pose.x_px, y_px: pose.y_px, radius_px: self.radius_px };
            if let Ok(reference) = RigidBody::new(target, &region) {
                (self.reference, self.origin) = (reference, pose);
                self.is_whole = self.is_whole && !is_hidden;
            }
        }
        Some(pose)
    }
}

impl Kept {
    /// Whether a subset of a frame shows something else than the body in that frame or another.
    fn is_veiled(&self, [from, to]: [&Pose; 2], point: &FieldPoint, subset_px: u32) -> bool {
        let apart = (f64::from(point.x_px) - from.x_px, f64::from(point.y_px) - from.y_px);
        let most = (MOST_HIDDEN * f64::from(subset_px).powi(2)).max(FEW_HIDDEN);
        let mut near = self.veils.iter().filter(|veiled| [from.frame, to.frame].contains(&veiled.frame));
        near.any(|Veiled { origin, center_px, veil, .. }| {
            let (x, y) = turned(apart, origin.angle_deg - from.angle_deg);
            let place = (origin.x_px + x - center_px.0, origin.y_px + y - center_px.1);
            f64::from(veil.hidden(place, subset_px)) > most
        })
    }
}

impl Pose {
    /// Where a body whose circle has this rate is after some frames.
    fn moved(&self, circle: &Circle, rate: &RigidStep, frames: f64) -> Self {
        let angle_deg = frames * rate.dtheta_deg;
        let (dx, dy) = turned((self.x_px - circle.x_px, self.y_px - circle.y_px), angle_deg);
        Self {
            x_px: circle.x_px + frames * rate.dx_px + dx,
            y_px: circle.y_px + frames * rate.dy_px + dy,
            angle_deg: self.angle_deg + angle_deg,
            ..*self
        }
    }

    /// The step of the circle's centre to a later pose, per frame.
    fn step_to(&self, later: &Self, circle: &Circle, frames: f64) -> RigidStep {
        let angle_deg = later.angle_deg - self.angle_deg;
        let (dx, dy) = turned((circle.x_px - self.x_px, circle.y_px - self.y_px), angle_deg);
        // The reference's noise is in both poses, unless one is its own.
        let sigma = |k: usize| match (self.share, later.share) {
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

/// An offset turned counter-clockwise on the screen.
fn turned((dx, dy): (f64, f64), angle_deg: f64) -> (f64, f64) {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    (dx * cos + dy * sin, dy * cos - dx * sin)
}
