//! Checks that the files that a command reads and writes are different files.

use std::{
    io::Read,
    path::{Path, PathBuf},
};

/// A file with the option or argument that names it.
pub type Named<'a> = (&'a str, &'a Path);

/// Resolves links and `.` and `..` in a path that may not exist yet.
fn resolved(path: &Path) -> PathBuf {
    if let Ok(full) = path.canonicalize() {
        return full;
    }
    // Links to missing files are followed by hand.
    if let Ok(behind) = path.read_link() {
        let folder = path.parent().unwrap_or(Path::new(""));
        return std::path::absolute(folder.join(behind)).unwrap_or_else(|_| path.to_owned());
    }
    match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => {
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            resolved(folder).join(name)
        }
        _ => path.to_owned(),
    }
}

/// Returns whether a path, which may not exist yet, is a folder or is inside it.
pub fn lies_in(path: &Path, folder: &Path) -> bool {
    resolved(path).starts_with(resolved(folder))
}

/// Refuses an output that is also another output or an input.
pub fn check_apart(outputs: &[Named<'_>], inputs: &[Named<'_>]) -> anyhow::Result<()> {
    let places: Vec<PathBuf> = outputs.iter().map(|(_, path)| resolved(path)).collect();
    for (k, (option, path)) in outputs.iter().enumerate() {
        if let Some(before) = places[..k].iter().position(|place| *place == places[k]) {
            anyhow::bail!("{}: {} and {option} name the same file; give two different names", path.display(), outputs[before].0);
        }
    }
    for (input, path) in inputs {
        let place = resolved(path);
        if let Some(k) = places.iter().position(|output| *output == place) {
            anyhow::bail!("{}: {} would overwrite {input}; give it another name", path.display(), outputs[k].0);
        }
    }
    Ok(())
}

/// Refuses an output that is one of the input files of a folder. The folder of a bare file name is the current one.
pub fn check_not_over(output: &Path, folder: &Path) -> anyhow::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    anyhow::ensure!(
        !(output.is_file() && lies_in(output, folder)),
        "{}: --output would overwrite a file of {}; give it another name",
        output.display(),
        folder.display()
    );
    Ok(())
}

/// Refuses an existing output that is not a table of this command, which begins with these columns: a person may have written it.
pub fn check_own_table(output: &Path, begins: &str) -> anyhow::Result<()> {
    let mut first = vec![0; begins.len()];
    let is_own = |first: &mut [u8]| {
        std::fs::File::open(output).and_then(|mut file| file.read_exact(first)).is_ok() && *first == *begins.as_bytes()
    };
    anyhow::ensure!(
        !output.exists() || is_own(&mut first),
        "{}: --output would overwrite a file that this command did not write; give it another name",
        output.display()
    );
    Ok(())
}

/// Refuses inputs inside a folder that is made anew.
pub fn check_outside(option: &str, folder: &Path, inputs: &[Named<'_>]) -> anyhow::Result<()> {
    for (input, path) in inputs {
        anyhow::ensure!(
            !lies_in(path, folder),
            "{}: {option} would replace this folder, but {input} lies in it; give another folder",
            path.display()
        );
    }
    Ok(())
}

/// Returns all files of a list with the same name.
pub fn all<'a>(name: &'a str, paths: impl IntoIterator<Item = &'a PathBuf>) -> impl Iterator<Item = Named<'a>> {
    paths.into_iter().map(move |path| (name, path.as_path()))
}

/// Returns the file of an option, if it is given.
pub fn maybe<'a>(name: &'a str, path: Option<&'a PathBuf>) -> impl Iterator<Item = Named<'a>> {
    path.into_iter().map(move |path| (name, path.as_path()))
}

/// Extensions of files that users give by mistake for a folder of results.
const FILE_ENDINGS: [&str; 24] = [
    "apng", "avi", "bvh", "csv", "fap", "fbx", "gif", "glb", "gltf", "html", "jpeg", "jpg", "json", "mkv", "mov", "mp4", "npy",
    "obj", "pdf", "ply", "png", "txt", "webm", "zip",
];

/// The extension in lower case if files of results have it that users name by mistake.
fn file_ending(path: &Path) -> Option<String> {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).filter(|ending| FILE_ENDINGS.contains(&ending.as_str()))
}

/// Refuses a folder of results with the name of a file, unless it exists as a folder. `choice` says how to choose the files in it.
pub fn check_folder_name(folder: &Path, choice: &str) -> anyhow::Result<()> {
    match file_ending(folder).filter(|_| !folder.is_dir()) {
        Some(ending) => anyhow::bail!(
            "{}: --output must name a folder, but this name ends in .{ending} like a file; name a folder ({choice})",
            folder.display()
        ),
        None => Ok(()),
    }
}

