//! Figs. 3 to 6: a bar per pattern and method, with the standard deviation over films.

use std::fmt::Write as _;

use super::films_plan::{SpeckleStudy, Speeds};
use super::log_axis::{self, HEADING, LINE, LogAxis};
use super::methods::Method;
use super::summary::Group;
use crate::study::svg::text;
use crate::synth::PatternSetup;

/// Left margin of a panel, and heights of its plot, title and labels, px.
const LEFT: f64 = 58.0;
const PLOT: f64 = 130.0;
const ABOVE: f64 = 26.0;
const BELOW: f64 = 26.0;

/// Width of a bar, and gap between two patterns, px.
const BAR: f64 = 6.0;
const GAP: f64 = 7.0;

/// Titles of the vertical axes.
const TITLES: [&str; 3] =
    ["mean |error| along x, px/frame", "mean |error| along y, px/frame", "mean |error| of the rotation, deg/frame"];

/// The data of a figure.
pub(super) struct Figure<'a> {
    pub(super) study: SpeckleStudy,
    /// The groups of the case that the figure is about.
    pub(super) groups: &'a [Group],
    pub(super) patterns: &'a [usize],
    pub(super) speeds: &'a [Speeds],
    pub(super) methods: &'a [Method],
    /// The lines of the caption.
    pub(super) caption: &'a [String],
}

/// Returns the errors of the paper's best ball, where its text reports them: px/frame along x and y, deg/frame.
fn best_of_the_paper(study: SpeckleStudy) -> [Option<f64>; 3] {
    match study {
        SpeckleStudy::Translation => [Some(0.02), Some(0.03), Some(0.01)],
        SpeckleStudy::Translation2 => [Some(0.02), Some(0.02), Some(0.005)],
        SpeckleStudy::Rotation => [None, None, Some(0.05)],
        _ => [None; 3],
    }
}

