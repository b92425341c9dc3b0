//! The collisions of a body: begun, measured, revised and withdrawn.

use super::BodyTracker;
use crate::impact::{Contact, DilatationRates, Event, ImpactContext, OutOfPlane, solve};
use crate::motion::{Form, Scale, gravity_px};
use crate::results::{Estimate, Impact, PointStatus};
use crate::track::pending_impact::{PendingImpact, REVISIONS_FRAMES, Revision, due_revisions};

/// The number of frames after which a collision that could not be measured is tried again.
const RETRY_FRAMES: f64 = 3.0;
/// The time after the end of contact from which the first revision is final, s.
const FINAL_AFTER_S: f64 = 0.035;
/// The uncertainty of the start and the end of a contact that is detected but not measured, frames.
const DETECTED_SIGMA_FRAMES: f64 = 2.0;
/// The flight before a contact in which a moving surface must not rotate, frames.
const FLIGHT_FRAMES: f64 = 128.0;

impl BodyTracker {
    /// Begins, measures, revises or withdraws the collision after an event of the detector.
    pub(super) fn handle_event(&mut self, event: Event, time_frames: f64, impacts: &mut Vec<Impact>) {
        let contact = self.detector.as_ref().and_then(|d| d.contact().copied());
        match event {
            Event::Began => {
                // The flight after the previous collision is over, so this revision is the final one.
                if let Some(next) = contact {
                    self.measure_impact(next.flight_to_frames * f64::from(next.stride), Revision::Final, impacts);
                }
                self.rolling.begin_contact();
                self.pending_impact = None;
            }
            Event::Ended => {
                self.pending_impact = contact.map(|contact| PendingImpact {
                    contact,
                    number: self.collisions,
                    revision: 0,
                    measured_to_frames: f64::NEG_INFINITY,
                    stage: due_revisions(contact.nodes_since_end(time_frames)),
                    sigma: f64::INFINITY,
                    tried_frames: time_frames,
                });
                self.collisions += 1;
                self.measure_impact(time_frames, Revision::Preliminary, impacts);
            }
            Event::Dismissed => self.pending_impact = None,
            Event::None => self.revise(time_frames, impacts),
        }
    }

    /// Measures the last collision again when a revision or a retry is due, and ends it with the final revision.
    fn revise(&mut self, time_frames: f64, impacts: &mut Vec<Impact>) {
        let Some(pending_impact) = &mut self.pending_impact else { return };
        // The detector estimates the end again while the flight after it grows.
        if let Some(contact) = self.detector.as_ref().and_then(|d| d.contact()) {
            pending_impact.contact = *contact;
        }
        let periods = f64::from(pending_impact.contact.stride);
        let known = pending_impact.contact.nodes_since_end(time_frames);
        let stage = due_revisions(known).max(pending_impact.stage);
        let late = known * periods * self.params.frame_period_ns * 1e-9 >= FINAL_AFTER_S;
        let last = stage == REVISIONS_FRAMES.len() || (stage > 0 && late);
        let is_retry =
            pending_impact.revision == 0 && time_frames - pending_impact.tried_frames >= RETRY_FRAMES * periods;
        let is_due = stage > pending_impact.stage || is_retry;
        pending_impact.stage = stage;
        if is_due || last {
            let revision = if last { Revision::Final } else { Revision::Preliminary };
            self.measure_impact(time_frames, revision, impacts);
        }
        if last {
            self.pending_impact = None;
            if let Some(detector) = &mut self.detector {
                detector.release();
            }
        }
    }

    /// Returns the scale, gravity, radius, mass and errors that a collision is solved with; `None` without a scale.
    fn impact_context(&self) -> Option<ImpactContext> {
        // The median of radii belongs to the middle of the observed time, whatever the radius was at contact.
        let half = 0.5 * self.size_change.total_dilatation();
        let metres_per_px = self.radius.metres_per_px(self.params.scale)?;
        let metres_per_px = match self.params.scale {
            Scale::BallDiameterMm(_) => metres_per_px.with_relative_error(half),
            Scale::MmPerPx(_) | Scale::Unknown => metres_per_px,
        };
        let [x, y] = gravity_px(&self.params, metres_per_px.value);
        let gravity = self.axes.surface(x, y);
        let radius_px = match self.params.scale {
            _ if self.params.form != Form::Ball => None,
            Scale::Unknown => None,
            Scale::BallDiameterMm(mm) => Some(Estimate { value: mm * 5e-4 / metres_per_px.value, sigma: 0.0 }),
            Scale::MmPerPx(_) => self.radius.radius_px().map(|radius| radius.with_relative_error(half)),
        };
        let period_s = self.params.frame_period_ns * 1e-9;
        let center = self.nodes.last().and_then(|node| self.center_filter.center(node));
        let light_fraction = self.light_fraction();
        Some(ImpactContext {
            metres_per_px,
            period_s,
            stride: 1,
            gravity_px: [gravity.normal, gravity.tangential],
            radius_px,
            mass_kg: self.params.mass_kg,
            center_sigma_px: center
                .map_or(0.0, |center| center.sigma_px)
                .hypot(self.rim_misfit_px())
                .hypot(self.pulled_px()),
            speed_bias: self.speed_bias(),
            light_fraction,
            is_surface_fixed: self.surface.is_none(),
        })
    }

