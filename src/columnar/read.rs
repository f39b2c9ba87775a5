//! Reads models, either all at once or node by node.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use nalgebra::{Point2, Vector2};
use parquet::{
    basic::Type as PhysicalType,
    column::reader::{ColumnReader, get_typed_column_reader},
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type},
    errors::ParquetError,
    file::reader::{FileReader, SerializedFileReader},
};

use super::{
    ColumnarError, ID, NAMES, coordinate,
    lengths::{PageLengths, check_footer},
    number::Number,
    shared_file::SharedFile,
};
use crate::{
    foreign::caught,
    model::{DynamicExpressionModel, FrameExpressionModel},
    plausible::FaceSize,
    statistics::{
        NEUTRAL_TOLERANCE,
        scale::{SlotSource, SourceError},
    },
    text::message,
    units::{FaceUnit, NodeId, SequenceId},
};

/// Largest accepted ratio of a text column's bytes to the bytes of the file.
const MOST_TEXT: u64 = 64;

/// Checks the row counts: the row groups must add up to the file's count, and each row takes at least one byte.
fn check_rows(reader: &SerializedFileReader<SharedFile>, length: u64) -> Result<(), String> {
    let rows = reader.metadata().file_metadata().num_rows();
    let groups = reader.metadata().row_groups().iter().map(parquet::file::metadata::RowGroupMetaData::num_rows);
    let sum = groups.map(|rows| u64::try_from(rows).ok()).try_fold(0_u64, |sum, rows| sum.checked_add(rows?));
    if u64::try_from(rows).ok() == sum && sum.is_some_and(|sum| sum <= length) {
        Ok(())
    } else {
        Err(format!("{rows} rows in {length} bytes"))
    }
}

/// Returns axis, frame and node of a coordinate column's name, or `None` for other names.
pub(super) fn parse_coordinate(name: &str) -> Option<(usize, usize, usize)> {
    let mut parts = name.split('_');
    let axis = match parts.next()? {
        "x" => 0,
        "y" => 1,
        _ => return None,
    };
    let (frame, node) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
    parts.next().is_none().then_some((axis, frame, node))
}

/// An open file of models.
pub struct ColumnarModels {
    path: PathBuf,
    shared: SharedFile,
    reader: SerializedFileReader<SharedFile>,
    /// Sequence of each row.
    pub ids: Vec<SequenceId>,
    /// Emotion of each row.
    pub emotions: Vec<String>,
    /// Further text and number columns: name and values by row, as in a CSV table.
    pub metadata: BTreeMap<String, Vec<String>>,
    /// Names of further columns of other types: dates, decimal fractions, lists.
    pub not_read: Vec<String>,
    frames: usize,
    nodes: usize,
    /// Index of the column of frame m, node k, axis a, at position (m * nodes + k) * 2 + a.
    columns: Vec<usize>,
}

impl std::fmt::Debug for ColumnarModels {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ColumnarModels({}, {} rows)", self.path.display(), self.ids.len())
    }
}

