//! `[[body]]`: what is followed in the pictures.

use super::check::{Bounds, Table};
use super::error::ConfigError;
use super::raw::RawBody;
use super::text::Text;
use crate::ball::OutlineMethod;
use crate::dic::Patch;
use crate::results::ROD_EDGES;

/// What kind of thing a body is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyKind {
    /// A speckled ball: its outline is a circle.
    Ball,
    /// An upright rod with two tapes around it, one of them speckled.
    Rod,
    /// The pixels inside a polygon, drawn in the stream's first picture.
    Patch,
}

/// `[[body]]`: one thing that is followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// What results call it: 1 to 32 of `a-z A-Z 0-9 _ -`, no two alike. Default its kind for the only body.
    pub name: String,
    /// What it is, default `ball`.
    pub kind: BodyKind,
    /// True diameter, above 0 and at most 10000 mm. With `scale.mm_per_px` it narrows the radii (widths) looked for; with
    /// `scale.ball_diameter_mm` it takes that value's place for this body. Left out: not known.
    pub diameter_mm: Option<f64>,
    /// Mass, above 0 and at most 1000 kg: turns accelerations into forces and speeds into energies. Left out: not known.
    pub mass_kg: Option<f64>,
    /// Smallest radius looked for, 2 to 32768 px, less than `max_radius_px`. Left out: 0.8 times the radius that
    /// `diameter_mm` and `scale.mm_per_px` predict, else 0.04 of the image's smaller side.
    pub min_radius_px: Option<f64>,
    /// Largest radius looked for, 2 to 32768 px. Left out: 1.25 times the predicted radius, else 0.45 of the
    /// image's smaller side.
    pub max_radius_px: Option<f64>,
    /// How the outline of a ball is measured: `edges` (default), to a few hundredths of a pixel, or `marked`, the paper's
    /// marked boundary and Hough transform, to some tenths.
    pub outline: OutlineMethod,
    /// Edges of tapes that are followed on a rod, from the top downwards, 2 to 4, default 4: all of them must be in
    /// sight for the rod to be found.
    pub edges: u32,
    /// From the lowest edge that is followed down to the end of a rod, 0 to 10000 mm; triggers on its gap or its predicted
    /// contact need it, and `scale.mm_per_px`. Left out: not known.
    pub end_mm: Option<f64>,
    /// Region searched, `[x, y, width, height]` in px, inside the image; left out, the whole image.
    pub roi_px: Option<[u32; 4]>,
    /// A patch: `polygon_px` of 3 to 256 corners `[x, y]` in the stream's first picture, `holes_px`, polygons too, and
    /// `center_px`, the point that is told, default the centroid.
    pub patch: Option<Patch>,
}

impl Body {
    /// Whether it is known how far the body reaches, so that it can be told when it touches something.
    pub(super) fn has_rim(&self) -> bool {
        self.kind == BodyKind::Ball || self.end_mm.is_some()
    }

    fn only_ball() -> Self {
        Self {
            name: "ball".into(),
            kind: BodyKind::Ball,
            diameter_mm: None,
            mass_kg: None,
            min_radius_px: None,
            max_radius_px: None,
            outline: OutlineMethod::default(),
            edges: EDGES_DEFAULT,
            end_mm: None,
            roi_px: None,
            patch: None,
        }
    }
}

const BODIES_MAX: usize = 16;
const CORNERS_MAX: usize = 256;
/// The smallest patch that is a subset's equal, px^2.
const AREA_MIN_PX2: f64 = 150.0;
const EDGES_DEFAULT: u32 = ROD_EDGES as u32;
const RADIUS: Bounds = Bounds::closed(2.0, 32_768.0, "px");
const END: Bounds = Bounds::closed(0.0, 10_000.0, "mm");
const MASS: Bounds = Bounds::above(0.0, 1000.0, "kg");
pub(super) const DIAMETER: Bounds = Bounds::above(0.0, 10_000.0, "mm");

pub(super) fn bodies(
    text: &Text<'_>,
    raw: Vec<RawBody>,
    image_px: Option<(u32, u32)>,
) -> Result<Vec<Body>, ConfigError> {
    if raw.is_empty() {
        return Ok(vec![Body::only_ball()]);
    }
    if raw.len() > BODIES_MAX {
        return Err(text.refuse("body", format!("at most {BODIES_MAX} tables")));
    }
    let alone = raw.len() == 1;
    let mut bodies: Vec<Body> = Vec::new();
    for (index, raw) in raw.into_iter().enumerate() {
        let table = Table::new(text, format!("body[{index}]"));
        let body = body(&table, raw, alone, image_px)?;
        if bodies.iter().any(|other| other.name == body.name) {
            return Err(table.refuse("name", "different from the names of the bodies before it"));
        }
        bodies.push(body);
    }
    Ok(bodies)
}

