//! Balls at a known position, because the whole ball was matched.

use super::scene::{Random, Scene};
use super::{finder, mean};
use ricochet::ball::Presence;
use ricochet::image::ImageView;
use ricochet::results::Circle;

#[test]
fn an_outline_is_right_with_a_fitting_sigma_where_little_of_the_rim_agrees() {
    for hidden in [0.0, 0.2, 0.4] {
        let (mut errors, mut pulls, mut doubted) = (Vec::new(), Vec::new(), 0);
        for seed in 0..120 {
            let scene = Scene::hard(seed, seed.is_multiple_of(2), hidden);
            let (data, mut r) = (scene.render(), Random(seed));
            // The typical error of an outline some frames earlier.
            let mut off = || r.uniform(-0.1, 0.1);
            let (x_px, y_px, radius_px) = (scene.x + off(), scene.y + off(), scene.radius + off());
            let near =
                Circle { x_px, y_px, radius_px, sigma_center_px: 0.1, sigma_radius_px: 0.1, visible_fraction: 1.0 };
            let (mut finder, view) =
                (finder(50.0, 68.0, &scene), ImageView::new(&data, scene.width, scene.height).unwrap());
            let Some(found) = finder.follow_closely(view, &near, Presence::Certain) else { continue };
            doubted += usize::from(finder.follow_closely(view, &near, Presence::Uncertain).is_none());
            for error in [found.x_px - scene.x, found.y_px - scene.y] {
                errors.push(error.abs());
                pulls.push((error / found.sigma_center_px).powi(2));
            }
        }
        let (worst, pull) = (errors.iter().copied().fold(0.0, f64::max), mean(&pulls).sqrt());
        let count = errors.len() / 2;
        println!(
            "{hidden} occluded: {count} of 120, mean {:.4}, worst {worst:.3} px, pull {pull:.2}; {doubted} searched again",
            mean(&errors)
        );
        assert!(count > 80 && doubted > 5, "{count} {doubted}");
        assert!(worst < 0.3 && (0.6..1.25).contains(&pull), "{worst} {pull}");
    }
}
