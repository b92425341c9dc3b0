//! The paper's figures of an experiment, drawn from a recording: files that need nothing else.

use super::chart::{self, Chart, Curve, Point};
use super::curves::Drawer;
use super::number::{escape, fixed, short};
use super::shot::{Shot, Snapshot};
use super::snapshot;
use crate::results::{BodyVelocity, ROD_EDGES, TrackSample, VelocitySample};
use std::fmt::Write as _;

/// Width of a figure, px.
const WIDTH: f64 = 900.0;
/// Height of a heading, of the title of a panel, of its plot, and of its axis, px.
const HEADING: f64 = 70.0;
const TITLE: f64 = 26.0;
const PLOT: f64 = 200.0;
const AXIS: f64 = 56.0;
/// Side of a picture, and the lines under it, px.
const PICTURE: f64 = 284.0;
const CAPTION: f64 = 96.0;

/// White on every page; the page's colours are those of the light style sheet.
const STYLE: &str = "text{font:13px system-ui,sans-serif;fill:#14181f}.head{font-size:17px;font-weight:600}\
    .title{font-weight:600}.note,.tick{fill:#5c6675;font-size:12px}.grid{stroke:#dfe3e9;fill:none}\
    .zero,.axis{stroke:#5c6675;fill:none}.contact{fill:#fbe9c8}path.edge{stroke:#c9a45a;fill:none}\
    path.deepest{stroke:#c9a45a;fill:none;stroke-dasharray:2 3}.line{fill:none;stroke-width:1.9}\
    .line.a{stroke:#0b62c4}.line.truth{stroke:#d9730d;stroke-width:1.5;stroke-dasharray:5 4}\
    .line.b{stroke:#1b7f4b}.dot.b{fill:#1b7f4b}.label.b{fill:#1b7f4b}.band.b{fill:#1b7f4b}.band{opacity:.28;fill:#0b62c4}.dot.a{fill:#0b62c4}.label.a{fill:#0b62c4}.label.truth{fill:#d9730d}\
    .line.c{stroke:#8a3ffc}.dot.c{fill:#8a3ffc}.label.c{fill:#8a3ffc}\
    .outline{fill:none;stroke:#35e06f;stroke-width:1.6px;vector-effect:non-scaling-stroke}\
    .arrow,.casing{fill:none;stroke:#ffd21f;stroke-width:1.5px;vector-effect:non-scaling-stroke}\
    .casing{stroke:#000;stroke-width:3.6px;opacity:.6}image{image-rendering:pixelated}";

/// One figure.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Figure {
    /// What its file is called, without the ending.
    pub name: &'static str,
    /// The drawing.
    pub svg: String,
}

/// What is known of the experiment besides its recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Experiment<'a> {
    /// Its name.
    pub name: &'a str,
    /// Length of a pixel, mm.
    pub mm_per_px: f64,
    /// The surface's tangent, counter-clockwise from x, deg.
    pub surface_angle_deg: f64,
    /// The normal velocity as others would measure it, m/s.
    pub beside: &'a [Beside],
}

/// A number of the same film, measured in another way.
#[derive(Debug, Clone, PartialEq)]
pub struct Beside {
    /// What it is called at the end of its curve.
    pub label: &'static str,
    /// Moment, ns since the Unix epoch, and number.
    pub points: Vec<(u64, f64)>,
}

/// Heading of the plot that has the normal velocity by the paper's settings.
const BY_THE_PAPER: &str = "normal velocity by the paper's settings, m/s: 5 spline points, highest grid point";

/// A number of a row with its uncertainty.
type Number<'a> = &'a dyn Fn(&VelocitySample) -> Option<(f64, f64)>;

