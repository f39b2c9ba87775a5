//! Recognizes folders with single pictures of several people, which are not sequences although they hold two or more pictures, and pairs each
//! neutral picture with those of expressions.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use super::{
    super::{
        PICTURE_SEPARATOR,
        frames::{is_picture, visible},
        name_key,
    },
    ProposedRow, SEPARATORS, UNKNOWN_EMOTION, is_label,
    pictures::{
        FRAME_WORDS, NEUTRAL, Named, are_frames, are_unordered, consecutive, expression_of, numbered, pictures, read_to_pair,
        readings_in_folder, without_shots,
    },
    relative,
    search::Found,
    unpaired::{PicturesOfPeople, Unpaired},
};
use crate::{output::count, text::composed};

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
    let pair = people.first().and_then(|person| pair(root, pictures, person));
    let folders = folders.iter().map(|folder| relative(root, folder)).collect();
    PicturesOfPeople { folders, reason: Unpaired::People { people, pair } }
}

/// A collection without pairs; `alike` are names of people that differ only in case.
fn refused(
    root: &Path,
    folders: &[&PathBuf],
    pictures: &[&Named],
    people: BTreeSet<&str>,
    alike: Vec<String>,
) -> PicturesOfPeople {
    let refused = of_people(root, folders, pictures, people);
    if alike.is_empty() { refused } else { PicturesOfPeople { reason: Unpaired::SameButCase { names: alike }, ..refused } }
}

/// Sequences of two pictures, and what was found beside them.
#[derive(Debug, Default)]
pub(super) struct Pairs {
    /// The sequences.
    pub rows: Vec<ProposedRow>,
    /// Pictures of people, and other pictures, in no pair.
    pub lacking: Vec<String>,
    /// Pictures without an emotion in the name.
    unnamed: Vec<String>,
    /// Pictures from the side.
    side: usize,
    /// Collections without pairs.
    pub refused: Vec<PicturesOfPeople>,
}

impl Pairs {
    /// Adds a sequence of each neutral picture and each picture of an expression of the same person. If there is none, it changes nothing
    /// and returns names of people that differ only in case.
    ///
    /// `place` is the name of the sequence and, in messages, of the place of a picture.
    fn add(&mut self, root: &Path, pictures: &[&Named], place: impl Fn(&Named) -> (String, String)) -> Result<(), Vec<String>> {
        let (side, front): (Vec<&Named>, Vec<&Named>) = pictures.iter().partition(|p| p.is_side);
        let mut people: BTreeMap<String, [Vec<&Named>; 2]> = BTreeMap::new();
        let mut unnamed: Vec<String> = Vec::new();
        for picture in front {
            match picture.emotion {
                Some(emotion) => {
                    let person = people.entry(name_key(&picture.person)).or_default();
                    person[usize::from(emotion != NEUTRAL)].push(picture);
                }
                None => unnamed.push(format!("{} (no emotion in the name)", relative(root, &picture.path))),
            }
        }
        let mut rows = Vec::new();
        let mut lacking = Vec::new();
        let mut alike = Vec::new();
        for [neutral, others] in people.values() {
            let Some(person) = neutral.first().or(others.first()).map(|first| &first.person) else { continue };
            let spellings: BTreeSet<&str> = neutral.iter().chain(others).map(|p| p.person.as_str()).collect();
            let names = spellings.into_iter().collect::<Vec<_>>().join(" and ");
            let differ = names != *person;
            let mut leave_out = |pictures: &[&Named], reason: &str| {
                lacking.extend(pictures.iter().map(|p| format!("{} ({reason})", relative(root, &p.path))));
            };
            let neutral = match &neutral[..] {
                [] => {
                    leave_out(others, &format!("no neutral picture of {person}"));
                    continue;
                }
                [neutral] => *neutral,
                several => {
                    let reason = if differ {
                        alike.push(names.clone());
                        format!("{names} differ only in case; rename one")
                    } else {
                        format!("several neutral pictures of {person}")
                    };
                    leave_out(several, &reason);
                    leave_out(others, &reason);
                    continue;
                }
            };
            if others.is_empty() {
                leave_out(&[neutral], &format!("the only picture of {person}"));
                continue;
            }
            let mut places: BTreeMap<String, Vec<&Named>> = BTreeMap::new();
            for picture in others {
                places.entry(place(picture).1).or_default().push(picture);
            }
            for (of, pictures) in &places {
                let [picture] = pictures[..] else {
                    leave_out(pictures, &format!("several pictures of {names} in {of}"));
                    continue;
                };
                let pair = [neutral, picture].map(|p| relative(root, &p.path));
                if pair.iter().any(|path| path.contains(PICTURE_SEPARATOR) || path.trim() != path) {
                    leave_out(
                        &[picture],
                        &format!("`{PICTURE_SEPARATOR}` or a blank at an end in the name of {}", pair.join(" or ")),
                    );
                    continue;
                }
                rows.push(ProposedRow {
                    subject: neutral.subject.clone(),
                    sequence: place(picture).0,
                    emotion: picture.emotion.unwrap_or(UNKNOWN_EMOTION).to_owned(),
                    frames: pair.join(&PICTURE_SEPARATOR.to_string()),
                    landmarks: String::new(),
                    person: Vec::new(),
                    more: Vec::new(),
                });
            }
        }
        if rows.is_empty() {
            return Err(alike);
        }
        self.rows.extend(rows);
        self.lacking.extend(lacking);
        self.unnamed.extend(unnamed);
        self.side += side.len();
        Ok(())
    }

