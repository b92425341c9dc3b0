//! `ricochet init`: asks what a rig consists of and writes its first file.

mod questions;
mod rig_text;

use super::cameras;
use crate::config::{BodyKind, Config, Source};
use crate::console::{Outcome, Overwrite, print_line, write_file};
use crate::failure::Failure;
use questions::{Questions, Unanswered};
use std::path::PathBuf;

/// The options of `ricochet init`. Each answers one question, which is then not asked.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct InitOptions {
    /// Camera: `simulated`, a device file such as /dev/video0, or the address, serial number or name of a GenICam camera.
    #[arg(long, value_name = "ID")]
    pub camera: Option<String>,
    /// Size of the image, as WIDTHxHEIGHT in px.
    #[arg(long, value_name = "SIZE")]
    pub size: Option<String>,
    /// Frame rate, Hz.
    #[arg(long)]
    pub fps: Option<f64>,
    /// Kind of body: ball, rod or patch.
    #[arg(long, value_name = "KIND")]
    pub body: Option<String>,
    /// True diameter of the ball, or width of the rod, mm.
    #[arg(long, value_name = "MM")]
    pub diameter_mm: Option<f64>,
    /// Scale of a rod or patch, mm/px.
    #[arg(long, value_name = "SCALE")]
    pub mm_per_px: Option<f64>,
    /// Direction of the surface in the image, counter-clockwise from level, deg.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub surface_deg: Option<f64>,
    /// Folder of the recordings.
    #[arg(long, value_name = "FOLDER")]
    pub directory: Option<String>,
    /// Take the default for every question that no option answers.
    #[arg(long)]
    pub defaults: bool,
    /// Rig file to write.
    #[arg(short, long, default_value = "rig.toml")]
    pub output: PathBuf,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    pub overwrite: Overwrite,
}

/// The answers.
#[derive(Debug, Clone, PartialEq)]
struct Answers {
    source: Source,
    id: Option<String>,
    /// Width and height of a device's image, px.
    size_px: Option<[u32; 2]>,
    frame_rate_hz: Option<f64>,
    body: BodyKind,
    diameter_mm: Option<f64>,
    mm_per_px: Option<f64>,
    surface_deg: f64,
    directory: Option<String>,
}

/// Asks the questions that no option answers, and writes the rig file.
///
/// # Errors
///
/// An answer outside its range, standard input that ends before the last answer, or an output that exists.
pub fn run(options: &InitOptions) -> Result<Outcome, Failure> {
    options.overwrite.check(&options.output)?;
    let answers = collect_answers(options)?;
    let text = rig_text::rig_text(&answers);
    let name = options.output.display().to_string();
    // Ranges were checked with each answer. This finds answers that contradict each other.
    Config::parse(&text, &name)?;
    write_file(&options.output, &text, options.overwrite)?;
    print_line(&format!("{name} is written. Next: ricochet check {name}, then ricochet run {name}"));
    Ok(Outcome::Clean)
}

/// Asks the questions that no option answers, in the order of the rig file.
fn collect_answers(options: &InitOptions) -> Result<Answers, Failure> {
    let mut questions = Questions::new(if options.defaults { Unanswered::TakeDefault } else { Unanswered::Ask });
    let found = if options.camera.is_none() && !options.defaults { cameras::find_cameras() } else { Vec::new() };
    let camera = questions.ask_camera(options.camera.as_deref(), &found)?;
    let source = source_of(&camera);
    let mut answers = Answers {
        source,
        id: source.is_device().then_some(camera),
        size_px: None,
        frame_rate_hz: None,
        body: BodyKind::Ball,
        diameter_mm: None,
        mm_per_px: None,
        surface_deg: 0.0,
        directory: None,
    };
    if source.is_device() {
        answers.size_px = Some(questions.ask_size(options.size.as_deref())?);
        answers.frame_rate_hz =
            questions.ask_number("camera.frame_rate_hz", "Frame rate, Hz", options.fps, Some(100.0))?;
    }
    answers.body = questions.ask_body(options.body.as_deref())?;
    match answers.body {
        BodyKind::Ball => {
            let question = "True diameter of the ball, mm (nothing: unknown, results in pixels)";
            answers.diameter_mm = questions.ask_number("body.diameter_mm", question, options.diameter_mm, None)?;
        }
        BodyKind::Rod | BodyKind::Patch => {
            let question = "Size of a pixel, mm/px (nothing: unknown, results in pixels)";
            answers.mm_per_px = questions.ask_number("scale.mm_per_px", question, options.mm_per_px, None)?;
        }
    }
    let question = "Direction of the surface in the image, counter-clockwise from level, deg";
    answers.surface_deg =
        questions.ask_number("surface.angle_deg", question, options.surface_deg, Some(0.0))?.unwrap_or_default();
    answers.directory = questions.ask_directory(options.directory.as_deref())?;
    Ok(answers)
}

/// Returns the source of a camera by its name: `simulated`, the name of a V4L2 camera, or else of a GenICam one.
fn source_of(camera: &str) -> Source {
    match camera {
        "simulated" => Source::Simulated,
        camera if crate::camera::v4l2::is_v4l2_id(camera) => Source::V4l2,
        _ => Source::Genicam,
    }
}
