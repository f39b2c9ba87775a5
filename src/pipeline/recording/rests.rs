//! One rest for all stretches of a person.
//!
//! Every stretch is measured against a rest of its own. If a face is hidden or lost while it smiles, and smiles on when it is found again,
//! the smile would be the rest of the second stretch. So the rests of a person are compared: one that shows an expression, seen from
//! another, is none, and its stretch is measured against the other. Stretches that are too short to show a rest are measured against that of
//! their person, too.

use super::{
    Entry, RecordingError, Tick,
    follow::Followed,
    measure::{Measured, Neutral},
    measure_seen, named,
    survey::{Survey, too_short},
};
use crate::{
    pipeline::Workbench,
    segment::{Phase, SegmentOptions, Segmentation, segment_at_known_rest, strength},
};

/// Order of the way from one rest to another ([`Workbench::order`]) above which the second shows an expression: as large as the one below
/// which a sequence is reported as played backwards.
const FORWARD: f64 = 0.07;

/// Measures stretches whose rest is an expression against the rest of another stretch of the same person, and so the `short` ones, which are
/// numbered and become entries where the person is known. Returns notes.
pub(super) fn share_rests(
    (entries, short): (&mut Vec<Entry>, Vec<(usize, Followed)>),
    survey: &Survey,
    bench: &Workbench,
    (options, tick): (&SegmentOptions, Tick<'_>),
) -> Result<Vec<String>, RecordingError> {
    let mut notes = Vec::new();
    let mut rests = Vec::new();
    for group in people(entries, survey, bench) {
        let Some((&first, others)) = group.split_first() else { continue };
        let shows_more = |than: usize, of: usize| -> Result<bool, RecordingError> {
            let (from, to) = (&entries[than], &entries[of]);
            let compared = Neutral::elsewhere(&from.followed, from.neutral).compare(&to.followed, to.neutral, bench);
            match compared {
                Ok((frame, order)) => Ok(order > FORWARD && strength(&frame) >= options.high),
                Err(RecordingError::Pose(_)) => Ok(false),
                Err(error) => Err(error),
            }
        };
        let mut rest = first;
        for &k in others {
            if shows_more(k, rest)? {
                rest = k;
            }
        }
        rests.push((rest, group.clone()));
        let mut moved = Vec::new();
        for &k in group.iter().filter(|&&k| k != rest) {
            if shows_more(rest, k)? {
                moved.push(k);
            }
        }
        let neutral = Neutral::elsewhere(&entries[rest].followed, entries[rest].neutral);
        let number = entries[rest].followed.frames[entries[rest].neutral].number;
        for k in moved {
            let entry = &mut entries[k];
            match measure_seen(&entry.followed, &neutral, survey, bench, tick) {
                Ok(measured) => {
                    notes.push(format!(
                        "{}: what would be their rest shows an expression beside frame {number}; they are measured against that frame",
                        named(&entry.followed)
                    ));
                    entry.segmentation = segment_at_known_rest(&measured.frames, survey.fps, options);
                    entry.measured = measured;
                }
                Err(RecordingError::Pose(_)) => {}
                Err(error) => return Err(error),
            }
        }
    }
    let mut added = Vec::new();
    for (stretch, followed) in short {
        let is_one = |group: &[usize]| group.iter().any(|&k| are_one(&entries[k].followed, &followed, survey, bench));
        let known = rests.iter().find(|(_, group)| is_one(group)).map(|(rest, _)| &entries[*rest]);
        let Some(known) = known else {
            notes.push(too_short(&named(&followed), followed.frames.len(), survey.fps));
            continue;
        };
        let number = known.followed.frames[known.neutral].number;
        match measure_seen(&followed, &Neutral::elsewhere(&known.followed, known.neutral), survey, bench, tick) {
            Ok(measured) => {
                notes.push(format!(
                    "{}: too short to show a rest; they are measured against frame {number}, and no expression is proposed",
                    named(&followed)
                ));
                let segmentation = Ok(nothing_proposed(&measured, followed.fitted));
                added.push(Entry { stretch, neutral: followed.fitted, measured, segmentation, followed });
            }
            Err(RecordingError::Pose(error)) => notes.push(format!("{}: {error}", named(&followed))),
            Err(error) => return Err(error),
        }
    }
    entries.extend(added);
    Ok(notes)
}

/// The activity of a stretch that is too short to look for expressions.
fn nothing_proposed(measured: &Measured, fitted: usize) -> Segmentation {
    Segmentation {
        rest: fitted,
        activity: measured.frames.iter().map(strength).collect(),
        phases: vec![Phase::Other; measured.frames.len()],
        expressions: Vec::new(),
        without_rest: Vec::new(),
    }
}

/// Whether two stretches show the same person, as far as is known: stretches of one scene that follow one person, and stretches whose faces
/// look alike.
fn are_one(a: &Followed, b: &Followed, survey: &Survey, bench: &Workbench) -> bool {
    let scene = |followed: &Followed| survey.cuts.partition_point(|&cut| cut <= followed.first);
    let person = |followed: &Followed| {
        let place = followed.first + followed.fitted;
        survey.looks.binary_search_by_key(&place, |look| look.place).ok().map(|k| survey.looks[k].person)
    };
    let together = scene(a) == scene(b) && person(a).is_some() && person(a) == person(b);
    let mut pairs = a.portraits.iter().flat_map(|a| b.portraits.iter().map(move |b| (a, b)));
    together || pairs.any(|(a, b)| a.is_same(b, bench) == Some(true))
}

/// Indices of the stretches of each person, as far as is known ([`are_one`]).
fn people(entries: &[Entry], survey: &Survey, bench: &Workbench) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (k, entry) in entries.iter().enumerate() {
        let is_one = |&other: &usize| are_one(&entries[other].followed, &entry.followed, survey, bench);
        match groups.iter_mut().find(|group| group.iter().any(is_one)) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    groups
}