fn body(table: &Table<'_>, raw: RawBody, alone: bool, image_px: Option<(u32, u32)>) -> Result<Body, ConfigError> {
    let kind = kind(table, raw.kind.as_deref())?;
    let patch_keys = [
        ("polygon_px", raw.polygon_px.is_some()),
        ("holes_px", raw.holes_px.is_some()),
        ("center_px", raw.center_px.is_some()),
    ];
    if let (Some((key, _)), true) = (patch_keys.iter().find(|(_, given)| *given), kind != BodyKind::Patch) {
        return Err(table.text.out_of_place(&table.key(key), with(kind), "kind = \"patch\""));
    }
    let given = [
        ("min_radius_px", raw.min_radius_px.is_some(), &[BodyKind::Ball][..]),
        ("max_radius_px", raw.max_radius_px.is_some(), &[BodyKind::Ball]),
        ("outline", raw.outline.is_some(), &[BodyKind::Ball]),
        ("edges", raw.edges.is_some(), &[BodyKind::Rod]),
        ("end_mm", raw.end_mm.is_some(), &[BodyKind::Rod]),
        ("diameter_mm", raw.diameter_mm.is_some(), &[BodyKind::Ball, BodyKind::Rod]),
        ("roi_px", raw.roi_px.is_some(), &[BodyKind::Ball, BodyKind::Rod]),
    ];
    if let Some((key, _, owners)) = given.iter().find(|(_, given, owners)| *given && !owners.contains(&kind)) {
        return Err(table.text.out_of_place(&table.key(key), with(kind), with(owners[0])));
    }
    let patch = (kind == BodyKind::Patch).then(|| patch(table, &raw, image_px)).transpose()?;
    let body = Body {
        name: name(table, raw.name, alone.then_some(kind))?,
        kind,
        diameter_mm: table.number("diameter_mm", raw.diameter_mm, DIAMETER)?,
        mass_kg: table.number("mass_kg", raw.mass_kg, MASS)?,
        min_radius_px: table.number("min_radius_px", raw.min_radius_px, RADIUS)?,
        max_radius_px: table.number("max_radius_px", raw.max_radius_px, RADIUS)?,
        outline: outline(table, raw.outline.as_deref())?,
        edges: table.whole("edges", raw.edges, 2..=ROD_EDGES as i64, "")?.unwrap_or(EDGES_DEFAULT),
        end_mm: table.number("end_mm", raw.end_mm, END)?,
        roi_px: table.region("roi_px", raw.roi_px.as_deref(), image_px)?,
        patch,
    };
    match body.min_radius_px.zip(body.max_radius_px) {
        Some((min_px, max_px)) if min_px >= max_px => {
            Err(table.refuse("min_radius_px", format!("less than max_radius_px = {max_px} px")))
        }
        _ => Ok(body),
    }
}

fn kind(table: &Table<'_>, word: Option<&str>) -> Result<BodyKind, ConfigError> {
    let kinds = [("ball", BodyKind::Ball), ("rod", BodyKind::Rod), ("patch", BodyKind::Patch)];
    Ok(table.choice("kind", word, &kinds)?.unwrap_or(BodyKind::Ball))
}

fn outline(table: &Table<'_>, word: Option<&str>) -> Result<OutlineMethod, ConfigError> {
    let methods = [("edges", OutlineMethod::Edges), ("marked", OutlineMethod::Marked)];
    Ok(table.choice("outline", word, &methods)?.unwrap_or_default())
}

/// The polygon of a patch.
fn patch(table: &Table<'_>, raw: &RawBody, image_px: Option<(u32, u32)>) -> Result<Patch, ConfigError> {
    let (right, bottom) = image_px.map_or((65_535.0, 65_535.0), |(w, h)| (f64::from(w) - 1.0, f64::from(h) - 1.0));
    let polygon = |corners: &[Vec<f64>]| -> Option<Vec<[f64; 2]>> {
        let inside = |[x, y]: &[f64; 2]| (0.0..=right).contains(x) && (0.0..=bottom).contains(y);
        let corners: Option<Vec<[f64; 2]>> =
            corners.iter().map(|corner| <[f64; 2]>::try_from(corner.as_slice()).ok().filter(inside)).collect();
        corners.filter(|corners| (3..=CORNERS_MAX).contains(&corners.len()))
    };
    let words = format!("3 to {CORNERS_MAX} corners [x, y], 0 to {right} and 0 to {bottom} px");
    let outline_px = polygon(raw.polygon_px.as_deref().unwrap_or_default());
    let outline_px = outline_px.ok_or_else(|| table.refuse("polygon_px", words.as_str()))?;
    let holes = raw.holes_px.iter().flatten().map(|hole| polygon(hole)).collect::<Option<Vec<_>>>();
    let holes_px = holes.ok_or_else(|| table.refuse("holes_px", format!("polygons, each {words}")))?;
    let center = |given: &Vec<f64>| {
        let center = <[f64; 2]>::try_from(given.as_slice()).ok();
        center.filter(|center| center.iter().all(|x| x.abs() <= 65_535.0))
    };
    let center_px = raw.center_px.as_ref().map(center);
    if center_px == Some(None) {
        return Err(table.refuse("center_px", "a point [x, y] in px, -65535 to 65535"));
    }
    let patch = Patch { outline_px, holes_px, center_px: center_px.flatten() };
    let area_px2 = patch.area_and_centroid().0;
    if area_px2.is_nan() || area_px2 < AREA_MIN_PX2 {
        return Err(table.refuse(
            "polygon_px",
            format!("of at least {AREA_MIN_PX2} px^2 without its holes, and is of {area_px2:.0}"),
        ));
    }
    Ok(patch)
}

/// The setting that makes a body one of this kind.
pub(super) fn with(kind: BodyKind) -> &'static str {
    match kind {
        BodyKind::Ball => "kind = \"ball\"",
        BodyKind::Rod => "kind = \"rod\"",
        BodyKind::Patch => "kind = \"patch\"",
    }
}

fn name(table: &Table<'_>, name: Option<String>, alone: Option<BodyKind>) -> Result<String, ConfigError> {
    let letter = |byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte);
    match (name, alone) {
        (None, Some(BodyKind::Ball)) => Ok("ball".into()),
        (None, Some(BodyKind::Rod)) => Ok("rod".into()),
        (None, Some(BodyKind::Patch)) => Ok("patch".into()),
        (Some(name), _) if (1..=32).contains(&name.len()) && name.bytes().all(letter) => Ok(name),
        _ => Err(table.refuse("name", "1 to 32 of the characters a-z A-Z 0-9 _ -")),
    }
}