/// The figures of one of the paper's experiments; none of another.
///
/// Of the rod Figs. 10 and 11, of the tennis ball Figs. 13 to 16, of the lacrosse ball Figs. 18 to 21.
pub fn figures(shot: &Shot, experiment: &Experiment<'_>) -> Vec<Figure> {
    let names: [&'static str; 4] = match experiment.name {
        "rod" => ["fig10-position", "fig11-velocity", "", ""],
        "tennis" => ["fig14-position", "fig15-velocity", "fig16-spin", "fig13-field"],
        "lacrosse" => ["fig19-position", "fig20-velocity", "fig21-spin", "fig18-field"],
        _ => return Vec::new(),
    };
    let Some(drawer) = Drawer::new(shot, 0) else { return Vec::new() };
    let subject = if experiment.name == "rod" { "the mark on the rod" } else { "the centre of the ball" };
    let of = |number: fn(&BodyVelocity) -> (f64, f64)| move |row: &VelocitySample| row.velocity.as_ref().map(number);
    let (normal, tangential, spin) = (
        of(|v| (v.vn_m_s, v.sigma_v_m_s)),
        of(|v| (v.vt_m_s, v.sigma_v_m_s)),
        of(|v| (v.omega_rad_s, v.sigma_omega_rad_s)),
    );
    let place = Places::new(shot, experiment);
    let (along_normal, along_tangent) =
        (|row: &VelocitySample| place.of(row, 0), |row: &VelocitySample| place.of(row, 1));
    let rod = experiment.name == "rod";
    let panel = |label: &'static str, number: Number<'_>| (label, pair(&drawer, number));
    // A rod does not move along the flat; its tapes' edges are what the paper follows.
    let (second, more) = if rod {
        (Some(("edges of the tapes, mm above where the lowest began", edges(shot, experiment))), None)
    } else {
        (Some(panel("tangential position, mm", &along_tangent)), Some(panel("tangential velocity, m/s", &tangential)))
    };
    let paper = (!experiment.beside.is_empty()).then(|| {
        let truth = pair(&drawer, &normal).into_iter().filter(|curve| curve.class == "truth");
        (BY_THE_PAPER, beside(shot, experiment).chain(truth).collect())
    });
    let drawings = [
        plots(
            &drawer,
            &format!("Position of {subject}"),
            [panel("normal position, mm", &along_normal)].into_iter().chain(second).collect(),
        ),
        plots(
            &drawer,
            &format!("Velocity of {subject}"),
            [panel("normal velocity, m/s", &normal)].into_iter().chain(more).chain(paper).collect(),
        ),
        plots(&drawer, "Angular velocity of the ball, counter-clockwise", vec![panel("spin, rad/s", &spin)]),
        pictures(shot, experiment.name),
    ];
    let named = names.into_iter().zip(drawings).filter(|(name, svg)| !name.is_empty() && !svg.is_empty());
    named.map(|(name, svg)| Figure { name, svg }).collect()
}

/// Places along the surface's axes, from the true place in the first frame.
struct Places {
    from_px: [f64; 2],
    mm_per_px: f64,
    turn: (f64, f64),
}

impl Places {
    fn new(shot: &Shot, experiment: &Experiment<'_>) -> Self {
        let place = |row: &VelocitySample| Some([row.center_x_px?, row.center_y_px?]);
        let from_px = shot.truth.iter().chain(&shot.velocities).find_map(place).unwrap_or_default();
        let turn = experiment.surface_angle_deg.to_radians().sin_cos();
        Self { from_px, mm_per_px: experiment.mm_per_px, turn }
    }

    /// Along the normal (0) or the tangent (1), mm.
    fn of(&self, row: &VelocitySample, axis: usize) -> Option<(f64, f64)> {
        // The image's y points down.
        let (right, up) = (row.center_x_px? - self.from_px[0], self.from_px[1] - row.center_y_px?);
        let (sin, cos) = self.turn;
        let along = if axis == 0 { up * cos - right * sin } else { right * cos + up * sin };
        Some((self.mm_per_px * along, 0.0))
    }
}

fn open(svg: &mut String, height: f64, title: &str, note: &str) {
    let (title, note) = (escape(title), escape(note));
    let _ = write!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\">\
         <style>{STYLE}</style><rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\
         <text class=\"head\" x=\"20\" y=\"30\">{title}</text><text class=\"note\" x=\"20\" y=\"52\">{note}</text>"
    );
}

/// What was measured over what is true.
fn pair(drawer: &Drawer<'_>, number: Number<'_>) -> Vec<Curve> {
    let named = |curve: Curve| Curve { label: if curve.class == "truth" { "truth" } else { "measured" }, ..curve };
    drawer.pair(number).into_iter().map(named).collect()
}

/// Heights of the edges of a rod's tapes.
fn edges(shot: &Shot, experiment: &Experiment<'_>) -> Vec<Curve> {
    const LABELS: [&str; ROD_EDGES] = ["edge 1", "edge 2", "edge 3", "edge 4"];
    let place = |row: &TrackSample, edge: usize| row.rod?.edges[edge]?.y_px;
    let first = (0..ROD_EDGES).filter_map(|edge| shot.rods.iter().find_map(|row| place(row, edge)));
    let lowest_px = first.map(|place| place.value).fold(f64::NEG_INFINITY, f64::max);
    let curve = |edge: usize| {
        let mut stretches: Vec<Vec<Point>> = Vec::new();
        let mut last_frame = None;
        for row in &shot.rods {
            let Some(place) = place(row, edge) else { continue };
            let point = Point {
                x: 1e3 * shot.seconds(row.stamp_ns),
                y: experiment.mm_per_px * (lowest_px - place.value),
                sigma: experiment.mm_per_px * place.sigma,
            };
            match stretches.last_mut() {
                Some(stretch) if last_frame == Some(row.frame.wrapping_sub(1)) => stretch.push(point),
                _ => stretches.push(vec![point]),
            }
            last_frame = Some(row.frame);
        }
        Curve { class: "b", label: LABELS[edge], stretches }
    };
    (0..ROD_EDGES).map(curve).filter(|curve| !curve.stretches.is_empty()).collect()
}

