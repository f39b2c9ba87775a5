//! One rest for all stretches of a person.
//!
//! Every stretch is measured against a rest of its own. If a face is hidden or lost while it smiles, and smiles on when it is found again,
//! the smile would be the rest of the second stretch. So the rests of a person are compared: one that shows an expression, seen from
//! another, is none, and its stretch is measured against the other.

use super::{Entry, RecordingError, Tick, measure::Neutral, measure_seen, named, survey::Survey};
use crate::{
    pipeline::Workbench,
    segment::{SegmentOptions, segment_at_known_rest, strength},
};

/// Order of the way from one rest to another ([`Workbench::order`]) above which the second shows an expression: as large as the one below
/// which a sequence is reported as played backwards.
const FORWARD: f64 = 0.07;

/// Measures stretches whose rest is an expression against the rest of another stretch of the same person. Returns notes.
pub(super) fn share_rests(
    entries: &mut [Entry],
    survey: &Survey,
    bench: &Workbench,
    (options, tick): (&SegmentOptions, Tick<'_>),
) -> Result<Vec<String>, RecordingError> {
    let mut notes = Vec::new();
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
    Ok(notes)
}

/// Indices of the stretches of each person, as far as is known: stretches of one scene that follow one person, and stretches whose faces
/// look alike.
fn people(entries: &[Entry], survey: &Survey, bench: &Workbench) -> Vec<Vec<usize>> {
    let scene = |entry: &Entry| survey.cuts.partition_point(|&cut| cut <= entry.followed.first);
    let person = |entry: &Entry| {
        let place = entry.followed.first + entry.followed.fitted;
        survey.looks.binary_search_by_key(&place, |look| look.place).ok().map(|k| survey.looks[k].person)
    };
    let is_one = |a: &Entry, b: &Entry| {
        let together = scene(a) == scene(b) && person(a).is_some() && person(a) == person(b);
        let mut pairs = a.followed.portraits.iter().flat_map(|a| b.followed.portraits.iter().map(move |b| (a, b)));
        together || pairs.any(|(a, b)| a.is_same(b, bench) == Some(true))
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (k, entry) in entries.iter().enumerate() {
        match groups.iter_mut().find(|group| group.iter().any(|&other| is_one(&entries[other], entry))) {
            Some(group) => group.push(k),
            None => groups.push(vec![k]),
        }
    }
    groups
}
