//! Computes the mean expression ratio image of every class from the neutral and apex pictures of its people.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
};

use rayon::prelude::*;

use super::{Analysis, AnalyzedClass, Workbench, work::Planned};
use crate::{
    clone::{LEAST_SKIN_PEOPLE, MOST_SKIN_PEOPLE, NoSkin, Skin, SkinLayout, SkinSample},
    dataset::FrameSource,
    output::listed,
    sequence::read_colour_frames,
    track::{TrackedFrame, neutral_first, read_track, read_track_info},
    units::SequenceId,
};

/// Most classes that a warning names.
const MOST_NAMED: usize = 6;

/// Which sequences have pictures.
#[derive(Default)]
pub(super) struct Pictures {
    /// Frames of sequences whose pictures may be shown. A mean of faces is also a picture of faces.
    shown: BTreeMap<SequenceId, FrameSource>,
    /// Sequences whose pictures may not be shown.
    hidden: BTreeSet<SequenceId>,
}

/// The pictures of sequences; those that landmarks drive have none.
pub(super) fn picture_sources(planned: &[Planned<'_>], bench: &Workbench) -> Pictures {
    let mut pictures = Pictures::default();
    for (item, source) in planned.iter().filter_map(|item| Some((item, item.images()?))) {
        if bench.options.shows(&source.metadata) {
            pictures.shown.insert(item.id.clone(), source.frames.clone());
        } else {
            pictures.hidden.insert(item.id.clone());
        }
    }
    pictures
}

/// The reason why a class has no skin when only `found` of its people have pictures that may be shown.
fn too_few(sequences: &[SequenceId], found: usize, pictures: &Pictures) -> NoSkin {
    if found > 0 {
        return NoSkin::TooFewPeople { found };
    }
    let hidden = sequences.iter().filter(|id| pictures.hidden.contains(id)).count();
    NoSkin::NoPictures { landmarks: sequences.len() - hidden, hidden }
}

/// Sets the skin of every class, or the reason why it has none. Returns messages to the user.
///
/// It reads one sequence per person, and at most [`MOST_SKIN_PEOPLE`] people per class, which limits time and memory. A person whose
/// picture can no longer be read is left out.
pub(super) fn collect_skins(analysis: &mut Analysis, pictures: &Pictures, out: &Path, stop: &AtomicBool) -> Vec<String> {
    let sources = &pictures.shown;
    let chosen: Vec<Vec<SequenceId>> = analysis.classes.iter().map(|class| one_of_each(class, sources)).collect();
    let Some(layout) = chosen.iter().any(|ids| ids.len() >= LEAST_SKIN_PEOPLE).then(SkinLayout::new).flatten() else {
        for (class, ids) in analysis.classes.iter_mut().zip(&chosen) {
            class.skin = Err(too_few(&class.representative.sequences, ids.len(), pictures));
        }
        return Vec::new();
    };
    let mut flat = Vec::new();
    let mut from = 0;
    while from < analysis.classes.len() {
        // The classes of one emotion share its sequences.
        let emotion = analysis.classes[from].representative.label.emotion.clone();
        let count = analysis.classes[from..].iter().take_while(|c| c.representative.label.emotion == emotion).count();
        let needed = chosen[from..from + count].iter().filter(|ids| ids.len() >= LEAST_SKIN_PEOPLE).flatten();
        let ids: Vec<&SequenceId> = needed.collect::<BTreeSet<_>>().into_iter().collect();
        let measure = |id: &&SequenceId| {
            let sample = if stop.load(Ordering::Relaxed) { None } else { measured(&layout, sources.get(id)?, out, id) };
            sample.map(|sample| ((*id).clone(), sample))
        };
        let samples: BTreeMap<SequenceId, SkinSample> = ids.par_iter().filter_map(measure).collect();
        for (class, ids) in analysis.classes[from..from + count].iter_mut().zip(&chosen[from..]) {
            let own: Vec<&SkinSample> = ids.iter().filter_map(|id| samples.get(id)).collect();
            // No person of a smaller class was measured.
            class.skin = if ids.len() < LEAST_SKIN_PEOPLE {
                Err(too_few(&class.representative.sequences, ids.len(), pictures))
            } else {
                Skin::mean(&own)
            };
            if matches!(class.skin, Err(NoSkin::NoShading { .. })) {
                flat.push(class.stem.clone());
            }
        }
        from += count;
    }
    let warning = || {
        format!(
            "no representatives/*_skin.png was written, because the people have no folds in common (reason in the .json): {}",
            listed(&flat, MOST_NAMED)
        )
    };
    if flat.is_empty() { Vec::new() } else { vec![warning()] }
}

/// The first sequence with pictures of each person of a class, in order.
fn one_of_each(class: &AnalyzedClass, sources: &BTreeMap<SequenceId, FrameSource>) -> Vec<SequenceId> {
    let mut first: BTreeMap<&str, &SequenceId> = BTreeMap::new();
    for id in class.representative.sequences.iter().filter(|id| sources.contains_key(id)) {
        let known = first.entry(&id.subject).or_insert(id);
        *known = id.min(known);
    }
    first.into_values().take(MOST_SKIN_PEOPLE).cloned().collect()
}

/// Ratio image of one sequence.
fn measured(layout: &SkinLayout, source: &FrameSource, out: &Path, id: &SequenceId) -> Option<SkinSample> {
    let path = out.join(format!("tracks/{id}.csv"));
    let frames = neutral_first(read_track(&path).ok()?, read_track_info(&path).ok()?.and_then(|info| info.neutral_frame));
    let (first, last) = (frames.first()?, frames.last()?);
    let pictures = read_colour_frames(source, &[first.number, last.number]).ok()?;
    let nodes = |frame: &TrackedFrame| frame.nodes.iter().map(|n| n.position).collect::<Vec<_>>();
    let picture = |frame: &TrackedFrame| pictures.iter().find(|(number, _)| *number == frame.number).map(|(_, p)| p);
    layout.measure((picture(first)?, &nodes(first)), (picture(last)?, &nodes(last)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_for_missing_pictures_is_given() {
        let id = |k: u32| SequenceId { subject: format!("S{k:03}"), sequence: "1".to_owned() };
        let sequences: Vec<SequenceId> = (0..5).map(id).collect();
        let hidden = [id(3), id(9)].into();
        let pictures = Pictures { hidden, ..Pictures::default() };
        let said = |found| too_few(&sequences, found, &pictures).to_string();
        let expected = "no sequence has pictures that may be shown (4 use landmarks only, 1 show people who may not be shown)";
        assert_eq!(said(0), expected);
        assert_eq!(said(2), "2 people have pictures that show folds; at least 5 are needed");
    }
}
