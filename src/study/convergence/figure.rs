//! The figure of the convergence study: logarithmic curves over the number of spline points, as a self-contained SVG.

use std::fmt::Write as _;

use super::SPLINE_POINTS;
use crate::study::svg::{plain, power_of_ten, text};

/// Width of the figure and its margins, px.
const WIDTH: f64 = 760.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 24.0;
/// Height of the heading, and of a panel's title and legend, plot, and axis labels, px.
const HEADING: f64 = 74.0;
const ABOVE: f64 = 50.0;
const PLOT: f64 = 250.0;
const BELOW: f64 = 62.0;
/// Height of the strip for zeros, px.
const STRIP: f64 = 34.0;

/// Smaller lengths are rounding errors of single precision and are drawn as zero, px.
const ZERO_PX: f64 = 1e-7;

/// The background is white on every page, and the colours suit the colour-blind (M. Okabe, K. Ito, 2008).
const STYLE: &str = "text{font:13px system-ui,sans-serif;fill:#222}\
    .head{font-size:17px;font-weight:600}.title{font-weight:600}.small{font-size:12px;fill:#555}\
    .grid{stroke:#ddd}.axis{stroke:#222;fill:none}\
    .curve{stroke:#0072b2;stroke-width:2;fill:none}.b.curve{stroke:#d55e00}\
    .dot{fill:#0072b2}.b.dot{fill:#d55e00}\
    .level.curve{stroke:#222;stroke-width:1.4;stroke-dasharray:7 4}\
    .bound.curve{stroke:#888;stroke-width:1.4;stroke-dasharray:2 3}\
    .ring{fill:none;stroke:#222;stroke-width:1.6}";

/// The line style of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    /// Blue with discs.
    Discs,
    /// Orange with squares.
    Squares,
    /// Dashed black line.
    Dashed,
    /// Dotted grey line.
    Dotted,
}

impl Look {
    fn class(self) -> &'static str {
        match self {
            Self::Discs => "a",
            Self::Squares => "b",
            Self::Dashed => "level",
            Self::Dotted => "bound",
        }
    }
}

/// A curve and its legend entry.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    pub(super) look: Look,
    pub(super) name: String,
    /// The lengths, one per number of spline points; `None` where there is none.
    pub(super) values_px: [Option<f64>; SPLINE_POINTS.len()],
    /// The index of the ringed point.
    pub(super) ring: Option<usize>,
}

/// A plot.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    pub(super) title: String,
    /// The label of the vertical axis, with its unit.
    pub(super) label: String,
    pub(super) curves: Vec<Curve>,
}

/// Draws the figure below the lines of its heading.
pub(super) fn draw(heading: &[String; 3], panels: &[Panel]) -> String {
    let height = HEADING + (ABOVE + PLOT + BELOW) * panels.len() as f64;
    let [title, of, verdict] = heading.each_ref().map(|line| plain(line));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" \
         viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{title}\">\n<style>{STYLE}</style>\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    text(&mut svg, (16.0, 26.0), "class=\"head\"", &title);
    text(&mut svg, (16.0, 47.0), "class=\"small\"", &of);
    text(&mut svg, (16.0, 66.0), "", &verdict);
    for (index, panel) in panels.iter().enumerate() {
        let top = HEADING + (ABOVE + PLOT + BELOW) * index as f64;
        let _ = writeln!(svg, "<g transform=\"translate(0 {top})\">");
        panel.draw(&mut svg);
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

/// The vertical axis.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    /// Exponents of ten at both ends.
    low: i32,
    high: i32,
    /// Height of the strip for zeros; 0 if there are none.
    strip: f64,
}

