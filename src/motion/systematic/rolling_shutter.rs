//! Cameras that expose the rows of a frame one after another.

use crate::motion::{Form, Node, PixelRates};
use crate::results::{BodyStep, Circle, Estimate, Impact, RigidStep, Rod};

/// How far what is seen of a ball draws the row that its motion led to.
const DRAWN: f64 = 0.1;
/// A speed that changes from one step to the next by 1 is unsure by so much at the frame between them.
const BETWEEN: f64 = 0.3;
/// A hidden rim leaves the centre unsure by so many times its share and what the outline is stretched by: a circle fitted to
/// half of an ellipse that is longer by 1 lies off by 1.1.
const HIDDEN: f64 = 2.2;
/// A circle that is fitted to the whole of one that is longer by 1 may follow a part of it, and lies off by so much.
const PARTS: f64 = 0.4;
/// An outline longer by 1 has a radius that depends on how it is fitted, by so much of the square.
const SQUARE: f64 = 0.2;
/// A ball that is struck while its rows are read is bent: its centre is off by so much of its radius' rows.
const BENT: f64 = 0.1;
/// The mean square of how far aside subsets of a ball lie, in radii, as they are weighed; and how unsure that is.
const ASIDE: f64 = 0.2;
const UNSURE_ASIDE: f64 = 0.04;
/// What subsets of a ball take for a front that turns, of the same.
const FRONT: f64 = 0.6;
/// Half a subset, px; the share of a disc beyond a chord, over its height in radii to the power of 1.5; and how much more than
/// that a turn is off by what it strains.
const SUBSET_PX: f64 = 16.0;
const CAP: f64 = 0.6;
const STRAINED: f64 = 2.0;
/// How far beside the centre half of a ball lies, in radii.
const HALF: f64 = 0.4;
/// How far beside its centre the rows lie that a whole ball is followed by, in radii: its pattern is not even.
const UNEVEN: f64 = 0.02;
/// Rows that follow a body hardly show it.
const LEAST: f64 = 0.1;

/// When the rows of a frame are exposed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shutter {
    /// How much later each row is exposed than the one above it, frame periods: 0 where all are at once, below 0 where it
    /// rolls upwards.
    pub row_time_frames: f64,
    /// The row that is exposed from the frame's stamp on.
    pub first_row_px: f64,
    /// The last column and row of the picture, where they are known, px.
    pub last_px: Option<[f64; 2]>,
}

impl Shutter {
    /// The same of pictures of this size: a shutter that rolls upwards begins with the last row.
    ///
    /// Rows above that the camera leaves out shift all moments alike, and nothing else.
    #[must_use]
    pub fn over(self, size_px: [u32; 2]) -> Self {
        let last_px = size_px.map(|length_px| f64::from(length_px.saturating_sub(1)));
        let first_row_px = if self.row_time_frames < 0.0 { last_px[1] } else { 0.0 };
        Self { first_row_px, last_px: Some(last_px), ..self }
    }

    /// The share of a ball that is not followed: what is hidden, and what lies too near to the picture's edge for subsets.
    fn unfollowed(&self, circle: &Circle) -> f64 {
        let beyond_px =
            |at: f64, last: f64| (circle.radius_px + SUBSET_PX - at).max(at + circle.radius_px + SUBSET_PX - last);
        let beyond_px = self.last_px.map_or(0.0, |[x, y]| beyond_px(circle.x_px, x).max(beyond_px(circle.y_px, y)));
        let share = CAP * (beyond_px.max(0.0) / circle.radius_px.max(1.0)).powf(1.5);
        (1.0 - circle.visible_fraction).max(share).min(1.0)
    }
}

