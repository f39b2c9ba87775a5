//! Prior files: JSON with the mean, the modes, and their origin.

use std::{
    io,
    path::{Path, PathBuf},
};

use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::ShapePrior;
use crate::output::{OutputError, write_atomic};

/// Version of the schema of a prior file.
pub const PRIOR_SCHEMA: u32 = 1;

/// Rounding of a length in a prior file: 1e-5 model units are 0.002 % of the eye distance.
const DECIMALS: f64 = 1e5;

/// The unit of every length in the file.
const UNITS: &str = "Candide-3 model unit in face space: x to the subject's left, y up, eye distance about 0.6";

/// The priors embedded in the program.
const EMBEDDED: [&str; 2] =
    [include_str!("../../../candide/face_prior.json"), include_str!("../../../candide/face_prior_by_hand.json")];

/// One file or dataset of the training data of a prior.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FaceSource {
    /// Name of the file or folder.
    pub name: String,
    /// Number of faces taken from it.
    pub faces: usize,
    /// BLAKE3 of the faces' names and landmarks.
    pub blake3: String,
}

/// Origin of a prior.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PriorOrigin {
    /// Program name and version.
    pub made_by: String,
    /// The command, with file names instead of paths.
    pub command: String,
    /// Number of faces.
    pub faces: usize,
    /// Files or datasets of the training data.
    pub sources: Vec<FaceSource>,
    /// Credit and licence of the faces; empty if unknown.
    pub credit: String,
}

/// The content of a prior file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PriorFile {
    /// Always 1.
    pub schema_version: u32,
    /// Unit and axes of every length.
    pub units: String,
    /// Origin of the prior.
    #[serde(flatten)]
    pub origin: PriorOrigin,
    /// Standard deviation of a mark, in x and in y.
    pub mark_deviation: f64,
    /// Mean position of every node, in node order.
    pub mean: Vec<[f64; 2]>,
    /// Standard deviation in x and in y of the residual that the modes leave, by node.
    pub residuals: Vec<f64>,
    /// Offset of every node at one standard deviation of each mode, the strongest mode first.
    pub modes: Vec<Vec<[f64; 2]>>,
}

/// A prior file that does not read.
///
/// ```
/// use grimace::fit::{PriorFileError, read_prior};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("prior.json");
/// std::fs::write(&path, "{}")?;
/// assert!(matches!(read_prior(&path), Err(PriorFileError::Json { .. })));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum PriorFileError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The file is not the JSON of a prior.
    #[error("{}: {source}; a prior file as written by `grimace prior` was expected", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Why, with the line.
        source: serde_json::Error,
    },
    /// The file has another version.
    #[error("{}: schema version {found}; this program reads {PRIOR_SCHEMA}", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: u32,
    },
    /// The content is not a valid prior.
    #[error("{}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

impl PriorFile {
    /// Creates the file of a prior. Lengths are rounded to 5 decimals, every mode is scaled to one standard deviation.
    pub fn new(prior: &ShapePrior, origin: PriorOrigin) -> Self {
        let round = |v: f64| {
            let rounded = (v * DECIMALS).round() / DECIMALS;
            // Avoids -0 in the file.
            if rounded == 0.0 { 0.0 } else { rounded }
        };
        let modes = prior.modes.iter().zip(&prior.deviations);
        Self {
            schema_version: PRIOR_SCHEMA,
            units: UNITS.to_owned(),
            origin,
            mark_deviation: prior.mark_deviation,
            mean: prior.mean.iter().map(|p| [round(p.x), round(p.y)]).collect(),
            residuals: prior.residuals.iter().map(|&r| round(r)).collect(),
            modes: modes.map(|(m, d)| m.iter().map(|v| [round(v.x * d), round(v.y * d)]).collect()).collect(),
        }
    }

