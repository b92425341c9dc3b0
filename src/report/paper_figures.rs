//! The paper's figures of an experiment, drawn from a recording as files that need nothing else.

use super::curves::{BodyCharts, join_consecutive};
use super::shot::{Shot, Snapshot};
use super::snapshot;
use crate::plot::{self, TimeChart, TimeCurve, TimePoint, fixed, three_digits};
use crate::results::{BodyVelocity, Estimate, ROD_EDGES, TrackSample, VelocitySample};
use maud::{Markup, html};

/// Width of a figure, px.
const WIDTH: f64 = 900.0;
/// Height of heading and note, of a panel's title, of its plot, and of its axis, px.
const HEADING: f64 = 70.0;
const TITLE: f64 = 26.0;
const PLOT: f64 = 200.0;
const AXIS: f64 = 56.0;
/// Side of a picture, and height of the lines below it, px.
const PICTURE: f64 = 284.0;
const CAPTION: f64 = 96.0;

/// One figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// The name of its file, without the ending.
    pub name: &'static str,
    /// The drawing.
    pub svg: String,
}

/// An experiment: the settings that its recording does not hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Experiment<'a> {
    /// Its name.
    pub name: &'a str,
    /// Length of a pixel, mm.
    pub mm_per_px: f64,
    /// The surface's tangent, counter-clockwise from x, deg.
    pub surface_angle_deg: f64,
    /// The normal velocity by other settings, m/s.
    pub comparisons: &'a [Comparison],
}

/// A number of the same film, measured with other settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The label at the end of its curve.
    pub label: &'static str,
    /// Time, ns since the Unix epoch, and value.
    pub points: Vec<(u64, f64)>,
}

/// The note below the heading of the plots.
const PLOT_NOTE: &str =
    "blue: measured, with a band of 2 sigma; orange: truth; shaded: contact from start to end, dotted where deepest";
/// The title of the panel with the normal velocity by the paper's settings.
const BY_THE_PAPER: &str = "normal velocity by the paper's settings, m/s: 5 spline points, highest grid point";

