use super::super::edge_fit::fit_step_edge;
use super::super::edge_fit::tests::{SCENE, Scene, expected, picture};
use super::*;

/// The fit of an edge at 20.3 px, from which the frames of these tests start.
fn before() -> FittedEdge {
    fit_step_edge(picture(&Scene { seed: 77, ..SCENE }).view(), &expected(20.0)).unwrap().fitted.unwrap()
}

/// Fits the edge of a scene from the frame before, where it is predicted at 20.3 px.
fn closely(scene: Scene) -> Option<Edge> {
    fit_close_edge(picture(&scene).view(), &expected(20.3), &before())
}

#[test]
fn a_close_fit_is_as_exact_and_as_certain_as_that_from_scratch() {
    let (mut errors, mut pulls, rounds) = ([0.0; 2], 0.0, 40);
    for round in 0..rounds {
        let at = 20.2 + 0.005 * f64::from(round);
        let scene = Scene { at, slope: 0.01 - 0.0005 * f64::from(round), seed: 200 + round as u64, ..SCENE };
        let close = closely(scene).unwrap_or_else(|| panic!("{at} px is refused"));
        let full = fit_step_edge(picture(&scene).view(), &expected(20.0)).unwrap();
        errors[0] += (close.at.value - at).powi(2) / f64::from(rounds);
        errors[1] += (full.at.value - at).powi(2) / f64::from(rounds);
        pulls += ((close.at.value - at) / close.at.sigma).powi(2) / f64::from(rounds);
        // From scratch, noise may count as speckles, which are less certain.
        let is_alike = full.is_speckled != close.is_speckled || (close.at.sigma / full.at.sigma - 1.0).abs() < 0.2;
        assert!(is_alike, "{close:?} {full:?}");
    }
    let [close, full] = errors.map(f64::sqrt);
    eprintln!("{close:.5} px rms, from scratch {full:.5}, pulls {:.2}", pulls.sqrt());
    assert!(close < 1.1 * full && (0.6..1.4).contains(&pulls.sqrt()), "{close} px, {full} from scratch, {pulls}");
}

#[test]
fn an_edge_that_has_changed_is_refused() {
    let change = |scene: Scene| closely(Scene { seed: 9, ..scene });
    assert!(change(SCENE).is_some(), "the same edge");
    assert!(change(Scene { at: 21.6, ..SCENE }).is_none(), "moved");
    assert!(change(Scene { light: 130.0, ..SCENE }).is_none(), "darker");
    assert!(change(Scene { light: 20.0, ..SCENE }).is_none(), "covered");
    assert!(change(Scene { noise: 6.0, ..SCENE }).is_none(), "noisier");
    let outside = fit_close_edge(picture(&SCENE).view(), &ExpectedEdge { room: [16, 39], ..expected(20.3) }, &before());
    assert!(outside.is_none(), "out of the allowed range");
}

#[test]
fn slowly_changing_light_is_followed() {
    let mut fitted = before();
    for frame in 0..10_u32 {
        let light = SCENE.light + f64::from(frame);
        let scene = Scene { light, seed: 300 + u64::from(frame), ..SCENE };
        let edge = fit_close_edge(picture(&scene).view(), &expected(20.3), &fitted).unwrap();
        assert!((edge.at.value - SCENE.at).abs() < 4.0 * edge.at.sigma, "{frame}: {edge:?}");
        assert!((edge.paints_dn[1].value - light).abs() < 1.0, "{frame}: {edge:?}");
        fitted = edge.fitted.unwrap();
    }
}
