//! FAP values over time: frames and sequences.

use super::catalog::FapNumber;

/// FAP values of one frame: absolute offsets from neutral. A FAP without a value is masked out.
///
/// ```
/// use grimace::fap::{FapFrame, FapNumber};
///
/// let (jaw, mut frame) = ("3".parse()?, FapFrame::default());
/// frame.set_value(jaw, Some(512.0));
/// assert_eq!(frame.value(jaw), Some(512.0));
/// // FAPs 1 and 2 are codes: they have fields, and no value.
/// frame.set_fields(FapNumber::EXPRESSION, Some(vec![1, 40, 0, 0, 0, 0]));
/// assert!(frame.value(FapNumber::EXPRESSION).is_none() && frame.is_set(FapNumber::EXPRESSION));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FapFrame {
    values: [Option<f64>; FapNumber::COUNT],
    /// Fields of FAPs 1 and 2.
    fields: [Option<Vec<i32>>; 2],
}

impl Default for FapFrame {
    /// A frame with every FAP masked out.
    fn default() -> Self {
        Self { values: [None; FapNumber::COUNT], fields: [None, None] }
    }
}

impl FapFrame {
    /// Value of a low-level FAP (3 to 68) in its unit; `None` when masked out, and for FAPs 1 and 2.
    pub fn value(&self, fap: FapNumber) -> Option<f64> {
        self.values[fap.index()]
    }

    /// Sets or masks out a low-level FAP. FAPs 1 and 2 have [`fields`](Self::fields) instead of a value and are not changed.
    pub fn set_value(&mut self, fap: FapNumber, value: Option<f64>) {
        if !fap.is_high_level() {
            self.values[fap.index()] = value;
        }
    }

    /// The integers of FAP 1 (4, or 1 from old writers) or FAP 2 (6 or 1); `None` when masked out, and for other FAPs.
    pub fn fields(&self, fap: FapNumber) -> Option<&[i32]> {
        self.fields.get(fap.index())?.as_deref()
    }

    /// Sets or masks out FAP 1 or 2. Other FAPs have no fields and are not changed.
    pub fn set_fields(&mut self, fap: FapNumber, fields: Option<Vec<i32>>) {
        if let Some(slot) = self.fields.get_mut(fap.index()) {
            *slot = fields;
        }
    }

    /// Whether the FAP has a value or fields.
    pub fn is_set(&self, fap: FapNumber) -> bool {
        self.value(fap).is_some() || self.fields(fap).is_some()
    }
}

/// A FAP file in memory.
///
/// ```
/// use grimace::fap::{FapFrame, FapSequence};
///
/// let (jaw, mut frames) = ("3".parse()?, vec![FapFrame::default(); 2]);
/// frames[0].set_value(jaw, Some(0.0));
/// frames[1].set_value(jaw, Some(1024.0));
/// let sequence = FapSequence { version: "2.1".to_owned(), name: "jaw".to_owned(), fps: 25.0, frames };
/// assert_eq!((sequence.set_faps(), sequence.seconds()), (vec![jaw], 0.08));
/// let slower = sequence.with_frames_between(1)?;
/// assert_eq!(slower.frames[1].value(jaw), Some(512.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FapSequence {
    /// Version of the format, `2.0`, `2.1` or `2.2`.
    pub version: String,
    /// Name from the header.
    pub name: String,
    /// Frames per second, positive.
    pub fps: f64,
    /// The frames in order, numbered from 0.
    pub frames: Vec<FapFrame>,
}

/// Version written to files.
pub(super) const VERSION: &str = "2.1";

/// Longest name that every reader accepts, characters.
pub(super) const NAME_MAX: usize = 100;

impl FapSequence {
    /// FAPs that any frame sets, ascending.
    pub fn set_faps(&self) -> Vec<FapNumber> {
        FapNumber::all().filter(|&fap| self.frames.iter().any(|frame| frame.is_set(fap))).collect()
    }

