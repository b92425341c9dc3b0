//! Films of cameras with defective pixels.

use ricochet::synth::{CameraSetup, Scenario, SimulatedFilm};

use crate::measured_world::rows_of_pictures;
use crate::support::{Rig, run};

/// The share of pixels that are hot or dead.
const STUCK: f64 = 0.001;

fn pictures(world: &SimulatedFilm) -> impl Iterator<Item = Vec<u8>> {
    (0..world.frames()).map(|index| {
        let mut bytes = vec![0; world.frame_bytes()];
        world.render(index, &mut bytes);
        bytes
    })
}

fn worlds(name: &str, seed: u64) -> [SimulatedFilm; 2] {
    let sound = Scenario { seed, ..Scenario::built_in(name).unwrap() };
    let stuck = Scenario { camera: CameraSetup { stuck_share: STUCK, ..sound.camera.clone() }, ..sound.clone() };
    [sound, stuck].map(|scenario| SimulatedFilm::new(&scenario).unwrap())
}

/// Column and row of the pixels that differ between the two worlds in all of these frames.
fn stuck_px([sound, stuck]: &[SimulatedFilm; 2]) -> Vec<[u32; 2]> {
    let width = sound.width_px();
    let mut ends = vec![true; sound.frame_bytes()];
    for (sound, stuck) in pictures(sound).zip(pictures(stuck)).take(30) {
        let differs = sound.iter().zip(&stuck).map(|(sound, stuck)| sound != stuck && (*stuck == 0 || *stuck == 255));
        ends.iter_mut().zip(differs).for_each(|(ends, differs)| *ends &= differs);
    }
    let places = (0..width * sound.height_px()).zip(&ends).filter(|(_, ends)| **ends);
    places.map(|(at, _)| [at % width, at / width]).collect()
}

/// The largest error of any number of the collision in sigmas, and the name of that number.
fn worst(world: &SimulatedFilm, rig: &str) -> (f64, String) {
    let rows = rows_of_pictures(pictures(world), world, rig);
    let Some(measured) = rows.impacts.last() else { return (f64::INFINITY, "no collision".into()) };
    let truth = world.impact().unwrap().numbers();
    let pulls = measured.numbers().into_iter().zip(truth).filter_map(|((name, measured), (_, truth))| {
        let (measured, truth) = (measured?, truth?);
        Some((((measured.value - truth.value) / measured.sigma).abs(), name.to_string()))
    });
    pulls.fold((0.0, String::new()), |most, pull| if pull.0 > most.0 { pull } else { most })
}

/// Without the list of defective pixels, they remove subsets like an occluder, and numbers of most balls have larger
/// errors.
#[test]
fn defective_pixels_are_filled_in() {
    let rigs = [
        ("lacrosse", include_str!("../../config/lacrosse.toml")),
        ("tennis", include_str!("../../config/tennis.toml")),
        ("rod", include_str!("../../config/rod.toml")),
    ];
    let mut improved = 0;
    for (name, rig) in rigs {
        for seed in [71, 72] {
            let worlds = worlds(name, seed);
            let pixels = stuck_px(&worlds);
            let with_list = rig.replacen("[camera]", &format!("[camera]\ndefective_px = {pixels:?}"), 1);
            let [sound, stuck] = &worlds;
            let [without, ignored, filled] =
                [(sound, rig), (stuck, rig), (stuck, &with_list)].map(|(w, rig)| worst(w, rig));
            println!(
                "{name} {seed}: {} pixels; sound {without:.1?}, ignored {ignored:.1?}, filled in {filled:.1?}",
                pixels.len()
            );
            assert!(filled.0 < without.0.max(2.0) + 0.5, "{name} {seed}");
            improved += u32::from(ignored.0 > filled.0 + 0.1);
        }
    }
    assert!(improved >= 3, "nothing to fill in: {improved} of 6 films are better with the list");
}

#[test]
fn check_finds_the_defective_pixels() {
    let worlds = worlds("tennis", 72);
    let truth = stuck_px(&worlds);
    let found: [Vec<[u32; 2]>; 2] = worlds.map(|world| {
        let rig = Rig::new();
        let film = rig.file("film.toml", &toml::to_string(world.scenario()).unwrap());
        let camera = format!("source = \"simulated\"\nscenario = \"{}\"\npaced = false", film.display());
        let config = rig.config(&camera, "[scale]\nmm_per_px = 0.5\n[[body]]\ndiameter_mm = 67\n[workers]\ncount = 1");
        let output = run(["check".as_ref(), config.as_os_str(), "--json".as_ref()]);
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        serde_json::from_value(report["defective_px"].clone()).unwrap()
    });
    let [sound, stuck] = found;
    println!("{} pixels, {} found, {} of a sound camera", truth.len(), stuck.len(), sound.len());
    assert!(sound.is_empty(), "{sound:?}");
    assert!(stuck.iter().all(|pixel| truth.contains(pixel)), "{stuck:?} {truth:?}");
    assert!(stuck.len() * 10 >= truth.len() * 8, "{stuck:?} {truth:?}");
}
