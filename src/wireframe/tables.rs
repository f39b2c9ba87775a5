//! The data files of `candide/`, which assign nodes to feature points, regions, FAPUs and landmarks.

use std::{collections::BTreeMap, fmt, str::FromStr, sync::LazyLock};

use nalgebra::{Point3, Vector3};
use serde::Deserialize;

use super::{Axis, Fapu, FapuDefinition, MotionUnit, UnitKind, Wireframe};
use crate::{
    text::excerpt,
    units::{FeaturePoint, NodeId},
};

const VERTICES: &str = include_str!("../../candide/vertices.csv");
const TRIANGLES: &str = include_str!("../../candide/triangles.csv");
const ACTION_UNITS: &str = include_str!("../../candide/action_units.csv");
const SHAPE_UNITS: &str = include_str!("../../candide/shape_units.csv");
const FEATURE_POINTS: &str = include_str!("../../candide/feature_points.csv");
const FAPUS: &str = include_str!("../../candide/fapus.csv");
const REGIONS: &str = include_str!("../../candide/regions.csv");
const REGION_FAPUS: &str = include_str!("../../candide/region_fapus.csv");
const LANDMARKS: &str = include_str!("../../candide/ibug68.csv");

/// A facial region: nodes that share FAPUs, and a row in reports.
///
/// ```
/// use grimace::{units::NodeId, wireframe::{Region, Tables}};
///
/// assert_eq!(Tables::candide3().region(NodeId(31)), Region::Mouth);
/// assert_eq!(Region::ALL.map(|region| region.to_string())[..3], ["forehead", "brow", "eye"]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Region {
    /// Forehead and skull.
    Forehead,
    /// Eyebrows.
    Brow,
    /// Lids, corners and irises.
    Eye,
    /// Nose.
    Nose,
    /// Cheeks.
    Cheek,
    /// Lips.
    Mouth,
    /// Chin.
    Jaw,
    /// Outer contour of the face.
    Contour,
}

impl Region {
    /// All regions, from top to bottom.
    pub const ALL: [Self; 8] =
        [Self::Forehead, Self::Brow, Self::Eye, Self::Nose, Self::Cheek, Self::Mouth, Self::Jaw, Self::Contour];
}

impl fmt::Display for Region {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Forehead => "forehead",
            Self::Brow => "brow",
            Self::Eye => "eye",
            Self::Nose => "nose",
            Self::Cheek => "cheek",
            Self::Mouth => "mouth",
            Self::Jaw => "jaw",
            Self::Contour => "contour",
        })
    }
}

/// One MPEG-4 feature point and its nodes.
///
/// The position of the feature point is the mean of the nodes; the list is empty if Candide-3 lacks the point.
///
/// ```
/// use grimace::{units::NodeId, wireframe::Tables};
///
/// let tables = Tables::candide3();
/// let chin = tables.feature_points.iter().find(|row| row.fp.to_string() == "2.1").expect("feature point 2.1");
/// assert_eq!(chin.nodes, [NodeId(10)]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FeaturePointRow {
    /// The feature point.
    pub fp: FeaturePoint,
    /// Its nodes.
    pub nodes: Vec<NodeId>,
    /// Description of the point.
    pub description: String,
}

/// How well a landmark of the 68-point scheme corresponds to a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum LandmarkConfidence {
    /// No node there: interpolated, not used for fitting.
    Low,
    /// On the same contour; the position along it is approximate.
    Medium,
    /// Same anatomical point.
    High,
}

/// One landmark of the 68-point (iBUG 300-W) scheme, counted from 0, and the nodes it corresponds to.
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkRow {
    /// Landmark index, 0 to 67.
    pub landmark: u8,
    /// Part of the face: jaw, brow, nose, eye, `outer_lip`, `inner_lip`.
    pub part: String,
    /// Nodes and weights; several for an interpolated position.
    pub nodes: Vec<(NodeId, f64)>,
    /// How well it corresponds.
    pub confidence: LandmarkConfidence,
}

