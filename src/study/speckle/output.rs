//! The output of a completed speckle study.

use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};

use super::bar_figure::Figure;
use super::film::{DIAMETERS_PX, Filming, SIDE_PX};
use super::films_plan::{SpeckleStudy, Speeds};
use super::methods::Way;
use super::summary::{self, Group};
use super::{Finished, peak_figure, sweep_figure};
use crate::command::field::FieldError;
use crate::console::{say, table};
use crate::failure::Failure;
use crate::synth::PatternSetup;

/// The error that the best pattern is chosen by: the mean of x and y, or the rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Measure {
    Translation,
    Rotation,
}

impl Finished<'_> {
    /// Writes the tables and the figure, and prints a summary.
    pub(super) fn publish(&self) -> Result<(), Failure> {
        match self.job.study {
            SpeckleStudy::Peak => self.publish_peak(),
            SpeckleStudy::Noise | SpeckleStudy::Blur | SpeckleStudy::Rate => self.publish_sweep(),
            _ => self.publish_patterns(),
        }
    }

    fn publish_patterns(&self) -> Result<(), Failure> {
        let groups = summary::groups(&self.job.films, &self.job.ways, self.rows);
        let lines: Vec<summary::Line> = groups.iter().map(Group::line).collect();
        let shown: Vec<Group> = groups.iter().filter(|group| group.case == self.job.study.figure()).cloned().collect();
        if let Some(directory) = &self.options.output {
            let (patterns, speeds, caption) = (self.patterns(), self.speeds(), self.caption(&shown));
            let (study, ways, groups) = (self.job.study, &self.job.ways[..], &shown[..]);
            let figure = Figure { study, groups, patterns: &patterns, speeds: &speeds, ways, caption: &caption }.draw();
            self.write_table(directory, "", &lines)?;
            self.write(directory, ".svg", figure.as_bytes())?;
        }
        if self.options.json {
            self.print_json(json!({ "groups": lines, "best": self.best(&shown) }));
        } else {
            self.print_patterns(&shown);
        }
        Ok(())
    }

    fn publish_peak(&self) -> Result<(), Failure> {
        let points = peak_figure::points(self.job, self.rows);
        let costs = peak_figure::costs(self.job)?;
        let lines: Vec<peak_figure::Line> = points.iter().map(peak_figure::Point::line).collect();
        if let Some(directory) = &self.options.output {
            let groups = summary::groups(&self.job.films, &self.job.ways, self.rows);
            let figure = peak_figure::draw(self.job, &points, &costs, &self.caption(&groups));
            self.write_table(directory, "", &lines)?;
            self.write_table(directory, "_time", &costs)?;
            self.write(directory, ".svg", figure.as_bytes())?;
        }
        if self.options.json {
            self.print_json(json!({ "speeds": lines, "time": costs }));
        } else {
            self.print_peak(&points, &costs);
        }
        Ok(())
    }

    fn publish_sweep(&self) -> Result<(), Failure> {
        let points = sweep_figure::points(self.job, self.rows);
        let lines: Vec<sweep_figure::Line> = points.iter().map(|point| point.line(self.job.study)).collect();
        if let Some(directory) = &self.options.output {
            let groups = summary::groups(&self.job.films, &self.job.ways, self.rows);
            self.write_table(directory, "", &lines)?;
            self.write(directory, ".svg", sweep_figure::draw(self.job, &points, &self.caption(&groups)).as_bytes())?;
        }
        if self.options.json {
            self.print_json(json!({ "levels": lines }));
        } else {
            say(sweep_figure::READING);
            say(&table(&sweep_figure::cells(self.job, &points)));
        }
        Ok(())
    }

    fn patterns(&self) -> Vec<usize> {
        let mut patterns: Vec<usize> = self.job.films.iter().map(|film| film.pattern).collect();
        // The films of a pattern are consecutive.
        patterns.dedup();
        patterns
    }

    fn speeds(&self) -> Vec<Speeds> {
        let has = |speeds: &Speeds| self.job.films.iter().any(|film| film.speeds == *speeds);
        Speeds::ALL.into_iter().filter(has).collect()
    }

    /// Returns the caption: the settings, and an explanation of the figure.
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
        caption.extend(study.reading().map(str::to_owned));
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

    /// Returns the best pattern for each set of speeds and method.
    fn best(&self, shown: &[Group]) -> Vec<Best> {
        let measures = [Measure::Translation, Measure::Rotation];
        let of = |speeds: Speeds, way: Way| measures.into_iter().filter_map(move |of| best(shown, speeds, way, of));
        let sets = self.speeds();
        sets.iter().flat_map(|speeds| self.job.ways.iter().flat_map(move |way| of(*speeds, *way))).collect()
    }

    fn print_patterns(&self, shown: &[Group]) {
        let mut head = vec!["pattern".to_owned()];
        for speeds in self.speeds() {
            head.extend(self.job.ways.iter().map(|way| format!("{} {}", speeds.as_str(), way.as_str())));
        }
        let mut lines = vec![head];
        for pattern in self.patterns() {
            let mut line = vec![PatternSetup::PAPER[pattern].to_owned()];
            for speeds in self.speeds() {
                for way in &self.job.ways {
                    let of = |group: &&Group| (group.pattern, group.speeds, group.way) == (pattern, speeds, *way);
                    let cell = shown.iter().find(of).map_or_else(|| "-".to_owned(), cell);
                    line.push(cell);
                }
            }
            lines.push(line);
        }
        say("mean absolute error: px/frame (mean of x and y) / deg/frame; ! where answers are missing");
        say(&table(&lines));
        let sets = self.speeds();
        let head = sets.iter().flat_map(|s| [format!("{} px/frame", s.as_str()), format!("{} deg/frame", s.as_str())]);
        let mut lines = vec![["best pattern".to_owned()].into_iter().chain(head).collect::<Vec<_>>()];
        let found = self.best(shown);
        for way in &self.job.ways {
            let mut line = vec![way.as_str().to_owned()];
            for (speeds, of) in sets.iter().flat_map(|s| [(s, Measure::Translation), (s, Measure::Rotation)]) {
                let best =
                    found.iter().find(|b| (b.speeds, b.of, b.method) == (speeds.as_str(), of.as_str(), way.as_str()));
                line.push(best.map_or_else(|| "-".to_owned(), |b| format!("{:.5} {}", b.mean, b.pattern)));
            }
            lines.push(line);
        }
        say(&format!("\n{}", table(&lines)));
    }

    fn print_peak(&self, points: &[peak_figure::Point], costs: &[peak_figure::Cost]) {
        for speeds in self.speeds() {
            let head =
                ["px/frame".to_owned()].into_iter().chain(self.job.ways.iter().map(|way| way.as_str().to_owned()));
            let mut lines = vec![head.collect::<Vec<_>>()];
            let of = |point: &&peak_figure::Point| point.speeds == speeds;
            let mut steps: Vec<f64> = points.iter().filter(of).map(|point| point.speed_px_frame).collect();
            steps.truncate(steps.len() / self.job.ways.len());
            for step in &steps {
                let mut line = vec![format!("{step:.3}")];
                let here = |point: &&peak_figure::Point| of(point) && (point.speed_px_frame - step).abs() < 1e-9;
                line.extend(points.iter().filter(here).map(|point| px(point.error.map(|error| error.mean))));
                lines.push(line);
            }
            say(&format!("mean absolute error along x, px/frame; {} speeds", speeds.as_str()));
            say(&table(&lines));
        }
        let times = costs.iter().map(|cost| format!("{} {:.1}", cost.method, cost.us_per_window));
        say(&format!("us per window, one thread: {}", times.collect::<Vec<_>>().join(", ")));
    }

    /// Prints the settings and the results as one JSON object.
    fn print_json(&self, found: Value) {
        let mut report = super::settings(self.job);
        if let (Some(report), Value::Object(found)) = (report.as_object_mut(), found) {
            report.extend(found);
        }
        say(&report.to_string());
    }

    fn write_table(&self, directory: &Path, ending: &str, lines: &[impl Serialize]) -> Result<(), Failure> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        lines.iter().try_for_each(|line| csv.serialize(line))?;
        let bytes = csv.into_inner().map_err(|error| Failure::internal(format!("{error}")))?;
        self.write(directory, &format!("{ending}.csv"), &bytes)
    }

    fn write(&self, directory: &Path, ending: &str, bytes: &[u8]) -> Result<(), Failure> {
        let path = directory.join(format!("{}{ending}", self.job.study.as_str()));
        Ok(std::fs::write(&path, bytes).map_err(|error| FieldError::write(&path, error))?)
    }
}

