//! Errors and warnings of a fit.

use super::{MINIMUM_MARKS, SpringError};
use crate::{geometry::SimilarityError, units::NodeId};

/// Reason why a wireframe cannot be fitted.
///
/// ```
/// use grimace::{fit::{FitError, Fitter}, wireframe::Face};
///
/// let Face { wireframe, .. } = Face::candide3();
/// let error = Fitter::new(&wireframe, Default::default()).fit(&wireframe, &[]).unwrap_err();
/// assert!(matches!(error, FitError::TooFewMarks { found: 0 }));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// Too few marks.
    #[error("{found} marks; a fit needs at least {MINIMUM_MARKS}, and 5 to 8 for a good one")]
    TooFewMarks {
        /// Marks given.
        found: usize,
    },
    /// The marks do not determine a similarity transform.
    #[error("the marks do not determine a placement: {0}")]
    Placement(#[from] SimilarityError),
    /// The springs have no equilibrium.
    #[error(transparent)]
    Springs(#[from] SpringError),
    /// A mark at a node that the wireframe does not have.
    #[error("mark at node {node}, but the wireframe has nodes 0 to {}", count.saturating_sub(1))]
    NoSuchNode {
        /// The node.
        node: NodeId,
        /// Nodes there are.
        count: usize,
    },
    /// A node marked twice.
    #[error("node {node} is marked twice; keep one of the two marks")]
    DuplicateNode {
        /// The node.
        node: NodeId,
    },
    /// A position or expected error that no mark has.
    #[error("the {what} of the mark at node {node} is {value}; it must be {allowed}")]
    Mark {
        /// The node.
        node: NodeId,
        /// The coordinate or the expected error, px.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// A prior that is none: a number that is not finite, a deviation that is not positive, or a mode over other nodes.
    #[error("the shape prior is not valid: {reason}")]
    Prior {
        /// What is wrong.
        reason: String,
    },
    /// A prior over another wireframe.
    #[error("the shape prior has {found} nodes, but the wireframe has {count}; choose another --prior")]
    PriorNodes {
        /// Nodes of the prior.
        found: usize,
        /// Nodes of the wireframe.
        count: usize,
    },
    /// The options name a prior file that was not loaded.
    #[error("the shape prior with BLAKE3 {blake3} was not read from its file")]
    PriorNotRead {
        /// BLAKE3 of the file.
        blake3: String,
    },
    /// Left and right are exchanged.
    #[error(
        "the marks fit a mirrored face: left and right are swapped; they mean the subject's own sides (the subject's left is on the \
         right of the image){}{}",
        mirrored(pairs),
        and_then(then)
    )]
    Mirrored {
        /// Nodes of both sides that are marked, in pairs.
        pairs: Vec<(NodeId, NodeId)>,
        /// Nodes that are exchanged beside that, in pairs.
        then: Vec<(NodeId, NodeId)>,
    },
    /// Columns of the table were exchanged.
    #[error(
        "the marks fit a mirrored face that lies on its side: x and y are swapped; x points right and y down, from the upper left corner \
         of the image"
    )]
    AxesExchanged,
    /// Rows were counted from the bottom of the image.
    #[error(
        "the marks fit a face mirrored at a horizontal line: y must be counted downwards from the top of the image; if it was counted \
         from the bottom, write the image's height - 1 - y"
    )]
    YUpwards,
    /// Two marks that are probably exchanged.
    #[error("{} swapped: each lies where the other is expected (left and right are the subject's own)", exchanged(pairs))]
    Exchanged {
        /// The nodes, in pairs.
        pairs: Vec<(NodeId, NodeId)>,
    },
    /// A mark at an impossible position.
    #[error(
        "node {node} is marked at ({x}, {y}), but the other marks expect it near ({expected_x:.0}, {expected_y:.0}), {percent:.0} % of \
         the eye distance away{}; correct it or remove it",
        and_others(others)
    )]
    Outlier {
        /// The node.
        node: NodeId,
        /// Its x, px.
        x: f64,
        /// Its y, px.
        y: f64,
        /// Where the other marks expect it, x, px.
        expected_x: f64,
        /// Where the other marks expect it, y, px.
        expected_y: f64,
        /// How far that is, percent of the eye distance.
        percent: f64,
        /// Further marks that no face has where they are.
        others: Vec<NodeId>,
    },
    /// The wireframe lies upside down in the image.
    #[error(
        "the marks place the face upside down (roll {degrees:.0} degrees): if the face is upside down in the picture, turn the picture; \
         otherwise marks are swapped (left and right are the subject's own), or y was counted from the bottom of the image"
    )]
    UpsideDown {
        /// Angle of the face's up against the image's up.
        degrees: f64,
    },
}

fn exchanged(pairs: &[(NodeId, NodeId)]) -> String {
    format!("the marks of nodes {} are", in_pairs(pairs))
}

fn in_pairs(pairs: &[(NodeId, NodeId)]) -> String {
    pairs.iter().map(|(a, b)| format!("{a} and {b}")).collect::<Vec<_>>().join(", ")
}

fn mirrored(pairs: &[(NodeId, NodeId)]) -> String {
    if pairs.is_empty() { String::new() } else { format!("; swap the marks of nodes {}", in_pairs(pairs)) }
}

fn and_then(pairs: &[(NodeId, NodeId)]) -> String {
    if pairs.is_empty() { String::new() } else { format!("; then also swap {}", in_pairs(pairs)) }
}

fn and_others(nodes: &[NodeId]) -> String {
    let names: Vec<String> = nodes.iter().map(ToString::to_string).collect();
    if names.is_empty() { String::new() } else { format!(" (so are nodes {})", names.join(", ")) }
}

/// Warning about marks that a fit did use.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// use grimace::{fit::{FitWarning, Fitter}, units::NodeId};
///
/// // `marks` are eleven points of a neutral frame.
/// let mut moved = marks.clone();
/// moved[0].position.x += 9.0;
/// let fitted = Fitter::new(&wireframe, Default::default()).fit(&wireframe, &moved)?;
/// assert!(matches!(fitted.warnings[0], FitWarning::Doubtful { node: NodeId(20), .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FitWarning {
    /// A mark that is far from where the others expect it, but may be right.
    #[error(
        "the mark of node {node} at ({x:.1}, {y:.1}) lies {percent:.0} % of the eye distance from where the other marks expect it; check it"
    )]
    Doubtful {
        /// The node.
        node: NodeId,
        /// Its x, px.
        x: f64,
        /// Its y, px.
        y: f64,
        /// How far off it is, percent of the eye distance.
        percent: f64,
    },
    /// The marks turn triangles over.
    #[error("the marks turn parts of the wireframe over; check them in a picture of the fit (--overlay)")]
    Turned,
}
