//! Figs. 3 to 6: a bar per pattern and method, with the standard deviation over films.

use std::fmt::Write as _;

use super::films_plan::{SpeckleStudy, Speeds};
use super::method_style::{self, LEGEND};
use super::methods::Method;
use super::summary::Group;
use crate::plot::{self, LogAxis, PlotArea, px};
use crate::synth::PatternSetup;
use maud::{Markup, html};

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

    /// Returns the text of the SVG file: a column of panels per set of speeds, and a row per error.
    pub(super) fn draw(&self) -> String {
        let figure = plot::Figure { heading: self.study.heading(), caption: self.caption };
        let top = figure.content_top() + LEGEND;
        let (across, down) = (LEFT + self.width() + 14.0, ABOVE + PLOT + BELOW);
        let content = html! {
            (method_style::legend(figure.content_top() + 8.0, self.methods))
            @for (row, title) in TITLES.iter().enumerate() {
                @for (column, speeds) in self.speeds.iter().enumerate() {
                    @let (left, top) = (across * column as f64, top + down * row as f64);
                    text class="title" x=(px(left + 14.0)) y=(px(top + 14.0)) { (title) "; " (speeds.as_str()) " speeds" }
                    (self.panel(row, *speeds, PlotArea { left: left + LEFT, top: top + ABOVE, width: self.width() }))
                }
            }
        };
        figure.draw((across * self.speeds.len() as f64).max(760.0), top + 3.0 * down, &content)
    }

    /// Returns the vertical axis of a row of panels: 0 is x, 1 is y, 2 the rotation.
    ///
    /// Both sets of speeds share it, and so do x and y.
    fn axis(&self, row: usize) -> LogAxis {
        let rows = if row == 2 { 2..3 } else { 0..2 };
        let paper = best_of_the_paper(self.study);
        let known = rows.clone().filter_map(|row| paper[row]);
        let means = self.groups.iter().flat_map(|group| rows.clone().filter_map(|row| group.errors[row]));
        let ends = means.flat_map(|error| [error.mean, error.mean + error.spread.unwrap_or(0.0)]);
        LogAxis::around(ends.chain(known), PLOT, 0.0)
    }

    /// Draws the panel of one error (`row` 0 is x, 1 is y, 2 the rotation) and one set of speeds.
    fn panel(&self, row: usize, speeds: Speeds, plot: PlotArea) -> Markup {
        let PlotArea { left, top, width } = plot;
        let axis = self.axis(row);
        html! {
            (axis.draw(plot))
            @if let Some(best) = best_of_the_paper(self.study)[row] {
                path class="level" d={ "M" (left) " " (px(top + axis.y(best))) "h" (width) } {}
            }
            @for (place, method) in self.methods.iter().enumerate() {
                @let bars = self.bars(place, row, speeds, plot);
                path fill=(method_style::style(*method).color) d=(bars.bars) {}
                path class="spread" d=(bars.spreads) {}
                @for (x, y, sign) in &bars.signs { text class="tick" x=(px(*x)) y=(px(*y)) text-anchor="middle" { (sign) } }
            }
            @for (number, pattern) in self.patterns.iter().enumerate() {
                @let x = left + (number as f64 + 0.5) * self.pitch();
                text class="tick" x=(px(x)) y=(px(top + PLOT + 15.0)) text-anchor="middle" {
                    (PatternSetup::PAPER[*pattern].replace('-', ""))
                }
            }
        }
    }

    /// Returns the bars of the method at `place` in the list, for the error of a `row` of panels and one set of speeds.
    ///
    /// A cross stands for a missing bar, and an exclamation mark for missing answers.
    fn bars(&self, place: usize, row: usize, speeds: Speeds, plot: PlotArea) -> Bars {
        let (method, axis) = (self.methods[place], self.axis(row));
        let mut drawn = Bars::default();
        for (number, pattern) in self.patterns.iter().enumerate() {
            let x = plot.left + 0.5 * GAP + number as f64 * self.pitch() + place as f64 * BAR;
            let group = self.groups.iter().find(|g| (g.pattern, g.speeds, g.method) == (*pattern, speeds, method));
            let Some(error) = group.and_then(|group| group.errors[row]) else {
                drawn.signs.push((x + 0.5 * BAR, plot.top + PLOT - 2.0, '\u{d7}'));
                continue;
            };
            if group.is_some_and(|group| group.missing > 0) {
                drawn.signs.push((x + 0.5 * BAR, plot.top + 8.0, '!'));
            }
            let (foot, y) = (plot.top + PLOT, axis.y(error.mean));
            let _ = write!(drawn.bars, "M{x:.1} {foot:.1}v{:.1}h{:.1}v{:.1}z", y - PLOT, BAR - 1.0, PLOT - y);
            if let Some(spread) = error.spread {
                let (high, low) = (axis.y(error.mean + spread), axis.y((error.mean - spread).max(0.0)));
                let middle = x + 0.5 * (BAR - 1.0);
                let _ = write!(drawn.spreads, "M{middle:.1} {:.1}v{:.1}", plot.top + high, low - high);
            }
        }
        drawn
    }
}

/// The bars of one method in a panel.
#[derive(Default)]
struct Bars {
    /// The path of the bars, and of their standard deviations.
    bars: String,
    spreads: String,
    /// Signs for missing values, with their places, px.
    signs: Vec<(f64, f64, char)>,
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
            .split('<')
            .filter(|tag| tag.starts_with("path fill=\"#d55e00\""))
            .flat_map(|tag| {
                tag.split('v').skip(1).step_by(2).map(|part| part.split('h').next().unwrap().parse().unwrap())
            })
            .collect();
        assert_eq!(heights.len(), 6);
        let decade = PLOT / 4.0;
        assert!(heights.iter().all(|height: &f64| *height < 0.0), "{heights:?}");
        assert!((heights[1] - heights[0] - decade).abs() < 0.2, "a tenth of the error is a decade lower: {heights:?}");
        assert_eq!(svg.matches("class=\"level\"").count(), 1, "the paper has a number for the rotation alone");
    }
}
