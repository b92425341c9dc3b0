//! The pictures and the sentences of a diagnosis.

use super::evidence::Evidence;
use crate::command::film_survey::{FilmFiles, Surveyed};
use crate::config::{BodyKind, Config};
use crate::console::WriteError;
use crate::failure::Failure;
use crate::image::encode_png;
use crate::plot::{Canvas, Color, stretched_levels};
use crate::report::{FrameDiagnosis, Panel};
use crate::results::{Circle, PointStatus, segments};

/// The colour of the searched region and radii.
const ROI: Color = [90, 170, 255];
/// The colour of outlines and subsets that were found.
const FOUND: Color = [53, 224, 111];
/// The colour of an outline outside of the search.
const ELSEWHERE: Color = [255, 90, 60];
/// The colour that tints what moves.
const MOVING: Color = [122, 92, 255];
/// The colour of refused subsets.
const REFUSED: Color = [229, 154, 28];
/// The width of an enlarged part, px.
const PART_PX: u32 = 640;
/// Half of the side of an enlarged part, in radii.
const PART_RADII: f64 = 1.5;

/// Draws one frame, and describes what was searched, found and refused.
pub(super) fn draw_frame(
    evidence: &Evidence,
    config: &Config,
    body: usize,
    surveyed: &Surveyed,
) -> Result<FrameDiagnosis, Failure> {
    let view = View { evidence, config, body, surveyed };
    let mut panels = vec![Panel { png: encode_drawing(view.draw_whole())?, caption: "The whole frame".into() }];
    if let Some((part, caption)) = view.draw_part() {
        panels.push(Panel { png: encode_drawing(part)?, caption });
    }
    Ok(FrameDiagnosis {
        number: evidence.index,
        time_ms: evidence.time_ms,
        choice: evidence.choice.reason,
        status: evidence.choice.status,
        findings: view.findings(),
        panels,
    })
}

/// Draws what moves in the film over the frame in which most of it moves; `None` if the film has fewer than three
/// frames.
pub(super) fn draw_movement(film: &FilmFiles, surveyed: &Surveyed) -> Result<Option<Panel>, Failure> {
    let Some(movement) = &surveyed.movement else { return Ok(None) };
    let busiest = surveyed.bodies.iter().flat_map(|body| &body.mover.appearances);
    let shown = busiest.max_by(|a, b| a.area_px2.total_cmp(&b.area_px2)).map_or(0, |appearance| appearance.index);
    let (meta, bytes) = film.frame(shown)?;
    let levels = stretched_levels(&crate::command::export::grey_levels(meta, &bytes)?);
    let mut canvas = Canvas::from_levels(&levels, meta.width_px).with_line(2);
    tint_marked(&mut canvas, &movement.swept, surveyed);
    for body in &surveyed.bodies {
        canvas.rectangle(body.mover.bounds_px.map(|number| number as f32 - 0.5), ROI);
        let Some(path) = &body.path else { continue };
        let centers: Vec<[f32; 2]> = path.track.iter().map(|point| center_px(&point.circle)).collect();
        canvas.path(&centers, FOUND);
        if let Some(point) = path.track.iter().find(|point| point.index == shown) {
            canvas.circle(center_px(&point.circle), point.circle.radius_px as f32, FOUND);
        }
    }
    let caption = format!("Frame {shown}; tinted: every place over which something moves in the film");
    Ok(Some(Panel { png: encode_drawing(canvas)?, caption }))
}

/// One body in one frame.
struct View<'a> {
    evidence: &'a Evidence,
    config: &'a Config,
    body: usize,
    surveyed: &'a Surveyed,
}

