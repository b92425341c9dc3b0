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

/// Rim seen within a hidden arc weighs this much more than rim missing outside it.
const PENALTY: f64 = 2.0;

/// Share of the disc's area in front of a straight occluder, 0 to 1.
///
/// The hidden arc is the circular run of bins with the most missing rim, each
/// bin of rim in it counted against it; a chord cuts off the area behind it.
pub(super) fn unhidden_share(sights: &[Sight]) -> f64 {
    let bins = sights.len();
    let gain = |sight: Sight| match sight {
        Sight::Rim => -PENALTY,
        Sight::Missing => 1.0,
        Sight::Outside => 0.0,
    };
    let (mut best, mut longest) = (0.0, 0);
    let (mut sum, mut length) = (0.0, 0);
    // Twice around, so that a run across the first bin is seen whole.
    for i in 0..2 * bins {
        if sum <= 0.0 {
            (sum, length) = (0.0, 0);
        }
        sum += gain(sights[i % bins]);
        length += 1;
        if sum > best && length <= bins {
            (best, longest) = (sum, length);
        }
    }
    let half_angle = std::f64::consts::PI * longest as f64 / bins.max(1) as f64;
    1.0 - (half_angle - half_angle.sin() * half_angle.cos()) / std::f64::consts::PI
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
        assert!(unhidden_share(&sights) > 0.998);
    }

    #[test]
    fn a_disc_centred_on_the_border_is_half_in_the_image() {
        assert!((share_in_image(-0.5, 50.0, 20.0, 100, 100) - 0.5).abs() < 1e-3);
        assert!((share_in_image(50.0, 50.0, 20.0, 100, 100) - 1.0).abs() < 1e-12);
        assert!((share_in_image(-0.5, 99.5, 20.0, 100, 100) - 0.25).abs() < 1e-3);
    }
}
