//! What was found, what it means, and what to do about it.

use super::displacement::Floor;
use super::fixed::Fixed;
use super::grab::Grabbed;
use super::light::Flicker;
use super::texture::{Levels, Speckles};
use crate::config::Config;

/// Pixels named in a line.
const SHOWN_PIXELS: usize = 8;

/// How a finding bears on the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// As it should be.
    Good,
    /// It could not be found out.
    Unknown,
    /// The measurement works, and could be better.
    Fair,
    /// The rig is not ready.
    Bad,
}

impl Verdict {
    /// The word for people and programs.
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Unknown => "unknown",
            Self::Fair => "fair",
            Self::Bad => "bad",
        }
    }
}

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What, in a word or two; a key for programs.
    pub name: &'static str,
    /// The number found; `None` where there is none.
    pub value: Option<f64>,
    /// Its unit; empty for shares and counts.
    pub unit: &'static str,
    /// What it means.
    pub verdict: Verdict,
    /// Advice where it is needed, else what it says.
    pub words: String,
}

/// Everything the findings are drawn from.
pub(super) struct Seen<'a> {
    pub(super) config: &'a Config,
    pub(super) grabbed: &'a Grabbed,
    pub(super) floor: &'a Floor,
    pub(super) levels: Levels,
    pub(super) speckles: Speckles,
    pub(super) blur_px: Option<f64>,
    pub(super) flicker: Option<Flicker>,
    pub(super) defective_px: &'a [[u32; 2]],
    pub(super) fixed: Option<Fixed>,
    pub(super) expected_px: Option<f64>,
    pub(super) full_dn: f64,
}

/// Good below `fair`, fair below `bad`, bad from there on.
fn rising(value: f64, fair: f64, bad: f64) -> Verdict {
    match value {
        _ if value >= bad => Verdict::Bad,
        _ if value >= fair => Verdict::Fair,
        _ => Verdict::Good,
    }
}

fn finding(name: &'static str, value: Option<f64>, unit: &'static str, verdict: Verdict, words: &str) -> Finding {
    Finding {
        name,
        value,
        unit,
        verdict: if value.is_some() { verdict } else { Verdict::Unknown },
        words: words.into(),
    }
}

