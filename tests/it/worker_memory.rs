//! The memory of a worker: the same after a lost ball as before.

use crate::allocation::held_bytes;
use crate::pipeline::drift;
use ricochet::camera::simulated::{meta, stream_format};
use ricochet::config::Config;
use ricochet::image::Frame;
use ricochet::measure::{Measurer, Share};
use ricochet::synth::{Scenario, SimulatedFilm};

/// The number of frames of a block.
const BLOCK: u64 = 64;

/// Measures a film in which the ball is away in some frames. Returns the memory after each block, and the largest within
/// one, kB.
fn held_kb(frames: u64, is_away: impl Fn(u64) -> bool) -> (Vec<isize>, isize) {
    let scenario: Scenario = toml::from_str(&drift(frames, 1000.0)).unwrap();
    let film = SimulatedFilm::new(&scenario).unwrap();
    let rig = format!("[camera]\nsource = \"simulated\"\n[scale]\nmm_per_px = 0.5\n[workers]\nblock_frames = {BLOCK}");
    let (params, _) =
        ricochet::process::analysis_params(&Config::parse(&rig, "rig.toml").unwrap(), &stream_format(&film));
    let size = [film.width_px(), film.height_px()].map(|side| side as usize);
    let before = held_bytes();
    let mut measurer = Measurer::new(&params, Share::ALL, size[0], size[1]).unwrap();
    measurer.reserve();
    let (mut measured, mut bytes, mut lost) = (Vec::new(), vec![0; film.frame_bytes()], 0);
    let (mut ends, mut max) = (Vec::new(), 0);
    for index in 0..frames {
        film.render(index, &mut bytes);
        if is_away(index) {
            bytes.fill(60);
        }
        measurer.push(&Frame { meta: meta(&film, index), bytes: &bytes }, &mut measured).unwrap();
        lost += measured.iter().filter(|row| row.step.outline.is_none()).count();
        measured = Vec::new();
        let held = (held_bytes() - before) / 1024;
        max = held.max(max);
        if (index + 1) % BLOCK == 0 {
            ends.push(held);
        }
    }
    assert_eq!(lost, (0..frames).filter(|index| is_away(*index)).count());
    (ends, max)
}

/// The number of blocks of a film.
const BLOCKS: u64 = 5;

#[test]
fn a_worker_holds_no_more_after_a_lost_ball_than_before() {
    let (usual, _) = held_kb(BLOCKS * BLOCK, |_| false);
    let (ends, max) = held_kb(BLOCKS * BLOCK, |index| index == BLOCK + 10);
    println!(
        "{usual:?} kB after blocks with a ball, {ends:?} kB after blocks with a lost one, at most {max} kB within"
    );
    // One prepared frame more or less is in use at the end of a block; a block has 64 of them.
    assert!(ends.iter().zip(&usual).all(|(end, usual)| *end <= usual + usual / 4), "{ends:?} instead of {usual:?} kB");
    // The frames that wait for the end of the block keep no images, except the few that may be measured again.
    assert!(max < 2 * usual[0], "{max} kB within a block, usually {} kB", usual[0]);
}

#[test]
fn a_worker_frees_the_memory_of_a_ball_that_came_and_went() {
    let (usual, _) = held_kb(BLOCKS * BLOCK, |_| false);
    let (ends, max) = held_kb(BLOCKS * BLOCK, |index| index < 3 * BLOCK && index % 7 < 3);
    println!("{usual:?} kB after blocks with a ball, {ends:?} kB after others, at most {max} kB within");
    assert!(ends.iter().zip(&usual).all(|(end, usual)| *end < 2 * usual), "{ends:?} instead of {usual:?} kB");
}
