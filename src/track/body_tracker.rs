//! The tracker of one body.

mod collisions;
mod flights;

use super::gating::ValidationGate;
use super::moving_surface::MovingSurface;
use super::pending_impact::{PendingImpact, Revision};
use super::rows::TrackerRows;
use super::sightings::Sightings;
use crate::impact::{Detector, Event, SurfaceNode, deepest_so_far};
use crate::measure::body_circle;
use crate::motion::{
    Axes, Center, CenterFilter, DEFAULT_LAG_FRAMES, Form, KnownMotion, LocalDrift, MotionParams, OutlineDrift,
    PixelRates, PlanarRates, Pose, PoseIntegrator, Regime, RollingShutter, RunningBias, RunningRadius, Scatter,
    SizeChange, SpeedBias, View, ViewPosition, gravity_px, physical, smooth, widened_by_neighbours,
};
use crate::results::{
    Alarm, AlarmKind, BodyStep, Estimate, Impact, MotionMethod, Phase, PointStatus, RigidStep, TrackSample,
    VelocitySample,
};

/// The distance from which an outline and the integrated motion place the centre differently, sigmas.
const CONTRADICTION_SIGMAS: f64 = 8.0;
/// The share of a rotation held back by light from which the rotation is not known at all, and the share that stands for it.
const MAX_LIGHT_FRACTION: f64 = 0.7;
const UNKNOWN_FRACTION: f64 = 1e9;
/// The share of the rotation held back by light that appears as a motion of a lopsided pattern.
const LIGHT_PULL: f64 = 0.3;
/// The number of nodes kept beyond the reach of the local fits.
const SPARE_NODES: u64 = 64;

/// The tracker of one body.
#[derive(Debug, Clone)]
pub struct BodyTracker {
    body: u32,
    params: MotionParams,
    origin_ns: u64,
    axes: Axes,
    gate: ValidationGate,
    integrator: PoseIntegrator,
    center_filter: CenterFilter,
    radius: RunningRadius,
    fixed_pattern_bias: RunningBias,
    light_bias: RunningBias,
    pull_px: RunningBias,
    size_change: SizeChange,
    outline_drift: OutlineDrift,
    rolling: RollingShutter,
    /// The offset of a rod from the pose that its steps lead to, px.
    rod_px: Option<[f64; 2]>,
    /// The method of the newest measured motion.
    method: MotionMethod,
    nodes: Vec<Pose>,
    sightings: Sightings,
    /// The newest frame, whether the body was detected in it or not.
    newest_frame: u64,
    first_sigma_deg: Option<f64>,
    detector: Option<Detector>,
    /// Whether the deepest point of the current contact was reported.
    deepest_reported: bool,
    pending_impact: Option<PendingImpact>,
    collisions: u32,
    /// The position in the newest frame along the surface's axes; `None` if there is none.
    newest: Option<SurfaceNode>,
    /// The body that is the surface; `None` for a fixed surface.
    surface: Option<MovingSurface>,
}

impl BodyTracker {
    /// Creates the tracker of body number `body`; without a `detector` no contacts are detected.
    pub fn new(body: u32, params: &MotionParams, detector: Option<Detector>) -> Self {
        let rolling = RollingShutter::new(params.shutter, params.form);
        Self {
            body,
            params: params.clone(),
            origin_ns: 0,
            axes: Axes::new(params.surface_angle_deg),
            gate: ValidationGate::default(),
            integrator: PoseIntegrator::new(params.walk),
            center_filter: CenterFilter::new(),
            radius: RunningRadius::new(),
            fixed_pattern_bias: RunningBias::default(),
            light_bias: RunningBias::default(),
            pull_px: RunningBias::default(),
            size_change: SizeChange::default(),
            outline_drift: OutlineDrift::new(&rolling),
            rolling,
            rod_px: None,
            method: MotionMethod::default(),
            nodes: Vec::new(),
            sightings: Sightings::default(),
            newest_frame: 0,
            first_sigma_deg: None,
            detector,
            deepest_reported: false,
            pending_impact: None,
            collisions: 0,
            newest: None,
            surface: None,
        }
    }

