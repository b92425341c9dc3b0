//! The numbers of a collision as the page shows them.

use crate::plot::{ImpactQuantity, format_estimate};
use crate::results::{Estimate, Impact, PointStatus};
use serde_json::{Value, json};

/// The numbers that decide whether a drop is repeated.
pub(super) const QUANTITIES: [ImpactQuantity; 8] = [
    ImpactQuantity::new("restitution", "Restitution", "", 1.0),
    ImpactQuantity::new("contact_time_s", "Contact time", "ms", 1e3),
    ImpactQuantity::new("vn_before_m_s", "Normal speed in", "m/s", 1.0),
    ImpactQuantity::new("vn_after_m_s", "Normal speed out", "m/s", 1.0),
    ImpactQuantity::new("vt_before_m_s", "Tangential speed in", "m/s", 1.0),
    ImpactQuantity::new("vt_after_m_s", "Tangential speed out", "m/s", 1.0),
    ImpactQuantity::new("omega_before_rad_s", "Spin in", "rad/s", 1.0),
    ImpactQuantity::new("omega_after_rad_s", "Spin out", "rad/s", 1.0),
];

/// Returns a number as JSON, with its texts as the page shows them; `text` is null when it was not measured.
pub(super) fn quantity_json(quantity: &ImpactQuantity, estimate: Option<Estimate>) -> Value {
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
