//! Correspondences: marked image points with their nodes, and their file `C.csv`.

use std::{collections::BTreeMap, fmt, path::Path};

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::{
    input::{CsvFile, InputError},
    output::{OutputError, nine_digits, write_durable},
    text::excerpt,
    units::NodeId,
    wireframe::{Tables, parse_node_or_feature_point},
};

/// Smallest number of correspondences that a fit accepts. Usual are 5 to 8 [KP, section 2].
///
/// ```
/// use grimace::correspondence::{MarksError, validate_correspondences};
///
/// assert_eq!(validate_correspondences(&[], 320, 320), Err(MarksError::TooFew { found: 0 }));
/// ```
pub const MINIMUM_MARKS: usize = 3;

/// Limit below which marks count as collinear: ratio of the smaller to the larger singular value of their centred positions.
pub const COLLINEAR_RATIO: f64 = 0.01;

/// How strictly the fit keeps a node at its correspondence.
///
/// ```
/// use grimace::{correspondence::{Correspondence, MarkKind}, units::NodeId};
/// use nalgebra::Point2;
///
/// let exact = Correspondence::hard(NodeId(10), Point2::new(149.5, 240.0));
/// assert_eq!(exact.kind, MarkKind::Hard);
/// assert_eq!(MarkKind::default().to_string(), "mark");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MarkKind {
    /// A marked point: it pulls its node with a spring force.
    #[default]
    Mark,
    /// A position set by hand after the fit: the node takes it exactly.
    Hard,
}

impl fmt::Display for MarkKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mark => "mark",
            Self::Hard => "hard",
        })
    }
}

/// A marked image point tied to a node.
///
/// ```
/// use grimace::{correspondence::{Correspondence, MarkKind}, units::NodeId};
/// use nalgebra::Point2;
///
/// let chin = Correspondence::mark(NodeId(10), Point2::new(149.5, 240.0));
/// assert_eq!((chin.kind, chin.expected_error), (MarkKind::Mark, None));
/// assert_eq!(Correspondence::found(NodeId(10), chin.position, 2.5).expected_error, Some(2.5));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// The node.
    pub node: NodeId,
    /// Marked position in image pixels, y down; the centre of the top-left pixel is (0, 0).
    pub position: Point2<f64>,
    /// Mark or hard position.
    pub kind: MarkKind,
    /// Expected error of the mark in px: its median distance from the true point. `None` for a mark set by hand, for which the fit
    /// assumes 0.019 of the eye distance.
    pub expected_error: Option<f64>,
}

impl Correspondence {
    /// Creates a mark set by hand.
    pub fn mark(node: NodeId, position: Point2<f64>) -> Self {
        Self { node, position, kind: MarkKind::Mark, expected_error: None }
    }

    /// Creates a position that the node takes exactly.
    pub fn hard(node: NodeId, position: Point2<f64>) -> Self {
        Self { node, position, kind: MarkKind::Hard, expected_error: None }
    }

    /// Creates a mark from a detector or another measurement, with its expected error in px.
    pub fn found(node: NodeId, position: Point2<f64>, expected_error: f64) -> Self {
        Self { expected_error: Some(expected_error), ..Self::mark(node, position) }
    }
}

