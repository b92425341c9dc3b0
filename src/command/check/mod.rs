//! `ricochet check`: checks whether a rig is ready.

mod defects;
mod displacement;
mod finding;
mod fixed_pattern;
mod grab;
mod light;
mod region;
mod texture;

pub use finding::{Finding, Verdict};

use crate::config::Config;
use crate::console::{Outcome, Overwrite, UsageError, print_line, table, write_file};
use crate::failure::{ExitCode, Failure, Fatal};
use crate::image::FrameMeta;
use crate::interrupt::{self, Interrupted};
use crate::process::{Stop, analysis_params};
use crate::report;
use displacement::NoiseFloor;
use finding::Measurements;
use fixed_pattern::FixedPattern;
use grab::Grabbed;
use region::{Region, Stack};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Findings that are counts, not fractions.
const COUNTS: [&str; 2] = ["lost-frames", "defective-pixels"];
/// Maximum film duration, s.
const MAX_SECONDS: f64 = 600.0;

/// The options of `ricochet check`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct CheckOptions {
    /// Rig file.
    pub config: PathBuf,
    /// The filming time, s.
    #[arg(long, default_value_t = 1.0)]
    pub seconds: f64,
    /// HTML page to write.
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// The rig is not ready.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("rig {rig:?} is not ready: {what}")]
pub struct NotReady {
    /// Name of the rig.
    pub rig: String,
    /// The names of the bad findings.
    pub what: String,
}

impl Fatal for NotReady {
    fn exit_code(&self) -> ExitCode {
        ExitCode::Camera
    }
}

/// Films with the rig's camera, prints the findings, and writes them as a page.
///
/// # Errors
///
/// [`NotReady`] when a finding is bad, and any error of the rig file, the camera or the page.
pub fn run(options: &CheckOptions, stop: &Stop) -> Result<Outcome, Failure> {
    if !(options.seconds > 0.0 && options.seconds <= MAX_SECONDS) {
        return Err(
            UsageError(format!("--seconds {}: must be above 0 and at most {MAX_SECONDS}", options.seconds)).into()
        );
    }
    options.output.as_deref().map_or(Ok(()), |path| options.overwrite.check(path))?;
    let config = Config::load(&options.config)?;
    config.check_sources()?;
    let grabbed = grab::grab(&config, options.seconds, stop)?;
    // The camera is closed, so nothing needs an orderly end any more.
    interrupt::allow_end();
    if stop.requested() {
        return Err(Interrupted.into());
    }
    let floor = displacement::measure_noise_floor(&config, &grabbed)?;
    let inspection = inspect(&config, &grabbed, &floor)?;
    if options.json {
        print_line(&inspection_as_json(&config, &grabbed, &inspection).to_string());
    } else {
        print_findings(&inspection.findings);
    }
    if let Some(output) = &options.output {
        write_file(output, findings_page(&config, &grabbed, &inspection), options.overwrite)?;
        if !options.json {
            print_line(&output.display().to_string());
        }
    }
    let unready = inspection.findings.iter().filter(|finding| finding.is_blocking());
    let what = unready.map(|finding| finding.name).collect::<Vec<_>>().join(", ");
    if !what.is_empty() {
        return Err(NotReady { rig: config.rig.name.clone(), what }.into());
    }
    Ok(Outcome::from_losses(grabbed.lost))
}

/// The findings and the data for the pictures of the page.
struct Inspection {
    findings: Vec<Finding>,
    stack: Stack,
    region: Region,
    /// Column and row of the defective pixels.
    defective_px: Vec<[u32; 2]>,
}

/// Computes the findings from the frames and from the noise floor measured in them. Of a moving scene only the first
/// frame counts.
fn inspect(config: &Config, grabbed: &Grabbed, floor: &NoiseFloor) -> Result<Inspection, Failure> {
    let format = grabbed.format;
    let subset_px = config.correlation.subset_size_px;
    let (width, height) = (format.width_px as usize, format.height_px as usize);
    let region = Region::from_subsets(&floor.first_fields(), subset_px, width, height);
    let correction = analysis_params(config, &format).0.correction(width, height)?;
    let max_frames = if floor.motion.is_some() { 1 } else { usize::MAX };
    let stack = Stack::new(grabbed, max_frames, &correction)?;
    let full_dn = f64::from((1_u32 << format.format.bits()) - 1);
    let levels = texture::measure_levels(&stack, &region, full_dn);
    let noise_dn = levels.noise_dn.unwrap_or(0.0);
    let defective_px = defects::find_defects(grabbed, &correction, noise_dn, full_dn)?;
    let slope = texture::slope_dn_px(&stack, &region, noise_dn);
    let measurements = Measurements {
        config,
        grabbed,
        floor,
        levels,
        speckles: texture::measure_speckles(&stack, &region, noise_dn, subset_px as usize),
        blur_px: texture::edge_blur_px(&stack, &region),
        flicker: light::estimate_flicker(&grabbed.means),
        defective_px: &defective_px,
        fixed_pattern: fixed_pattern::fixed_pattern_dn(&stack, &region, levels.noise_dn, full_dn)
            .map(|dn| FixedPattern { dn, slope_dn_px: slope }),
        // Two noisy images and one sum of squared gradients (Pan et al. 2008, doi:10.1364/OE.16.007037).
        expected_px: (slope > 0.0)
            .then_some(levels.noise_dn)
            .flatten()
            .map(|noise_dn| std::f64::consts::SQRT_2 * noise_dn / (slope * f64::from(subset_px))),
        full_dn,
    };
    let findings = measurements.findings();
    Ok(Inspection { findings, stack, region, defective_px })
}

