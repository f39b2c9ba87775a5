//! Transfers entries of an existing manifest to a proposal.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use super::{ProposedManifest, ProposedRow, UNKNOWN_EMOTION, id_key, unique_sequence};
use crate::{
    dataset::{DatasetError, MANIFEST_COLUMNS, PICTURE_SEPARATOR},
    input::CsvFile,
    text::composed,
};

/// Result of transferring an earlier manifest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Columns that were transferred.
    pub columns: Vec<String>,
    /// Frames of earlier rows that are not there; their rows are left out.
    pub gone: Vec<String>,
    /// Frames without an earlier row.
    pub added: Vec<String>,
}

/// An earlier manifest.
struct Earlier {
    csv: CsvFile,
    /// Rows by their frames, as a proposal names them.
    rows: BTreeMap<String, Vec<Vec<String>>>,
}

impl Earlier {
    fn read(path: &Path) -> Result<Self, DatasetError> {
        let csv = CsvFile::open(path)?.or_semicolons(&MANIFEST_COLUMNS)?;
        let mut earlier = Self { csv, rows: BTreeMap::new() };
        let mut rows: BTreeMap<String, Vec<Vec<String>>> = BTreeMap::new();
        // The proposal is written with commas between columns, so its only decimal number gets a decimal point.
        let fps = earlier.csv.column("fps").filter(|_| earlier.csv.separator() == b';');
        for row in earlier.csv.rows() {
            let row = row?;
            let field_of = |k: usize| match row.number(k) {
                Ok(number) if fps == Some(k) => number.to_string(),
                _ => row.get(k).to_owned(),
            };
            let fields: Vec<String> = (0..earlier.csv.header().len()).map(field_of).collect();
            let named = composed(&earlier.field(&fields, "frames"));
            let default = composed(&format!("{}/{}", earlier.field(&fields, "subject"), earlier.field(&fields, "sequence")));
            let place = if named.is_empty() { default } else { plain(&named) };
            rows.entry(place).or_default().push(fields);
        }
        earlier.rows = rows;
        Ok(earlier)
    }

    fn field(&self, row: &[String], name: &str) -> String {
        self.csv.column(name).and_then(|k| row.get(k).cloned()).unwrap_or_default()
    }
}

impl ProposedManifest {
    /// Names sequences and their emotions as an earlier manifest does for the same frames. Frames with several sequences are left to
    /// [`ProposedManifest::keep`]. New sequences get other names than these. Returns the sequences whose file names say another emotion,
    /// each with both.
    ///
    /// # Errors
    /// [`DatasetError`] when the earlier manifest cannot be read.
    pub fn keep_names(&mut self, path: &Path) -> Result<Vec<String>, DatasetError> {
        let earlier = Earlier::read(path)?;
        let mut others = Vec::new();
        let names = earlier.rows.values().flatten().map(|row| [earlier.field(row, "subject"), earlier.field(row, "sequence")]);
        let mut taken: BTreeSet<String> = names.map(|[subject, sequence]| id_key(&subject, &sequence)).collect();
        for row in &mut self.rows {
            let old = earlier.rows.get(&composed(&row.frames)).map(Vec::as_slice);
            if old.is_none() {
                row.sequence = unique_sequence(&mut taken, &row.subject, &row.sequence);
            }
            let Some([old]) = old else { continue };
            let [subject, sequence, emotion] = ["subject", "sequence", "emotion"].map(|name| earlier.field(old, name));
            if !subject.is_empty() && !sequence.is_empty() {
                (row.subject, row.sequence) = (subject, sequence);
            }
            if !emotion.is_empty() && emotion != UNKNOWN_EMOTION {
                if row.emotion != UNKNOWN_EMOTION && !row.emotion.eq_ignore_ascii_case(&emotion) {
                    others.push(format!("{}_{} ({emotion}; its name says {})", row.subject, row.sequence, row.emotion));
                }
                row.emotion = emotion;
            }
        }
        Ok(others)
    }

