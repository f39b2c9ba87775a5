//! Tracks and normalized models.

use std::{path::PathBuf, sync::Arc};

use grimace::internal::{
    dataset::{FrameSource, list_frames},
    pipeline::{self, SequenceFailure, SequenceSource, Workbench, id_of, normalize_track, track_one, track_pictures},
    plausible::FaceSize,
    sequence::{Frame, read_first_frame},
    track::{self as tracking, TrackInfo, TrackedFrame, TrackedNode, read_track, read_track_info, write_track},
    units::{FaceUnit, Px, SequenceId},
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::{exceptions::PyKeyboardInterrupt, prelude::*};

use crate::{
    arrays::{Marks, Picture, marks_or_found, model_array, model_of, positions_of},
    bench::bench,
    errors::{GrimaceError, InputError, NormalizeError, TrackError, of_stage, to},
    long::{Caller, run_long},
};

/// A tracked sequence.
#[pyclass(frozen, module = "grimace._grimace")]
pub struct Track {
    track: tracking::Track,
    info: Option<TrackInfo>,
}

impl Track {
    pub fn frames(&self) -> &[TrackedFrame] {
        &self.track.frames
    }

    pub fn fps(&self) -> Option<f64> {
        self.info.as_ref().and_then(|i| i.fps)
    }

    fn per_node<'py>(&self, py: Python<'py>, value: impl Fn(&TrackedNode) -> Option<f64>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values: Vec<f64> = self.frames().iter().flat_map(|f| &f.nodes).map(|n| value(n).unwrap_or(f64::NAN)).collect();
        let frames = self.frames().len();
        let nodes = values.len() / frames.max(1);
        values.into_pyarray(py).reshape([frames, nodes])
    }
}

#[pymethods]
impl Track {
    /// Reads a track file.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        let frames = read_track(&path).map_err(to::<InputError>)?;
        let info = read_track_info(&path).map_err(to::<InputError>)?;
        let size = info.as_ref().map_or(grimace::internal::sequence::ImageSize { width: 0, height: 0 }, |i| i.image_size);
        Ok(Self { track: tracking::Track { size, frames, mouth_moved: None, covered_at_apex: Vec::new() }, info })
    }

    /// Writes the track and its `.json`.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        let mut info = self.info.clone().ok_or_else(|| {
            to::<TrackError>("this track was read from a .csv without the .json beside it, so what it was made from is not known")
        })?;
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
            return Err(to::<TrackError>(format!("{}: a track is a .csv; the .json is written beside it", path.display())));
        }
        info.id = id_of(&path);
        write_track(&path, self.frames(), &mut info).map_err(to::<GrimaceError>)?;
        Ok(())
    }

    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        positions_of(py, &self.track)
    }

    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.frames().iter().map(|f| i64::from(f.number)).collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn states(&self) -> Vec<Vec<&'static str>> {
        self.frames().iter().map(|f| f.nodes.iter().map(|n| n.state.name()).collect()).collect()
    }

    #[getter]
    fn residuals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.per_node(py, |n| n.residual)
    }

    #[getter]
    fn expected_errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.per_node(py, |n| n.expected_error)
    }

    /// Width and height of the frames, px.
    #[getter]
    fn size(&self) -> (u32, u32) {
        (self.track.size.width, self.track.size.height)
    }

    /// What the track was made from, as JSON; `None` where no file says so.
    #[getter]
    fn info(&self) -> PyResult<Option<String>> {
        self.info.as_ref().map(|info| serde_json::to_string(info).map_err(to::<GrimaceError>)).transpose()
    }
}

/// Where the frames of a track come from.
enum Source {
    Files(FrameSource),
    Pictures(Vec<Picture>),
}

/// Tracks a folder of images, a video, or pictures.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn track(
    py: Python<'_>,
    folder: Option<PathBuf>,
    pictures: Option<Vec<Bound<'_, PyAny>>>,
    marks: Option<Marks>,
    range: (Option<u32>, Option<u32>),
    fps: Option<f64>,
    labels: (String, String, String),
    options: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Track> {
    let source = match (folder, pictures) {
        (Some(folder), _) => Source::Files(list_frames(&folder, range.0, range.1).map_err(to::<InputError>)?),
        (None, pictures) => Source::Pictures(pictures.unwrap_or_default().iter().map(Picture::of).collect::<PyResult<Vec<_>>>()?),
    };
    let bench = bench(options)?;
    let (subject, sequence, emotion) = labels;
    run_long(py, progress, true, move |caller| {
        let id = SequenceId { subject, sequence };
        let labelled = SequenceSource {
            id,
            emotion,
            metadata: std::collections::BTreeMap::new(),
            frames: FrameSource::Images(Vec::new()),
            marks: Vec::new(),
            marks_from: String::new(),
            covered: Vec::new(),
            fps,
        };
        let tracked = match source {
            Source::Files(frames) => track_files(frames, marks.as_ref(), labelled, &bench, caller),
            Source::Pictures(pictures) => track_arrays(pictures, marks.as_ref(), labelled, &bench, caller),
        };
        let (track, info) = tracked?;
        Ok(Track { track, info: Some(info) })
    })
}

