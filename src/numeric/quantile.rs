//! Median, quantiles, and the threshold between two classes of values.

use std::cmp::Ordering;

/// The standard deviation of Gaussian noise relative to the median of its absolute values.
pub const SIGMA_PER_MEDIAN: f64 = 1.4826;

/// A floating-point number.
pub trait Float: Copy {
    /// Compares in the order of `total_cmp`, in which NaN has a place too.
    fn order(&self, other: &Self) -> Ordering;
    /// Returns the mean of two numbers.
    fn middle(self, other: Self) -> Self;
}

impl Float for f32 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }

    fn middle(self, other: Self) -> Self {
        0.5 * (self + other)
    }
}

impl Float for f64 {
    fn order(&self, other: &Self) -> Ordering {
        self.total_cmp(other)
    }

    fn middle(self, other: Self) -> Self {
        0.5 * (self + other)
    }
}

/// Returns the median, the mean of the two middle values of an even number; `None` without values.
///
/// Changes the order of the values.
pub fn median<T: Float>(values: &mut [T]) -> Option<T> {
    if values.is_empty() {
        return None;
    }
    let count = values.len();
    let (below, middle, _) = values.select_nth_unstable_by(count / 2, T::order);
    let middle = *middle;
    if count % 2 == 1 {
        return Some(middle);
    }
    below.iter().copied().max_by(T::order).map(|before| before.middle(middle))
}

/// Returns the value at a fraction, 0 to 1, of the sorted values; `None` without values.
///
/// Between two values, it is the nearer one, or the upper one of two equally near. Changes the order of the values.
pub fn quantile<T: Float>(values: &mut [T], fraction: f64) -> Option<T> {
    let last = values.len().checked_sub(1)?;
    let rank = ((last as f64 * fraction).round() as usize).min(last);
    Some(*values.select_nth_unstable_by(rank, T::order).1)
}

/// Returns the index of the first bin of a histogram that counts as bright; 1 if at most one bin is filled.
///
/// Maximises the variance between both sides (N. Otsu, IEEE Trans. Syst. Man Cybern. 9 (1979) 62,
/// <https://doi.org/10.1109/TSMC.1979.4310076>). Thresholds in an empty range between the sides are equivalent, so the
/// middle one is returned.
pub fn otsu(counts: &[u32]) -> usize {
    let total: f64 = counts.iter().map(|n| f64::from(*n)).sum();
    let moment: f64 = counts.iter().enumerate().map(|(level, n)| level as f64 * f64::from(*n)).sum();
    let (mut below, mut sum, mut highest) = (0.0, 0.0, -1.0);
    let (mut first, mut last) = (1, 1);
    for level in 1..counts.len() {
        below += f64::from(counts[level - 1]);
        sum += (level - 1) as f64 * f64::from(counts[level - 1]);
        if below <= 0.0 || below >= total {
            continue;
        }
        let between = (moment * below - sum * total).powi(2) / (below * (total - below));
        if between > highest {
            (highest, first, last) = (between, level, level);
        } else if between >= highest {
            last = level;
        }
    }
    usize::midpoint(first, last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_is_the_mean_of_the_middle_ones() {
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
        assert_eq!(median(&mut [4.0_f32, 1.0, 3.0]), Some(3.0));
        assert_eq!(median::<f64>(&mut []), None);
    }

    #[test]
    fn quantiles_are_values_of_the_sorted_list() {
        let values = [7.0, 1.0, 5.0, 3.0];
        for (fraction, expected) in [(0.0, 1.0), (0.33, 3.0), (0.5, 5.0), (1.0, 7.0)] {
            assert_eq!(quantile(&mut values.clone(), fraction), Some(expected));
        }
        assert_eq!(quantile::<f32>(&mut [], 0.5), None);
    }

    #[test]
    fn the_threshold_lies_in_the_middle_of_the_gap() {
        let mut counts = [0_u32; 256];
        (counts[20], counts[22], counts[200]) = (30, 40, 60);
        assert_eq!(otsu(&counts), usize::midpoint(23, 200));
        assert_eq!(otsu(&[5, 0, 0]), 1);
    }
}