impl Scale {
    /// Returns an axis of whole decades around all values.
    fn of(curves: &[Curve]) -> Self {
        let values = || curves.iter().flat_map(|curve| curve.values_px).flatten();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values().filter(|value| *value >= ZERO_PX) {
            (low, high) = (low.min(value.log10()), high.max(value.log10()));
        }
        let strip = if values().any(|value| value < ZERO_PX) { STRIP } else { 0.0 };
        if low > high {
            return Self { low: -3, high: 0, strip };
        }
        // A value on a power of ten must not coincide with the frame.
        let (low, high) = ((low - 0.02).floor() as i32, (high + 0.02).ceil() as i32);
        Self { low, high: high.max(low + 1), strip }
    }

    fn y(self, value_px: f64) -> f64 {
        if value_px < ZERO_PX {
            return ABOVE + PLOT - 0.5 * self.strip;
        }
        let share = (f64::from(self.high) - value_px.log10()) / f64::from(self.high - self.low);
        ABOVE + share * (PLOT - self.strip)
    }
}

/// Returns the horizontal position of an index; positions are evenly spaced.
fn x(index: usize) -> f64 {
    let apart = (WIDTH - LEFT - RIGHT) / SPLINE_POINTS.len() as f64;
    LEFT + apart * (index as f64 + 0.5)
}

impl Panel {
    fn draw(&self, svg: &mut String) {
        let scale = Scale::of(&self.curves);
        text(svg, (16.0, 18.0), "class=\"title\"", &plain(&self.title));
        self.frame(svg, scale);
        let mut entry = LEFT;
        for curve in &self.curves {
            curve.draw(svg, scale);
            curve.explain(svg, entry);
            entry += 58.0 + 7.0 * curve.name.chars().count() as f64;
        }
    }

    fn frame(&self, svg: &mut String, scale: Scale) {
        let (right, low) = (WIDTH - RIGHT, ABOVE + PLOT);
        for power in scale.low..=scale.high {
            let y = scale.y(10_f64.powi(power));
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{right}\"/>");
            text(svg, (LEFT - 8.0, y + 4.0), "text-anchor=\"end\"", &power_of_ten(power));
        }
        if scale.strip > 0.0 {
            text(svg, (LEFT - 8.0, scale.y(0.0) + 4.0), "text-anchor=\"end\"", "0");
        }
        let _ = writeln!(svg, "<path class=\"axis\" d=\"M{LEFT} {ABOVE}V{low}H{right}\"/>");
        for (index, points) in SPLINE_POINTS.iter().enumerate() {
            let _ = writeln!(svg, "<path class=\"axis\" d=\"M{:.1} {low}v5\"/>", x(index));
            text(svg, (x(index), low + 20.0), "text-anchor=\"middle\"", &points.to_string());
        }
        let middle = 0.5 * (LEFT + right);
        text(svg, (middle, low + 40.0), "text-anchor=\"middle\"", "spline points between two pixels");
        let turned = format!("text-anchor=\"middle\" transform=\"rotate(-90 20 {:.1})\"", ABOVE + 0.5 * PLOT);
        text(svg, (20.0, ABOVE + 0.5 * PLOT), &turned, &plain(&self.label));
    }
}

impl Curve {
    fn draw(&self, svg: &mut String, scale: Scale) {
        let class = self.look.class();
        let place = |(index, value): (usize, &Option<f64>)| value.map(|value| (x(index), scale.y(value), value));
        let places: Vec<_> = self.values_px.iter().enumerate().map(place).collect();
        // No line leads to a zero: its length would be meaningless on a logarithmic axis.
        let is_drawn = |place: &Option<(f64, f64, f64)>| place.is_some_and(|(_, _, value)| value >= ZERO_PX);
        for stretch in places.split(|place| !is_drawn(place)).filter(|stretch| stretch.len() > 1) {
            let points = stretch.iter().flatten().map(|(x, y, _)| format!("{x:.1} {y:.1}"));
            let path = points.collect::<Vec<_>>().join("L");
            let _ = writeln!(svg, "<path class=\"{class} curve\" d=\"M{path}\"/>");
        }
        for (x, y, _) in places.iter().flatten() {
            self.look.mark(svg, (*x, *y));
        }
        if let Some((x, y, _)) = self.ring.and_then(|index| places[index]) {
            let _ = writeln!(svg, "<circle class=\"ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\"/>");
        }
    }

