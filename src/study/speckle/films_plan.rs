//! The films of a study: all combinations of the paper's speeds and spins, and the same off every grid.

use crate::console::UsageError;
use crate::synth::PatternSetup;

/// Number of speeds along each axis, px/frame; each study uses some of the combinations.
const SPEEDS_PX: usize = 6;

/// Number of spins, deg/frame.
const SPINS_DEG: usize = 4;

/// Number of films of one pattern and set of speeds: 6 speeds along x, 6 along y, 4 spins.
pub(super) const FILMS: usize = SPEEDS_PX * SPEEDS_PX * SPINS_DEG;

/// Number of speeds of the peak study: 0.1 to 2 px/frame in steps of 0.1.
const PEAK_FILMS: usize = 20;

/// Films per speed of the peak study, each at a subpixel position of its own.
const PEAK_TAKES: usize = 8;

/// Motions at each level of a study over a setting: px/frame along x and y, deg/frame; off every grid.
const MOTIONS: [[f64; 3]; 8] = [
    [0.13, 0.77, 0.83],
    [0.37, 1.23, -1.71],
    [0.77, 0.13, 2.57],
    [1.23, 1.87, -0.83],
    [1.87, 0.37, 1.71],
    [0.37, 0.37, -2.57],
    [1.23, 0.13, 0.37],
    [0.77, 1.87, -0.37],
];

/// A speckle study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeckleStudy {
    /// Translation along one axis, without spin (Fig. 3).
    Translation,
    /// Translation along both axes, without spin (Fig. 4).
    Translation2,
    /// Spin without translation (Fig. 5).
    Rotation,
    /// Translation along both axes with spin (Fig. 6); films along one axis with spin are measured as well.
    General,
    /// Splined windows against a splined peak, along x (Fig. 7).
    Peak,
    /// Variation of the camera noise.
    Noise,
    /// Variation of the lens blur.
    Blur,
    /// Variation of the frame rate: the same motion in smaller and smaller steps.
    Rate,
}

/// A set of speeds and spins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Speeds {
    /// The paper's: all but 0.1 lie on the grid of 5 points between two pixels.
    Paper,
    /// Similar ones off every such grid.
    OffGrid,
}

/// The kind of motion in a film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Case {
    /// No motion.
    Rest,
    /// Translation along x or y.
    OneAxis,
    /// Translation along both axes.
    TwoAxes,
    /// Spin.
    Spin,
    /// Spin and translation along x or y.
    OneAxisSpin,
    /// Spin and translation along both axes.
    General,
}

/// The true velocity of a film's ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Velocity {
    /// Translation along x and along y (down), px/frame.
    pub(super) px_frame: [f64; 2],
    /// Spin, counter-clockwise, deg/frame.
    pub(super) deg_frame: f64,
}

/// A film to render and measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Film {
    /// Index of the pattern in [`PatternSetup::PAPER`].
    pub(super) pattern: usize,
    pub(super) speeds: Speeds,
    /// Number among all films of the pattern and set of speeds, the same in every study that uses it.
    pub(super) number: usize,
    pub(super) case: Case,
    pub(super) velocity: Velocity,
    /// Index of the study's level; 0 if it has none.
    pub(super) level: usize,
}