/// The tables that relate a wireframe with Candide-3's node numbers to MPEG-4 and to landmarks.
///
/// ```
/// use grimace::{units::NodeId, wireframe::{Fapu, Tables}};
///
/// let tables = Tables::candide3();
/// assert_eq!(tables.feature_point_nodes("8.3".parse()?), Some(&[NodeId(31)][..]));
/// // Across, the mouth's motion is measured in mouth widths; up and down, in distances of mouth and nose.
/// assert_eq!(tables.node_fapus(NodeId(31)), (Fapu::Mw, Fapu::Mns));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// Feature points in the order of the standard.
    pub feature_points: Vec<FeaturePointRow>,
    /// Definitions of the FAPU lengths.
    pub fapus: Vec<FapuDefinition>,
    /// Region of every node, in node order.
    pub regions: Vec<Region>,
    /// FAPUs of a region along x and y.
    pub region_fapus: BTreeMap<Region, (Fapu, Fapu)>,
    /// The 68 landmarks in order.
    #[doc(hidden)]
    pub landmarks: Vec<LandmarkRow>,
}

/// Error for a data file of `candide/` that cannot be read.
///
/// The tables are compiled into the program, so this error occurs only after they were changed.
#[derive(Debug, thiserror::Error)]
#[error("{table}: {reason}")]
pub struct TableError {
    /// File name.
    pub table: &'static str,
    /// What is wrong, with the row.
    pub reason: String,
}

impl Tables {
    /// Returns the embedded tables of Candide-3, which are parsed once.
    pub fn candide3() -> Self {
        static TABLES: LazyLock<Tables> =
            LazyLock::new(|| Tables::embedded().unwrap_or_else(|error| unreachable!("embedded table: {error}")));
        TABLES.clone()
    }

    fn embedded() -> Result<Self, TableError> {
        #[derive(Deserialize)]
        struct FpRow {
            fp: String,
            nodes: String,
            description: String,
        }
        #[derive(Deserialize)]
        struct FapuRow {
            fapu: Fapu,
            axis: Axis,
            plus_nodes: String,
            minus_nodes: String,
        }
        #[derive(Deserialize)]
        struct RegionRow {
            region: Region,
        }
        #[derive(Deserialize)]
        struct RegionFapuRow {
            region: Region,
            fapu_x: Fapu,
            fapu_y: Fapu,
        }
        #[derive(Deserialize)]
        struct RawLandmark {
            landmark: u8,
            part: String,
            nodes: String,
            weights: String,
            confidence: LandmarkConfidence,
        }
        let feature_points = rows::<FpRow>("feature_points.csv", FEATURE_POINTS)?
            .into_iter()
            .map(|r| {
                let fp = r.fp.parse().map_err(|e| TableError { table: "feature_points.csv", reason: format!("{e}") })?;
                Ok(FeaturePointRow { fp, nodes: nodes("feature_points.csv", &r.nodes)?, description: r.description })
            })
            .collect::<Result<_, _>>()?;
        let fapus = rows::<FapuRow>("fapus.csv", FAPUS)?
            .into_iter()
            .map(|r| {
                Ok(FapuDefinition {
                    fapu: r.fapu,
                    axis: r.axis,
                    plus_nodes: nodes("fapus.csv", &r.plus_nodes)?,
                    minus_nodes: nodes("fapus.csv", &r.minus_nodes)?,
                })
            })
            .collect::<Result<_, _>>()?;
        let landmarks = rows::<RawLandmark>("ibug68.csv", LANDMARKS)?
            .into_iter()
            .map(|r| {
                let ids = nodes("ibug68.csv", &r.nodes)?;
                let weights: Vec<f64> = numbers("ibug68.csv", &r.weights)?;
                let nodes = ids.into_iter().zip(weights).collect();
                Ok(LandmarkRow { landmark: r.landmark, part: r.part, nodes, confidence: r.confidence })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            feature_points,
            fapus,
            regions: rows::<RegionRow>("regions.csv", REGIONS)?.into_iter().map(|r| r.region).collect(),
            region_fapus: rows::<RegionFapuRow>("region_fapus.csv", REGION_FAPUS)?
                .into_iter()
                .map(|r| (r.region, (r.fapu_x, r.fapu_y)))
                .collect(),
            landmarks,
        })
    }

