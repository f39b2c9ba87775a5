//! Masks: selections of the FAPs that a file sets.

use std::{collections::BTreeSet, fmt, str::FromStr};

use super::{
    catalog::{FapNumber, ParseFapNumberError},
    sequence::FapSequence,
};

/// Selects the FAPs that are written.
///
/// ```
/// use grimace::fap::{FapMask, read_fap};
///
/// let mut sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// let lips: FapMask = "3-13".parse()?;
/// sequence.apply_mask(&lips);
/// assert_eq!((sequence.set_faps().len(), lips.to_string().as_str()), (11, "3-13"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum FapMask {
    /// All low-level FAPs, 3 to 68, and FAPs 1 and 2 if they are set.
    All,
    /// The FAPs that any frame sets.
    #[default]
    Set,
    /// The listed FAPs.
    List(BTreeSet<FapNumber>),
}

/// Error for a text that does not list FAPs.
///
/// ```
/// use grimace::fap::FapMask;
///
/// let error = "13-3".parse::<FapMask>().unwrap_err();
/// assert!(error.to_string().contains("13-3"), "{error}");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseMaskError {
    /// A FAP number is not within 1 and 68.
    #[error("{0}; expected `all`, `set` or a list such as `3-13,31-38`")]
    Number(#[from] ParseFapNumberError),
    /// A range ends before it begins.
    #[error("the range `{0}` runs backwards; write the smaller number first")]
    Backwards(String),
}

impl FromStr for FapMask {
    type Err = ParseMaskError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "all" => return Ok(Self::All),
            "set" => return Ok(Self::Set),
            _ => {}
        }
        let mut list = BTreeSet::new();
        for part in text.split(',') {
            let (from, to) = part.split_once('-').unwrap_or((part, part));
            let (from, to): (FapNumber, FapNumber) = (from.parse()?, to.parse()?);
            if from > to {
                return Err(ParseMaskError::Backwards(part.trim().to_owned()));
            }
            list.extend(FapNumber::all().filter(|fap| (from..=to).contains(fap)));
        }
        Ok(Self::List(list))
    }
}

impl fmt::Display for FapMask {
    /// Writes the mask in the form that can be parsed: `all`, `set`, or a list with ranges such as `3-13,15`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = match self {
            Self::All => return f.write_str("all"),
            Self::Set => return f.write_str("set"),
            Self::List(list) => list,
        };
        let mut runs: Vec<(u8, u8)> = Vec::new();
        for number in list.iter().map(|fap| fap.get()) {
            match runs.last_mut() {
                Some((_, to)) if *to + 1 == number => *to = number,
                _ => runs.push((number, number)),
            }
        }
        for (k, (from, to)) in runs.into_iter().enumerate() {
            let comma = if k == 0 { "" } else { "," };
            if from == to { write!(f, "{comma}{from}")? } else { write!(f, "{comma}{from}-{to}")? }
        }
        Ok(())
    }
}

