//! Grey-level images: owned and borrowed.

/// The data do not fit the shape.
///
/// # Examples
///
/// ```
/// use ricochet::image::Image;
///
/// let error = Image::from_vec(vec![0.0; 5], 3, 2).unwrap_err();
/// assert_eq!((error.expected, error.actual), (6, 5));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected} values, got {actual}")]
pub struct ShapeError {
    /// The number of values (or bytes) that the shape requires.
    pub expected: usize,
    /// The number of values (or bytes) given.
    pub actual: usize,
}

impl crate::failure::Fatal for ShapeError {}

/// An image of grey levels in digital numbers (DN), row-major, borrowed.
///
/// # Examples
///
/// ```
/// use ricochet::image::ImageView;
///
/// let levels_dn = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0];
/// let view = ImageView::new(&levels_dn, 3, 2)?;
/// assert_eq!(view.row(1), &levels_dn[3..]);
/// assert_eq!(view.at(2, 1), Some(60.0));
/// // There is no pixel outside the image.
/// assert_eq!(view.at(3, 0), None);
/// # Ok::<(), ricochet::image::ShapeError>(())
/// ```
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
    /// [`ShapeError`] when the length of `data` is not `width * height`.
    pub fn new(data: &'a [f32], width: usize, height: usize) -> Result<Self, ShapeError> {
        if data.len() != width * height {
            return Err(ShapeError { expected: width * height, actual: data.len() });
        }
        Ok(Self { data, width, height })
    }

    /// Returns the number of pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns all pixels, row-major.
    pub fn data(&self) -> &'a [f32] {
        self.data
    }

    /// Returns one row.
    ///
    /// # Panics
    ///
    /// If `y` is not a row of the image.
    pub fn row(&self, y: usize) -> &'a [f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Returns the grey level at (`x`, `y`), or `None` outside the image.
    pub fn at(&self, x: usize, y: usize) -> Option<f32> {
        (x < self.width && y < self.height).then(|| self.data[y * self.width + x])
    }

    /// Interpolates the grey level bilinearly at (`x`, `y`), px; `None` unless all four pixels around it are in the image.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::image::ImageView;
    ///
    /// let view = ImageView::new(&[10.0, 20.0, 30.0, 40.0], 2, 2)?;
    /// assert_eq!(view.interpolate(0.5, 0.25), Some(20.0));
    /// assert_eq!(view.interpolate(1.5, 0.25), None);
    /// # Ok::<(), ricochet::image::ShapeError>(())
    /// ```
    pub fn interpolate(&self, x: f64, y: f64) -> Option<f32> {
        let (column, row) = (x.floor(), y.floor());
        if !(column >= 0.0 && row >= 0.0) {
            return None;
        }
        let (fx, fy, column, row) = ((x - column) as f32, (y - row) as f32, column as usize, row as usize);
        let at = |dx: usize, dy: usize| self.at(column + dx, row + dy);
        let (upper, lower) = (at(0, 0)? * (1.0 - fx) + at(1, 0)? * fx, at(0, 1)? * (1.0 - fx) + at(1, 1)? * fx);
        Some(upper * (1.0 - fy) + lower * fy)
    }
}

/// An image of grey levels in digital numbers (DN), row-major, owned.
///
/// # Examples
///
/// ```
/// use ricochet::image::Image;
///
/// let mut image = Image::from_vec(vec![10.0, 20.0, 30.0, 40.0, 50.0, 60.0], 3, 2)?;
/// for row in image.rows_mut() {
///     row[0] = 0.0;
/// }
/// image.data_mut()[1] = 25.0;
/// assert_eq!(image.view().data(), [0.0, 25.0, 30.0, 0.0, 50.0, 60.0]);
/// // A new image is black; another shape leaves its content unspecified.
/// let mut buffer = Image::new(3, 2);
/// assert_eq!(buffer.view().at(2, 1), Some(0.0));
/// buffer.reshape(640, 480);
/// # Ok::<(), ricochet::image::ShapeError>(())
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    data: Vec<f32>,
    width: usize,
    height: usize,
}

impl Image {
    /// Allocates a black image.
    pub fn new(width: usize, height: usize) -> Self {
        Self { data: vec![0.0; width * height], width, height }
    }

    /// Creates an image from `data`: `height` rows of `width` pixels.
    ///
    /// # Errors
    ///
    /// [`ShapeError`] when the length of `data` is not `width * height`.
    pub fn from_vec(data: Vec<f32>, width: usize, height: usize) -> Result<Self, ShapeError> {
        if data.len() != width * height {
            return Err(ShapeError { expected: width * height, actual: data.len() });
        }
        Ok(Self { data, width, height })
    }

    /// Changes the shape of the image. Its content is unspecified afterwards.
    pub fn reshape(&mut self, width: usize, height: usize) {
        self.data.resize(width * height, 0.0);
        self.width = width;
        self.height = height;
    }

    /// Borrows the image.
    pub fn view(&self) -> ImageView<'_> {
        ImageView { data: &self.data, width: self.width, height: self.height }
    }

    /// Returns all pixels, row-major.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Returns the rows, top to bottom.
    pub fn rows_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        self.data.chunks_exact_mut(self.width.max(1))
    }
}
