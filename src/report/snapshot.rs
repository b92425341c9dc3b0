//! The moments of a collision as pictures, with the measurement drawn over them.

use super::picture::{Crop, data_url};
use super::shot::{Shot, Snapshot};
use crate::plot::{ArrowScale, fixed, three_digits};
use crate::results::{Impact, PairField};
use maud::{Markup, html};
use std::fmt::Write as _;

/// Maximum number of arrows in one picture. Of more, every n-th is drawn.
const MAX_ARROWS: usize = 200;

/// Draws the pictures of a collision, or states that there are none; nothing for a collision without moments.
pub(super) fn picture_strip(shot: &Shot, impact: &Impact) -> Markup {
    let of_impact = |s: &&Snapshot| s.impact == (impact.body, impact.number);
    let shown: Vec<&Snapshot> = shot.snapshots.iter().filter(of_impact).collect();
    if shown.is_empty() {
        return Markup::default();
    }
    if shown.iter().all(|snapshot| snapshot.picture.is_none()) {
        return html! { p class="none" { "No pictures: this recording holds no raw frames of these moments." } };
    }
    let gain = gain(&shown);
    html! {
        div class="moments" { @for snapshot in &shown { (moment_figure(shot, snapshot, gain)) } }
        p class="note" {
            span class="key outline" {} "detected outline" span class="key arrow" {}
            "motion to the next frame, enlarged " (gain_text(gain)) " times in all pictures"
        }
    }
}

/// Draws the picture of a moment, with its time, frame and velocities in the caption.
fn moment_figure(shot: &Shot, snapshot: &Snapshot, gain: f64) -> Markup {
    let moment_ms = 1e3 * shot.seconds(snapshot.moment_ns);
    let off_ms = 1e3 * (shot.seconds(snapshot.row.stamp_ns) - shot.seconds(snapshot.moment_ns));
    html! {
        figure {
            @match &snapshot.picture {
                Some((crop, png)) => (draw(snapshot, *crop, png, gain)),
                None => p class="none" { "frame missing" }
            }
            figcaption {
                b { (snapshot.title) } " at " (fixed(moment_ms, 3)) " ms" br;
                span {
                    "frame " (shot.frame(snapshot.row.frame)) ", exposed " (fixed(off_ms.abs(), 3)) " ms "
                    (if off_ms < 0.0 { "before" } else { "after" }) " it"
                }
                @if let Some(velocity) = snapshot.row.velocity {
                    br;
                    i { "v" } sub { "n" } " " (three_digits(velocity.vn_m_s)) " m/s, "
                    i { "v" } sub { "t" } " " (three_digits(velocity.vt_m_s)) " m/s"
                    @if let Some(omega_rad_s) = velocity.omega_rad_s {
                        ", " i { "ω" } " " (three_digits(omega_rad_s)) " rad/s"
                    }
                }
            }
        }
    }
}

/// Computes the common gain of the arrows, rounded down to one digit from 1 to 5. The longest of all pictures spans at
/// most 1.8 grid steps. The gain is 1 without displacements.
pub(super) fn gain(shown: &[&Snapshot]) -> f64 {
    let mut scale = ArrowScale::default();
    shown.iter().filter_map(|snapshot| snapshot.field.as_ref()).for_each(|field| scale.add(&field.points));
    let exact = scale.gain(1.8);
    // A round number is easier to remember.
    let power = 10_f64.powf(exact.log10().floor());
    [5.0, 4.0, 3.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|round| *round <= exact).unwrap_or(power)
}

/// Formats a gain: whole numbers from 1 on, three decimals below.
pub(super) fn gain_text(gain: f64) -> String {
    fixed(gain, if gain < 1.0 { 3 } else { 0 })
}

/// Draws a picture with outline and field over it; arrows are enlarged by `gain`.
pub(super) fn draw(snapshot: &Snapshot, crop: Crop, png: &[u8], gain: f64) -> Markup {
    let Crop { x, y, width, height } = crop;
    // Pixel (0, 0) is centred on (0, 0), so the picture begins half a pixel before it.
    let (left, top) = (x as f64 - 0.5, y as f64 - 0.5);
    let row = &snapshot.row;
    let arrows = snapshot.field.as_ref().map(|field| arrow_path(field, gain)).filter(|path| !path.is_empty());
    html! {
        svg class="moment" viewBox={ (left) " " (top) " " (width) " " (height) } role="img"
            aria-label=(snapshot.title) {
            image x=(left) y=(top) width=(width) height=(height) preserveAspectRatio="none" href=(data_url(png)) {}
            @if let (Some(x), Some(y), Some(radius)) = (row.center_x_px, row.center_y_px, row.radius_px) {
                circle class="outline" cx=(format!("{x:.2}")) cy=(format!("{y:.2}")) r=(format!("{radius:.2}")) {}
                path class="outline" d=(format!("M{:.2} {y:.2}h6M{x:.2} {:.2}v6", x - 3.0, y - 3.0)) {}
            }
            @if let Some(path) = &arrows {
                path class="casing" d=(path) {}
                path class="arrow" d=(path) {}
            }
        }
    }
}

/// Returns the SVG path of all arrows of a field, px; displacements are enlarged by `gain`.
fn arrow_path(field: &PairField, gain: f64) -> String {
    let every = field.points.len().div_ceil(MAX_ARROWS).max(1);
    let mut path = String::new();
    for point in field.points.iter().step_by(every) {
        let Some(motion) = point.displacement else { continue };
        let (x, y) = (f64::from(point.x_px), f64::from(point.y_px));
        let (u, v) = (gain * f64::from(motion.u_px), gain * f64::from(motion.v_px));
        let length = u.hypot(v);
        let _ = write!(path, "M{x:.1} {y:.1}l{u:.1} {v:.1}");
        if length > 1.5 {
            // The head has two strokes of at most 3 px, 30 deg to either side of the shaft.
            let head = (0.35 * length).min(3.0) / length;
            let (back_x, back_y) = (-u * head, -v * head);
            let (c, s) = (0.866, 0.5);
            for sign in [1.0, -1.0] {
                let (dx, dy) = (c * back_x - sign * s * back_y, sign * s * back_x + c * back_y);
                let _ = write!(path, "M{:.1} {:.1}l{dx:.1} {dy:.1}", x + u, y + v);
            }
        }
    }
    path
}
