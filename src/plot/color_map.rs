//! A colour map of one quantity of the field over the reference, with a colour bar.

use image::{Rgb, RgbImage};

use super::arrows::grey_picture;
use super::pixel_font;
use crate::image::ImageView;
use crate::results::FieldPoint;

/// The quantity of a colour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Displacement along x, px.
    U,
    /// Displacement along y, px.
    V,
    /// Zero-mean normalised cross-correlation coefficient, -1 to 1.
    Zncc,
    /// Standard uncertainty of the displacement, px: root mean square over x and y.
    Sigma,
}

impl Quantity {
    /// Names on the command line.
    pub const WORDS: [(&str, Self); 4] = [("u", Self::U), ("v", Self::V), ("zncc", Self::Zncc), ("sigma", Self::Sigma)];

    /// Returns the name, and the unit after a blank; empty for a quantity without a unit.
    fn name_and_unit(self) -> (&'static str, &'static str) {
        match self {
            Self::U => ("u", " px"),
            Self::V => ("v", " px"),
            Self::Zncc => ("zncc", ""),
            Self::Sigma => ("sigma", " px"),
        }
    }

    /// Returns the value at a point; `None` where the displacement is not valid or the coefficient is missing.
    fn value_at(self, point: &FieldPoint) -> Option<f32> {
        let found = point.displacement?;
        match self {
            Self::U => Some(found.u_px),
            Self::V => Some(found.v_px),
            Self::Zncc => point.zncc,
            Self::Sigma => Some((0.5 * (found.sigma_u_px.powi(2) + found.sigma_v_px.powi(2))).sqrt()),
        }
    }
}

/// Viridis at ten equal steps (S. van der Walt, N. Smith, <https://bids.github.io/colormap/>), a perceptually uniform
/// map.
const VIRIDIS: [[u8; 3]; 10] = [
    [68, 1, 84],
    [72, 40, 120],
    [62, 73, 137],
    [49, 104, 142],
    [38, 130, 142],
    [31, 158, 137],
    [53, 183, 121],
    [110, 206, 88],
    [181, 222, 43],
    [253, 231, 37],
];

/// Height of the colour bar, px.
const BAR_PX: u32 = 8;

/// Margin around the colour bar and its labels, px.
const MARGIN_PX: u32 = 3;

/// The range of values in a map.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ValueRange {
    low: f32,
    high: f32,
}

impl ValueRange {
    /// Returns the range of all valid points; `None` if there are none.
    fn from_field(field: &[FieldPoint], quantity: Quantity) -> Option<Self> {
        let values = field.iter().filter_map(|point| quantity.value_at(point));
        values.fold(None, |range, value| {
            let Self { low, high } = range.unwrap_or(Self { low: value, high: value });
            Some(Self { low: low.min(value), high: high.max(value) })
        })
    }

    /// Returns the position of a value in the range, 0 to 1; 0.5 for an empty range.
    fn fraction(self, value: f32) -> f32 {
        let span = self.high - self.low;
        if span > 0.0 { ((value - self.low) / span).clamp(0.0, 1.0) } else { 0.5 }
    }

    /// Formats both ends with enough decimals to resolve a hundredth of the range, at most 8; an empty range has 4.
    fn end_labels(self) -> [String; 2] {
        let span = f64::from(self.high - self.low);
        let decimals = if span > 0.0 { (2.0 - span.log10().floor()).clamp(0.0, 8.0) as usize } else { 4 };
        [self.low, self.high].map(|end| format!("{end:.decimals$}"))
    }
}

/// Returns the colour of the map at a position, 0 to 1, interpolated linearly.
fn viridis(fraction: f32) -> Rgb<u8> {
    let place = fraction.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f32;
    let first = (place as usize).min(VIRIDIS.len() - 2);
    let along = place - first as f32;
    let mix = |k: usize| {
        let (a, b) = (f32::from(VIRIDIS[first][k]), f32::from(VIRIDIS[first + 1][k]));
        (a + along * (b - a)).round() as u8
    };
    Rgb([mix(0), mix(1), mix(2)])
}

/// A colour map and its legend.
pub struct ColorMap {
    /// The drawn map.
    pub picture: RgbImage,
    /// The quantity and its range, or that no point is valid.
    pub legend: String,
}

/// Draws the reference in grey, and around each valid point a square one step wide in the colour of its value.
///
/// The squares touch without overlap. Points without a valid displacement stay grey. The colour bar below is labelled
/// with the minimum on the left and the maximum on the right.
pub fn draw_map(image: ImageView<'_>, field: &[FieldPoint], quantity: Quantity, step_px: u32) -> ColorMap {
    let mut picture = grey_picture(image);
    let (name, unit) = quantity.name_and_unit();
    let Some(range) = ValueRange::from_field(field, quantity) else {
        return ColorMap { picture, legend: format!("map of {name}: no valid subset") };
    };
    for point in field {
        if let Some(value) = quantity.value_at(point) {
            fill_square(&mut picture, point, step_px, viridis(range.fraction(value)));
        }
    }
    let [low, high] = range.end_labels();
    let legend = format!("map of {name} from {low} to {high}{unit}");
    ColorMap { picture: with_color_bar(&picture, &low, &high), legend }
}

/// Fills a square around a point, clipped to the picture. An even side extends one pixel further to the left and up.
fn fill_square(picture: &mut RgbImage, point: &FieldPoint, side_px: u32, color: Rgb<u8>) {
    let range = |center: f32, size: u32| {
        let start = center.round() as i64 - i64::from(side_px / 2);
        let end = (start + i64::from(side_px)).clamp(0, i64::from(size));
        start.clamp(0, i64::from(size)) as u32..end as u32
    };
    for row in range(point.y_px, picture.height()) {
        for column in range(point.x_px, picture.width()) {
            picture.put_pixel(column, row, color);
        }
    }
}

