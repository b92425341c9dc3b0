//! Built-in scenarios.

use super::{
    BodySetup, CameraSetup, LightSetup, MotionSetup, PatternSetup, ScaleSetup, Scenario, ShadeSetup, Shape,
    SurfaceSetup,
};

const LACROSSE: &str = include_str!("built_in/lacrosse.toml");
const PAIR: &str = include_str!("built_in/pair.toml");
const PASSING: &str = include_str!("built_in/passing.toml");
const PLANE: &str = include_str!("built_in/plane.toml");
const ROD: &str = include_str!("built_in/rod.toml");
const TENNIS: &str = include_str!("built_in/tennis.toml");

/// The longitudinal vibration of a free steel rod 0.304 m long: c / 2 L.
const RINGING: &str = "ringing = { speed_m_s = 0.05, frequency_hz = 8500.0, decay_s = 2e-3 }\n";

impl Scenario {
    /// The names of the built-in experiments; [`PatternSetup::PAPER`] lists those of the patterns.
    pub const BUILT_IN: [&'static str; 9] =
        ["lacrosse", "lacrosse-sphere", "tennis", "tennis-physical", "rod", "rod-ringing", "pair", "passing", "plane"];

    /// Returns the built-in scenario of this name.
    ///
    /// - `lacrosse`: the lacrosse ball of the paper on a surface tilted by 19 deg.
    /// - `lacrosse-sphere`: the same with its speckles on a sphere.
    /// - `tennis`: the tennis ball of the paper on a racket at 45 deg, with the reported spin of 5 rad/s, which needs
    ///   very little friction.
    /// - `tennis-physical`: the same with the friction of strings.
    /// - `rod`: the steel rod of the paper dropped on a printed surface, with two tapes around it.
    /// - `rod-ringing`: the same with longitudinal vibrations.
    /// - `pair`: two balls that collide in the air and lose some of their speed.
    /// - `passing`: a small ball that passes in front of a larger one, both spheres. The larger one rotates faster and
    ///   about another axis from the middle of the film on.
    /// - `plane`: a speckled plane that fills the image, drifts and rotates.
    /// - `pattern-a-I` to `pattern-f-II`: a uniform motion off every grid, with a pattern of the paper's speckle study.
    pub fn built_in(name: &str) -> Option<Self> {
        let text = match name {
            "lacrosse" => LACROSSE.to_owned(),
            "lacrosse-sphere" => LACROSSE.replace("[body]\n", "[body]\nshape = \"sphere\"\n"),
            "tennis" => TENNIS.to_owned(),
            "tennis-physical" => TENNIS.replace("coefficient = 0.016", "coefficient = 0.3"),
            "rod" => ROD.to_owned(),
            "rod-ringing" => format!("{ROD}{RINGING}"),
            "pair" => PAIR.to_owned(),
            "passing" => PASSING.to_owned(),
            "plane" => PLANE.to_owned(),
            _ => {
                let pattern = PatternSetup::paper(name.strip_prefix("pattern-")?)?;
                let uniform = Self::translation(0.37, 0.13, 0.35);
                return Some(Self { name: name.to_owned(), body: BodySetup { pattern, ..uniform.body }, ..uniform });
            }
        };
        Self::from_toml(&text).ok().map(|scenario| Self { name: name.to_owned(), ..scenario })
    }

    /// Returns a ball of 120 px in 512 x 512 pixels that moves uniformly, for accuracy tests.
    ///
    /// `vx_px_frame` right, `vy_px_frame` **down**, `omega_deg_frame` counter-clockwise; 10 frames, noise 2 grey
    /// levels, uniform light. In the middle frame the ball is in the centre of the image.
    pub fn translation(vx_px_frame: f64, vy_px_frame: f64, omega_deg_frame: f64) -> Self {
        let frames = 10;
        let half = 0.5 * (frames - 1) as f64;
        // An odd fraction of a pixel, so that no frame lies on the pixel grid.
        let start_px = [255.63 - half * vx_px_frame, 255.29 - half * vy_px_frame];
        let camera = CameraSetup {
            width_px: 512,
            height_px: 512,
            frame_rate_hz: 10_000.0,
            exposure_us: 0.0,
            row_time_us: 0.0,
            frames,
            bits: 8,
            noise_dn: 2.0,
            shot_share: 0.0,
            gain_spread: 0.0,
            offset_spread_dn: 0.0,
            stuck_share: 0.0,
            blur_px: 0.7,
            gamma: 1.0,
            start_ns: 1_700_000_000_000_000_000,
        };
        Self {
            name: "translation".to_owned(),
            seed: 1,
            camera,
            scale: ScaleSetup { mm_per_px: 0.5, nearer_per_s: 0.0 },
            surface: SurfaceSetup::default(),
            body: BodySetup {
                diameter_mm: 60.0,
                shape: Shape::Disc,
                pattern: PatternSetup::default(),
                fuzz_px: 0.0,
                rod: None,
            },
            shade: ShadeSetup::default(),
            light: LightSetup::default(),
            occluder: None,
            motion: MotionSetup::Constant { vx_px_frame, vy_px_frame, omega_deg_frame, start_px },
            other: None,
        }
    }
}

impl PatternSetup {
    /// The names of the 16 patterns of the speckle study.
    pub const PAPER: [&'static str; 16] = [
        "a-I", "a-II", "a-III", "b-I", "b-II", "b-III", "c-I", "c-II", "c-III", "d-I", "d-II", "d-III", "e-I", "e-II",
        "f-I", "f-II",
    ];

    /// Returns a pattern of the speckle study: its speckle areas, density and lines (section 3 and Fig. 2 of the
    /// paper).
    ///
    /// The density of e-II is not given there; 45 % is assumed. The irregular speckles of e and f are round here.
    pub fn paper(name: &str) -> Option<Self> {
        let round = |area_px2: f64, coverage: f64| (area_px2, area_px2, coverage, 0);
        let (area_min_px2, area_max_px2, coverage, lines) = match name {
            "a-I" => round(4.0, 0.09),
            "a-II" => round(4.0, 0.17),
            "a-III" => round(4.0, 0.24),
            "b-I" => round(10.0, 0.13),
            "b-II" => round(10.0, 0.19),
            "b-III" => round(10.0, 0.31),
            "c-I" => round(20.0, 0.14),
            "c-II" => round(20.0, 0.18),
            "c-III" => round(20.0, 0.27),
            "d-I" => round(250.0, 0.22),
            "d-II" => round(250.0, 0.30),
            "d-III" => round(250.0, 0.43),
            "e-I" => (4.0, 80.0, 0.54, 0),
            "e-II" => (2.0, 40.0, 0.45, 0),
            "f-I" => (4.0, 20.0, 0.27, 4),
            "f-II" => (4.0, 80.0, 0.52, 4),
            _ => return None,
        };
        Some(Self { area_min_px2, area_max_px2, coverage, lines, ..Self::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_scenario_is_valid() {
        let patterns = PatternSetup::PAPER.map(|pattern| format!("pattern-{pattern}"));
        for name in Scenario::BUILT_IN.into_iter().chain(patterns.iter().map(String::as_str)) {
            assert_eq!(Scenario::built_in(name).map(|scenario| scenario.name).as_deref(), Some(name));
        }
    }
}
