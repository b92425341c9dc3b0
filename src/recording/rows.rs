//! Rows of results to messages and back; every number survives to the last bit.

mod rod;

use super::schema::proto;
use crate::results::{
    BodyVelocity, Displacement, Estimate, FieldPoint, ForceLaw, Impact, PairField, Phase, PointStatus, RigidStep,
    TrackSample, VelocitySample,
};
use std::collections::BTreeMap;

/// Something happened: a trigger, a change of state, a loss.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EventRow {
    /// When, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// One word: `trigger`, `armed`, `lost-frames`, ...
    pub kind: String,
    /// The rest, for people.
    pub text: String,
}

/// How a process of the rig is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct StatusRow {
    /// When, ns since the Unix epoch.
    pub stamp_ns: u64,
    /// Which process: `acquire`, `correlate`, ...
    pub process: String,
    /// Its state in one word.
    pub state: String,
    /// Its numbers, the unit in each name; `None` where there is none yet.
    pub readings: BTreeMap<String, Option<f64>>,
}

/// A row that a recording can hold.
pub(super) trait Row: Sized {
    /// Its message.
    type Message: prost::Message + Default;

    /// The row as a message.
    fn to_message(&self) -> Self::Message;

    /// The row in a message, or what is wrong with it.
    fn from_message(message: Self::Message) -> Result<Self, String>;
}

fn status(word: &str) -> Result<PointStatus, String> {
    PointStatus::from_word(word).ok_or_else(|| format!("unknown status {word:?}"))
}

impl Row for TrackSample {
    type Message = proto::Track;

    fn to_message(&self) -> proto::Track {
        proto::Track {
            frame: self.frame,
            body: self.body,
            stamp_ns: self.stamp_ns,
            center_x_px: self.center_x_px,
            center_y_px: self.center_y_px,
            angle_deg: self.angle_deg,
            radius_px: self.radius_px,
            sigma_center_px: self.sigma_center_px,
            sigma_angle_deg: self.sigma_angle_deg,
            visible_fraction: self.visible_fraction,
            status: self.status.word().into(),
            rod: self.rod.as_ref().map(rod::to_message),
        }
    }

    fn from_message(message: proto::Track) -> Result<Self, String> {
        Ok(Self {
            frame: message.frame,
            body: message.body,
            stamp_ns: message.stamp_ns,
            center_x_px: message.center_x_px,
            center_y_px: message.center_y_px,
            angle_deg: message.angle_deg,
            radius_px: message.radius_px,
            sigma_center_px: message.sigma_center_px,
            sigma_angle_deg: message.sigma_angle_deg,
            visible_fraction: message.visible_fraction,
            rod: message.rod.map(|message| rod::from_message(&message)).transpose()?,
            status: status(&message.status)?,
        })
    }
}

impl Row for VelocitySample {
    type Message = proto::Velocity;

    fn to_message(&self) -> proto::Velocity {
        let (step, velocity) = (self.step, self.velocity);
        proto::Velocity {
            frame: self.frame,
            body: self.body,
            stamp_ns: self.stamp_ns,
            center_x_px: self.center_x_px,
            center_y_px: self.center_y_px,
            radius_px: self.radius_px,
            dx_px: step.map(|s| s.dx_px),
            dy_px: step.map(|s| s.dy_px),
            dtheta_deg: step.map(|s| s.dtheta_deg),
            sigma_dx_px: step.map(|s| s.sigma_dx_px),
            sigma_dy_px: step.map(|s| s.sigma_dy_px),
            sigma_dtheta_deg: step.map(|s| s.sigma_dtheta_deg),
            points: step.map(|s| s.points),
            vx_m_s: velocity.map(|v| v.vx_m_s),
            vy_m_s: velocity.map(|v| v.vy_m_s),
            vn_m_s: velocity.map(|v| v.vn_m_s),
            vt_m_s: velocity.map(|v| v.vt_m_s),
            omega_rad_s: velocity.map(|v| v.omega_rad_s),
            sigma_v_m_s: velocity.map(|v| v.sigma_v_m_s),
            sigma_omega_rad_s: velocity.map(|v| v.sigma_omega_rad_s),
            window_frames: velocity.map(|v| v.window_frames),
            order: velocity.map(|v| v.order),
            visible_fraction: self.visible_fraction,
            phase: self.phase.word().into(),
            status: self.status.word().into(),
        }
    }

