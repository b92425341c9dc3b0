//! The ball finder against drawn balls with known circles.

#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by unwrapping and prints what it measured")]

mod known_position;
mod paint;
mod scene;
mod shaded;
mod small;
mod tally;
mod textured;

use ricochet::ball::{BallFinder, BallParams, OutlineMethod, Presence};
use ricochet::image::ImageView;
use ricochet::results::Circle;
use scene::{Occluder, Random, Scene};
use tally::{Tally, mean};

fn finder(low: f64, high: f64, scene: &Scene) -> BallFinder {
    BallFinder::new(&BallParams::new(low, high), scene.width, scene.height).unwrap()
}

fn find(finder: &mut BallFinder, scene: &Scene) -> Option<Circle> {
    finder.find(ImageView::new(&scene.render(), scene.width, scene.height).unwrap())
}

fn hard_scenes(bright: bool, hidden: f64, seeds: std::ops::Range<u64>) -> Tally {
    let mut finder = finder(50.0, 68.0, &Scene::plain(1.0, 0.0));
    let mut tally = Tally::default();
    for seed in seeds {
        let scene = Scene::hard(seed, bright, hidden);
        tally.add(&scene, find(&mut finder, &scene));
    }
    println!("bright {bright} hidden {hidden}: {}", tally.line());
    tally
}

/// A lacrosse-like image: dense dark speckle, a background nearly as dark, and a flat surface that the ball touches.
fn lacrosse(seed: u64, surface: f64) -> Scene {
    let mut r = Random(seed);
    Scene {
        x: 128.0 + r.uniform(-8.0, 8.0),
        y: 120.0 + r.uniform(-8.0, 8.0),
        radius: 61.5,
        blur: r.uniform(0.6, 0.9),
        cover: 0.54,
        areas: (2.0, 40.0),
        transmission: 0.25,
        texture: r.uniform(1.0, 5.0),
        correlation: 3.0,
        side_light: 0.15,
        limb: 0.1,
        occluder: Some(Occluder {
            angle: std::f64::consts::FRAC_PI_2 + r.uniform(-0.03, 0.03),
            hidden: r.uniform(-0.01, 0.02),
            grey: surface,
            curvature: 0.0,
            texture: 5.0,
        }),
        seed,
        ..Scene::plain(170.0, r.uniform(40.0, 60.0))
    }
}

#[test]
fn hard_scenes_are_measured_or_refused_but_never_wrong() {
    let mut all = Tally::default();
    for (bright, hidden, limit, refusals) in [
        (true, 0.0, 0.025, 1),
        (true, 0.2, 0.04, 2),
        (true, 0.4, 0.06, 8),
        (false, 0.0, 0.025, 0),
        (false, 0.2, 0.04, 0),
        (false, 0.4, 0.06, 0),
    ] {
        let tally = hard_scenes(bright, hidden, 1000..1020);
        assert!(tally.mean() <= limit, "{}", tally.line());
        assert!(tally.worst() <= 1.0, "{}", tally.line());
        assert!(tally.refused() <= refusals, "{}", tally.line());
        assert!(mean(&tally.radius).abs() <= 0.02, "{}", tally.line());
        all.ratios.extend(tally.ratios);
        all.radius_ratios.extend(tally.radius_ratios);
    }
    assert!((0.62..0.8).contains(&all.covered(1.0)) && (0.9..0.99).contains(&all.covered(2.0)), "{}", all.line());
    assert!(all.radius_covered(1.0) > 0.5 && all.radius_covered(2.0) > 0.85, "{}", all.line());
}

#[test]
fn limb_darkening_does_not_bias_the_radius() {
    let mut finder = finder(50.0, 68.0, &Scene::plain(1.0, 0.0));
    for (ball, ground) in [(190.0, 40.0), (120.0, 205.0)] {
        for limb in [0.0, 0.15, 0.3] {
            let scene = |seed: u64| Scene { limb, cover: 0.35, seed, ..Scene::plain(ball, ground) };
            let off: Vec<f64> = (0..6).map(|k| find(&mut finder, &scene(k)).unwrap().radius_px - 57.2).collect();
            println!("{ball} on {ground}, darkened by {limb}: radius {:+.4} px", mean(&off));
            // With the limb darkening ignored, the radius was up to 0.1 px smaller or 0.04 px larger.
            assert!(mean(&off).abs() < 0.01, "{ball} on {ground}, darkened by {limb}: {off:?}");
        }
    }
}

