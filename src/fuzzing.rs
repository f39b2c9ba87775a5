//! Support for fuzzing: calls every reader through one interface and generates malformed files. Not part of the library's
//! interface.
//!
//! `fuzz/` drives it with libFuzzer; `tests/` and `scripts/fuzz` use [`mutate`], which needs no tool.

#![allow(missing_docs)]

use std::{
    cell::OnceCell,
    fs, io,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{
    columnar::ColumnarModels,
    dataset::{Dataset, read_landmarks},
    fap::{read_fap, read_tidy_csv},
    features::read_blendshapes,
    fit::{read_correspondences, read_neutral_faces, read_prior},
    mesh::{gltf::read_gltf, read_npy_indices, read_npy_rows, read_obj, read_ply},
    pipeline::{RunJson, load_columnar, read_model},
    sequence::{read_colour, read_frame},
    synthesis::{Bank, candide_bank, read_motion, read_recipes},
    track::{read_track, read_track_info},
    units::NodeId,
    wireframe::{Tables, Wireframe, read_wfm},
};

/// A kind of file with its reader.
#[derive(Debug)]
pub struct Target {
    /// Name of the target, of the folder with its seeds, and of its fuzz target.
    pub name: &'static str,
    /// File name, whose extension tells readers the kind.
    file: &'static str,
    /// Whether it is a text format; these get more executions.
    pub is_text: bool,
    read: fn(&Path) -> Outcome,
}

/// `Ok`, or the text of the error.
type Outcome = Result<(), String>;

fn said<T, E: std::fmt::Display>(result: Result<T, E>) -> Outcome {
    result.map(drop).map_err(|e| e.to_string())
}

const fn text(name: &'static str, file: &'static str, read: fn(&Path) -> Outcome) -> Target {
    Target { name, file, is_text: true, read }
}

const fn binary(name: &'static str, file: &'static str, read: fn(&Path) -> Outcome) -> Target {
    Target { name, file, is_text: false, read }
}

/// All readers.
pub static TARGETS: [Target; 29] = [
    text("fap", "a.fap", |p| said(read_fap(p))),
    text("fap_table", "a.csv", |p| said(read_tidy_csv(p, 25.0))),
    text("wireframe", "a.wfm", |p| said(read_wfm(p))),
    text("manifest", "manifest.csv", |p| match Dataset::open(p) {
        Ok(dataset) => dataset.failures.first().map_or(Ok(()), |f| Err(f.error.to_string())),
        Err(error) => Err(error.to_string()),
    }),
    text("correspondences", "c.csv", |p| said(read_correspondences(p, tables(), node_count()))),
    text("landmark_table", "a.csv", |p| said(read_landmarks(p))),
    text("landmark_text", "S001_001_00000001_landmarks.txt", landmark_folder),
    text("landmark_points", "a_00000001.pts", landmark_folder),
    text("emotion_label", "label", emotion_label),
    text("track", "S001_001.csv", |p| said(read_track(p))),
    text("track_record", "S001_001.json", |p| said(read_track_info(p))),
    text("model", "a.csv", |p| said(read_model(p))),
    text("prior", "a.json", |p| said(read_prior(p))),
    text("neutral_faces", "a.csv", |p| said(read_neutral_faces(p, "neutral"))),
    text("motion", "a.csv", |p| said(read_motion(p, bank(), None))),
    text("fap_motion", "a.fap", |p| said(read_motion(p, bank(), None))),
    text("recipes", "a.csv", |p| said(read_recipes(p, bank().names()))),
    text("feature_points", "a.csv", |p| said(crate::synthesis::read_feature_points(p, bank().mesh().vertex_count()))),
    text("blendshapes", "a.json", |p| said(read_blendshapes(p))),
    text("blendshape_table", "a.csv", |p| said(read_blendshapes(p))),
    text("run_record", "run.json", |p| match fs::read(p) {
        Ok(bytes) => said(serde_json::from_slice::<RunJson>(&bytes)),
        Err(error) => Err(error.to_string()),
    }),
    text("obj", "a.obj", |p| said(read_obj(p))),
    binary("ply", "a.ply", |p| said(read_ply(p))),
    binary("gltf", "a.glb", |p| said(read_gltf(p, None, |_| false))),
    binary("npy", "a.npy", |p| said(read_npy_indices(p))),
    binary("npy_rows", "a.npy", |p| said(read_npy_rows(p))),
    binary("bank", "a.bank", |p| said(Bank::open(p))),
    binary("columnar", "a.parquet", columnar),
    binary("picture", "a.png", |p| {
        said(read_frame(p))?;
        said(read_colour(p))
    }),
];

/// Tables of Candide-3, computed once.
fn tables() -> &'static Tables {
    static TABLES: OnceLock<Tables> = OnceLock::new();
    TABLES.get_or_init(Tables::candide3)
}

