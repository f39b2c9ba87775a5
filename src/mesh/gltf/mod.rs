//! glTF 2.0: morph targets with names, in and out.
//!
//! Names of morph targets stand in `extras.targetNames` of the mesh, as Blender, three.js and other programs have agreed.

mod read;
mod write;

pub use read::{GltfMorphs, read_gltf};
pub use write::{GltfAnimation, GltfTarget, write_glb};

#[cfg(test)]
mod tests {
    use std::{borrow::Cow, fs};

    use super::*;
    use crate::mesh::TriangleMesh;

    fn mesh() -> TriangleMesh {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.25], [0.0, 1.0, -2.0]];
        TriangleMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
    }

    fn glb() -> Vec<u8> {
        let mesh = mesh();
        let moves = [vec![[0.5, 0.0, 0.0]; 4], vec![[0.0; 3], [0.0, -1.0, 0.0], [0.0; 3], [0.0; 3]]];
        let targets = vec![
            GltfTarget { name: "smile \"wide\"".to_owned(), vertices: None },
            GltfTarget { name: "jawOpen".to_owned(), vertices: Some(vec![1]) },
        ];
        let animation =
            GltfAnimation { name: "happiness".to_owned(), times_s: vec![0.0, 0.04], weights: vec![0.0, 0.0, 1.0, 0.5] };
        let mut bytes = Vec::new();
        write_glb(&mut bytes, &mesh, &targets, &|k| Cow::Borrowed(&moves[k][..]), Some(&animation)).unwrap();
        bytes
    }

    fn read(bytes: &[u8]) -> Result<GltfMorphs, crate::mesh::MeshFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        fs::write(&path, bytes).unwrap();
        read_gltf(&path)
    }

    #[test]
    fn what_is_written_reads_back_dense_and_sparse() {
        let read = read(&glb()).unwrap();
        assert_eq!(read.mesh, mesh());
        assert_eq!(read.names, ["smile \"wide\"", "jawOpen"]);
        assert_eq!(read.targets[0], vec![[0.5, 0.0, 0.0]; 4]);
        assert_eq!(read.targets[1], [[0.0; 3], [0.0, -1.0, 0.0], [0.0; 3], [0.0; 3]]);
    }

    #[test]
    fn the_gltf_crate_validates_it_and_plays_the_weights() {
        let (document, buffers, _) = gltf::import_slice(glb()).unwrap();
        let animation = document.animations().next().unwrap();
        assert_eq!(animation.name(), Some("happiness"));
        let channel = animation.channels().next().unwrap();
        let reader = channel.reader(|b| Some(&buffers[b.index()]));
        assert_eq!(reader.read_inputs().unwrap().collect::<Vec<_>>(), [0.0, 0.04]);
        let Some(gltf::animation::util::ReadOutputs::MorphTargetWeights(weights)) = reader.read_outputs() else { panic!() };
        assert_eq!(weights.into_f32().collect::<Vec<_>>(), [0.0, 0.0, 1.0, 0.5]);
        let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|b| Some(&buffers[b.index()]));
        let morphs: Vec<Vec<[f32; 3]>> = reader.read_morph_targets().map(|(p, _, _)| p.unwrap().collect()).collect();
        assert_eq!(morphs[1][1], [0.0, -1.0, 0.0]);
        // Normals of the moved face minus those of the neutral one, of length 1 together.
        let normals: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
        assert!(normals.iter().all(|n| (n.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn no_cut_and_no_flipped_byte_makes_it_panic() {
        let whole = glb();
        for length in 0..whole.len() {
            let _ = read(&whole[..length]);
        }
        assert!(read(&whole[..whole.len() / 2]).is_err());
        for place in 0..whole.len() {
            let mut damaged = whole.clone();
            damaged[place] ^= 0x11;
            let _ = read(&damaged);
        }
    }

    #[test]
    fn lies_about_sizes_are_errors() {
        let text = |from: &str, to: &str| {
            // Same length, so that the chunk's length stays true.
            assert_eq!(from.len(), to.len());
            let whole = glb();
            let place = whole.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
            let mut damaged = whole;
            damaged[place..place + to.len()].copy_from_slice(to.as_bytes());
            read(&damaged).unwrap_err().to_string()
        };
        assert!(text("\"count\":4", "\"count\":9").contains("beyond"), "{}", text("\"count\":4", "\"count\":9"));
        assert!(text("\"VEC3\"", "\"VEC2\"").contains("float VEC3"));
    }
}
