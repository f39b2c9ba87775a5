//! Facial animation parameter units (FAPUs) of a neutral wireframe (MPEG-4 Visual, Annex C).

use std::{fmt, str::FromStr};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::units::NodeId;

/// A facial animation parameter unit.
///
/// ```
/// use grimace::wireframe::Fapu;
///
/// assert_eq!(Fapu::LENGTHS.map(|fapu| fapu.to_string()), ["IRISD", "ES", "ENS", "MNS", "MW"]);
/// assert_eq!("MW".parse(), Ok(Fapu::Mw));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub enum Fapu {
    /// Iris diameter, IRISD0.
    Irisd,
    /// Eye separation, ES0.
    Es,
    /// Eye-nose separation, ENS0.
    Ens,
    /// Mouth-nose separation, MNS0.
    Mns,
    /// Mouth width, MW0.
    Mw,
    /// Angular unit, 1e-5 rad.
    Au,
}

impl Fapu {
    /// The five lengths, in the order of the standard.
    pub const LENGTHS: [Self; 5] = [Self::Irisd, Self::Es, Self::Ens, Self::Mns, Self::Mw];
}

impl Fapu {
    /// Description of the unit, with the nodes between which it is measured.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Irisd => "the opening of the lids",
            Self::Es => "the distance of the pupils, left minus right",
            Self::Ens => "the height of the eyes above the base of the nose (node 6)",
            Self::Mns => "the height of the base of the nose (node 6) above the upper lip (node 87)",
            Self::Mw => "the width of the mouth, left corner (node 31) minus right corner (node 64)",
            Self::Au => "an angle",
        }
    }
}

impl fmt::Display for Fapu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Irisd => "IRISD",
            Self::Es => "ES",
            Self::Ens => "ENS",
            Self::Mns => "MNS",
            Self::Mw => "MW",
            Self::Au => "AU",
        })
    }
}

impl FromStr for Fapu {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let all = [Self::Irisd, Self::Es, Self::Ens, Self::Mns, Self::Mw, Self::Au];
        all.into_iter().find(|u| u.to_string() == text).ok_or_else(|| format!("`{text}` is not a FAPU"))
    }
}

/// A coordinate axis of face space.
///
/// ```
/// use grimace::wireframe::{Axis, Fapu, Tables};
///
/// let tables = Tables::candide3();
/// let eyes = tables.fapus.iter().find(|definition| definition.fapu == Fapu::Es).expect("ES0");
/// assert_eq!(eyes.axis, Axis::X);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// To the subject's left.
    X,
    /// Up.
    Y,
    /// Out of the face.
    Z,
}

/// Definition of a FAPU length: the mean coordinate of some nodes minus the mean of others, along an axis of face space.
///
/// The mouth is measured from its right corner (node 64) to its left one (node 31).
/// ```
/// use grimace::{units::NodeId, wireframe::{Fapu, Tables}};
///
/// let tables = Tables::candide3();
/// let mouth = tables.fapus.iter().find(|definition| definition.fapu == Fapu::Mw).expect("MW0");
/// assert_eq!((&mouth.plus_nodes[..], &mouth.minus_nodes[..]), (&[NodeId(31)][..], &[NodeId(64)][..]));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FapuDefinition {
    /// The FAPU.
    pub fapu: Fapu,
    /// x or y.
    pub axis: Axis,
    /// Nodes whose mean coordinate is added.
    pub plus_nodes: Vec<NodeId>,
    /// Nodes whose mean coordinate is subtracted.
    pub minus_nodes: Vec<NodeId>,
}

/// The five FAPU lengths of a neutral face, in the unit of the measured points.
///
/// ```
/// use grimace::wireframe::{Face, Fapu, Fapus};
///
/// let face = Face::candide3();
/// let fapus = Fapus::measure(&face.tables.fapus, &face.wireframe.frontal())?;
/// // Twice as large, the face measures twice as much.
/// assert_eq!(fapus.scaled(2.0).es, 2.0 * fapus.es);
/// assert_eq!((fapus.length(Fapu::Es), fapus.length(Fapu::Au)), (Some(fapus.es), None));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fapus {
    /// Iris diameter (lid opening).
    pub irisd: f64,
    /// Eye separation.
    pub es: f64,
    /// Eye-nose separation.
    pub ens: f64,
    /// Mouth-nose separation.
    pub mns: f64,
    /// Mouth width.
    pub mw: f64,
}

