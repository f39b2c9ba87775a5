//! The sequences of a dataset and their marks, as the page reads and saves them.
//!
//! Marks are in a sequence's correspondence file: the one named in the manifest, else `SUBJECT/SEQUENCE/correspondences.csv`, which is then
//! entered in the manifest. Every save states the version it is based on: a hash of the file and of the sequence's manifest entries, which
//! are read again whenever the manifest changes. If another tab, program or person has changed any of it since, nothing is written and the
//! page receives the current state.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, OnceLock, PoisonError},
};

use image::GrayImage;
use nalgebra::Point2;

use super::{
    AnnotateError, AnnotateOptions, CascadeError, Cascades, ENOUGH_MARKS, RequestError,
    found::propose_from_face,
    frames::{FrameList, FrameShelf, Picture},
    item::{Item, all_frames_of, confidence, cut, find, frames_of, manifest_blake3, no_sequence, picture_entry, version},
    live::LiveFrame,
    manifest_edit::{manifest_text, relative, set_fields},
    messages::{List, Listed, Mark, Opened, Proposed, SaveFrames, SaveMarks, Saved},
    proposals::{propose_from_cascades, propose_from_landmarks},
};
use crate::{
    dataset::{Dataset, FrameSource, MANIFEST_NAME, SequenceEntry, is_picture},
    fit::{Correspondence, read_correspondences, write_correspondences},
    output::{count, remove_durably, write_durable},
    pipeline::Workbench,
    sequence::{ImageSize, read_first_in_colour},
    units::SequenceId,
};

/// A dataset opened for marking.
pub struct Desk {
    /// Wireframe, fitter, tables.
    pub bench: Workbench,
    root: PathBuf,
    manifest: Mutex<Option<PathBuf>>,
    /// Whether the dataset is one picture without a manifest.
    is_picture: bool,
    /// BLAKE3 of the manifest from which `items` was read.
    manifest_read: Mutex<Option<blake3::Hash>>,
    items: Mutex<Vec<Item>>,
    /// Indices in `items` of the sequences on the page.
    worklist: Vec<usize>,
    failures: Vec<String>,
    cascade_folder: Option<PathBuf>,
    cascades: OnceLock<Mutex<Result<Cascades, CascadeError>>>,
    shelf: FrameShelf,
    /// The frame being marked.
    pub(super) live: LiveFrame,
}

impl Desk {
    /// Opens a dataset.
    pub fn open(path: &Path, options: &AnnotateOptions, bench: Workbench) -> Result<Self, AnnotateError> {
        let is_picture = is_picture(path);
        let manifest = if path.is_file() && !is_picture { path.to_owned() } else { path.join(MANIFEST_NAME) };
        let manifest_read = manifest_blake3(&manifest);
        let dataset = if is_picture {
            Dataset { sequences: vec![picture_entry(path)], ..Dataset::default() }
        } else {
            Dataset::open(path)?
        };
        let failures: Vec<String> = dataset.failures.iter().map(|f| f.error.to_string()).collect();
        let count_marks = |entry: &SequenceEntry| {
            read_correspondences(entry.marks_path(), &bench.tables, bench.wireframe.node_count()).map_or(0, |marks| marks.len())
        };
        let items: Vec<Item> = dataset
            .sequences
            .into_iter()
            .map(|entry| Item { marks: count_marks(&entry), entry, listed: true, frames: None })
            .collect();
        if items.is_empty() {
            let skipped = dataset.skipped.first().map(|s| format!("{}: {}", s.id, s.reason));
            let reason = failures.first().cloned().or(skipped).unwrap_or_default();
            return Err(AnnotateError::NoSequence { path: path.to_owned(), reason });
        }
        // Sequences proposed by `segment` are always reviewed, with marks or without.
        let is_work = |item: &Item| options.all || item.marks < ENOUGH_MARKS || confidence(&item.entry).is_some();
        let worklist = (0..items.len()).filter(|&k| is_work(&items[k])).collect();
        let folder = if path.is_file() { path.parent().filter(|p| !p.as_os_str().is_empty()) } else { Some(path) };
        let root = folder.unwrap_or(Path::new(".")).to_owned();
        Ok(Self {
            bench,
            root,
            is_picture,
            manifest_read: Mutex::new(manifest_read),
            manifest: Mutex::new(Some(manifest).filter(|m| m.is_file())),
            items: Mutex::new(items),
            worklist,
            failures,
            cascade_folder: options.cascades.clone(),
            cascades: OnceLock::new(),
            shelf: FrameShelf::default(),
            live: LiveFrame::default(),
        })
    }