impl ColumnarModels {
    /// Opens a file and reads subjects, sequences, emotions and further columns, but no coordinates.
    ///
    /// # Errors
    /// [`ColumnarError`] for a file that cannot be read, lacks a column, has a sequence twice, or has no rows.
    pub fn open(path: &Path) -> Result<Self, ColumnarError> {
        let io_error = |reason| ColumnarError::Io { path: path.to_owned(), reason };
        let file = crate::input::open_or_stdin(path).map_err(io_error)?;
        let length = file.metadata().map_err(io_error)?.len();
        let shared = SharedFile::new(file, length);
        let damaged = |reason: String| ColumnarError::Parquet { path: path.to_owned(), reason };
        let footer = shared.footer().map_err(io_error)?.ok_or_else(|| damaged("no Parquet footer at its end".to_owned()))?;
        check_footer(&footer).map_err(damaged)?;
        drop(footer);
        let reader =
            caught(|| SerializedFileReader::new(shared.clone())).map_err(damaged)?.map_err(|e| parquet_error(path, &e))?;
        check_rows(&reader, length).map_err(damaged)?;
        let schema = reader.metadata().file_metadata().schema_descr_ptr();
        let (mut numbers, mut texts) = (BTreeMap::new(), BTreeMap::new());
        let (mut further, mut not_read) = (Vec::new(), Vec::new());
        for (place, column) in schema.columns().iter().enumerate() {
            let is_flat = column.path().parts().len() == 1 && column.max_rep_level() == 0;
            match column.physical_type() {
                PhysicalType::DOUBLE if is_flat => drop(numbers.insert(column.name().to_owned(), place)),
                PhysicalType::BYTE_ARRAY if is_flat => drop(texts.insert(column.name().to_owned(), place)),
                _ => {}
            }
            let is_ours = parse_coordinate(column.name()).is_some() || NAMES.contains(&column.name()) || column.name() == ID;
            match Number::of(column).filter(|_| is_flat) {
                Some(number) if !is_ours => further.push((column.name().to_owned(), place, number)),
                None if !(is_flat && column.physical_type() == PhysicalType::BYTE_ARRAY) => {
                    not_read.extend(column.path().parts().first().cloned());
                }
                _ => {}
            }
        }
        let missing =
            |column: &str, expected| ColumnarError::Column { path: path.to_owned(), column: column.to_owned(), expected };
        let known = numbers.keys().filter_map(|name| parse_coordinate(name));
        let (frames, nodes) =
            known.fold((0, 0), |(f, n), (_, frame, node)| (f.max(frame.saturating_add(1)), n.max(node.saturating_add(1))));
        if frames < 2 || nodes > usize::from(u16::MAX) {
            return Err(missing("x_1_0", "double"));
        }
        // Column names may claim more coordinates than the file has columns.
        let all = frames.checked_mul(nodes * 2).filter(|&all| all <= numbers.len());
        let mut columns = Vec::with_capacity(all.unwrap_or(0));
        for (m, k, axis) in (0..frames).flat_map(|m| (0..nodes).flat_map(move |k| (0..2).map(move |axis| (m, k, axis)))) {
            let name = coordinate(axis, m, k);
            columns.push(*numbers.get(&name).ok_or_else(|| missing(&name, "double"))?);
        }
        let mut file = Self {
            path: path.to_owned(),
            shared,
            reader,
            ids: Vec::new(),
            emotions: Vec::new(),
            metadata: BTreeMap::new(),
            not_read,
            frames,
            nodes,
            columns,
        };
        let [subjects, sequences, emotions] = NAMES.map(|name| match texts.remove(name) {
            Some(place) => file.texts(place, name, false),
            None => Err(missing(name, "text")),
        });
        let id = |(subject, sequence): (String, String)| SequenceId {
            subject: subject.trim().to_owned(),
            sequence: sequence.trim().to_owned(),
        };
        file.ids = subjects?.into_iter().zip(sequences?).map(id).collect();
        // As in a manifest.
        file.emotions = emotions?.iter().map(|emotion| emotion.trim().to_lowercase()).collect();
        if let Some(row) = file.emotions.iter().position(String::is_empty) {
            return Err(ColumnarError::Missing { path: path.to_owned(), row: row + 1, column: NAMES[2].to_owned() });
        }
        for (name, place) in texts.into_iter().filter(|(name, _)| name != ID) {
            let values = file.texts(place, &name, true)?;
            file.metadata.insert(name, values);
        }
        for (name, place, number) in further {
            let values = file.numbers(place, &name, number)?;
            file.metadata.insert(name, values);
        }
        if file.ids.is_empty() {
            return Err(ColumnarError::Empty { path: path.to_owned() });
        }
        let mut seen = BTreeSet::new();
        if let Some(twice) = file.ids.iter().find(|id| !seen.insert(*id)) {
            return Err(ColumnarError::Duplicate { path: path.to_owned(), id: twice.to_string() });
        }
        drop(seen);
        Ok(file)
    }