/// What the rows of one body's frames do to it.
///
/// A body is seen at the moment its own row is read: one that moves by u rows a frame is seen 1 + u T frame periods later in
/// the next, T being the row time in those. Within a frame its lower rows are later: it is drawn longer by u T, and sheared by
/// what it moves aside a frame, times T. And of a body that turns, what moves down is followed for longer than what moves up:
/// it seems to sink.
#[derive(Debug, Clone)]
pub struct Rolling {
    shutter: Shutter,
    form: Form,
    /// The row of its centre.
    row_px: Option<f64>,
    /// The frame in which it was told last.
    frame: u64,
    /// How far it moved in the picture in the newest frame and the one before, px.
    moved_px: Option<[[f64; 2]; 2]>,
    /// Whether the newest frame has a step.
    is_led: bool,
    /// Its radius, px, and the share of it that is not followed.
    radius_px: f64,
    hidden: f64,
    /// How far beside its centre the rows lie that it is followed by, at most since a contact began, px.
    beside_px: f64,
    /// What its angle seemed to be when it was first told, rad.
    first_rad: Option<f64>,
}

impl Rolling {
    /// Of a camera with this shutter, and what it films.
    pub fn new(shutter: Shutter, form: Form) -> Self {
        Self {
            shutter,
            form,
            row_px: None,
            frame: 0,
            moved_px: None,
            is_led: false,
            radius_px: 0.0,
            hidden: 0.0,
            beside_px: 0.0,
            first_rad: None,
        }
    }

    /// How much later than the stamp its centre was exposed, frame periods; takes the next step in frame order, of the
    /// recorded picture.
    pub fn push(&mut self, step: &BodyStep) -> f64 {
        self.row_px = self.row(step);
        self.frame = step.frame;
        if let Some(circle) = step.circle {
            (self.radius_px, self.hidden) = (circle.radius_px, self.shutter.unfollowed(&circle));
        }
        // What is hidden lies to one side of the rest.
        let beside_px = |circle: Circle| circle.radius_px * UNEVEN.hypot(1.0 - circle.visible_fraction);
        self.beside_px = self.beside_px.max(step.circle.map_or(0.0, beside_px));
        let moved_px = step.center_step().map(|step| [step.dx_px, step.dy_px]);
        let moved_px = moved_px.filter(|moved| moved.iter().all(|px| px.is_finite()));
        let before_px = self.moved_px.map(|[newest, _]| newest);
        // A body that was lost may have been struck meanwhile.
        let before_px = if self.is_led { before_px } else { moved_px.or(before_px) };
        self.moved_px = moved_px.or(before_px).map(|newest| [newest, before_px.unwrap_or(newest)]);
        self.is_led = moved_px.is_some();
        let first_px = self.shutter.first_row_px;
        self.shutter.row_time_frames * (self.row_px.unwrap_or(first_px) - first_px)
    }

    /// Where its steps lead, as it is seen to be: a rod is told by one point of it or another, steps are of the same.
    fn row(&self, step: &BodyStep) -> Option<f64> {
        let ahead_px =
            self.moved_px.map_or(0.0, |[newest, _]| step.frame.saturating_sub(self.frame) as f64 * newest[1]);
        let led_px = self.row_px.map(|row_px| row_px + ahead_px);
        let seen_px = step.circle.map(|circle| circle.y_px).or(step.rod.map(|rod| rod.y_px.value));
        match (led_px, seen_px.filter(|row_px| row_px.is_finite())) {
            (Some(led_px), Some(_)) if self.is_led && step.rod.is_some() => Some(led_px),
            (Some(led_px), Some(seen_px)) if self.is_led => Some(led_px + DRAWN * (seen_px - led_px)),
            (led_px, seen_px) => seen_px.or(led_px),
        }
    }

    /// What it moves in the picture a frame at the newest frame and how much that changes, times the row time.
    fn bent(&self) -> ([f64; 2], [f64; 2]) {
        let [newest, before] = self.moved_px.unwrap_or_default();
        let of =
            |px: fn(f64, f64) -> f64| [0, 1].map(|axis| self.shutter.row_time_frames * px(newest[axis], before[axis]));
        (of(|newest, before| 0.5 * (newest + before)), of(|newest, before| newest - before))
    }

