//! `ricochet demo`: runs the whole pipeline on a simulated camera and compares the result with the truth.

mod paper_settings;

use super::analyze::last_revisions;
use crate::config::{BodyKind, Config, Scale};
use crate::console::{Outcome, Overwrite, UsageError, print_line, progress, table, write_file};
use crate::failure::Failure;
use crate::interrupt::{self, Interrupted};
use crate::message::Role;
use crate::process::{self, Child, Extras, Stop};
use crate::recording::Recording;
use crate::report::{self, Experiment, Figure, Shot};
use crate::results::{Estimate, Impact};
use paper_settings::Setup;
use std::path::{Path, PathBuf};

/// The built-in experiments: name and rig file.
const BUILT_IN: [(&str, &str); 3] = [
    ("lacrosse", include_str!("../../../config/lacrosse.toml")),
    ("tennis", include_str!("../../../config/tennis.toml")),
    ("rod", include_str!("../../../config/rod.toml")),
];

/// Returns the rig file of a built-in experiment; `None` for an unknown name.
pub(super) fn built_in_config(name: &str) -> Option<&'static str> {
    BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The options of `ricochet demo`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct DemoOptions {
    /// Experiment: lacrosse, tennis or rod.
    #[arg(default_value = "lacrosse")]
    pub experiment: String,
    /// Directory for the recording.
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Number of correlation workers.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub workers: Option<u32>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// The tolerance of a measured number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Tolerance {
    /// A fraction of the true value.
    Share(f64),
    /// A number of frames.
    Frames(f64),
    /// An amount in the column's unit.
    Amount(f64),
    /// Reported without a limit.
    Free,
}

/// A number of an impact that is compared with the truth.
#[derive(Debug, Clone, Copy)]
struct Quantity {
    /// The column of the `impact` table.
    column: &'static str,
    heading: &'static str,
    /// The printed unit, empty for a number without one.
    unit: &'static str,
    /// The factor from the column's unit to the printed one.
    factor: f64,
    tolerance: Tolerance,
}

/// Returns a quantity that is printed in the unit of its column.
const fn quantity(column: &'static str, heading: &'static str, unit: &'static str, tolerance: Tolerance) -> Quantity {
    Quantity { column, heading, unit, factor: 1.0, tolerance }
}

/// Returns a time, which is printed in ms.
const fn time(column: &'static str, heading: &'static str, tolerance: Tolerance) -> Quantity {
    Quantity { column, heading, unit: "ms", factor: 1e3, tolerance }
}

/// The compared numbers of a ball.
const BALL_QUANTITIES: [Quantity; 12] = [
    quantity("vn_before_m_s", "normal speed before", "m/s", Tolerance::Share(0.01)),
    quantity("vn_after_m_s", "normal speed after", "m/s", Tolerance::Share(0.01)),
    quantity("vt_before_m_s", "tangential speed before", "m/s", Tolerance::Share(0.01)),
    quantity("vt_after_m_s", "tangential speed after", "m/s", Tolerance::Share(0.01)),
    quantity("omega_before_rad_s", "spin before", "rad/s", Tolerance::Free),
    quantity("omega_after_rad_s", "spin after", "rad/s", Tolerance::Share(0.05)),
    quantity("restitution", "restitution", "", Tolerance::Share(0.01)),
    time("start_s", "contact starts", Tolerance::Frames(1.0)),
    time("deepest_s", "deepest", Tolerance::Frames(1.0)),
    time("end_s", "contact ends", Tolerance::Frames(1.0)),
    time("contact_time_s", "contact lasts", Tolerance::Frames(2.0)),
    quantity("compression_max_mm", "compressed by", "mm", Tolerance::Free),
];

/// The numbers of a rod, which has no spin and no tangential motion.
const ROD_QUANTITIES: [Quantity; 9] = [
    quantity("vn_before_m_s", "normal speed before", "m/s", Tolerance::Share(0.0015)),
    quantity("vn_after_m_s", "normal speed after", "m/s", Tolerance::Share(0.003)),
    quantity("restitution", "restitution", "", Tolerance::Amount(0.002)),
    time("start_s", "contact starts", Tolerance::Frames(0.5)),
    time("deepest_s", "deepest", Tolerance::Frames(0.1)),
    time("end_s", "contact ends", Tolerance::Frames(0.5)),
    time("contact_time_s", "contact lasts", Tolerance::Frames(1.0)),
    quantity("compression_max_mm", "compressed by", "mm", Tolerance::Free),
    quantity("acceleration_max_m_s2", "acceleration at most", "m/s^2", Tolerance::Free),
];

