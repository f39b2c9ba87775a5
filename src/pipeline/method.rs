//! Selects all options of a method together: the default, or that of the paper.

use serde::{Deserialize, Serialize};

use super::PipelineOptions;
use crate::{
    fit::{FitOptions, PriorKind},
    normalize::{IrisdMode, NormalizeOptions, PoseMode},
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

#[cfg(test)]
mod tests {
    use super::*;

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
