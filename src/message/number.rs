//! Numbers that may be missing.

use super::layout::described;
use iceoryx2::prelude::ZeroCopySend;

described! {
    "ricochet.Number.v1"
    /// A number that may be missing.
    ///
    /// # Examples
    ///
    /// ```
    /// use ricochet::message::Number;
    ///
    /// assert_eq!(Option::<f64>::from(Number { value: -1.69, known: 1 }), Some(-1.69));
    /// // A missing number is zero in memory, but not a measured zero.
    /// assert_eq!(Option::<f64>::from(Number::default()), None);
    /// ```
    #[derive(Debug, Clone, Copy, PartialEq, Default, ZeroCopySend)]
    #[repr(C)]
    pub struct Number {
        /// The number; 0 and meaningless unless `known` is 1.
        pub value: f64,
        /// 1 when the number was measured, 0 when it is missing.
        pub known: u64,
    }
}

impl From<Option<f64>> for Number {
    fn from(number: Option<f64>) -> Self {
        number.map_or_else(Self::default, |value| Self { value, known: 1 })
    }
}

impl From<Number> for Option<f64> {
    fn from(number: Number) -> Self {
        (number.known == 1).then_some(number.value)
    }
}