/// A panel of a figure: its title and curves.
type Panel = (&'static str, Vec<TimeCurve>);

/// A number of a row with its uncertainty.
type Number<'a> = &'a dyn Fn(&VelocitySample) -> Option<Estimate>;

/// Draws the figures of one of the paper's experiments (`rod`, `tennis` or `lacrosse`) from the first body of a shot.
///
/// Any other experiment has no figures.
/// A figure with a panel without data, or without pictures of its moments, is left out.
/// These are Figs. 10 and 11 of the rod, Figs. 13 to 16 of the tennis ball and Figs. 18 to 21 of the lacrosse ball.
pub fn figures(shot: &Shot, experiment: &Experiment<'_>) -> Vec<Figure> {
    let names: [&'static str; 4] = match experiment.name {
        "rod" => ["fig10-position", "fig11-velocity", "", ""],
        "tennis" => ["fig14-position", "fig15-velocity", "fig16-spin", "fig13-field"],
        "lacrosse" => ["fig19-position", "fig20-velocity", "fig21-spin", "fig18-field"],
        _ => return Vec::new(),
    };
    let Some(charts) = BodyCharts::new(shot, 0) else { return Vec::new() };
    let is_rod = experiment.name == "rod";
    let subject = if is_rod { "the mark on the rod" } else { "the centre of the ball" };
    let velocity_number = |number: fn(&BodyVelocity) -> Option<Estimate>| {
        move |row: &VelocitySample| row.velocity.as_ref().and_then(number)
    };
    let normal = velocity_number(|v| Some(Estimate { value: v.vn_m_s, sigma: v.sigma_v_m_s }));
    let tangential = velocity_number(|v| Some(Estimate { value: v.vt_m_s, sigma: v.sigma_v_m_s }));
    let spin =
        velocity_number(|v| v.omega_rad_s.zip(v.sigma_omega_rad_s).map(|(value, sigma)| Estimate { value, sigma }));
    let axes = SurfaceAxes::new(shot, experiment);
    let panel = |title: &'static str, number: Number<'_>| (title, labelled_pair(&charts, number));
    let mut positions = vec![panel("normal position, mm", &|row| axes.normal_mm(row))];
    let mut velocities = vec![panel("normal velocity, m/s", &normal)];
    if is_rod {
        // A rod does not move along the flat. The paper follows the edges of its tapes.
        positions.push(("edges of the tapes, mm above where the lowest began", edge_curves(shot, experiment)));
    } else {
        positions.push(panel("tangential position, mm", &|row| axes.tangential_mm(row)));
        velocities.push(panel("tangential velocity, m/s", &tangential));
    }
    if !experiment.comparisons.is_empty() {
        let truth = labelled_pair(&charts, &normal).into_iter().filter(|curve| curve.class == "truth");
        velocities.push((BY_THE_PAPER, comparison_curves(shot, experiment).chain(truth).collect()));
    }
    let drawings = [
        draw_panels(&charts, &format!("Position of {subject}"), positions),
        draw_panels(&charts, &format!("Velocity of {subject}"), velocities),
        draw_panels(&charts, "Angular velocity of the ball, counter-clockwise", vec![panel("spin, rad/s", &spin)]),
        draw_snapshots(shot, experiment.name),
    ];
    let named = names.into_iter().zip(drawings).filter(|(name, _)| !name.is_empty());
    named.filter_map(|(name, svg)| Some(Figure { name, svg: svg? })).collect()
}

/// The axes of the surface, with the true position in the first frame as origin.
struct SurfaceAxes {
    origin_px: [f64; 2],
    mm_per_px: f64,
    sin: f64,
    cos: f64,
}

impl SurfaceAxes {
    /// Returns the axes with the first true position as origin, or the first measured one without a truth.
    fn new(shot: &Shot, experiment: &Experiment<'_>) -> Self {
        let position = |row: &VelocitySample| Some([row.center_x_px?, row.center_y_px?]);
        let origin_px = shot.truth.iter().chain(&shot.velocities).find_map(position).unwrap_or_default();
        let (sin, cos) = experiment.surface_angle_deg.to_radians().sin_cos();
        Self { origin_px, mm_per_px: experiment.mm_per_px, sin, cos }
    }

    /// Returns the displacement right and up, px; the image's y points down.
    fn displacement_px(&self, row: &VelocitySample) -> Option<[f64; 2]> {
        Some([row.center_x_px? - self.origin_px[0], self.origin_px[1] - row.center_y_px?])
    }

    /// Returns the position along the surface's normal, mm, without uncertainty (0).
    fn normal_mm(&self, row: &VelocitySample) -> Option<Estimate> {
        let [right, up] = self.displacement_px(row)?;
        Some(Estimate { value: self.mm_per_px * (up * self.cos - right * self.sin), sigma: 0.0 })
    }

    /// Returns the position along the surface's tangent, mm, without uncertainty (0).
    fn tangential_mm(&self, row: &VelocitySample) -> Option<Estimate> {
        let [right, up] = self.displacement_px(row)?;
        Some(Estimate { value: self.mm_per_px * (right * self.cos + up * self.sin), sigma: 0.0 })
    }
}

/// Returns the measured curve and the true one, labelled.
fn labelled_pair(charts: &BodyCharts<'_>, number: Number<'_>) -> Vec<TimeCurve> {
    let named =
        |curve: TimeCurve| TimeCurve { label: if curve.class == "truth" { "truth" } else { "measured" }, ..curve };
    charts.measured_and_true_curves(number).into_iter().map(named).collect()
}

/// Returns the heights of the edges of a rod's tapes above the first position of the lowest, mm.
fn edge_curves(shot: &Shot, experiment: &Experiment<'_>) -> Vec<TimeCurve> {
    const LABELS: [&str; ROD_EDGES] = ["edge 1", "edge 2", "edge 3", "edge 4"];
    let height = |row: &TrackSample, edge: usize| row.rod?.edges[edge]?.y_px;
    let first = (0..ROD_EDGES).filter_map(|edge| shot.rods.iter().find_map(|row| height(row, edge)));
    let lowest_px = first.map(|height| height.value).fold(f64::NEG_INFINITY, f64::max);
    let curve = |edge: usize| {
        let point = |row: &TrackSample| {
            let height = height(row, edge)?;
            let point = TimePoint {
                x: 1e3 * shot.seconds(row.stamp_ns),
                y: experiment.mm_per_px * (lowest_px - height.value),
                sigma: experiment.mm_per_px * height.sigma,
            };
            Some((row.frame, point))
        };
        TimeCurve { class: "b", label: LABELS[edge], stretches: join_consecutive(shot.rods.iter().filter_map(point)) }
    };
    (0..ROD_EDGES).map(curve).filter(|curve| !curve.stretches.is_empty()).collect()
}

/// Returns the curves of the same film measured with other settings.
fn comparison_curves<'a>(shot: &'a Shot, experiment: &Experiment<'a>) -> impl Iterator<Item = TimeCurve> + use<'a> {
    const CLASSES: [&str; 2] = ["b", "c"];
    let point = |(stamp_ns, y): &(u64, f64)| TimePoint { x: 1e3 * shot.seconds(*stamp_ns), y: *y, sigma: 0.0 };
    experiment.comparisons.iter().zip(CLASSES.into_iter().cycle()).map(move |(comparison, class)| TimeCurve {
        class,
        label: comparison.label,
        stretches: vec![comparison.points.iter().map(point).collect()],
    })
}

/// Draws panels one below the other; `None` when one of them has no point.
fn draw_panels(charts: &BodyCharts<'_>, title: &str, panels: Vec<Panel>) -> Option<String> {
    let each = TITLE + PLOT + AXIS;
    let height = HEADING + each * panels.len() as f64;
    let drawn: Option<Vec<_>> = panels
        .into_iter()
        .map(|(label, curves)| {
            let chart = TimeChart { title: label.to_owned(), curves, height: PLOT, has_axis: true };
            Some((label, chart.draw(charts.time())?))
        })
        .collect();
    let content = html! {
        @for (index, (label, chart)) in drawn?.iter().enumerate() {
            @let top = HEADING + each * index as f64;
            text class="title" x="20" y=(top + 16.0) { (label) }
            svg x="0" y=(top + TITLE) width=(WIDTH) height=(PLOT + AXIS) { (chart) }
            text class="tick" x=(0.5 * WIDTH) y=(top + each - 4.0) text-anchor="middle" { "time, ms" }
        }
    };
    Some(plot::Figure { heading: title, caption: &[PLOT_NOTE.to_owned()] }.draw(WIDTH, height, &content))
}

/// Draws the field at start, deepest moment and end of the first collision; `None` without pictures of it.
fn draw_snapshots(shot: &Shot, experiment: &str) -> Option<String> {
    let is_shown = |shown: &&Snapshot| shown.impact.1 == 0 && shown.field.is_some() && shown.picture.is_some();
    let shown: Vec<&Snapshot> = shot.snapshots.iter().filter(is_shown).collect();
    if shown.is_empty() {
        return None;
    }
    let gain = snapshot::gain(&shown);
    let content = html! {
        @for (index, snapshot) in shown.iter().enumerate() {
            (draw_snapshot(shot, snapshot, gain, 14.0 + index as f64 * (PICTURE + 10.0)))
        }
    };
    let title = format!("Frames of the {experiment} ball with the measured field");
    let note = format!(
        "green: detected outline; yellow: motion of each subset to the next frame, enlarged {} times",
        snapshot::gain_text(gain)
    );
    let figure = plot::Figure { heading: &title, caption: &[note] };
    Some(figure.draw(WIDTH, HEADING + PICTURE + CAPTION, &content))
}

/// Draws the picture of a moment at horizontal place `left`, px, with its frame and velocities below.
fn draw_snapshot(shot: &Shot, snapshot: &Snapshot, gain: f64, left: f64) -> Markup {
    let low = HEADING + PICTURE;
    let t_ms = 1e3 * shot.seconds(snapshot.row.stamp_ns);
    let mut lines = vec![format!("frame {}, {} ms", shot.frame(snapshot.row.frame), fixed(t_ms, 3))];
    if let Some(v) = snapshot.row.velocity {
        lines.push(format!("vn {} m/s, vt {} m/s", three_digits(v.vn_m_s), three_digits(v.vt_m_s)));
        lines.extend(v.omega_rad_s.map(|omega| format!("spin {} rad/s", three_digits(omega))));
    }
    html! {
        @if let Some((crop, png)) = &snapshot.picture {
            svg x=(left) y=(HEADING) width=(PICTURE) height=(PICTURE) { (snapshot::draw(snapshot, *crop, png, gain)) }
        }
        text class="title" x=(left) y=(low + 20.0) { (snapshot.title) }
        @for (line, text) in lines.iter().enumerate() {
            text class="note" x=(left) y=(low + 40.0 + 18.0 * line as f64) { (text) }
        }
    }
}
