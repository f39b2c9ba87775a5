//! Detects emotions in the names of folders and files.

use std::collections::BTreeSet;

use super::UNKNOWN_EMOTION;

/// Words that negate an emotion, as separate words or as prefixes.
const NEGATIONS: [&str; 9] = ["not", "non", "no", "un", "never", "without", "nicht", "kein", "ohne"];

/// Words that denote an emotion with any ending. No personal name begins with them.
const EMOTION_STEMS: [(&str, &str); 31] = [
    ("angr", "anger"),
    ("disg", "disgust"),
    ("fearful", "fear"),
    ("afraid", "fear"),
    ("scared", "fear"),
    ("happy", "happiness"),
    ("happi", "happiness"),
    ("joyful", "happiness"),
    ("joyous", "happiness"),
    ("smile", "happiness"),
    ("smiling", "happiness"),
    ("sadness", "sadness"),
    ("surp", "surprise"),
    ("amaze", "surprise"),
    ("contempt", "contempt"),
    ("neutral", "neutral"),
    ("neutre", "neutral"),
    ("neutro", "neutral"),
    // German.
    ("wütend", "anger"),
    ("wuetend", "anger"),
    ("ärger", "anger"),
    ("aerger", "anger"),
    ("ängstlich", "fear"),
    ("aengstlich", "fear"),
    ("lächel", "happiness"),
    ("laechel", "happiness"),
    ("traurig", "sadness"),
    ("überrasch", "surprise"),
    ("ueberrasch", "surprise"),
    ("verachtung", "contempt"),
    ("verächtlich", "contempt"),
];

/// Words that denote an emotion alone or before another one (`sadhappy`). Names begin with them (`Angela`, `Joyce`, `Sadie`, `Neumann`,
/// `Freudenberg`).
const EMOTION_WORDS: [(&str, &str); 16] = [
    ("anger", "anger"),
    ("ang", "anger"),
    ("fears", "fear"),
    ("fear", "fear"),
    ("happ", "happiness"),
    ("hap", "happiness"),
    ("joy", "happiness"),
    ("sad", "sadness"),
    ("sur", "surprise"),
    ("neu", "neutral"),
    ("wut", "anger"),
    ("ekel", "disgust"),
    ("angst", "fear"),
    ("freude", "happiness"),
    ("glücklich", "happiness"),
    ("trauer", "sadness"),
];

fn words(name: &str) -> Vec<String> {
    name.to_lowercase().split(|c: char| !c.is_alphabetic()).filter(|w| !w.is_empty()).map(str::to_owned).collect()
}

/// Whether a name contains more than an emotion.
pub(super) fn has_other_words(name: &str) -> bool {
    words(name).len() > 1 || name.chars().any(|c| c.is_ascii_digit())
}

/// The emotion at the beginning of a word, and the length of its text.
fn at_start(word: &str) -> Option<(usize, &'static str)> {
    let long = |(start, emotion): &(&str, &'static str)| word.starts_with(start).then_some((start.len(), *emotion));
    let short = |(start, emotion): &(&str, &'static str)| {
        let rest = word.strip_prefix(start)?;
        (rest.is_empty() || matches!(rest, "face" | "faces") || at_start(rest).is_some()).then_some((start.len(), *emotion))
    };
    EMOTION_STEMS.iter().find_map(long).or_else(|| EMOTION_WORDS.iter().find_map(short))
}

/// The emotion in a name; [`UNKNOWN_EMOTION`] if it contains several or a negated one.
pub(super) fn emotion_of(name: &str) -> Option<&'static str> {
    let mut found: BTreeSet<&'static str> = BTreeSet::new();
    let words = words(name);
    for word in &words {
        if NEGATIONS.iter().any(|no| word.strip_prefix(no).is_some_and(|rest| at_start(rest).is_some())) {
            return Some(UNKNOWN_EMOTION);
        }
        let Some((length, emotion)) = at_start(word) else { continue };
        found.insert(emotion);
        // Another one may follow in the same word: `happysad`.
        let rest = word.get(length..).unwrap_or_default();
        found.extend(rest.char_indices().filter_map(|(k, _)| at_start(&rest[k..])).map(|(_, emotion)| emotion));
    }
    let is_negated = words.iter().any(|word| NEGATIONS.contains(&word.as_str()));
    match found.first() {
        Some(_) if found.len() > 1 || is_negated => Some(UNKNOWN_EMOTION),
        only => only.copied(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_say_no_emotion_or_several_leave_it_open() {
        for (name, emotion) in [
            ("happy_01", Some("happiness")),
            ("01-SMILING", Some("happiness")),
            ("disgusted", Some("disgust")),
            ("surprise neutral", Some("?")),
            ("not_happy", Some("?")),
            ("non-sad", Some("?")),
            ("unhappy", Some("?")),
            ("no smile", Some("?")),
            ("happysad", Some("?")),
            ("happy_happiness", Some("happiness")),
            ("ang-2", Some("anger")),
            ("angry", Some("anger")),
            ("angela_happy", Some("happiness")),
            ("sadhappy", Some("?")),
            ("joy", Some("happiness")),
            ("happyface", Some("happiness")),
            ("sadface", Some("sadness")),
            ("sad2", Some("sadness")),
            ("NEU", Some("neutral")),
            ("visage_neutre", Some("neutral")),
            ("Neutro", Some("neutral")),
            ("Freude", Some("happiness")),
            ("01_Trauer", Some("sadness")),
            ("Wut", Some("anger")),
            ("Ärger", Some("anger")),
            ("Aerger_2", Some("anger")),
            ("Angst", Some("fear")),
            ("Ekel", Some("disgust")),
            ("Überraschung", Some("surprise")),
            ("Ueberraschung", Some("surprise")),
            ("neutrales Gesicht", Some("neutral")),
            ("nicht traurig", Some("?")),
            ("unglücklich", Some("?")),
            ("Freudenberg", None),
            ("Trauernicht", None),
            ("Wutzke", None),
            ("Joyce", None),
            ("Sadie", None),
            ("Neumann", None),
            ("neurotypical", None),
            ("Fearon", None),
            ("Surya", None),
            ("Hapke", None),
            ("nora", None),
            ("un_1", None),
        ] {
            assert_eq!(emotion_of(name), emotion, "{name}");
        }
    }
}
