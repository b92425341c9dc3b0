//! Plain balls under one lamp: the contrast along the rim changes several times over, and its sign with it.

use super::scene::{Random, Scene, Surface};
use super::tally::Tally;
use ricochet::ball::{BallFinder, BallParams};
use ricochet::image::ImageView;

/// A sphere without marks that is bright on the side of the lamp, and from brighter to darker than the ground on the other.
fn under_a_lamp(seed: u64) -> Scene {
    let mut r = Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5ade);
    let ball = r.uniform(90.0, 150.0);
    Scene {
        x: 128.0 + r.uniform(-30.0, 30.0),
        y: 128.0 + r.uniform(-30.0, 30.0),
        radius: r.uniform(25.0, 60.0),
        blur: r.uniform(0.5, 1.0),
        cover: 0.0,
        surface: Surface::Sphere,
        texture: r.uniform(0.0, 3.0),
        correlation: r.uniform(3.0, 12.0),
        gradient: r.uniform(-0.2, 0.2),
        side_light: r.uniform(0.4, 0.85),
        limb: r.uniform(0.0, 0.3),
        noise: r.uniform(1.0, 3.0),
        seed,
        ..Scene::plain(ball, ball * r.uniform(0.2, 0.7))
    }
}

#[test]
fn plain_balls_under_one_lamp_are_found_within_their_uncertainty() {
    let mut tally = Tally::default();
    for seed in 0..120 {
        let scene = under_a_lamp(seed);
        let radius = scene.radius;
        let params =
            BallParams { expected_radius_px: Some(1.01 * radius), ..BallParams::new(0.8 * radius, 1.25 * radius) };
        let mut finder = BallFinder::new(&params, scene.width, scene.height).unwrap();
        tally.add(&scene, finder.find(ImageView::new(&scene.render(), scene.width, scene.height).unwrap()));
    }
    println!("{}", tally.line());
    let worst = tally.ratios.iter().copied().fold(0.0, f64::max);
    assert!(tally.refused() <= 5 && worst < 5.0, "{} refused, worst {worst} sigmas", tally.refused());
    assert!(tally.mean() < 0.1, "{} px", tally.mean());
}
