//! The curves of one body.

use super::shot::Shot;
use crate::numeric::quantile;
use crate::plot::{TimeChart, TimeCurve, TimePoint, Timeline, format_estimate};
use crate::results::{BodyVelocity, Estimate, VelocitySample};
use maud::{Markup, PreEscaped, html};

/// Draws every chart of a body, one below the other on one time axis; `None` for a body without velocity rows.
pub(super) fn section(shot: &Shot, body: u32) -> Option<Markup> {
    let charts = BodyCharts::new(shot, body)?;
    Some(html! {
        div class="curves" {
            (charts.legend())
            @for velocity in &VELOCITIES { (charts.velocity_chart(velocity)) }
            (charts.displacement_chart())
            @if let Some(radius) = charts.radius_chart() { (radius) }
            (charts.visible_fraction_chart())
        }
    })
}

/// A chart of one velocity component.
struct VelocityChart {
    title: &'static str,
    /// The title with its symbol, as HTML.
    heading: PreEscaped<&'static str>,
    unit: &'static str,
    /// Returns the number and its standard uncertainty.
    number: fn(&BodyVelocity) -> Option<Estimate>,
}

/// The velocity charts of a body, in the order of the page.
const VELOCITIES: [VelocityChart; 3] = [
    VelocityChart {
        title: "Normal velocity",
        heading: PreEscaped("Normal velocity <i>v</i><sub>n</sub>"),
        unit: "m/s",
        number: |v| Some(Estimate { value: v.vn_m_s, sigma: v.sigma_v_m_s }),
    },
    VelocityChart {
        title: "Tangential velocity",
        heading: PreEscaped("Tangential velocity <i>v</i><sub>t</sub>"),
        unit: "m/s",
        number: |v| Some(Estimate { value: v.vt_m_s, sigma: v.sigma_v_m_s }),
    },
    VelocityChart {
        title: "Spin, counter-clockwise",
        heading: PreEscaped("Spin <i>ω</i>, counter-clockwise"),
        unit: "rad/s",
        number: |v| v.omega_rad_s.zip(v.sigma_omega_rad_s).map(|(value, sigma)| Estimate { value, sigma }),
    },
];

/// The charts of one body over time.
pub(super) struct BodyCharts<'a> {
    shot: &'a Shot,
    rows: Vec<&'a VelocitySample>,
    truth: Vec<&'a VelocitySample>,
    time: Timeline,
}

impl<'a> BodyCharts<'a> {
    /// Collects the rows of a body; `None` when it has none.
    pub(super) fn new(shot: &'a Shot, body: u32) -> Option<Self> {
        let rows: Vec<&VelocitySample> = shot.velocities.iter().filter(|row| row.body == body).collect();
        let truth = shot.truth.iter().filter(|row| row.body == body).collect();
        let (first, last) = (rows.first()?, rows.last()?);
        let contacts = shot.impacts.iter().filter(|impact| impact.body == body).map(|impact| {
            let shift_s = shot.shift_s(impact);
            [impact.start_s, impact.deepest_s, impact.end_s].map(|moment| moment.map(|m| 1e3 * (m.value + shift_s)))
        });
        let time = Timeline {
            span: [1e3 * shot.seconds(first.stamp_ns), 1e3 * shot.seconds(last.stamp_ns)],
            contacts: contacts.collect(),
        };
        Some(Self { shot, rows, truth, time })
    }

    /// Returns the time that all charts of the body span, with its contacts.
    pub(super) fn time(&self) -> &Timeline {
        &self.time
    }

    /// Explains the curves and shades that the charts have.
    fn legend(&self) -> Markup {
        html! {
            p class="legend" {
                span class="key a" {} "measured, band ±2" i { "σ" }
                @if !self.truth.is_empty() { span class="key truth" {} "truth" }
                @if !self.time.contacts.is_empty() {
                    span class="key shade" {} "contact: start, " b class="deepest" { "deepest" } ", end"
                }
            }
        }
    }

    /// Draws one velocity component over time, with its typical uncertainty next to the title.
    fn velocity_chart(&self, velocity: &VelocityChart) -> Markup {
        let VelocityChart { title, heading, unit, number } = velocity;
        let curves = self.measured_and_true_curves(|row| row.velocity.as_ref().and_then(number));
        let chart = TimeChart { title: (*title).into(), curves, height: 130.0, has_axis: false };
        let note = self.typical_sigma(|row| row.velocity.as_ref().and_then(number).map(|number| number.sigma));
        self.captioned(&html! { (heading) ", " (unit) }, note.as_ref(), &chart)
    }

    /// Wraps a chart into a figure with its heading and note; a chart without a point states that it was not measured.
    fn captioned(&self, heading: &Markup, note: Option<&Markup>, chart: &TimeChart) -> Markup {
        html! {
            figure {
                @match chart.draw(&self.time) {
                    Some(svg) => {
                        figcaption { b { (heading) } span { @if let Some(note) = note { (note) } } }
                        (svg)
                    }
                    None => { figcaption { b { (heading) } } p class="none" { "not measured" } }
                }
            }
        }
    }

