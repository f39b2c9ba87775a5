//! File format of the embedded head: the left half of a symmetric mesh and of its expression shapes, quantized and compressed.
//!
//! A file consists of [`MAGIC`], the length of a JSON description (u32, little-endian), the description, and a PNG picture with
//! one byte per pixel. The picture holds the numbers: first the high bytes of all, then the low bytes. Numbers are differences:
//! of a vertex from a neighbour with a lower index, or of a corner of a triangle from the previous corner. A number `n >= 0` is
//! stored as `2n`, a negative one as `-2n - 1`.

use serde::{Deserialize, Serialize};

use super::FeaturePointVertex;

/// First bytes of the file.
const MAGIC: &[u8; 8] = b"grimhead";
/// Version of the file format.
const SCHEMA: u32 = 1;
/// Quantization step of positions and of displacements in the mesh's unit (cm): 0.01 and 0.02 mm.
const STEPS: [f32; 2] = [0.001, 0.002];
/// Width of the PNG picture, px.
const WIDTH: usize = 1024;

/// Origin of a head mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeadMeshOrigin {
    /// Program and version.
    pub made_by: String,
    /// The command that made it.
    pub command: String,
    /// BLAKE3 hash of the source mesh and shapes, in hexadecimal.
    pub blake3: String,
    /// Authors and licence.
    pub credit: String,
}

/// A symmetric head with expression shapes, in centimetres.
///
/// Vertices are ordered: left half, middle, then right half in the order of the left.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadMesh {
    /// Number of vertices of the left half.
    pub left: usize,
    /// Number of vertices of the middle.
    pub middle: usize,
    /// Neutral positions.
    pub positions: Vec<[f32; 3]>,
    /// Triangles; the second half mirrors the first.
    pub triangles: Vec<[u32; 3]>,
    /// Vertex indices of the 68 landmarks.
    pub landmarks: Vec<u32>,
    /// Feature points.
    pub feature_points: Vec<FeaturePointVertex>,
    /// Names of the shapes.
    pub names: Vec<String>,
    /// Displacements of all vertices for each shape.
    pub shapes: Vec<Vec<[f32; 3]>>,
}

#[derive(Serialize, Deserialize)]
struct Description {
    schema: u32,
    left: usize,
    middle: usize,
    /// Number of triangles of one half.
    triangles: usize,
    landmarks: Vec<u32>,
    feature_points: Vec<(String, u32)>,
    /// Names of the shapes stored in the file; the twin of a one-sided shape follows from it.
    shapes: Vec<String>,
    origin: HeadMeshOrigin,
}

/// Name of a shape's mirror image; `None` for a shape of both sides.
pub fn twin(name: &str) -> Option<String> {
    let swap = |from: &str, to: &str| name.strip_suffix(from).map(|start| format!("{start}{to}"));
    [("_L", "_R"), ("_R", "_L"), ("Left", "Right"), ("Right", "Left")].iter().find_map(|(from, to)| swap(from, to))
}

/// Whether a shape is stored: the left one of two twins, or a shape of both sides.
fn is_stored(name: &str) -> bool {
    !name.ends_with("_R") && !name.ends_with("Right")
}

/// Returns the vertex that mirrors a vertex.
pub fn mirrored(vertex: u32, left: usize, middle: usize) -> u32 {
    let (left, half) = (left as u32, (left + middle) as u32);
    match vertex {
        v if v < left => v + half,
        v if v < half => v,
        v => v - half,
    }
}

/// Returns for every vertex of the left half and the middle a neighbour with a lower index, if it has one.
fn parents(half: usize, triangles: &[[u32; 3]]) -> Vec<Option<usize>> {
    let mut parents = vec![None; half];
    for &[a, b, c] in triangles {
        for (from, to) in [(a, b), (b, c), (c, a), (b, a), (c, b), (a, c)] {
            if to < from && (from as usize) < half {
                let parent: &mut Option<usize> = &mut parents[from as usize];
                *parent = Some(parent.map_or(to as usize, |p| p.max(to as usize)));
            }
        }
    }
    parents
}

fn folded(number: i32) -> Result<u16, String> {
    let folded = if number >= 0 { 2 * i64::from(number) } else { -2 * i64::from(number) - 1 };
    u16::try_from(folded).map_err(|_| format!("a difference of {number} steps does not fit"))
}

fn unfolded(number: u16) -> i32 {
    let half = i32::from(number / 2);
    if number.is_multiple_of(2) { half } else { -half - 1 }
}

/// Parent of a vertex; vertices of the right half have the mirror images of the parents.
fn parent(parents: &[Option<usize>], vertex: usize, left: usize, middle: usize) -> Option<usize> {
    let half = left + middle;
    if vertex < half { parents[vertex] } else { parents[vertex - half].map(|p| mirrored(p as u32, left, middle) as usize) }
}

