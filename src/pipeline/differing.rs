//! Describes the differences between two runs for a user.

use std::{collections::BTreeSet, path::Path};

use serde_json::{Map, Value};

use super::{PipelineOptions, ReportFace};
use crate::fit::{FitOptions, PriorKind};

/// The options in which an earlier run and this one differ, each with its name and both values. Files are compared by path; with the same
/// path, the text says that the content changed.
pub(super) fn differing_options(there: &PipelineOptions, now: &PipelineOptions) -> Vec<String> {
    // Options that are identified by a hash are compared separately.
    let value = |options: &PipelineOptions| {
        let fit = FitOptions { prior: PriorKind::default(), ..options.fit.clone() };
        let plain = PipelineOptions { fit, report_face: ReportFace::default(), ..options.clone() };
        serde_json::to_value(plain).unwrap_or_default()
    };
    let mut found = Vec::new();
    differences("", &value(there), &value(now), &mut found);
    found.extend(differing_prior(&there.fit.prior, &now.fit.prior));
    found.extend(differing_faces(&there.report_face, &now.report_face));
    found
}

/// Difference between two wireframes, identified by their hashes; Candide-3 has none.
pub(crate) fn differing_wireframes(there: Option<&str>, now: Option<&str>) -> Option<&'static str> {
    match (there, now) {
        (None, Some(_)) => Some("another wireframe (previously Candide-3, now a file)"),
        (Some(_), None) => Some("another wireframe (previously a file, now Candide-3)"),
        _ => (there != now).then_some("another wireframe (previously a file, now another file)"),
    }
}

fn differing_prior(there: &PriorKind, now: &PriorKind) -> Option<String> {
    // Only the content hash of a prior's file is recorded: the file may have been renamed or changed.
    let word = |kind: &PriorKind| match kind {
        PriorKind::File(_) => "a file".to_owned(),
        _ => in_words(&serde_json::to_value(kind).unwrap_or_default()),
    };
    let both_files = matches!((there, now), (PriorKind::File(_), PriorKind::File(_)));
    let now_word = if both_files { "a file with another content".to_owned() } else { word(now) };
    (there != now).then(|| format!("fit prior: previously {}, now {now_word}", word(there)))
}

/// A file and its hash, if the file existed.
type File<'a> = (&'a Path, Option<&'a str>);

/// Differences between the faces on which the report shows the representatives.
fn differing_faces(there: &ReportFace, now: &ReportFace) -> Vec<String> {
    /// The photograph and the marks of a face.
    fn files(face: &ReportFace) -> [Option<File<'_>>; 2] {
        let ReportFace::Photograph { image, correspondences, blake3: [picture, marks] } = face else { return [None, None] };
        [Some((image, picture.as_deref())), correspondences.as_deref().map(|path| (path, marks.as_deref()))]
    }
    let ([picture_there, marks_there], [picture_now, marks_now]) = (files(there), files(now));
    let picture = differing_files("portrait", "the built-in one", picture_there, picture_now);
    // The shipped portrait has no marks to compare.
    let marks = picture_there.and(picture_now).and_then(|_| {
        let none = "found in the portrait";
        differing_files("marks of the portrait", none, marks_there, marks_now)
    });
    picture.into_iter().chain(marks).collect()
}

/// Differences between two optional files.
fn differing_files(name: &str, none: &str, there: Option<File<'_>>, now: Option<File<'_>>) -> Option<String> {
    let word = |file: Option<File<'_>>| file.map_or_else(|| none.to_owned(), |(path, _)| path.display().to_string());
    if there.map(|(path, _)| path) != now.map(|(path, _)| path) {
        return Some(format!("{name}: previously {}, now {}", word(there), word(now)));
    }
    (there != now).then(|| format!("{name}: {} was changed since", word(now)))
}

/// Adds the differences between two values to a list, by name.
fn differences(name: &str, there: &Value, now: &Value, found: &mut Vec<String>) {
    if there == now {
        return;
    }
    if let (Value::Object(there), Value::Object(now)) = (there, now) {
        let keys: BTreeSet<&String> = there.keys().chain(now.keys()).collect();
        for key in keys {
            let name = if name.is_empty() { key.replace('_', " ") } else { format!("{name} {}", key.replace('_', " ")) };
            let of = |object: &Map<String, Value>| object.get(key).cloned().unwrap_or(Value::Null);
            differences(&name, &of(there), &of(now), found);
        }
        return;
    }
    found.push(format!("{name}: previously {}, now {}", in_words(there), in_words(now)));
}