    /// FAPs that have a value other than 0 in any frame, ascending.
    pub(crate) fn moving_faps(&self) -> Vec<FapNumber> {
        let some = |value: Option<f64>| value.is_some_and(|v| v != 0.0);
        let moves = |frame: &FapFrame, fap: FapNumber| {
            some(frame.value(fap)) || frame.fields(fap).is_some_and(|fields| fields.iter().any(|&v| v != 0))
        };
        FapNumber::all().filter(|&fap| self.frames.iter().any(|frame| moves(frame, fap))).collect()
    }

    /// Duration in seconds: number of frames divided by frame rate.
    pub fn seconds(&self) -> f64 {
        self.frames.len() as f64 / self.fps
    }

    /// Rounds every value to the nearest integer, halves away from zero; returns the number of changed values.
    pub fn round(&mut self) -> usize {
        let mut changed = 0;
        for value in self.frames.iter_mut().flat_map(|frame| frame.values.iter_mut()).flatten() {
            let rounded = value.round() + 0.0; // -0 becomes 0
            changed += usize::from(rounded != *value);
            *value = rounded;
        }
        changed
    }
}

/// Converts a name to one token that every reader of FAP files accepts: ASCII without blanks, 1 to 100 characters, not starting
/// with `#`. Other characters become `_`.
///
/// ```
/// assert_eq!(grimace::internal::fap::name_token("joy (young)"), "joy_(young)");
/// ```
pub fn name_token(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_graphic() { c } else { '_' };
    let mut token: String = name.chars().take(NAME_MAX).map(plain).collect();
    if token.is_empty() {
        token.push('_');
    }
    if token.starts_with('#') {
        token.replace_range(..1, "_");
    }
    token
}

/// Whether a name is a token in the sense of `name_token`.
pub(super) fn is_name_token(name: &str) -> bool {
    name_token(name) == name
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_tokens() {
        assert_eq!(name_token("a b\tc"), "a_b_c");
        assert_eq!(name_token("#1"), "_1");
        assert_eq!(name_token(""), "_");
        assert_eq!(name_token("é"), "_");
        assert_eq!(name_token(&"x".repeat(200)).len(), 100);
        assert!(is_name_token("happiness") && !is_name_token("very happy") && !is_name_token(&"x".repeat(101)));
    }

    #[test]
    fn low_and_high_level_faps_are_kept_apart() {
        let (viseme, jaw) = (FapNumber::VISEME, FapNumber::try_from(3).unwrap());
        let mut frame = FapFrame::default();
        frame.set_value(viseme, Some(1.0));
        frame.set_fields(jaw, Some(vec![1]));
        assert_eq!(frame, FapFrame::default());
        frame.set_value(jaw, Some(5.0));
        frame.set_fields(viseme, Some(vec![1, 0, 63, 0]));
        assert!(frame.is_set(jaw) && frame.is_set(viseme) && !frame.is_set(FapNumber::EXPRESSION));
    }

    #[test]
    fn rounding_goes_to_the_nearest_integer_and_knows_no_minus_zero() {
        let fap = |n| FapNumber::try_from(n).unwrap();
        let mut frame = FapFrame::default();
        frame.set_value(fap(3), Some(-0.4));
        frame.set_value(fap(4), Some(2.5));
        frame.set_value(fap(5), Some(7.0));
        let mut sequence = FapSequence { version: VERSION.into(), name: "x".into(), fps: 25.0, frames: vec![frame] };
        assert_eq!(sequence.round(), 2);
        assert_eq!(sequence.frames[0].value(fap(4)), Some(3.0));
        assert!(sequence.frames[0].value(fap(3)).unwrap().is_sign_positive());
        assert_eq!(sequence.set_faps(), [fap(3), fap(4), fap(5)]);
        assert_eq!(sequence.seconds(), 0.04);
    }
}
