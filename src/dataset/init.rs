//! Proposes a manifest for folders without one: a row for every folder of images and every video, at any depth, and for every pair of a neutral
//! picture and one of an expression.

mod codes;
mod emotions;
mod kept;
mod people;
mod pictures;
mod search;
#[cfg(test)]
mod tests;
mod unlisted;
mod unpaired;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use self::{
    emotions::{emotion_of, has_other_words},
    people::{Pairs, take_pictures_of_people},
    search::Found,
};
pub use self::{kept::Kept, unlisted::unlisted_said, unpaired::PicturesOfPeople};
use super::{
    Dataset, DatasetError, Labels, MANIFEST_NAME, cohn_kanade,
    entry::is_publish_column,
    error::name_key,
    frames::{has_extension, visible},
    landmarks::read_landmarks,
};
use crate::{
    input::CsvFile,
    output::{OutputError, write_records},
    text::{composed, excerpt},
};

/// Placeholder for an emotion that neither folders nor file names contain.
pub const UNKNOWN_EMOTION: &str = "?";

/// Separators of the parts of a name.
const SEPARATORS: [char; 3] = ['_', '-', ' '];

/// A row of a proposed manifest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProposedRow {
    /// Subject.
    pub subject: String,
    /// Sequence.
    pub sequence: String,
    /// Emotion, or [`UNKNOWN_EMOTION`].
    pub emotion: String,
    /// Folder of images, video, or pictures separated by `;`, relative to the manifest.
    pub frames: String,
    /// File or folder of landmarks, relative to the manifest; may be empty.
    pub landmarks: String,
    /// Fields of the person, in the order of [`ProposedManifest::person_columns`].
    pub person: Vec<String>,
    /// Fields of the sequence, in the order of [`ProposedManifest::more_columns`].
    pub more: Vec<String>,
}

/// A proposed manifest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ProposedManifest {
    /// Rows sorted by subject and sequence.
    pub rows: Vec<ProposedRow>,
    /// Columns that describe people.
    pub person_columns: Vec<String>,
    /// Further columns: known marks and frames, and those of an earlier manifest.
    pub more_columns: Vec<String>,
    /// Columns of the table of people that were not joined.
    pub not_joined: Vec<String>,
    /// Subjects missing from the table of people. If it has a column `publish`, they get `no`.
    pub unknown_people: Vec<String>,
    /// People in that table without a sequence.
    pub people_without_rows: Vec<String>,
    /// Sequences of a labelled dataset that were skipped, and names that no manifest can hold, with the reason.
    pub skipped: Vec<String>,
    /// Folders without a sequence, relative to the manifest: empty ones, and those with a single picture.
    pub left_out: Vec<String>,
    /// People and pictures in no pair of a neutral picture and one of an expression, with the reason.
    pub lacking: Vec<String>,
    /// Collections of pictures of several people, which are in no row.
    pub pictures_of_people: Vec<PicturesOfPeople>,
    /// Folders taken for the frames of one person each although all have files of the same names, numbered from 1: the numbers may as well be
    /// those of people.
    pub frames_or_people: Vec<String>,
    /// Videos and pictures in unsupported formats, relative to the manifest.
    pub unread: Vec<String>,
    /// Folders with results of this program, relative to the manifest. Runs and clones are not searched; other folders have pictures or
    /// videos written by a command, such as overlays.
    pub results: Vec<String>,
    /// The folder that contains everything, if its name is not a person's.
    pub holds_all: Option<String>,
}

/// Proposes a manifest for a folder.
///
/// For Cohn-Kanade's layout it uses its labels. Otherwise it has a row for every folder with two or more images and every video below, with
/// the emotion in the folder or file name. Single pictures of people, neutral and of expressions, are paired.
///
/// # Errors
/// [`DatasetError`] when a folder cannot be read or nothing is found.
pub fn propose_manifest(root: &Path) -> Result<ProposedManifest, DatasetError> {
    if !root.is_dir() {
        return Err(DatasetError::NotFound { path: root.to_owned() });
    }
    let labelled = match cohn_kanade::open(root, Labels::Needed) {
        Ok(dataset) => dataset,
        Err(DatasetError::NoEmotionFolder { .. }) => None,
        Err(error) => return Err(error),
    };
    let manifest = match labelled {
        Some(dataset) => of_dataset(root, &dataset),
        None => of_folders(root)?,
    };
    if manifest.rows.is_empty() {
        let root = root.to_owned();
        return Err(match manifest {
            ProposedManifest { pictures_of_people: found, .. } if !found.is_empty() => {
                DatasetError::PicturesOfPeople { root, found: found.iter().map(ToString::to_string).collect() }
            }
            ProposedManifest { unread: files, .. } if !files.is_empty() => DatasetError::NothingReadable { root, files },
            ProposedManifest { results, .. } if !results.is_empty() => DatasetError::OnlyResults { root, results },
            _ => DatasetError::NothingFound { root },
        });
    }
    Ok(manifest)
}

