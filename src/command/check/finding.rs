//! The findings of a rig check: values, verdicts and advice.

use super::displacement::NoiseFloor;
use super::fixed_pattern::FixedPattern;
use super::grab::Grabbed;
use super::light::Flicker;
use super::texture::{Levels, Speckles};
use crate::config::Config;

/// Maximum number of pixels listed in a line.
const SHOWN_PIXELS: usize = 8;

/// The verdict on a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// No problem.
    Good,
    /// Not measurable.
    Unknown,
    /// The measurement works but could be better.
    Fair,
    /// The rig is not ready.
    Bad,
}

impl Verdict {
    /// Returns the name used in output.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Unknown => "unknown",
            Self::Fair => "fair",
            Self::Bad => "bad",
        }
    }
}

/// The result of one check.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// The name, which is also a key for programs.
    pub name: &'static str,
    /// The measured value, if there is one.
    pub value: Option<f64>,
    /// The unit; empty for fractions and counts.
    pub unit: &'static str,
    /// The verdict.
    pub verdict: Verdict,
    /// Advice, or an explanation of the value.
    pub advice: String,
}

impl Finding {
    /// Whether the rig is not ready because of it. Lost frames count as lost data instead, which the exit code states.
    pub(super) fn is_blocking(&self) -> bool {
        self.verdict == Verdict::Bad && self.name != "lost-frames"
    }
}

/// The measurements that the findings are derived from.
pub(super) struct Measurements<'a> {
    pub(super) config: &'a Config,
    pub(super) grabbed: &'a Grabbed,
    pub(super) floor: &'a NoiseFloor,
    pub(super) levels: Levels,
    pub(super) speckles: Speckles,
    pub(super) blur_px: Option<f64>,
    pub(super) flicker: Option<Flicker>,
    pub(super) defective_px: &'a [[u32; 2]],
    pub(super) fixed_pattern: Option<FixedPattern>,
    pub(super) expected_px: Option<f64>,
    pub(super) full_dn: f64,
}

/// Returns `Good` below `fair`, `Fair` below `bad`, else `Bad`.
fn verdict_by_limits(value: f64, fair: f64, bad: f64) -> Verdict {
    match value {
        _ if value >= bad => Verdict::Bad,
        _ if value >= fair => Verdict::Fair,
        _ => Verdict::Good,
    }
}

/// Returns a finding with its advice. Without a value its verdict is `Unknown`.
fn finding(name: &'static str, value: Option<f64>, unit: &'static str, verdict: Verdict, advice: &str) -> Finding {
    Finding {
        name,
        value,
        unit,
        verdict: if value.is_some() { verdict } else { Verdict::Unknown },
        advice: advice.into(),
    }
}

