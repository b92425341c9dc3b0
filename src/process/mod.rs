//! The main loops, one file a role.
