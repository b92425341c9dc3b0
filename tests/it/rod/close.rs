//! A rod that is followed closely, from the fits of the frame before, against the fits from scratch.

use super::{EDGES, film, params, picture};
use ricochet::image::Image;
use ricochet::rod::{RodFinder, RodObservation};
use ricochet::synth::SimulatedFilm;

/// The frames of a block.
const BLOCK: u64 = 64;

/// Returns the rod of a frame where its true motion leads it in another frame.
fn predicted(world: &SimulatedFilm, near: &RodObservation, [from, to]: [u64; 2]) -> RodObservation {
    let (from, to) = (world.truth(from), world.truth(to));
    let moved = |a: Option<f64>, b: Option<f64>| b.unwrap() - a.unwrap();
    near.moved(moved(from.center_x_px, to.center_x_px), moved(from.center_y_px, to.center_y_px), 0.01)
}

/// Root mean square.
fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

#[test]
fn a_rod_that_is_followed_closely_is_where_the_fit_from_scratch_finds_it() {
    for seed in [3, 11, 42] {
        let world = film("rod", seed);
        let finder = RodFinder::new(&params(), 64, 160).unwrap();
        let mut bytes = vec![0; world.frame_bytes()];
        let (mut errors, mut full_errors, mut refused) = (Vec::new(), Vec::new(), 0);
        let mut near = finder.find(picture(&world, 0, &mut bytes).view()).unwrap();
        for index in 1..BLOCK {
            let image = picture(&world, index, &mut bytes);
            let expected = predicted(&world, &near, [index - 1, index]);
            let full = finder.follow(image.view(), &expected).unwrap();
            let close = finder.follow_closely(image.view(), &expected);
            refused += u32::from(close.is_none());
            near = close.unwrap_or(full);
            let middle_px = world.truth(index).center_y_px.unwrap();
            let pairs = near.rod.edges.iter().flatten().zip(full.rod.edges.iter().flatten()).zip(EDGES);
            for ((edge, full), offset) in pairs {
                let (Some(y), Some(full)) = (edge.y_px, full.y_px) else { continue };
                errors.push(y.value - middle_px - offset);
                full_errors.push(full.value - middle_px - offset);
            }
        }
        let (close, full) = (rms(&errors), rms(&full_errors));
        println!("seed {seed}: {refused} of {BLOCK} refused; {close:.4} px rms, from scratch {full:.4}");
        assert!(refused < 7, "{refused} frames are refused");
        assert!(close < 1.1 * full, "{close} px rms, from scratch {full}");
    }
}

#[test]
fn what_has_changed_since_the_frame_before_is_fitted_from_scratch() {
    let world = film("rod", 3);
    let finder = RodFinder::new(&params(), 64, 160).unwrap();
    let mut bytes = vec![0; world.frame_bytes()];
    let near = finder.find(picture(&world, 0, &mut bytes).view()).unwrap();
    let image = picture(&world, 1, &mut bytes);
    let mut darker = image.clone();
    darker.data_mut().iter_mut().for_each(|level| *level *= 0.7);
    for (change, image, near) in [("rows", &image, near.moved(0.0, 1.2, 0.01)), ("light", &darker, near)] {
        let close = finder.follow_closely(image.view(), &near).unwrap_or_else(|| panic!("{change}: lost"));
        let full = finder.follow(image.view(), &near).unwrap();
        for (edge, full) in close.rod.edges.iter().flatten().zip(full.rod.edges.iter().flatten()) {
            let (edge, full) = (edge.y_px.unwrap().value, full.y_px.unwrap().value);
            assert!((edge - full).abs() < 0.005, "{change}: {edge} px, from scratch {full}");
        }
    }
    assert_eq!(finder.follow_closely(Image::new(64, 160).view(), &near), None, "nothing is left to be found");
}