impl Measurements<'_> {
    /// Returns all findings, in the order in which a rig is set up.
    pub(super) fn findings(&self) -> Vec<Finding> {
        let groups =
            [self.stream_findings(), self.light_findings(), self.pattern_findings(), self.displacement_findings()];
        groups.into_iter().flatten().collect()
    }

    /// Returns the findings about lost frames, the frame rate, and whether the workers keep up with it.
    fn stream_findings(&self) -> Vec<Finding> {
        let (grabbed, wanted_hz) = (self.grabbed, self.grabbed.format.frame_rate_hz);
        let lost = match grabbed.lost {
            0 if grabbed.is_live => finding("lost-frames", Some(0.0), "", Verdict::Good, "no frame lost"),
            0 => {
                finding("lost-frames", Some(0.0), "", Verdict::Good, "no frame lost; this source waits for its reader")
            }
            lost => {
                let came = grabbed.means.len();
                let words = format!(
                    "{lost} lost, {came} received: lower the frame rate or the image size, stop other programs, and \
                     check socket buffer and packet size of a network camera"
                );
                finding("lost-frames", Some(lost as f64), "", Verdict::Bad, &words)
            }
        };
        let rate_hz = grabbed.rate_hz();
        let deviation = rate_hz.map_or(0.0, |rate_hz| (rate_hz / wanted_hz - 1.0).abs());
        let rate = match deviation > 0.02 {
            true => format!("{wanted_hz} Hz requested: a shorter exposure or a smaller image may allow it"),
            false => format!("as requested, {wanted_hz} Hz"),
        };
        let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let workers = processors.min(self.config.workers.count.max(1) as usize);
        let capacity_hz = self.floor.capacity_hz(workers, processors);
        let slow = capacity_hz < wanted_hz;
        let words = match slow {
            true => format!(
                "slower than the camera ({wanted_hz} Hz) with {workers} of {processors} processors measuring. Waiting frames \
                 are lost once the ring is full; keep shots short, increase step_px, or analyze offline"
            ),
            false => format!("{workers} of {processors} processors keep up with the camera"),
        };
        vec![
            lost,
            finding("frame-rate", rate_hz, "Hz", if deviation > 0.02 { Verdict::Fair } else { Verdict::Good }, &rate),
            finding(
                "measuring-rate",
                Some(capacity_hz),
                "Hz",
                if slow { Verdict::Fair } else { Verdict::Good },
                &words,
            ),
        ]
    }

    /// Returns the findings about clipping, contrast, noise, defective pixels and flicker.
    fn light_findings(&self) -> Vec<Finding> {
        let levels = &self.levels;
        let saturated = verdict_by_limits(levels.saturated, 5e-4, 1e-2);
        let words = match saturated {
            Verdict::Good => "no highlights are clipped",
            _ => "highlights are clipped: reduce light, exposure, gain or aperture",
        };
        let black = verdict_by_limits(levels.black, 0.05, 0.5);
        let dark = match black {
            Verdict::Good => "no shadows are clipped",
            _ => "shadows are clipped: add light, or raise the black level",
        };
        let contrast = (levels.high_dn - levels.low_dn) / self.full_dn;
        let flat = verdict_by_limits(1.0 - contrast, 0.75, 0.92);
        let contrasty = match flat {
            Verdict::Good => "the pattern uses the range of the camera",
            _ => "low contrast: add light, use darker paint, or a longer exposure if motion blur allows",
        };
        let noise = levels.noise_dn.map(|noise_dn| noise_dn / (levels.high_dn - levels.low_dn).max(1e-9));
        let noisy = verdict_by_limits(noise.unwrap_or(0.0), 0.05, 0.25);
        let words_of_noise = match (noise, noisy) {
            (None, _) => "not measured: the scene moves, or the image is clipped",
            (_, Verdict::Good) => "small compared with the contrast",
            _ => "large compared with the contrast: add light and reduce the gain",
        };
        let (share, unsteady) = self.flicker.map_or((None, Verdict::Good), |flicker| {
            (Some(flicker.share), verdict_by_limits(flicker.share, 0.02, 0.25))
        });
        vec![
            finding("saturated", Some(levels.saturated), "", saturated, words),
            finding("black", Some(levels.black), "", black, dark),
            finding("contrast", Some(contrast), "", flat, contrasty),
            finding("noise", levels.noise_dn, "DN", noisy, words_of_noise),
            self.fixed_pattern_finding(),
            self.defects_finding(),
            finding("flicker", share, "", unsteady, &self.flicker_advice(unsteady)),
        ]
    }

    /// Returns the finding about pixels that respond differently, by the underestimate of displacements that they
    /// cause.
    fn fixed_pattern_finding(&self) -> Finding {
        let short = self.fixed_pattern.map_or(0.0, |pattern| pattern.underestimate_fraction());
        let verdict = verdict_by_limits(short, 1e-3, 1e-2);
        let words = match (self.fixed_pattern, verdict) {
            (None, _) => "not measured: the scene moves, or too little of it is visible".into(),
            (_, Verdict::Good) => "pixels respond uniformly".into(),
            _ => format!(
                "pixels respond differently: subpixel displacements of subsets are underestimated by up to {:.1} %. Run \
                 the camera's black reference and shading correction, add light, increase interval_frames, \
                 and measure balls with rotation.method = \"rigid\"",
                100.0 * short
            ),
        };
        finding("fixed-pattern", self.fixed_pattern.map(|pattern| pattern.dn), "DN", verdict, &words)
    }

    /// Returns the finding about hot and dead pixels.
    fn defects_finding(&self) -> Finding {
        let pixels = self.defective_px;
        let shown: Vec<String> = pixels.iter().take(SHOWN_PIXELS).map(|[x, y]| format!("[{x}, {y}]")).collect();
        let more = if pixels.len() > shown.len() { "; --json lists all of them" } else { "" };
        let (verdict, words) = match pixels {
            [] => (Verdict::Good, "no hot or dead pixels".into()),
            _ => (
                Verdict::Fair,
                format!(
                    "hot or dead pixels bias the displacement towards zero: camera.defective_px = [{}] interpolates them from \
                     their neighbours{more}",
                    shown.join(", ")
                ),
            ),
        };
        finding("defective-pixels", Some(pixels.len() as f64), "", verdict, &words)
    }

    /// Describes the flicker and names its cure.
    fn flicker_advice(&self, verdict: Verdict) -> String {
        let Some(flicker) = self.flicker else { return "the image is black".into() };
        let often = flicker.frequency_hz.map_or_else(String::new, |hz| format!(" at {hz:.0} Hz"));
        let seen = flicker.seen_s;
        match verdict {
            Verdict::Good => format!("the light is steady over {seen:.3} s"),
            _ => format!(
                "the light flickers{often}, observed for {seen:.3} s: use a DC lamp or a high-frequency ballast"
            ),
        }
    }

    /// Returns the findings about focus, and about size and density of the speckles.
    fn pattern_findings(&self) -> Vec<Finding> {
        let blurred = verdict_by_limits(self.blur_px.unwrap_or(0.0), 1.5, 2.5);
        let focus = match (self.blur_px, blurred) {
            (None, _) => "not measured: there are no edges",
            (_, Verdict::Good) => "edges are sharp",
            _ => "edges are blurred: focus, clean the lens, close the aperture; shorten the exposure of a moving body",
        };
        let subset_px = f64::from(self.config.correlation.subset_size_px);
        let size = self.speckles.size_px;
        let (fine, coarse) = (size.is_some_and(|px| px < 2.5), size.is_some_and(|px| px > subset_px / 3.0));
        let words = match size {
            None => "no pattern found: apply speckles to the body, or set its roi_px".to_owned(),
            Some(_) if fine => "undersampled: use coarser speckles, or more pixels per millimetre".into(),
            Some(_) if coarse => {
                format!("too coarse for subsets of {subset_px} px: use finer speckles or larger subsets")
            }
            Some(_) => "3 to 5 px is best".into(),
        };
        let coverage = self.speckles.coverage;
        let thin = !(0.15..=0.85).contains(&coverage);
        let density = match thin {
            true => "too few speckles: 20 to 50 % of the area is best",
            false => "the pattern is dense enough",
        };
        let fair = |is: bool| if is { Verdict::Fair } else { Verdict::Good };
        let pattern = if size.is_none() { Verdict::Bad } else { fair(fine || coarse) };
        vec![
            finding("blur", self.blur_px, "px", blurred, focus),
            Finding { verdict: pattern, ..finding("speckle-size", size, "px", pattern, &words) },
            finding("speckle-coverage", Some(coverage), "", fair(thin), density),
        ]
    }

    /// Returns the findings about visible bodies, matched subsets and the noise floor of displacements.
    fn displacement_findings(&self) -> Vec<Finding> {
        let floor = self.floor;
        let found = verdict_by_limits(1.0 - floor.found_fraction, 0.05, 0.5);
        let visible = match found {
            Verdict::Good => "a body is visible in every frame",
            _ => "bodies are not found: make them visible, and check roi_px, diameter_mm and the radii in the rig file",
        };
        let valid = verdict_by_limits(1.0 - floor.valid_fraction, 0.1, 0.5);
        let matched = match valid {
            Verdict::Good => "nearly every subset is matched",
            _ => "subsets are not matched: see pattern, light and focus above",
        };
        let noisy = verdict_by_limits(floor.subset_px.unwrap_or(0.0), 0.05, 0.25);
        let compared =
            self.expected_px.map_or_else(String::new, |px| format!("; {px:.4} px expected from noise and pattern"));
        let words = match (floor.subset_px, floor.motion) {
            (None, Some((px, deg))) => {
                format!("not measured: the body moves by {px:.3} px and {deg:.3} deg per frame; hold it still")
            }
            (None, None) => "not measured: too few subsets are matched".into(),
            (Some(px), _) if self.expected_px.is_some_and(|expected| px > 2.0 * expected.max(1e-3)) => {
                format!("per subset, frame to frame{compared}: check for vibration, moving air and unsteady light")
            }
            _ => format!("per subset, frame to frame{compared}"),
        };
        let body = "whole body, frame to frame";
        vec![
            finding("body-found", Some(floor.found_fraction), "", found, visible),
            finding("subsets-matched", Some(floor.valid_fraction), "", valid, matched),
            finding("noise-floor", floor.subset_px, "px", noisy, &words),
            finding(
                "noise-floor-body",
                floor.body_px,
                "px",
                verdict_by_limits(floor.body_px.unwrap_or(0.0), 0.02, 0.1),
                body,
            ),
            finding(
                "noise-floor-rotation",
                floor.body_deg,
                "deg",
                verdict_by_limits(floor.body_deg.unwrap_or(0.0), 0.02, 0.1),
                body,
            ),
        ]
    }
}
