//! The curves of one body.

use super::chart::{self, Chart, Curve, Point, Timeline};
use super::number;
use super::shot::Shot;
use crate::results::{BodyVelocity, Estimate, VelocitySample};
use std::fmt::Write as _;

/// Every chart of a body, one under the other on one time axis.
pub(super) fn section(shot: &Shot, body: u32) -> String {
    let Some(drawer) = Drawer::new(shot, body) else { return String::new() };
    let mut html = String::from("<div class=\"curves\">");
    html.push_str(&drawer.legend());
    for (title, unit, number, sigma) in VELOCITIES {
        let curves = drawer.pair(|row| row.velocity.map(|v| (number(&v), sigma(&v))));
        let typical = drawer.typical(|row| row.velocity.map(|v| sigma(&v)));
        drawer.figure(
            &mut html,
            &format!("{title}, {unit}"),
            &typical,
            Chart { title: title.into(), curves, height: 130.0, has_axis: false },
        );
    }
    drawer.place(&mut html);
    drawer.shape(&mut html);
    html.push_str("</div>");
    html
}

type OfVelocity = fn(&BodyVelocity) -> f64;

const VELOCITIES: [(&str, &str, OfVelocity, OfVelocity); 3] = [
    ("Normal velocity <i>v</i><sub>n</sub>", "m/s", |v| v.vn_m_s, |v| v.sigma_v_m_s),
    ("Tangential velocity <i>v</i><sub>t</sub>", "m/s", |v| v.vt_m_s, |v| v.sigma_v_m_s),
    ("Spin <i>ω</i>, counter-clockwise", "rad/s", |v| v.omega_rad_s, |v| v.sigma_omega_rad_s),
];

/// Draws the rows of one body.
pub(super) struct Drawer<'a> {
    shot: &'a Shot,
    rows: Vec<&'a VelocitySample>,
    truth: Vec<&'a VelocitySample>,
    time: Timeline,
}

impl<'a> Drawer<'a> {
    /// `None` of a body without rows.
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

    /// The time that all its charts span.
    pub(super) fn time(&self) -> &Timeline {
        &self.time
    }

    fn legend(&self) -> String {
        let mut html = String::from("<p class=\"legend\"><span class=\"key a\"></span>measured, band ±2<i>σ</i>");
        if !self.truth.is_empty() {
            html.push_str("<span class=\"key truth\"></span>truth");
        }
        if !self.time.contacts.is_empty() {
            html.push_str("<span class=\"key shade\"></span>contact: start, <b class=\"deepest\">deepest</b>, end");
        }
        html.push_str("</p>");
        html
    }

    fn figure(&self, html: &mut String, heading: &str, note: &str, mut chart: Chart) {
        chart.title = chart.title.replace("<i>", "").replace("</i>", "").replace("<sub>", "").replace("</sub>", "");
        let svg = chart::draw(&chart, &self.time);
        if svg.is_empty() {
            let _ = write!(
                html,
                "<figure><figcaption><b>{heading}</b></figcaption><p class=\"none\">not measured</p></figure>"
            );
        } else {
            let _ = write!(html, "<figure><figcaption><b>{heading}</b><span>{note}</span></figcaption>{svg}</figure>");
        }
    }

    /// Stretches of a number; a lost frame or a missing number ends one.
    fn stretches(
        &self,
        rows: &[&VelocitySample],
        number: impl Fn(&VelocitySample) -> Option<(f64, f64)>,
    ) -> Vec<Vec<Point>> {
        let mut stretches: Vec<Vec<Point>> = Vec::new();
        let mut last_frame = None;
        for row in rows {
            let Some((y, sigma)) = number(row).filter(|(y, _)| y.is_finite()) else { continue };
            let point = Point {
                x: 1e3 * self.shot.seconds(row.stamp_ns),
                y,
                sigma: if sigma.is_finite() { sigma } else { 0.0 },
            };
            match stretches.last_mut() {
                Some(stretch) if last_frame == Some(row.frame.wrapping_sub(1)) => stretch.push(point),
                _ => stretches.push(vec![point]),
            }
            last_frame = Some(row.frame);
        }
        stretches
    }

    fn curve(
        &self,
        class: &'static str,
        label: &'static str,
        number: impl Fn(&VelocitySample) -> Option<(f64, f64)>,
    ) -> Curve {
        Curve { class, label, stretches: self.stretches(&self.rows, number) }
    }

    /// Measured over true.
    pub(super) fn pair(&self, number: impl Fn(&VelocitySample) -> Option<(f64, f64)>) -> Vec<Curve> {
        let truth = self.stretches(&self.truth, |row| number(row).map(|(y, _)| (y, 0.0)));
        vec![
            Curve { class: "a", label: "", stretches: self.stretches(&self.rows, &number) },
            Curve { class: "truth", label: "", stretches: truth },
        ]
    }

    /// The uncertainty in the middle of all.
    fn typical(&self, sigma: impl Fn(&VelocitySample) -> Option<f64>) -> String {
        let mut sigmas: Vec<f64> = self.rows.iter().filter_map(|row| sigma(row)).filter(|s| s.is_finite()).collect();
        sigmas.sort_by(f64::total_cmp);
        let (Some(middle), Some(highest)) = (sigmas.get(sigmas.len() / 2), sigmas.last()) else { return String::new() };
        let written = |sigma: f64| number::write(Estimate { value: 0.0, sigma }, 1.0).sigma;
        format!("<i>σ</i> {} typical, {} at most", written(*middle), written(*highest))
    }

    /// How far the centre has come, in mm where the scale is known.
    fn place(&self, html: &mut String) {
        let scale = self.shot.metadata.get("scale").and_then(|text| text.strip_suffix(" mm/px")?.parse::<f64>().ok());
        let (factor, unit) = scale.map_or((1.0, "px"), |mm_per_px| (mm_per_px, "mm"));
        let first =
            |number: fn(&VelocitySample) -> Option<f64>| self.rows.iter().find_map(|row| number(row)).unwrap_or(0.0);
        let (x0, y0) = (first(|row| row.center_x_px), first(|row| row.center_y_px));
        let x = self.curve("b", "right", |row| Some((factor * (row.center_x_px? - x0), 0.0)));
        let y = self.curve("a", "up", |row| Some((factor * (y0 - row.center_y_px?), 0.0)));
        let chart = Chart { title: "Place of the centre".into(), curves: vec![x, y], height: 130.0, has_axis: false };
        self.figure(html, &format!("Way of the centre from its first place, {unit}"), "", chart);
    }

    fn shape(&self, html: &mut String) {
        let radius = self.curve("a", "", |row| Some((row.radius_px?, 0.0)));
        let has_radius = !radius.stretches.is_empty();
        let visible = self.curve("a", "", |row| Some((100.0 * row.visible_fraction?, 0.0)));
        if has_radius {
            let chart = Chart { title: "Radius".into(), curves: vec![radius], height: 70.0, has_axis: false };
            self.figure(html, "Radius, px", "", chart);
        }
        let chart = Chart { title: "Visible part".into(), curves: vec![visible], height: 70.0, has_axis: true };
        self.figure(html, "Visible part, %", "", chart);
    }
}
