//! `ricochet bindings`: the messages in shared memory as declarations of other languages.

use crate::console::{Outcome, print_line};
use crate::failure::Failure;
use crate::message::{EventKind, FieldKind, MessageLayout, Role, VelocityDatagram, layouts};
use crate::results::{BodyKind, ForceLaw, Phase, PointStatus};
use std::fmt::Write;

/// A language.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Language {
    /// A module for ctypes.
    Python,
    /// A header.
    C,
}

/// Prints the declarations.
///
/// # Errors
///
/// When standard output is closed.
pub fn run(language: Language) -> Result<Outcome, Failure> {
    let text = match language {
        Language::Python => python_module(),
        Language::C => c_header(),
    };
    print_line(text.trim_end());
    Ok(Outcome::Clean)
}

/// Returns the enumerations of the messages: name, then number and name of each value.
fn enumerations() -> Vec<(&'static str, Vec<(u32, &'static str)>)> {
    macro_rules! words {
        ($name:literal, $Enum:ident) => {
            ($name, $Enum::ALL.map(|word| (word as u32, word.as_str())).to_vec())
        };
    }
    vec![
        words!("STATUS", PointStatus),
        words!("PHASE", Phase),
        words!("EVENT", EventKind),
        words!("FORCE_LAW", ForceLaw),
        words!("ROLE", Role),
        words!("BODY_KIND", BodyKind),
        // The bits of the numbers in `known`.
        ("DATAGRAM_BIT", (0..).zip(VelocityDatagram::NUMBERS).collect()),
    ]
}

/// Returns the name of a message without its ending `Message`.
fn name_without_suffix(name: &str) -> &str {
    name.strip_suffix("Message").unwrap_or(name)
}

/// Returns the module with a ctypes structure for each message and a dictionary for each enumeration.
fn python_module() -> String {
    let mut text = String::from(
        "\"\"\"The messages of a rig in shared memory and its datagrams, made by `ricochet bindings python`.\"\"\"\n\nimport ctypes\n",
    );
    for layout in layouts() {
        let MessageLayout { name, type_name, size_bytes, alignment_bytes, fields } = layout;
        let _ = write!(text, "\n\nclass {}(ctypes.Structure):\n    _fields_ = [\n", name_without_suffix(name));
        for field in &fields {
            let _ = writeln!(text, "        (\"{}\", {}),", field.name, python_type(&field.kind));
        }
        let _ = write!(
            text,
            "    ]\n    SIZE_BYTES = {size_bytes}\n    ALIGNMENT_BYTES = {alignment_bytes}\n\n    @staticmethod\n    \
             def type_name():\n        return \"{type_name}\"\n"
        );
    }
    for (name, words) in enumerations() {
        let _ = write!(text, "\n\n{name} = {{\n");
        for (number, word) in words {
            let _ = writeln!(text, "    {number}: {word:?},");
        }
        text += "}\n";
    }
    text
}

/// Returns the type of a field in ctypes.
fn python_type(kind: &FieldKind) -> String {
    match kind {
        FieldKind::U8 => "ctypes.c_uint8".into(),
        FieldKind::U32 => "ctypes.c_uint32".into(),
        FieldKind::U64 => "ctypes.c_uint64".into(),
        FieldKind::F32 => "ctypes.c_float".into(),
        FieldKind::F64 => "ctypes.c_double".into(),
        FieldKind::Array(kind, count) => format!("{} * {count}", python_type(kind)),
        FieldKind::Message(name) => name_without_suffix(name).into(),
    }
}

/// Returns the header with a struct for each message, an enum for each enumeration, and assertions of their layout.
fn c_header() -> String {
    let mut text = String::from(
        "/* The messages of a rig in shared memory and its datagrams, made by `ricochet bindings c`. */\n#ifndef RICOCHET_H\n#define \
         RICOCHET_H\n\n#include <assert.h>\n#include <stddef.h>\n#include <stdint.h>\n\n#ifdef __cplusplus\nextern \"C\" \
         {\n#endif\n",
    );
    for layout in layouts() {
        let MessageLayout { name, type_name, size_bytes, fields, .. } = layout;
        let name = c_name(name);
        let _ = write!(text, "\n#define {}_TYPE_NAME \"{type_name}\"\ntypedef struct {{\n", name.to_uppercase());
        for field in &fields {
            let (kind, dimension) = c_type(&field.kind);
            let _ = writeln!(text, "    {kind} {}{dimension};", field.name);
        }
        let _ = writeln!(text, "}} {name}_t;\nstatic_assert(sizeof({name}_t) == {size_bytes}, \"layout\");");
        if let Some(last) = fields.last() {
            let (field, offset) = (last.name, last.offset_bytes);
            let _ = writeln!(text, "static_assert(offsetof({name}_t, {field}) == {offset}, \"layout\");");
        }
    }
    for (name, words) in enumerations() {
        let _ = write!(text, "\nenum {{\n");
        for (number, word) in words {
            let word: String =
                word.chars().map(|c| if c.is_alphanumeric() { c.to_ascii_uppercase() } else { '_' }).collect();
            let _ = writeln!(text, "    RICOCHET_{name}_{word} = {number},");
        }
        text += "};\n";
    }
    text + "\n#ifdef __cplusplus\n}\n#endif\n\n#endif\n"
}

/// Returns the name of a struct in C: `ricochet_field_header` for `FieldHeader`.
fn c_name(name: &str) -> String {
    let mut words = String::from("ricochet");
    for letter in name_without_suffix(name).chars() {
        if letter.is_uppercase() {
            words.push('_');
        }
        words.push(letter.to_ascii_lowercase());
    }
    words
}

/// Returns the type of a field in C, and the dimension that follows its name.
fn c_type(kind: &FieldKind) -> (String, String) {
    match kind {
        FieldKind::U8 => ("uint8_t".into(), String::new()),
        FieldKind::U32 => ("uint32_t".into(), String::new()),
        FieldKind::U64 => ("uint64_t".into(), String::new()),
        FieldKind::F32 => ("float".into(), String::new()),
        FieldKind::F64 => ("double".into(), String::new()),
        FieldKind::Array(kind, count) => {
            let (kind, inner) = c_type(kind);
            (kind, format!("[{count}]{inner}"))
        }
        FieldKind::Message(name) => (format!("{}_t", c_name(name)), String::new()),
    }
}
