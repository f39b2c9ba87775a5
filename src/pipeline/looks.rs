//! Looks of a person at the tracks of a run: which count, and what a run says about them.

use std::{collections::BTreeSet, path::Path};

use super::{RunError, file_blake3};
use crate::{
    output::{count, listed},
    track::{LOOKED_AT, Look, Looks, TrackQuality, content_of, read_track_info},
    units::SequenceId,
};

/// Most sequences that a note names.
const MOST_NAMED: usize = 6;

/// Reads the looks in a results folder. Rows without content are about the tracks that are there; `saved` writes that into the file.
pub(super) fn looks_in(out: &Path, saved: bool) -> Result<Looks, RunError> {
    let mut looks = Looks::read(out)?;
    let content = |id: &str| {
        // No part of a path but a name.
        let name = Path::new(id).file_name().filter(|name| *name == id)?.to_str()?;
        let csv = out.join("tracks").join(format!("{name}.csv"));
        let info = read_track_info(&csv).ok().flatten()?;
        Some(content_of(Some(&info), &file_blake3(&csv)?))
    };
    if looks.fill_in(content) && saved {
        looks.write()?;
    }
    Ok(looks)
}

/// Fills in the content of rows about sequences that had no track when the run began. The file is read again, because somebody may have
/// written it meanwhile.
pub(super) fn fill_in_new(out: &Path, looks: &mut Looks, tracks: &[TrackQuality]) -> Result<(), RunError> {
    let content = |id: &str| tracks.iter().find(|t| t.id.to_string() == id).map(|t| t.content.clone());
    if looks.fill_in(content) {
        let mut now = Looks::read(out)?;
        if now.fill_in(content) {
            now.write()?;
        }
    }
    Ok(())
}

/// Note that rows are about no sequence of the run.
pub(super) fn unused_looks(looks: &Looks, ids: &BTreeSet<String>) -> Option<String> {
    let unused: Vec<String> = looks.ids().filter(|id| !ids.contains(*id)).cloned().collect();
    let rows = if unused.len() == 1 { "row is" } else { "rows are" };
    (!unused.is_empty()).then(|| {
        let named = listed(&unused, MOST_NAMED);
        format!("{LOOKED_AT}: {} {rows} not used, because no sequence of this run has the id: {named}", unused.len())
    })
}

/// Notes about the sequences that were looked at.
pub(super) fn looked_said(tracks: &[TrackQuality]) -> Vec<String> {
    let of = |look: Look| -> Vec<&SequenceId> { tracks.iter().filter(|t| t.look == Some(look)).map(|t| &t.id).collect() };
    let named = |ids: &[&SequenceId]| listed(&ids.iter().map(ToString::to_string).collect::<Vec<_>>(), MOST_NAMED);
    let [right, left_out, outdated] = [Look::Right, Look::LeaveOut, Look::Outdated].map(of);
    let mut said = Vec::new();
    if !right.is_empty() {
        said.push(format!("{} looked at and found right ({LOOKED_AT})", count(right.len(), "sequence was", "sequences were")));
    }
    if !left_out.is_empty() {
        let were = count(left_out.len(), "sequence is", "sequences are");
        said.push(format!("{were} left out of the statistics after a look ({LOOKED_AT}): {}", named(&left_out)));
    }
    if !outdated.is_empty() {
        let have = count(outdated.len(), "sequence has", "sequences have");
        said.push(format!(
            "{have} other pictures or another track than when they were looked at, so the row in {LOOKED_AT} does not count: {}",
            named(&outdated)
        ));
    }
    said
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn looks_at_no_sequence_are_named() {
        let out = tempfile::tempdir().unwrap();
        fs::write(out.path().join(LOOKED_AT), "id,look\nP1_2,right\nP9_2,leave out\n../P1_2,right\n").unwrap();
        let looks = looks_in(out.path(), false).unwrap();
        let said = unused_looks(&looks, &BTreeSet::from(["P1_2".to_owned()])).unwrap();
        assert!(said.starts_with("looked_at.csv: 2 rows are not used") && said.ends_with(": ../P1_2; P9_2"), "{said}");
        assert_eq!(unused_looks(&looks, &looks.ids().cloned().collect()), None);
    }
}
