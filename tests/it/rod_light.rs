//! Rods under light that varies across them: a lamp from one side, a reflection between the tapes, speckles at the edges.

use crate::measured_world::rows_of;
use ricochet::results::PointStatus;
use ricochet::synth::{Scenario, SimulatedFilm};

/// A rod, its lamp and its paint.
struct Variant {
    name: &'static str,
    /// The width of the rod, px.
    width_px: f64,
    /// The direction of the lamp, counter-clockwise from x, and its elevation towards the camera, deg.
    lamp_deg: [f64; 2],
    /// The share of its light.
    lamp: f64,
    /// The reflection of the lamp, as a fraction of full scale.
    highlight: f64,
    /// Rod, tapes and ground, as fractions of full scale.
    shades: [f64; 3],
    /// The fraction of the upper tape that speckles cover.
    coverage: f64,
}

const VARIANTS: [Variant; 6] = [
    Variant {
        name: "polished rod before dark ground",
        width_px: 30.0,
        lamp_deg: [165.0, 55.0],
        lamp: 0.85,
        highlight: 0.4,
        shades: [0.04, 0.65, 0.04],
        coverage: 0.3,
    },
    Variant {
        name: "lamp on the right, dark side in shadow",
        width_px: 26.0,
        lamp_deg: [10.0, 35.0],
        lamp: 0.8,
        highlight: 0.3,
        shades: [0.06, 0.8, 0.12],
        coverage: 0.35,
    },
    Variant {
        name: "ground brighter than the rod and the dark side of its tapes",
        width_px: 34.0,
        lamp_deg: [150.0, 45.0],
        lamp: 0.7,
        highlight: 0.25,
        shades: [0.05, 0.7, 0.2],
        coverage: 0.3,
    },
    Variant {
        name: "narrow rod with a lamp at the camera",
        width_px: 19.0,
        lamp_deg: [60.0, 70.0],
        lamp: 0.9,
        highlight: 1.5,
        shades: [0.08, 0.75, 0.15],
        coverage: 0.25,
    },
    Variant {
        name: "lamp from above on the left, faint tapes",
        width_px: 30.0,
        lamp_deg: [120.0, 30.0],
        lamp: 0.75,
        highlight: 0.4,
        shades: [0.03, 0.45, 0.06],
        coverage: 0.3,
    },
    Variant {
        name: "weak lamp at the camera, by which tapes fade towards both sides",
        width_px: 30.0,
        lamp_deg: [14.0, 82.0],
        lamp: 0.48,
        highlight: 0.0,
        shades: [0.1, 0.65, 0.25],
        coverage: 0.29,
    },
];

fn film(variant: &Variant) -> SimulatedFilm {
    let mut scenario = Scenario::built_in("rod").unwrap();
    (scenario.camera.width_px, scenario.camera.frames) = (90, 160);
    scenario.body.diameter_mm = variant.width_px * scenario.scale.mm_per_px;
    scenario.body.pattern.coverage = variant.coverage;
    let light = &mut scenario.light;
    [light.side_angle_deg, light.lamp_elevation_deg] = variant.lamp_deg;
    (light.lamp, light.highlight, light.highlight_deg) = (variant.lamp, variant.highlight, 4.0);
    let [rod, tape, ground] = variant.shades;
    scenario.body.rod.as_mut().unwrap().shade = rod;
    (scenario.shade.ball, scenario.shade.ground, scenario.shade.speckle) = (tape, ground, 0.06);
    if let ricochet::synth::MotionSetup::Impact(impact) = &mut scenario.motion {
        (impact.contact_center_px, impact.contact_start_s) = ([44.4, 56.3], 1.5e-3);
    }
    SimulatedFilm::new(&scenario).unwrap()
}

fn rig(variant: &Variant) -> String {
    include_str!("../../config/rod.toml")
        .replace("diameter_mm = 9\n", &format!("diameter_mm = {}\n", 0.3 * variant.width_px))
        .replace("roi_px = [0, 0, 64, 136]", "roi_px = [0, 0, 90, 136]")
}

/// Errors of one kind.
#[derive(Default)]
struct Errors {
    count: usize,
    squares: f64,
    /// The largest error in standard uncertainties.
    worst: f64,
}

impl Errors {
    fn add(&mut self, error: f64, sigma: f64) {
        self.count += 1;
        self.squares += error * error;
        self.worst = self.worst.max((error / sigma).abs());
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

#[test]
fn rods_with_glare_and_shading_are_measured_within_their_sigmas() {
    let mut faults = Vec::new();
    for variant in &VARIANTS {
        let mut check = |is_good: bool, what: &str| {
            if !is_good {
                faults.push(format!("{}: {what}", variant.name));
            }
        };
        let world = film(variant);
        let rows = rows_of(&world, &rig(variant));
        let (mut edges, mut across, mut steps) = (Errors::default(), Errors::default(), Errors::default());
        for (row, track) in rows.velocities.iter().zip(&rows.tracks) {
            let truth = world.truth(row.frame);
            let (Some(x), Some(sigma)) = (track.center_x_px, track.sigma_center_px) else { continue };
            across.add(x - truth.center_x_px.unwrap(), sigma);
            if let Some((step, exact)) = row.motion.zip(truth.motion) {
                steps.add(step.dy_px - exact.dy_px, step.sigma_dy_px);
            }
            let places = track.rod.into_iter().flat_map(|rod| rod.edges).zip([-25.0, 25.0, 45.0, 65.0]);
            for (edge, offset) in places {
                let Some(y) = edge.and_then(|edge| edge.y_px) else { continue };
                edges.add(y.value - truth.center_y_px.unwrap() - offset, y.sigma);
            }
        }
        let valid = rows.velocities.iter().filter(|row| row.status == PointStatus::Valid).count();
        println!(
            "{}: {valid} of 160 rows; x {:.3} px rms, {:.1} sigma; {} edges {:.3} px rms, {:.1} sigma; steps {:.4} px rms, {:.1}",
            variant.name,
            across.rms(),
            across.worst,
            edges.count,
            edges.rms(),
            edges.worst,
            steps.rms(),
            steps.worst
        );
        check(valid >= 150, "rows");
        check(across.worst < 5.0 && across.rms() < 1.0, "x");
        check(edges.count > 200 && edges.rms() < 0.08 && edges.worst < 5.0, "edges");
        check(steps.rms() < 0.008 && steps.worst < 5.0, "steps");
        let Some(found) = rows.impacts.last() else {
            check(false, "no impact");
            continue;
        };
        let exact = world.impact().unwrap();
        for (name, [found, exact]) in [
            ("before", [found.vn_before_m_s, exact.vn_before_m_s]),
            ("after", [found.vn_after_m_s, exact.vn_after_m_s]),
            ("restitution", [found.restitution, exact.restitution]),
        ] {
            let (Some(found), exact) = (found, exact.unwrap().value) else {
                check(false, name);
                continue;
            };
            let error = found.value - exact;
            println!(
                "{}: {name} off by {:.2} %, {:.1} sigma",
                variant.name,
                100.0 * error / exact,
                error / found.sigma
            );
            check(error.abs() < 4.0 * found.sigma || error.abs() < 0.01 * exact.abs(), name);
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
