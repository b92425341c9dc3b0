//! The close follow of a rod: its sides and edges from their fits in the frame before.

use super::axis::Axis;
use super::close_fit::fit_close_edge;
use super::edge_fit::{Edge, fit_step_edge};
use super::finder::{Prediction, RodFinder, RodOnAxis, observe};
use super::observation::{FittedRod, RodObservation};
use super::paint_shading::clean_paint_at;
use super::profiles::CleanPaint;
use crate::image::ImageView;
use crate::results::{PointStatus, ROD_EDGES};

impl RodFinder {
    /// Finds the rod where it is predicted, from the fits of its sides and edges in the frame before.
    ///
    /// Those that could not be fitted before, or that have changed, are fitted from scratch. `None` if no side was fitted
    /// before, if light varies across the rod in this frame, or if the rod is not found.
    ///
    /// # Panics
    ///
    /// If the size of `image` differs from the planned size.
    pub fn follow_closely(&self, image: ImageView<'_>, near: &RodObservation) -> Option<RodObservation> {
        self.check_shape(image);
        let prediction = self.predict(near);
        if !self.expected_rod(&prediction).is_lit_evenly(image) {
            return None;
        }
        let axis = self.fit_close_axis(image, &prediction, &near.fitted)?;
        let rod = RodOnAxis { prediction: &prediction, axis: &axis, lights: &[None; ROD_EDGES] };
        let edges = self.fit_close_edges(image, &rod, &near.fitted);
        observe(near, &axis, &edges).ok()
    }

    /// Fits both sides, from their fits in the frame before where these hold.
    fn fit_close_axis(&self, image: ImageView<'_>, prediction: &Prediction, before: &FittedRod) -> Option<Axis> {
        let expected = self.expected_sides(prediction);
        let side = |index: usize| {
            let (expected, before) = (&expected[index], before.sides[index].as_ref()?);
            fit_close_edge(image, expected, before).or_else(|| fit_step_edge(image, expected).ok())
        };
        self.axis_between([side(0)?, side(1)?], expected[0].middle).ok()
    }

    /// Fits the edges, from their fits in the frame before where these hold: first those of clean tapes, then the speckled
    /// ones with blur and paint of the clean ones.
    fn fit_close_edges(
        &self,
        image: ImageView<'_>,
        rod: &RodOnAxis<'_>,
        before: &FittedRod,
    ) -> Vec<Result<Edge, PointStatus>> {
        let places = &rod.prediction.edges_px;
        let closely = |index: usize, clean: Option<CleanPaint>| {
            let fitted = before.edges[index].as_ref()?;
            fit_close_edge(image, &self.expected_edge(rod, index, clean), fitted).map(|edge| Self::on_axis(rod, edge))
        };
        let was_speckled = |index: usize| before.edges[index].is_some_and(|fitted| fitted.is_speckled());
        let mut found: Vec<Option<Edge>> =
            (0..places.len()).map(|index| (!was_speckled(index)).then(|| closely(index, None)).flatten()).collect();
        let mut separate = vec![None; places.len()];
        for index in (0..places.len()).filter(|index| found[*index].is_none() && !was_speckled(*index)) {
            separate[index] = Some(self.fit_edge(image, rod, index, None));
        }
        let fitted = found.iter().flatten().chain(separate.iter().flatten().flatten());
        let clean: Vec<Edge> = fitted.filter(|edge| !edge.is_speckled).copied().collect();
        let clean: Vec<&Edge> = clean.iter().collect();
        let paint = |index: usize| clean_paint_at(&clean, places[index]);
        for index in (0..places.len()).filter(|index| was_speckled(*index)) {
            found[index] = closely(index, paint(index));
            if found[index].is_none() {
                separate[index] = Some(self.fit_edge(image, rod, index, None));
            }
        }
        let refit = |index: usize, edge: Result<Edge, PointStatus>| match edge {
            Ok(edge) if clean.is_empty() || !edge.is_speckled => Ok(edge),
            Err(PointStatus::OutOfFrame) => Err(PointStatus::OutOfFrame),
            _ => self.fit_edge(image, rod, index, paint(index)),
        };
        let edge = |index: usize| match (found[index], separate[index]) {
            (Some(edge), _) => Ok(edge),
            (None, Some(edge)) => refit(index, edge),
            (None, None) => Err(PointStatus::Lost),
        };
        (0..places.len()).map(edge).collect()
    }
}