    /// Returns the prior of a file.
    ///
    /// # Errors
    /// A message, if lists differ in length, or numbers are not finite or negative where they must not be.
    pub fn prior(&self) -> Result<ShapePrior, String> {
        let count = self.mean.len();
        if count == 0 {
            return Err("the mean has no nodes".to_owned());
        }
        if self.residuals.len() != count {
            return Err(format!("it has {} residuals, but the mean has {count} nodes", self.residuals.len()));
        }
        if let Some((j, mode)) = self.modes.iter().enumerate().find(|(_, m)| m.len() != count) {
            return Err(format!("mode {j} has {} nodes, but the mean has {count}", mode.len()));
        }
        let is_finite = |p: &[f64; 2]| p.iter().all(|v| v.is_finite());
        if !self.mean.iter().chain(self.modes.iter().flatten()).all(is_finite) {
            return Err("a coordinate is not a finite number".to_owned());
        }
        if let Some(k) = self.residuals.iter().position(|r| !(*r >= 0.0 && r.is_finite())) {
            return Err(format!("the residual of node {k} is {}; a number of at least 0 was expected", self.residuals[k]));
        }
        if !(self.mark_deviation > 0.0 && self.mark_deviation.is_finite()) {
            return Err(format!("mark_deviation is {}; a number greater than 0 was expected", self.mark_deviation));
        }
        Ok(ShapePrior {
            mean: self.mean.iter().map(|&[x, y]| Point2::new(x, y)).collect(),
            modes: self.modes.iter().map(|m| m.iter().map(|&[x, y]| Vector2::new(x, y)).collect()).collect(),
            deviations: vec![1.0; self.modes.len()],
            residuals: self.residuals.clone(),
            mark_deviation: self.mark_deviation,
        })
    }
}

/// The only field that all versions of the schema share.
#[derive(Deserialize)]
struct Version {
    schema_version: u32,
}

/// Reads a prior file. Returns the prior and the BLAKE3 of the file, in hexadecimal.
///
/// ```
/// use grimace::fit::read_prior;
///
/// let (prior, blake3) = read_prior("candide/face_prior.json".as_ref())?;
/// assert_eq!((prior.mean.len(), blake3.len()), (113, 64));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`PriorFileError`].
pub fn read_prior(path: &Path) -> Result<(ShapePrior, String), PriorFileError> {
    let at = || path.to_owned();
    let bytes = crate::input::read(path).map_err(|source| PriorFileError::Io { path: at(), source })?;
    // The version first: later schemas may lack the fields of this one.
    let Version { schema_version } =
        serde_json::from_slice(&bytes).map_err(|source| PriorFileError::Json { path: at(), source })?;
    if schema_version != PRIOR_SCHEMA {
        return Err(PriorFileError::Version { path: at(), found: schema_version });
    }
    let file: PriorFile = serde_json::from_slice(&bytes).map_err(|source| PriorFileError::Json { path: at(), source })?;
    let prior = file.prior().map_err(|reason| PriorFileError::Content { path: at(), reason })?;
    Ok((prior, blake3::hash(&bytes).to_hex().to_string()))
}

/// Writes a prior file: JSON with one line per list of coordinates.
///
/// # Errors
/// [`OutputError`] when the file cannot be written.
pub fn write_prior(path: &Path, file: &PriorFile) -> Result<(), OutputError> {
    write_atomic(path, |writer| {
        let json = |value: serde_json::Result<String>| value.map_err(io::Error::from);
        let origin = &file.origin;
        writeln!(writer, "{{\n  \"schema_version\": {},", file.schema_version)?;
        writeln!(writer, "  \"units\": {},", json(serde_json::to_string(&file.units))?)?;
        writeln!(writer, "  \"made_by\": {},", json(serde_json::to_string(&origin.made_by))?)?;
        writeln!(writer, "  \"command\": {},", json(serde_json::to_string(&origin.command))?)?;
        writeln!(writer, "  \"faces\": {},", origin.faces)?;
        writeln!(writer, "  \"sources\": {},", json(serde_json::to_string(&origin.sources))?)?;
        writeln!(writer, "  \"credit\": {},", json(serde_json::to_string(&origin.credit))?)?;
        writeln!(writer, "  \"mark_deviation\": {},", json(serde_json::to_string(&file.mark_deviation))?)?;
        writeln!(writer, "  \"mean\": {},", json(serde_json::to_string(&file.mean))?)?;
        writeln!(writer, "  \"residuals\": {},", json(serde_json::to_string(&file.residuals))?)?;
        writeln!(writer, "  \"modes\": [")?;
        for (j, mode) in file.modes.iter().enumerate() {
            let comma = if j + 1 < file.modes.len() { "," } else { "" };
            writeln!(writer, "    {}{comma}", json(serde_json::to_string(mode))?)?;
        }
        writeln!(writer, "  ]\n}}")
    })
}