    /// Number of sequences on the page, and of those left to mark.
    pub fn counts(&self) -> (usize, usize) {
        (self.worklist.len(), self.left(&self.lock()))
    }

    /// Number of sequences in the dataset.
    pub fn total(&self) -> usize {
        self.lock().len()
    }

    /// Rows or folders of the dataset that are not valid sequences.
    pub fn failures(&self) -> &[String] {
        &self.failures
    }

    /// The dataset's folder with links resolved.
    fn resolved(&self) -> PathBuf {
        fs::canonicalize(&self.root).unwrap_or_else(|_| self.root.clone())
    }

    /// Name of the dataset.
    pub fn title(&self) -> String {
        self.resolved().file_name().map_or_else(|| "dataset".to_owned(), |name| name.to_string_lossy().into_owned())
    }

    /// Key of 16 digits that distinguishes this dataset from others with the same name.
    pub fn key(&self) -> String {
        blake3::hash(self.resolved().as_os_str().as_encoded_bytes()).to_hex()[..16].to_owned()
    }

    /// The sequences on the page.
    pub fn list(&self) -> List {
        let items = self.lock();
        let listed = |&k: &usize| {
            let Item { entry, marks, .. } = &items[k];
            Listed { id: entry.id.to_string(), emotion: entry.emotion.clone(), marks: *marks, confidence: confidence(entry) }
        };
        List {
            sequences: self.worklist.iter().map(listed).collect(),
            left: self.left(&items),
            total: items.len(),
            failures: self.failures.clone(),
        }
    }

    /// One sequence with its marks.
    pub fn opened(&self, id: &str) -> Result<Opened, RequestError> {
        self.forget_shown();
        let mut items = self.lock();
        self.refresh(&mut items, id)?;
        self.open_item(find(&mut items, id)?)
    }

    fn open_item(&self, item: &mut Item) -> Result<Opened, RequestError> {
        let frames = self.frames_of(item)?;
        let (neutral, apex, missing) = cut(&item.entry, &frames)?;
        let (marks, problem) = match self.read_marks(&item.entry) {
            Ok(marks) => (marks, None),
            Err(problem) => (Vec::new(), Some(problem)),
        };
        let problem = problem.or(missing);
        item.marks = marks.len();
        Ok(Opened {
            id: item.entry.id.to_string(),
            emotion: item.entry.emotion.clone(),
            neutral,
            apex,
            width: frames.size.width,
            height: frames.size.height,
            frames: frames.numbers,
            marks: marks.iter().map(Mark::from).collect(),
            version: version(&item.entry),
            file: if self.is_picture {
                item.entry.marks_path().file_name().unwrap_or_default().to_string_lossy().into_owned()
            } else {
                relative(&self.root, item.entry.marks_path())
            },
            problem,
        })
    }