/// Number of nodes of Candide-3, computed once.
fn node_count() -> usize {
    static COUNT: OnceLock<usize> = OnceLock::new();
    *COUNT.get_or_init(|| Wireframe::candide3().node_count())
}

/// Reads a file with one frame's landmarks through the folder that contains it.
fn landmark_folder(path: &Path) -> Outcome {
    said(read_landmarks(path.parent().unwrap_or(path)))
}

/// The embedded bank, computed once.
fn bank() -> &'static Bank {
    static BANK: OnceLock<Bank> = OnceLock::new();
    #[allow(clippy::expect_used)]
    BANK.get_or_init(|| candide_bank().expect("the embedded bank"))
}

/// Reads a dataset in the Cohn-Kanade layout whose only label is the file.
fn emotion_label(path: &Path) -> Outcome {
    let root = path.with_file_name("ck");
    let label = root.join("Emotion/S001/001/S001_001_00000002_emotion.txt");
    let frames = root.join("cohn-kanade-images/S001/001");
    let made = || -> io::Result<()> {
        if !frames.exists() {
            fs::create_dir_all(&frames)?;
            fs::create_dir_all(root.join("Emotion/S001/001"))?;
            fs::write(frames.join("S001_001_00000001.png"), b"")?;
            fs::write(frames.join("S001_001_00000002.png"), b"")?;
        }
        fs::copy(path, &label).map(drop)
    };
    made().map_err(|e| e.to_string())?;
    let dataset = Dataset::open(&root).map_err(|e| e.to_string())?;
    dataset.failures.first().map_or(Ok(()), |f| Err(f.error.to_string()))
}

/// Calls all readers of a columnar file.
fn columnar(path: &Path) -> Outcome {
    let file = ColumnarModels::open(path).map_err(|e| e.to_string())?;
    let nodes: Vec<NodeId> = (0..file.node_count()).map(|k| NodeId(k as u16)).collect();
    said(file.class((0..file.row_count()).collect(), &nodes).neutral())?;
    said(load_columnar(&file))
}

/// Returns the target with a name.
pub fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|t| t.name == name)
}

impl Target {
    /// Reads bytes as this kind of file.
    ///
    /// # Errors
    /// The text of the reader's error, or an error when the temporary file cannot be written.
    pub fn read(&self, bytes: &[u8]) -> Outcome {
        thread_local! {
            static FOLDER: OnceCell<tempfile::TempDir> = const { OnceCell::new() };
        }
        let folder: PathBuf = FOLDER.with(|cell| match cell.get() {
            Some(folder) => Ok(folder.path().to_owned()),
            None => tempfile::tempdir().map(|made| cell.get_or_init(|| made).path().to_owned()).map_err(|e| e.to_string()),
        })?;
        // Each target has its own folder, because some readers look for files next to theirs.
        let folder = folder.join(self.name);
        let path = folder.join(self.file);
        fs::write(&path, bytes)
            .or_else(|_| fs::create_dir_all(&folder).and_then(|()| fs::write(&path, bytes)))
            .map_err(|e| e.to_string())?;
        (self.read)(&path)
    }
}

