//! The proposal drawn over a frame of the film.

use super::proposal::{Proposal, ProposedBody};
use crate::command::export::grey_levels;
use crate::command::film_survey::Surveyed;
use crate::failure::Failure;
use crate::image::Frame;
use crate::plot::{Canvas, Color, stretched_levels};
use image::RgbImage;

/// The colour of the ball in the shown frame, and of a patch.
const OUTLINE: Color = [53, 224, 111];
/// The colour of the ball in other frames.
const PAST: Color = [26, 120, 60];
/// The colour of the track of the centre.
const TRACK: Color = [255, 210, 31];
/// The colour of the surface.
const SURFACE: Color = [255, 80, 60];
/// The colour of the searched region.
const ROI: Color = [90, 170, 255];
/// The colour of the scale bar.
const SCALE: Color = [255, 255, 255];
/// The number of outlines along the track.
const OUTLINES: usize = 8;

/// Draws outline, track, surface, region and scale over a frame.
pub(super) fn draw(proposal: &Proposal, surveyed: &Surveyed, frame: &Frame<'_>) -> Result<RgbImage, Failure> {
    let mut canvas =
        Canvas::from_levels(&stretched_levels(&grey_levels(frame.meta, frame.bytes)?), frame.meta.width_px)
            .with_line(2);
    for body in &proposal.bodies {
        match body {
            ProposedBody::Ball { roi_px: Some(roi), .. } | ProposedBody::Rod { roi_px: Some(roi), .. } => {
                canvas.rectangle(roi.map(|number| number as f32 - 0.5), ROI);
            }
            ProposedBody::Patch { polygon_px } => {
                let corners: Vec<[f32; 2]> = polygon_px.iter().map(|corner| corner.map(|at| at as f32)).collect();
                canvas.path(&corners, OUTLINE);
                if let (Some(last), Some(first)) = (corners.last(), corners.first()) {
                    canvas.draw_line(*last, *first, OUTLINE);
                }
            }
            _ => {}
        }
    }
    for path in surveyed.bodies.iter().filter_map(|body| body.path.as_ref()) {
        for point in path.track.iter().step_by(path.track.len().div_ceil(OUTLINES).max(1)) {
            let center = [point.circle.x_px as f32, point.circle.y_px as f32];
            canvas.circle(center, point.circle.radius_px as f32, PAST);
        }
        let centers: Vec<[f32; 2]> =
            path.track.iter().map(|point| [point.circle.x_px as f32, point.circle.y_px as f32]).collect();
        canvas.path(&centers, TRACK);
        if let Some(shown) = path.track.iter().find(|point| point.index == proposal.shown_frame) {
            let center = [shown.circle.x_px as f32, shown.circle.y_px as f32];
            canvas.circle(center, shown.circle.radius_px as f32, OUTLINE);
            canvas.cross(center, 4.0, OUTLINE);
        }
    }
    draw_surface(&mut canvas, proposal);
    draw_scale(&mut canvas, proposal);
    Ok(canvas.into_picture())
}

/// Draws the surface below the ball where it bounces, with its normal; nothing without a bounce or a radius.
fn draw_surface(canvas: &mut Canvas, proposal: &Proposal) {
    let surface = &proposal.surface;
    let radius_px = proposal.bodies.iter().find_map(ProposedBody::radius_px);
    let Some((bounce, radius_px)) = surface.bounce.zip(radius_px) else { return };
    let (sin, cos) = surface.angle_deg.to_radians().sin_cos();
    // In the image y points down.
    let (along, normal) = ([cos, -sin], [-sin, -cos]);
    let foot = match surface.edge {
        Some(edge) => {
            let [a, b] = edge.ends_px;
            [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
        }
        None => [bounce.center_px[0] - radius_px * normal[0], bounce.center_px[1] - radius_px * normal[1]],
    };
    let point = |t: f64, n: f64| {
        [(foot[0] + t * along[0] + n * normal[0]) as f32, (foot[1] + t * along[1] + n * normal[1]) as f32]
    };
    canvas.draw_line(point(-3.0 * radius_px, 0.0), point(3.0 * radius_px, 0.0), SURFACE);
    canvas.draw_line(point(0.0, 0.0), point(0.0, 0.6 * radius_px), SURFACE);
}

/// Draws a bar in the lower left corner with its length: 1, 2 or 5 times a power of ten, mm, or px without a scale.
///
/// It is at most a quarter of the image long.
fn draw_scale(canvas: &mut Canvas, proposal: &Proposal) {
    let [width, height] = proposal.size_px.map(|size| size as f64);
    let (mm_per_px, unit) = proposal.mm_per_px.map_or((1.0, "px"), |mm_per_px| (mm_per_px, "mm"));
    let longest = 0.25 * width * mm_per_px;
    let power = 10_f64.powf(longest.log10().floor());
    let length = [5.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|length| *length <= longest).unwrap_or(power);
    let (x, y) = ((0.03 * width) as f32, (0.96 * height) as f32);
    let end = x + (length / mm_per_px) as f32;
    for offset in [0.0, 1.0] {
        canvas.draw_line([x, y + offset], [end, y + offset], SCALE);
    }
    canvas.label([x, y - 3.0], &format!("{length} {unit}"), SCALE);
}
