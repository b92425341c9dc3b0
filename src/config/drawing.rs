//! Shapes that a person draws on a picture of the camera, as values of a rig file.

use super::body::MAX_BODIES;
use super::polygon::{Point, is_in_polygon, is_self_intersecting};
use super::trigger::TriggerMode;
use super::{Config, ConfigError};
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike, Value, value};

/// The maximum number of corners of a polygon.
const MAX_CORNERS: usize = 256;

/// A value of the rig file that can be drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ShapeKey {
    /// `trigger.roi_px`: two opposite pixels.
    TriggerRegion,
    /// `roi_px` of a body: two opposite pixels.
    SearchRegion(String),
    /// `polygon_px` of a patch: its corners.
    Polygon(String),
    /// One of the `holes_px` of a patch by its place in the list, or a further one: its corners.
    Mask(String, usize),
    /// A patch that the rig does not have yet, by its name: its corners. It becomes a further `[[body]]`.
    NewPatch(String),
    /// `surface.edge`: its two ends. The outward normal is a quarter turn counter-clockwise from the first to the second.
    Edge,
}

/// A shape on a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// The value that it is written to.
    pub key: ShapeKey,
    /// Its points, px; empty if the rig file has none.
    pub points_px: Vec<Point>,
}

/// A shape that is not written to a rig file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DrawingError {
    /// No body of the rig has this name.
    #[error("no body of the rig is named {0:?}")]
    UnknownBody(String),
    /// A point is not on the frame.
    #[error("the point [{}, {}] is outside the frame of {} x {} px", at[0], at[1], frame_px.0, frame_px.1)]
    Outside {
        /// The point, px.
        at: Point,
        /// Width and height of the frame, px.
        frame_px: (u32, u32),
    },
    /// The shape has too few or too many points.
    #[error("a region and an edge have 2 points, and a polygon 3 to {MAX_CORNERS}, but {0} were drawn")]
    Count(usize),
    /// Two sides of the polygon cross or touch each other.
    #[error("two sides of the polygon cross each other")]
    Crossing,
    /// A mask covers pixels that are not part of its patch.
    #[error("the mask reaches beyond its patch")]
    BeyondPatch,
    /// The rig file would be refused with the shape, or is refused already.
    #[error(transparent)]
    Refused(#[from] ConfigError),
}

impl Config {
    /// Returns the shapes that can be drawn for the main camera, with their points in this file.
    pub fn shapes(&self) -> Vec<Shape> {
        let mut shapes = Vec::new();
        let mut add = |key, points_px| shapes.push(Shape { key, points_px });
        if matches!(self.trigger.mode, TriggerMode::Motion | TriggerMode::Enter) {
            add(ShapeKey::TriggerRegion, self.trigger.roi_px.map_or_else(Vec::new, opposite_pixels));
        }
        for body in &self.bodies {
            let name = || body.name.clone();
            let Some(patch) = &body.patch else {
                add(ShapeKey::SearchRegion(name()), body.roi_px.map_or_else(Vec::new, opposite_pixels));
                continue;
            };
            add(ShapeKey::Polygon(name()), patch.outline_px.clone());
            for (place, hole) in patch.holes_px.iter().enumerate() {
                add(ShapeKey::Mask(name(), place), hole.clone());
            }
            add(ShapeKey::Mask(name(), patch.holes_px.len()), Vec::new());
        }
        if self.bodies.len() < MAX_BODIES {
            add(ShapeKey::NewPatch(self.free_patch_name()), Vec::new());
        }
        add(ShapeKey::Edge, self.surface.edge.map_or_else(Vec::new, |edge| edge.to_vec()));
        shapes
    }

