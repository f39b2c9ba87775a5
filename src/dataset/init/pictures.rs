//! Reads the names of single pictures of people: the person, the expression, and numbers of shots and frames.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{
    super::{
        frames::{is_picture, visible},
        name_key,
    },
    SEPARATORS,
    codes::{Coded, coded},
    emotions::{emotion_of, has_other_words},
};
use crate::text::composed;

/// The emotion that forms a pair with any other.
pub(super) const NEUTRAL: &str = "neutral";

/// Words that precede frame numbers and are not names.
pub(super) const FRAME_WORDS: [&str; 20] = [
    "", "img", "image", "frame", "frames", "f", "pic", "picture", "photo", "foto", "bild", "dsc", "still", "shot", "cap",
    "capture", "clip", "video", "vid", "seq",
];

/// A picture with the information in its name.
pub(super) struct Named {
    pub path: PathBuf,
    /// The name without emotions. Pictures of one person with equal names form a pair.
    pub person: String,
    /// The person in the manifest.
    pub subject: String,
    pub emotion: Option<&'static str>,
    /// The expression as in the name.
    pub kind: String,
    /// Name of the sequence.
    pub word: String,
    /// Number of the picture, if its person has several of one expression.
    pub shot: Option<String>,
    /// Whether the face is seen from the side.
    pub is_side: bool,
    /// Ways to read the name, the likelier first; empty for codes.
    pub readings: Vec<Reading>,
}

impl Named {
    /// Takes a reading of the name.
    pub fn take(&mut self, reading: Reading) {
        let Reading { person, emotion, word } = reading;
        self.subject.clone_from(&person);
        self.kind = word.to_lowercase();
        (self.person, self.emotion, self.word) = (person, emotion, word);
    }

    /// The name of a sequence, with the number of the picture if there are several.
    pub fn sequence(&self, word: &str) -> String {
        self.shot.as_ref().map_or_else(|| word.to_owned(), |shot| format!("{word}_{shot}"))
    }
}

/// A way to read a file name: words such as `Joy` may be a name or an emotion.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    /// The name without the words of the emotion.
    pub person: String,
    pub emotion: Option<&'static str>,
    /// The word of the emotion.
    pub word: String,
}

/// Words that denote a neutral face only beside pictures of emotions.
const RESTING: [&str; 4] = ["rest", "resting", "relaxed", "baseline"];

/// The emotion of a word that contains nothing else, or of a word for a face at rest.
pub(super) fn expression_of(part: &str) -> Option<&'static str> {
    if RESTING.contains(&part.to_lowercase().as_str()) {
        return Some(NEUTRAL);
    }
    emotion_of(part).filter(|_| !has_other_words(part))
}

/// The ways to read a name. Of several words of emotions the last is the emotion and the others belong to the person, else the first is the
/// emotion, else all are if they mean the same.
fn readings(folder: &Path, stem: &str) -> Vec<Reading> {
    let parts: Vec<&str> = stem.split(SEPARATORS).filter(|part| !part.is_empty()).collect();
    let places: Vec<usize> = (0..parts.len()).filter(|&k| expression_of(parts[k]).is_some()).collect();
    let without = |removed: &[usize]| {
        let others: Vec<&str> = (0..parts.len()).filter(|k| !removed.contains(k)).map(|k| parts[k]).collect();
        let person = match others.join("_") {
            none if none.is_empty() => composed(&folder.file_name().unwrap_or_default().to_string_lossy()),
            some => some,
        };
        let words: Vec<&str> = removed.iter().map(|&k| parts[k]).collect();
        Reading { person, emotion: words.first().and_then(|word| expression_of(word)), word: words.join("_") }
    };
    let (Some(&first), Some(&last)) = (places.first(), places.last()) else { return vec![without(&[])] };
    let mut readings = vec![without(&[last])];
    if first != last {
        readings.push(without(&[first]));
        if places.iter().all(|&k| expression_of(parts[k]) == expression_of(parts[first])) {
            readings.push(without(&places));
        }
    }
    readings
}

