//! FAPs in words.

/// What the parts of a FAP's name mean. `_o` at the end is the outer contour of the lips; elsewhere it is the outer part.
const WORDS: [(&str, &str); 13] = [
    ("l", "left"),
    ("r", "right"),
    ("t", "upper"),
    ("b", "lower"),
    ("i", "inner"),
    ("m", "middle"),
    ("o", "outer"),
    ("lm", "left of the middle"),
    ("rm", "right of the middle"),
    ("midlip", "lip, middle"),
    ("cornerlip", "corner of the mouth"),
    ("eyebrow", "brow"),
    ("eyelid", "lid"),
];

/// The name of a FAP as people would say it: `raise_l_i_eyebrow` is `raise left inner brow`.
pub fn fap_in_words(name: &str) -> String {
    let (stem, outer) = match name.strip_suffix("_o") {
        Some(stem) if name.contains("lip") => (stem, true),
        _ => (name, false),
    };
    let word = |part: &str| WORDS.iter().find(|(short, _)| *short == part).map_or(part, |(_, long)| long).to_owned();
    let mut text = stem.split('_').map(word).collect::<Vec<_>>().join(" ");
    if name.contains("lip") {
        text.push_str(if outer { " (outer edge)" } else { " (inner edge)" });
    }
    text
}

/// Where on the face a FAP acts.
pub(super) fn part_of(number: u8) -> &'static str {
    match number {
        3 | 14 | 15 | 18 => "Jaw",
        4..=13 | 16 | 17 | 51..=60 => "Mouth",
        19..=22 => "Lids",
        23..=30 => "Gaze",
        31..=38 => "Brows",
        39..=42 => "Cheeks",
        61..=64 => "Nose",
        _ => "Other",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fap::FapCatalog;

    #[test]
    fn names_become_words() {
        assert_eq!(fap_in_words("raise_l_i_eyebrow"), "raise left inner brow");
        assert_eq!(fap_in_words("raise_l_o_eyebrow"), "raise left outer brow");
        assert_eq!(fap_in_words("stretch_r_cornerlip_o"), "stretch right corner of the mouth (outer edge)");
        assert_eq!(fap_in_words("lower_t_lip_lm"), "lower upper lip left of the middle (inner edge)");
        assert_eq!(fap_in_words("open_jaw"), "open jaw");
    }

    #[test]
    fn no_two_faps_have_the_same_words() {
        let mut words: Vec<String> = FapCatalog::mpeg4().rows().iter().map(|row| fap_in_words(&row.name)).collect();
        words.sort();
        words.dedup();
        assert_eq!(words.len(), 68);
    }
}
