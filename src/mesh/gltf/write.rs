//! Writes a mesh with morph targets and animations of their weights as a GLB file.

use std::{
    borrow::Cow,
    io::{self, Write},
};

use gltf::json::{
    self, Accessor, Animation, Asset, Buffer, Image, Index, Material, Mesh, Node, Root, Scene, Texture, Value,
    accessor::{ComponentType, GenericComponentType, IndexComponentType, Type, sparse},
    animation::{Channel, Interpolation, Property, Sampler, Target},
    buffer::{self, View},
    image::MimeType,
    material::{PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor},
    mesh::{Mode, MorphTarget, Primitive, Semantic},
    texture,
    validation::{Checked, USize64},
};

use super::seam::Seam;
use crate::mesh::{TriangleMesh, add, colour::linear, sub, vertex_normals};

/// A morph target to be written.
#[derive(Clone, Debug, PartialEq)]
pub struct GltfTarget {
    /// Its name.
    pub name: String,
    /// The vertices it moves, ascending, if most do not move: only these are written (a sparse accessor). `None` writes all.
    pub vertices: Option<Vec<u32>>,
}

/// An animation: weights of the targets over time.
#[derive(Clone, Debug, PartialEq)]
pub struct GltfAnimation {
    /// Its name.
    pub name: String,
    /// Time of every key frame, s, ascending.
    pub times_s: Vec<f32>,
    /// Weights of all targets for each key frame.
    pub weights: Vec<f32>,
    /// Rotation of the head in each key frame, a unit quaternion x, y, z, w; empty for a head that does not turn.
    pub turns: Vec<[f32; 4]>,
}

/// Appearance of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GltfLook<'a> {
    /// Colours of the vertices, sRGB; `None` gives everything the colour of skin.
    pub paint: Option<&'a [[u8; 3]]>,
    /// Its triangles by material; if empty, all are `skin`.
    pub surfaces: Vec<GltfSurface>,
    /// Texture of the textured surfaces.
    pub texture: Option<GltfTexture<'a>>,
    /// Authors and licence; not written if empty.
    pub copyright: &'a str,
    /// Point about which the head turns, the mesh's unit.
    pub pivot: [f32; 3],
}

/// Triangles of one material.
#[derive(Clone, Debug, PartialEq)]
pub struct GltfSurface {
    /// Name of the material.
    pub name: &'static str,
    /// The triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Roughness: 0 is a mirror, 1 is matt.
    pub roughness: f32,
    /// Whether it uses the texture instead of the vertex colours.
    pub textured: bool,
}

/// A texture of the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct GltfTexture<'a> {
    /// The picture as a JPEG file.
    pub jpeg: Vec<u8>,
    /// Texture coordinates of all vertices, v downwards.
    pub places: &'a [[f32; 2]],
}

/// Colour of skin, linear RGBA, for a mesh without colours or texture.
const SKIN: [f32; 4] = [0.74, 0.52, 0.42, 1.0];
const ROUGHNESS: f32 = 0.65;
const GLB_MAGIC: u32 = 0x4654_6C67;
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;

