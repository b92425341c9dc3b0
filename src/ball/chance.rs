//! How unlikely a circle is by chance.

/// Edges lie as near to a circle as this where it is no ball's by chance alone, px: what tells most counts.
const NEAR_PX: [f32; 4] = [0.10, 0.15, 0.20, 0.25];

/// How much more of `trials` edges lie near a circle than would anywhere, nats; `near` counts those within so many px.
///
/// An edge anywhere within `reach_px` of the circle is as near as `x` with probability `x / reach_px`; that at least `k` of
/// `n` are has a probability below `exp(-n D)`, `D` being the divergence of `k / n` from it (H. Chernoff, Ann. Math. Stat.
/// 23 (1952) 493, <https://doi.org/10.1214/aoms/1177729330>).
pub(super) fn evidence(trials: usize, reach_px: f32, near: impl Fn(f32) -> usize) -> f64 {
    let told = |within_px: f32| {
        let chance = f64::from(within_px / reach_px);
        let share = near(within_px) as f64 / trials.max(1) as f64;
        if share > chance { trials as f64 * divergence(share, chance) } else { 0.0 }
    };
    NEAR_PX.into_iter().map(told).fold(0.0, f64::max)
}

/// Of a coin that shows heads with one probability from one that does with another, nats.
fn divergence(share: f64, chance: f64) -> f64 {
    let part = |a: f64, b: f64| if a > 0.0 { a * (a / b).ln() } else { 0.0 };
    part(share, chance) + part(1.0 - share, 1.0 - chance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_that_lie_anywhere_are_no_evidence() {
        assert!(evidence(100, 2.5, |within_px| (40.0 * within_px) as usize) < 1e-9);
        assert!(evidence(0, 2.5, |_| 0) < 1e-9);
    }

    #[test]
    fn edges_that_all_agree_are_as_unlikely_as_each_of_them_to_their_number() {
        let told = evidence(20, 2.5, |_| 20);
        assert!((told - 20.0 * 25.0_f64.ln()).abs() < 1e-4, "{told}");
    }

    #[test]
    fn edges_that_do_not_agree_speak_against_it() {
        let near = |within_px: f32| if within_px < 0.24 { 0 } else { 18 };
        let told: Vec<f64> = [18, 24, 40].into_iter().map(|trials| evidence(trials, 2.5, near)).collect();
        assert!(told[0] > told[1] + 8.0 && told[1] > told[2] + 8.0, "{told:?}");
    }
}