    /// How many frame periods pass between its pictures.
    pub fn periods(&self) -> f64 {
        (1.0 + self.bent().0[1]).max(LEAST)
    }

    /// The newest frame's node without what the shear of the picture makes its angle seem since the first.
    #[must_use]
    pub fn unsheared(&mut self, node: Node) -> Node {
        if !self.rolls() {
            return node;
        }
        let leans_rad = 0.5 * self.bent().0[0];
        let [x, y, angle_deg] = node.pose;
        let first_rad = *self.first_rad.get_or_insert(leans_rad);
        Node { pose: [x, y, angle_deg - (leans_rad - first_rad).to_degrees()], ..node }
    }

    /// A contact has begun.
    pub fn touches(&mut self) {
        self.beside_px = 0.0;
    }

    /// An impact whose moments are as sure as it is which rows showed them; `period_s` is a frame's.
    #[must_use]
    pub fn told(&self, impact: Impact, period_s: f64) -> Impact {
        if !self.rolls() {
            return impact;
        }
        let unsure_s = self.shutter.row_time_frames * self.beside_px * period_s;
        let told = |at: Option<Estimate>| at.map(|at| Estimate { sigma: at.sigma.hypot(unsure_s), ..at });
        let spin = |spin: Option<Estimate>| {
            spin.map(|spin| Estimate { sigma: spin.sigma.hypot(self.swings(spin.value * period_s) / period_s), ..spin })
        };
        Impact {
            start_s: told(impact.start_s),
            deepest_s: told(impact.deepest_s),
            end_s: told(impact.end_s),
            slip_end_s: told(impact.slip_end_s),
            force_start_s: told(impact.force_start_s),
            force_end_s: told(impact.force_end_s),
            omega_before_rad_s: spin(impact.omega_before_rad_s),
            omega_after_rad_s: spin(impact.omega_after_rad_s),
            ..impact
        }
    }

    /// The rates of a body that turns, as sure as they are: what is on its one side is followed for longer, and which that is
    /// changes as it turns.
    #[must_use]
    pub fn unsure(&self, rates: PixelRates) -> PixelRates {
        if !self.rolls() {
            return rates;
        }
        let turn_rad = rates.theta.value.to_radians();
        let swings_deg = self.swings(turn_rad).hypot(self.strains(turn_rad)).to_degrees();
        let theta = Estimate { sigma: rates.theta.sigma.hypot(swings_deg), ..rates.theta };
        PixelRates { theta, ..rates }
    }

    /// By how much a turn of so many rad a frame period may seem another, rad.
    fn swings(&self, turn_rad: f64) -> f64 {
        self.shutter.row_time_frames * UNEVEN * self.radius_px * turn_rad * turn_rad
    }

    /// By how much it may where a part is hidden, rad: what is stretched and turns is strained, and the rest of it alone is turned
    /// by that.
    fn strains(&self, turn_rad: f64) -> f64 {
        STRAINED * self.hidden * length(self.bent().0) * turn_rad
    }

    /// Whether rows are exposed one after the other.
    pub fn rolls(&self) -> bool {
        self.shutter.row_time_frames.total_cmp(&0.0).is_ne()
    }

    /// The step that was pushed last, as a camera shows it that exposes all rows at once.
    ///
    /// Its motion stays that between the moments of two frames, and its rotation what the picture shows: see [`Self::unsheared`].
    pub fn straightened(&self, step: &BodyStep) -> BodyStep {
        if !self.rolls() || self.moved_px.is_none() {
            return *step;
        }
        let (stretch, change) = self.bent();
        let longer = 0.5 * change[1];
        let growth = |grown: Estimate| Estimate { value: grown.value - longer, sigma: grown.sigma.hypot(longer) };
        let straight = BodyStep {
            // The outline of a patch is as it was drawn.
            circle: step.circle.map(|circle| match self.form {
                Form::Patch => circle,
                Form::Ball | Form::Rod => round(circle, stretch, change),
            }),
            rod: step.rod.map(|rod| self.upright(rod, stretch, change)),
            growth_fraction: step.growth_fraction.map(growth),
            ..*step
        };
        match step.circle {
            Some(circle) => self.unsunk(straight, &circle, stretch, change),
            None => straight,
        }
    }