/// Error for a correspondence file that cannot be read.
///
/// ```
/// use grimace::{correspondence::{CorrespondenceError, read_correspondences}, units::NodeId, wireframe::Tables};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("marks.csv");
/// std::fs::write(&path, "node,x,y\n10,149,240\n8.3,180,200\n10,150,241\n")?;
/// let error = read_correspondences(&path, &Tables::candide3(), 113).unwrap_err();
/// assert!(matches!(error, CorrespondenceError::DuplicateNode { line: 4, node: NodeId(10), first_line: 2, .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum CorrespondenceError {
    /// The file, a row or a number cannot be read, or a column is missing.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A node that does not exist.
    #[error("{file}, line {line}: {reason}")]
    Node {
        /// The file.
        file: String,
        /// Line number, from 1.
        line: usize,
        /// What was found and what was expected.
        reason: String,
    },
    /// Points of several faces, as `grimace locate` writes them, or of several frames.
    #[error(
        "{file}, line {line}: this row belongs to another {what} ({other}) than the lines before; keep the rows of one {what}"
    )]
    Several {
        /// The file.
        file: String,
        /// Line of the first row with a different picture or face, from 1.
        line: usize,
        /// `picture`, `face` or `frame`.
        what: &'static str,
        /// Value of the column in that row, shortened and printable.
        other: String,
    },
    /// A node has two rows.
    #[error("{file}, line {line}: node {node} is already in line {first_line}; keep one of the two")]
    DuplicateNode {
        /// The file.
        file: String,
        /// Line of the second row, from 1.
        line: usize,
        /// The node.
        node: NodeId,
        /// Line of the first row.
        first_line: usize,
    },
}

/// Why correspondences do not determine a fit to an image.
///
/// ```
/// use grimace::{correspondence::{Correspondence, MarksError, validate_correspondences}, units::NodeId};
/// use nalgebra::Point2;
///
/// // On one line, marks say nothing of the extent across it.
/// let marks = [10, 20, 30].map(|k| Correspondence::mark(NodeId(k), Point2::new(f64::from(k), f64::from(k))));
/// let error = validate_correspondences(&marks, 320, 320).unwrap_err();
/// assert!(matches!(error, MarksError::Collinear { count: 3, .. }));
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MarksError {
    /// Too few marks.
    #[error("{found} correspondences; at least {MINIMUM_MARKS} are needed, 5 to 8 give a good fit")]
    TooFew {
        /// Number of correspondences.
        found: usize,
    },
    /// A node marked twice.
    #[error("node {node} is marked twice; keep one of the two marks")]
    DuplicateNode {
        /// The node.
        node: NodeId,
    },
    /// A mark outside the image, or not a finite position.
    #[error(
        "node {node} is marked at ({x}, {y}), outside the image of {width} x {height} pixels \
         (x from -0.5 to {}, y from -0.5 to {}); are these the marks of another picture, or of this one at another size?", f64::from(*width) - 0.5, f64::from(*height) - 0.5
    )]
    OutsideImage {
        /// The node.
        node: NodeId,
        /// Its x, px.
        x: f64,
        /// Its y, px.
        y: f64,
        /// Image width, px.
        width: u32,
        /// Image height, px.
        height: u32,
    },
    /// Marks (nearly) on one line, which do not determine the size of the face across it.
    #[error(
        "the {count} marks lie on one line: their spread across it is {:.2} % of the spread along it, at least {} % is needed; \
         mark a point off the line, such as the chin", ratio * 100.0, COLLINEAR_RATIO * 100.0
    )]
    Collinear {
        /// Number of marks.
        count: usize,
        /// Smaller over larger singular value of the centred positions, 0 to 1.
        ratio: f64,
    },
}

/// Required columns.
const COLUMNS: [&str; 3] = ["node", "x", "y"];

/// Reads a correspondence file with the columns `node,x,y`.
///
/// Optional columns are `kind` (`mark`, the default, or `hard`) and `expected_error` (px, > 0, or empty); further columns are ignored.
/// Columns may be separated by semicolons; decimals then have commas.
///
/// `node` is a node number or an MPEG-4 feature point that is a single node. The order of the rows is kept. The number of marks and their
/// positions are not checked here but by [`validate_correspondences`].
///
/// ```
/// use grimace::{correspondence::read_correspondences, units::NodeId, wireframe::Tables};
///
/// let path = "fixtures/simulated/S001/005/correspondences.csv";
/// let marks = read_correspondences(path.as_ref(), &Tables::candide3(), 113)?;
/// assert_eq!((marks.len(), marks[0].node), (11, NodeId(20)));
/// assert_eq!((marks[0].position.x, marks[0].position.y), (214.112141, 135.557175));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`CorrespondenceError`] for a missing column, a value that is not a finite number, points of several pictures or faces, or a node that
/// does not exist or is listed twice.
pub fn read_correspondences(path: &Path, tables: &Tables, node_count: usize) -> Result<Vec<Correspondence>, CorrespondenceError> {
    correspondences_of(&CsvFile::open(path)?.or_semicolons(&COLUMNS)?, tables, node_count)
}

