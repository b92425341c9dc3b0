//! Layouts of the messages in shared memory, for bindings of other languages.

/// The type of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FieldKind {
    /// An unsigned number of one byte.
    U8,
    /// An unsigned number of four bytes.
    U32,
    /// An unsigned number of eight bytes.
    U64,
    /// A floating-point number of four bytes.
    F32,
    /// A floating-point number of eight bytes.
    F64,
    /// An array.
    Array(Box<FieldKind>, usize),
    /// Another message, by its name.
    Message(&'static str),
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LayoutField {
    /// The name.
    pub name: &'static str,
    /// The type.
    pub kind: FieldKind,
    /// The place from the start of the message, bytes.
    pub offset_bytes: usize,
}

/// The layout of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MessageLayout {
    /// The name of the type in Rust.
    pub name: &'static str,
    /// The versioned name that a service is opened with.
    pub type_name: &'static str,
    /// The size, bytes.
    pub size_bytes: usize,
    /// The alignment, bytes.
    pub alignment_bytes: usize,
    /// The fields, in their order.
    pub fields: Vec<LayoutField>,
}

/// A type that a field can have.
pub trait Field {
    /// Returns the type of the field in the layout.
    fn kind() -> FieldKind;
}

/// Implements [`Field`] for primitive types.
macro_rules! numbers {
    ($($type:ty: $kind:ident,)*) => {$(
        impl Field for $type {
            fn kind() -> FieldKind {
                FieldKind::$kind
            }
        }
    )*};
}

numbers! { u8: U8, u32: U32, u64: U64, f32: F32, f64: F64, }

impl<T: Field, const COUNT: usize> Field for [T; COUNT] {
    fn kind() -> FieldKind {
        FieldKind::Array(Box::new(T::kind()), COUNT)
    }
}

/// A message whose layout is described.
pub trait Described {
    /// Returns the layout.
    fn layout() -> MessageLayout;
}

/// Defines a message with its versioned name, and describes its layout.
macro_rules! described {
    ($type_name:tt $(#[$meta:meta])* pub struct $Message:ident {
        $($(#[$field_meta:meta])* pub $field:ident: $Type:ty,)*
    }) => {
        $(#[$meta])*
        #[type_name($type_name)]
        pub struct $Message { $($(#[$field_meta])* pub $field: $Type,)* }

        impl crate::message::layout::Described for $Message {
            fn layout() -> crate::message::layout::MessageLayout {
                use crate::message::layout::{Field, LayoutField, MessageLayout};
                MessageLayout {
                    name: stringify!($Message),
                    type_name: $type_name,
                    size_bytes: size_of::<$Message>(),
                    alignment_bytes: align_of::<$Message>(),
                    fields: vec![$(LayoutField {
                        name: stringify!($field),
                        kind: <$Type as Field>::kind(),
                        offset_bytes: std::mem::offset_of!($Message, $field),
                    },)*],
                }
            }
        }

        impl crate::message::layout::Field for $Message {
            fn kind() -> crate::message::layout::FieldKind {
                crate::message::layout::FieldKind::Message(stringify!($Message))
            }
        }
    };
}
pub(crate) use described;
