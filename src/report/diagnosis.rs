//! The page that shows what was searched in a film, what was found, and why it was refused.

use super::page::document;
use super::picture::data_url;
use crate::results::PointStatus;
use maud::{Markup, html};

/// The width of the strip of all frames, px.
const STRIP_PX: f64 = 1000.0;
/// The maximum number of bars in the strip.
const MAX_BARS: usize = 500;
/// The lines drawn into the frames: style class and meaning.
const LINES: [(&str, &str); 7] = [
    ("roi", "searched region"),
    ("radii", "smallest and largest searched radius"),
    ("outline", "outline found"),
    ("elsewhere", "outline outside of the search"),
    ("moving", "what moves"),
    ("subset", "subset matched"),
    ("refused", "subset refused"),
];

/// The findings about a film.
#[derive(Debug, Clone, Default)]
pub struct Diagnosis {
    /// The name of the film.
    pub film: String,
    /// Facts about the film and the rig file.
    pub facts: Vec<String>,
    /// The diagnosis of each body.
    pub bodies: Vec<BodyDiagnosis>,
    /// The movement in the film, as a picture with a caption.
    pub movement: Option<Panel>,
    /// One line about each thing that moves.
    pub movers: Vec<String>,
}

/// The findings about one body.
#[derive(Debug, Clone, Default)]
pub struct BodyDiagnosis {
    /// The name.
    pub name: String,
    /// The number of measured frames, and why it was not measured in the others.
    pub line: String,
    /// Whether the body was measured in every frame.
    pub is_complete: bool,
    /// The changes that would help, as lines of the rig file with their reasons.
    pub changes: Vec<Change>,
    /// The status of every frame, in order.
    pub statuses: Vec<PointStatus>,
    /// A few frames.
    pub frames: Vec<FrameDiagnosis>,
}

/// A change of the rig file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// The lines to write.
    pub lines: String,
    /// The reason.
    pub reason: String,
}

/// One frame of a diagnosis.
#[derive(Debug, Clone)]
pub struct FrameDiagnosis {
    /// The number of the frame in the film, from 0.
    pub number: u64,
    /// The time since the first frame, ms.
    pub time_ms: f64,
    /// The reason why the frame was chosen.
    pub choice: &'static str,
    /// The status.
    pub status: PointStatus,
    /// Searched, found and refused, one sentence each.
    pub findings: Vec<String>,
    /// The whole frame, and the body enlarged.
    pub panels: Vec<Panel>,
}

/// A picture with its caption.
#[derive(Debug, Clone)]
pub struct Panel {
    /// The picture.
    pub png: Vec<u8>,
    /// The caption.
    pub caption: String,
}

/// Returns the page of a diagnosis.
pub fn diagnosis_page(diagnosis: &Diagnosis) -> String {
    let body = html! {
        header {
            h1 { (diagnosis.film) } p class="file" { "Diagnosis" }
            ul class="facts" { @for fact in &diagnosis.facts { li { (fact) } } }
        }
        @for body in &diagnosis.bodies { (body_section(body)) }
        @if let Some(movement) = &diagnosis.movement {
            section {
                h2 { "What moves in the film" }
                div class="panels" {
                    (panel(movement))
                    div { @for line in &diagnosis.movers { p { (line) } } }
                }
            }
        }
    };
    document(&format!("{} – diagnosis", diagnosis.film), None, &body)
}

/// Writes the section of a body: its measured frames, the changes that would help, and a few frames.
fn body_section(body: &BodyDiagnosis) -> Markup {
    html! {
        section class="body" {
            h2 { (body.name) }
            p class={ @if body.is_complete { "note" } @else { "alert" } } { (body.line) "." }
            @if !body.changes.is_empty() {
                div class="changes" {
                    h3 { "Change the rig file" }
                    @for change in &body.changes { pre { (change.lines) } p { (change.reason) } }
                }
            }
            @if !body.statuses.is_empty() { (status_strip(body)) }
            p class="legend keys" {
                @for (class, meaning) in LINES { span class="item" { span class={ "key " (class) } {} (meaning) } }
            }
            @for frame in &body.frames { (frame_card(frame)) }
        }
    }
}