fn png(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let height = bytes.len().div_ceil(WIDTH).max(1);
    let mut rows = bytes.to_vec();
    rows.resize(height * WIDTH, 0);
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, WIDTH as u32, height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_filter(png::Filter::NoFilter);
    let mut writer = encoder.write_header().map_err(|e| e.to_string())?;
    writer.write_image_data(&rows).map_err(|e| e.to_string())?;
    writer.finish().map_err(|e| e.to_string())?;
    Ok(out)
}

fn unpng(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().map_err(|e| e.to_string())?;
    let mut rows = vec![0; reader.output_buffer_size().ok_or("the picture is too large")?];
    reader.next_frame(&mut rows).map_err(|e| e.to_string())?;
    Ok(rows)
}

impl HeadMesh {
    /// Encodes the file.
    ///
    /// # Errors
    /// A message when the mesh is too large for the format.
    pub fn to_bytes(&self, origin: &HeadMeshOrigin) -> Result<Vec<u8>, String> {
        let (left, middle) = (self.left, self.middle);
        let half = left + middle;
        let one_side = &self.triangles[..self.triangles.len() / 2];
        let parents = parents(half, one_side);
        let mut numbers = Vec::new();
        let mut before = 0;
        for &corner in one_side.as_flattened() {
            numbers.push(folded(corner as i32 - before)?);
            before = corner as i32;
        }
        let mut push = |values: &[[f32; 3]], step: f32| -> Result<(), String> {
            for axis in 0..3 {
                let whole: Vec<i32> = values.iter().map(|v| (v[axis] / step).round() as i32).collect();
                for (vertex, number) in whole.iter().enumerate() {
                    let from = parent(&parents, vertex, left, middle).map_or(0, |p| whole[p]);
                    numbers.push(folded(number - from)?);
                }
            }
            Ok(())
        };
        push(&self.positions[..half], STEPS[0])?;
        let stored = || self.names.iter().zip(&self.shapes).filter(|(name, _)| is_stored(name));
        for (name, shape) in stored() {
            push(if twin(name).is_some() { shape } else { &shape[..half] }, STEPS[1])?;
        }
        let bytes: Vec<u8> = numbers.iter().map(|n| (n >> 8) as u8).chain(numbers.iter().map(|n| *n as u8)).collect();
        let description = Description {
            schema: SCHEMA,
            left,
            middle,
            triangles: one_side.len(),
            landmarks: self.landmarks.clone(),
            feature_points: self.feature_points.iter().map(|p| (p.fp.to_string(), p.vertex)).collect(),
            shapes: stored().map(|(name, _)| name.clone()).collect(),
            origin: origin.clone(),
        };
        let text = serde_json::to_vec(&description).map_err(|e| e.to_string())?;
        let mut file = MAGIC.to_vec();
        file.extend((text.len() as u32).to_le_bytes());
        file.extend(text);
        file.extend(png(&bytes)?);
        Ok(file)
    }

