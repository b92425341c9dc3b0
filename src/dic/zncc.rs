//! Statistical correlation by definition.

use crate::image::ImageView;

/// Returns the zero-mean normalised cross-correlation (ZNCC) of two subsets.
///
/// It measures the similarity of two patches independent of brightness and contrast:
///
/// ```text
/// C = sum (f - mean f)(g - mean g) / sqrt( sum (f - mean f)^2  sum (g - mean g)^2 )
/// ```
///
/// The coefficient is dimensionless, -1 to 1. `None` if either subset has no contrast.
///
/// # Panics
///
/// If the subsets differ in shape: shapes are fixed when a correlator is planned.
///
/// # Cost
///
/// Two passes over the pixels, no allocation. The fast correlators are tested against it.
///
/// # Examples
///
/// ```
/// use ricochet::{dic::zncc, image::ImageView};
///
/// let reference = ImageView::new(&[10.0, 20.0, 30.0, 40.0], 2, 2)?;
/// let brighter = ImageView::new(&[25.0, 45.0, 65.0, 85.0], 2, 2)?; // twice as bright, plus 5
/// let flat = ImageView::new(&[7.0, 7.0, 7.0, 7.0], 2, 2)?;
///
/// assert!((zncc(reference, brighter).unwrap() - 1.0).abs() < 1e-12);
/// assert_eq!(zncc(reference, flat), None);
/// # Ok::<(), ricochet::image::ShapeError>(())
/// ```
///
/// # References
///
/// B. Pan et al., Meas. Sci. Technol. 20 (2009) 062001, <https://doi.org/10.1088/0957-0233/20/6/062001>.
pub fn zncc(reference: ImageView<'_>, target: ImageView<'_>) -> Option<f64> {
    assert_eq!(
        (reference.width(), reference.height()),
        (target.width(), target.height()),
        "subsets of one correlation have one shape"
    );
    let mean = |image: ImageView<'_>| {
        image.data().iter().map(|level| f64::from(*level)).sum::<f64>() / image.data().len() as f64
    };
    let (mean_f, mean_g) = (mean(reference), mean(target));
    let (mut product, mut energy_f, mut energy_g) = (0.0, 0.0, 0.0);
    for (f, g) in reference.data().iter().zip(target.data()) {
        let (f, g) = (f64::from(*f) - mean_f, f64::from(*g) - mean_g);
        product += f * g;
        energy_f += f * f;
        energy_g += g * g;
    }
    (energy_f > 0.0 && energy_g > 0.0).then(|| product / (energy_f * energy_g).sqrt())
}
