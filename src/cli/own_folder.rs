//! A folder of results of one command: no other command writes there at the same time, and only files of the command itself are
//! overwritten.

use std::path::{Path, PathBuf};

use grimace::output::{FolderRecord, OutputError};

/// A folder of results, with the record of the files that earlier runs of the command wrote there.
pub struct OwnFolder {
    folder: PathBuf,
    command: &'static str,
    record: FolderRecord,
}

impl OwnFolder {
    /// Opens the record of the folder, `COMMAND.b3`. Nothing is written yet.
    pub fn open(folder: &Path, command: &'static str) -> Result<Self, OutputError> {
        let record = FolderRecord::open(folder, &record_name(command), true)?;
        Ok(Self { folder: folder.to_owned(), command, record })
    }

    /// Refuses to overwrite files with these names that the command did not write or that were changed since.
    pub fn check_own<N: AsRef<str>>(&self, names: impl IntoIterator<Item = N>) -> anyhow::Result<()> {
        let is_foreign = |name: &N| {
            let is_there = std::fs::symlink_metadata(self.folder.join(name.as_ref())).is_ok();
            is_there && !self.record.is_unchanged(name.as_ref())
        };
        let foreign: Vec<N> = names.into_iter().filter(is_foreign).collect();
        let Some(first) = foreign.first() else { return Ok(()) };
        let more = if foreign.len() > 1 { format!(", and {} more files", foreign.len() - 1) } else { String::new() };
        anyhow::bail!(
            "{}: this file exists and differs from what an earlier `{}` wrote{more}; move it away, or choose another folder",
            self.folder.join(first.as_ref()).display(),
            self.command
        )
    }

    /// Claims the folder: until the end no other process of this command writes into it.
    pub fn begin(&self) -> Result<(), OutputError> {
        self.record.begin()
    }

    /// Records a file of the folder that was just written.
    pub fn wrote(&self, name: &str) -> Result<(), OutputError> {
        self.record.enter_written(name)
    }

    /// Records a file of the folder that was just written, with its BLAKE3.
    pub fn wrote_as(&self, name: &str, hash: impl std::fmt::Display) -> Result<(), OutputError> {
        self.record.wrote(name, hash.to_string())
    }

    /// Removes files of earlier commands that this one did not write, and releases the folder. Changed files are kept and reported.
    pub fn end(self) -> Result<(), OutputError> {
        for name in self.record.remove_stale()? {
            eprintln!(
                "note: {}: this file of an earlier `{}` was changed by hand and is kept; it does not belong to these results",
                self.folder.join(name).display(),
                self.command
            );
        }
        self.record.close()
    }

    /// Releases the folder and keeps all files of earlier commands.
    pub fn end_beside_earlier(self) -> Result<(), OutputError> {
        self.record.keep(|_| true);
        self.record.close()
    }
}

fn record_name(command: &str) -> String {
    format!("{command}.b3")
}

/// Refuses a file in place of a folder of results.
pub fn check_is_folder(path: &Path) -> anyhow::Result<()> {
    let is_there = path.exists();
    anyhow::ensure!(
        !is_there || path.is_dir(),
        "{}: this is a file, but --output must name a folder; give another name",
        path.display()
    );
    Ok(())
}

/// Returns whether a folder has files other than those that `command` keeps for itself.
pub fn is_used(folder: &Path, command: &str) -> bool {
    let own = [record_name(command), super::unfinished::NAME.to_owned()];
    let is_result = |name: &str| !own.iter().any(|own| own == name) && !name.starts_with(".grimace-");
    folder.read_dir().is_ok_and(|entries| entries.flatten().any(|entry| is_result(&entry.file_name().to_string_lossy())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_the_command_itself_wrote_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let write = |name: &str, text: &str| {
            let own = OwnFolder::open(folder.path(), "synthesize")?;
            own.check_own([name])?;
            own.begin()?;
            grimace::output::write_bytes(&at(name), text.as_bytes())?;
            own.wrote(name)?;
            anyhow::Ok(own.end()?)
        };
        write("joy/fitness.csv", "one").unwrap();
        assert!(is_used(folder.path(), "synthesize"));
        write("joy/fitness.csv", "two").unwrap();
        std::fs::write(at("joy/fitness.csv"), "mine").unwrap();
        let said = write("joy/fitness.csv", "three").unwrap_err().to_string();
        assert!(
            said.ends_with(
                "this file exists and differs from what an earlier `synthesize` wrote; move it away, or choose another \
             folder"
            ),
            "{said}"
        );
        std::fs::write(at("animation.glb"), "mine").unwrap();
        assert!(write("animation.glb", "ours").is_err());
        assert_eq!(std::fs::read_to_string(at("animation.glb")).unwrap(), "mine");
        // Files of an earlier command are removed with its folder; changed files are kept.
        write("fear/fitness.csv", "four").unwrap();
        write("weights.csv", "five").unwrap();
        assert!(at("joy/fitness.csv").exists() && !at("fear").exists());
        let said = check_is_folder(&at("weights.csv")).unwrap_err().to_string();
        assert!(said.ends_with("weights.csv: this is a file, but --output must name a folder; give another name"), "{said}");
        assert!(check_is_folder(folder.path()).is_ok() && check_is_folder(&at("new")).is_ok());
    }

    #[test]
    fn two_at_once_do_not_mix() {
        let folder = tempfile::tempdir().unwrap();
        let [first, second] = [(); 2].map(|()| OwnFolder::open(folder.path(), "figures").unwrap());
        first.begin().unwrap();
        assert!(!is_used(folder.path(), "figures"));
        assert!(second.begin().unwrap_err().to_string().contains("another command is writing into this folder"));
    }
}
