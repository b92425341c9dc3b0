//! Triggers on measured motion: drops, and what is none.

use ricochet::camera::simulated::{meta, stream_format};
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Order, Share};
use ricochet::process::analysis_params;
use ricochet::synth::{MotionSetup, Scenario, World};
use ricochet::trigger::Decision;

/// Even numbers from 0 to 1.
struct Dice(u64);

impl Dice {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * ((self.0 >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

/// What the trigger decided over a whole film.
fn decide(world: &World, config: &Config) -> Vec<Decision> {
    let format = stream_format(world);
    let (measure, tracker) = analysis_params(config, &format);
    let mut measurer = Measurer::new(&measure, Share::ALL, format.width_px as usize, format.height_px as usize).unwrap();
    let mut order = Order::new(1, tracker.intervals_frames().collect(), u64::MAX);
    order.start_at(0);
    let mut trigger = config.measured_trigger(format.frame_rate_hz, format.exposure_us).unwrap();
    let (mut measured, mut bytes, mut decisions) = (Vec::new(), vec![0; world.frame_bytes()], Vec::new());
    for index in 0..world.frames() {
        world.render(index, &mut bytes);
        measurer.push(&Frame { meta: meta(world, index), bytes: &bytes }, &mut measured).unwrap();
        if index + 1 == world.frames() {
            measurer.finish(&mut measured);
        }
        measured.drain(..).for_each(|measured| order.push(measured.step));
        decisions.extend(std::iter::from_fn(|| order.pop()).filter_map(|step| trigger.push(&step)));
    }
    decisions
}

fn rig(edge: [[f64; 2]; 2], angle_deg: f64, trigger: &str) -> Config {
    let text = format!(
        "[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = 0.5142\n[surface]\nangle_deg = {angle_deg}\nedge = {edge:?}\n\
         [[body]]\ndiameter_mm = 63.25\n[velocity]\ngravity_angle_deg = -71\n[trigger]\n{trigger}\n"
    );
    Config::parse(&text, "rig.toml").unwrap()
}

/// A drop on a level flat, noise of 2 grey levels, in the light of a lamp on the mains.
fn drop_scenario(dice: &mut Dice, number: u64) -> Scenario {
    let mut scenario = Scenario::built_in("lacrosse").unwrap();
    scenario.seed = number;
    scenario.light.flicker = 0.08;
    scenario.light.flicker_hz = 120.0;
    let MotionSetup::Impact(impact) = &mut scenario.motion else { panic!("a drop") };
    impact.vn_m_s = -dice.between(0.8, 4.0);
    impact.vt_m_s = dice.between(-0.6, 0.6);
    impact.omega_rad_s = dice.between(-40.0, 40.0);
    // The ball is in the picture from the first frame on.
    let fall_s = (0.0178 / -impact.vn_m_s).min(6.0e-3);
    impact.contact_start_s = fall_s * dice.between(0.8, 1.0);
    impact.contact_center_px = [dice.between(100.0, 150.0), dice.between(99.0, 104.0)];
    scenario.camera.frames = (impact.contact_start_s * scenario.camera.frame_rate_hz).ceil() as u64 + 30;
    scenario
}

/// The edge that the ball of a drop touches.
fn edge(scenario: &Scenario) -> [[f64; 2]; 2] {
    let MotionSetup::Impact(impact) = &scenario.motion else { panic!("a drop") };
    let y_px = impact.contact_center_px[1] + scenario.radius_px();
    [[0.0, y_px], [255.0, y_px]]
}

#[test]
fn predicted_contact_fires_within_two_frames_of_the_contact_in_a_hundred_drops() {
    let (mut dice, mut errors, mut leads) = (Dice(5), Vec::new(), Vec::new());
    for number in 0..100 {
        let scenario = drop_scenario(&mut dice, number);
        let MotionSetup::Impact(impact) = &scenario.motion else { panic!("a drop") };
        let seen_s = impact.contact_start_s - 0.5e-6 * scenario.camera.exposure_us;
        let config = rig(edge(&scenario), 0.0, "mode = \"predicted-contact\"");
        let decisions = decide(&World::new(&scenario).unwrap(), &config);
        assert_eq!(decisions.len(), 1, "drop {number} at {} m/s: {decisions:#?}", impact.vn_m_s);
        let error = decisions[0].frame as f64 - seen_s * scenario.camera.frame_rate_hz;
        let lead = decisions[0].frame as i64 - decisions[0].newest_frame as i64;
        println!("drop {number}: {:.2} m/s, {} off by {error:.2}", impact.vn_m_s, decisions[0].what);
        errors.push(error);
        leads.push(lead);
    }
    let worst = errors.iter().fold(0.0_f64, |worst, error| worst.max(error.abs()));
    leads.sort_unstable();
    println!("100 drops, worst {worst:.2} frames, told {} to {} frames ahead, median {}", leads[0], leads[99], leads[50]);
    assert!(worst <= 2.0, "{worst} frames");
    assert!(leads[50] >= 5, "most are told well ahead: median {}", leads[50]);
}
