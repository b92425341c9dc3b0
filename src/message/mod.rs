//! What crosses a process border: fixed-size `repr(C)` values with versioned names.