impl SpeckleStudy {
    /// Returns the name on the command line and in file names.
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Translation => "translation",
            Self::Translation2 => "translation2",
            Self::Rotation => "rotation",
            Self::General => "general",
            Self::Peak => "peak",
            Self::Noise => "noise",
            Self::Blur => "blur",
            Self::Rate => "rate",
        }
    }

    /// Returns the heading of the figure.
    pub(super) fn heading(self) -> &'static str {
        match self {
            Self::Translation => "Speckle patterns: translation in one direction (the paper's Fig. 3)",
            Self::Translation2 => "Speckle patterns: translation in two directions (the paper's Fig. 4)",
            Self::Rotation => "Speckle patterns: pure rotation (the paper's Fig. 5)",
            Self::General => "Speckle patterns: general motion (the paper's Fig. 6)",
            Self::Peak => "Splined windows and splined peaks (the paper's Fig. 7)",
            Self::Noise => "Accuracy of the methods over the noise",
            Self::Blur => "Accuracy of the methods over the lens blur",
            Self::Rate => "Accuracy of the methods over the frame rate",
        }
    }

    /// Returns the lines that explain the figure.
    pub(super) fn explanation(self) -> impl Iterator<Item = &'static str> {
        const BARS: &str =
            "Logarithmic axes; thin lines: mean +- standard deviation of the films; ! where answers are missing.";
        const BEST: &str = "Dashed line: the paper's best ball, where its text reports a number.";
        let lines: &'static [&'static str] = match self {
            Self::Translation | Self::Translation2 => &[
                BARS,
                BEST,
                "Without spin all windows read one grid point, so \"paper\" errs by next to nothing in deg.",
            ],
            Self::Rotation => &[BARS, BEST],
            Self::General => &[BARS],
            Self::Peak => {
                &["Logarithmic axes; each point is the mean of the films of one speed; hollow: answers are missing."]
            }
            Self::Noise | Self::Blur | Self::Rate => &[
                "Logarithmic axes; each point is the mean of the eight motions of one level; hollow: answers are missing.",
            ],
        };
        lines.iter().copied()
    }

    /// Returns the levels of the varied setting; empty for a study that varies none.
    ///
    /// They are standard deviations of the noise in grey levels of 255, standard deviations of the lens blur in px, or
    /// frame rates as multiples of the slowest.
    pub(super) fn levels(self) -> &'static [f64] {
        match self {
            Self::Noise => &[0.0, 1.0, 2.0, 4.0, 8.0, 16.0],
            Self::Blur => &[0.3, 0.5, 0.7, 1.0, 1.4, 2.0],
            Self::Rate => &[1.0, 2.0, 4.0, 8.0, 16.0, 32.0],
            _ => &[],
        }
    }

    /// Returns the column of the varied setting; without meaning for a study that varies none.
    pub(super) fn level_column(self) -> &'static str {
        match self {
            Self::Noise => "noise_dn",
            Self::Blur => "blur_px",
            _ => "rate",
        }
    }

    /// Returns the case of motion that the figure shows.
    pub(super) fn figure_case(self) -> Case {
        match self {
            Self::Translation | Self::Peak => Case::OneAxis,
            Self::Translation2 => Case::TwoAxes,
            Self::Rotation => Case::Spin,
            Self::General | Self::Noise | Self::Blur | Self::Rate => Case::General,
        }
    }

    /// Whether the study includes films of this case.
    pub(super) fn includes(self, case: Case) -> bool {
        match self {
            Self::Translation => matches!(case, Case::Rest | Case::OneAxis),
            Self::Translation2 => case == Case::TwoAxes,
            Self::Rotation => case == Case::Spin,
            Self::General => matches!(case, Case::General | Case::OneAxisSpin),
            Self::Peak => case == Case::OneAxis,
            Self::Noise | Self::Blur | Self::Rate => case == Case::General,
        }
    }

    /// Returns the films of one pattern and set of speeds whose case the study includes, in the order of their numbers.
    fn films(self, pattern: usize, speeds: Speeds) -> Vec<Film> {
        let film = |(number, velocity): (usize, Velocity)| {
            let case = Case::from_velocity(&velocity);
            let level = if self.levels().is_empty() { 0 } else { number / MOTIONS.len() };
            Film { pattern, speeds, number, case, velocity, level }
        };
        let velocities: Vec<Velocity> = match self {
            Self::Peak => {
                (0..PEAK_FILMS * PEAK_TAKES).map(|number| speeds.peak_velocity(number / PEAK_TAKES)).collect()
            }
            Self::Noise | Self::Blur | Self::Rate => self.level_motions(),
            _ => (0..FILMS).map(|number| speeds.velocity(number)).collect(),
        };
        velocities.into_iter().enumerate().map(film).filter(|film| self.includes(film.case)).collect()
    }

    /// Returns the motions at every level of a study over a setting, level by level; the frame rate divides them.
    fn level_motions(self) -> Vec<Velocity> {
        let motion = |level: f64, [x, y, turn]: [f64; 3]| {
            let slower = if self == Self::Rate { level } else { 1.0 };
            Velocity { px_frame: [x / slower, y / slower], deg_frame: turn / slower }
        };
        self.levels().iter().flat_map(|level| MOTIONS.map(|of| motion(*level, of))).collect()
    }

    /// Returns all films of the study, in the order of its table.
    pub(super) fn plan(self, patterns: &[usize], speeds: &[Speeds]) -> Vec<Film> {
        let both = patterns.iter().flat_map(|pattern| speeds.iter().map(move |speeds| (*pattern, *speeds)));
        both.flat_map(|(pattern, speeds)| self.films(pattern, speeds)).collect()
    }
}

