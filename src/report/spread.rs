//! The variation of a number from shot to shot.

use crate::numeric::median;
use crate::results::Estimate;

/// Modified z-score beyond which a value is an outlier: Iglewicz and Hoaglin, How to Detect and Handle Outliers,
/// ASQC 1993, section 3.4.
const OUTLIER_SCORE: f64 = 3.5;
/// Factor from the median absolute deviation to the standard deviation of normal errors.
const MAD_TO_SIGMA: f64 = 1.482_602_218_505_602;
/// Minimum number of values with outliers. Among three, one value cannot be distinguished from the other two.
const MIN_VALUES: usize = 4;

/// The mean and the spread of a number.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Whether each of the values is an outlier.
    pub outliers: Vec<bool>,
    /// The number of values that are none.
    pub kept: usize,
    /// Mean of the kept values.
    pub mean: f64,
    /// Sample standard deviation of the kept values; `None` for a single value.
    pub sd: Option<f64>,
    /// Root mean square of the stated uncertainties of the kept values.
    pub stated: f64,
}

impl Spread {
    /// Computes the spread of values; `None` without any.
    pub fn from_estimates(values: &[Estimate]) -> Option<Self> {
        let outliers = outliers(values);
        let kept: Vec<&Estimate> =
            values.iter().zip(&outliers).filter(|(_, out)| !**out).map(|(value, _)| value).collect();
        if kept.is_empty() {
            return None;
        }
        let n = kept.len() as f64;
        let mean = kept.iter().map(|e| e.value).sum::<f64>() / n;
        let squares = kept.iter().map(|e| (e.value - mean).powi(2)).sum::<f64>();
        let sd = (kept.len() > 1).then(|| (squares / (n - 1.0)).sqrt());
        let stated = (kept.iter().map(|e| e.sigma.powi(2)).sum::<f64>() / n).sqrt();
        Some(Self { kept: kept.len(), mean, sd, stated, outliers })
    }
}

/// Returns whether each value is further from the median than 3.5 robust standard deviations; none of fewer than four
/// is.
///
/// The standard deviation is at least the median stated uncertainty and at least the value's own. Values that agree
/// better than stated, and a value that states a large uncertainty, are therefore no outliers.
fn outliers(values: &[Estimate]) -> Vec<bool> {
    if values.len() < MIN_VALUES {
        return vec![false; values.len()];
    }
    let middle = |of: &dyn Fn(&Estimate) -> f64| median(&mut values.iter().map(of).collect::<Vec<_>>()).unwrap_or(0.0);
    let center = middle(&|e| e.value);
    let spread = MAD_TO_SIGMA * middle(&|e| (e.value - center).abs());
    let stated = middle(&|e| e.sigma);
    values.iter().map(|e| (e.value - center).abs() > OUTLIER_SCORE * spread.max(stated).max(e.sigma)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(values: &[f64], sigma: f64) -> Vec<Estimate> {
        values.iter().map(|value| Estimate { value: *value, sigma }).collect()
    }

    #[test]
    fn one_wild_value_of_six_is_left_out_of_mean_and_sd() {
        let spread = Spread::from_estimates(&values(&[1.0, 1.2, 0.8, 1.1, 0.9, 5.0], 0.01)).unwrap();
        assert_eq!(spread.outliers, [false, false, false, false, false, true]);
        assert_eq!(spread.kept, 5);
        assert!((spread.mean - 1.0).abs() < 1e-12 && (spread.sd.unwrap() - 0.025_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn values_that_agree_within_their_uncertainty_have_no_outlier() {
        let spread = Spread::from_estimates(&values(&[1.0, 1.0, 1.0, 1.0, 1.03], 0.01)).unwrap();
        assert_eq!((spread.kept, spread.outliers.contains(&true)), (5, false));
        let spread = Spread::from_estimates(&values(&[1.0, 1.0, 1.0, 1.0, 1.04], 0.01)).unwrap();
        assert_eq!(spread.kept, 4);
    }

    #[test]
    fn a_value_that_states_a_large_uncertainty_is_no_outlier_within_it() {
        let mut shots = values(&[1.0, 1.0, 1.0, 1.0, 2.0], 0.01);
        assert_eq!(Spread::from_estimates(&shots).unwrap().kept, 4);
        shots[4].sigma = 0.5;
        assert_eq!(Spread::from_estimates(&shots).unwrap().kept, 5);
    }

    #[test]
    fn of_three_values_none_is_an_outlier_and_one_has_no_sd() {
        assert_eq!(Spread::from_estimates(&values(&[1.0, 1.0, 100.0], 0.01)).unwrap().kept, 3);
        assert_eq!(Spread::from_estimates(&values(&[2.0], 0.1)).unwrap().sd, None);
        assert_eq!(Spread::from_estimates(&[]), None);
    }
}
