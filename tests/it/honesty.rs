//! Random scenes of every shape, light, pattern, motion and camera that the simulator draws: rows are right or refused.
//!
//! The truth is that of the simulator. The rig files state the scale, the surface and the body, as those of users do.
//! `RICOCHET_SEED` selects the first scene of the ignored test.

mod draw;
mod film;
mod judge;
mod table;

use draw::Scene;
use judge::Verdict;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use table::{Sum, Tally};

/// The scenes of the normal suite.
const FEW: u64 = 24;
/// All scenes.
const ALL: u64 = 320;

/// Draws, films and measures the scenes of some seeds.
fn tally(seeds: Range<u64>) -> Tally {
    let next = AtomicU64::new(seeds.start);
    let worker = || {
        let seeds = std::iter::from_fn(|| Some(next.fetch_add(1, Ordering::Relaxed)).filter(|seed| *seed < seeds.end));
        seeds.filter_map(|seed| judge::judged(&Scene::draw(seed))).collect::<Vec<_>>()
    };
    let mut verdicts: Vec<Verdict> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..2).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap()).collect()
    });
    // The order in which the scenes are finished does not matter.
    verdicts.sort_by_key(|verdict| verdict.seed);
    Tally::of(&verdicts)
}

/// The share of wrong rows.
fn wrong(sum: &Sum) -> f64 {
    sum.wrong as f64 / sum.rows.max(1) as f64
}

/// The bounds are those that hold today, with a margin of a scene. The aim is in the test below.
#[test]
fn a_few_random_scenes_are_measured_or_refused() {
    let tally = tally(0..FEW);
    println!("{tally}");
    // Compressed frames depend on the encoder, and lead to most of the wrong rows.
    let raw = tally.kind("raw frames");
    assert!(raw.scenes >= 15 && raw.rows > 400, "{} scenes, {} rows", raw.scenes, raw.rows);
    assert!(wrong(raw) < 0.007, "{} of {} rows are wrong", raw.wrong, raw.rows);
    assert!(wrong(&tally.all) < 0.035, "{} of {} rows are wrong", tally.all.wrong, tally.all.rows);
    let (positions, rotations) = (raw.positions.of_one(), raw.rotations.of_one());
    assert!(positions > 0.65 && rotations > 0.65, "{positions:.2} of the positions, {rotations:.2} of the rotations");
    let plain = tally.kind("plain");
    assert!(plain.scenes > 0 && plain.positions.of_one() > 0.7, "plain balls");
}

/// The aim: at most 1 of 2000 rows is wrong, and 85 % of what a person could measure is measured.
#[test]
#[ignore = "several minutes, and the aim is not reached"]
fn random_scenes_are_measured_or_refused() {
    let first = std::env::var("RICOCHET_SEED").map_or(0, |seed| seed.parse().unwrap());
    let tally = tally(first..first + ALL);
    println!("{tally}");
    let all = &tally.all;
    assert!(wrong(all) <= 1.0 / 2000.0, "{} of {} rows are wrong", all.wrong, all.rows);
    let (positions, rotations) = (all.positions.of_one(), all.rotations.of_one());
    assert!(positions >= 0.85 && rotations >= 0.85, "{positions:.2} of the positions, {rotations:.2} of the rotations");
}

/// Scenes whose highlight outweighs the marks: what turns with the ball then looks like something in front of it.
#[test]
fn a_ball_that_its_highlight_holds_back_has_no_rotation() {
    for seed in [1283, 4003, 5297] {
        let tally = tally(seed..seed + 1);
        println!("{tally}");
        assert_eq!(tally.all.wrong, 0, "scene {seed}");
        assert!(tally.all.positions.of_one() > 0.7, "scene {seed}");
    }
}
