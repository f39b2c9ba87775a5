//! Target readers of a file: what individual readers need or accept beyond the strict subset.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

use super::{
    catalog::{FapCatalog, FapNumber},
    interpolate::InterpolateError,
    sequence::{FapSequence, VERSION, name_token},
};

/// The reader that a file is written for.
///
/// ```
/// use grimace::fap::{Profile, read_fap};
///
/// let mut sequence = read_fap("fixtures/golden/fap/happiness.fap".as_ref())?.sequence;
/// sequence.fps = 50.0;
/// // Greta plays 25 frames per second, whatever the file says.
/// assert_eq!(Profile::Greta.fixed_fps(), Some(25));
/// assert_eq!(sequence.for_profile(Profile::Greta)?.frames.len(), 13);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Profile {
    /// Every known reader.
    #[default]
    Strict,
    /// Xface: accepts FAPs 1 and 2 in full and float values; copies between inner and outer lips if one of them is 0.
    Xface,
    /// Greta: always plays 25 frames per second, regardless of the header, and accepts only integers. Its C++ readers split a
    /// mask line at the blank after each flag, so they also need one after the last flag.
    Greta,
    /// The visage encoder: expects version 2.2, accepts FAPs 1 and 2 in full, and only integers.
    Visage,
}

/// Capabilities of a profile's readers.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::struct_excessive_bools)]
pub(super) struct Rules {
    /// Version in the header.
    pub(super) version: &'static str,
    /// Whether they accept float values.
    pub(super) floats: bool,
    /// Whether they accept FAPs 1 and 2, as 4 and 6 integers.
    pub(super) high_level: bool,
    /// The only supported frame rate; `None` for any.
    pub(super) fps: Option<u32>,
    /// Whether they need a blank after the last flag of a mask.
    pub(super) blank_after_mask: bool,
    /// Whether they replace a lip FAP that is 0 by its twin.
    mirrors_lips: bool,
}

impl Profile {
    /// All profiles, strict first.
    pub const ALL: [Self; 4] = [Self::Strict, Self::Xface, Self::Greta, Self::Visage];

    pub(super) fn rules(self) -> Rules {
        let strict =
            Rules { version: VERSION, floats: false, high_level: false, fps: None, blank_after_mask: false, mirrors_lips: false };
        match self {
            Self::Strict => strict,
            Self::Xface => Rules { floats: true, high_level: true, mirrors_lips: true, ..strict },
            Self::Greta => Rules { fps: Some(25), blank_after_mask: true, ..strict },
            Self::Visage => Rules { version: "2.2", high_level: true, ..strict },
        }
    }

    /// The only frame rate that the reader plays; `None` for any.
    pub fn fixed_fps(self) -> Option<u32> {
        self.rules().fps
    }

    /// Changes a sequence so that the profile's readers accept it, except for the frame rate; returns what was changed.
    ///
    /// FAPs 1 and 2 are masked out if the reader may misread them, and the name becomes a token. For Xface, a lip FAP that is
    /// masked out gets the value of its twin, as Xface itself would do. A lip FAP that is 0 while its twin moves becomes 1, a
    /// thousandth of the mouth-nose separation, so that Xface does not overwrite it.
    #[doc(hidden)]
    pub fn prepare(self, sequence: &mut FapSequence) -> Prepared {
        let rules = self.rules();
        let mut prepared = Prepared::default();
        let name = name_token(&sequence.name);
        if name != sequence.name {
            prepared.renamed = Some(std::mem::replace(&mut sequence.name, name));
        }
        let catalog = FapCatalog::mpeg4();
        for frame in &mut sequence.frames {
            for fap in [FapNumber::VISEME, FapNumber::EXPRESSION] {
                let takes = rules.high_level && frame.fields(fap).is_some_and(|f| f.len() == catalog.fields(fap).len());
                if frame.is_set(fap) && !takes {
                    frame.set_fields(fap, None);
                    prepared.dropped += 1;
                }
            }
            if !rules.mirrors_lips {
                continue;
            }
            for &(inner, outer) in catalog.lip_twins() {
                for (from, to) in [(outer, inner), (inner, outer)] {
                    let Some(value) = frame.value(from).filter(|&value| value != 0.0) else { continue };
                    match frame.value(to) {
                        None => {
                            frame.set_value(to, Some(value));
                            prepared.lips_copied += 1;
                        }
                        Some(0.0) => {
                            frame.set_value(to, Some(1.0));
                            prepared.lips_kept += 1;
                        }
                        Some(_) => {}
                    }
                }
            }
        }
        prepared
    }
}

