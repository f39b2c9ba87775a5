//! Recognizes folders with single pictures of several people, which are not sequences although they hold two or more pictures, and pairs each
//! neutral picture with those of expressions.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    path::{Path, PathBuf},
};

use super::{
    super::{
        PICTURE_SEPARATOR,
        frames::{is_picture, visible},
        name_key,
    },
    ProposedRow, SEPARATORS, UNKNOWN_EMOTION,
    codes::{Coded, coded},
    emotions::{emotion_of, has_other_words},
    is_label, relative,
    search::Found,
};
use crate::{
    output::{count, listed},
    text::composed,
};

/// The emotion that forms a pair with any other.
const NEUTRAL: &str = "neutral";

/// Words that precede frame numbers and are not names.
const FRAME_WORDS: [&str; 20] = [
    "", "img", "image", "frame", "frames", "f", "pic", "picture", "photo", "foto", "bild", "dsc", "still", "shot", "cap",
    "capture", "clip", "video", "vid", "seq",
];

/// Most names in a message.
const MOST_NAMED: usize = 6;

/// A collection of pictures of several people, one picture per expression.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PicturesOfPeople {
    /// Its folders, relative to the manifest.
    pub folders: Vec<String>,
    /// The people, from the file names.
    pub people: Vec<String>,
    /// Neutral picture and picture of an expression of one person, relative to the manifest, and the expression; `None` without such a
    /// pair.
    pub pair: Option<[String; 3]>,
}

impl fmt::Display for PicturesOfPeople {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let folders: Vec<String> = self
            .folders
            .iter()
            .map(|folder| if folder == "." { "this folder".to_owned() } else { format!("`{folder}`") })
            .collect();
        let whose = if self.people.len() == 1 { "single pictures of" } else { "single pictures of several people:" };
        write!(f, "{}: {whose} {}; ", listed(&folders, MOST_NAMED), listed(&self.people, MOST_NAMED))?;
        write!(f, "make a folder for every person and expression, with the neutral picture as 1 and the other as 2")?;
        let Some([neutral, other, emotion]) = &self.pair else { return Ok(()) };
        let person = self.people.first().map_or("", String::as_str);
        let extension =
            |file: &str| Path::new(file).extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
        let (first, second) = (extension(neutral), extension(other));
        write!(f, ": copy {neutral} to {person}/{emotion}/1{first} and {other} to {person}/{emotion}/2{second}")
    }
}

/// A picture with the information in its name.
struct Named {
    path: PathBuf,
    /// The name without emotions. Pictures of one person with equal names form a pair.
    person: String,
    /// The person in the manifest.
    subject: String,
    emotion: Option<&'static str>,
    /// The expression as in the name.
    kind: String,
    /// Name of the sequence.
    word: String,
    /// Whether the face is seen from the side.
    is_side: bool,
}

/// Words without meaning in the names of folders of pictures.
const PICTURE_WORDS: [&str; 12] = [
    "face",
    "faces",
    "visage",
    "visages",
    "image",
    "images",
    "picture",
    "pictures",
    "photo",
    "photos",
    "expression",
    "expressions",
];

/// Words that denote a neutral face only beside pictures of emotions.
const RESTING: [&str; 4] = ["rest", "resting", "relaxed", "baseline"];

/// The emotion of a word that contains nothing else, or of a word for a face at rest.
fn expression_of(part: &str) -> Option<&'static str> {
    if RESTING.contains(&part.to_lowercase().as_str()) {
        return Some(NEUTRAL);
    }
    emotion_of(part).filter(|_| !has_other_words(part))
}

/// A picture in the folder `folder`.
fn named(folder: &Path, path: PathBuf) -> Named {
    let stem = composed(&path.file_stem().unwrap_or_default().to_string_lossy());
    if let Some(Coded { person, subject, emotion, kind, word, is_side }) = coded(&stem) {
        return Named { path, person, subject, emotion: Some(emotion), kind, word, is_side };
    }
    let (emotions, others): (Vec<&str>, Vec<&str>) =
        stem.split(SEPARATORS).filter(|part| !part.is_empty()).partition(|part| expression_of(part).is_some());
    let emotion = emotions.first().and_then(|part| expression_of(part));
    let mut person = others.join("_");
    if person.is_empty() {
        person = composed(&folder.file_name().unwrap_or_default().to_string_lossy());
    }
    let word = emotions.first().map(|&part| part.to_owned()).unwrap_or_default();
    Named { path, subject: person.clone(), person, emotion, kind: word.to_lowercase(), word, is_side: false }
}

