//! Labels that are spelled in several ways.
//!
//! Values that differ only in case and blanks are one group (`FEMALE` and ` female`), shown in the most frequent spelling. Labels that
//! may be a typing error (`happines` and `happiness`) or a synonym (`joy`) are kept apart and reported.

use std::collections::{BTreeMap, BTreeSet};

use super::EMOTIONS;
use crate::text::composed;

/// Smallest number of letters of words that are compared as near twins.
const LEAST_LETTERS: usize = 5;

/// Synonyms of the emotions of [`EMOTIONS`], in lower case. `smile` is not included: a smile need not be happy.
const WORDS: [(&str, &[&str]); 7] = [
    ("anger", &["anger", "angry", "wut", "w\u{fc}tend", "\u{e4}rger"]),
    ("disgust", &["disgust", "disgusted", "ekel"]),
    ("fear", &["fear", "fearful", "afraid", "scared", "angst", "\u{e4}ngstlich"]),
    ("happiness", &["happiness", "happy", "joy", "joyful", "freude", "gl\u{fc}cklich"]),
    ("sadness", &["sadness", "sad", "trauer", "traurig"]),
    ("surprise", &["surprise", "surprised", "\u{fc}berraschung", "\u{fc}berrascht"]),
    ("contempt", &["contempt", "contemptuous", "verachtung"]),
];

/// Characters that nobody sees and that mean nothing: zero-width space, word joiner, byte-order mark, soft hyphen.
const INVISIBLE: [char; 4] = ['\u{200b}', '\u{2060}', '\u{feff}', '\u{ad}'];

/// Returns the text by which values are compared: Unicode-composed, in lower case, trimmed, with single blanks inside and nothing invisible.
pub fn spelling_key(value: &str) -> String {
    composed(value).replace(INVISIBLE, "").split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase()
}

/// Returns the text by which names of people are compared: as [`spelling_key`], without leading zeros of numbers, which spreadsheets drop.
pub fn person_key(subject: &str) -> String {
    let key = spelling_key(subject);
    let mut shown = String::with_capacity(key.len());
    let mut signs = key.chars().peekable();
    while let Some(sign) = signs.next() {
        let begins = sign == '0' && !shown.ends_with(|c: char| c.is_ascii_digit());
        let is_leading = begins && signs.peek().is_some_and(char::is_ascii_digit);
        if !is_leading {
            shown.push(sign);
        }
    }
    shown
}

/// Returns the most frequent spelling of every value, by [`spelling_key`]. Of equally frequent spellings it is the first in alphabetical
/// order.
pub fn common_spellings<'a>(values: impl IntoIterator<Item = &'a str>) -> BTreeMap<String, String> {
    let mut counts: BTreeMap<String, BTreeMap<&str, usize>> = BTreeMap::new();
    for value in values {
        *counts.entry(spelling_key(value)).or_default().entry(value.trim()).or_default() += 1;
    }
    let common = |spellings: BTreeMap<&str, usize>| {
        let best = spellings.into_iter().max_by(|a, b| a.1.cmp(&b.1).then(b.0.cmp(a.0)));
        best.map_or_else(String::new, |(spelling, _)| spelling.to_owned())
    };
    counts.into_iter().map(|(key, spellings)| (key, common(spellings))).collect()
}

/// Returns pairs of a word of one or two letters and the only longer word that begins with it, such as `f` and `female`.
pub fn abbreviations<'a>(values: impl IntoIterator<Item = &'a str>) -> Vec<(String, String)> {
    let is_word = |value: &String| value.chars().all(char::is_alphabetic);
    let words: Vec<String> = common_spellings(values).into_keys().filter(is_word).collect();
    let (short, long): (Vec<&String>, Vec<&String>) = words.iter().partition(|word| (1..3).contains(&word.chars().count()));
    let full = |short: &String| {
        let mut longer = long.iter().filter(|word| word.starts_with(short.as_str()));
        longer.next().filter(|_| longer.next().is_none()).map(|word| (short.clone(), (*word).clone()))
    };
    short.into_iter().filter_map(full).collect()
}

/// Returns pairs of different words that differ by one typing error: one letter added, missing or replaced, or two adjacent letters
/// exchanged.
pub fn near_twins<'a>(values: impl IntoIterator<Item = &'a str>) -> Vec<(String, String)> {
    let is_word = |value: &String| value.chars().count() >= LEAST_LETTERS && value.chars().all(char::is_alphabetic);
    let words: Vec<String> = common_spellings(values).into_keys().filter(is_word).collect();
    let mut twins = Vec::new();
    for (i, a) in words.iter().enumerate() {
        let near = words[i + 1..].iter().filter(|b| strsim::damerau_levenshtein(a, b) == 1);
        twins.extend(near.map(|b| (a.clone(), b.clone())));
    }
    twins
}

