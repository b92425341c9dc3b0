//! Annotations that viewers draw over a frame.

use foxglove::messages::{CircleAnnotation, Color, ImageAnnotations, Point2, PointsAnnotation, points_annotation};

/// Circles and arrows in image axes, px; pixel centres are at whole numbers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Annotations {
    /// Circles: centre x, centre y, radius.
    pub circles: Vec<[f64; 3]>,
    /// Arrows from one (x, y) to another.
    pub vectors: Vec<[[f64; 2]; 2]>,
}

/// The colour of detected outlines.
const GREEN: Color = Color { r: 0.1, g: 0.9, b: 0.3, a: 1.0 };
/// The colour of displacement arrows.
const YELLOW: Color = Color { r: 1.0, g: 0.85, b: 0.1, a: 1.0 };

impl Annotations {
    /// Converts to Foxglove's message for the frame with this stamp, ns since the Unix epoch.
    pub(super) fn to_message(&self, stamp_ns: u64) -> ImageAnnotations {
        let timestamp = Some(super::frame_message::timestamp(stamp_ns));
        let circles = self
            .circles
            .iter()
            .map(|[x, y, radius]| CircleAnnotation {
                timestamp,
                position: Some(corner_origin(*x, *y)),
                diameter: 2.0 * radius,
                thickness: 1.0,
                fill_color: None,
                outline_color: Some(GREEN),
                metadata: Vec::new(),
            })
            .collect();
        let lines = PointsAnnotation {
            timestamp,
            r#type: points_annotation::Type::LineList.into(),
            points: self.vectors.iter().flatten().map(|[x, y]| corner_origin(*x, *y)).collect(),
            outline_color: Some(YELLOW),
            outline_colors: Vec::new(),
            fill_color: None,
            thickness: 1.0,
            metadata: Vec::new(),
        };
        let points = if self.vectors.is_empty() { Vec::new() } else { vec![lines] };
        ImageAnnotations { timestamp, circles, points, texts: Vec::new(), metadata: Vec::new() }
    }
}

/// Converts a position, px, to Foxglove's axes, which begin at the corner of the top-left pixel instead of at its
/// centre: adds half a pixel to both.
fn corner_origin(x_px: f64, y_px: f64) -> Point2 {
    Point2 { x: x_px + 0.5, y: y_px + 0.5 }
}