    /// Splits a number with its uncertainty into stretches over time, ms. A lost frame or a missing number ends one.
    fn unbroken_stretches(
        &self,
        rows: &[&VelocitySample],
        number: impl Fn(&VelocitySample) -> Option<Estimate>,
    ) -> Vec<Vec<TimePoint>> {
        let point = |row: &&VelocitySample| {
            let Estimate { value: y, sigma } = number(row).filter(|number| number.value.is_finite())?;
            let sigma = if sigma.is_finite() { sigma } else { 0.0 };
            Some((row.frame, TimePoint { x: 1e3 * self.shot.seconds(row.stamp_ns), y, sigma }))
        };
        join_consecutive(rows.iter().filter_map(point))
    }

    /// Returns the measured curve of a number without uncertainty.
    fn curve(
        &self,
        class: &'static str,
        label: &'static str,
        number: impl Fn(&VelocitySample) -> Option<f64>,
    ) -> TimeCurve {
        TimeCurve {
            class,
            label,
            stretches: self.unbroken_stretches(&self.rows, |row| Some(Estimate { value: number(row)?, sigma: 0.0 })),
        }
    }

    /// Returns the measured curve of a number with its uncertainty, and the true one, which may be empty.
    pub(super) fn measured_and_true_curves(
        &self,
        number: impl Fn(&VelocitySample) -> Option<Estimate>,
    ) -> Vec<TimeCurve> {
        let truth =
            self.unbroken_stretches(&self.truth, |row| number(row).map(|number| Estimate { sigma: 0.0, ..number }));
        vec![
            TimeCurve { class: "a", label: "", stretches: self.unbroken_stretches(&self.rows, &number) },
            TimeCurve { class: "truth", label: "", stretches: truth },
        ]
    }

    /// Formats the median and the largest standard uncertainty of a number over the rows; `None` without any.
    fn typical_sigma(&self, sigma: impl Fn(&VelocitySample) -> Option<f64>) -> Option<Markup> {
        let mut sigmas: Vec<f64> = self.rows.iter().filter_map(|row| sigma(row)).filter(|s| s.is_finite()).collect();
        let text = |sigma: f64| format_estimate(Estimate { value: 0.0, sigma }, 1.0).sigma;
        let (median, highest) = (text(quantile(&mut sigmas, 0.5)?), text(quantile(&mut sigmas, 1.0)?));
        Some(html! { i { "σ" } " " (median) " typical, " (highest) " at most" })
    }

    /// Draws the displacement of the centre from its first position, right and up, in mm where the scale is known.
    fn displacement_chart(&self) -> Markup {
        let scale = self.shot.metadata.get("scale").and_then(|text| text.strip_suffix(" mm/px")?.parse::<f64>().ok());
        let (factor, unit) = scale.map_or((1.0, "px"), |mm_per_px| (mm_per_px, "mm"));
        let first =
            |number: fn(&VelocitySample) -> Option<f64>| self.rows.iter().find_map(|row| number(row)).unwrap_or(0.0);
        let (x0, y0) = (first(|row| row.center_x_px), first(|row| row.center_y_px));
        let x = self.curve("b", "right", |row| Some(factor * (row.center_x_px? - x0)));
        let y = self.curve("a", "up", |row| Some(factor * (y0 - row.center_y_px?)));
        let title = "Displacement of the centre from its first position";
        let chart = TimeChart { title: title.into(), curves: vec![x, y], height: 130.0, has_axis: false };
        self.captioned(&html! { (title) ", " (unit) }, None, &chart)
    }

    /// Draws the radius, px; `None` for a body without one.
    fn radius_chart(&self) -> Option<Markup> {
        let radius = self.curve("a", "", |row| row.radius_px);
        let is_round = !radius.stretches.is_empty();
        let chart = TimeChart { title: "Radius".into(), curves: vec![radius], height: 70.0, has_axis: false };
        is_round.then(|| self.captioned(&html! { "Radius, px" }, None, &chart))
    }

    /// Draws the visible share of the body, %.
    fn visible_fraction_chart(&self) -> Markup {
        let visible = self.curve("a", "", |row| Some(100.0 * row.visible_fraction?));
        let chart = TimeChart { title: "Visible fraction".into(), curves: vec![visible], height: 70.0, has_axis: true };
        self.captioned(&html! { "Visible fraction, %" }, None, &chart)
    }
}

/// Joins the points of consecutive frames into stretches.
pub(super) fn join_consecutive(points: impl Iterator<Item = (u64, TimePoint)>) -> Vec<Vec<TimePoint>> {
    let mut stretches: Vec<Vec<TimePoint>> = Vec::new();
    let mut last_frame = None;
    for (frame, point) in points {
        match stretches.last_mut() {
            Some(stretch) if last_frame == Some(frame.wrapping_sub(1)) => stretch.push(point),
            _ => stretches.push(vec![point]),
        }
        last_frame = Some(frame);
    }
    stretches
}