    /// Decodes a file.
    ///
    /// # Errors
    /// A message when the bytes are not such a file.
    pub fn from_bytes(bytes: &[u8]) -> Result<(Self, HeadMeshOrigin), String> {
        let rest = bytes.strip_prefix(MAGIC).ok_or("it does not begin as a head does")?;
        let (length, rest) = rest.split_first_chunk::<4>().ok_or("it ends early")?;
        let (text, picture) = rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or("it ends early")?;
        let d: Description = serde_json::from_slice(text).map_err(|e| e.to_string())?;
        if d.schema != SCHEMA || d.left.max(d.middle).max(d.triangles) > usize::from(u16::MAX) {
            return Err(format!("version {} with {} vertices a side is not read", d.schema, d.left));
        }
        let (left, middle) = (d.left, d.middle);
        let (half, whole) = (left + middle, 2 * left + middle);
        let rows: usize = d.shapes.iter().map(|name| if twin(name).is_some() { whole } else { half }).sum();
        let count = 3 * (d.triangles + half + rows);
        let bytes = unpng(picture)?;
        let (high, low) = bytes.get(..2 * count).ok_or("it has too few numbers")?.split_at(count);
        let mut numbers = high.iter().zip(low).map(|(&h, &l)| unfolded(u16::from_le_bytes([l, h])));
        let mut before = 0_i32;
        let corners: Vec<u32> = numbers
            .by_ref()
            .take(3 * d.triangles)
            .map(|n| {
                before = before.wrapping_add(n);
                before as u32
            })
            .collect();
        let all = corners.iter().chain(&d.landmarks).chain(d.feature_points.iter().map(|(_, vertex)| vertex));
        if let Some(vertex) = all.copied().find(|&v| v as usize >= whole) {
            return Err(format!("there is no vertex {vertex}"));
        }
        let mut triangles = corners.as_chunks::<3>().0.to_vec();
        let parents = parents(half, &triangles);
        let reflect = |v: u32| mirrored(v, left, middle);
        triangles.extend(triangles.clone().iter().map(|&[a, b, c]| [reflect(a), reflect(c), reflect(b)]));
        let mut pull = |count: usize, step: f32| -> Vec<[f32; 3]> {
            let mut values = vec![[0.0; 3]; count];
            for axis in 0..3 {
                let mut whole: Vec<i32> = Vec::with_capacity(count);
                for (vertex, number) in numbers.by_ref().take(count).enumerate() {
                    let from = parent(&parents, vertex, left, middle).map_or(0, |p| whole[p]);
                    whole.push(from.wrapping_add(number));
                }
                values.iter_mut().zip(whole).for_each(|(v, n)| v[axis] = n as f32 * step);
            }
            values
        };
        let complete = |mut values: Vec<[f32; 3]>| {
            values.extend_from_within(..left);
            values[half..].iter_mut().for_each(|v| v[0] = -v[0]);
            values
        };
        let positions = complete(pull(half, STEPS[0]));
        let (mut names, mut shapes) = (Vec::new(), Vec::new());
        for name in &d.shapes {
            match twin(name) {
                None => {
                    names.push(name.clone());
                    shapes.push(complete(pull(half, STEPS[1])));
                }
                Some(twin) => {
                    let shape = pull(whole, STEPS[1]);
                    let other = (0..whole as u32).map(|v| shape[reflect(v) as usize]).map(|[x, y, z]| [-x, y, z]).collect();
                    names.extend([name.clone(), twin]);
                    shapes.extend([shape, other]);
                }
            }
        }
        let point = |(fp, vertex): &(String, u32)| {
            fp.parse().map(|fp| FeaturePointVertex { fp, vertex: *vertex }).map_err(|_| format!("`{fp}` is no feature point"))
        };
        let feature_points = d.feature_points.iter().map(point).collect::<Result<_, _>>()?;
        Ok((Self { left, middle, positions, triangles, landmarks: d.landmarks, feature_points, names, shapes }, d.origin))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that share an edge in the middle; one shape of both sides and one of the left side.
    fn small() -> HeadMesh {
        HeadMesh {
            left: 1,
            middle: 2,
            positions: vec![[1.5, 0.0, 0.25], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [-1.5, 0.0, 0.25]],
            triangles: vec![[0, 1, 2], [3, 2, 1]],
            landmarks: vec![1, 2],
            feature_points: vec![FeaturePointVertex { fp: "8.1".parse().unwrap(), vertex: 3 }],
            names: ["jawOpen", "smile_L", "smile_R"].map(str::to_owned).to_vec(),
            shapes: vec![
                vec![[0.5, 0.0, 0.0], [0.0, -0.25, 0.0], [0.0; 3], [-0.5, 0.0, 0.0]],
                vec![[0.25, 0.5, 0.0], [0.0; 3], [0.0; 3], [0.0, 0.0, -4.0]],
                vec![[0.0, 0.0, -4.0], [0.0; 3], [0.0; 3], [-0.25, 0.5, 0.0]],
            ],
        }
    }

    #[test]
    fn written_values_read_back_within_a_step() {
        let origin = HeadMeshOrigin { credit: "nobody".to_owned(), ..HeadMeshOrigin::default() };
        let bytes = small().to_bytes(&origin).unwrap();
        let (read, from) = HeadMesh::from_bytes(&bytes).unwrap();
        let whole = small();
        assert_eq!((from, &read.triangles, &read.names), (origin, &whole.triangles, &whole.names));
        let pairs =
            read.positions.iter().zip(&whole.positions).chain(read.shapes.iter().flatten().zip(whole.shapes.iter().flatten()));
        for (a, b) in pairs {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4), "{a:?} {b:?}");
        }
    }

    #[test]
    fn damaged_files_are_errors_in_words() {
        let bytes = small().to_bytes(&HeadMeshOrigin::default()).unwrap();
        assert!(HeadMesh::from_bytes(b"grimloc\n").unwrap_err().contains("does not begin"));
        for length in 0..bytes.len() - 16 {
            assert!(HeadMesh::from_bytes(&bytes[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn small_numbers_stay_small() {
        assert_eq!([0, -1, 1, -2].map(|n| folded(n).unwrap()), [0, 1, 2, 3]);
        assert!((0..=u16::MAX).all(|n| folded(unfolded(n)).unwrap() == n));
        assert!(folded(40_000).is_err());
    }
}