/// Pictures of a folder.
fn pictures(folder: &Path) -> Vec<Named> {
    let resolved = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let files = visible(folder).unwrap_or_default().into_iter().map(|entry| entry.path()).filter(|path| is_picture(path));
    files.map(|path| named(&resolved, path)).collect()
}

/// The part of a name before its last number, and the number.
fn numbered(name: &str) -> (&str, &str) {
    let word = name.trim_end_matches(|c: char| c.is_ascii_digit());
    (word.trim_end_matches(SEPARATORS), &name[word.len()..])
}

/// Whether files are numbered like the frames of one sequence: without gaps and duplicates.
fn are_frames(pictures: &[Named]) -> bool {
    let numbers: BTreeSet<&str> = pictures.iter().map(|p| numbered(&p.person).1).collect();
    numbers.len() == pictures.len() && !numbers.contains("")
}

/// A neutral picture and a picture of an expression of the same person.
fn pair(root: &Path, pictures: &[&Named], person: &str) -> Option<[String; 3]> {
    let of = |neutral: bool| {
        pictures.iter().find(|p| p.person == person && p.emotion.is_some_and(|emotion| (emotion == NEUTRAL) == neutral))
    };
    let (neutral, other) = (of(true)?, of(false)?);
    Some([relative(root, &neutral.path), relative(root, &other.path), other.emotion?.to_owned()])
}

/// Describes folders with pictures of several people.
fn of_people(root: &Path, folders: &[&PathBuf], pictures: &[&Named], people: BTreeSet<&str>) -> PicturesOfPeople {
    let mut people: Vec<String> = people.into_iter().filter(|name| !name.is_empty()).map(str::to_owned).collect();
    // The person of the example is named first.
    if let Some(place) = people.iter().position(|person| pair(root, pictures, person).is_some()) {
        let example = people.remove(place);
        people.insert(0, example);
    }
    PicturesOfPeople {
        folders: folders.iter().map(|folder| relative(root, folder)).collect(),
        pair: people.first().and_then(|person| pair(root, pictures, person)),
        people,
    }
}

/// Sequences of two pictures, and what was found beside them.
#[derive(Debug, Default)]
pub(super) struct Pairs {
    /// The sequences.
    pub rows: Vec<ProposedRow>,
    /// People without a neutral picture or without a picture of an expression, and other pictures in no pair.
    pub lacking: Vec<String>,
    /// Pictures from the side.
    side: usize,
    /// Collections without pairs.
    pub refused: Vec<PicturesOfPeople>,
}

