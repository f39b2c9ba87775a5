//! Record of the files that runs wrote into an output folder, so that no other file is replaced or removed.
//!
//! `run.json` lists the files of the last complete run with their hashes. During a run, `run.journal` lists the names to be written, on
//! disk before the first of them is written, and the hash of every file written since. It is removed when `run.json` contains all of it.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use rayon::prelude::*;

use super::{RunError, RunJson, file_blake3};
use crate::{
    output::{OutputError, count, is_inside},
    track::read_track_info,
};

/// Name of the journal.
pub(super) const JOURNAL: &str = "run.journal";

/// The record of a folder during a run.
pub(super) struct Ledger {
    out: PathBuf,
    /// Names that were written here, or were going to be.
    known: BTreeMap<String, Known>,
    journal: Mutex<Option<fs::File>>,
    force: bool,
}

/// State of a name.
#[derive(Default)]
struct Known {
    /// Hashes of the written contents.
    hashes: BTreeSet<String>,
    /// Whether an interrupted run was going to write it, and may have done so.
    is_open: bool,
}

impl Ledger {
    /// Reads `run.json`, if there is one, and the journal.
    pub(super) fn open(out: &Path, earlier: Option<&RunJson>, force: bool) -> Result<Self, OutputError> {
        let mut known: BTreeMap<String, Known> = BTreeMap::new();
        let path = out.join(JOURNAL);
        let journal = match crate::input::read(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            read => read.map_err(OutputError::at(&path))?,
        };
        // A line that a power failure truncated contains no valid hash.
        let journal = String::from_utf8_lossy(&journal).into_owned();
        let lines = journal.lines().filter_map(|line| line.split_once('\t'));
        let listed =
            earlier.iter().flat_map(|e| e.outputs.iter().chain(&e.kept).map(|(name, hash)| (name.as_str(), hash.as_str())));
        for (name, hash) in listed.chain(lines).filter(|(name, _)| is_inside(name)) {
            let known = known.entry(name.to_owned()).or_default();
            known.is_open = hash.is_empty();
            known.hashes.insert(hash.to_owned());
        }
        Ok(Self { out: out.to_owned(), known, journal: Mutex::new(None), force })
    }

    /// Claims names for results. An existing file that this folder's runs did not write is an error or, with `--force`, a message.
    pub(super) fn claim(&self, names: &[String]) -> Result<Vec<String>, RunError> {
        let changed: Vec<&String> = names.par_iter().filter(|name| self.is_changed(name)).collect();
        let (tracks, foreign): (Vec<&String>, Vec<&String>) =
            changed.into_iter().partition(|name| is_track(name, &self.out.join(name)));
        if let Some(first) = foreign.first()
            && !self.force
        {
            let more = foreign.len() - 1;
            let more = if more == 0 { String::new() } else { format!(" (and {} more)", count(more, "file", "files")) };
            return Err(RunError::Foreign { path: self.out.join(first), more });
        }
        self.append(names.iter().map(|name| (name.as_str(), "")), true)?;
        let said = |name: &&String| {
            format!("{name} was not written by a run into this folder, or was changed since; it was replaced (--force)")
        };
        let edited = tracks.iter().filter(|name| is_edited_track(&self.out.join(name))).map(|name| {
            format!("{name} was changed by hand and is overwritten; save hand corrections in corrections/ with `annotate`")
        });
        Ok(foreign.iter().map(said).chain(edited).collect())
    }

    /// Whether a file exists that differs from what a run wrote.
    fn is_changed(&self, name: &str) -> bool {
        let path = self.out.join(name);
        let is_as_written = |known: &Known| known.is_open || file_blake3(&path).is_some_and(|hash| known.hashes.contains(&hash));
        fs::symlink_metadata(&path).is_ok() && !self.known.get(name).is_some_and(is_as_written)
    }

