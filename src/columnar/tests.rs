use super::*;
use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    statistics::scale::SlotSource,
    units::{FaceUnit, NodeId, SequenceId},
};
use nalgebra::{Point2, Vector2};

/// Two frames over two nodes: neutral (0, 0) and (10, 0), moved by (x, 1) and (0, x).
fn model(x: f64) -> DynamicExpressionModel<FaceUnit> {
    let frame = |a: (f64, f64), b: (f64, f64)| FrameExpressionModel::new(vec![Point2::new(a.0, a.1), Point2::new(b.0, b.1)]);
    DynamicExpressionModel::new(vec![frame((0.0, 0.0), (10.0, 0.0)), frame((x, 1.0), (10.0, x))]).unwrap()
}

fn row(subject: &str, x: f64) -> ColumnarRow {
    let id = SequenceId { subject: subject.to_owned(), sequence: "1".to_owned() };
    ColumnarRow::new(id, "fear".to_owned(), vec![format!("<{subject}>")], &model(x))
}

fn written(rows: Vec<ColumnarRow>) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = ColumnarWriter::create(&folder.path().join("m.parquet"), &["note".to_owned()], 2, 2).unwrap();
    rows.into_iter().for_each(|row| writer.push(row).unwrap());
    writer.finish().unwrap();
    folder
}

#[test]
fn models_come_back_to_the_last_bit() {
    let x = 1.0 / 3.0;
    let folder = written(vec![row("a", x), row("b", -2.0), row("c", 0.1)]);
    let file = ColumnarModels::open(&folder.path().join("m.parquet")).unwrap();
    assert_eq!((file.row_count(), file.node_count()), (3, 2));
    assert_eq!(file.ids[1].to_string(), "b_1");
    assert_eq!((file.emotions[2].as_str(), file.metadata["note"][0].as_str()), ("fear", "<a>"));
    assert_eq!(file.models().unwrap(), [model(x), model(-2.0), model(0.1)]);
    // A class has its rows in the order of the ids, and reads them node by node.
    let live = [NodeId(0), NodeId(1)];
    let class = file.class(vec![2, 0], &live);
    assert_eq!(class.ids()[0].to_string(), "a_1");
    assert_eq!(class.node(0).unwrap(), [[Vector2::new(x, 1.0), Vector2::new(0.1, 1.0)]]);
    assert_eq!(class.neutral().unwrap(), [Point2::new(0.0, 0.0), Point2::new(10.0, 0.0)]);
}

#[test]
fn many_row_groups_are_one_column() {
    let count = GROUP_ROWS + 7;
    let folder = written((0..count).map(|i| row(&format!("{i:06}"), i as f64)).collect());
    let file = ColumnarModels::open(&folder.path().join("m.parquet")).unwrap();
    let live = [NodeId(1)];
    let class = file.class((0..count).collect(), &live);
    let node = class.node(0).unwrap();
    assert!(node[0].iter().enumerate().all(|(i, v)| *v == Vector2::new(0.0, i as f64)));
}

#[test]
fn the_same_rows_are_the_same_bytes() {
    let bytes = |folder: &tempfile::TempDir| std::fs::read(folder.path().join("m.parquet")).unwrap();
    assert_eq!(bytes(&written(vec![row("a", 1.0)])), bytes(&written(vec![row("a", 1.0)])));
}

#[test]
fn files_that_are_no_models_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let error = |name: &str| ColumnarModels::open(&folder.path().join(name)).unwrap_err().to_string();
    assert!(error("none").contains("No such file"));
    std::fs::write(folder.path().join("text"), "frame,node,x,y\n").unwrap();
    assert!(error("text").contains("this is not a readable Parquet file of models"));
    let good = written(vec![row("a", 1.0), row("b", 2.0)]);
    let bytes = std::fs::read(good.path().join("m.parquet")).unwrap();
    std::fs::write(folder.path().join("cut"), &bytes[..bytes.len() - 20]).unwrap();
    assert!(error("cut").contains("this is not a readable Parquet file of models"));
    let twice = written(vec![row("a", 1.0), row("a", 2.0)]);
    let error = ColumnarModels::open(&twice.path().join("m.parquet")).unwrap_err().to_string();
    assert!(error.ends_with("sequence a_1 appears twice; keep one row"), "{error}");
    let empty = written(vec![]);
    assert!(matches!(ColumnarModels::open(&empty.path().join("m.parquet")), Err(ColumnarError::Empty { .. })));
    // Implausible values are reported when they are read.
    let mut no_number = row("b", 1.0);
    // Frame 1, node 0, x.
    no_number.coordinates[4] = f64::NAN;
    let wild = written(vec![row("a", 1.0), no_number]);
    let file = ColumnarModels::open(&wild.path().join("m.parquet")).unwrap();
    assert!(file.models().unwrap_err().to_string().contains("b_1"));
    let live = [NodeId(0)];
    assert!(file.class(vec![0, 1], &live).node(0).unwrap_err().to_string().contains("b_1: frame 1: node 0 is (NaN, 1"));
    let mut writer = ColumnarWriter::create(&folder.path().join("odd"), &[], 3, 2).unwrap();
    assert!(matches!(writer.push(row("a", 1.0)), Err(ColumnarError::Shape { found: 8, expected: 12, .. })));
}

/// Reads everything that a file offers.
fn read_all(path: &std::path::Path) -> Result<usize, String> {
    let file = ColumnarModels::open(path).map_err(|e| e.to_string())?;
    let live: Vec<NodeId> = (0..file.node_count()).map(|k| NodeId(k as u16)).collect();
    let class = file.class((0..file.row_count()).collect(), &live);
    class.neutral().map_err(|e| e.to_string())?;
    live.iter().enumerate().try_for_each(|(k, _)| class.node(k).map(drop)).map_err(|e| e.to_string())?;
    file.models().map(|models| models.len()).map_err(|e| e.to_string())
}