impl Pairs {
    /// Adds a sequence of each neutral picture and each picture of an expression of the same person. Returns `false`, without a change, if there
    /// is none.
    ///
    /// `place` is the name of the sequence and, in messages, of the place of a picture.
    fn add(&mut self, root: &Path, pictures: &[&Named], place: impl Fn(&Named) -> (String, String)) -> bool {
        let (side, front): (Vec<&Named>, Vec<&Named>) = pictures.iter().partition(|p| p.is_side);
        let mut people: BTreeMap<String, [Vec<&Named>; 2]> = BTreeMap::new();
        let mut unknown: Vec<String> = Vec::new();
        for picture in front {
            match picture.emotion {
                Some(emotion) => {
                    let person = people.entry(name_key(&picture.person)).or_default();
                    person[usize::from(emotion != NEUTRAL)].push(picture);
                }
                None => unknown.push(format!("{} (no emotion in the name)", relative(root, &picture.path))),
            }
        }
        let mut rows = Vec::new();
        let mut lacking = Vec::new();
        let places: BTreeSet<String> = people.values().flat_map(|[_, others]| others).map(|p| place(p).1).collect();
        for [neutral, others] in people.values() {
            let Some(first) = neutral.first().or(others.first()) else { continue };
            let (subject, person) = (&first.subject, &first.person);
            let neutral = match &neutral[..] {
                [] => {
                    lacking.push(format!("{person} (no neutral picture)"));
                    continue;
                }
                [neutral] => *neutral,
                _ => {
                    lacking.push(format!("{person} (several neutral pictures)"));
                    continue;
                }
            };
            if others.is_empty() {
                lacking.push(format!("{person} (the neutral picture alone)"));
                continue;
            }
            for of in &places {
                let (sequence, emotion, picture) = match others.iter().filter(|p| place(p).1 == *of).collect::<Vec<_>>()[..] {
                    [] => {
                        lacking.push(format!("{person} (no picture in {of})"));
                        continue;
                    }
                    [picture] => (place(picture).0, picture.emotion.unwrap_or(UNKNOWN_EMOTION), picture),
                    _ => {
                        lacking.push(format!("{person} (several pictures in {of})"));
                        continue;
                    }
                };
                let pair = [neutral, *picture].map(|p| relative(root, &p.path));
                if pair.iter().any(|path| path.contains(PICTURE_SEPARATOR) || path.trim() != path) {
                    lacking.push(format!(
                        "{person} (`{PICTURE_SEPARATOR}` or a blank at an end in the name of {})",
                        pair.join(" or ")
                    ));
                    continue;
                }
                rows.push(ProposedRow {
                    subject: subject.clone(),
                    sequence,
                    emotion: emotion.to_owned(),
                    frames: pair.join(&PICTURE_SEPARATOR.to_string()),
                    landmarks: String::new(),
                    person: Vec::new(),
                    more: Vec::new(),
                });
            }
        }
        if rows.is_empty() {
            return false;
        }
        self.rows.extend(rows);
        self.lacking.extend(lacking.into_iter().chain(unknown));
        self.side += side.len();
        true
    }

    /// With the pictures from the side, as one message.
    fn finished(mut self) -> Self {
        if self.side > 0 {
            self.lacking.push(count(self.side, "picture from the side", "pictures from the side"));
        }
        self
    }
}

/// A folder whose name contains an emotion, with its pictures.
struct EmotionFolder {
    path: PathBuf,
    /// Its name without the emotion and numbers, such as the view in `neutral_front`.
    view: String,
    pictures: Vec<Named>,
}

/// The folder with its pictures, if its name contains one emotion.
fn emotion_folder(path: &Path) -> Option<EmotionFolder> {
    let name = composed(&path.file_name().unwrap_or_default().to_string_lossy());
    let (emotions, others): (Vec<&str>, Vec<&str>) = name.split(SEPARATORS).partition(|part| expression_of(part).is_some());
    let emotion = match &emotions[..] {
        [only] => expression_of(only)?,
        _ => return None,
    };
    let has_no_meaning =
        |part: &str| part.chars().all(|c| c.is_ascii_digit()) || PICTURE_WORDS.contains(&part.to_lowercase().as_str());
    let view = others.into_iter().filter(|part| !has_no_meaning(part)).collect::<Vec<_>>().join("_").to_lowercase();
    let mut pictures = pictures(path);
    pictures.iter_mut().for_each(|p| p.emotion = Some(emotion));
    Some(EmotionFolder { path: path.to_owned(), view, pictures })
}

/// Removes the last part from the names, if it is the same within every folder and differs between folders. Returns whether it does: `001_03` in one, `001_08` in the other.
fn without_codes(folders: &mut [EmotionFolder]) -> bool {
    let mut codes: BTreeSet<String> = BTreeSet::new();
    for folder in folders.iter() {
        let of_folder: BTreeSet<Option<&str>> = folder.pictures.iter().map(|p| Some(p.person.rsplit_once('_')?.1)).collect();
        match (of_folder.len(), of_folder.first()) {
            (1, Some(Some(code))) => codes.insert((*code).to_owned()),
            _ => return false,
        };
    }
    if codes.len() < folders.len() {
        return false;
    }
    for picture in folders.iter_mut().flat_map(|folder| &mut folder.pictures) {
        if let Some((person, _)) = picture.person.rsplit_once('_') {
            picture.person = person.to_owned();
            picture.subject.clone_from(&picture.person);
        }
    }
    true
}