#[test]
fn light_from_a_side_does_not_bias_the_centre() {
    for (ball, ground, radius) in [(190.0, 60.0, 57.2), (120.0, 205.0, 57.2), (120.0, 205.0, 10.4)] {
        let mut finder = finder(0.9 * radius, 1.1 * radius, &Scene::plain(1.0, 0.0));
        for limb in [0.0, 0.3] {
            let lit = Scene { limb, radius, side_light: 0.2, side_light_rad: Some(0.0), ..Scene::plain(ball, ground) };
            let off: Vec<f64> = (0..10)
                .map(|seed| find(&mut finder, &Scene { seed, noise: 1.0, ..lit.clone() }).unwrap().x_px - lit.x)
                .collect();
            println!("{ball} on {ground}, radius {radius}, darkened by {limb}: {:+.4} px", mean(&off));
            // Up to 0.04 px where the blur of the edge and the stronger darkening of the brighter limb are ignored.
            assert!(mean(&off).abs() < if radius < 20.0 { 0.008 } else { 0.004 }, "{off:?}");
        }
    }
}

#[test]
fn an_overexposed_ball_is_measured_from_unclipped_pixels_with_a_larger_sigma() {
    for bright in [true, false] {
        for exposure in [1.2, 1.4, 2.0, 3.0, 4.0] {
            let mut finder = finder(50.0, 68.0, &Scene::plain(1.0, 0.0));
            let mut tally = Tally::default();
            for seed in 0..50 {
                let scene = Scene::hard(seed, bright, 0.0);
                let data: Vec<f32> = scene.render().iter().map(|grey| (exposure * grey).round().min(255.0)).collect();
                tally.add(&scene, finder.find(ImageView::new(&data, scene.width, scene.height).unwrap()));
            }
            println!("bright {bright} exposure {exposure}: {}", tally.line());
            assert!(exposure > 1.5 || (tally.mean() < 0.025 && mean(&tally.radius).abs() < 0.1), "{}", tally.line());
            assert!(tally.worst() < 1.0 && tally.covered(2.0) > 0.9, "{}", tally.line());
            assert!(tally.radius_covered(2.0) > 0.9, "{}", tally.line());
        }
    }
}

#[test]
fn the_papers_marked_boundary_is_found_within_tenths_of_a_pixel_with_that_sigma() {
    let params = BallParams { outline: OutlineMethod::Marked, ..BallParams::new(50.0, 68.0) };
    let plain = Scene::plain(1.0, 0.0);
    let (mut marked, mut edges) =
        (BallFinder::new(&params, plain.width, plain.height).unwrap(), finder(50.0, 68.0, &plain));
    let mut tallies = Vec::new();
    for (bright, hidden) in [(true, 0.0), (false, 0.0), (true, 0.2), (false, 0.2)] {
        let (mut by_marks, mut by_edges) = (Tally::default(), Tally::default());
        for seed in 1000..1020 {
            let scene = Scene::hard(seed, bright, hidden);
            by_marks.add(&scene, find(&mut marked, &scene));
            by_edges.add(&scene, find(&mut edges, &scene));
        }
        println!("marked, bright {bright} hidden {hidden}: {}", by_marks.line());
        tallies.push((by_marks, by_edges));
    }
    for (by_marks, by_edges) in tallies {
        assert!(by_marks.refused() <= 10, "{}", by_marks.line());
        assert!(by_marks.mean() < 0.25 && by_marks.worst() < 1.5, "{}", by_marks.line());
        assert!(by_edges.mean() < 0.5 * by_marks.mean(), "edges must beat whole pixels");
        assert!(by_marks.covered(1.0) > 0.65 && by_marks.covered(2.0) > 0.9, "{}", by_marks.line());
    }
}