/// Returns the priors embedded in the program.
pub(super) fn embedded() -> [ShapePrior; 2] {
    EMBEDDED.map(|text| {
        let file: PriorFile = serde_json::from_str(text).unwrap_or_else(|error| unreachable!("embedded prior: {error}"));
        file.prior().unwrap_or_else(|reason| unreachable!("embedded prior: {reason}"))
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn small() -> PriorFile {
        let prior = ShapePrior {
            mean: vec![Point2::new(0.123456, -0.0000001), Point2::new(1.0, 2.0)],
            modes: vec![vec![Vector2::new(0.5, 0.0), Vector2::zeros()]],
            deviations: vec![0.1],
            residuals: vec![0.0, 0.01],
            mark_deviation: 0.01,
        };
        let origin = PriorOrigin {
            made_by: "grimace".to_owned(),
            command: "grimace prior \"a b.csv\"".to_owned(),
            faces: 10,
            sources: vec![FaceSource { name: "a b.csv".to_owned(), faces: 10, blake3: "00".to_owned() }],
            credit: String::new(),
        };
        PriorFile::new(&prior, origin)
    }

    #[test]
    fn written_files_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("prior.json");
        let file = small();
        // 0.123456 rounds to 0.12346; the mode at one standard deviation is 0.5 * 0.1.
        assert_eq!(file.mean[0], [0.12346, 0.0]);
        assert_eq!(file.modes[0][0], [0.05, 0.0]);
        write_prior(&path, &file).unwrap();
        assert_eq!(serde_json::from_slice::<PriorFile>(&fs::read(&path).unwrap()).unwrap(), file);
        assert_eq!(read_prior(&path).unwrap().0, file.prior().unwrap());
    }

    #[test]
    fn bad_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("prior.json");
        let error = |text: &str| {
            fs::write(&path, text).unwrap();
            read_prior(&path).unwrap_err().to_string()
        };
        assert!(error("{").contains("as written by `grimace prior` was expected"));
        assert!(error("{\"schema_version\": 7}").ends_with("schema version 7; this program reads 1"));
        let with = |change: fn(&mut PriorFile)| {
            let mut file = small();
            change(&mut file);
            serde_json::to_string(&file).unwrap()
        };
        assert!(error(&with(|f| f.modes[0].truncate(1))).ends_with("mode 0 has 1 nodes, but the mean has 2"));
        assert!(error(&with(|f| f.residuals[1] = -1.0)).contains("the residual of node 1 is -1"));
        assert!(error(&with(|f| f.mark_deviation = 0.0)).contains("mark_deviation is 0"));
        assert!(error(&with(|f| f.mean.clear())).ends_with("the mean has no nodes"));
        assert!(read_prior(&folder.path().join("none.json")).unwrap_err().to_string().contains("cannot be read"));
    }

    #[test]
    fn the_shipped_priors_name_their_credit_and_how_they_were_made() {
        for text in EMBEDDED {
            let file: PriorFile = serde_json::from_str(text).unwrap();
            assert!(file.origin.credit.contains("DeBruine") && file.origin.credit.contains("CC BY 4.0"));
            assert!(file.origin.command.starts_with("grimace prior "));
            assert_eq!(file.origin.faces, file.origin.sources.iter().map(|s| s.faces).sum::<usize>());
        }
    }
}
