//! The output of the convergence study: table, JSON and figure.

use crate::failure::Failure;
use crate::plot::CurveStyle;
use std::path::Path;

use serde_json::{Value, json};

use super::criterion::{Stage, converged_points};
use super::figure::{self, Curve, DASHED, DISCS, DOTTED, Panel, SQUARES};
use super::image_pairs::DRAWN_PX;
use super::{ConvergenceOptions, Method, Peak, Row, SPLINE_POINTS};
use crate::console::table;
use crate::study::output_files::{Cell, Report, Table};

/// The options and the results.
pub(super) struct Study<'a> {
    pub(super) options: &'a ConvergenceOptions,
    pub(super) rows: &'a [Row],
}

/// Names of the files.
pub(super) const TABLE: &str = "convergence.csv";
pub(super) const FIGURE: &str = "convergence.svg";

impl Row {
    /// Returns all values of the row; missing ones are null.
    fn cells(&self) -> Vec<Cell> {
        let (name, spline_points, peak_fit) = match self.method {
            Method::IcGn => ("ic-gn", None, None),
            Method::Spline { spline_points, peak } => ("spline-fft", Some(spline_points), Some(peak == Peak::Fitted)),
        };
        let (change, from) = (self.change, self.from_ic_gn);
        vec![
            ("method", json!(name)),
            ("spline_points", json!(spline_points)),
            ("peak_fit", json!(peak_fit)),
            ("subsets", json!(self.subsets)),
            ("valid", json!(self.valid)),
            ("compared", json!(change.map(|change| change.compared))),
            ("change_median_u_px", json!(change.map(|change| change.median_px[0]))),
            ("change_median_v_px", json!(change.map(|change| change.median_px[1]))),
            ("change_p99_u_px", json!(change.map(|change| change.p99_px[0]))),
            ("change_p99_v_px", json!(change.map(|change| change.p99_px[1]))),
            ("ic_gn_median_u_px", json!(from.map(|from| from.median_px[0]))),
            ("ic_gn_median_v_px", json!(from.map(|from| from.median_px[1]))),
            ("mean_u_px", json!(self.mean_px.map(|mean| mean[0]))),
            ("mean_v_px", json!(self.mean_px.map(|mean| mean[1]))),
            ("bias_px", json!(self.error.map(|error| error.bias_px))),
            ("rms_px", json!(self.error.map(|error| error.rms_px))),
            ("max_px", json!(self.error.map(|error| error.max_px))),
            ("time_s", json!(self.time_s)),
        ]
    }

    /// Describes the displacement, or its error against the truth.
    fn answer(&self) -> String {
        match (self.error, self.mean_px) {
            (Some(error), _) => format!("bias {:.4}, rms {:.4} px", error.bias_px, error.rms_px),
            (None, Some([u, v])) => format!("mean u {u:.4}, v {v:.4} px"),
            (None, None) => "no valid subset".to_owned(),
        }
    }
}