#[test]
fn a_damaged_file_is_an_error_and_takes_no_memory() {
    let good = written(vec![row("a", 1.0), row("b", 2.0), row("c", 3.0)]);
    let path = good.path().join("m.parquet");
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(read_all(&path), Ok(3));
    let mut refused = 0;
    for place in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[place] ^= [0x01, 0x80, 0xFF][place % 3];
        std::fs::write(&path, &damaged).unwrap();
        // Values may have changed undetected. There must be no panic, and errors must name the file.
        if let Err(error) = read_all(&path) {
            refused += 1;
            assert!(error.contains("m.parquet"), "byte {place}: {error}");
        }
    }
    assert!(refused > bytes.len() / 3, "{refused} of {} damaged files refused", bytes.len());
}

#[test]
fn rows_and_pages_that_no_file_holds_are_refused() {
    let good = written(vec![row("a", 1.0), row("b", 2.0)]);
    let path = good.path().join("m.parquet");
    let bytes = std::fs::read(&path).unwrap();
    let error = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read_all(&path).unwrap_err()
    };
    // The footer's third field, the number of rows: i64, zigzag 2.
    let length = bytes.len();
    let footer = length - 8 - u32::from_le_bytes(bytes[length - 8..length - 4].try_into().unwrap()) as usize;
    let mut footers = bytes[footer..length - 8].to_vec();
    let rows = (0..footers.len()).rev().find(|&at| footers[at..].starts_with(&[0x16, 0x04, 0x19, 0x1C])).unwrap();
    footers.splice(rows + 1..=rows + 1, [0x80, 0x80, 0x80, 0x80, 0x40]);
    let many = [&bytes[..footer], &footers, &(footers.len() as u32).to_le_bytes(), b"PAR1"].concat();
    assert!(error(&many).contains("8589934592 rows in"), "{}", error(&many));
    // A column named after a very high frame must not allocate memory for all lower frames.
    let far = String::from_utf8_lossy(&bytes).contains("x_1_0");
    assert!(far, "names are stored unchanged");
    let renamed: Vec<u8> = {
        let mut bytes = bytes.clone();
        for at in 0..bytes.len() - 5 {
            if &bytes[at..at + 5] == b"x_1_0" {
                bytes[at..at + 5].copy_from_slice(b"x_9_9");
            }
        }
        bytes
    };
    assert!(error(&renamed).contains("has no column `x_0_2`"), "{}", error(&renamed));
    assert!(error(b"PAR1\xFF\xFF\xFF\x7FPAR1").contains("no Parquet footer"));
    assert!(error(b"PAR1").contains("no Parquet footer"));
}

/// A file as another program could write it: two models of one node that stays or moves by 1, and columns of every type.
fn foreign(path: &std::path::Path) {
    use parquet::{
        data_type::{BoolType, ByteArrayType, DoubleType, Int32Type, Int64Type},
        file::writer::SerializedFileWriter,
        schema::parser::parse_message_type,
    };
    let schema = "message models {
        required binary subject (UTF8); required binary sequence (UTF8); required binary emotion (UTF8);
        optional int32 age; required double weight; required boolean smoker; required int64 number (INTEGER(64, false));
        required int32 born (DATE); optional int64 all_null;
        required double x_0_0; required double y_0_0; required double x_1_0; required double y_1_0;
    }";
    let schema = std::sync::Arc::new(parse_message_type(schema).unwrap());
    let mut writer = SerializedFileWriter::new(std::fs::File::create(path).unwrap(), schema, std::sync::Arc::default()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    macro_rules! column {
        ($kind:ty, $values:expr) => {
            column!($kind, $values, None)
        };
        ($kind:ty, $values:expr, $levels:expr) => {{
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<$kind>().write_batch(&$values, $levels, None).unwrap();
            column.close().unwrap();
        }};
    }
    column!(ByteArrayType, ["a", "b"].map(Into::into));
    column!(ByteArrayType, ["1", "1"].map(Into::into));
    column!(ByteArrayType, ["joy", "joy"].map(Into::into));
    column!(Int32Type, [-34], Some(&[0, 1]));
    column!(DoubleType, [f64::NAN, 70.5]);
    column!(BoolType, [true, false]);
    column!(Int64Type, [-1, 3]);
    column!(Int32Type, [0, 1]);
    column!(Int64Type, [], Some(&[0, 0]));
    for values in [[0.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 0.0]] {
        column!(DoubleType, values);
    }
    group.close().unwrap();
    writer.close().unwrap();
}

#[test]
fn numbers_of_other_programs_are_columns_to_group_by() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs.parquet");
    foreign(&path);
    let file = ColumnarModels::open(&path).unwrap();
    assert_eq!(file.models().unwrap().len(), 2);
    let expected = [
        ("age", ["", "-34"]),
        ("all_null", ["", ""]),
        ("number", ["18446744073709551615", "3"]),
        ("smoker", ["true", "false"]),
        ("weight", ["", "70.5"]),
    ];
    let found: Vec<(&str, &[String])> = file.metadata.iter().map(|(name, values)| (name.as_str(), values.as_slice())).collect();
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for ((name, values), (expected_name, expected_values)) in found.into_iter().zip(expected) {
        assert_eq!((name, values), (expected_name, &expected_values.map(str::to_owned)[..]));
    }
    assert_eq!(file.not_read, ["born"]);
}