/// Draws the status of every frame as a strip, with triangles at the frames that are shown.
///
/// If there are more than [`MAX_BARS`] frames, each bar shows the worst status of several.
fn status_strip(body: &BodyDiagnosis) -> Markup {
    let count = body.statuses.len();
    let group = count.div_ceil(MAX_BARS);
    let width = STRIP_PX / count as f64;
    let mut counts: Vec<(PointStatus, usize)> = PointStatus::ALL
        .into_iter()
        .map(|status| (status, body.statuses.iter().filter(|other| **other == status).count()))
        .collect();
    counts.retain(|(_, count)| *count > 0);
    html! {
        svg class="strip" viewBox={ "0 0 " (STRIP_PX) " 34" } role="img" aria-label="status of every frame" {
            @for (place, statuses) in body.statuses.chunks(group).enumerate() {
                // A group shows its worst frame.
                @let status = statuses.iter().copied().max().unwrap_or_default();
                rect class=(status_class(status)) x=(format!("{:.2}", (place * group) as f64 * width)) y="0"
                    width=(format!("{:.2}", (statuses.len() as f64 * width).max(0.5))) height="22" {}
            }
            @for frame in &body.frames {
                @let x = (frame.number as f64 + 0.5) * width;
                path class="tickmark" d=(format!("M{x:.1} 24l-5 9h10z")) {}
            }
        }
        p class="legend" {
            @for (status, count) in &counts {
                span class={ "swatch " (status_class(*status)) } {} (status.as_str()) " (" (count) ") "
            }
            "of " (count) " frames; the triangles mark the frames below"
        }
    }
}

/// Returns the class of a status in the style sheet.
fn status_class(status: PointStatus) -> &'static str {
    match status {
        PointStatus::Valid => "s-valid",
        PointStatus::Lost => "s-lost",
        PointStatus::Occluded | PointStatus::OutOfFrame | PointStatus::Predicted => "s-hidden",
        PointStatus::LowContrast | PointStatus::LowCorrelation | PointStatus::Ambiguous | PointStatus::Outlier => {
            "s-refused"
        }
    }
}

/// Writes the card of a frame: its status, pictures and findings.
fn frame_card(frame: &FrameDiagnosis) -> Markup {
    html! {
        div class="card" {
            h3 {
                "Frame " (frame.number) ", " (format!("{:.3}", frame.time_ms)) " ms "
                span class="choice" { "(" (frame.choice) ")" }
                span class={ "badge " (status_class(frame.status)) } { (frame.status.as_str()) }
            }
            div class="panels" {
                @for shown in &frame.panels { (panel(shown)) }
            }
            ul class="findings" { @for finding in &frame.findings { li { (finding) } } }
        }
    }
}

/// Writes a picture with its caption.
fn panel(panel: &Panel) -> Markup {
    html! {
        figure { img src=(data_url(&panel.png)) alt=(panel.caption); figcaption { (panel.caption) } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_says_what_to_change_before_it_shows_frames() {
        let panel = Panel { png: vec![1, 2, 3], caption: "a < b".into() };
        let frame = FrameDiagnosis {
            number: 3,
            time_ms: 0.6,
            choice: "first",
            status: PointStatus::Lost,
            findings: vec!["nothing & nobody".into()],
            panels: vec![panel.clone()],
        };
        let body = BodyDiagnosis {
            name: "ball".into(),
            line: "ball: 0 of 9 frames measured".into(),
            is_complete: false,
            changes: vec![Change { lines: "min_radius_px = 9".into(), reason: "smaller".into() }],
            statuses: vec![PointStatus::Lost; 9],
            frames: vec![frame],
        };
        let diagnosis =
            Diagnosis { film: "x.mp4".into(), bodies: vec![body], movement: Some(panel), ..Diagnosis::default() };
        let page = diagnosis_page(&diagnosis);
        let places: Vec<usize> = ["0 of 9 frames measured", "min_radius_px = 9", "Frame 3", "What moves"]
            .into_iter()
            .map(|words| page.find(words).unwrap())
            .collect();
        assert!(places.is_sorted(), "{places:?}");
        assert!(page.contains("nothing &amp; nobody") && page.contains("a &lt; b") && !page.contains("http"), "{page}");
    }
}
