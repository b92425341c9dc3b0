//! Grey-level images: owned and borrowed.

/// The data do not have the size that the shape asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected} values, got {actual}")]
pub struct ShapeError {
    /// Values (or bytes) the shape asks for.
    pub expected: usize,
    /// Values (or bytes) given.
    pub actual: usize,
}

impl crate::failure::Fatal for ShapeError {}

/// An image of grey levels in digital numbers (DN), row-major, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct ImageView<'a> {
    data: &'a [f32],
    width: usize,
    height: usize,
}

impl<'a> ImageView<'a> {
    /// Views `data` as `height` rows of `width` pixels.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] when `data` has another length than `width * height`.
    pub fn new(data: &'a [f32], width: usize, height: usize) -> Result<Self, ShapeError> {
        if data.len() != width * height {
            return Err(ShapeError { expected: width * height, actual: data.len() });
        }
        Ok(Self { data, width, height })
    }

    /// Pixels a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row-major.
    pub fn data(&self) -> &'a [f32] {
        self.data
    }

    /// One row.
    ///
    /// # Panics
    ///
    /// If `y` is not a row of the image.
    pub fn row(&self, y: usize) -> &'a [f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// The grey level at (`x`, `y`), or `None` outside.
    pub fn at(&self, x: usize, y: usize) -> Option<f32> {
        (x < self.width && y < self.height).then(|| self.data[y * self.width + x])
    }
}

/// An image of grey levels in digital numbers (DN), row-major, owned.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    data: Vec<f32>,
    width: usize,
    height: usize,
}

impl Image {
    /// A black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self { data: vec![0.0; width * height], width, height }
    }

    /// Takes `data` as `height` rows of `width` pixels.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] when `data` has another length than `width * height`.
    pub fn from_vec(data: Vec<f32>, width: usize, height: usize) -> Result<Self, ShapeError> {
        if data.len() != width * height {
            return Err(ShapeError { expected: width * height, actual: data.len() });
        }
        Ok(Self { data, width, height })
    }

    /// Gives the image another shape; its content is unspecified afterwards.
    pub fn reshape(&mut self, width: usize, height: usize) {
        self.data.resize(width * height, 0.0);
        self.width = width;
        self.height = height;
    }

    /// Borrows it.
    pub fn view(&self) -> ImageView<'_> {
        ImageView { data: &self.data, width: self.width, height: self.height }
    }

    /// All pixels, row-major.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// The rows, top to bottom.
    pub fn rows_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        self.data.chunks_exact_mut(self.width.max(1))
    }
}
