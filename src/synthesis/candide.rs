//! The embedded bank `candide`: a smooth Candide-3 with its own motion units as shapes.
//!
//! It is computed from the wireframe's tables on demand. Four rounds of Loop subdivision refine the skin (all triangles except
//! those of the eyes) and the displacements of its nodes. Loop's scheme also smooths the nodes, which would narrow eyes and lips;
//! so coarse values are first pushed outwards until the refined nodes are near their Candide-3 positions. Two eyeballs that do
//! not move fill the eyes.

use nalgebra::Vector3;

use super::{
    Bank, BankError, BankInfo, Composition, FeaturePointVertex, PerformanceOptions, Recipe, arkit, choose_members,
    feature_points::skin_feature_points, perform,
};
use crate::{
    mesh::{Subdivision, TriangleMesh, sphere_front},
    output::MADE_BY,
    units::NodeId,
    wireframe::{Emotion, ExpressionUnit, Fapus, Tables, Wireframe, expressions, find_unit, settle_offsets},
};

/// Rounds of subdivision: about 23K vertices and 46K triangles with the eyes, like the meshes of \[ZL\].
const ROUNDS: usize = 4;
/// Number of members of the bank \[ZL\].
const MEMBERS: usize = 30;
/// Nodes of the iris boxes: a triangle with one of them is eyeball, not skin.
const EYEBALL: std::ops::RangeInclusive<u16> = 67..=74;
/// Distance across the midline, model units, over which the effect of a one-sided unit rises from 0 to 1.
const SIDE_RAMP: f64 = 0.12;
/// The jaw drop (AUV 11) moves one bone, so it has no sides.
const JAW_DROP: u16 = 11;

/// A motion unit, or one side of it.
struct Shape {
    name: String,
    unit: ExpressionUnit,
    /// 1 left, -1 right, 0 both.
    side: f64,
}

/// The shapes that the six expressions use: FAPs unchanged, action unit vectors split into sides.
fn shapes(wireframe: &Wireframe, fapus: &Fapus) -> Vec<Shape> {
    let mut shapes: Vec<Shape> = Vec::new();
    for row in expressions().iter().filter(|r| Emotion::BASIC.contains(&r.emotion)) {
        if shapes.iter().any(|s| s.unit == row.unit) {
            continue;
        }
        let Some((index, _)) = find_unit(wireframe, fapus, row.unit) else { continue };
        let unit = &wireframe.action_units()[index];
        let push = |shapes: &mut Vec<Shape>, name: String, side| shapes.push(Shape { name, unit: row.unit, side });
        match row.unit {
            ExpressionUnit::Auv(JAW_DROP) | ExpressionUnit::Fap(_) => push(&mut shapes, unit.name.clone(), 0.0),
            ExpressionUnit::Auv(_) => {
                push(&mut shapes, format!("{}_L", unit.name), 1.0);
                push(&mut shapes, format!("{}_R", unit.name), -1.0);
            }
        }
    }
    shapes
}

/// The wireframe with its tables, and its smooth surface.
struct Candide {
    wireframe: Wireframe,
    shapes: Vec<Shape>,
    /// Offsets of every node in every shape at weight 1.
    offsets: Vec<Vec<Vector3<f64>>>,
    /// The node of every coarse vertex of the skin.
    nodes: Vec<NodeId>,
    rule: Subdivision,
    mesh: TriangleMesh,
    feature_points: Vec<FeaturePointVertex>,
}

