//! Triggers on a rod, whose end is known from its lowest tape.

use super::{Dice, decide, decide_on};
use crate::measured_world::through;
use ricochet::config::Config;
use ricochet::synth::{MotionSetup, Scenario, SimulatedFilm};

/// The distances from the middle of the speckled tape and from its lowest edge to the end of the rod, px.
const BELOW_PX: [f64; 2] = [85.0, 20.0];
const MM_PER_PX: f64 = 0.3;

fn rig(edge_px: f64, trigger: &str) -> Config {
    let end_mm = MM_PER_PX * BELOW_PX[1];
    let text = format!(
        "[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = {MM_PER_PX}\n\
         [surface]\nedge = [[0, {edge_px}], [63, {edge_px}]]\n\
         [[body]]\nkind = \"rod\"\ndiameter_mm = 9\nend_mm = {end_mm}\n[trigger]\n{trigger}\n"
    );
    Config::parse(&text, "rig.toml").unwrap()
}

/// One drop, and where and when its end touches, px and frames.
fn drop_scenario(number: u64) -> (Scenario, f64, f64) {
    let mut dice = Dice((number + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    let mut scenario = Scenario::built_in("rod").unwrap();
    scenario.seed = number;
    (scenario.light.flicker, scenario.light.flicker_hz) = (0.08, 120.0);
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
    impact.vn_m_s = -dice.between(0.7, 3.0);
    // The speckled tape is in the image from the first frame on.
    impact.contact_start_s = (6.5e-3 / -impact.vn_m_s).min(2.4e-3) * dice.between(0.8, 1.0);
    impact.contact_center_px = [dice.between(25.0, 39.0), dice.between(56.0, 57.0)];
    let (edge_px, start_s) = (impact.contact_center_px[1] + BELOW_PX[0], impact.contact_start_s);
    let rate_hz = scenario.camera.frame_rate_hz;
    scenario.camera.frames = (start_s * rate_hz).ceil() as u64 + 40;
    let frame = (start_s - 0.5e-6 * scenario.camera.exposure_us) * rate_hz;
    (scenario, edge_px, frame)
}

#[test]
fn the_contact_of_a_rods_end_is_predicted_within_two_frames_in_fifty_drops() {
    let drops = |index: u64| -> Vec<f64> {
        let one = |number| {
            let (scenario, edge_px, contact) = drop_scenario(number);
            let config = rig(edge_px, "mode = \"predicted-contact\"");
            let decisions = decide(&SimulatedFilm::new(&scenario).unwrap(), &config);
            assert_eq!(decisions.len(), 1, "drop {number}: {decisions:#?}");
            println!("drop {number}: {} error {:.2}", decisions[0].what, decisions[0].frame as f64 - contact);
            decisions[0].frame as f64 - contact
        };
        (index..50).step_by(2).map(one).collect()
    };
    let errors = std::thread::scope(|scope| {
        let threads = [0, 1].map(|index| scope.spawn(move || drops(index)));
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    });
    assert!(errors.len() == 50 && errors.iter().all(|error| error.abs() <= 2.0), "{errors:?}");
}

#[test]
fn gap_triggers_fire_at_their_threshold_and_a_distant_surface_is_not_touched() {
    let (mut scenario, edge_px, contact) = drop_scenario(0);
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
    impact.vn_m_s = -2.0;
    let world = SimulatedFilm::new(&scenario).unwrap();
    // 2 m/s at 40 000 frames/s are 0.05 mm per frame, and gravity adds little: 1 mm is 20 frames before contact.
    let gap = decide(&world, &rig(edge_px, "mode = \"gap\"\ngap_mm = 1"));
    assert_eq!(gap.len(), 1, "{gap:?}");
    assert!((gap[0].frame as f64 - (contact - 20.0)).abs() <= 3.0, "{contact}: {gap:?}");
    let far = decide(&world, &rig(edge_px + 15.0, "mode = \"gap\"\ngap_mm = 1"));
    assert_eq!(far, [], "never nearer than 4.5 mm, less what the contact yields");
}

/// The calibration of a camera that looks up at the rod: pixels cover a fifth more at the top than at the foot.
fn aslant(width_px: u32, height_px: u32, mm: f64) -> String {
    let entries = [1.0, 0.0, -9.0, 0.0, 1.0, -20.0].map(|x| mm * x);
    format!(
        "[calibration]\nimage_px = [{width_px}, {height_px}]\nhomography_mm = [{}, {}, {}, {}, {}, {}, 0, 5e-4, 1]\n",
        entries[0], entries[1], entries[2], entries[3], entries[4], entries[5]
    )
}

#[test]
fn the_contact_of_a_rod_seen_obliquely_is_predicted_with_the_calibration() {
    for number in 0..6 {
        let (mut scenario, edge_px, contact) = drop_scenario(number);
        let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
        // The image ends elsewhere than the plane.
        impact.contact_center_px[0] = 30.0 + 0.37 * number as f64;
        let world = SimulatedFilm::new(&scenario).unwrap();
        let calibrated = |mm: f64, edge: [[f64; 2]; 2], end_mm: f64| {
            let text = format!(
                "[camera]\nsource = \"simulated\"\n[surface]\nedge = {edge:?}\n\
                 [[body]]\nkind = \"rod\"\ndiameter_mm = 9\nend_mm = {end_mm}\nroi_px = [3, 2, 55, 140]\n{}\
                 [trigger]\nmode = \"predicted-contact\"\n",
                aslant(world.width_px(), world.height_px(), mm)
            );
            Config::parse(&text, "rig.toml").unwrap()
        };
        // The scale in the middle is that of the film.
        let rough = calibrated(1.0, [[0.0, 1.0], [9.0, 1.0]], 1.0).calibration.unwrap().mm_per_px().unwrap();
        let mm = MM_PER_PX / rough;
        let rectifier = calibrated(mm, [[0.0, 1.0], [9.0, 1.0]], 1.0).calibration.unwrap();
        let edge = [[2.0, edge_px], [61.0, edge_px]].map(|at| rectifier.pixel(at).unwrap());
        let config = calibrated(mm, edge, MM_PER_PX * BELOW_PX[1]);
        let size = [world.width_px(), world.height_px()].map(|side| side as usize);
        let decisions = decide_on(&world, &config, |bytes| *bytes = through(&rectifier, bytes, size));
        assert_eq!(decisions.len(), 1, "drop {number}: {decisions:#?}");
        let off = decisions[0].frame as f64 - contact;
        println!("drop {number}: {} error {off:.2}; the edge appears at {edge:?}, true {edge_px}", decisions[0].what);
        assert!(off.abs() <= 2.0, "drop {number}: error {off} frames");
    }
}