/// Writes a mesh, its morph targets (positions and normals) and animations of their weights as binary glTF.
///
/// `metres` is the length of the mesh's unit in metres, the unit of glTF; `None` if unknown. Texture coordinates are those of the
/// look's texture, or an unwrapping of the neutral mesh around its upright axis with the seam at the back. Along the seam, vertices
/// have copies behind the mesh's own, whose u is above 1; textures repeat. Materials share the vertices and the targets.
///
/// `displacements(k)` returns the displacements of every vertex in target k. It is called twice for each target, and the results
/// are not kept: apart from the mesh, one target at a time is in memory. An animation without targets and without turns is not
/// written, because glTF does not allow empty ones. If the head turns in one of them, the node `face` is below a node `head`, which
/// turns about the look's pivot.
///
/// # Errors
/// When `out` cannot be written to, or the file would exceed the 4 GiB of the format.
pub fn write_glb<'a>(
    out: &mut dyn Write,
    (mesh, look): (&TriangleMesh, &GltfLook<'_>),
    targets: &[GltfTarget],
    displacements: &dyn Fn(usize) -> Cow<'a, [[f32; 3]]>,
    animations: &[GltfAnimation],
    metres: Option<f64>,
) -> io::Result<()> {
    let moves = |animation: &&GltfAnimation| !targets.is_empty() || !animation.turns.is_empty();
    let animations = &animations.iter().filter(moves).collect::<Vec<_>>()[..];
    let whole = [GltfSurface { name: "skin", triangles: mesh.triangles().to_vec(), roughness: ROUGHNESS, textured: true }];
    let surfaces = if look.surfaces.is_empty() { &whole[..] } else { &look.surfaces };
    let seam = match &look.texture {
        Some(texture) => Seam::new(surfaces, texture.places, false),
        None => Seam::new(surfaces, &unwrapped(mesh), true),
    };
    let cut = |target: &GltfTarget| GltfTarget {
        name: target.name.clone(),
        vertices: target.vertices.as_ref().map(|vertices| seam.with_copies(vertices, mesh.vertex_count())),
    };
    let targets = &targets.iter().map(cut).collect::<Vec<_>>()[..];
    let (root, bin_length) = document((mesh, look, &seam), targets, displacements, animations, metres)?;
    let mut text = json::serialize::to_vec(&root).map_err(io::Error::from)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() as u64 + 8 + bin_length;
    let total =
        u32::try_from(total).map_err(|_| io::Error::other("the glTF would be larger than 4 GiB; write npy, obj or ply"))?;
    for word in [GLB_MAGIC, 2, total, text.len() as u32, CHUNK_JSON] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&text)?;
    for word in [bin_length as u32, CHUNK_BIN] {
        out.write_all(&word.to_le_bytes())?;
    }
    // The same order as the views in `document`.
    let normals = vertex_normals(mesh.positions(), mesh.triangles());
    write_vectors(out, &seam.all(mesh.positions()))?;
    write_vectors(out, &seam.all(&normals))?;
    for number in seam.places.as_flattened() {
        out.write_all(&number.to_le_bytes())?;
    }
    for colour in look.paint.map(|paint| seam.all(paint)).unwrap_or_default() {
        let [red, green, blue] = colour.map(|c| (f32::from(u16::MAX) * linear(c)).round() as u16);
        for word in [red, green, blue, u16::MAX] {
            out.write_all(&word.to_le_bytes())?;
        }
    }
    for triangle in seam.surfaces.iter().flat_map(|surface| &surface.triangles) {
        write_words(out, triangle)?;
    }
    for (k, target) in targets.iter().enumerate() {
        let moves = displacements(k);
        let turns = seam.all(&normal_changes(mesh, &normals, &moves));
        let moves = seam.all(&moves);
        match &target.vertices {
            None => {
                write_vectors(out, &moves)?;
                write_vectors(out, &turns)?;
            }
            Some(vertices) => {
                write_words(out, vertices)?;
                for values in [&moves[..], &turns] {
                    let moved: Vec<[f32; 3]> = vertices.iter().map(|&v| values[v as usize]).collect();
                    write_vectors(out, &moved)?;
                }
            }
        }
    }
    for animation in animations {
        for number in animation.times_s.iter().chain(&animation.weights).chain(animation.turns.as_flattened()) {
            out.write_all(&number.to_le_bytes())?;
        }
    }
    if let Some(texture) = &look.texture {
        out.write_all(&texture.jpeg)?;
        out.write_all(&[0; 3][..texture.jpeg.len().next_multiple_of(4) - texture.jpeg.len()])?;
    }
    Ok(())
}

/// Texture coordinates around the upright axis, 0 to 1, v downwards; the front is at one half.
fn unwrapped(mesh: &TriangleMesh) -> Vec<[f32; 2]> {
    let [low, high] = mesh.bounds();
    let middle = |k: usize| f32::midpoint(low[k], high[k]);
    let tall = (high[1] - low[1]).max(f32::MIN_POSITIVE);
    let place = |p: &[f32; 3]| {
        let turn = (p[0] - middle(0)).atan2(p[2] - middle(2)) / std::f32::consts::TAU;
        [0.5 + turn, (high[1] - p[1]) / tall]
    };
    mesh.positions().iter().map(place).collect()
}