/// The ways to read a name in a folder of the emotion `emotion`: as a whole, without the last word of this emotion, without all words of
/// emotions.
pub(super) fn readings_in_folder(stem: &str, emotion: &'static str) -> Vec<Reading> {
    let parts: Vec<&str> = stem.split(SEPARATORS).filter(|part| !part.is_empty()).collect();
    let last = parts.iter().rposition(|part| expression_of(part) == Some(emotion));
    let person_of = |is_removed: &dyn Fn(usize) -> bool| {
        (0..parts.len()).filter(|&k| !is_removed(k)).map(|k| parts[k]).collect::<Vec<_>>().join("_")
    };
    let people = [person_of(&|_| false), person_of(&|k| Some(k) == last), person_of(&|k| expression_of(parts[k]).is_some())];
    let mut readings: Vec<Reading> = Vec::new();
    for person in people.into_iter().filter(|person| !person.is_empty()) {
        let reading = Reading { person, emotion: Some(emotion), word: String::new() };
        if !readings.contains(&reading) {
            readings.push(reading);
        }
    }
    readings
}

/// A picture in the folder `folder`.
fn named(folder: &Path, path: PathBuf) -> Named {
    let stem = composed(&path.file_stem().unwrap_or_default().to_string_lossy());
    let shot = None;
    if let Some(Coded { person, subject, emotion, kind, word, is_side }) = coded(&stem) {
        return Named { path, person, subject, emotion: Some(emotion), kind, word, shot, is_side, readings: Vec::new() };
    }
    let readings = readings(folder, &stem);
    let (person, subject, kind, word) = <(String, String, String, String)>::default();
    let mut picture = Named { path, person, subject, emotion: None, kind, word, shot, is_side: false, readings };
    if let Some(reading) = picture.readings.first().cloned() {
        picture.take(reading);
    }
    picture
}

/// People with a neutral picture and one of an expression.
fn paired<'a>(readings: impl Iterator<Item = (&'a str, Option<&'static str>)>) -> BTreeSet<String> {
    let mut people: BTreeMap<String, [bool; 2]> = BTreeMap::new();
    for (person, emotion) in readings.filter_map(|(person, emotion)| Some((person, emotion?))) {
        people.entry(name_key(person)).or_default()[usize::from(emotion != NEUTRAL)] = true;
    }
    people.into_iter().filter(|(_, has)| *has == [true; 2]).map(|(person, _)| person).collect()
}

/// Reads the names so that pictures pair: each in the first way in which its person has a neutral picture and one of an expression.
pub(super) fn read_to_pair(pictures: &mut [&mut Named]) {
    let most = pictures.iter().map(|p| p.readings.len()).max().unwrap_or(0);
    let mut is_read: Vec<bool> = pictures.iter().map(|p| p.readings.is_empty()).collect();
    for round in 0..most {
        let reading_of = |picture: &Named, is_read: bool| {
            let reading = picture.readings.get(round).or(picture.readings.last()).filter(|_| !is_read).cloned();
            let as_it_is = || Reading { person: picture.person.clone(), emotion: picture.emotion, word: picture.word.clone() };
            reading.unwrap_or_else(as_it_is)
        };
        let now: Vec<Reading> = pictures.iter().zip(&is_read).map(|(p, is_read)| reading_of(p, *is_read)).collect();
        let people = paired(now.iter().map(|reading| (reading.person.as_str(), reading.emotion)));
        for ((picture, is_read), reading) in pictures.iter_mut().zip(&mut is_read).zip(now) {
            if !*is_read && reading.emotion.is_some() && people.contains(&name_key(&reading.person)) {
                picture.take(reading);
                *is_read = true;
            }
        }
    }
}

