//! The output of a completed speckle study.

use crate::console::Overwrite;
use crate::failure::Failure;
use serde::Serialize;
use serde_json::{Value, json};

use super::bar_figure::Figure;
use super::film::{DIAMETERS_PX, Filming, SIDE_PX};
use super::films_plan::{SpeckleStudy, Speeds};
use super::methods::Method;
use super::summary::{self, EXPLANATION, Group, format_error, summary_cell, translation_error};
use super::{Finished, peak_figure, sweep_figure};
use crate::study::output_files::{Report, Table, cross_table, rounded};
use crate::synth::PatternSetup;

/// The error that the best pattern is chosen by: the mean of x and y, or the rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Measure {
    Translation,
    Rotation,
}

/// The results of one kind of study.
struct Results {
    /// The tables, by the ending of their file name.
    tables: Vec<(&'static str, Table)>,
    figure: String,
    json: Value,
    text: String,
}

impl Finished<'_> {
    /// Writes the tables and the figure, and prints a summary.
    ///
    /// # Errors
    ///
    /// When the film for the timings cannot be rendered, a table cannot be encoded, or a file cannot be written.
    pub(super) fn publish(&self) -> Result<(), Failure> {
        let study = self.job.study;
        let results = match study {
            SpeckleStudy::Peak => self.peak_results()?,
            SpeckleStudy::Noise | SpeckleStudy::Blur | SpeckleStudy::Rate => self.level_results(),
            _ => self.pattern_results(),
        };
        let mut files = vec![(format!("{}.svg", study.as_str()), results.figure.into_bytes())];
        for (ending, table) in &results.tables {
            files.push((format!("{}{ending}.csv", study.as_str()), table.as_csv()?));
        }
        let printed = if self.options.json { self.as_json(results.json).to_string() } else { results.text };
        // The directory is that of this study, and holds the films that it resumes from.
        Report { files, printed }.publish(self.options.output.as_deref(), Overwrite::ALLOWED)
    }

    /// Returns the statistics of each pattern, set of speeds, case and method.
    fn groups(&self) -> Vec<Group> {
        summary::groups(&self.job.films, &self.job.methods, self.rows)
    }

    /// Returns the results of a study over patterns.
    fn pattern_results(&self) -> Results {
        let (study, groups) = (self.job.study, self.groups());
        let table = Table::new(groups.iter().map(Group::cells));
        let shown: Vec<Group> = groups.into_iter().filter(|group| group.case == study.figure_case()).collect();
        let (patterns, speeds, caption) = (self.patterns(), self.speeds(), self.caption(&shown));
        let figure = Figure {
            study,
            groups: &shown,
            patterns: &patterns,
            speeds: &speeds,
            methods: &self.job.methods,
            caption: &caption,
        };
        Results {
            figure: figure.draw(),
            json: json!({ "groups": table.as_json(), "best": self.best(&shown) }),
            text: self.pattern_text(&shown),
            tables: vec![("", table)],
        }
    }

    /// Returns the results of the peak study.
    ///
    /// # Errors
    ///
    /// When the film for the timings cannot be rendered.
    fn peak_results(&self) -> Result<Results, Failure> {
        let points = peak_figure::points(self.job, self.rows);
        let costs = peak_figure::measure_costs(self.job)?;
        let table = Table::new(points.iter().map(peak_figure::Point::cells));
        let time = Table::new(costs.iter().map(peak_figure::Cost::cells));
        Ok(Results {
            figure: peak_figure::draw(self.job, &points, &costs, &self.caption(&self.groups())),
            json: json!({ "speeds": table.as_json(), "time": time.as_json() }),
            text: self.peak_text(&points, &costs),
            tables: vec![("", table), ("_time", time)],
        })
    }

    /// Returns the results of a study over a setting of the camera.
    fn level_results(&self) -> Results {
        let points = sweep_figure::points(self.job, self.rows);
        let table = Table::new(points.iter().map(|point| point.cells(self.job.study)));
        Results {
            figure: sweep_figure::draw(self.job, &points, &self.caption(&self.groups())),
            json: json!({ "levels": table.as_json() }),
            text: format!("{EXPLANATION}\n{}", sweep_figure::printed_table(self.job, &points)),
            tables: vec![("", table)],
        }
    }

