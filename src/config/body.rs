//! `[[body]]`: the bodies to follow.

use super::check::{Bounds, OwnedKey, Setting, Table};
use super::error::ConfigError;
use super::raw::RawBody;
use super::text::Text;
use crate::ball::OutlineMethod;
use crate::dic::Patch;
pub use crate::results::BodyKind;
use crate::results::ROD_EDGES;

impl BodyKind {
    const SETTING: Setting<Self> = Setting { key: "kind", name: Self::as_str };

    /// Returns `kind = "name"`, for error messages.
    pub(super) fn assignment(self) -> String {
        Self::SETTING.assignment(&[self])
    }
}

/// `[[body]]`: a body to follow.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// The name in results: 1 to 32 of `a-z A-Z 0-9 _ -`, unique. Default: the kind, if there is only one body.
    pub name: String,
    /// The kind, default `ball`.
    pub kind: BodyKind,
    /// The true diameter, above 0 and at most 10000 mm. With `scale.mm_per_px` it narrows the range of radii (or widths)
    /// to search. With `scale.ball_diameter_mm` it replaces that value for this body. Default: unknown.
    pub diameter_mm: Option<f64>,
    /// The mass, above 0 and at most 1000 kg. It converts accelerations to forces and speeds to energies. Default: unknown.
    pub mass_kg: Option<f64>,
    /// The minimum radius to search, 2 to 32768 px, less than `max_radius_px`. Default: 0.8 times the radius that
    /// `diameter_mm` and `scale.mm_per_px` predict, else 0.04 of the image's smaller side.
    pub min_radius_px: Option<f64>,
    /// The maximum radius to search, 2 to 32768 px. Default: 1.25 times the predicted radius, else 0.45 of the image's
    /// smaller side.
    pub max_radius_px: Option<f64>,
    /// The method for the outline of a ball: `edges` (default), accurate to a few hundredths of a pixel, or `marked`, the
    /// paper's marked boundary and Hough transform, accurate to some tenths.
    pub outline: OutlineMethod,
    /// The number of tape edges to follow on a rod, from the top, 2 to 4, default 4. All of them must be visible for the
    /// rod to be found.
    pub edges: u32,
    /// The distance from the lowest followed edge down to the end of a rod, 0 to 10000 mm. Triggers on its gap or its
    /// predicted contact need it, and `scale.mm_per_px`. Default: unknown.
    pub end_mm: Option<f64>,
    /// The region to search, `[x, y, width, height]` in px, inside the image. Default: the whole image.
    pub roi_px: Option<[u32; 4]>,
    /// The pixels of a patch: `polygon_px` of 3 to 256 corners `[x, y]` in the first frame of the stream, `holes_px`,
    /// polygons too, and `center_px`, the reported point, default the centroid.
    pub patch: Option<Patch>,
}

impl Body {
    /// Whether the extent of the body is known, so that its contact can be predicted.
    pub(super) fn has_known_extent(&self) -> bool {
        self.kind == BodyKind::Ball || self.end_mm.is_some()
    }
}

/// The maximum number of bodies.
pub(super) const MAX_BODIES: usize = 16;
/// The maximum number of corners of a polygon.
const MAX_CORNERS: usize = 256;
/// The area of the smallest patch that carries as much texture as a subset, px^2.
const AREA_MIN_PX2: f64 = 150.0;
const EDGES_DEFAULT: u32 = ROD_EDGES as u32;
const RADIUS: Bounds = Bounds::closed(2.0, 32_768.0, "px");
const END: Bounds = Bounds::closed(0.0, 10_000.0, "mm");
const MASS: Bounds = Bounds::above(0.0, 1000.0, "kg");
pub(super) const DIAMETER: Bounds = Bounds::above(0.0, 10_000.0, "mm");

/// Checks the bodies of a file. A file without any has a ball.
pub(super) fn check_bodies(
    text: &Text<'_>,
    mut raw: Vec<RawBody>,
    image_px: Option<(u32, u32)>,
) -> Result<Vec<Body>, ConfigError> {
    if raw.is_empty() {
        raw.push(RawBody::default());
    }
    if raw.len() > MAX_BODIES {
        return Err(text.refuse("body", format!("at most {MAX_BODIES} tables")));
    }
    let count = raw.len();
    let mut bodies: Vec<Body> = Vec::new();
    for (index, mut raw) in raw.into_iter().enumerate() {
        let table = Table::new(text, format!("body[{index}]"));
        if count == 1 && raw.name.is_none() {
            raw.name = Some(raw.kind.clone().unwrap_or_else(|| "ball".into()));
        }
        let body = check_body(&table, raw, image_px)?;
        if bodies.iter().any(|other| other.name == body.name) {
            return Err(table.refuse("name", "different from the names of the bodies before it"));
        }
        bodies.push(body);
    }
    Ok(bodies)
}

