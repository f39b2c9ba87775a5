//! Finds what a folder holds beside the sequences of its manifest.

use std::path::{Path, PathBuf};

use super::{
    super::{MANIFEST_COLUMNS, PICTURE_SEPARATOR},
    kept::plain,
    manifest_path, propose_manifest,
};
use crate::{
    input::CsvFile,
    output::{count, listed},
};

/// Returns the frames of sequences that would be proposed for a folder and that its manifest does not list, neither as a whole nor in part.
/// Empty without a manifest, or if one of the two cannot be read.
fn unlisted(root: &Path) -> Vec<String> {
    let Some(known) = listed_frames(&manifest_path(root)) else { return Vec::new() };
    let Ok(proposed) = propose_manifest(root) else { return Vec::new() };
    // However a path is written.
    let resolved = |path: &str| {
        let path = root.join(path);
        path.canonicalize().unwrap_or(path)
    };
    let known: Vec<PathBuf> = known.iter().map(|path| resolved(path)).collect();
    let is_listed = |frames: &str| {
        // Of a pair, the expression: several have the same neutral picture.
        let path = resolved(frames.rsplit(PICTURE_SEPARATOR).next().unwrap_or(frames));
        known.iter().any(|known| path.starts_with(known) || known.starts_with(&path))
    };
    proposed.rows.into_iter().map(|row| row.frames).filter(|frames| !is_listed(frames)).collect()
}

/// Message about what [`unlisted`] finds.
pub fn unlisted_said(root: &Path) -> Option<String> {
    let (frames, text) = (unlisted(root), root.display().to_string());
    (!frames.is_empty()).then(|| {
        format!(
            "manifest.csv does not list {}: {}; `grimace init {} --force` adds {}, and keeps what the manifest says of the others",
            count(frames.len(), "recording of its folder", "recordings of its folder"),
            listed(&frames, 3),
            if text.contains(char::is_whitespace) { format!("\"{text}\"") } else { text.clone() },
            if frames.len() == 1 { "it" } else { "them" }
        )
    })
}

/// Folders and files that a manifest names as frames; `None` if it cannot be read.
fn listed_frames(manifest: &Path) -> Option<Vec<String>> {
    let csv = CsvFile::open(manifest).and_then(|csv| csv.or_semicolons(&MANIFEST_COLUMNS)).ok()?;
    let mut all = Vec::new();
    for row in csv.rows() {
        let row = row.ok()?;
        let field = |name: &str| csv.column(name).map(|k| row.get(k)).unwrap_or_default();
        let named = match field("frames") {
            "" => format!("{}/{}", field("subject"), field("sequence")),
            frames => plain(frames),
        };
        all.extend(named.split(PICTURE_SEPARATOR).map(str::trim).filter(|path| !path.is_empty()).map(str::to_owned));
    }
    Some(all)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn pictures_added_after_the_manifest_are_named() {
        let pair = |p: &str| [format!("{p}_neutral.jpg"), format!("{p}_happy.jpg")];
        let folder = super::super::super::folder_with(&[&pair("anna")[..], &pair("ben")[..], &["C/1.png".to_owned()]].concat());
        fs::write(folder.path().join("C/2.png"), "").unwrap();
        assert!(unlisted(folder.path()).is_empty(), "there is no manifest");
        propose_manifest(folder.path()).unwrap().write(&manifest_path(folder.path())).unwrap();
        assert!(unlisted(folder.path()).is_empty());
        for name in pair("dora") {
            fs::write(folder.path().join(name), "").unwrap();
        }
        fs::create_dir(folder.path().join("E")).unwrap();
        ["E/1.png", "E/2.png"].iter().for_each(|name| fs::write(folder.path().join(name), "").unwrap());
        assert_eq!(unlisted(folder.path()), ["E", "dora_neutral.jpg;dora_happy.jpg"]);
        // Other pairs of the same person, and a folder of which the manifest names single files.
        fs::write(
            manifest_path(folder.path()),
            "subject,sequence,emotion,frames\nd,1,joy,./dora_happy.jpg;x.jpg\nE,1,joy,E/2.png;E/1.png\nC,1,joy,C/\n",
        )
        .unwrap();
        assert_eq!(unlisted(folder.path()).len(), 2, "anna and ben");
    }
}