    fn from_message(message: proto::Velocity) -> Result<Self, String> {
        let phase = Phase::from_word(&message.phase).ok_or_else(|| format!("unknown phase {:?}", message.phase))?;
        Ok(Self {
            frame: message.frame,
            body: message.body,
            stamp_ns: message.stamp_ns,
            center_x_px: message.center_x_px,
            center_y_px: message.center_y_px,
            radius_px: message.radius_px,
            step: step(&message),
            velocity: velocity(&message),
            visible_fraction: message.visible_fraction,
            phase,
            status: status(&message.status)?,
        })
    }
}

fn step(message: &proto::Velocity) -> Option<RigidStep> {
    Some(RigidStep {
        dx_px: message.dx_px?,
        dy_px: message.dy_px?,
        dtheta_deg: message.dtheta_deg?,
        sigma_dx_px: message.sigma_dx_px?,
        sigma_dy_px: message.sigma_dy_px?,
        sigma_dtheta_deg: message.sigma_dtheta_deg?,
        points: message.points?,
    })
}

fn velocity(message: &proto::Velocity) -> Option<BodyVelocity> {
    Some(BodyVelocity {
        vx_m_s: message.vx_m_s?,
        vy_m_s: message.vy_m_s?,
        vn_m_s: message.vn_m_s?,
        vt_m_s: message.vt_m_s?,
        omega_rad_s: message.omega_rad_s?,
        sigma_v_m_s: message.sigma_v_m_s?,
        sigma_omega_rad_s: message.sigma_omega_rad_s?,
        window_frames: message.window_frames?,
        order: message.order?,
    })
}

/// Copies every estimate of an [`Impact`] between the row and its message's `X`, `sigma_X` pairs.
macro_rules! impact_numbers {
    ($($number:ident $sigma:ident),+ $(,)?) => {
        impl Row for Impact {
            type Message = proto::Impact;

            fn to_message(&self) -> proto::Impact {
                proto::Impact {
                    body: self.body,
                    number: self.number,
                    revision: self.revision,
                    origin_ns: self.origin_ns,
                    $($number: self.$number.map(|e| e.value), $sigma: self.$number.map(|e| e.sigma),)+
                    force_law: self.force_law.word().into(),
                    force_law_probability: self.force_law_probability,
                    status: self.status.word().into(),
                }
            }

            fn from_message(message: proto::Impact) -> Result<Self, String> {
                let force_law = ForceLaw::from_word(&message.force_law)
                    .ok_or_else(|| format!("unknown force_law {:?}", message.force_law))?;
                Ok(Self {
                    body: message.body,
                    number: message.number,
                    revision: message.revision,
                    origin_ns: message.origin_ns,
                    $($number: estimate(message.$number, message.$sigma),)+
                    force_law,
                    force_law_probability: message.force_law_probability,
                    status: status(&message.status)?,
                })
            }
        }
    };
}

impact_numbers!(
    start_s sigma_start_s,
    deepest_s sigma_deepest_s,
    end_s sigma_end_s,
    vn_before_m_s sigma_vn_before_m_s,
    vn_after_m_s sigma_vn_after_m_s,
    vt_before_m_s sigma_vt_before_m_s,
    vt_after_m_s sigma_vt_after_m_s,
    omega_before_rad_s sigma_omega_before_rad_s,
    omega_after_rad_s sigma_omega_after_rad_s,
    restitution sigma_restitution,
    restitution_tangential sigma_restitution_tangential,
    impulse_ratio sigma_impulse_ratio,
    contact_time_s sigma_contact_time_s,
    compression_max_mm sigma_compression_max_mm,
    acceleration_max_m_s2 sigma_acceleration_max_m_s2,
    slip_end_s sigma_slip_end_s,
    force_start_s sigma_force_start_s,
    force_end_s sigma_force_end_s,
    force_max_n sigma_force_max_n,
    energy_lost_j sigma_energy_lost_j,
    gravity_m_s2 sigma_gravity_m_s2,
    growth_before_per_s sigma_growth_before_per_s,
    growth_after_per_s sigma_growth_after_per_s,
);

fn estimate(value: Option<f64>, sigma: Option<f64>) -> Option<Estimate> {
    Some(Estimate { value: value?, sigma: sigma? })
}

impl Row for PairField {
    type Message = proto::Field;

