//! Reads and writes FAP values as a tidy CSV table: `frame,fap,name,value`, one row for every FAP that a frame sets.
//!
//! FAPs 1 and 2 have their integers in `value`, separated by blanks. If the last frame sets nothing, it has a row with only its
//! number. The table has no frame rate.

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use super::{
    catalog::{FapCatalog, FapNumber},
    interpolate::MAX_FRAMES,
    sequence::{FapFrame, FapSequence, VERSION, name_token},
};
use crate::{
    output::{OutputError, nine_digits, write_csv},
    text::{excerpt, message},
};

/// Error for a table that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TidyError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// An invalid row.
    #[error("{}:{line}: {reason}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What was found and what is expected.
        reason: String,
    },
}

#[derive(Serialize, Deserialize)]
struct Row {
    frame: String,
    fap: String,
    name: String,
    value: String,
}

/// Writes a sequence as a table, values with 9 significant digits.
///
/// # Errors
/// [`OutputError`] when the file cannot be written.
pub fn write_tidy_csv(path: &Path, sequence: &FapSequence) -> Result<(), OutputError> {
    let rows = sequence.frames.iter().enumerate().flat_map(|(index, frame)| {
        let empty = || Row { frame: index.to_string(), fap: String::new(), name: String::new(), value: String::new() };
        // The last frame determines the number of frames.
        let is_last = index + 1 == sequence.frames.len();
        let sets_nothing = is_last && FapNumber::all().all(|fap| !frame.is_set(fap));
        let set = FapCatalog::mpeg4().rows().iter().filter_map(move |row| {
            let fields = |fields: &[i32]| fields.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ");
            let value = frame.value(row.number).map(nine_digits).or_else(|| frame.fields(row.number).map(fields))?;
            Some(Row { frame: index.to_string(), fap: row.number.to_string(), name: row.name.clone(), value })
        });
        sets_nothing.then(empty).into_iter().chain(set)
    });
    write_csv(path, rows)
}

/// Reads a table. The sequence gets the name of the file and the frame rate `fps`.
///
/// Rows may be in any order. A frame without rows, or with a row of only its number, sets nothing. The column `name` may be
/// missing or empty.
///
/// # Errors
/// [`TidyError`] for a missing column, a FAP or frame that is no number, a name that belongs to another FAP, a value that is not
/// finite, a repeated row, or a table without rows.
pub fn read_tidy_csv(path: &Path, fps: f64) -> Result<FapSequence, TidyError> {
    let at = |line: u64, reason: String| TidyError::Row { path: path.to_owned(), line, reason };
    let bytes = crate::input::read_or_stdin(path).map_err(|source| TidyError::Io { path: path.to_owned(), source })?;
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&bytes);
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let headers = reader.headers().map_err(|e| at(1, e.to_string()))?.clone();
    let column = |name: &str| headers.iter().position(|header| header == name);
    let needed =
        |name: &str| column(name).ok_or_else(|| at(1, format!("there is no column `{name}`; expected `frame,fap,name,value`")));
    let (frame_column, fap_column, value_column) = (needed("frame")?, needed("fap")?, needed("value")?);
    let name_column = column("name");
    let mut frames: BTreeMap<usize, FapFrame> = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|e| at(e.position().map_or(0, csv::Position::line), e.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let text = |column: usize| record.get(column).unwrap_or_default();
        let number = text(frame_column).parse::<usize>().ok().filter(|&number| number < MAX_FRAMES);
        let number = number.ok_or_else(|| {
            at(line, format!("`{}` is not a frame number; expected 0 to {}", excerpt(text(frame_column)), MAX_FRAMES - 1))
        })?;
        if text(fap_column).is_empty() && text(value_column).is_empty() {
            frames.entry(number).or_default();
            continue;
        }
        let fap: FapNumber = text(fap_column).parse().map_err(|e| at(line, message(&format!("{e}")).into_owned()))?;
        let row = FapCatalog::mpeg4().row(fap);
        let name = name_column.map(text).filter(|name| !name.is_empty() && *name != row.name);
        if let Some(name) = name {
            return Err(at(line, format!("FAP {fap} is `{}`, not `{}`", row.name, excerpt(name))));
        }
        let frame = frames.entry(number).or_default();
        if frame.is_set(fap) {
            return Err(at(line, format!("FAP {fap} of frame {number} appears twice; keep one row")));
        }
        if fap.is_high_level() {
            frame.set_fields(fap, Some(fields(fap, text(value_column)).map_err(|reason| at(line, reason))?));
        } else {
            let value = text(value_column).parse::<f64>().ok().filter(|value| value.abs() <= f64::from(i32::MAX));
            let value =
                value.ok_or_else(|| at(line, format!("`{}` is not a finite number of 32 bits", excerpt(text(value_column)))))?;
            frame.set_value(fap, Some(value));
        }
    }
    let Some((&last, _)) = frames.last_key_value() else {
        return Err(at(1, "the table has no rows".to_owned()));
    };
    let frames = (0..=last).map(|k| frames.remove(&k).unwrap_or_default()).collect();
    let name = name_token(&path.file_stem().unwrap_or_default().to_string_lossy());
    Ok(FapSequence { version: VERSION.to_owned(), name, fps, frames })
}

