//! Numbers and units of length drawn into a picture with a font of 3 x 5 dots.

use image::{Rgb, RgbImage};

/// The width of a character, dots.
const WIDTH_DOTS: u32 = 3;
/// The height of a character, dots.
const HEIGHT_DOTS: u32 = 5;
/// The distance from one character to the next, dots.
const PITCH_DOTS: u32 = WIDTH_DOTS + 1;

/// Returns the rows of a character from top to bottom, three bits each, the left dot first. Unknown characters are
/// blank.
fn glyph_rows(letter: char) -> [u8; 5] {
    match letter {
        '0' => [0b111, 0b101, 0b101, 0b101, 0b111],
        '1' => [0b010, 0b110, 0b010, 0b010, 0b111],
        '2' => [0b111, 0b001, 0b111, 0b100, 0b111],
        '3' => [0b111, 0b001, 0b111, 0b001, 0b111],
        '4' => [0b101, 0b101, 0b111, 0b001, 0b001],
        '5' => [0b111, 0b100, 0b111, 0b001, 0b111],
        '6' => [0b111, 0b100, 0b111, 0b101, 0b111],
        '7' => [0b111, 0b001, 0b010, 0b010, 0b010],
        '8' => [0b111, 0b101, 0b111, 0b101, 0b111],
        '9' => [0b111, 0b101, 0b111, 0b001, 0b111],
        '-' => [0b000, 0b000, 0b111, 0b000, 0b000],
        '.' => [0b000, 0b000, 0b000, 0b000, 0b010],
        'm' => [0b000, 0b000, 0b111, 0b111, 0b101],
        'p' => [0b000, 0b110, 0b101, 0b110, 0b100],
        'x' => [0b000, 0b000, 0b101, 0b010, 0b101],
        _ => [0; 5],
    }
}

/// Returns the width of a text, px, with dots `scale` px wide.
pub(super) fn width(text: &str, scale: u32) -> u32 {
    (text.chars().count() as u32 * PITCH_DOTS).saturating_sub(1) * scale
}

/// Returns the height of a text, px, with dots `scale` px high.
pub(super) fn height(scale: u32) -> u32 {
    HEIGHT_DOTS * scale
}

/// Draws a text in black with its top left corner at a pixel and dots `scale` px wide; clips it at the edge.
pub(super) fn write(picture: &mut RgbImage, left: u32, top: u32, scale: u32, text: &str) {
    for (place, letter) in text.chars().enumerate() {
        let start = left + place as u32 * PITCH_DOTS * scale;
        let bits = glyph_rows(letter);
        for y in 0..HEIGHT_DOTS * scale {
            for x in 0..WIDTH_DOTS * scale {
                let dot = bits[(y / scale) as usize] >> (WIDTH_DOTS - 1 - x / scale) & 1;
                if dot == 1 && start + x < picture.width() && top + y < picture.height() {
                    picture.put_pixel(start + x, top + y, Rgb([0; 3]));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_reads_as_it_is_written() {
        let mut picture = RgbImage::from_pixel(width("-4.1", 1), height(1), Rgb([255; 3]));
        write(&mut picture, 0, 0, 1, "-4.1");
        let line = |y: u32| -> String {
            (0..picture.width()).map(|x| if picture.get_pixel(x, y).0[0] == 0 { '#' } else { ' ' }).collect()
        };
        let drawn: Vec<String> = (0..height(1)).map(line).collect();
        assert_eq!(
            drawn,
            ["    # #      # ", "    # #     ## ", "### ###      # ", "      #      # ", "      #  #  ###"]
        );
    }

    #[test]
    fn no_two_characters_look_alike() {
        let letters: Vec<char> = "0123456789-.mpx".chars().collect();
        for (k, a) in letters.iter().enumerate() {
            assert!(letters[..k].iter().all(|b| glyph_rows(*a) != glyph_rows(*b)), "{a}");
            assert_ne!(glyph_rows(*a), [0; 5], "{a}");
        }
    }
}
