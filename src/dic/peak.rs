//! Peaks of a correlation surface.

/// The top of a peak between the samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Peak {
    /// Column of the highest sample.
    pub(super) column: usize,
    /// Row of the highest sample.
    pub(super) row: usize,
    /// Offset of the top from the highest sample along the columns, -1 to 1.
    pub(super) dx: f64,
    /// Offset along the rows, -1 to 1.
    pub(super) dy: f64,
    /// Height of the top.
    pub(super) height: f64,
}

/// A correlation surface; samples that could not be computed are -infinity.
#[derive(Debug, Clone, Copy)]
pub(super) struct Surface<'a> {
    pub(super) data: &'a [f32],
    pub(super) columns: usize,
}

impl Surface<'_> {
    fn rows(&self) -> usize {
        self.data.len() / self.columns
    }

    /// The nine samples around (column, row); `None` at the border and next to missing samples.
    fn patch(&self, column: usize, row: usize) -> Option<[f32; 9]> {
        if column == 0 || row == 0 || column + 1 >= self.columns || row + 1 >= self.rows() {
            return None;
        }
        let patch = std::array::from_fn(|k| self.data[(row + k / 3 - 1) * self.columns + column + k % 3 - 1]);
        patch.iter().all(|value| value.is_finite()).then_some(patch)
    }

    /// The top of the peak whose highest sample is at (column, row).
    ///
    /// A paraboloid through the logarithm of the nine samples, by least squares
    /// with the cross term; the sample itself where that has no top.
    pub(super) fn top(&self, column: usize, row: usize) -> Peak {
        let height = f64::from(self.data[row * self.columns + column]);
        let plain = Peak { column, row, dx: 0.0, dy: 0.0, height };
        let Some(patch) = self.patch(column, row).filter(|patch| patch.iter().all(|value| *value > 0.0)) else {
            return plain;
        };
        match paraboloid(&patch.map(|value| f64::from(value).ln())) {
            Some((dx, dy, top)) => Peak { dx, dy, height: top.exp(), ..plain },
            None => plain,
        }
    }

    /// The highest sample; the first of equal ones. `None` when all are missing.
    pub(super) fn highest(&self) -> Option<(usize, usize)> {
        let mut best: Option<(usize, f32)> = None;
        for (index, value) in self.data.iter().enumerate() {
            if value.is_finite() && best.is_none_or(|(_, high)| *value > high) {
                best = Some((index, *value));
            }
        }
        best.map(|(index, _)| (index % self.columns, index / self.columns))
    }

    /// The highest local maximum besides (column, row) and its eight neighbours.
    pub(super) fn second(&self, (column, row): (usize, usize)) -> Option<Peak> {
        let mut best: Option<Peak> = None;
        for y in 1..self.rows().saturating_sub(1) {
            for x in 1..self.columns.saturating_sub(1) {
                let value = self.data[y * self.columns + x];
                let low = best.is_some_and(|peak| f64::from(value) < 0.8 * peak.height);
                if low || value <= 0.0 || (x.abs_diff(column) <= 1 && y.abs_diff(row) <= 1) {
                    continue;
                }
                let Some(patch) = self.patch(x, y) else { continue };
                if patch.iter().all(|other| *other <= value) {
                    let peak = self.top(x, y);
                    if best.is_none_or(|best| peak.height > best.height) {
                        best = Some(peak);
                    }
                }
            }
        }
        best
    }
}

/// Top of the least-squares paraboloid over a 3 x 3 patch: dx, dy and height.
pub(super) fn paraboloid(patch: &[f64; 9]) -> Option<(f64, f64, f64)> {
    let sum = |weight: fn(f64, f64) -> f64| -> f64 {
        patch.iter().enumerate().map(|(k, value)| value * weight((k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0)).sum()
    };
    let (x, y) = (sum(|x, _| x) / 6.0, sum(|_, y| y) / 6.0);
    let xx = sum(|x, _| x * x - 2.0 / 3.0) / 2.0;
    let yy = sum(|_, y| y * y - 2.0 / 3.0) / 2.0;
    let xy = sum(|x, y| x * y) / 4.0;
    let mean = sum(|_, _| 1.0) / 9.0 - (xx + yy) * 2.0 / 3.0;
    let determinant = 4.0 * xx * yy - xy * xy;
    if xx >= 0.0 || determinant <= 0.0 {
        return None;
    }
    let (dx, dy) = ((xy * y - 2.0 * yy * x) / determinant, (xy * x - 2.0 * xx * y) / determinant);
    (dx.abs() <= 1.0 && dy.abs() <= 1.0).then_some((dx, dy, mean + 0.5 * (x * dx + y * dy)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bumps(centers: &[(f64, f64, f64)]) -> Vec<f32> {
        (0..21 * 25)
            .map(|k| {
                let (x, y) = (f64::from(k % 25), f64::from(k / 25));
                let height = |(cx, cy, h): &(f64, f64, f64)| {
                    h * (-((x - cx).powi(2) / 6.0 + (y - cy).powi(2) / 4.0 + (x - cx) * (y - cy) / 8.0)).exp()
                };
                centers.iter().map(height).sum::<f64>() as f32
            })
            .collect()
    }

    #[test]
    fn the_top_of_a_tilted_gaussian_is_exact() {
        for (x, y) in [(8.0, 9.0), (8.3, 9.4), (7.55, 8.61)] {
            let data = bumps(&[(x, y, 0.9)]);
            let surface = Surface { data: &data, columns: 25 };
            let (column, row) = surface.highest().unwrap();
            let peak = surface.top(column, row);
            assert!((column as f64 + peak.dx - x).abs() < 1e-4, "{peak:?}");
            assert!((row as f64 + peak.dy - y).abs() < 1e-4, "{peak:?}");
            assert!((peak.height - 0.9).abs() < 1e-4, "{peak:?}");
        }
    }

    #[test]
    fn the_second_peak_is_the_next_maximum_not_the_shoulder_of_the_first() {
        let data = bumps(&[(6.3, 6.2, 1.0), (17.2, 12.1, 0.7), (5.0, 17.0, 0.6)]);
        let surface = Surface { data: &data, columns: 25 };
        let second = surface.second(surface.highest().unwrap()).unwrap();
        assert_eq!((second.column, second.row), (17, 12));
        assert!((second.height - 0.7).abs() < 1e-3, "{second:?}");
    }

    #[test]
    fn a_surface_without_samples_has_no_peak() {
        assert!(Surface { data: &[f32::NEG_INFINITY; 9], columns: 3 }.highest().is_none());
    }
}
