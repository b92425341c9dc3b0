//! The one program: every role and every command.

fn main() {}