    /// Returns the text of a rig file with a shape, and the rig that it then describes. Everything else in the text stays
    /// as it is, including comments. `origin` names the file in errors, and `frame_px` is the size of the frames if it is
    /// known. Coordinates are rounded to 0.1 px, those of regions to whole pixels.
    ///
    /// # Errors
    ///
    /// [`DrawingError`] when the shape does not fit the frame or the rig, or the file with it is refused as by
    /// [`load`](Self::load).
    pub fn with_shape(
        text: &str,
        origin: &str,
        shape: &Shape,
        frame_px: Option<(u32, u32)>,
    ) -> Result<(String, Self), DrawingError> {
        let before = Self::parse_with_files(text, origin)?;
        let frame_px = frame_px.or_else(|| before.camera.image_px());
        shape.check(&before, frame_px)?;
        // The text was parsed before, so it parses again.
        let mut document = text.parse::<DocumentMut>().unwrap_or_default();
        shape.write(&before, &mut document)?;
        let changed = document.to_string();
        let after = Self::parse_with_files(&changed, origin)?;
        Ok((changed, after))
    }

    /// Returns a name that no body has, for a further patch.
    fn free_patch_name(&self) -> String {
        let is_free = |name: &String| self.bodies.iter().all(|body| body.name != *name);
        let numbered = (2..).map(|number| format!("patch-{number}"));
        std::iter::once("patch".to_owned()).chain(numbered).find(is_free).unwrap_or_default()
    }

    /// Returns the index of a body by its name.
    fn body_index(&self, name: &str) -> Result<usize, DrawingError> {
        let index = self.bodies.iter().position(|body| body.name == name);
        index.ok_or_else(|| DrawingError::UnknownBody(name.to_owned()))
    }
}

/// Returns the first and the last pixel of a region [x, y, width, height].
fn opposite_pixels([x, y, width, height]: [u32; 4]) -> Vec<Point> {
    let far = |start: u32, size: u32| f64::from(start) + f64::from(size) - 1.0;
    vec![[f64::from(x), f64::from(y)], [far(x, width), far(y, height)]]
}

impl Shape {
    /// Checks the points by themselves, against the frame, and a mask against its patch.
    fn check(&self, config: &Config, frame_px: Option<(u32, u32)>) -> Result<(), DrawingError> {
        let is_polygon = matches!(self.key, ShapeKey::Polygon(_) | ShapeKey::Mask(..) | ShapeKey::NewPatch(_));
        let count = self.points_px.len();
        if !(if is_polygon { 3..=MAX_CORNERS } else { 2..=2 }).contains(&count) {
            return Err(DrawingError::Count(count));
        }
        if let Some(frame_px @ (width, height)) = frame_px {
            let is_inside = |[x, y]: &Point| {
                (0.0..=f64::from(width) - 1.0).contains(x) && (0.0..=f64::from(height) - 1.0).contains(y)
            };
            if let Some(at) = self.points_px.iter().find(|point| !is_inside(point)) {
                return Err(DrawingError::Outside { at: *at, frame_px });
            }
        }
        if is_polygon && is_self_intersecting(&self.points_px) {
            return Err(DrawingError::Crossing);
        }
        if let ShapeKey::Mask(name, _) = &self.key
            && let Some(patch) = &config.bodies[config.body_index(name)?].patch
            && !self.points_px.iter().all(|corner| is_in_polygon(*corner, &patch.outline_px))
        {
            return Err(DrawingError::BeyondPatch);
        }
        Ok(())
    }

    /// Sets the value of the shape in a rig file.
    fn write(&self, config: &Config, document: &mut DocumentMut) -> Result<(), DrawingError> {
        let mut set_in_table = |table: &str, key: &str, new: Value| {
            let entry = document.entry(table).or_insert_with(|| Item::Table(Table::new()));
            if let Some(table) = entry.as_table_like_mut() {
                replace(table, key, new);
            }
        };
        match &self.key {
            ShapeKey::TriggerRegion => set_in_table("trigger", "roi_px", self.region()),
            ShapeKey::Edge => set_in_table("surface", "edge", polygon(&self.points_px)),
            ShapeKey::SearchRegion(name) => {
                if let Some(body) = body_table(document, config.body_index(name)?) {
                    replace(body, "roi_px", self.region());
                }
            }
            ShapeKey::Polygon(name) => {
                if let Some(body) = body_table(document, config.body_index(name)?) {
                    replace(body, "polygon_px", polygon(&self.points_px));
                }
            }
            ShapeKey::Mask(name, place) => {
                if let Some(body) = body_table(document, config.body_index(name)?) {
                    set_mask(body, *place, polygon(&self.points_px));
                }
            }
            ShapeKey::NewPatch(name) => {
                // The name of a single body may be left out of the file.
                if let Some(first) = body_table(document, 0)
                    && !first.contains_key("name")
                {
                    first.insert("name", value(&config.bodies[0].name));
                }
                add_patch(document, name, polygon(&self.points_px));
            }
        }
        Ok(())
    }

