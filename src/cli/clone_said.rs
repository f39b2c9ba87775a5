//! What `clone` says about FAPs that are not shown as requested.

use grimace::{
    clone::CutFap,
    fap::{FapCatalog, FapNumber},
    output::listed,
};

/// Number of reduced and of changed FAPs that are printed, the worst ones first.
const PRINTED: usize = 3;

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
    (!parts.is_empty()).then(|| {
        format!(
            "{}, because the skin would fold over, or lips or lids would lose their shape or pass through each other",
            parts.join("; ")
        )
    })
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
        let because = ", because the skin would fold over, or lips or lids would lose their shape or pass through each other";
        let said = |cut: &[CutFap], changed: &[CutFap]| not_as_asked_said(cut, changed).map(|said| said.replace(because, ""));
        assert_eq!(said(&[], &[]), None);
        assert_eq!(said(&cut, &[]).unwrap(), "reduced FAP 10 raise_b_lip_lm (-5 of 31)");
        let other = "stronger or the other way: FAP 52 raise_b_midlip_o (asked -13, shown 19 in frame 24)";
        assert_eq!(said(&[], &changed).unwrap(), other);
        assert_eq!(said(&cut, &changed).unwrap(), format!("reduced FAP 10 raise_b_lip_lm (-5 of 31); {other}"));
    }
}