/// People in several of the sibling folders, if these contain a picture of every person rather than the frames of one.
fn people_of(parent: &str, folders: &[EmotionFolder], are_coded: bool) -> Option<BTreeSet<String>> {
    let mut times: BTreeMap<&str, usize> = BTreeMap::new();
    for name in folders.iter().flat_map(|folder| folder.pictures.iter().map(|p| p.person.as_str()).collect::<BTreeSet<_>>()) {
        *times.entry(name).or_insert(0) += 1;
    }
    let is_person = |name: &str| {
        let word = numbered(name).0.to_lowercase();
        are_coded || !FRAME_WORDS.contains(&word.as_str()) && word != parent.to_lowercase()
    };
    let shared: BTreeSet<String> =
        times.into_iter().filter(|(name, count)| *count > 1 && is_person(name)).map(|(name, _)| name.to_owned()).collect();
    // Folders with one picture each are no sequences in any case.
    let sizes = || folders.iter().map(|folder| folder.pictures.len());
    let fewest = sizes().filter(|size| *size > 1).min().unwrap_or(1);
    let least = if sizes().all(|size| size == 1) { 1 } else { 2 };
    (shared.len() >= least && 2 * shared.len() >= fewest && (are_coded || !is_label(parent))).then_some(shared)
}

/// Removes folders with single pictures of people from what was found, and pairs their pictures. These are folders whose pictures show several
/// expressions and are not numbered like frames. They are also sibling folders named after emotions, one of them neutral, that contain files
/// with the same names.
pub(super) fn take_pictures_of_people(root: &Path, found: &mut Found) -> Pairs {
    let mut pairs = Pairs::default();
    let mut taken: BTreeSet<PathBuf> = BTreeSet::new();
    let mut beside: BTreeMap<PathBuf, BTreeMap<String, Vec<EmotionFolder>>> = BTreeMap::new();
    for folder in found.sequences.iter().filter(|path| path.is_dir()) {
        let pictures = pictures(folder);
        let emotions: BTreeSet<Option<&str>> = pictures.iter().map(|p| p.emotion).collect();
        if emotions.len() > 1 && !are_frames(&pictures) {
            let all: Vec<&Named> = pictures.iter().collect();
            if !pairs.add(root, &all, |p| (p.word.clone(), format!("`{}`", p.kind))) {
                pairs.refused.push(of_people(root, &[folder], &all, pictures.iter().map(|p| p.person.as_str()).collect()));
            }
            taken.insert(folder.clone());
        }
    }
    let with_one = found.left_out.iter().filter(|path| visible(path).is_ok_and(|e| e.iter().any(|e| is_picture(&e.path()))));
    for path in found.sequences.iter().filter(|path| path.is_dir() && !taken.contains(*path)).chain(with_one) {
        if let (Some(folder), Some(parent)) = (emotion_folder(path), path.parent()) {
            let views = beside.entry(parent.to_owned()).or_default();
            views.entry(folder.view.clone()).or_default().push(folder);
        }
    }
    let is_neutral = |folders: &Vec<EmotionFolder>| folders.iter().any(|f| f.pictures.iter().any(|p| p.emotion == Some(NEUTRAL)));
    for views in beside.values_mut() {
        views.retain(|_, folders| folders.len() > 1 && is_neutral(folders));
    }
    beside.retain(|_, views| !views.is_empty());
    // Several such parents mean one person each.
    let (Some((parent, mut views)), true) = (beside.pop_first(), beside.is_empty()) else {
        found.sequences.retain(|path| !taken.contains(path));
        return pairs.finished();
    };
    let name = parent.canonicalize().ok().and_then(|p| p.file_name().map(|n| composed(&n.to_string_lossy()))).unwrap_or_default();
    let mut people: BTreeSet<String> = BTreeSet::new();
    for folders in views.values_mut() {
        folders.sort_by(|a, b| a.path.cmp(&b.path));
        let mut shared = people_of(&name, folders, false);
        if shared.is_none() && without_codes(folders) {
            shared = people_of(&name, folders, true);
        }
        let Some(shared) = shared else { continue };
        let pictures: Vec<&Named> = folders.iter().flat_map(|folder| &folder.pictures).collect();
        let place = |picture: &Named| {
            let folder = picture.path.parent().unwrap_or(root);
            let name = composed(&folder.file_name().unwrap_or_default().to_string_lossy());
            (name, format!("`{}`", relative(root, folder)))
        };
        if pairs.add(root, &pictures, place) {
            people.extend(shared);
        } else {
            let paths: Vec<&PathBuf> = folders.iter().map(|folder| &folder.path).collect();
            pairs.refused.push(of_people(root, &paths, &pictures, shared.iter().map(String::as_str).collect()));
        }
        taken.extend(folders.iter().map(|folder| folder.path.clone()));
    }
    // Other folders with pictures of the same people are no sequences, either.
    let is_person =
        |p: &Named| people.contains(&p.person) || p.person.split('_').next().is_some_and(|part| people.contains(part));
    for path in found.sequences.iter().filter(|path| path.is_dir() && path.parent() == Some(&*parent)) {
        let is_of_people = || {
            let pictures = pictures(path);
            2 * pictures.iter().filter(|p| is_person(p)).count() >= pictures.len()
        };
        if !people.is_empty() && !taken.contains(path) && is_of_people() {
            pairs.lacking.push(format!("`{}` (no emotion in its name, or no neutral folder of this kind)", relative(root, path)));
            taken.insert(path.clone());
        }
    }
    found.sequences.retain(|path| !taken.contains(path));
    found.left_out.retain(|path| !taken.contains(path));
    pairs.finished()
}

