//! Tables, written as CSV with full precision and as Markdown for reading.

use std::{fmt::Write as _, path::Path};

use grimace::internal::output::{OutputError, nine_digits, write_atomic};

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Text.
    Text(String),
    /// An integer.
    Count(usize),
    /// A number with its decimals in Markdown; CSV has nine significant digits.
    Number(f64, usize),
    /// No value.
    Empty,
}

impl Cell {
    /// Makes a cell of text.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// Makes a cell of a number, or an empty cell for `None`.
    pub fn maybe(value: Option<f64>, decimals: usize) -> Self {
        value.map_or(Self::Empty, |v| Self::Number(v, decimals))
    }

    fn csv(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Count(count) => count.to_string(),
            Self::Number(value, _) => nine_digits(*value),
            Self::Empty => String::new(),
        }
    }

    fn markdown(&self) -> String {
        match self {
            Self::Text(text) => text.replace('|', "\\|"),
            Self::Count(count) => count.to_string(),
            Self::Number(value, decimals) => format!("{value:.decimals$}"),
            Self::Empty => String::new(),
        }
    }
}

/// A table: a header, and rows with one cell for each column.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Column names with their units.
    pub header: Vec<String>,
    /// Rows.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// Makes a table without rows.
    pub fn new<S: Into<String>>(header: impl IntoIterator<Item = S>) -> Self {
        Self { header: header.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Writes the table as CSV.
    ///
    /// # Errors
    /// [`OutputError`] when the file cannot be written.
    pub fn write_csv(&self, path: &Path) -> Result<(), OutputError> {
        write_atomic(path, |writer| {
            let mut csv = grimace::internal::output::csv_writer(writer);
            csv.write_record(&self.header)?;
            for row in &self.rows {
                csv.write_record(row.iter().map(Cell::csv))?;
            }
            csv.flush()
        })
    }

    /// Returns the table in Markdown, with aligned columns and numbers to the right.
    pub fn markdown(&self) -> String {
        let cells: Vec<Vec<String>> = self.rows.iter().map(|row| row.iter().map(Cell::markdown).collect()).collect();
        let width = |k: usize| {
            let body = cells.iter().filter_map(|row| row.get(k)).map(|c| c.chars().count());
            body.chain([self.header[k].chars().count(), 3]).max().unwrap_or(3)
        };
        let widths: Vec<usize> = (0..self.header.len()).map(width).collect();
        let is_text = |k: usize| self.rows.iter().any(|row| matches!(row.get(k), Some(Cell::Text(_))));
        let left: Vec<bool> = (0..self.header.len()).map(is_text).collect();
        let mut out = String::new();
        let mut line = |row: &[String]| {
            for (k, cell) in row.iter().enumerate() {
                let width = widths.get(k).copied().unwrap_or(0);
                let padded = if left.get(k) == Some(&true) { format!("{cell:<width$}") } else { format!("{cell:>width$}") };
                let _ = write!(out, "| {padded} ");
            }
            out.push_str("|\n");
        };
        line(&self.header);
        let rule: Vec<String> =
            widths.iter().zip(&left).map(|(&w, &l)| if l { "-".repeat(w) } else { format!("{}:", "-".repeat(w - 1)) }).collect();
        line(&rule);
        cells.iter().for_each(|row| line(row));
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new(["name", "error (px)", "n"]);
        table.rows.push(vec![Cell::text("a|b, c"), Cell::Number(1.0 / 3.0, 2), Cell::Count(12)]);
        table.rows.push(vec![Cell::text("d"), Cell::Empty, Cell::Count(3)]);
        table
    }

    #[test]
    fn markdown_lines_up_and_escapes_bars() {
        let expected = "| name    | error (px) |   n |\n| ------- | ---------: | --: |\n| a\\|b, c |       0.33 |  12 |\n| d       |            |   3 |\n";
        assert_eq!(table().markdown(), expected);
    }

    #[test]
    fn csv_has_nine_digits_and_quotes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        table().write_csv(&path).unwrap();
        assert_eq!(std::fs::read_to_string(path).unwrap(), "name,error (px),n\n\"a|b, c\",0.333333333,12\nd,,3\n");
    }
}
