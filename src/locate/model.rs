//! What the locator has learned, and its file: safetensors, each tensor as 16-bit numbers with a scale for each of its rows.

use std::{collections::HashMap, path::{Path, PathBuf}};

use safetensors::{Dtype, SafeTensors, tensor::TensorView};
use serde::{Deserialize, Serialize};

use super::{
    cells::Patch,
    points::points,
    shape::Shape,
    stages::{JointStage, LocalStage},
    template::{self, Template},
};

/// Version of the file.
pub const SCHEMA: u32 = 1;

/// Key of the file's description among its metadata.
const KEY: &str = "grimace";

/// Everything that the locator has learned.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Mean face, canonical.
    pub mean: Shape,
    /// Points that joint stages look around.
    pub features: Vec<usize>,
    /// The first stages.
    pub joint: Vec<JointStage>,
    /// The later ones.
    pub local: Vec<LocalStage>,
    /// Where faces may be.
    pub template: Template,
    /// Whether it is one: weights of what the last joint stage reads, and a constant.
    pub verifier: (Vec<f32>, f32),
    /// What errors to expect.
    pub errors: ErrorModel,
}

/// The error to expect of a point from how the reading went: `log e = intercept + sum of slope x sign`, then a calibration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorModel {
    /// Per point.
    pub intercepts: Vec<f32>,
    /// Per sign, as [`super::expect::signs`] lists them.
    pub slopes: Vec<f32>,
    /// Pairs of what the sum says and what it comes to, both logarithms of shares of the eye distance, rising.
    pub knots: Vec<[f32; 2]>,
    /// Score of the verifier under which errors are larger than these: the lowest hundredth of the faces that it was calibrated on.
    pub low_score: f32,
}

/// From whom a model was learned.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelOrigin {
    /// Program and version.
    pub made_by: String,
    /// The command.
    pub command: String,
    /// BLAKE3 of points and pictures, in hexadecimal.
    pub blake3: String,
    /// Number of people.
    pub people: usize,
    /// People left out.
    pub left_out: Vec<String>,
    /// Whose faces these are, and their licence.
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
    origin: ModelOrigin,
}

/// A model that does not read or cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// No model in it.
    #[error("{}: not a model of the locator: {reason}; `grimace learn locator` makes one", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// A matrix as 16-bit numbers, and a scale for each row.
fn quantized(values: &[f32], row: usize) -> (Vec<u8>, Vec<u8>) {
    let (mut numbers, mut scales) = (Vec::with_capacity(values.len() * 2), Vec::new());
    for line in values.chunks(row.max(1)) {
        let most = line.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let scale = if most > 0.0 { most / f32::from(i16::MAX) } else { 1.0 };
        scales.extend(scale.to_le_bytes());
        line.iter().for_each(|v| numbers.extend(((v / scale).round() as i16).to_le_bytes()));
    }
    (numbers, scales)
}

struct Tensors<'a> {
    tensors: SafeTensors<'a>,
}

impl Tensors<'_> {
    /// The numbers of a tensor, `count` of them in rows of `row`.
    fn read(&self, name: &str, count: usize, row: usize) -> Result<Vec<f32>, String> {
        let get = |name: &str, dtype, size: usize| {
            let view = self.tensors.tensor(name).map_err(|e| format!("{name}: {e}"))?;
            let fits = view.dtype() == dtype && view.data().len() == size;
            if fits { Ok(view.data().to_vec()) } else { Err(format!("{name}: {} bytes; {size} were expected", view.data().len())) }
        };
        let row = row.max(1);
        let numbers = get(name, Dtype::I16, count * 2)?;
        let scales = get(&format!("{name}.scale"), Dtype::F32, count.div_ceil(row) * 4)?;
        let scale = |k: usize| scales.get(k * 4..k * 4 + 4).and_then(|b| b.try_into().ok()).map_or(0.0, f32::from_le_bytes);
        let values: Vec<f32> =
            numbers.chunks_exact(2).enumerate().map(|(k, b)| f32::from(i16::from_le_bytes([b[0], b[1]])) * scale(k / row)).collect();
        if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(format!("{name}: numbers that are not finite")) }
    }
}

impl Model {
    /// The model that ships with this program.
    ///
    /// # Errors
    /// [`ModelError::Format`] when it was not built in whole.
    pub fn shipped() -> Result<Self, ModelError> {
        Self::from_bytes(Path::new("candide/locator.safetensors"), include_bytes!("../../candide/locator.safetensors")).map(|m| m.0)
    }

    /// Reads a model from its file.
    ///
    /// # Errors
    /// [`ModelError`].
    pub fn read(path: &Path) -> Result<(Self, ModelOrigin), ModelError> {
        let bytes = std::fs::read(path).map_err(|source| ModelError::Io { path: path.to_owned(), source })?;
        Self::from_bytes(path, &bytes)
    }

    /// As [`Model::read`] from the file's content; `path` is only named in errors.
    ///
    /// # Errors
    /// [`ModelError::Format`].
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<(Self, ModelOrigin), ModelError> {
        parse(bytes).map_err(|reason| ModelError::Format { path: path.to_owned(), reason })
    }