impl Candide {
    fn new() -> Result<Self, BankError> {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let fapus = Fapus::measure(&tables.fapus, &wireframe.frontal()).map_err(|e| BankError::Number {
            what: "a FAPU of Candide-3",
            found: e.to_string(),
            expected: "a length".to_owned(),
        })?;
        let shapes = shapes(&wireframe, &fapus);
        let offsets = shapes.iter().map(|s| node_offsets(&wireframe, &fapus, s)).collect();
        let is_skin = |t: &&[NodeId; 3]| !t.iter().any(|n| EYEBALL.contains(&n.0));
        let triangles: Vec<[NodeId; 3]> = wireframe.triangles().iter().filter(is_skin).copied().collect();
        let mut nodes: Vec<NodeId> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let vertex = |n: NodeId| nodes.binary_search(&n).unwrap_or_default() as u32;
        let positions = nodes.iter().map(|n| wireframe.vertices()[n.index()].coords.map(|c| c as f32).into()).collect();
        let coarse = TriangleMesh::new(positions, triangles.iter().map(|t| t.map(vertex)).collect())?;
        let rule = Subdivision::new(&coarse, ROUNDS)?;
        let skin = TriangleMesh::new(refine_through(&rule, coarse.positions()), rule.triangles().to_vec())?;
        let mesh = with_eyeballs(&skin)?;
        let feature_points = skin_feature_points()
            .filter_map(|fp| {
                let node = tables.feature_point_nodes(fp)?.first()?;
                nodes.binary_search(node).ok().map(|k| FeaturePointVertex { fp, vertex: k as u32 })
            })
            .collect();
        Ok(Self { wireframe, shapes, offsets, nodes, rule, mesh, feature_points })
    }

    fn names(&self) -> Vec<String> {
        self.shapes.iter().map(|s| s.name.clone()).collect()
    }

    /// Returns the dense displacements for node offsets; the eyeballs do not move.
    fn refine(&self, offsets: &[Vector3<f64>]) -> Vec<[f32; 3]> {
        let coarse: Vec<[f32; 3]> = self.nodes.iter().map(|n| offsets[n.index()].map(|c| c as f32).into()).collect();
        let mut fine = refine_through(&self.rule, &coarse);
        fine.resize(self.mesh.vertex_count(), [0.0; 3]);
        fine
    }

    /// Node offsets of a mixture; lips do not pass through each other, and brows move the forehead.
    fn mixture(&self, weights: &[f64]) -> Vec<Vector3<f64>> {
        let mut sum = vec![Vector3::zeros(); self.wireframe.node_count()];
        for (offsets, weight) in self.offsets.iter().zip(weights) {
            sum.iter_mut().zip(offsets).for_each(|(s, o)| *s += o * *weight);
        }
        settle_offsets(&self.wireframe, &mut sum);
        sum
    }

    fn expressions(&self) -> Vec<(String, Vec<f64>)> {
        let weight = |emotion: Emotion, shape: &Shape| {
            expressions().iter().filter(|r| r.emotion == emotion && r.unit == shape.unit).map(|r| r.weight).sum()
        };
        Emotion::BASIC.iter().map(|&e| (e.label().to_owned(), self.shapes.iter().map(|s| weight(e, s)).collect())).collect()
    }

    fn performance(&self, options: &PerformanceOptions) -> Vec<Recipe> {
        let side = |s: &Shape| match s.unit {
            // The names of FAPs contain their side: `raise_l_cornerlip`, `stretch_r_cornerlip_o`.
            ExpressionUnit::Fap(_) if s.name.contains("_l_") => 1.0,
            ExpressionUnit::Fap(_) if s.name.contains("_r_") => -1.0,
            _ => arkit::side(&s.name),
        };
        perform(&self.expressions(), &self.shapes.iter().map(side).collect::<Vec<_>>(), options)
    }

    fn bank(
        &self,
        names: Vec<String>,
        displacements: Vec<[f32; 3]>,
        composition: Option<Composition>,
    ) -> Result<Bank, BankError> {
        let info = BankInfo {
            made_by: MADE_BY.to_owned(),
            unit: "Candide-3 model unit".to_owned(),
            source: "Candide-3, subdivided".to_owned(),
            credit: "Candide-3: J. Ahlberg, report LiTH-ISY-R-2326".to_owned(),
            composition,
            paint: None,
        };
        Bank::new(self.mesh.clone(), names, displacements, self.feature_points.clone(), info)
    }

