//! The arguments of `ricochet field`.

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::PathBuf;

use crate::command::field::{Begin, Corners, FieldOptions, Roi};
use crate::config::{Config, ConfigError};
use crate::console::Overwrite;
use crate::dic::{self, CorrelationParams, Interpolation, Method, Shape, WindowShape};
use crate::plot::Quantity;

/// The arguments of `field`.
#[derive(Debug, Args)]
pub struct Field {
    /// Reference image.
    reference: PathBuf,
    /// Target image.
    target: PathBuf,
    /// Further target images; with any of them --output and --picture name directories.
    #[arg(value_name = "TARGET")]
    later: Vec<PathBuf>,
    /// Rig file whose [correlation] table is used.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Table to write [default: standard output].
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Region of interest: x,y,width,height in px.
    #[arg(long, value_name = "X,Y,W,H")]
    roi: Option<Roi>,
    /// Region of interest instead of --roi: at least three corners x,y in px, separated by spaces.
    #[arg(long, value_name = "X,Y X,Y X,Y...", conflicts_with = "roi")]
    polygon: Option<Corners>,
    /// Hole in the polygon; may be repeated.
    #[arg(long, value_name = "X,Y X,Y X,Y...", requires = "polygon")]
    hole: Vec<Corners>,
    /// Also use subsets cut by the edge of the image or region, if at least half of their pixels remain.
    #[arg(long)]
    partial: bool,
    /// Subset size, odd, px.
    #[arg(long, value_name = "PX")]
    subset: Option<u32>,
    /// Grid step between subsets, px.
    #[arg(long, value_name = "PX")]
    step: Option<u32>,
    /// Correlation method.
    #[arg(long, value_parser = name_parser(&Method::WORDS))]
    method: Option<Method>,
    /// Shape function of the subsets (method ic-gn).
    #[arg(long, value_parser = name_parser(&Shape::WORDS))]
    shape: Option<Shape>,
    /// Shape of the subset window.
    #[arg(long, value_parser = name_parser(&WindowShape::WORDS))]
    window: Option<WindowShape>,
    /// Interpolation of the target; bicubic matches OpenCorr and is less accurate.
    #[arg(long, value_parser = name_parser(&Interpolation::WORDS))]
    interpolation: Option<Interpolation>,
    /// Search range: maximum displacement, px.
    #[arg(long, value_name = "PX")]
    search: Option<u32>,
    /// Initial guess; any-angle first searches the whole region at every angle in the whole target.
    #[arg(long, value_parser = name_parser(&Begin::WORDS), default_value = "neighbor")]
    start: Begin,
    /// PNG picture of the vectors over the reference.
    #[arg(long)]
    picture: Option<PathBuf>,
    /// Draw a colour map of this quantity instead of the vectors.
    #[arg(long, value_parser = name_parser(&Quantity::WORDS), requires = "picture")]
    map: Option<Quantity>,
    /// Whether an output that exists is replaced.
    #[command(flatten)]
    overwrite: Overwrite,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Returns a parser that accepts one of the listed names and returns its value.
fn name_parser<T: Copy + Send + Sync + 'static>(
    names: &'static [(&'static str, T)],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names.iter().map(|(word, _)| *word))
        .try_map(|word| names.iter().find(|(known, _)| *known == word).map(|(_, value)| *value).ok_or(word))
}

impl Field {
    /// Returns the options. Those of the correlator are the rig file's, or the defaults, overridden by the command
    /// line.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] when the rig file cannot be used.
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
        let Field { reference, target, later, output, picture, json, map, start: begin, partial, overwrite, .. } = self;
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
            overwrite,
        })
    }
}
