//! The content of a rig file for a film.

use super::gravity::Gravity;
use crate::command::film_survey::{Surveyed, SurveyedBody};
use crate::dic::CorrelationParams;
use crate::survey::{Bounce, Identified, SurfaceEdge, find_surface_edge};

/// The range of radii to search, relative to the smallest and the largest radius found.
const RADIUS_RANGE: [f64; 2] = [0.8, 1.25];
/// The width of a subset relative to the radius of a ball, so that some of them fit side by side.
const SUBSET_RADII: f64 = 0.7;
/// The share of the image up to which a region is worth a key.
const MAX_ROI_SHARE: f64 = 0.7;
/// The difference from a level surface or an upright wall that friction explains, deg.
const FRICTION_DEG: f64 = 25.0;

/// The area of something else that moves from which it is worth a warning, relative to the body.
const MIN_OTHER_SHARE: f64 = 0.1;

/// The minimum difference from a level surface or an upright wall that counts as a tilt, deg.
///
/// A smaller one changes a restitution by less than 1 % of the tangential speed.
const MIN_TILT_DEG: f64 = 0.5;
/// The coverage of the uncertainty of an edge, standard deviations. Within it, a level surface is far more frequent.
const COVERAGE: f64 = 2.0;

/// A body of the rig file.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum ProposedBody {
    Ball { radius_px: f64, radii_px: [f64; 2], roi_px: Option<[u32; 4]>, found_frames: usize },
    Rod { half_width_px: f64, roi_px: Option<[u32; 4]> },
    Patch { polygon_px: Vec<[f64; 2]> },
}

/// The surface that the ball strikes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ProposedSurface {
    pub(super) angle_deg: f64,
    pub(super) source: SurfaceSource,
    pub(super) edge: Option<SurfaceEdge>,
    pub(super) bounce: Option<Bounce>,
}

/// The source of the angle of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SurfaceSource {
    /// An edge of the background that the ball touches.
    Edge,
    /// The change of velocity, rounded to a level surface or a wall where friction explains the rest.
    Bounce,
    /// The track does not bounce; a level surface is assumed.
    Assumed,
}

/// A proposal, with everything that the rig file, the picture and the terminal show.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Proposal {
    pub(super) size_px: [usize; 2],
    pub(super) count: u64,
    pub(super) frame_rate_hz: f64,
    pub(super) rate_source: String,
    pub(super) bodies: Vec<ProposedBody>,
    pub(super) diameter_mm: Option<f64>,
    pub(super) mm_per_px: Option<f64>,
    pub(super) surface: ProposedSurface,
    pub(super) gravity: Gravity,
    /// `None` where the defaults fit.
    pub(super) subset_size_px: Option<u32>,
    pub(super) search_px: Option<u32>,
    /// The number of the frame that the picture shows.
    pub(super) shown_frame: u64,
    pub(super) warnings: Vec<String>,
    /// The missing key, if any.
    pub(super) missing: Option<String>,
}

/// Whether a diameter would give the scale.
pub(super) fn needs_diameter(surveyed: &Surveyed) -> bool {
    surveyed.bodies.iter().any(|body| matches!(body.kind, Identified::Ball { .. } | Identified::Rod { .. }))
}

