//! Names with letters that Unicode writes in two ways: an accent of its own behind its letter, as macOS writes folders, or one with it, as keyboards
//! and spreadsheets write tables. A file system that keeps the bytes takes the two for different names; people do not.

use std::path::{Component, Path, PathBuf};

use crate::text::composed;

/// Where `value`, relative to `root`, lies: folders and files of that very name, and where there are none, those whose names are the same text.
/// What is not there at all keeps its name.
pub(super) fn place_of(root: &Path, value: &str) -> PathBuf {
    let named = root.join(value);
    if value.is_ascii() || named.exists() {
        return named;
    }
    named.components().fold(PathBuf::new(), |folder, component| {
        let next = folder.join(component);
        match component {
            Component::Normal(name) if !next.exists() => {
                name.to_str().and_then(|name| same_text(&folder, name)).map_or(next, |found| folder.join(found))
            }
            _ => next,
        }
    })
}

/// The first name in a folder that is the same text.
fn same_text(folder: &Path, name: &str) -> Option<String> {
    if name.is_ascii() {
        return None;
    }
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let names = folder.read_dir().ok()?.flatten().filter_map(|entry| entry.file_name().into_string().ok());
    let meant = composed(name);
    names.filter(|other| composed(other) == meant).min()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    const DECOMPOSED: &str = "Andre\u{301}";
    const COMPOSED: &str = "Andr\u{e9}";

    #[test]
    fn names_that_are_the_same_text_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        for path in [format!("{DECOMPOSED}/1/fe\u{302}te"), format!("{COMPOSED} B")] {
            fs::create_dir_all(root.join(path)).unwrap();
        }
        let place = |value: &str| place_of(root, value).strip_prefix(root).unwrap().to_str().unwrap().to_owned();
        assert!(root.join(place("Andr\u{e9}/1/f\u{ea}te")).is_dir());
        assert!(root.join(place("Andre\u{301}/1/f\u{ea}te")).is_dir());
        assert!(root.join(place("Andre\u{301} B")).is_dir());
        // Of what is to be made, the folders that are there.
        assert!(root.join(place(&format!("{COMPOSED}/1/caf\u{e9}.csv"))).parent().unwrap().is_dir());
        // Another name is another name, and the very name comes first.
        for other in ["Andre", "Andr\u{e8}/1", "none/\u{e9}"] {
            assert_eq!(place(other), other);
        }
        fs::create_dir(root.join(COMPOSED)).ok();
        assert_eq!(place(COMPOSED), COMPOSED);
        assert_eq!(composed(DECOMPOSED), COMPOSED);
    }
}
