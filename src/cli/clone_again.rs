//! Repeated `grimace clone`: a clone made earlier from the same files and options is kept.

use std::{fs, path::Path};

use grimace::{
    clone::{CLONE_SCHEMA, FRAMES_RECORD},
    input::record_at,
    output::{FolderRecord, MADE_BY},
};
use image::RgbImage;
use serde_json::Value;

/// Files of a clone in addition to those in its record.
const BESIDE: [&str; 3] = ["clone.fap", "overlay.png", "sheet.png"];

/// BLAKE3 of everything that determines a clone: this program, hashes of files, options.
pub fn inputs_hash(inputs: &Value) -> String {
    blake3::hash(format!("{MADE_BY}\n{inputs}").as_bytes()).to_hex().to_string()
}

/// BLAKE3 of the pixels of pictures.
pub fn pictures_hash(pictures: &[RgbImage]) -> String {
    let mut hasher = blake3::Hasher::new();
    for picture in pictures {
        hasher.update(picture.as_raw());
    }
    hasher.finalize().to_hex().to_string()
}

/// Returns the record of the clone in a folder, if it can be read. A record of a newer version is an error.
pub fn record_of(folder: &Path) -> anyhow::Result<Option<Value>> {
    let path = folder.join("clone.json");
    record_at(&path, CLONE_SCHEMA).map_err(|newer| anyhow::anyhow!("{}: {newer}, or choose another folder", path.display()))
}

/// Returns the apex frame of the clone in a folder with this record, if it has the same inputs and nobody changed it since.
pub fn made_before(folder: &Path, info: &Value, target: &str, inputs_blake3: &str) -> Option<RgbImage> {
    let is_same = info["inputs_blake3"].as_str() == Some(inputs_blake3);
    let is_whole = || FolderRecord::open(folder, FRAMES_RECORD, false).is_ok_and(|record| record.is_whole());
    if !is_same || !is_whole() || !BESIDE.iter().all(|name| folder.join(name).is_file()) {
        return None;
    }
    let apex = info["apex_frame"].as_u64()?;
    Some(image::open(folder.join(format!("frames/{target}_{apex:08}.png"))).ok()?.into_rgb8())
}

/// Returns whether a folder has folders of clones, as of a batch.
pub fn holds_a_batch(folder: &Path) -> bool {
    let is_clone = |entry: fs::DirEntry| entry.path().join(FRAMES_RECORD).is_file();
    fs::read_dir(folder).is_ok_and(|entries| entries.flatten().any(is_clone))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_of_a_later_version_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let record = |text: &str| {
            fs::write(folder.path().join("clone.json"), text).unwrap();
            record_of(folder.path()).map_err(|e| e.to_string())
        };
        assert!(record("{\"schema_version\": 1, \"apex_frame\": 3}").unwrap().is_some_and(|info| info["apex_frame"] == 3));
        assert_eq!(record("{\"schema_version\": 1,").unwrap(), None);
        let said = record("{\"schema_version\": 9}").unwrap_err();
        assert!(said.contains("clone.json: schema version 9; this program reads 1"), "{said}");
        fs::remove_file(folder.path().join("clone.json")).unwrap();
        assert_eq!(record_of(folder.path()).unwrap(), None);
    }
}
