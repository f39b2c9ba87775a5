//! Reads and writes `.npy` arrays (`NumPy`): real numbers as `f32`, integers as indices.

use std::{
    fs::File,
    io::{self, BufReader, Read, Write},
    path::{Path, PathBuf},
};

use npyz::{NpyFile, NpyReader, Order, WriterBuilder};

use super::MeshFileError;
use crate::foreign::caught;

/// A whole array in memory, C order.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyArray<T> {
    /// Sizes, outermost first.
    pub shape: Vec<usize>,
    /// Values; the last index varies fastest.
    pub data: Vec<T>,
}

/// Longest header accepted, bytes, and largest number of digits in its shape: files of greater sizes do not exist.
const MAX_HEADER: u32 = 1 << 20;
const MAX_SHAPE_DIGITS: usize = 18;

type Source = BufReader<File>;

/// Reads a real array block by block (a block is one index of the outermost dimension), with at most one block in memory.
pub struct NpyRows {
    path: PathBuf,
    shape: Vec<usize>,
    values: Values,
}

enum Values {
    Single(NpyReader<f32, Source>),
    Double(NpyReader<f64, Source>),
}

impl NpyRows {
    /// Sizes, outermost first.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Reads the values of the next block. NaN and infinity are not refused.
    ///
    /// # Errors
    /// [`MeshFileError`] when the file ends early.
    pub fn next_block(&mut self) -> Result<Vec<f32>, MeshFileError> {
        let count = self.shape.iter().skip(1).product::<usize>();
        let io = MeshFileError::io(&self.path);
        let values: io::Result<Vec<f32>> = match &mut self.values {
            Values::Single(reader) => reader.take(count).collect(),
            Values::Double(reader) => reader.take(count).map(|v| v.map(|v| v as f32)).collect(),
        };
        let values = values.map_err(io)?;
        if values.len() < count {
            return Err(MeshFileError::format(&self.path, "the array has no more blocks"));
        }
        Ok(values)
    }
}

/// Opens a C-order array of `f32` or `f64` for reading block by block.
///
/// # Errors
/// [`MeshFileError`] for a file that is no such array, or whose shape does not match its length.
pub fn read_npy_rows(path: &Path) -> Result<NpyRows, MeshFileError> {
    let (file, shape) = open(path)?;
    let wrong = |f: &NpyFile<Source>| {
        MeshFileError::format(path, format!("the array is of type {}; float32 or float64 was expected", f.dtype().descr()))
    };
    let values = match file.try_data::<f32>() {
        Ok(reader) => Values::Single(reader),
        Err(file) => match file.try_data::<f64>() {
            Ok(reader) => Values::Double(reader),
            Err(file) => return Err(wrong(&file)),
        },
    };
    Ok(NpyRows { path: path.to_owned(), shape, values })
}

/// Reads a whole C-order array of integers as indices.
///
/// # Errors
/// [`MeshFileError`] for a file that is no such array, and for numbers that are not valid indices.
pub fn read_npy_indices(path: &Path) -> Result<NpyArray<u32>, MeshFileError> {
    let (file, shape) = open(path)?;
    let type_name = file.dtype().descr();
    macro_rules! read_as {
        ($file:expr, $($kind:ty),+) => {{
            let mut file = $file;
            $(
                match file.try_data::<$kind>() {
                    Ok(reader) => {
                        let mut data = Vec::new();
                        for (place, value) in reader.enumerate() {
                            let value = value.map_err(MeshFileError::io(path))?;
                            data.push(u32::try_from(value).map_err(|_| {
                                MeshFileError::format(path, format!("value {place} is {value}; an index of 0 or more was expected"))
                            })?);
                        }
                        return Ok(NpyArray { shape, data });
                    }
                    Err(other) => file = other,
                }
            )+
            drop(file);
        }};
    }
    read_as!(file, i32, u32, i64, u64, i16, u16);
    Err(MeshFileError::format(path, format!("the array is of type {type_name}; whole numbers were expected")))
}

fn open(path: &Path) -> Result<(NpyFile<Source>, Vec<usize>), MeshFileError> {
    let header = check_header(path)?;
    let file = crate::input::open_file(path).map_err(MeshFileError::io(path))?;
    let length = file.metadata().map_err(MeshFileError::io(path))?.len();
    let array = caught(|| NpyFile::new(BufReader::new(file))).map_err(|e| MeshFileError::format(path, e))?;
    let array = array.map_err(|e| MeshFileError::format(path, format!("no .npy array: {e}")))?;
    if array.order() != Order::C {
        return Err(MeshFileError::format(path, "the array is in Fortran order; save it with numpy.ascontiguousarray"));
    }
    let bytes = array.dtype().num_bytes().unwrap_or(0) as u64;
    let needed = array.len().checked_mul(bytes).and_then(|n| n.checked_add(header));
    if needed.is_none_or(|n| n > length) {
        let reason = format!("the header says {:?} values of {bytes} bytes, but the file has {length} bytes", array.shape());
        return Err(MeshFileError::format(path, reason));
    }
    let shape = array.shape().iter().map(|&n| n as usize).collect();
    Ok((array, shape))
}

