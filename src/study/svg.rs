//! Texts in the figures.

use std::fmt::Write as _;

/// Writes a text element; `attributes` are added to its place.
pub(super) fn text(svg: &mut String, (x, y): (f64, f64), attributes: &str, words: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{words}</text>");
}

/// Formats a power of ten.
pub(super) fn power_of_ten(power: i32) -> String {
    match power {
        -4..=3 => format!("{:.*}", (-power).max(0) as usize, 10_f64.powi(power)),
        _ => format!("1e{power}"),
    }
}

/// Escapes text for XML.
pub(super) fn plain(text: &str) -> String {
    let letter = |letter: char| match letter {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        '"' => "&quot;".to_owned(),
        other if other.is_control() => " ".to_owned(),
        other => other.to_string(),
    };
    text.chars().map(letter).collect()
}