/// Headers of the column that names the person in a table of people, in any case.
const PERSON_COLUMNS: [&str; 14] = [
    "subject",
    "subject_id",
    "subject id",
    "subjectid",
    "person",
    "person_id",
    "person id",
    "participant",
    "participant_id",
    "participant id",
    "participantid",
    "id",
    "name",
    "code",
];

impl ProposedManifest {
    /// Joins a table of people: a CSV file with a column `subject`, `person`, `participant`, `id`, `name` or similar, in any case. Its
    /// other columns are added to every sequence of the subject, except columns that describe sequences ([`ProposedManifest::not_joined`]). Subjects are compared without regard to case, and
    /// `Ole B` is the subject `Ole_B` unless the table has both.
    ///
    /// # Errors
    /// [`DatasetError`] when the file cannot be read, has no such column, or none of its people is in the dataset.
    pub fn join_people(&mut self, path: &Path) -> Result<(), DatasetError> {
        let csv = CsvFile::open(path)?.or_semicolons(&PERSON_COLUMNS)?;
        let by = match self.person_column(&csv) {
            Some(column) => column,
            None => csv.require(["subject"])?[0],
        };
        let taken = ["subject", "sequence", "emotion", "frames", "landmarks"];
        let is_ours = |name: &String| {
            taken.iter().any(|ours| ours.eq_ignore_ascii_case(name)) || self.more_columns.iter().any(|more| more == name)
        };
        let named = || (0..csv.header().len()).filter(|&k| k != by && !csv.header()[k].is_empty());
        let (ours, others): (Vec<usize>, Vec<usize>) = named().partition(|&k| is_ours(&csv.header()[k]));
        let unnamed: Vec<usize> = (0..csv.header().len()).filter(|&k| csv.header()[k].is_empty()).collect();
        // Spreadsheets leave empty columns behind.
        let mut filled: BTreeSet<usize> = BTreeSet::new();
        // By name key: the name in the table, and the fields.
        let mut people: BTreeMap<String, (String, Vec<String>)> = BTreeMap::new();
        for row in csv.rows() {
            let row = row?;
            let fields: Vec<String> = others.iter().map(|&k| row.get(k).to_owned()).collect();
            filled.extend(unnamed.iter().filter(|&&k| !row.get(k).is_empty()));
            let subject = row.get(by).to_owned();
            let earlier = people.insert(name_key(&subject), (subject.clone(), fields.clone()));
            if earlier.is_some_and(|(_, earlier)| earlier != fields) {
                return Err(DatasetError::Contradiction { path: path.to_owned(), line: row.line(), subject });
            }
        }
        // Names from files have `_` between their words. By such a name: the key in the table, if it is the only one.
        let mut cleaned: BTreeMap<String, Option<String>> = BTreeMap::new();
        for (key, (name, _)) in &people {
            cleaned.entry(joined_words(name)).and_modify(|only| *only = None).or_insert_with(|| Some(key.clone()));
        }
        // Nor may two subjects share a person, whose consent is only one's.
        let mut subjects: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
        for row in &self.rows {
            subjects.entry(joined_words(&row.subject)).or_default().insert(&row.subject);
        }
        let shared: BTreeSet<String> =
            subjects.into_iter().filter(|(_, names)| names.len() > 1).map(|(joined, _)| joined).collect();
        let key_of = |subject: &str| {
            let (key, joined) = (name_key(subject), joined_words(subject));
            let known = people.contains_key(&key).then_some(key);
            known.or_else(|| cleaned.get(&joined).cloned().flatten().filter(|_| !shared.contains(&joined)))
        };
        if !self.rows.iter().any(|row| key_of(&row.subject).is_some()) {
            let subject = self.rows.first().map(|row| row.subject.clone()).unwrap_or_default();
            let without_zeros = |name: &str| name_key(name).trim_start_matches('0').to_owned();
            let listed: BTreeSet<String> = people.values().map(|(name, _)| without_zeros(name)).collect();
            let only_zeros = self.rows.iter().any(|row| listed.contains(&without_zeros(&row.subject)));
            return Err(DatasetError::NobodyKnown { path: path.to_owned(), subject, only_zeros });
        }
        let of_sequences = ours.iter().map(|&k| format!("`{}`, which the manifest sets for each sequence", csv.header()[k]));
        self.not_joined = of_sequences.chain(filled.iter().map(|k| format!("column {}, which has no name", k + 1))).collect();
        self.person_columns = others.iter().map(|&k| csv.header()[k].clone()).collect();
        // A person missing from a table of consents has not consented.
        let nothing_known = |column: &String| if is_publish_column(column) { "no".to_owned() } else { String::new() };
        let unknown_person: Vec<String> = self.person_columns.iter().map(nothing_known).collect();
        let (mut known, mut unknown) = (BTreeSet::new(), BTreeSet::new());
        for row in &mut self.rows {
            let key = key_of(&row.subject);
            if let Some((key, (_, fields))) = key.and_then(|key| people.get_key_value(&key)) {
                row.person.clone_from(fields);
                known.insert(key.clone());
            } else {
                row.person.clone_from(&unknown_person);
                unknown.insert(row.subject.clone());
            }
        }
        self.unknown_people = unknown.into_iter().collect();
        self.people_without_rows =
            people.into_iter().filter(|(key, _)| !known.contains(key)).map(|(_, (name, _))| name).collect();
        Ok(())
    }

