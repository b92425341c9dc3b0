//! Bodies that come nearer to the camera, or go away from it.

use ricochet::results::{Impact, VelocitySample};
use ricochet::synth::{MotionSetup, Scenario, World};

use crate::measured_world::{level_rig, rows_of};

/// The largest of so many sigmas that any velocity is off by.
fn worst_pull(world: &World, velocities: &[VelocitySample]) -> f64 {
    let pull = |row: &VelocitySample| {
        let (told, truth) = (row.velocity?, world.truth(row.frame).velocity?);
        let off = [told.vn_m_s - truth.vn_m_s, told.vt_m_s - truth.vt_m_s];
        Some(off.map(f64::abs).into_iter().fold(0.0, f64::max) / told.sigma_v_m_s)
    };
    velocities.iter().filter_map(pull).fold(0.0, f64::max)
}

/// A built-in collision of a ball that comes nearer by so much a second: what is told of it and the truth.
fn struck(name: &str, rig: &str, nearer_per_s: f64) -> (World, Impact, Vec<VelocitySample>) {
    let mut scenario = Scenario { seed: 71, ..Scenario::built_in(name).unwrap() };
    scenario.scale.nearer_per_s = nearer_per_s;
    let world = World::new(&scenario).unwrap();
    let rows = rows_of(&world, rig);
    (world, *rows.impacts.last().unwrap(), rows.velocities)
}

/// A third of a metre a second towards a camera one metre away: without a word of it restitution was off by 0.08 points and
/// 2 sigmas, the tangential speed after by 0.5 % and 12, and no contact law was found.
#[test]
fn a_collision_is_that_across_the_view() {
    for (name, rig, nearer_per_s) in [
        ("lacrosse", include_str!("../../config/lacrosse.toml"), 0.3),
        ("tennis", include_str!("../../config/tennis.toml"), -0.3),
    ] {
        let (world, told, velocities) = struck(name, rig, nearer_per_s);
        let truth = world.impact().unwrap();
        for ((number, told), (_, truth)) in told.numbers().into_iter().zip(truth.numbers()) {
            let Some((told, truth)) = told.zip(truth) else { continue };
            let pull = (told.value - truth.value) / told.sigma;
            println!("{name} {number}: {:.6} +- {:.6}, {pull:+.1} sigmas", told.value, told.sigma);
            assert!(pull.abs() < 3.5, "{name} {number}: {told:?} for {}", truth.value);
        }
        let off = told.restitution.unwrap().value - truth.restitution.unwrap().value;
        assert!(off.abs() < 3e-4, "{name}: restitution off by {off}");
        assert_eq!(told.force_law, truth.force_law, "{name}");
        for growth in [told.growth_before_per_s, told.growth_after_per_s] {
            let growth = growth.unwrap();
            assert!((growth.value - nearer_per_s).abs() < 3.0 * growth.sigma && growth.sigma < 0.1, "{growth:?}");
        }
        let pull = worst_pull(&world, &velocities);
        assert!(pull < 4.0, "{name}: a velocity is off by {pull:.1} sigmas");
    }
}

/// Without a surface, by the whole ball and by its subsets, towards the camera and away from it.
#[test]
fn a_flight_is_that_across_the_view() {
    for (rotation, nearer_per_s) in [("rigid", 0.8), ("field", -0.8)] {
        let mut scenario = Scenario::translation(1.87, -0.73, 0.35);
        (scenario.camera.frames, scenario.camera.width_px, scenario.camera.height_px) = (96, 400, 280);
        scenario.scale = ricochet::synth::ScaleSetup { mm_per_px: 0.5, nearer_per_s };
        if let MotionSetup::Constant { start_px, .. } = &mut scenario.motion {
            *start_px = [90.3, 180.7];
        }
        let world = World::new(&scenario).unwrap();
        let rig = format!("{}[rotation]\nmethod = \"{rotation}\"\n", level_rig(0.5));
        let rows = rows_of(&world, &rig);
        let radius =
            |frame: usize| rows.tracks[frame].radius_px.unwrap() - world.truth(frame as u64).radius_px.unwrap();
        assert!(radius(2).abs() < 0.15 && radius(90).abs() < 0.15, "{} and {} px", radius(2), radius(90));
        let pull = worst_pull(&world, &rows.velocities);
        println!("{rotation}, {nearer_per_s}/s: a velocity is off by {pull:.1} sigmas");
        assert!(pull < 4.0, "{rotation}: a velocity is off by {pull:.1} sigmas");
    }
}

#[test]
fn approaches_that_cannot_be_drawn_are_refused_by_name() {
    let refused = |name: &str, nearer_per_s: f64| {
        let mut scenario = Scenario::built_in(name).unwrap();
        scenario.scale.nearer_per_s = nearer_per_s;
        scenario.check().unwrap_err().to_string()
    };
    for (name, nearer_per_s, message) in [
        ("lacrosse", -3000.0, "scale.nearer_per_s = -3000 is out of range: allowed is -1000 to 1000"),
        ("lacrosse", 80.0, "scale.nearer_per_s x length of the film = 0.8 is out of range: allowed is -0.5 to 0.5"),
        (
            "lacrosse-sphere",
            0.1,
            "scale.nearer_per_s is out of place: spheres, rods and pairs of balls keep their distance",
        ),
        ("rod", 0.1, "scale.nearer_per_s is out of place: spheres, rods and pairs of balls keep their distance"),
        ("pair", 0.1, "scale.nearer_per_s is out of place: spheres, rods and pairs of balls keep their distance"),
    ] {
        let error = refused(name, nearer_per_s);
        assert!(error.contains(message), "{name}: {error}");
    }
}
