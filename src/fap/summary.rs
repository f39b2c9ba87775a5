//! Summary of a FAP sequence.

use serde::Serialize;

use super::{
    catalog::{FapCatalog, FapNumber},
    sequence::FapSequence,
};

/// Summary of one FAP over a sequence. Values are in the FAP's unit; `None` for FAPs 1 and 2, which have codes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FapSummary {
    /// Number, 1 to 68.
    pub fap: u8,
    /// Name in the standard.
    pub name: String,
    /// Unit of the values: `ENS/1024`, `1e-5 rad`, or `code`.
    pub unit: String,
    /// Smallest value.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Value farthest from neutral (0), with its sign.
    pub apex: Option<f64>,
    /// Index of the first frame with the apex value, from 0.
    pub apex_frame: Option<usize>,
}

/// Summary of a FAP sequence.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SequenceSummary {
    /// Name in the header.
    pub name: String,
    /// Version in the header.
    pub version: String,
    /// Frames per second.
    pub fps: f64,
    /// Number of frames.
    pub frames: usize,
    /// Duration in seconds: number of frames divided by frame rate.
    pub seconds: f64,
    /// Summaries of the FAPs that any frame sets, ascending.
    pub faps: Vec<FapSummary>,
}

impl FapSequence {
    /// Summarizes the sequence.
    pub(crate) fn summary(&self) -> SequenceSummary {
        SequenceSummary {
            name: self.name.clone(),
            version: self.version.clone(),
            fps: self.fps,
            frames: self.frames.len(),
            seconds: self.seconds(),
            faps: self.set_faps().into_iter().map(|fap| self.fap_summary(fap)).collect(),
        }
    }

    fn fap_summary(&self, fap: FapNumber) -> FapSummary {
        let row = FapCatalog::mpeg4().row(fap);
        let values = || self.frames.iter().enumerate().filter_map(|(k, frame)| Some((k, frame.value(fap)?)));
        // The first of equal values; `max_by` would return the last.
        let apex = values().reduce(|best, next| if next.1.abs() > best.1.abs() { next } else { best });
        FapSummary {
            fap: fap.get(),
            name: row.name.clone(),
            unit: row.unit_name(),
            min: values().map(|(_, value)| value).reduce(f64::min),
            max: values().map(|(_, value)| value).reduce(f64::max),
            apex: apex.map(|(_, value)| value),
            apex_frame: apex.map(|(frame, _)| frame),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fap::FapFrame;

    #[test]
    fn the_apex_is_the_first_value_farthest_from_neutral() {
        let fap = FapNumber::try_from(52).unwrap();
        let mut frames = vec![FapFrame::default(); 4];
        for (frame, value) in frames.iter_mut().zip([0.0, -9.0, 5.0, -9.0]) {
            frame.set_value(fap, Some(value));
        }
        frames[0].set_fields(FapNumber::VISEME, Some(vec![1, 0, 63, 0]));
        let sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames };
        let summary = sequence.summary();
        assert_eq!((summary.frames, summary.seconds), (4, 0.16));
        let [viseme, lip] = summary.faps.as_slice() else { panic!("{summary:?}") };
        assert_eq!((viseme.fap, viseme.unit.as_str(), viseme.apex), (1, "code", None));
        assert_eq!((lip.min, lip.max, lip.apex, lip.apex_frame), (Some(-9.0), Some(5.0), Some(-9.0), Some(1)));
        assert_eq!((lip.name.as_str(), lip.unit.as_str()), ("raise_b_midlip_o", "MNS/1024"));
    }
}