#[test]
fn a_plain_ball_is_found_within_a_hundredth_of_a_pixel() {
    for (ball, ground) in [(190.0, 40.0), (60.0, 200.0)] {
        let mut finder = finder(50.0, 68.0, &Scene::plain(1.0, 0.0));
        let mut tally = Tally::default();
        for seed in 0..10 {
            let mut r = Random(seed);
            let (x, y) = (128.0 + r.uniform(-9.0, 9.0), 128.0 + r.uniform(-9.0, 9.0));
            let scene = Scene { x, y, radius: r.uniform(56.0, 62.0), seed, ..Scene::plain(ball, ground) };
            tally.add(&scene, find(&mut finder, &scene));
        }
        println!("{ball} on {ground}: {}", tally.line());
        assert_eq!(tally.refused(), 0);
        assert!(tally.worst() < 0.02 && tally.mean() < 0.008, "{}", tally.line());
        assert!(mean(&tally.radius).abs() < 0.01, "{}", tally.line());
        assert!(mean(&tally.visible) < 0.001, "{}", tally.line());
    }
}

#[test]
fn a_lacrosse_ball_on_a_surface_is_found_in_every_frame() {
    let mut finder = finder(54.0, 70.0, &Scene::plain(1.0, 0.0));
    for surface in [15.0, 90.0, 150.0, 230.0] {
        let mut tally = Tally::default();
        for seed in 0..12 {
            let scene = lacrosse(seed, surface);
            let found = find(&mut finder, &scene);
            if found.is_none() {
                println!("lacrosse, surface {surface}, seed {seed}: refused");
            }
            tally.add(&scene, found);
        }
        println!("lacrosse, surface {surface}: {}", tally.line());
        assert_eq!(tally.refused(), 0, "{}", tally.line());
        assert!(tally.worst() < 0.3 && tally.mean() < 0.06, "{}", tally.line());
    }
}

#[test]
fn following_a_ball_gives_the_circle_of_a_full_search() {
    let mut finder = finder(50.0, 68.0, &Scene::plain(1.0, 0.0));
    let mut worst = 0.0_f64;
    let mut lost = 0;
    for seed in 0..24 {
        let scene = Scene::hard(seed, seed.is_multiple_of(2), [0.0, 0.2][(seed / 2 % 2) as usize]);
        let data = scene.render();
        let image = ImageView::new(&data, scene.width, scene.height).unwrap();
        let Some(found) = finder.find(image) else { continue };
        let mut r = Random(seed);
        let near = Circle {
            x_px: found.x_px + r.uniform(-2.0, 2.0),
            y_px: found.y_px + r.uniform(-2.0, 2.0),
            radius_px: found.radius_px + r.uniform(-0.1, 0.1),
            ..found
        };
        let Some(followed) = finder.follow(image, &near) else {
            lost += 1;
            continue;
        };
        let apart = [followed.x_px - found.x_px, followed.y_px - found.y_px, followed.radius_px - found.radius_px];
        let apart = apart.into_iter().map(f64::abs).fold(0.0, f64::max);
        println!("seed {seed}: {apart:.4}");
        worst = worst.max(apart);
    }
    println!("follow: worst difference {worst:.4} px, lost {lost}");
    // Side light is estimated over a gap in the rim only up to some width. Near that width one result is corrected and
    // the other is not.
    assert!(worst < 0.015, "{worst}");
    assert_eq!(lost, 0);
}

#[test]
fn following_searches_no_farther_than_documented() {
    let params = |outline| BallParams { outline, ..BallParams::new(50.0, 68.0) };
    let mut found = 0;
    for seed in 0..60 {
        let scene = Scene::hard(seed, seed.is_multiple_of(2), [0.0, 0.2, 0.4][(seed / 2 % 3) as usize]);
        let (data, mut r) = (scene.render(), Random(seed));
        let mut off = |most: f64| r.uniform(-most, most);
        let (x_px, y_px, radius_px) = (scene.x + off(9.0), scene.y + off(9.0), scene.radius + off(6.0));
        let near = Circle { x_px, y_px, radius_px, sigma_center_px: 0.1, sigma_radius_px: 0.1, visible_fraction: 1.0 };
        let elsewhere = changed_beyond(&scene, &data, &near, BallFinder::FOLLOW_RANGE_PX);
        for outline in [OutlineMethod::Edges, OutlineMethod::Marked] {
            let mut finder = BallFinder::new(&params(outline), scene.width, scene.height).unwrap();
            let [here, there] = [&data, &elsewhere]
                .map(|data| finder.follow(ImageView::new(data, scene.width, scene.height).unwrap(), &near));
            assert_eq!(here, there, "seed {seed}");
            found += usize::from(here.is_some());
        }
    }
    println!("{found} of 120 followed");
    assert!(found > 40, "{found}");
}

