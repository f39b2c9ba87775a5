//! glTF 2.0: reads and writes meshes with named morph targets.
//!
//! The names of morph targets are in `extras.targetNames` of the mesh, the convention of Blender, three.js and other programs.

mod read;
mod seam;
mod write;

pub use read::{buffer_files, read_gltf};
pub use write::{GltfAnimation, GltfLook, GltfSurface, GltfTarget, GltfTexture, write_glb};

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
        let animation = GltfAnimation {
            name: "happiness".to_owned(),
            times_s: vec![0.0, 0.04],
            weights: vec![0.0, 0.0, 1.0, 0.5],
            turns: Vec::new(),
        };
        let mut bytes = Vec::new();
        let paint = [[0, 255, 128]; 4];
        let look = GltfLook { paint: Some(&paint), ..GltfLook::default() };
        write_glb(&mut bytes, (&mesh, &look), &targets, &|k| Cow::Borrowed(&moves[k][..]), &[animation], Some(0.1)).unwrap();
        bytes
    }

    fn read(bytes: &[u8]) -> Result<read::GltfMorphs, crate::mesh::MeshFileError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        fs::write(&path, bytes).unwrap();
        read_gltf(&path, None, |_| false)
    }

    #[test]
    fn written_files_read_back_dense_and_sparse() {
        let read = read(&glb()).unwrap();
        // Transformed by its node: in metres, a tenth of the size.
        assert_eq!(read.mesh.positions(), [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.025], [0.0, 0.1, -0.2]]);
        assert_eq!(read.mesh.triangles(), mesh().triangles());
        assert_eq!(read.names, ["smile \"wide\"", "jawOpen"]);
        assert_eq!(read.targets[0], vec![[0.05, 0.0, 0.0]; 4]);
        assert_eq!(read.targets[1], [[0.0; 3], [0.0, -0.1, 0.0], [0.0; 3], [0.0; 3]]);
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
        // Half of sRGB is 21.6 % of the light. The front is at 90 degrees of the circumference, the heights are those of the
        // square.
        let colours: Vec<[f32; 4]> = reader.read_colors(0).unwrap().into_rgba_f32().collect();
        assert!(colours.iter().all(|c| c[0] == 0.0 && c[1] == 1.0 && (c[2] - 0.216).abs() < 1e-3 && c[3] == 1.0));
        let places: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
        assert_eq!(places.iter().map(|p| p[1]).collect::<Vec<_>>(), [1.0, 1.0, 0.0, 0.0]);
        // Vertex 2 is at x = 0.5 and z = 1.125 from the middle of the bounding box: atan(0.5/1.125) = 23.96 degrees = 0.0666
        // turns.
        assert!((places[2][0] - 0.5666).abs() < 1e-3);
        // The neutral normals have length 1.
        let normals: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
        assert!(normals.iter().all(|n| (n.iter().map(|c| c * c).sum::<f32>() - 1.0).abs() < 1e-6));
    }

    #[test]
    fn materials_share_the_vertices_and_the_picture_is_whole() {
        let mesh = mesh();
        let moves = [[0.5, 0.0, 0.0]; 4];
        let targets = [GltfTarget { name: "smile".to_owned(), vertices: None }];
        let surface =
            |name, k: usize, textured| GltfSurface { name, triangles: vec![mesh.triangles()[k]], roughness: 0.5, textured };
        let mut jpeg = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut jpeg)
            .encode_image(&image::RgbImage::from_pixel(8, 8, image::Rgb([200, 90, 60])))
            .unwrap();
        let (paint, places) = ([[0, 255, 128]; 4], [[0.25, 0.5]; 4]);
        let look = GltfLook {
            paint: Some(&paint),
            surfaces: vec![surface("skin", 0, true), surface("eyes", 1, false)],
            texture: Some(GltfTexture { jpeg, places: &places }),
            copyright: "Somebody (MIT)",
            ..GltfLook::default()
        };
        let mut bytes = Vec::new();
        write_glb(&mut bytes, (&mesh, &look), &targets, &|_| Cow::Borrowed(&moves[..]), &[], None).unwrap();
        let (document, buffers, images) = gltf::import_slice(&bytes).unwrap();
        assert_eq!(document.as_json().asset.copyright.as_deref(), Some("Somebody (MIT)"));
        assert_eq!((images.len(), images[0].width, images[0].height), (1, 8, 8));
        assert!(images[0].pixels[0].abs_diff(200) < 6);
        let primitives: Vec<_> = document.meshes().next().unwrap().primitives().collect();
        let material = |k: usize| primitives[k].material();
        assert_eq!([0, 1].map(|k| material(k).name().unwrap().to_owned()), ["skin", "eyes"]);
        assert_eq!([0, 1].map(|k| material(k).pbr_metallic_roughness().base_color_texture().is_some()), [true, false]);
        // Surfaces without the texture have vertex colours.
        let colours = |k: usize| primitives[k].reader(|b| Some(&buffers[b.index()])).read_colors(0).is_some();
        assert_eq!([0, 1].map(colours), [false, true]);
        let at: Vec<[f32; 2]> =
            primitives[0].reader(|b| Some(&buffers[b.index()])).read_tex_coords(0).unwrap().into_f32().collect();
        assert_eq!(at, places);
        let read = read(&bytes).unwrap();
        assert_eq!((read.mesh, read.targets), (mesh, vec![moves.to_vec()]));
    }

    #[test]
    fn a_seam_copies_vertices_with_their_normals_colours_and_targets() {
        // A triangle at the back of a prism, whose seam goes through it: turns of -150 and 150 degrees.
        let (x, z) = (0.5, -0.75_f32.sqrt());
        let positions = vec![[-x, 0.0, z], [x, 0.0, z], [0.0, 1.0, z], [-1.0, 0.0, 0.75_f32.sqrt()], [1.0, 0.0, 0.75_f32.sqrt()]];
        let mesh = TriangleMesh::new(positions, vec![[1, 0, 2], [3, 4, 2]]).unwrap();
        let moves = [vec![[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0; 3], [0.0; 3]], vec![[0.0, 0.1, 0.0]; 5]];
        let targets = [
            GltfTarget { name: "some".to_owned(), vertices: Some(vec![0, 1, 2]) },
            GltfTarget { name: "all".to_owned(), vertices: None },
        ];
        let paint = [[10; 3], [20; 3], [30; 3], [40; 3], [50; 3]];
        let look = GltfLook { paint: Some(&paint), ..GltfLook::default() };
        let mut bytes = Vec::new();
        write_glb(&mut bytes, (&mesh, &look), &targets, &|k| Cow::Borrowed(&moves[k][..]), &[], None).unwrap();
        let (document, buffers, _) = gltf::import_slice(&bytes).unwrap();
        let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
        let reader = primitive.reader(|b| Some(&buffers[b.index()]));
        let corners: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
        let places: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
        let at: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
        let normals: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
        let colours: Vec<[f32; 4]> = reader.read_colors(0).unwrap().into_rgba_f32().collect();
        let morphs: Vec<Vec<[f32; 3]>> = reader.read_morph_targets().map(|(p, _, _)| p.unwrap().collect()).collect();
        assert!(at.len() > 5 && [places.len(), normals.len(), colours.len(), morphs[0].len(), morphs[1].len()] == [at.len(); 5]);
        for triangle in corners.chunks(3) {
            let u: Vec<f32> = triangle.iter().map(|&v| places[v as usize][0]).collect();
            let span = u.iter().copied().fold(f32::MIN, f32::max) - u.iter().copied().fold(f32::MAX, f32::min);
            assert!(span <= 0.5 + 1e-4, "{u:?}");
        }
        // Every copy is at the place of its vertex and moves with it.
        for copy in 5..at.len() {
            let vertex = (0..5).find(|&v| at[v] == at[copy]).unwrap();
            assert_eq!((normals[copy], colours[copy]), (normals[vertex], colours[vertex]));
            assert!(morphs.iter().all(|moves| moves[copy] == moves[vertex]));
        }
    }

    #[test]
    fn a_head_turns_about_its_pivot_and_rests_where_it_was() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let animation = |name: &str, turns: &[[f32; 4]]| GltfAnimation {
            name: name.to_owned(),
            times_s: vec![0.0, 0.04],
            weights: Vec::new(),
            turns: turns.to_vec(),
        };
        let nod = animation("nod", &[[0.0, 0.0, 0.0, 1.0], [half, 0.0, 0.0, half]]);
        let look = GltfLook { pivot: [0.5, -2.0, 1.0], ..GltfLook::default() };
        let mut bytes = Vec::new();
        let animations = [animation("none", &[]), nod];
        write_glb(&mut bytes, (&mesh(), &look), &[], &|_| Cow::Borrowed(&[][..]), &animations, Some(0.1)).unwrap();
        let (document, buffers, _) = gltf::import_slice(&bytes).unwrap();
        // Only the second animation has something to show: a quarter of a turn downwards.
        let names: Vec<_> = document.animations().map(|a| a.name().unwrap().to_owned()).collect();
        assert_eq!(names, ["nod"]);
        let channel = document.animations().next().unwrap().channels().next().unwrap();
        assert_eq!(channel.target().node().name(), Some("head"));
        let Some(gltf::animation::util::ReadOutputs::Rotations(turns)) =
            channel.reader(|b| Some(&buffers[b.index()])).read_outputs()
        else {
            panic!()
        };
        assert_eq!(turns.into_f32().collect::<Vec<_>>(), [[0.0, 0.0, 0.0, 1.0], [half, 0.0, 0.0, half]]);
        let head = document.default_scene().unwrap().nodes().next().unwrap();
        let (at, turn, _) = head.transform().decomposed();
        assert_eq!((head.name(), at, turn), (Some("head"), [0.05, -0.2, 0.1], [0.0, 0.0, 0.0, 1.0]));
        let face = head.children().next().unwrap();
        let (at, _, scale) = face.transform().decomposed();
        assert_eq!((face.name(), at, scale), (Some("face"), [-0.05, 0.2, -0.1], [0.1; 3]));
    }

    /// Returns the file with its JSON changed.
    fn edited(change: impl FnOnce(&mut serde_json::Value)) -> Vec<u8> {
        let whole = glb();
        let length = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
        let mut root = serde_json::from_slice(&whole[20..20 + length]).unwrap();
        change(&mut root);
        let mut json = serde_json::to_vec(&root).unwrap();
        json.resize(json.len().next_multiple_of(4), b' ');
        let total = 20 + json.len() + whole.len() - 20 - length;
        let mut bytes = whole[..8].to_vec();
        bytes.extend((total as u32).to_le_bytes());
        bytes.extend((json.len() as u32).to_le_bytes());
        bytes.extend(&whole[16..20]);
        bytes.extend(json);
        bytes.extend(&whole[20 + length..]);
        bytes
    }

    #[test]
    fn of_several_meshes_the_one_with_the_wanted_targets_is_read() {
        let bytes = edited(|root| {
            let mut eye = root["meshes"][0].clone();
            eye["name"] = "EyeLeft".into();
            eye["extras"]["targetNames"] = serde_json::json!(["look"]);
            eye["primitives"][0]["targets"].as_array_mut().unwrap().truncate(1);
            root["meshes"][0]["name"] = "Face".into();
            root["meshes"].as_array_mut().unwrap().insert(0, eye);
        });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("avatar.glb");
        fs::write(&path, bytes).unwrap();
        // A mesh with two targets is preferred to one with a single target, unless that target is wanted.
        let face = read_gltf(&path, None, |_| false).unwrap();
        assert_eq!((face.names.len(), &face.others[..]), (2, &["EyeLeft (1 targets)".to_owned()][..]));
        assert_eq!(read_gltf(&path, None, |name| name == "look").unwrap().names, ["look"]);
        assert_eq!(read_gltf(&path, Some("EyeLeft"), |_| false).unwrap().names, ["look"]);
        let error = read_gltf(&path, Some("Nose"), |_| false).unwrap_err().to_string();
        assert!(
            error.contains("no mesh with morph targets is named `Nose`; there are EyeLeft (1 targets), Face (2 targets)"),
            "{error}"
        );
    }

    #[test]
    fn compressed_meshes_say_what_writes_them_plain_and_pictures_do_not_matter() {
        let with = |key: &'static str, name: &'static str| edited(move |root| root[key] = serde_json::json!([name]));
        for name in ["EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_mesh_quantization"] {
            let error = read(&with("extensionsUsed", name)).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("gltf-transform dequantize"), "{error}");
        }
        assert_eq!(read(&with("extensionsRequired", "EXT_texture_webp")).unwrap().names.len(), 2);
    }

    #[test]
    fn another_version_and_half_a_triangle_are_refused() {
        let error = read(&edited(|root| root["asset"]["version"] = "1.0".into())).unwrap_err().to_string();
        assert!(error.contains("the file is glTF 1.0, but only glTF 2.0 is supported"), "{error}");
        assert!(read(&edited(|root| root["asset"]["version"] = "2.1".into())).is_ok());
        let seven = edited(|root| {
            let indices = root["meshes"][0]["primitives"][0]["indices"].as_u64().unwrap() as usize;
            root["accessors"][indices]["count"] = 5.into();
        });
        let error = read(&seven).unwrap_err().to_string();
        assert!(error.contains("primitive 0 has 5 indices; triangles take a multiple of 3"), "{error}");
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
            // The replacement has the same length, so that the chunk's length stays correct.
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