    /// Returns the origin of poses relative to the principal point, along normal and tangent, px.
    fn relative_position_px(&self) -> Option<[f64; 2]> {
        let (origin_px, [x, y]) = (self.origin_px()?, self.params.view.principal_point_px);
        let relative = self.axes.surface(origin_px[0] - x, origin_px[1] - y);
        Some([relative.normal, relative.tangential])
    }

    /// Measures the last collision up to `time_frames`. Appends it if it is final, or no less certain than before.
    pub(super) fn measure_impact(&mut self, time_frames: f64, revision: Revision, impacts: &mut Vec<Impact>) {
        let (context, place) = (self.impact_context(), self.relative_position_px());
        let (Some(pending_impact), Some(detector), Some(context)) = (&mut self.pending_impact, &self.detector, context)
        else {
            return;
        };
        let known = impacts.len();
        let contact = &pending_impact.contact;
        let (stride, periods) = (contact.stride, f64::from(contact.stride));
        let context = context.with_stride(stride);
        let nodes = detector.nodes(stride);
        let newest = nodes.last().map_or(f64::NEG_INFINITY, |n| n.time_frames).min(time_frames / periods);
        if newest.total_cmp(&pending_impact.measured_to_frames).is_eq() {
            return;
        }
        let own = self.surface.as_ref().map(|surface| surface.relative(nodes));
        let from_frames = (contact.start_frames - FLIGHT_FRAMES) * periods;
        let turns = self.surface.as_ref().is_some_and(|surface| surface.has_turned(from_frames, newest * periods));
        let nodes = own.as_deref().unwrap_or(nodes);
        let (growth, drift, axes) = (&self.size_change, &self.outline_drift, self.axes);
        let middle_sigma_px = self.params.view.sigma_px;
        // A surface that moves has a place and a distance of its own.
        let place = place.filter(|_| own.is_none());
        let out_of_plane = place.map(|place_px| OutOfPlane { growth, drift, axes, place_px, middle_sigma_px, stride });
        let approach = out_of_plane.and_then(|motion| DilatationRates::estimate(&motion, contact, newest));
        let measured = match approach {
            Some(approach) => solve(&approach.at_constant_distance(nodes), contact, newest, &context)
                .map(|impact| approach.correct(impact, nodes, &context)),
            None => solve(nodes, contact, newest, &context),
        };
        let measured = measured.map(|impact| self.rolling.widen_times(impact, context.period_s / periods));
        pending_impact.measured_to_frames = newest;
        pending_impact.tried_frames = newest * periods;
        let sigma = measured.and_then(|i| i.restitution).map_or(f64::INFINITY, |e| e.sigma);
        if measured.is_none() && revision == Revision::Final && pending_impact.revision == 0 {
            impacts.push(unmeasured_impact(
                contact,
                context.period_s,
                Impact::unknown(self.body, pending_impact.number, self.origin_ns),
            ));
        }
        // A revision replaces an earlier one if it is more certain. The final one always does.
        if let Some(impact) = measured.filter(|_| sigma <= pending_impact.sigma || revision == Revision::Final) {
            pending_impact.sigma = sigma;
            let (number, revision) = (pending_impact.number, pending_impact.revision);
            pending_impact.revision += 1;
            let impact = if self.params.form == Form::Rod { without_spin(impact) } else { impact };
            impacts.push(Impact { body: self.body, number, revision, origin_ns: self.origin_ns, ..impact });
        }
        for impact in &mut impacts[known..] {
            // Velocities relative to a moving surface are not those of the frames.
            if turns || (self.surface.is_none() && self.contradicts_flights(impact)) {
                impact.status = PointStatus::Outlier;
            }
        }
    }

    /// Returns the impact of a contact that lasts beyond the end of the stream.
    pub(super) fn unfinished_impact(&self, contact: &Contact) -> Impact {
        let period_s = self.params.frame_period_ns * 1e-9 * f64::from(contact.stride);
        unmeasured_impact(contact, period_s, Impact::unknown(self.body, self.collisions, self.origin_ns))
    }
}

/// Returns an impact of which only the detected start and end are known.
///
/// `period_s` is that of the frames in which the contact was detected.
fn unmeasured_impact(contact: &Contact, period_s: f64, unknown: Impact) -> Impact {
    let at = |frames: f64| Estimate { value: frames * period_s, sigma: DETECTED_SIGMA_FRAMES * period_s };
    Impact { start_s: Some(at(contact.start_frames)), end_s: contact.end_frames.map(at), ..unknown }
}

/// Removes the spin, which an upright rod does not have, however it tilts.
fn without_spin(impact: Impact) -> Impact {
    Impact { omega_before_rad_s: None, omega_after_rad_s: None, ..impact }
}
