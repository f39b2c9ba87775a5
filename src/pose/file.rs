//! Head model files: JSON with the mean head, the modes of identity, and the expression shapes, as node positions and offsets.

use std::path::Path;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{NamedOffsets, learn::LearnedHead};
use crate::output::{OutputError, write_atomic};

/// Version of the schema of a head model file.
pub const HEAD_SCHEMA: u32 = 1;

/// Rounding of a length: 1e-5 model units are 0.002 % of the eye distance.
const DECIMALS: f64 = 1e5;

const UNITS: &str = "Candide-3 model unit in face space: x to the subject's left, y up, z out of the face, eye distance 0.613";

/// The head model embedded in the program.
const EMBEDDED: &str = include_str!("../../candide/head_model.json");

/// Origin of a head model.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeadOrigin {
    /// Program name and version.
    pub made_by: String,
    /// The command, with file names instead of paths.
    pub command: String,
    /// Number of identity modes of the source that were used, counted from the first.
    pub identity_modes: usize,
    /// BLAKE3 of the source arrays, in hexadecimal.
    pub blake3: String,
    /// Credit and licence of the heads.
    pub credit: String,
}

#[derive(Serialize, Deserialize)]
struct Expression {
    name: String,
    offsets: Vec<[f64; 3]>,
}

#[derive(Serialize, Deserialize)]
struct HeadFile {
    schema_version: u32,
    units: String,
    #[serde(flatten)]
    origin: HeadOrigin,
    mean: Vec<[f64; 3]>,
    identity: Vec<Vec<[f64; 3]>>,
    expressions: Vec<Expression>,
}

/// A head model file that does not make a head.
#[derive(Debug, thiserror::Error)]
pub enum HeadFileError {
    /// The file is not the JSON of a head model.
    #[error("the head model cannot be read: {0}")]
    Json(#[from] serde_json::Error),
    /// The content is not a valid head model.
    #[error("the head model cannot be read: {0}")]
    Content(String),
}

/// Writes a head model, with lengths rounded to 5 decimals and one shape per line.
///
/// # Errors
/// [`OutputError`] when the file cannot be written.
pub fn write_head(path: &Path, head: &LearnedHead, origin: &HeadOrigin) -> Result<(), OutputError> {
    let round = |v: f64| {
        let rounded = (v * DECIMALS).round() / DECIMALS;
        if rounded == 0.0 { 0.0 } else { rounded }
    };
    let line = |offsets: &[Vector3<f64>]| {
        let rows: Vec<[f64; 3]> = offsets.iter().map(|v| [round(v.x), round(v.y), round(v.z)]).collect();
        serde_json::to_string(&rows)
    };
    write_atomic(path, |out| {
        let text = |s: &str| serde_json::to_string(s);
        writeln!(out, "{{\n  \"schema_version\": {HEAD_SCHEMA},\n  \"units\": {},", text(UNITS)?)?;
        writeln!(out, "  \"made_by\": {},\n  \"command\": {},", text(&origin.made_by)?, text(&origin.command)?)?;
        writeln!(out, "  \"identity_modes\": {},\n  \"blake3\": {},", origin.identity_modes, text(&origin.blake3)?)?;
        writeln!(out, "  \"credit\": {},\n  \"mean\": {},\n  \"identity\": [", text(&origin.credit)?, line(&head.mean)?)?;
        let comma = |k: usize, of: usize| if k + 1 < of { "," } else { "" };
        for (k, mode) in head.identity.iter().enumerate() {
            writeln!(out, "    {}{}", line(mode)?, comma(k, head.identity.len()))?;
        }
        writeln!(out, "  ],\n  \"expressions\": [")?;
        for (k, shape) in head.expressions.iter().enumerate() {
            let comma = comma(k, head.expressions.len());
            writeln!(out, "    {{\"name\": {}, \"offsets\": {}}}{comma}", text(&shape.name)?, line(&shape.offsets)?)?;
        }
        writeln!(out, "  ]\n}}")
    })
}

fn parse(text: &str) -> Result<LearnedHead, HeadFileError> {
    let file: HeadFile = serde_json::from_str(text)?;
    if file.schema_version != HEAD_SCHEMA {
        let reason = format!("schema version {}; this program reads {HEAD_SCHEMA}", file.schema_version);
        return Err(HeadFileError::Content(reason));
    }
    let count = file.mean.len();
    let vectors = |what: &str, rows: &[[f64; 3]]| {
        if rows.len() != count {
            return Err(HeadFileError::Content(format!("{what} has {} nodes, but the mean has {count}", rows.len())));
        }
        Ok(rows.iter().map(|&v| Vector3::from(v)).collect::<Vec<_>>())
    };
    Ok(LearnedHead {
        mean: vectors("the mean", &file.mean)?,
        identity: file.identity.iter().map(|mode| vectors("a mode", mode)).collect::<Result<_, _>>()?,
        expressions: file
            .expressions
            .iter()
            .map(|e| Ok(NamedOffsets { name: e.name.clone(), offsets: vectors(&e.name, &e.offsets)? }))
            .collect::<Result<_, HeadFileError>>()?,
    })
}

/// Returns the head model embedded in the program.
pub(super) fn embedded() -> LearnedHead {
    parse(EMBEDDED).unwrap_or_else(|error| unreachable!("candide/head_model.json: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_is_written_and_read_back() {
        let shape = |x: f64| vec![Vector3::new(x, 0.5, -0.25), Vector3::new(0.0, 1.0, 2.0)];
        let head = LearnedHead {
            mean: shape(0.125),
            identity: vec![shape(1.0), shape(2.0)],
            expressions: vec![NamedOffsets { name: "smile".to_owned(), offsets: shape(3.0) }],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("head.json");
        let word = String::new;
        let origin = HeadOrigin { made_by: word(), command: word(), identity_modes: 2, blake3: word(), credit: "who".to_owned() };
        write_head(&path, &head, &origin).unwrap();
        assert_eq!(parse(&std::fs::read_to_string(&path).unwrap()).unwrap(), head);
    }

    #[test]
    fn shapes_of_other_lengths_are_refused() {
        let text = "{\"schema_version\":1,\"units\":\"\",\"made_by\":\"\",\"command\":\"\",\"identity_modes\":1,\"blake3\":\"\",\
                    \"credit\":\"\",\"mean\":[[0,0,0]],\"identity\":[[[0,0,0],[1,1,1]]],\"expressions\":[]}";
        assert!(parse(text).unwrap_err().to_string().contains("a mode has 2 nodes, but the mean has 1"));
        assert!(parse(&text.replace("_version\":1", "_version\":7")).unwrap_err().to_string().contains("schema version 7"));
    }
}
