//! `ricochet simulate`: renders a simulated impact into a recording.

use crate::camera::{CameraIdentity, StreamFormat, simulated};
use crate::config::Config;
use crate::console::{Outcome, Overwrite, UsageError, print_line, progress};
use crate::failure::Failure;
use crate::image::Frame;
use crate::process::recording_info;
use crate::recording::{RecordingWriter, WriterOptions};
use crate::synth::{ScenarioError, SimulatedFilm};
use std::path::PathBuf;

/// The options of `ricochet simulate`.
#[derive(Debug, Clone, PartialEq, Eq, clap::Args)]
pub struct SimulateOptions {
    /// A built-in scenario such as lacrosse, or the path of a scenario file.
    pub scenario: String,
    /// Recording to write.
    #[arg(short, long)]
    pub output: PathBuf,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// Built-in scenarios that differ from a built-in experiment only in their physics.
const VARIANTS: [(&str, &str); 3] =
    [("lacrosse-sphere", "lacrosse"), ("tennis-physical", "tennis"), ("rod-ringing", "rod")];
/// Margin around the path of one of two balls in its search region, px.
const ROOM_PX: f64 = 8.0;

/// Renders every frame of a scenario into a recording, with the ground truth.
///
/// # Errors
///
/// When the scenario is unknown or invalid, or the recording cannot be written.
pub fn run(options: &SimulateOptions) -> Result<Outcome, Failure> {
    let named = |error: ScenarioError| match error {
        ScenarioError::Unreadable { .. } => UsageError(error.to_string()),
        error => UsageError(format!("{}: {error}", options.scenario)),
    };
    let scenario = simulated::load_scenario(&options.scenario).map_err(named)?;
    let film = SimulatedFilm::new(&scenario).map_err(named)?;
    let config = default_config(&film, &options.scenario)?;
    let format = simulated::stream_format(&film);
    let camera = CameraIdentity { model: "simulated".into(), serial: options.scenario.clone() };
    let mut info = recording_info(&config, &format, &camera, "none: simulated");
    // A simulated film must not depend on the host.
    info.metadata.remove("host");
    Overwrite::REFUSED.check(&options.output)?;
    let mut writer = RecordingWriter::create(&options.output, &info, &WriterOptions::default())?;
    for impact in film.impacts() {
        writer.write_truth_impact(&impact)?;
    }
    render_frames(&film, &format, &mut writer)?;
    let finished = writer.finish()?;
    if options.json {
        let summary = serde_json::json!({
            "path": finished.path, "frames": finished.frames, "bytes": finished.bytes,
        });
        print_line(&summary.to_string());
    }
    Ok(Outcome::Clean)
}

/// Renders every frame into the recording, with its true velocities.
fn render_frames(film: &SimulatedFilm, format: &StreamFormat, writer: &mut RecordingWriter) -> Result<(), Failure> {
    let mut bytes = vec![0; format.slot_bytes()];
    let bar = progress::bar(film.frames(), "simulate");
    for index in 0..film.frames() {
        film.render(index, &mut bytes);
        writer.write_frame(&Frame { meta: simulated::meta(film, index), bytes: &bytes })?;
        for row in film.truths(index) {
            writer.write_truth(&row)?;
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(())
}

/// Returns the configuration attached to the recording of the scenario `name`, which is the default for measuring it.
///
/// That of a built-in experiment has its own. Any other gets one with the scale and the bodies of the scenario.
fn default_config(film: &SimulatedFilm, name: &str) -> Result<Config, Failure> {
    let scenario = film.scenario();
    let built_in = format!("{name}.toml");
    if let Some(text) = super::demo::built_in_config(name) {
        return Ok(Config::parse(text, &built_in)?);
    }
    // A variant of a built-in experiment uses the configuration of that experiment.
    let experiment = VARIANTS.iter().find(|(variant, _)| *variant == name);
    if let Some(text) = experiment.and_then(|(_, experiment)| super::demo::built_in_config(experiment)) {
        return Ok(Config::parse(text, &built_in)?.with(&[("camera.scenario", name.into())])?);
    }
    let body = match (&scenario.body.rod, &scenario.other) {
        (Some(_), _) => {
            "\n[[body]]\nkind = \"rod\"\n\n[correlation]\nsubset_size_px = 25\nstep_px = 5\nshape = \"translation\"\n"
                .to_owned()
        }
        (None, Some(_)) => two_ball_tables(film),
        (None, None) => String::new(),
    };
    let text = format!(
        "[rig]\nname = \"simulated\"\n\n[camera]\nsource = \"simulated\"\nscenario = {}\npaced = false\n\n[scale]\nmm_per_px = {:?}\n{body}",
        toml_edit::Value::from(name),
        scenario.scale.mm_per_px,
    );
    Ok(Config::parse(&text, &built_in)?)
}

/// Returns the body tables of two balls, each with a search region around its path.
fn two_ball_tables(film: &SimulatedFilm) -> String {
    let scenario = film.scenario();
    let diameters = [Some(scenario.body.diameter_mm), scenario.other.as_ref().map(|other| other.body.diameter_mm)];
    let table = |(number, diameter_mm): (usize, f64)| {
        let mut span = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for index in 0..film.frames() {
            let Some(truth) = film.truths(index).into_iter().nth(number) else { continue };
            let (Some(x), Some(y), Some(radius)) = (truth.center_x_px, truth.center_y_px, truth.radius_px) else {
                continue;
            };
            for (span, place) in span.iter_mut().zip([x, y]) {
                *span = [span[0].min(place - radius), span[1].max(place + radius)];
            }
        }
        let [x, y] = [(span[0], film.width_px()), (span[1], film.height_px())].map(|([low, high], length)| {
            let length = f64::from(length);
            // A ball that is never visible is searched for in the whole image.
            let first = (low - ROOM_PX).floor().clamp(0.0, length);
            let end = (high + ROOM_PX).ceil().clamp(0.0, length);
            if end - first < 16.0 { [0.0, length] } else { [first, end - first] }
        });
        format!(
            "\n[[body]]\nname = \"ball-{}\"\ndiameter_mm = {diameter_mm:?}\nroi_px = [{}, {}, {}, {}]\n",
            number + 1,
            x[0],
            y[0],
            x[1],
            y[1]
        )
    };
    diameters.into_iter().flatten().enumerate().map(table).collect()
}
