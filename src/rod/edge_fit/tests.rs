use super::super::profiles::Direction;
use super::*;
use crate::image::Image;
use crate::numeric::normal_f64;

/// Approximately normal numbers: sums of twelve uniform ones.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

#[derive(Clone, Copy)]
struct Scene {
    at: f64,
    slope: f64,
    blur: f64,
    dark: f64,
    light: f64,
    noise: f64,
    seed: u64,
}

const SCENE: Scene = Scene { at: 20.3, slope: 0.0, blur: 0.76, dark: 20.0, light: 180.0, noise: 2.0, seed: 5 };

/// Draws 40 x 40 px with an edge along the rows whose position belongs to column 20.
fn picture(scene: &Scene) -> Image {
    let (mut image, mut noise) = (Image::new(40, 40), Noise(scene.seed));
    for y in 0..40 {
        for x in 0..40 {
            let (p, _) = normal_f64((y as f64 - scene.at - scene.slope * (x as f64 - 20.0)) / scene.blur);
            let level = scene.dark + (scene.light - scene.dark) * p + scene.noise * noise.next();
            image.data_mut()[y * 40 + x] = level as f32;
        }
    }
    image
}

fn expected(near: f64) -> ExpectedEdge<'static> {
    ExpectedEdge {
        direction: Direction::Rows,
        along: [6, 34],
        middle: 20.0,
        near,
        slope: 0.0,
        depth: [8, 8],
        room: [0, 39],
        sign: 1.0,
        clean: None,
        light: None,
    }
}

#[test]
fn an_edge_is_placed_to_some_thousandths_with_its_uncertainty() {
    let (mut squares, mut pulls, mut slope_pulls) = (0.0, 0.0, 0.0);
    let rounds = 40;
    for round in 0..rounds {
        let at = 20.0 + 0.025 * f64::from(round);
        let slope = 0.02 - 0.001 * f64::from(round);
        let scene = Scene { at, slope, seed: 100 + round as u64, ..SCENE };
        let edge = fit_step_edge(picture(&scene).view(), &expected(at.round())).unwrap();
        squares += (edge.at.value - at).powi(2) / f64::from(rounds);
        pulls += ((edge.at.value - at) / edge.at.sigma).powi(2) / f64::from(rounds);
        slope_pulls += ((edge.slope.value - slope) / edge.slope.sigma).powi(2) / f64::from(rounds);
    }
    eprintln!("rms {:.5} px, pulls {:.2}, of slopes {:.2}", squares.sqrt(), pulls.sqrt(), slope_pulls.sqrt());
    // Two grey levels of noise over 28 columns of 160 levels contrast: 0.004 px with all else known.
    assert!(squares.sqrt() < 0.008, "{}", squares.sqrt());
    assert!((0.6..1.4).contains(&pulls.sqrt()) && (0.6..1.4).contains(&slope_pulls.sqrt()), "{pulls} {slope_pulls}");
}

#[test]
fn the_direction_and_the_sign_are_as_expected() {
    let image = picture(&SCENE);
    let mut transposed = Image::new(40, 40);
    for y in 0..40 {
        for x in 0..40 {
            transposed.data_mut()[x * 40 + y] = image.view().row(y)[x];
        }
    }
    let upright = fit_step_edge(image.view(), &expected(20.0)).unwrap();
    let lying =
        fit_step_edge(transposed.view(), &ExpectedEdge { direction: Direction::Columns, ..expected(20.0) }).unwrap();
    assert_eq!(upright, lying);
    let other = fit_step_edge(image.view(), &ExpectedEdge { sign: -1.0, ..expected(20.0) });
    assert_eq!(other, Err(PointStatus::Lost));
}

#[test]
fn speckles_near_the_edge_do_not_move_it() {
    let mut image = picture(&SCENE);
    // Two thirds of the columns have something dark 2 px below the edge.
    for x in (0..40).filter(|x| x % 3 != 0) {
        for y in 22..26 {
            image.data_mut()[y * 40 + x] = 40.0;
        }
    }
    let edge = fit_step_edge(image.view(), &expected(20.0)).unwrap();
    assert!((edge.at.value - SCENE.at).abs() < 0.02 && edge.is_speckled, "{edge:?}");
}

#[test]
fn what_is_no_edge_is_refused_with_its_reason() {
    let refused =
        |scene: Scene, expected: ExpectedEdge<'_>| fit_step_edge(picture(&scene).view(), &expected).unwrap_err();
    let near = expected(20.0);
    let flat = Scene { light: 20.0, ..SCENE };
    assert!(matches!(refused(flat, near), PointStatus::Lost | PointStatus::LowContrast | PointStatus::LowCorrelation));
    let soft = refused(Scene { blur: 4.0, ..SCENE }, near);
    assert!(matches!(soft, PointStatus::LowContrast | PointStatus::LowCorrelation), "{soft:?}");
    assert_eq!(refused(Scene { noise: 40.0, ..SCENE }, near), PointStatus::LowContrast, "too faint");
    assert_eq!(refused(SCENE, ExpectedEdge { room: [16, 39], ..near }), PointStatus::OutOfFrame);
    assert_eq!(refused(Scene { at: 2.0, ..SCENE }, expected(2.0)), PointStatus::OutOfFrame);
}

#[test]
fn a_picture_without_noise_is_exact() {
    for at in [19.51, 19.75, 20.0, 20.25, 20.49] {
        let edge = fit_step_edge(picture(&Scene { at, noise: 0.0, ..SCENE }).view(), &expected(20.0)).unwrap();
        assert!((edge.at.value - at).abs() < 5e-4, "{edge:?} at {at}");
    }
}