/// A value as text for the user.
fn in_words(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::Bool(yes) => if *yes { "on" } else { "off" }.to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(list) if list.is_empty() => "none".to_owned(),
        Value::Array(list) => list.iter().map(in_words).collect::<Vec<_>>().join(", "),
        Value::Object(map) => map.iter().map(|(key, value)| format!("{key} {}", in_words(value))).collect::<Vec<_>>().join(", "),
        Value::Number(number) => number.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::LoadedPrior;

    #[test]
    fn plain_options_are_told_by_name_and_value() {
        let there = PipelineOptions::default();
        let mut now = there.clone();
        now.by = vec!["sex".to_owned(), "age".to_owned()];
        now.no_faces = true;
        now.statistics.alpha = 0.25;
        let alpha = format!("statistics alpha: previously {}, now 0.25", there.statistics.alpha);
        assert_eq!(
            differing_options(&there, &now),
            ["by: previously none, now sex, age", "no faces: previously off, now on", &alpha]
        );
        assert!(differing_options(&now, &now).is_empty());
    }

    #[test]
    fn a_portrait_and_its_marks_are_told_by_their_files() {
        let face = |image: &str, picture: &str, marks: Option<(&str, &str)>| ReportFace::Photograph {
            image: image.into(),
            correspondences: marks.map(|(path, _)| path.into()),
            blake3: [Some(picture.to_owned()), marks.map(|(_, hash)| hash.to_owned())],
        };
        let options = |report_face| PipelineOptions { report_face, ..PipelineOptions::default() };
        let differing = |there: &ReportFace, now: &ReportFace| differing_options(&options(there.clone()), &options(now.clone()));
        let anna = face("anna.jpg", "0a1b", None);
        assert_eq!(differing(&ReportFace::Composite, &anna), ["portrait: previously the built-in one, now anna.jpg"]);
        let marked = face("anna.jpg", "0a1b", Some(("anna.csv", "2c3d")));
        assert_eq!(differing(&marked, &ReportFace::Composite), ["portrait: previously anna.jpg, now the built-in one"]);
        assert_eq!(differing(&anna, &marked), ["marks of the portrait: previously found in the portrait, now anna.csv"]);
        let ben = face("ben.jpg", "4e5f", Some(("ben.csv", "6a7b")));
        let both = ["portrait: previously anna.jpg, now ben.jpg", "marks of the portrait: previously anna.csv, now ben.csv"];
        assert_eq!(differing(&marked, &ben), both);
        // The same file names with other content.
        let changed = face("anna.jpg", "8c9d", Some(("anna.csv", "0e1f")));
        let both = ["portrait: anna.jpg was changed since", "marks of the portrait: anna.csv was changed since"];
        assert_eq!(differing(&marked, &changed), both);
    }

    #[test]
    fn priors_and_wireframes_are_told_without_their_hashes() {
        let options = |prior| {
            let fit = FitOptions { prior, ..FitOptions::default() };
            PipelineOptions { fit, ..PipelineOptions::default() }
        };
        let file = |hash: &str| options(PriorKind::File(LoadedPrior { blake3: hash.to_owned(), prior: None }));
        let differing = differing_options(&options(PriorKind::Auto), &file("0a1b"));
        assert_eq!(differing, ["fit prior: previously auto, now a file"]);
        let differing = differing_options(&file("0a1b"), &file("2c3d"));
        assert_eq!(differing, ["fit prior: previously a file, now a file with another content"]);
        assert_eq!(differing_wireframes(Some("0a1b"), Some("0a1b")), None);
        let said = differing_wireframes(None, Some("0a1b")).unwrap();
        assert_eq!(said, "another wireframe (previously Candide-3, now a file)");
        assert!(differing_wireframes(Some("0a1b"), Some("2c3d")).is_some());
    }
}
