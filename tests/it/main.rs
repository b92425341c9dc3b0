//! The integration tests, in one binary.

mod fake_gige;
mod genicam;
mod slots;
