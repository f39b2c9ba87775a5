//! Reads the marks of one picture in any supported form.

use std::path::{Path, PathBuf};

use nalgebra::Point2;

use super::{
    LANDMARK_COUNT, LandmarkSelection, LandmarksError, correspondences_from_landmarks,
    landmarks::{is_frame_file, read_points},
};
use crate::{
    correspondence::{Correspondence, CorrespondenceError, correspondences_of},
    input::{CsvFile, InputError},
    wireframe::Tables,
};

/// Why marks cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum MarksFileError {
    /// A table of nodes cannot be read.
    #[error(transparent)]
    Correspondences(#[from] CorrespondenceError),
    /// A `.pts` file cannot be read, or its landmarks lack a requested node.
    #[error(transparent)]
    Landmarks(#[from] LandmarksError),
    /// A table of points cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// The number of landmarks is not 68.
    #[error("{}: {found} landmarks; the points 0 to 67 were expected, each once", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Number of landmarks.
        found: usize,
    },
}

/// Reads the marks of a picture: `node,x,y[,kind,expected_error]`; or 68 landmarks, as `point,x,y` with points 0 to 67 or as a file of one
/// frame (`.pts`, or CK+'s lines `x y`). From landmarks, `selection` chooses those that become marks of nodes.
///
/// # Errors
/// `MarksFileError` for a file that has none of these forms or cannot be read.
pub fn read_marks(
    path: &Path,
    selection: &LandmarkSelection,
    tables: &Tables,
    node_count: usize,
) -> Result<Vec<Correspondence>, MarksFileError> {
    if is_frame_file(path) {
        return Ok(correspondences_from_landmarks(&read_points(path)?, tables, selection)?);
    }
    let file = CsvFile::open(path)?.or_semicolons(&["node", "point", "x", "y"])?;
    if file.column("node").is_some() || file.column("point").is_none() {
        return Ok(correspondences_of(&file, tables, node_count)?);
    }
    let [point, x, y] = file.require(["point", "x", "y"])?;
    let mut points = vec![None; LANDMARK_COUNT];
    for row in file.rows() {
        let row = row?;
        let number = row.whole_number(point)? as usize;
        let slot = points.get_mut(number).ok_or_else(|| row.field_error(point, "a landmark from 0 to 67"))?;
        if slot.is_some() {
            return Err(row.field_error(point, "a landmark that no line before it has").into());
        }
        *slot = Some(Point2::new(row.number(x)?, row.number(y)?));
    }
    let found = points.iter().flatten().count();
    let points: Option<Vec<Point2<f64>>> = points.into_iter().collect();
    let points = points.ok_or_else(|| MarksFileError::Count { path: path.to_owned(), found })?;
    Ok(correspondences_from_landmarks(&points, tables, selection)?)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::correspondence::MarkKind;

    #[test]
    fn marks_read_alike_in_every_form() {
        let folder = tempfile::tempdir().unwrap();
        let tables = Tables::candide3();
        let read = |name: &str, text: String| {
            let path = folder.path().join(name);
            fs::write(&path, text).unwrap();
            read_marks(&path, &LandmarkSelection::Default, &tables, 113).map_err(|e| e.to_string())
        };
        let points: String = (0..68).map(|k| format!("{k},{},{}\n", 10 * k, k * k)).collect();
        // A .pts file counts pixels from 1.
        let pts: String = (0..68).map(|k| format!("{} {}\n", 10 * k + 1, k * k + 1)).collect();
        let of_table = read("points.csv", format!("point,x,y\n{points}")).unwrap();
        let of_pts = read("face.pts", format!("version: 1\nn_points: 68\n{{\n{pts}}}\n")).unwrap();
        assert_eq!(of_table, of_pts);
        let lines: String = (0..68).map(|k| format!("{} {}\n", 10 * k, k * k)).collect();
        assert_eq!(of_table, read("face.txt", lines).unwrap());
        // The chin, node 10, is landmark 8.
        let chin = of_table.iter().find(|m| m.node.0 == 10).unwrap();
        assert_eq!((chin.position.x, chin.position.y), (80.0, 64.0));
        let nodes = read("nodes.csv", "node,x,y\n10,80,64\n".to_owned()).unwrap();
        assert_eq!((nodes[0].node, nodes[0].position), (chin.node, chin.position));
        // As written by a spreadsheet with decimal commas.
        let semicolons: String = (0..68).map(|k| format!("{k};{},0;{}\r\n", 10 * k, k * k)).collect();
        assert_eq!(of_table, read("semicolons.csv", format!("\u{feff}point;x;y\r\n{semicolons}")).unwrap());
        let halves = read("halves.csv", "y;x;node;kind\n64,5;80,25;10;hard\n".to_owned()).unwrap();
        assert_eq!((halves[0].position.x, halves[0].position.y, halves[0].kind), (80.25, 64.5, MarkKind::Hard));
        let half = read("half.csv", "node;x;y\n10;80,2,5;64\n".to_owned()).unwrap_err();
        assert!(half.ends_with("half.csv, line 2: x is `80,2,5`; a finite number was expected"), "{half}");
        assert!(read("few.csv", "point,x,y\n0,1,2\n".to_owned()).unwrap_err().contains("1 landmarks; the points 0 to 67"));
        let twice = read("twice.csv", format!("point,x,y\n{points}8,1,2\n")).unwrap_err();
        assert!(twice.contains("line 70") && twice.contains("that no line before it has"), "{twice}");
        assert!(read("bad.pts", "hello\n".to_owned()).unwrap_err().contains("bad.pts, line 1"));
        assert!(read("else.csv", "x,y\n1,2\n".to_owned()).unwrap_err().contains("has no column `node`"));
    }
}
