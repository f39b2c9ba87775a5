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
    /// Folders with files of the same names that may as well be the frames of one person.
    pub frames_or_people: Vec<String>,
}

/// Pairs of pictures from one collection.
struct Paired<'a> {
    root: &'a Path,
    rows: Vec<ProposedRow>,
    lacking: Vec<String>,
    /// Names of people that differ only in case.
    alike: Vec<String>,
}

impl Paired<'_> {
    fn leave_out(&mut self, pictures: &[&Named], reason: &str) {
        self.lacking.extend(pictures.iter().map(|p| format!("{} ({reason})", relative(self.root, &p.path))));
    }

    /// Pairs the neutral picture of a person with each picture of an expression. `place`: see [`Pairs::add`].
    fn add_person(&mut self, neutral: &[&Named], others: &[&Named], place: impl Fn(&Named) -> (String, String)) {
        let Some(person) = neutral.first().or(others.first()).map(|first| &first.person) else { return };
        let spellings: BTreeSet<&str> = neutral.iter().chain(others).map(|p| p.person.as_str()).collect();
        let names = spellings.into_iter().collect::<Vec<_>>().join(" and ");
        let neutral = match neutral {
            [] => return self.leave_out(others, &format!("no neutral picture of {person}")),
            [neutral] if others.is_empty() => return self.leave_out(&[neutral], &format!("the only picture of {person}")),
            [neutral] => *neutral,
            several => {
                let reason = if names == *person {
                    format!("several neutral pictures of {person}")
                } else {
                    self.alike.push(names.clone());
                    format!("{names} differ only in case; rename one")
                };
                self.leave_out(several, &reason);
                return self.leave_out(others, &reason);
            }
        };
        let mut places: BTreeMap<String, Vec<&Named>> = BTreeMap::new();
        for picture in others {
            places.entry(place(picture).1).or_default().push(picture);
        }
        for (of, pictures) in &places {
            match pictures[..] {
                [picture] => self.add_pair(neutral, picture, place(picture).0),
                _ => self.leave_out(pictures, &format!("several pictures of {names} in {of}")),
            }
        }
    }

    fn add_pair(&mut self, neutral: &Named, picture: &Named, sequence: String) {
        let pair = [neutral, picture].map(|p| relative(self.root, &p.path));
        if pair.iter().any(|path| path.contains(PICTURE_SEPARATOR) || path.trim() != path) {
            let reason = format!("`{PICTURE_SEPARATOR}` or a blank at an end in the name of {}", pair.join(" or "));
            return self.leave_out(&[picture], &reason);
        }
        self.rows.push(ProposedRow {
            subject: neutral.subject.clone(),
            sequence,
            emotion: picture.emotion.unwrap_or(UNKNOWN_EMOTION).to_owned(),
            frames: pair.join(&PICTURE_SEPARATOR.to_string()),
            landmarks: String::new(),
            person: Vec::new(),
            more: Vec::new(),
        });
    }
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
        let mut paired = Paired { root, rows: Vec::new(), lacking: Vec::new(), alike: Vec::new() };
        for [neutral, others] in people.values() {
            paired.add_person(neutral, others, &place);
        }
        if paired.rows.is_empty() {
            return Err(paired.alike);
        }
        self.rows.extend(paired.rows);
        self.lacking.extend(paired.lacking);
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
/// `are_frames` says whether folders may hold frames; otherwise one person suffices. `is_root`: the parent holds all of the dataset. Its name is
/// that of a study rather than of a person (`ds3`), and files of the same names in every folder are frames only if they are numbered from 1.
fn people_of(
    (parent, is_root): (&str, bool),
    folders: &[EmotionFolder],
    are_coded: bool,
    are_frames: bool,
) -> Option<BTreeSet<String>> {
    let begin = folders.iter().any(|folder| consecutive(&folder.pictures).is_some_and(|n| n.first().is_some_and(|n| *n <= 1)));
    let are_named_alike = are_named_alike(folders);
    let mut times: BTreeMap<&str, usize> = BTreeMap::new();
    for name in folders.iter().flat_map(|folder| folder.pictures.iter().map(|p| p.person.as_str()).collect::<BTreeSet<_>>()) {
        *times.entry(name).or_insert(0) += 1;
    }
    let is_person = |name: &str| {
        let word = numbered(name).0.to_lowercase();
        let is_frame = FRAME_WORDS.contains(&word.as_str()) || word == parent.to_lowercase();
        are_coded || !is_frame || is_root && are_named_alike && !begin
    };
    let shared: BTreeSet<String> =
        times.into_iter().filter(|(name, count)| *count > 1 && is_person(name)).map(|(name, _)| name.to_owned()).collect();
    // Folders with one picture each are no sequences in any case.
    let sizes = || folders.iter().map(|folder| folder.pictures.len());
    let fewest = sizes().filter(|size| *size > 1).min().unwrap_or(1);
    let least = if sizes().all(|size| size == 1) { 1 } else { 2 };
    let suffice = if are_frames { shared.len() >= least && 2 * shared.len() >= fewest } else { !shared.is_empty() };
    let is_person = is_label(parent) && !(is_root && (are_named_alike || !begin));
    (suffice && (are_coded || !is_person)).then_some(shared)
}

