//! Errors and refusals of many frames with a known circle.

use super::scene::Scene;
use ricochet::results::Circle;

/// Errors of many frames.
#[derive(Debug, Default)]
pub struct Tally {
    pub frames: usize,
    pub center: Vec<f64>,
    pub radius: Vec<f64>,
    pub visible: Vec<f64>,
    pub ratios: Vec<f64>,
    pub radius_ratios: Vec<f64>,
}

impl Tally {
    pub fn add(&mut self, scene: &Scene, circle: Option<Circle>) {
        self.frames += 1;
        let Some(c) = circle else { return };
        for e in [c.x_px - scene.x, c.y_px - scene.y] {
            self.center.push(e.abs());
            self.ratios.push(e.abs() / c.sigma_center_px);
        }
        self.radius.push(c.radius_px - scene.radius);
        self.radius_ratios.push((c.radius_px - scene.radius).abs() / c.sigma_radius_px);
        self.visible.push((c.visible_fraction - scene.visible()).abs());
    }

    pub fn refused(&self) -> usize {
        self.frames - self.radius.len()
    }

    pub fn mean(&self) -> f64 {
        mean(&self.center)
    }

    pub fn worst(&self) -> f64 {
        self.center.iter().copied().fold(0.0, f64::max)
    }

    pub fn covered(&self, sigmas: f64) -> f64 {
        share_within(&self.ratios, sigmas)
    }

    pub fn radius_covered(&self, sigmas: f64) -> f64 {
        share_within(&self.radius_ratios, sigmas)
    }

    pub fn line(&self) -> String {
        let mut sorted = self.center.clone();
        sorted.sort_by(f64::total_cmp);
        let q95 = sorted.get(sorted.len() * 95 / 100).copied().unwrap_or(0.0);
        format!(
            "mean {:.4} q95 {q95:.3} worst {:.3} px, radius {:+.3}, refused {} of {}, sigma {:.2} / {:.2}, \
             of the radius {:.2} / {:.2}, visible {:.3}",
            self.mean(),
            self.worst(),
            mean(&self.radius),
            self.refused(),
            self.frames,
            self.covered(1.0),
            self.covered(2.0),
            self.radius_covered(1.0),
            self.radius_covered(2.0),
            mean(&self.visible)
        )
    }
}

fn share_within(ratios: &[f64], sigmas: f64) -> f64 {
    ratios.iter().filter(|ratio| **ratio < sigmas).count() as f64 / ratios.len().max(1) as f64
}

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
