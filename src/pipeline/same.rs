//! Finds sequences that are the same (those of two people, and those of one person with one emotion), and sequences that are not measured in
//! the same way.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    AnalyzedModel,
    sequence::{FOUND, LANDMARKS},
};
use crate::{
    dataset::FACE_COLUMN,
    model::FrameExpressionModel,
    output::{count, listed},
    statistics::SequenceModel,
    track::TrackInfo,
    units::SequenceId,
};

/// Most pairs that a note names.
const MOST_NAMED: usize = 5;

/// Identifies the pictures of a track by their names and bytes and by the frames used; `None` for landmarks, and for videos, which may
/// show several people.
pub(super) fn pictures_of(info: &TrackInfo) -> Option<String> {
    let frames = info.frames_blake3.as_ref().filter(|_| info.has_pictures() && !info.is_of_video())?;
    Some(format!("{frames} {:?} {:?}", info.neutral_frame, info.apex_frame))
}

/// Identifies a motion, to the bit; `None` without motion, in which all people agree.
fn motion_of(model: &SequenceModel) -> Option<String> {
    let frames = model.model.frames();
    if frames.iter().all(|frame| frame == model.model.neutral()) {
        return None;
    }
    let mut hash = blake3::Hasher::new();
    for point in frames.iter().flat_map(FrameExpressionModel::nodes) {
        hash.update(&point.x.to_bits().to_le_bytes()).update(&point.y.to_bits().to_le_bytes());
    }
    Some(hash.finalize().to_hex().to_string())
}

/// A sequence and what identifies its contents.
pub(super) struct Contents<'a> {
    pub id: &'a SequenceId,
    pub emotion: &'a str,
    /// Its pictures and its motion, as far as they are known. Sequences that agree in either are copies.
    pub keys: [Option<String>; 2],
}

/// Notes on sequences with the same pictures or exactly the same motion: of two people, and of one person with one emotion.
pub(super) fn same_said(models: &[AnalyzedModel]) -> Vec<String> {
    let contents = models.iter().map(|model| Contents {
        id: &model.model.id,
        emotion: &model.emotion,
        keys: [model.pictures.as_ref().map(|pictures| with_face(pictures, &model.metadata)), motion_of(&model.model)],
    });
    copies_said(contents.collect(), "the same pictures or exactly the same motion")
}

/// Note on sequences whose marks are landmarks beside others whose marks were found. Other programs place nose, lips and chin elsewhere on the
/// face, above all closed lips apart.
pub(super) fn mixed_marks_said(models: &[AnalyzedModel]) -> Option<String> {
    let of = |from: &str| models.iter().filter(|model| model.marks_from.as_deref() == Some(from)).count();
    let [found, landmarks] = [FOUND, LANDMARKS].map(of);
    (found > 0 && landmarks > 0).then(|| {
        format!(
            "the marks of {} were found in the picture, those of {} are landmarks: nose, lips and chin differ between the two, and with them FAPs \
             of the mouth by about a fifth; give landmarks to all sequences or to none",
            count(found, "sequence", "sequences"),
            count(landmarks, "sequence", "sequences")
        )
    })
}

/// Identifies pictures of one of several faces.
pub(super) fn with_face(pictures: &str, metadata: &BTreeMap<String, String>) -> String {
    format!("{pictures} {}", metadata.get(FACE_COLUMN).map_or("", String::as_str))
}