    /// Region of a node; nodes beyond the table belong to the contour.
    pub fn region(&self, node: NodeId) -> Region {
        self.regions.get(node.index()).copied().unwrap_or(Region::Contour)
    }

    /// FAPUs that scale a node's motion along x and y.
    pub fn node_fapus(&self, node: NodeId) -> (Fapu, Fapu) {
        self.region_fapus.get(&self.region(node)).copied().unwrap_or((Fapu::Es, Fapu::Ens))
    }

    /// Nodes of a feature point; `None` if the standard or Candide-3 does not have it.
    pub fn feature_point_nodes(&self, fp: FeaturePoint) -> Option<&[NodeId]> {
        let row = self.feature_points.iter().find(|row| row.fp == fp)?;
        (!row.nodes.is_empty()).then_some(row.nodes.as_slice())
    }
}

/// Parses a node in the notation of users: a node number, or a feature point that is a single node, such as `8.3`.
///
/// # Errors
/// A message that says what was expected.
pub fn parse_node_or_feature_point(text: &str, tables: &Tables, node_count: usize) -> Result<NodeId, String> {
    let text = text.trim();
    if let Ok(number) = text.parse::<u16>() {
        return if usize::from(number) < node_count {
            Ok(NodeId(number))
        } else {
            Err(format!("node {number} does not exist; the wireframe has nodes 0 to {}", node_count.saturating_sub(1)))
        };
    }
    let fp: FeaturePoint =
        text.parse().map_err(|_| format!("`{}` is neither a node number nor a feature point such as 8.3", excerpt(text)))?;
    match tables.feature_point_nodes(fp) {
        Some(&[node]) if node.index() < node_count => Ok(node),
        Some(nodes) => {
            let list = nodes.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            Err(format!("feature point {fp} is the middle of nodes {list}, not a single node; mark one of these nodes"))
        }
        None => Err(format!("feature point {fp} has no node in Candide-3")),
    }
}

/// Builds Candide-3 from the embedded tables.
pub(super) fn candide3() -> Wireframe {
    build().unwrap_or_else(|error| unreachable!("embedded table: {error}"))
}

fn build() -> Result<Wireframe, TableError> {
    #[derive(Deserialize)]
    struct VertexRow {
        x: f64,
        y: f64,
        z: f64,
    }
    #[derive(Deserialize)]
    struct TriangleRow {
        a: u16,
        b: u16,
        c: u16,
    }
    #[derive(Deserialize)]
    struct ActionRow {
        unit: String,
        kind: String,
        number: u16,
        fapu: Option<Fapu>,
        node: u16,
        dx: f64,
        dy: f64,
        dz: f64,
    }
    #[derive(Deserialize)]
    struct ShapeRow {
        unit: String,
        node: u16,
        dx: f64,
        dy: f64,
        dz: f64,
    }
    let vertices = rows::<VertexRow>("vertices.csv", VERTICES)?.iter().map(|r| Point3::new(r.x, r.y, r.z)).collect();
    let triangles =
        rows::<TriangleRow>("triangles.csv", TRIANGLES)?.iter().map(|r| [NodeId(r.a), NodeId(r.b), NodeId(r.c)]).collect();
    let mut action_units: Vec<MotionUnit> = Vec::new();
    for r in rows::<ActionRow>("action_units.csv", ACTION_UNITS)? {
        let kind = match r.kind.as_str() {
            "FAP" => UnitKind::Fap { number: r.number, fapu: r.fapu },
            _ => UnitKind::Action { number: r.number },
        };
        push_offset(&mut action_units, &r.unit, kind, r.node, Vector3::new(r.dx, r.dy, r.dz));
    }
    let mut shape_units: Vec<MotionUnit> = Vec::new();
    for r in rows::<ShapeRow>("shape_units.csv", SHAPE_UNITS)? {
        push_offset(&mut shape_units, &r.unit, UnitKind::Shape, r.node, Vector3::new(r.dx, r.dy, r.dz));
    }
    Wireframe::new(vertices, triangles, action_units, shape_units)
        .map_err(|e| TableError { table: "candide/", reason: e.to_string() })
}

