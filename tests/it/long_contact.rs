//! Contacts of three to five thousand frames.

use crate::impact::track;
use crate::support::{Rig, csv, succeed};
use crate::synth_physics::{Experiment, Noise, lacrosse, steps};
use ricochet::results::{Estimate, Phase};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Requires a value within four standard uncertainties of the truth.
fn is_right(name: &str, estimate: Option<Estimate>, truth: f64) {
    let Estimate { value, sigma } = estimate.expect(name);
    assert!((value - truth).abs() < 4.0 * sigma, "{name}: {value} +- {sigma}, truly {truth}");
}

#[test]
fn the_time_scale_of_a_contact_is_that_of_its_motion() {
    for frame_rate_hz in [800.0, 3e3, 1e4, 3e4, 6e4, 1e5, 3e5, 1.1e6] {
        let flight_frames = 30 + (4e-3 * frame_rate_hz) as usize;
        let (before_frames, after_frames) = (flight_frames, flight_frames);
        let base = Experiment { frame_rate_hz, before_frames, after_frames, sigma_px: 0.003, ..lacrosse(false) };
        let truth = base.simulate(0.3);
        let rows = track(&truth.steps(1, &mut Noise::new(3)), &base.params());
        let impact = rows.impacts.last().unwrap_or_else(|| panic!("no impact at {frame_rate_hz} frames/s"));
        let lasts = truth.end - truth.start;
        println!("{lasts:.0} frames: {:?}, {:?}", impact.start_s, impact.restitution);
        assert!(rows.impacts.iter().all(|impact| impact.number == 0), "{lasts} frames: one collision");
        is_right("start", impact.start_s, truth.start / frame_rate_hz);
        is_right("deepest", impact.deepest_s, truth.deepest / frame_rate_hz);
        is_right("end", impact.end_s, truth.end / frame_rate_hz);
        is_right("speed before", impact.vn_before_m_s, truth.before[0]);
        is_right("speed after", impact.vn_after_m_s, truth.after[0]);
        is_right("restitution", impact.restitution, -truth.after[0] / truth.before[0]);
        is_right("compression", impact.compression_max_mm, truth.depth_mm);
        let sigma = impact.restitution.unwrap().sigma;
        assert!(sigma < 0.01, "{lasts} frames: {sigma}");
    }
}

/// Draws and measures a film, and compares its only impact with the truth, within 3 sigmas or 0.1 %.
fn check_film(scenario: &Path, rig: &Path, folder: &Path) {
    let [film, results] = ["film.mcap", "results.mcap"].map(|name| folder.join(name));
    succeed(["simulate".as_ref(), scenario.as_os_str(), "-o".as_ref(), film.as_os_str()]);
    let results_path = [results.as_os_str()];
    succeed(
        [
            &["analyze".as_ref(), film.as_os_str(), "--config".as_ref(), rig.as_os_str(), "-o".as_ref()],
            &results_path[..],
        ]
        .concat(),
    );
    let [truth, measured] = [csv(&film, "truth_impact"), csv(&results, "impact")];
    let [truth, measured] = [&truth, &measured].map(|table| {
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        let [names, .., row] = &rows[..] else { panic!("{}: no impact", scenario.display()) };
        names.iter().copied().zip(row.iter().copied()).collect::<HashMap<_, _>>()
    });
    for name in ["start_s", "end_s", "vn_before_m_s", "vn_after_m_s", "restitution", "contact_time_s"] {
        let sigma_name = format!("sigma_{name}");
        let [right, value, sigma] =
            [truth[name], measured[name], measured[&*sigma_name]].map(|text| text.parse::<f64>().unwrap());
        println!("{name} {value} +- {sigma}, truly {right}");
        let off = (value - right).abs();
        assert!(off < (3.0 * sigma).max(1e-3 * right.abs()), "{name} {value} +- {sigma}, truly {right}");
        assert!(sigma < 0.04 * right.abs(), "{name}: {sigma}");
    }
    std::fs::remove_file(film).unwrap();
    std::fs::remove_file(results).unwrap();
}

