//! The parameters of the measuring rooms, derived from a configuration.

use super::error::ConfigError;
use super::text::Text;
use super::{Body, BodyKind, Config, TriggerMode};
use crate::ball::BallParams;
use crate::dic::{CorrelationParams, STALE_DEG};
use crate::motion::{Form, Intervals, MotionParams, RandomWalk, Rectifier, Renewal, Scale, Shutter, View};
use crate::results::FrameCoding;
use crate::rod::{MIN_WIDTH_PX, RodParams};
use crate::trigger::{BodyWatch, Condition, MeasuredTrigger};

/// The range of radii relative to the predicted one. It allows for a wrong scale, or a ball out of the plane of motion.
const RADIUS_TOLERANCE: (f64, f64) = (0.8, 1.25);
/// The range of radii if nothing is known, relative to the image's smaller side.
const RADIUS_SHARE: (f64, f64) = (0.04, 0.45);
/// The radius of the smallest ball whose outline can be measured, px.
const MIN_RADIUS_PX: f64 = 6.0;
/// The radius of the smallest ball that is found as a point, px.
const MIN_POINT_RADIUS_PX: f64 = 2.0;
/// The minimum ratio of both radii, if only one is given and the default for the other contradicts it.
const MIN_RADIUS_RATIO: f64 = 1.5;

impl Config {
    /// Checks that every camera of the rig has a source, which files that are measured offline need not have.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when `camera.source` is missing.
    pub fn check_sources(&self) -> Result<(), ConfigError> {
        if self.camera.source.is_none() {
            let allowed = format!("{} for a rig that runs", super::camera::source_names());
            return Err(Text::new(&self.text, &self.origin)?.refuse("camera.source", allowed));
        }
        self.views.iter().try_for_each(|view| view.config.check_sources())
    }

    /// Returns the parameters of the correlator, the same for every body.
    pub fn correlation(&self) -> CorrelationParams {
        self.correlation.clone()
    }

    /// Returns the parameters of a body's ball finder, for images of this size in px.
    ///
    /// # Panics
    ///
    /// If there is no body of this index.
    pub fn ball(&self, body: usize, width_px: u32, height_px: u32) -> BallParams {
        let body = &self.bodies[body];
        let side_px = f64::from(width_px.min(height_px));
        let (lowest, highest) = match self.predicted_radius_px(body) {
            Some(radius_px) => {
                let smallest_px = if radius_px < MIN_RADIUS_PX { MIN_POINT_RADIUS_PX } else { MIN_RADIUS_PX };
                ((RADIUS_TOLERANCE.0 * radius_px).max(smallest_px), RADIUS_TOLERANCE.1 * radius_px)
            }
            None => ((RADIUS_SHARE.0 * side_px).max(MIN_RADIUS_PX), RADIUS_SHARE.1 * side_px),
        };
        let (min_radius_px, max_radius_px) = match (body.min_radius_px, body.max_radius_px) {
            (None, None) => (lowest, highest.max(MIN_RADIUS_RATIO * lowest)),
            (Some(min_px), None) => (min_px, highest.max(MIN_RADIUS_RATIO * min_px)),
            (None, Some(max_px)) => (lowest.min(max_px / MIN_RADIUS_RATIO), max_px),
            (Some(min_px), Some(max_px)) => (min_px, max_px),
        };
        BallParams {
            min_radius_px,
            max_radius_px,
            expected_radius_px: self.predicted_radius_px(body),
            roi_px: body.roi_px,
            outline: body.outline,
            outward: self.outward(),
        }
    }

    /// Returns the outward direction of the surface in the image; `None` with several balls.
    fn outward(&self) -> Option<[f64; 2]> {
        let balls = self.bodies.iter().filter(|body| body.kind == BodyKind::Ball).count();
        let (sin, cos) = self.surface.angle_deg.to_radians().sin_cos();
        (balls == 1).then_some([-sin, -cos])
    }

