//! Films that end soon after a contact.

#![expect(clippy::print_stdout, reason = "a test prints what it measured")]

use crate::impact::track;
use crate::synth_physics::{Experiment, Noise, lacrosse};
use ricochet::results::PointStatus;

/// A collision whose end was detected has a row even if too few frames follow to measure it.
#[test]
fn a_collision_at_the_end_of_a_film_is_never_left_out() {
    let mut measured = 0;
    for after_frames in 2..16 {
        let base = Experiment { after_frames, sigma_px: 0.05, ..lacrosse(true) };
        let truth = base.simulate(0.3);
        let rows = track(&truth.steps(1, &mut Noise::new(5)), &base.params());
        let impact = rows.impacts.last().unwrap_or_else(|| panic!("{after_frames} frames: no impact"));
        let start = impact.start_s.unwrap_or_else(|| panic!("{after_frames} frames: no start"));
        let off = (start.value - truth.start / base.frame_rate_hz).abs();
        println!("{after_frames} frames: {:?}, start off by {:.1} sigmas", impact.status, off / start.sigma);
        assert!(off < 4.0 * start.sigma, "{after_frames} frames: {start:?}, off by {off} s");
        measured += u32::from(impact.status == PointStatus::Valid);
    }
    assert!(measured >= 8, "{measured} of 14 collisions are measured");
}