impl Measure {
    fn as_str(self) -> &'static str {
        match self {
            Self::Translation => "px_frame",
            Self::Rotation => "deg_frame",
        }
    }

    fn of(self, group: &Group) -> Option<f64> {
        let [x, y, turn] = group.errors.map(|error| error.map(|error| error.mean));
        match self {
            Self::Translation => x.zip(y).map(|(x, y)| 0.5 * (x + y)),
            Self::Rotation => turn,
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

/// Returns the group with the smallest mean error among those without missing answers.
fn best(groups: &[Group], speeds: Speeds, way: Way, of: Measure) -> Option<Best> {
    let whole = groups.iter().filter(|group| (group.speeds, group.way, group.missing) == (speeds, way, 0));
    let (group, mean) = whole.filter_map(|group| Some((group, of.of(group)?))).min_by(|a, b| a.1.total_cmp(&b.1))?;
    let pattern = PatternSetup::PAPER[group.pattern];
    Some(Best { speeds: speeds.as_str(), method: way.as_str(), of: of.as_str(), pattern, mean: round(mean) })
}

fn cell(group: &Group) -> String {
    let (px, deg) = (px(Measure::Translation.of(group)), px(Measure::Rotation.of(group)));
    format!("{px} / {deg}{}", if group.missing > 0 { "!" } else { "" })
}

fn px(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"))
}

fn round(value: f64) -> f64 {
    (value * 1e7).round() / 1e7
}
