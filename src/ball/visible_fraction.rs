//! The visible fraction of a ball, from its rim.

/// The state of one bin of the rim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RimBin {
    /// The rim is visible.
    Visible,
    /// There is no rim: it is occluded or covered by a speckle.
    Missing,
    /// The bin lies outside the image, or has no contrast.
    Outside,
}

/// A circular run of bins.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Run {
    first: usize,
    length: usize,
}

/// The fraction of the bins behind an occluder that look like rim by chance.
const FALSE_RIM_RATE: f64 = 0.05;
/// The minimum log likelihood ratio of an occluder against a row of speckles, nats.
const MIN_EVIDENCE_NATS: f64 = 6.0;

/// Returns the fraction of the disc's area that a straight occluder leaves visible, 0 to 1.
///
/// The occluded arc is the most likely circular run of bins, given the rate of visible rim outside it and behind an
/// occluder. A chord cuts off the occluded area.
pub(super) fn unoccluded_fraction(bins: &[RimBin]) -> f64 {
    let mut occluded = Run::default();
    for _ in 0..4 {
        let visible = visible_rate_outside(bins, occluded);
        // A rim visible at the chance rate contains no information.
        let run = likeliest_run(bins, visible.clamp(2.0 * FALSE_RIM_RATE, 0.99));
        if run == occluded {
            break;
        }
        occluded = run;
    }
    let half_angle = std::f64::consts::PI * occluded.length as f64 / bins.len().max(1) as f64;
    1.0 - (half_angle - half_angle.sin() * half_angle.cos()) / std::f64::consts::PI
}

/// Returns the rate of visible rim outside a run of bins.
fn visible_rate_outside(bins: &[RimBin], run: Run) -> f64 {
    let outside = bins.iter().chain(bins).skip(run.first + run.length).take(bins.len().saturating_sub(run.length));
    let count = |bin: RimBin| outside.clone().filter(|s| **s == bin).count();
    let visible = count(RimBin::Visible);
    visible as f64 / (visible + count(RimBin::Missing)).max(1) as f64
}

/// Returns the run with the most evidence of an occluder; length 0 if there is too little.
///
/// `visible` is the rate of visible rim outside the occluder. The run is the maximum subarray of log likelihood
/// ratios (J. B. Kadane's algorithm).
fn likeliest_run(bins: &[RimBin], visible: f64) -> Run {
    let count = bins.len();
    let (rim, missing) = ((FALSE_RIM_RATE / visible).ln(), ((1.0 - FALSE_RIM_RATE) / (1.0 - visible)).ln());
    let gain = |bin: RimBin| match bin {
        RimBin::Visible => rim,
        RimBin::Missing => missing,
        RimBin::Outside => 0.0,
    };
    let (mut best, mut run) = (MIN_EVIDENCE_NATS, Run::default());
    let (mut sum, mut first) = (0.0, 0);
    // Twice around, so that a run across the first bin is not split.
    for (i, bin) in bins.iter().chain(bins).enumerate() {
        if sum <= 0.0 {
            (sum, first) = (0.0, i);
        }
        sum += gain(*bin);
        if sum > best && i + 1 - first <= count {
            (best, run) = (sum, Run { first: first % count, length: i + 1 - first });
        }
    }
    run
}

/// Returns the fraction of the disc (`x`, `y`, `radius`) inside an image of `width` x `height` pixels, 0 to 1.
pub(super) fn fraction_in_image(x: f64, y: f64, radius: f64, width: usize, height: usize) -> f64 {
    let (right, bottom) = (width as f64 - 0.5, height as f64 - 0.5);
    if x - radius >= -0.5 && x + radius <= right && y - radius >= -0.5 && y + radius <= bottom {
        return 1.0;
    }
    const STRIPS: usize = 400;
    let strip = 2.0 * radius / STRIPS as f64;
    let area: f64 = (0..STRIPS)
        .map(|i| {
            let dy = -radius + (i as f64 + 0.5) * strip;
            let half = (radius * radius - dy * dy).max(0.0).sqrt();
            let inside = (-0.5..=bottom).contains(&(y + dy));
            if inside { ((x + half).min(right) - (x - half).max(-0.5)).max(0.0) * strip } else { 0.0 }
        })
        .sum();
    (area / (std::f64::consts::PI * radius * radius)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_occluded_half_leaves_half_the_disc() {
        let mut bins = vec![RimBin::Visible; 140];
        bins[..35].fill(RimBin::Missing);
        bins[105..].fill(RimBin::Missing);
        assert!((unoccluded_fraction(&bins) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn scattered_speckle_occludes_next_to_nothing() {
        let bins: Vec<_> = (0..140).map(|i| if i % 5 < 2 { RimBin::Missing } else { RimBin::Visible }).collect();
        assert!(unoccluded_fraction(&bins) > 0.9999);
    }

    #[test]
    fn an_occluded_arc_is_found_among_speckle() {
        let mut bins: Vec<_> =
            (0..200).map(|i| if i * 7 % 5 < 3 { RimBin::Missing } else { RimBin::Visible }).collect();
        bins[20..80].fill(RimBin::Missing);
        bins[50] = RimBin::Visible;
        let half_angle = 60.0 / 200.0 * std::f64::consts::PI;
        let fraction = 1.0 - (half_angle - half_angle.sin() * half_angle.cos()) / std::f64::consts::PI;
        assert!((unoccluded_fraction(&bins) - fraction).abs() < 0.02);
    }

    #[test]
    fn a_disc_centred_on_the_border_is_half_in_the_image() {
        assert!((fraction_in_image(-0.5, 50.0, 20.0, 100, 100) - 0.5).abs() < 1e-3);
        assert!((fraction_in_image(50.0, 50.0, 20.0, 100, 100) - 1.0).abs() < 1e-12);
        assert!((fraction_in_image(-0.5, 99.5, 20.0, 100, 100) - 0.25).abs() < 1e-3);
    }
}
