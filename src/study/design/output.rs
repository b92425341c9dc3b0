//! The output of the design study.

use super::advice::Advice;
use super::rig::Rig;
use super::scatter::{Expected, Prediction};
use super::{DesignOptions, FILMS, FILMS_PER_CHANGE};
use crate::console::table;
use crate::failure::Failure;
use crate::results::MotionMethod;
use crate::study::output_files::{Report, Table};
use serde_json::{Value, json};

/// Name of the table of expected uncertainties.
pub(super) const TABLE: &str = "design.csv";
/// Name of the table of tried changes.
pub(super) const ADVICE_TABLE: &str = "design_advice.csv";

/// The results for a rig.
pub(super) struct Study<'a> {
    pub(super) options: &'a DesignOptions,
    pub(super) rig: &'a Rig,
    pub(super) prediction: &'a Prediction,
    pub(super) advice: &'a [Advice],
}

impl Study<'_> {
    /// Returns the files, and the text or JSON object to print.
    ///
    /// # Errors
    ///
    /// When a table cannot be encoded.
    pub(super) fn report(&self) -> Result<Report, Failure> {
        let expected = Table::new(self.prediction.rows.iter().map(|row| {
            vec![
                ("name", json!(row.name)),
                ("unit", json!(row.unit)),
                ("true", json!(row.truth)),
                ("sigma", json!(row.sigma)),
                ("mean_error", json!(row.offset)),
                ("measured", json!(row.fraction)),
                ("odd", json!(row.outliers)),
            ]
        }));
        let names =
            self.advice.first().into_iter().flat_map(|advice| advice.ratios.iter().map(|(name, _)| name.clone()));
        let row = |advice: &Advice| {
            let ratios = advice.ratios.iter().map(|(_, ratio)| json!(ratio));
            [json!(advice.description), json!(advice.mean)].into_iter().chain(ratios).collect()
        };
        let advice = Table {
            columns: ["change".to_owned(), "mean_share".to_owned()].into_iter().chain(names).collect(),
            rows: self.advice.iter().map(row).collect(),
        };
        let printed = if self.options.json { self.as_json(&expected).to_string() } else { self.as_text() };
        let files = vec![(TABLE.to_owned(), expected.as_csv()?), (ADVICE_TABLE.to_owned(), advice.as_csv()?)];
        Ok(Report { files, printed })
    }

    /// Returns rig, expected uncertainties and advice as one JSON object.
    fn as_json(&self, expected: &Table) -> Value {
        let Self { rig, prediction, advice, .. } = self;
        let camera = &rig.scenario.camera;
        let [x, y, angle] = prediction.noise.pose;
        let advice = advice.iter().map(|advice| {
            let shares: serde_json::Map<_, _> =
                advice.ratios.iter().map(|(name, ratio)| (name.clone(), json!(ratio))).collect();
            json!({ "change": advice.description, "mean_share": advice.mean, "shares": shares })
        });
        json!({
            "rig": rig.config.origin, "scenario": rig.scenario.name,
            "frame_rate_hz": camera.frame_rate_hz, "exposure_us": camera.exposure_us, "noise_dn": camera.noise_dn,
            "diameter_px": 2.0 * rig.scenario.radius_px(), "motion_blur_px": self.blur_px(),
            "pixel_noise_dn": prediction.noise.pixel_dn, "is_whole": prediction.noise.step.method == MotionMethod::WholeBody,
            "sigma_x_px": x, "sigma_y_px": y, "sigma_angle_deg": angle,
            "films": FILMS, "films_of_a_change": FILMS_PER_CHANGE,
            "expected": expected.as_json(), "advice": advice.collect::<Vec<_>>(),
        })
    }

    /// Returns the motion of the fastest point during the exposure, px.
    fn blur_px(&self) -> f64 {
        1e-6 * self.rig.scenario.camera.exposure_us * self.rig.speed_px_s()
    }

    /// Formats rig, expected uncertainties and advice for the terminal.
    fn as_text(&self) -> String {
        let Self { rig, prediction, .. } = self;
        let (camera, noise) = (&rig.scenario.camera, &prediction.noise);
        let [x, y, angle] = noise.pose;
        let rig = format!(
            "{}: {} of {:.1} px, {} Hz, {} us ({:.2} px of motion blur), noise {} of {} grey levels",
            rig.config.origin,
            if rig.scenario.body.rod.is_some() { "rod" } else { "ball" },
            2.0 * rig.scenario.radius_px(),
            camera.frame_rate_hz,
            camera.exposure_us,
            self.blur_px(),
            camera.noise_dn,
            2u32.pow(camera.bits)
        );
        let method = match noise.step.method {
            MotionMethod::WholeBody => "whole-body match",
            MotionMethod::Subsets => "subsets",
            MotionMethod::Outlines => "outlines",
        };
        let pose = format!("pose noise ({method}): {x:.5} px, {y:.5} px, {angle:.5} deg (1 sigma)");
        let header = ["result", "true", "scatter (1 sigma)", "relative", "mean error", ""].map(str::to_owned).to_vec();
        let rows: Vec<_> = std::iter::once(header).chain(prediction.rows.iter().map(row_cells)).collect();
        let mut text = format!("{rig}\n{pose}\n\n{}", table(&rows));
        let worst = prediction.rows.iter().max_by(|a, b| a.outliers.total_cmp(&b.outliers));
        if let Some(row) = worst.filter(|row| row.outliers > 0.0) {
            let percent = 100.0 * row.outliers;
            text += &format!("\n\nup to {percent:.1} % of the films ({}) are outliers and excluded", row.name);
        }
        if !self.advice.is_empty() {
            text += &format!("\n\nchanges to the rig, with the remaining scatter:\n{}", self.advice_text());
        }
        text
    }

    /// Formats the helpful changes as a table, or a sentence if none helps.
    fn advice_text(&self) -> String {
        let helpful: Vec<&Advice> = self.advice.iter().filter(|advice| advice.helps()).collect();
        let Some(first) = helpful.first() else { return "no change reduces the scatter by more than 3 %".to_owned() };
        let names = first.ratios.iter().map(|(name, _)| name.clone());
        let header = [String::new(), "mean".to_owned()].into_iter().chain(names).collect();
        let line = |(place, advice): (usize, &&Advice)| {
            let ratios = advice.ratios.iter().map(|(_, ratio)| percent(*ratio));
            [(place + 1).to_string(), percent(advice.mean)].into_iter().chain(ratios).collect()
        };
        let rows: Vec<Vec<String>> = std::iter::once(header).chain(helpful.iter().enumerate().map(line)).collect();
        let descriptions = std::iter::once("").chain(helpful.iter().map(|advice| advice.description.as_str()));
        let lines =
            table(&rows).lines().zip(descriptions).map(|(row, change)| format!("{row}   {change}")).collect::<Vec<_>>();
        lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n")
    }
}

/// Formats a fraction as a whole percentage.
fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// Formats the row of one result with times in ms: the truth to four decimals, the errors to three significant digits.
fn row_cells(expected: &Expected) -> Vec<String> {
    let (factor, unit) = if expected.unit == "s" { (1e3, "ms") } else { (1.0, expected.unit) };
    let digits = |value: f64| {
        let leading = (value.abs().max(1e-12)).log10().floor();
        format!("{value:.*}", (2.0 - leading).clamp(0.0, 9.0) as usize)
    };
    let share = if expected.truth.abs() > expected.sigma {
        format!("{:.2} %", 100.0 * expected.sigma / expected.truth.abs())
    } else {
        "-".into()
    };
    vec![
        expected.name.clone(),
        format!("{:.4}", factor * expected.truth),
        digits(factor * expected.sigma),
        share,
        digits(factor * expected.offset),
        unit.to_owned(),
    ]
}