    /// Saves all marks of a sequence; without marks, removes the file.
    pub fn save_marks(&self, id: &str, request: &SaveMarks) -> Result<Saved, RequestError> {
        let mut items = self.lock();
        self.refresh(&mut items, id)?;
        let item = find(&mut items, id)?;
        let frames = self.frames_of(item)?;
        if let (.., Some(problem)) = cut(&item.entry, &frames)? {
            return Err(RequestError::Refused(problem));
        }
        self.check_marks(&request.marks, frames.size)?;
        let current = self.read_marks(&item.entry).map_err(|problem| {
            RequestError::Refused(format!(
                "{problem}; correct the file or move it away, because marks made here would replace it"
            ))
        })?;
        let mut marks: Vec<Correspondence> = request.marks.iter().map(Correspondence::from).collect();
        marks.sort_by_key(|m| m.node);
        // The page repeats a save whose answer was lost.
        let repeated = current == marks;
        if request.version != version(&item.entry) && !repeated {
            return Err(RequestError::conflict(&self.open_item(item)?));
        }
        if !repeated {
            self.write_marks(&mut item.entry, &marks)?;
        }
        item.marks = marks.len();
        // The next save is compared with this state.
        self.refresh(&mut items, id)?;
        let version = version(&find(&mut items, id)?.entry);
        Ok(Saved { version, left: self.left(&items) })
    }

    fn write_marks(&self, entry: &mut SequenceEntry, marks: &[Correspondence]) -> Result<(), RequestError> {
        let file = entry.marks_path().to_owned();
        let manifest = self.manifest();
        if marks.is_empty() {
            // Without marks the sequence returns to its initial state: landmarks are used again, if there are any.
            if let Some(manifest) = manifest.as_ref().filter(|_| entry.correspondences_path.is_some()) {
                set_fields(manifest, &entry.id, &[("correspondences", String::new())]).map_err(RequestError::failed)?;
                entry.correspondences_path = None;
                entry.default_correspondences_path.clone_from(&file);
            }
            return remove_durably(&file).map_err(RequestError::failed);
        }
        write_correspondences(&file, marks).map_err(RequestError::failed)?;
        if let Some(manifest) = manifest.filter(|_| entry.correspondences_path.is_none()) {
            let named = relative(&self.root, &file);
            set_fields(&manifest, &entry.id, &[("correspondences", named)]).map_err(RequestError::failed)?;
            entry.correspondences_path = Some(file);
        }
        Ok(())
    }

    /// Saves the numbers of the neutral and the apex frame in the manifest.
    pub fn save_frames(&self, id: &str, request: &SaveFrames) -> Result<Opened, RequestError> {
        let mut items = self.lock();
        self.refresh(&mut items, id)?;
        let place = self.place(&items, id)?;
        let frames = self.frames_of(&mut items[place])?;
        let known = |n: u32| frames.numbers.binary_search(&n).is_ok();
        if let Some(missing) = [request.neutral, request.apex].into_iter().find(|&n| !known(n)) {
            return Err(RequestError::Refused(format!("there is no frame {missing}")));
        }
        if self.is_picture {
            return Err(RequestError::Refused("this is one picture: it has no neutral and no apex frame".to_owned()));
        }
        if request.neutral == request.apex {
            let frame = request.neutral;
            return Err(RequestError::Refused(format!("frame {frame} cannot be both the neutral and the apex frame")));
        }
        if request.version != version(&items[place].entry) {
            let current = self.open_item(&mut items[place])?;
            return Err(RequestError::conflict(&current));
        }
        if self.manifest().is_none() {
            if !request.create_manifest {
                return Err(RequestError::Consent(format!(
                    "this choice is saved in manifest.csv, which this dataset does not have; grimace can write one that lists its {} \
                     sequences",
                    items.len()
                )));
            }
            self.create_manifest(&items)?;
        }
        if let Some(manifest) = self.manifest() {
            let fields = [("first_frame", request.neutral.to_string()), ("last_frame", request.apex.to_string())];
            set_fields(&manifest, &items[place].entry.id, &fields).map_err(RequestError::failed)?;
        }
        self.refresh(&mut items, id)?;
        self.open_item(&mut items[place])
    }

    fn create_manifest(&self, items: &[Item]) -> Result<(), RequestError> {
        let path = self.root.join(MANIFEST_NAME);
        let entries: Vec<_> = items.iter().map(|i| i.entry.clone()).collect();
        let text = manifest_text(&self.root, &entries);
        write_durable(&path, |writer| writer.write_all(text.as_bytes())).map_err(RequestError::failed)?;
        *self.manifest.lock().unwrap_or_else(PoisonError::into_inner) = Some(path);
        Ok(())
    }

