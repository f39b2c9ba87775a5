//! Describes collections of pictures of people that are in no row, with what to do.

use std::{fmt, path::Path};

use crate::output::listed;

/// Most names in a message.
const MOST_NAMED: usize = 6;

/// A collection of pictures of several people, which are in no row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PicturesOfPeople {
    /// Its folders, relative to the manifest.
    pub folders: Vec<String>,
    /// Why its pictures are in no pair.
    pub reason: Unpaired,
}

/// Why pictures of people are in no pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Unpaired {
    /// No person has one neutral picture and one of an expression.
    People {
        /// The people, from the file names.
        people: Vec<String>,
        /// Neutral picture and picture of an expression of one person, relative to the manifest, and the expression; `None` without such a
        /// pair.
        pair: Option<[String; 3]>,
    },
    /// Folders named after expressions have no file name in common.
    NothingInCommon {
        /// Names for the two pictures of a person, as an example.
        example: [String; 2],
    },
    /// The names neither contain an expression nor number frames.
    NoExpression {
        /// The files.
        files: Vec<String>,
    },
    /// Names of people that differ only in case.
    SameButCase {
        /// The names.
        names: Vec<String>,
    },
}

impl fmt::Display for PicturesOfPeople {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let folders: Vec<String> = self
            .folders
            .iter()
            .map(|folder| if folder == "." { "this folder".to_owned() } else { format!("`{folder}`") })
            .collect();
        let folders = listed(&folders, MOST_NAMED);
        let (people, pair) = match &self.reason {
            Unpaired::People { people, pair } => (people, pair),
            Unpaired::NothingInCommon { example: [neutral, other] } => {
                return write!(
                    f,
                    "{folders}: these folders hold pictures with no name in common; name the two pictures of a person alike, e.g. \
                     {neutral} and {other}, or number the frames of a sequence from 1 in each folder"
                );
            }
            Unpaired::NoExpression { files } => {
                return write!(
                    f,
                    "{folders}: the file names neither contain a known word for an expression nor number the frames of one sequence: {}; \
                     name the two pictures of a person like anna_neutral.jpg and anna_happy.jpg, or neutral/anna.jpg and happy/anna.jpg \
                     (words: neutral happy smiling sad angry fear disgust surprised contempt, German words, and the codes of KDEF, RaFD \
                     and CFD)",
                    listed(files, MOST_NAMED)
                );
            }
            Unpaired::SameButCase { names } => {
                return write!(f, "{folders}: names of people differ only in case: {}; rename one of them", names.join(", "));
            }
        };
        let whose = if people.len() == 1 { "single pictures of" } else { "single pictures of several people:" };
        write!(f, "{folders}: {whose} {}; ", listed(people, MOST_NAMED))?;
        write!(f, "make a folder for every person and expression, with the neutral picture as 1 and the other as 2")?;
        let Some([neutral, other, emotion]) = pair else { return Ok(()) };
        let person = people.first().map_or("", String::as_str);
        let extension =
            |file: &str| Path::new(file).extension().map_or_else(String::new, |e| format!(".{}", e.to_string_lossy()));
        let (first, second) = (extension(neutral), extension(other));
        write!(f, ": copy {neutral} to {person}/{emotion}/1{first} and {other} to {person}/{emotion}/2{second}")
    }
}