    /// The file's content.
    ///
    /// # Errors
    /// [`ModelError::Format`] when the parts do not fit together.
    pub fn to_bytes(&self, origin: &ModelOrigin) -> Result<Vec<u8>, ModelError> {
        let failed = |reason: String| ModelError::Format { path: PathBuf::from("model"), reason };
        let header = Header {
            schema: SCHEMA,
            points: self.mean.len(),
            features: self.features.clone(),
            joint: self.joint.iter().map(|s| s.patch).collect(),
            local: self.local.iter().map(|s| s.patches.clone()).collect(),
            template_bias: self.template.bias,
            verifier_bias: self.verifier.1,
            errors: self.errors.clone(),
            origin: origin.clone(),
        };
        let description = serde_json::to_string(&header).map_err(|e| failed(e.to_string()))?;
        let steps = 2 * self.mean.len();
        let mean: Vec<f32> = self.mean.iter().flatten().copied().collect();
        let mut parts: Vec<(String, &[f32], usize)> = vec![
            ("mean".to_owned(), &mean, 1),
            ("template".to_owned(), &self.template.weights, self.template.weights.len()),
            ("verifier".to_owned(), &self.verifier.0, self.verifier.0.len()),
        ];
        for (k, stage) in self.joint.iter().enumerate() {
            let rank = stage.up.len() / steps.max(1);
            parts.push((format!("joint.{k}.offset"), &stage.offset, stage.offset.len()));
            parts.push((format!("joint.{k}.down"), &stage.down, stage.offset.len()));
            parts.push((format!("joint.{k}.up"), &stage.up, rank));
            parts.push((format!("joint.{k}.base"), &stage.base, steps));
        }
        for (k, stage) in self.local.iter().enumerate() {
            let row: usize = stage.patches.iter().map(Patch::len).sum();
            parts.push((format!("local.{k}.offset"), &stage.offset, row));
            parts.push((format!("local.{k}.weights"), &stage.weights, row));
            parts.push((format!("local.{k}.base"), &stage.base, steps));
            parts.push((format!("local.{k}.mix"), &stage.mix, steps));
        }
        let stored: Vec<_> = parts.iter().map(|(name, values, row)| (name, quantized(values, *row))).collect();
        let mut views = Vec::new();
        for (name, (numbers, scales)) in &stored {
            let view = |dtype, bytes, size| TensorView::new(dtype, vec![size], bytes).map_err(|e| failed(e.to_string()));
            views.push(((*name).clone(), view(Dtype::I16, numbers.as_slice(), numbers.len() / 2)?));
            views.push((format!("{name}.scale"), view(Dtype::F32, scales.as_slice(), scales.len() / 4)?));
        }
        let metadata = HashMap::from([(KEY.to_owned(), description)]);
        safetensors::serialize(views, Some(metadata)).map_err(|e| failed(e.to_string()))
    }
}

fn parse(bytes: &[u8]) -> Result<(Model, ModelOrigin), String> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let description = metadata.metadata().as_ref().and_then(|m| m.get(KEY)).ok_or("it has no description")?;
    let header: Header = serde_json::from_str(description).map_err(|e| e.to_string())?;
    if header.schema != SCHEMA {
        return Err(format!("schema {}; this program reads {SCHEMA}", header.schema));
    }
    let count = points().len();
    if header.points != count || header.features.iter().any(|&k| k >= count) {
        return Err(format!("{} points; this program knows {count}", header.points));
    }
    let patches = header.joint.iter().chain(header.local.iter().flatten());
    if patches.clone().any(|p| !(4.0..=256.0).contains(&p.size) || p.side > 16 || p.blur > 32 || !(0.0..1.0).contains(&p.cell)) {
        return Err("patches out of range".to_owned());
    }
    if header.joint.len() < 2 || header.local.is_empty() || header.errors.intercepts.len() != count {
        return Err("stages are missing".to_owned());
    }
    let tensors = Tensors { tensors: SafeTensors::deserialize(bytes).map_err(|e| e.to_string())? };
    let steps = 2 * count;
    let length = |patch: &Patch| header.features.len() * patch.len();
    let joint = header.joint.iter().enumerate().map(|(k, patch)| {
        let size = length(patch);
        let name = |part: &str| format!("joint.{k}.{part}");
        let up = tensors.tensors.tensor(&name("up")).map_err(|e| e.to_string())?.data().len() / 2;
        let rank = up / steps;
        Ok(JointStage {
            patch: *patch,
            offset: tensors.read(&name("offset"), size, size)?,
            down: tensors.read(&name("down"), size * rank, size)?,
            up: tensors.read(&name("up"), steps * rank, rank)?,
            base: tensors.read(&name("base"), steps, steps)?,
        })
    });
    let local = header.local.iter().enumerate().map(|(k, patches)| {
        let row: usize = patches.iter().map(Patch::len).sum();
        let name = |part: &str| format!("local.{k}.{part}");
        Ok(LocalStage {
            patches: patches.clone(),
            offset: tensors.read(&name("offset"), count * row, row)?,
            weights: tensors.read(&name("weights"), steps * row, row)?,
            base: tensors.read(&name("base"), steps, steps)?,
            mix: tensors.read(&name("mix"), steps * steps, steps)?,
        })
    });
    let mean = tensors.read("mean", steps, 1)?;
    let last = header.joint.last().map_or(0, length);
    let model = Model {
        mean: mean.chunks_exact(2).map(|p| [p[0], p[1]]).collect(),
        features: header.features.clone(),
        joint: joint.collect::<Result<_, String>>()?,
        local: local.collect::<Result<_, String>>()?,
        template: Template {
            weights: tensors.read("template", template::LENGTH, template::LENGTH)?,
            bias: header.template_bias,
        },
        verifier: (tensors.read("verifier", last, last)?, header.verifier_bias),
        errors: header.errors,
    };
    Ok((model, header.origin))
}
