//! Names of FAPs in plain words.

/// Meanings of the parts of a FAP's name. A final `_o` means the outer contour of the lips; elsewhere `o` means the outer part.
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

/// FAPs whose names do not tell the direction of a positive value, or tell the wrong one, like MPEG-4's FAP 18.
const DIRECTIONS: [(&str, &str); 13] = [
    ("depress_chin", "push chin up"),
    ("shift_jaw", "shift jaw to the right"),
    ("yaw_l_eyeball", "turn left eyeball to the left"),
    ("yaw_r_eyeball", "turn right eyeball to the left"),
    ("pitch_l_eyeball", "turn left eyeball down"),
    ("pitch_r_eyeball", "turn right eyeball down"),
    ("squeeze_l_eyebrow", "squeeze left brow inwards"),
    ("squeeze_r_eyebrow", "squeeze right brow inwards"),
    ("shift_tongue_tip", "shift tongue tip to the right"),
    ("bend_nose", "bend nose to the right"),
    ("head_pitch", "turn head down"),
    ("head_yaw", "turn head to the left"),
    ("head_roll", "tilt head to the right"),
];

/// Name of a FAP in plain words, for a positive value: `raise_l_i_eyebrow` becomes `raise left inner brow`.
/// Left and right are the subject's.
pub fn fap_in_words(name: &str) -> String {
    if let Some((_, words)) = DIRECTIONS.iter().find(|(known, _)| *known == name) {
        return (*words).to_owned();
    }
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

/// Region of the face on which a FAP acts.
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
        // MPEG-4 calls it `depress_chin`, but a positive value moves up.
        assert_eq!(fap_in_words("depress_chin"), "push chin up");
    }

    #[test]
    fn no_two_faps_have_the_same_words() {
        let mut words: Vec<String> = FapCatalog::mpeg4().rows().iter().map(|row| fap_in_words(&row.name)).collect();
        words.sort();
        words.dedup();
        assert_eq!(words.len(), 68);
        assert!(DIRECTIONS.iter().all(|(name, _)| FapCatalog::mpeg4().rows().iter().any(|row| row.name == *name)));
    }
}
