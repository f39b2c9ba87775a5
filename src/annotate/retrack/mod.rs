//! Shows the tracks of a run frame by frame, corrects them by hand, and tracks again from a corrected frame.
//!
//! A correction is first saved in the corrections file, which is on disk before anything else happens. Then the track's own writer adds it
//! to the track. Later frames stay unchanged until they are tracked again. `grimace run` accepts such a track unchanged, and applies the
//! corrections again whenever it has to track anew.

mod item;
mod messages;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
};

use nalgebra::Point2;

pub use self::messages::{Correct, Corrected, FrameNodes, List, Listed, Looked, Opened, Retrack, SetLook};
use self::{
    item::{Item, count_corrected},
    messages::frame_nodes,
};
use super::{
    AnnotateError, RequestError,
    frames::{FrameShelf, Picture},
    item::all_frames_of,
    untouched::Untouched,
};
use crate::{
    dataset::{Dataset, FrameSource},
    fit::Springs,
    input::{CsvFile, CsvRow, InputError},
    pipeline::{Workbench, read_run_json, results_folder, track_files, tracks_folder},
    sequence::SequenceReader,
    track::{
        Confidence, Corrections, Look, Looks, TrackCorrections, TrackInfo, TrackedFrame, TrackedNode, correct_nodes,
        corrections_of, expect_errors, far_corrections, fitting_corrections, resume_with, summarize, window_px,
        write_corrections, write_track,
    },
};

/// A frame before corrections, cached while a node of it is dragged.
struct Base {
    id: String,
    frame: u32,
    version: String,
    nodes: Vec<TrackedNode>,
}

/// The tracks of a run opened for correction.
pub struct TrackDesk {
    /// Wireframe, tracking plan, tables.
    pub bench: Workbench,
    out: PathBuf,
    springs: Springs,
    items: Mutex<Vec<Item>>,
    failures: Vec<String>,
    base: Mutex<Option<Base>>,
    untouched: Untouched,
    shelf: FrameShelf,
}

impl TrackDesk {
    /// Opens the tracks in `out`, or in its folder `tracks`; their frames are those of the dataset.
    pub fn open(out: &Path, dataset: Option<&Path>, bench: Workbench) -> Result<Self, AnnotateError> {
        let folder = tracks_folder(out);
        let files = track_files(&[folder]).map_err(AnnotateError::Tracks)?;
        if files.is_empty() {
            return Err(AnnotateError::NoTracks { path: out.to_owned() });
        }
        let dataset = match dataset {
            Some(path) => Dataset::open(path)?,
            None => beside(out)?,
        };
        let mut items = Vec::new();
        let mut failures = Vec::new();
        let mut judged = reasons_of_the_run(&results_folder(out)).unwrap_or_default();
        for csv in files {
            match Item::open(csv, &dataset.sequences, bench.wireframe.node_count()) {
                Ok(item) => {
                    let reasons = judged.remove(&item.id).unwrap_or_else(|| item.summary.reasons.clone());
                    items.push(Item { reasons, ..item });
                }
                Err(reason) => failures.push(reason),
            }
        }
        if items.is_empty() {
            let reason = failures.first().cloned().unwrap_or_default();
            return Err(AnnotateError::NoSequence { path: out.to_owned(), reason });
        }
        items.sort_by(|a, b| a.summary.tracked_share.total_cmp(&b.summary.tracked_share).then_with(|| a.id.cmp(&b.id)));
        let springs = Springs::new(&bench.wireframe);
        let (items, base) = (Mutex::new(items), Mutex::new(None));
        Ok(Self {
            bench,
            out: out.to_owned(),
            springs,
            items,
            failures,
            base,
            untouched: Untouched::default(),
            shelf: FrameShelf::default(),
        })
    }

    /// Tracks on the page.
    pub fn count(&self) -> usize {
        self.lock().len()
    }

    /// Tracks that cannot be shown, with the reason.
    pub fn failures(&self) -> &[String] {
        &self.failures
    }

    /// Name of the output folder.
    pub fn title(&self) -> String {
        let resolved = fs::canonicalize(&self.out).unwrap_or_else(|_| self.out.clone());
        resolved.file_name().map_or_else(|| "tracks".to_owned(), |name| name.to_string_lossy().into_owned())
    }