/// Error for FAPUs that cannot be measured.
///
/// ```
/// use grimace::wireframe::{Face, Fapus, FapusError};
/// use nalgebra::Point2;
///
/// let face = Face::candide3();
/// let all_in_one_place = vec![Point2::origin(); face.wireframe.node_count()];
/// let error = Fapus::measure(&face.tables.fapus, &all_in_one_place).unwrap_err();
/// assert!(matches!(error, FapusError::NotPositive { value: 0.0, .. }));
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FapusError {
    /// A length that is zero, negative or not a number: the neutral wireframe is folded there.
    #[error("{fapu}0 of the neutral face, {}, is {value:.3}; it must be positive: check the marks around it", fapu.meaning())]
    NotPositive {
        /// The FAPU.
        fapu: Fapu,
        /// The measured value.
        value: f64,
    },
    /// The wireframe lacks a node that a FAPU is measured on.
    #[error("{fapu}0 is measured at node {node}, which the wireframe does not have")]
    NoSuchNode {
        /// The FAPU.
        fapu: Fapu,
        /// The node.
        node: NodeId,
    },
}

impl Fapus {
    /// Measures the five lengths on an upright frontal neutral face; `positions` are in face axes (y up), in any unit.
    ///
    /// IRISD0 is measured at the lids, as MPEG-4 defines it (IRISD0 = 3.1.y - 3.3.y = 3.2.y - 3.4.y, here the mean of both eyes).
    /// It is scaled so that on Candide-3 it equals the height of the iris boxes, and limited to 0.8 to 3 times the height of the
    /// face's own boxes.
    ///
    /// # Errors
    /// [`FapusError`] when a length is not positive or a node is missing.
    pub fn measure(definitions: &[FapuDefinition], positions: &[Point2<f64>]) -> Result<Self, FapusError> {
        let of_nodes = Self::of_nodes(definitions, positions)?;
        Ok(Self { irisd: lid_based(of_nodes.irisd, positions), ..of_nodes })
    }

    /// Measures every length between the nodes of its definition. Unlike in [`Fapus::measure`], IRISD0 is the height of the iris
    /// boxes (Candide-3's report, Table 2).
    ///
    /// # Errors
    /// Same as [`Fapus::measure`].
    pub fn of_nodes(definitions: &[FapuDefinition], positions: &[Point2<f64>]) -> Result<Self, FapusError> {
        let mut lengths = [f64::NAN; 5];
        for definition in definitions {
            let fapu = definition.fapu;
            let mean = |nodes: &[NodeId]| -> Result<f64, FapusError> {
                let mut sum = 0.0;
                for &node in nodes {
                    let point = positions.get(node.index()).ok_or(FapusError::NoSuchNode { fapu, node })?;
                    sum += if definition.axis == Axis::X { point.x } else { point.y };
                }
                Ok(sum / nodes.len() as f64)
            };
            if let Some(slot) = Fapu::LENGTHS.iter().position(|&u| u == fapu) {
                lengths[slot] = mean(&definition.plus_nodes)? - mean(&definition.minus_nodes)?;
            }
        }
        for (fapu, value) in Fapu::LENGTHS.into_iter().zip(lengths) {
            if !(value > 0.0 && value.is_finite()) {
                return Err(FapusError::NotPositive { fapu, value });
            }
        }
        let [irisd, es, ens, mns, mw] = lengths;
        Ok(Self { irisd, es, ens, mns, mw })
    }

    /// Length of one FAPU; `None` for the angular unit, which is no length.
    pub fn length(&self, fapu: Fapu) -> Option<f64> {
        match fapu {
            Fapu::Irisd => Some(self.irisd),
            Fapu::Es => Some(self.es),
            Fapu::Ens => Some(self.ens),
            Fapu::Mns => Some(self.mns),
            Fapu::Mw => Some(self.mw),
            Fapu::Au => None,
        }
    }

    /// Returns all lengths times `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        let Self { irisd, es, ens, mns, mw } = *self;
        Self { irisd: irisd * factor, es: es * factor, ens: ens * factor, mns: mns * factor, mw: mw * factor }
    }
}