    /// Adds a position of the moving surface, which is another body. Impacts of this body are measured relative to it.
    pub fn add_surface_position(&mut self, node: SurfaceNode) {
        let kept_from = self.detector.as_ref().map_or(0, Detector::kept_from);
        self.surface.get_or_insert_default().push(node, kept_from);
    }

    /// Returns the position in the newest frame along the surface's axes; `None` if the body was not measured there.
    pub fn newest(&self) -> Option<SurfaceNode> {
        self.newest
    }

    /// Adds the next step and appends its impacts and alarms to `rows`; `origin_ns` is the first stamp of the stream.
    ///
    /// Returns the step after gating and correction for the rolling shutter, which [`Self::rows`] expects.
    pub fn add_step(&mut self, step: &BodyStep, origin_ns: u64, rows: &mut TrackerRows) -> BodyStep {
        let accepted = self.gate.gate(step);
        self.sightings.push(&accepted);
        let later_frames = self.rolling.push(&accepted);
        let straight = self.rolling.as_global_shutter(&accepted);
        self.origin_ns = origin_ns;
        let since_ns = (i128::from(step.stamp_ns) - i128::from(origin_ns)) as f64 + 0.5 * self.params.exposure_ns;
        let time_frames = since_ns / self.params.frame_period_ns + later_frames;
        self.integrate_step(&self.params.rectified(&straight), time_frames, rows);
        straight
    }

    /// Adds a rectified step, `time_frames` after the first stamp, to the pose and everything that follows from it.
    fn integrate_step(&mut self, step: &BodyStep, time_frames: f64, rows: &mut TrackerRows) {
        self.newest_frame = step.frame;
        self.newest = None;
        // An outline that was predicted by the motion holds no information of its own.
        let outline = body_circle(step).filter(|_| step.is_detected());
        if let Some(circle) = &outline {
            self.radius.push(circle);
        }
        if let Some(share) = step.fixed_fraction {
            self.fixed_pattern_bias.push(share);
        }
        if let Some(share) = step.light_fraction {
            self.light_bias.push(share);
        }
        if let Some(pull_px) = step.pull_px {
            self.pull_px.push(pull_px);
        }
        if step.motion.is_some() {
            self.method = step.method;
        }
        self.size_change.push(step, time_frames);
        if self.params.form == Form::Ball {
            self.outline_drift.push_step(time_frames, step);
        }
        let Some(node) = self.integrator.push(step, time_frames, self.rolling.image_interval_periods()) else { return };
        let node = self.rolling.without_shear(node);
        self.first_sigma_deg.get_or_insert(node.sigma[2]);
        self.retain_node(node);
        if let Some(circle) = outline.filter(|_| self.params.form == Form::Ball) {
            self.outline_drift.push(&node, &circle);
        }
        if let Some(rod) = step.rod() {
            self.rod_px = Some([rod.x_px.value - node.pose[0], rod.y_px.value - node.pose[1]]);
        }
        let gravity = self.gravity().map(|g| self.axes.surface(g[0], g[1]).normal);
        let node_on_surface = SurfaceNode::new(&node, self.axes, step);
        self.newest = Some(node_on_surface);
        let event = self.detector.as_mut().map_or(Event::None, |detector| {
            let may_be_in_contact = detector.may_be_in_contact();
            if let Some(circle) = outline.filter(|_| !may_be_in_contact) {
                self.center_filter.update(&node, &circle);
            }
            detector.add_node(node_on_surface, gravity)
        });
        if let (None, Some(circle)) = (&self.detector, &outline) {
            self.center_filter.update(&node, circle);
        }
        self.handle_event(event, node.time_frames, &mut rows.impacts);
        rows.alarms.extend(self.take_alarm(event, step.frame, node.time_frames));
    }

