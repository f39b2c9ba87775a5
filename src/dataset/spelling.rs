//! Finds files whose names have another Unicode form. An accent may be a separate character after its letter, as in macOS folders, or part
//! of the letter, as from keyboards and in spreadsheets. File systems that compare bytes distinguish the two; people do not.

use std::path::{Component, Path, PathBuf};

use crate::text::composed;

/// Resolves `value` relative to `root`: folders and files with exactly that name or, if there are none, with an equivalent name. Names that
/// do not exist are kept.
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

/// The first equivalent name in a folder.
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
        // Of a new path, the existing folders.
        assert!(root.join(place(&format!("{COMPOSED}/1/caf\u{e9}.csv"))).parent().unwrap().is_dir());
        // Other names are not equivalent, and the exact name has precedence.
        for other in ["Andre", "Andr\u{e8}/1", "none/\u{e9}"] {
            assert_eq!(place(other), other);
        }
        fs::create_dir(root.join(COMPOSED)).ok();
        assert_eq!(place(COMPOSED), COMPOSED);
        assert_eq!(composed(DECOMPOSED), COMPOSED);
    }
}
