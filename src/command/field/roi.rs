//! Regions of interest as they are written on the command line.

/// A rectangle x, y, width, height, written with commas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Roi(pub [u32; 4]);

impl std::str::FromStr for Roi {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<u32>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        let roi = numbers.ok().and_then(|numbers| <[u32; 4]>::try_from(numbers).ok());
        roi.map(Self).ok_or_else(|| "expected four whole numbers of pixels: x,y,width,height".to_owned())
    }
}

/// The corners of a polygon.
#[derive(Debug, Clone)]
pub struct Corners(pub Vec<[f64; 2]>);

impl std::str::FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let corner = |corner: &str| {
            let (x, y) = corner.split_once(',')?;
            let number = |text: &str| text.parse().ok().filter(|px: &f64| px.abs() <= 65_536.0);
            Some([number(x)?, number(y)?])
        };
        let corners: Option<Vec<[f64; 2]>> = text.split_whitespace().map(corner).collect();
        let corners = corners.filter(|corners| corners.len() >= 3);
        corners.map(Self).ok_or_else(|| {
            "expected at least three corners x,y in px, separated by spaces, each within 65536".to_owned()
        })
    }
}
