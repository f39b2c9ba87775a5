//! The locator's learned model and its file format.
//!
//! The file contains [`MAGIC`], the length of a JSON description (u32, little-endian), the description, and the matrices that it lists: for
//! each a scale per row (f32), then its values (i16, times the scale of their row).

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use super::{
    cells::Patch,
    covers::CoverStage,
    mouth::{ESTIMATES, MouthStage, moved_points},
    part::FacePart,
    points::points,
    shape::Shape,
    stages::{JointStage, LocalStage},
    template::{self, Template},
};

/// Version of the file.
pub const SCHEMA: u32 = 1;

/// First bytes of the file.
pub const MAGIC: &[u8; 8] = b"grimloc\n";

/// All learned parameters of the locator.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Mean face, canonical.
    pub mean: Shape,
    /// Indices of the points whose neighbourhoods joint stages read.
    pub features: Vec<usize>,
    /// Joint stages, which come first.
    pub joint: Vec<JointStage>,
    /// Local stages, which follow.
    pub local: Vec<LocalStage>,
    /// Template that proposes faces.
    pub template: Template,
    /// Verifier that accepts faces: weights of the last joint stage's features, and a constant.
    pub verifier: (Vec<f32>, f32),
    /// Model of expected errors.
    pub errors: ErrorModel,
    /// Stage for covered parts; `None` in an older model without it.
    pub covers: Option<CoverStage>,
    /// Stage for moved mouths; `None` in a model without it.
    pub mouth: Option<MouthStage>,
}

/// Model of a point's expected error from features of the reading: `log e = intercept + sum of slope x feature`, then a calibration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorModel {
    /// Intercept of each point.
    pub intercepts: Vec<f32>,
    /// Slope of each feature of [`super::expect::signs`].
    pub slopes: Vec<f32>,
    /// Calibration: pairs of the sum and the calibrated value, both logarithms of shares of the eye distance, ascending.
    pub knots: Vec<[f32; 2]>,
    /// Score of the verifier below which errors are larger than predicted: the lowest percentile of the calibration faces.
    pub low_score: f32,
}

/// Origin of a model: its training data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelOrigin {
    /// Program name and version.
    pub made_by: String,
    /// Command line.
    pub command: String,
    /// BLAKE3 of points and pictures, in hexadecimal.
    pub blake3: String,
    /// Number of people.
    pub people: usize,
    /// People excluded from training.
    pub left_out: Vec<String>,
    /// Credit and licence of the faces.
    pub credit: String,
}

#[derive(Serialize, Deserialize)]
struct Header {
    schema: u32,
    points: usize,
    features: Vec<usize>,
    joint: Vec<Patch>,
    local: Vec<Vec<Patch>>,
    template_bias: f32,
    verifier_bias: f32,
    errors: ErrorModel,
    /// Whether the matrices include those of covered parts.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    covers: bool,
    /// Parameters of moved mouths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mouth: Option<MouthHeader>,
    origin: ModelOrigin,
    /// Names of the matrices in order, with their number of values and row length.
    matrices: Vec<(String, usize, usize)>,
}

/// Parameters of [`MouthStage`] that are no matrices.
#[derive(Serialize, Deserialize)]
struct MouthHeader {
    base: [f32; ESTIMATES],
    ramps: [[f32; 2]; ESTIMATES],
    stages: Vec<Vec<Patch>>,
}

/// A model of the locator that does not read or cannot be written.
///
/// ```
/// use grimace::locate::{Locator, LocatorError};
///
/// let error = Locator::open("fixtures/portraits/P01.jpg".as_ref()).unwrap_err();
/// assert!(matches!(error, LocatorError::Format { .. }));
/// assert!(Locator::open("candide/locator.bin".as_ref()).is_ok());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum LocatorError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is not a model.
    #[error("{}: this is not a model of the locator: {reason}; make one with `grimace learn locator`", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// Appends a matrix in the file's format.
fn quantized(values: &[f32], row: usize, out: &mut Vec<u8>) {
    let most = |line: &[f32]| line.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    let scales: Vec<f32> =
        values.chunks(row.max(1)).map(|line| most(line).max(f32::MIN_POSITIVE) / f32::from(i16::MAX)).collect();
    scales.iter().for_each(|s| out.extend(s.to_le_bytes()));
    for (line, scale) in values.chunks(row.max(1)).zip(&scales) {
        line.iter().for_each(|v| out.extend(((v / scale).round() as i16).to_le_bytes()));
    }
}

/// Matrices by name.
struct Matrices(BTreeMap<String, Vec<f32>>);