/// A name without its last part that is a number, and this number: `X_01`. `None` for names without a person, such as `IMG_01`.
fn shot_of(person: &str) -> Option<(String, Option<String>)> {
    let mut parts: Vec<&str> = person.split('_').collect();
    let is_number = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_digit());
    let shot = parts.iter().rposition(|part| is_number(part)).map(|k| parts.remove(k).to_owned());
    let words: Vec<&str> = parts.iter().copied().filter(|part| !is_number(part)).collect();
    let is_frame = !words.is_empty() && FRAME_WORDS.contains(&words.join("_").to_lowercase().as_str());
    (!is_frame).then(|| (parts.join("_"), shot))
}

/// Removes numbers of shots from the names of people whose pictures do not pair with them: `X_01_neutral` and `X_02_happy`, or one neutral
/// picture and `X_happy_1`, `X_happy_2`. A person has exactly one neutral picture then. `folder` is the common folder of the pictures; without one,
/// every folder holds one expression.
pub(super) fn without_shots(folder: Option<&Path>, pictures: &mut [&mut Named]) {
    let of_folder = folder.map(|folder| composed(&folder.file_name().unwrap_or_default().to_string_lossy()));
    let people = paired(pictures.iter().map(|p| (p.person.as_str(), p.emotion)));
    // By person without numbers: places and numbers.
    let mut bases: BTreeMap<String, Vec<(usize, String, Option<String>)>> = BTreeMap::new();
    for (k, picture) in pictures.iter().enumerate().filter(|(_, p)| p.emotion.is_some() && !p.readings.is_empty()) {
        let Some((base, shot)) = shot_of(&picture.person) else { continue };
        let base = match &of_folder {
            Some(name) if base.is_empty() => name.clone(),
            None if !base.chars().any(char::is_alphabetic) => continue,
            _ => base,
        };
        bases.entry(name_key(&base)).or_default().push((k, base, shot));
    }
    let several = bases.len() > 1;
    for (key, members) in bases {
        let is_paired = |k: usize| people.contains(&name_key(&pictures[k].person));
        let mut neutral = members.iter().filter(|(k, ..)| pictures[*k].emotion == Some(NEUTRAL));
        let (Some((_, _, shot)), None) = (neutral.next(), neutral.next()) else { continue };
        let shots: BTreeSet<&Option<String>> = members.iter().map(|(_, _, shot)| shot).collect();
        let are_open = || members.iter().all(|(k, ..)| !is_paired(*k)) && shots.len() == members.len();
        let is_of_folder = of_folder.as_ref().is_some_and(|name| name_key(name) == key);
        // The number follows the emotion: it is not the number of a person.
        let follows = |k: usize, shot: &Option<String>| {
            let stem = composed(&pictures[k].path.file_stem().unwrap_or_default().to_string_lossy());
            let parts: Vec<&str> = stem.split(SEPARATORS).collect();
            parts.windows(2).any(|two| two[0] == pictures[k].word && Some(two[1]) == shot.as_deref())
        };
        let all_follow = || members.iter().all(|(k, _, shot)| is_paired(*k) || follows(*k, shot));
        let are_shots = match (shot, &of_folder) {
            (None, _) => several || of_folder.is_some(),
            (Some(_), None) => several && are_open(),
            (Some(_), Some(_)) if is_of_folder => !several && all_follow(),
            (Some(_), Some(_)) => several && are_open() || all_follow(),
        };
        if members.len() < 2 || !are_shots || members.iter().all(|(k, ..)| is_paired(*k)) {
            continue;
        }
        let kind = |p: &Named| (p.path.parent().map(Path::to_owned), p.kind.clone());
        let kinds: Vec<_> = members.iter().map(|(k, ..)| kind(pictures[*k])).collect();
        for ((k, base, shot), of) in members.into_iter().zip(&kinds) {
            pictures[k].shot = shot.filter(|_| kinds.iter().filter(|kind| *kind == of).count() > 1);
            pictures[k].subject.clone_from(&base);
            pictures[k].person = base;
        }
    }
}