    /// Records files that were written.
    pub(super) fn wrote<'a>(&self, files: impl IntoIterator<Item = (&'a String, &'a String)>) -> Result<(), OutputError> {
        self.append(files.into_iter().map(|(name, hash)| (name.as_str(), hash.as_str())), false)
    }

    fn append<'a>(&self, lines: impl Iterator<Item = (&'a str, &'a str)>, durable: bool) -> Result<(), OutputError> {
        let text = lines.fold(String::new(), |text, (name, hash)| text + name + "\t" + hash + "\n");
        let path = self.out.join(JOURNAL);
        let mut journal = self.journal.lock().unwrap_or_else(PoisonError::into_inner);
        let mut append = || -> io::Result<()> {
            let file = match journal.take() {
                Some(file) => file,
                None => fs::File::options().create(true).append(true).open(&path)?,
            };
            let file = journal.insert(file);
            file.write_all(text.as_bytes())?;
            if durable { file.sync_data() } else { Ok(()) }
        };
        append().map_err(OutputError::at(&path))
    }

    /// Removes unchanged files of earlier runs, complete or interrupted, that this run did not make. Changed files are kept. Returns their
    /// names with one of their recorded hashes, and a message about them.
    pub(super) fn remove_stale(&self, outputs: &BTreeMap<String, String>) -> (BTreeMap<String, String>, Vec<String>) {
        let (mut kept, mut said) = (BTreeMap::new(), Vec::new());
        for (name, Known { hashes, .. }) in self.known.iter().filter(|(name, _)| !outputs.contains_key(*name)) {
            let path = self.out.join(name);
            if fs::symlink_metadata(&path).is_err() {
                continue;
            }
            let is_ours = file_blake3(&path).is_some_and(|hash| hashes.contains(&hash));
            // A file that cannot be removed stays in the record.
            if !is_ours || fs::remove_file(&path).is_err() {
                kept.insert(name.clone(), hashes.iter().next_back().cloned().unwrap_or_default());
                said.push(format!(
                    "{name} is from an earlier run and was changed by hand; it is kept, but does not belong to this run"
                ));
            }
        }
        (kept, said)
    }

    /// Removes the journal; `run.json` contains all of it.
    pub(super) fn close(self) {
        drop(self.journal);
        remove_journal(&self.out);
    }
}

/// Removes the journal of a folder whose `run.json` describes a complete run and contains the same information.
pub(super) fn remove_journal(out: &Path) {
    let _ = fs::remove_file(out.join(JOURNAL));
}

/// Whether a file is a track of this program according to its `.json`, which `annotate` also updates.
fn is_track(name: &str, path: &Path) -> bool {
    name.starts_with("tracks/")
        && matches!(read_track_info(path), Ok(Some(info))
            if path.file_stem().is_some_and(|stem| stem.to_string_lossy() == info.id.to_string()))
}

/// Whether a file is the table of a track and differs from the one recorded in its `.json`.
fn is_edited_track(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "csv")
        && matches!(read_track_info(path), Ok(Some(info)) if file_blake3(path).is_some_and(|hash| hash != info.csv_blake3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::write_bytes;

    fn known(pairs: &[(&str, &[u8])]) -> BTreeMap<String, String> {
        pairs.iter().map(|(name, bytes)| ((*name).to_owned(), blake3::hash(bytes).to_hex().to_string())).collect()
    }

    #[test]
    fn only_what_the_record_lists_and_nobody_changed_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, bytes) in
            [("models/a.csv", "a"), ("models/b.csv", "edited"), ("models/mine.csv", "mine"), ("models/c.csv", "c")]
        {
            write_bytes(&at(name), bytes.as_bytes()).unwrap();
        }
        let ledger = Ledger::open(folder.path(), None, false).unwrap();
        ledger
            .append([("models/a.csv", ""), ("models/b.csv", ""), ("models/c.csv", ""), ("../x", "")].into_iter(), true)
            .unwrap();
        ledger.wrote(&known(&[("models/a.csv", b"a"), ("models/b.csv", b"b"), ("models/c.csv", b"c")])).unwrap();
        drop(ledger);
        // A killed process wrote no more than this journal.
        let ledger = Ledger::open(folder.path(), None, false).unwrap();
        assert!(!ledger.known.contains_key("../x"));
        let (kept, said) = ledger.remove_stale(&known(&[("models/c.csv", b"c")]));
        assert_eq!(kept.into_keys().collect::<Vec<_>>(), ["models/b.csv"]);
        assert!(said.len() == 1 && said[0].contains("models/b.csv"), "{said:?}");
        assert!(!at("models/a.csv").exists() && at("models/c.csv").exists() && at("models/mine.csv").exists());
        ledger.close();
        assert!(!at(JOURNAL).exists());
    }

    #[test]
    fn foreign_files_are_not_replaced_without_force() {
        let folder = tempfile::tempdir().unwrap();
        write_bytes(&folder.path().join("fap/joy.fap"), b"mine").unwrap();
        let names = ["fap/joy.fap".to_owned(), "statistics.csv".to_owned()];
        let ledger = Ledger::open(folder.path(), None, false).unwrap();
        let error = ledger.claim(&names).unwrap_err().to_string();
        assert!(error.contains("joy.fap") && error.contains("--force"), "{error}");
        let forced = Ledger::open(folder.path(), None, true).unwrap().claim(&names).unwrap();
        assert!(forced.len() == 1 && forced[0].contains("fap/joy.fap"), "{forced:?}");
        // A file that was changed after the run belongs to the user.
        let journal = Ledger::open(folder.path(), None, false).unwrap();
        journal.wrote(&known(&[("fap/joy.fap", b"ours")])).unwrap();
        drop(journal);
        assert!(Ledger::open(folder.path(), None, false).unwrap().claim(&names).is_err());
        Ledger::open(folder.path(), None, true).unwrap().claim(&names).unwrap();
        // Claimed names belong to this folder from then on.
        assert!(Ledger::open(folder.path(), None, false).unwrap().claim(&names).unwrap().is_empty());
    }
}