    /// Draws the legend entry.
    fn explain(&self, svg: &mut String, from: f64) {
        let (class, y) = (self.look.class(), ABOVE - 16.0);
        let _ = writeln!(svg, "<path class=\"{class} curve\" d=\"M{from:.1} {y}h30\"/>");
        self.look.mark(svg, (from + 15.0, y));
        text(svg, (from + 37.0, y + 4.0), "", &plain(&self.name));
    }
}

impl Look {
    /// Draws a marker, if the style has one.
    fn mark(self, svg: &mut String, (x, y): (f64, f64)) {
        let _ = match self {
            Self::Discs => writeln!(svg, "<circle class=\"a dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/>"),
            Self::Squares => {
                let (x, y) = (x - 3.5, y - 3.5);
                writeln!(svg, "<rect class=\"b dot\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"7\" height=\"7\"/>")
            }
            Self::Dashed | Self::Dotted => Ok(()),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(values_px: [Option<f64>; 9]) -> Curve {
        Curve { look: Look::Discs, name: "a<b".into(), values_px, ring: None }
    }

    fn drawn(curve: Curve) -> String {
        let mut svg = String::new();
        let scale = Scale::of(std::slice::from_ref(&curve));
        curve.draw(&mut svg, scale);
        svg
    }

    #[test]
    fn a_decade_is_the_same_height_everywhere_and_higher_is_more() {
        let mut values = [None; 9];
        (values[0], values[8]) = (Some(0.0004), Some(0.3));
        let scale = Scale::of(&[curve(values)]);
        assert_eq!((scale.low, scale.high, scale.strip), (-4, 0, 0.0));
        let decade = PLOT / 4.0;
        for value in [0.001, 0.002, 0.03] {
            assert!((scale.y(value) - scale.y(10.0 * value) - decade).abs() < 1e-9, "{value}");
        }
        assert!((scale.y(1.0) - ABOVE).abs() < 1e-9 && (scale.y(1e-4) - ABOVE - PLOT).abs() < 1e-9);
    }

    #[test]
    fn what_was_not_measured_breaks_the_curve_and_a_zero_has_a_mark_without_a_line() {
        let mut values = [Some(0.01); 9];
        assert_eq!(drawn(curve(values)).matches("<path").count(), 1);
        values[3] = None;
        let gap = drawn(curve(values));
        assert_eq!((gap.matches("<path").count(), gap.matches("<circle").count()), (2, 8));
        values[3] = Some(0.0);
        let zero = drawn(curve(values));
        assert_eq!((zero.matches("<path").count(), zero.matches("<circle").count()), (2, 9));
        let low = ABOVE + PLOT - 0.5 * STRIP;
        assert!(zero.contains(&format!("cy=\"{low:.1}\"")), "{zero}");
        let all_zero = drawn(curve([Some(0.0); 9]));
        assert_eq!((all_zero.matches("<path").count(), all_zero.matches("<circle").count()), (0, 9));
    }

    #[test]
    fn names_cannot_break_the_file_and_nothing_measured_is_an_empty_plot() {
        let panel = Panel { title: "t&t".into(), label: "px".into(), curves: vec![curve([None; 9])] };
        let svg = draw(&["x\"".into(), "\u{1}".into(), ">".into()], &[panel]);
        assert!(svg.contains("t&amp;t") && svg.contains("a&lt;b") && svg.contains("x&quot;"));
        assert!(!svg.contains('\u{1}') && !svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(power_of_ten(-3), "0.001");
        assert_eq!((power_of_ten(1), power_of_ten(-7)), ("10".into(), "1e-7".into()));
    }
}