    /// Transfers entries of an earlier manifest for the same frames: emotions that are otherwise unknown, landmarks, and all columns
    /// without a proposed value, such as marks, chosen frames and `publish`. Columns of a table of people are transferred for people who are
    /// not in it.
    ///
    /// # Errors
    /// [`DatasetError`] when it cannot be read.
    pub fn keep(&mut self, path: &Path) -> Result<Kept, DatasetError> {
        // All rows are read before anything is changed.
        let mut earlier = Earlier::read(path)?;
        let mut kept = Kept::default();
        let known = ["subject", "sequence", "emotion", "frames", "landmarks"];
        let is_more = |name: &String| !name.is_empty() && !known.contains(&name.as_str()) && !self.person_columns.contains(name);
        let header = earlier.csv.header().iter().cloned().enumerate();
        let columns: Vec<(usize, String)> = header.filter(|(_, name)| is_more(name)).collect();
        // By column of people, its place in the earlier manifest.
        let of_people: Vec<Option<usize>> = self.person_columns.iter().map(|name| earlier.csv.column(name)).collect();
        let mut are_kept = vec![false; of_people.len()];
        for (_, name) in &columns {
            if !self.more_columns.contains(name) {
                self.more_columns.push(name.clone());
            }
        }
        let width = self.more_columns.len();
        let more_columns = self.more_columns.clone();
        let mut rows = Vec::with_capacity(self.rows.len());
        for mut row in std::mem::take(&mut self.rows) {
            row.more.resize(width, String::new());
            let Some(old) = earlier.rows.remove(&composed(&row.frames)) else {
                kept.added.push(row.frames.clone());
                rows.push(row);
                continue;
            };
            // Several sequences of one recording remain several.
            let several = old.len() > 1;
            for fields in &old {
                let mut row = row.clone();
                if several {
                    (row.subject, row.sequence) = (earlier.field(fields, "subject"), earlier.field(fields, "sequence"));
                }
                let emotion = earlier.field(fields, "emotion");
                if !emotion.is_empty() && (several || row.emotion == UNKNOWN_EMOTION) {
                    row.emotion = emotion;
                }
                if row.landmarks.is_empty() {
                    row.landmarks = earlier.field(fields, "landmarks");
                }
                for (k, name) in &columns {
                    let place = more_columns.iter().position(|column| column == name);
                    if let Some(value) =
                        place.and_then(|place| row.more.get_mut(place)).filter(|value| several || value.is_empty())
                    {
                        value.clone_from(&fields[*k]);
                    }
                }
                // The table of people has precedence over the earlier manifest, also where it says nothing.
                let is_joined = !self.unknown_people.contains(&row.subject);
                for ((value, column), is_kept) in row.person.iter_mut().zip(&of_people).zip(&mut are_kept) {
                    if let Some(known) =
                        column.and_then(|k| fields.get(k)).filter(|known| !is_joined && value.is_empty() && !known.is_empty())
                    {
                        value.clone_from(known);
                        *is_kept = true;
                    }
                }
                rows.push(row);
            }
        }
        // Rows that no proposal has stay if their frames are there: pairs of pictures, or frames outside of the folder.
        let folder = path.parent().unwrap_or(Path::new(""));
        let (there, gone): (BTreeMap<_, _>, BTreeMap<_, _>) =
            std::mem::take(&mut earlier.rows).into_iter().partition(|(frames, old)| {
                let landmarks = || old.iter().map(|fields| earlier.field(fields, "landmarks"));
                frames.split(PICTURE_SEPARATOR).all(|name| folder.join(name.trim()).exists())
                    || landmarks().all(|file| !file.is_empty() && folder.join(file).exists())
            });
        for fields in there.values().flatten() {
            let field = |name: &str| earlier.field(fields, name);
            let of = |column: Option<usize>| column.and_then(|k| fields.get(k)).cloned().unwrap_or_default();
            rows.push(ProposedRow {
                subject: field("subject"),
                sequence: field("sequence"),
                emotion: field("emotion"),
                frames: field("frames"),
                landmarks: field("landmarks"),
                person: of_people.iter().map(|column| of(*column)).collect(),
                more: more_columns.iter().map(|name| of(earlier.csv.column(name))).collect(),
            });
        }
        self.rows = rows;
        kept.gone = gone.into_keys().collect();
        kept.columns = columns.into_iter().map(|(_, name)| name).collect();
        kept.columns
            .extend(self.person_columns.iter().zip(are_kept).filter(|(_, is_kept)| *is_kept).map(|(name, _)| name.clone()));
        Ok(kept)
    }
}

