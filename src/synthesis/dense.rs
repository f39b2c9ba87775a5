//! Reads a dense face model: the folder of a bank in `NumPy` arrays, with identity modes.

use std::path::Path;

use super::{BankError, source::BankSource};
use crate::{mesh::read_npy_rows, pose::DenseFaces};

/// Reads a face model from a folder.
///
/// The folder holds `neutral_vertices.npy` (V x 3), `triangles.npy` or `quads.npy`, `expression_deltas.npy`,
/// `identity_deltas.npy` (modes x V x 3), and a `manifest.json` that names the expressions and the vertices of the 68 landmarks.
/// At most `modes` modes are read.
///
/// # Errors
/// [`BankError`] when an array cannot be read or the landmarks are missing.
pub fn read_dense_faces(folder: &Path, modes: usize) -> Result<DenseFaces, BankError> {
    let mut source = BankSource::open(folder, None)?;
    let landmarks = source.about.landmarks.clone().ok_or_else(|| BankError::Source {
        path: folder.to_owned(),
        reason: "no `landmarks_multipie68` in manifest.json, the vertices of the 68 landmarks".to_owned(),
    })?;
    let mut rows = read_npy_rows(&folder.join("identity_deltas.npy"))?;
    let count = rows.shape().first().copied().unwrap_or(0).min(modes);
    let mut identity = Vec::with_capacity(count);
    for _ in 0..count {
        identity.push(rows.next_block()?.as_chunks::<3>().0.to_vec());
    }
    let mut expressions = Vec::new();
    for name in source.names.clone() {
        let shape = source.next_member(&name)?;
        expressions.push((name, shape));
    }
    Ok(DenseFaces { neutral: source.mesh.positions().to_vec(), landmarks, identity, expressions })
}
