//! The steps of a match as separate functions, for benchmarks.

use crate::dic::geometry::{GridPoint, PlanarMotion, Shape, SubsetMask, Warp};
use crate::dic::image::{Interpolation, PreparedFrame};
use crate::dic::params::CorrelationParams;
use crate::dic::refine::Refiner;
use crate::dic::search::IntegerSearch;
use crate::dic::subset::ReferenceSubset;
use crate::image::ImageView;

/// The steps of matching subsets of 31 x 31 pixels, and a disc of 53 px radius (8800 px), in one pair of frames.
///
/// Each method runs one step of [`Correlator::correlate`](crate::dic::Correlator::correlate) once.
pub struct KernelBenchmark {
    frames: (PreparedFrame, PreparedFrame),
    window: SubsetMask,
    search: IntegerSearch,
    subset: ReferenceSubset,
    disc: SubsetMask,
    body: ReferenceSubset,
    warp: Warp,
}

/// The pixels that an iteration matches.
#[derive(Clone, Copy)]
enum Pixels {
    Subset,
    Disc,
}

/// The radius of the disc, px.
const DISC_PX: i32 = 53;

impl KernelBenchmark {
    /// Prepares a pair of frames of one size, at least 128 x 128 px, that differ by about the given motion.
    ///
    /// # Panics
    ///
    /// If the frames are smaller.
    pub fn new(first: ImageView<'_>, second: ImageView<'_>, motion: PlanarMotion) -> Self {
        assert!(first.width() >= 128 && first.height() >= 128, "frames of a benchmark have room for the disc");
        let params = CorrelationParams::default();
        let mut parts = Self {
            frames: (PreparedFrame::default(), PreparedFrame::default()),
            window: SubsetMask::new(params.window, params.subset_size_px),
            search: IntegerSearch::new(params.subset_size_px as usize, params.search_px as usize),
            subset: ReferenceSubset::default(),
            disc: SubsetMask::from_test(DISC_PX as u32, |dx, dy| dx * dx + dy * dy <= DISC_PX * DISC_PX),
            body: ReferenceSubset::default(),
            warp: motion.to_warp(),
        };
        parts.prepare(first);
        std::mem::swap(&mut parts.frames.0, &mut parts.frames.1);
        parts.prepare(second);
        let at = parts.image_center();
        parts.extract(at);
        let Self { body, disc, frames, .. } = &mut parts;
        let _ = body.fill_body(&frames.0, disc, at);
        parts
    }

    /// Returns the pixel at the centre of the frames.
    fn image_center(&self) -> GridPoint {
        GridPoint { x: self.frames.0.width() as u32 / 2, y: self.frames.0.height() as u32 / 2 }
    }

    /// Computes grey levels, gradients and spline coefficients of a frame and makes it the target.
    pub fn prepare(&mut self, frame: ImageView<'_>) {
        self.frames.1.fill(frame, Interpolation::Optimised);
    }

    /// Extracts the subset centred at `at`: mean, energy, gradients and Hessian. Returns whether it is usable.
    pub fn extract(&mut self, at: GridPoint) -> bool {
        self.subset.fill(&self.frames.0, &self.window, Shape::Affine, at).is_ok()
    }

    /// Runs the FFT correlation of the last subset with the same 32 x 32 pixels of the target, and the sub-pixel peak
    /// fit. Returns whether it found a peak.
    pub fn find_peak(&mut self, at: GridPoint) -> bool {
        self.search.find_near(&self.subset, &self.window, &self.frames.1.levels, self.frames.1.local(at)).is_some()
    }

    /// Runs one exact affine iteration of the last subset. Returns whether it succeeded.
    pub fn iterate(&mut self, at: GridPoint) -> bool {
        self.refiner(Pixels::Subset, at).gauss_newton_step(&self.warp).is_ok()
    }

    /// Runs one rigid iteration of the disc. Returns whether it succeeded.
    pub fn iterate_disc(&mut self) -> bool {
        self.refiner(Pixels::Disc, self.image_center()).gauss_newton_step(&self.warp).is_ok()
    }

    /// Returns the refiner of the subset or the disc, centred at `at`.
    fn refiner(&self, pixels: Pixels, at: GridPoint) -> Refiner<'_> {
        let (subset, window, shape) = match pixels {
            Pixels::Subset => (&self.subset, &self.window, Shape::Affine),
            Pixels::Disc => (&self.body, &self.disc, Shape::Rigid),
        };
        Refiner { subset, window, shape, target: &self.frames.1.interpolated, at: self.frames.1.local(at) }
    }
}