    /// Returns the patterns of the films.
    fn patterns(&self) -> Vec<usize> {
        let mut patterns: Vec<usize> = self.job.films.iter().map(|film| film.pattern).collect();
        // The films of a pattern are consecutive.
        patterns.dedup();
        patterns
    }

    /// Returns the sets of speeds of the films.
    fn speeds(&self) -> Vec<Speeds> {
        let has = |speeds: &Speeds| self.job.films.iter().any(|film| film.speeds == *speeds);
        Speeds::ALL.into_iter().filter(has).collect()
    }

    /// Returns the lines of the caption: the settings, an explanation of the figure, and the missing answers of the
    /// `shown` groups.
    fn caption(&self, shown: &[Group]) -> Vec<String> {
        let (job, study) = (self.job, self.job.study);
        let films: Vec<usize> = shown.iter().map(|group| group.films).collect();
        let (patterns, speeds) = (self.patterns(), self.speeds());
        let names: Vec<&str> = patterns.iter().map(|pattern| PatternSetup::PAPER[*pattern]).collect();
        let of = if names.len() > 4 { format!("{} patterns", names.len()) } else { names.join(", ") };
        let windows = job.windows;
        let mut caption = vec![format!(
            "{of}; {} films of {} frames each for every pattern and set of speeds; balls of {} px (a to d) and {} px (e, f)",
            films.first().copied().unwrap_or(0),
            job.filming.frames,
            DIAMETERS_PX[0],
            DIAMETERS_PX[1]
        )];
        caption.push(format!(
            "in {SIDE_PX} x {SIDE_PX} px, rendered without interpolation, {}; the ball's centre is detected, not given.",
            self.camera()
        ));
        let points = "5 points between pixels where windows or peaks are splined";
        caption.push(format!("Windows of {} px, {} px apart; {points}.", windows.subset_size_px, windows.step_px));
        caption.extend(study.explanation().map(str::to_owned));
        let set = |speeds: &Speeds| format!("{}: {}", speeds.as_str(), speeds.describe(study));
        caption.push(speeds.iter().map(set).collect::<Vec<_>>().join("; "));
        let missing: usize = shown.iter().map(|group| group.missing).sum();
        if missing > 0 {
            let pairs: usize = shown.iter().map(|group| group.pairs).sum();
            caption.push(format!("{missing} of {pairs} answers are missing and not counted."));
        }
        caption
    }

    /// Describes the camera of the films.
    fn camera(&self) -> String {
        let Filming { noise_dn, blur_px, .. } = self.job.filming;
        match self.job.study {
            SpeckleStudy::Noise => format!("lens blur {blur_px} px"),
            SpeckleStudy::Blur => format!("noise {noise_dn} of 255 grey levels"),
            _ => format!("noise {noise_dn} of 255 grey levels, lens blur {blur_px} px"),
        }
    }

    /// Returns the best pattern for each set of speeds, method and kind of error.
    fn best(&self, shown: &[Group]) -> Vec<Best> {
        let measures = [Measure::Translation, Measure::Rotation];
        let of = |speeds: Speeds, method: Method| {
            measures.into_iter().filter_map(move |of| best_pattern(shown, speeds, method, of))
        };
        let sets = self.speeds();
        sets.iter().flat_map(|speeds| self.job.methods.iter().flat_map(move |method| of(*speeds, *method))).collect()
    }

    /// Returns the methods with their names.
    fn methods(&self) -> Vec<(String, Method)> {
        self.job.methods.iter().map(|method| (method.as_str().to_owned(), *method)).collect()
    }

