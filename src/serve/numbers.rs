//! The numbers of a collision as the page shows them.

use crate::plot::format_estimate;
use crate::results::{Estimate, Impact, PointStatus};
use serde_json::{Value, json};

/// A number of the `impact` table on the page.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quantity {
    /// The column.
    pub(super) column: &'static str,
    /// The name on the page.
    pub(super) label: &'static str,
    /// The unit on the page; empty for a plain number.
    pub(super) unit: &'static str,
    /// The factor from the unit of the column to that of the page.
    pub(super) factor: f64,
}

/// Returns one entry of [`QUANTITIES`].
const fn quantity(column: &'static str, label: &'static str, unit: &'static str, factor: f64) -> Quantity {
    Quantity { column, label, unit, factor }
}

/// The numbers that decide whether a drop is repeated.
pub(super) const QUANTITIES: [Quantity; 8] = [
    quantity("restitution", "Restitution", "", 1.0),
    quantity("contact_time_s", "Contact time", "ms", 1e3),
    quantity("vn_before_m_s", "Normal speed in", "m/s", 1.0),
    quantity("vn_after_m_s", "Normal speed out", "m/s", 1.0),
    quantity("vt_before_m_s", "Tangential speed in", "m/s", 1.0),
    quantity("vt_after_m_s", "Tangential speed out", "m/s", 1.0),
    quantity("omega_before_rad_s", "Spin in", "rad/s", 1.0),
    quantity("omega_after_rad_s", "Spin out", "rad/s", 1.0),
];

/// Returns a number as JSON, with its texts as the page shows them; `text` is null when it was not measured.
pub(super) fn quantity_json(quantity: &Quantity, estimate: Option<Estimate>) -> Value {
    let text = estimate.map(|estimate| format_estimate(estimate, quantity.factor));
    json!({
        "column": quantity.column, "label": quantity.label, "unit": quantity.unit,
        "value": estimate.map(|estimate| estimate.value), "sigma": estimate.map(|estimate| estimate.sigma),
        "text": text.as_ref().map(|text| text.value.as_str()),
        "sigma_text": text.as_ref().map(|text| text.sigma.as_str()),
    })
}

/// Returns all [`QUANTITIES`] of a collision as JSON.
pub(super) fn impact_json(impact: &Impact) -> Vec<Value> {
    QUANTITIES.iter().map(|quantity| quantity_json(quantity, impact.get(quantity.column))).collect()
}

/// Returns the reason behind a status in words for the person at the rig; `None` for a valid one.
pub(super) fn status_reason(status: PointStatus) -> Option<&'static str> {
    match status {
        PointStatus::Valid => None,
        PointStatus::LowContrast => Some("the surface of the body has too little contrast"),
        PointStatus::LowCorrelation => Some("the body does not look the same from frame to frame"),
        PointStatus::Ambiguous => Some("several motions explain the frames equally well"),
        PointStatus::Outlier => Some("the measurements contradict each other"),
        PointStatus::Occluded => Some("something covers the body"),
        PointStatus::OutOfFrame => Some("the body leaves the image"),
        PointStatus::Lost => Some("the body was not found"),
        PointStatus::Predicted => Some("the body was not found; its position is predicted"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quantity_is_a_column_and_a_missing_one_has_no_text() {
        let mut impact = Impact::unknown(0, 0, 0);
        impact.contact_time_s = Some(Estimate { value: 0.001_234, sigma: 0.000_012 });
        let known = impact.numbers().map(|(name, _)| name);
        assert!(QUANTITIES.iter().all(|quantity| known.contains(&quantity.column)));
        let numbers = impact_json(&impact);
        assert_eq!((&numbers[1]["text"], &numbers[1]["sigma_text"]), (&json!("1.234"), &json!("0.012")));
        assert_eq!((&numbers[0]["text"], &numbers[0]["value"]), (&Value::Null, &Value::Null));
    }
}