/// Pictures of a folder.
pub(super) fn pictures(folder: &Path) -> Vec<Named> {
    let resolved = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let files = visible(folder).unwrap_or_default().into_iter().map(|entry| entry.path()).filter(|path| is_picture(path));
    files.map(|path| named(&resolved, path)).collect()
}

/// The part of a name before its last number, and the number.
pub(super) fn numbered(name: &str) -> (&str, &str) {
    let word = name.trim_end_matches(|c: char| c.is_ascii_digit());
    (word.trim_end_matches(SEPARATORS), &name[word.len()..])
}

/// Whether files are numbered like the frames of one sequence: without duplicates and, where the names contain an expression, with one word
/// beside it and few changes. A single neutral picture is none if it is not the first, or beside one picture or several expressions.
pub(super) fn are_frames(pictures: &[Named]) -> bool {
    let numbers: BTreeSet<&str> = pictures.iter().map(|p| numbered(&p.person).1).collect();
    let of_expressions = || pictures.iter().filter(|p| p.emotion.is_some());
    let words: BTreeSet<&str> = of_expressions().map(|p| numbered(&p.person).0).collect();
    let number = |p: &Named| numbered(&p.person).1.trim_start_matches('0').to_owned();
    let mut in_order: Vec<(usize, String, Option<&str>)> =
        of_expressions().map(|p| (number(p).len(), number(p), p.emotion)).collect();
    in_order.sort_unstable();
    let changes = in_order.windows(2).filter(|two| two[0].2 != two[1].2).count();
    let expressions: BTreeSet<Option<&str>> = in_order.iter().map(|named| named.2).filter(|e| *e != Some(NEUTRAL)).collect();
    let is_first = in_order.first().is_some_and(|first| first.2 == Some(NEUTRAL));
    let neutral = in_order.iter().filter(|named| named.2 == Some(NEUTRAL)).count();
    if neutral == 1 && !expressions.is_empty() && (pictures.len() == 2 || expressions.len() > 1 || !is_first) {
        return false;
    }
    numbers.len() == pictures.len() && !numbers.contains("") && words.len() < 2 && changes <= 2
}

/// Numbers of the files, if these have one word and follow each other without gaps.
pub(super) fn consecutive(pictures: &[Named]) -> Option<BTreeSet<u64>> {
    let words: BTreeSet<&str> = pictures.iter().map(|p| numbered(&p.person).0).collect();
    let numbers: BTreeSet<u64> = pictures.iter().map(|p| numbered(&p.person).1.parse().ok()).collect::<Option<_>>()?;
    let span = numbers.last()?.checked_sub(*numbers.first()?)?;
    (words.len() == 1 && numbers.len() == pictures.len() && span < numbers.len() as u64).then_some(numbers)
}

/// Most numbered pictures of a person that are stills. Recordings that are numbered anew every second have more frames in each.
const MOST_STILLS: usize = 4;

/// Whether the names of files in a folder neither number nor date the frames of one sequence: more than two names differ, and none is that of
/// most files. Nor do numbers that begin anew for each of several names with few files.
pub(super) fn are_unordered(pictures: &[Named]) -> bool {
    let stems: Vec<String> =
        pictures.iter().map(|p| composed(&p.path.file_stem().unwrap_or_default().to_string_lossy())).collect();
    let mut bases: BTreeMap<&str, usize> = BTreeMap::new();
    for stem in &stems {
        *bases.entry(numbered(stem).0).or_insert(0) += 1;
    }
    let numbers: BTreeSet<&str> = stems.iter().map(|stem| numbered(stem).1).collect();
    let are_numbered = numbers.len() == stems.len() && !numbers.contains("");
    let texts: BTreeSet<String> = stems.iter().map(|stem| stem.chars().filter(|c| !c.is_ascii_digit()).collect()).collect();
    let has_main = bases.values().any(|count| 2 * count > stems.len());
    let begin_anew = bases.values().all(|count| (2..=MOST_STILLS).contains(count));
    bases.len() > 2 && !are_numbered && !has_main && (texts.len() > 1 || begin_anew)
}