/// Words with a meaning for readers: limits of number types, magic words of formats.
const WORDS: [&[u8]; 34] = [
    b"-1",
    b"0",
    b"1",
    b"67",
    b"68",
    b"113",
    b"65535",
    b"65536",
    b"2147483647",
    b"-2147483648",
    b"4294967296",
    b"18446744073709551616",
    b"1e30",
    b"-1e308",
    b"1e999",
    b"1e-320",
    b"nan",
    b"inf",
    b"-0",
    b"0.5",
    b"\xEF\xBB\xBF",
    b"\xFF\xFE",
    b"\r\n",
    b"\n",
    b",",
    b"\"",
    b"\0",
    b"\x1b[2J",
    b"=1+1",
    b"../",
    b"{",
    b"}",
    b"[[",
    b"null",
];

/// Generates a malformed file: a seed changed in one to eight positions, or (one time in 16) arbitrary bytes. The same `seed` and
/// `index` give the same file.
///
/// The changes affect bits, bytes, lengths and numbers, and insert words of the readers and of `dictionary`. Parts are removed,
/// duplicated, moved, or replaced from another seed; the end is cut off.
pub fn mutate(seeds: &[Vec<u8>], dictionary: &[Vec<u8>], seed: u64, index: u64) -> Vec<u8> {
    /// Largest number of bytes generated beyond the seed's own length.
    const MOST: usize = 4096;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(index);
    let base = if seeds.is_empty() { &[][..] } else { &seeds[random.random_range(0..seeds.len())][..] };
    if base.is_empty() || random.random_ratio(1, 16) {
        let mut bytes = vec![0; random.random_range(0..200)];
        random.fill_bytes(&mut bytes);
        return bytes;
    }
    let mut bytes = base.to_vec();
    for _ in 0..random.random_range(1..=8) {
        if bytes.is_empty() {
            break;
        }
        let at = random.random_range(0..bytes.len());
        let end = (at + random.random_range(1..=64)).min(bytes.len());
        match random.random_range(0..12) {
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = random.random(),
            2 => bytes[at] = [0, 1, 0x7F, 0x80, 0xFF][random.random_range(0..5)],
            3 => {
                let wide: [u8; 4] = [0, 1, 0x7FFF_FFFF, 0x8000_0000, u32::MAX][random.random_range(0..5)].to_le_bytes();
                let end = (at + 4).min(bytes.len());
                bytes[at..end].copy_from_slice(&wide[..end - at]);
            }
            4 => drop(bytes.drain(at..end)),
            5 if bytes.len() < base.len() + MOST => {
                let part = bytes[at..end].to_vec();
                let to = random.random_range(0..=bytes.len());
                bytes.splice(to..to, part);
            }
            6 => bytes.truncate(at),
            7 => {
                let other = &seeds[random.random_range(0..seeds.len())];
                let from = random.random_range(0..=other.len());
                bytes.truncate(at);
                bytes.extend_from_slice(&other[from..]);
            }
            8 => {
                // Replaces a number in the text by another word.
                let digit = |b: u8| b.is_ascii_digit() || matches!(b, b'.' | b'-' | b'e');
                let end = at + bytes[at..].iter().take_while(|&&b| digit(b)).count();
                bytes.splice(at..end, WORDS[random.random_range(0..WORDS.len())].iter().copied());
            }
            9 if !dictionary.is_empty() => {
                let word = dictionary[random.random_range(0..dictionary.len())].iter().copied();
                bytes.splice(at..at, word);
            }
            _ => {
                let word = WORDS[random.random_range(0..WORDS.len())].iter().copied();
                bytes.splice(at..at, word);
            }
        }
    }
    bytes
}

/// Parses a dictionary in libFuzzer's format: one `"word"` per line, in which `\xFF`, `\"` and `\\` stand for one byte.
pub fn dictionary(text: &str) -> Vec<Vec<u8>> {
    let word = |line: &str| {
        let inner = line.trim().strip_prefix('"')?.strip_suffix('"')?;
        let (mut word, mut rest) = (Vec::new(), inner.as_bytes());
        while let Some((&first, after)) = rest.split_first() {
            let hex = after.get(1..3).and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
            let (byte, left) = match (first, after.first(), hex) {
                (b'\\', Some(b'x'), Some(byte)) => (byte, &after[3..]),
                (b'\\', Some(&escaped), _) => (escaped, &after[1..]),
                _ => (first, after),
            };
            word.push(byte);
            rest = left;
        }
        Some(word)
    };
    text.lines().filter_map(word).collect()
}
