//! Options of the tracker.

use serde::{Deserialize, Serialize};

use super::{AlignOptions, KltKind, TrackError};

/// Forces with which tracked nodes drive the springs.
///
/// ```
/// use grimace::track::{Forces, TrackOptions};
///
/// // As in the paper: every node is pulled alike.
/// let options = TrackOptions { forces: Forces::Same, ..TrackOptions::default() };
/// assert_ne!(options.forces, Forces::default());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Forces {
    /// By the accuracy of each displacement that KLT reports, in each direction: [`TrackOptions::force`] and [`TrackOptions::mismatch`].
    #[default]
    Measured,
    /// The same gain, [`TrackOptions::force`], at every node and in every direction [KP, section 3].
    Same,
}

/// Options of the tracker, each with its default. Lengths are relative to the eye distance ES0 of the neutral frame, so that they suit
/// small and large faces.
/// 38~ Independent switches.
///
/// ```
/// use grimace::track::TrackOptions;
///
/// // Lengths are shares of the eye distance: 8 px for eyes that are 100 px apart.
/// let options = TrackOptions { levels: 3, ..TrackOptions::default() };
/// assert_eq!((options.window * 100.0, options.levels), (8.0, 3));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[allow(clippy::struct_excessive_bools)] // Switches of parts that work without each other.
pub struct TrackOptions {
    /// Side of the KLT window over the eye distance, 0.08; the result is odd and at least 7.
    pub window: f64,
    /// Pyramid levels, the image itself included; 4.
    pub levels: u32,
    /// Largest forward-backward distance over the eye distance, 0.01; 0 disables the backward search, as in KP.
    pub forward_backward: f64,
    /// A displacement is extreme when it differs from the neighbours' by more than this many robust standard deviations; 6.
    pub extreme: f64,
    /// Gain of the force on a node that was not lost, over the stiffness of a spring, for a window whose gradients are as strong as its
    /// mismatch; 150.
    pub force: f64,
    /// Weight of the squared mismatch of the two windows relative to the gradients, 1; 0 gives every match the same weight.
    pub mismatch: f64,
    /// How forces are computed; measured by default.
    pub forces: Forces,
    /// Search for nodes of the inner lip within their own lip, because KLT finds both lips where they meet. On by default, as are the next
    /// six.
    pub lip_probes: bool,
    /// Move the corners of each iris box as one.
    pub rigid_eyes: bool,
    /// Adjust every frame to the light of the neutral one before the search.
    pub even_light: bool,
    /// Place lids by the look of the eyes when they close.
    pub read_lids: bool,
    /// Move lips towards where the locator reads them when a mouth has moved.
    pub read_lips: bool,
    /// Locate the face in a large step, as between a neutral photograph and one of the apex.
    pub locate_lost: bool,
    /// Deform the wireframe again after each step. Without it lost nodes do not move.
    pub deform: bool,
    /// Alignment with the neutral frame after this deformation.
    pub align: AlignOptions,
    /// Implementation of KLT, by default [`Klt`](super::Klt); whole tracks differ by 0.0001 to 0.0002 px (median).
    #[serde(default)]
    pub klt: KltKind,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            window: 0.08,
            levels: 4,
            forward_backward: 0.01,
            extreme: 6.0,
            force: 150.0,
            mismatch: 1.0,
            forces: Forces::Measured,
            lip_probes: true,
            rigid_eyes: true,
            even_light: true,
            read_lids: true,
            read_lips: true,
            locate_lost: true,
            deform: true,
            align: AlignOptions::default(),
            klt: KltKind::default(),
        }
    }
}

impl TrackOptions {
    /// Checks the numbers.
    ///
    /// # Errors
    /// [`TrackError::Option`] for the first one out of range.
    pub(super) fn check(&self) -> Result<(), TrackError> {
        const FINITE: (f64, &str) = (f64::MAX, "a finite number of at least 0");
        // These two can be switched off by infinity.
        const ANY: (f64, &str) = (f64::INFINITY, "at least 0");
        let AlignOptions { gain, anchor, stiffness, reach, smoothing, corners } = self.align;
        let all = [
            ("window", self.window, FINITE),
            ("forward_backward", self.forward_backward, ANY),
            ("extreme", self.extreme, ANY),
            ("force", self.force, FINITE),
            ("mismatch", self.mismatch, FINITE),
            ("align.gain", gain, FINITE),
            ("align.anchor", anchor, FINITE),
            ("align.stiffness", stiffness, FINITE),
            ("align.reach", reach, FINITE),
            ("align.smoothing", smoothing, (MOST_SMOOTHING_PX, "0 to 20 px")),
            ("align.corners", corners, FINITE),
        ];
        match all.into_iter().find(|(_, value, (most, _))| !(*value >= 0.0 && value <= most)) {
            Some((name, value, (_, allowed))) => Err(TrackError::Option { name, value, allowed }),
            None => Ok(()),
        }
    }

    /// Whether anything is read by the locator in later frames.
    pub(crate) fn locates(&self) -> bool {
        self.locate_lost || self.read_lips
    }
}

/// Smallest KLT window, px.
pub const MIN_WINDOW_PX: u32 = 7;

/// Largest smoothing of the frames for the alignment, px: beyond it a face has no texture left, and smoothing takes long.
const MOST_SMOOTHING_PX: f64 = 20.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_out_of_range_are_named() {
        let (base, align) = (TrackOptions::default(), AlignOptions::default());
        assert!(base.check().is_ok());
        assert!(TrackOptions { extreme: f64::INFINITY, forward_backward: f64::INFINITY, ..base }.check().is_ok());
        let of_align = |align: AlignOptions| TrackOptions { align, ..base };
        for (options, message) in [
            (
                TrackOptions { window: f64::NAN, ..base },
                "`window` of the tracker is NaN; it must be a finite number of at least 0",
            ),
            (TrackOptions { extreme: f64::NAN, ..base }, "`extreme` of the tracker is NaN; it must be at least 0"),
            (TrackOptions { force: -1.0, ..base }, "`force` of the tracker is -1; it must be a finite number of at least 0"),
            (TrackOptions { mismatch: f64::INFINITY, ..base }, "`mismatch` of the tracker is inf"),
            (
                of_align(AlignOptions { smoothing: 1000.0, ..align }),
                "`align.smoothing` of the tracker is 1000; it must be 0 to 20 px",
            ),
            (of_align(AlignOptions { reach: f64::NAN, ..align }), "`align.reach` of the tracker is NaN"),
        ] {
            let found = options.check().unwrap_err().to_string();
            assert!(found.contains(message), "{found}");
        }
    }
}
