//! Numbers as text: with as many digits as their uncertainty supports.

use crate::results::Estimate;

/// Returns the decimals that show two digits of `sigma` (GUM, 7.2.6), or six digits of `value` without `sigma`.
fn decimals(value: f64, sigma: f64) -> usize {
    let decimal_exponent = |number: f64| number.abs().log10().floor();
    let decimals = if sigma.is_finite() && sigma > 0.0 {
        // 0.0998 is written 0.10 with two digits, so round before counting.
        let rounded = format!("{sigma:.1e}").parse::<f64>().unwrap_or(sigma);
        1.0 - decimal_exponent(rounded)
    } else if value.is_finite() && value.abs() > 0.0 {
        5.0 - decimal_exponent(value)
    } else {
        0.0
    };
    decimals.clamp(0.0, 12.0) as usize
}

/// Formats a number with a fixed number of decimals and a real minus sign; a zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().any(|b| matches!(b, b'1'..=b'9')) => format!("\u{2212}{digits}"),
        Some(digits) => digits.to_owned(),
        None => text,
    }
}

/// An estimate as text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EstimateText {
    /// The value.
    pub value: String,
    /// The standard uncertainty; empty when there is none.
    pub sigma: String,
    /// The decimals of both.
    pub decimals: usize,
}

/// A number of a collision on a page.
#[derive(Debug, Clone, Copy)]
pub struct ImpactQuantity {
    /// The column of the `impact` table.
    pub column: &'static str,
    /// The name on the page.
    pub label: &'static str,
    /// The unit on the page; empty for a plain number.
    pub unit: &'static str,
    /// The factor from the unit of the column to that of the page.
    pub factor: f64,
}

impl ImpactQuantity {
    /// Describes a column.
    pub const fn new(column: &'static str, label: &'static str, unit: &'static str, factor: f64) -> Self {
        Self { column, label, unit, factor }
    }
}

/// Formats `factor` times an estimate to two digits of its uncertainty, or to six digits without one.
pub fn format_estimate(estimate: Estimate, factor: f64) -> EstimateText {
    let (value, sigma) = (estimate.value * factor, estimate.sigma * factor);
    let decimals = decimals(value, sigma);
    let sigma = if sigma.is_finite() && sigma > 0.0 { fixed(sigma, decimals) } else { String::new() };
    EstimateText { value: fixed(value, decimals), sigma, decimals }
}

/// Formats a number to three significant digits, at most nine decimals, and all digits before the decimal point.
///
/// Numbers below 1e-12 are written as 0.
pub fn three_digits(value: f64) -> String {
    if value.abs() < 1e-12 {
        return "0".into();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    fixed(value, decimals)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(value: f64, sigma: f64) -> [String; 2] {
        let text = format_estimate(Estimate { value, sigma }, 1.0);
        [text.value, text.sigma]
    }

    #[test]
    fn a_number_is_written_to_two_digits_of_its_uncertainty() {
        assert_eq!(texts(-1.690_349, 0.000_472), ["\u{2212}1.69035", "0.00047"]);
        assert_eq!(texts(1040.326, 0.287), ["1040.33", "0.29"]);
        assert_eq!(texts(0.797_775, 0.099_8), ["0.80", "0.10"]);
        assert_eq!(texts(12_345.6, 234.0), ["12346", "234"]);
        assert_eq!(texts(-0.001, 0.5), ["0.00", "0.50"]);
        assert_eq!(texts(1.25, 0.0), ["1.25000", ""]);
    }
}