    fn mixed_bank(&self, recipes: &[&Recipe]) -> Result<Bank, BankError> {
        let displacements = recipes.iter().flat_map(|r| self.refine(&self.mixture(&r.weights))).collect();
        let weights = recipes.iter().map(|r| r.weights.clone()).collect();
        let names = recipes.iter().map(|r| r.name.clone()).collect();
        self.bank(names, displacements, Some(Composition { shapes: self.names(), weights }))
    }

    /// Splits the models of a performance into those that become a bank of 30 and the others.
    fn split(&self, recipes: &[Recipe]) -> (Vec<usize>, Vec<usize>) {
        let motion = |r: &Recipe| {
            let offsets = self.mixture(&r.weights);
            let points = self.feature_points.iter().map(|p| offsets[self.nodes[p.vertex as usize].index()]);
            points.flat_map(|v| [v.x, v.y, v.z]).collect::<Vec<f64>>()
        };
        let motions: Vec<Vec<f64>> = recipes.iter().map(motion).collect();
        let chosen = choose_members(&motions, Emotion::BASIC.len(), MEMBERS);
        let rest = (0..recipes.len()).filter(|k| !chosen.contains(k)).collect();
        (chosen, rest)
    }
}

/// Rounds of pushing values outwards; each leaves about half of the remaining difference.
const PUSHES: usize = 3;

/// Refines values so that they pass close to the coarse ones: pushes the coarse values outwards by the amount that smoothing
/// removes.
fn refine_through(rule: &Subdivision, values: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut pushed = values.to_vec();
    for _ in 0..PUSHES {
        let fine = rule.refine(&pushed);
        for ((pushed, value), fine) in pushed.iter_mut().zip(values).zip(&fine) {
            (0..3).for_each(|axis| pushed[axis] += value[axis] - fine[axis]);
        }
    }
    rule.refine(&pushed)
}

fn node_offsets(wireframe: &Wireframe, fapus: &Fapus, shape: &Shape) -> Vec<Vector3<f64>> {
    let mut offsets = vec![Vector3::zeros(); wireframe.node_count()];
    if let Some((unit, length)) = find_unit(wireframe, fapus, shape.unit) {
        for &(node, offset) in &wireframe.action_units()[unit].offsets {
            let place = wireframe.vertices()[node.index()].x / SIDE_RAMP;
            let share = if shape.side == 0.0 { 1.0 } else { f64::midpoint(1.0, shape.side * place).clamp(0.0, 1.0) };
            offsets[node.index()] += offset * (length * share);
        }
    }
    offsets
}

/// Centre and radius of the left eyeball, model units: it fills the opening between the lids from behind.
const EYE_CENTRE: [f32; 3] = [0.298, 0.163, -0.225];
const EYE_RADIUS: f32 = 0.2;
/// Rings and sectors of the front of an eyeball.
const EYE_GRID: (u32, u32) = (28, 56);

/// Adds the fronts of two eyeballs.
fn with_eyeballs(skin: &TriangleMesh) -> Result<TriangleMesh, BankError> {
    let (mut positions, mut triangles) = (skin.positions().to_vec(), skin.triangles().to_vec());
    let (rings, sectors) = EYE_GRID;
    for side in [1.0_f32, -1.0] {
        let first = positions.len() as u32;
        let [x, y, z] = EYE_CENTRE;
        let (ball, faces) = sphere_front([side * x, y, z], EYE_RADIUS, rings, sectors);
        positions.extend(ball);
        triangles.extend(faces.into_iter().map(|t| t.map(|v| v + first)));
    }
    Ok(TriangleMesh::new(positions, triangles)?)
}

/// Returns the embedded shapes: Candide-3's motion units that the six expressions use, on its smooth surface.
///
/// # Errors
/// [`BankError`], only if the embedded tables are defective.
pub fn candide_shapes() -> Result<Bank, BankError> {
    let candide = Candide::new()?;
    let displacements = candide.offsets.iter().flat_map(|o| candide.refine(o)).collect();
    candide.bank(candide.names(), displacements, None)
}

/// Returns the six expressions as weights of [`candide_shapes`], from [`expressions`].
///
/// # Errors
/// Same as [`candide_shapes`].
pub fn candide_expressions() -> Result<Vec<(String, Vec<f64>)>, BankError> {
    Ok(Candide::new()?.expressions())
}