/// IRISD0 of a neutral face with this height of the iris boxes: the opening of its lids, scaled so that Candide-3's equals the
/// height of its boxes. If the wireframe has no lids, it is the height of the boxes.
fn lid_based(boxes: f64, positions: &[Point2<f64>]) -> f64 {
    let [Some(left), Some(right)] = openings(positions) else { return boxes };
    let seen = BOX_OVER_OPENING * f64::midpoint(left, right);
    if seen.is_finite() { seen.clamp(LEAST_OPENING * boxes, LID_LIMIT * boxes) } else { boxes }
}

/// Opening of the lids of each eye on an upright face, y up; `None` if the wireframe lacks them.
fn openings(positions: &[Point2<f64>]) -> [Option<f64>; 2] {
    LID_MIDDLES.map(|(above, below)| Some(positions.get(above)?.y - positions.get(below)?.y))
}

/// Ratio of the height of Candide-3's iris boxes to the opening of its lids: 0.085 to 0.082.
const BOX_OVER_OPENING: f64 = 0.085 / 0.082;
/// Smallest ratio of IRISD0 to the height of the iris boxes; below it, lids were measured wrongly or are closed. The ratio is 1
/// on Candide-3's face and 1.4 to 2.0 on real people.
const LEAST_OPENING: f64 = 0.8;

/// Nodes at the middles of the upper and lower lids: MPEG-4's feature points 3.1 and 3.3 of the left eye, 3.2 and 3.4 of the
/// right eye.
const LID_MIDDLES: [(usize, usize); 2] = [(21, 22), (54, 55)];
/// Largest factor by which the opening of the lids may differ from IRISD0 or from the height of the iris boxes; beyond it, lids
/// were measured wrongly.
pub(crate) const LID_LIMIT: f64 = 3.0;

/// Unit of the lid FAPs (19 to 22) of each eye: the opening of the lids of the neutral face, 3.1.y - 3.3.y and 3.2.y - 3.4.y
/// \[MPEG-4\]. A lid that moves by 1024 closes the eye.
///
/// [`Fapus::irisd`], which normalizes models, is one length for both eyes. This type stores that length divided by the opening of
/// each eye; multiplying a value in IRISD0 by it gives a value in openings.
///
/// It also stores how that length compares with the opening of the lids, so that eyeballs that look up or down by one angle (FAPs 25 and
/// 26) have one value, whichever of the two lengths normalized the model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidUnits {
    lids: [f64; 2],
    gaze: f64,
}

impl LidUnits {
    /// Units for face units: one IRISD0 of the canonical neutral is one opening, whatever was measured.
    pub const CANONICAL: Self = Self { lids: [1.0, 1.0], gaze: 1.0 };

    /// Units of a face from its FAPUs and the openings of its left and right eye.
    pub fn new(fapus: &Fapus, openings: [f64; 2]) -> Self {
        let unit = |opening: f64| if opening > 0.0 { (fapus.irisd / opening).clamp(1.0 / LID_LIMIT, LID_LIMIT) } else { 1.0 };
        Self { lids: openings.map(unit), gaze: 1.0 }
    }

    /// Measures the units on an upright neutral face, y up.
    pub fn measure(fapus: &Fapus, upright: &[Point2<f64>]) -> Self {
        Self::new(fapus, openings(upright).map(|opening| opening.unwrap_or(0.0)))
    }

    /// The same for models normalized by `used` instead of `lids`, the IRISD0 of the same face measured on its lids.
    pub fn with_irisd(self, used: f64, lids: f64) -> Self {
        Self { gaze: if lids > 0.0 { used / lids } else { 1.0 }, ..self }
    }

    /// Factor for the vertical shift of an iris in a model that was normalized by IRISD0, for the angle of the eyeball.
    pub fn gaze(self) -> f64 {
        self.gaze
    }

    /// Factor for a value of this FAP in IRISD0; 1 for a FAP that is not of the lids.
    pub fn of_fap(self, fap: u8) -> f64 {
        match fap {
            19 | 21 => self.lids[0],
            20 | 22 => self.lids[1],
            _ => 1.0,
        }
    }