/// Refuses a page with the name of another kind of file.
pub fn check_page_name(page: &Path) -> anyhow::Result<()> {
    match file_ending(page).filter(|ending| ending != "html") {
        Some(ending) => {
            anyhow::bail!(
                "{}: --output is a web page, but this name ends in .{ending}; name a file ending in .html",
                page.display()
            )
        }
        None => Ok(()),
    }
}

/// Refuses a folder of films with the name of another kind of file, unless it exists as a folder.
pub fn check_films_name(films: &Path) -> anyhow::Result<()> {
    match file_ending(films).filter(|ending| !["mp4", "webm"].contains(&ending.as_str()) && !films.is_dir()) {
        Some(ending) => anyhow::bail!(
            "--overlay {}: films end in .mp4 or .webm, but this name ends in .{ending}; name a film, or a folder for several",
            films.display()
        ),
        None => Ok(()),
    }
}

/// Refuses a picture without the extension `.png`, the format that is written.
pub fn check_png(option: &str, path: &Path, or_folder: &str) -> anyhow::Result<()> {
    anyhow::ensure!(
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")),
        "{option} {}: the picture must be a .png file; name one{or_folder}",
        path.display()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(outputs: &[Named<'_>], inputs: &[Named<'_>]) -> String {
        check_apart(outputs, inputs).map_or_else(|error| error.to_string(), |()| String::new())
    }

    #[test]
    fn a_file_is_known_by_any_of_its_paths() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("sub")).unwrap();
        std::fs::write(at("marks.csv"), "").unwrap();
        let (a, b) = (at("a.csv"), at("b.csv"));
        assert_eq!(said(&[("--output", &a), ("--overlay", &b)], &[("IMAGE", &at("marks.csv"))]), "");
        let (dotted, up) = (at("./a.csv"), at("sub/../a.csv"));
        for same in [&a, &dotted, &up] {
            let both = said(&[("--output", &a), ("--overlay", same)], &[]);
            assert!(both.ends_with("--output and --overlay name the same file; give two different names"), "{both}");
        }
        let over = said(&[("--output", &at("sub/../marks.csv"))], &[("--correspondences", &at("marks.csv"))]);
        assert!(over.ends_with("marks.csv: --output would overwrite --correspondences; give it another name"), "{over}");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("sub"), at("link")).unwrap();
            std::os::unix::fs::symlink("marks.csv", at("other.csv")).unwrap();
            assert_ne!(said(&[("-o", &at("link/new.csv")), ("--more", &at("sub/new.csv"))], &[]), "");
            assert_ne!(said(&[("-o", &at("other.csv"))], &[("MARKS", &at("marks.csv"))]), "");
        }
        let over = check_not_over(&at("marks.csv"), folder.path()).unwrap_err().to_string();
        assert!(over.contains("--output would overwrite a file of"), "{over}");
        assert!(check_not_over(&a, folder.path()).is_ok() && check_not_over(&at("marks.csv"), &at("sub")).is_ok());
        std::fs::write(at("table.csv"), "subject,verdict\nS1,good\n").unwrap();
        assert!(
            check_own_table(&at("table.csv"), "subject,verdict").is_ok() && check_own_table(&at("new.csv"), "subject").is_ok()
        );
        assert!(
            check_own_table(&at("table.csv"), "subject,emotion").is_err() && check_own_table(&at("marks.csv"), "node").is_err()
        );
        let called =
            |name: &str| check_folder_name(&at(name), "see --format").map_or_else(|error| error.to_string(), |()| String::new());
        assert!(called("notes.TXT").ends_with("but this name ends in .txt like a file; name a folder (see --format)"));
        assert_eq!((called("v1.2"), called("anna.b"), called("smile")), (String::new(), String::new(), String::new()));
        std::fs::create_dir(at("old.gif")).unwrap();
        assert_eq!(called("old.gif"), "");
        let inside = |path: &str| check_outside("--output", &at("sub"), &[("--source", &at(path))]).is_err();
        assert!(inside("sub/a.fap") && inside("sub/deep/a.fap") && !inside("subject.fap"));
    }

    #[test]
    fn pages_and_films_have_no_names_of_other_files() {
        assert!(check_page_name("a.html".as_ref()).is_ok() && check_page_name("v1.2".as_ref()).is_ok());
        let said = check_page_name("a.PNG".as_ref()).unwrap_err().to_string();
        assert!(said.ends_with("this name ends in .png; name a file ending in .html"), "{said}");
        for good in ["a.mp4", "a.WEBM", "films", "session1.2"] {
            assert!(check_films_name(good.as_ref()).is_ok(), "{good}");
        }
        assert!(check_films_name("a.gif".as_ref()).unwrap_err().to_string().starts_with("--overlay a.gif: films end in"));
        let folder = tempfile::tempdir().unwrap();
        let named = folder.path().join("films.gif");
        std::fs::create_dir(&named).unwrap();
        assert!(check_films_name(&named).is_ok());
    }
}