#[cfg(test)]
mod tests {
    use super::super::super::folder_with as folder;
    use super::super::{ProposedRow, propose_manifest};
    use crate::dataset::DatasetError;

    fn files(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    fn pairs(names: &[String]) -> (Vec<String>, Vec<String>) {
        let manifest = propose_manifest(folder(names).path()).unwrap();
        let row = |row: &ProposedRow| format!("{} {} {} {}", row.subject, row.sequence, row.emotion, row.frames);
        (manifest.rows.iter().map(row).collect(), manifest.lacking)
    }

    #[test]
    fn a_folder_for_every_emotion_with_a_file_for_every_person_gives_pairs() {
        let mut names = files(&["S9/happy/1.png", "S9/happy/2.png", "mix/neutral/L004.jpg", "mix/smiling/L005.jpg"]);
        names.extend(["neutral", "smiling"].iter().flat_map(|f| ["L001", "L002"].map(|p| format!("mix/{f}/{p}.jpg"))));
        let (rows, lacking) = pairs(&names);
        let expected = [
            "L001 smiling happiness mix/neutral/L001.jpg;mix/smiling/L001.jpg",
            "L002 smiling happiness mix/neutral/L002.jpg;mix/smiling/L002.jpg",
            "S9 happy happiness S9/happy",
        ];
        assert_eq!(rows, expected);
        assert_eq!(lacking, ["L004 (the neutral picture alone)", "L005 (no neutral picture)"]);
        // Several emotions, one with a single picture, and other words for neutral.
        let (rows, lacking) =
            pairs(&files(&["visage neutre/a.jpg", "visage neutre/b.jpg", "sad/a.png", "joy/a.jpg", "joy/b.jpg"]));
        let expected = [
            "a joy happiness visage neutre/a.jpg;joy/a.jpg",
            "a sad sadness visage neutre/a.jpg;sad/a.png",
            "b joy happiness visage neutre/b.jpg;joy/b.jpg",
        ];
        assert_eq!(rows, expected);
        assert_eq!(lacking, ["b (no picture in `sad`)"]);
    }

    #[test]
    fn names_with_a_code_of_the_expression_are_paired_by_what_precedes_it() {
        let names = files(&[
            "neutral_front/001_03.jpg",
            "neutral_front/002_03.jpg",
            "neutral_front/005_03.jpg",
            "smiling_front/001_08.jpg",
            "smiling_front/002_08.jpg",
            "neutral_left/001_01.jpg",
            "neutral_left/002_01.jpg",
            "joie/001_09.jpg",
            "joie/002_09.jpg",
        ]);
        let (rows, lacking) = pairs(&names);
        let expected =
            ["001", "002"].map(|p| format!("{p} smiling_front happiness neutral_front/{p}_03.jpg;smiling_front/{p}_08.jpg"));
        assert_eq!(rows, expected);
        let left_out = |folder: &str| format!("`{folder}` (no emotion in its name, or no neutral folder of this kind)");
        assert_eq!(lacking, ["005 (the neutral picture alone)".to_owned(), left_out("joie"), left_out("neutral_left")]);
    }

    #[test]
    fn a_flat_folder_of_people_and_emotions_gives_pairs() {
        let names = ["L001_neutral.jpg", "L001_happy.jpg", "L003_Trauer.jpg", "L003_rest.jpg", "L004_neutral.jpg", "L005.jpg"];
        let (rows, lacking) = pairs(&files(&names));
        let expected =
            ["L001 happy happiness L001_neutral.jpg;L001_happy.jpg", "L003 Trauer sadness L003_rest.jpg;L003_Trauer.jpg"];
        assert_eq!(rows, expected);
        let expected = [
            "L001 (no picture in `trauer`)",
            "L003 (no picture in `happy`)",
            "L004 (the neutral picture alone)",
            "L005.jpg (no emotion in the name)",
        ];
        assert_eq!(lacking, expected);
        let (rows, _) = pairs(&files(&["anna/neutral.jpg", "anna/happy.jpg", "ben/neutral.jpg", "ben/happy.jpg"]));
        let expected = ["anna", "ben"].map(|p| format!("{p} happy happiness {p}/neutral.jpg;{p}/happy.jpg"));
        assert_eq!(rows, expected);
        // The two sessions of KDEF are of one person.
        let (rows, lacking) = pairs(&files(&["AF01NES.JPG", "AF01HAS.JPG", "BF01NES.JPG", "BF01HAS.JPG", "AF01HAHL.JPG"]));
        let expected = ["A", "B"].map(|s| format!("F01 {s}-HA happiness {s}F01NES.JPG;{s}F01HAS.JPG"));
        assert_eq!((rows, lacking), (expected.to_vec(), vec!["1 picture from the side".to_owned()]));
    }

    #[test]
    fn pictures_without_a_neutral_one_are_no_sequence() {
        let names = files(&["mix/L001_sad.jpg", "mix/L001_happy.jpg", "mix/L003_sad.jpg", "mix/L003_Trauer.jpg"]);
        let error = propose_manifest(folder(&names).path()).unwrap_err();
        assert!(matches!(&error, DatasetError::PicturesOfPeople { found, .. } if found.len() == 1), "{error}");
        let said = "`mix`: single pictures of several people: L001; L003; make a folder for every person and expression, with the neutral picture \
                    as 1 and the other as 2";
        assert!(error.to_string().ends_with(said), "{error}");
        // A person twice in one folder.
        let twice = files(&["L001_neutral.jpg", "L001-neutral.jpg", "L001_happy.jpg"]);
        let error = propose_manifest(folder(&twice).path()).unwrap_err().to_string();
        assert!(error.contains("to L001/happiness/1.jpg and L001_happy.jpg to L001/happiness/2.jpg"), "{error}");
    }

    #[test]
    fn frames_of_one_person_stay_a_sequence() {
        let taken = |names: &[String]| propose_manifest(folder(names).path()).unwrap().rows.len();
        let frames = |folders: &[&str], names: [&str; 2]| -> Vec<String> {
            folders.iter().flat_map(|folder| names.map(|name| format!("{folder}/{name}.png"))).collect()
        };
        assert_eq!(taken(&frames(&["S1/neutral", "S1/happy"], ["a001", "a002"])), 2, "the folder is named after a person");
        assert_eq!(taken(&frames(&["anna/neutral", "anna/happy"], ["1", "2"])), 2);
        assert_eq!(taken(&frames(&["anna/neutral", "anna/happy"], ["anna_001", "anna_002"])), 2);
        assert_eq!(taken(&frames(&["anna/neutral", "anna/happy", "ben/neutral", "ben/happy"], ["x01", "x02"])), 4);
        assert_eq!(taken(&frames(&["neutral", "happy"], ["frame_1", "frame_2"])), 2);
        assert_eq!(taken(&files(&["anna/neutral_1.png", "anna/happy_2.png"])), 1, "numbered from neutral to happy");
    }

    #[test]
    fn without_readable_files_the_readable_formats_are_listed() {
        let error = propose_manifest(folder(&files(&["anna/1.HEIC", "anna/2.HEIC", "b.gif"])).path()).unwrap_err();
        assert!(matches!(&error, DatasetError::NothingReadable { files, .. } if files.len() == 3), "{error}");
        let said = error.to_string();
        assert!(said.contains("anna/1.HEIC; anna/2.HEIC; b.gif") && said.contains("png jpg") && said.contains("mp4"), "{said}");
    }
}
