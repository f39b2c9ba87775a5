//! Errors that several modules share, in one place for the facade.

pub use crate::{input::InputError, output::OutputError, plausible::Implausible, positions::PositionsError};