/// Notes on copies, which have `same` in common.
pub(super) fn copies_said(mut all: Vec<Contents<'_>>, same: &str) -> Vec<String> {
    all.sort_by(|a, b| a.id.cmp(b.id));
    // A copy is named together with the first sequence that it equals.
    let mut first: BTreeMap<(usize, &str), &Contents<'_>> = BTreeMap::new();
    let (mut people, mut sequences) = (BTreeMap::new(), BTreeSet::new());
    for one in &all {
        for (kind, key) in one.keys.iter().enumerate() {
            let Some(key) = key else { continue };
            let earlier = *first.entry((kind, key)).or_insert(one);
            let (a, b) = (earlier.id, one.id);
            if a.subject != b.subject {
                people.entry((&a.subject, &b.subject)).or_insert_with(BTreeSet::new).insert((a, b));
            } else if a != b && earlier.emotion == one.emotion {
                sequences.insert((a, b));
            }
        }
    }
    let mut said = Vec::new();
    if !people.is_empty() {
        let pair = |(subjects, ids): (&(&String, &String), &BTreeSet<_>)| {
            let (a, b) = ids.first()?;
            let more = if ids.len() > 1 { format!(" and {} more", ids.len() - 1) } else { String::new() };
            Some(format!("{} and {} ({a} and {b}{more})", subjects.0, subjects.1))
        };
        let pairs: Vec<String> = people.iter().filter_map(pair).collect();
        said.push(format!("people with {same}: {}; are these two people?", listed(&pairs, MOST_NAMED)));
    }
    if !sequences.is_empty() {
        let pairs: Vec<String> = sequences.iter().map(|(a, b)| format!("{a} and {b}")).collect();
        said.push(format!(
            "sequences of one person and emotion with {same}: {}; is one of them a copy?",
            listed(&pairs, MOST_NAMED)
        ));
    }
    said
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::{model::DynamicExpressionModel, units::SequenceId};

    /// A sequence of one node that moves to `x`.
    fn moved(subject: &str, sequence: &str, x: f64, pictures: Option<&str>) -> AnalyzedModel {
        let frame = |x: f64| FrameExpressionModel::new(vec![Point2::new(x, 0.0)]);
        AnalyzedModel {
            model: SequenceModel {
                id: SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() },
                model: DynamicExpressionModel::new(vec![frame(0.0), frame(x)]).unwrap(),
            },
            emotion: sequence[..3].to_owned(),
            metadata: BTreeMap::new(),
            quality: None,
            course: None,
            pictures: pictures.map(str::to_owned),
            marks_from: None,
        }
    }

    #[test]
    fn landmarks_beside_found_marks_are_told_and_marks_set_by_hand_are_not() {
        let from = |sources: &[&str]| {
            let models: Vec<AnalyzedModel> = sources
                .iter()
                .map(|&from| AnalyzedModel { marks_from: Some(from.to_owned()), ..moved("A", "joy1", 1.0, None) })
                .collect();
            mixed_marks_said(&models)
        };
        assert_eq!([from(&["found", "file"]), from(&["landmarks", "file"]), from(&["found", "found"])], [None, None, None]);
        let said = from(&["found", "landmarks", "landmarks"]).unwrap();
        assert!(
            said.starts_with("the marks of 1 sequence were found in the picture, those of 2 sequences are landmarks: "),
            "{said}"
        );
    }

    #[test]
    fn copies_are_named_in_pairs() {
        // P02 and P03 move alike, twice; P04 has other marks on the pictures of P05. P06 and P07 do not move.
        let models = [
            moved("P03", "joy", 2.0, None),
            moved("P02", "joy", 2.0, None),
            moved("P02", "sad", 3.0, None),
            moved("P03", "sad", 3.0, None),
            moved("P04", "joy", 4.0, Some("a")),
            moved("P05", "joy", 5.0, Some("a")),
            moved("P06", "joy", 0.0, Some("b")),
            moved("P07", "joy", 0.0, Some("c")),
        ];
        let same = "with the same pictures or exactly the same motion";
        let pairs = "P02 and P03 (P02_joy and P03_joy and 1 more); P04 and P05 (P04_joy and P05_joy)";
        assert_eq!(same_said(&models), [format!("people {same}: {pairs}; are these two people?")]);
        // The same motion of one person counts twice only within an emotion.
        let models = [moved("P02", "joy1", 2.0, None), moved("P02", "joy2", 2.0, None), moved("P02", "sad1", 2.0, None)];
        let said = format!("sequences of one person and emotion {same}: P02_joy1 and P02_joy2; is one of them a copy?");
        assert_eq!(same_said(&models), [said]);
        // Six copies of one person: five pairs are named.
        let models: Vec<AnalyzedModel> = (0..7).map(|k| moved(&format!("Q{k}"), "joy", 1.0, None)).collect();
        let said = same_said(&models).remove(0);
        assert!(said.contains("Q0 and Q5 (") && !said.contains("Q0 and Q6"), "{said}");
    }
}