    /// Returns the parameters of a body's rod finder.
    ///
    /// # Panics
    ///
    /// If there is no body of this index.
    pub fn rod(&self, body: usize) -> RodParams {
        let body = &self.bodies[body];
        let any = RodParams { roi_px: body.roi_px, ..RodParams::new(body.edges) };
        match self.predicted_radius_px(body) {
            None => any,
            Some(radius_px) => {
                let min = (2.0 * RADIUS_TOLERANCE.0 * radius_px).max(MIN_WIDTH_PX);
                RodParams { width_px: [min, (2.0 * RADIUS_TOLERANCE.1 * radius_px).max(1.5 * min)], ..any }
            }
        }
    }

    /// Returns the radius, or half the width of a rod, that scale and diameter predict, px; `None` without a fixed
    /// scale or a diameter.
    fn predicted_radius_px(&self, body: &Body) -> Option<f64> {
        match (self.scale, body.diameter_mm) {
            (Some(Scale::MmPerPx(mm_per_px)), Some(diameter_mm)) => Some(diameter_mm / 2.0 / mm_per_px),
            _ => None,
        }
    }

    /// Returns the parameters for the motion of a body at this nominal frame rate in Hz.
    ///
    /// `exposure_us` is the camera's own exposure time, used if the file gives none.
    ///
    /// # Panics
    ///
    /// If there is no body of this index.
    pub fn motion(&self, body: usize, frame_rate_hz: f64, exposure_us: f64) -> MotionParams {
        let scale = match (self.scale.unwrap_or(Scale::Unknown), self.bodies[body].diameter_mm) {
            (Scale::BallDiameterMm(_), Some(diameter_mm)) => Scale::BallDiameterMm(diameter_mm),
            (scale, _) => scale,
        };
        // Patches are always matched with the first frame.
        let renewal = (self.bodies[body].kind != BodyKind::Patch)
            .then_some(Renewal { block_frames: self.workers.block_frames, stale_deg: STALE_DEG });
        MotionParams {
            scale,
            rectifier: self.calibration.clone(),
            view: View::default(),
            radius_px: self.predicted_radius_px(&self.bodies[body]),
            surface_angle_deg: self.surface.angle_deg,
            gravity_m_s2: self.velocity.gravity_m_s2,
            gravity_angle_deg: self.velocity.gravity_angle_deg,
            window_frames: self.velocity.window_frames,
            lag_frames: u64::from(self.velocity.lag_frames),
            order: self.velocity.order,
            mass_kg: self.bodies[body].mass_kg,
            form: match self.bodies[body].kind {
                BodyKind::Ball => Form::Ball,
                BodyKind::Rod => Form::Rod,
                BodyKind::Patch => Form::Patch,
            },
            interval_frames: self.intervals_frames[0],
            walk: RandomWalk::new(&self.intervals_frames, renewal),
            spans: Intervals::new(&self.intervals_frames, renewal),
            exposure_ns: 1.0e3 * self.camera.exposure_us.unwrap_or(exposure_us),
            coding: FrameCoding::default(),
            shutter: Shutter {
                row_time_frames: 1.0e-6 * self.camera.row_time_us.unwrap_or(0.0) * frame_rate_hz,
                ..Shutter::default()
            },
            frame_period_ns: 1.0e9 / frame_rate_hz,
        }
    }