/// Checks one body, and that its keys belong to its kind.
fn check_body(table: &Table<'_>, raw: RawBody, image_px: Option<(u32, u32)>) -> Result<Body, ConfigError> {
    let kind = table.named("kind", raw.kind.as_deref())?.unwrap_or(BodyKind::Ball);
    let (ball, rod, patch_only) = (&[BodyKind::Ball], &[BodyKind::Rod], &[BodyKind::Patch]);
    let keys: [OwnedKey<'_, BodyKind>; 10] = [
        ("polygon_px", raw.polygon_px.is_some(), patch_only),
        ("holes_px", raw.holes_px.is_some(), patch_only),
        ("center_px", raw.center_px.is_some(), patch_only),
        ("min_radius_px", raw.min_radius_px.is_some(), ball),
        ("max_radius_px", raw.max_radius_px.is_some(), ball),
        ("outline", raw.outline.is_some(), ball),
        ("edges", raw.edges.is_some(), rod),
        ("end_mm", raw.end_mm.is_some(), rod),
        ("diameter_mm", raw.diameter_mm.is_some(), &[BodyKind::Ball, BodyKind::Rod]),
        ("roi_px", raw.roi_px.is_some(), &[BodyKind::Ball, BodyKind::Rod]),
    ];
    table.check_owners(BodyKind::SETTING, kind, &keys)?;
    let outlines = [("edges", OutlineMethod::Edges), ("marked", OutlineMethod::Marked)];
    let body = Body {
        patch: (kind == BodyKind::Patch).then(|| check_patch(table, &raw, image_px)).transpose()?,
        name: check_name(table, raw.name)?,
        kind,
        diameter_mm: table.number("diameter_mm", raw.diameter_mm, DIAMETER)?,
        mass_kg: table.number("mass_kg", raw.mass_kg, MASS)?,
        min_radius_px: table.number("min_radius_px", raw.min_radius_px, RADIUS)?,
        max_radius_px: table.number("max_radius_px", raw.max_radius_px, RADIUS)?,
        outline: table.choice("outline", raw.outline.as_deref(), &outlines)?.unwrap_or_default(),
        edges: table.integer("edges", raw.edges, 2..=ROD_EDGES as i64, "")?.unwrap_or(EDGES_DEFAULT),
        end_mm: table.number("end_mm", raw.end_mm, END)?,
        roi_px: table.region("roi_px", raw.roi_px.as_deref(), image_px)?,
    };
    match body.min_radius_px.zip(body.max_radius_px) {
        Some((min_px, max_px)) if min_px >= max_px => {
            Err(table.refuse("min_radius_px", format!("less than max_radius_px = {max_px} px")))
        }
        _ => Ok(body),
    }
}

/// Checks the polygon, the holes and the reported point of a patch, and its area without the holes.
///
/// Corners lie in the image, or in one of 65535 px if its size is unknown.
fn check_patch(table: &Table<'_>, raw: &RawBody, image_px: Option<(u32, u32)>) -> Result<Patch, ConfigError> {
    let (right, bottom) = image_px.map_or((65_535.0, 65_535.0), |(w, h)| (f64::from(w) - 1.0, f64::from(h) - 1.0));
    let polygon = |corners: &[Vec<f64>]| -> Option<Vec<[f64; 2]>> {
        let inside = |[x, y]: &[f64; 2]| (0.0..=right).contains(x) && (0.0..=bottom).contains(y);
        let corners: Option<Vec<[f64; 2]>> =
            corners.iter().map(|corner| <[f64; 2]>::try_from(corner.as_slice()).ok().filter(inside)).collect();
        corners.filter(|corners| (3..=MAX_CORNERS).contains(&corners.len()))
    };
    let allowed = format!("3 to {MAX_CORNERS} corners [x, y], 0 to {right} and 0 to {bottom} px");
    let outline_px = polygon(raw.polygon_px.as_deref().unwrap_or_default());
    let outline_px = outline_px.ok_or_else(|| table.refuse("polygon_px", allowed.as_str()))?;
    let holes = raw.holes_px.iter().flatten().map(|hole| polygon(hole)).collect::<Option<Vec<_>>>();
    let holes_px = holes.ok_or_else(|| table.refuse("holes_px", format!("polygons, each {allowed}")))?;
    let center = |given: &Vec<f64>| {
        let center = <[f64; 2]>::try_from(given.as_slice()).ok();
        center
            .filter(|center| center.iter().all(|x| x.abs() <= 65_535.0))
            .ok_or_else(|| table.refuse("center_px", "a point [x, y] in px, -65535 to 65535"))
    };
    let patch = Patch { outline_px, holes_px, center_px: raw.center_px.as_ref().map(center).transpose()? };
    let area_px2 = patch.area_and_centroid().0;
    if area_px2.is_nan() || area_px2 < AREA_MIN_PX2 {
        let allowed = format!("at least {AREA_MIN_PX2} px^2 large without its holes, and is {area_px2:.0} px^2");
        return Err(table.refuse("polygon_px", allowed));
    }
    Ok(patch)
}

/// Checks the characters of a name, which is required.
fn check_name(table: &Table<'_>, name: Option<String>) -> Result<String, ConfigError> {
    let letter = |byte: u8| byte.is_ascii_alphanumeric() || b"_-".contains(&byte);
    name.filter(|name| (1..=32).contains(&name.len()) && name.bytes().all(letter))
        .ok_or_else(|| table.refuse("name", "1 to 32 of the characters a-z A-Z 0-9 _ -"))
}
