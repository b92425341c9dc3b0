//! The style of the methods in the figures of the speckle studies.

use super::methods::Method;
use crate::plot::{CurveStyle, Marker, draw_legend};
use maud::Markup;

/// Height of the space for a line of the legend, px.
pub(super) const LEGEND: f64 = 20.0;

/// Returns the style of a method; the palette suits the colour-blind (M. Okabe, K. Ito, 2008).
pub(super) fn style(method: Method) -> CurveStyle {
    let color = match method {
        Method::Paper => "#d55e00",
        Method::PaperFit => "#e69f00",
        Method::PeakSpline => "#009e73",
        Method::PeakPlain => "#cc79a7",
        Method::IcGn => "#56b4e9",
        Method::Ring => "#f0e442",
        Method::Rigid => "#0072b2",
    };
    CurveStyle { color, dash: "", marker: Marker::Disc }
}

/// Draws a line of the legend for some methods, at height `top`, px.
pub(super) fn legend(top: f64, methods: &[Method]) -> Markup {
    let entries: Vec<(CurveStyle, String)> =
        methods.iter().map(|method| (style(*method), method.title().to_owned())).collect();
    draw_legend(top, &entries)
}