impl FapSequence {
    /// Gives a value to every low-level FAP that some frames set and others do not; returns the number of new values.
    ///
    /// MPEG-4 leaves a FAP out of a frame to have the decoder interpolate it; 0 would be the neutral face. Between two frames that
    /// set it the value is linear in time. After the last of them it is held; before the first it is 0, with which a decoder starts. A
    /// FAP that no frame sets stays unset, and so do FAPs 1 and 2, which are codes.
    ///
    /// ```
    /// use grimace::fap::{FapFrame, FapSequence};
    ///
    /// let (jaw, mut frames) = ("3".parse()?, vec![FapFrame::default(); 4]);
    /// frames[0].set_value(jaw, Some(50.0));
    /// frames[2].set_value(jaw, Some(150.0));
    /// let mut sequence = FapSequence { version: "2.1".to_owned(), name: "jaw".to_owned(), fps: 25.0, frames };
    /// assert_eq!(sequence.fill_gaps(), 2);
    /// let values: Vec<_> = sequence.frames.iter().map(|frame| frame.value(jaw)).collect();
    /// assert_eq!(values, [50.0, 100.0, 150.0, 150.0].map(Some));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn fill_gaps(&mut self) -> usize {
        let mut filled = 0;
        for fap in FapNumber::low_level() {
            // The last frame that sets the FAP.
            let mut before: Option<(usize, f64)> = None;
            for index in 0..self.frames.len() {
                let Some(value) = self.frames[index].value(fap) else { continue };
                let (start, from, rise) = before.map_or((0, 0.0, 0.0), |(last, from)| (last + 1, from, value - from));
                let steps = (index + 1 - start) as f64;
                for (step, frame) in (1..).zip(&mut self.frames[start..index]) {
                    frame.set_value(fap, Some(from + rise * f64::from(step) / steps));
                }
                filled += index - start;
                before = Some((index, value));
            }
            if let Some((last, value)) = before {
                self.frames[last + 1..].iter_mut().for_each(|frame| frame.set_value(fap, Some(value)));
                filled += self.frames.len() - (last + 1);
            }
        }
        filled
    }

    /// Gives every frame the same mask. FAPs outside the mask are masked out. A low-level FAP of the mask that only some frames
    /// set is interpolated in the others ([`fill_gaps`](Self::fill_gaps)); one that no frame sets becomes 0. FAPs 1 and 2 have no
    /// such value: they stay unset.
    pub fn apply_mask(&mut self, mask: &FapMask) {
        self.fill_gaps();
        let set = self.set_faps();
        for fap in FapNumber::all() {
            let keep = match mask {
                FapMask::All => !fap.is_high_level() || set.contains(&fap),
                FapMask::Set => set.contains(&fap),
                FapMask::List(list) => list.contains(&fap),
            };
            for frame in &mut self.frames {
                frame.set_value(fap, keep.then(|| frame.value(fap).unwrap_or(0.0)));
                if !keep {
                    frame.set_fields(fap, None);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fap::FapFrame;

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    #[test]
    fn lists_and_ranges_parse() {
        let FapMask::List(list) = "3-5, 31".parse().unwrap() else { panic!("not a list") };
        assert_eq!(list.iter().map(|f| f.get()).collect::<Vec<_>>(), [3, 4, 5, 31]);
        assert_eq!(FapMask::List(list).to_string(), "3-5,31");
        assert_eq!("all".parse(), Ok(FapMask::All));
        assert_eq!("set".parse(), Ok(FapMask::Set));
        for bad in ["", "3-", "-3", "0", "69", "3-99", "3;4", "jaw"] {
            assert!(matches!(bad.parse::<FapMask>(), Err(ParseMaskError::Number(_))), "{bad}");
        }
        assert_eq!("9-3".parse::<FapMask>(), Err(ParseMaskError::Backwards("9-3".into())));
    }

    #[test]
    fn frames_that_leave_a_fap_out_are_interpolated() {
        // A smile of 0, 50, nothing, 150, 200; a jaw that only the frames 2 and 5 of 6 set; nothing in the last frame.
        let mut frames = vec![FapFrame::default(); 6];
        for (frame, value) in [(0, 0.0), (1, 50.0), (3, 150.0), (4, 200.0)] {
            frames[frame].set_value(fap(12), Some(value));
        }
        frames[1].set_value(fap(3), Some(-30.0));
        frames[4].set_value(fap(3), Some(60.0));
        frames[1].set_fields(fap(1), Some(vec![1, 0, 63, 0]));
        let mut sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames };
        let set = sequence.set_faps();
        assert_eq!(sequence.fill_gaps(), 2 + 4);
        let values = |number: u8| sequence.frames.iter().map(|frame| frame.value(fap(number)).unwrap()).collect::<Vec<_>>();
        assert_eq!(values(12), [0.0, 50.0, 100.0, 150.0, 200.0, 200.0]);
        assert_eq!(values(3), [0.0, -30.0, 0.0, 30.0, 60.0, 60.0]);
        assert_eq!(sequence.set_faps(), set);
        assert_eq!(sequence.frames.iter().filter(|frame| frame.is_set(fap(1))).count(), 1);
        assert_eq!(sequence.fill_gaps(), 0);
    }

    #[test]
    fn masks_become_equal_and_what_no_frame_sets_becomes_zero() {
        let mut frames = vec![FapFrame::default(), FapFrame::default()];
        frames[1].set_value(fap(5), Some(4.0));
        frames[1].set_value(fap(6), Some(1.0));
        frames[1].set_fields(fap(1), Some(vec![1, 0, 63, 0]));
        let sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames };
        let masked = |text: &str| {
            let mut masked = sequence.clone();
            masked.apply_mask(&text.parse().unwrap());
            masked
        };
        assert_eq!(masked("set").frames[0].value(fap(5)), Some(0.0));
        assert_eq!(masked("5,7").frames[0].value(fap(7)), Some(0.0));
        assert_eq!(masked("set").set_faps(), [fap(1), fap(5), fap(6)]);
        assert_eq!(masked("5,7").set_faps(), [fap(5), fap(7)]);
        assert_eq!(masked("5,7").frames[1].value(fap(5)), Some(4.0));
        assert_eq!(masked("all").set_faps().len(), 67);
    }
}
