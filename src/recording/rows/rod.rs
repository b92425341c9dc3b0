//! The rod within a track row.

use super::{Row, unknown_name};
use crate::recording::schema::proto;
use crate::results::{Estimate, ROD_EDGES, Rod, RodEdge};

impl Row for Rod {
    type Message = proto::Rod;

    fn to_message(&self) -> proto::Rod {
        let edge = |edge: &RodEdge| proto::RodEdge {
            y_px: edge.y_px.map(|y| y.value),
            sigma_y_px: edge.y_px.map(|y| y.sigma),
            status: edge.status.as_str().into(),
        };
        proto::Rod {
            edges: self.edges.iter().flatten().map(edge).collect(),
            x_px: Some(self.x_px.value),
            sigma_x_px: Some(self.x_px.sigma),
            y_px: Some(self.y_px.value),
            sigma_y_px: Some(self.y_px.sigma),
            half_width_px: Some(self.half_width_px.value),
            sigma_half_width_px: Some(self.half_width_px.sigma),
            tilt_deg: Some(self.tilt_deg.value),
            sigma_tilt_deg: Some(self.tilt_deg.sigma),
        }
    }

    fn from_message(message: proto::Rod) -> Result<Self, String> {
        if message.edges.len() > ROD_EDGES {
            return Err(format!("a rod with {} edges; at most {ROD_EDGES} are known", message.edges.len()));
        }
        let estimate = |value: Option<f64>, sigma: Option<f64>| match (value, sigma) {
            (Some(value), Some(sigma)) => Ok(Estimate { value, sigma }),
            _ => Err("a rod without its position, width or tilt".to_owned()),
        };
        let mut edges = [None; ROD_EDGES];
        for (to, from) in edges.iter_mut().zip(&message.edges) {
            let y_px = from.y_px.zip(from.sigma_y_px).map(|(value, sigma)| Estimate { value, sigma });
            *to = Some(RodEdge { y_px, status: from.status.parse().map_err(unknown_name)? });
        }
        Ok(Self {
            x_px: estimate(message.x_px, message.sigma_x_px)?,
            y_px: estimate(message.y_px, message.sigma_y_px)?,
            half_width_px: estimate(message.half_width_px, message.sigma_half_width_px)?,
            tilt_deg: estimate(message.tilt_deg, message.sigma_tilt_deg)?,
            edges,
        })
    }
}
