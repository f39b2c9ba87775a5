//! Strict writer of ASCII FAP files: the subset that every known reader accepts, and the extensions of individual readers.

use std::{fmt::Write as _, path::Path};

use super::{
    catalog::{FapCatalog, FapNumber},
    profile::Profile,
    sequence::{FapSequence, is_name_token},
};
use crate::output::{OutputError, write_hashed};

/// Format of the written values.
///
/// ```
/// use grimace::fap::{Profile, ValueFormat, read_fap, write_fap_as};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("smile.fap");
/// let sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence.with_frames_between(1)?;
/// write_fap_as(&path, &sequence, Profile::Xface, ValueFormat::Float)?;
/// assert_eq!(read_fap(&path)?.sequence.frames, sequence.frames);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ValueFormat {
    /// Decimal integers, which every reader accepts.
    #[default]
    Integer,
    /// The shortest decimal number that reads back as the same value.
    Float,
}

/// Largest frame rate: the limit of a reader with a 16-bit counter.
const FPS_MAX: f64 = 32_767.0;

/// Content of a sequence that cannot be written.
///
/// ```
/// use grimace::fap::{FapWriteError, FapWriteErrorKind, read_fap, write_fap};
///
/// let folder = tempfile::tempdir()?;
/// let mut sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// sequence.frames.clear();
/// let error = write_fap(&folder.path().join("smile.fap"), &sequence).unwrap_err();
/// assert!(matches!(error, FapWriteError::Content(FapWriteErrorKind::NoFrames)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FapWriteErrorKind {
    /// The name is not a token.
    #[error(
        "`{name}` is not a name that every reader accepts: use one ASCII word of 1 to 100 characters that does not start with #"
    )]
    Name {
        /// The name.
        name: String,
    },
    /// The frame rate is not an integer within 1 and 32767, or not the one that the profile's reader plays.
    #[error("cannot write {fps} frames per second: the {profile} profile needs {expected}; change the rate with --fps")]
    Fps {
        /// The frame rate.
        fps: f64,
        /// The profile of the file.
        profile: Profile,
        /// What the profile accepts.
        expected: &'static str,
    },
    /// There are no frames to write.
    #[error("there is no frame to write")]
    NoFrames,
    /// FAP 1 or 2 for a reader that may misread it, or not in the reader's form.
    #[error("frame {frame} sets FAP {fap} with {found} values, but the {profile} profile needs {expected}")]
    HighLevel {
        /// Frame index, from 0.
        frame: usize,
        /// FAP 1 or 2.
        fap: FapNumber,
        /// Number of values.
        found: usize,
        /// The profile of the file.
        profile: Profile,
        /// What the profile accepts.
        expected: String,
    },
    /// A value is not an integer, although integers are required.
    #[error("FAP {fap} of frame {frame} is {value}, which is not an integer: round it first")]
    NotInteger {
        /// Frame index, from 0.
        frame: usize,
        /// The FAP.
        fap: FapNumber,
        /// Its value.
        value: f64,
    },
    /// A value that is not finite or does not fit into 32 bits.
    #[error("FAP {fap} of frame {frame} is {value}, which no reader accepts: it must be finite and fit into 32 bits")]
    NotFinite {
        /// Frame index, from 0.
        frame: usize,
        /// The FAP.
        fap: FapNumber,
        /// Its value.
        value: f64,
    },
    /// Decimal numbers for a reader that cannot read them.
    #[error("the {profile} profile allows integers only: give --values integer")]
    Float {
        /// The profile of the file.
        profile: Profile,
    },
}

