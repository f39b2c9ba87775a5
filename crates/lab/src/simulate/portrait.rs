//! Neutral portraits to animate: a photograph with its marks, a folder of photographs, or the neutral frames of a dataset.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use image::RgbImage;
use nalgebra::{Point2, Point3, Vector2};

use super::subject::place_followers;
use grimace::internal::{
    dataset::{
        CorrespondenceSource, Dataset, DatasetError, FramesError, LANDMARK_COUNT, LandmarkSelection, LandmarksError,
        MANIFEST_NAME, correspondences_from_landmarks, is_picture, read_landmarks,
    },
    fit::{
        Correspondence, CorrespondenceError, FitError, FitOptions, Fitter, MarksError, read_correspondences,
        validate_correspondences,
    },
    geometry::Similarity,
    input::{CsvFile, InputError},
    pipeline::{FoundMarksError, PipelineOptions, Workbench, WorkbenchError, found_marks_and_remark},
    sequence::{self, Frame, SequenceError, read_colour},
    track::eye_distance_px,
    warp::{Texture, Warp, WarpError},
    wireframe::{Fapus, FapusError, Tables, Wireframe},
};

/// Endings that, after a photograph's name, make the name of its file of marks, in search order.
const MARK_FILES: [&str; 5] = ["_correspondences.csv", ".csv", "_landmarks68.csv", "_landmarks68_auto.csv", "_landmarks.csv"];
/// Selections of landmarks by confidence, the largest first; the first one that gives a face without folds is used.
const SELECTIONS: [LandmarkSelection; 3] =
    [LandmarkSelection::HighAndMedium, LandmarkSelection::High, LandmarkSelection::Default];

/// Upper and lower node in the middle of each brow. No landmark marks the lower node, and fits place it too high. A brow keeps its
/// thickness when it lies between two nodes that move up together.
const BROWS: [(usize, usize); 2] = [(16, 18), (49, 51)];
/// Height of a brow in Candide-3, relative to the eye distance.
const BROW_HEIGHT: f64 = 0.085;

