//! A row of the table of films: one method on one pair of frames.

use serde::{Deserialize, Serialize};

use super::films_plan::{Film, SpeckleStudy};
use super::methods::{Answer, Method};
use crate::study::output_files::rounded;
use crate::synth::PatternSetup;

/// The result of one method; a missing number is an empty cell, and `status` gives the reason.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    pub(super) pattern: String,
    pub(super) speeds: String,
    pub(super) case: String,
    /// Number among the films of a pattern and set of speeds.
    pub(super) film: usize,
    /// First frame of the pair.
    pub(super) frame: u64,
    pub(super) method: String,
    /// The varied setting; only one of these columns exists in a study.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) noise_dn: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) blur_px: Option<f64>,
    /// Frame rate relative to the slowest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) rate: Option<f64>,
    /// True velocity.
    pub(super) vx_px_frame: f64,
    pub(super) vy_px_frame: f64,
    pub(super) omega_deg_frame: f64,
    /// Measured motion of the ball's centre, and rotation.
    pub(super) dx_px: Option<f64>,
    pub(super) dy_px: Option<f64>,
    pub(super) dtheta_deg: Option<f64>,
    pub(super) sigma_dx_px: Option<f64>,
    pub(super) sigma_dy_px: Option<f64>,
    pub(super) sigma_dtheta_deg: Option<f64>,
    /// Number of subsets or pixels used.
    pub(super) points: u32,
    pub(super) status: String,
}

impl Row {
    /// Returns the row of a method's answer on a pair of frames that starts with `frame`.
    pub(super) fn new(study: SpeckleStudy, film: &Film, frame: u64, method: Method, answer: &Answer) -> Self {
        let part = |values: Option<[f64; 3]>, axis: usize| values.map(|values| rounded(values[axis]));
        let [vx_px_frame, vy_px_frame] = film.velocity.px_frame;
        let level = |of: SpeckleStudy| study.levels().get(film.level).copied().filter(|_| study == of);
        Self {
            pattern: PatternSetup::PAPER[film.pattern].to_owned(),
            speeds: film.speeds.as_str().to_owned(),
            case: film.case.as_str().to_owned(),
            film: film.number,
            frame,
            method: method.as_str().to_owned(),
            noise_dn: level(SpeckleStudy::Noise),
            blur_px: level(SpeckleStudy::Blur),
            rate: level(SpeckleStudy::Rate),
            vx_px_frame,
            vy_px_frame,
            omega_deg_frame: film.velocity.deg_frame,
            dx_px: part(answer.step, 0),
            dy_px: part(answer.step, 1),
            dtheta_deg: part(answer.step, 2),
            sigma_dx_px: part(answer.sigma, 0),
            sigma_dy_px: part(answer.sigma, 1),
            sigma_dtheta_deg: part(answer.sigma, 2),
            points: answer.points,
            status: answer.status.as_str().to_owned(),
        }
    }

    /// Returns the level of the varied setting, if any.
    pub(super) fn level(&self) -> Option<f64> {
        self.noise_dn.or(self.blur_px).or(self.rate)
    }

    /// Returns measured minus true along x and y (px per frame) and in rotation (deg per frame); `None` where it is
    /// missing.
    pub(super) fn error(&self) -> [Option<f64>; 3] {
        let less = |measured: Option<f64>, truth: f64| measured.map(|measured| measured - truth);
        [
            less(self.dx_px, self.vx_px_frame),
            less(self.dy_px, self.vy_px_frame),
            less(self.dtheta_deg, self.omega_deg_frame),
        ]
    }

    /// Returns the columns that identify the row.
    fn key(&self) -> (&str, &str, &str, usize, u64, &str) {
        (&self.pattern, &self.speeds, &self.case, self.film, self.frame, &self.method)
    }

    /// Whether this is the row of a method on a pair of frames.
    pub(super) fn belongs_to(&self, film: &Film, frame: u64, method: Method) -> bool {
        let pattern = PatternSetup::PAPER[film.pattern];
        self.key() == (pattern, film.speeds.as_str(), film.case.as_str(), film.number, frame, method.as_str())
    }
}
