//! Significance of a circle: an a-contrario test against random edges.

/// The distances within which edges are counted, px; the distance with the strongest evidence decides.
const DISTANCES_PX: [f32; 4] = [0.10, 0.15, 0.20, 0.25];

/// Computes the evidence that `trials` edges lie on a circle and not anywhere, nats.
///
/// `near` counts the edges within a distance, px. A random edge within `reach_px` of the circle is as near as `x` with
/// probability `x / reach_px`. At least `k` of `n` random edges are that near with a probability below `exp(-n D)`,
/// where `D` is the divergence of `k / n` from that probability (H. Chernoff, Ann. Math. Stat. 23 (1952) 493,
/// <https://doi.org/10.1214/aoms/1177729330>).
pub(super) fn evidence(trials: usize, reach_px: f32, near: impl Fn(f32) -> usize) -> f64 {
    let nats = |within_px: f32| {
        let chance = f64::from(within_px / reach_px);
        let fraction = near(within_px) as f64 / trials.max(1) as f64;
        if fraction > chance { trials as f64 * divergence(fraction, chance) } else { 0.0 }
    };
    DISTANCES_PX.into_iter().map(nats).fold(0.0, f64::max)
}

/// Returns the Kullback-Leibler divergence of two Bernoulli distributions, nats.
fn divergence(fraction: f64, chance: f64) -> f64 {
    let term = |a: f64, b: f64| if a > 0.0 { a * (a / b).ln() } else { 0.0 };
    term(fraction, chance) + term(1.0 - fraction, 1.0 - chance)
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
        let nats = evidence(20, 2.5, |_| 20);
        assert!((nats - 20.0 * 25.0_f64.ln()).abs() < 1e-4, "{nats}");
    }

    #[test]
    fn edges_that_do_not_agree_reduce_the_evidence() {
        let near = |within_px: f32| if within_px < 0.24 { 0 } else { 18 };
        let nats: Vec<f64> = [18, 24, 40].into_iter().map(|trials| evidence(trials, 2.5, near)).collect();
        assert!(nats[0] > nats[1] + 8.0 && nats[1] > nats[2] + 8.0, "{nats:?}");
    }
}