/// Rejects headers with a wrong length or with impossible sizes; returns the number of bytes before the values.
fn check_header(path: &Path) -> Result<u64, MeshFileError> {
    let mut start = Vec::new();
    let file = crate::input::open_file(path).map_err(MeshFileError::io(path))?;
    file.take(u64::from(MAX_HEADER)).read_to_end(&mut start).map_err(MeshFileError::io(path))?;
    let bytes_at = |k: usize| start.get(k).copied().unwrap_or(0);
    let (length, preamble) = if bytes_at(6) >= 2 {
        (u32::from_le_bytes([bytes_at(8), bytes_at(9), bytes_at(10), bytes_at(11)]), 12)
    } else {
        (u32::from(u16::from_le_bytes([bytes_at(8), bytes_at(9)])), 10)
    };
    let text = String::from_utf8_lossy(&start);
    let digits = text.split_once("shape").map(|(_, rest)| {
        let tuple = rest.split_once(')').map_or(rest, |(tuple, _)| tuple);
        tuple.chars().filter(char::is_ascii_digit).count()
    });
    if !start.starts_with(b"\x93NUMPY") || length >= MAX_HEADER || digits.is_none_or(|d| d > MAX_SHAPE_DIGITS) {
        return Err(MeshFileError::format(path, "no .npy array: its header is damaged"));
    }
    Ok(preamble + u64::from(length))
}

/// Writes a C-order `f32` array with the given shape. `fill` passes the values in order to its argument.
///
/// # Errors
/// When `out` cannot be written to, or the number of values does not match the shape.
pub fn write_npy_f32(
    out: &mut dyn Write,
    shape: &[usize],
    fill: impl FnOnce(&mut dyn FnMut(&[f32]) -> io::Result<()>) -> io::Result<()>,
) -> io::Result<()> {
    let shape: Vec<u64> = shape.iter().map(|&n| n as u64).collect();
    let mut writer = npyz::WriteOptions::new().default_dtype().shape(&shape).writer(out).begin_nd()?;
    fill(&mut |values: &[f32]| writer.extend(values.iter().copied()))?;
    writer.finish()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
        let path = folder.join(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    fn array(shape: &[usize], values: &[f32]) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_npy_f32(&mut bytes, shape, |push| push(values)).unwrap();
        bytes
    }

    #[test]
    fn blocks_come_one_after_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(folder.path(), "a.npy", &array(&[2, 1, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, f32::NAN]));
        let mut rows = read_npy_rows(&path).unwrap();
        assert_eq!(rows.shape(), [2, 1, 3]);
        assert_eq!(rows.next_block().unwrap(), [1.0, 2.0, 3.0]);
        assert!(rows.next_block().unwrap()[2].is_nan());
        assert!(rows.next_block().is_err());
    }

    #[test]
    fn indices_of_any_width_are_read_and_negative_ones_refused() {
        let folder = tempfile::tempdir().unwrap();
        let save = |values: &[i64]| {
            let mut bytes = Vec::new();
            let options = npyz::WriteOptions::new().default_dtype().shape(&[1, values.len() as u64]);
            let mut writer = options.writer(&mut bytes).begin_nd().unwrap();
            writer.extend(values.iter().copied()).unwrap();
            writer.finish().unwrap();
            write(folder.path(), "i.npy", &bytes)
        };
        assert_eq!(read_npy_indices(&save(&[0, 7, 3])).unwrap(), NpyArray { shape: vec![1, 3], data: vec![0, 7, 3] });
        let error = read_npy_indices(&save(&[0, -7])).unwrap_err().to_string();
        assert!(error.contains("value 1 is -7"), "{error}");
        assert!(read_npy_rows(&save(&[1])).err().unwrap().to_string().contains("float32 or float64"));
    }

    #[test]
    fn damaged_arrays_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let whole = array(&[4, 3], &[0.5; 12]);
        for length in 0..whole.len() {
            assert!(read_npy_rows(&write(folder.path(), "cut.npy", &whole[..length])).is_err(), "{length} bytes");
        }
        let huge = String::from_utf8_lossy(&whole[10..100]).replace("(4, 3)", "(9223372036854775807, 9223372036854775807)");
        let mut lying = whole[..10].to_vec();
        lying.extend_from_slice(huge.as_bytes());
        assert!(read_npy_rows(&write(folder.path(), "lie.npy", &lying)).is_err());
        assert!(read_npy_rows(&write(folder.path(), "no.npy", b"hello")).err().unwrap().to_string().contains("damaged"));
    }
}