    /// Returns the alarm of an event at `time_frames`, or that of the deepest point, once per contact.
    fn take_alarm(&mut self, event: Event, frame: u64, time_frames: f64) -> Option<Alarm> {
        let period_s = self.params.frame_period_ns * 1e-9;
        let alarm = |kind, at: Estimate| {
            let at_s = Estimate { value: at.value * period_s, sigma: at.sigma * period_s };
            let stamp_ns = self.origin_ns.saturating_add_signed((1e9 * at_s.value).round() as i64);
            Alarm { body: self.body, kind, frame, at_s, stamp_ns }
        };
        let detector = self.detector.as_ref()?;
        match (event, detector.contact().filter(|contact| contact.end_frames.is_none())) {
            (Event::Began, Some(contact)) => {
                self.deepest_reported = false;
                let periods = f64::from(contact.stride);
                Some(alarm(AlarmKind::Began, Estimate { value: contact.start_frames * periods, sigma: periods }))
            }
            (Event::Dismissed, _) => Some(alarm(AlarmKind::Withdrawn, Estimate { value: time_frames, sigma: 1.0 })),
            (_, Some(contact)) if !self.deepest_reported => {
                let Estimate { value, sigma } = deepest_so_far(detector.nodes(contact.stride), contact)?;
                self.deepest_reported = true;
                let periods = f64::from(contact.stride);
                Some(alarm(AlarmKind::Turned, Estimate { value: value * periods, sigma: sigma * periods }))
            }
            _ => None,
        }
    }

    /// Adds a step over a longer interval to the pose, unless the gate rejected the ball in its frame.
    pub fn link(&mut self, step: &BodyStep) {
        if !self.gate.has_rejected(step.frame) {
            self.integrator.link(&self.params.rectified(&self.rolling.as_global_shutter(step)));
        }
    }

    /// Ends the stream: measures the last collision finally and reports a contact that lasts beyond the end.
    pub fn finish(&mut self, impacts: &mut Vec<Impact>) {
        self.measure_impact(f64::INFINITY, Revision::Final, impacts);
        let contact = self.detector.as_ref().and_then(|d| d.contact().copied());
        if let Some(contact) = contact.filter(|c| c.end_frames.is_none()) {
            impacts.push(self.unfinished_impact(&contact));
        }
    }

    /// Stores a pose. Discards those beyond the reach of the local fits, once there are at least 256 of them.
    fn retain_node(&mut self, node: Pose) {
        self.nodes.push(node);
        let lag = self.params.lag_frames.max(DEFAULT_LAG_FRAMES);
        let reach = u64::from(self.params.window_frames.unwrap_or(0)) + 2 * lag + SPARE_NODES;
        let old = self.nodes.partition_point(|n| n.frame + reach < node.frame);
        if old >= 256 {
            self.nodes.drain(..old);
        }
    }

    /// Returns gravity along x and y (down) of the image, px/frame^2; `None` without a scale.
    fn gravity(&self) -> Option<[f64; 2]> {
        let scale = self.radius.metres_per_px(self.params.scale)?;
        Some(gravity_px(&self.params, scale.value))
    }

    /// Returns the bounds of the relative error of measured speeds by the fixed pattern and by interpolation.
    fn speed_bias(&self) -> SpeedBias {
        let radius_px = self.radius.radius_px().filter(|_| self.params.form != Form::Rod);
        SpeedBias {
            share: self.fixed_pattern_bias.significant(),
            spans: self.params.spans,
            is_whole: self.method == MotionMethod::WholeBody,
            radius_px: radius_px.map_or(0.0, |radius| radius.value),
        }
    }

    /// Returns the image position of the origin of poses, px; `None` before a centre or a rod was measured.
    fn origin_px(&self) -> Option<[f64; 2]> {
        let center = self.nodes.last().and_then(|node| Some((node.pose, self.center_filter.center(node)?)));
        center.map(|(pose, center)| [center.x_px - pose[0], center.y_px - pose[1]]).or(self.rod_px)
    }

    /// Corrects the velocity of the centre at a node for motion out of the image plane. `here` is the local drift of
    /// the outline.
    fn correct_out_of_plane(&self, rates: PixelRates, regime: Regime, node: &Pose, here: &LocalDrift) -> PixelRates {
        let rates = OutlineDrift::apply_to_rates(rates, here);
        let View { principal_point_px: [x, y], sigma_px } = self.params.view;
        let Some(origin_px) = self.origin_px() else { return rates };
        let place_px = [origin_px[0] + node.pose[0] - x, origin_px[1] + node.pose[1] - y];
        self.size_change.across(
            rates,
            regime,
            ViewPosition { frame: node.frame, time_frames: node.time_frames, place_px, sigma_px },
        )
    }