impl Matrices {
    fn read(layout: &[(String, usize, usize)], mut bytes: &[u8]) -> Result<Self, String> {
        let mut matrices = BTreeMap::new();
        for (name, count, row) in layout {
            let row = (*row).max(1);
            let size = count.checked_mul(2).and_then(|n| n.checked_add(count.div_ceil(row).checked_mul(4)?));
            let size = size.filter(|&n| n <= bytes.len()).ok_or_else(|| format!("{name}: the file ends too early"))?;
            let (part, rest) = bytes.split_at(size);
            bytes = rest;
            let (scales, numbers) = part.split_at(count.div_ceil(row) * 4);
            let scales = scales.as_chunks().0.iter().map(|scale| f32::from_le_bytes(*scale));
            let mut values = Vec::with_capacity(*count);
            for (line, scale) in numbers.chunks(row.saturating_mul(2)).zip(scales) {
                values.extend(line.as_chunks().0.iter().map(|number| f32::from(i16::from_le_bytes(*number)) * scale));
            }
            if !values.iter().all(|v| v.is_finite()) {
                return Err(format!("{name}: numbers that are not finite"));
            }
            matrices.insert(name.clone(), values);
        }
        if bytes.is_empty() { Ok(Self(matrices)) } else { Err(format!("the file has {} bytes too many at the end", bytes.len())) }
    }

    /// Removes and returns a matrix, which must have `count` values; any positive number if `None`.
    fn take(&mut self, name: &str, count: Option<usize>) -> Result<Vec<f32>, String> {
        let values = self.0.remove(name).ok_or_else(|| format!("{name} is missing"))?;
        let fits = count.map_or(!values.is_empty(), |c| c == values.len());
        if fits { Ok(values) } else { Err(format!("{name}: {} numbers; {} were expected", values.len(), count.unwrap_or(1))) }
    }
}