/// Returns the emotion of [`EMOTIONS`] that a misspelled label probably means: one within two typing errors.
///
/// Returns `None` for labels that are one of [`EMOTIONS`], and for labels unlike any.
pub fn likely_emotion(label: &str) -> Option<&'static str> {
    const SLIPS: usize = 2;
    let label = spelling_key(label);
    if EMOTIONS.contains(&label.as_str()) || label.chars().count() < LEAST_LETTERS {
        return None;
    }
    let distance = |emotion: &&str| strsim::damerau_levenshtein(emotion, &label);
    EMOTIONS.into_iter().min_by_key(distance).filter(|emotion| distance(emotion) <= SLIPS)
}

/// Returns the emotion of [`EMOTIONS`] that a label is a synonym of, or `None`. Misspelled words are not recognized.
fn emotion_of_word(label: &str) -> Option<&'static str> {
    let label = spelling_key(label);
    WORDS.iter().find(|(_, words)| words.contains(&label.as_str())).map(|(emotion, _)| *emotion)
}

/// Returns the labels that are synonyms of one emotion, sorted, for each emotion that has several, in the order of [`EMOTIONS`].
pub fn synonyms<'a>(labels: impl IntoIterator<Item = &'a str>) -> Vec<Vec<String>> {
    let keys: BTreeSet<String> = labels.into_iter().map(spelling_key).collect();
    let of = |emotion: &str| keys.iter().filter(|label| emotion_of_word(label) == Some(emotion)).cloned().collect::<Vec<_>>();
    EMOTIONS.into_iter().map(of).filter(|words| words.len() > 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_frequent_spelling_stands_for_all() {
        let spellings = common_spellings(["FEMALE", "female ", "female", "Male", "East  Asian", "east asian"]);
        let expected = [("east asian", "East  Asian"), ("female", "female"), ("male", "Male")];
        assert_eq!(spellings, expected.map(|(k, v)| (k.to_owned(), v.to_owned())).into());
        assert_eq!(spelling_key("De\u{301}gou\u{302}t"), "d\u{e9}go\u{fb}t");
        assert_eq!(spelling_key("\u{200b}York\u{feff}"), "york");
    }

    #[test]
    fn names_of_people_are_compared_without_the_zeros_that_spreadsheets_drop() {
        for (name, key) in [("001", "1"), ("01", "1"), ("1", "1"), ("S010", "s10"), ("0", "0"), ("000", "0"), ("A0b00c", "a0b0c")]
        {
            assert_eq!(person_key(name), key);
        }
        assert_eq!(person_key("S1.05"), "s1.5");
    }

    #[test]
    fn a_misspelt_emotion_is_known_by_itself() {
        let meant = ["happyness", "suprise", "Sadnes", "happiness", "joy", "pain", "feer", "confusion"].map(likely_emotion);
        assert_eq!(meant, [Some("happiness"), Some("surprise"), Some("sadness"), None, None, None, None, None]);
    }

    #[test]
    fn words_for_one_emotion_are_named_together() {
        let labels =
            ["joy", "happiness", "Happy", "angry", "anger", "sad", "scared", "afraid", "smile", "pain", "neutral", "joy"];
        assert_eq!(synonyms(labels), [vec!["anger", "angry"], vec!["afraid", "scared"], vec!["happiness", "happy", "joy"]]);
        assert!(synonyms(["joy", "sadness", "fear", "happiness-low", "Joyce"]).is_empty());
        assert!(WORDS.iter().all(|(emotion, words)| EMOTIONS.contains(emotion) && words.contains(emotion)));
    }

    #[test]
    fn slips_are_named_and_short_or_numbered_values_are_not() {
        let twins = near_twins(["happiness", "happines", "cohort-A", "cohort-B", "fear", "feat", "anger", "Anger", "angre"]);
        assert_eq!(twins, [("anger".to_owned(), "angre".to_owned()), ("happines".to_owned(), "happiness".to_owned())]);
    }

    #[test]
    fn letters_that_abbreviate_a_word_are_paired_with_it() {
        let pairs = abbreviations(["F", "Female", "m", "male", "x", "12", "1"]);
        assert_eq!(pairs, [("f", "female"), ("m", "male")].map(|(a, b)| (a.to_owned(), b.to_owned())));
        assert!(abbreviations(["m", "male", "married"]).is_empty());
    }
}
