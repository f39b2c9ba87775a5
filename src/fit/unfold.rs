//! Triangles that a fit turned over are turned back.
//!
//! Marks that are a few pixels off can turn a triangle between them. Every triangle that lies the other way round than in the frontal view
//! is given a shape to hold: its own, with the turned axis made small instead (its singular values signed, then bounded), as struts along
//! its sides beside the springs. The springs are solved again; what turned meanwhile joins in; the struts of a triangle grow stiffer while
//! it is turned. Marks give way where they must, by their own force: soft ones first, hard ones never.

use nalgebra::{Matrix2, Point2, Vector2};

use super::{DrivenNode, SpringError, Springs, spring::Strut};
use crate::{units::NodeId, wireframe::Wireframe};

/// Least area of a triangle in the frontal view, model units squared, that is turned back: slivers at lids and closed lips turn over
/// without harm.
const LEAST_AREA: f64 = 5e-4;
/// Bounds of a held triangle's stretch against its shape at rest.
const STRETCH: (f64, f64) = (0.15, 4.0);
/// A triangle is turned when less than this share of its area at rest is left.
const LEAST_SHARE: f64 = 0.01;
/// Stiffness of the first struts, over that of a spring.
const STIFFNESS: f64 = 2.0;
/// Growth of a triangle's stiffness in each round in which it is still turned.
const GROWTH: f64 = 1.5;
/// Rounds at most.
const ROUNDS: usize = 40;

/// Places of all nodes, and how many triangles are turned still.
pub(super) struct Unfolded {
    pub nodes: Vec<Point2<f64>>,
    pub turned: usize,
}

/// Turns triangles back: `nodes` are the springs' equilibrium from `rest` under `targets`, y down. `None` when no triangle is turned.
pub(super) fn unfold(
    springs: &Springs,
    wireframe: &Wireframe,
    rest: &[Point2<f64>],
    targets: &[DrivenNode],
    nodes: &[Point2<f64>],
    frontal: &Frontal,
) -> Result<Option<Unfolded>, SpringError> {
    let mut turned = frontal.turned(wireframe, nodes);
    if turned.is_empty() {
        return Ok(None);
    }
    let mut best = (turned.len(), nodes.to_vec());
    let mut nodes = nodes.to_vec();
    // Of the struts of every triangle; 0 for one that never turned.
    let mut stiffness = vec![0.0; wireframe.triangles().len()];
    for _ in 0..ROUNDS {
        turned.iter().for_each(|&t| stiffness[t] = (stiffness[t] * GROWTH).max(STIFFNESS));
        let mut struts = Vec::new();
        for (t, triangle) in wireframe.triangles().iter().enumerate().filter(|(t, _)| stiffness[*t] > 0.0) {
            let shape = frontal.ideal(rest, t, *triangle);
            let now = [1, 2].map(|k| nodes[triangle[k].index()] - nodes[triangle[0].index()]);
            let Some([u, v]) = held_shape(shape, now) else { continue };
            let stiffness = stiffness[t];
            struts.push(Strut { from: triangle[0], to: triangle[1], offset: u, stiffness });
            struts.push(Strut { from: triangle[0], to: triangle[2], offset: v, stiffness });
            struts.push(Strut { from: triangle[1], to: triangle[2], offset: v - u, stiffness });
        }
        nodes = springs.deform_with(wireframe, rest, targets, &struts)?;
        turned = frontal.turned(wireframe, &nodes);
        if turned.len() < best.0 {
            best = (turned.len(), nodes.clone());
        }
        if turned.is_empty() {
            break;
        }
    }
    Ok(Some(Unfolded { nodes: best.1, turned: best.0 }))
}

/// The sides of a triangle that lies the right way round and is near `now`: its deformation from `shape` with bounded stretches. `None`
/// for a shape without area.
fn held_shape(shape: [Vector2<f64>; 2], now: [Vector2<f64>; 2]) -> Option<[Vector2<f64>; 2]> {
    let from = Matrix2::from_columns(&shape);
    let deformation = Matrix2::from_columns(&now) * from.try_inverse()?;
    let svd = deformation.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // Singular values are the first the larger; one of a turned triangle is negative, the smaller.
    let sign = if (u.determinant() * v_t.determinant()) < 0.0 { -1.0 } else { 1.0 };
    let (large, small) = (svd.singular_values[0], svd.singular_values[1] * sign);
    let stretches = Vector2::new(large.clamp(STRETCH.0, STRETCH.1), small.clamp(STRETCH.0, STRETCH.1));
    let flipped = Matrix2::from_diagonal(&Vector2::new(1.0, sign));
    let held = u * Matrix2::from_diagonal(&stretches) * flipped * v_t * from;
    held.iter().all(|x| x.is_finite()).then(|| [held.column(0).into_owned(), held.column(1).into_owned()])
}

/// The frontal wireframe, and where the similarity puts it in the image.
pub(super) struct Frontal {
    /// Areas of the triangles in face space, with sign.
    areas: Vec<f64>,
    /// Places in the image, y down.
    placed: Vec<Point2<f64>>,
}

impl Frontal {
    pub(super) fn new(wireframe: &Wireframe, frontal: &[Point2<f64>], placed: Vec<Point2<f64>>) -> Self {
        Self { areas: wireframe.triangles().iter().map(|t| area(frontal, *t)).collect(), placed }
    }

    /// Numbers of the triangles that lie the other way round than in the frontal view, slivers left out.
    pub(super) fn turned(&self, wireframe: &Wireframe, nodes: &[Point2<f64>]) -> Vec<usize> {
        let is_turned = |(t, triangle): &(usize, &[NodeId; 3])| {
            // y is down in the image, so an upright triangle changes its sign.
            self.areas[*t].abs() > LEAST_AREA
                && -area(nodes, **triangle) * self.areas[*t].signum() < LEAST_SHARE * area(&self.placed, **triangle).abs()
        };
        wireframe.triangles().iter().enumerate().filter(is_turned).map(|(t, _)| t).collect()
    }

    /// Two sides of a triangle as it should be: at rest, or as the frontal wireframe lies where it is turned at rest already.
    fn ideal(&self, rest: &[Point2<f64>], t: usize, triangle: [NodeId; 3]) -> [Vector2<f64>; 2] {
        let upright = -area(rest, triangle) * self.areas[t].signum() > STRETCH.0 * area(&self.placed, triangle).abs();
        let points = if upright { rest } else { &self.placed };
        [1, 2].map(|k| points[triangle[k].index()] - points[triangle[0].index()])
    }
}

fn area(points: &[Point2<f64>], [a, b, c]: [NodeId; 3]) -> f64 {
    (points[b.index()] - points[a.index()]).perp(&(points[c.index()] - points[a.index()])) / 2.0
}
