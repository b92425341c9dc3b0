//! `ricochet study convergence`: convergence of `spline-fft` with the number of spline points between pixels.

mod criterion;
mod figure;
mod image_pairs;
mod output;

use crate::failure::Failure;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::output_files;
use crate::console::{Outcome, Overwrite, UsageError, progress};
use crate::dic::{self, CorrelationParams, Correlator, PreparedFrame, Start};
use crate::results::FieldPoint;
use criterion::{Change, Deviation, Displacements, change, deviation, mean_displacement};
use image_pairs::{Files, Subject};

use crate::command::field::{Roi, Size};

/// The numbers of spline points to try, in this order.
pub const SPLINE_POINTS: [u32; 9] = [0, 1, 2, 3, 5, 7, 10, 14, 20];

/// The interval at which the bar shows the elapsed time.
const TICK: Duration = Duration::from_millis(100);

/// The options of `ricochet study convergence`.
#[derive(Debug, Clone, clap::Args)]
pub struct ConvergenceOptions {
    /// Reference image [default: a rendered pattern].
    #[arg(requires = "target")]
    pub reference: Option<PathBuf>,
    /// Target image.
    pub target: Option<PathBuf>,
    /// Region of interest of the images: x,y,width,height in px.
    #[arg(long = "roi", value_name = "X,Y,W,H", requires = "reference")]
    pub roi_px: Option<Roi>,
    /// Subset size, odd, px.
    #[arg(long = "subset", value_name = "PX", default_value_t = 31)]
    pub subset_size_px: u32,
    /// Grid step between subsets, px.
    #[arg(long = "step", value_name = "PX", default_value_t = 20)]
    pub step_px: u32,
    /// Search range: maximum displacement, px.
    #[arg(long = "search", value_name = "PX", default_value_t = 16)]
    pub search_px: u32,
    /// Converged when 99 % of the displacements change by less than this, px; at most 1.
    #[arg(long, value_name = "PX", default_value_t = 0.001)]
    pub tolerance_px: f64,
    /// Directory for convergence.csv and convergence.svg; created if missing.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

impl ConvergenceOptions {
    /// Returns the images to measure; `None` for the rendered pattern.
    fn files(&self) -> Option<Files<'_>> {
        let (reference, target) = self.reference.as_deref().zip(self.target.as_deref())?;
        Some(Files { reference, target, roi_px: self.roi_px.map(|roi| roi.0) })
    }

    /// Returns the correlation settings of one method.
    fn params(&self, method: Method) -> CorrelationParams {
        let (correlation, spline_points) = match method {
            Method::Spline { spline_points, .. } => (dic::Method::SplineFft, spline_points),
            Method::IcGn => (dic::Method::IcGn, 0),
        };
        CorrelationParams {
            method: correlation,
            spline_points,
            subset_size_px: self.subset_size_px,
            step_px: self.step_px,
            search_px: self.search_px,
            ..CorrelationParams::default()
        }
    }
}

/// A method of the study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Method {
    /// `spline-fft`.
    Spline {
        /// Number of points between two pixels.
        spline_points: u32,
        /// The treatment of the correlation peak.
        peak: Peak,
    },
    /// `ic-gn`, for comparison.
    IcGn,
}

/// The treatment of the highest grid point of a correlation peak.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Peak {
    /// The maximum of a fit around it is the displacement.
    Fitted,
    /// The grid point itself is the displacement.
    Highest,
}

/// The result of one method.
#[derive(Debug, Clone)]
struct Row {
    method: Method,
    /// Number of subsets of all pairs.
    subsets: usize,
    /// Number of subsets with a valid displacement.
    valid: usize,
    /// Change against the previous number of points.
    change: Option<Change>,
    /// Difference from `ic-gn`.
    from_ic_gn: Option<Change>,
    /// Error against the truth, if known.
    error: Option<Deviation>,
    /// Mean displacement of a single pair, px.
    mean_px: Option<[f64; 2]>,
    /// Time of all fields, s.
    time_s: f64,
}