    /// Proposed marks for the neutral frame.
    pub fn proposed(&self, id: &str) -> Result<Proposed, RequestError> {
        let entry = find(&mut self.lock(), id)?.entry.clone();
        let frames = frames_of(&entry)?;
        let note = match propose_from_landmarks(&entry, frames.neutral_number(), &self.bench.tables) {
            Ok(Some(found)) => return Ok(Proposed::of(&found)),
            Ok(None) => None,
            Err(note) => Some(note),
        };
        let (frame, colour) = read_first_in_colour(&frames).map_err(RequestError::refused)?;
        match propose_from_face(&frame, colour.as_ref()) {
            Ok(Some((found, doubt))) => return Ok(Proposed { note: doubt.or(note), ..Proposed::of(&found) }),
            Ok(None) => {}
            Err(reason) => return Ok(Proposed { source: None, marks: Vec::new(), note: Some(note.unwrap_or(reason)) }),
        }
        let load = || Mutex::new(Cascades::load(self.cascade_folder.as_deref(), &self.bench.tables));
        let none = match propose_from_cascades(self.cascades.get_or_init(load), &frame) {
            Ok(Some(found)) => return Ok(Proposed { note, ..Proposed::of(&found) }),
            Ok(None) => "no face with two eyes was found".to_owned(),
            Err(reason) => format!("no face was found, and OpenCV's cascades were not tried: {reason}"),
        };
        Ok(Proposed { source: None, marks: Vec::new(), note: Some(note.unwrap_or(none)) })
    }

    /// Sequences on the page without marks, and those with too few or unreadable marks, each with the reason.
    pub(super) fn unmarked(&self) -> (Vec<SequenceId>, Vec<(SequenceId, String)>) {
        let items = self.lock();
        let (mut without, mut left) = (Vec::new(), Vec::new());
        for item in self.worklist.iter().map(|&k| &items[k]) {
            let id = item.entry.id.clone();
            match self.read_marks(&item.entry).map(|marks| marks.len()) {
                Ok(0) if item.marks == 0 => without.push(id),
                Ok(found @ 1..ENOUGH_MARKS) => {
                    left.push((
                        id,
                        format!("it has {}, but {ENOUGH_MARKS} are needed; its marks are kept", count(found, "mark", "marks")),
                    ));
                }
                Ok(_) => {}
                Err(problem) => left.push((id, format!("{problem}; correct the file or move it away"))),
            }
        }
        (without, left)
    }

    /// The frames of a sequence from the neutral one on.
    pub(super) fn neutral_frames(&self, id: &SequenceId) -> Result<FrameSource, RequestError> {
        let entry = find(&mut self.lock(), &id.to_string())?.entry.clone();
        frames_of(&entry)
    }

    /// Saves marks of a sequence without marks. Returns `false`, without writing, if it has marks by now.
    pub(super) fn save_found(&self, id: &SequenceId, marks: &[Correspondence]) -> Result<bool, RequestError> {
        let mut items = self.lock();
        let id = id.to_string();
        self.refresh(&mut items, &id)?;
        let item = find(&mut items, &id)?;
        if !self.read_marks(&item.entry).map_err(RequestError::Refused)?.is_empty() {
            return Ok(false);
        }
        self.write_marks(&mut item.entry, marks)?;
        item.marks = marks.len();
        self.refresh(&mut items, &id)?;
        Ok(true)
    }

    /// A frame of a sequence in grey.
    pub(super) fn grey(&self, id: &str, number: u32) -> Result<GrayImage, RequestError> {
        let entry = find(&mut self.lock(), id)?.entry.clone();
        self.shelf.grey(&all_frames_of(&entry)?, (entry.first_frame, entry.last_frame), number)
    }

    /// One frame for the browser.
    pub fn picture(&self, id: &str, number: u32) -> Result<Picture, RequestError> {
        let entry = find(&mut self.lock(), id)?.entry.clone();
        self.shelf.picture(&all_frames_of(&entry)?, (entry.first_frame, entry.last_frame), number)
    }

