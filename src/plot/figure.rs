//! Figures as SVG files that need nothing else.

use maud::{Markup, PreEscaped, html};
use std::fmt::Write as _;

/// Height of the heading and of a line of the caption, px.
const HEADING: f64 = 34.0;
const LINE: f64 = 17.0;

/// The frame of a figure: a white page with a heading and a caption.
pub struct Figure<'a> {
    /// The heading.
    pub heading: &'a str,
    /// The lines of the caption.
    pub caption: &'a [String],
}

impl Figure<'_> {
    /// The height of heading and caption, px; the content is drawn below it.
    pub fn content_top(&self) -> f64 {
        HEADING + LINE * self.caption.len() as f64
    }

    /// Returns the text of an SVG file of `width` x `height` px: heading, caption and `content`.
    pub fn draw(&self, width: f64, height: f64, content: &Markup) -> String {
        let heading = printable(self.heading);
        let figure = html! {
            svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height)
                viewBox={ "0 0 " (width) " " (height) } role="img" aria-label=(heading) {
                style { (PreEscaped(include_str!("figure.css"))) }
                rect width=(width) height=(height) fill="#fff" {}
                text class="head" x="14" y="24" { (heading) }
                @for (number, line) in self.caption.iter().enumerate() {
                    text class="note" x="14" y=(px(HEADING + LINE * (number as f64 + 0.6))) { (printable(line)) }
                }
                (content)
            }
        };
        figure.into_string() + "\n"
    }
}

/// Replaces control characters, which XML does not allow.
fn printable(text: &str) -> String {
    text.replace(|letter: char| letter.is_control(), " ")
}

/// Formats a coordinate to a tenth of a pixel.
pub fn px(coordinate: f64) -> String {
    format!("{coordinate:.1}")
}

/// Returns the data of an SVG path through places (x, y), px; `None` leaves a gap.
pub fn polyline(places: impl IntoIterator<Item = Option<(f64, f64)>>) -> String {
    let (mut path, mut is_joined) = (String::new(), false);
    for place in places {
        if let Some((x, y)) = place {
            let _ = write!(path, "{}{x:.1} {y:.1}", if is_joined { 'L' } else { 'M' });
        }
        is_joined = place.is_some();
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_cannot_break_the_file() {
        let figure = Figure { heading: "x\"\u{1}y", caption: &["a<b".to_owned()] };
        let svg = figure.draw(10.0, 10.0, &html! { text { "t&t" } });
        assert!(svg.contains("x&quot; y") && svg.contains("a&lt;b") && svg.contains("t&amp;t"), "{svg}");
    }

    #[test]
    fn a_missing_place_is_a_gap() {
        let places = [Some((0.0, 1.0)), Some((1.0, 1.0)), None, Some((3.0, 2.0)), Some((4.0, 2.5))];
        assert_eq!(polyline(places), "M0.0 1.0L1.0 1.0M3.0 2.0L4.0 2.5");
    }
}