/// Why a photograph cannot be animated.
#[derive(Debug, thiserror::Error)]
pub enum PortraitError {
    /// The photograph cannot be opened.
    #[error(transparent)]
    Image(#[from] SequenceError),
    /// No such photograph.
    #[error("{}: there is no such file", path.display())]
    NotThere {
        /// The path.
        path: PathBuf,
    },
    /// A folder cannot be listed.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A folder without portraits.
    #[error("{}: the folder has no portraits; add photographs, or rows in its manifest.csv", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// A photograph without marks, in which no marks could be found.
    #[error(
        "{}: {source}; or put correspondences (node,x,y) or 68 landmarks (point,x,y) beside the picture, as {}", path.display(), MARK_FILES.map(|ending| format!("{id}{ending}")).join(", ")
    )]
    NotFound {
        /// Portrait.
        id: String,
        /// The photograph.
        path: PathBuf,
        /// Why.
        source: Box<FoundMarksError>,
    },
    /// The workbench that finds marks cannot be created.
    #[error(transparent)]
    Workbench(Box<WorkbenchError>),
    /// Correspondences cannot be read.
    #[error(transparent)]
    Correspondences(#[from] CorrespondenceError),
    /// A CSV file cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Landmarks cannot be read.
    #[error(transparent)]
    Landmarks(#[from] LandmarksError),
    /// The landmarks are not the 68 points.
    #[error("{}: {found} of {LANDMARK_COUNT} landmarks; every point from 0 to {} once, point,x,y", path.display(), LANDMARK_COUNT - 1)]
    LandmarkCount {
        /// The file.
        path: PathBuf,
        /// Points found.
        found: usize,
    },
    /// A dataset or one of its sequences cannot be opened.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Frames cannot be listed.
    #[error(transparent)]
    Frames(#[from] FramesError),
    /// The marks do not determine a fit.
    #[error("{id}: {source}")]
    Marks {
        /// Portrait.
        id: String,
        /// Why.
        source: MarksError,
    },
    /// The fit failed.
    #[error("{id}: {source}")]
    Fit {
        /// Portrait.
        id: String,
        /// Why.
        source: FitError,
    },
    /// The face cannot be warped.
    #[error("{id}: {source}")]
    Warp {
        /// Portrait.
        id: String,
        /// Why.
        source: WarpError,
    },
    /// The face's FAPUs cannot be measured.
    #[error("{id}: {source}")]
    Fapus {
        /// Portrait.
        id: String,
        /// Why.
        source: FapusError,
    },
}

/// A neutral portrait with its fitted wireframe, ready to be animated.
#[derive(Debug)]
pub struct Portrait {
    id: String,
    metadata: BTreeMap<String, String>,
    /// Map from face space, with flipped y, to the photograph.
    pub(super) image_from_face: Similarity,
    /// Fitted nodes in face space, model units; depths are those of Candide-3.
    pub(super) neutral: Vec<Point3<f64>>,
    pub(super) fapus: Fapus,
    pub(super) warp: Warp,
    pub(super) texture: Texture,
}

/// Marks of a portrait.
#[derive(Clone, Debug, PartialEq)]
pub enum PortraitMarks {
    /// Hand-set or found marks.
    Correspondences(Vec<Correspondence>),
    /// The 68 landmarks in the order of the scheme.
    Landmarks(Vec<Point2<f64>>),
}

impl PortraitMarks {
    /// Reads marks from a CSV file: correspondences `node,x,y`, or 68 landmarks as `point,x,y` or as the first row of `frame,x0,y0,...`.
    /// The header determines the format.
    ///
    /// # Errors
    /// [`PortraitError`] for a file that cannot be read.
    pub fn read(path: &Path, tables: &Tables, node_count: usize) -> Result<Self, PortraitError> {
        let csv = CsvFile::open(path)?;
        if csv.column("point").is_some() {
            return Ok(Self::Landmarks(read_points(&csv)?));
        }
        if csv.column("x0").is_some() {
            let track = read_landmarks(path)?;
            let points = track.frames.into_values().next();
            return Ok(Self::Landmarks(points.ok_or_else(|| PortraitError::LandmarkCount { path: path.to_owned(), found: 0 })?));
        }
        Ok(Self::Correspondences(read_correspondences(path, tables, node_count)?))
    }
}

/// Reads the 68 points of `point,x,y`.
fn read_points(csv: &CsvFile) -> Result<Vec<Point2<f64>>, PortraitError> {
    let [point, x, y] = csv.require(["point", "x", "y"])?;
    let mut points = vec![None; LANDMARK_COUNT];
    for row in csv.rows() {
        let row = row?;
        let place = points.get_mut(row.whole_number(point)? as usize).filter(|p| p.is_none());
        let Some(place) = place else { return Err(row.field_error(point, "each of the points 0 to 67 once").into()) };
        *place = Some(Point2::new(row.number(x)?, row.number(y)?));
    }
    let found = points.iter().flatten().count();
    let count = || PortraitError::LandmarkCount { path: csv.path().to_owned(), found };
    points.into_iter().collect::<Option<Vec<_>>>().ok_or_else(count)
}

impl Portrait {
    /// Fits the wireframe to the marks and prepares the warp. With landmarks, the largest selection that gives a face without folds is
    /// used.
    ///
    /// # Errors
    /// [`PortraitError`] when the marks do not determine a fit, or the face is not frontal.
    pub fn new(
        id: &str,
        photograph: &RgbImage,
        marks: &PortraitMarks,
        fitter: &Fitter,
        wireframe: &Wireframe,
        tables: &Tables,
    ) -> Result<Self, PortraitError> {
        match marks {
            PortraitMarks::Correspondences(marks) => Self::fitted(id, photograph, marks, fitter, wireframe, tables),
            PortraitMarks::Landmarks(points) => {
                let mut result = None;
                for selection in &SELECTIONS {
                    let marks = correspondences_from_landmarks(points, tables, selection)?;
                    let portrait = Self::fitted(id, photograph, &marks, fitter, wireframe, tables);
                    match (&portrait, &result) {
                        (Ok(_), _) => return portrait,
                        (Err(_), None) => result = Some(portrait),
                        _ => {}
                    }
                }
                // The first error belongs to the selection with the most marks; there is at least one selection.
                result.unwrap_or_else(|| Err(PortraitError::Warp { id: id.to_owned(), source: WarpError::NoEyes }))
            }
        }
    }

    fn fitted(
        id: &str,
        photograph: &RgbImage,
        marks: &[Correspondence],
        fitter: &Fitter,
        wireframe: &Wireframe,
        tables: &Tables,
    ) -> Result<Self, PortraitError> {
        let name = || id.to_owned();
        validate_correspondences(marks, photograph.width(), photograph.height())
            .map_err(|source| PortraitError::Marks { id: name(), source })?;
        let fitted = fitter.fit(wireframe, marks).map_err(|source| PortraitError::Fit { id: name(), source })?;
        let mut nodes = fitted.model.nodes().to_vec();
        give_brows_height(&mut nodes, &fitted.image_from_face, tables);
        let texture = Texture::new(photograph);
        let warp = Warp::new(&nodes).map_err(|source| PortraitError::Warp { id: name(), source })?.with_eyes(&texture);
        let face_from_image = fitted.image_from_face.inverse();
        let mut neutral: Vec<Point3<f64>> = nodes
            .iter()
            .zip(wireframe.vertices())
            .map(|(p, vertex)| {
                let flat = face_from_image.apply(p);
                Point3::new(flat.x, -flat.y, vertex.z)
            })
            .collect();
        place_followers(wireframe, &mut neutral);
        let flat: Vec<Point2<f64>> = neutral.iter().map(nalgebra::OPoint::xy).collect();
        let fapus = Fapus::measure(&tables.fapus, &flat).map_err(|source| PortraitError::Fapus { id: name(), source })?;
        let image_from_face = fitted.image_from_face;
        Ok(Self { id: name(), metadata: BTreeMap::new(), image_from_face, neutral, fapus, warp, texture })
    }

    /// Returns the name of the portrait.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Returns the metadata of the person, by column.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Returns the nodes on the photograph, px.
    pub fn nodes(&self) -> &[Point2<f64>] {
        self.warp.nodes()
    }
}

/// Moves the lower nodes of the brows down to at least [`BROW_HEIGHT`] below the upper ones.
fn give_brows_height(nodes: &mut [Point2<f64>], image_from_face: &Similarity, tables: &Tables) {
    let down = image_from_face.apply_vector(&Vector2::y()).normalize();
    let height = BROW_HEIGHT * eye_distance_px(tables, nodes).unwrap_or(0.0);
    for (upper, lower) in BROWS {
        let missing = height - (nodes[lower] - nodes[upper]).dot(&down);
        nodes[lower] += down * missing.max(0.0);
    }
}

/// A portrait on disk.
#[derive(Clone, Debug, PartialEq)]
pub struct PortraitSource {
    /// Name of the portrait.
    pub id: String,
    /// Path of the photograph.
    pub photograph: PathBuf,
    /// Marks; when there are none, they are found when the photograph is read.
    pub marks: Option<PortraitMarks>,
    /// Metadata of the person, by column.
    pub metadata: BTreeMap<String, String>,
}

impl PortraitSource {
    /// Makes a source from one photograph, with marks from the given file or from one next to the photograph, if there is any.
    ///
    /// # Errors
    /// [`PortraitError`] for marks that cannot be read.
    pub fn photograph(path: &Path, marks: Option<&Path>, tables: &Tables, node_count: usize) -> Result<Self, PortraitError> {
        if !path.exists() {
            return Err(PortraitError::NotThere { path: path.to_owned() });
        }
        let id = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let beside = MARK_FILES.map(|ending| path.with_file_name(format!("{id}{ending}")));
        let found = marks.or_else(|| beside.iter().map(PathBuf::as_path).find(|path| path.is_file()));
        let marks = found.map(|file| PortraitMarks::read(file, tables, node_count)).transpose()?;
        Ok(Self { id, photograph: path.to_owned(), marks, metadata: BTreeMap::new() })
    }

    /// Returns the portraits of a folder: the photographs in it, or the neutral frame of every subject of a dataset.
    ///
    /// A `manifest.csv` with the columns `file` and `state` restricts the photographs to neutral ones and adds its other columns. Frames of
    /// a dataset come with their correspondences or landmarks. Missing marks are found later.
    ///
    /// # Errors
    /// [`PortraitError`] for a folder without portraits, or marks that cannot be read.
    pub fn folder(path: &Path, tables: &Tables, node_count: usize) -> Result<Vec<Self>, PortraitError> {
        let listed = listed_photographs(path)?;
        let photographs = match listed {
            Some(photographs) => photographs,
            None if path.join(MANIFEST_NAME).is_file() => return Self::dataset(path, tables, node_count),
            None => photographs(path)?.into_iter().map(|file| (file, BTreeMap::new())).collect(),
        };
        if photographs.is_empty() {
            return Self::dataset(path, tables, node_count).map_err(|error| match error {
                PortraitError::Dataset(_) => PortraitError::Empty { path: path.to_owned() },
                error => error,
            });
        }
        let one = |(file, metadata): Listed| Ok(Self { metadata, ..Self::photograph(&file, None, tables, node_count)? });
        photographs.into_iter().map(one).collect()
    }

    /// Returns the neutral frame of every subject's first sequence.
    fn dataset(path: &Path, tables: &Tables, node_count: usize) -> Result<Vec<Self>, PortraitError> {
        let dataset = Dataset::open(path)?;
        let mut portraits: Vec<Self> = Vec::new();
        for entry in &dataset.sequences {
            if portraits.iter().any(|p| p.id == entry.id.subject) {
                continue;
            }
            let frames = entry.frames()?;
            let neutral = frames.neutral_number();
            let marks = if let Some(track) = entry.landmarks()? {
                Some(PortraitMarks::Landmarks(track.frame(neutral)?.to_vec()))
            } else if matches!(entry.correspondence_source()?, CorrespondenceSource::None) {
                None
            } else {
                let selection = LandmarkSelection::default();
                Some(PortraitMarks::Correspondences(entry.correspondences(neutral, tables, node_count, &selection)?))
            };
            let Some(photograph) = frames.files().first().map(|path| (*path).to_owned()) else { continue };
            portraits.push(Self { id: entry.id.subject.clone(), photograph, marks, metadata: entry.metadata.clone() });
        }
        if portraits.is_empty() {
            return Err(PortraitError::Empty { path: path.to_owned() });
        }
        Ok(portraits)
    }

    /// Reads the photograph and fits it; finds its marks when there are none.
    ///
    /// # Errors
    /// As [`Portrait::new`], and for a photograph that cannot be opened, or in which no face is found.
    pub fn open(&self, fitter: &Fitter, wireframe: &Wireframe, tables: &Tables) -> Result<Portrait, PortraitError> {
        let picture = read_colour(&self.photograph)?;
        let found;
        let marks = if let Some(marks) = &self.marks {
            marks
        } else {
            found = PortraitMarks::Correspondences(self.find()?);
            &found
        };
        let portrait = Portrait::new(&self.id, &picture, marks, fitter, wireframe, tables)?;
        Ok(Portrait { metadata: self.metadata.clone(), ..portrait })
    }

    /// Finds the marks of the largest face in the photograph.
    fn find(&self) -> Result<Vec<Correspondence>, PortraitError> {
        let bench = Workbench::new(None, PipelineOptions::default()).map_err(|e| PortraitError::Workbench(Box::new(e)))?;
        let photograph = sequence::Portrait::read(&self.photograph)?;
        let frame = Frame::new(0, photograph.grey);
        let found = found_marks_and_remark(&frame, Some(&photograph.picture), &bench);
        found.map(|found| found.marks).map_err(|source| PortraitError::NotFound {
            id: self.id.clone(),
            path: self.photograph.clone(),
            source: Box::new(source),
        })
    }
}

/// Returns a fitter for portraits, with the default options.
#[must_use]
pub fn portrait_fitter(wireframe: &Wireframe) -> Fitter {
    Fitter::new(wireframe, FitOptions::default())
}

/// A photograph with its metadata from a manifest.
type Listed = (PathBuf, BTreeMap<String, String>);

/// Returns the photographs that a manifest with the columns `file` and `state` lists as neutral, with its other columns; `None` without
/// such a manifest.
fn listed_photographs(folder: &Path) -> Result<Option<Vec<Listed>>, PortraitError> {
    let manifest = folder.join(MANIFEST_NAME);
    if !manifest.is_file() {
        return Ok(None);
    }
    let csv = CsvFile::open(&manifest)?;
    let (Some(file), Some(state)) = (csv.column("file"), csv.column("state")) else { return Ok(None) };
    let further: Vec<(usize, &String)> = csv.header().iter().enumerate().filter(|(k, _)| ![file, state].contains(k)).collect();
    let mut files = Vec::new();
    for row in csv.rows() {
        let row = row?;
        if row.get(state).trim() == "neutral" {
            let metadata = further.iter().map(|&(k, name)| (name.clone(), row.get(k).trim().to_owned())).collect();
            files.push((folder.join(row.get(file).trim()), metadata));
        }
    }
    Ok(Some(files))
}

/// Returns the pictures in a folder, sorted by name.
fn photographs(folder: &Path) -> Result<Vec<PathBuf>, PortraitError> {
    let io = |source| PortraitError::Io { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if is_picture(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
