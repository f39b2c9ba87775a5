//! Options of a fit.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{FIT_FORCE, PriorFileError, ShapePrior, read_prior};

/// Shape prior that is applied before the springs.
///
/// ```
/// use grimace::fit::{FitOptions, PriorKind};
///
/// assert_eq!(FitOptions::default().prior, PriorKind::Auto);
/// assert_eq!(serde_json::to_string(&PriorKind::Candide)?, "\"candide\"");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PriorKind {
    /// None: similarity and springs only, as in KP.
    None,
    /// Candide's neutral and shape units.
    Candide,
    /// Real faces: priors learned from 90 people ([`ShapePrior::faces`]).
    Faces,
    /// Both, weighted by the probability of the marks. Only Candide for a wireframe with another number of nodes than Candide-3.
    #[default]
    Auto,
    /// A prior file.
    File(LoadedPrior),
}

/// A prior read from a file. It is identified by the hash of the file, and only the hash is compared and written.
///
/// ```
/// use grimace::fit::{FitOptions, LoadedPrior, PriorKind};
///
/// let loaded = LoadedPrior::read("candide/face_prior.json".as_ref())?;
/// assert!(loaded.prior.is_some());
/// let options = FitOptions { prior: PriorKind::File(loaded), ..FitOptions::default() };
/// assert_ne!(options, FitOptions::default());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LoadedPrior {
    /// BLAKE3 of the file, in hexadecimal.
    pub blake3: String,
    /// The prior; `None` in options that were read back from a provenance file.
    #[serde(skip)]
    pub prior: Option<Arc<ShapePrior>>,
}

impl LoadedPrior {
    /// Reads a prior file.
    ///
    /// # Errors
    /// As [`read_prior`].
    pub fn read(path: &std::path::Path) -> Result<Self, PriorFileError> {
        let (prior, blake3) = read_prior(path)?;
        Ok(Self { blake3, prior: Some(Arc::new(prior)) })
    }
}

impl PartialEq for LoadedPrior {
    fn eq(&self, other: &Self) -> bool {
        self.blake3 == other.blake3
    }
}

/// Options of a fit.
///
/// ```
/// use grimace::fit::{FitOptions, PriorKind};
///
/// // As in the paper: a similarity and springs, no prior knowledge of faces.
/// let options = FitOptions { prior: PriorKind::None, ..FitOptions::default() };
/// assert_eq!(options.force, 20.0);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// Gain of the force on a marked node over the stiffness of a spring, > 0; 20.
    pub force: f64,
    /// Shape prior; by default both embedded ones, weighted by the probability of the marks.
    pub prior: PriorKind,
    /// Let nodes without a mark also follow points read in the picture, if there is one and the hand-set marks agree with its face.
    #[serde(default = "yes")]
    pub read_unmarked: bool,
}

/// Default of [`FitOptions::read_unmarked`] in files from before the option existed.
fn yes() -> bool {
    true
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { force: FIT_FORCE, prior: PriorKind::default(), read_unmarked: true }
    }
}