/// Runs the study and prints its table.
///
/// # Errors
///
/// When an option is out of range, a file cannot be read, or the images differ in size.
pub fn run(options: &ConvergenceOptions) -> Result<Outcome, Failure> {
    if !(options.tolerance_px > 0.0 && options.tolerance_px <= 1.0) {
        return Err(
            UsageError(format!("--tolerance-px {}: must be above 0 and at most 1", options.tolerance_px)).into()
        );
    }
    let subject = load_subject(options)?;
    // Prepared before the work, so that a wrong path is reported at once.
    if let Some(directory) = &options.output {
        let inputs: Vec<&Path> =
            options.files().into_iter().flat_map(|files| [files.reference, files.target]).collect();
        output_files::prepare(directory, &[output::TABLE, output::FIGURE], &inputs, options.overwrite)?;
    }
    let methods = methods();
    let rows = measure(options, &subject, &methods)?;
    output::Study { options, rows: &rows }.report()?.publish(options.output.as_deref(), options.overwrite)?;
    Ok(Outcome::Clean)
}

/// Reads the files to measure, or renders the pattern.
///
/// # Errors
///
/// When a setting is out of range, a file cannot be read, or the subsets do not fit.
fn load_subject(options: &ConvergenceOptions) -> Result<Subject, Failure> {
    let params = options.params(Method::IcGn);
    // Planned for any size that has room, so that settings out of range are reported before anything is read or
    // rendered.
    Correlator::new(&params, 1 << 10, 1 << 10)?;
    let subject = match options.files() {
        Some(files) => image_pairs::read(&files, &params)?,
        None => image_pairs::render(&image_pairs::DRAWN_PX, &params)?,
    };
    Ok(subject)
}

/// Returns all methods in the order of the table: `ic-gn` first, since the others are compared with it.
fn methods() -> Vec<Method> {
    let spline = |peak: Peak| SPLINE_POINTS.map(|spline_points| Method::Spline { spline_points, peak });
    [Method::IcGn].into_iter().chain(spline(Peak::Fitted)).chain(spline(Peak::Highest)).collect()
}

/// Returns the relative duration of a method for the progress bar: the transformed area grows with the square of the
/// points.
fn cost(method: Method) -> u64 {
    match method {
        Method::IcGn => 1,
        Method::Spline { spline_points, .. } => 1 + u64::from(spline_points + 1).pow(2),
    }
}

/// Measures the subject with every method and returns a row for each.
///
/// # Errors
///
/// When a setting of a method is out of range.
fn measure(options: &ConvergenceOptions, subject: &Subject, methods: &[Method]) -> Result<Vec<Row>, Failure> {
    let size = subject.size();
    let plan = |method: &Method| Ok((*method, plan(options, *method, size)?));
    let planned = methods.iter().map(plan).collect::<Result<Vec<_>, Failure>>()?;
    let bar = progress::bar(methods.iter().map(|method| cost(*method)).sum(), "study");
    bar.enable_steady_tick(TICK);
    let mut rows = Vec::new();
    measure_methods(planned, subject, |row| {
        bar.inc(cost(row.method));
        rows.push(row);
    });
    bar.finish_and_clear();
    Ok(rows)
}

/// Plans the correlator of a method for frames of this size.
///
/// # Errors
///
/// When a setting is out of range or there is no room for a subset.
fn plan(options: &ConvergenceOptions, method: Method, size: Size) -> Result<Correlator, Failure> {
    let correlator = Correlator::new(&options.params(method), size.width, size.height)?;
    Ok(match method {
        Method::Spline { peak: Peak::Highest, .. } => correlator.without_peak_fit(),
        _ => correlator,
    })
}

/// Measures the subject with every method and passes one row each to `emit`.
fn measure_methods(planned: Vec<(Method, Correlator)>, subject: &Subject, mut emit: impl FnMut(Row)) {
    let truth_px: Option<Vec<_>> = subject.pairs.iter().map(|pair| pair.truth_px).collect();
    let (mut ic_gn, mut before): (Option<Displacements>, Option<(Method, Displacements)>) = (None, None);
    for (method, mut correlator) in planned {
        let TimedDisplacements { displacements, time_s } = correlate_pairs(&mut correlator, subject);
        let follows = before.as_ref().filter(|(earlier, _)| differ_in_points_only(*earlier, method));
        let row = Row {
            method,
            subsets: displacements.len(),
            valid: displacements.iter().flatten().count(),
            change: follows.and_then(|(_, earlier)| change(earlier, &displacements)),
            from_ic_gn: ic_gn.as_ref().and_then(|ic_gn| change(ic_gn, &displacements)),
            error: truth_px.as_ref().and_then(|truth_px| deviation(&displacements, truth_px)),
            mean_px: mean_displacement(&displacements).filter(|_| subject.pairs.len() == 1),
            time_s,
        };
        if method == Method::IcGn {
            ic_gn = Some(displacements);
        } else {
            before = Some((method, displacements));
        }
        emit(row);
    }
}