/// Reads correspondences from an open file, as [`read_correspondences`] does.
///
/// # Errors
/// As [`read_correspondences`].
pub(crate) fn correspondences_of(
    csv: &CsvFile,
    tables: &Tables,
    node_count: usize,
) -> Result<Vec<Correspondence>, CorrespondenceError> {
    let [node_column, x_column, y_column] = csv.require(COLUMNS)?;
    let kind_column = csv.column("kind");
    let error_column = csv.column("expected_error");
    let file = || csv.path().display().to_string();
    // A table written by `locate` can hold several pictures and faces, a track or a model several frames.
    let of_what = [("image", "picture"), ("face", "face"), ("frame", "frame")].map(|(name, what)| (csv.column(name), what));
    let mut first: Option<[String; 3]> = None;
    let mut line_of = BTreeMap::new();
    let mut correspondences = Vec::new();
    for row in csv.rows() {
        let row = row?;
        let line = row.line();
        let of_row = of_what.map(|(column, _)| column.map(|k| row.get(k).to_owned()).unwrap_or_default());
        let of_first = first.get_or_insert_with(|| of_row.clone());
        if let Some(k) = (0..of_row.len()).find(|&k| of_row[k] != of_first[k]) {
            return Err(CorrespondenceError::Several { file: file(), line, what: of_what[k].1, other: excerpt(&of_row[k]) });
        }
        let node = parse_node_or_feature_point(row.get(node_column), tables, node_count)
            .map_err(|reason| CorrespondenceError::Node { file: file(), line, reason })?;
        let position = Point2::new(row.number(x_column)?, row.number(y_column)?);
        let kind = match kind_column.map(|k| (k, row.get(k))) {
            None | Some((_, "" | "mark")) => MarkKind::Mark,
            Some((_, "hard")) => MarkKind::Hard,
            Some((k, _)) => return Err(row.field_error(k, "`mark` or `hard`").into()),
        };
        let expected_error = match error_column {
            Some(column) if !row.get(column).is_empty() => match row.number(column)? {
                error if error > 0.0 => Some(error),
                _ => return Err(row.field_error(column, "a distance in px above 0, or nothing").into()),
            },
            _ => None,
        };
        if let Some(first_line) = line_of.insert(node, line) {
            return Err(CorrespondenceError::DuplicateNode { file: file(), line, node, first_line });
        }
        correspondences.push(Correspondence { node, position, kind, expected_error });
    }
    Ok(correspondences)
}

/// Writes a correspondence file that [`read_correspondences`] reads.
///
/// Columns are `node,x,y,kind`, and `expected_error` if any mark has one. Rows are sorted by node; numbers have 9 significant digits.
///
/// ```
/// use grimace::{correspondence::{Correspondence, write_correspondences}, units::NodeId};
/// use nalgebra::Point2;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("marks.csv");
/// write_correspondences(&path, &[Correspondence::mark(NodeId(10), Point2::new(149.5, 240.0))])?;
/// assert_eq!(std::fs::read_to_string(&path)?, "node,x,y,kind\n10,149.5,240,mark\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`OutputError`] when the file cannot be written.
pub fn write_correspondences(path: &Path, correspondences: &[Correspondence]) -> Result<(), OutputError> {
    let mut sorted: Vec<_> = correspondences.iter().collect();
    sorted.sort_by_key(|c| c.node);
    let with_errors = sorted.iter().any(|c| c.expected_error.is_some());
    let written = write_durable(path, |writer| {
        writeln!(writer, "node,x,y,kind{}", if with_errors { ",expected_error" } else { "" })?;
        sorted.iter().try_for_each(|c| {
            write!(writer, "{},{},{},{}", c.node, nine_digits(c.position.x), nine_digits(c.position.y), c.kind)?;
            match c.expected_error {
                _ if !with_errors => writeln!(writer),
                Some(error) => writeln!(writer, ",{}", nine_digits(error)),
                None => writeln!(writer, ","),
            }
        })
    });
    written.map(|_| ())
}