    /// The tracks on the page.
    pub fn list(&self) -> List {
        // The file's errors are shown where a look is set.
        let looks = self.looks().ok();
        let listed = |item: &Item| Listed {
            id: item.id.clone(),
            emotion: item.emotion.clone(),
            tracked_share: item.summary.tracked_share,
            frames: item.summary.frames,
            corrected: item.corrected,
            doubtful: !item.reasons.is_empty(),
            look: looks.as_ref().and_then(|looks| item.look(looks)),
        };
        List { sequences: self.lock().iter().map(listed).collect(), failures: self.failures.clone() }
    }

    /// One track.
    pub fn opened(&self, id: &str) -> Result<Opened, RequestError> {
        let items = self.lock();
        self.open_item(find(&items, id)?)
    }

    /// Saves what a person found when looking at a track.
    pub fn look(&self, id: &str, request: &SetLook) -> Result<Looked, RequestError> {
        let items = self.lock();
        let item = find(&items, id)?;
        self.check_version(item, &request.version)?;
        let look = request.look;
        if look == Some(Look::Outdated) {
            return Err(RequestError::Refused("a sequence is right, left out, or not looked at".to_owned()));
        }
        let mut looks = self.looks()?;
        looks.set(id, look, &item.content()?);
        looks.write().map_err(RequestError::failed)?;
        Ok(Looked { look })
    }

    fn looks(&self) -> Result<Looks, RequestError> {
        Looks::read(&results_folder(&self.out)).map_err(RequestError::refused)
    }

    /// Returns one frame for the browser.
    pub fn picture(&self, id: &str, number: u32) -> Result<Picture, RequestError> {
        let entry = find(&self.lock(), id)?.entry.clone();
        self.shelf.any_picture(&all_frames_of(&entry)?, number)
    }

    /// A frame with unsaved corrections, shown while a node is dragged.
    pub fn preview(&self, id: &str, request: &Correct) -> Result<FrameNodes, RequestError> {
        let items = self.lock();
        let item = find(&items, id)?;
        let nodes = self.corrected_nodes(item, &self.read_frames(item)?, request)?;
        Ok(frame_nodes(&TrackedFrame { number: request.frame, nodes }))
    }

    /// Replaces the corrections of a frame, and writes the track.
    pub fn correct(&self, id: &str, request: &Correct) -> Result<Corrected, RequestError> {
        let mut items = self.lock();
        let item = find_mut(&mut items, id)?;
        self.check_version(item, &request.version)?;
        let mut frames = self.read_frames(item)?;
        let nodes = self.corrected_nodes(item, &frames, request)?;
        let place = index_of(&frames, request.frame)?;
        frames[place].nodes = nodes;
        let mut corrections = item.saved_corrections()?.unwrap_or_else(|| corrections_of(&frames));
        let set = request.corrections.iter().map(|mark| (mark.node, Point2::new(mark.x, mark.y))).collect::<BTreeMap<_, _>>();
        if set.is_empty() {
            corrections.remove(&request.frame);
        } else {
            corrections.insert(request.frame, set);
        }
        self.write(item, &frames, &corrections)?;
        Ok(Corrected { version: item.version(), frame: frame_nodes(&frames[place]) })
    }

    /// Tracks all frames after a frame again, with all corrections, and writes the track.
    pub fn retrack(&self, id: &str, request: &Retrack) -> Result<Opened, RequestError> {
        let mut items = self.lock();
        let item = find_mut(&mut items, id)?;
        self.check_version(item, &request.version)?;
        let mut frames = self.read_frames(item)?;
        let place = index_of(&frames, request.frame)?;
        let corrections = item.saved_corrections()?.unwrap_or_else(|| corrections_of(&frames));
        let size = item.info()?.image_size;
        let (fit, _) = fitting_corrections(&corrections, size, size, &frames, &self.bench.wireframe);
        let behind = self.track(item, &frames, place, frames.len() - 1, &fit)?;
        frames.truncate(place + 1);
        frames.extend(behind);
        self.write(item, &frames, &corrections)?;
        self.open_item(item)
    }

    fn open_item(&self, item: &Item) -> Result<Opened, RequestError> {
        let looks = self.looks().ok();
        let opened = item.opened(&self.bench, &self.springs)?;
        Ok(Opened { look: looks.and_then(|looks| item.look(&looks)), ..opened })
    }