/// Runs a simulated rig with all its processes and prints the measurement against the truth.
///
/// # Errors
///
/// When the rig cannot run or a measured number is out of tolerance.
pub fn run(options: &DemoOptions, stop: &Stop) -> Result<Outcome, Failure> {
    let config = demo_config(options)?;
    let total = process::truth_world(&config)?.map_or(0, |film| film.frames());
    let bar = progress::bar(total, "measure");
    let tracker = Child::first(Role::Track);
    let summary = process::supervise(&config, stop, Extras::default(), |latest| {
        if let Some(status) = latest.get(&tracker) {
            bar.set_position(status.given.min(total));
        }
    })?;
    bar.finish_and_clear();
    interrupt::allow_end();
    if stop.requested() {
        return Err(Interrupted.into());
    }
    let Some(path) = summary.recordings.last() else {
        return Err(Failure::internal("the rig ended without a recording"));
    };
    let is_rod = config.bodies.iter().all(|body| body.kind == BodyKind::Rod);
    let figures = write_figures(&config, &options.experiment, path)?;
    let agrees =
        print_comparison(path, &figures, if is_rod { &ROD_QUANTITIES } else { &BALL_QUANTITIES }, options.json)?;
    if !agrees {
        return Err(Failure::internal(format!(
            "the measurement is out of tolerance; the recording is {}",
            path.display()
        )));
    }
    Ok(Outcome::from_rig(&summary))
}

/// Returns the rig of the experiment with the options, under a name of its own, as fast as it measures.
///
/// # Errors
///
/// [`UsageError`] for an unknown experiment, and an option that the rig file does not allow.
fn demo_config(options: &DemoOptions) -> Result<Config, Failure> {
    let name = &options.experiment;
    let Some(text) = built_in_config(name) else {
        let known = BUILT_IN.map(|(name, _)| name).join(", ");
        return Err(UsageError(format!("experiment {name:?} is unknown, allowed are {known}")).into());
    };
    let config = Config::parse(text, &format!("{name}.toml"))?;
    let rig = format!("demo-{}", std::process::id());
    let mut changes = vec![("rig.name", rig.into()), ("camera.paced", false.into())];
    if let Some(directory) = &options.output {
        changes.push(("record.directory", directory.display().to_string().into()));
    }
    if let Some(workers) = options.workers {
        changes.push(("workers.count", i64::from(workers).into()));
    }
    Ok(config.with(&changes)?)
}

/// Draws the paper's figures of the experiment next to its recording; returns their paths.
///
/// # Errors
///
/// When the recording cannot be read, the rig has no `scale.mm_per_px`, or a figure exists or cannot be written.
fn write_figures(config: &Config, experiment: &str, path: &Path) -> Result<Vec<PathBuf>, Failure> {
    let recording = Recording::open(path)?;
    let shot = Shot::read(&recording)?;
    let mm_per_px = match config.scale {
        Some(Scale::MmPerPx(mm_per_px)) => mm_per_px,
        _ => {
            return Err(Failure::internal(format!(
                "{}: cannot draw positions: scale.mm_per_px is missing",
                config.origin
            )));
        }
    };
    let surface_angle_deg = config.surface.angle_deg;
    let comparisons = if experiment == "rod" {
        paper_settings::measure_velocities(&recording, &Setup { rod: &config.rod(0), mm_per_px, surface_angle_deg })?
    } else {
        Vec::new()
    };
    let experiment = Experiment { name: experiment, mm_per_px, surface_angle_deg, comparisons: &comparisons };
    let stem = path.file_stem().map_or_else(|| "demo".into(), |stem| stem.to_string_lossy().into_owned());
    let write = |figure: Figure| {
        let file = path.with_file_name(format!("{stem}-{}.svg", figure.name));
        write_file(&file, figure.svg, Overwrite::REFUSED)?;
        Ok(file)
    };
    report::figures(&shot, &experiment).into_iter().map(write).collect()
}

