//! Classes as results: their FAPs, the names of their files, and warnings about them.

use std::collections::{BTreeMap, BTreeSet};

use super::{AnalysisError, AnalyzedClass, FapOptions, UNLABELLED, Workbench};
use crate::{
    clone::NoSkin,
    fap::{Clamped, FapCatalog, FapSequence},
    output::{count, listed},
    statistics::{
        ClassLabel, Representative, SequenceLabels, StatisticsOptions, Weighting, abbreviations, bootstrap::DispersionInterval,
        is_missing, likely_emotion, near_twins, person_key, scale::MANY_MODELS, sequence_weights, spelling_key, synonyms,
        trimming::trimmed_count,
    },
    text::composed,
    units::SequenceId,
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
    let FapOptions { fps, between, .. } = bench.options.fap;
    let (fap, clamped) = FapSequence::from_model(&representative.model, fapus, FapCatalog::mpeg4(), &stem, fps, between)?;
    let skin = Err(NoSkin::NotCollected);
    Ok(AnalyzedClass { representative, stem, fap, clamped, subjects, interval, skin })
}

/// The class of all people of an emotion.
pub(super) fn whole_class<'a>(classes: &'a [AnalyzedClass], emotion: &str) -> Option<&'a AnalyzedClass> {
    classes.iter().find(|c| c.representative.label.emotion == emotion && c.representative.label.group.is_empty())
}

/// Stem of a class's files, distinct from all earlier `stems` on every file system.
pub(super) fn unique_stem(label: &ClassLabel, stems: &mut BTreeSet<String>) -> String {
    let mut stem = file_stem(&label.emotion);
    for (column, value) in &label.group {
        stem = format!("{stem}_{}-{}", file_stem(column), file_stem(value));
    }
    unique_name(&stem, stems)
}

/// A stem short enough for file systems, distinct from all earlier `stems` on every file system.
pub(super) fn unique_name(stem: &str, stems: &mut BTreeSet<String>) -> String {
    let stem: String = stem.chars().take(MAX_STEM).collect();
    let mut unique = stem.clone();
    for number in 2.. {
        if stems.insert(crate::dataset::name_key(&unique)) {
            break;
        }
        unique = format!("{stem}~{number}");
    }
    unique
}

/// Longest stem of a file name, characters: the file systems in use allow 255 bytes.
const MAX_STEM: usize = 60;

/// Number of people below which a representative is not meaningful.
const SMALL_CLASS: usize = 5;

/// Change of a value by clamping, in FAP units, from which a warning is given.
const NOTABLE_CLAMP: f64 = 20.0;

/// Most classes named in a warning.
const MOST_NAMED: usize = 12;

/// Number of sequences and people of a class, identified by the stem of its files.
pub(super) struct ClassSize<'a> {
    pub stem: &'a str,
    pub sequences: usize,
    pub people: usize,
}

