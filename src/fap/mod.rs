//! MPEG-4 facial animation parameters (FAPs): the table of FAPs, their measurement, and their file formats.
//!
//! [`FapCatalog`] is the table of the 68 FAPs. `convert` is the only module that converts face units to FAP values and back
//! ([`FapSequence::from_model`], [`offsets_from_frame`]). `interpolate` inserts frames between key frames and changes the frame
//! rate. `reader`, `check`, `writer` and `tidy` are the file formats. A value is the offset from the neutral face in 1/1024 of
//! the FAP's unit (FAPU), or an angle in 1e-5 rad [MPEG-4].
// Values are integers stored as `f64`, so that float values of other writers are kept; exact comparison is intended.
#![allow(clippy::float_cmp)]

mod catalog;
mod check;
mod convert;
mod finding;
mod interpolate;
mod mask;
mod parser;
mod profile;
mod reader;
mod sequence;
mod summary;
mod tidy;
mod writer;

pub use catalog::{Directionality, FapCatalog, FapMotion, FapNumber, FapRow, ParseFapNumberError};
pub use check::{beyond_range, check_fap, check_lips};
pub(crate) use convert::{ANGLE_UNIT_RAD, FAP_UNITS_PER_FAPU};
pub use convert::{Clamped, ConvertError, measure_faps, offsets_from_frame, unlimited_faps};
pub use finding::{Finding, Rule, Severity};
pub use interpolate::InterpolateError;
pub(crate) use interpolate::MAX_FRAMES;
pub(crate) use interpolate::whole_rate;
pub use mask::FapMask;
pub use profile::Profile;
pub use reader::{FapFile, FapReadError, is_for_greta, read_fap, read_fap_bytes};
pub use sequence::{FapFrame, FapSequence, name_token};
pub use summary::{FapSummary, SequenceSummary};
pub use tidy::{read_tidy_csv, write_tidy_csv};
pub use writer::{FapWriteError, FapWriteErrorKind, ValueFormat, fap_text, write_fap, write_fap_as};
