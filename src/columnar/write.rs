//! Writes models, one row group at a time.

use std::{path::Path, path::PathBuf, sync::Arc};

use parquet::{
    basic::{LogicalType, Repetition, Type as PhysicalType},
    data_type::{ByteArray, ByteArrayType, DoubleType},
    file::{
        metadata::KeyValue,
        properties::{EnabledStatistics, WriterProperties},
        writer::SerializedFileWriter,
    },
    schema::types::{ColumnPath, Type, TypePtr},
};

use super::{ColumnarError, GROUP_ROWS, ID, NAMES, SCHEMA_VERSION, coordinate};
use crate::{
    model::DynamicExpressionModel,
    output::{OutputError, PendingFile, beside_ours},
    units::{FaceUnit, SequenceId},
};

/// One model as a row.
#[derive(Clone, Debug)]
pub struct ColumnarRow {
    /// Subject and sequence.
    pub id: SequenceId,
    /// Emotion.
    pub emotion: String,
    /// Values of the further columns, in their order.
    pub metadata: Vec<String>,
    /// x and y of every node of every frame: frame 0 node 0 x, y, node 1 x, y, ...
    pub coordinates: Vec<f64>,
}

impl ColumnarRow {
    /// Creates the row of a model.
    pub fn new(id: SequenceId, emotion: String, metadata: Vec<String>, model: &DynamicExpressionModel<FaceUnit>) -> Self {
        let coordinates = model.frames().iter().flat_map(|f| f.nodes().iter().flat_map(|p| [p.x, p.y])).collect();
        Self { id, emotion, metadata, coordinates }
    }
}

/// Writes models to a file. Rows must come sorted by id. The file appears under its name only with [`ColumnarWriter::finish`].
pub struct ColumnarWriter {
    path: PathBuf,
    writer: SerializedFileWriter<PendingFile>,
    texts: usize,
    coordinates: usize,
    rows: Vec<ColumnarRow>,
}

impl ColumnarWriter {
    /// Creates a file for models with the given numbers of frames and nodes, and further text columns `metadata`.
    ///
    /// # Errors
    /// [`ColumnarError`] when the file cannot be created.
    pub fn create(path: &Path, metadata: &[String], frames: usize, nodes: usize) -> Result<Self, ColumnarError> {
        let pending = PendingFile::create(path).map_err(unwritable)?;
        let error = |e: parquet::errors::ParquetError| ColumnarError::Parquet { path: path.to_owned(), reason: e.to_string() };
        let mut fields: Vec<TypePtr> = Vec::new();
        let names = NAMES.iter().chain([&ID]).map(|&name| name.to_owned());
        let is_ours = |name: &str| NAMES.contains(&name) || name == ID || super::read::parse_coordinate(name).is_some();
        for name in names.chain(beside_ours(metadata, is_ours)) {
            let text = Type::primitive_type_builder(&name, PhysicalType::BYTE_ARRAY)
                .with_repetition(Repetition::REQUIRED)
                .with_logical_type(Some(LogicalType::String));
            fields.push(Arc::new(text.build().map_err(error)?));
        }
        let texts = fields.len();
        let mut properties = WriterProperties::builder()
            .set_created_by(crate::output::MADE_BY.to_owned())
            .set_key_value_metadata(Some(notes()))
            .set_statistics_enabled(EnabledStatistics::None)
            .set_offset_index_disabled(true)
            .set_max_row_group_row_count(Some(GROUP_ROWS));
        for (m, k) in (0..frames).flat_map(|m| (0..nodes).map(move |k| (m, k))) {
            for axis in 0..2 {
                let name = coordinate(axis, m, k);
                let number = Type::primitive_type_builder(&name, PhysicalType::DOUBLE).with_repetition(Repetition::REQUIRED);
                fields.push(Arc::new(number.build().map_err(error)?));
                // The neutral frame is the same in every row; other values do not repeat.
                properties = properties.set_column_dictionary_enabled(ColumnPath::from(name), m == 0);
            }
        }
        let coordinates = fields.len() - texts;
        let schema = Arc::new(Type::group_type_builder("models").with_fields(fields).build().map_err(error)?);
        let writer = SerializedFileWriter::new(pending, schema, Arc::new(properties.build())).map_err(error)?;
        Ok(Self { path: path.to_owned(), writer, texts, coordinates, rows: Vec::new() })
    }

    /// Adds a model.
    ///
    /// # Errors
    /// [`ColumnarError::Shape`] for a wrong number of coordinates; [`ColumnarError::Parquet`] when the disk is full.
    pub fn push(&mut self, row: ColumnarRow) -> Result<(), ColumnarError> {
        if row.coordinates.len() != self.coordinates {
            return Err(ColumnarError::Shape {
                id: row.id.to_string(),
                found: row.coordinates.len(),
                expected: self.coordinates,
            });
        }
        self.rows.push(row);
        if self.rows.len() == GROUP_ROWS { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), ColumnarError> {
        if self.rows.is_empty() {
            return Ok(());
        }
        let rows = std::mem::take(&mut self.rows);
        let (texts, path) = (self.texts, self.path.clone());
        let error = |e: parquet::errors::ParquetError| ColumnarError::Parquet { path: path.clone(), reason: e.to_string() };
        let mut group = self.writer.next_row_group().map_err(error)?;
        let mut place = 0;
        let mut numbers = Vec::with_capacity(rows.len());
        while let Some(mut column) = group.next_column().map_err(error)? {
            if place < texts {
                let text = |row: &ColumnarRow| match place {
                    0 => row.id.subject.clone(),
                    1 => row.id.sequence.clone(),
                    2 => row.emotion.clone(),
                    3 => row.id.to_string(),
                    further => row.metadata.get(further - NAMES.len() - 1).cloned().unwrap_or_default(),
                };
                let values: Vec<ByteArray> = rows.iter().map(|row| ByteArray::from(text(row).into_bytes())).collect();
                column.typed::<ByteArrayType>().write_batch(&values, None, None).map_err(error)?;
            } else {
                numbers.clear();
                numbers.extend(rows.iter().map(|row| row.coordinates[place - texts]));
                column.typed::<DoubleType>().write_batch(&numbers, None, None).map_err(error)?;
            }
            column.close().map_err(error)?;
            place += 1;
        }
        group.close().map_err(error)?;
        Ok(())
    }

    /// Writes the remaining rows, moves the file to its final path and returns the BLAKE3 hash of its bytes.
    ///
    /// # Errors
    /// [`ColumnarError`] when the file cannot be written.
    pub fn finish(mut self) -> Result<blake3::Hash, ColumnarError> {
        self.flush()?;
        let path = self.path;
        let pending = self.writer.into_inner().map_err(|e| ColumnarError::Parquet { path, reason: e.to_string() })?;
        pending.persist().map_err(unwritable)
    }
}

/// Returns the file's metadata: program, schema version, unit and meaning of the columns.
fn notes() -> Vec<KeyValue> {
    let note = |key: &str, value: &str| KeyValue::new(key.to_owned(), value.to_owned());
    vec![
        note("grimace.made_by", crate::output::MADE_BY),
        note("grimace.schema_version", SCHEMA_VERSION),
        note("grimace.unit", <FaceUnit as crate::units::Unit>::NAME),
        note("grimace.columns", "x_M_K, y_M_K: node K in frame M from 0, x to the subject's left, y up"),
    ]
}

fn unwritable(error: OutputError) -> ColumnarError {
    ColumnarError::Io { path: error.path, reason: error.source }
}