/// Returns the embedded bank: the six dominant expressions and 24 intermediates of a performance of them (seed 1).
///
/// Where a mixture of units would push the lips through each other, they meet in the middle.
///
/// ```
/// use grimace::synthesis::candide_bank;
///
/// let bank = candide_bank()?;
/// assert_eq!(bank.member_count(), 30);
/// assert!(bank.names().iter().any(|name| name == "happiness"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Same as `candide_shapes`.
pub fn candide_bank() -> Result<Bank, BankError> {
    let candide = Candide::new()?;
    let recipes = candide.performance(&PerformanceOptions::default());
    let (chosen, _) = candide.split(&recipes);
    candide.mixed_bank(&chosen.iter().map(|&k| &recipes[k]).collect::<Vec<_>>())
}

/// Returns [`candide_bank`] for a seed, and a second bank of the models of the performance that are not in the first.
///
/// # Errors
/// Same as `candide_shapes`.
pub fn candide_study(seed: u64) -> Result<(Bank, Bank), BankError> {
    let candide = Candide::new()?;
    let recipes = candide.performance(&PerformanceOptions { seed, ..PerformanceOptions::default() });
    let (chosen, rest) = candide.split(&recipes);
    let bank = |models: &[usize]| candide.mixed_bank(&models.iter().map(|&k| &recipes[k]).collect::<Vec<_>>());
    Ok((bank(&chosen)?, bank(&rest)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::testing::check_dominant_expressions;

    #[test]
    fn the_bank_is_as_large_as_the_papers_and_symmetric() {
        let bank = candide_bank().unwrap();
        assert_eq!((bank.vertex_count(), bank.mesh().triangles().len()), (23_424, 46_096));
        assert_eq!((bank.member_count(), bank.feature_points().len()), (30, 56));
        assert_eq!(bank.names()[..6], ["anger", "disgust", "fear", "happiness", "sadness", "surprise"]);
        let at = |text: &str| bank.feature_point_position(text.parse().unwrap()).unwrap();
        assert!((at("8.3")[0] + at("8.4")[0]).abs() < 1e-5 && (at("8.3")[1] - at("8.4")[1]).abs() < 1e-5);
        // The nodes are near their Candide-3 positions: the mouth is 0.492 wide, the lids 0.082 apart.
        assert!((at("8.3")[0] - 0.246).abs() < 0.01, "{:?}", at("8.3"));
        assert!((at("3.1")[1] - at("3.3")[1] - 0.082).abs() < 0.012);
    }

    #[test]
    fn the_dominant_expressions_move_the_right_way() {
        check_dominant_expressions(&candide_bank().unwrap(), [0.04, 0.02, 0.03, 0.1]);
    }

    #[test]
    fn shapes_mix_to_the_bank_but_for_what_is_settled() {
        // Sadness does not open the lips but raises the inner brows: without the forehead's share the mixture of shapes equals
        // the member.
        let shapes = candide_shapes().unwrap();
        let (name, weights) = candide_expressions().unwrap().swap_remove(4);
        assert_eq!(name, "sadness");
        let mixed = crate::synthesis::mix(&shapes, &weights);
        let bank = candide_bank().unwrap();
        for fp in ["8.3", "8.4", "4.1", "2.1"] {
            let vertex = bank.feature_points()[bank.feature_point_index(fp.parse().unwrap()).unwrap()].vertex as usize;
            for (a, b) in mixed[vertex].iter().zip(bank.displacements(4)[vertex]) {
                assert!((a - b).abs() < 0.012, "{fp}");
            }
        }
    }

    #[test]
    fn a_study_has_all_models_once() {
        let (bank, unseen) = candide_study(2).unwrap();
        assert_eq!((bank.member_count(), unseen.member_count()), (30, 354));
        assert!(unseen.names().iter().all(|n| !bank.names().contains(n)));
        assert_eq!(bank.mesh(), unseen.mesh());
    }
}