    /// Returns the centre predicted by the pose, with the uncertainty of the drift of the outline.
    fn predicted_center(&self, node: &Pose, here: &LocalDrift) -> Option<Center> {
        let drift_px = self.outline_drift.center_uncertainty_px(node, here);
        let center = self.center_filter.center(node)?;
        Some(Center { sigma_px: center.sigma_px.hypot(drift_px), ..center })
    }

    /// Returns the difference between measured and expected radius that noise and the scale do not explain, or the scatter
    /// of the radii that noise does not explain, px.
    ///
    /// Glancing reflections or shadow mask the rim on one side, which moves the centre by about as much.
    fn rim_misfit_px(&self) -> f64 {
        if self.params.form != Form::Ball {
            return 0.0;
        }
        let misfit_px = self.params.radius_px.map_or(0.0, |expected_px| self.radius.misfit_px(expected_px));
        misfit_px.max(self.radius.scatter_px())
    }

    /// Returns the distance from the centre of the point that light or stripes hold in place while the body turns, px.
    fn pulled_px(&self) -> f64 {
        let radius_px = self.radius.radius_px().filter(|_| self.params.form == Form::Ball);
        let by_light_px = LIGHT_PULL * self.light_bias.significant() * radius_px.map_or(0.0, |radius| radius.value);
        by_light_px.max(self.pull_px.significant())
    }

    /// Adds the systematic uncertainty of measured motions: fixed pattern, interpolation and light.
    fn with_systematic_errors(&self, rates: PixelRates) -> PixelRates {
        let PixelRates { x, y, theta, .. } = rates;
        let motion = PlanarRates { first_px: x.value, second_px: y.value, angle_deg: theta.value };
        let speed_bias = self.speed_bias();
        let rates = rates.biased_by(speed_bias.underestimate(motion)).biased_by(speed_bias.interpolation_error(motion));
        PixelRates { theta: rates.theta.with_relative_error(self.light_fraction()), ..rates }
    }

    /// Adds the errors of a step by light, which moves the centre by up to `center_sigma_px` and holds the rotation back.
    fn with_light_errors(&self, step: RigidStep, center_sigma_px: f64) -> RigidStep {
        step.about(center_sigma_px).with_rotation_error(self.light_fraction())
    }

    /// Returns the share of the rotation that light may hold back; where it is nearly all, the rotation is not known.
    fn light_fraction(&self) -> f64 {
        // A share of hardly any rotation says nothing about that of the body.
        Some(self.light_bias.significant()).filter(|share| *share < MAX_LIGHT_FRACTION).unwrap_or(UNKNOWN_FRACTION)
    }

    /// Adds the errors that the outlines of many frames share, if these gave the motion.
    fn with_outline_errors(&self, rates: PixelRates, step: &BodyStep, track: &TrackSample) -> PixelRates {
        let method = step.motion.map_or(self.method, |_| step.method);
        let sigma_px = track.sigma_center_px.filter(|_| method == MotionMethod::Outlines);
        sigma_px.map_or(rates, |sigma_px| rates.from_outlines(sigma_px))
    }

    /// Returns the status of the rotation of a step, which light makes ambiguous if it holds it back.
    fn rotation_status(&self, step: &BodyStep) -> PointStatus {
        let is_held = step.rotation_status == PointStatus::Valid && self.light_fraction() > MAX_LIGHT_FRACTION;
        if is_held { PointStatus::Ambiguous } else { step.rotation_status }
    }

