//! Images with known levels, complete and damaged.

use super::decode_luma;
use super::sample::encode_picture;
use crate::camera::v4l2::FrameSize;

const SIZE: FrameSize = FrameSize { width_px: 48, height_px: 24 };

fn level(column: usize, row: usize) -> u8 {
    ((column * 41 + row * 97) % 256) as u8
}

fn sample() -> Vec<u8> {
    encode_picture((48, 24), level)
}

fn decoded(file: &[u8]) -> Result<Vec<u8>, String> {
    let mut pixels = vec![0; 48 * 24];
    decode_luma(file, SIZE, &mut pixels).map(|()| pixels)
}

#[test]
fn luma_comes_out_as_it_went_in_without_tables_and_whatever_the_colour() {
    let pixels = decoded(&sample()).unwrap();
    for (at, pixel) in pixels.iter().enumerate() {
        assert_eq!(*pixel, level(at % 48 / 8, at / 48 / 8), "at {}, {}", at % 48, at / 48);
    }
}

#[test]
fn padding_behind_the_image_is_ignored() {
    let mut file = sample();
    file.extend([0; 100]);
    assert_eq!(decoded(&file), decoded(&sample()));
}

#[test]
fn a_truncated_image_is_refused_wherever_it_is_cut() {
    let file = sample();
    for length in 0..file.len() {
        assert!(decoded(&file[..length]).is_err(), "cut at {length}");
        // Cut in the middle, with an end marker appended.
        let mut closed = file[..length.max(2)].to_vec();
        closed.extend([0xff, 0xd9]);
        let is_whole = length + 2 >= file.len();
        assert!(is_whole || decoded(&closed).is_err(), "cut at {length} and closed");
    }
}

#[test]
fn pictures_of_another_size_and_other_files_are_refused() {
    let mut pixels = vec![0; 32 * 32];
    assert_eq!(
        decode_luma(&sample(), FrameSize { width_px: 32, height_px: 32 }, &mut pixels).unwrap_err(),
        "a JPEG of 48x24 px instead of 32x32 px"
    );
    assert_eq!(decoded(b"\x89PNG and so on").unwrap_err(), "no JPEG start marker");
    let mut odd = sample();
    odd[3] = 0x01;
    assert!(decoded(&odd).unwrap_err().starts_with("a damaged JPEG: "));
}
