//! Samples as JSON objects with the columns of their tables.

use crate::message::{Event, EventKind, ImpactMessage, VelocityMessage};
use crate::results::{Cell, Column, Impact, VelocitySample};
use serde_json::{Map, Value, json};

/// The names and the start that a row needs besides its message.
#[derive(Debug, Clone, Default)]
pub(super) struct RowContext {
    /// The names of the bodies, by index.
    pub(super) bodies: Vec<String>,
    /// The stamp of the stream's first frame, ns since the Unix epoch; `None` until it is known.
    pub(super) origin_ns: Option<u64>,
}

impl RowContext {
    /// Returns the name of a body as JSON; its index if it has no name.
    fn body_name(&self, index: u32) -> Value {
        self.bodies.get(index as usize).map_or_else(|| index.to_string().into(), |name| name.as_str().into())
    }

    /// Returns the time since the start of the stream, s, negative before it; `None` until the start is known.
    fn seconds(&self, stamp_ns: u64) -> Option<f64> {
        self.origin_ns.map(|origin_ns| (i128::from(stamp_ns) - i128::from(origin_ns)) as f64 / 1e9)
    }
}

/// Returns the cells of a row as JSON, each with the name of its column. A number that is missing, not finite or too
/// large for 64 bits is null.
pub fn json_cells<R>(row: &R, columns: &[Column<R>]) -> impl Iterator<Item = (&'static str, Value)> {
    let json = |cell| match cell {
        Cell::Integer(number) => i64::try_from(number).map_or(Value::Null, Value::from),
        Cell::Stamp(stamp_ns) => Value::from(stamp_ns),
        Cell::Double(number) => Value::from(number),
        Cell::Single(number) => Value::from(number),
        Cell::Text(text) => Value::from(text),
    };
    columns.iter().map(move |column| (column.heading.name, json((column.cell)(row))))
}

/// Returns a JSON object with these cells.
fn object(cells: impl IntoIterator<Item = (&'static str, Value)>) -> Map<String, Value> {
    cells.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// Returns a row of the `velocity` table; `None` when a name in it is unknown.
pub(super) fn velocity_row(message: &VelocityMessage, context: &RowContext) -> Option<Map<String, Value>> {
    let sample = message.sample()?;
    let place = [
        ("frame", json!(sample.frame)),
        ("body", context.body_name(sample.body)),
        ("stamp_ns", json!(sample.stamp_ns)),
        ("t_s", json!(context.seconds(sample.stamp_ns))),
    ];
    Some(object(place.into_iter().chain(json_cells(&sample, <VelocitySample as crate::results::Sample>::COLUMNS))))
}

/// Returns a row of the `impact` table with the number of the collision and of its revision; `None` when a name in it
/// is unknown.
pub(super) fn impact_row(message: &ImpactMessage, context: &RowContext) -> Option<Map<String, Value>> {
    let impact = message.impact()?;
    let place = [
        ("body", context.body_name(impact.body)),
        ("number", json!(impact.number)),
        ("revision", json!(impact.revision)),
        ("origin_ns", json!(impact.origin_ns)),
    ];
    Some(object(place.into_iter().chain(json_cells(&impact, &Impact::json_columns()))))
}

/// Returns a row of the `events` table; `None` when its kind is unknown.
pub(super) fn event_row(message: &Event, context: &RowContext) -> Option<Map<String, Value>> {
    let kind = message.kind().map(EventKind::as_str)?;
    Some(object([
        ("frame", json!(message.sequence)),
        ("stamp_ns", json!(message.stamp_ns)),
        ("t_s", json!(context.seconds(message.stamp_ns))),
        ("kind", json!(kind)),
        ("text", json!(message.text())),
    ]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_names_of_the_table_and_null_for_a_missing_number() {
        let context = RowContext { bodies: vec!["disc".into()], origin_ns: Some(1_000) };
        let message = VelocityMessage { sequence: 7, stamp_ns: 501_000, status: 7, ..VelocityMessage::default() };
        let row = velocity_row(&message, &context).unwrap();
        assert_eq!((&row["frame"], &row["body"], &row["t_s"]), (&json!(7), &json!("disc"), &json!(0.0005)));
        assert_eq!((&row["vn_m_s"], &row["status"]), (&Value::Null, &json!("lost")));
        assert_eq!(velocity_row(&VelocityMessage { status: 99, ..message }, &context), None);
    }
}
