//! The output of the design study.

use super::advice::Advice;
use super::rig::Rig;
use super::scatter::{Expected, Prediction};
use super::{FILMS, FILMS_OF_A_CHANGE};
use crate::command::field::FieldError;
use crate::console::{say, table};
use crate::failure::Failure;
use serde_json::json;
use std::path::Path;

/// The results for a rig.
pub(super) struct Output<'a> {
    pub(super) rig: &'a Rig,
    pub(super) prediction: &'a Prediction,
    pub(super) advice: &'a [Advice],
}

impl Output<'_> {
    pub(super) fn print_json(&self) {
        let Self { rig, prediction, advice } = self;
        let camera = &rig.scenario.camera;
        let [x, y, angle] = prediction.noise.pose;
        let rows: Vec<_> = prediction.rows.iter().map(row).collect();
        let advice = advice.iter().map(|advice| {
            let shares: serde_json::Map<_, _> =
                advice.shares.iter().map(|(name, share)| (name.clone(), json!(share))).collect();
            json!({ "change": advice.words, "mean_share": advice.mean, "shares": shares })
        });
        let report = json!({
            "rig": rig.config.origin, "scenario": rig.scenario.name,
            "frame_rate_hz": camera.frame_rate_hz, "exposure_us": camera.exposure_us, "noise_dn": camera.noise_dn,
            "diameter_px": 2.0 * rig.scenario.radius_px(), "motion_blur_px": self.blur_px(),
            "pixel_noise_dn": prediction.noise.pixel_dn, "is_whole": prediction.noise.step.is_whole,
            "sigma_x_px": x, "sigma_y_px": y, "sigma_angle_deg": angle,
            "films": FILMS, "films_of_a_change": FILMS_OF_A_CHANGE,
            "expected": rows, "advice": advice.collect::<Vec<_>>(),
        });
        say(&report.to_string());
    }

    /// Writes `design.csv`, one row per result, and `design_advice.csv`, one row per change, replacing existing
    /// files.
    ///
    /// # Errors
    ///
    /// [`FieldError`] naming the file that cannot be written.
    pub(super) fn write(&self, directory: &Path) -> Result<(), Failure> {
        let expected = self.prediction.rows.iter().map(|row| {
            let numbers =
                [row.truth, row.sigma, row.offset, row.fraction, row.outliers].map(|number| number.to_string());
            [vec![row.name.clone(), row.unit.to_owned()], numbers.to_vec()].concat()
        });
        let header = ["name", "unit", "true", "sigma", "mean_error", "told", "odd"].map(str::to_owned).to_vec();
        file(&directory.join("design.csv"), header, expected)?;
        let names =
            self.advice.first().into_iter().flat_map(|advice| advice.shares.iter().map(|(name, _)| name.clone()));
        let header = ["change".to_owned(), "mean_share".to_owned()].into_iter().chain(names).collect();
        let advice = self.advice.iter().map(|advice| {
            let shares = advice.shares.iter().map(|(_, share)| share.to_string());
            [advice.words.clone(), advice.mean.to_string()].into_iter().chain(shares).collect()
        });
        file(&directory.join("design_advice.csv"), header, advice)
    }

    fn blur_px(&self) -> f64 {
        1e-6 * self.rig.scenario.camera.exposure_us * self.rig.speed_px_s()
    }

    pub(super) fn print_table(&self) {
        let Self { rig, prediction, .. } = self;
        let (camera, noise) = (&rig.scenario.camera, &prediction.noise);
        let [x, y, angle] = noise.pose;
        say(&format!(
            "{}: {} of {:.1} px, {} Hz, {} us ({:.2} px of motion blur), noise {} of {} grey levels",
            rig.config.origin,
            if rig.scenario.body.rod.is_some() { "rod" } else { "ball" },
            2.0 * rig.scenario.radius_px(),
            camera.frame_rate_hz,
            camera.exposure_us,
            self.blur_px(),
            camera.noise_dn,
            2u32.pow(camera.bits)
        ));
        let method = if noise.step.is_whole { "whole-body match" } else { "subsets" };
        say(&format!("pose noise ({method}): {x:.5} px, {y:.5} px, {angle:.5} deg (1 sigma)\n"));
        let header = ["result", "true", "scatter (1 sigma)", "relative", "mean error", ""].map(str::to_owned).to_vec();
        let rows: Vec<_> = std::iter::once(header).chain(prediction.rows.iter().map(cells)).collect();
        say(&table(&rows));
        if let Some(row) =
            prediction.rows.iter().max_by(|a, b| a.outliers.total_cmp(&b.outliers)).filter(|row| row.outliers > 0.0)
        {
            let share = 100.0 * row.outliers;
            say(&format!("\nup to {share:.1} % of the films ({}) are outliers and excluded", row.name));
        }
        self.print_advice();
    }

    fn print_advice(&self) {
        if self.advice.is_empty() {
            return;
        }
        say("\nchanges to the rig, with the remaining scatter:");
        let helpful: Vec<&Advice> = self.advice.iter().filter(|advice| advice.helps()).collect();
        if helpful.is_empty() {
            say("no change reduces the scatter by more than 3 %");
            return;
        }
        let names = helpful[0].shares.iter().map(|(name, _)| name.clone());
        let header = ["".to_owned(), "mean".to_owned()].into_iter().chain(names).collect();
        let line = |(place, advice): (usize, &&Advice)| {
            let shares = advice.shares.iter().map(|(_, share)| percent(*share));
            [(place + 1).to_string(), percent(advice.mean)].into_iter().chain(shares).collect()
        };
        let rows: Vec<Vec<String>> = std::iter::once(header).chain(helpful.iter().enumerate().map(line)).collect();
        for (row, words) in
            table(&rows).lines().zip(std::iter::once("").chain(helpful.iter().map(|a| a.words.as_str())))
        {
            say(format!("{row}   {words}").trim_end());
        }
    }
}

fn file(path: &Path, header: Vec<String>, rows: impl Iterator<Item = Vec<String>>) -> Result<(), Failure> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    std::iter::once(header).chain(rows).try_for_each(|row| csv.write_record(row))?;
    let bytes = csv.into_inner().map_err(|error| Failure::internal(format!("{error}")))?;
    Ok(std::fs::write(path, bytes).map_err(|error| FieldError::write(path, error))?)
}

fn row(expected: &Expected) -> serde_json::Value {
    json!({
        "name": expected.name, "unit": expected.unit, "true": expected.truth, "sigma": expected.sigma,
        "mean_error": expected.offset, "told": expected.fraction, "odd": expected.outliers,
    })
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

/// Formats three significant digits, with times in ms.
fn cells(expected: &Expected) -> Vec<String> {
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