fn write_vectors(out: &mut dyn Write, values: &[[f32; 3]]) -> io::Result<()> {
    // glTF is little-endian.
    if cfg!(target_endian = "little") {
        return out.write_all(bytemuck::cast_slice(values));
    }
    values.as_flattened().iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

fn write_words(out: &mut dyn Write, values: &[u32]) -> io::Result<()> {
    if cfg!(target_endian = "little") {
        return out.write_all(bytemuck::cast_slice(values));
    }
    values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

/// Normals of the displaced mesh minus those of the neutral one.
fn normal_changes(mesh: &TriangleMesh, normals: &[[f32; 3]], moves: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let moved: Vec<[f32; 3]> = mesh.positions().iter().zip(moves).map(|(&p, &d)| add(p, d)).collect();
    vertex_normals(&moved, mesh.triangles()).iter().zip(normals).map(|(&n, &m)| sub(n, m)).collect()
}

/// Accessors of the key frames of an animation.
struct Keys {
    times: Index<Accessor>,
    weights: Option<Index<Accessor>>,
    turns: Option<Index<Accessor>>,
}

/// The document under construction: its views are consecutive in one buffer.
struct Builder {
    root: Root,
    length: u64,
}

impl Builder {
    fn view(&mut self, bytes: u64, target: Option<buffer::Target>) -> Index<View> {
        let view = View {
            buffer: Index::new(0),
            byte_length: USize64(bytes),
            byte_offset: Some(USize64(self.length)),
            byte_stride: None,
            name: None,
            target: target.map(Checked::Valid),
            extensions: None,
            extras: None,
        };
        self.length += bytes;
        self.root.push(view)
    }

    fn accessor(&mut self, view: Option<Index<View>>, count: usize, component: ComponentType, kind: Type) -> Index<Accessor> {
        self.root.push(Accessor {
            buffer_view: view,
            byte_offset: None,
            count: USize64::from(count),
            component_type: Checked::Valid(GenericComponentType(component)),
            type_: Checked::Valid(kind),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
            extensions: None,
            extras: None,
        })
    }

    fn vectors(&mut self, count: usize, bounds: Option<[[f32; 3]; 2]>) -> Index<Accessor> {
        let view = self.view(12 * count as u64, Some(buffer::Target::ArrayBuffer));
        let index = self.accessor(Some(view), count, ComponentType::F32, Type::Vec3);
        self.set_bounds(index, bounds);
        index
    }

    fn set_bounds(&mut self, index: Index<Accessor>, bounds: Option<[[f32; 3]; 2]>) {
        if let (Some([min, max]), Some(accessor)) = (bounds, self.root.accessors.get_mut(index.value())) {
            accessor.min = Some(Value::from(min.to_vec()));
            accessor.max = Some(Value::from(max.to_vec()));
        }
    }

    /// Adds a texture from a JPEG file of this length, bytes.
    fn picture(&mut self, length: usize) -> Index<Texture> {
        let view = self.view(length as u64, None);
        self.length = self.length.next_multiple_of(4);
        let source = self.root.push(Image {
            buffer_view: Some(view),
            mime_type: Some(MimeType("image/jpeg".to_owned())),
            name: Some("skin".to_owned()),
            uri: None,
            extensions: None,
            extras: None,
        });
        self.root.push(Texture { name: None, sampler: None, source, extensions: None, extras: None })
    }

    /// Adds the key frames of an animation.
    fn keys(&mut self, animation: &GltfAnimation) -> Keys {
        let frames = animation.times_s.len();
        let view = self.view(4 * frames as u64, None);
        let times = self.accessor(Some(view), frames, ComponentType::F32, Type::Scalar);
        if let Some(accessor) = self.root.accessors.get_mut(times.value()) {
            accessor.min = Some(Value::from(vec![animation.times_s.first().copied().unwrap_or(0.0)]));
            accessor.max = Some(Value::from(vec![animation.times_s.last().copied().unwrap_or(0.0)]));
        }
        let mut outputs = |numbers: usize, each: u64, kind: Type| {
            let view = (numbers > 0).then(|| self.view(4 * each * numbers as u64, None));
            view.map(|view| self.accessor(Some(view), numbers, ComponentType::F32, kind))
        };
        let weights = outputs(animation.weights.len(), 1, Type::Scalar);
        Keys { times, weights, turns: outputs(animation.turns.len(), 4, Type::Vec4) }
    }

    /// Adds vectors that are zero except at some vertices; the view with the vertex indices is shared.
    fn sparse_vectors(
        &mut self,
        count: usize,
        places: Index<View>,
        moved: usize,
        bounds: Option<[[f32; 3]; 2]>,
    ) -> Index<Accessor> {
        let values = self.view(12 * moved as u64, None);
        let index = self.accessor(None, count, ComponentType::F32, Type::Vec3);
        self.set_bounds(index, bounds);
        if let Some(accessor) = self.root.accessors.get_mut(index.value()) {
            accessor.sparse = Some(sparse::Sparse {
                count: USize64::from(moved),
                indices: sparse::Indices {
                    buffer_view: places,
                    byte_offset: USize64(0),
                    component_type: Checked::Valid(IndexComponentType(ComponentType::U32)),
                    extensions: None,
                    extras: None,
                },
                values: sparse::Values { buffer_view: values, byte_offset: USize64(0), extensions: None, extras: None },
                extensions: None,
                extras: None,
            });
        }
        index
    }
}

fn document<'a>(
    (mesh, look, seam): (&TriangleMesh, &GltfLook<'_>, &Seam),
    targets: &[GltfTarget],
    displacements: &dyn Fn(usize) -> Cow<'a, [[f32; 3]]>,
    animations: &[&GltfAnimation],
    metres: Option<f64>,
) -> io::Result<(Root, u64)> {
    let count = seam.places.len();
    let generator = Some(format!("grimace {}", env!("CARGO_PKG_VERSION")));
    let copyright = Some(look.copyright.to_owned()).filter(|text| !text.is_empty());
    let asset = Asset { copyright, generator, version: "2.0".to_owned(), ..Asset::default() };
    let mut builder = Builder { root: Root { asset, ..Root::default() }, length: 0 };
    let positions = builder.vectors(count, Some(mesh.bounds()));
    let normals = builder.vectors(count, None);
    let view = builder.view(8 * count as u64, Some(buffer::Target::ArrayBuffer));
    let places = builder.accessor(Some(view), count, ComponentType::F32, Type::Vec2);
    let colours = look.paint.is_some().then(|| {
        let view = builder.view(8 * count as u64, Some(buffer::Target::ArrayBuffer));
        let colours = builder.accessor(Some(view), count, ComponentType::U16, Type::Vec4);
        if let Some(accessor) = builder.root.accessors.get_mut(colours.value()) {
            accessor.normalized = true;
        }
        colours
    });
    let corners = |surface: &GltfSurface| {
        let view = builder.view(12 * surface.triangles.len() as u64, Some(buffer::Target::ElementArrayBuffer));
        builder.accessor(Some(view), 3 * surface.triangles.len(), ComponentType::U32, Type::Scalar)
    };
    let indices: Vec<Index<Accessor>> = seam.surfaces.iter().map(corners).collect();
    let mut morphs = Vec::with_capacity(targets.len());
    for (k, target) in targets.iter().enumerate() {
        let bounds = Some(bounds(&displacements(k)));
        let (positions, normals) = match &target.vertices {
            None => (builder.vectors(count, bounds), builder.vectors(count, None)),
            Some(vertices) => {
                let places = builder.view(4 * vertices.len() as u64, None);
                let moved = vertices.len();
                (builder.sparse_vectors(count, places, moved, bounds), builder.sparse_vectors(count, places, moved, None))
            }
        };
        morphs.push(MorphTarget { positions: Some(positions), normals: Some(normals), tangents: None });
    }
    let keys: Vec<Keys> = animations.iter().map(|animation| builder.keys(animation)).collect();
    let picture = look.texture.as_ref().map(|texture| builder.picture(texture.jpeg.len()));
    let Builder { mut root, length } = builder;
    root.push(Buffer { byte_length: USize64(length), name: None, uri: None, extensions: None, extras: None });
    let base =
        [Some((Semantic::Positions, positions)), Some((Semantic::Normals, normals)), Some((Semantic::TexCoords(0), places))];
    let primitive = |(surface, indices): (&GltfSurface, Index<Accessor>)| {
        let picture = picture.filter(|_| surface.textured);
        // A viewer would multiply the vertex colours by the texture.
        let paint = colours.filter(|_| picture.is_none());
        let attributes = base.iter().cloned().chain([paint.map(|colours| (Semantic::Colors(0), colours))]).flatten();
        Primitive {
            attributes: attributes.map(|(semantic, index)| (Checked::Valid(semantic), index)).collect(),
            indices: Some(indices),
            material: Some(root.push(material(surface, picture, paint.is_some()))),
            mode: Checked::Valid(Mode::Triangles),
            targets: (!targets.is_empty()).then(|| morphs.clone()),
            extensions: None,
            extras: None,
        }
    };
    let primitives: Vec<Primitive> = seam.surfaces.iter().zip(indices).map(primitive).collect();
    let names: Vec<&str> = targets.iter().map(|t| t.name.as_str()).collect();
    let extras = serde_json::value::to_raw_value(&serde_json::json!({ "targetNames": names })).map_err(io::Error::from)?;
    let mesh = root.push(Mesh {
        name: Some("face".to_owned()),
        weights: (!targets.is_empty()).then(|| vec![0.0; targets.len()]),
        extras: (!targets.is_empty()).then_some(extras),
        extensions: None,
        primitives,
    });
    let scale = metres.map(|m| [m as f32; 3]);
    let face = Node { mesh: Some(mesh), name: Some("face".to_owned()), scale, ..Node::default() };
    let (face, head) = if animations.iter().any(|animation| !animation.turns.is_empty()) {
        let pivot = look.pivot.map(|c| c * metres.unwrap_or(1.0) as f32);
        let face = root.push(Node { translation: Some(pivot.map(|c| -c)), ..face });
        let (children, name) = (Some(vec![face]), Some("head".to_owned()));
        (face, Some(root.push(Node { children, name, translation: Some(pivot), ..Node::default() })))
    } else {
        (root.push(face), None)
    };
    let scene = root.push(Scene { nodes: vec![head.unwrap_or(face)], name: None, extensions: None, extras: None });
    root.scene = Some(scene);
    for (animation, keys) in animations.iter().zip(keys) {
        let weights = keys.weights.map(|output| (output, face, Property::MorphTargetWeights));
        let turns = keys.turns.zip(head).map(|(output, head)| (output, head, Property::Rotation));
        let (mut channels, mut samplers) = (Vec::new(), Vec::new());
        for (output, node, property) in weights.into_iter().chain(turns) {
            let target = Target { node, path: Checked::Valid(property), extensions: None, extras: None };
            channels.push(Channel { sampler: Index::new(samplers.len() as u32), target, extensions: None, extras: None });
            let interpolation = Checked::Valid(Interpolation::Linear);
            samplers.push(Sampler { input: keys.times, output, interpolation, extensions: None, extras: None });
        }
        let name = Some(animation.name.clone());
        root.push(Animation { name, channels, samplers, extensions: None, extras: None });
    }
    Ok((root, length))
}

/// Returns the material of a surface with a texture, with vertex colours, or with neither.
fn material(surface: &GltfSurface, picture: Option<Index<Texture>>, is_painted: bool) -> Material {
    Material {
        name: Some(surface.name.to_owned()),
        double_sided: true,
        pbr_metallic_roughness: PbrMetallicRoughness {
            base_color_factor: PbrBaseColorFactor(if is_painted || picture.is_some() { [1.0; 4] } else { SKIN }),
            base_color_texture: picture.map(|index| texture::Info { index, tex_coord: 0, extensions: None, extras: None }),
            metallic_factor: StrengthFactor(0.0),
            roughness_factor: StrengthFactor(surface.roughness),
            ..PbrMetallicRoughness::default()
        },
        ..Material::default()
    }
}

fn bounds(values: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let mut bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for value in values {
        for axis in 0..3 {
            bounds[0][axis] = bounds[0][axis].min(value[axis]);
            bounds[1][axis] = bounds[1][axis].max(value[axis]);
        }
    }
    bounds
}