#[test]
fn following_closely_searches_no_farther_than_documented() {
    let mut found = 0;
    for seed in 0..60 {
        let scene = Scene::hard(seed, seed.is_multiple_of(2), 0.0);
        let (data, mut r) = (scene.render(), Random(seed));
        let mut off = |most: f64| r.uniform(-most, most);
        let (x_px, y_px, radius_px) = (scene.x + off(0.9), scene.y + off(0.9), scene.radius + off(0.9));
        let near = Circle { x_px, y_px, radius_px, sigma_center_px: 0.1, sigma_radius_px: 0.1, visible_fraction: 1.0 };
        let elsewhere = changed_beyond(&scene, &data, &near, BallFinder::CLOSE_RANGE_PX);
        for outline in [OutlineMethod::Edges, OutlineMethod::Marked] {
            let params = BallParams { outline, ..BallParams::new(50.0, 68.0) };
            let mut finder = BallFinder::new(&params, scene.width, scene.height).unwrap();
            let [here, there] = [&data, &elsewhere].map(|data| {
                finder.follow_closely(
                    ImageView::new(data, scene.width, scene.height).unwrap(),
                    &near,
                    Presence::Uncertain,
                )
            });
            assert_eq!(here, there, "seed {seed}");
            found += usize::from(here.is_some());
        }
    }
    assert!(found > 40, "{found} of 120 followed closely");
}

/// The image with different content farther than `range_px` from a circle.
fn changed_beyond(scene: &Scene, data: &[f32], near: &Circle, range_px: f64) -> Vec<f32> {
    let (mut r, reach) = (Random(1), near.radius_px + range_px);
    let level = |(k, level): (usize, &f32)| {
        let (x, y) = ((k % scene.width) as f64, (k / scene.width) as f64);
        let is_near = (x - near.x_px).abs() <= reach && (y - near.y_px).abs() <= reach;
        if is_near { *level } else { r.uniform(0.0, 255.0) as f32 }
    };
    data.iter().enumerate().map(level).collect()
}

#[test]
fn the_same_image_gives_the_same_circle_after_any_other() {
    let (one, other) = (Scene::hard(3, true, 0.2), Scene::hard(4, false, 0.4));
    let mut used = finder(50.0, 68.0, &one);
    let first = find(&mut used, &one);
    find(&mut used, &other);
    assert!(first.is_some());
    assert_eq!(find(&mut used, &one), first);
    assert_eq!(find(&mut finder(50.0, 68.0, &one), &one), first);
}

#[test]
fn no_ball_is_found_in_an_image_without_one() {
    search_empty_images(0..16);
}

#[test]
#[ignore = "long"]
fn no_ball_is_found_in_many_images_without_one() {
    search_empty_images(1000..1080);
}

fn search_empty_images(seeds: std::ops::Range<u64>) {
    let mut narrow = finder(50.0, 68.0, &Scene::plain(1.0, 0.0));
    let mut wide = finder(20.0, 110.0, &Scene::plain(1.0, 0.0));
    for seed in seeds {
        let mut r = Random(seed);
        let occluder = (seed.is_multiple_of(2)).then(|| Occluder {
            angle: r.uniform(0.0, 6.0),
            hidden: r.uniform(0.1, 0.6),
            grey: 200.0,
            curvature: [0.0, 1.0 / 300.0][(seed / 2 % 2) as usize],
            texture: 8.0,
        });
        let (texture, correlation) = (r.uniform(2.0, 40.0), r.uniform(1.0, 8.0));
        let empty =
            Scene { ball: None, texture, correlation, occluder, seed, ..Scene::plain(0.0, r.uniform(60.0, 180.0)) };
        assert_eq!(find(&mut narrow, &empty), None, "seed {seed}");
        assert_eq!(find(&mut wide, &empty), None, "seed {seed}");
    }
}

