//! Size: gives all models equal FAPUs.
//!
//! KP scale the frame models "in such a way that their facial animation parameter units are equal". A single scale factor can make one
//! FAPU equal, but not five. Therefore every node's offset from neutral is scaled along x and y by the ratio of the canonical FAPU of the
//! node's region to the subject's, and added to the canonical neutral. The displacement vectors, the only input of the statistics, then
//! have the FAPUs of the same face.

use nalgebra::{Point2, Vector2};

use super::{CANONICAL_ES, Canonical, NormalizeError, NormalizeOptions, SizeMode};
use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    units::{FaceUnit, NodeId},
    wireframe::{Fapu, Tables, Wireframe},
};

/// Returns the normalized model of upright frames (y up, px).
pub fn equalize(
    upright: &[Vec<Point2<f64>>],
    tables: &Tables,
    canonical: &Canonical,
    wireframe: &Wireframe,
    options: NormalizeOptions,
) -> Result<DynamicExpressionModel<FaceUnit>, NormalizeError> {
    let neutral = upright.first().map_or(&[][..], Vec::as_slice);
    let fapus = options.irisd.fapus(tables, neutral)?;
    let ratio = |fapu: Fapu| match (canonical.fapus.length(fapu), fapus.length(fapu)) {
        (Some(canonical), Some(subject)) => canonical / subject,
        _ => CANONICAL_ES / fapus.es,
    };
    let scales: Vec<Vector2<f64>> = (0..wireframe.node_count())
        .map(|k| match options.size {
            SizeMode::Fapu => {
                let (x, y) = tables.node_fapus(NodeId(k as u16));
                Vector2::new(ratio(x), ratio(y))
            }
            SizeMode::Uniform => Vector2::repeat(CANONICAL_ES / fapus.es),
        })
        .collect();
    let frames = upright.iter().map(|frame| {
        let mut nodes: Vec<Point2<f64>> =
            (0..frame.len()).map(|k| canonical.neutral.nodes()[k] + (frame[k] - neutral[k]).component_mul(&scales[k])).collect();
        wireframe.place_followers(&mut nodes);
        FrameExpressionModel::new(nodes)
    });
    Ok(DynamicExpressionModel::new(frames.collect())?)
}