/// Appends a row to the last unit if name and kind are the same, otherwise starts a new unit.
fn push_offset(units: &mut Vec<MotionUnit>, name: &str, kind: UnitKind, node: u16, offset: Vector3<f64>) {
    let entry = (NodeId(node), offset);
    match units.last_mut() {
        Some(last) if last.name == name && last.kind == kind => last.offsets.push(entry),
        _ => units.push(MotionUnit { name: name.to_owned(), kind, offsets: vec![entry] }),
    }
}

/// Parses all records of an embedded CSV table.
pub(super) fn rows<T: for<'de> Deserialize<'de>>(table: &'static str, text: &str) -> Result<Vec<T>, TableError> {
    let mut reader = csv::ReaderBuilder::new().from_reader(text.as_bytes());
    reader.deserialize().collect::<Result<_, _>>().map_err(|e| TableError { table, reason: e.to_string() })
}

/// Parses numbers separated by white space; empty text gives none.
fn numbers<T: FromStr<Err: fmt::Display>>(table: &'static str, text: &str) -> Result<Vec<T>, TableError> {
    let parse = |word: &str| word.parse().map_err(|e| TableError { table, reason: format!("`{word}`: {e}") });
    text.split_whitespace().map(parse).collect()
}

fn nodes(table: &'static str, text: &str) -> Result<Vec<NodeId>, TableError> {
    Ok(numbers(table, text)?.into_iter().map(NodeId).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_reads_and_refers_to_nodes_that_exist() {
        let (tables, wireframe) = (Tables::candide3(), Wireframe::candide3());
        let count = wireframe.node_count();
        assert_eq!(tables.regions.len(), count);
        assert_eq!(tables.landmarks.len(), 68);
        assert_eq!(tables.fapus.len(), 5);
        assert_eq!(tables.region_fapus.len(), Region::ALL.len());
        let referred = tables.feature_points.iter().flat_map(|r| r.nodes.iter().copied());
        let landmarks = tables.landmarks.iter().flat_map(|r| r.nodes.iter().map(|&(n, _)| n));
        assert!(referred.chain(landmarks).all(|n| n.index() < count));
        for row in &tables.landmarks {
            let sum: f64 = row.nodes.iter().map(|(_, w)| w).sum();
            assert!((sum - 1.0).abs() < 1e-9, "landmark {}", row.landmark);
        }
    }

    #[test]
    fn nodes_are_written_as_numbers_or_feature_points() {
        let tables = Tables::candide3();
        let parse = |text| parse_node_or_feature_point(text, &tables, 113);
        assert_eq!(parse("31"), Ok(NodeId(31)));
        assert_eq!(parse(" 8.3 "), Ok(NodeId(31)));
        assert!(parse("113").unwrap_err().contains("nodes 0 to 112"));
        assert!(parse("3.5").unwrap_err().contains("67, 68, 71, 72"));
        assert!(parse("6.1").unwrap_err().contains("no node"));
        assert!(parse("mouth").unwrap_err().contains("neither"));
    }

    #[test]
    fn mirrored_feature_points_have_mirrored_nodes() {
        // The left and right mouth corners, 8.3 and 8.4, differ only in the sign of x.
        let (tables, w) = (Tables::candide3(), Wireframe::candide3());
        let at = |text: &str| w.vertices()[tables.feature_point_nodes(text.parse().unwrap()).unwrap()[0].index()];
        assert_eq!(at("8.3").x, -at("8.4").x);
        assert_eq!(at("8.3").y, at("8.4").y);
    }
}