/// Whether both methods are `spline-fft` with the same treatment of the peak, so that only their points differ.
fn differ_in_points_only(before: Method, method: Method) -> bool {
    matches!((before, method), (Method::Spline { peak: a, .. }, Method::Spline { peak: b, .. }) if a == b)
}

/// The displacements that a method measured, and its cost.
struct TimedDisplacements {
    displacements: Displacements,
    /// The time of the correlation, s, without the preparation of the frames.
    time_s: f64,
}

/// Correlates all pairs in order.
#[expect(clippy::disallowed_methods, reason = "a study of cost reads the clock")]
fn correlate_pairs(correlator: &mut Correlator, subject: &Subject) -> TimedDisplacements {
    let (mut displacements, mut field) = (Displacements::new(), Vec::new());
    let (mut reference, mut target) = (PreparedFrame::default(), PreparedFrame::default());
    let mut time_s = 0.0;
    for pair in &subject.pairs {
        correlator.prepare_into(pair.reference.view(), &mut reference);
        correlator.prepare_into(pair.target.view(), &mut target);
        let began = Instant::now();
        correlator.correlate(&reference, &target, &subject.points, Start::Search, &mut field);
        time_s += began.elapsed().as_secs_f64();
        let displacement =
            |point: &FieldPoint| point.displacement.map(|found| [f64::from(found.u_px), f64::from(found.v_px)]);
        displacements.extend(field.iter().map(displacement));
    }
    TimedDisplacements { displacements, time_s }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> ConvergenceOptions {
        ConvergenceOptions {
            reference: None,
            target: None,
            roi_px: None,
            subset_size_px: 21,
            step_px: 24,
            search_px: 4,
            tolerance_px: 0.001,
            output: None,
            overwrite: Overwrite::REFUSED,
            json: false,
        }
    }

    fn row(options: &ConvergenceOptions, displacement_px: [f64; 2], method: Method) -> Row {
        let subject = image_pairs::render(&[displacement_px], &options.params(Method::IcGn)).unwrap();
        measure(options, &subject, &[method]).unwrap().remove(0)
    }

    #[test]
    fn without_the_peak_fit_a_small_shift_reads_zero_and_with_it_it_is_found() {
        let method = |peak: Peak| Method::Spline { spline_points: 5, peak };
        let highest = row(&options(), [0.06, -0.05], method(Peak::Highest));
        assert_eq!(highest.mean_px, Some([0.0, 0.0]), "every displacement is the grid point 0");
        let fitted = row(&options(), [0.06, -0.05], method(Peak::Fitted));
        let [u, v] = fitted.mean_px.unwrap();
        assert!((u - 0.06).abs() < 0.01 && (v + 0.05).abs() < 0.01, "{u} {v}");
        assert!(fitted.error.unwrap().rms_px < 0.5 * highest.error.unwrap().rms_px);
    }

    #[test]
    fn without_the_peak_fit_displacements_are_multiples_of_the_grid_step() {
        let (options, method) = (options(), Method::Spline { spline_points: 2, peak: Peak::Highest });
        let subject = image_pairs::render(&[[0.56, -0.89]], &options.params(method)).unwrap();
        let mut correlator = plan(&options, method, subject.size()).unwrap();
        let displacements = correlate_pairs(&mut correlator, &subject).displacements;
        assert!(displacements.iter().flatten().count() >= 10);
        for part in displacements.iter().flatten().flatten() {
            assert!((3.0 * part - (3.0 * part).round()).abs() < 1e-5, "{part}");
        }
    }
}
