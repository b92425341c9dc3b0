//! The features of a camera as lines of text.

use crate::results::named_enum;

/// One feature of a camera, or a category of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FeatureLine {
    /// Depth in the tree; the top categories have depth 0.
    pub depth: usize,
    /// GenICam name, as used under `features` in the configuration.
    pub name: String,
    /// Type.
    pub kind: FeatureKind,
    /// Present value; `None` if it cannot be read.
    pub value: Option<String>,
    /// Allowed values as text; empty if there is no range.
    pub allowed: String,
    /// Unit; empty if it has none.
    pub unit: String,
    /// Whether the feature can be written now.
    pub writable: bool,
}

named_enum! {
    /// The type of a feature.
    FeatureKind: "feature type" {
        /// A boolean.
        Boolean = 0 "boolean",
        /// One of several named entries.
        Enumeration = 1 "enumeration",
        /// A command to execute.
        Command = 2 "command",
        /// A group of features.
        Category = 3 "category",
        /// An integer in a range.
        Integer = 4 "integer",
        /// A real number in a range.
        Float = 5 "float",
        /// A text.
        Text = 6 "text",
    }
}