    /// Reads the manifest again if its content has changed, and updates the sequences from it.
    fn refresh(&self, items: &mut [Item], id: &str) -> Result<(), RequestError> {
        if self.is_picture {
            return Ok(());
        }
        let path = self.manifest().unwrap_or_else(|| self.root.join(MANIFEST_NAME));
        let found = manifest_blake3(&path);
        let mut read = self.manifest_read.lock().unwrap_or_else(PoisonError::into_inner);
        if *read != found {
            let dataset = match found {
                Some(_) => Dataset::open(&path).map_err(RequestError::refused)?,
                None => Dataset::open(&self.root).map_err(RequestError::refused)?,
            };
            let mut entries: BTreeMap<String, SequenceEntry> =
                dataset.sequences.into_iter().map(|entry| (entry.id.to_string(), entry)).collect();
            for item in items.iter_mut() {
                let entry = entries.remove(&item.entry.id.to_string());
                item.listed = entry.is_some();
                if let Some(entry) = entry {
                    let shown = |entry: &SequenceEntry| {
                        (entry.frames_path.clone(), entry.pictures.clone(), entry.first_frame, entry.last_frame)
                    };
                    if shown(&entry) != shown(&item.entry) {
                        item.frames = None;
                    }
                    item.entry = entry;
                }
            }
            *self.manifest.lock().unwrap_or_else(PoisonError::into_inner) = found.map(|_| path);
            *read = found;
        }
        match items.iter().find(|item| item.entry.id.to_string() == id) {
            Some(item) if !item.listed => {
                Err(RequestError::Refused(format!("the manifest no longer lists {id}; start grimace annotate again")))
            }
            _ => Ok(()),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Item>> {
        self.items.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn manifest(&self) -> Option<PathBuf> {
        self.manifest.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn left(&self, items: &[Item]) -> usize {
        self.worklist.iter().filter(|&&k| items[k].marks < ENOUGH_MARKS).count()
    }

    #[allow(clippy::unused_self)]
    fn place(&self, items: &[Item], id: &str) -> Result<usize, RequestError> {
        items.iter().position(|item| item.entry.id.to_string() == id).ok_or_else(|| no_sequence(id))
    }

    fn frames_of(&self, item: &mut Item) -> Result<FrameList, RequestError> {
        if let Some(frames) = &item.frames {
            return Ok(frames.clone());
        }
        let frames = self.shelf.list(&all_frames_of(&item.entry)?, (item.entry.first_frame, item.entry.last_frame))?;
        Ok(item.frames.insert(frames).clone())
    }

    /// The marks of a sequence; empty without a file.
    fn read_marks(&self, entry: &SequenceEntry) -> Result<Vec<Correspondence>, String> {
        let path = entry.marks_path();
        if !path.exists() {
            return Ok(Vec::new());
        }
        let marks = read_correspondences(path, &self.bench.tables, self.bench.wireframe.node_count());
        let mut marks = marks.map_err(|e| e.to_string())?;
        marks.sort_by_key(|m| m.node);
        Ok(marks)
    }

    fn check_marks(&self, marks: &[Mark], size: ImageSize) -> Result<(), RequestError> {
        for (k, mark) in marks.iter().enumerate() {
            let node = mark.node;
            if !self.bench.wireframe.live_nodes().contains(&node) {
                return Err(RequestError::Refused(format!(
                    "node {node} cannot be marked: it is in no triangle of the wireframe"
                )));
            }
            if marks[..k].iter().any(|m| m.node == node) {
                return Err(RequestError::Refused(format!("node {node} is marked twice")));
            }
            if !size.contains(&Point2::new(mark.x, mark.y)) {
                let (x, y) = (mark.x, mark.y);
                return Err(RequestError::Refused(format!("node {node} is marked at ({x}, {y}), outside the image of {size}")));
            }
        }
        Ok(())
    }
}
