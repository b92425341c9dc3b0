//! Descriptions of the tables and keys of the rig file.

use serde_json::{Map, Value, json};
use std::collections::BTreeMap;

/// A table of the rig file.
#[derive(Debug, Clone, Copy)]
pub struct Section {
    /// The name.
    pub path: &'static str,
    pub(super) about: &'static str,
    /// The keys, in the order of the reference.
    pub keys: &'static [Key],
}

/// A key of the rig file.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// The name within its table.
    pub name: &'static str,
    /// The type of the value, in words.
    pub value: &'static str,
    /// The allowed values with their unit: the end of a sentence that begins with "must be".
    pub allowed: &'static str,
    /// The value of an absent key, in words.
    pub default: &'static str,
    pub(super) schema: fn() -> Value,
    pub(super) meaning: &'static str,
}

impl Section {
    /// Returns the header as it is written in the file.
    pub fn header(&self) -> String {
        if self.is_list() { format!("[[{}]]", self.path) } else { format!("[{}]", self.path) }
    }

    /// Returns the description in one paragraph.
    pub fn about(&self) -> String {
        one_line(self.about)
    }

    /// Whether the file may have several of this table.
    fn is_list(&self) -> bool {
        self.path == "body"
    }

    /// Returns the table as JSON.
    pub fn to_json(&self) -> Value {
        let keys: Vec<Value> = self.keys.iter().map(|key| key.to_json(self)).collect();
        json!({ "table": self.header(), "about": self.about(), "keys": keys })
    }

    /// Returns the JSON Schema of the table, with its keys and their ranges.
    pub(super) fn schema(&self) -> Value {
        let keys: Map<String, Value> = self.keys.iter().map(|key| (key.name.to_owned(), key.schema())).collect();
        let table = json!({
            "type": "object", "description": self.about(), "properties": keys, "additionalProperties": false,
        });
        if self.is_list() { json!({ "type": "array", "items": table, "minItems": 1, "maxItems": 16 }) } else { table }
    }
}

impl Key {
    /// Returns the description in one paragraph.
    pub fn meaning(&self) -> String {
        one_line(self.meaning)
    }

    /// Returns the key as JSON.
    pub fn to_json(&self, section: &Section) -> Value {
        json!({
            "key": format!("{}.{}", section.path, self.name), "type": self.value, "allowed": self.allowed,
            "default": self.default, "meaning": self.meaning(),
        })
    }

    /// Returns the lowest and the highest allowed number; `None` for keys of another type, and for numbers without
    /// limits.
    pub fn range(&self) -> Option<NumberRange> {
        if !matches!(self.value, "number" | "whole number") {
            return None;
        }
        let number = |text: &str| text.split(' ').next()?.parse().ok();
        match self.allowed.strip_prefix("above ") {
            Some(rest) => {
                let (low, high) = rest.split_once(" and at most ")?;
                Some(NumberRange { min: number(low)?, max: number(high)?, min_is_allowed: false })
            }
            None => {
                let (low, high) = self.allowed.split_once(" to ")?;
                Some(NumberRange { min: number(low)?, max: number(high)?, min_is_allowed: true })
            }
        }
    }

    /// Returns the allowed words; empty if the key is not limited to certain words.
    pub fn words(&self) -> Vec<&'static str> {
        let words: Option<Vec<&str>> =
            self.allowed.split(", ").map(|word| word.strip_prefix('"')?.strip_suffix('"')).collect();
        words.unwrap_or_default()
    }

    /// Returns the JSON Schema of the key: type, description, range and words.
    fn schema(&self) -> Value {
        let mut schema = (self.schema)();
        schema["description"] =
            format!("{} Must be {}. Default: {}.", self.meaning(), self.allowed, self.default).into();
        if let Some(NumberRange { min, max, min_is_allowed }) = self.range() {
            schema[if min_is_allowed { "minimum" } else { "exclusiveMinimum" }] = min.into();
            schema["maximum"] = max.into();
        }
        match self.words() {
            words if words.is_empty() => {}
            words => schema["enum"] = words.into(),
        }
        schema
    }
}

/// A range of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberRange {
    /// The lower end.
    pub min: f64,
    /// The upper end.
    pub max: f64,
    /// Whether the lower end itself is allowed.
    pub min_is_allowed: bool,
}

impl NumberRange {
    /// Whether a number lies within the range.
    pub fn contains(self, x: f64) -> bool {
        x <= self.max && (x > self.min || self.min_is_allowed && x >= self.min)
    }
}

/// Joins the lines of a text with single blanks.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A type of a value in the file.
pub(super) trait TomlType {
    /// The name in words.
    const NAME: &'static str;

    /// Returns the JSON Schema of a value of the type.
    fn schema() -> Value;
}

macro_rules! toml_types {
    ($($type:ty: $name:literal, $schema:expr;)*) => {$(
        impl TomlType for $type {
            const NAME: &'static str = $name;

            fn schema() -> Value {
                $schema
            }
        }
    )*};
}

toml_types! {
    String: "text", json!({ "type": "string" });
    bool: "yes or no", json!({ "type": "boolean" });
    i64: "whole number", json!({ "type": "integer" });
    f64: "number", json!({ "type": "number" });
    Vec<String>: "list of texts", list_of(String::schema());
    Vec<i64>: "list of whole numbers", list_of(i64::schema());
    Vec<f64>: "list of numbers", list_of(f64::schema());
    Vec<Vec<i64>>: "list of pairs", list_of(Vec::<i64>::schema());
    Vec<Vec<f64>>: "list of points", list_of(Vec::<f64>::schema());
    Vec<Vec<Vec<f64>>>: "list of lists of points", list_of(Vec::<Vec<f64>>::schema());
    BTreeMap<String, toml::Value>: "table", json!({ "type": "object" });
}

/// Returns the JSON Schema of a list.
fn list_of(items: Value) -> Value {
    json!({ "type": "array", "items": items })
}