    fn read_frames(&self, item: &Item) -> Result<Vec<TrackedFrame>, RequestError> {
        item.frames(&self.bench, &self.springs)
    }

    fn check_version(&self, item: &Item, given: &str) -> Result<(), RequestError> {
        if item.version() == given { Ok(()) } else { Err(RequestError::conflict(&self.open_item(item)?)) }
    }

    /// The nodes of a frame: one step from the previous frame, with the requested corrections.
    fn corrected_nodes(&self, item: &Item, frames: &[TrackedFrame], request: &Correct) -> Result<Vec<TrackedNode>, RequestError> {
        let place = index_of(frames, request.frame)?;
        if place == 0 {
            return Err(RequestError::Refused(
                "the neutral frame is fitted, not tracked: correct its marks with `grimace annotate DATASET` and run again"
                    .to_owned(),
            ));
        }
        let mut hard = BTreeMap::new();
        for mark in &request.corrections {
            if !self.bench.wireframe.live_nodes().contains(&mark.node) {
                return Err(RequestError::Refused(format!(
                    "node {} cannot be corrected: it is in no triangle and follows other nodes",
                    mark.node
                )));
            }
            hard.insert(mark.node, Point2::new(mark.x, mark.y));
        }
        let version = item.version();
        let mut base = self.base.lock().unwrap_or_else(PoisonError::into_inner);
        let is_known = |b: &&Base| b.id == item.id && b.frame == request.frame && b.version == version;
        let nodes = if let Some(base) = base.as_ref().filter(is_known) {
            base.nodes.clone()
        } else {
            let mut step = self.track(item, frames, place - 1, place, &Corrections::new())?;
            let nodes = step.pop().map(|f| f.nodes).unwrap_or_default();
            *base = Some(Base { id: item.id.clone(), frame: request.frame, version, nodes: nodes.clone() });
            nodes
        };
        correct_nodes(&self.bench.wireframe, &self.springs, &nodes, &hard).map_err(RequestError::refused)
    }

    /// Tracks from one index in the list of frames to another.
    fn track(
        &self,
        item: &Item,
        frames: &[TrackedFrame],
        from: usize,
        to: usize,
        corrections: &Corrections,
    ) -> Result<Vec<TrackedFrame>, RequestError> {
        let info = item.info()?;
        let source = match &item.source {
            FrameSource::Images(files) => {
                let wanted = files.iter().enumerate().filter(|(k, _)| *k == 0 || (from..=to).contains(k));
                FrameSource::Images(wanted.map(|(_, file)| file.clone()).collect())
            }
            FrameSource::Video { path, first, .. } => {
                FrameSource::Video { path: path.clone(), first: *first, last: frames.get(to).map(|f| f.number) }
            }
        };
        let Some(start) = frames.get(from) else { return Err(RequestError::Refused("the track has no such frame".to_owned())) };
        if from == to {
            return Ok(Vec::new());
        }
        let neutral: Vec<_> = frames[0].nodes.iter().map(|n| n.position).collect();
        let window = window_px(&self.bench.tables, &neutral, &info.track);
        let mut tracker = info.track.klt.tracker(info.track.levels, window).map_err(RequestError::refused)?;
        let reader = SequenceReader::open(&source).map_err(RequestError::refused)?;
        let (wireframe, plan) = (&self.bench.wireframe, self.bench.plan());
        resume_with(&mut tracker, wireframe, plan, frames, start.number, corrections, reader, &info.track)
            .map_err(RequestError::refused)
    }

    /// Saves the corrections, then the track with them. After an interruption in between, the track is made again from the corrections.
    fn write(&self, item: &mut Item, frames: &[TrackedFrame], corrections: &Corrections) -> Result<(), RequestError> {
        let mut info = item.info()?;
        let earlier = info.corrections.take();
        let is_first = item.saved_corrections()?.is_none() && item.corrected == 0;
        let saved = write_corrections(&item.csv, corrections).map_err(RequestError::failed)?;
        // If a frame cannot be read, the previous judgement is kept.
        let far = self.far(item, frames, &info, (corrections, is_first));
        let far = far.unwrap_or_else(|_| earlier.as_ref().map(|c| c.far.clone()).unwrap_or_default());
        info.corrections = Some(TrackCorrections {
            blake3: saved.blake3,
            image_size: earlier.as_ref().map_or(info.image_size, |c| c.image_size),
            not_applied: earlier.map(|c| c.not_applied).unwrap_or_default(),
            far,
        });
        let mut frames = frames.to_vec();
        expect_errors(&mut frames, &self.bench.wireframe, &self.bench.tables, Confidence::shipped());
        info.summary = summarize(&frames, &self.bench.wireframe, &self.bench.tables).told_by_the_pictures_of(&info.summary);
        write_track(&item.csv, &frames, &mut info).map_err(RequestError::failed)?;
        item.corrected = count_corrected(&frames);
        item.summary = info.summary;
        Ok(())
    }

