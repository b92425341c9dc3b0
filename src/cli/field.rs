//! The line of `ricochet field`.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::PathBuf;

use crate::command::field::{Begin, FieldOptions, Quantity};
use crate::config::{Config, ConfigError};
use crate::dic::{self, CorrelationParams, Interpolation, Method, Shape, WindowShape};

/// Arguments of a command.
#[derive(Debug, Args)]
pub struct Field {
    /// The image before.
    reference: PathBuf,
    /// The image after.
    target: PathBuf,
    /// More images after it: all of them are a series in this order, and --output and --picture name directories.
    #[arg(value_name = "TARGET")]
    later: Vec<PathBuf>,
    /// A rig file whose [correlation] table is used.
    #[arg(long)]
    config: Option<PathBuf>,
    /// The table to write; standard output when absent.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Region of interest: x,y,width,height in px.
    #[arg(long, value_name = "X,Y,W,H")]
    roi: Option<Region>,
    /// Region of interest: three corners or more, x,y in px, with spaces between them; in place of --roi.
    #[arg(long, value_name = "X,Y X,Y X,Y...", conflicts_with = "roi")]
    polygon: Option<Corners>,
    /// A hole in the polygon; as often as needed.
    #[arg(long, value_name = "X,Y X,Y X,Y...", requires = "polygon")]
    hole: Vec<Corners>,
    /// Also subsets that the edge of the picture or of the region cuts, as long as half of their pixels are left.
    #[arg(long)]
    partial: bool,
    /// Subset size, odd, px.
    #[arg(long, value_name = "PX")]
    subset: Option<u32>,
    /// From one subset to the next, px.
    #[arg(long, value_name = "PX")]
    step: Option<u32>,
    /// How displacements are found.
    #[arg(long, value_parser = words(&Method::WORDS))]
    method: Option<Method>,
    /// How subsets may deform (method ic-gn).
    #[arg(long, value_parser = words(&Shape::WORDS))]
    shape: Option<Shape>,
    /// Outline of the subsets.
    #[arg(long, value_parser = words(&WindowShape::WORDS))]
    window: Option<WindowShape>,
    /// How the target is interpolated; bicubic is OpenCorr's, less exact, to compare with its results.
    #[arg(long, value_parser = words(&Interpolation::WORDS))]
    interpolation: Option<Interpolation>,
    /// Largest displacement looked for, px.
    #[arg(long, value_name = "PX")]
    search: Option<u32>,
    /// Where the search begins; any-angle looks for the whole region first, at every angle and in the whole target.
    #[arg(long, value_parser = words(&Begin::WORDS), default_value = "neighbor")]
    start: Begin,
    /// A PNG of the vectors over the reference.
    #[arg(long)]
    picture: Option<PathBuf>,
    /// Show this in colours in the picture, in place of the vectors.
    #[arg(long, value_parser = words(&Quantity::WORDS), requires = "picture")]
    map: Option<Quantity>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// One of the words of a setting, as what it stands for.
fn words<T: Copy + Send + Sync + 'static>(words: &'static [(&'static str, T)]) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(words.iter().map(|(word, _)| *word))
        .try_map(|word| words.iter().find(|(known, _)| *known == word).map(|(_, meaning)| *meaning).ok_or(word))
}

/// Four numbers with commas between them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Region(pub(super) [u32; 4]);

impl std::str::FromStr for Region {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<u32>, _> = text.split(',').map(|number| number.trim().parse()).collect();
        let region = numbers.ok().and_then(|numbers| <[u32; 4]>::try_from(numbers).ok());
        region.map(Self).ok_or_else(|| "four whole numbers of pixels, x,y,width,height".to_owned())
    }
}

/// Corners of a polygon.
#[derive(Debug, Clone)]
struct Corners(Vec<[f64; 2]>);

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
        corners
            .map(Self)
            .ok_or_else(|| "three corners or more, x,y in px, each within 65536, spaces between".to_owned())
    }
}

impl Field {
    /// What was asked for: the rig file's settings, and over them those of the self.
    pub(super) fn options(self) -> Result<FieldOptions, ConfigError> {
        let mut params = match &self.config {
            Some(path) => Config::load(path)?.correlation(),
            None => CorrelationParams::default(),
        };
        params.subset_size_px = self.subset.unwrap_or(params.subset_size_px);
        params.step_px = self.step.unwrap_or(params.step_px);
        params.search_px = self.search.unwrap_or(params.search_px);
        params.method = self.method.unwrap_or(params.method);
        params.shape = self.shape.unwrap_or(params.shape);
        params.window = self.window.unwrap_or(params.window);
        params.interpolation = self.interpolation.unwrap_or(params.interpolation);
        let roi_px = self.roi.map(|roi| roi.0);
        let holes_px = self.hole.into_iter().map(|hole| hole.0).collect();
        let region = self.polygon.map(|outline| dic::Region::Polygon { outline_px: outline.0, holes_px });
        let Field { reference, target, later, output, picture, json, map, start: begin, partial, .. } = self;
        Ok(FieldOptions {
            reference,
            target,
            later,
            params,
            roi_px,
            region,
            partial,
            output,
            json,
            picture,
            map,
            begin,
        })
    }
}
