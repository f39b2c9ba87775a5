//! Draws the figures of a run: displacement fields, dispersion, curves over time, differences between groups.
//!
//! Positions are face units, y up, as in models; drawings have y down. The subject's left is on the right.

mod charts;
mod fields;
mod maps;
mod words;

use std::collections::BTreeMap;

use nalgebra::{Point2, Vector2};

pub use charts::{BandFigure, StripRow, bands, distances};
pub use fields::{FieldScale, draw_measure, field, fields, lengths, representatives, spread};
pub use maps::{difference, dispersion, map, range};
pub use words::directions;

use super::{
    drawing::{Colour, Drawing, Pen, Step, polyline},
    payload::contour_chains,
};
use crate::{
    model::DynamicExpressionModel,
    units::{FaceUnit, NodeId},
    wireframe::Wireframe,
};

/// A normalized model.
pub type Model = DynamicExpressionModel<FaceUnit>;

/// Size of small text, px.
const SMALL: f64 = 9.5;
/// Size of headings, px.
const HEADING: f64 = 11.0;
/// Colours of two groups (Okabe and Ito), distinguishable for colour-blind readers, and of secondary lines.
const BLUE: Colour = [0x00, 0x5a, 0x9c];
const ORANGE: Colour = [0xd5, 0x5e, 0x00];
const QUIET: Colour = [0x8b, 0x93, 0x9b];
const DARK: Colour = [0x23, 0x27, 0x2b];

/// Lines of a wireframe that figures show.
pub struct Lines {
    live: Vec<NodeId>,
    triangles: Vec<[NodeId; 3]>,
    edges: Vec<[NodeId; 2]>,
    /// Edges that belong to one triangle only.
    outline: Vec<[NodeId; 2]>,
    strong: Vec<Vec<NodeId>>,
    fine: Vec<Vec<NodeId>>,
}

impl Lines {
    /// Collects the lines of a wireframe.
    pub fn new(wireframe: &Wireframe) -> Self {
        let mut uses: BTreeMap<[NodeId; 2], usize> = BTreeMap::new();
        for &[a, b, c] in wireframe.triangles() {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *uses.entry([p.min(q), p.max(q)]).or_default() += 1;
            }
        }
        Self {
            live: wireframe.live_nodes().to_vec(),
            triangles: wireframe.triangles().to_vec(),
            outline: uses.iter().filter(|(_, n)| **n == 1).map(|(edge, _)| *edge).collect(),
            edges: uses.into_keys().collect(),
            strong: contour_chains(wireframe, "strong"),
            fine: contour_chains(wireframe, "fine"),
        }
    }

    /// Draws springs, fine and strong contours.
    fn draw(&self, drawing: &mut Drawing, at: &dyn Fn(NodeId) -> Point2<f64>, quiet: bool) {
        let (edges, contours) = if quiet { (0.35, 0.45) } else { (0.75, 1.0) };
        drawing.path(Pen::line("edges", QUIET, 0.4).at(edges), pairs(&self.edges, at));
        drawing.path(Pen::line("fine", DARK, 0.5).at(contours), chains(&self.fine, at));
        drawing.path(Pen::line("contours", DARK, 0.9).at(contours), self.contours(at));
    }

    /// The strong contours and the outline.
    fn contours(&self, at: &dyn Fn(NodeId) -> Point2<f64>) -> Vec<Step> {
        let mut steps = chains(&self.strong, at);
        steps.extend(pairs(&self.outline, at));
        steps
    }
}

fn pairs(edges: &[[NodeId; 2]], at: &dyn Fn(NodeId) -> Point2<f64>) -> Vec<Step> {
    edges.iter().flat_map(|&[a, b]| [Step::Move(at(a)), Step::Line(at(b))]).collect()
}

fn chains(chains: &[Vec<NodeId>], at: &dyn Fn(NodeId) -> Point2<f64>) -> Vec<Step> {
    chains.iter().flat_map(|chain| polyline(chain.iter().map(|n| at(*n)), false)).collect()
}

/// Position of a node in a frame, y down.
fn place(model: &Model, frame: usize, node: NodeId) -> Point2<f64> {
    let p = model.frames().get(frame).and_then(|f| f.node(node)).unwrap_or_default();
    Point2::new(p.x, -p.y)
}

/// Offset of a node in a frame from its neutral position, y up.
fn offset(model: &Model, frame: usize, node: NodeId) -> Vector2<f64> {
    let at = |m: usize| model.frames().get(m).and_then(|f| f.node(node)).unwrap_or_default();
    at(frame) - at(0)
}

/// Number of the last frame.
fn apex(model: &Model) -> usize {
    model.frame_count().saturating_sub(1)
}

/// Bounding box (left, top, width, height) of all frames of all models, y down, with a margin.
pub fn view_box<'a>(models: impl IntoIterator<Item = &'a Model>, lines: &Lines) -> [f64; 4] {
    /// Margin around the faces, as a share of the longer side.
    const MARGIN: f64 = 0.02;
    let (mut least, mut most) = (Point2::new(f64::INFINITY, f64::INFINITY), Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY));
    for model in models {
        for frame in 0..model.frame_count() {
            for &node in &lines.live {
                let p = place(model, frame, node);
                least = least.inf(&p);
                most = most.sup(&p);
            }
        }
    }
    let size = most - least;
    if !(size.x.is_finite() && size.y.is_finite() && size.x > 0.0 && size.y > 0.0) {
        return [0.0, 0.0, 1.0, 1.0];
    }
    let margin = MARGIN * size.x.max(size.y);
    [least.x - margin, least.y - margin, size.x + 2.0 * margin, size.y + 2.0 * margin]
}

/// About `count` ticks at 1, 2 or 5 times a power of ten between two values, and the decimals they need.
fn ticks(low: f64, high: f64, count: f64) -> (Vec<f64>, usize) {
    let raw = (high - low).max(1e-9) / count.max(1.0);
    let power = 10_f64.powf(raw.log10().floor());
    let step = power * [1.0, 2.0, 5.0].into_iter().find(|f| f * power >= raw * 0.999).unwrap_or(10.0);
    let first = (low / step - 1e-9).ceil();
    let list = (0..100).map(|k| (first + f64::from(k)) * step).take_while(|v| *v <= high + step * 1e-6);
    (list.map(|v| if v.abs() < step * 1e-9 { 0.0 } else { v }).collect(), (-(step.log10() + 1e-9).floor()).max(0.0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(ticks(0.0, 10.0, 5.0), (vec![0.0, 2.0, 4.0, 6.0, 8.0, 10.0], 0));
        // A step of 0.05 takes two decimals.
        let (list, digits) = ticks(0.11, 0.24, 3.0);
        assert_eq!((list.len(), digits), (2, 2));
        assert!((list[0] - 0.15).abs() < 1e-12 && (list[1] - 0.2).abs() < 1e-12);
    }

    #[test]
    fn every_edge_is_drawn_once() {
        let lines = Lines::new(&Wireframe::candide3());
        // In a triangulated disc, every inner edge belongs to two triangles, every outer one to one.
        assert_eq!(2 * lines.edges.len() - lines.outline.len(), 3 * lines.triangles.len());
    }
}