    /// The column of a table of people with their names: `subject` or `person`, else that of [`PERSON_COLUMNS`] that names most of the
    /// dataset's subjects, the first of several.
    fn person_column(&self, csv: &CsvFile) -> Option<usize> {
        if let Some(column) = csv.column_of_any_case("subject").or_else(|| csv.column_of_any_case("person")) {
            return Some(column);
        }
        let subjects: BTreeSet<String> = self.rows.iter().map(|row| joined_words(&row.subject)).collect();
        let named = |column: usize| -> usize {
            let names: BTreeSet<String> = csv.rows().flatten().map(|row| joined_words(row.get(column))).collect();
            names.intersection(&subjects).count()
        };
        let columns = PERSON_COLUMNS.iter().filter_map(|name| csv.column_of_any_case(name)).enumerate();
        columns.max_by_key(|&(place, column)| (named(column), std::cmp::Reverse(place))).map(|(_, column)| column)
    }

    /// Writes `manifest.csv`.
    ///
    /// # Errors
    /// [`OutputError`] when it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let with_landmarks = self.rows.iter().any(|row| !row.landmarks.is_empty());
        let mut header: Vec<String> = ["subject", "sequence", "emotion", "frames"].map(str::to_owned).into();
        header.extend(with_landmarks.then(|| "landmarks".to_owned()));
        header.extend(self.person_columns.iter().chain(&self.more_columns).cloned());
        let rows = self.rows.iter().map(|row| {
            let ProposedRow { subject, sequence, emotion, frames, landmarks, person, more } = row.clone();
            let mut fields = vec![subject, sequence, emotion, frames];
            fields.extend(with_landmarks.then_some(landmarks));
            fields.extend(person);
            fields.extend(more);
            fields
        });
        write_records(path, header, rows).map(|_| ())
    }
}

/// Key of the id of a sequence.
fn id_key(subject: &str, sequence: &str) -> String {
    name_key(&format!("{subject}_{sequence}"))
}

/// A name for a sequence that no other has, with a number if necessary. `taken` are the keys of all ids.
fn unique_sequence(taken: &mut BTreeSet<String>, subject: &str, sequence: &str) -> String {
    let numbered = (2..).map(|number| format!("{sequence}-{number}"));
    let mut names = std::iter::once(sequence.to_owned()).chain(numbered);
    names.find(|name| taken.insert(id_key(subject, name))).unwrap_or_default()
}

