//! The page that shows whether a rig is ready.

use super::page::document;
use super::picture::{Crop, data_url, encode_png};
use crate::image::FrameMeta;
use maud::html;

/// One finding of the check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckRow {
    /// The quantity that was checked.
    pub name: String,
    /// The value with its unit.
    pub value: String,
    /// `good`, `fair`, `bad` or `unknown`.
    pub verdict: &'static str,
    /// Advice.
    pub advice: String,
}

/// A frame, or a part of it, as the camera sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckPicture {
    /// Shape of the frame.
    pub meta: FrameMeta,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The part shown: first column and row, columns and rows, px.
    pub crop: [usize; 4],
    /// The caption.
    pub caption: String,
}

/// Returns the page of a check: facts about the rig, pictures, and findings with their advice.
///
/// A picture whose frame does not unpack is left out.
///
/// # Panics
///
/// If the part of a picture exceeds its frame.
pub fn check_page(rig: &str, facts: &[String], rows: &[CheckRow], pictures: &[CheckPicture]) -> String {
    let bad: Vec<&str> = rows.iter().filter(|row| row.verdict == "bad").map(|row| row.name.as_str()).collect();
    let drawn = pictures.iter().filter_map(|picture| {
        let [x, y, width, height] = picture.crop;
        Some((&picture.caption, encode_png(picture.meta, &picture.bytes, Crop { x, y, width, height })?))
    });
    let body = html! {
        header {
            h1 { (rig) } p class="file" { "Rig check" } ul class="facts" { @for fact in facts { li { (fact.trim()) } } }
        }
        @if !bad.is_empty() { p class="alert" { "The rig is not ready: " (bad.join(", ")) "." } }
        section {
            h2 { "Camera view" }
            div class="moments" {
                @for (caption, png) in drawn {
                    figure { img class="moment" alt=(caption) src=(data_url(&png)); figcaption { (caption) } }
                }
            }
        }
        section {
            h2 { "Findings" }
            table class="files" {
                thead { tr { th { "quantity" } th { "value" } th { "verdict" } th {} } }
                tbody {
                    @for row in rows {
                        tr {
                            td { (row.name) } td { (row.value) }
                            td class=[(row.verdict == "bad").then_some("far")] { (row.verdict) }
                            td { (row.advice) }
                        }
                    }
                }
            }
        }
    };
    document(&format!("{rig} – check"), None, &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_findings_come_first_and_pictures_are_inside() {
        let row = |name: &str, verdict| CheckRow {
            name: name.into(),
            value: "3 <".into(),
            verdict,
            advice: "less & less".into(),
        };
        let meta = FrameMeta { width_px: 4, height_px: 4, stride_bytes: 4, ..FrameMeta::default() };
        let picture = CheckPicture { meta, bytes: vec![7; 16], crop: [0, 0, 4, 4], caption: "all".into() };
        let page = check_page("a&b", &[], &[row("black", "good"), row("saturated", "bad")], &[picture]);
        assert!(
            page.contains("The rig is not ready: saturated.") && page.contains("src=\"data:image/png;base64,iVBOR")
        );
        assert!(page.contains("a&amp;b") && page.contains("3 &lt;") && !page.contains("http"), "{page}");
    }
}
