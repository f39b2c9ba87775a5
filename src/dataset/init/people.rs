//! Recognizes folders with single pictures of several people, which are not sequences although they hold two or more pictures.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
    path::{Path, PathBuf},
};

use super::{
    super::frames::{is_picture, visible},
    SEPARATORS,
    emotions::{emotion_of, has_other_words},
    is_label, relative,
};
use crate::{output::listed, text::composed};

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
    /// The name without emotions.
    person: String,
    emotion: Option<&'static str>,
}

/// Pictures of a folder.
fn pictures(folder: &Path) -> Vec<Named> {
    let files = visible(folder).unwrap_or_default().into_iter().map(|entry| entry.path()).filter(|path| is_picture(path));
    files
        .map(|path| {
            let stem = composed(&path.file_stem().unwrap_or_default().to_string_lossy());
            let is_emotion = |part: &&str| emotion_of(part).is_some() && !has_other_words(part);
            let parts: Vec<&str> = stem.split(SEPARATORS).filter(|part| !part.is_empty()).collect();
            let emotion = parts.iter().find(|part| is_emotion(part)).and_then(|part| emotion_of(part));
            let person = parts.iter().filter(|part| !is_emotion(part)).copied().collect::<Vec<_>>().join("_");
            Named { path, person, emotion }
        })
        .collect()
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

/// Removes folders with single pictures of people from `sequences`. These are folders whose pictures show several expressions and are not
/// numbered like frames. They are also sibling folders named after emotions, one of them neutral, that contain files with the same names.
pub(super) fn take_pictures_of_people(root: &Path, sequences: &mut Vec<PathBuf>) -> Vec<PicturesOfPeople> {
    let mut found = Vec::new();
    let mut taken: BTreeSet<PathBuf> = BTreeSet::new();
    let mut beside: BTreeMap<PathBuf, Vec<(&PathBuf, Vec<Named>)>> = BTreeMap::new();
    for folder in sequences.iter().filter(|path| path.is_dir()) {
        let mut pictures = pictures(folder);
        let emotions: BTreeSet<Option<&str>> = pictures.iter().map(|p| p.emotion).collect();
        if emotions.len() > 1 && !are_frames(&pictures) {
            let people = pictures.iter().map(|p| p.person.as_str()).collect();
            found.push(of_people(root, &[folder], &pictures.iter().collect::<Vec<_>>(), people));
            taken.insert(folder.clone());
            continue;
        }
        let name = composed(&folder.file_name().unwrap_or_default().to_string_lossy());
        let emotion = emotion_of(&name).filter(|_| !has_other_words(&name));
        if let (Some(emotion), Some(parent)) = (emotion, folder.parent()) {
            pictures.iter_mut().for_each(|p| p.emotion = Some(emotion));
            beside.entry(parent.to_owned()).or_default().push((folder, pictures));
        }
    }
    let is_neutral =
        |folders: &[(&PathBuf, Vec<Named>)]| folders.iter().any(|(_, p)| p.iter().any(|p| p.emotion == Some(NEUTRAL)));
    beside.retain(|_, folders| folders.len() > 1 && is_neutral(folders));
    // Several such parents mean one person each.
    if let (1, Some((parent, folders))) = (beside.len(), beside.first_key_value()) {
        let parent =
            parent.canonicalize().ok().and_then(|p| p.file_name().map(|n| composed(&n.to_string_lossy()))).unwrap_or_default();
        let mut times: BTreeMap<&str, usize> = BTreeMap::new();
        for name in folders.iter().flat_map(|(_, pictures)| pictures.iter().map(|p| p.person.as_str()).collect::<BTreeSet<_>>()) {
            *times.entry(name).or_insert(0) += 1;
        }
        let is_person = |name: &str| {
            let word = numbered(name).0.to_lowercase();
            !FRAME_WORDS.contains(&word.as_str()) && word != parent.to_lowercase()
        };
        let shared: BTreeSet<&str> =
            times.into_iter().filter(|(name, count)| *count > 1 && is_person(name)).map(|(name, _)| name).collect();
        let fewest = folders.iter().map(|(_, pictures)| pictures.len()).min().unwrap_or(0);
        if shared.len() > 1 && 2 * shared.len() >= fewest && !is_label(&parent) {
            let paths: Vec<&PathBuf> = folders.iter().map(|(path, _)| *path).collect();
            let pictures: Vec<&Named> = folders.iter().flat_map(|(_, pictures)| pictures).collect();
            found.push(of_people(root, &paths, &pictures, shared));
            taken.extend(paths.into_iter().cloned());
        }
    }
    sequences.retain(|path| !taken.contains(path));
    found
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::propose_manifest;
    use crate::dataset::DatasetError;

    fn folder(files: &[String]) -> tempfile::TempDir {
        let folder = tempfile::Builder::new().prefix("pictures").tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    fn files(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn a_folder_for_every_emotion_with_a_file_for_every_person_is_no_sequence() {
        let mut names = files(&["S9/happy/1.png", "S9/happy/2.png"]);
        names.extend(["neutral", "smiling"].iter().flat_map(|f| ["L001", "L002", "L003"].map(|p| format!("mix/{f}/{p}.jpg"))));
        let manifest = propose_manifest(folder(&names).path()).unwrap();
        assert_eq!(manifest.rows.iter().map(|row| row.frames.as_str()).collect::<Vec<_>>(), ["S9/happy"]);
        let said = "`mix/neutral`; `mix/smiling`: single pictures of several people: L001; L002; L003; make a folder for every person \
             and expression, with the neutral picture as 1 and the other as 2: copy mix/neutral/L001.jpg to L001/happiness/1.jpg and \
                    mix/smiling/L001.jpg to L001/happiness/2.jpg";
        assert_eq!(manifest.pictures_of_people.iter().map(ToString::to_string).collect::<Vec<_>>(), [said]);
        // There is nothing else.
        let error = propose_manifest(folder(&names[2..]).path()).unwrap_err();
        assert!(matches!(&error, DatasetError::PicturesOfPeople { found, .. } if found.len() == 1), "{error}");
        assert!(error.to_string().contains("copy mix/neutral/L001.jpg to L001/happiness/1.jpg"), "{error}");
    }

    #[test]
    fn a_flat_folder_of_people_and_emotions_is_no_sequence() {
        let names = files(&["L001_neutral.jpg", "L001_happy.jpg", "L003_neutral.jpg", "L003_Trauer.jpg"]);
        let error = propose_manifest(folder(&names).path()).unwrap_err().to_string();
        assert!(error.contains("several people: L001; L003;"), "{error}");
        assert!(
            error.contains("copy L001_neutral.jpg to L001/happiness/1.jpg and L001_happy.jpg to L001/happiness/2.jpg"),
            "{error}"
        );
    }

    #[test]
    fn frames_of_one_person_stay_a_sequence() {
        let taken = |names: &[String]| propose_manifest(folder(names).path()).unwrap().rows.len();
        let frames = |folders: &[&str], names: [&str; 2]| -> Vec<String> {
            folders.iter().flat_map(|folder| names.map(|name| format!("{folder}/{name}.png"))).collect()
        };
        assert_eq!(taken(&frames(&["S1/neutral", "S1/happy"], ["a001", "a002"])), 2, "the folder is called as a person");
        assert_eq!(taken(&frames(&["anna/neutral", "anna/happy"], ["1", "2"])), 2);
        assert_eq!(taken(&frames(&["anna/neutral", "anna/happy"], ["anna_001", "anna_002"])), 2);
        assert_eq!(taken(&frames(&["anna/neutral", "anna/happy", "ben/neutral", "ben/happy"], ["x01", "x02"])), 4);
        assert_eq!(taken(&frames(&["neutral", "happy"], ["frame_1", "frame_2"])), 2);
        assert_eq!(taken(&files(&["anna/neutral_1.png", "anna/happy_2.png"])), 1, "numbered from neutral to happy");
    }

    #[test]
    fn where_nothing_is_read_the_formats_that_are_read_are_named() {
        let error = propose_manifest(folder(&files(&["anna/1.HEIC", "anna/2.HEIC", "b.gif"])).path()).unwrap_err();
        assert!(matches!(&error, DatasetError::NothingReadable { files, .. } if files.len() == 3), "{error}");
        let said = error.to_string();
        assert!(said.contains("anna/1.HEIC; anna/2.HEIC; b.gif") && said.contains("png jpg") && said.contains("mp4"), "{said}");
    }
}
