//! Tables of node positions with the columns `frame,node,x,y`.
//!
//! This is the only reader for tracks, normalized models, representatives, corrections and exact positions.

use std::path::{Path, PathBuf};

use nalgebra::Point2;

use crate::{
    input::{CsvFile, CsvRow, InputError},
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    units::{NodeId, Unit},
};

/// Error for a table of positions that cannot be read or does not make whole frames.
///
/// ```
/// use grimace::{errors::PositionsError, pipeline::{ModelFileError, read_model}};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("model.csv");
/// std::fs::write(&path, "frame,node,x,y\n0,0,1,1\n")?;
/// let error = read_model(&path).unwrap_err();
/// assert!(matches!(error, ModelFileError::Positions(PositionsError::TooFewFrames { found: 1, .. })), "{error}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum PositionsError {
    /// The table, one of its rows or one of its fields cannot be read.
    #[error(transparent)]
    Table(#[from] InputError),
    /// A frame without all nodes, or nodes out of order.
    #[error("{}, line {line}: node {found} where node {expected} of frame {frame} was expected; every frame lists all nodes from 0 in order", path.display())]
    Order {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Frame number.
        frame: u32,
        /// Node found.
        found: NodeId,
        /// Node index expected.
        expected: usize,
    },
    /// Fewer than two frames, hence no motion.
    #[error("{}: a track or a model needs at least 2 frames, from neutral to apex; found {found}", path.display())]
    TooFewFrames {
        /// The file.
        path: PathBuf,
        /// Frames found.
        found: usize,
    },
    /// Frames out of order.
    #[error("{}: frame {frame} follows frame {previous}; frames must ascend", path.display())]
    Descending {
        /// The file.
        path: PathBuf,
        /// Frame number.
        frame: u32,
        /// Number of the previous frame.
        previous: u32,
    },
    /// Frames over different wireframes.
    #[error("{}: frame {frame} has {found} nodes, but frame {first} has {expected}", path.display())]
    NodeCount {
        /// The file.
        path: PathBuf,
        /// Frame number.
        frame: u32,
        /// Number of nodes of that frame.
        found: usize,
        /// Number of the first frame.
        first: u32,
        /// Number of nodes of the first frame.
        expected: usize,
    },
    /// The frames do not form a model.
    #[error("{}: {source}", path.display())]
    Model {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: ModelError,
    },
}

/// A table with the columns `frame`, `node`, `x` and `y`. Their order and the case of their names do not matter; further columns are
/// allowed.
#[derive(Clone, Debug)]
pub struct PositionTable {
    csv: CsvFile,
    columns: [usize; 4],
}

/// Position of one node in one frame.
#[derive(Clone, Debug)]
pub struct PositionRow<'a> {
    /// Frame number.
    pub frame: u32,
    /// The node.
    pub node: NodeId,
    /// Position in the table's unit.
    pub position: Point2<f64>,
    /// The row, for reading further columns and for error messages.
    pub row: CsvRow<'a>,
}

/// Frames by ascending number, each with one value per node, from node 0.
pub type Frames<T> = Vec<(u32, Vec<T>)>;

impl PositionTable {
    /// Opens a table.
    ///
    /// # Errors
    /// [`InputError`] for a file that cannot be read, is not a table, or lacks a column.
    pub fn open(path: &Path) -> Result<Self, InputError> {
        Self::new(CsvFile::open(path)?)
    }

    /// Makes a position table from an open CSV table.
    ///
    /// # Errors
    /// [`InputError`] for a missing column.
    pub fn new(csv: CsvFile) -> Result<Self, InputError> {
        let names = ["frame", "node", "x", "y"];
        let columns = match names.map(|name| csv.column_of_any_case(name)) {
            [Some(frame), Some(node), Some(x), Some(y)] => [frame, node, x, y],
            _ => csv.require(names)?,
        };
        Ok(Self { csv, columns })
    }

    /// Returns the file's path.
    pub fn path(&self) -> &Path {
        self.csv.path()
    }