    /// Formats the errors of every pattern and the best patterns for the terminal.
    fn pattern_text(&self, shown: &[Group]) -> String {
        let pattern = |pattern: usize| (PatternSetup::PAPER[pattern].to_owned(), pattern);
        let patterns: Vec<_> = self.patterns().into_iter().map(pattern).collect();
        let (sets, methods) = (self.speeds(), self.methods());
        let series = |speeds: &Speeds| {
            let speeds = *speeds;
            self.job
                .methods
                .iter()
                .map(move |method| (format!("{} {}", speeds.as_str(), method.as_str()), (speeds, *method)))
        };
        let errors = cross_table(
            "pattern",
            &patterns,
            &sets.iter().flat_map(series).collect::<Vec<_>>(),
            |pattern, (speeds, method)| {
                let of = |group: &&Group| (group.pattern, group.speeds, group.method) == (*pattern, *speeds, *method);
                let group = shown.iter().find(of);
                group.map_or_else(|| "-".to_owned(), |group| summary_cell(&group.errors, group.missing))
            },
        );
        let found = self.best(shown);
        let measures = |speeds: &Speeds| {
            let speeds = speeds.as_str();
            let titles = [("px/frame", Measure::Translation), ("deg/frame", Measure::Rotation)];
            titles.map(|(unit, measure)| (format!("{speeds} {unit}"), (speeds, measure.as_str())))
        };
        let best = cross_table(
            "best pattern",
            &methods,
            &sets.iter().flat_map(measures).collect::<Vec<_>>(),
            |method, (speeds, measure)| {
                let best = found.iter().find(|b| (b.speeds, b.of, b.method) == (*speeds, *measure, method.as_str()));
                best.map_or_else(|| "-".to_owned(), |best| format!("{:.5} {}", best.mean, best.pattern))
            },
        );
        format!("{EXPLANATION}\n{errors}\n\n{best}")
    }

    /// Formats the errors at every speed and the cost of the methods for the terminal.
    fn peak_text(&self, points: &[peak_figure::Point], costs: &[peak_figure::Cost]) -> String {
        let methods = self.methods();
        let mut text = String::new();
        for speeds in self.speeds() {
            let of = |point: &&peak_figure::Point| point.speeds == speeds;
            let step = |point: &peak_figure::Point| (format!("{:.3}", point.speed_px_frame), point.speed_px_frame);
            let mut steps: Vec<_> = points.iter().filter(of).map(step).collect();
            steps.truncate(steps.len() / methods.len());
            let table = cross_table("px/frame", &steps, &methods, |step, method| {
                let is_here = |point: &&peak_figure::Point| {
                    of(point) && point.method == *method && (point.speed_px_frame - step).abs() < 1e-9
                };
                format_error(points.iter().find(is_here).and_then(|point| point.error).map(|error| error.mean))
            });
            text += &format!("mean absolute error along x, px/frame; {} speeds\n{table}\n", speeds.as_str());
        }
        let times = costs.iter().map(|cost| format!("{} {:.1}", cost.method, cost.us_per_window));
        text + &format!("us per window, one thread: {}", times.collect::<Vec<_>>().join(", "))
    }

    /// Returns the settings and the results as one JSON object.
    fn as_json(&self, results: Value) -> Value {
        let mut report = super::settings(self.job);
        if let (Some(report), Value::Object(results)) = (report.as_object_mut(), results) {
            report.extend(results);
        }
        report
    }
}

impl Measure {
    fn as_str(self) -> &'static str {
        match self {
            Self::Translation => "px_frame",
            Self::Rotation => "deg_frame",
        }
    }

    /// Returns the mean absolute error of a group by this measure, px/frame or deg/frame; `None` if it is missing.
    fn error_of(self, group: &Group) -> Option<f64> {
        match self {
            Self::Translation => translation_error(&group.errors),
            Self::Rotation => group.errors[2].map(|error| error.mean),
        }
    }
}

/// The best pattern of a method.
#[derive(Debug, Serialize)]
struct Best {
    speeds: &'static str,
    method: &'static str,
    /// The kind of error.
    of: &'static str,
    pattern: &'static str,
    /// Mean absolute error, px/frame or deg/frame.
    mean: f64,
}

/// Returns the pattern with the smallest mean error of a set of speeds and a method; `None` if each has missing
/// answers.
fn best_pattern(groups: &[Group], speeds: Speeds, method: Method, measure: Measure) -> Option<Best> {
    let whole = groups.iter().filter(|group| (group.speeds, group.method, group.missing) == (speeds, method, 0));
    let (group, mean) =
        whole.filter_map(|group| Some((group, measure.error_of(group)?))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    let pattern = PatternSetup::PAPER[group.pattern];
    Some(Best { speeds: speeds.as_str(), method: method.as_str(), of: measure.as_str(), pattern, mean: rounded(mean) })
}