impl Proposal {
    /// Derives a proposal from a survey, and the scale from the true diameter of the ball, or width of the rod, if it
    /// is given.
    ///
    /// # Errors
    ///
    /// The reason why nothing can be followed.
    pub(super) fn from_survey(surveyed: &Surveyed, diameter_mm: Option<f64>) -> Result<Self, String> {
        let chosen = choose_bodies(surveyed)?;
        let bodies: Vec<ProposedBody> = chosen.iter().filter_map(|body| propose_body(body, surveyed.size_px)).collect();
        let main = chosen.iter().find_map(|body| body.path.as_ref());
        let mm_per_px = diameter_mm.zip(bodies.iter().find_map(ProposedBody::radius_px));
        let mm_per_px = mm_per_px.map(|(diameter_mm, radius_px)| diameter_mm / (2.0 * radius_px));
        let radius_px = bodies.iter().find_map(ProposedBody::radius_px);
        let bounce = main.and_then(|path| path.bounce);
        let surface = propose_surface(surveyed, bounce, radius_px);
        let gravity = Gravity::classify(main.and_then(|path| path.acceleration), mm_per_px);
        let defaults = CorrelationParams::default();
        let speed_px = main.map_or(0.0, |path| path.speed_px_frame);
        let fitting = radius_px.map(|radius_px| ((SUBSET_RADII * radius_px / 2.0) as u32 * 2 + 1).clamp(9, 255));
        let first = chosen[0].mover.appearances.first().map_or(0, |first| first.index);
        let middle = main.map_or(first, |path| path.track.get(path.track.len() / 2).map_or(first, |point| point.index));
        Ok(Self {
            size_px: surveyed.size_px,
            count: surveyed.count,
            frame_rate_hz: surveyed.frame_rate_hz,
            rate_source: surveyed.rate_source.clone(),
            diameter_mm,
            mm_per_px,
            surface,
            gravity,
            subset_size_px: fitting.filter(|fitting| *fitting < defaults.subset_size_px),
            search_px: (speed_px > f64::from(defaults.search_px)).then(|| (1.5 * speed_px).ceil().min(1024.0) as u32),
            shown_frame: bounce.map_or(middle, |bounce| bounce.index),
            warnings: collect_warnings(surveyed, &chosen, gravity),
            missing: missing_scale(&bodies, mm_per_px),
            bodies,
        })
    }

    /// Returns the lines for the terminal, each with its name.
    pub(super) fn facts(&self) -> Vec<(&'static str, String)> {
        let [width, height] = self.size_px;
        let (count, rate_hz) = (self.count, self.frame_rate_hz);
        let mut facts =
            vec![("film", format!("{count} frames of {width}x{height} px at {rate_hz} frames/s {}", self.rate_source))];
        for body in &self.bodies {
            facts.push(match body {
                ProposedBody::Ball { radius_px, found_frames, .. } => {
                    ("ball", format!("radius {radius_px:.1} px, found in {found_frames} of {count} frames"))
                }
                ProposedBody::Rod { half_width_px, .. } => ("rod", format!("{:.1} px wide", 2.0 * half_width_px)),
                ProposedBody::Patch { polygon_px } => {
                    ("patch", format!("{} corners in the first frame; no circular outline", polygon_px.len()))
                }
            });
        }
        facts.push(match (self.diameter_mm, self.mm_per_px) {
            (Some(diameter_mm), Some(mm_per_px)) => {
                ("scale", format!("{mm_per_px:.4} mm/px, from a diameter of {diameter_mm} mm"))
            }
            _ => ("scale", "unknown".into()),
        });
        facts.push(("surface", self.surface.describe()));
        facts.push(("gravity", self.gravity.describe(rate_hz)));
        facts
    }
}

impl ProposedSurface {
    /// Describes the angle, its source and the frame of the bounce in one line.
    pub(super) fn describe(&self) -> String {
        let angle_deg = self.angle_deg;
        let at = self.bounce.map_or_else(String::new, |bounce| format!(", touched about frame {}", bounce.index));
        match self.source {
            SurfaceSource::Edge => {
                let edge_deg = self.edge.map_or(angle_deg, |edge| edge.angle_deg);
                let sigma_deg = self.edge.map_or(0.0, |edge| edge.sigma_deg);
                format!("{angle_deg} deg, from an edge of the background at {edge_deg:.1} +- {sigma_deg:.1} deg{at}")
            }
            SurfaceSource::Bounce => format!("{angle_deg} deg, from the direction of the bounce{at}"),
            SurfaceSource::Assumed => format!("{angle_deg} deg, assumed, because the track does not bounce"),
        }
    }
}

impl ProposedBody {
    /// Returns the radius of a ball, or half the width of a rod, px; `None` for a patch.
    pub(super) fn radius_px(&self) -> Option<f64> {
        match self {
            Self::Ball { radius_px, .. } => Some(*radius_px),
            Self::Rod { half_width_px, .. } => Some(*half_width_px),
            Self::Patch { .. } => None,
        }
    }
}

