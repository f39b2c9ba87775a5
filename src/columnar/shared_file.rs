//! Random access to a file for the Parquet reader.

use std::{
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    sync::{Arc, Mutex, PoisonError},
};

use parquet::{
    errors::ParquetError,
    file::reader::{ChunkReader, Length},
};

/// A file read at given offsets, by one thread at a time.
#[derive(Clone)]
pub(super) struct SharedFile {
    file: Arc<Mutex<File>>,
    pub length: u64,
}

impl SharedFile {
    pub fn new(file: File, length: u64) -> Self {
        Self { file: Arc::new(Mutex::new(file)), length }
    }

    pub fn read_at(&self, start: u64, buffer: &mut [u8]) -> io::Result<()> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(buffer)
    }
}

/// A part of a [`SharedFile`] as a stream.
pub(super) struct Stream {
    file: SharedFile,
    at: u64,
}

impl Read for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.file.length.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let count = buffer.len().min(left);
        self.file.read_at(self.at, &mut buffer[..count])?;
        self.at += count as u64;
        Ok(count)
    }
}

impl Length for SharedFile {
    fn len(&self) -> u64 {
        self.length
    }
}

impl ChunkReader for SharedFile {
    type T = io::BufReader<Stream>;

    fn get_read(&self, start: u64) -> Result<Self::T, ParquetError> {
        Ok(io::BufReader::new(Stream { file: self.clone(), at: start }))
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<bytes::Bytes, ParquetError> {
        if start.checked_add(length as u64).is_none_or(|end| end > self.length) {
            return Err(ParquetError::EOF(format!("{length} bytes at {start} of a file of {}", self.length)));
        }
        let mut buffer = vec![0; length];
        self.read_at(start, &mut buffer)?;
        Ok(buffer.into())
    }
}

impl SharedFile {
    /// Returns the metadata at the end of the file, without its length and the closing mark `PAR1`. Returns `None` if these are missing.
    pub fn footer(&self) -> io::Result<Option<Vec<u8>>> {
        const TAIL: u64 = 8;
        let Some(tail_at) = self.length.checked_sub(TAIL) else { return Ok(None) };
        let mut tail = [0; TAIL as usize];
        self.read_at(tail_at, &mut tail)?;
        let [a, b, c, d, mark @ ..] = tail;
        let length = u64::from(u32::from_le_bytes([a, b, c, d]));
        let Some(start) = tail_at.checked_sub(length).filter(|_| &mark == b"PAR1") else { return Ok(None) };
        let mut footer = vec![0; length as usize];
        self.read_at(start, &mut footer)?;
        Ok(Some(footer))
    }
}