    /// Of a ball or patch that turns, without what it only seems to sink.
    fn unsunk(&self, step: BodyStep, circle: &Circle, stretch: [f64; 2], change: [f64; 2]) -> BodyStep {
        let Some(seen) = step.step else { return step };
        let (radius_px, hidden) = (circle.radius_px, self.hidden);
        let interval = f64::from(step.interval_frames.max(1));
        let turn = seen.dtheta_deg.to_radians();
        let sinks_px = self.shutter.row_time_frames * radius_px * radius_px * turn * (interval * turn).sin() / interval;
        let lopsided = hidden * HALF * radius_px * length(change).hypot(length(stretch) * turn);
        let unsure_px =
            ((UNSURE_ASIDE + hidden * ASIDE) * sinks_px).hypot(lopsided).hypot(swings_px(radius_px, change, self));
        let unsure_deg = (0.5 * length(change)).hypot(self.strains(turn)).to_degrees();
        let straight = RigidStep {
            dy_px: seen.dy_px - ASIDE * sinks_px,
            sigma_dx_px: seen.sigma_dx_px.hypot(unsure_px),
            sigma_dy_px: seen.sigma_dy_px.hypot(unsure_px),
            sigma_dtheta_deg: seen.sigma_dtheta_deg.hypot(unsure_deg),
            ..seen
        };
        let drift = step.drift.map(|[x, y, turn]| {
            let y = Estimate { value: y.value - FRONT * sinks_px, sigma: y.sigma.hypot(0.25 * FRONT * sinks_px) };
            [x, y, turn]
        });
        BodyStep { step: Some(straight), drift, ..step }
    }

    /// A rod at the moment that its middle was exposed.
    fn upright(&self, rod: Rod, stretch: [f64; 2], change: [f64; 2]) -> Rod {
        let longer = self.periods();
        let (middle_px, unsure) = (rod.y_px.value, BETWEEN * length(change));
        let mut edges = rod.edges;
        for place in edges.iter_mut().flatten().filter_map(|edge| edge.y_px.as_mut()) {
            let below_px = (place.value - middle_px) / longer;
            *place = Estimate { value: middle_px + below_px, sigma: place.sigma.hypot(unsure * below_px) };
        }
        let slope = rod.tilt_deg.value.to_radians().tan() * longer - stretch[0];
        let tilt_deg =
            Estimate { value: slope.atan().to_degrees(), sigma: rod.tilt_deg.sigma.hypot(unsure.to_degrees()) };
        Rod { tilt_deg, edges, ..rod }
    }
}

fn length([x, y]: [f64; 2]) -> f64 {
    x.hypot(y)
}

/// How far the mean of a ball's rows leaves its centre while its speed changes, px.
fn swings_px(radius_px: f64, change: [f64; 2], rolling: &Rolling) -> f64 {
    BENT * radius_px * length(change) * (rolling.shutter.row_time_frames * radius_px).abs()
}

/// The circle whose picture is stretched and sheared.
fn round(circle: Circle, stretch: [f64; 2], change: [f64; 2]) -> Circle {
    let radius_px = circle.radius_px / (1.0 + 0.5 * stretch[1]).max(LEAST);
    let parts_px = PARTS.hypot(HIDDEN * (1.0 - circle.visible_fraction)) * length(stretch) * radius_px;
    let struck_px = BENT * length(change) * radius_px;
    let unsure = SQUARE * length(stretch).powi(2) + 0.5 * BETWEEN * length(change);
    Circle {
        radius_px,
        sigma_center_px: circle.sigma_center_px.hypot(parts_px).hypot(struck_px),
        sigma_radius_px: circle.sigma_radius_px.hypot(parts_px).hypot(unsure * radius_px),
        ..circle
    }
}

#[cfg(test)]
mod tests;