/// Frames as a proposal names them.
pub(super) fn plain(frames: &str) -> String {
    let names = frames.split(PICTURE_SEPARATOR).map(|name| name.trim().trim_start_matches("./").trim_end_matches('/'));
    names.filter(|name| !name.is_empty()).collect::<Vec<_>>().join(&PICTURE_SEPARATOR.to_string())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::{manifest_path, propose_manifest};

    #[test]
    fn rows_that_no_proposal_has_stay_if_their_frames_are_there() {
        let folder = super::super::super::folder_with(&["D/A/1.png", "D/A/2.png", "E/1.png", "E/2.png", "D/l.csv"]);
        let root = folder.path().join("D");
        let path = manifest_path(&root);
        fs::write(
            &path,
            "subject,sequence,emotion,frames,landmarks,note\nA,pair,joy,A/1.png;A/2.png,,mine\nB,1,fear,../E,,\nC,1,fear,gone,,\n\
             L,1,fear,,l.csv,\n",
        )
        .unwrap();
        let mut manifest = propose_manifest(&root).unwrap();
        let kept = manifest.keep(&path).unwrap();
        assert_eq!(kept.gone, ["gone"]);
        manifest.write(&path).unwrap();
        let rows: Vec<String> = fs::read_to_string(&path).unwrap().lines().skip(2).map(str::to_owned).collect();
        assert_eq!(rows, ["B,1,fear,../E,,", "A,pair,joy,A/1.png;A/2.png,,mine", "L,1,fear,,l.csv,"]);
    }

    #[test]
    fn entries_of_a_person_are_kept_when_a_manifest_is_made_again() {
        let folder = tempfile::tempdir().unwrap();
        for file in ["A/a.mp4", "B/b.mp4"] {
            fs::create_dir(folder.path().join(file).parent().unwrap()).unwrap();
            fs::write(folder.path().join(file), "").unwrap();
        }
        let path = manifest_path(folder.path());
        fs::write(
            &path,
            "subject,sequence,emotion,frames,publish,first_frame,group\nA,a,fear,A/a.mp4,no,7,old\nC,c,joy,C/c.mp4,no,,old\n",
        )
        .unwrap();
        let people = folder.path().join("people.csv");
        fs::write(&people, "subject,group\nA,new\nB,new\n").unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        manifest.join_people(&people).unwrap();
        let kept = manifest.keep(&path).unwrap();
        assert_eq!((kept.columns, kept.gone), (vec!["publish".to_owned(), "first_frame".to_owned()], vec!["C/c.mp4".to_owned()]));
        assert_eq!(kept.added, ["B/b.mp4"]);
        manifest.write(&path).unwrap();
        let expected = "subject,sequence,emotion,frames,group,publish,first_frame\n\
                        A,a,fear,A/a.mp4,new,no,7\nB,b,?,B/b.mp4,new,,\n";
        assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        // A person who is not in the table of people keeps the old values.
        fs::write(&path, "subject,sequence,emotion,frames,group\nA,a,fear,A/a.mp4,old\nB,b,joy,B/b.mp4,old\n").unwrap();
        for (row, group) in [("B,new", "new"), ("B,", "")] {
            fs::write(&people, format!("subject,group\n{row}\n")).unwrap();
            let mut manifest = propose_manifest(folder.path()).unwrap();
            manifest.join_people(&people).unwrap();
            assert_eq!(manifest.keep(&path).unwrap().columns, ["group"]);
            assert_eq!([0, 1].map(|k| manifest.rows[k].person.clone()), [["old"], [group]]);
        }
        // Two sequences of one video, another spelling of a path, and an unreadable row.
        fs::write(&path, "subject,sequence,emotion,frames,publish\nA,1,joy,./A/a.mp4,no\nA,2,fear,A/a.mp4,yes\n").unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        manifest.keep(&path).unwrap();
        manifest.write(&path).unwrap();
        let expected = "subject,sequence,emotion,frames,publish\nA,1,joy,A/a.mp4,no\nA,2,fear,A/a.mp4,yes\nB,b,?,B/b.mp4,\n";
        assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        // Tables with semicolons and decimal commas become tables with commas.
        fs::write(&path, "subject;sequence;emotion;frames;fps\nA;a;joy;A/a.mp4;12,5\n").unwrap();
        fs::write(&people, "subject;weight\nA;61,5\n").unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        manifest.join_people(&people).unwrap();
        manifest.keep(&path).unwrap();
        manifest.write(&path).unwrap();
        let expected = "subject,sequence,emotion,frames,weight,fps\nA,a,joy,A/a.mp4,\"61,5\",12.5\nB,b,?,B/b.mp4,,\n";
        assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        fs::write(&path, "subject,sequence,emotion,frames\nA,a,joy,A/a.mp4,x,y,z\n").unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        let before = manifest.clone();
        assert!(manifest.keep(&path).is_err() && manifest == before);
    }

    #[test]
    fn names_and_emotions_of_an_earlier_manifest_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        for file in ["A_pre/happy.mp4", "B/sad.mp4", "C/x.mp4"] {
            fs::create_dir(folder.path().join(file).parent().unwrap()).unwrap();
            fs::write(folder.path().join(file), "").unwrap();
        }
        let path = manifest_path(folder.path());
        fs::write(&path, "subject,sequence,emotion,frames\nA,pre,amusement,A_pre/happy.mp4\nB,sad,?,B/sad.mp4\n").unwrap();
        let people = folder.path().join("people.csv");
        fs::write(&people, "subject,group\nA,1\nB,2\n").unwrap();
        let mut manifest = propose_manifest(folder.path()).unwrap();
        let others = manifest.keep_names(&path).unwrap();
        assert_eq!(others, ["A_pre (amusement; its name says happiness)"]);
        manifest.join_people(&people).unwrap();
        assert_eq!(manifest.keep(&path).unwrap().added, ["C/x.mp4"]);
        manifest.write(&path).unwrap();
        let expected = "subject,sequence,emotion,frames,group\nA,pre,amusement,A_pre/happy.mp4,1\nB,sad,sadness,B/sad.mp4,2\nC,x,?,C/x.mp4,\n";
        assert_eq!(fs::read_to_string(&path).unwrap(), expected);
        // A new recording with a name that was given to another one.
        fs::write(&path, "subject,sequence,emotion,frames\nC,x,joy,B/sad.mp4\n").unwrap();
        let mut renamed = propose_manifest(folder.path()).unwrap();
        renamed.keep_names(&path).unwrap();
        let names: Vec<String> =
            renamed.rows.iter().map(|row| format!("{} {} {}", row.subject, row.sequence, row.frames)).collect();
        assert_eq!(names, ["A_pre happy A_pre/happy.mp4", "C x B/sad.mp4", "C x-2 C/x.mp4"]);
    }
}
