//! Balls before a ground whose brightness lies between their marks and their paint: no sign prevails along the rim.

use super::paint::{SIDE, picture};
use super::scene::{Random, Scene, Surface};
use super::tally::{Tally, mean};
use ricochet::ball::{BallFinder, BallParams};
use ricochet::image::ImageView;

/// A speckled sphere lit from one side, so that its rim is brighter than the ground, equal to it, and darker.
fn before_its_own_brightness(seed: u64) -> Scene {
    let mut r = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ 0x1f1f);
    let ball = r.uniform(150.0, 215.0);
    Scene {
        x: 128.0 + r.uniform(-30.0, 30.0),
        y: 128.0 + r.uniform(-30.0, 30.0),
        radius: r.uniform(32.0, 60.0),
        blur: r.uniform(0.5, 1.0),
        cover: r.uniform(0.35, 0.55),
        areas: (12.0, 60.0),
        transmission: r.uniform(0.1, 0.3),
        surface: Surface::Sphere,
        texture: r.uniform(2.0, 8.0),
        correlation: r.uniform(3.0, 6.0),
        gradient: r.uniform(-0.2, 0.2),
        side_light: r.uniform(0.3, 0.85),
        limb: r.uniform(0.0, 0.3),
        noise: r.uniform(1.0, 4.0),
        seed,
        ..Scene::plain(ball, ball * r.uniform(0.35, 0.65))
    }
}

/// The knowledge of the radius that a search starts from.
#[derive(Debug, Clone, Copy)]
enum Radius {
    Range,
    Expected,
}

fn search(seeds: std::ops::Range<u64>, radius: Radius) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let scene = before_its_own_brightness(seed);
        let range = BallParams::new(0.8 * scene.radius, 1.25 * scene.radius);
        let params = match radius {
            Radius::Range => range,
            Radius::Expected => BallParams { expected_radius_px: Some(1.01 * scene.radius), ..range },
        };
        let mut finder = BallFinder::new(&params, scene.width, scene.height).unwrap();
        let found = finder.find(ImageView::new(&scene.render(), scene.width, scene.height).unwrap());
        if let Some(circle) = found {
            let off = (circle.x_px - scene.x).hypot(circle.y_px - scene.y);
            if off > 4.0 * circle.sigma_center_px {
                println!("seed {seed}: off by {off:.2} px, sigma {:.2}", circle.sigma_center_px);
            }
        }
        tally.add(&scene, found);
    }
    println!("{radius:?}: {}", tally.line());
    tally
}

fn worst_ratio(tally: &Tally) -> f64 {
    tally.ratios.iter().copied().fold(0.0, f64::max)
}

/// The edges of one sign alone find a part of them.
#[test]
fn balls_as_bright_as_their_ground_are_found_by_their_texture() {
    for radius in [Radius::Range, Radius::Expected] {
        let tally = search(40..100, radius);
        assert!(tally.refused() <= 12, "{radius:?}: {}", tally.line());
        assert!(tally.worst() < 1.5 && worst_ratio(&tally) < 5.0, "{radius:?}: {}", tally.line());
        assert!(tally.covered(2.0) > 0.85 && mean(&tally.radius).abs() < 0.2, "{radius:?}: {}", tally.line());
    }
}

#[test]
#[ignore = "long"]
fn many_balls_as_bright_as_their_ground_are_right_or_refused() {
    for radius in [Radius::Range, Radius::Expected] {
        let tally = search(1000..2000, radius);
        let wrong = tally.ratios.iter().filter(|ratio| **ratio > 5.0).count();
        println!("{wrong} of {} coordinates beyond 5 sigmas, worst {:.1}", tally.ratios.len(), worst_ratio(&tally));
        assert!(wrong <= tally.ratios.len() / 100, "{radius:?}: {}", tally.line());
    }
}

#[test]
fn no_textured_ball_is_found_in_texture_or_paint() {
    let mut found = 0;
    for seed in 3000..3060 {
        let grey = picture(seed);
        for [low, high] in [[20.0, 32.0], [32.0, 50.0], [50.0, 68.0]] {
            let middle = 0.5 * (low + high);
            let params = BallParams { expected_radius_px: Some(middle), ..BallParams::new(low, high) };
            let mut finder = BallFinder::new(&params, SIDE, SIDE).unwrap();
            if let Some(circle) = finder.find(ImageView::new(&grey, SIDE, SIDE).unwrap()) {
                println!("seed {seed}: {circle:?}");
                found += 1;
            }
        }
    }
    assert_eq!(found, 0);
}
