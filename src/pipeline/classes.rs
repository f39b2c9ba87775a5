//! Classes as results: their FAPs, the names of their files, and what a person should know before using them.

use std::collections::BTreeSet;

use super::{AnalysisError, AnalyzedClass, FapOptions, Workbench};
use crate::{
    fap::{Clamped, FapCatalog, FapSequence},
    output::listed,
    statistics::{ClassLabel, Representative, bootstrap::DispersionInterval, scale::MANY_MODELS},
    wireframe::Fapus,
};

/// A representative with its FAPs.
pub(super) fn class(
    representative: Representative,
    stem: String,
    subjects: usize,
    interval: Option<DispersionInterval>,
    fapus: &Fapus,
    bench: &Workbench,
) -> Result<AnalyzedClass, AnalysisError> {
    let FapOptions { fps, between } = bench.options.fap;
    let (fap, clamped) = FapSequence::from_model(&representative.model, fapus, FapCatalog::mpeg4(), &stem, fps, between)?;
    Ok(AnalyzedClass { representative, stem, fap, clamped, subjects, interval })
}

/// Stem of a class's files, different from all `stems` so far.
pub(super) fn unique_stem(label: &ClassLabel, stems: &mut BTreeSet<String>) -> String {
    let mut stem = file_stem(&label.emotion);
    for (column, value) in &label.group {
        stem = format!("{stem}_{}-{}", file_stem(column), file_stem(value));
    }
    let stem: String = stem.chars().take(MAX_STEM).collect();
    let mut unique = stem.clone();
    for number in 2.. {
        if stems.insert(unique.clone()) {
            break;
        }
        unique = format!("{stem}~{number}");
    }
    unique
}

/// Longest stem of a file name, characters: the file systems in use allow 255 bytes.
const MAX_STEM: usize = 60;

/// Sequences below which a representative says little.
const SMALL_CLASS: usize = 5;

/// FAP units by which a value is changed before a person need be told.
const NOTABLE_CLAMP: f64 = 20.0;

/// Most classes that a warning names.
const MOST_NAMED: usize = 12;

/// What a person should know before using the results: at most one line of each kind.
pub(super) fn warnings(classes: &[AnalyzedClass]) -> Vec<String> {
    let mut warnings = Vec::new();
    let counted = |few: &dyn Fn(usize) -> bool| -> Vec<String> {
        let chosen = classes.iter().map(|c| (&c.stem, c.representative.sequences.len())).filter(|&(_, n)| few(n));
        chosen.map(|(stem, n)| if n == 1 { stem.clone() } else { format!("{stem} ({n})") }).collect()
    };
    let single = counted(&|n| n == 1);
    if !single.is_empty() {
        let list = listed(&single, MOST_NAMED);
        warnings.push(format!("a single sequence is its own representative and has no dispersion: {list}"));
    }
    let small = counted(&|n| n > 1 && n < SMALL_CLASS);
    if !small.is_empty() {
        let list = listed(&small, MOST_NAMED);
        warnings.push(format!("fewer than {SMALL_CLASS} sequences say little about anybody else: {list}"));
    }
    let many: Vec<String> = classes
        .iter()
        .filter(|c| c.representative.sequences.len() > MANY_MODELS)
        .map(|c| format!("{} ({})", c.stem, c.representative.sequences.len()))
        .collect();
    if !many.is_empty() {
        let list = listed(&many, MOST_NAMED);
        warnings
            .push(format!("more than {MANY_MODELS} sequences: the exact median, no greedy one, and certified trimming: {list}"));
    }
    let undecided: usize = classes.iter().filter_map(|c| c.representative.certificate.as_ref()).map(|c| c.undecided.len()).sum();
    if undecided > 0 {
        warnings.push(format!(
            "rounding does not tell which of {undecided} sequences to trim, see `trimming_certificate` in representatives/*.json"
        ));
    }
    let much = |c: &&Clamped| (c.value - f64::from(c.limit)).abs() >= NOTABLE_CLAMP;
    let clamped: BTreeSet<u8> = classes.iter().flat_map(|c| c.clamped.iter().filter(much).map(|c| c.fap.get())).collect();
    if !clamped.is_empty() {
        let list = clamped.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        warnings.push(format!(
            "values outside the standard's range were clamped, see `clamped` in representatives/*.json: FAP {list}"
        ));
    }
    warnings
}

/// Text that is safe in a file name on any system: letters, digits, `.`, `-`; everything else becomes `-`.
fn file_stem(text: &str) -> String {
    let safe = |c: char| if c.is_alphanumeric() || c == '.' || c == '-' || c == '_' { c } else { '-' };
    let stem: String = text.trim().chars().map(safe).collect();
    let stem = stem.trim_start_matches('.');
    if stem.is_empty() { "none".to_owned() } else { stem.to_owned() }
}
