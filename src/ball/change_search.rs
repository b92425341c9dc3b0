//! The search of a ball by its difference from a background: one that is known, or a plain one.

use super::changed_disc::{ChangedDisc, WantedRadius, fit_disc};
use super::faint_rim::fit_faint_rim;
use super::foreground::{ChangedPart, Foreground};
use super::params::{BallParams, MIN_EDGE_RADIUS_PX};
use super::plain_ground::PlainGround;
use super::point::find_point;
use super::texture_disc::RadiusRange;
use crate::image::ImageView;
use crate::results::Circle;

/// The search by differences, with its scratch memory.
#[derive(Debug, Default)]
pub(super) struct ChangeSearch {
    foreground: Foreground,
    ground: PlainGround,
}

impl ChangeSearch {
    /// Finds the ball in the difference of an image from its background, DN: its outline, or a ball too small for one as a
    /// point.
    pub(super) fn find(&mut self, difference: ImageView<'_>, params: &BallParams) -> Option<Circle> {
        let fit = |sizes: ImageView<'_>, part, wanted| {
            fit_disc(sizes, part, wanted).or_else(|| fit_faint_rim(difference, sizes, part, wanted))
        };
        let disc = params.may_have_edges().then(|| self.best_disc(difference, params, fit)).flatten();
        disc.or_else(|| self.find_point(difference, params).filter(|_| params.may_be_point()))
    }

    /// Finds a ball of known size by its difference from a ground of hardly any structure.
    ///
    /// Without its size, the lit side of a ball alone, or marks of paint, may pass for one.
    pub(super) fn find_on_plain_ground(&mut self, image: ImageView<'_>, params: &BallParams) -> Option<Circle> {
        params.expected_radius_px?;
        let (width, height) = (image.width(), image.height());
        let mut ground = std::mem::take(&mut self.ground);
        let difference = ground.subtract(image, params.region(width, height), params.max_radius_px);
        let view = ImageView::new(difference, width, height).ok();
        let circle = view.and_then(|view| self.best_disc(view, params, fit_disc));
        let circle = circle.filter(|circle| ground.is_strongest(circle, width, params.min_radius_px));
        self.ground = ground;
        circle
    }

    /// Returns the disc that changed most among those that `fit` finds in the changed parts of a difference.
    fn best_disc<F>(&mut self, difference: ImageView<'_>, params: &BallParams, fit: F) -> Option<Circle>
    where
        F: Fn(ImageView<'_>, ChangedPart, WantedRadius) -> Option<ChangedDisc>,
    {
        let range = RadiusRange { low: params.min_radius_px.max(MIN_EDGE_RADIUS_PX), high: params.max_radius_px };
        let wanted = WantedRadius { range, expected: params.expected_radius_within(range) };
        let parts = self.changed_parts(difference, params, range);
        let sizes = ImageView::new(self.foreground.sizes(), difference.width(), difference.height()).ok()?;
        let discs = parts.into_iter().filter_map(|part| fit(sizes, part, wanted));
        discs.max_by(|a, b| a.gain.total_cmp(&b.gain)).map(|disc| disc.circle)
    }

    /// Returns the ball as a point, if it may be too small for its outline.
    fn find_point(&mut self, difference: ImageView<'_>, params: &BallParams) -> Option<Circle> {
        let range = RadiusRange { low: params.min_radius_px, high: params.max_radius_px.min(MIN_EDGE_RADIUS_PX) };
        if range.low >= range.high {
            return None;
        }
        let parts = self.changed_parts(difference, params, range);
        let sizes = ImageView::new(self.foreground.sizes(), difference.width(), difference.height()).ok()?;
        find_point(sizes, &parts, WantedRadius { range, expected: params.expected_radius_within(range) })
    }

    /// Returns the changed parts of about the area of a ball.
    fn changed_parts(
        &mut self,
        difference: ImageView<'_>,
        params: &BallParams,
        range: RadiusRange,
    ) -> Vec<ChangedPart> {
        let region = params.region(difference.width(), difference.height());
        self.foreground.search(difference, region, range)
    }
}
