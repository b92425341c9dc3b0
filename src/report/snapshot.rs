//! The moments of a collision as pictures, with what was measured drawn over them.

use super::base64;
use super::number::{fixed, short};
use super::picture::Crop;
use super::shot::{Shot, Snapshot};
use crate::results::{Impact, PairField};
use std::fmt::Write as _;

/// Arrows in one picture; of more, every n-th is drawn.
const ARROWS_MAX: usize = 200;

/// The pictures of a collision; a sentence where there are none.
pub(super) fn strip(shot: &Shot, impact: &Impact) -> String {
    let of_impact = |s: &&Snapshot| s.impact == (impact.body, impact.number);
    let shown: Vec<&Snapshot> = shot.snapshots.iter().filter(of_impact).collect();
    if shown.is_empty() {
        return String::new();
    }
    if shown.iter().all(|snapshot| snapshot.picture.is_none()) {
        return "<p class=\"none\">No pictures: this recording holds no raw frames of these moments.</p>".into();
    }
    let gain = gain(&shown);
    let mut html = String::from("<div class=\"moments\">");
    for snapshot in &shown {
        let t_ms = 1e3 * shot.seconds(snapshot.moment_ns);
        let off_ms = 1e3 * (shot.seconds(snapshot.row.stamp_ns) - shot.seconds(snapshot.moment_ns));
        let drawn = match &snapshot.picture {
            Some((crop, png)) => draw(snapshot, *crop, png, gain),
            None => "<p class=\"none\">frame missing</p>".into(),
        };
        let speed = snapshot.row.velocity.map_or_else(String::new, |v| {
            format!(
                "<br><i>v</i><sub>n</sub> {} m/s, <i>v</i><sub>t</sub> {} m/s, <i>ω</i> {} rad/s",
                short(v.vn_m_s),
                short(v.vt_m_s),
                short(v.omega_rad_s)
            )
        });
        let frame = shot.frame(snapshot.row.frame);
        let _ = write!(
            html,
            "<figure>{drawn}<figcaption><b>{}</b> at {} ms<br><span>frame {frame}, exposed {} ms {} it</span>{speed}</figcaption></figure>",
            snapshot.title,
            fixed(t_ms, 3),
            fixed(off_ms.abs(), 3),
            if off_ms < 0.0 { "before" } else { "after" },
        );
    }
    html.push_str("</div>");
    let _ = write!(
        html,
        "<p class=\"note\"><span class=\"key outline\"></span>outline found<span class=\"key arrow\"></span>motion to the next frame, {} times enlarged in all pictures</p>",
        fixed(gain, if gain < 1.0 { 3 } else { 0 })
    );
    html
}

/// How much arrows are enlarged: the longest of all pictures spans not quite two subsets' distance.
pub(super) fn gain(shown: &[&Snapshot]) -> f64 {
    let (mut longest, mut step) = (0.0_f64, f64::INFINITY);
    for field in shown.iter().filter_map(|snapshot| snapshot.field.as_ref()) {
        let motions = field.points.iter().filter_map(|point| point.displacement);
        longest = motions.map(|d| f64::from(d.u_px.hypot(d.v_px))).fold(longest, f64::max);
        let apart = field.points.windows(2).map(|p| f64::from((p[0].x_px - p[1].x_px).hypot(p[0].y_px - p[1].y_px)));
        step = apart.filter(|apart| *apart > 0.0).fold(step, f64::min);
    }
    let exact = if longest > 0.0 && step.is_finite() { 1.8 * step / longest } else { 1.0 };
    // A round number, so that it can be remembered.
    let power = 10_f64.powf(exact.log10().floor());
    [5.0, 4.0, 3.0, 2.0, 1.0].into_iter().map(|k| k * power).find(|round| *round <= exact).unwrap_or(power)
}

/// A picture with what was measured over it; arrows are enlarged by `gain`.
pub(super) fn draw(snapshot: &Snapshot, crop: Crop, png: &[u8], gain: f64) -> String {
    let Crop { x, y, width, height } = crop;
    // The pixel (0, 0) is centred on (0, 0): the picture begins half a pixel before.
    let (left, top) = (x as f64 - 0.5, y as f64 - 0.5);
    let mut svg = format!(
        "<svg class=\"moment\" viewBox=\"{left} {top} {width} {height}\" role=\"img\" aria-label=\"{}\">\
         <image x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
         href=\"data:image/png;base64,{}\"/>",
        snapshot.title,
        base64::encode(png)
    );
    let row = &snapshot.row;
    if let (Some(x), Some(y), Some(radius)) = (row.center_x_px, row.center_y_px, row.radius_px) {
        let _ = write!(svg, "<circle class=\"outline\" cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\"/>");
        let _ = write!(svg, "<path class=\"outline\" d=\"M{:.2} {y:.2}h6M{x:.2} {:.2}v6\"/>", x - 3.0, y - 3.0);
    }
    if let Some(field) = &snapshot.field {
        arrows(&mut svg, field, gain);
    }
    svg.push_str("</svg>");
    svg
}

fn arrows(svg: &mut String, field: &PairField, gain: f64) {
    let every = field.points.len().div_ceil(ARROWS_MAX).max(1);
    let mut path = String::new();
    for point in field.points.iter().step_by(every) {
        let Some(motion) = point.displacement else { continue };
        let (x, y) = (f64::from(point.x_px), f64::from(point.y_px));
        let (u, v) = (gain * f64::from(motion.u_px), gain * f64::from(motion.v_px));
        let length = u.hypot(v);
        let _ = write!(path, "M{x:.1} {y:.1}l{u:.1} {v:.1}");
        if length > 1.5 {
            // Two strokes of at most 3 px, 30 deg to either side of the way back.
            let head = (0.35 * length).min(3.0) / length;
            let (back_x, back_y) = (-u * head, -v * head);
            let (c, s) = (0.866, 0.5);
            let tip = (x + u, y + v);
            for sign in [1.0, -1.0] {
                let (dx, dy) = (c * back_x - sign * s * back_y, sign * s * back_x + c * back_y);
                let _ = write!(path, "M{:.1} {:.1}l{dx:.1} {dy:.1}", tip.0, tip.1);
            }
        }
    }
    if !path.is_empty() {
        let _ = write!(svg, "<path class=\"casing\" d=\"{path}\"/><path class=\"arrow\" d=\"{path}\"/>");
    }
}