/// Returns the bodies to follow: all balls, else one rod, else one patch unless everything moves.
///
/// # Errors
///
/// The reason why nothing can be followed.
fn choose_bodies(surveyed: &Surveyed) -> Result<Vec<&SurveyedBody>, String> {
    let Some(movement) = &surveyed.movement else { return Err("fewer than three frames; nothing can move".into()) };
    let is_ball = |body: &&SurveyedBody| matches!(body.kind, Identified::Ball { .. });
    let balls: Vec<_> = surveyed.bodies.iter().filter(is_ball).collect();
    if !balls.is_empty() {
        return Ok(balls);
    }
    let first = |is_wanted: fn(&Identified) -> bool| surveyed.bodies.iter().find(|body| is_wanted(&body.kind));
    let other = first(|kind| matches!(kind, Identified::Rod { .. }))
        .or_else(|| first(|kind| matches!(kind, Identified::Patch { .. })).filter(|_| !movement.is_everywhere));
    if let Some(body) = other {
        return Ok(vec![body]);
    }
    let place = |body: &SurveyedBody| {
        let [x, y, width, height] = body.mover.bounds_px;
        format!("what moves in [{x}, {y}, {width}, {height}]")
    };
    Err(match surveyed.bodies.first() {
        _ if movement.is_everywhere => {
            "everything moves, and no ball was found in it: the camera was not held still, or the light changes".into()
        }
        None => "nothing moves in this film".into(),
        Some(body) => match body.kind {
            Identified::TooSmall { radius_px } => format!(
                "{} is about {radius_px:.0} px in radius; an outline needs at least 6 px: film it nearer, or set \
                 body.min_radius_px below that radius to follow it as a point",
                place(body)
            ),
            _ => format!(
                "{} has no circular outline and is not visible in the first frame, so no patch can be drawn in it; start \
                 the film later",
                place(body)
            ),
        },
    })
}

/// Returns the range of radii and the region of a ball, the region of a rod, or the polygon of a patch.
///
/// `None` for what cannot be followed.
fn propose_body(body: &SurveyedBody, size_px: [usize; 2]) -> Option<ProposedBody> {
    match &body.kind {
        Identified::Ball { radius_px, circles } => {
            let track = body.path.as_ref().map_or(&[][..], |path| &path.track);
            let found = circles.iter().map(|(_, circle)| circle).chain(track.iter().map(|point| &point.circle));
            let radii: Vec<f64> = found.clone().map(|circle| circle.radius_px).collect();
            let low = radii.iter().copied().fold(f64::INFINITY, f64::min);
            let high = radii.iter().copied().fold(0.0, f64::max);
            let spans = found.map(|circle| {
                let reach = 2.0 * circle.radius_px;
                [circle.x_px - reach, circle.y_px - reach, circle.x_px + reach, circle.y_px + reach]
            });
            Some(ProposedBody::Ball {
                radius_px: *radius_px,
                radii_px: [(RADIUS_RANGE[0] * low).floor().max(6.0), (RADIUS_RANGE[1] * high).ceil()],
                roi_px: enclosing_region(spans, size_px),
                found_frames: track.len(),
            })
        }
        Identified::Rod { half_width_px, .. } => {
            let [x, y, width, height] = body.mover.bounds_px.map(f64::from);
            let margin = 2.0 * half_width_px;
            let span = [x - margin, y - margin, x + width + margin, y + height + margin];
            let roi_px = enclosing_region(std::iter::once(span), size_px);
            Some(ProposedBody::Rod { half_width_px: *half_width_px, roi_px })
        }
        Identified::Patch { polygon_px } => Some(ProposedBody::Patch { polygon_px: polygon_px.clone() }),
        Identified::Unknown | Identified::TooSmall { .. } => None,
    }
}

/// Returns the region (x, y, width, height, px) around spans (left, top, right, bottom), clipped to the image.
///
/// `None` if it is most of the image.
fn enclosing_region(spans: impl Iterator<Item = [f64; 4]>, size_px: [usize; 2]) -> Option<[u32; 4]> {
    let around = spans.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])?;
    let [width, height] = size_px.map(|size| size as f64);
    let (left, top) = (around[0].max(0.0).floor(), around[1].max(0.0).floor());
    let (right, bottom) = (around[2].min(width).ceil(), around[3].min(height).ceil());
    let share = (right - left) * (bottom - top) / (width * height);
    (share < MAX_ROI_SHARE).then(|| [left, top, right - left, bottom - top].map(|number| number as u32))
}