    /// Returns the index of the column `name` (case-insensitive), or `None`.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.csv.column_of_any_case(name)
    }

    /// Returns whether the table is a track in px: it has a column `state`. Models in face units have none.
    pub fn is_track(&self) -> bool {
        self.column("state").is_some()
    }

    /// Returns all rows in file order. Frames need not be complete.
    pub fn rows(&self) -> impl Iterator<Item = Result<PositionRow<'_>, InputError>> {
        let [frame, node, x, y] = self.columns;
        self.csv.rows().map(move |row| {
            let row = row?;
            let number = u16::try_from(row.whole_number(node)?).map_err(|_| row.field_error(node, "the number of a node"))?;
            let position = Point2::new(row.number(x)?, row.number(y)?);
            Ok(PositionRow { frame: row.whole_number(frame)?, node: NodeId(number), position, row })
        })
    }

    /// Returns whole frames: at least two, ascending, all with the same nodes from 0 in order. `node` converts a row to a value.
    ///
    /// # Errors
    /// [`PositionsError`], and the errors of `node`.
    pub fn frames<T, E: From<PositionsError>>(
        &self,
        mut node: impl FnMut(&PositionRow<'_>) -> Result<T, E>,
    ) -> Result<Frames<T>, E> {
        let mut frames: Frames<T> = Vec::new();
        for row in self.rows() {
            let row = row.map_err(PositionsError::from)?;
            if frames.last().is_none_or(|(number, _)| *number != row.frame) {
                frames.push((row.frame, Vec::new()));
            }
            let Some((_, nodes)) = frames.last_mut() else { continue };
            if row.node.index() != nodes.len() {
                let (path, line) = (self.path().to_owned(), row.row.line());
                let (frame, found, expected) = (row.frame, row.node, nodes.len());
                return Err(PositionsError::Order { path, line, frame, found, expected }.into());
            }
            nodes.push(node(&row)?);
        }
        self.check(&frames)?;
        Ok(frames)
    }

    fn check<T>(&self, frames: &Frames<T>) -> Result<(), PositionsError> {
        let path = || self.path().to_owned();
        let [(first, nodes), _, ..] = &frames[..] else {
            return Err(PositionsError::TooFewFrames { path: path(), found: frames.len() });
        };
        if let Some(pair) = frames.windows(2).find(|pair| pair[1].0 <= pair[0].0) {
            return Err(PositionsError::Descending { path: path(), frame: pair[1].0, previous: pair[0].0 });
        }
        match frames.iter().find(|(_, found)| found.len() != nodes.len()) {
            Some((frame, found)) => Err(PositionsError::NodeCount {
                path: path(),
                frame: *frame,
                found: found.len(),
                first: *first,
                expected: nodes.len(),
            }),
            None => Ok(()),
        }
    }

    /// Returns the frames as a dynamic model.
    ///
    /// # Errors
    /// As [`PositionTable::frames`].
    pub fn model<U: Unit>(&self) -> Result<DynamicExpressionModel<U>, PositionsError> {
        let frames = self.frames(|row| Ok::<_, PositionsError>(row.position))?;
        let frames: Vec<_> = frames.into_iter().map(|(_, nodes)| FrameExpressionModel::new(nodes)).collect();
        DynamicExpressionModel::new(frames).map_err(|source| PositionsError::Model { path: self.path().to_owned(), source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::FaceUnit;

    fn table(text: &str) -> PositionTable {
        PositionTable::new(CsvFile::from_bytes(Path::new("t.csv"), text.as_bytes().to_vec()).unwrap()).unwrap()
    }

    fn failure(text: &str) -> String {
        table(text).model::<FaceUnit>().unwrap_err().to_string()
    }

    #[test]
    fn whole_frames_make_a_model() {
        let model = table("y,X,node,Frame,note\n1,2,0,3,a\n4,5,1,3,b\n6,7,0,9,\n8,9,1,9,\n").model::<FaceUnit>().unwrap();
        assert_eq!((model.frame_count(), model.node_count()), (2, 2));
        assert_eq!(model.apex().nodes(), [Point2::new(7.0, 6.0), Point2::new(9.0, 8.0)]);
    }

    #[test]
    fn any_nodes_of_any_frames_are_rows() {
        let table = table("frame,node,x,y,state\n7,31,1,2,lost\n3,0,3,4,\n");
        assert!(table.is_track());
        let rows: Vec<_> = table.rows().map(Result::unwrap).map(|r| (r.frame, r.node.0, r.row.line())).collect();
        assert_eq!(rows, [(7, 31, 2), (3, 0, 3)]);
    }

    #[test]
    fn what_makes_no_frames_is_named_by_line_and_value() {
        assert_eq!(failure("frame,node,x,y\n1,0,1,nan\n"), "t.csv, line 2: y is `nan`; a finite number was expected");
        assert!(failure("frame,node,x,y\n1,70000,1,1\n").starts_with("t.csv, line 2: node is `70000`"));
        assert!(failure("frame,node,x,y\n1,0,1,1\n1,2,1,1\n").starts_with("t.csv, line 3: node 2 where node 1 of frame 1"));
        assert!(failure("frame,node,x,y\n1,0,1,1\n").contains("at least 2 frames, from neutral to apex; found 1"));
        assert!(failure("frame,node,x,y\n2,0,1,1\n1,0,1,1\n").contains("frame 1 follows frame 2"));
        assert!(failure("frame,node,x,y\n1,0,1,1\n2,0,1,1\n2,1,1,1\n").contains("frame 2 has 2 nodes, but frame 1 has 1"));
        let csv = CsvFile::from_bytes(Path::new("t.csv"), b"frame,node,x\n".to_vec()).unwrap();
        assert!(PositionTable::new(csv).unwrap_err().to_string().starts_with("t.csv, line 1: has no column `y`"));
    }
}