    /// Returns the region between two opposite pixels as [x, y, width, height].
    fn region(&self) -> Value {
        let along = |axis: usize| {
            let (low, high) = self.points_px.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), point| {
                (low.min(point[axis].round()), high.max(point[axis].round()))
            });
            (low as i64, (high - low) as i64 + 1)
        };
        let ((x, width), (y, height)) = (along(0), along(1));
        Value::Array([x, y, width, height].into_iter().collect())
    }
}

/// Returns points as a list of lists, rounded to 0.1 px.
fn polygon(points_px: &[Point]) -> Value {
    let point = |point: &Point| point.map(|x| (x * 10.0).round() / 10.0).into_iter().collect::<Array>();
    Value::Array(points_px.iter().map(point).collect())
}

/// Returns the table of the body at an index. A file without bodies has a ball, which then gets its table.
fn body_table(document: &mut DocumentMut, index: usize) -> Option<&mut dyn TableLike> {
    let bodies = document.entry("body").or_insert_with(|| {
        let mut bodies = ArrayOfTables::new();
        bodies.push(Table::new());
        Item::ArrayOfTables(bodies)
    });
    match bodies {
        Item::ArrayOfTables(tables) => tables.get_mut(index).map(|table| table as _),
        Item::Value(Value::Array(tables)) => {
            tables.get_mut(index).and_then(Value::as_inline_table_mut).map(|table| table as _)
        }
        _ => None,
    }
}

/// Adds the table of a patch after those of the other bodies.
fn add_patch(document: &mut DocumentMut, name: &str, corners: Value) {
    let entries = [("name", name.into()), ("kind", "patch".into()), ("polygon_px", corners)];
    match document.get_mut("body") {
        Some(Item::ArrayOfTables(tables)) => {
            tables.push(entries.map(|(key, new)| (key, value(new))).into_iter().collect())
        }
        Some(Item::Value(Value::Array(tables))) => tables.push(entries.into_iter().collect::<InlineTable>()),
        _ => {}
    }
}

/// Replaces the mask at a place of a patch's list, or adds it at the end. The other masks stay as they are.
fn set_mask(patch: &mut dyn TableLike, place: usize, mask: Value) {
    match patch.get_mut("holes_px") {
        Some(Item::Value(Value::Array(masks))) if place < masks.len() => {
            masks.replace(place, mask);
        }
        Some(Item::Value(Value::Array(masks))) => masks.push(mask),
        _ => replace(patch, "holes_px", Value::Array([mask].into_iter().collect())),
    }
}

/// Sets a value in a table, and keeps the comments around one that it replaces.
fn replace(table: &mut dyn TableLike, key: &str, mut new: Value) {
    if let Some(Item::Value(old)) = table.get_mut(key) {
        *new.decor_mut() = old.decor().clone();
        *old = new;
    } else {
        table.insert(key, value(new));
    }
}