impl Speeds {
    pub(super) const ALL: [Self; 2] = [Self::Paper, Self::OffGrid];

    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::OffGrid => "off-grid",
        }
    }

    /// Returns the speeds along an axis, px/frame.
    fn px_frame(self) -> [f64; SPEEDS_PX] {
        match self {
            Self::Paper => [0.0, 0.1, 0.5, 1.0, 1.5, 2.0],
            Self::OffGrid => [0.0, 0.13, 0.37, 0.77, 1.23, 1.87],
        }
    }

    /// Returns the spins, deg/frame.
    fn deg_frame(self) -> [f64; SPINS_DEG] {
        match self {
            Self::Paper => [0.0, 1.0, 2.0, 3.0],
            Self::OffGrid => [0.0, 0.83, 1.71, 2.57],
        }
    }

    /// Describes the speeds and spins for a caption.
    pub(super) fn describe(self, study: SpeckleStudy) -> String {
        let listed = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        if study == SpeckleStudy::Peak {
            let steps: Vec<f64> = (0..PEAK_FILMS).map(|step| self.peak_velocity(step).px_frame[0]).collect();
            return format!("{}, {}, ... {} px/frame", steps[0], steps[1], steps[PEAK_FILMS - 1]);
        }
        let (speeds, spins) = (listed(&self.px_frame()[1..]), listed(&self.deg_frame()[1..]));
        match study {
            SpeckleStudy::Noise | SpeckleStudy::Blur => {
                "0.5 to 2.2 px/frame and spins of 0.37 to 2.57 deg/frame".to_owned()
            }
            SpeckleStudy::Rate => {
                "0.5 to 2.2 px/frame and spins of 0.37 to 2.57 deg/frame at the slowest rate".to_owned()
            }
            SpeckleStudy::Rotation => format!("{spins} deg/frame"),
            SpeckleStudy::General => format!("{speeds} px/frame and {spins} deg/frame"),
            _ => format!("{speeds} px/frame"),
        }
    }

    /// Returns the velocity of the film with this number in the first four studies. The spin varies fastest, then y,
    /// then x.
    fn velocity(self, number: usize) -> Velocity {
        let (speeds, spins) = (self.px_frame(), self.deg_frame());
        let [x, y] = [number / SPINS_DEG / SPEEDS_PX, number / SPINS_DEG % SPEEDS_PX];
        Velocity { px_frame: [speeds[x], speeds[y]], deg_frame: spins[number % SPINS_DEG] }
    }

    /// Returns the velocity of a step, counted from 0, of the peak study along x: `step + 1` tenths of a pixel per
    /// frame, or 0.017 px less off the grid.
    fn peak_velocity(self, step: usize) -> Velocity {
        let offset_px = if self == Self::Paper { 0.0 } else { -0.017 };
        // Rounded, because 0.1 * 3 is not 0.3.
        let speed_px = ((100.0 * (step + 1) as f64 + 1000.0 * offset_px).round()) / 1000.0;
        Velocity { px_frame: [speed_px, 0.0], deg_frame: 0.0 }
    }
}

impl Case {
    pub(super) fn as_str(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::OneAxis => "one-axis",
            Self::TwoAxes => "two-axes",
            Self::Spin => "spin",
            Self::OneAxisSpin => "one-axis-spin",
            Self::General => "general",
        }
    }

    /// Returns the case of a motion with this velocity, whose translation is not negative.
    fn from_velocity(velocity: &Velocity) -> Self {
        let axes = velocity.px_frame.iter().filter(|speed| **speed > 0.0).count();
        match (axes, velocity.deg_frame.abs() > 0.0) {
            (0, false) => Self::Rest,
            (1, false) => Self::OneAxis,
            (_, false) => Self::TwoAxes,
            (0, true) => Self::Spin,
            (1, true) => Self::OneAxisSpin,
            (_, true) => Self::General,
        }
    }
}

