//! Names of files that can be told apart: files of one name in a command get their extension, their folder or a number.

use std::path::Path;

/// How what tells names apart is added to them.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Before an extension.
    extension: &'static str,
    /// Before and behind a folder.
    folder: [&'static str; 2],
    /// Before and behind a number.
    number: [&'static str; 2],
}

/// For labels: `joy.csv`, `joy (london)`, `joy (2)`.
pub const LABELS: Style = Style { extension: ".", folder: [" (", ")"], number: [" (", ")"] };
/// For names of files and folders: `joy-csv`, `joy-london`, `joy~2`.
pub const FILES: Style = Style { extension: "-", folder: ["-", ""], number: ["~", ""] };

/// Makes the names of files distinct.
///
/// Equal names get the extension of their files where these differ. Names that are still equal get the nearest folder in which they
/// differ, and if there is none, the second and later ones get a number.
pub fn distinct<P: AsRef<Path>>(names: &[String], paths: &[P], style: Style) -> Vec<String> {
    let mut named = names.to_vec();
    let extension = |path: &Path| path.extension().map(|e| format!("{}{}", style.extension, e.to_string_lossy()));
    add(&mut named, paths, &|group| {
        let found: Vec<String> = group.iter().map(|path| extension(path).unwrap_or_default()).collect();
        found.iter().any(|one| *one != found[0]).then_some(found)
    });
    let folders = |path: &Path| -> Vec<String> {
        path.ancestors().skip(1).filter_map(Path::file_name).map(|name| name.to_string_lossy().into_owned()).collect()
    };
    let [before, behind] = style.folder;
    add(&mut named, paths, &|group| {
        let folders: Vec<Vec<String>> = group.iter().map(|path| folders(path)).collect();
        let depth = folders.iter().map(Vec::len).max().unwrap_or_default();
        (0..depth).find_map(|depth| {
            let at: Vec<Option<&String>> = folders.iter().map(|folders| folders.get(depth)).collect();
            let differ = (1..at.len()).all(|k| !at[..k].contains(&at[k]));
            let added = |folder: &Option<&String>| folder.map_or_else(String::new, |folder| format!("{before}{folder}{behind}"));
            differ.then(|| at.iter().map(added).collect())
        })
    });
    let [before, behind] = style.number;
    let mut taken: Vec<String> = Vec::with_capacity(named.len());
    for name in named {
        let numbered = || (2..).map(|k| format!("{name}{before}{k}{behind}")).find(|other| !taken.contains(other));
        let name = if taken.contains(&name) { numbered().unwrap_or_else(|| name.clone()) } else { name };
        taken.push(name);
    }
    taken
}

/// Adds to all names of a group of equal ones what `of` finds for their paths.
fn add<P: AsRef<Path>>(names: &mut [String], paths: &[P], of: &dyn Fn(&[&Path]) -> Option<Vec<String>>) {
    let mut done = vec![false; names.len()];
    for first in 0..names.len() {
        let group: Vec<usize> = (first..names.len()).filter(|&k| !done[k] && names[k] == names[first]).collect();
        group.iter().for_each(|&k| done[k] = true);
        let of_group: Vec<&Path> = group.iter().filter_map(|&k| paths.get(k)).map(AsRef::as_ref).collect();
        let added = if group.len() > 1 { of(&of_group) } else { None };
        for (&k, added) in group.iter().zip(added.into_iter().flatten()) {
            names[k].push_str(&added);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(paths: &[&str], style: Style) -> Vec<String> {
        let stem = |path: &&str| Path::new(path).file_stem().unwrap().to_string_lossy().into_owned();
        distinct(&paths.iter().map(stem).collect::<Vec<_>>(), paths, style)
    }

    #[test]
    fn equal_names_get_what_tells_them_apart() {
        assert_eq!(of(&["joy.csv", "joy.fap", "fear.csv"], LABELS), ["joy.csv", "joy.fap", "fear"]);
        assert_eq!(of(&["joy.csv", "joy.fap", "fear.csv"], FILES), ["joy-csv", "joy-fap", "fear"]);
        // One in the current folder; then folders that differ only farther up.
        assert_eq!(of(&["joy.csv", "a/joy.csv"], LABELS), ["joy", "joy (a)"]);
        assert_eq!(of(&["old/fap/joy.fap", "new/fap/joy.fap"], FILES), ["joy-old", "joy-new"]);
        assert_eq!(of(&["a/joy.csv", "joy.fap", "b/joy.csv"], LABELS), ["joy.csv (a)", "joy.fap", "joy.csv (b)"]);
        // The same file three times; a name that looks like another's number.
        assert_eq!(of(&["a/joy.csv"; 3], FILES), ["joy", "joy~2", "joy~3"]);
        assert_eq!(of(&["joy (2).csv", "a/joy.csv", "a/joy.csv"], LABELS), ["joy (2)", "joy", "joy (3)"]);
        assert_eq!(of(&[], LABELS), Vec::<String>::new());
    }
}