impl Figure<'_> {
    /// Returns the width of a panel's plot.
    fn width(&self) -> f64 {
        (self.patterns.len() as f64 * self.pitch()).max(260.0)
    }

    /// Returns the distance from one pattern to the next.
    fn pitch(&self) -> f64 {
        self.methods.len() as f64 * BAR + GAP
    }

    /// Draws the figure.
    pub(super) fn draw(&self) -> String {
        let top = HEADING + LINE * self.caption.len() as f64 + 34.0;
        let (across, down) = (LEFT + self.width() + 14.0, ABOVE + PLOT + BELOW);
        let size = ((across * self.speeds.len() as f64).max(760.0), top + 3.0 * down);
        let mut svg = log_axis::begin(size, self.study.heading(), self.caption);
        let entries: Vec<(Method, String)> =
            self.methods.iter().map(|method| (*method, method.title().to_owned())).collect();
        log_axis::legend(&mut svg, top - 26.0, &entries);
        for (row, title) in TITLES.iter().enumerate() {
            let axis = self.axis(row);
            for (column, speeds) in self.speeds.iter().enumerate() {
                let corner = (across * column as f64, top + down * row as f64);
                let title = format!("{title}; {} speeds", speeds.as_str());
                text(&mut svg, (corner.0 + 14.0, corner.1 + 14.0), "class=\"title\"", &title);
                self.panel(&mut svg, (corner.0 + LEFT, corner.1 + ABOVE), axis, (row, *speeds));
            }
        }
        svg.push_str("</svg>\n");
        svg
    }

    /// Returns the axis, which both sets of speeds share, and so do x and y.
    fn axis(&self, row: usize) -> LogAxis {
        let rows = if row == 2 { 2..3 } else { 0..2 };
        let paper = best_of_the_paper(self.study);
        let known = rows.clone().filter_map(|row| paper[row]);
        let means = self.groups.iter().flat_map(|group| rows.clone().filter_map(|row| group.errors[row]));
        let ends = means.flat_map(|error| [error.mean, error.mean + error.spread.unwrap_or(0.0)]);
        LogAxis::around(ends.chain(known), PLOT)
    }

    fn panel(&self, svg: &mut String, (left, top): (f64, f64), axis: LogAxis, (row, speeds): (usize, Speeds)) {
        axis.draw(svg, (left, top), self.width());
        if let Some(best) = best_of_the_paper(self.study)[row] {
            let y = top + axis.y(best);
            let _ = writeln!(svg, "<path class=\"level\" d=\"M{left} {y:.1}h{}\"/>", self.width());
        }
        let mut spreads = String::new();
        for (place, method) in self.methods.iter().enumerate() {
            let mut bars = String::new();
            for (number, pattern) in self.patterns.iter().enumerate() {
                let x = left + 0.5 * GAP + number as f64 * self.pitch() + place as f64 * BAR;
                let group = self.groups.iter().find(|g| (g.pattern, g.speeds, g.method) == (*pattern, speeds, *method));
                let Some(error) = group.and_then(|group| group.errors[row]) else {
                    text(svg, (x + 0.5 * BAR, top + PLOT - 2.0), "text-anchor=\"middle\"", "\u{d7}");
                    continue;
                };
                if group.is_some_and(|group| group.missing > 0) {
                    text(svg, (x + 0.5 * BAR, top + 8.0), "text-anchor=\"middle\"", "!");
                }
                let y = axis.y(error.mean);
                let _ = write!(bars, "M{x:.1} {:.1}v{:.1}h{:.1}v{:.1}z", top + PLOT, y - PLOT, BAR - 1.0, PLOT - y);
                if let Some(spread) = error.spread {
                    let (high, low) = (axis.y(error.mean + spread), axis.y((error.mean - spread).max(0.0)));
                    let _ = write!(spreads, "M{:.1} {:.1}v{:.1}", x + 0.5 * (BAR - 1.0), top + high, low - high);
                }
            }
            let _ = writeln!(svg, "<path fill=\"{}\" d=\"{bars}\"/>", log_axis::colour(*method));
        }
        let _ = writeln!(svg, "<path class=\"spread\" d=\"{spreads}\"/>");
        for (number, pattern) in self.patterns.iter().enumerate() {
            let x = left + (number as f64 + 0.5) * self.pitch();
            let name = PatternSetup::PAPER[*pattern].replace('-', "");
            text(svg, (x, top + PLOT + 15.0), "text-anchor=\"middle\"", &name);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::films_plan::Case;
    use super::super::summary::ErrorStatistics;
    use super::*;

    fn group(pattern: usize, method: Method, mean: Option<f64>) -> Group {
        let error = mean.map(|mean| ErrorStatistics { count: 4, mean, spread: Some(0.5 * mean), max: mean, bias: 0.0 });
        let (speeds, case) = (Speeds::Paper, Case::Spin);
        Group { pattern, speeds, case, method, films: 3, pairs: 6, missing: 0, errors: [error; 3] }
    }

    #[test]
    fn a_larger_error_is_a_higher_bar_and_one_that_is_not_known_is_a_cross() {
        let groups = [
            group(0, Method::Paper, Some(0.1)),
            group(0, Method::Rigid, Some(0.001)),
            group(1, Method::Paper, Some(0.01)),
            group(1, Method::Rigid, None),
        ];
        let figure = Figure {
            study: SpeckleStudy::Rotation,
            groups: &groups,
            patterns: &[0, 1],
            speeds: &[Speeds::Paper],
            methods: &[Method::Paper, Method::Rigid],
            caption: &["what was run".to_owned()],
        };
        let svg = figure.draw();
        assert!(svg.contains("what was run") && svg.contains(">aI</text>") && svg.contains(">aII</text>"));
        assert_eq!(svg.matches('\u{d7}').count(), 3, "one in each panel");
        // Panels with bars of the first method: two patterns each; "v-H" is the height of a bar.
        let heights: Vec<f64> = svg
            .lines()
            .filter(|line| line.starts_with("<path fill=\"#d55e00\"") && line.matches('M').count() == 2)
            .flat_map(|line| {
                line.split('v').skip(1).step_by(2).map(|part| part.split('h').next().unwrap().parse().unwrap())
            })
            .collect();
        assert_eq!(heights.len(), 6);
        let decade = PLOT / 4.0;
        assert!(heights.iter().all(|height: &f64| *height < 0.0), "{heights:?}");
        assert!((heights[1] - heights[0] - decade).abs() < 0.2, "a tenth of the error is a decade lower: {heights:?}");
        assert_eq!(svg.matches("class=\"level\"").count(), 1, "the paper has a number for the rotation alone");
    }
}
