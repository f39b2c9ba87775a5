//! Statistics of one emotion and their file, so that different machines can compute different emotions.
//!
//! A part is identified by the content of everything it was computed from. `run` uses a matching part and computes a missing one; the
//! results are bitwise equal.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{AnalysisError, MADE_BY, Workbench};
use crate::{
    output::{OutputError, json_into, write_hashed},
    statistics::{
        self, ClassLabel, Representative, SequenceModel,
        bootstrap::{DispersionInterval, dispersion_interval},
        compare::{Comparisons, Strata, compare_groups, stream_of},
    },
};

/// Folder of the parts in the output folder of a divided run.
pub(super) const PARTS_FOLDER: &str = "parts";

/// One class of an emotion.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct ClassPart {
    pub representative: Representative,
    pub subjects: usize,
    pub interval: Option<DispersionInterval>,
}

/// Statistics of one emotion.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct EmotionPart {
    /// BLAKE3 of its inputs; empty until it is written.
    inputs_blake3: String,
    pub classes: Vec<ClassPart>,
    /// Comparisons without correction for the number of tests.
    pub comparisons: Comparisons,
}

/// Classes of one emotion, all its people first.
type Groups<'a> = [(ClassLabel, Vec<&'a SequenceModel>)];

impl EmotionPart {
    /// Computes the representatives, intervals and comparisons of one emotion.
    ///
    /// # Errors
    /// [`AnalysisError`] when the options are out of range.
    pub fn compute(
        emotion: &str,
        groups: &Groups<'_>,
        bench: &Workbench,
        strata: Option<&Strata>,
    ) -> Result<Self, AnalysisError> {
        let options = &bench.options;
        let live = bench.wireframe.live_nodes();
        let replicates = if options.by.is_empty() { 0 } else { options.groups.bootstrap };
        let class = |(label, models): &(ClassLabel, Vec<&SequenceModel>)| {
            let representative = statistics::representative(label.clone(), models, &bench.wireframe, &options.statistics)?;
            let seed = options.groups.compare.seed;
            let stream = stream_of(&[(emotion, &label.group)]);
            let interval = dispersion_interval(&representative, models, live, &options.statistics, replicates, (seed, stream));
            let subjects = models.iter().map(|m| m.id.subject.as_str()).collect::<BTreeSet<_>>().len();
            Ok(ClassPart { representative, subjects, interval })
        };
        let classes = groups.par_iter().map(class).collect::<Result<Vec<_>, AnalysisError>>()?;
        let comparisons = if options.by.is_empty() {
            Comparisons::default()
        } else {
            compare_groups(emotion, groups, live, &options.groups, strata)
        };
        Ok(Self { inputs_blake3: String::new(), classes, comparisons })
    }

    /// Writes the part for [`EmotionPart::read`].
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write(
        mut self,
        out: &Path,
        emotion: &str,
        groups: &Groups<'_>,
        bench: &Workbench,
        strata: Option<&Strata>,
    ) -> Result<blake3::Hash, OutputError> {
        self.inputs_blake3 = inputs_blake3(groups, bench, strata);
        write_hashed(&part_path(out, emotion), |writer| json_into(writer, &self))
    }

    /// Reads the part of exactly these models and options, if it exists.
    pub fn read(out: &Path, emotion: &str, groups: &Groups<'_>, bench: &Workbench, strata: Option<&Strata>) -> Option<Self> {
        let bytes = crate::input::read(&part_path(out, emotion)).ok()?;
        let part: Self = serde_json::from_slice(&bytes).ok()?;
        (part.inputs_blake3 == inputs_blake3(groups, bench, strata)).then_some(part)
    }
}

/// Name of a part's file in the output folder. Reading the dataset ensures that emotions are valid file names.
pub(super) fn part_name(emotion: &str) -> String {
    format!("{PARTS_FOLDER}/{emotion}.json")
}

fn part_path(out: &Path, emotion: &str) -> PathBuf {
    out.join(part_name(emotion))
}

fn inputs_blake3(groups: &Groups<'_>, bench: &Workbench, strata: Option<&Strata>) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    let options = &bench.options;
    part(MADE_BY.as_bytes());
    let chosen =
        (&options.normalize, &options.statistics, &options.groups, &options.by, &options.strata, &bench.wireframe_blake3);
    part(&serde_json::to_vec(&chosen).unwrap_or_default());
    for (label, models) in groups {
        part(&serde_json::to_vec(label).unwrap_or_default());
        for model in models {
            part(model.id.subject.as_bytes());
            let of_person = strata.map(|strata| strata.values(&model.id.subject)).unwrap_or_default();
            of_person.iter().for_each(|value| part(value.as_bytes()));
            part(model.id.sequence.as_bytes());
            let positions = model.model.frames().iter().flat_map(crate::model::FrameExpressionModel::nodes);
            let bytes: Vec<u8> = positions.flat_map(|p| [p.x.to_le_bytes(), p.y.to_le_bytes()]).flatten().collect();
            part(&bytes);
        }
    }
    hasher.finalize().to_hex().to_string()
}
