//! Grids of subset centres.

/// The centre of a subset in the reference, a whole pixel.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct GridPoint {
    /// The column, px.
    pub x: u32,
    /// The row, px.
    pub y: u32,
}

/// Returns the centres whose subsets lie wholly inside a rectangle, row by row.
///
/// `roi` is x, y, width and height in px. The first subset touches its top left corner. The grid is empty if no subset
/// fits.
pub fn rectangle(roi: [u32; 4], step_px: u32, subset_size_px: u32) -> Vec<GridPoint> {
    let half = subset_size_px / 2;
    let along = |start: u32, extent: u32| {
        let last = (start + extent).saturating_sub(half + 1);
        (start + half..=last).step_by(step_px.max(1) as usize)
    };
    if roi[2] < subset_size_px || roi[3] < subset_size_px {
        return Vec::new();
    }
    along(roi[1], roi[3]).flat_map(|y| along(roi[0], roi[2]).map(move |x| GridPoint { x, y })).collect()
}

/// Returns the grid of [`rectangle`], continued to all centres inside the rectangle, row by row, although subsets near
/// its edge extend beyond it.
pub fn partial(roi: [u32; 4], step_px: u32, subset_size_px: u32) -> Vec<GridPoint> {
    let step = step_px.max(1);
    let along = |start: u32, extent: u32| (start + subset_size_px / 2 % step..start + extent).step_by(step as usize);
    along(roi[1], roi[3]).flat_map(|y| along(roi[0], roi[2]).map(move |x| GridPoint { x, y })).collect()
}

/// Returns the centres whose square subsets lie wholly inside a disc and inside the image, row by row.
///
/// The grid is anchored at the disc's centre, rounded to a whole pixel. It is empty if centre or radius is NaN or
/// beyond a million pixels.
#[expect(clippy::too_many_arguments, reason = "a disc, a grid and an image: six plain numbers and one more")]
pub fn disc(
    x_px: f64,
    y_px: f64,
    radius_px: f64,
    step_px: u32,
    subset_size_px: u32,
    width_px: usize,
    height_px: usize,
) -> Vec<GridPoint> {
    let step = f64::from(step_px.max(1));
    let half = f64::from(subset_size_px / 2);
    let (anchor_x, anchor_y) = (x_px.round(), y_px.round());
    let (right, bottom) = (width_px as f64 - 1.0, height_px as f64 - 1.0);
    // Written so that NaN gives no points.
    if !((0.0..1e6).contains(&radius_px) && anchor_x.abs() < 1e6 && anchor_y.abs() < 1e6) {
        return Vec::new();
    }
    let steps = (radius_px / step).ceil() as i32;
    let mut points = Vec::new();
    for row in -steps..=steps {
        for column in -steps..=steps {
            let (x, y) = (anchor_x + f64::from(column) * step, anchor_y + f64::from(row) * step);
            let (reach_x, reach_y) = ((x - x_px).abs() + half, (y - y_px).abs() + half);
            let in_disc = reach_x * reach_x + reach_y * reach_y <= radius_px * radius_px;
            if in_disc && x - half >= 0.0 && y - half >= 0.0 && x + half <= right && y + half <= bottom {
                points.push(GridPoint { x: x as u32, y: y as u32 });
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_is_filled_to_both_ends() {
        let points = rectangle([10, 20, 61, 35], 10, 31);
        let xs: Vec<u32> = points.iter().filter(|p| p.y == 35).map(|p| p.x).collect();
        assert_eq!(xs, [25, 35, 45, 55]);
        assert_eq!(points.iter().map(|p| p.y).max(), Some(35));
        assert!(rectangle([0, 0, 30, 100], 10, 31).is_empty());
        assert_eq!(rectangle([0, 0, 31, 31], 10, 31), [GridPoint { x: 15, y: 15 }]);
    }

    #[test]
    fn partial_subsets_carry_the_same_grid_on() {
        let (whole, all) = (rectangle([10, 20, 61, 35], 10, 31), partial([10, 20, 61, 35], 10, 31));
        assert!(whole.iter().all(|point| all.contains(point)));
        let xs: Vec<u32> = all.iter().filter(|p| p.y == 35).map(|p| p.x).collect();
        assert_eq!(xs, [15, 25, 35, 45, 55, 65]);
        assert_eq!(all.iter().map(|p| p.y).max(), Some(45));
    }

    #[test]
    fn every_subset_of_a_disc_lies_in_the_disc_and_the_image() {
        let points = disc(40.3, 61.8, 50.0, 7, 21, 120, 100);
        assert!(points.contains(&GridPoint { x: 40, y: 62 }));
        assert!(points.len() > 20);
        for point in &points {
            for (cx, cy) in [(-10.0, -10.0), (10.0, -10.0), (-10.0, 10.0), (10.0, 10.0)] {
                let (x, y) = (f64::from(point.x) + cx, f64::from(point.y) + cy);
                assert!((x - 40.3).hypot(y - 61.8) <= 50.0);
                assert!(x >= 0.0 && y >= 0.0 && x <= 119.0 && y <= 99.0);
            }
        }
        assert!(disc(f64::NAN, 0.0, 50.0, 7, 21, 120, 100).is_empty());
    }
}
