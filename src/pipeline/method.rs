//! Selects all options of a method together: the default, or that of the paper.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::PipelineOptions;
use crate::{
    fit::{FitOptions, PriorKind},
    normalize::{IrisdMode, NormalizeOptions, PoseMode},
    output::listed,
    statistics::{MedianKind, StatisticsOptions, TrimLevel, Weighting},
    track::{AlignOptions, Forces, TrackOptions},
};

/// Sets all options in which the default differs from \[KP\]. `docs/method.md` has a row for each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The default of every option.
    #[default]
    Default,
    /// Exactly as in \[KP\].
    Kp,
}

impl Method {
    /// Options of the fit. \[KP\]: similarity and springs, without a shape prior, by the marks alone.
    pub fn fit(self) -> FitOptions {
        match self {
            Self::Default => FitOptions::default(),
            Self::Kp => FitOptions { prior: PriorKind::None, read_unmarked: false, ..FitOptions::default() },
        }
    }

    /// Options of the tracker. \[KP\]: forward KLT only, one force for all nodes, no alignment, no treatment of lips, eyes and lids.
    pub fn track(self) -> TrackOptions {
        let ours = TrackOptions::default();
        match self {
            Self::Default => ours,
            Self::Kp => TrackOptions {
                forward_backward: 0.0,
                forces: Forces::Same,
                lip_probes: false,
                rigid_eyes: false,
                even_light: false,
                read_lids: false,
                read_lips: false,
                locate_lost: false,
                align: AlignOptions { gain: 0.0, corners: 0.0, ..ours.align },
                ..ours
            },
        }
    }

    /// Options of the normalization. \[KP\]: only the head's roll is removed, and FAPUs are those of Candide-3's report.
    pub fn normalize(self) -> NormalizeOptions {
        match self {
            Self::Default => NormalizeOptions::default(),
            Self::Kp => NormalizeOptions { pose: PoseMode::Roll, irisd: IrisdMode::Boxes, ..NormalizeOptions::default() },
        }
    }

    /// Options of the statistics. \[KP\]: every sequence counts, including several of one person.
    pub fn statistics(self) -> StatisticsOptions {
        let ours = StatisticsOptions::default();
        match self {
            Self::Default => ours,
            Self::Kp => {
                StatisticsOptions { weighting: Weighting::Sequence, trim: TrimLevel::Frame, median: MedianKind::Greedy, ..ours }
            }
        }
    }

    /// Name of the method with these options: `default`, `kp`, or `changed` for neither.
    pub fn name_of(options: &PipelineOptions) -> &'static str {
        let is = |method: Self| {
            options.fit == method.fit()
                && options.track == method.track()
                && options.normalize == method.normalize()
                && options.statistics == method.statistics()
        };
        if is(Self::Default) {
            "default"
        } else if is(Self::Kp) {
            "kp"
        } else {
            "changed"
        }
    }
}

/// The method of these options in words: that of grimace or of Krinidis and Pitas, whichever is nearer, and the options that differ from it.
pub(super) fn method_in_words(options: &PipelineOptions) -> String {
    let differing = |method: Method| {
        let theirs = (method.fit(), method.track(), method.normalize(), method.statistics());
        let ours = (&options.fit, &options.track, &options.normalize, &options.statistics);
        let (mut found, name) = (Vec::new(), String::new());
        if let (Ok(theirs), Ok(ours)) = (serde_json::to_value(theirs), serde_json::to_value(ours)) {
            differences(&name, &theirs, &ours, &mut found);
        }
        found
    };
    let (default, kp) = (differing(Method::Default), differing(Method::Kp));
    let (name, differing) =
        if kp.len() < default.len() { ("method of Krinidis and Pitas", kp) } else { ("default method of grimace", default) };
    if differing.is_empty() { name.to_owned() } else { format!("{name}, but {}", listed(&differing, MOST_NAMED)) }
}

/// Most differing options that are named.
const MOST_NAMED: usize = 4;

/// Appends the options with different values, as name and value.
fn differences(name: &str, theirs: &Value, ours: &Value, found: &mut Vec<String>) {
    match (theirs, ours) {
        (Value::Object(theirs), Value::Object(ours)) => {
            for (key, value) in ours {
                differences(&key.replace('_', " "), theirs.get(key).unwrap_or(&Value::Null), value, found);
            }
        }
        (Value::Array(theirs), Value::Array(ours)) if theirs.len() == ours.len() => {
            theirs.iter().zip(ours).for_each(|(theirs, ours)| differences(name, theirs, ours, found));
        }
        _ if theirs != ours => found.push(match ours {
            Value::String(word) => format!("{name} {word}"),
            other => format!("{name} {other}"),
        }),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_method_in_words_names_the_options_that_differ() {
        let mut options = PipelineOptions::default();
        assert_eq!(method_in_words(&options), "default method of grimace");
        options.normalize.resample = crate::normalize::Resample::Linear;
        options.statistics.alpha = 0.25;
        assert_eq!(method_in_words(&options), "default method of grimace, but resample linear; alpha 0.25");
        let kp = Method::Kp;
        options = PipelineOptions { fit: kp.fit(), track: kp.track(), normalize: kp.normalize(), ..options };
        options.statistics = kp.statistics();
        assert_eq!(method_in_words(&options), "method of Krinidis and Pitas");
        options.track.lip_probes = true;
        assert_eq!(method_in_words(&options), "method of Krinidis and Pitas, but lip probes true");
    }

    #[test]
    fn options_say_which_method_they_are() {
        let of = |method: Method| PipelineOptions {
            fit: method.fit(),
            track: method.track(),
            normalize: method.normalize(),
            statistics: method.statistics(),
            ..PipelineOptions::default()
        };
        assert_eq!(Method::name_of(&PipelineOptions::default()), "default");
        assert_eq!(Method::name_of(&of(Method::Kp)), "kp");
        let mut changed = of(Method::Kp);
        changed.track.lip_probes = true;
        assert_eq!(Method::name_of(&changed), "changed");
    }
}
