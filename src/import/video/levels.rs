//! The grey levels of a film's pixels.

use super::stream::Stream;
use crate::image::PixelFormat;

/// The pixel layout of a film, as ffmpeg names it, and the grey levels that are made of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Levels {
    /// Name of the stored layout: `yuv420p10le`.
    pub(super) layout: String,
    /// Significant bits of a stored level.
    pub(super) bits: u32,
    /// Format of the grey levels.
    pub(super) format: PixelFormat,
    /// The rule that makes the levels; empty for a grey film.
    pub(super) rule: String,
}

impl Levels {
    /// Returns the levels of the first video stream, from ffprobe's names of its layout and range.
    pub(super) fn from_stream(stream: &Stream) -> Self {
        let layout = stream.text("pix_fmt");
        let bits = layout_bits(layout);
        let format = match bits {
            ..=8 => PixelFormat::Mono8,
            9 | 10 => PixelFormat::Mono10,
            11 | 12 => PixelFormat::Mono12,
            _ => PixelFormat::Mono16,
        };
        let is_full = stream.text("color_range") == "pc" || layout.starts_with("yuvj");
        let range = if is_full { Range::Full } else { Range::Limited };
        Self { layout: layout.to_owned(), bits, format, rule: grey_rule(layout, range) }
    }

    /// Returns the name of the grey layout that ffmpeg writes.
    pub(super) fn grey_layout(&self) -> &'static str {
        match self.format {
            PixelFormat::Mono8 => "gray",
            PixelFormat::Mono10 => "gray10le",
            PixelFormat::Mono12 => "gray12le",
            PixelFormat::Mono16 => "gray16le",
        }
    }

    /// Returns the filters of ffmpeg that make grey levels, with a comma before each: `,format=...`. A Bayer mosaic
    /// becomes colours first.
    pub(super) fn filters(&self) -> String {
        let by_way_of = match self.layout.strip_prefix("bayer_") {
            Some(_) if self.bits > 8 => ",format=rgb48le",
            Some(_) => ",format=rgb24",
            None => "",
        };
        format!("{by_way_of},format={}", self.grey_layout())
    }
}

/// Returns the bits of a level from the name of a layout: `gray12le`, `yuv420p10le`, `rgb48be`, `p010le`; 8 if the name
/// states none.
fn layout_bits(layout: &str) -> u32 {
    let name = layout.trim_end_matches("le").trim_end_matches("be");
    let digits = name.trim_start_matches(|letter: char| !letter.is_ascii_digit());
    let last = name.rsplit(|letter: char| !letter.is_ascii_digit()).next().unwrap_or_default();
    let number = last.parse().unwrap_or(0);
    match name {
        // The numbers of these layouts are the bits of a pixel, or no bits.
        _ if name.starts_with("nv20") => 10,
        _ if name.starts_with("nv") => 8,
        _ if name.starts_with("rgb48") || name.starts_with("bgr48") => 16,
        _ if name.starts_with("rgba64") || name.starts_with("bgra64") => 16,
        _ if name.starts_with("x2rgb10") || name.starts_with("x2bgr10") => 10,
        _ if name.starts_with("p0") || name.starts_with("p2") || name.starts_with("p4") || name.starts_with("y2") => {
            digits.get(1..).and_then(|digits| digits.parse().ok()).filter(|bits| (9..=16).contains(bits)).unwrap_or(8)
        }
        _ if (9..=16).contains(&number) => number,
        _ => 8,
    }
}

/// The levels of luma that stand for black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Range {
    /// All levels.
    Full,
    /// 16 to 235 of 255.
    Limited,
}

/// Describes how grey levels are made of a layout; empty for a grey one.
fn grey_rule(layout: &str, range: Range) -> String {
    let has_alpha = ["yuva", "rgba", "bgra", "argb", "abgr", "gbrap", "ya"].iter().any(|name| layout.starts_with(name));
    let alpha = if has_alpha { ", without its transparency" } else { "" };
    let is_rgb = ["rgb", "bgr", "gbr", "argb", "abgr", "pal", "0rgb", "0bgr", "x2"].iter();
    if layout.starts_with("gray") {
        String::new()
    } else if let Some(filters) = layout.strip_prefix("bayer_") {
        let filters = filters.get(..4).unwrap_or_default().to_uppercase();
        format!("0.299 R + 0.587 G + 0.114 B of the interpolated Bayer filters {filters}")
    } else if is_rgb.clone().any(|name| layout.starts_with(name)) {
        format!("0.299 R + 0.587 G + 0.114 B of {layout}{alpha}")
    } else if range == Range::Limited && !layout.starts_with("ya") {
        format!("the luma of {layout}, black 16 and white 235 of 255 stretched to the full range{alpha}")
    } else {
        format!("the luma of {layout}{alpha}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_layouts_state_their_bits() {
        let known = [
            ("gray", 8),
            ("gray10le", 10),
            ("gray12be", 12),
            ("gray16le", 16),
            ("yuv420p", 8),
            ("yuvj444p", 8),
            ("yuv422p10le", 10),
            ("yuva444p12le", 12),
            ("nv12", 8),
            ("nv16", 8),
            ("nv20le", 10),
            ("p010le", 10),
            ("p016le", 16),
            ("y210le", 10),
            ("rgb24", 8),
            ("rgb565le", 8),
            ("rgb48le", 16),
            ("gbrp14le", 14),
            ("bayer_rggb8", 8),
            ("bayer_bggr16le", 16),
            ("pal8", 8),
            ("ya16le", 16),
        ];
        for (layout, expected) in known {
            assert_eq!(layout_bits(layout), expected, "{layout}");
        }
    }
}