/// Key of a name whose words may be separated by any separator.
fn joined_words(name: &str) -> String {
    name_key(&name.split(SEPARATORS).filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_"))
}

/// Path from `root` with `/` between folders.
fn relative(root: &Path, path: &Path) -> String {
    let inside = path.strip_prefix(root).unwrap_or(path);
    let parts: Vec<String> = inside.components().map(|c| c.as_os_str().to_string_lossy().into_owned()).collect();
    if parts.is_empty() { ".".to_owned() } else { parts.join("/") }
}

fn of_dataset(root: &Path, dataset: &Dataset) -> ProposedManifest {
    let marks = |entry: &super::SequenceEntry| {
        let file = entry.marks_path();
        file.is_file().then(|| relative(root, file))
    };
    let any_marks = dataset.sequences.iter().any(|entry| marks(entry).is_some());
    let row = |entry: &super::SequenceEntry| ProposedRow {
        subject: entry.id.subject.clone(),
        sequence: entry.id.sequence.clone(),
        emotion: entry.emotion.clone(),
        frames: relative(root, &entry.frames_path),
        landmarks: entry.landmarks_paths.first().map(|path| relative(root, path)).unwrap_or_default(),
        person: Vec::new(),
        more: any_marks.then(|| marks(entry).unwrap_or_default()).into_iter().collect(),
    };
    let skipped = dataset.skipped.iter().map(|s| format!("{}: {}", s.id, s.reason));
    let failed = dataset.failures.iter().map(|f| f.error.to_string());
    ProposedManifest {
        rows: dataset.sequences.iter().map(row).collect(),
        more_columns: any_marks.then(|| "correspondences".to_owned()).into_iter().collect(),
        skipped: skipped.chain(failed).collect(),
        ..ProposedManifest::default()
    }
}

/// Returns the table of landmarks in a folder of frames: the only one with `landmark` in its name that can be read.
fn landmarks_beside(frames: &Path) -> Option<PathBuf> {
    let is_table = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        has_extension(path, &["csv"]) && name.contains("landmark") && read_landmarks(path).is_ok()
    };
    let mut tables = visible(frames).ok()?.into_iter().map(|entry| entry.path()).filter(is_table);
    let found = tables.next()?;
    tables.next().is_none().then_some(found)
}

fn of_folders(root: &Path) -> Result<ProposedManifest, DatasetError> {
    let mut found = Found::in_folder(root)?;
    let Pairs { rows: pairs, lacking, refused: pictures_of_people, frames_or_people, .. } =
        take_pictures_of_people(root, &mut found);
    let relative_all = |paths: &[PathBuf]| paths.iter().map(|path| relative(root, path)).collect();
    let names: Vec<Vec<String>> = found.sequences.iter().map(|path| names(root, path)).collect();
    let holds_all = names.first().and_then(|n| n.first()).filter(|first| holds_all(first, &names)).cloned();
    let people_first = are_people(names.iter().filter_map(|n| n.get(usize::from(holds_all.is_some()))));
    let mut taken = BTreeSet::new();
    let mut unique = |subject: &str, sequence: String| unique_sequence(&mut taken, subject, &sequence);
    let row = |(path, names): (&PathBuf, &Vec<String>)| {
        let names = &names[usize::from(holds_all.is_some())..];
        let (subject, sequence) = subject_and_sequence(root, names, people_first);
        let sequence = unique(&subject, sequence);
        // A person's name such as Joy is not an emotion.
        let is_name = |name: &&String| people_first && names.len() > 1 && **name == subject && !has_other_words(name);
        let emotion =
            names.iter().rev().filter(|name| !is_name(name)).find_map(|name| emotion_of(name)).unwrap_or(UNKNOWN_EMOTION);
        let (emotion, frames) = (emotion.to_owned(), relative(root, path));
        let landmarks = landmarks_beside(path).map(|file| relative(root, &file)).unwrap_or_default();
        ProposedRow { subject, sequence, emotion, frames, landmarks, person: Vec::new(), more: Vec::new() }
    };
    let mut rows: Vec<ProposedRow> = found.sequences.iter().zip(&names).map(row).collect();
    rows.extend(pairs.into_iter().map(|row| ProposedRow { sequence: unique(&row.subject, row.sequence.clone()), ..row }));
    rows.sort_by(|a, b| (&a.subject, &a.sequence).cmp(&(&b.subject, &b.sequence)));
    let mut skipped = Vec::new();
    rows.retain(|row| {
        let reason = unlistable(row);
        skipped.extend(reason.map(|reason| format!("{} ({reason}; rename it)", excerpt(&row.frames))));
        reason.is_none()
    });
    let (left_out, unread, results) = (relative_all(&found.left_out), relative_all(&found.unread), relative_all(&found.results));
    Ok(ProposedManifest {
        rows,
        skipped,
        left_out,
        lacking,
        pictures_of_people,
        frames_or_people,
        unread,
        results,
        holds_all,
        ..ProposedManifest::default()
    })
}