/// Resolves the values of a comma-separated option, in the given order.
///
/// # Errors
///
/// [`UsageError`] naming the option, the unknown or repeated value and the allowed ones.
pub(super) fn resolve_words<T: Copy + PartialEq>(
    option: &str,
    given: &[String],
    allowed: &[(&'static str, T)],
) -> Result<Vec<T>, UsageError> {
    let mut chosen = Vec::new();
    for word in given {
        let Some((_, value)) = allowed.iter().find(|(name, _)| name == word) else {
            let names: Vec<&str> = allowed.iter().map(|(name, _)| *name).collect();
            return Err(UsageError(format!("{option} {word:?}: allowed are {}", names.join(", "))));
        };
        if chosen.contains(value) {
            return Err(UsageError(format!("{option} {word:?}: given twice")));
        }
        chosen.push(*value);
    }
    if chosen.is_empty() {
        let names: Vec<&str> = allowed.iter().map(|(name, _)| *name).collect();
        return Err(UsageError(format!("{option}: no value given, allowed are {}", names.join(", "))));
    }
    Ok(chosen)
}

/// Returns names and indices of the paper's patterns.
pub(super) fn patterns() -> Vec<(&'static str, usize)> {
    PatternSetup::PAPER.into_iter().enumerate().map(|(place, name)| (name, place)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_four_studies_share_the_144_films_of_a_pattern() {
        for speeds in Speeds::ALL {
            let count = |study: SpeckleStudy| study.films(0, speeds).len();
            let counts = [
                count(SpeckleStudy::Translation),
                count(SpeckleStudy::Translation2),
                count(SpeckleStudy::Rotation),
                count(SpeckleStudy::General),
            ];
            assert_eq!(counts, [11, 25, 3, 105]);
            assert_eq!(counts.iter().sum::<usize>(), FILMS);
        }
        let shown = |study: SpeckleStudy| {
            study.films(3, Speeds::Paper).into_iter().filter(|film| film.case == study.figure_case()).count()
        };
        // The paper's numbers: 25 velocities along both axes, spins of 1 to 3 deg, 75 of both together.
        assert_eq!(shown(SpeckleStudy::Translation), 10);
        assert_eq!(shown(SpeckleStudy::Translation2), 25);
        assert_eq!(shown(SpeckleStudy::Rotation), 3);
        assert_eq!(shown(SpeckleStudy::General), 75);
    }

    #[test]
    fn off_grid_speeds_lie_off_the_grid_of_5_points_and_of_every_other_number_up_to_10() {
        let on = |speeds: Speeds| speeds.px_frame().into_iter().skip(1);
        let peak = (0..PEAK_FILMS).map(|step| Speeds::OffGrid.peak_velocity(step).px_frame[0]);
        let apart = |speed: f64, per_px: f64| (speed * per_px - (speed * per_px).round()).abs() / per_px;
        for speed in on(Speeds::OffGrid) {
            assert!((1..=11).all(|per_px| apart(speed, f64::from(per_px)) >= 0.002), "{speed}");
            assert!(apart(speed, 6.0) > 0.02, "{speed} px is on the grid of 5 points");
        }
        // Of the paper's, only 0.1 px is off the grid of 5 points.
        assert_eq!(on(Speeds::Paper).filter(|speed| apart(*speed, 6.0) > 1e-9).count(), 1);
        assert!(peak.clone().all(|speed| apart(speed, 6.0) > 0.015), "on the grid of 5 points");
        assert_eq!(peak.count(), 20);
    }

    #[test]
    fn the_peak_study_goes_by_tenths_from_a_tenth_to_two_pixels() {
        let films = SpeckleStudy::Peak.films(13, Speeds::Paper);
        assert_eq!(films.len(), PEAK_FILMS * PEAK_TAKES);
        // Exact to the bit, because they are written into tables.
        let along = |film: &Film| film.velocity.px_frame.map(|px| px.to_string());
        assert_eq!(along(&films[0]), ["0.1", "0"]);
        assert_eq!(along(&films[2 * PEAK_TAKES]), ["0.3", "0"]);
        assert_eq!(along(&films[films.len() - 1]), ["2", "0"]);
        assert_eq!(along(&SpeckleStudy::Peak.films(13, Speeds::OffGrid)[0]), ["0.083", "0"]);
    }

    #[test]
    fn a_study_over_a_setting_has_the_same_motions_at_every_level_and_slower_ones_at_a_higher_rate() {
        for study in [SpeckleStudy::Noise, SpeckleStudy::Blur, SpeckleStudy::Rate] {
            let films = study.plan(&[13], &[Speeds::OffGrid]);
            assert_eq!(films.len(), 6 * 8);
            for film in &films {
                let first = films[film.number % 8].velocity;
                let slower = if study == SpeckleStudy::Rate { 2_f64.powi(film.level as i32) } else { 1.0 };
                assert!((film.velocity.px_frame[0] * slower - first.px_frame[0]).abs() < 1e-12, "{film:?}");
                assert!((film.velocity.deg_frame * slower - first.deg_frame).abs() < 1e-12, "{film:?}");
                assert_eq!(film.case, Case::General);
            }
        }
    }

    #[test]
    fn a_name_that_is_not_there_or_twice_is_refused_with_what_is_allowed() {
        let allowed = [("x", 1), ("y", 2)];
        let chosen = |words: &[&str]| {
            let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            super::resolve_words("--of", &words, &allowed).map_err(|error| error.to_string())
        };
        assert_eq!(chosen(&["y", "x"]), Ok(vec![2, 1]));
        assert_eq!(chosen(&["z"]), Err("--of \"z\": allowed are x, y".to_owned()));
        assert_eq!(chosen(&["x", "x"]), Err("--of \"x\": given twice".to_owned()));
        assert!(chosen(&[]).is_err());
    }
}