/// Warnings about classes with few sequences or people.
pub(super) fn few_said(classes: &[ClassSize<'_>]) -> Vec<String> {
    let single: Vec<String> = classes.iter().filter(|c| c.sequences == 1).map(|c| c.stem.to_owned()).collect();
    let is_small = |c: &&ClassSize<'_>| c.sequences > 1 && c.people < SMALL_CLASS;
    let small: Vec<String> = classes.iter().filter(is_small).map(|c| format!("{} ({})", c.stem, c.people)).collect();
    let said = |what: String, named: &[String]| (!named.is_empty()).then(|| format!("{what}: {}", listed(named, MOST_NAMED)));
    let alone = said("a single sequence is its own representative and has no dispersion".to_owned(), &single);
    let few = said(format!("fewer than {SMALL_CLASS} people allow few conclusions about other people"), &small);
    alone.into_iter().chain(few).collect()
}

/// Warnings about the results, at most one of each kind.
pub(super) fn warnings(classes: &[AnalyzedClass], options: &StatisticsOptions) -> Vec<String> {
    let sizes =
        classes.iter().map(|c| ClassSize { stem: &c.stem, sequences: c.representative.sequences.len(), people: c.subjects });
    let mut warnings = few_said(&sizes.collect::<Vec<_>>());
    let counted_where = |chosen: &dyn Fn(&Representative) -> bool| -> Vec<String> {
        let chosen = classes.iter().filter(|c| chosen(&c.representative)).map(|c| (&c.stem, c.representative.sequences.len()));
        chosen.map(|(stem, n)| if n == 1 { stem.clone() } else { format!("{stem} ({n})") }).collect()
    };
    let held: Vec<String> = classes
        .iter()
        .filter_map(|c| {
            let (who, share) = heaviest_person(&c.representative, options.weighting)?;
            // With two people each has a share of one half, and another warning covers classes of two.
            let is_heavy = share > 0.5 + SHARE_ROUNDING || (c.subjects > 2 && share > 0.5 - SHARE_ROUNDING);
            (c.subjects > 1 && is_heavy).then(|| format!("{} ({who}, {:.0} %)", c.stem, share * 100.0))
        })
        .collect();
    if !held.is_empty() {
        let list = listed(&held, MOST_NAMED);
        warnings.push(format!(
            "one person has at least half of the weight after trimming, so that person dominates representative and dispersion: {list}"
        ));
    }
    let alpha = options.alpha;
    // People with small weights can be dropped where none of as many people with equal weights could.
    let is_untrimmed = |r: &Representative| {
        let n = r.sequences.len();
        n > 1 && if r.trimming.is_empty() { trimmed_count(alpha, n) == 0 } else { r.trimming.iter().all(|row| !row.dropped) }
    };
    let untrimmed = counted_where(&|r| alpha > 0.0 && !r.weighted && is_untrimmed(r));
    if !untrimmed.is_empty() {
        let list = listed(&untrimmed, MOST_NAMED);
        let least = (1.0 / alpha).ceil();
        warnings.push(format!("nothing was trimmed, because alpha {alpha} needs at least {least} sequences: {list}"));
    }
    let heavy = counted_where(&|r| alpha > 0.0 && r.weighted && is_untrimmed(r));
    if !heavy.is_empty() {
        let list = listed(&heavy, MOST_NAMED);
        warnings.push(format!(
            "nothing was trimmed, because the farthest sequence has more than {alpha} (alpha) of the weight of all people: {list}"
        ));
    }
    let weighted: Vec<String> = classes
        .iter()
        .filter(|c| c.representative.weighted)
        .map(|c| format!("{} ({} of {})", c.stem, c.representative.sequences.len(), c.subjects))
        .collect();
    if !weighted.is_empty() {
        let list = listed(&weighted, MOST_NAMED);
        warnings.push(format!(
            "people have different numbers of sequences; every person has equal weight (--weight sequence gives every sequence equal \
             weight): {list}"
        ));
    }
    let repeated: Vec<String> = classes
        .iter()
        .filter(|c| options.weighting == Weighting::Sequence && c.subjects < c.representative.sequences.len())
        .map(|c| format!("{} ({} of {})", c.stem, c.representative.sequences.len(), c.subjects))
        .collect();
    if !repeated.is_empty() {
        let list = listed(&repeated, MOST_NAMED);
        warnings.push(format!(
            "people with several sequences have more weight than others (--weight person gives every person equal \
             weight): {list}"
        ));
    }
    let many: Vec<String> = classes
        .iter()
        .filter(|c| c.representative.sequences.len() > MANY_MODELS)
        .map(|c| format!("{} ({})", c.stem, c.representative.sequences.len()))
        .collect();
    if !many.is_empty() {
        let list = listed(&many, MOST_NAMED);
        warnings
            .push(format!("more than {MANY_MODELS} sequences: computed the exact median only, and certified trimming: {list}"));
    }
    let undecided: usize = classes.iter().filter_map(|c| c.representative.certificate.as_ref()).map(|c| c.undecided.len()).sum();
    if undecided > 0 {
        warnings.push(format!(
            "because of rounding, it is undecided which of {undecided} sequences to trim; see `trimming_certificate` in representatives/*.json"
        ));
    }
    let much = |c: &&Clamped| (c.value - f64::from(c.limit)).abs() >= NOTABLE_CLAMP;
    let clamped: Vec<String> = classes
        .iter()
        .filter_map(|c| {
            let faps: BTreeSet<u8> = c.clamped.iter().filter(much).map(|c| c.fap.get()).collect();
            let list = faps.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            (!list.is_empty()).then(|| format!("FAP {list} of {}", c.stem))
        })
        .collect();
    if !clamped.is_empty() {
        let list = listed(&clamped, MOST_NAMED);
        warnings.push(format!(
            "values outside the range of the standard were clamped; see `clamped` in representatives/*.json: {list}"
        ));
    }
    warnings
}

/// Rounding tolerance for shares of weights.
const SHARE_ROUNDING: f64 = 1e-9;

/// The person with the largest share of the weight left by trimming in a displacement field, and that share.
fn heaviest_person(r: &Representative, weighting: Weighting) -> Option<(&str, f64)> {
    let weights = sequence_weights(&r.sequences, weighting).unwrap_or_else(|| vec![1.0; r.sequences.len()]);
    let weights: BTreeMap<&SequenceId, f64> = r.sequences.iter().zip(weights).collect();
    let weight = |id: &SequenceId| weights.get(id).copied().unwrap_or(0.0);
    // The rows are not kept if many models are trimmed.
    let of_field = |field: Option<usize>| {
        let mut people: BTreeMap<&str, f64> = BTreeMap::new();
        match field {
            None => r.sequences.iter().for_each(|id| *people.entry(&id.subject).or_default() += weight(id)),
            Some(field) => {
                let kept = r.trimming.iter().filter(|row| row.field == field && !row.dropped);
                kept.for_each(|row| *people.entry(&row.id.subject).or_default() += weight(&row.id));
            }
        }
        let total: f64 = people.values().sum();
        people.into_iter().map(|(who, weight)| (who, weight / total)).max_by(|a, b| a.1.total_cmp(&b.1))
    };
    let fields: BTreeSet<usize> = r.trimming.iter().map(|row| row.field).collect();
    let fields: Vec<Option<usize>> = if fields.is_empty() { vec![None] } else { fields.into_iter().map(Some).collect() };
    fields.into_iter().filter_map(of_field).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Warnings about labels that may be misspelt, and about people whose names may denote one person.
pub(super) fn spelling_warnings(labels: &[SequenceLabels<'_>], by: &[String]) -> Vec<String> {
    let mut twins: Vec<String> = Vec::new();
    let emotions: BTreeSet<&str> = labels.iter().map(|(_, emotion, _)| *emotion).collect();
    let words = synonyms(emotions.iter().copied());
    // `surprised` beside `surprise` is not a misspelling.
    let are_words = |a: &String, b: &String| words.iter().any(|words| words.contains(a) && words.contains(b));
    let is_word = |label: &str| words.iter().flatten().any(|word| *word == spelling_key(label));
    let emotion_twins = near_twins(emotions.iter().copied()).into_iter().filter(|(a, b)| !are_words(a, b));
    twins.extend(emotion_twins.map(|(a, b)| format!("emotion {a} and {b}")));
    for column in by {
        let values: BTreeSet<&str> = labels
            .iter()
            .filter_map(|(.., metadata)| metadata.get(column))
            .map(String::as_str)
            .filter(|v| !is_missing(v))
            .collect();
        let alike = near_twins(values.iter().copied()).into_iter().chain(abbreviations(values.iter().copied()));
        twins.extend(alike.map(|(a, b)| format!("{column} {a} and {b}")));
    }
    let subjects: BTreeSet<&str> = labels.iter().map(|(id, ..)| id.subject.as_str()).collect();
    let mut spelled: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    subjects.into_iter().for_each(|subject| spelled.entry(person_key(subject)).or_default().push(subject));
    let people: Vec<String> = spelled.into_values().filter(|s| s.len() > 1).map(|s| s.join(" and ")).collect();
    let mut warnings = Vec::new();
    let unlabelled = labels.iter().filter(|(_, emotion, _)| *emotion == UNLABELLED).count();
    if unlabelled > 0 {
        warnings.push(format!(
            "{} the label `{UNLABELLED}`, which counts as one emotion, whatever they show; fill in the column emotion",
            count(unlabelled, "sequence has", "sequences have")
        ));
    }
    let meant: Vec<String> = emotions
        .iter()
        .filter(|emotion| !is_word(emotion))
        .filter_map(|emotion| likely_emotion(emotion).map(|meant| format!("{emotion} (perhaps {meant})")))
        .collect();
    if !meant.is_empty() {
        warnings.push(format!(
            "emotions that may be misspelt; each is treated as a separate emotion: {}",
            listed(&meant, MOST_NAMED)
        ));
    }
    if !words.is_empty() {
        let list: Vec<String> = words.iter().map(|words| words.join(" and ")).collect();
        warnings.push(format!(
            "emotions that seem to mean the same; each is treated as a separate emotion: {} (if they mean the same, give them one label)",
            listed(&list, MOST_NAMED)
        ));
    }
    if !twins.is_empty() {
        warnings.push(format!(
            "similar names, of which one may be misspelt or abbreviated; they are kept separate: {}",
            listed(&twins, MOST_NAMED)
        ));
    }
    if !people.is_empty() {
        warnings.push(format!("similar names of subjects, counted as different people: {}", listed(&people, MOST_NAMED)));
    }
    warnings
}

/// Text that is safe in a file name on any system: letters, digits, `.`, `-`; everything else becomes `-`.
pub(super) fn file_stem(text: &str) -> String {
    let safe = |c: char| if c.is_alphanumeric() || c == '.' || c == '-' || c == '_' { c } else { '-' };
    let stem: String = composed(text.trim()).chars().map(safe).collect();
    let stem = stem.trim_start_matches('.');
    if stem.is_empty() { "none".to_owned() } else { stem.to_owned() }
}
