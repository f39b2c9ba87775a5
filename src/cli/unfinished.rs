//! A folder in which a command was interrupted: the next one may write into it.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use grimace::output::{OutputError, write_bytes};

/// Name of the file that stands in a folder while a command writes into it.
const NAME: &str = "unfinished.txt";

/// Folders of a file for every frame.
const FRAMES: [&str; 2] = ["obj", "ply"];

/// The mark of a folder that was empty when a command began to write into it, and in which it has not come to its end.
pub struct Unfinished {
    folder: PathBuf,
    path: PathBuf,
}

impl Unfinished {
    /// The mark of a folder, be it there or not.
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), path: folder.join(NAME) }
    }

    /// Whether a command began in the folder and did not come to its end.
    pub fn is_there(&self) -> bool {
        self.path.is_file()
    }

    /// Sets the mark.
    pub fn begin(&self) -> Result<(), OutputError> {
        write_bytes(
            &self.path,
            b"grimace synthesize is at work here, or was interrupted; run again it writes this folder anew.\n",
        )
    }

    /// Removes what the interrupted command left under these names, in the folder and in those of `motions`, and the frames there: the next
    /// one may not make all of it.
    pub fn clear(&self, motions: &[&str], names: &[&str]) -> Result<(), OutputError> {
        for folder in motions.iter().map(|motion| self.folder.join(motion)).chain([self.folder.clone()]) {
            for path in names.iter().map(|name| folder.join(name)).filter(|path| path.is_file()) {
                fs::remove_file(&path).map_err(OutputError::at(&path))?;
            }
            for frames in FRAMES {
                let files = fs::read_dir(folder.join(frames)).into_iter().flatten().flatten();
                for file in files.filter(|file| is_frame(&file.file_name().to_string_lossy(), frames)) {
                    fs::remove_file(file.path()).map_err(OutputError::at(&file.path()))?;
                }
                // It goes when nothing else is in it.
                let _ = fs::remove_dir(folder.join(frames));
            }
        }
        Ok(())
    }

    /// Takes the mark away.
    pub fn end(&self) -> Result<(), OutputError> {
        match fs::remove_file(&self.path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(OutputError::at(&self.path)(error)),
            _ => Ok(()),
        }
    }
}

/// Whether a file is called as a frame: `frame_012.obj`.
fn is_frame(name: &str, extension: &str) -> bool {
    let number = name.strip_prefix("frame_").and_then(|rest| rest.strip_suffix(extension)?.strip_suffix('.'));
    number.is_some_and(|digits| digits.len() >= 3 && digits.bytes().all(|b| b.is_ascii_digit()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_interrupted_command_left_is_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let mark = Unfinished::in_folder(folder.path());
        assert!(!mark.is_there());
        mark.begin().unwrap();
        for name in
            ["obj/frame_000.obj", "joy/ply/frame_1234.ply", "obj/frame_1.obj", "obj/mine.obj", "surface.npy", "mine/surface.npy"]
        {
            write_bytes(&at(name), b"x").unwrap();
        }
        assert!(Unfinished::in_folder(folder.path()).is_there());
        mark.clear(&["joy"], &["surface.npy"]).unwrap();
        assert!(["obj/frame_000.obj", "joy/ply", "surface.npy"].iter().all(|name| !at(name).exists()));
        assert!(["obj/frame_1.obj", "obj/mine.obj", "mine/surface.npy"].iter().all(|name| at(name).exists()));
        mark.end().unwrap();
        mark.end().unwrap();
        assert!(!mark.is_there());
    }
}
