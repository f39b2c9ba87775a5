//! Converts motion from Candide-3's face to the face of a bank.
//!
//! All motion except feature points from a CSV file is a frontal view: two-dimensional, in units of Candide-3's face. Each offset
//! is scaled to the bank's face along x and y by the ratio of the FAPUs of its facial region, as in the normalization of models.
//! The FAPUs of the bank and of Candide-3 are measured on the same feature points.

use std::path::Path;

use nalgebra::Vector2;

use super::{Motion, MotionKind};
use crate::{
    model::DynamicExpressionModel,
    normalize::Canonical,
    plausible::{FaceSize, Implausible},
    synthesis::{Bank, FpMotion, SynthesisError},
    units::{FaceUnit, FeaturePoint, NodeId},
    wireframe::{Face, Fapu, LidUnits},
};

/// Returns the conversion of an implausible motion into an error that names the file.
pub(super) fn implausible(path: &Path) -> impl Fn(Implausible) -> SynthesisError {
    move |source| SynthesisError::Implausible { path: path.to_owned(), source }
}

/// Size of a bank's face: its eye separation, or the diagonal of its mesh if it has no eyes.
pub(super) fn face_size(bank: &Bank) -> FaceSize {
    let at = |fp: FeaturePoint| bank.feature_point_position(fp).map(|[x, y, _]| Vector2::new(f64::from(x), f64::from(y)));
    let eye_separation = length(Fapu::Es, &at).filter(|es| *es > 0.0).unwrap_or_else(|| bank.mesh().diagonal());
    FaceSize { eye_separation, unit: "of the bank's units" }
}

/// The bank's face with Candide-3's face for comparison.
pub(super) struct BankFace<'b> {
    bank: &'b Bank,
    pub candide: Face,
    pub canonical: Canonical,
    /// Bank units per face unit for each FAPU.
    pub scale: [f64; 5],
}

impl<'b> BankFace<'b> {
    pub fn new(bank: &'b Bank, scale: Option<f64>) -> Result<Self, SynthesisError> {
        let candide = Face::candide3();
        let canonical = Canonical::new(&candide.wireframe, &candide.tables)?;
        let scale = match scale {
            Some(scale) if scale > 0.0 && scale.is_finite() => [scale; 5],
            Some(scale) => {
                let found = scale.to_string();
                return Err(SynthesisError::Option { what: "the scale", found, expected: "a number greater than 0" });
            }
            None => {
                let of_bank =
                    |fp: FeaturePoint| bank.feature_point_position(fp).map(|[x, y, _]| Vector2::new(f64::from(x), f64::from(y)));
                let of_candide = |fp: FeaturePoint| {
                    let node = candide.tables.feature_point_nodes(fp)?.first()?;
                    canonical.neutral.node(*node).map(|p| p.coords)
                };
                scale_of(&of_bank, &of_candide)?
            }
        };
        Ok(Self { bank, candide, canonical, scale })
    }

    pub fn motion(
        &self,
        kind: MotionKind,
        (model, lids): (&DynamicExpressionModel<FaceUnit>, LidUnits),
        fps: Option<f64>,
        path: &Path,
    ) -> Result<Motion, SynthesisError> {
        let (found, expected) = (model.node_count(), self.candide.wireframe.node_count());
        if found != expected {
            let reason = format!("{found} nodes; Candide-3 has {expected}");
            return Err(SynthesisError::Motion { path: path.to_owned(), reason });
        }
        FaceSize::CANONICAL.check_model(model).map_err(implausible(path))?;
        let frames = (0..model.frame_count())
            .map(|m| {
                let offsets = model.neutral_offsets(m);
                self.frame(|node| offsets.get(node.index()).map(|o| Vector2::new(o.x, o.y * lids.of_node(node))))
            })
            .collect();
        Ok(Motion { kind, frames, fps, ignored: Vec::new(), not_shown: Vec::new(), scale: Some(self.scale), uneven: None })
    }

    /// Whether a feature point of the bank corresponds to a node.
    pub fn has(&self, node: NodeId) -> bool {
        let mut nodes = self.bank.feature_points().iter().filter_map(|p| self.candide.tables.feature_point_nodes(p.fp));
        nodes.any(|nodes| nodes.contains(&node))
    }

