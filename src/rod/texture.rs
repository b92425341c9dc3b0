//! The texture and the noise of a part of the image.

use crate::image::{ImageView, PixelRect};
use crate::numeric::quantile;
use std::ops::Range;

/// Returns the mean squared difference of pixels two apart, DN^2, along rows or columns, whichever is smaller.
///
/// Speckles change along both. A reflection and shading change along rows only.
pub(super) fn mean_square_gradient(image: ImageView<'_>, columns: Range<usize>, rows: Range<usize>) -> f64 {
    let square = |low: f32, high: f32| f64::from(high - low).powi(2);
    let (mut along_rows, mut along_columns) = (0.0, 0.0);
    for y in rows.clone() {
        let [above, row, below] = [y - 1, y, y + 1].map(|y| image.row(y));
        along_rows += columns.clone().map(|x| square(row[x - 1], row[x + 1])).sum::<f64>();
        along_columns += columns.clone().map(|x| square(above[x], below[x])).sum::<f64>();
    }
    f64::min(along_rows, along_columns) / (rows.len() * columns.len()).max(1) as f64
}

/// Estimates the noise of single pixels in a region, DN, from the median difference of
/// neighbours.
pub(super) fn noise_dn(image: ImageView<'_>, region: PixelRect) -> f32 {
    let rows = region.rows().map(|y| &image.row(y)[region.columns()]);
    let mut differences: Vec<f32> = rows.flat_map(|row| row.windows(2).map(|pair| (pair[1] - pair[0]).abs())).collect();
    // The median absolute difference of two normal numbers, in standard deviations of one.
    quantile(&mut differences, 0.5).unwrap_or(0.0) / (0.6745 * std::f32::consts::SQRT_2)
}