    /// Factor for the motion of a node in IRISD0; 1 for a node that is not the middle of a lid.
    pub fn of_node(self, node: NodeId) -> f64 {
        let eye = LID_MIDDLES.iter().position(|&(above, below)| node.index() == above || node.index() == below);
        eye.map_or(1.0, |eye| self.lids[eye])
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;
    use crate::wireframe::{Tables, Wireframe};

    #[test]
    fn candide3_has_the_lengths_of_the_report() {
        let fapus = Fapus::measure(&Tables::candide3().fapus, &Wireframe::candide3().frontal()).unwrap();
        // LiTH-ISY-R-2326, Table 2, on the undeformed mesh.
        assert_relative_eq!(fapus.irisd, 0.085, epsilon = 1e-12);
        assert_relative_eq!(fapus.es, 0.613, epsilon = 1e-12);
        assert_relative_eq!(fapus.ens, 0.4225, epsilon = 1e-12);
        assert_relative_eq!(fapus.mns, 0.196, epsilon = 1e-12);
        assert_relative_eq!(fapus.mw, 0.492, epsilon = 1e-12);
    }

    #[test]
    fn one_irisd_of_the_lids_is_the_opening_of_their_eye() {
        let mut face = Wireframe::candide3().frontal();
        // Lids opened wider than the boxes: 0.1 on the left, 0.17 on the right.
        (face[21].y, face[22].y) = (0.22, 0.12);
        (face[54].y, face[55].y) = (0.28, 0.11);
        let fapus = Fapus::measure(&Tables::candide3().fapus, &face).unwrap();
        let units = LidUnits::measure(&fapus, &face);
        // A lid that moves down by the opening measures this many IRISD0.
        assert_relative_eq!(units.of_fap(19) * 0.1 / fapus.irisd, 1.0, epsilon = 1e-12);
        assert_relative_eq!(units.of_node(NodeId(55)) * 0.17 / fapus.irisd, 1.0, epsilon = 1e-12);
        // IRISD0 itself is the mean opening times the ratio of Candide-3's box height to its lid opening.
        assert_relative_eq!(fapus.irisd, 0.135 * 0.085 / 0.082, epsilon = 1e-12);
        assert_relative_eq!(Fapus::of_nodes(&Tables::candide3().fapus, &face).unwrap().irisd, 0.085, epsilon = 1e-12);
        assert_eq!((units.of_fap(31), units.of_node(NodeId(31))), (1.0, 1.0));
        // An iris that rises by a tenth of the lids' IRISD0 has one angle, also in a model normalized by iris boxes of 0.085.
        let boxes = units.with_irisd(0.085, fapus.irisd);
        assert_relative_eq!(0.1 * fapus.irisd / 0.085 * boxes.gaze(), 0.1, epsilon = 1e-12);
        assert_eq!((units.gaze(), boxes.of_fap(19)), (1.0, units.of_fap(19)));
        // A closed neutral eye has no opening to measure in.
        assert_eq!(LidUnits::new(&fapus, [0.0, -1.0]), LidUnits::CANONICAL);
    }

    #[test]
    fn lids_that_are_shut_or_far_apart_do_not_make_irisd_small_or_large() {
        let of = |above: f64, below: f64| {
            let mut face = Wireframe::candide3().frontal();
            (face[21].y, face[22].y, face[54].y, face[55].y) = (above, below, above, below);
            Fapus::measure(&Tables::candide3().fapus, &face).unwrap().irisd
        };
        assert_relative_eq!(of(0.2, 0.2), 0.8 * 0.085, epsilon = 1e-12);
        assert_relative_eq!(of(0.2, 0.21), 0.8 * 0.085, epsilon = 1e-12);
        assert_relative_eq!(of(0.9, 0.1), 3.0 * 0.085, epsilon = 1e-12);
        assert_relative_eq!(of(f64::NAN, 0.1), 0.085, epsilon = 1e-12);
    }

    #[test]
    fn a_folded_face_is_refused_by_name() {
        let mirrored: Vec<_> = Wireframe::candide3().frontal().iter().map(|p| Point2::new(-p.x, p.y)).collect();
        let error = Fapus::measure(&Tables::candide3().fapus, &mirrored).unwrap_err();
        assert!(
            error.to_string().starts_with("ES0 of the neutral face, the distance of the pupils, left minus right, is -0.613"),
            "{error}"
        );
    }
}
