//! The numbers of a collision on the page.

use crate::plot::ImpactQuantity;

/// Every number of a collision, grouped as the page shows them.
pub(super) const GROUPS: [(&str, &[ImpactQuantity]); 4] = [
    (
        "Normal",
        &[
            ImpactQuantity::new("vn_before_m_s", "velocity before", "m/s", 1.0),
            ImpactQuantity::new("vn_after_m_s", "velocity after", "m/s", 1.0),
            ImpactQuantity::new("restitution", "restitution", "", 1.0),
        ],
    ),
    (
        "Tangential",
        &[
            ImpactQuantity::new("vt_before_m_s", "velocity before", "m/s", 1.0),
            ImpactQuantity::new("vt_after_m_s", "velocity after", "m/s", 1.0),
            ImpactQuantity::new("restitution_tangential", "restitution", "", 1.0),
            ImpactQuantity::new("impulse_ratio", "impulse ratio", "", 1.0),
        ],
    ),
    (
        "Spin",
        &[
            ImpactQuantity::new("omega_before_rad_s", "before", "rad/s", 1.0),
            ImpactQuantity::new("omega_after_rad_s", "after", "rad/s", 1.0),
        ],
    ),
    (
        "Contact",
        &[
            ImpactQuantity::new("start_s", "start", "ms", 1e3),
            ImpactQuantity::new("deepest_s", "deepest", "ms", 1e3),
            ImpactQuantity::new("end_s", "end", "ms", 1e3),
            ImpactQuantity::new("contact_time_s", "duration", "ms", 1e3),
            ImpactQuantity::new("slip_end_s", "slip ends", "ms", 1e3),
            ImpactQuantity::new("force_start_s", "force above 2 % from", "ms", 1e3),
            ImpactQuantity::new("force_end_s", "force above 2 % until", "ms", 1e3),
            ImpactQuantity::new("compression_max_mm", "maximum compression", "mm", 1.0),
            ImpactQuantity::new("acceleration_max_m_s2", "maximum acceleration", "m/s²", 1.0),
            ImpactQuantity::new("force_max_n", "maximum force", "N", 1.0),
            ImpactQuantity::new("energy_lost_j", "energy loss", "J", 1.0),
            ImpactQuantity::new("gravity_m_s2", "gravity in flight", "m/s²", 1.0),
            ImpactQuantity::new("growth_before_per_s", "apparent growth before", "%/s", 1e2),
            ImpactQuantity::new("growth_after_per_s", "apparent growth after", "%/s", 1e2),
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