/// What others would measure of the same film.
fn beside<'a>(shot: &'a Shot, experiment: &Experiment<'a>) -> impl Iterator<Item = Curve> + use<'a> {
    const CLASSES: [&str; 2] = ["b", "c"];
    let point = |(stamp_ns, y): &(u64, f64)| Point { x: 1e3 * shot.seconds(*stamp_ns), y: *y, sigma: 0.0 };
    experiment.beside.iter().zip(CLASSES.into_iter().cycle()).map(move |(beside, class)| Curve {
        class,
        label: beside.label,
        stretches: vec![beside.points.iter().map(point).collect()],
    })
}

/// One plot under the other; empty when one of them has nothing to show.
fn plots(drawer: &Drawer<'_>, title: &str, panels: Vec<(&'static str, Vec<Curve>)>) -> String {
    let each = TITLE + PLOT + AXIS;
    let mut svg = String::new();
    let note = "blue: measured, with a band of 2 sigma; orange: truth; shaded: contact from start to end, dotted where deepest";
    open(&mut svg, HEADING + each * panels.len() as f64, title, note);
    for (index, (label, curves)) in panels.into_iter().enumerate() {
        let chart = Chart { title: label.to_owned(), curves, height: PLOT, has_axis: true };
        let drawn = chart::draw(&chart, drawer.time());
        if drawn.is_empty() {
            return String::new();
        }
        let top = HEADING + each * index as f64;
        let _ = write!(svg, "<text class=\"title\" x=\"20\" y=\"{}\">{}</text>", top + 16.0, escape(label));
        let placed = format!("<svg x=\"0\" y=\"{}\" width=\"{WIDTH}\" height=\"{}\"", top + TITLE, PLOT + AXIS);
        svg.push_str(&drawn.replacen("<svg", &placed, 1));
        let middle = 0.5 * WIDTH;
        let _ = write!(
            svg,
            "<text class=\"tick\" x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">time, ms</text>",
            top + each - 4.0
        );
    }
    svg.push_str("</svg>\n");
    svg
}

/// The field at the beginning, the deepest moment and the end of the first collision; empty without pictures of it.
fn pictures(shot: &Shot, experiment: &str) -> String {
    let shown: Vec<&Snapshot> = shot
        .snapshots
        .iter()
        .filter(|shown| shown.impact.1 == 0 && shown.field.is_some() && shown.picture.is_some())
        .collect();
    if shown.is_empty() {
        return String::new();
    }
    let gain = snapshot::gain(&shown);
    let mut svg = String::new();
    let enlarged = fixed(gain, if gain < 1.0 { 3 } else { 0 });
    let note =
        format!("green: outline found; yellow: motion of each subset to the next frame, {enlarged} times enlarged");
    open(
        &mut svg,
        HEADING + PICTURE + CAPTION,
        &format!("Frames of the {experiment} ball with the field measured"),
        &note,
    );
    for (index, snapshot) in shown.iter().enumerate() {
        let Some((crop, png)) = &snapshot.picture else { continue };
        let left = 14.0 + index as f64 * (PICTURE + 10.0);
        let placed = format!("<svg x=\"{left}\" y=\"{HEADING}\" width=\"{PICTURE}\" height=\"{PICTURE}\"");
        svg.push_str(&snapshot::draw(snapshot, *crop, png, gain).replacen("<svg", &placed, 1));
        let t_ms = 1e3 * (shot.seconds(snapshot.row.stamp_ns));
        let mut lines = vec![format!("frame {}, {} ms", shot.frame(snapshot.row.frame), fixed(t_ms, 3))];
        if let Some(v) = snapshot.row.velocity {
            lines.push(format!("vn {} m/s, vt {} m/s", short(v.vn_m_s), short(v.vt_m_s)));
            lines.push(format!("spin {} rad/s", short(v.omega_rad_s)));
        }
        let low = HEADING + PICTURE;
        let _ = write!(svg, "<text class=\"title\" x=\"{left}\" y=\"{}\">{}</text>", low + 20.0, snapshot.title);
        for (line, text) in lines.iter().enumerate() {
            let y = low + 40.0 + 18.0 * line as f64;
            let _ = write!(svg, "<text class=\"note\" x=\"{left}\" y=\"{y}\">{}</text>", escape(text));
        }
    }
    svg.push_str("</svg>\n");
    svg
}
