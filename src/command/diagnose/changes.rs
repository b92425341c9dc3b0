//! The changes of the rig file that would help.

use super::evidence::Evidence;
use crate::command::body_summary::{BodySummary, Key};
use crate::command::film_survey::Surveyed;
use crate::config::{BodyKind, Config};
use crate::report::Change;
use crate::results::PointStatus;
use crate::survey::Identified;

/// The range of radii to search, relative to the one found.
const RADIUS_RANGE: [f64; 2] = [0.8, 1.25];
/// The share of white pixels from which a body is overexposed.
const MAX_WHITE: f64 = 0.05;

/// Returns the change that the evidence advises for the most frequent reason, or else all keys that change that reason.
///
/// It is empty if the body was measured in every frame.
pub(super) fn advise_changes(
    summary: &BodySummary,
    evidence: &[Evidence],
    config: &Config,
    body: usize,
    surveyed: &Surveyed,
) -> Vec<Change> {
    let Some(status) = summary.frequent_status() else { return Vec::new() };
    let refused: Vec<&Evidence> = evidence.iter().filter(|evidence| evidence.choice.status == status).collect();
    let found = match (status, config.bodies[body].kind) {
        (PointStatus::Lost, BodyKind::Ball) => advise_ball_search(&refused, config, body, surveyed),
        (PointStatus::LowCorrelation, _) => advise_search_range(config, surveyed),
        _ => advise_subset_size(&refused, config).or_else(|| advise_exposure(&refused)),
    };
    found.map_or_else(|| general_advice(summary), |change| vec![change])
}

/// Advises the radii or the region that include a ball outside of the search, or names what moves instead of a ball.
///
/// `None` if the ball is within both, or nothing can be said about what moves.
fn advise_ball_search(refused: &[&Evidence], config: &Config, body: usize, surveyed: &Surveyed) -> Option<Change> {
    let [width, height] = surveyed.size_px.map(|size| size as u32);
    let search = config.ball(body, width, height);
    let moving = surveyed.bodies.iter().find_map(|body| body.kind.ball_radius_px());
    let outside = refused.iter().find_map(|evidence| evidence.searched.outside);
    if let Some(radius_px) = moving.or(outside.map(|circle| circle.radius_px)) {
        let (low, high) = ((RADIUS_RANGE[0] * radius_px).floor().max(6.0), (RADIUS_RANGE[1] * radius_px).ceil());
        if !(search.min_radius_px..=search.max_radius_px).contains(&radius_px) {
            let from = format!("{:.1} to {:.1} px", search.min_radius_px, search.max_radius_px);
            return Some(Change {
                lines: format!("min_radius_px = {low}\nmax_radius_px = {high}"),
                reason: format!("The ball has a radius of {radius_px:.1} px; searched were {from}."),
            });
        }
        let is_beyond = |[x, y, w, h]: [u32; 4]| {
            outside.is_some_and(|circle| {
                !(f64::from(x)..f64::from(x + w)).contains(&circle.x_px)
                    || !(f64::from(y)..f64::from(y + h)).contains(&circle.y_px)
            })
        };
        if let (Some(roi), Some(circle)) = (search.roi_px.filter(|roi| is_beyond(*roi)), outside) {
            let bounds = surveyed.bodies.iter().find(|body| body.kind.ball_radius_px().is_some());
            let wider = bounds.map_or_else(
                || "# roi_px = ...      (leave it out to search the whole image)".to_owned(),
                |body| format!("roi_px = {:?}", body.mover.bounds_px),
            );
            return Some(Change {
                lines: wider,
                reason: format!(
                    "The ball is at ({:.0}, {:.0}), outside of the searched region {roi:?}.",
                    circle.x_px, circle.y_px
                ),
            });
        }
        return None;
    }
    describe_other_mover(surveyed)
}