    /// Returns the rows of a frame from everything added so far; `step` is the one that [`Self::add_step`] returned.
    pub fn rows(&self, step: &BodyStep) -> (TrackSample, VelocitySample) {
        let step = &BodyStep { status: self.sightings.status(step), ..*step };
        let is_missing = matches!(step.status, PointStatus::Lost | PointStatus::Occluded | PointStatus::OutOfFrame)
            || (body_circle(step).is_none() && step.status == PointStatus::Ambiguous);
        let node = self.nodes.binary_search_by_key(&step.frame, |n| n.frame).ok().map(|i| self.nodes[i]);
        let node = node.filter(|_| !is_missing);
        let circle = step.circle().filter(|_| !is_missing);
        let outline = body_circle(step).filter(|_| !is_missing);
        let (regime, phase) = self.detector.as_ref().map_or((Regime::Unknown, Phase::Unknown), |d| {
            (d.regime(step.frame), if node.is_some() { d.phase(step.frame) } else { Phase::Unknown })
        });
        let outline = outline.map(|c| Center { x_px: c.x_px, y_px: c.y_px, sigma_px: c.sigma_center_px });
        let detected = outline.filter(|_| step.is_detected());
        let here = node.map(|node| (node, self.outline_drift.local_drift(&node, regime)));
        let by_pose = |(node, here): (Pose, LocalDrift)| {
            let center = self.outline_drift.center(&node, &here).or_else(|| self.predicted_center(&node, &here))?;
            Some(self.outline_drift.widened(&node, center))
        };
        let center = here.and_then(by_pose).and_then(|center| self.params.recorded(center)).or(outline);
        let center =
            center.map(|center| detected.filter(|detected| contradicts_motion(detected, &center)).unwrap_or(center));
        let angle = here.filter(|(n, _)| n.bridged[2].is_finite());
        let sigma_angle = |(n, here): (Pose, LocalDrift)| {
            let noise = (n.sigma[2].powi(2) + self.first_sigma_deg.unwrap_or(0.0).powi(2) + n.bridged[2]).sqrt();
            noise.hypot(self.outline_drift.angle_uncertainty_deg(&n, &here))
        };
        let track = TrackSample {
            frame: step.frame,
            body: step.body,
            stamp_ns: step.stamp_ns,
            center_x_px: center.map(|c| c.x_px),
            center_y_px: center.map(|c| c.y_px),
            angle_deg: angle.map(|(n, _)| n.pose[2]),
            radius_px: circle.map(|c| c.radius_px),
            sigma_center_px: center.map(|c| c.sigma_px.hypot(self.rim_misfit_px())),
            sigma_angle_deg: angle.map(sigma_angle),
            visible_fraction: circle.map(|c| c.visible_fraction),
            rod: step.rod().filter(|_| !is_missing),
            status: step.status,
        };
        let known = KnownMotion { nodes: &self.nodes, to_frame: self.newest_frame, gravity: self.gravity() };
        let scatter = Scatter::near(known, step.frame, regime, self.params.coding);
        let rates = here.and_then(|(n, here)| {
            let rates = scatter.apply_to_rates(smooth(known, n.frame, regime, &self.params)?, &n);
            let rates = self.with_outline_errors(rates, step, &track);
            Some(self.rolling.widen_rates(self.correct_out_of_plane(rates, regime, &n, &here)))
        });
        let scale = self.radius.metres_per_px(self.params.scale);
        let center_sigma_px = track.sigma_center_px.unwrap_or(0.0).hypot(self.pulled_px());
        let velocity = VelocitySample {
            frame: step.frame,
            body: step.body,
            stamp_ns: step.stamp_ns,
            center_x_px: track.center_x_px,
            center_y_px: track.center_y_px,
            radius_px: track.radius_px,
            motion: step
                .motion
                .filter(|_| !is_missing)
                .map(|moved| here.map_or(moved, |(_, here)| OutlineDrift::apply_to_step(moved, step.drift, &here)))
                .map(|moved| widened_by_neighbours(known, step.frame, step.interval_frames.into(), moved))
                .map(|moved| self.with_light_errors(scatter.apply_to_step(moved), center_sigma_px).into()),
            velocity: rates.zip(scale).map(|(rates, scale)| {
                physical(&self.with_systematic_errors(rates.about(center_sigma_px)), scale, &self.params)
            }),
            visible_fraction: track.visible_fraction,
            phase,
            rotation_status: self.rotation_status(step),
            status: step.status,
        };
        (track, velocity)
    }
}

/// Whether the detected centre is over eight standard uncertainties from that by the motion from other frames.
fn contradicts_motion(detected: &Center, by_motion: &Center) -> bool {
    let apart_px = (detected.x_px - by_motion.x_px).hypot(detected.y_px - by_motion.y_px);
    apart_px > CONTRADICTION_SIGMAS * detected.sigma_px.hypot(by_motion.sigma_px)
}