/// Error for a FAP file that was not written.
///
/// ```
/// use grimace::fap::{FapWriteError, read_fap, write_fap};
///
/// let folder = tempfile::tempdir()?;
/// let mut sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// sequence.name = "two words".to_owned();
/// let error = write_fap(&folder.path().join("smile.fap"), &sequence).unwrap_err();
/// assert!(matches!(error, FapWriteError::Content(_)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum FapWriteError {
    /// The sequence does not fit the format.
    #[error("cannot write a FAP file: {0}")]
    Content(#[from] FapWriteErrorKind),
    /// The file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Writes a FAP file that every known reader accepts, completely or not at all.
///
/// ```
/// use grimace::fap::{read_fap, write_fap};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("copy.fap");
/// let sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// write_fap(&path, &sequence)?;
/// assert_eq!(std::fs::read(&path)?, std::fs::read("fixtures/golden/fap/happiness.fap")?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`FapWriteError`] when a name, frame rate or value does not fit the strict subset, or the file cannot be written.
pub fn write_fap(path: &Path, sequence: &FapSequence) -> Result<blake3::Hash, FapWriteError> {
    write_fap_as(path, sequence, Profile::Strict, ValueFormat::Integer)
}

/// Writes a FAP file for the readers of a profile, completely or not at all; returns the BLAKE3 hash of its bytes.
///
/// ```
/// use grimace::fap::{Profile, ValueFormat, read_fap, write_fap_as};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("visage.fap");
/// let sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// write_fap_as(&path, &sequence, Profile::Visage, ValueFormat::Integer)?;
/// assert!(std::fs::read_to_string(&path)?.starts_with("2.2 happiness 25 25\n"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Same as [`write_fap`].
pub fn write_fap_as(
    path: &Path,
    sequence: &FapSequence,
    profile: Profile,
    values: ValueFormat,
) -> Result<blake3::Hash, FapWriteError> {
    let text = fap_text(sequence, profile, values)?;
    Ok(write_hashed(path, |writer| writer.write_all(text.as_bytes()))?)
}

/// Returns the text of a FAP file for the readers of a profile.
///
/// The version is that of the profile, not that of the sequence.
///
/// # Errors
/// [`FapWriteErrorKind`] when a name, frame rate or value does not fit the profile.
pub fn fap_text(sequence: &FapSequence, profile: Profile, values: ValueFormat) -> Result<String, FapWriteErrorKind> {
    let FapSequence { name, fps, frames, .. } = sequence;
    let (rules, fps) = (profile.rules(), *fps);
    if !is_name_token(name) {
        return Err(FapWriteErrorKind::Name { name: name.clone() });
    }
    if !(fps.fract() == 0.0 && (1.0..=FPS_MAX).contains(&fps)) {
        return Err(FapWriteErrorKind::Fps { fps, profile, expected: "an integer, 1 to 32767" });
    }
    if rules.fps.is_some_and(|only| fps != f64::from(only)) {
        return Err(FapWriteErrorKind::Fps { fps, profile, expected: "25" });
    }
    if values == ValueFormat::Float && !rules.floats {
        return Err(FapWriteErrorKind::Float { profile });
    }
    if frames.is_empty() {
        return Err(FapWriteErrorKind::NoFrames);
    }
    // Writing to a `String` does not fail, so the results of `write!` can be ignored.
    let mut text = String::with_capacity(frames.len() * 400);
    let _ = writeln!(text, "{} {name} {fps} {}", rules.version, frames.len());
    for (index, frame) in frames.iter().enumerate() {
        for fap in FapNumber::all() {
            text.push(if frame.is_set(fap) { '1' } else { '0' });
            if fap.index() + 1 < FapNumber::COUNT || rules.blank_after_mask {
                text.push(' ');
            }
        }
        text.push('\n');
        let _ = write!(text, "{index}");
        for fap in FapNumber::all() {
            if let Some(fields) = frame.fields(fap) {
                let expected = FapCatalog::mpeg4().fields(fap).len();
                if !rules.high_level || fields.len() != expected {
                    let expected = if rules.high_level { expected.to_string() } else { "none: leave it out".to_owned() };
                    let found = fields.len();
                    return Err(FapWriteErrorKind::HighLevel { frame: index, fap, found, profile, expected });
                }
                for field in fields {
                    let _ = write!(text, " {field}");
                }
            }
            let Some(value) = frame.value(fap) else { continue };
            if value.is_nan() || value.abs() > f64::from(i32::MAX) {
                return Err(FapWriteErrorKind::NotFinite { frame: index, fap, value });
            }
            if values == ValueFormat::Integer && value.fract() != 0.0 {
                return Err(FapWriteErrorKind::NotInteger { frame: index, fap, value });
            }
            let _ = write!(text, " {}", value + 0.0); // -0 becomes 0; an integral f64 prints without a point
        }
        text.push('\n');
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{super::parser::parse_fap, *};
    use crate::fap::{FapFrame, Finding, Severity};

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    fn sequence(frames: Vec<FapFrame>) -> FapSequence {
        FapSequence { version: "2.1".into(), name: "joy".into(), fps: 25.0, frames }
    }

    fn frame(values: &[(u8, f64)]) -> FapFrame {
        let mut frame = FapFrame::default();
        for &(number, value) in values {
            frame.set_value(fap(number), Some(value));
        }
        frame
    }

    #[test]
    fn the_text_is_header_mask_and_values() {
        let text = fap_text(&sequence(vec![frame(&[(3, 7.0), (68, -2.0)])]), Profile::Strict, ValueFormat::Integer).unwrap();
        let mask = format!("0 0 1 {}1", "0 ".repeat(64));
        assert_eq!(text, format!("2.1 joy 25 1\n{mask}\n0 7 -2\n"));
    }

    #[test]
    fn what_a_reader_would_not_take_is_refused() {
        let refused = |change: fn(&mut FapSequence)| {
            let mut sequence = sequence(vec![frame(&[(3, 7.0)])]);
            change(&mut sequence);
            fap_text(&sequence, Profile::Strict, ValueFormat::Integer).unwrap_err().to_string()
        };
        assert!(refused(|s| s.name = "two words".into()).contains("`two words`"));
        assert!(refused(|s| s.fps = 29.97).contains("29.97"));
        assert!(refused(|s| s.fps = f64::NAN).contains("1 to 32767"));
        assert!(refused(|s| s.frames.clear()).contains("no frame"));
        assert!(refused(|s| s.frames[0].set_value(fap(5), Some(0.5))).contains("FAP 5 of frame 0 is 0.5"));
        assert!(refused(|s| s.frames[0].set_value(fap(5), Some(f64::NAN))).contains("NaN"));
        assert!(refused(|s| s.frames[0].set_value(fap(5), Some(3e9))).contains("3000000000"));
        assert!(refused(|s| s.frames[0].set_fields(fap(1), Some(vec![1]))).contains("FAP 1"));
        let s = sequence(vec![frame(&[(3, 7.0)])]);
        assert!(fap_text(&s, Profile::Strict, ValueFormat::Float).unwrap_err().to_string().contains("integers only"));
        assert!(fap_text(&FapSequence { fps: 10.0, ..s }, Profile::Greta, ValueFormat::Integer).is_err());
    }

    #[test]
    fn a_file_that_can_not_be_written_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let blocked = folder.path().join("file");
        std::fs::write(&blocked, b"").unwrap();
        let error = write_fap(&blocked.join("x.fap"), &sequence(vec![frame(&[])])).unwrap_err();
        assert!(matches!(error, FapWriteError::Output(_)), "{error}");
    }

    prop_compose! {
        /// Generates a sequence with one mask in all frames and integer values.
        fn any_sequence()(
            mask in prop::collection::vec(any::<bool>(), 66),
            frames in 1_usize..6,
            fps in 1_u16..=32_767,
            name in "[!-~]{1,100}",
        )(
            values in prop::collection::vec(prop::collection::vec(-4000_i32..4000, 66), frames),
            mask in Just(mask),
            fps in Just(fps),
            name in Just(crate::fap::name_token(&name)),
        ) -> FapSequence {
            let frames = values.iter().map(|values| {
                let mut frame = FapFrame::default();
                for ((fap, &set), &value) in FapNumber::low_level().zip(&mask).zip(values) {
                    frame.set_value(fap, set.then_some(f64::from(value)));
                }
                frame
            });
            FapSequence { version: "2.1".into(), name, fps: f64::from(fps), frames: frames.collect() }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn write_then_read_is_identity_without_a_finding(sequence in any_sequence()) {
            let text = fap_text(&sequence, Profile::Strict, ValueFormat::Integer).unwrap();
            let file = parse_fap(text.as_bytes()).into_file().unwrap();
            prop_assert_eq!(file.findings, Vec::<Finding>::new());
            prop_assert_eq!(file.sequence, sequence);
        }

        #[test]
        fn floats_and_compound_faps_survive_the_xface_profile(
            mut sequence in any_sequence(),
            value in -1e9..1e9,
            viseme in prop::option::of(prop::collection::vec(0..15_i32, 4)),
            expression in prop::option::of(prop::collection::vec(0..7_i32, 6)),
        ) {
            sequence.frames[0].set_value(fap(9), Some(value));
            sequence.frames[0].set_fields(fap(1), viseme);
            sequence.frames[0].set_fields(fap(2), expression);
            let text = fap_text(&sequence, Profile::Xface, ValueFormat::Float).unwrap();
            let file = parse_fap(text.as_bytes()).into_file().unwrap();
            prop_assert!(file.findings.iter().all(|f| f.severity == Severity::Warning));
            prop_assert_eq!(file.sequence, sequence);
        }

        #[test]
        fn the_reader_survives_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            let parsed = parse_fap(&bytes);
            prop_assert!(parsed.findings.iter().all(|f| f.line >= 1));
            let _ = parsed.into_file();
        }

        #[test]
        fn the_reader_survives_a_mutated_file(
            sequence in any_sequence(),
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>(), 0..3_u8), 1..12),
        ) {
            let mut bytes = fap_text(&sequence, Profile::Strict, ValueFormat::Integer).unwrap().into_bytes();
            for (place, byte, kind) in edits {
                let k = place.index(bytes.len());
                match kind {
                    0 => bytes[k] = byte,
                    1 => bytes.insert(k, byte),
                    _ => bytes.truncate(k.max(1)),
                }
            }
            // Everything that can be read can be written again after rounding, except for names that the bytes may have damaged.
            if let Ok(mut file) = parse_fap(&bytes).into_file() {
                file.sequence.round();
                file.sequence.name = crate::fap::name_token(&file.sequence.name);
                file.sequence.fps = 25.0;
                for frame in &mut file.sequence.frames {
                    frame.set_fields(fap(1), None);
                    frame.set_fields(fap(2), None);
                }
                prop_assert!(fap_text(&file.sequence, Profile::Strict, ValueFormat::Integer).is_ok());
            }
        }
    }
}