impl Seen<'_> {
    /// All of them, in the order one sets a rig up.
    pub(super) fn findings(&self) -> Vec<Finding> {
        let groups = [self.stream(), self.light(), self.pattern(), self.displacement()];
        groups.into_iter().flatten().collect()
    }

    fn stream(&self) -> Vec<Finding> {
        let (grabbed, wanted_hz) = (self.grabbed, self.grabbed.format.frame_rate_hz);
        let lost = match grabbed.lost {
            0 if grabbed.is_live => finding("lost-frames", Some(0.0), "", Verdict::Good, "no frame was lost"),
            0 => finding(
                "lost-frames",
                Some(0.0),
                "",
                Verdict::Good,
                "no frame is missing; this source waits for its taker",
            ),
            lost => {
                let came = grabbed.means.len();
                let words = format!(
                    "{lost} lost beside {came} that came: lower the rate or the window, let fewer programs run, and see \
                     socket buffer and packet size of a network camera"
                );
                finding("lost-frames", Some(lost as f64), "", Verdict::Bad, &words)
            }
        };
        let rate_hz = grabbed.rate_hz();
        let off = rate_hz.map_or(0.0, |rate_hz| (rate_hz / wanted_hz - 1.0).abs());
        let rate = match off > 0.02 {
            true => format!("{wanted_hz} Hz are wanted: a shorter exposure or a smaller window may allow them"),
            false => format!("as wanted, {wanted_hz} Hz"),
        };
        let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let workers = processors.min(self.config.workers.count.max(1) as usize);
        let capacity_hz = self.floor.rate_hz * workers as f64;
        let slow = capacity_hz < wanted_hz;
        let words = match slow {
            true => format!(
                "the camera is faster ({wanted_hz} Hz): {workers} of {processors} processors measure. Frames that wait \
                 are lost once the ring is full; keep shots short, take a larger step_px, or analyze afterwards"
            ),
            false => format!("{workers} of {processors} processors measure as fast as the camera films"),
        };
        vec![
            lost,
            finding("frame-rate", rate_hz, "Hz", if off > 0.02 { Verdict::Fair } else { Verdict::Good }, &rate),
            finding(
                "measuring-rate",
                Some(capacity_hz),
                "Hz",
                if slow { Verdict::Fair } else { Verdict::Good },
                &words,
            ),
        ]
    }

    fn light(&self) -> Vec<Finding> {
        let levels = &self.levels;
        let saturated = rising(levels.saturated, 5e-4, 1e-2);
        let words = match saturated {
            Verdict::Good => "no highlight is cut off",
            _ => "highlights are cut off: less light, a shorter exposure, less gain or a smaller aperture",
        };
        let black = rising(levels.black, 0.05, 0.5);
        let dark = match black {
            Verdict::Good => "no shadow is cut off",
            _ => "shadows are cut off: more light, or a higher black level",
        };
        let contrast = (levels.high_dn - levels.low_dn) / self.full_dn;
        let flat = rising(1.0 - contrast, 0.75, 0.92);
        let contrasty = match flat {
            Verdict::Good => "the pattern uses the camera's range",
            _ => "the pattern is pale: more light on it, a longer exposure where motion allows, darker paint",
        };
        let noise = levels.noise_dn.map(|noise_dn| noise_dn / (levels.high_dn - levels.low_dn).max(1e-9));
        let noisy = rising(noise.unwrap_or(0.0), 0.05, 0.25);
        let words_of_noise = match (noise, noisy) {
            (None, _) => "not measured: the picture moves, or all of it is cut off",
            (_, Verdict::Good) => "small against the contrast",
            _ => "large against the contrast: more light and less gain",
        };
        let (share, unsteady) = self
            .flicker
            .map_or((None, Verdict::Good), |flicker| (Some(flicker.share), rising(flicker.share, 0.02, 0.25)));
        vec![
            finding("saturated", Some(levels.saturated), "", saturated, words),
            finding("black", Some(levels.black), "", black, dark),
            finding("contrast", Some(contrast), "", flat, contrasty),
            finding("noise", levels.noise_dn, "DN", noisy, words_of_noise),
            self.fixed_pattern(),
            self.defective(),
            finding("flicker", share, "", unsteady, &self.words_of_flicker(unsteady)),
        ]
    }

    fn fixed_pattern(&self) -> Finding {
        let short = self.fixed.map_or(0.0, |fixed| fixed.short());
        let verdict = rising(short, 1e-3, 1e-2);
        let words = match (self.fixed, verdict) {
            (None, _) => "not measured: the picture moves, or too little of it is seen".into(),
            (_, Verdict::Good) => "pixels are alike enough".into(),
            _ => format!(
                "pixels differ from one another: steps of less than a pixel come out up to {:.1} % too short over subsets. Let \
                 the camera take its black reference and correct its shading, bring more light, see interval_frames, \
                 and measure balls by rotation.method = \"rigid\"",
                100.0 * short
            ),
        };
        finding("fixed-pattern", self.fixed.map(|fixed| fixed.dn), "DN", verdict, &words)
    }

    fn defective(&self) -> Finding {
        let pixels = self.defective_px;
        let shown: Vec<String> = pixels.iter().take(SHOWN_PIXELS).map(|[x, y]| format!("[{x}, {y}]")).collect();
        let more = if pixels.len() > shown.len() { "; --json gives all of them" } else { "" };
        let (verdict, words) = match pixels {
            [] => (Verdict::Good, "no pixel stands out from its neighbours in every frame".into()),
            _ => (
                Verdict::Fair,
                format!(
                    "hot or dead, they stand still before what moves: camera.defective_px = [{}] has them filled in from \
                     those around{more}",
                    shown.join(", ")
                ),
            ),
        };
        finding("defective-pixels", Some(pixels.len() as f64), "", verdict, &words)
    }

    fn words_of_flicker(&self, verdict: Verdict) -> String {
        let Some(flicker) = self.flicker else { return "the picture is black".into() };
        let often = flicker.frequency_hz.map_or_else(String::new, |hz| format!(" at {hz:.0} Hz"));
        let seen = flicker.seen_s;
        match verdict {
            Verdict::Good => format!("the light is steady over {seen:.3} s"),
            _ => format!(
                "the light swings{often}, seen over {seen:.3} s: a lamp on direct current, or a high-frequency ballast"
            ),
        }
    }

    fn pattern(&self) -> Vec<Finding> {
        let blurred = rising(self.blur_px.unwrap_or(0.0), 1.5, 2.5);
        let focus = match (self.blur_px, blurred) {
            (None, _) => "there are no edges to judge it by",
            (_, Verdict::Good) => "edges are sharp",
            _ => "edges are blurred: focus, clean the lens, close the aperture; of a moving body expose more shortly",
        };
        let subset_px = f64::from(self.config.correlation.subset_size_px);
        let size = self.speckles.size_px;
        let (fine, coarse) = (size.is_some_and(|px| px < 2.5), size.is_some_and(|px| px > subset_px / 3.0));
        let words = match size {
            None => "no pattern was found: speckle the body, or set its roi_px".to_owned(),
            Some(_) if fine => "too fine to be sampled well: coarser speckles, or more pixels a millimetre".into(),
            Some(_) if coarse => format!("too coarse for subsets of {subset_px} px: finer speckles or larger subsets"),
            Some(_) => "3 to 5 px are best".into(),
        };
        let coverage = self.speckles.coverage;
        let thin = !(0.15..=0.85).contains(&coverage);
        let density = match thin {
            true => "few speckles: a fifth to a half of the area is best",
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

    fn displacement(&self) -> Vec<Finding> {
        let floor = self.floor;
        let found = rising(1.0 - floor.found, 0.05, 0.5);
        let sight = match found {
            Verdict::Good => "a body is in sight in every frame",
            _ => "bodies are not found: put them in sight, and see roi_px, diameter_mm and the radii in the rig file",
        };
        let valid = rising(1.0 - floor.valid, 0.1, 0.5);
        let matched = match valid {
            Verdict::Good => "nearly every subset is matched",
            _ => "subsets are not matched: see the pattern, the light and the focus above",
        };
        let noisy = rising(floor.subset_px.unwrap_or(0.0), 0.05, 0.25);
        let compared =
            self.expected_px.map_or_else(String::new, |px| format!("; noise and pattern alone make {px:.4} px"));
        let words = match (floor.subset_px, floor.moves) {
            (None, Some((px, deg))) => {
                format!("not measured: the body moves by {px:.3} px and {deg:.3} deg a frame; hold it still")
            }
            (None, None) => "not measured: too few subsets are matched".into(),
            (Some(px), _) if self.expected_px.is_some_and(|expected| px > 2.0 * expected.max(1e-3)) => {
                format!(
                    "of one subset, one frame to the next{compared}: look for vibration, moving air and unsteady light"
                )
            }
            _ => format!("of one subset, one frame to the next{compared}"),
        };
        let body = "of the whole body, one frame to the next";
        vec![
            finding("body-found", Some(floor.found), "", found, sight),
            finding("subsets-matched", Some(floor.valid), "", valid, matched),
            finding("noise-floor", floor.subset_px, "px", noisy, &words),
            finding("noise-floor-body", floor.body_px, "px", rising(floor.body_px.unwrap_or(0.0), 0.02, 0.1), body),
            finding(
                "noise-floor-rotation",
                floor.body_deg,
                "deg",
                rising(floor.body_deg.unwrap_or(0.0), 0.02, 0.1),
                body,
            ),
        ]
    }
}