    /// Corrections that lie far from the expected face, by the track without corrections, with the messages of `run`; and whether they are
    /// the first of this track.
    fn far(
        &self,
        item: &Item,
        frames: &[TrackedFrame],
        info: &TrackInfo,
        (corrections, is_first): (&Corrections, bool),
    ) -> Result<Vec<String>, RequestError> {
        let (wireframe, tables) = (&self.bench.wireframe, &self.bench.tables);
        let (fit, _) = fitting_corrections(corrections, info.image_size, info.image_size, frames, wireframe);
        let mut places = frames.iter().enumerate().filter(|(_, frame)| fit.contains_key(&frame.number)).map(|(place, _)| place);
        let Some(first) = places.next() else { return Ok(Vec::new()) };
        let last = places.next_back().unwrap_or(first);
        // In a track without earlier corrections, the frames before the first correction come from the tracker.
        let known = if is_first { first } else { 1 };
        let track = |known: &[TrackedFrame]| {
            let from = known.len() - 1;
            let whole: Vec<_> = known.iter().chain(frames.iter().skip(known.len())).cloned().collect();
            self.track(item, &whole, from, last, &Corrections::new())
        };
        let untouched = self.untouched.frames(&item.id, &info.inputs_blake3, &frames[..known], last, track)?;
        Ok(far_corrections(&fit, &untouched, wireframe, tables))
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Item>> {
        self.items.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The dataset of a run, by its name in `run.json`, in the current folder or a parent of the output.
fn beside(out: &Path) -> Result<Dataset, AnnotateError> {
    /// Only the needed fields, so that records with options of other versions can be read.
    #[derive(serde::Deserialize)]
    struct Named {
        dataset: String,
    }
    let Some(Named { dataset: name }) = read_run_json(&results_folder(out))? else {
        return Err(AnnotateError::NoRun { path: out.to_owned() });
    };
    let resolved = fs::canonicalize(out).unwrap_or_else(|_| out.to_owned());
    let folders = std::iter::once(PathBuf::from(".")).chain(resolved.ancestors().take(4).map(Path::to_owned));
    let not_found = || AnnotateError::DatasetNotFound { path: out.to_owned(), name: name.clone() };
    if name.is_empty() || name.contains(['/', '\\']) {
        return Err(not_found());
    }
    let found = folders.map(|f| f.join(&name)).find_map(|path| Dataset::open(&path).ok());
    found.ok_or_else(not_found)
}

/// Reasons to look at the sequences of a run, by id.
fn reasons_of_the_run(out: &Path) -> Result<BTreeMap<String, Vec<String>>, InputError> {
    let csv = CsvFile::open(&out.join("verdicts.csv"))?;
    let [id, reasons] = csv.require(["id", "reasons"])?;
    let row = |row: CsvRow<'_>| {
        let reasons = Some(row.get(reasons)).filter(|text| !text.is_empty());
        (row.get(id).to_owned(), reasons.map(str::to_owned).into_iter().collect())
    };
    csv.rows().map(|read| read.map(row)).collect()
}

fn index_of(frames: &[TrackedFrame], number: u32) -> Result<usize, RequestError> {
    let place = frames.iter().position(|f| f.number == number);
    place.ok_or_else(|| RequestError::NotFound(format!("the track has no frame {number}")))
}

fn no_track(id: &str) -> RequestError {
    RequestError::NotFound(format!("there is no track of {id}"))
}

fn find<'a>(items: &'a [Item], id: &str) -> Result<&'a Item, RequestError> {
    items.iter().find(|item| item.id == id).ok_or_else(|| no_track(id))
}

fn find_mut<'a>(items: &'a mut [Item], id: &str) -> Result<&'a mut Item, RequestError> {
    items.iter_mut().find(|item| item.id == id).ok_or_else(|| no_track(id))
}
