//! Films of cameras with a tone curve: grey levels that are a power of the light.

use ricochet::synth::{Scenario, SimulatedFilm};

use crate::measured_world::rows_of_pictures;

/// The frames as a camera of this gamma records them, rounded again with a dither that depends on the position only.
fn pictures(world: &SimulatedFilm, gamma: f64) -> impl Iterator<Item = Vec<u8>> {
    (0..world.frames()).map(move |index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        let mut state = index + 1;
        for byte in &mut bytes {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let dither = (state >> 40) as f64 / (1_u64 << 24) as f64;
            *byte = (255.0 * (f64::from(*byte) / 255.0).powf(gamma) + dither).floor().min(255.0) as u8;
        }
        bytes
    })
}

/// The error of the radius, px, and the largest error, in sigmas, of the numbers of the collision that a tone curve
/// affects most.
fn off(world: &SimulatedFilm, gamma: f64, rig: &str) -> (f64, f64) {
    let rows = rows_of_pictures(pictures(world, gamma), world, rig);
    let radii = rows.tracks.iter().filter_map(|track| Some(track.radius_px? - world.truth(track.frame).radius_px?));
    let (sum, count) = radii.fold((0.0, 0.0), |(sum, count), off| (sum + off, count + 1.0));
    let (measured, truth) = (rows.impacts.last().unwrap().numbers(), world.impact().unwrap().numbers());
    let pulls = measured.into_iter().zip(truth).filter(|((number, _), _)| **number == *"restitution_tangential");
    let pull = pulls.filter_map(|((_, measured), (_, truth))| Some((measured?.value - truth?.value) / measured?.sigma));
    (sum / count, pull.fold(0.0, |most, pull: f64| most.max(pull.abs())))
}

/// Without the key the radius was 0.14 to 0.24 px too large, and the tangential restitution off by 5 to 9 sigma.
#[test]
fn a_known_tone_curve_is_corrected() {
    let rig = include_str!("../../config/lacrosse.toml");
    let corrected = |gamma: f64| rig.replacen("[camera]", &format!("[camera]\ngamma = {gamma}"), 1);
    let world = SimulatedFilm::new(&Scenario { seed: 71, ..Scenario::built_in("lacrosse").unwrap() }).unwrap();
    for gamma in [0.7, 0.45] {
        let (bent, straight) = (off(&world, gamma, rig), off(&world, gamma, &corrected(gamma)));
        println!(
            "gamma {gamma}: radius {:+.3} px, {:.1} sigmas; taken out {:+.3}, {:.1}",
            bent.0, bent.1, straight.0, straight.1
        );
        assert!(bent.0 > 0.1 && straight.0.abs() < 0.02, "{bent:?} {straight:?}");
        assert!(bent.1 > 3.0 && straight.1 < 2.5, "{bent:?} {straight:?}");
    }
}