    /// Returns the motion of the bank's feature points from node offsets in face units.
    pub fn frame(&self, offset: impl Fn(NodeId) -> Option<Vector2<f64>>) -> FpMotion {
        let ratio = |fapu: Fapu| Fapu::LENGTHS.iter().position(|&u| u == fapu).map_or(self.scale[1], |k| self.scale[k]);
        let of_point = |fp: FeaturePoint| {
            let nodes = self.candide.tables.feature_point_nodes(fp)?;
            let known: Vec<Vector2<f64>> = nodes
                .iter()
                .filter_map(|&node| {
                    let (x, y) = self.candide.tables.node_fapus(node);
                    offset(node).map(|o| Vector2::new(o.x * ratio(x), o.y * ratio(y)))
                })
                .collect();
            let sum: Vector2<f64> = known.iter().sum();
            (!known.is_empty()).then(|| (sum / known.len() as f64).push(0.0))
        };
        FpMotion {
            offsets: self.bank.feature_points().iter().map(|p| of_point(p.fp)).collect(),
            planar: true,
            ..FpMotion::default()
        }
    }
}

/// Ratios of the bank's lengths to those of the canonical Candide-3 for the five FAPUs. If a length is missing in either, the
/// ratio of the eye separation is used.
fn scale_of(
    bank: &dyn Fn(FeaturePoint) -> Option<Vector2<f64>>,
    candide: &dyn Fn(FeaturePoint) -> Option<Vector2<f64>>,
) -> Result<[f64; 5], SynthesisError> {
    let ratio = |fapu: Fapu| {
        let (bank, candide) = (length(fapu, bank)?, length(fapu, candide)?);
        (bank > 0.0 && candide > 0.0).then(|| bank / candide)
    };
    let es = ratio(Fapu::Es).ok_or_else(|| SynthesisError::Scale {
        reason: "the eye separation needs the corners of both eyes, feature points 3.7, 3.8, 3.11 and 3.12, left of each other"
            .to_owned(),
    })?;
    Ok(Fapu::LENGTHS.map(|fapu| ratio(fapu).unwrap_or(es)))
}

/// Length of a FAPU on a bank's face, in the bank's unit; `None` if the bank lacks its feature points.
pub fn fapu_length(bank: &Bank, fapu: Fapu) -> Option<f64> {
    let at = |fp: FeaturePoint| bank.feature_point_position(fp).map(|[x, y, _]| Vector2::new(f64::from(x), f64::from(y)));
    length(fapu, &at).filter(|length| *length > 0.0)
}

/// Returns the point about which the head turns, the bank's unit: feature point 7.1, the top of the spine. In a bank without it, the
/// point is taken 1.4 eye separations behind the pupils and 0.6 below, roughly the joint of skull and spine; in one without eyes, it is
/// the origin.
pub fn head_pivot(bank: &Bank) -> [f32; 3] {
    /// Distance behind and below the pupils, over the eye separation.
    const BEHIND: f64 = 1.4;
    const BELOW: f64 = 0.6;
    let at = |group: u8, point: u8| bank.feature_point_position(FeaturePoint { group, point });
    if let Some(spine) = at(7, 1) {
        return spine;
    }
    let corners: Option<Vec<[f32; 3]>> = [7, 11, 12, 8].into_iter().map(|point| at(3, point)).collect();
    let Some((corners, es)) = corners.zip(fapu_length(bank, Fapu::Es)) else { return [0.0; 3] };
    let middle = |axis: usize| corners.iter().map(|corner| f64::from(corner[axis])).sum::<f64>() / 4.0;
    [middle(0), middle(1) - BELOW * es, middle(2) - BEHIND * es].map(|c| c as f32)
}

/// Length of a FAPU from feature points of the skin. The pupils are taken halfway between the corners of their eye.
fn length(fapu: Fapu, at: &dyn Fn(FeaturePoint) -> Option<Vector2<f64>>) -> Option<f64> {
    let at = |group: u8, point: u8| at(FeaturePoint { group, point });
    let pupil = |outer: u8, inner: u8| Some((at(3, outer)? + at(3, inner)?) / 2.0);
    let eyes = || Some((pupil(7, 11)?, pupil(12, 8)?));
    match fapu {
        Fapu::Irisd => Some(f64::midpoint(at(3, 1)?.y - at(3, 3)?.y, at(3, 2)?.y - at(3, 4)?.y)),
        Fapu::Es => eyes().map(|(left, right)| left.x - right.x),
        Fapu::Ens => eyes().and_then(|(left, right)| Some(f64::midpoint(left.y, right.y) - at(9, 15)?.y)),
        Fapu::Mns => Some(at(9, 15)?.y - at(2, 2)?.y),
        Fapu::Mw => Some(at(8, 3)?.x - at(8, 4)?.x),
        Fapu::Au => None,
    }
}
