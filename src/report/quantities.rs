//! The numbers of a collision on the page.

/// One column of the `impact` table as the page shows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quantity {
    /// The column.
    pub(super) column: &'static str,
    /// The name on the page.
    pub(super) label: &'static str,
    /// The unit on the page; empty for a plain number.
    pub(super) unit: &'static str,
    /// The factor from the column's unit to the page's.
    pub(super) factor: f64,
}

/// Returns a quantity, so that the table below has one line for each.
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
            quantity("start_s", "start", "ms", 1e3),
            quantity("deepest_s", "deepest", "ms", 1e3),
            quantity("end_s", "end", "ms", 1e3),
            quantity("contact_time_s", "duration", "ms", 1e3),
            quantity("slip_end_s", "slip ends", "ms", 1e3),
            quantity("force_start_s", "force above 2 % from", "ms", 1e3),
            quantity("force_end_s", "force above 2 % until", "ms", 1e3),
            quantity("compression_max_mm", "maximum compression", "mm", 1.0),
            quantity("acceleration_max_m_s2", "maximum acceleration", "m/s²", 1.0),
            quantity("force_max_n", "maximum force", "N", 1.0),
            quantity("energy_lost_j", "energy loss", "J", 1.0),
            quantity("gravity_m_s2", "gravity in flight", "m/s²", 1.0),
            quantity("growth_before_per_s", "apparent growth before", "%/s", 1e2),
            quantity("growth_after_per_s", "apparent growth after", "%/s", 1e2),
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Impact;

    #[test]
    fn every_number_of_a_collision_is_on_the_page_once() {
        let mut columns: Vec<_> = GROUPS.iter().flat_map(|(_, group)| group.iter().map(|q| q.column)).collect();
        let mut expected = Impact::unknown(0, 0, 0).numbers().map(|(name, _)| name).to_vec();
        columns.sort_unstable();
        expected.sort_unstable();
        assert_eq!(columns, expected);
    }
}