impl ShapeKey {
    /// Returns the path of the value in the rig file, for people: `trigger.roi_px`, `polygon_px of body "target"`.
    pub fn path(&self) -> String {
        match self {
            Self::TriggerRegion => "trigger.roi_px".to_owned(),
            Self::SearchRegion(name) => format!("roi_px of body {name:?}"),
            Self::Polygon(name) => format!("polygon_px of body {name:?}"),
            Self::Mask(name, _) => format!("holes_px of body {name:?}"),
            Self::NewPatch(name) => format!("the new patch {name:?}"),
            Self::Edge => "surface.edge".to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "# A rig on the bench.\n[camera] # the old one\nsource = \"simulated\"\nwidth_px = 640\nheight_px = 480\n\n\
        [trigger]\nmode = \"motion\"\n# Above the hand.\nroi_px = [1, 2, 3, 4] # too small\n\n[surface]\nangle_deg = 0.0\n\n\
        [[body]]\nname = \"ball\"\n\n[[body]]\nname = \"target\"\nkind = \"patch\"\n\
        polygon_px = [[10, 10], [60, 10], [60, 60], [10, 60]] # by hand\n";

    fn draw(key: ShapeKey, points_px: &[Point]) -> Result<String, DrawingError> {
        let shape = Shape { key, points_px: points_px.to_vec() };
        Config::with_shape(FILE, "rig.toml", &shape, Some((640, 480))).map(|(text, config)| {
            assert_eq!(config.bodies.len(), 2);
            text
        })
    }

    #[test]
    fn a_shape_replaces_its_value_and_leaves_the_rest_of_the_file() {
        let cases: [(ShapeKey, &[Point], &str, &str); 4] = [
            (ShapeKey::TriggerRegion, &[[99.6, 50.0], [20.2, 10.0]], "[1, 2, 3, 4]", "[20, 10, 81, 41]"),
            (
                ShapeKey::Polygon("target".into()),
                &[[10.04, 20.0], [90.0, 20.0], [50.0, 99.96]],
                "[[10, 10], [60, 10], [60, 60], [10, 60]]",
                "[[10.0, 20.0], [90.0, 20.0], [50.0, 100.0]]",
            ),
            (
                ShapeKey::Edge,
                &[[0.0, 400.0], [639.0, 400.0]],
                "angle_deg = 0.0\n",
                "angle_deg = 0.0\nedge = [[0.0, 400.0], [639.0, 400.0]]\n",
            ),
            (
                ShapeKey::SearchRegion("ball".into()),
                &[[0.0, 0.0], [639.0, 479.0]],
                "name = \"ball\"\n",
                "name = \"ball\"\nroi_px = [0, 0, 640, 480]\n",
            ),
        ];
        for (key, points, old, new) in cases {
            assert_eq!(draw(key, points).unwrap(), FILE.replace(old, new));
        }
        let inner = [[20.0, 20.0], [40.0, 20.0], [40.0, 40.0]];
        let once = draw(ShapeKey::Mask("target".into(), 0), &inner).unwrap();
        assert!(once.ends_with("# by hand\nholes_px = [[[20.0, 20.0], [40.0, 20.0], [40.0, 40.0]]]\n"), "{once}");
        let masked = FILE.to_owned() + "holes_px = [\n  [[11.25, 11], [20, 11], [20, 20]], # the clamp\n]\n";
        let shape = Shape { key: ShapeKey::Mask("target".into(), 1), points_px: inner.to_vec() };
        let (twice, config) = Config::with_shape(&masked, "rig.toml", &shape, None).unwrap();
        assert!(twice.contains("  [[11.25, 11], [20, 11], [20, 20]], "), "{twice}");
        assert_eq!(config.bodies[1].patch.as_ref().unwrap().holes_px[1], inner);
    }

    #[test]
    fn a_file_without_a_body_gets_the_table_of_its_ball() {
        let shape = Shape { key: ShapeKey::SearchRegion("ball".into()), points_px: vec![[1.0, 2.0], [30.0, 40.0]] };
        let text = "[camera]\nsource = \"simulated\"\n# the end\n";
        let (text, config) = Config::with_shape(text, "rig.toml", &shape, None).unwrap();
        assert_eq!(config.bodies[0].roi_px, Some([1, 2, 30, 39]));
        assert!(text.contains("# the end") && text.contains("[[body]]\nroi_px = [1, 2, 30, 39]"), "{text}");
        assert_eq!(config.shapes()[0], shape);
    }

    #[test]
    fn a_new_patch_is_a_further_body_and_the_others_keep_their_names() {
        let corners = vec![[10.0, 20.0], [90.0, 20.0], [50.0, 99.96]];
        let shape = Shape { key: ShapeKey::NewPatch("plate".into()), points_px: corners };
        let add = |text: &str| Config::with_shape(text, "rig.toml", &shape, Some((640, 480)));
        let table = "[[body]]\nname = \"plate\"\nkind = \"patch\"\n\
                     polygon_px = [[10.0, 20.0], [90.0, 20.0], [50.0, 100.0]]\n";
        assert_eq!(add(FILE).unwrap().0, format!("{FILE}\n{table}"));
        let camera = "[camera]\nsource = \"simulated\"\n";
        for (bodies, named) in [
            ("", "\n[[body]]\nname = \"ball\"\n"),
            ("[[body]] # white\nmass_kg = 0.1\n", "[[body]] # white\nmass_kg = 0.1\nname = \"ball\"\n"),
        ] {
            let (text, config) = add(&format!("{camera}{bodies}")).unwrap();
            assert_eq!(text, format!("{camera}{named}\n{table}"));
            assert_eq!(config.bodies[0].name, "ball");
        }
        let (text, config) = add(&format!("body = [{{ kind = \"rod\" }}] # one line\n{camera}")).unwrap();
        assert!(text.starts_with("body = [{ kind = \"rod\" , name = \"rod\" }, { name = \"plate\", kind"), "{text}");
        assert_eq!((config.bodies.len(), config.bodies[1].name.as_str()), (2, "plate"));
        let again = add(&format!("{FILE}\n{table}")).unwrap_err().to_string();
        assert!(again.contains("different from the names of the bodies before it"), "{again}");
    }

    #[test]
    fn a_shape_that_does_not_fit_is_refused() {
        let patch = || ShapeKey::Polygon("target".into());
        let square = [[100.0, 100.0], [200.0, 100.0], [200.0, 200.0], [100.0, 200.0]];
        let crossed = [square[0], square[2], square[1], square[3]];
        let touching = [square[0], square[1], square[2], [150.0, 100.0], square[3]];
        let error = |key, points: &[Point]| draw(key, points).unwrap_err().to_string();
        assert_eq!(error(patch(), &crossed), "two sides of the polygon cross each other");
        assert_eq!(error(patch(), &touching), "two sides of the polygon cross each other");
        assert!(draw(patch(), &square).is_ok());
        assert!(error(patch(), &square[..2]).contains("but 2 were drawn"));
        assert!(
            error(patch(), &[square[0], [640.0, 0.0], square[2]])
                .contains("[640, 0] is outside the frame of 640 x 480")
        );
        assert!(error(patch(), &[[1.0, 1.0], [9.0, 1.0], [9.0, 9.0]]).contains("at least 150 px^2 large"));
        assert_eq!(error(ShapeKey::Polygon("no".into()), &square), "no body of the rig is named \"no\"");
        let foreign = error(ShapeKey::Polygon("ball".into()), &square);
        assert!(foreign.starts_with("rig.toml, line 17: body[0].polygon_px"), "{foreign}");
        assert_eq!(error(ShapeKey::Mask("target".into(), 0), &square), "the mask reaches beyond its patch");
        let steep = error(ShapeKey::Edge, &[[0.0, 0.0], [100.0, 100.0]]);
        assert!(steep.contains("within 2 deg of surface.angle_deg = 0, but is at -45.0 deg"), "{steep}");
    }

    #[test]
    fn shapes_are_those_that_the_kinds_and_the_trigger_have() {
        let keys = |text: &str| -> Vec<String> {
            Config::parse(text, "rig.toml").unwrap().shapes().iter().map(|shape| shape.key.path()).collect()
        };
        let all = [
            "trigger.roi_px",
            "roi_px of body \"ball\"",
            "polygon_px of body \"target\"",
            "holes_px of body \"target\"",
            "the new patch \"patch\"",
            "surface.edge",
        ];
        assert_eq!(keys(FILE), all);
        assert_eq!(keys(&FILE.replace("mode = \"motion\"", "mode = \"off\"").replace("roi_px = [1", "# [1")), all[1..]);
    }
}
