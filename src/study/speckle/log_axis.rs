//! Logarithmic axes, colours and captions shared by the figures of the speckle studies.

use std::fmt::Write as _;

use super::methods::Method;
use crate::study::svg::{plain, power_of_ten, text};

/// Height of the heading and of a caption line, px.
pub(super) const HEADING: f64 = 34.0;
pub(super) const LINE: f64 = 17.0;

/// The style sheet.
const STYLE: &str = "text{font:12px system-ui,sans-serif;fill:#222}.head{font-size:17px;font-weight:600}\
    .title{font-weight:600}.small{fill:#555}.grid{stroke:#ddd}.axis{stroke:#222;fill:none}\
    .spread{stroke:#222;stroke-width:1;fill:none}.level{stroke:#222;stroke-dasharray:5 4;fill:none}\
    .curve{stroke-width:2;fill:none}";

/// Returns the colour of a method; the palette suits the colour-blind (M. Okabe, K. Ito, 2008).
pub(super) fn colour(method: Method) -> &'static str {
    match method {
        Method::Paper => "#d55e00",
        Method::PaperFit => "#e69f00",
        Method::PeakSpline => "#009e73",
        Method::PeakPlain => "#cc79a7",
        Method::IcGn => "#56b4e9",
        Method::Ring => "#f0e442",
        Method::Rigid => "#0072b2",
    }
}

/// A vertical logarithmic axis of whole decades.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LogAxis {
    low: i32,
    high: i32,
    height: f64,
}

impl LogAxis {
    /// Returns an axis of whole decades around all positive values.
    pub(super) fn around(values: impl Iterator<Item = f64>, height: f64) -> Self {
        let logs = values.filter(|value| *value > 0.0).map(f64::log10);
        let (low, high) =
            logs.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), log| (low.min(log), high.max(log)));
        if low > high {
            return Self { low: -3, high: 0, height };
        }
        let (low, high) = ((low - 0.1).floor() as i32, (high + 0.02).ceil() as i32);
        Self { low, high: high.max(low + 1), height }
    }

    /// Returns the distance from the top, px; values below the axis, such as 0, lie at its foot.
    pub(super) fn y(self, value: f64) -> f64 {
        let share = (f64::from(self.high) - value.max(f64::MIN_POSITIVE).log10()) / f64::from(self.high - self.low);
        self.height * share.clamp(0.0, 1.0)
    }

    /// Draws grid lines, labels and frame from (`left`, `top`) on.
    pub(super) fn draw(self, svg: &mut String, (left, top): (f64, f64), width: f64) {
        for power in self.low..=self.high {
            let y = top + self.y(10_f64.powi(power));
            let _ = writeln!(svg, "<path class=\"grid\" d=\"M{left} {y:.1}h{width}\"/>");
            text(svg, (left - 6.0, y + 4.0), "text-anchor=\"end\"", &power_of_ten(power));
        }
        let _ = writeln!(svg, "<path class=\"axis\" d=\"M{left} {top}v{}h{width}\"/>", self.height);
    }
}

/// Draws a marker of a curve, hollow if answers are missing.
pub(super) fn mark(svg: &mut String, method: Method, (x, y): (f64, f64), missing: usize) {
    let (colour, inside) = (colour(method), if missing > 0 { "#fff" } else { colour(method) });
    let _ = writeln!(svg, "<circle fill=\"{inside}\" stroke=\"{colour}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"/>");
}

/// Starts a figure with its heading and caption.
pub(super) fn begin((width, height): (f64, f64), heading: &str, caption: &[String]) -> String {
    let heading = plain(heading);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{heading}\">\n<style>{STYLE}</style>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    text(&mut svg, (14.0, 24.0), "class=\"head\"", &heading);
    for (number, line) in caption.iter().enumerate() {
        text(&mut svg, (14.0, HEADING + LINE * (number as f64 + 0.6)), "class=\"small\"", &plain(line));
    }
    svg
}

/// Draws a legend line: a colour and a label per method.
pub(super) fn legend(svg: &mut String, y: f64, entries: &[(Method, String)]) {
    let mut x = 14.0;
    for (method, label) in entries {
        let _ = writeln!(svg, "<path fill=\"{}\" d=\"M{x:.0} {y:.0}h12v12h-12z\"/>", colour(*method));
        text(svg, (x + 17.0, y + 10.0), "", &plain(label));
        x += 36.0 + 6.2 * label.chars().count() as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_are_equally_high_and_what_is_below_lies_on_the_foot() {
        let axis = LogAxis::around([0.004, 0.7, 0.0].into_iter(), 120.0);
        assert_eq!((axis.low, axis.high), (-3, 0));
        assert!((axis.y(0.01) - axis.y(0.1) - 40.0).abs() < 1e-9);
        assert!((axis.y(0.002) - axis.y(0.02) - 40.0).abs() < 1e-9);
        assert!((axis.y(0.0) - 120.0).abs() < 1e-9 && (axis.y(1e-9) - 120.0).abs() < 1e-9);
        assert!(axis.y(1.0).abs() < 1e-9);
        let empty = LogAxis::around([].into_iter(), 120.0);
        assert_eq!((empty.low, empty.high), (-3, 0));
    }
}