    /// With the pictures without an emotion after those of people, and the pictures from the side as one message.
    fn finished(mut self) -> Self {
        self.lacking.append(&mut self.unnamed);
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
    for picture in &mut pictures {
        if !picture.readings.is_empty() {
            let stem = composed(&picture.path.file_stem().unwrap_or_default().to_string_lossy());
            picture.readings = readings_in_folder(&stem, emotion);
            if let Some(reading) = picture.readings.last().cloned() {
                picture.take(reading);
            }
        }
        picture.emotion = Some(emotion);
    }
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
///
/// `are_frames` says whether folders may hold frames; otherwise one person suffices.
fn people_of(parent: &str, folders: &[EmotionFolder], are_coded: bool, are_frames: bool) -> Option<BTreeSet<String>> {
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
    let suffice = if are_frames { shared.len() >= least && 2 * shared.len() >= fewest } else { !shared.is_empty() };
    (suffice && (are_coded || !is_label(parent))).then_some(shared)
}

/// Names for an example, if the neutral folder and another have two or more pictures each, no name in common, and are not numbered like frames that
/// start anew in each folder.
fn nothing_in_common(root: &Path, folders: &[EmotionFolder]) -> Option<[String; 2]> {
    let (neutral, others): (Vec<&EmotionFolder>, Vec<&EmotionFolder>) =
        folders.iter().filter(|f| f.pictures.len() > 1).partition(|f| f.pictures.iter().all(|p| p.emotion == Some(NEUTRAL)));
    let (first, other) = (neutral.first()?, others.first()?);
    let names = |folders: &[&EmotionFolder]| -> BTreeSet<String> {
        let readings = folders
            .iter()
            .flat_map(|folder| &folder.pictures)
            .flat_map(|p| p.readings.iter().map(|reading| reading.person.as_str()).chain([p.person.as_str()]));
        readings.map(name_key).collect()
    };
    let numbers = |folder: &&EmotionFolder| consecutive(&folder.pictures);
    let restart =
        || others.iter().any(|other| numbers(first).zip(numbers(other)).is_some_and(|(first, other)| !first.is_disjoint(&other)));
    if !names(&neutral).is_disjoint(&names(&others)) || restart() {
        return None;
    }
    let extension = first.pictures.first()?.path.extension().map(|e| e.to_string_lossy().into_owned()).unwrap_or_default();
    Some([first, other].map(|folder| format!("{}/anna.{extension}", relative(root, &folder.path))))
}

/// Removes folders with single pictures of people from what was found, and pairs their pictures. These are folders whose pictures show several
/// expressions and are not numbered like frames. They are also sibling folders named after emotions, one of them neutral, that contain files
/// with the same names.
pub(super) fn take_pictures_of_people(root: &Path, found: &mut Found) -> Pairs {
    let mut pairs = Pairs::default();
    let mut taken: BTreeSet<PathBuf> = BTreeSet::new();
    // In a folder of one emotion, a word such as `Joy` may be a name.
    let mut perhaps: BTreeMap<PathBuf, PicturesOfPeople> = BTreeMap::new();
    let mut beside: BTreeMap<PathBuf, BTreeMap<String, Vec<EmotionFolder>>> = BTreeMap::new();
    for folder in found.sequences.iter().filter(|path| path.is_dir()) {
        let mut pictures = pictures(folder);
        read_to_pair(&mut pictures.iter_mut().collect::<Vec<_>>());
        let emotions: BTreeSet<Option<&str>> = pictures.iter().map(|p| p.emotion).collect();
        if emotions.len() > 1 && !are_frames(&pictures) {
            let resolved = folder.canonicalize().unwrap_or_else(|_| folder.clone());
            without_shots(Some(&resolved), &mut pictures.iter_mut().collect::<Vec<_>>());
            let all: Vec<&Named> = pictures.iter().collect();
            if let Err(alike) = pairs.add(root, &all, |p| (p.sequence(&p.word), format!("`{}`", p.sequence(&p.kind)))) {
                let refused = refused(root, &[folder], &all, pictures.iter().map(|p| p.person.as_str()).collect(), alike);
                if emotion_folder(folder).is_some() {
                    perhaps.insert(folder.clone(), refused);
                    continue;
                }
                pairs.refused.push(refused);
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
        leave_rest(root, found, perhaps, &mut taken, &mut pairs);
        found.sequences.retain(|path| !taken.contains(path));
        return pairs.finished();
    };
    let name = parent.canonicalize().ok().and_then(|p| p.file_name().map(|n| composed(&n.to_string_lossy()))).unwrap_or_default();
    let mut people: BTreeSet<String> = BTreeSet::new();
    for folders in views.values_mut() {
        folders.sort_by(|a, b| a.path.cmp(&b.path));
        let mut all: Vec<&mut Named> = folders.iter_mut().flat_map(|folder| &mut folder.pictures).collect();
        read_to_pair(&mut all);
        without_shots(None, &mut all);
        let mut shared = people_of(&name, folders, false, true);
        if shared.is_none() && without_codes(folders) {
            shared = people_of(&name, folders, true, true);
        } else if shared.is_none() && folders.iter().all(|f| f.pictures.len() < 2 || consecutive(&f.pictures).is_none()) {
            shared = people_of(&name, folders, false, false);
        }
        let paths: Vec<&PathBuf> = folders.iter().map(|folder| &folder.path).collect();
        let Some(shared) = shared else {
            if let Some(example) = nothing_in_common(root, folders) {
                let folders = paths.iter().map(|folder| format!("{}/", relative(root, folder))).collect();
                pairs.refused.push(PicturesOfPeople { folders, reason: Unpaired::NothingInCommon { example } });
                taken.extend(paths.into_iter().cloned());
            }
            continue;
        };
        let pictures: Vec<&Named> = folders.iter().flat_map(|folder| &folder.pictures).collect();
        let place = |picture: &Named| {
            let folder = picture.path.parent().unwrap_or(root);
            let name = composed(&folder.file_name().unwrap_or_default().to_string_lossy());
            (picture.sequence(&name), format!("`{}`", picture.sequence(&relative(root, folder))))
        };
        match pairs.add(root, &pictures, place) {
            Ok(()) => people.extend(shared),
            Err(alike) => {
                pairs.refused.push(refused(root, &paths, &pictures, shared.iter().map(String::as_str).collect(), alike));
            }
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
            pairs.unnamed.push(format!("`{}` (no emotion in its name, or no neutral folder of this kind)", relative(root, path)));
            taken.insert(path.clone());
        }
    }
    leave_rest(root, found, perhaps, &mut taken, &mut pairs);
    found.sequences.retain(|path| !taken.contains(path));
    found.left_out.retain(|path| !taken.contains(path));
    pairs.finished()
}

/// Takes the folders in `perhaps`, and those whose pictures are in no order because their names are those of people or of unknown expressions.
fn leave_rest(
    root: &Path,
    found: &Found,
    perhaps: BTreeMap<PathBuf, PicturesOfPeople>,
    taken: &mut BTreeSet<PathBuf>,
    pairs: &mut Pairs,
) {
    for (folder, refused) in perhaps {
        if taken.insert(folder) {
            pairs.refused.push(refused);
        }
    }
    for folder in found.sequences.iter().filter(|path| path.is_dir()) {
        let mut pictures = pictures(folder);
        pictures.retain(|picture| !found.is_own(&picture.path));
        if !taken.contains(folder) && are_unordered(&pictures) {
            let name = |p: &Named| p.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let files = pictures.iter().map(name).collect();
            let folders = vec![relative(root, folder)];
            pairs.refused.push(PicturesOfPeople { folders, reason: Unpaired::NoExpression { files } });
            taken.insert(folder.clone());
        }
    }
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
        assert_eq!(
            lacking,
            ["mix/neutral/L004.jpg (the only picture of L004)", "mix/smiling/L005.jpg (no neutral picture of L005)"]
        );
        // Several emotions, one with a single picture, and other words for neutral.
        let (rows, lacking) =
            pairs(&files(&["visage neutre/a.jpg", "visage neutre/b.jpg", "sad/a.png", "joy/a.jpg", "joy/b.jpg"]));
        let expected = [
            "a joy happiness visage neutre/a.jpg;joy/a.jpg",
            "a sad sadness visage neutre/a.jpg;sad/a.png",
            "b joy happiness visage neutre/b.jpg;joy/b.jpg",
        ];
        assert_eq!(rows, expected);
        assert!(lacking.is_empty(), "every picture is in a pair: {lacking:?}");
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
        assert_eq!(
            lacking,
            ["neutral_front/005_03.jpg (the only picture of 005)".to_owned(), left_out("joie"), left_out("neutral_left")]
        );
    }

    #[test]
    fn a_flat_folder_of_people_and_emotions_gives_pairs() {
        let names = ["L001_neutral.jpg", "L001_happy.jpg", "L003_Trauer.jpg", "L003_rest.jpg", "L004_neutral.jpg", "L005.jpg"];
        let (rows, lacking) = pairs(&files(&names));
        let expected =
            ["L001 happy happiness L001_neutral.jpg;L001_happy.jpg", "L003 Trauer sadness L003_rest.jpg;L003_Trauer.jpg"];
        assert_eq!(rows, expected);
        assert_eq!(lacking, ["L004_neutral.jpg (the only picture of L004)", "L005.jpg (no emotion in the name)"]);
        let (rows, _) = pairs(&files(&["anna/neutral.jpg", "anna/happy.jpg", "ben/neutral.jpg", "ben/happy.jpg"]));
        let expected = ["anna", "ben"].map(|p| format!("{p} happy happiness {p}/neutral.jpg;{p}/happy.jpg"));
        assert_eq!(rows, expected);
        // The two sessions of KDEF are of one person.
        let (rows, lacking) = pairs(&files(&["AF01NES.JPG", "AF01HAS.JPG", "BF01NES.JPG", "BF01HAS.JPG", "AF01HAHL.JPG"]));
        let expected = ["A", "B"].map(|s| format!("F01 {s}-HA happiness {s}F01NES.JPG;{s}F01HAS.JPG"));
        assert_eq!((rows, lacking), (expected.to_vec(), vec!["1 picture from the side".to_owned()]));
    }

    /// Without the frames.
    fn sequences(names: &[&str]) -> Vec<String> {
        let manifest = propose_manifest(folder(names).path()).unwrap();
        manifest.rows.iter().map(|row| format!("{} {} {}", row.subject, row.sequence, row.emotion)).collect()
    }

    fn refusal(names: &[&str]) -> String {
        propose_manifest(folder(names).path()).unwrap_err().to_string()
    }

    #[test]
    fn folders_of_emotions_without_a_common_name_are_no_sequences() {
        let camera = |folder: &str, last: u32| [0, 20, 40].map(|at| format!("{folder}/IMG_20240501_{}.jpg", 120_001 + last + at));
        let mut names = [camera("B4/neutral", 0), camera("B4/happy", 10)].concat();
        let said = refusal(&names.iter().map(String::as_str).collect::<Vec<_>>());
        let expected = "no sequences found: `B4/happy/`; `B4/neutral/`: these folders hold pictures with no name in common; name the two \
                        pictures of a person alike, e.g. B4/neutral/anna.jpg and B4/happy/anna.jpg";
        assert!(said.contains(expected), "{said}");
        // Beside others they are skipped.
        names.extend(files(&["S1/joy/1.png", "S1/joy/2.png"]));
        let manifest = propose_manifest(folder(&names).path()).unwrap();
        assert_eq!((manifest.rows.len(), manifest.pictures_of_people.len()), (1, 1));
        // One common name is a pair.
        let one = ["neutral/anna.jpg", "neutral/ben.jpg", "neutral/eva.jpg", "joy/anna.jpg", "joy/ole.jpg", "joy/ida.jpg"];
        assert_eq!(sequences(&one), ["anna joy happiness"]);
        // Frames that start anew, or that one person has, are sequences.
        assert_eq!(sequences(&["neutral/n1.png", "neutral/n2.png", "joy/j1.png", "joy/j2.png"]).len(), 2);
        let several = ["anna", "ben"].map(|p| [1, 2, 3, 4].map(|n| format!("{p}/{}/{n}.png", ["neutral", "joy"][n / 3])));
        assert_eq!(sequences(&several.concat().iter().map(String::as_str).collect::<Vec<_>>()).len(), 4);
    }

    #[test]
    fn people_may_have_the_name_of_an_emotion() {
        let names =
            ["Neu_neutral.jpg", "Neu_happy.jpg", "Joy_neutral.jpg", "Joy_happy.jpg", "ida_neutral.jpg", "ida_happy_smile.jpg"];
        assert_eq!(sequences(&names), ["Joy happy happiness", "Neu happy happiness", "ida happy_smile happiness"]);
        assert_eq!(sequences(&["happy_Joy.jpg", "neutral_Joy.jpg"]), ["Joy happy happiness"]);
        assert_eq!(
            sequences(&["neutral/Joy.jpg", "neutral/ida.jpg", "sad/Joy.jpg", "sad/ida.jpg"]),
            ["Joy sad sadness", "ida sad sadness"]
        );
        let (rows, lacking) = pairs(&files(&["ida_neutral.jpg", "ida_sad.jpg", "ida_sad_happy.jpg"]));
        assert_eq!((rows.len(), lacking), (1, vec!["ida_sad_happy.jpg (no neutral picture of ida_sad)".to_owned()]));
    }

    #[test]
    fn numbers_of_shots_are_not_of_people() {
        let names = ["anna_01_neutral.jpg", "anna_02_happy.jpg", "ben_03_neutral.jpg", "ben_04_happy.jpg"];
        assert_eq!(sequences(&names), ["anna happy happiness", "ben happy happiness"]);
        let names = ["anna_neutral_1.jpg", "anna_happy_2.jpg", "ben_neutral.jpg", "ben_happy.jpg"];
        assert_eq!(sequences(&names), ["anna happy happiness", "ben happy happiness"]);
        let names = ["neutral/anna_1.jpg", "neutral/ben_1.jpg", "happy/anna_2.jpg", "happy/ben_3.jpg"];
        assert_eq!(sequences(&names), ["anna happy happiness", "ben happy happiness"]);
        // These are people.
        let names =
            ["S_001_neutral.jpg", "S_001_happy.jpg", "S_002_neutral.jpg", "S_003_happy.jpg", "T_1_neutral.jpg", "T_1_sad.jpg"];
        assert_eq!(sequences(&names), ["S_001 happy happiness", "T_1 sad sadness"]);
    }

    #[test]
    fn every_picture_of_an_expression_pairs_with_the_neutral_one() {
        let expected = ["anna happy_1 happiness", "anna happy_2 happiness"];
        assert_eq!(sequences(&["anna_neutral.jpg", "anna_happy_1.jpg", "anna_happy_2.jpg"]), expected);
        assert_eq!(sequences(&["anna_neutral_1.jpg", "anna_happy_1.jpg", "anna_happy_2.jpg"]), expected);
        assert_eq!(sequences(&["anna/neutral.jpg", "anna/happy_1.jpg", "anna/happy_2.jpg"]), expected);
        let (_, lacking) =
            pairs(&files(&["anna_neutral.jpg", "anna_happy.jpg", "anna_sad_1.jpg", "anna_smile.jpg", "anna-smile.jpg"]));
        let of = |file: &str| format!("{file} (several pictures of anna in `smile`)");
        assert_eq!(lacking, ["anna-smile.jpg", "anna_smile.jpg"].map(of));
    }

    #[test]
    fn people_whose_names_differ_only_in_case_are_named() {
        let names = ["Carla_neutral.jpg", "Carla_happy.jpg", "carla_neutral.jpg", "carla_happy.jpg"];
        let said = refusal(&names);
        assert!(
            said.ends_with("this folder: names of people differ only in case: Carla and carla; rename one of them"),
            "{said}"
        );
        let (rows, lacking) = pairs(&files(&[&names[..], &["ida_neutral.jpg", "Ida_sad.jpg"]].concat()));
        assert_eq!(rows, ["ida sad sadness ida_neutral.jpg;Ida_sad.jpg"]);
        assert_eq!(
            (lacking.len(), lacking[0].as_str()),
            (4, "Carla_neutral.jpg (Carla and carla differ only in case; rename one)")
        );
    }

    #[test]
    fn pictures_with_unknown_words_are_no_sequence() {
        let said = refusal(&["anna_before.jpg", "anna_after.jpg", "ben_before.jpg", "ben_after.jpg"]);
        assert!(said.contains("known word for an expression") && said.contains("anna_after.jpg; anna_before.jpg"), "{said}");
        let said = refusal(&["L001n.jpg", "L001h.jpg", "L002n.jpg", "L002h.jpg"]);
        assert!(said.contains("name the two pictures of a person like anna_neutral.jpg and anna_happy.jpg"), "{said}");
        for frames in [
            &["a_1.png", "b_2.png", "c_3.png"][..],
            &["1_cropped.png", "2_cropped.png", "3_cropped.png"],
            &["1.png", "2.png", "3.png", "cover.png", "title.png"],
            &["start.png", "apex.png"],
        ] {
            let names: Vec<String> = frames.iter().map(|name| format!("anna/x/{name}")).collect();
            assert_eq!(sequences(&names.iter().map(String::as_str).collect::<Vec<_>>()).len(), 1, "{frames:?}");
        }
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
        let phases = files(&["anna/t_neutral_1.png", "anna/t_onset_2.png", "anna/t_happy_3.png", "anna/t_offset_4.png"]);
        assert_eq!(taken(&phases), 1, "phases between");
    }

    #[test]
    fn without_readable_files_the_readable_formats_are_listed() {
        let error = propose_manifest(folder(&files(&["anna/1.HEIC", "anna/2.HEIC", "b.gif"])).path()).unwrap_err();
        assert!(matches!(&error, DatasetError::NothingReadable { files, .. } if files.len() == 3), "{error}");
        let said = error.to_string();
        assert!(said.contains("anna/1.HEIC; anna/2.HEIC; b.gif") && said.contains("png jpg") && said.contains("mp4"), "{said}");
    }
}