/// Whether all folders hold files of the same names, and several.
fn are_named_alike(folders: &[EmotionFolder]) -> bool {
    let names = |folder: &EmotionFolder| folder.pictures.iter().map(|p| p.person.clone()).collect::<BTreeSet<_>>();
    let names: BTreeSet<BTreeSet<String>> = folders.iter().map(names).collect();
    names.len() == 1 && names.first().is_some_and(|names| names.len() > 1)
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

/// Sibling folders of one view, each with the pictures of one emotion.
struct Siblings {
    parent: PathBuf,
    folders: Vec<EmotionFolder>,
    /// People in several of them; `None` if the folders hold something else.
    people: Option<BTreeSet<String>>,
}

impl Siblings {
    /// Reads the names of their pictures.
    fn read(root: &Path, parent: &Path, mut folders: Vec<EmotionFolder>) -> Self {
        let name =
            parent.canonicalize().ok().and_then(|p| p.file_name().map(|n| composed(&n.to_string_lossy()))).unwrap_or_default();
        folders.sort_by(|a, b| a.path.cmp(&b.path));
        let mut all: Vec<&mut Named> = folders.iter_mut().flat_map(|folder| &mut folder.pictures).collect();
        read_to_pair(&mut all);
        without_shots(None, &mut all);
        let name = (name.as_str(), parent == root);
        let mut people = people_of(name, &folders, false, true);
        if people.is_none() && without_codes(&mut folders) {
            people = people_of(name, &folders, true, true);
        } else if people.is_none() && folders.iter().all(|f| f.pictures.len() < 2 || consecutive(&f.pictures).is_none()) {
            people = people_of(name, &folders, false, false);
        }
        Self { parent: parent.to_owned(), folders, people }
    }

    fn paths(&self) -> Vec<&PathBuf> {
        self.folders.iter().map(|folder| &folder.path).collect()
    }

    fn pictures(&self) -> Vec<&Named> {
        self.folders.iter().flat_map(|folder| &folder.pictures).collect()
    }

    /// Words before the numbers of its people's names.
    fn words(&self) -> BTreeSet<String> {
        self.people.iter().flatten().map(|name| numbered(name).0.to_lowercase()).collect()
    }
}

/// Siblings by their parent and view, those with one neutral folder and others.
fn siblings_in(root: &Path, found: &Found, taken: &BTreeSet<PathBuf>) -> Vec<Siblings> {
    let mut views: BTreeMap<(PathBuf, String), Vec<EmotionFolder>> = BTreeMap::new();
    let with_one = found.left_out.iter().filter(|path| visible(path).is_ok_and(|e| e.iter().any(|e| is_picture(&e.path()))));
    for path in found.sequences.iter().filter(|path| path.is_dir() && !taken.contains(*path)).chain(with_one) {
        if let (Some(folder), Some(parent)) = (emotion_folder(path), path.parent()) {
            views.entry((parent.to_owned(), folder.view.clone())).or_default().push(folder);
        }
    }
    let is_neutral = |folders: &[EmotionFolder]| folders.iter().any(|f| f.pictures.iter().any(|p| p.emotion == Some(NEUTRAL)));
    let of_people = views.into_iter().filter(|(_, folders)| folders.len() > 1 && is_neutral(folders));
    of_people.map(|((parent, _), folders)| Siblings::read(root, &parent, folders)).collect()
}

/// Names of folders that hold several people.
const GROUP_WORDS: [&str; 31] = [
    "female",
    "females",
    "women",
    "woman",
    "girls",
    "male",
    "males",
    "men",
    "man",
    "boys",
    "children",
    "adults",
    "young",
    "old",
    "older",
    "younger",
    "patients",
    "controls",
    "control",
    "healthy",
    "frauen",
    "männer",
    "maenner",
    "weiblich",
    "männlich",
    "maennlich",
    "kinder",
    "femmes",
    "hommes",
    "patienten",
    "kontrollen",
];

/// Whether siblings below several parents hold pictures of several people each, as when a collection is sorted by site or by sex, rather than
/// the frames of one person: every parent has two or more people, none of them in two parents, and not every parent its own word before numbers,
/// unless the parents have names of groups.
fn are_groups_of_people(siblings: &[Siblings]) -> bool {
    let mut parents: BTreeMap<&Path, [BTreeSet<String>; 2]> = BTreeMap::new();
    for of_view in siblings {
        let [people, words] = parents.entry(&of_view.parent).or_default();
        people.extend(of_view.people.iter().flatten().map(|name| name_key(name)));
        words.extend(of_view.words());
    }
    let all: Vec<&String> = parents.values().flat_map(|[people, _]| people).collect();
    let distinct: BTreeSet<&String> = all.iter().copied().collect();
    let words: BTreeSet<&String> = parents.values().flat_map(|[_, words]| words).collect();
    let is_group = |parent: &&Path| {
        let name = parent.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
        GROUP_WORDS.contains(&composed(&name).as_str())
    };
    let are_groups = parents.keys().all(is_group);
    let own_word = !are_groups && parents.values().all(|[_, words]| words.len() == 1) && words.len() == parents.len();
    parents.values().all(|[people, _]| people.len() > 1) && distinct.len() == all.len() && !own_word
}

/// Removes folders with single pictures of people from what was found, and pairs their pictures. These are folders whose pictures show several
/// expressions and are not numbered like frames. They are also sibling folders named after emotions, one of them neutral, that contain files
/// with the same names.
pub(super) fn take_pictures_of_people(root: &Path, found: &mut Found) -> Pairs {
    let mut pairs = Pairs::default();
    let mut taken: BTreeSet<PathBuf> = BTreeSet::new();
    let perhaps = take_folders_of_people(root, found, &mut pairs, &mut taken);
    let siblings = siblings_in(root, found, &taken);
    let parents: BTreeSet<&PathBuf> = siblings.iter().map(|of_view| &of_view.parent).collect();
    // Several parents mean one person each, unless they are groups of people.
    if parents.len() == 1 || are_groups_of_people(&siblings) {
        let mut people: BTreeSet<&String> = BTreeSet::new();
        for of_view in &siblings {
            if take_siblings(root, of_view, &mut pairs, &mut taken) {
                people.extend(of_view.people.iter().flatten());
            }
        }
        leave_of_people(root, found, &parents, &people, &mut pairs, &mut taken);
    }
    leave_rest(root, found, perhaps, &mut taken, &mut pairs);
    found.sequences.retain(|path| !taken.contains(path));
    found.left_out.retain(|path| !taken.contains(path));
    pairs.finished()
}

/// Takes folders whose pictures show several expressions of people. Returns those of one emotion in which a word such as `Joy` may be a name.
fn take_folders_of_people(
    root: &Path,
    found: &Found,
    pairs: &mut Pairs,
    taken: &mut BTreeSet<PathBuf>,
) -> BTreeMap<PathBuf, PicturesOfPeople> {
    let mut perhaps: BTreeMap<PathBuf, PicturesOfPeople> = BTreeMap::new();
    for folder in found.sequences.iter().filter(|path| path.is_dir()) {
        let mut pictures = pictures(folder);
        read_to_pair(&mut pictures.iter_mut().collect::<Vec<_>>());
        let emotions: BTreeSet<Option<&str>> = pictures.iter().map(|p| p.emotion).collect();
        if emotions.len() < 2 || are_frames(&pictures) {
            continue;
        }
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
    perhaps
}

/// Pairs the pictures of sibling folders. Returns whether there were pairs.
fn take_siblings(root: &Path, siblings: &Siblings, pairs: &mut Pairs, taken: &mut BTreeSet<PathBuf>) -> bool {
    let paths = siblings.paths();
    let Some(people) = &siblings.people else {
        if let Some(example) = nothing_in_common(root, &siblings.folders) {
            let folders = paths.iter().map(|folder| format!("{}/", relative(root, folder))).collect();
            pairs.refused.push(PicturesOfPeople { folders, reason: Unpaired::NothingInCommon { example } });
            taken.extend(paths.into_iter().cloned());
        } else if siblings.parent == root && are_named_alike(&siblings.folders) {
            pairs.frames_or_people.extend(paths.into_iter().map(|folder| format!("{}/", relative(root, folder))));
        }
        return false;
    };
    let place = |picture: &Named| {
        let folder = picture.path.parent().unwrap_or(root);
        let name = composed(&folder.file_name().unwrap_or_default().to_string_lossy());
        (picture.sequence(&name), format!("`{}`", picture.sequence(&relative(root, folder))))
    };
    let pictures = siblings.pictures();
    let added = pairs.add(root, &pictures, place);
    taken.extend(paths.iter().map(|path| (*path).clone()));
    match added {
        Ok(()) => true,
        Err(alike) => {
            pairs.refused.push(refused(root, &paths, &pictures, people.iter().map(String::as_str).collect(), alike));
            false
        }
    }
}

/// Takes other folders beside the siblings with pictures of the same people, which are no sequences, either.
fn leave_of_people(
    root: &Path,
    found: &Found,
    parents: &BTreeSet<&PathBuf>,
    people: &BTreeSet<&String>,
    pairs: &mut Pairs,
    taken: &mut BTreeSet<PathBuf>,
) {
    let is_person = |p: &Named| {
        let begin = p.person.split('_').next().unwrap_or_default();
        people.iter().any(|name| **name == p.person || *name == begin)
    };
    let is_beside = |path: &Path| path.parent().is_some_and(|parent| parents.iter().any(|known| *known == parent));
    for path in found.sequences.iter().filter(|path| path.is_dir() && is_beside(path)) {
        let is_of_people = || {
            let pictures = pictures(path);
            2 * pictures.iter().filter(|p| is_person(p)).count() >= pictures.len()
        };
        if !people.is_empty() && !taken.contains(path) && is_of_people() {
            pairs.unnamed.push(format!("`{}` (no emotion in its name, or no neutral folder of this kind)", relative(root, path)));
            taken.insert(path.clone());
        }
    }
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
mod tests;