/// Checks that correspondences (marks and hard positions together) determine a fit to an image of the given size in pixels.
///
/// Pixels extend half a pixel around their centres: a mark must lie in [-0.5, width - 0.5] x [-0.5, height - 0.5].
///
/// ```
/// use grimace::{correspondence::{Correspondence, validate_correspondences}, units::NodeId};
/// use nalgebra::Point2;
///
/// let mark = |node, x, y| Correspondence::mark(NodeId(node), Point2::new(x, y));
/// let marks = [mark(20, 214.0, 136.0), mark(53, 114.0, 140.0), mark(10, 165.0, 250.0)];
/// assert!(validate_correspondences(&marks, 320, 320).is_ok());
/// let error = validate_correspondences(&marks, 160, 160).unwrap_err();
/// assert!(error.to_string().starts_with("node 20 is marked at (214, 136), outside the image of 160 x 160 pixels"));
/// ```
///
/// # Errors
/// [`MarksError`] for the first of these that applies: fewer than 3 correspondences, a node marked twice, a mark outside the image,
/// collinear marks (smaller singular value of their centred positions below 0.01 of the larger one).
pub fn validate_correspondences(correspondences: &[Correspondence], width: u32, height: u32) -> Result<(), MarksError> {
    let count = correspondences.len();
    if count < MINIMUM_MARKS {
        return Err(MarksError::TooFew { found: count });
    }
    if let Some(node) = marked_twice(correspondences) {
        return Err(MarksError::DuplicateNode { node });
    }
    let inside = |value: f64, size: u32| value >= -0.5 && value <= f64::from(size) - 0.5;
    if let Some(c) = correspondences.iter().find(|c| !(inside(c.position.x, width) && inside(c.position.y, height))) {
        return Err(MarksError::OutsideImage { node: c.node, x: c.position.x, y: c.position.y, width, height });
    }
    let ratio = singular_value_ratio(correspondences);
    if ratio < COLLINEAR_RATIO { Err(MarksError::Collinear { count, ratio }) } else { Ok(()) }
}

/// Returns the lowest node that is marked more than once.
pub(crate) fn marked_twice(marks: &[Correspondence]) -> Option<NodeId> {
    let mut nodes: Vec<NodeId> = marks.iter().map(|mark| mark.node).collect();
    nodes.sort_unstable();
    nodes.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0])
}

