//! What `clone` says about FAPs that are not shown as requested.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use grimace::{
    clone::CutFap,
    fap::{FapCatalog, FapNumber, read_fap},
    output::listed,
};

use super::fap::beyond_range_said;

/// Number of reduced and of changed FAPs that are printed, the worst ones first.
const PRINTED: usize = 3;

/// Why FAPs are not shown as requested.
const BECAUSE: &str = "because the skin would fold over, or lips or lids would lose their shape or pass through each other";

/// The FAPs that clones of a batch do not show as requested.
#[derive(Debug, Default)]
pub struct NotAsAsked {
    clones: usize,
    faps: BTreeMap<u8, usize>,
}

impl NotAsAsked {
    /// Adds the FAPs of a clone.
    pub fn add(&mut self, cut: &[CutFap], changed: &[CutFap]) {
        let faps: BTreeSet<u8> = cut.iter().chain(changed).map(|c| c.fap).collect();
        self.clones += usize::from(!faps.is_empty());
        faps.into_iter().for_each(|fap| *self.faps.entry(fap).or_default() += 1);
    }

    /// Message about a batch of `of` clones, if there are such FAPs.
    pub fn said(&self, of: usize) -> Option<String> {
        let mut faps: Vec<(u8, usize)> = self.faps.iter().map(|(fap, count)| (*fap, *count)).collect();
        faps.sort_by_key(|&(fap, count)| (std::cmp::Reverse(count), fap));
        let faps: Vec<String> = faps.into_iter().map(|(fap, count)| format!("FAP {} in {count}", named(fap))).collect();
        (self.clones > 0).then(|| {
            format!(
                "{} of {of} clones show some FAPs weaker, stronger or the other way than requested (faps_cut and faps_changed in their \
                 clone.json), {BECAUSE}: {}",
                self.clones,
                listed(&faps, 2 * PRINTED)
            )
        })
    }
}

/// Message about FAPs that are not shown as requested, if there are any. All of them are in `clone.json`.
pub fn not_as_asked_said(cut: &[CutFap], changed: &[CutFap]) -> Option<String> {
    let reduced = |c: &CutFap| format!("{} ({} of {})", named(c.fap), c.shown, c.asked);
    let other = |c: &CutFap| format!("{} (asked {}, shown {} in frame {})", named(c.fap), c.asked, c.shown, c.frame);
    let worst = |list: &[CutFap], of: &dyn Fn(&CutFap) -> String| {
        let mut list = list.to_vec();
        list.sort_by(|a, b| (b.asked - b.shown).abs().total_cmp(&(a.asked - a.shown).abs()));
        let more = if list.len() > PRINTED { " in clone.json" } else { "" };
        listed(&list.iter().map(of).collect::<Vec<_>>(), PRINTED) + more
    };
    let mut parts = Vec::new();
    if !cut.is_empty() {
        parts.push(format!("reduced FAP {}", worst(cut, &reduced)));
    }
    if !changed.is_empty() {
        parts.push(format!("stronger or the other way: FAP {}", worst(changed, &other)));
    }
    (!parts.is_empty()).then(|| format!("{}, {BECAUSE}", parts.join("; ")))
}

/// Warns of values of a FAP file beyond the standard's range. Most faces cannot show them.
pub fn warn_beyond_range(path: &Path) {
    let Ok(file) = read_fap(path) else { return };
    for said in beyond_range_said(&file.sequence) {
        eprintln!("warning: {}: {said}", path.display());
    }
}

/// Number and name of a FAP.
fn named(fap: u8) -> String {
    let name = FapNumber::try_from(fap).map(|number| FapCatalog::mpeg4().row(number).name.as_str());
    format!("{fap} {}", name.unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reduced_and_changed_faps_have_both_values() {
        let cut = [CutFap { fap: 10, frame: 25, asked: 31.0, shown: -5.0 }];
        let changed = [CutFap { fap: 52, frame: 24, asked: -13.0, shown: 19.0 }];
        let because = format!(", {BECAUSE}");
        let said = |cut: &[CutFap], changed: &[CutFap]| not_as_asked_said(cut, changed).map(|said| said.replace(&because, ""));
        assert_eq!(said(&[], &[]), None);
        assert_eq!(said(&cut, &[]).unwrap(), "reduced FAP 10 raise_b_lip_lm (-5 of 31)");
        let other = "stronger or the other way: FAP 52 raise_b_midlip_o (asked -13, shown 19 in frame 24)";
        assert_eq!(said(&[], &changed).unwrap(), other);
        assert_eq!(said(&cut, &changed).unwrap(), format!("reduced FAP 10 raise_b_lip_lm (-5 of 31); {other}"));
    }

    #[test]
    fn a_batch_is_summed_up_by_fap() {
        let of = |fap| CutFap { fap, frame: 25, asked: 31.0, shown: -5.0 };
        let mut batch = NotAsAsked::default();
        assert_eq!(batch.said(3), None);
        batch.add(&[of(10)], &[of(10), of(52)]);
        batch.add(&[], &[]);
        batch.add(&[of(52)], &[]);
        let said = batch.said(3).unwrap();
        assert!(said.starts_with("2 of 3 clones show some FAPs weaker, stronger or the other way than requested"), "{said}");
        assert!(said.ends_with(&format!("{BECAUSE}: FAP 52 raise_b_midlip_o in 2; FAP 10 raise_b_lip_lm in 1")), "{said}");
    }
}