impl Model {
    /// Reads the model shipped with the program.
    ///
    /// # Errors
    /// [`LocatorError::Format`] if the program was built with an incomplete model.
    pub fn shipped() -> Result<Self, LocatorError> {
        Self::from_bytes(Path::new("candide/locator.bin"), include_bytes!("../../candide/locator.bin")).map(|m| m.0)
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// [`LocatorError`].
    pub fn read(path: &Path) -> Result<(Self, ModelOrigin), LocatorError> {
        let bytes = crate::input::read(path).map_err(|source| LocatorError::Io { path: path.to_owned(), source })?;
        Self::from_bytes(path, &bytes)
    }

    /// Same as [`Model::read`], from the file's content; `path` is only used in error messages.
    ///
    /// # Errors
    /// [`LocatorError::Format`].
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<(Self, ModelOrigin), LocatorError> {
        parse(bytes).map_err(|reason| LocatorError::Format { path: path.to_owned(), reason })
    }

    /// Returns the content of the model's file.
    ///
    /// # Errors
    /// Fails if a number is not finite.
    pub fn to_bytes(&self, origin: &ModelOrigin) -> Result<Vec<u8>, serde_json::Error> {
        let steps = 2 * self.mean.len();
        let mean: Vec<f32> = self.mean.iter().flatten().copied().collect();
        let mut parts: Vec<(String, &[f32], usize)> = vec![
            ("mean".to_owned(), &mean, 1),
            ("template".to_owned(), &self.template.weights, self.template.weights.len()),
            ("verifier".to_owned(), &self.verifier.0, self.verifier.0.len()),
        ];
        for (k, stage) in self.joint.iter().enumerate() {
            parts.push((format!("joint.{k}.offset"), &stage.offset, stage.offset.len()));
            parts.push((format!("joint.{k}.down"), &stage.down, stage.offset.len()));
            parts.push((format!("joint.{k}.up"), &stage.up, stage.up.len() / steps.max(1)));
            parts.push((format!("joint.{k}.base"), &stage.base, steps));
        }
        for (k, stage) in self.local.iter().enumerate() {
            parts.extend(local_parts(&format!("local.{k}"), stage));
        }
        if let Some(covers) = &self.covers {
            let count = self.mean.len();
            parts.push(("covers.weights".to_owned(), &covers.weights, covers.weights.len() / (self.local.len() * count).max(1)));
            parts.push(("covers.base".to_owned(), &covers.base, 1));
            parts.push(("covers.mix".to_owned(), &covers.mix, count));
            parts.push(("covers.mix_base".to_owned(), &covers.mix_base, 1));
            parts.push(("covers.errors".to_owned(), &covers.errors, 1));
            parts.push(("covers.limits".to_owned(), &covers.limits, 1));
        }
        if let Some(mouth) = &self.mouth {
            for (k, weights) in mouth.weights.iter().enumerate() {
                parts.push((format!("mouth.weights.{k}"), weights, weights.len()));
            }
            parts.push(("mouth.errors".to_owned(), &mouth.errors, 1));
            mouth.stages.iter().enumerate().for_each(|(k, stage)| parts.extend(local_parts(&format!("mouth.{k}"), stage)));
        }
        let header = Header {
            schema: SCHEMA,
            points: self.mean.len(),
            features: self.features.clone(),
            joint: self.joint.iter().map(|s| s.patch).collect(),
            local: self.local.iter().map(|s| s.patches.clone()).collect(),
            template_bias: self.template.bias,
            verifier_bias: self.verifier.1,
            errors: self.errors.clone(),
            covers: self.covers.is_some(),
            mouth: self.mouth.as_ref().map(|s| MouthHeader {
                base: s.base,
                ramps: s.ramps,
                stages: s.stages.iter().map(|stage| stage.patches.clone()).collect(),
            }),
            origin: origin.clone(),
            matrices: parts.iter().map(|(name, values, row)| (name.clone(), values.len(), *row)).collect(),
        };
        let description = serde_json::to_string(&header)?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend((description.len() as u32).to_le_bytes());
        bytes.extend(description.as_bytes());
        parts.iter().for_each(|(_, values, row)| quantized(values, *row, &mut bytes));
        Ok(bytes)
    }
}

/// Returns the matrices of a local stage by name, with their row lengths.
fn local_parts<'a>(name: &str, stage: &'a LocalStage) -> [(String, &'a [f32], usize); 4] {
    let row: usize = stage.patches.iter().map(Patch::len).sum();
    let steps = stage.base.len();
    [
        (format!("{name}.offset"), &stage.offset, row),
        (format!("{name}.weights"), &stage.weights, row),
        (format!("{name}.base"), &stage.base, steps),
        (format!("{name}.mix"), &stage.mix, steps),
    ]
}

/// Takes the matrices of a local stage over `count` points.
fn take_local(matrices: &mut Matrices, name: &str, patches: &[Patch], count: usize) -> Result<LocalStage, String> {
    let row: usize = patches.iter().map(Patch::len).sum();
    let steps = 2 * count;
    let mut take = |part: &str, size| matrices.take(&format!("{name}.{part}"), Some(size));
    Ok(LocalStage {
        patches: patches.to_vec(),
        offset: take("offset", count * row)?,
        weights: take("weights", steps * row)?,
        base: take("base", steps)?,
        mix: take("mix", steps * steps)?,
    })
}

/// Takes the stage for moved mouths; `read_around` is the number of descriptors around a point that its estimate reads.
fn take_mouth(matrices: &mut Matrices, header: MouthHeader, read_around: usize) -> Result<MouthStage, String> {
    let MouthHeader { base, ramps, stages } = header;
    let wrong = |&[from, to]: &[f32; 2]| !(0.0..1.0).contains(&from) || !(from..1.0).contains(&to);
    if let Some([from, to]) = ramps.iter().find(|ramp| wrong(ramp)) {
        return Err(format!(
            "the limits of moved mouths are {from} and {to}, but must be ascending shares of the eye distance, from 0 to less than 1"
        ));
    }
    if !base.iter().all(|b| b.is_finite()) {
        return Err("the constants of moved mouths are not finite".to_owned());
    }
    let moved = moved_points().len();
    let stages = stages.iter().enumerate().map(|(k, patches)| take_local(matrices, &format!("mouth.{k}"), patches, moved));
    let stages = stages.collect::<Result<_, _>>()?;
    let mut weights: [Vec<f32>; ESTIMATES] = Default::default();
    for (k, row) in weights.iter_mut().enumerate() {
        *row = matrices.take(&format!("mouth.weights.{k}"), Some(moved * read_around))?;
    }
    Ok(MouthStage { weights, base, ramps, stages, errors: matrices.take("mouth.errors", Some(moved))? })
}

fn parse(bytes: &[u8]) -> Result<(Model, ModelOrigin), String> {
    let rest = bytes.strip_prefix(MAGIC.as_slice()).ok_or("the beginning of the file is not that of a model")?;
    let (length, rest) = rest.split_first_chunk::<4>().ok_or("the file is truncated")?;
    let length = u32::from_le_bytes(*length) as usize;
    let (description, numbers) = rest.split_at_checked(length).ok_or("the file is truncated")?;
    let header: Header = serde_json::from_slice(description).map_err(|e| e.to_string())?;
    if header.schema != SCHEMA {
        return Err(format!("schema {}; this program reads {SCHEMA}", header.schema));
    }
    let count = points().len();
    if header.points != count || header.features.iter().any(|&k| k >= count) {
        return Err(format!("it has {} points, but this program knows {count}", header.points));
    }
    let of_mouths = header.mouth.iter().flat_map(|s| s.stages.iter().flatten());
    let patches = header.joint.iter().chain(header.local.iter().flatten()).chain(of_mouths);
    if patches.clone().any(|p| !(4.0..=256.0).contains(&p.size) || p.side > 16 || p.blur > 32 || !(0.0..1.0).contains(&p.cell)) {
        return Err("patches out of range".to_owned());
    }
    if header.joint.len() < 2 || header.local.is_empty() || header.errors.intercepts.len() != count {
        return Err("stages are missing".to_owned());
    }
    let mut matrices = Matrices::read(&header.matrices, numbers)?;
    let steps = 2 * count;
    let length = |patch: &Patch| header.features.len() * patch.len();
    let mut joint = Vec::new();
    for (k, patch) in header.joint.iter().enumerate() {
        let size = length(patch);
        let up = matrices.take(&format!("joint.{k}.up"), None)?;
        let rank = up.len() / steps;
        if up.len() != rank * steps {
            return Err(format!("joint.{k}.up: {} numbers are no rows of {steps}", up.len()));
        }
        let mut take = |part: &str, count| matrices.take(&format!("joint.{k}.{part}"), Some(count));
        let (offset, down, base) = (take("offset", size)?, take("down", size * rank)?, take("base", steps)?);
        joint.push(JointStage { patch: *patch, offset, down, up, base });
    }
    let mut local = Vec::new();
    for (k, patches) in header.local.iter().enumerate() {
        local.push(take_local(&mut matrices, &format!("local.{k}"), patches, count)?);
    }
    let mean = matrices.take("mean", Some(steps))?;
    let verifier = matrices.take("verifier", Some(header.joint.last().map_or(0, length)))?;
    let weights = matrices.take("template", Some(template::LENGTH))?;
    let read_around: usize = header.local.iter().flatten().map(Patch::len).sum();
    let covers = if header.covers {
        let mut take = |part: &str, size| matrices.take(&format!("covers.{part}"), Some(size));
        Some(CoverStage {
            weights: take("weights", count * read_around)?,
            base: take("base", count)?,
            mix: take("mix", count * count)?,
            mix_base: take("mix_base", count)?,
            errors: take("errors", count)?,
            limits: take("limits", FacePart::ALL.len())?,
        })
    } else {
        None
    };
    let mouth = header.mouth.map(|mouth| take_mouth(&mut matrices, mouth, read_around)).transpose()?;
    let model = Model {
        mean: mean.chunks_exact(2).map(|p| [p[0], p[1]]).collect(),
        features: header.features,
        joint,
        local,
        template: Template { weights, bias: header.template_bias },
        verifier: (verifier, header.verifier_bias),
        errors: header.errors,
        covers,
        mouth,
    };
    Ok((model, header.origin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_model_reads_and_writes_the_same_again() {
        let bytes = include_bytes!("../../candide/locator.bin");
        let (model, origin) = Model::from_bytes(Path::new("locator.bin"), bytes).unwrap();
        assert!(bytes.len() < 2_000_000, "{} bytes", bytes.len());
        assert!(!origin.credit.is_empty());
        let again = Model::from_bytes(Path::new("again"), &model.to_bytes(&origin).unwrap()).unwrap();
        for (one, two) in model.joint[0].down.iter().zip(&again.0.joint[0].down) {
            approx::assert_relative_eq!(one, two, epsilon = 1e-5, max_relative = 1e-3);
        }
    }

    #[test]
    fn files_that_are_not_models_are_reported() {
        let bytes = include_bytes!("../../candide/locator.bin");
        let message = |bytes: &[u8]| Model::from_bytes(Path::new("m.bin"), bytes).unwrap_err().to_string();
        assert!(
            message(b"")
                .starts_with("m.bin: this is not a model of the locator: the beginning of the file is not that of a model")
        );
        assert!(message(&bytes[..bytes.len() - 1]).contains("ends too early"));
        assert!(message(&bytes[..10]).contains("truncated"));
        let mut longer = bytes.to_vec();
        longer.push(0);
        assert!(message(&longer).contains("1 bytes too many"));
    }
}
