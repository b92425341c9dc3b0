//! The proposal as a rig file with comments.

use super::proposal::{Proposal, ProposedBody, SurfaceSource};
use std::fmt::Write as _;

/// Returns the text of the rig file for a film of this name; `command` measures the film.
pub(super) fn rig_text(proposal: &Proposal, film: &str, command: &str) -> String {
    let mut text = String::new();
    let [width, height] = proposal.size_px;
    let _ = write!(
        text,
        "# A rig file for {}, proposed by `ricochet setup`. Check it against the picture next to it.\n#\n#     {}\n#\n# {} \
         frames of {width} x {height} px at {} frames/s {}. A film needs no [camera].\n",
        one_line(film),
        one_line(command),
        proposal.count,
        proposal.frame_rate_hz,
        proposal.rate_source
    );
    proposal.warnings.iter().for_each(|warning| {
        let _ = writeln!(text, "# Warning: {warning}.");
    });
    write_scale(&mut text, proposal);
    write_surface(&mut text, proposal);
    let count = proposal.bodies.len();
    for (number, body) in proposal.bodies.iter().enumerate() {
        write_body(&mut text, body, (count > 1).then_some(number + 1));
    }
    write_correlation(&mut text, proposal);
    let gravity = proposal.gravity.describe(proposal.frame_rate_hz);
    let _ = write!(text, "\n[velocity]\n# Gravity: {gravity}.\n{}", proposal.gravity.keys());
    text
}

/// Returns a text without line ends, so that it stays a comment.
fn one_line(text: &str) -> String {
    text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}

/// Writes the `[scale]` table, with a comment where the scale is missing.
fn write_scale(text: &mut String, proposal: &Proposal) {
    *text += "\n[scale]\n";
    let is_ball = proposal.bodies.iter().any(|body| matches!(body, ProposedBody::Ball { .. }));
    let _ = match (proposal.diameter_mm, proposal.mm_per_px) {
        (Some(diameter_mm), Some(mm_per_px)) if is_ball => write!(
            text,
            "# True diameter of the ball, mm. The measured radius gives the scale, about {mm_per_px:.4} mm/px.\n\
             ball_diameter_mm = {diameter_mm}\n"
        ),
        (Some(diameter_mm), Some(mm_per_px)) => {
            write!(text, "# Millimetres per pixel, from a width of {diameter_mm} mm.\nmm_per_px = {mm_per_px:.5}\n")
        }
        _ if is_ball => write!(
            text,
            "# MISSING: the true diameter of the ball, mm. Without it results are in pixels only.\n# ball_diameter_mm = \n"
        ),
        _ => write!(text, "# MISSING: millimetres per pixel. Without it results are in pixels only.\n# mm_per_px = \n"),
    };
}

/// Writes the `[surface]` table, with the source of its angle as a comment.
fn write_surface(text: &mut String, proposal: &Proposal) {
    let surface = &proposal.surface;
    let why = match surface.source {
        SurfaceSource::Edge => {
            "From an edge of the background where the ball bounces, uncertain by some degrees. A nearly level edge gives 0."
        }
        SurfaceSource::Bounce => {
            "From the direction in which the ball bounces; friction of up to 25 deg is rounded to a level surface or a wall."
        }
        SurfaceSource::Assumed => "Assumed to be level, because the ball does not bounce in this film.",
    };
    let _ = write!(
        text,
        "\n[surface]\n# Direction of the surface in the image, counter-clockwise from x, deg. Its outward normal is 90 deg \
         further.\n# {why}\nangle_deg = {}\n",
        surface.angle_deg
    );
    if let Some(edge) = surface.edge {
        let [[x0, y0], [x1, y1]] = edge.ends_px;
        let _ = write!(
            text,
            "# The detected edge. Uncomment it to count contacts only between its end points.\n# edge = [[{x0:.0}, \
             {y0:.0}], [{x1:.0}, {y1:.0}]]\n"
        );
    }
}

/// Writes a `[[body]]` table; `number` makes the names of several bodies different.
fn write_body(text: &mut String, body: &ProposedBody, number: Option<usize>) {
    let name = |kind: &str| number.map_or_else(|| kind.to_owned(), |number| format!("{kind}-{number}"));
    *text += "\n[[body]]\n";
    let _ = match body {
        ProposedBody::Ball { radius_px, radii_px: [low, high], found_frames, .. } => write!(
            text,
            "name = \"{}\"\nkind = \"ball\"\n# Range of radii to search, px: the ball has {radius_px:.1} px, and was found in \
             {found_frames} frames.\nmin_radius_px = {low}\nmax_radius_px = {high}\n",
            name("ball")
        ),
        ProposedBody::Rod { half_width_px, .. } => write!(
            text,
            "# Upright, with tapes around it, {:.1} px wide.\nname = \"{}\"\nkind = \"rod\"\n",
            2.0 * half_width_px,
            name("rod")
        ),
        ProposedBody::Patch { polygon_px } => {
            let corners: Vec<String> = polygon_px.iter().map(|[x, y]| format!("[{x:.0}, {y:.0}]")).collect();
            write!(
                text,
                "# What moves has no circular outline. It is followed by its texture.\nname = \"{}\"\nkind = \"patch\"\n# Its \
                 corners in the first frame, px.\npolygon_px = [{}]\n",
                name("patch"),
                corners.join(", ")
            )
        }
    };
    if let ProposedBody::Ball { roi_px: Some(roi), .. } | ProposedBody::Rod { roi_px: Some(roi), .. } = body {
        let _ =
            write!(text, "# The region that it crosses, with a margin: x, y, width, height, px.\nroi_px = {roi:?}\n");
    }
}

/// Writes the settings for which the defaults do not fit.
fn write_correlation(text: &mut String, proposal: &Proposal) {
    if proposal.subset_size_px.is_none() && proposal.search_px.is_none() {
        return;
    }
    *text += "\n[correlation]\n";
    if let Some(size_px) = proposal.subset_size_px {
        let step_px = (size_px / 3).max(3);
        let _ = write!(
            text,
            "# Width and distance of the subsets, px: small enough for several to fit on the ball.\nsubset_size_px = \
             {size_px}\nstep_px = {step_px}\n"
        );
    }
    if let Some(search_px) = proposal.search_px {
        let _ =
            write!(text, "# The ball moves by more than the default from frame to frame.\nsearch_px = {search_px}\n");
    }
}