/// Adds the colour bar and its labels below the picture, widening it if the labels need room.
fn with_color_bar(picture: &RgbImage, low: &str, high: &str) -> RgbImage {
    let scale = if picture.width() >= 480 { 3 } else { 2 };
    let [left, right] = [low, high].map(|text| pixel_font::width(text, scale));
    let width = picture.width().max(left + right + 4 * MARGIN_PX);
    let height = picture.height() + BAR_PX + pixel_font::height(scale) + 3 * MARGIN_PX;
    let mut all = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    image::imageops::replace(&mut all, picture, 0, 0);
    let top = picture.height() + MARGIN_PX;
    let long = width - 2 * MARGIN_PX;
    for column in 0..long {
        let color = viridis(column as f32 / (long - 1) as f32);
        (top..top + BAR_PX).for_each(|row| all.put_pixel(MARGIN_PX + column, row, color));
    }
    let row = top + BAR_PX + MARGIN_PX;
    pixel_font::write(&mut all, MARGIN_PX, row, scale, low);
    pixel_font::write(&mut all, width - MARGIN_PX - right, row, scale, high);
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::results::{Displacement, PointStatus};

    /// CIE 1976 lightness, 0 to 100.
    fn lightness(Rgb(color): Rgb<u8>) -> f64 {
        let linear = |level: u8| {
            let level = f64::from(level) / 255.0;
            if level <= 0.04045 { level / 12.92 } else { ((level + 0.055) / 1.055).powf(2.4) }
        };
        let luminance = 0.2126 * linear(color[0]) + 0.7152 * linear(color[1]) + 0.0722 * linear(color[2]);
        if luminance > 0.008_856 { 116.0 * luminance.cbrt() - 16.0 } else { 903.3 * luminance }
    }

    #[test]
    fn equal_steps_of_the_value_are_equal_steps_of_lightness() {
        let steps: Vec<f64> = (0..=30).map(|k| lightness(viridis(k as f32 / 30.0))).collect();
        assert!(steps[0] < 16.0 && steps[30] > 89.0, "{steps:?}");
        let mean = (steps[30] - steps[0]) / 30.0;
        for pair in steps.windows(2) {
            // Rounding to 8 bits and linear interpolation between ten colours cause up to a third.
            assert!((pair[1] - pair[0] - mean).abs() < 0.35 * mean, "{pair:?} against {mean}");
        }
    }

    fn point(x_px: f32, u_px: Option<f32>) -> FieldPoint {
        let of = |u_px: f32| Displacement { u_px, v_px: -u_px, sigma_u_px: 0.003, sigma_v_px: 0.004 };
        let status = if u_px.is_some() { PointStatus::Valid } else { PointStatus::Outlier };
        let displacement = u_px.map(of);
        FieldPoint { x_px, y_px: 12.0, displacement, zncc: Some(0.9), peak_ratio: None, status }
    }

    #[test]
    fn each_point_has_the_colour_of_its_value_and_invalid_ones_stay_grey() {
        let levels = Image::from_vec(vec![100.0; 96 * 40], 96, 40).unwrap();
        let field = [point(12.0, Some(-1.0)), point(20.0, Some(0.5)), point(28.0, None), point(36.0, Some(2.0))];
        let map = draw_map(levels.view(), &field, Quantity::U, 8);
        assert_eq!(map.legend, "map of u from -1.00 to 2.00 px");
        let at = |x: u32, y: u32| *map.picture.get_pixel(x, y);
        let grey = Rgb([255; 3]);
        assert_eq!((at(12, 12), at(8, 8), at(15, 15)), (viridis(0.0), viridis(0.0), viridis(0.0)));
        assert_eq!((at(16, 12), at(23, 12)), (viridis(0.5), viridis(0.5)), "squares touch and do not overlap");
        assert_eq!(at(36, 12), viridis(1.0));
        assert_eq!((at(28, 12), at(7, 12), at(12, 16), at(60, 30)), (grey, grey, grey, grey));
        // The colour bar: darkest on the left, lightest on the right, like the values.
        let row = 40 + MARGIN_PX + BAR_PX / 2;
        assert_eq!((at(MARGIN_PX, row), at(95 - MARGIN_PX, row)), (viridis(0.0), viridis(1.0)));
        let dark = |range: std::ops::Range<u32>| {
            let below = 40 + BAR_PX + 2 * MARGIN_PX..map.picture.height();
            range.flat_map(|x| below.clone().map(move |y| (x, y))).filter(|(x, y)| at(*x, *y) == Rgb([0; 3])).count()
        };
        assert!(dark(0..48) > 20 && dark(48..96) > 20, "numbers at both ends");
    }

    #[test]
    fn every_quantity_is_its_own_and_invalid_zncc_does_not_stretch_the_range() {
        let mut field = [point(12.0, Some(1.0)), point(20.0, None)];
        field[1].zncc = Some(0.1);
        let range = |quantity: Quantity| ValueRange::from_field(&field, quantity).unwrap().low;
        for ((word, quantity), expected) in Quantity::WORDS.into_iter().zip([1.0, -1.0, 0.9, 0.003_535_534]) {
            assert!((range(quantity) - expected).abs() < 1e-6, "{word}: {}", range(quantity));
        }
        let one = draw_map(Image::new(30, 30).view(), &field, Quantity::Zncc, 8);
        assert_eq!(one.legend, "map of zncc from 0.9000 to 0.9000");
        assert_eq!(*one.picture.get_pixel(12, 12), viridis(0.5));
        let none = draw_map(Image::new(30, 30).view(), &field[1..], Quantity::V, 8);
        assert_eq!(none.legend, "map of v: no valid subset");
    }
}