type Tracked = (tracking::Track, TrackInfo);

fn track_files(
    frames: FrameSource,
    marks: Option<&Marks>,
    labelled: SequenceSource,
    bench: &Workbench,
    caller: &Caller<Track>,
) -> PyResult<Tracked> {
    let first = read_first_frame(&frames).map_err(to::<InputError>)?;
    let (found, from) = marks_or_found(marks, (&first, None), bench)?;
    let total = match &frames {
        FrameSource::Images(files) => Some(files.len()),
        FrameSource::Video { .. } => None,
    };
    let source = SequenceSource { frames, marks: found.marks, covered: found.covered, marks_from: from.to_owned(), ..labelled };
    tracked(track_one(&source, bench, ticks(caller, total)), caller)
}

fn track_arrays(
    pictures: Vec<Picture>,
    marks: Option<&Marks>,
    labelled: SequenceSource,
    bench: &Workbench,
    caller: &Caller<Track>,
) -> PyResult<Tracked> {
    let frames: Vec<Frame> = (1..).zip(pictures).map(|(number, picture)| picture.frame(number)).collect::<PyResult<_>>()?;
    let first = frames.first().ok_or_else(|| to::<TrackError>("there are no frames to track"))?;
    let (found, from) = marks_or_found(marks, (first, None), bench)?;
    let total = Some(frames.len());
    let source = SequenceSource { marks: found.marks, covered: found.covered, marks_from: from.to_owned(), ..labelled };
    tracked(track_pictures(&source, frames, bench, ticks(caller, total)), caller)
}

fn ticks<T>(caller: &Caller<T>, total: Option<usize>) -> impl FnMut(u32) -> bool {
    let mut done = 0;
    move |_| {
        done += 1;
        caller.progress(done, total);
        caller.goes_on()
    }
}

fn tracked(result: Result<Tracked, SequenceFailure>, caller: &Caller<Track>) -> PyResult<Tracked> {
    result.map_err(|failure| if caller.goes_on() { of_stage(&failure) } else { PyKeyboardInterrupt::new_err(()) })
}

/// The normalized model of a track, frames x nodes x 2, face units.
#[pyfunction]
pub fn normalize<'py>(py: Python<'py>, track: Bound<'py, Track>, options: &str) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let bench = bench(options)?;
    let track: Py<Track> = track.unbind();
    let model = run_long(py, None, false, move |_| {
        let track = track.get();
        normalize_track(track.frames(), track.info.as_ref(), &bench).map_err(|f| of_stage(&f))
    })?;
    model_array(py, &model)
}

/// The normalized model of positions in px, with the head's roll alone taken out: nothing is known of where they come from.
#[pyfunction]
pub fn normalize_positions<'py>(
    py: Python<'py>,
    positions: PyReadonlyArray3<'py, f64>,
    options: &str,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let bench: Arc<Workbench> = bench(options)?;
    let track = model_of::<Px>(&positions)?;
    let normalizer = bench.normalizer().map_err(to::<NormalizeError>)?;
    let model = normalizer.normalize(&track).map_err(to::<NormalizeError>)?;
    FaceSize::CANONICAL.check_model(&model).map_err(to::<NormalizeError>)?;
    model_array(py, &model)
}

/// Reads a normalized model or a representative.
#[pyfunction]
pub fn read_model(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<f64>>> {
    model_array(py, &pipeline::read_model(&path).map_err(to::<InputError>)?)
}

/// Writes a normalized model or a representative.
#[pyfunction]
pub fn write_model(path: PathBuf, model: PyReadonlyArray3<'_, f64>) -> PyResult<()> {
    pipeline::write_model(&path, &model_of::<FaceUnit>(&model)?).map_err(to::<GrimaceError>)?;
    Ok(())
}