/// Describes what moves where no ball does; `None` if nothing can be said about it.
fn describe_other_mover(surveyed: &Surveyed) -> Option<Change> {
    let note = |reason: String| Some(Change { lines: "# no key helps with this film".into(), reason });
    match surveyed.bodies.first().map(|body| &body.kind) {
        Some(Identified::Patch { polygon_px }) => {
            let corners: Vec<String> = polygon_px.iter().map(|[x, y]| format!("[{x:.0}, {y:.0}]")).collect();
            Some(Change {
                lines: format!("kind = \"patch\"\npolygon_px = [{}]", corners.join(", ")),
                reason:
                    "Something moves, but no circle stands out from what is behind it. Film it against a darker or a \
                         lighter background, or follow its texture as a patch."
                        .into(),
            })
        }
        Some(Identified::TooSmall { radius_px }) => {
            let (low, high) = ((RADIUS_RANGE[0] * radius_px).floor().max(2.0), (RADIUS_RANGE[1] * radius_px).ceil());
            Some(Change {
                lines: format!("min_radius_px = {low}\nmax_radius_px = {high}"),
                reason: format!(
                    "What moves is about {radius_px:.0} px in radius. An outline needs at least 6 px: as a point it is known \
                     to some hundredths of its radius. Filmed nearer, it is known to a few hundredths of a pixel."
                ),
            })
        }
        None if surveyed.movement.is_some() => note("Nothing moves in this film.".into()),
        _ => None,
    }
}

/// Advises a subset size that fits into the ball, if fewer than three subsets do; `None` if that is not smaller.
fn advise_subset_size(refused: &[&Evidence], config: &Config) -> Option<Change> {
    let none_fits = |evidence: &&&Evidence| evidence.count_subsets().is_some_and(|(count, _)| count < 3);
    let circle = refused.iter().find(none_fits)?.circle()?;
    let (now, fitting) = (config.correlation().subset_size_px, (0.35 * circle.radius_px) as u32 * 2 + 1);
    let fitting = fitting.max(9);
    (fitting < now).then(|| Change {
        lines: format!("[correlation]\nsubset_size_px = {fitting}\nstep_px = {}", (fitting / 3).max(3)),
        reason: format!("Fewer than 3 subsets of {now} px fit into a ball of radius {:.1} px.", circle.radius_px),
    })
}

/// Advises a shorter exposure if more than [`MAX_WHITE`] of the body is saturated.
fn advise_exposure(refused: &[&Evidence]) -> Option<Change> {
    let white = refused.iter().filter_map(|evidence| evidence.searched.white_fraction).fold(0.0, f64::max);
    (white > MAX_WHITE).then(|| Change {
        lines: "# camera.exposure_us shorter, or less light".into(),
        reason: format!("{:.0} % of the pixels on the body are saturated, and show no texture.", 100.0 * white),
    })
}

/// Advises a larger search if the ball moves farther per frame than `correlation.search_px` reaches.
fn advise_search_range(config: &Config, surveyed: &Surveyed) -> Option<Change> {
    let speeds = surveyed.bodies.iter().filter_map(|body| Some(body.path.as_ref()?.speed_px_frame));
    let (speed_px, now) = (speeds.fold(0.0, f64::max), config.correlation().search_px);
    (speed_px > f64::from(now)).then(|| Change {
        lines: format!("[correlation]\nsearch_px = {:.0}", (1.5 * speed_px).ceil().min(1024.0)),
        reason: format!("The ball moves by up to {speed_px:.0} px per frame; searched were {now} px."),
    })
}

/// Lists the keys that change the reason, with their present values.
fn general_advice(summary: &BodySummary) -> Vec<Change> {
    let Some((reason, keys)) = summary.reason() else { return Vec::new() };
    let line = |key: &Key| match &key.value {
        Some(value) => format!("# {}      now {value}", key.name),
        None => format!("# {}", key.name),
    };
    let lines = keys.iter().map(line).collect::<Vec<_>>().join("\n");
    vec![Change { lines, reason: format!("{}: {}.", capitalize(reason.text), reason.advice) }]
}

/// Returns a text with its first letter in upper case.
fn capitalize(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}