/// Parses the integers of FAP 1 or 2.
fn fields(fap: FapNumber, text: &str) -> Result<Vec<i32>, String> {
    let count = FapCatalog::mpeg4().fields(fap).len();
    let fields: Option<Vec<i32>> = text.split_whitespace().map(|word| word.parse().ok()).collect();
    fields
        .filter(|fields| fields.len() == count || fields.len() == 1)
        .ok_or_else(|| format!("`{}` is no value of FAP {fap}; expected {count} integers (or 1)", excerpt(text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    fn read(text: &str) -> Result<FapSequence, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("joy.csv");
        std::fs::write(&path, text).unwrap();
        read_tidy_csv(&path, 25.0).map_err(|e| e.to_string().replace(&path.display().to_string(), "joy.csv"))
    }

    #[test]
    fn write_then_read_is_identity() {
        let mut frames = vec![FapFrame::default(); 3];
        frames[0].set_fields(fap(2), Some(vec![1, 63, 0, 0, 0, 1]));
        frames[0].set_value(fap(3), Some(-1.5));
        frames[2].set_value(fap(68), Some(7.0)); // frame 1 sets nothing
        let sequence = FapSequence { version: "2.1".into(), name: "joy".into(), fps: 25.0, frames };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("joy.csv");
        write_tidy_csv(&path, &sequence).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "frame,fap,name,value\n0,2,expression,1 63 0 0 0 1\n0,3,open_jaw,-1.5\n2,68,pull_r_ear,7\n");
        assert_eq!(read_tidy_csv(&path, 25.0).unwrap(), sequence);
    }

    #[test]
    fn order_bom_and_line_ends_do_not_matter() {
        let read = read("\u{feff}fap,value,frame\r\n4, 2 ,1\r\n3,1,0\r\n").unwrap();
        assert_eq!((read.frames[0].value(fap(3)), read.frames[1].value(fap(4))), (Some(1.0), Some(2.0)));
    }

    #[test]
    fn bad_rows_are_named() {
        let fails = |text: &str, expected: &str| {
            let error = read(text).unwrap_err();
            assert!(error.contains(expected), "{error}");
        };
        let header = "frame,fap,name,value\n";
        fails("", "joy.csv:1: there is no column `frame`");
        fails("frame,fap,name\n", "no column `value`");
        fails(header, "no rows");
        fails(&format!("{header}0,3,,1\n0,69,,1\n"), "joy.csv:3: `69` is not a FAP number");
        fails(&format!("{header}-1,3,,1\n"), "`-1` is not a frame number");
        fails(&format!("{header}99999999999,3,,1\n"), "not a frame number");
        fails(&format!("{header}0,3,jaw,1\n"), "FAP 3 is `open_jaw`, not `jaw`");
        fails(&format!("{header}0,3,,NaN\n"), "`NaN` is not a finite number");
        fails(&format!("{header}0,3,,1\n0,3,,2\n"), "appears twice");
        fails(&format!("{header}0,1,,1 2\n"), "expected 4 integers");
        fails(&format!("{header}0,3\n"), "joy.csv:2");
    }
}