/// Returns the ratio of the smaller to the larger singular value of the centred positions; 0 when all coincide.
fn singular_value_ratio(correspondences: &[Correspondence]) -> f64 {
    let mean = correspondences.iter().map(|c| c.position.coords).sum::<nalgebra::Vector2<f64>>() / correspondences.len() as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for c in correspondences {
        let p = c.position.coords - mean;
        xx += p.x * p.x;
        xy += p.x * p.y;
        yy += p.y * p.y;
    }
    let larger = 0.5 * (xx + yy + (xx - yy).hypot(2.0 * xy));
    if larger > 0.0 { ((xx * yy - xy * xy).max(0.0)).sqrt() / larger } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use proptest::prelude::*;

    use super::*;

    fn read(text: &[u8]) -> Result<Vec<Correspondence>, String> {
        let csv = CsvFile::from_bytes(Path::new("C.csv"), text.to_vec()).map_err(|e| e.to_string())?;
        correspondences_of(&csv, &Tables::candide3(), 113).map_err(|e| e.to_string())
    }

    fn mark(node: u16, x: f64, y: f64) -> Correspondence {
        Correspondence::mark(NodeId(node), Point2::new(x, y))
    }

    #[test]
    fn nodes_feature_points_and_kinds_are_read() {
        let text = b"\xEF\xBB\xBFlabel,y,x,node,kind\r\nchin,20.5,10,10,\r\ncorner,3,4,8.3,hard\r\n";
        let hard = Correspondence { kind: MarkKind::Hard, ..mark(31, 4.0, 3.0) };
        assert_eq!(read(text), Ok(vec![mark(10, 10.0, 20.5), hard]));
        assert_eq!(read(b"node,x,y\n"), Ok(vec![]), "the count is checked by validation");
    }

    #[test]
    fn errors_name_file_line_and_value() {
        let message = |text: &[u8]| read(text).unwrap_err();
        assert!(message(b"node,x\n1,2\n").starts_with("C.csv, line 1: has no column `y`; found `node`, `x`"));
        assert!(message(b"node,x,y\n1,2,3\n2,a,3\n").starts_with("C.csv, line 3: x is `a`; a finite number was expected"));
        assert!(message(b"node,x,y\n1,NaN,3\n").contains("x is `NaN`"));
        assert!(message(b"node,x,y\n1,2,-inf\n").contains("y is `-inf`"));
        assert_eq!(message(b"node,x,y\n113,2,3\n"), "C.csv, line 2: node 113 does not exist; the wireframe has nodes 0 to 112");
        assert!(message(b"node,x,y\n3.5,2,3\n").contains("the middle of nodes 67, 68, 71, 72, not a single node"));
        // Feature point 8.3 is node 31.
        assert_eq!(message(b"node,x,y\n8.3,2,3\n\n31,2,3\n"), "C.csv, line 4: node 31 is already in line 2; keep one of the two");
        // Of a track or a model.
        let frames = message(b"frame,node,x,y\n1,10,2,3\n2,10,2,3\n");
        assert!(
            frames.ends_with("this row belongs to another frame (2) than the lines before; keep the rows of one frame"),
            "{frames}"
        );
        assert!(message(b"node,x,y,kind\n1,2,3,soft\n").contains("kind is `soft`; `mark` or `hard` was expected"));
        assert!(message(b"").contains("is empty"));
        assert_eq!(
            message(b"image,face,node,x,y\na.jpg,1,31,2,3\nb.jpg,1,31,2,3\n"),
            "C.csv, line 3: this row belongs to another picture (b.jpg) than the lines before; keep the rows of one picture"
        );
        assert!(message(b"node,x,y\n\xE9,2,3\n").contains("not UTF-8"));
    }

    #[test]
    fn too_few_outside_and_twice_are_refused() {
        let corners = [mark(0, -0.5, -0.5), mark(1, 639.5, 0.0), mark(2, 0.0, 479.5)];
        assert_eq!(validate_correspondences(&corners, 640, 480), Ok(()));
        assert_eq!(validate_correspondences(&corners[..2], 640, 480), Err(MarksError::TooFew { found: 2 }));
        let error = validate_correspondences(&corners, 640, 479).unwrap_err();
        assert_eq!(
            error.to_string(),
            "node 2 is marked at (0, 479.5), outside the image of 640 x 479 pixels (x from -0.5 to 639.5, y from -0.5 to 478.5); \
             are these the marks of another picture, or of this one at another size?"
        );
        let nan = [corners[0], corners[1], mark(5, f64::NAN, 1.0)];
        assert!(matches!(validate_correspondences(&nan, 640, 480), Err(MarksError::OutsideImage { node: NodeId(5), .. })));
        let twice = [corners[0], corners[1], mark(0, 9.0, 99.0)];
        assert_eq!(validate_correspondences(&twice, 640, 480), Err(MarksError::DuplicateNode { node: NodeId(0) }));
    }

    #[test]
    fn marks_on_a_line_are_refused() {
        // (0, 0), (100, 0), (200, 0) and (100, h): centred on (100, h/4), the scatter is diag(20000, 3/4 h^2), so the ratio of
        // singular values is h sqrt(0.75 / 20000) = 0.00612 h: h = 1 is under 1 %, h = 2 over.
        let marks = |h| [mark(0, 0.0, 0.0), mark(1, 100.0, 0.0), mark(2, 200.0, 0.0), mark(3, 100.0, h)];
        match validate_correspondences(&marks(1.0), 640, 480).unwrap_err() {
            MarksError::Collinear { count, ratio } => {
                assert_eq!(count, 4);
                approx::assert_relative_eq!(ratio, (0.75_f64 / 20000.0).sqrt(), epsilon = 1e-12);
            }
            other => panic!("{other}"),
        }
        assert_eq!(validate_correspondences(&marks(2.0), 640, 480), Ok(()));
        let one_place = [mark(0, 5.0, 5.0), mark(1, 5.0, 5.0), mark(2, 5.0, 5.0)];
        assert_eq!(validate_correspondences(&one_place, 640, 480), Err(MarksError::Collinear { count: 3, ratio: 0.0 }));
    }

    #[test]
    fn writing_is_sorted_and_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("C.csv");
        let hard = Correspondence { kind: MarkKind::Hard, ..mark(31, 4.25, -0.0) };
        write_correspondences(&path, &[hard, mark(10, 1.0 / 3.0, 20.0)]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "node,x,y,kind\n10,0.333333333,20,mark\n31,4.25,0,hard\n");
        let read = read_correspondences(&path, &Tables::candide3(), 113).unwrap();
        assert_eq!(read, [mark(10, 0.333_333_333, 20.0), Correspondence { position: Point2::new(4.25, 0.0), ..hard }]);
    }

    #[test]
    fn expected_errors_are_read_and_written() {
        let found = Correspondence::found(NodeId(10), Point2::new(1.0, 2.0), 2.5);
        assert_eq!(read(b"node,x,y,expected_error\n10,1,2,2.5\n31,3,4,\n"), Ok(vec![found, mark(31, 3.0, 4.0)]));
        for bad in ["0", "-1", "x", "inf"] {
            let error = read(format!("node,x,y,expected_error\n10,1,2,{bad}\n").as_bytes()).unwrap_err();
            assert!(error.starts_with("C.csv, line 2: expected_error is"), "{error}");
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("C.csv");
        write_correspondences(&path, &[mark(31, 3.0, 4.0), found]).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "node,x,y,kind,expected_error\n10,1,2,mark,2.5\n31,3,4,mark,\n");
        assert_eq!(read_correspondences(&path, &Tables::candide3(), 113).unwrap(), [found, mark(31, 3.0, 4.0)]);
    }

    proptest! {
        #[test]
        fn collinearity_does_not_depend_on_place_turn_or_size(
            angle in 0.0..6.3_f64, scale in 0.5..20.0_f64, h in 0.0..50.0_f64, shift in -100.0..100.0_f64,
        ) {
            let base = [(0.0, 0.0), (10.0, h), (25.0, 0.0), (40.0, 3.0)];
            let rotation = nalgebra::Rotation2::new(angle);
            let plain: Vec<_> = base.iter().zip(0..).map(|(&(x, y), n)| mark(n, x, y)).collect();
            let moved: Vec<_> = plain
                .iter()
                .map(|c| Correspondence { position: rotation * c.position * scale + nalgebra::Vector2::new(shift, -shift), ..*c })
                .collect();
            prop_assert!((singular_value_ratio(&plain) - singular_value_ratio(&moved)).abs() < 1e-9);
        }

        #[test]
        fn any_text_reads_or_fails_without_a_panic(text in "(node,x,y(,kind)?\n)?[0-9a-z.,\"\n-]{0,80}") {
            let _ = read(text.as_bytes());
        }
    }
}