#[test]
fn balls_out_of_focus_are_found_and_their_uncertainty_grows_with_the_blur() {
    use ricochet::synth::{MotionSetup, PatternSetup, Scenario, SimulatedFilm};
    let mut finder = BallFinder::new(&BallParams::new(50.0, 70.0), 192, 192).unwrap();
    for (pattern, blur_px, least) in [("e-II", 1.4, 10), ("e-I", 1.4, 12), ("f-I", 2.0, 14), ("b-I", 2.0, 16)] {
        let (mut found, mut squares, mut pulls) = (0, 0.0, 0.0);
        for seed in 0..4 {
            let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
            scenario.seed = seed;
            (scenario.camera.width_px, scenario.camera.height_px, scenario.camera.blur_px) = (192, 192, blur_px);
            scenario.body.diameter_mm = 57.0;
            scenario.body.pattern = PatternSetup::paper(pattern).unwrap();
            let start_px = [94.2, 95.6];
            scenario.motion =
                MotionSetup::Constant { vx_px_frame: 0.37, vy_px_frame: 0.21, omega_deg_frame: 7.1, start_px };
            let world = SimulatedFilm::new(&scenario).unwrap();
            for index in 0..4 {
                let mut bytes = vec![0; world.frame_bytes()];
                world.render(index, &mut bytes);
                let pixels: Vec<f32> = bytes.into_iter().map(f32::from).collect();
                let Some(circle) = finder.find(ImageView::new(&pixels, 192, 192).unwrap()) else { continue };
                let truth = world.truth(index);
                let off = (circle.x_px - truth.center_x_px.unwrap()).hypot(circle.y_px - truth.center_y_px.unwrap());
                assert!(off < 0.5 && (circle.radius_px - 57.0).abs() < 0.4, "{pattern}: {off} px, {circle:?}");
                found += 1;
                squares += off * off;
                pulls += 0.5 * (off / circle.sigma_center_px).powi(2);
            }
        }
        let (rms, pull) = (f64::sqrt(squares / f64::from(found)), f64::sqrt(pulls / f64::from(found)));
        println!("{pattern} at {blur_px} px of blur: {found} of 16, {rms:.3} px rms, {pull:.2} sigma");
        assert!(found >= least, "{pattern}: {found} of 16");
        assert!(pull < 1.4, "{pattern}: {pull} sigma");
    }
}

#[test]
fn no_ball_is_found_in_black_white_and_noisy_images() {
    let mut finder = finder(20.0, 110.0, &Scene::plain(1.0, 0.0));
    let mut r = Random(7);
    let noise: Vec<f32> = (0..256 * 256).map(|_| r.uniform(0.0, 255.0) as f32).collect();
    for data in [vec![0.0; 256 * 256], vec![255.0; 256 * 256], noise] {
        let image = ImageView::new(&data, 256, 256).unwrap();
        assert_eq!(finder.find(image), None);
        let near = Circle {
            x_px: 128.0,
            y_px: 128.0,
            radius_px: 57.0,
            sigma_center_px: 0.02,
            sigma_radius_px: 0.02,
            visible_fraction: 1.0,
        };
        assert_eq!(finder.follow(image, &near), None);
        for place in [f64::NAN, f64::INFINITY, -1e30, 1e9] {
            assert_eq!(finder.follow(image, &Circle { x_px: place, ..near }), None);
            assert_eq!(finder.follow(image, &Circle { radius_px: place, ..near }), None);
        }
    }
}

#[test]
fn no_ball_is_found_in_images_smaller_than_the_ball() {
    for (width, height) in [(1, 1), (1, 300), (7, 7), (9, 9), (16, 40), (40, 40), (0, 0)] {
        for params in [BallParams::new(50.0, 68.0), BallParams::new(6.0, 200.0)] {
            let mut finder = BallFinder::new(&params, width, height).unwrap();
            let data: Vec<f32> = (0..width * height).map(|i| ((i * 7919) % 251) as f32).collect();
            assert_eq!(finder.find(ImageView::new(&data, width, height).unwrap()), None);
        }
    }
}

#[test]
fn a_ball_partly_out_of_the_image_is_found_with_its_visible_fraction() {
    for (x, y) in [(30.0, 128.0), (128.3, 240.0), (128.0, 128.0), (25.0, 230.0)] {
        let scene = Scene { x, y, cover: 0.3, seed: 5, ..Scene::plain(190.0, 40.0) };
        let circle = find(&mut finder(50.0, 68.0, &scene), &scene).unwrap();
        assert!((circle.x_px - x).abs() < 0.1 && (circle.y_px - y).abs() < 0.1, "{circle:?}");
        let share = scene.visible();
        assert!((circle.visible_fraction - share).abs() < 0.03, "{circle:?} {share}");
    }
}