    /// Returns the number of rows.
    pub fn row_count(&self) -> usize {
        self.ids.len()
    }

    /// Returns the number of nodes of every model.
    pub fn node_count(&self) -> usize {
        self.nodes
    }

    /// Returns the approximate memory for all models in bytes: positions, displacement vectors and names.
    pub fn memory(&self) -> u64 {
        (self.row_count() * (self.frames * self.nodes * 16 * 2 + 512)) as u64
    }

    /// Returns all values of a column. A null is an error.
    fn values<T: DataType>(&self, place: usize, name: &str) -> Result<Vec<T::T>, ColumnarError> {
        self.values_as::<T, _>(place, name, None, |value| value)
    }

    /// Returns all values of a column, converted by `make`. Nulls become `null`; if it is `None`, a null is an error.
    fn values_as<T: DataType, V: Clone>(
        &self,
        place: usize,
        name: &str,
        null: Option<&V>,
        make: impl Fn(T::T) -> V,
    ) -> Result<Vec<V>, ColumnarError> {
        let damaged = |reason| ColumnarError::Parquet { path: self.path.clone(), reason: format!("column `{name}`: {reason}") };
        let rows = self.reader.metadata().file_metadata().num_rows() as usize;
        let mut values = Vec::new();
        for group in 0..self.reader.num_row_groups() {
            self.check_pages(group, place).map_err(damaged)?;
            let before = values.len();
            let read = caught(|| self.group_values::<T, V>((group, place), null, &make, &mut values)).map_err(damaged)?;
            if let Some(missing) = read.map_err(|e| damaged(e.to_string()))? {
                return Err(ColumnarError::Missing {
                    path: self.path.clone(),
                    row: before + missing + 1,
                    column: name.to_owned(),
                });
            }
        }
        if values.len() == rows { Ok(values) } else { Err(damaged(format!("{} of {rows} rows", values.len()))) }
    }

    /// Appends one row group's values of a column to `values`. Nulls become `null`; if it is `None`, returns the row index within the
    /// group, from 0, of the first null.
    fn group_values<T: DataType, V: Clone>(
        &self,
        (group, place): (usize, usize),
        null: Option<&V>,
        make: &impl Fn(T::T) -> V,
        values: &mut Vec<V>,
    ) -> Result<Option<usize>, ParquetError> {
        let group = self.reader.get_row_group(group)?;
        let count = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
        let column: ColumnReader = group.get_column_reader(place)?;
        let mut column = get_typed_column_reader::<T>(column);
        let (mut levels, mut there) = (Vec::new(), Vec::new());
        let (mut read, mut last) = (0, usize::MAX);
        while read < count && last > 0 {
            levels.clear();
            let (records, _, _) = column.read_records(count - read, Some(&mut levels), None, &mut there)?;
            (read, last) = (read + records, records);
            let all = there.len() == records;
            let mut made = there.drain(..).map(make);
            match null {
                _ if all => values.extend(made),
                // Non-null values go to their own rows.
                Some(null) => values.extend(levels.iter().filter_map(|&l| if l == 0 { Some(null.clone()) } else { made.next() })),
                None => {
                    let null = levels.iter().position(|&level| level == 0).unwrap_or(0);
                    return Ok(Some(read - records + null));
                }
            }
        }
        Ok(None)
    }