/// Prints the measured numbers next to the true ones; returns whether every number is within tolerance.
///
/// # Errors
///
/// When the recording has not exactly one impact and one true one.
fn print_comparison(path: &Path, figures: &[PathBuf], quantities: &[Quantity], json: bool) -> Result<bool, Failure> {
    let recording = Recording::open(path)?;
    let measured = last_revisions(&recording)?;
    let truths = recording.truth_impacts()?.collect::<Result<Vec<_>, _>>()?;
    let [truth] = &truths[..] else {
        return Err(Failure::internal(format!(
            "{}: expected the truth of one impact, found {}",
            path.display(),
            truths.len()
        )));
    };
    let [measured] = &measured[..] else {
        return Err(Failure::internal(format!("{}: expected one impact, measured {}", path.display(), measured.len())));
    };
    let rate_hz = recording.metadata().get("frame_rate_hz").and_then(|text| text.parse::<f64>().ok());
    let frame_s = 1.0 / rate_hz.unwrap_or(f64::NAN);
    let compared: Vec<Compared> =
        quantities.iter().map(|quantity| Compared::new(quantity, measured, truth, frame_s)).collect();
    if json {
        let rows: Vec<_> = compared.iter().map(Compared::as_json).collect();
        print_line(&serde_json::json!({ "recording": path, "figures": figures, "compared": rows }).to_string());
    } else {
        let header = ["", "measured", "+-", "true", "error", "", ""].map(str::to_owned).to_vec();
        let rows: Vec<_> = std::iter::once(header).chain(compared.iter().map(Compared::as_row)).collect();
        print_line(&table(&rows));
        print_line(&format!("\nrecording: {}", path.display()));
        figures.iter().for_each(|figure| print_line(&format!("figure: {}", figure.display())));
    }
    Ok(compared.iter().all(|compared| compared.within))
}

/// A measured number next to the true one.
struct Compared {
    column: &'static str,
    heading: &'static str,
    unit: &'static str,
    factor: f64,
    measured: Option<Estimate>,
    truth: Option<f64>,
    within: bool,
}

impl Compared {
    /// Compares a number of two impacts with its tolerance; `frame_s` is the duration of a frame, s.
    ///
    /// A number that one of them lacks is within tolerance only if it has no limit.
    fn new(quantity: &Quantity, measured: &Impact, truth: &Impact, frame_s: f64) -> Self {
        let Quantity { column, heading, unit, factor, tolerance } = *quantity;
        let (measured, truth) = (measured.get(column), truth.get(column).map(|estimate| estimate.value));
        let error = measured.zip(truth).map(|(measured, truth)| (measured.value - truth).abs());
        let allowed = truth.map(|truth| match tolerance {
            Tolerance::Share(share) => share * truth.abs(),
            Tolerance::Frames(frames) => frames * frame_s,
            Tolerance::Amount(amount) => amount,
            Tolerance::Free => f64::INFINITY,
        });
        let within = match (error, allowed) {
            (Some(error), Some(allowed)) => error <= allowed,
            _ => tolerance == Tolerance::Free,
        };
        Self { column, heading, unit, factor, measured, truth, within }
    }

    /// Returns the cells of the printed table: heading, measured value, its uncertainty, true value, error, unit, and
    /// `off` if it is out of tolerance.
    fn as_row(&self) -> Vec<String> {
        let number =
            |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{:.4}", value * self.factor));
        let error = self.measured.zip(self.truth).map(|(measured, truth)| measured.value - truth);
        vec![
            self.heading.to_owned(),
            number(self.measured.map(|estimate| estimate.value)),
            number(self.measured.map(|estimate| estimate.sigma)),
            number(self.truth),
            number(error),
            self.unit.to_owned(),
            if self.within { String::new() } else { "off".into() },
        ]
    }

    /// Returns the comparison as JSON.
    fn as_json(&self) -> serde_json::Value {
        serde_json::json!({
            "name": self.column, "measured": self.measured.map(|estimate| estimate.value),
            "sigma": self.measured.map(|estimate| estimate.sigma), "true": self.truth, "within": self.within,
        })
    }
}