/// Why no row of a manifest can name a sequence.
fn unlistable(row: &ProposedRow) -> Option<&'static str> {
    if row.frames.contains(char::REPLACEMENT_CHARACTER) {
        Some("its name is not UTF-8")
    } else if row.frames.trim() != row.frames {
        Some("its name begins or ends with a blank")
    } else if row.frames.chars().any(char::is_control) || row.frames.contains('\\') {
        Some("its name has a backslash or a control character")
    } else {
        None
    }
}

/// Whether the first folder of all sequences, such as `videos`, is without meaning: it is neither an emotion nor has a form typical of
/// people's labels, and a possible person's name follows in every path.
fn holds_all(first: &str, names: &[Vec<String>]) -> bool {
    let may_be_person = |name: &String| emotion_of(name).is_none_or(|_| has_other_words(name));
    emotion_of(first).is_none()
        && !is_label(first)
        && names.iter().all(|n| n.len() > 1 && n[0] == first && n[1..].iter().any(may_be_person))
}

/// Whether sibling folders are named after people: fewer than half of their names are emotions.
fn are_people<'a>(names: impl Iterator<Item = &'a String>) -> bool {
    let names: BTreeSet<&String> = names.collect();
    let emotions = names.iter().filter(|name| emotion_of(name).is_some() && !has_other_words(name)).count();
    2 * emotions < names.len()
}

/// Words that begin the names of folders for several people.
const COLLECTIONS: [&str; 16] = [
    "video", "data", "set", "image", "img", "face", "record", "part", "batch", "day", "take", "export", "vid", "disc", "disk",
    "study",
];

/// Whether a name is a short word and a number, a typical label of a person: `S1`, `sub-01`, `012`.
fn is_label(name: &str) -> bool {
    let digits = name.trim_start_matches(|c: char| !c.is_ascii_digit());
    let word = name[..name.len() - digits.len()].trim_end_matches(SEPARATORS).to_lowercase();
    let is_number = !digits.is_empty() && digits.chars().all(|c| c.is_ascii_digit());
    is_number
        && word.chars().count() <= 12
        && word.chars().all(char::is_alphabetic)
        && !COLLECTIONS.iter().any(|collection| word.starts_with(collection))
}

/// Names of the folders from `root` to a sequence, without a video's extension, in the form used in tables.
fn names(root: &Path, path: &Path) -> Vec<String> {
    let path = if path.is_file() { path.with_extension("") } else { path.to_owned() };
    let inside = path.strip_prefix(root).unwrap_or(&path);
    inside.components().map(|c| composed(&c.as_os_str().to_string_lossy())).collect()
}

/// Subject and sequence from the names.
///
/// The subject is the first name if `people_first`, else the first that is not an emotion; the others form the sequence. A single name is
/// split: the subject is the part before the first `_`, `-` or space or, if that is an emotion, the next part that is not.
fn subject_and_sequence(root: &Path, names: &[String], people_first: bool) -> (String, String) {
    let of_root = || root.canonicalize().ok().and_then(|p| p.file_name().map(|n| composed(&n.to_string_lossy())));
    let place =
        if people_first { Some(0) } else { names.iter().position(|name| emotion_of(name).is_none_or(|_| has_other_words(name))) };
    match (names, place) {
        ([], _) => (of_root().unwrap_or_else(|| "1".to_owned()), "1".to_owned()),
        ([name], _) => {
            let parts: Vec<&str> = name.split(SEPARATORS).collect();
            let is_emotion = |part: &str| emotion_of(part).is_some() && !has_other_words(part);
            match (name.split_once(SEPARATORS), parts.iter().position(|part| !part.is_empty() && !is_emotion(part))) {
                (Some(_), Some(place)) if is_emotion(parts[0]) => {
                    let others: Vec<&str> =
                        parts.iter().enumerate().filter(|(k, _)| *k != place).map(|(_, part)| *part).collect();
                    (parts[place].to_owned(), others.join("_"))
                }
                (Some((subject, sequence)), _) if !subject.is_empty() && !sequence.is_empty() => {
                    (subject.to_owned(), sequence.to_owned())
                }
                _ => (name.clone(), "1".to_owned()),
            }
        }
        (_, place) => {
            let place = place.unwrap_or(0);
            let others: Vec<&str> = names.iter().enumerate().filter(|(k, _)| *k != place).map(|(_, n)| n.as_str()).collect();
            (names[place].clone(), others.join("-"))
        }
    }
}

/// Path of a folder's manifest.
pub fn manifest_path(root: &Path) -> PathBuf {
    root.join(MANIFEST_NAME)
}