#[test]
fn balls_of_unknown_radius_are_found() {
    for radius in [12.3, 21.0, 34.6, 57.0, 80.3, 104.0] {
        for (ball, ground) in [(190.0, 50.0), (70.0, 200.0)] {
            let scene = Scene { radius, cover: 0.3, texture: 6.0, areas: (4.0, 40.0), ..Scene::plain(ball, ground) };
            let circle = find(&mut finder(10.0, 120.0, &scene), &scene);
            println!("radius {radius} {ball} on {ground}: {circle:?}");
            let circle = circle.unwrap();
            let error = (circle.x_px - scene.x).hypot(circle.y_px - scene.y);
            assert!(error < 0.12 && (circle.radius_px - radius).abs() < 0.12, "{error}");
        }
    }
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    let refuse = |params: BallParams| BallFinder::new(&params, 640, 480).unwrap_err().to_string();
    assert!(refuse(BallParams::new(1.9, 60.0)).contains("min_radius_px = 1.9"));
    assert!(refuse(BallParams::new(f64::NAN, 60.0)).contains("min_radius_px = NaN"));
    assert!(refuse(BallParams::new(50.0, 40.0)).contains("max_radius_px = 40"));
    let roi = |roi| BallParams { roi_px: Some(roi), ..BallParams::new(50.0, 60.0) };
    assert!(refuse(roi([600, 0, 41, 100])).contains("roi_px = [600, 0, 41, 100]"));
    assert!(refuse(roi([0, 0, 0, 100])).contains("640 x 480"));
}

#[test]
fn a_ball_outside_the_searched_region_is_not_found() {
    let scene = Scene { width: 400, x: 300.0, ..Scene::plain(190.0, 40.0) };
    let region = |roi| BallParams { roi_px: Some(roi), ..BallParams::new(50.0, 68.0) };
    let mut beside = BallFinder::new(&region([0, 0, 200, 256]), 400, 256).unwrap();
    assert_eq!(find(&mut beside, &scene), None);
    let mut around = BallFinder::new(&region([201, 31, 199, 200]), 400, 256).unwrap();
    let circle = find(&mut around, &scene).unwrap();
    assert!((circle.x_px - 300.0).abs() < 0.02 && (circle.y_px - scene.y).abs() < 0.02);
}

#[test]
#[ignore = "long"]
fn time_of_a_frame_is_printed() {
    for (low, high) in [(50.0, 68.0), (20.0, 200.0)] {
        let mut finder = BallFinder::new(&BallParams::new(low, high), 512, 512).unwrap();
        let scene = Scene { width: 512, height: 512, x: 300.2, ..Scene::hard(3, true, 0.2) };
        let data = scene.render();
        let image = ImageView::new(&data, 512, 512).unwrap();
        let circle = finder.find(image).unwrap();
        for _ in 0..20 {
            finder.find(image);
        }
        let Some(start) = clock() else { return };
        for _ in 0..100 {
            finder.find(image);
        }
        println!("find {low}..{high}: {:.3} ms", (clock().unwrap() - start) * 10.0);
        let Some(start) = clock() else { return };
        for _ in 0..300 {
            finder.follow(image, &circle);
        }
        println!("follow {low}..{high}: {:.3} ms", (clock().unwrap() - start) / 0.3);
    }
}

/// The processor time of this thread in seconds, or `None` where the system does not report it.
fn clock() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

#[test]
#[ignore = "long"]
fn statistics_of_hard_scenes() {
    for bright in [true, false] {
        for hidden in [0.0, 0.2, 0.4] {
            let tally = hard_scenes(bright, hidden, 0..200);
            assert!(tally.mean() <= [0.025, 0.04, 0.06][(hidden * 5.0) as usize], "{}", tally.line());
            assert!(tally.worst() < 1.0, "{}", tally.line());
            assert!((0.65..0.8).contains(&tally.covered(1.0)), "{}", tally.line());
            assert!((0.9..0.99).contains(&tally.covered(2.0)), "{}", tally.line());
            assert!(mean(&tally.radius).abs() <= 0.015, "{}", tally.line());
            assert!((0.65..0.8).contains(&tally.radius_covered(1.0)), "{}", tally.line());
            assert!((0.9..0.99).contains(&tally.radius_covered(2.0)), "{}", tally.line());
        }
    }
}