impl FapSequence {
    /// Returns the sequence for the readers of a profile: at the frame rate that they play, prepared ([`Profile::prepare`]),
    /// values rounded.
    ///
    /// # Errors
    /// [`InterpolateError`] when the change of rate gives too many frames.
    pub fn for_profile(&self, profile: Profile) -> Result<Self, InterpolateError> {
        let fps = profile.fixed_fps().map_or(self.fps, f64::from);
        let mut sequence = if fps == self.fps { self.clone() } else { self.retimed(fps)? };
        profile.prepare(&mut sequence);
        sequence.round();
        Ok(sequence)
    }
}

/// Changes made by [`Profile::prepare`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Prepared {
    /// The original name, if it was changed to a token.
    pub renamed: Option<String>,
    /// Number of values of FAPs 1 and 2 masked out, summed over frames.
    pub dropped: usize,
    /// Number of lip values copied from their twins, summed over frames.
    pub lips_copied: usize,
    /// Number of lip values set to 1 so that the reader keeps them, summed over frames.
    pub lips_kept: usize,
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Strict => "strict",
            Self::Xface => "xface",
            Self::Greta => "greta",
            Self::Visage => "visage",
        })
    }
}

impl FromStr for Profile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let found = Self::ALL.into_iter().find(|profile| profile.to_string() == text);
        found.ok_or_else(|| format!("`{text}` is not a profile; choose strict, xface, greta or visage"))
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
    fn each_profile_prepares_what_its_readers_need() {
        let mut frame = FapFrame::default();
        frame.set_fields(fap(1), Some(vec![1, 0, 63, 0]));
        frame.set_fields(fap(2), Some(vec![1])); // an old tool's single value
        frame.set_value(fap(51), Some(40.0)); // 4, its twin, is masked out
        frame.set_value(fap(52), Some(40.0));
        frame.set_value(fap(5), Some(0.0)); // 0 beside a twin that moves
        let sequence = FapSequence { version: "2.1".into(), name: "a b".into(), fps: 25.0, frames: vec![frame] };
        let prepare = |profile: Profile| {
            let mut sequence = sequence.clone();
            let prepared = profile.prepare(&mut sequence);
            (sequence.frames[0].clone(), prepared)
        };
        let renamed = Some("a b".to_owned());
        let (strict, prepared) = prepare(Profile::Strict);
        assert_eq!(prepared, Prepared { renamed: renamed.clone(), dropped: 2, lips_copied: 0, lips_kept: 0 });
        assert!(!strict.is_set(fap(1)) && !strict.is_set(fap(4)) && strict.value(fap(5)) == Some(0.0));
        let (xface, prepared) = prepare(Profile::Xface);
        assert_eq!(prepared, Prepared { renamed: renamed.clone(), dropped: 1, lips_copied: 1, lips_kept: 1 });
        assert_eq!((xface.value(fap(4)), xface.value(fap(5)), xface.value(fap(52))), (Some(40.0), Some(1.0), Some(40.0)));
        assert!(xface.is_set(fap(1)) && !xface.is_set(fap(2)));
        assert_eq!(prepare(Profile::Visage).1, Prepared { renamed: renamed.clone(), dropped: 1, ..Prepared::default() });
        assert_eq!(prepare(Profile::Greta).1, Prepared { renamed, dropped: 2, ..Prepared::default() });
    }

    #[test]
    fn profiles_are_named() {
        for profile in Profile::ALL {
            assert_eq!(profile.to_string().parse(), Ok(profile));
        }
        assert!("maya".parse::<Profile>().unwrap_err().contains("strict, xface"));
    }
}