    /// Checks the lengths in the page headers of one column in one row group.
    fn check_pages(&self, group: usize, place: usize) -> Result<(), String> {
        /// Bytes first read for a header, and their maximum. Most headers have a few dozen bytes.
        const FIRST: u64 = 1 << 10;
        const MOST: u64 = 1 << 24;
        let group = self.reader.metadata().row_group(group);
        let column = group.column(place);
        let rows = u64::try_from(group.num_rows()).unwrap_or(0);
        let start = column.dictionary_page_offset().unwrap_or_else(|| column.data_page_offset());
        let range = u64::try_from(start).ok().zip(u64::try_from(column.compressed_size()).ok());
        let range = range.and_then(|(start, length)| Some((start, start.checked_add(length)?)));
        let (mut at, end) = range
            .filter(|&(_, end)| end <= self.shared.length)
            .ok_or_else(|| format!("{} bytes at {start} of a file of {}", column.compressed_size(), self.shared.length))?;
        while at < end {
            let mut window = FIRST;
            let lengths = loop {
                let mut bytes = vec![0; (end - at).min(window) as usize];
                self.shared.read_at(at, &mut bytes).map_err(|e| e.to_string())?;
                match PageLengths::read(&bytes)? {
                    Some(lengths) => break lengths,
                    None if window < (end - at).min(MOST) => window *= 8,
                    None => return Err("the header of a page ends early".to_owned()),
                }
            };
            at += lengths.checked(end - at, rows)?;
        }
        Ok(())
    }

    /// Returns all values of a text column. With `may_be_null`, nulls are empty texts.
    fn texts(&self, place: usize, name: &str, may_be_null: bool) -> Result<Vec<String>, ColumnarError> {
        let empty = ByteArray::from("");
        let values = self.values_as::<ByteArrayType, _>(place, name, may_be_null.then_some(&empty), |value| value)?;
        // The file stores a text shared by many rows only once.
        let bytes: u64 = values.iter().map(|text: &ByteArray| text.len() as u64).sum();
        if bytes > self.shared.length.saturating_mul(MOST_TEXT) {
            let reason = format!("column `{name}`: {bytes} bytes of text from a file of {}", self.shared.length);
            return Err(ColumnarError::Parquet { path: self.path.clone(), reason });
        }
        Ok(values.iter().map(|text| String::from_utf8_lossy(text.data()).into_owned()).collect())
    }

    /// Returns all values of a number column as text, as in a CSV table. Nulls are empty.
    fn numbers(&self, place: usize, name: &str, number: Number) -> Result<Vec<String>, ColumnarError> {
        let null = Some(&String::new());
        match number {
            Number::Truth => self.values_as::<BoolType, _>(place, name, null, |value| value.to_string()),
            Number::Int { is_signed: true } => self.values_as::<Int32Type, _>(place, name, null, |value| value.to_string()),
            Number::Int { .. } => self.values_as::<Int32Type, _>(place, name, null, |v| v.cast_unsigned().to_string()),
            Number::Long { is_signed: true } => self.values_as::<Int64Type, _>(place, name, null, |value| value.to_string()),
            Number::Long { .. } => self.values_as::<Int64Type, _>(place, name, null, |v| v.cast_unsigned().to_string()),
            Number::Float => {
                self.values_as::<FloatType, _>(place, name, null, |v| if v.is_nan() { String::new() } else { v.to_string() })
            }
            Number::Double => {
                self.values_as::<DoubleType, _>(place, name, null, |v| if v.is_nan() { String::new() } else { v.to_string() })
            }
        }
    }

    /// Returns the positions of one node in one frame, by row.
    fn positions(&self, frame: usize, node: usize) -> Result<Vec<Point2<f64>>, ColumnarError> {
        let at = (frame * self.nodes + node) * 2;
        let [x, y] = [0, 1].map(|axis| self.values::<DoubleType>(self.columns[at + axis], &coordinate(axis, frame, node)));
        Ok(x?.into_iter().zip(y?).map(|(x, y)| Point2::new(x, y)).collect())
    }

