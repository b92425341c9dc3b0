//! How much of a ball is in sight, from its rim.

/// What one bin of the rim tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sight {
    /// The rim is there.
    Rim,
    /// No rim is there: something hides it, or a speckle swallows it.
    Missing,
    /// Outside the image.
    Outside,
}

/// Share of the bins behind an occluder that look like rim by chance.
const CHANCE_RIM: f64 = 0.05;
/// A run less likely than this is an occluder, not a row of speckles; natural logarithm.
const LEAST_EVIDENCE: f64 = 6.0;

/// Share of the disc's area in front of a straight occluder, 0 to 1.
///
/// The hidden arc is the circular run of bins that is most likely to be one,
/// given how often the rim is seen outside it and how rarely behind something;
/// a chord cuts off the area behind it.
pub(super) fn unhidden_share(sights: &[Sight]) -> f64 {
    let mut hidden = (0, 0);
    for _ in 0..4 {
        let seen = seen_outside(sights, hidden);
        // A rim seen as rarely as chance allows tells nothing.
        let run = likeliest_run(sights, seen.clamp(2.0 * CHANCE_RIM, 0.99));
        if run == hidden {
            break;
        }
        hidden = run;
    }
    let half_angle = std::f64::consts::PI * hidden.1 as f64 / sights.len().max(1) as f64;
    1.0 - (half_angle - half_angle.sin() * half_angle.cos()) / std::f64::consts::PI
}

/// How often the rim is seen outside a run of (first, length) bins.
fn seen_outside(sights: &[Sight], (first, length): (usize, usize)) -> f64 {
    let outside = sights.iter().chain(sights).skip(first + length).take(sights.len().saturating_sub(length));
    let count = |sight: Sight| outside.clone().filter(|s| **s == sight).count();
    let seen = count(Sight::Rim);
    seen as f64 / (seen + count(Sight::Missing)).max(1) as f64
}

/// The run, as (first, length), with the most evidence of an occluder; length 0 when there is too little.
fn likeliest_run(sights: &[Sight], seen: f64) -> (usize, usize) {
    let bins = sights.len();
    let (rim, missing) = ((CHANCE_RIM / seen).ln(), ((1.0 - CHANCE_RIM) / (1.0 - seen)).ln());
    let gain = |sight: Sight| match sight {
        Sight::Rim => rim,
        Sight::Missing => missing,
        Sight::Outside => 0.0,
    };
    let (mut best, mut run) = (LEAST_EVIDENCE, (0, 0));
    let (mut sum, mut first) = (0.0, 0);
    // Twice around, so that a run across the first bin is seen whole.
    for (i, sight) in sights.iter().chain(sights).enumerate() {
        if sum <= 0.0 {
            (sum, first) = (0.0, i);
        }
        sum += gain(*sight);
        if sum > best && i + 1 - first <= bins {
            (best, run) = (sum, (first % bins, i + 1 - first));
        }
    }
    run
}

/// Share of the disc (`x`, `y`, `radius`) inside an image of `width` x `height` pixels, 0 to 1.
pub(super) fn share_in_image(x: f64, y: f64, radius: f64, width: usize, height: usize) -> f64 {
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
    fn a_hidden_half_leaves_half_the_disc() {
        let mut sights = vec![Sight::Rim; 140];
        sights[..35].fill(Sight::Missing);
        sights[105..].fill(Sight::Missing);
        assert!((unhidden_share(&sights) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn scattered_speckle_hides_next_to_nothing() {
        let sights: Vec<_> = (0..140).map(|i| if i % 5 < 2 { Sight::Missing } else { Sight::Rim }).collect();
        assert!(unhidden_share(&sights) > 0.9999);
    }

    #[test]
    fn a_hidden_arc_is_found_among_speckle() {
        let mut sights: Vec<_> = (0..200).map(|i| if i * 7 % 5 < 3 { Sight::Missing } else { Sight::Rim }).collect();
        sights[20..80].fill(Sight::Missing);
        sights[50] = Sight::Rim;
        let half_angle = 60.0 / 200.0 * std::f64::consts::PI;
        let share = 1.0 - (half_angle - half_angle.sin() * half_angle.cos()) / std::f64::consts::PI;
        assert!((unhidden_share(&sights) - share).abs() < 0.02);
    }

    #[test]
    fn a_disc_centred_on_the_border_is_half_in_the_image() {
        assert!((share_in_image(-0.5, 50.0, 20.0, 100, 100) - 0.5).abs() < 1e-3);
        assert!((share_in_image(50.0, 50.0, 20.0, 100, 100) - 1.0).abs() < 1e-12);
        assert!((share_in_image(-0.5, 99.5, 20.0, 100, 100) - 0.25).abs() < 1e-3);
    }
}
