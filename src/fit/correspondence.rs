//! placeholder until merge
use crate::units::NodeId;
use nalgebra::Point2;
/// Kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CorrespondenceKind {
    /// m
    Mark,
    /// h
    Hard,
}
/// Corr.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// n
    pub node: NodeId,
    /// p
    pub position: Point2<f64>,
    /// k
    pub kind: CorrespondenceKind,
}