    /// Creates the trigger on measured motion at this nominal frame rate in Hz; `None` unless
    /// [`TriggerMode::is_measured`]. The mode `motion` is not, because it compares grey levels.
    ///
    /// `exposure_us` is that of [`motion`](Self::motion).
    pub fn measured_trigger(&self, frame_rate_hz: f64, exposure_us: f64) -> Option<MeasuredTrigger> {
        let trigger = &self.trigger;
        let condition = match trigger.mode {
            TriggerMode::Off | TriggerMode::Software | TriggerMode::Hardware | TriggerMode::Motion => return None,
            TriggerMode::Enter => Condition::Enter { roi_px: trigger.roi_px },
            TriggerMode::Speed => Condition::Speed { speed_m_s: trigger.speed_m_s? },
            TriggerMode::Gap => Condition::Gap { gap_mm: trigger.gap_mm? },
            TriggerMode::PredictedContact => Condition::Contact { lead_s: trigger.lead_s },
        };
        let strikes = matches!(trigger.mode, TriggerMode::Gap | TriggerMode::PredictedContact);
        let watch = |(index, body): (usize, &Body)| BodyWatch {
            name: body.name.clone(),
            motion: self.motion(index, frame_rate_hz, exposure_us),
            is_watched: trigger.body.as_ref().is_none_or(|name| *name == body.name)
                && (!strikes || body.has_known_extent()),
            end_px: body.end_mm.filter(|_| strikes).zip(self.scale).and_then(|(end_mm, scale)| match scale {
                Scale::MmPerPx(mm_per_px) => Some(end_mm / mm_per_px),
                _ => None,
            }),
        };
        let bodies = self.bodies.iter().enumerate().map(watch).collect();
        Some(MeasuredTrigger::new(condition, bodies, self.surface.edge))
    }

    /// Returns the number of frames from before a trigger that the ring must hold, at this rate in Hz.
    ///
    /// It is 0 without a recorder, without a trigger, and in mode `hardware`.
    pub fn pre_trigger_frames(&self, frame_rate_hz: f64) -> u64 {
        if self.record.is_none() || matches!(self.trigger.mode, TriggerMode::Off | TriggerMode::Hardware) {
            return 0;
        }
        // The product fits, because pre_s is at most 60 s and the rate at most 1 MHz.
        (self.trigger.pre_s * frame_rate_hz).ceil() as u64
    }

    /// Checks that the ring can hold the pre-trigger time.
    ///
    /// A file that gives size and rate of the frames is checked when it is read. Otherwise the values of the opened camera
    /// have to be checked.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when `pre_s` needs more than `record.ring_bytes_max`, at this rate in Hz and with frames of this size.
    pub fn check_ring(&self, frame_bytes: usize, frame_rate_hz: f64) -> Result<(), ConfigError> {
        let Some(max) = self.record.as_ref().and_then(|record| record.ring_bytes_max) else { return Ok(()) };
        let needed = u128::from(self.pre_trigger_frames(frame_rate_hz)) * frame_bytes as u128;
        if needed <= u128::from(max) {
            return Ok(());
        }
        let pre_s = self.trigger.pre_s;
        let allowed = format!("at least {needed} bytes to hold trigger.pre_s = {pre_s} s at {frame_rate_hz} Hz");
        Err(Text::new(&self.text, &self.origin)?.refuse("record.ring_bytes_max", allowed))
    }

    /// Checks that the calibration applies to images of this size in px.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the image exceeds the calibrated one, or is smaller and its corner is unknown.
    pub fn check_calibration(&self, width_px: u32, height_px: u32) -> Result<(), ConfigError> {
        let Some(calibration) = self.calibration.as_ref().map(Rectifier::calibration) else { return Ok(()) };
        let [x, y] = calibration.offset_px;
        let [width, height] = calibration.image_px;
        let is_whole = [x, y] == [0, 0] && [width_px, height_px] == [width, height];
        let is_part = [x, y] != [0, 0] && x + width_px <= width && y + height_px <= height;
        if is_whole || is_part {
            return Ok(());
        }
        let allowed = format!(
            "the size of the recorded image, {width_px} x {height_px} px, or of a larger one that contains it at \
             calibration.offset_px = [{x}, {y}]"
        );
        Err(Text::new(&self.text, &self.origin)?.refuse("calibration.image_px", allowed))
    }

    /// Checks the ring if the file gives size, format and rate of the frames.
    pub(super) fn check_ring_if_known(&self) -> Result<(), ConfigError> {
        let camera = &self.camera;
        match (camera.image_px(), camera.pixel_format, camera.frame_rate_hz) {
            (Some((width, height)), Some(format), Some(rate_hz)) => {
                self.check_ring(width as usize * height as usize * format.bytes_per_pixel(), rate_hz)
            }
            _ => Ok(()),
        }
    }
}
