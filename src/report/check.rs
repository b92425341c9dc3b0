//! The page that tells whether a rig is ready.

use super::base64;
use super::number::escape;
use super::page::{foot, head};
use super::picture::{Crop, png};
use crate::image::FrameMeta;
use std::fmt::Write as _;

/// One thing that was looked at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CheckRow {
    /// What.
    pub name: String,
    /// The number with its unit.
    pub value: String,
    /// `good`, `fair`, `bad` or `unknown`.
    pub verdict: &'static str,
    /// Advice.
    pub words: String,
}

/// A picture of what the camera sees.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckPicture {
    /// Shape of the frame.
    pub meta: FrameMeta,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// The part shown: first column and row, columns and rows, px.
    pub crop: [usize; 4],
    /// What it shows.
    pub caption: String,
}

/// The page: facts, findings with their advice, pictures.
pub fn check_page(rig: &str, facts: &[String], rows: &[CheckRow], pictures: &[CheckPicture]) -> String {
    let mut html = head(&format!("{rig} – check"));
    let items: String = facts.iter().map(|fact| format!("<li>{}</li>", escape(fact.trim()))).collect();
    let _ = write!(
        html,
        "<header><h1>{}</h1><p class=\"file\">Rig check</p><ul class=\"facts\">{items}</ul></header>",
        escape(rig)
    );
    let bad: Vec<String> = rows.iter().filter(|row| row.verdict == "bad").map(|row| escape(&row.name)).collect();
    if !bad.is_empty() {
        let _ = write!(html, "<p class=\"alert\">The rig is not ready: {}.</p>", bad.join(", "));
    }
    html.push_str("<section><h2>What the camera sees</h2><div class=\"moments\">");
    for picture in pictures {
        let [x, y, width, height] = picture.crop;
        let Some(file) = png(picture.meta, &picture.bytes, Crop { x, y, width, height }) else { continue };
        let (data, caption) = (base64::encode(&file), escape(&picture.caption));
        let _ = write!(
            html,
            "<figure><img class=\"moment\" alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
        );
    }
    html.push_str("</div></section><section><h2>Findings</h2><table class=\"files\"><thead><tr><th>looked at</th><th>found</th><th>verdict</th><th></th></tr></thead><tbody>");
    for row in rows {
        let class = if row.verdict == "bad" { " class=\"far\"" } else { "" };
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{}</td><td{class}>{}</td><td>{}</td></tr>",
            escape(&row.name),
            escape(&row.value),
            row.verdict,
            escape(&row.words)
        );
    }
    html.push_str("</tbody></table></section>");
    html.push_str(&foot(""));
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_bad_is_said_first_and_pictures_are_inside() {
        let row = |name: &str, verdict| CheckRow {
            name: name.into(),
            value: "3 <".into(),
            verdict,
            words: "less & less".into(),
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