impl Study<'_> {
    /// Returns the number of spline points and the row of each `spline-fft` method with one treatment of the peak.
    fn rows_with_peak(&self, wanted: Peak) -> Vec<(u32, &Row)> {
        let points = |row: &Row| match row.method {
            Method::Spline { spline_points, peak } if peak == wanted => Some(spline_points),
            _ => None,
        };
        self.rows.iter().filter_map(|row| Some((points(row)?, row))).collect()
    }

    /// Returns the number of points from which on the answers have converged; `None` if they have not.
    fn settled(&self, peak: Peak) -> Option<u32> {
        let stage = |(spline_points, row): (u32, &Row)| Stage {
            spline_points,
            valid: row.valid,
            change: row.change,
            on_grid: peak == Peak::Highest,
        };
        let stages: Vec<Stage> = self.rows_with_peak(peak).into_iter().map(stage).collect();
        converged_points(&stages, self.options.tolerance_px)
    }

    /// Summarises one treatment of the peak in one line.
    fn verdict(&self, peak: Peak) -> String {
        let (rows, settled) = (self.rows_with_peak(peak), self.settled(peak));
        let name = match peak {
            Peak::Fitted => "with the peak fit",
            Peak::Highest => "without the peak fit",
        };
        let Some((last, row)) = rows.iter().rfind(|(points, _)| settled.is_none_or(|settled| *points == settled))
        else {
            return format!("{name}: not measured");
        };
        let tolerance_px = self.options.tolerance_px;
        let ic_gn = self.rows.iter().find(|row| row.method == Method::IcGn).map_or_else(String::new, Row::answer);
        let verdict = match settled {
            Some(points) => {
                format!("converged at {points} points (99 % change by less than {tolerance_px} px from there on)")
            }
            None => format!("did not converge to {tolerance_px} px within {last} points"),
        };
        format!("{name}: {verdict}, {}; ic-gn: {ic_gn}", row.answer())
    }

    /// Draws the figure.
    fn figure(&self) -> String {
        let options = self.options;
        let (subset_px, step_px) = (options.subset_size_px, options.step_px);
        let of = match options.files() {
            Some(files) => {
                let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                format!("{} to {}", name(files.reference), name(files.target))
            }
            None => format!("a rendered ball moved by {} known displacements", DRAWN_PX.len()),
        };
        let of = format!("{of}; subsets of {subset_px} px, {step_px} px apart");
        let settled = |peak: Peak| match self.settled(peak) {
            Some(points) => format!("converged at {points} points (ring)"),
            None => "did not converge".to_owned(),
        };
        let verdict = format!(
            "With the peak fit: {}. Without it: {}; answers are only known to half a grid step.",
            settled(Peak::Fitted),
            settled(Peak::Highest)
        );
        let mut panels = vec![self.changes_panel()];
        if options.reference.is_none() {
            panels.push(self.errors_panel());
        }
        figure::draw("Convergence of spline-fft with the number of spline points", &[of, verdict], &panels)
    }

    /// Returns the panel of the changes against the previous number of points.
    fn changes_panel(&self) -> Panel {
        let change_px = |row: &Row| row.change.map(|change| change.p99_px[0].max(change.p99_px[1]));
        let bound_px = |points: u32| Some(0.5 / f64::from(points + 1));
        let tolerance_px = self.options.tolerance_px;
        let mut curves = self.curves(change_px);
        let line = |style: CurveStyle, name: String, values_px| Curve { style, name, values_px, ring: None };
        curves.push(line(DASHED, format!("tolerance {tolerance_px} px"), [Some(tolerance_px); SPLINE_POINTS.len()]));
        curves.push(line(DOTTED, "half a grid step".to_owned(), SPLINE_POINTS.map(bound_px)));
        Panel {
            title: "99 % quantile of the change against the previous number of points, px; the larger of u and v"
                .to_owned(),
            curves,
        }
    }

    /// Returns the panel of the errors against the truth.
    fn errors_panel(&self) -> Panel {
        let mut curves = self.curves(|row| row.error.map(|error| error.rms_px));
        let ic_gn = self.rows.iter().find(|row| row.method == Method::IcGn).and_then(|row| row.error);
        let values_px = [ic_gn.map(|error| error.rms_px); SPLINE_POINTS.len()];
        curves.push(Curve { style: DASHED, name: "ic-gn".to_owned(), values_px, ring: None });
        Panel { title: "Error against the truth: rms error, px".to_owned(), curves }
    }

    /// Returns a curve with and one without the peak fit, ringed at convergence; `value_px` gives the value of a row.
    fn curves(&self, value_px: impl Fn(&Row) -> Option<f64>) -> Vec<Curve> {
        let curve = |(style, peak, name): (CurveStyle, Peak, &str)| {
            let rows = self.rows_with_peak(peak);
            let row = |wanted: u32| rows.iter().find(|(points, _)| *points == wanted);
            Curve {
                style,
                name: name.to_owned(),
                values_px: SPLINE_POINTS.map(|points| row(points).and_then(|(_, row)| value_px(row))),
                ring: self.settled(peak).and_then(|settled| SPLINE_POINTS.iter().position(|p| *p == settled)),
            }
        };
        let styles = [(DISCS, Peak::Fitted, "with the peak fit"), (SQUARES, Peak::Highest, "without it")];
        styles.into_iter().map(curve).collect()
    }

    /// Returns the files, and the text or JSON object to print.
    ///
    /// # Errors
    ///
    /// When the table cannot be encoded.
    pub(super) fn report(&self) -> Result<Report, Failure> {
        let table = Table::new(self.rows.iter().map(Row::cells));
        let files = vec![(TABLE.to_owned(), table.as_csv()?), (FIGURE.to_owned(), self.figure().into_bytes())];
        let printed = if self.options.json { self.as_json(&table).to_string() } else { self.as_text() };
        Ok(Report { files, printed })
    }

    /// Formats table and verdicts for the terminal.
    fn as_text(&self) -> String {
        let px = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.5}"));
        let has_truth = self.options.reference.is_none();
        let last = if has_truth { ["bias", "rms", "max"] } else { ["mean u", "mean v", ""] };
        let head =
            ["points", "peak fit", "valid", "|du|", "|dv|", "99 % |du|", "99 % |dv|", "ic-gn |du|", "ic-gn |dv|"];
        let mut lines = vec![head.into_iter().chain(last).chain(["s"]).map(str::to_owned).collect::<Vec<_>>()];
        for row in self.rows {
            let (points, fit) = match row.method {
                Method::IcGn => ("ic-gn".to_owned(), ""),
                Method::Spline { spline_points, peak: Peak::Fitted } => (spline_points.to_string(), "yes"),
                Method::Spline { spline_points, peak: Peak::Highest } => (spline_points.to_string(), "no"),
            };
            let changes = [
                row.change.map(|change| change.median_px),
                row.change.map(|change| change.p99_px),
                row.from_ic_gn.map(|change| change.median_px),
            ];
            let mut line = vec![points, fit.to_owned(), format!("{}/{}", row.valid, row.subsets)];
            line.extend(changes.into_iter().flat_map(|change| [0, 1].map(|axis| px(change.map(|px| px[axis])))));
            if has_truth {
                line.extend([px(row.error.map(|e| e.bias_px)), px(row.error.map(|e| e.rms_px))]);
                line.push(px(row.error.map(|e| e.max_px)));
            } else {
                line.extend([px(row.mean_px.map(|mean| mean[0])), px(row.mean_px.map(|mean| mean[1])), String::new()]);
            }
            line.push(format!("{:.2}", row.time_s));
            lines.push(line);
        }
        let explanation = "lengths in px; |du|, |dv|: median change against the previous row, and against ic-gn";
        let [fitted, highest] = [Peak::Fitted, Peak::Highest].map(|peak| self.verdict(peak));
        format!("{explanation}\n{}\n{fitted}\n{highest}", table(&lines))
    }

    /// Returns options, verdicts and rows as one JSON object.
    fn as_json(&self, table: &Table) -> Value {
        let (options, files) = (self.options, self.options.files());
        json!({
            "study": "convergence",
            "reference": files.map(|files| files.reference),
            "target": files.map(|files| files.target),
            "roi_px": files.and_then(|files| files.roi_px),
            "displacements_px": files.is_none().then_some(DRAWN_PX),
            "subset_size_px": options.subset_size_px,
            "step_px": options.step_px,
            "search_px": options.search_px,
            "tolerance_px": options.tolerance_px,
            "settled_points": self.settled(Peak::Fitted),
            "settled_points_without_peak_fit": self.settled(Peak::Highest),
            "rows": table.as_json(),
        })
    }
}