    /// Returns all models, by row.
    ///
    /// # Errors
    /// [`ColumnarError`] for values that cannot be read or do not make a model.
    pub fn models(&self) -> Result<Vec<DynamicExpressionModel<FaceUnit>>, ColumnarError> {
        let mut rows = vec![vec![Vec::with_capacity(self.nodes); self.frames]; self.row_count()];
        for (m, k) in (0..self.frames).flat_map(|m| (0..self.nodes).map(move |k| (m, k))) {
            for (row, position) in rows.iter_mut().zip(self.positions(m, k)?) {
                row[m].push(position);
            }
        }
        let model = |(frames, id): (Vec<Vec<Point2<f64>>>, &SequenceId)| {
            let error = |reason: String| ColumnarError::Model { path: self.path.clone(), id: id.to_string(), reason };
            let model = DynamicExpressionModel::new(frames.into_iter().map(FrameExpressionModel::new).collect())
                .map_err(|e| error(e.to_string()))?;
            FaceSize::CANONICAL.check_model(&model).map_err(|e| error(e.to_string()))?;
            Ok(model)
        };
        rows.into_iter().zip(&self.ids).map(model).collect()
    }

    /// Returns the models of the given rows, for reading node by node.
    pub fn class<'a>(&'a self, mut rows: Vec<usize>, live: &'a [NodeId]) -> ColumnarClass<'a> {
        rows.sort_by(|&a, &b| self.ids[a].cmp(&self.ids[b]));
        ColumnarClass { file: self, rows, live }
    }
}

fn parquet_error(path: &Path, error: &ParquetError) -> ColumnarError {
    ColumnarError::Parquet { path: path.to_owned(), reason: message(&error.to_string()).into_owned() }
}

/// Models of a file in the order of their ids, read node by node.
#[derive(Debug)]
pub struct ColumnarClass<'a> {
    file: &'a ColumnarModels,
    rows: Vec<usize>,
    live: &'a [NodeId],
}

impl ColumnarClass<'_> {
    /// Returns the sequence ids in order.
    pub fn ids(&self) -> Vec<SequenceId> {
        self.rows.iter().map(|&row| self.file.ids[row].clone()).collect()
    }

    /// Returns all nodes of the first model's neutral frame. The other models are checked against it as they are read.
    ///
    /// # Errors
    /// [`ColumnarError`] for values that cannot be read.
    pub fn neutral(&self) -> Result<Vec<Point2<f64>>, ColumnarError> {
        let first = self.rows.first().copied().unwrap_or(0);
        (0..self.file.nodes).map(|k| self.file.positions(0, k).map(|column| column[first])).collect()
    }

    fn error(&self, row: usize, reason: &str) -> SourceError {
        SourceError { path: self.file.path.clone(), reason: format!("{}: {reason}", self.file.ids[row]) }
    }
}

impl SlotSource for ColumnarClass<'_> {
    fn model_count(&self) -> usize {
        self.rows.len()
    }

    fn node_count(&self) -> usize {
        self.live.len()
    }

    fn field_count(&self) -> usize {
        self.file.frames - 1
    }

    fn node(&self, k: usize) -> Result<Vec<Vec<Vector2<f64>>>, SourceError> {
        let node = self.live[k];
        let read = |frame| {
            let column = self.file.positions(frame, node.index());
            column.map_err(|e| SourceError { path: self.file.path.clone(), reason: e.to_string() })
        };
        let mut before = read(0)?;
        let first = self.rows.first().map(|&row| before[row]).unwrap_or_default();
        let is_off = |row: &&usize| !((before[**row] - first).norm() <= NEUTRAL_TOLERANCE);
        if let Some(&row) = self.rows.iter().find(is_off) {
            let reason = format!(
                "node {node} of the neutral frame is not at its place in {}; normalize all sequences with the same options",
                self.file.ids[self.rows[0]]
            );
            return Err(self.error(row, &reason));
        }
        let neutral = before.clone();
        let mut fields = Vec::with_capacity(self.field_count());
        for frame in 1..self.file.frames {
            let now = read(frame)?;
            for &row in &self.rows {
                let (offset, from) = (now[row] - neutral[row], "its place in the neutral frame");
                let checked = FaceSize::CANONICAL.check(frame as u32, || format!("node {node}"), offset, from);
                checked.map_err(|e| self.error(row, &e.to_string()))?;
            }
            fields.push(self.rows.iter().map(|&row| now[row] - before[row]).collect());
            before = now;
        }
        Ok(fields)
    }
}