/// The scenario of a ball with a radius of 16 px that strikes a surface 2 ms after the start of the film.
fn scenario(frame_rate_hz: f64, frames: u64, law: &str) -> String {
    format!(
        "name = \"long\"\nseed = 5\n[camera]\nwidth_px = 80\nheight_px = 72\nframe_rate_hz = {frame_rate_hz}\n\
        exposure_us = 1.0\nframes = {frames}\nbits = 8\nnoise_dn = 1.0\nblur_px = 0.7\n[scale]\nmm_per_px = 1.0\n\
        [surface]\nangle_deg = 0.0\n[body]\ndiameter_mm = 32.0\nshape = \"sphere\"\n[body.pattern]\narea_min_px2 = 4.0\n\
        area_max_px2 = 12.0\ncoverage = 0.4\n[shade]\nball = 0.75\nspeckle = 0.2\nground = 0.1\n[occluder]\nshade = 0.4\n\
        [motion]\nkind = \"impact\"\ncontact_start_s = 2e-3\ncontact_center_px = [40.0, 40.0]\nvn_m_s = -1.2\n\
        vt_m_s = 0.3\nomega_rad_s = 0.0\ngravity_m_s2 = [0.0, -9.81]\nmass_kg = 0.02\ninertia_factor = 0.4\n\
        [motion.law]\n{law}\n[motion.friction]\nstiffness_n_m = 1e5\ndamping_n_s_m = 20.0\ncoefficient = 0.1\n"
    )
}

const RIG: &str = "[rig]\nname = \"long\"\n[camera]\nsource = \"recording\"\nid = \"x\"\nexposure_us = 1\n[scale]\n\
    mm_per_px = 1.0\n[surface]\nangle_deg = 0\n[[body]]\nname = \"ball\"\nkind = \"ball\"\ndiameter_mm = 32\n";

#[test]
fn a_film_of_a_long_contact_has_one_impact() {
    let folder = Rig::new();
    let rig = folder.file("rig.toml", RIG);
    let spring = "kind = \"kelvin-voigt\"\nstiffness_n_m = 8e3\ndamping_n_s_m = 1.6";
    let sphere = "kind = \"hunt-crossley\"\nstiffness_n_m15 = 2e5\ndamping_s_m = 0.2";
    for (frame_rate_hz, frames, law) in [(2e5, 1800, spring), (4e5, 4000, sphere)] {
        let path = folder.file("long.toml", &scenario(frame_rate_hz, frames, law));
        check_film(&path, &rig, &folder.path(""));
    }
    let Some(data) = std::env::var_os("RICOCHET_REAL_DATA") else {
        println!("left out: RICOCHET_REAL_DATA names no directory of real recordings");
        return;
    };
    let reported = PathBuf::from(data).join("field/long-contact-433-frames");
    let [scenario, rig] = ["long-contact.toml", "rig.toml"].map(|name| reported.join(name));
    check_film(&scenario, &rig, &folder.path(""));
}

/// Drag and friction bend a long flight as a slow contact does, but they do not take the speed of approach away.
#[test]
fn a_long_motion_without_contact_has_no_impact() {
    let params = ricochet::motion::MotionParams { gravity_m_s2: 0.0, ..lacrosse(true).params() };
    // Along the normal, px: drag takes a third of the speed, and friction stops the body after 4000 frames.
    let drag = |t: f64| -1500.0 * (1.0 + t / 1.2e4).ln();
    let friction = |t: f64| if t < 4000.0 { -0.1 * t + 1.25e-5 * t * t } else { -200.0 };
    for normal_px in [drag as fn(f64) -> f64, friction] {
        let poses: Vec<[f64; 3]> = (0..6000).map(|t| [200.0, 200.0 - normal_px(f64::from(t)), 0.0]).collect();
        let rows = track(&steps(&poses, 1, 1e5, (0.003, 0.002, 60.0), &mut Noise::new(8)), &params);
        assert!(rows.impacts.is_empty(), "{:?}", rows.impacts);
        assert!(rows.velocities.iter().all(|row| row.phase == Phase::Flight), "only flight");
    }
}