    fn to_message(&self) -> proto::Field {
        let column = |number: fn(&FieldPoint) -> Option<f32>| -> Vec<f32> {
            self.points.iter().map(|point| number(point).unwrap_or(f32::NAN)).collect()
        };
        proto::Field {
            frame: self.frame,
            target_frame: self.target_frame,
            stamp_ns: self.stamp_ns,
            body: self.body,
            x_px: column(|p| Some(p.x_px)),
            y_px: column(|p| Some(p.y_px)),
            u_px: column(|p| p.displacement.map(|d| d.u_px)),
            v_px: column(|p| p.displacement.map(|d| d.v_px)),
            sigma_u_px: column(|p| p.displacement.map(|d| d.sigma_u_px)),
            sigma_v_px: column(|p| p.displacement.map(|d| d.sigma_v_px)),
            zncc: column(|p| p.zncc),
            peak_ratio: column(|p| p.peak_ratio),
            status: self.points.iter().map(|p| proto_status(p.status).into()).collect(),
        }
    }

    fn from_message(message: proto::Field) -> Result<Self, String> {
        let count = message.x_px.len();
        let columns = [
            ("y_px", message.y_px.len()),
            ("u_px", message.u_px.len()),
            ("v_px", message.v_px.len()),
            ("sigma_u_px", message.sigma_u_px.len()),
            ("sigma_v_px", message.sigma_v_px.len()),
            ("zncc", message.zncc.len()),
            ("peak_ratio", message.peak_ratio.len()),
            ("status", message.status.len()),
        ];
        if let Some((name, length)) = columns.into_iter().find(|(_, length)| *length != count) {
            return Err(format!("field of frame {}: {count} x_px but {length} {name}", message.frame));
        }
        let points = (0..count).map(|i| point(&message, i)).collect::<Result<_, _>>()?;
        Ok(Self {
            frame: message.frame,
            target_frame: message.target_frame,
            stamp_ns: message.stamp_ns,
            body: message.body,
            points,
        })
    }
}

fn point(message: &proto::Field, i: usize) -> Result<FieldPoint, String> {
    let present = |value: f32| (!value.is_nan()).then_some(value);
    let displacement = || {
        Some(Displacement {
            u_px: present(message.u_px[i])?,
            v_px: present(message.v_px[i])?,
            sigma_u_px: present(message.sigma_u_px[i])?,
            sigma_v_px: present(message.sigma_v_px[i])?,
        })
    };
    let number = message.status[i];
    Ok(FieldPoint {
        x_px: message.x_px[i],
        y_px: message.y_px[i],
        displacement: displacement(),
        zncc: present(message.zncc[i]),
        peak_ratio: present(message.peak_ratio[i]),
        status: u32::try_from(number)
            .ok()
            .and_then(PointStatus::from_number)
            .ok_or_else(|| format!("unknown status number {number}"))?,
    })
}

fn proto_status(status: PointStatus) -> proto::PointStatus {
    match status {
        PointStatus::Valid => proto::PointStatus::Valid,
        PointStatus::LowContrast => proto::PointStatus::LowContrast,
        PointStatus::LowCorrelation => proto::PointStatus::LowCorrelation,
        PointStatus::Ambiguous => proto::PointStatus::Ambiguous,
        PointStatus::Outlier => proto::PointStatus::Outlier,
        PointStatus::Occluded => proto::PointStatus::Occluded,
        PointStatus::OutOfFrame => proto::PointStatus::OutOfFrame,
        PointStatus::Lost => proto::PointStatus::Lost,
    }
}

impl Row for EventRow {
    type Message = proto::Event;

    fn to_message(&self) -> proto::Event {
        proto::Event { stamp_ns: self.stamp_ns, kind: self.kind.clone(), text: self.text.clone() }
    }

    fn from_message(message: proto::Event) -> Result<Self, String> {
        Ok(Self { stamp_ns: message.stamp_ns, kind: message.kind, text: message.text })
    }
}

impl Row for StatusRow {
    type Message = proto::Status;

    fn to_message(&self) -> proto::Status {
        let readings =
            self.readings.iter().map(|(name, value)| proto::Reading { name: name.clone(), value: *value }).collect();
        proto::Status { stamp_ns: self.stamp_ns, process: self.process.clone(), state: self.state.clone(), readings }
    }

    fn from_message(message: proto::Status) -> Result<Self, String> {
        let readings = message.readings.into_iter().map(|reading| (reading.name, reading.value)).collect();
        Ok(Self { stamp_ns: message.stamp_ns, process: message.process, state: message.state, readings })
    }
}
