//! Expressions on new faces and on dense meshes.

use std::path::PathBuf;

use grimace::internal::{
    clone::{CloneError as LibraryError, CloneOptions, SourceMotion, clone_expression},
    interpolation::FPS,
    pipeline::found_marks_and_remark,
    synthesis::{self, Animation, Bank, EmbeddedBank, SynthesisOptions, Synthesizer, read_motion},
};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::{
    exceptions::{PyKeyboardInterrupt, PyValueError},
    prelude::*,
    types::PyDict,
};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::{
    arrays::{Marks, Picture, model_array, model_of},
    bench::{bench, without_place},
    errors::{CloneError, GrimaceError, LocateError, SynthesisError, to},
    fap::sequence_of,
    long::run_long,
    tracks::Track,
};

/// Whatever moves: a file, a track, a model, FAPs with their frame rate.
#[derive(FromPyObject)]
pub enum MotionSource<'py> {
    Track(Bound<'py, Track>),
    Model(PyReadonlyArray3<'py, f64>),
    Fap(PyReadonlyArray2<'py, f64>, f64),
    File(PathBuf),
}

const NAME: &str = "motion";

fn source_of(source: &MotionSource<'_>, bench: &grimace::internal::pipeline::Workbench) -> PyResult<SourceMotion> {
    let motion = match source {
        MotionSource::File(path) => SourceMotion::read(path, bench),
        MotionSource::Model(model) => SourceMotion::from_model(NAME, &model_of(model)?, bench),
        MotionSource::Fap(values, fps) => SourceMotion::from_fap(NAME, &sequence_of(NAME, *fps, values, Vec::new())?, bench),
        MotionSource::Track(track) => {
            let track = track.get();
            SourceMotion::from_track(NAME, track.frames(), &[], bench).map(|motion| SourceMotion { fps: track.fps(), ..motion })
        }
    };
    motion.map_err(to::<CloneError>)
}

/// The frames of an expression on a picture.
#[pyfunction]
pub fn clone<'py>(
    py: Python<'py>,
    source: MotionSource<'py>,
    image: &Bound<'py, PyAny>,
    marks: Option<Marks>,
    clone_options: &str,
    options: &str,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let bench = bench(options)?;
    let mut wanted = serde_json::to_value(CloneOptions::default()).map_err(to::<GrimaceError>)?;
    let given: serde_json::Value = serde_json::from_str(clone_options).map_err(to::<GrimaceError>)?;
    merge(&mut wanted, given);
    let wanted: CloneOptions = serde_json::from_value(wanted).map_err(|e| PyValueError::new_err(without_place(&e)))?;
    let motion = source_of(&source, &bench)?;
    let picture = Picture::of(image)?;
    let (pixels, nodes, fps, apex) = run_long(py, progress, true, move |caller| {
        let (frame, colour) = picture.portrait()?;
        let marks = match marks {
            Some(marks) => marks.read(&bench)?,
            None => found_marks_and_remark(&frame, Some(&colour), &bench).map_err(to::<LocateError>)?.marks,
        };
        let target = bench.target("target", colour, &marks).map_err(to::<CloneError>)?;
        let made = clone_expression(&motion, &target, None, &wanted, &bench).map_err(to::<CloneError>)?;
        let done = AtomicUsize::new(0);
        let total = Some(made.frames.len());
        let frames: Option<Vec<_>> = (0..made.frames.len())
            .into_par_iter()
            .map(|k| {
                let picture = caller.goes_on().then(|| made.picture(k))?;
                caller.progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
                Some(picture)
            })
            .collect();
        let frames = frames.ok_or_else(|| PyKeyboardInterrupt::new_err(()))?;
        let frames = frames.into_iter().collect::<Result<Vec<_>, _>>().map_err(|e: LibraryError| to::<CloneError>(e))?;
        let size = frames.first().map_or((0, 0), image::RgbImage::dimensions);
        let count = frames.len();
        let bytes: Vec<u8> = frames.into_iter().flat_map(image::RgbImage::into_raw).collect();
        let model = made.model().map_err(|e: LibraryError| to::<CloneError>(e))?;
        Ok(((bytes, count, size), model, made.fps, made.apex()))
    })?;
    let (bytes, count, (width, height)) = pixels;
    let out = PyDict::new(py);
    out.set_item("frames", bytes.into_pyarray(py).reshape([count, height as usize, width as usize, 3])?)?;
    out.set_item("nodes", model_array(py, &nodes)?)?;
    out.set_item("fps", fps)?;
    out.set_item("apex", apex)?;
    Ok(out)
}

/// Puts what is given over what is there.
fn merge(there: &mut serde_json::Value, given: serde_json::Value) {
    match (there, given) {
        (serde_json::Value::Object(there), serde_json::Value::Object(given)) => {
            for (key, value) in given {
                merge(there.entry(key).or_insert(serde_json::Value::Null), value);
            }
        }
        (there, given) => *there = given,
    }
}

/// A motion on a bank of meshes.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
pub fn synthesize<'py>(
    py: Python<'py>,
    motion: PathBuf,
    bank: PathBuf,
    between_noise: (Option<usize>, Option<f64>),
    fps_scale: (Option<f64>, Option<f64>),
    synthesis_options: &str,
    gltf: Option<PathBuf>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let mut wanted = serde_json::to_value(SynthesisOptions::default()).map_err(to::<GrimaceError>)?;
    merge(&mut wanted, serde_json::from_str(synthesis_options).map_err(to::<GrimaceError>)?);
    let wanted: SynthesisOptions = serde_json::from_value(wanted).map_err(|e| PyValueError::new_err(without_place(&e)))?;
    wanted.check().map_err(to::<SynthesisError>)?;
    let ((between, noise), (fps, scale)) = (between_noise, fps_scale);
    let made = run_long(py, progress, false, move |caller| {
        let bank = match EmbeddedBank::of_path(&bank) {
            Some(embedded) => embedded.bank().map_err(to::<SynthesisError>)?,
            None => Bank::open(&bank).map_err(|e| {
                let (path, text) = (bank.display().to_string(), e.to_string());
                to::<SynthesisError>(if text.contains(&path) { text } else { format!("{path}: {text}") })
            })?,
        };
        let motion = read_motion(&motion, &bank, scale).map_err(to::<SynthesisError>)?;
        let motion = motion.as_animated(between, noise).map_err(to::<SynthesisError>)?.for_solver(wanted.solver);
        let fps = fps.or(motion.fps).unwrap_or(f64::from(FPS));
        let synthesizer = Synthesizer::new(&bank, wanted).map_err(to::<SynthesisError>)?;
        let (done, total) = (AtomicUsize::new(0), Some(motion.frames.len()));
        let answers = synthesizer.animate(&motion.frames, || caller.progress(done.fetch_add(1, Ordering::Relaxed) + 1, total));
        if let Some(path) = gltf {
            let animation = Animation {
                synthesizer: &synthesizer,
                motions: &motion.frames,
                answers: &answers,
                name: NAME,
                fps,
                texture: None,
            };
            synthesis::write_gltf(&path, &[animation]).map_err(to::<SynthesisError>)?;
        }
        let surface: Vec<f32> =
            answers.iter().zip(&motion.frames).flat_map(|(a, m)| synthesizer.surface(a, m)).flatten().collect();
        let fitness: Vec<f64> = answers.iter().map(|a| a.fitness.unwrap_or(f64::NAN)).collect();
        let shown: Vec<f64> = answers.iter().map(|a| a.shown.unwrap_or(f64::NAN)).collect();
        let bound: Vec<f64> = answers.iter().map(|a| a.share_of_bound().unwrap_or(f64::NAN)).collect();
        let regions = answers.first().map_or(0, |a| a.weights.len());
        let weights: Vec<f64> = answers.iter().flat_map(|a| a.weights.iter().flatten().copied()).collect();
        let neutral: Vec<f32> = bank.mesh().positions().iter().flatten().copied().collect();
        let triangles: Vec<i64> = bank.mesh().triangles().iter().flatten().map(|&v| i64::from(v)).collect();
        Ok((surface, (fitness, shown, bound), (weights, regions), (neutral, triangles), bank.names().to_vec(), fps))
    })?;
    let (surface, (fitness, shown, bound), (weights, regions), (neutral, triangles), names, fps) = made;
    let (frames, vertices) = (fitness.len(), neutral.len() / 3);
    let triangle_count = triangles.len() / 3;
    let members = if regions == 0 || frames == 0 { 0 } else { weights.len() / regions / frames };
    let out = PyDict::new(py);
    out.set_item("surface", surface.into_pyarray(py).reshape([frames, vertices, 3])?)?;
    out.set_item("neutral", neutral.into_pyarray(py).reshape([vertices, 3])?)?;
    out.set_item("triangles", triangles.into_pyarray(py).reshape([triangle_count, 3])?)?;
    out.set_item("weights", weights.into_pyarray(py).reshape([frames, regions, members])?)?;
    out.set_item("members", names)?;
    out.set_item("fitness", fitness.into_pyarray(py))?;
    out.set_item("shown", shown.into_pyarray(py))?;
    out.set_item("share_of_bound", bound.into_pyarray(py))?;
    out.set_item("fps", fps)?;
    Ok(out)
}
