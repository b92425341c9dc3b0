//! Detection of defective pixels: those that read the same whatever is in front of them.

use super::grab::Grabbed;
use crate::failure::Failure;
use crate::image::{Correction, Frame, Image, PixelRect};

/// The minimum difference of a defective pixel from all but one of its neighbours, standard deviations of the noise.
const MIN_NOISE_SIGMAS: f64 = 10.0;
/// The minimum difference of a defective pixel relative to full scale. A lens spreads an object over more than two
/// pixels.
const MIN_FULL_SCALE_SHARE: f64 = 0.06;
/// The minimum fraction of the frames in which a defective pixel stands out.
const MIN_FRAMES_SHARE: f64 = 0.9;

/// Returns column and row of the pixels that stand out from their neighbours in at least [`MIN_FRAMES_SHARE`] of the
/// kept frames.
///
/// `noise_dn` is the standard deviation of the temporal noise, and `full_dn` full scale, both in DN.
pub(super) fn find_defects(
    grabbed: &Grabbed,
    correction: &Correction,
    noise_dn: f64,
    full_dn: f64,
) -> Result<Vec<[u32; 2]>, Failure> {
    let (width, height) = (grabbed.format.width_px as usize, grabbed.format.height_px as usize);
    let min_dn = (MIN_NOISE_SIGMAS * noise_dn).max(MIN_FULL_SCALE_SHARE * full_dn) as f32;
    let (mut image, mut counts) = (Image::default(), vec![0_u32; width * height]);
    for (meta, bytes) in &grabbed.frames {
        image.reshape(width, height);
        correction.unpack(
            &Frame { meta: *meta, bytes },
            PixelRect::whole(meta.width_px, meta.height_px),
            &mut image,
        )?;
        let data = image.view().data();
        let places = counts.iter_mut().enumerate();
        places.for_each(|(at, count)| *count += u32::from(stands_out(data, (at % width, at / width), width, min_dn)));
    }
    let min_frames = MIN_FRAMES_SHARE * grabbed.frames.len() as f64;
    let found = counts.iter().enumerate().filter(|(_, count)| **count > 0 && f64::from(**count) >= min_frames);
    Ok(found.map(|(at, _)| [(at % width) as u32, (at / width) as u32]).collect())
}

/// Whether a pixel is brighter, or darker, than all but one of its eight neighbours by more than `min_dn`.
fn stands_out(data: &[f32], (x, y): (usize, usize), width: usize, min_dn: f32) -> bool {
    let height = data.len() / width;
    let level = data[y * width + x];
    // The two largest differences of the neighbours above the pixel, and below it.
    let (mut brighter, mut darker) = ([f32::NEG_INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for row in y.saturating_sub(1)..(y + 2).min(height) {
        for column in x.saturating_sub(1)..(x + 2).min(width) {
            if (column, row) != (x, y) {
                let near = data[row * width + column];
                keep_largest_two(&mut brighter, near - level);
                keep_largest_two(&mut darker, level - near);
            }
        }
    }
    brighter[1] < -min_dn || darker[1] < -min_dn
}

/// Puts a number among the two largest so far, the largest first, if it is one of them.
fn keep_largest_two(largest: &mut [f32; 2], number: f32) {
    if number > largest[0] {
        *largest = [number, largest[0]];
    } else {
        largest[1] = largest[1].max(number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_or_two_pixels_stand_out_and_specks_do_not() {
        let mut data = vec![100.0; 12 * 9];
        let mut set = |places: &[usize], level: f32| places.iter().for_each(|at| data[*at] = level);
        set(&[0, 14, 15], 255.0);
        set(&[40], 30.0);
        set(&[68, 69, 80, 81], 255.0);
        set(&[107], 105.0);
        let out: Vec<usize> = (0..12 * 9).filter(|at| stands_out(&data, (at % 12, at / 12), 12, 20.0)).collect();
        assert_eq!(out, [0, 14, 15, 40]);
    }
}
