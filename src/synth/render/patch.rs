//! The part of an image that an object is drawn into.

/// The contribution of the ball to the static image, on the rectangle around it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Patch {
    /// The first column and row in the image.
    pub(crate) left: usize,
    pub(crate) top: usize,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// The coverage of each pixel by the ball, row-major.
    pub(crate) coverage: Vec<f32>,
    /// The light from the ball before the illumination of the room, DN, row-major.
    pub(crate) light_dn: Vec<f32>,
}

impl Patch {
    /// Interpolates coverage and light (DN) bilinearly at an image position, px; 0 outside.
    pub(crate) fn interpolate(&self, x: f64, y: f64) -> (f32, f32) {
        let (x, y) = (x - self.left as f64, y - self.top as f64);
        let (first_x, first_y) = (x.floor(), y.floor());
        let inside = |first: f64, count: usize| first >= 0.0 && first + 1.0 < count as f64;
        if !inside(first_x, self.width) || !inside(first_y, self.height) {
            return (0.0, 0.0);
        }
        let (right, down) = ((x - first_x) as f32, (y - first_y) as f32);
        let cell = first_y as usize * self.width + first_x as usize;
        let between = |values: &[f32]| {
            let along_row = |cell: usize| values[cell] + right * (values[cell + 1] - values[cell]);
            let (above, below) = (along_row(cell), along_row(cell + self.width));
            above + down * (below - above)
        };
        (between(&self.coverage), between(&self.light_dn))
    }
}

/// A patch whose ink is drawn: the coverage of its pixels by speckles and lines, row-major.
pub(crate) struct Canvas<'a> {
    pub(crate) patch: &'a Patch,
    pub(crate) ink: &'a mut [f32],
}

/// Adds a coverage to the ink of every pixel within `reach` of a position, px; `coverage` takes coordinates relative
/// to it.
pub(crate) fn splat(place_px: [f64; 2], reach: f64, canvas: &mut Canvas<'_>, coverage: impl Fn(f32, f32) -> f32) {
    let Canvas { patch, ink } = canvas;
    let [x, y] = place_px;
    let first_row = (y - reach).ceil().max(0.0) as usize;
    let end_row = ((y + reach).floor() + 1.0).clamp(0.0, patch.height as f64) as usize;
    for row in first_row..end_row {
        let dy = row as f64 - y;
        let half = (reach * reach - dy * dy).max(0.0).sqrt();
        let first = (x - half).ceil().max(0.0) as usize;
        let end = ((x + half).floor() + 1.0).clamp(0.0, patch.width as f64) as usize;
        if first >= end {
            continue;
        }
        let (mut dx, dy) = ((first as f64 - x) as f32, dy as f32);
        for cell in &mut ink[row * patch.width + first..row * patch.width + end] {
            *cell += coverage(dx, dy);
            dx += 1.0;
        }
    }
}