/// Returns the surface that the ball strikes, from an edge of the background or from the bounce.
///
/// Nearly level surfaces and upright walls are rounded. Without a bounce a level surface is assumed. `radius_px` is
/// that of the ball; without it no edge is searched.
fn propose_surface(surveyed: &Surveyed, bounce: Option<Bounce>, radius_px: Option<f64>) -> ProposedSurface {
    let Some(bounce) = bounce else {
        return ProposedSurface { angle_deg: 0.0, source: SurfaceSource::Assumed, edge: None, bounce: None };
    };
    let edge = surveyed.movement.as_ref().zip(radius_px);
    let edge = edge.and_then(|(movement, radius_px)| find_surface_edge(movement, &bounce, radius_px));
    if let Some(edge) = edge {
        let upright_deg = nearest_upright_deg(edge.angle_deg);
        let is_upright = (edge.angle_deg - upright_deg).abs() < MIN_TILT_DEG.max(COVERAGE * edge.sigma_deg);
        let angle_deg = if is_upright { upright_deg } else { (edge.angle_deg * 10.0).round() / 10.0 } + 0.0;
        return ProposedSurface { angle_deg, source: SurfaceSource::Edge, edge: Some(edge), bounce: Some(bounce) };
    }
    // The surface's tangent is the normal turned clockwise by a quarter turn; the image's y points down.
    let bounce_deg = (-bounce.direction[1]).atan2(bounce.direction[0]).to_degrees() - 90.0;
    let bounce_deg = (bounce_deg + 180.0).rem_euclid(360.0) - 180.0;
    let upright_deg = nearest_upright_deg(bounce_deg);
    let is_friction = (bounce_deg - upright_deg).abs() < FRICTION_DEG;
    // No negative zero, and no turn of -180 deg, in a file for people.
    let angle_deg = if is_friction { upright_deg } else { bounce_deg.round() } + 0.0;
    ProposedSurface { angle_deg, source: SurfaceSource::Bounce, edge: None, bounce: Some(bounce) }
}

/// Returns the nearest multiple of 90 deg, which is the angle of a level surface or a wall.
fn nearest_upright_deg(angle_deg: f64) -> f64 {
    (angle_deg / 90.0).round() * 90.0
}

/// Returns warnings about a rate that contradicts gravity, movement everywhere, and other things that move.
fn collect_warnings(surveyed: &Surveyed, chosen: &[&SurveyedBody], gravity: Gravity) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Gravity::Contradicts { value_m_s2, rate_factor } = gravity {
        let (rate_hz, needed_hz) = (surveyed.frame_rate_hz, surveyed.frame_rate_hz * rate_factor);
        warnings.push(format!(
            "at {rate_hz} frames/s the ball falls with {value_m_s2:.2} m/s^2; if it falls freely, the film was taken at about \
             {needed_hz:.0} frames/s: pass --fps"
        ));
    }
    if surveyed.movement.as_ref().is_some_and(|movement| movement.is_everywhere) {
        warnings.push("almost everything moves: hold the camera still, or light the scene evenly".into());
    }
    let is_chosen = |body: &SurveyedBody| chosen.iter().any(|chosen| std::ptr::eq(*chosen, body));
    let area_px2 = |body: &SurveyedBody| body.mover.appearances.iter().map(|a| a.area_px2).fold(0.0, f64::max);
    // Key frames of compressed films differ in small patches.
    let smallest_px2 = MIN_OTHER_SHARE * chosen.iter().map(|body| area_px2(body)).fold(0.0, f64::max);
    for body in surveyed.bodies.iter().filter(|body| !is_chosen(body) && area_px2(body) > smallest_px2) {
        let [x, y, width, height] = body.mover.bounds_px;
        let why = match body.kind {
            Identified::TooSmall { radius_px } => {
                format!("is about {radius_px:.0} px in radius; an outline needs at least 6 px")
            }
            _ => "is not followed".into(),
        };
        warnings.push(format!("something else moves in [{x}, {y}, {width}, {height}], and {why}"));
    }
    warnings
}

/// Returns the sentence about a missing scale; `None` with one.
fn missing_scale(bodies: &[ProposedBody], mm_per_px: Option<f64>) -> Option<String> {
    if mm_per_px.is_some() {
        return None;
    }
    let is_patch = bodies.iter().all(|body| body.radius_px().is_none());
    Some(match is_patch {
        true => "written without a scale: set scale.mm_per_px, else results are in pixels only".into(),
        false => "written without a scale: pass --diameter-mm, or set scale.ball_diameter_mm, else results are in pixels only".into(),
    })
}