/// Formats the value of a finding with its unit; a fraction as a percentage, a missing value as `-`.
fn value_text(finding: &Finding) -> String {
    match finding.value {
        None => "-".into(),
        Some(value) if finding.unit == "Hz" => format!("{value:.0} Hz"),
        Some(value) if finding.unit.is_empty() && !COUNTS.contains(&finding.name) => format!("{:.2} %", 100.0 * value),
        Some(value) if finding.unit.is_empty() => format!("{value}"),
        Some(value) if finding.unit == "DN" => format!("{value:.2} DN"),
        Some(value) => format!("{value:.4} {}", finding.unit),
    }
}

/// Returns the findings, the verdict and the defective pixels as JSON.
fn inspection_as_json(config: &Config, grabbed: &Grabbed, inspection: &Inspection) -> Value {
    let findings = &inspection.findings;
    let rows = findings.iter().map(|finding| {
        json!({
            "name": finding.name, "value": finding.value, "unit": finding.unit,
            "verdict": finding.verdict.as_str(), "text": finding.advice,
        })
    });
    json!({
        "rig": config.rig.name, "camera": grabbed.camera.model, "serial": grabbed.camera.serial,
        "frames": grabbed.means.len(), "ready": !findings.iter().any(Finding::is_blocking),
        "findings": rows.collect::<Vec<_>>(), "defective_px": inspection.defective_px,
    })
}

/// Prints the findings as a table with their advice.
fn print_findings(findings: &[Finding]) {
    let cells =
        |finding: &Finding| vec![finding.name.to_owned(), value_text(finding), finding.verdict.as_str().to_owned()];
    let rows: Vec<Vec<String>> = findings.iter().map(cells).collect();
    for (line, finding) in table(&rows).lines().zip(findings) {
        print_line(&format!("{line}  {}", finding.advice));
    }
}

/// Returns the page of the findings, with the first frame, the measured region and the temporal noise.
fn findings_page(config: &Config, grabbed: &Grabbed, inspection: &Inspection) -> String {
    let Inspection { findings, stack, region, .. } = inspection;
    let format = grabbed.format;
    let row = |finding: &Finding| report::CheckRow {
        name: finding.name.replace('-', " "),
        value: value_text(finding),
        verdict: finding.verdict.as_str(),
        advice: finding.advice.clone(),
    };
    let mut pictures = Vec::new();
    if let Some((meta, bytes)) = grabbed.frames.first() {
        let [x0, y0, x1, y1] = region.bounds();
        let whole = [0, 0, format.width_px as usize, format.height_px as usize];
        let picture = |crop, caption: &str| report::CheckPicture {
            meta: *meta,
            bytes: bytes.clone(),
            crop,
            caption: caption.into(),
        };
        pictures.push(picture(whole, "The first frame"));
        pictures.push(picture([x0, y0, x1 - x0, y1 - y0], "Measured region"));
        if !stack.noise.is_empty() {
            let max = stack.noise.iter().fold(f32::MIN_POSITIVE, |max, noise| max.max(*noise));
            let grey = stack.noise.iter().map(|noise| (255.0 * noise / max) as u8).collect();
            let meta = FrameMeta { stride_bytes: meta.width_px, format: crate::image::PixelFormat::Mono8, ..*meta };
            let caption = format!("Temporal noise; white is {max:.1} DN");
            pictures.push(report::CheckPicture { meta, bytes: grey, crop: whole, caption });
        }
    }
    let facts = [
        format!("{} {}", grabbed.camera.model, grabbed.camera.serial),
        format!("{} x {} px, {}", format.width_px, format.height_px, format.format.as_str()),
        format!("{} frames at {} Hz", grabbed.means.len(), format.frame_rate_hz),
    ];
    report::check_page(&config.rig.name, &facts, &findings.iter().map(row).collect::<Vec<_>>(), &pictures)
}