impl View<'_> {
    /// Returns the width of a frame, px.
    fn width_px(&self) -> u32 {
        self.surveyed.size_px[0] as u32
    }

    /// Draws the searched region, the range of radii, what moves, and the outlines.
    fn draw_whole(&self) -> Canvas {
        let mut canvas = Canvas::from_levels(&stretched_levels(&self.evidence.levels), self.width_px()).with_line(2);
        if let Some(is_moving) = &self.evidence.is_moving {
            tint_marked(&mut canvas, is_moving, self.surveyed);
        }
        let [width, height] = self.surveyed.size_px.map(|size| size as u32);
        let roi_px = self.config.bodies[self.body].roi_px.unwrap_or([1, 1, width - 2, height - 2]);
        canvas.rectangle(roi_px.map(|number| number as f32 - 0.5), ROI);
        if self.config.bodies[self.body].kind == BodyKind::Ball {
            let search = self.config.ball(self.body, width, height);
            let [x, y, w, h] = roi_px.map(|number| number as f32);
            let middle = self
                .evidence
                .circle()
                .or_else(|| self.moving_circle())
                .map_or([x + 0.5 * w, y + 0.5 * h], |circle| center_px(&circle));
            for radius_px in [search.min_radius_px, search.max_radius_px] {
                canvas.dotted_circle(middle, radius_px as f32, ROI);
            }
        }
        self.draw_outlines(&mut canvas);
        canvas
    }

    /// Draws the body enlarged with its subsets; returns a caption too. `None` where no circle and no movement show the
    /// body.
    fn draw_part(&self) -> Option<(Canvas, String)> {
        let circle = self.evidence.circle().or_else(|| self.moving_circle())?;
        let [width, height] = self.surveyed.size_px.map(|size| size as f64);
        let reach = (PART_RADII * circle.radius_px).max(16.0);
        let span = |at: f64, size: f64| {
            let from = (at - reach).clamp(0.0, size - 1.0).floor();
            (from as u32, ((at + reach).clamp(from + 1.0, size).ceil() - from) as u32)
        };
        let ((left, columns), (top, rows)) = (span(circle.x_px, width), span(circle.y_px, height));
        let zoom = (PART_PX / columns.max(rows)).clamp(1, 12);
        let levels = stretched_levels(&self.evidence.levels);
        let mut canvas = Canvas::from_part(&levels, self.width_px(), [left, top, columns, rows], zoom).with_line(2);
        self.draw_outlines(&mut canvas);
        let size_px = self.config.correlation().subset_size_px as f32;
        for point in self.evidence.field.iter().flat_map(|field| &field.points) {
            let color = if point.status == PointStatus::Valid { FOUND } else { REFUSED };
            canvas.cross([point.x_px, point.y_px], 2.0, color);
        }
        let first = self.evidence.field.as_ref().and_then(|field| field.points.first());
        // One subset in its size; all of them would cover the body.
        let sample = first.map_or(center_px(&circle), |point| [point.x_px, point.y_px]);
        let half = 0.5 * size_px;
        canvas.rectangle(
            [sample[0] - half, sample[1] - half, size_px, size_px],
            if first.is_some() { FOUND } else { REFUSED },
        );
        Some((canvas, format!("Enlarged {zoom} times; the square is a subset of {size_px} px")))
    }

    /// Returns a circle around what moves in the sampled frame nearest to this one; `None` if nothing moves in the
    /// film.
    fn moving_circle(&self) -> Option<Circle> {
        let appearances = self.surveyed.bodies.iter().flat_map(|body| &body.mover.appearances);
        let nearest = appearances.min_by_key(|appearance| appearance.index.abs_diff(self.evidence.index))?;
        let [x, y, width, height] = nearest.bounds_px.map(f64::from);
        Some(Circle {
            x_px: x + 0.5 * width,
            y_px: y + 0.5 * height,
            radius_px: 0.5 * width.max(height),
            sigma_center_px: 0.0,
            sigma_radius_px: 0.0,
            visible_fraction: 1.0,
        })
    }

    /// Draws the rod, the outline that was found, and one outside of the search.
    fn draw_outlines(&self, canvas: &mut Canvas) {
        let Evidence { searched, track, .. } = self.evidence;
        for [from, to] in track.iter().filter_map(|track| track.rod.as_ref()).flat_map(segments) {
            canvas.draw_line(from.map(|at| at as f32), to.map(|at| at as f32), FOUND);
        }
        let is_patch = self.config.bodies[self.body].kind == BodyKind::Patch;
        let found = self.evidence.measured_circle().filter(|_| !is_patch).or(searched.inside);
        for (circle, color) in [(found, FOUND), (searched.outside, ELSEWHERE)] {
            if let Some(circle) = circle {
                canvas.circle(center_px(&circle), circle.radius_px as f32, color);
                canvas.cross(center_px(&circle), 3.0, color);
            }
        }
    }

    /// Describes in sentences what was searched, found and refused.
    fn findings(&self) -> Vec<String> {
        let (evidence, settings) = (self.evidence, &self.config.bodies[self.body]);
        let mut findings = vec![format!("Searched: {}.", self.describe_search())];
        let place =
            |circle: &Circle| format!("radius {:.1} px at ({:.1}, {:.1})", circle.radius_px, circle.x_px, circle.y_px);
        findings.push(match (settings.kind, evidence.measured_circle().or(evidence.searched.inside)) {
            (BodyKind::Ball, Some(circle)) => format!("Found: an outline of {}.", place(&circle)),
            (BodyKind::Ball, None) => "Found: no outline within these limits.".into(),
            (_, Some(circle)) => format!("Found: at ({:.1}, {:.1}).", circle.x_px, circle.y_px),
            (BodyKind::Rod, None) => {
                let why = evidence.searched.rod.map_or("nothing", PointStatus::as_str);
                format!("Found: no rod ({why}).")
            }
            (BodyKind::Patch, None) => "Found: not these pixels.".into(),
        });
        if let Some(circle) = &evidence.searched.outside {
            findings.push(format!("Outside of these limits: an outline of {}.", place(circle)));
        }
        let size_px = self.config.correlation().subset_size_px;
        if let Some((count, counts)) = evidence.count_subsets() {
            let shares: Vec<String> =
                counts.iter().map(|(status, count)| format!("{count} {}", status.as_str())).collect();
            findings.push(match count {
                0 => format!("Subsets: none of {size_px} px fits into the outline."),
                _ => format!("Subsets of {size_px} px: {count}, of which {}.", shares.join(", ")),
            });
        }
        if let Some(reason) = evidence.choice.status.reason(settings.kind) {
            findings.push(format!("Refused: {}.", reason.text));
        }
        findings
    }

    /// Describes the limits of the search in the rig file.
    fn describe_search(&self) -> String {
        let settings = &self.config.bodies[self.body];
        let [width, height] = self.surveyed.size_px.map(|size| size as u32);
        let place = settings.roi_px.map_or_else(|| "the whole image".into(), |roi| format!("[x, y, w, h] = {roi:?}"));
        match settings.kind {
            BodyKind::Ball => {
                let search = self.config.ball(self.body, width, height);
                let (low, high) = (search.min_radius_px, search.max_radius_px);
                format!("a ball of {low:.1} to {high:.1} px radius in {place}")
            }
            BodyKind::Rod => format!("a rod with {} tape edges in {place}", settings.edges),
            BodyKind::Patch => {
                let corners = settings.patch.as_ref().map_or(0, |patch| patch.outline_px.len());
                format!("the pixels inside a polygon of {corners} corners of the first frame")
            }
        }
    }
}

/// Returns the centre of a circle, px.
fn center_px(circle: &Circle) -> [f32; 2] {
    [circle.x_px as f32, circle.y_px as f32]
}

/// Tints the pixels whose reduced pixel is marked. `marked` is row-major, reduced by the factor of the movement.
fn tint_marked(canvas: &mut Canvas, marked: &[bool], surveyed: &Surveyed) {
    let Some(movement) = &surveyed.movement else { return };
    let (factor, width) = (movement.factor as u32, movement.background.width as u32);
    let height = movement.background.height as u32;
    let is_marked = |x: u32, y: u32| {
        let (column, row) = (x / factor, y / factor);
        column < width && row < height && marked[(row * width + column) as usize]
    };
    canvas.tint(is_marked, MOVING);
}

/// Encodes a drawing as PNG.
fn encode_drawing(canvas: Canvas) -> Result<Vec<u8>, Failure> {
    encode_png(&canvas.into_picture()).map_err(|error| WriteError::new("a picture", error).into())
}
