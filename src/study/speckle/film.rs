//! The balls of the study and their films, rendered without interpolation.

use super::films_plan::{Film, Speeds};
use crate::failure::Failure;
use crate::image::{Frame, Image, ImageView};
use crate::synth::{MotionSetup, PatternSetup, Scenario, ScenarioError, SimulatedFilm};

/// Side of the frames, px.
pub(super) const SIDE_PX: u32 = 160;

/// Diameter of the balls with patterns a to d (tennis) and e and f (lacrosse), px, as filmed for the paper.
pub(super) const DIAMETERS_PX: [f64; 2] = [114.0, 123.0];

/// Centre of the ball in the middle of a film, px, without the subpixel offset of the film.
const MIDDLE_PX: f64 = 79.0;

/// Number of retakes reserved per set of speeds: more than a study has films of one pattern.
const MAX_FILMS_PER_PATTERN: u64 = 1000;

/// Steps of a quasi-random sequence (R2) that fills the unit square evenly: powers of the inverse plastic number.
const QUASIRANDOM_STEP: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// The settings shared by all films of a study.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Filming {
    /// Frames per film.
    pub(super) frames: u64,
    /// Standard deviation of the noise, grey levels of 255.
    pub(super) noise_dn: f64,
    /// Standard deviation of the lens blur, px.
    pub(super) blur_px: f64,
    /// Seed of the speckles and the noise.
    pub(super) seed: u64,
}

/// Returns the radius of the ball with this pattern, px.
pub(super) fn radius_px(pattern: usize) -> f64 {
    let lacrosse = PatternSetup::PAPER[pattern].starts_with(['e', 'f']);
    0.5 * DIAMETERS_PX[usize::from(lacrosse)]
}

/// Returns a static ball with one of the paper's patterns.
///
/// # Errors
///
/// [`ScenarioError`] when the noise is out of range.
pub(super) fn static_ball(pattern: usize, filming: &Filming) -> Result<SimulatedFilm, ScenarioError> {
    let mut scenario = Scenario::translation(0.0, 0.0, 0.0);
    scenario.seed = filming.seed.wrapping_add(pattern as u64);
    let camera = &mut scenario.camera;
    (camera.width_px, camera.height_px, camera.frames) = (SIDE_PX, SIDE_PX, filming.frames);
    (camera.noise_dn, camera.blur_px) = (filming.noise_dn, filming.blur_px);
    scenario.body.diameter_mm = 2.0 * radius_px(pattern) * scenario.scale.mm_per_px;
    if let Some(setup) = PatternSetup::paper(PatternSetup::PAPER[pattern]) {
        scenario.body.pattern = setup;
    }
    scenario.motion =
        MotionSetup::Constant { vx_px_frame: 0.0, vy_px_frame: 0.0, omega_deg_frame: 0.0, start_px: [MIDDLE_PX; 2] };
    SimulatedFilm::new(&scenario)
}

/// Returns the film of a ball that moves as planned, with a subpixel start position of its own.
///
/// # Errors
///
/// [`ScenarioError`] when the velocity is out of range.
pub(super) fn moving_ball(ball: &SimulatedFilm, film: &Film, filming: &Filming) -> Result<RenderedFilm, ScenarioError> {
    let take = 1 + film.number as u64 + if film.speeds == Speeds::Paper { 0 } else { MAX_FILMS_PER_PATTERN };
    let [vx_px_frame, vy_px_frame] = film.velocity.px_frame;
    let half = 0.5 * (filming.frames - 1) as f64;
    let start = |axis: usize, speed: f64| MIDDLE_PX + (QUASIRANDOM_STEP[axis] * take as f64).fract() - half * speed;
    let motion = MotionSetup::Constant {
        vx_px_frame,
        vy_px_frame,
        omega_deg_frame: film.velocity.deg_frame,
        start_px: [start(0, vx_px_frame), start(1, vy_px_frame)],
    };
    Ok(RenderedFilm { film: ball.retake(motion, take)? })
}

/// Two successive frames.
#[derive(Clone, Copy)]
pub(super) struct FramePair<'a> {
    pub(super) before: ImageView<'a>,
    pub(super) after: ImageView<'a>,
}

/// A film whose frames can be rendered.
#[derive(Debug)]
pub(super) struct RenderedFilm {
    film: SimulatedFilm,
}

impl RenderedFilm {
    /// Renders the frame with this index into reused memory.
    ///
    /// # Errors
    ///
    /// When the rendered bytes are not a frame.
    pub(super) fn draw(&self, index: u64, bytes: &mut Vec<u8>, image: &mut Image) -> Result<(), Failure> {
        bytes.resize(self.film.frame_bytes(), 0);
        self.film.render(index, bytes);
        Frame { meta: crate::camera::simulated::meta(&self.film, index), bytes }.unpack(image)?;
        Ok(())
    }

    /// Returns the true centre of the ball in the frame with this index, px.
    #[cfg(test)]
    fn center_px(&self, index: u64) -> [Option<f64>; 2] {
        let truth = self.film.truth(index);
        [truth.center_x_px, truth.center_y_px]
    }
}

#[cfg(test)]
mod tests {
    use super::super::films_plan::{SpeckleStudy, patterns};
    use super::*;

    const FILMING: Filming = Filming { frames: 3, noise_dn: 2.0, blur_px: 0.7, seed: 1 };

    #[test]
    fn every_pattern_of_the_paper_can_be_rendered() {
        for (name, pattern) in patterns() {
            let film = static_ball(pattern, &FILMING).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(film.scenario().body.pattern, PatternSetup::paper(name).unwrap());
            let wanted = if name.starts_with(['e', 'f']) { 61.5 } else { 57.0 };
            assert!((film.scenario().radius_px() - wanted).abs() < 1e-9, "{name}");
        }
    }

    #[test]
    fn films_move_as_planned_start_at_different_subpixel_positions_and_have_their_own_noise() {
        let film = static_ball(13, &FILMING).unwrap();
        let films = SpeckleStudy::Translation.plan(&[13], &Speeds::ALL);
        let mut fractions = Vec::new();
        let (mut bytes, mut image) = (Vec::new(), Image::default());
        let mut pictures = Vec::new();
        for plan in &films {
            let rendered = moving_ball(&film, plan, &FILMING).unwrap();
            let [from, to] = [0, 2].map(|index| rendered.center_px(index).map(Option::unwrap));
            for axis in 0..2 {
                assert!((to[axis] - from[axis] - 2.0 * plan.velocity.px_frame[axis]).abs() < 1e-9, "{plan:?}");
                // With a radius of 61.5 px it stays inside.
                assert!(from[axis] > 76.0 && to[axis] < 83.0, "{plan:?}");
            }
            fractions.push(rendered.center_px(1)[0].unwrap().fract());
            rendered.draw(0, &mut bytes, &mut image).unwrap();
            pictures.push(bytes.clone());
        }
        fractions.sort_by(f64::total_cmp);
        let widest = fractions.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
        // The films of one study are a subset of a series that is even as a whole.
        assert!(widest < 0.35, "{fractions:?}");
        // Two static films: the corner shows only noise.
        let rest = |speeds: Speeds| films.iter().position(|film| film.speeds == speeds).unwrap();
        assert_ne!(pictures[rest(Speeds::Paper)][..20], pictures[rest(Speeds::OffGrid)][..20]);
    }
}
