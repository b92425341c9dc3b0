//! How numbers are written: to the digits their uncertainty leaves them.

use crate::results::Estimate;

/// One column of the `impact` table as people read it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quantity {
    /// Its column.
    pub(super) column: &'static str,
    /// Its name.
    pub(super) label: &'static str,
    /// Its unit on the page; empty for a plain number.
    pub(super) unit: &'static str,
    /// From the column's unit to the page's.
    pub(super) factor: f64,
}

const fn quantity(column: &'static str, label: &'static str, unit: &'static str, factor: f64) -> Quantity {
    Quantity { column, label, unit, factor }
}

/// Every number of a collision, grouped as the page shows them.
pub(super) const GROUPS: [(&str, &[Quantity]); 4] = [
    (
        "Normal",
        &[
            quantity("vn_before_m_s", "velocity before", "m/s", 1.0),
            quantity("vn_after_m_s", "velocity after", "m/s", 1.0),
            quantity("restitution", "restitution", "", 1.0),
        ],
    ),
    (
        "Tangential",
        &[
            quantity("vt_before_m_s", "velocity before", "m/s", 1.0),
            quantity("vt_after_m_s", "velocity after", "m/s", 1.0),
            quantity("restitution_tangential", "restitution", "", 1.0),
            quantity("impulse_ratio", "impulse ratio", "", 1.0),
        ],
    ),
    (
        "Spin",
        &[quantity("omega_before_rad_s", "before", "rad/s", 1.0), quantity("omega_after_rad_s", "after", "rad/s", 1.0)],
    ),
    (
        "Contact",
        &[
            quantity("start_s", "starts", "ms", 1e3),
            quantity("deepest_s", "deepest", "ms", 1e3),
            quantity("end_s", "ends", "ms", 1e3),
            quantity("contact_time_s", "lasts", "ms", 1e3),
            quantity("slip_end_s", "slipping stops", "ms", 1e3),
            quantity("force_start_s", "force above 2 % from", "ms", 1e3),
            quantity("force_end_s", "force above 2 % until", "ms", 1e3),
            quantity("compression_max_mm", "compressed by", "mm", 1.0),
            quantity("acceleration_max_m_s2", "highest acceleration", "m/s²", 1.0),
            quantity("force_max_n", "highest force", "N", 1.0),
            quantity("energy_lost_j", "energy lost", "J", 1.0),
            quantity("gravity_m_s2", "gravity in flight", "m/s²", 1.0),
            quantity("growth_before_per_s", "growth in the picture before", "%/s", 1e2),
            quantity("growth_after_per_s", "growth in the picture after", "%/s", 1e2),
        ],
    ),
];

/// Decimals that show two digits of `sigma` (GUM, 7.2.6: two suffice); six significant ones of `value` without it.
fn decimals(value: f64, sigma: f64) -> usize {
    let leading = |number: f64| number.abs().log10().floor();
    let decimals = if sigma.is_finite() && sigma > 0.0 {
        // 0.0998 is written 0.10 with two digits, so round before counting.
        let rounded = format!("{sigma:.1e}").parse::<f64>().unwrap_or(sigma);
        1.0 - leading(rounded)
    } else if value.is_finite() && value.abs() > 0.0 {
        5.0 - leading(value)
    } else {
        0.0
    };
    decimals.clamp(0.0, 12.0) as usize
}

/// A number with this many decimals and a real minus sign; no minus before a zero.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().any(|b| matches!(b, b'1'..=b'9')) => format!("\u{2212}{digits}"),
        Some(digits) => digits.to_owned(),
        None => text,
    }
}

/// An estimate on the page: the number and its uncertainty to the same decimals.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Written {
    /// The number.
    pub(super) value: String,
    /// Its standard uncertainty; empty when it has none.
    pub(super) sigma: String,
    /// Decimals of both.
    pub(super) decimals: usize,
}

/// Writes a number as its uncertainty allows, in the unit that `factor` leads to.
pub(super) fn write(estimate: Estimate, factor: f64) -> Written {
    let (value, sigma) = (estimate.value * factor, estimate.sigma * factor);
    let decimals = decimals(value, sigma);
    let sigma = if sigma.is_finite() && sigma > 0.0 { fixed(sigma, decimals) } else { String::new() };
    Written { value: fixed(value, decimals), sigma, decimals }
}

/// A number to three significant digits.
pub(super) fn short(value: f64) -> String {
    if value.abs() < 1e-12 {
        return "0".into();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    fixed(value, decimals)
}

/// Text as HTML shows it.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Impact;

    fn told(value: f64, sigma: f64) -> [String; 2] {
        let written = write(Estimate { value, sigma }, 1.0);
        [written.value, written.sigma]
    }

    #[test]
    fn a_number_is_written_to_two_digits_of_its_uncertainty() {
        assert_eq!(told(-1.690_349, 0.000_472), ["\u{2212}1.69035", "0.00047"]);
        assert_eq!(told(1040.326, 0.287), ["1040.33", "0.29"]);
        assert_eq!(told(0.797_775, 0.099_8), ["0.80", "0.10"]);
        assert_eq!(told(12_345.6, 234.0), ["12346", "234"]);
        assert_eq!(told(-0.001, 0.5), ["0.00", "0.50"]);
        assert_eq!(told(1.25, 0.0), ["1.25000", ""]);
    }

    #[test]
    fn every_number_of_a_collision_is_on_the_page_once() {
        let mut columns: Vec<_> = GROUPS.iter().flat_map(|(_, group)| group.iter().map(|q| q.column)).collect();
        let mut expected = Impact::unknown(0, 0, 0).numbers().map(|(name, _)| name).to_vec();
        columns.sort_unstable();
        expected.sort_unstable();
        assert_eq!(columns, expected);
    }
}
