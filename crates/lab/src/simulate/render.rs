//! Renders nodes to pixels.
//!
//! The inverse warp is piecewise linear on the refined surface: each sample of the picture takes the texture at its position on the plane.
//! There are two samples per pixel and direction. Pixel (i, j) is the mean of the samples at `i ± 1/4`, `j ± 1/4`, so the centre of the
//! top-left pixel is (0, 0).

use grimace::internal::wireframe::LID_MARGINS;
use nalgebra::{Point2, Point3, Vector3};

use super::{
    camera::Exposure,
    eye::draw_eyes,
    mesh::{Anchor, SkinMesh},
    motion::HeadPose,
    mouth::draw_mouth,
    subject::{Colour, Subject},
    texture::{Texture, brightness},
};

/// Samples per pixel and direction.
pub const SAMPLES: usize = 2;
/// Depth of the skirt, model units, slightly behind the border of the face.
const SKIRT_DEPTH: f64 = -0.40;
/// Range of the brightness relative to neutral, when the direction of the surface changes.
const SHADE_RANGE: (f64, f64) = (0.80, 1.20);

/// The parts of a subject's surface that are the same in every frame.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Refined vertices of the neutral face, face space.
    neutral: Vec<Vector3<f64>>,
    /// Weight of the body, which does not rotate, in the motion of each refined vertex, 0 to 1.
    body: Vec<f64>,
    /// Brightness of the neutral surface at each refined vertex.
    brightness: Vec<f64>,
}

impl Surface {
    /// Computes the neutral surface of a subject.
    pub fn new(mesh: &SkinMesh, neutral: &[Point3<f64>]) -> Self {
        let coarse: Vec<Vector3<f64>> = mesh
            .anchors()
            .iter()
            .map(|anchor| match anchor {
                Anchor::Node(n) => Vector3::new(neutral[n.index()].z, 0.0, 0.0),
                Anchor::Head => Vector3::new(SKIRT_DEPTH, 0.0, 0.0),
                Anchor::Body => Vector3::new(SKIRT_DEPTH, 1.0, 0.0),
            })
            .collect();
        let fine = mesh.refine(&coarse);
        let vertices: Vec<Vector3<f64>> = mesh.plane().iter().zip(&fine).map(|(p, f)| Vector3::new(p.x, p.y, f.x)).collect();
        let shade = normals(mesh, &vertices).into_iter().map(|n| f64::from(brightness(n.cast()))).collect();
        Self { neutral: vertices, body: fine.iter().map(|f| f.y.clamp(0.0, 1.0)).collect(), brightness: shade }
    }
}

/// Returns the offsets of the coarse vertices: those of the nodes, and zero for the skirt, which does not follow the expression.
fn coarse(mesh: &SkinMesh, offsets: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let offset = |anchor: &Anchor| if let Anchor::Node(n) = anchor { offsets[n.index()] } else { Vector3::zeros() };
    mesh.anchors().iter().map(offset).collect()
}

/// Returns the unit normals at the refined vertices.
fn normals(mesh: &SkinMesh, vertices: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); vertices.len()];
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|k| vertices[k as usize]);
        let normal = (b - a).cross(&(c - a));
        // A few triangles of Candide-3 have reversed winding; all normals must point towards the viewer.
        let normal = if normal.z < 0.0 { -normal } else { normal };
        for &k in triangle {
            sums[k as usize] += normal;
        }
    }
    sums.into_iter().map(|n| n.try_normalize(1e-12).unwrap_or_else(Vector3::z)).collect()
}

/// A vertex in the picture: sample coordinates, plane coordinates, brightness relative to neutral.
#[derive(Clone, Copy, Debug)]
struct Corner {
    x: f64,
    y: f64,
    plane: Point2<f64>,
    shade: f64,
}

/// Samples of the picture, premultiplied RGBA; alpha 0 is background.
#[derive(Clone, Debug)]
pub struct Samples {
    /// Samples per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub data: Vec<[u8; 4]>,
}

impl Samples {
    /// Returns the sample coordinates of an image point.
    pub fn from_image(p: Point2<f64>) -> Point2<f64> {
        Point2::from(p.coords * SAMPLES as f64).map(|c| c + (SAMPLES as f64 - 1.0) / 2.0)
    }

    /// Returns the image point of a sample.
    pub fn to_image(x: usize, y: usize) -> Point2<f64> {
        Point2::new(x as f64, y as f64).map(|c| (c - (SAMPLES as f64 - 1.0) / 2.0) / SAMPLES as f64)
    }

    /// Returns the samples inside the box of image points, with a margin, as ranges of x and y.
    pub fn window(&self, points: &[Point2<f64>], margin_px: f64) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let range = |values: &mut dyn Iterator<Item = f64>, size: usize| {
            let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            let to_sample = |v: f64| Self::from_image(Point2::new(v, v)).x;
            let from = to_sample(low - margin_px).floor().clamp(0.0, size as f64) as usize;
            let to = to_sample(high + margin_px).ceil().clamp(from as f64, size as f64) as usize;
            from..to
        };
        (range(&mut points.iter().map(|p| p.x), self.width), range(&mut points.iter().map(|p| p.y), self.height))
    }

    /// Blends an opaque colour (0 to 255) over a sample with the given coverage.
    pub fn lay(&mut self, x: usize, y: usize, coverage: f64, colour: [f32; 3]) {
        let sample = &mut self.data[y * self.width + x];
        let coverage = coverage.clamp(0.0, 1.0) as f32;
        for (channel, value) in sample.iter_mut().zip([colour[0], colour[1], colour[2], 255.0]) {
            *channel = (f32::from(*channel) * (1.0 - coverage) + value.clamp(0.0, 255.0) * coverage + 0.5) as u8;
        }
    }
}

/// Renders a subject whose nodes are moved by `offsets` (model units of face space) and seen under `pose`.
pub fn render(subject: &Subject, texture: &Texture, offsets: &[Vector3<f64>], pose: &HeadPose, size: (u32, u32)) -> Samples {
    let mesh = &subject.mesh;
    let surface = &subject.surface;
    let moved: Vec<Vector3<f64>> = mesh.refine(&coarse(mesh, offsets)).iter().zip(&surface.neutral).map(|(d, n)| n + d).collect();
    let shades = normals(mesh, &moved);
    let still = pose.without_turn();
    let corners: Vec<Corner> = (0..moved.len())
        .map(|k| {
            let point = Point3::from(moved[k]);
            let head = pose.project(&point);
            let body = surface.body[k];
            let image = if body > 0.0 { head + (still.project(&point) - head) * body } else { head };
            let sample = Samples::from_image(image);
            let shade = f64::from(brightness((pose.turn() * shades[k]).cast())) / surface.brightness[k].max(0.1);
            Corner { x: sample.x, y: sample.y, plane: mesh.plane()[k], shade: shade.clamp(SHADE_RANGE.0, SHADE_RANGE.1) }
        })
        .collect();
    let (width, height) = (size.0 as usize * SAMPLES, size.1 as usize * SAMPLES);
    let mut samples = Samples { width, height, data: vec![[0; 4]; width * height] };
    for eye in LID_MARGINS {
        // The skin continues under the lids, so that no gap opens between the curve of a lid and its triangles.
        let [upper, lower] = eye;
        for k in 0..4 {
            let quad = [upper[k], upper[k + 1], lower[k], lower[k + 1]].map(|n| {
                let n = usize::from(n);
                let sample = Samples::from_image(pose.project(&(subject.neutral()[n] + offsets[n])));
                Corner { x: sample.x, y: sample.y, plane: subject.neutral()[n].xy(), shade: 1.0 }
            });
            fill(&mut samples, texture, [quad[0], quad[1], quad[2]]);
            fill(&mut samples, texture, [quad[1], quad[2], quad[3]]);
        }
    }
    for triangle in mesh.triangles() {
        fill(&mut samples, texture, triangle.map(|k| corners[k as usize]));
    }
    draw_mouth(&mut samples, subject, offsets, pose);
    draw_eyes(&mut samples, subject, offsets, pose);
    samples
}

/// Fills one triangle with the texture.
fn fill(samples: &mut Samples, texture: &Texture, [a, b, c]: [Corner; 3]) {
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area.abs() < 1e-9 {
        return;
    }
    let clip = |value: f64, size: usize| value.clamp(0.0, size as f64) as usize;
    let low_y = clip(a.y.min(b.y).min(c.y).ceil(), samples.height);
    let high_y = clip(a.y.max(b.y).max(c.y).floor() + 1.0, samples.height);
    // Values are linear over the triangle: the value at a, and slopes in x and y.
    let plane_of = |qa: f64, qb: f64, qc: f64| {
        let dx = ((qb - qa) * (c.y - a.y) - (qc - qa) * (b.y - a.y)) / area;
        let dy = ((qc - qa) * (b.x - a.x) - (qb - qa) * (c.x - a.x)) / area;
        move |x: f64, y: f64| (qa + dx * (x - a.x) + dy * (y - a.y), dx)
    };
    let u = plane_of(a.plane.x, b.plane.x, c.plane.x);
    let v = plane_of(a.plane.y, b.plane.y, c.plane.y);
    let shade = plane_of(a.shade, b.shade, c.shade);
    for y in low_y..high_y {
        let Some((from, to)) = span([a, b, c], y as f64) else { continue };
        // A margin on both sides makes neighbouring triangles overlap instead of leaving a gap.
        let (from, to) = (clip((from - 1e-6).ceil(), samples.width), clip((to + 1e-6).floor() + 1.0, samples.width));
        let ((mut pu, du), (mut pv, dv), (mut ps, ds)) =
            (u(from as f64, y as f64), v(from as f64, y as f64), shade(from as f64, y as f64));
        for sample in &mut samples.data[y * samples.width + from..y * samples.width + to.max(from)] {
            let [r, g, b, alpha] = texture.sample(pu as f32, pv as f32);
            let s = ps as f32;
            let byte = |c: f32| (c.min(255.0) + 0.5) as u8;
            *sample = [byte(r * s), byte(g * s), byte(b * s), byte(alpha)];
            pu += du;
            pv += dv;
            ps += ds;
        }
    }
}

/// Returns the interval in which a row crosses a triangle.
fn span(corners: [Corner; 3], y: f64) -> Option<(f64, f64)> {
    let mut range: Option<(f64, f64)> = None;
    for k in 0..3 {
        let (p, q) = (corners[k], corners[(k + 1) % 3]);
        let (p, q) = if p.y <= q.y { (p, q) } else { (q, p) };
        if y < p.y || y > q.y {
            continue;
        }
        let ends = if q.y > p.y { [p.x + (q.x - p.x) * (y - p.y) / (q.y - p.y); 2] } else { [p.x, q.x] };
        for x in ends {
            range = Some(range.map_or((x, x), |(low, high)| (low.min(x), high.max(x))));
        }
    }
    range
}

/// Accumulates the samples of one or more sub-frames while the shutter is open.
#[derive(Clone, Debug)]
pub struct Film {
    width: usize,
    height: usize,
    /// Sums of premultiplied RGBA over the samples of a pixel.
    sums: Vec<[u32; 4]>,
    subframes: u32,
}

impl Film {
    /// Makes unexposed film of a size in pixels.
    pub fn new((width, height): (u32, u32)) -> Self {
        let (width, height) = (width as usize, height as usize);
        Self { width, height, sums: vec![[0; 4]; width * height], subframes: 0 }
    }

    /// Adds a sub-frame.
    pub fn expose(&mut self, samples: &Samples) {
        self.subframes += 1;
        for (y, sums) in self.sums.chunks_exact_mut(self.width).enumerate() {
            for row in 0..SAMPLES {
                let line = &samples.data[(y * SAMPLES + row) * samples.width..][..samples.width];
                for (x, sum) in sums.iter_mut().enumerate() {
                    for sample in &line[x * SAMPLES..][..SAMPLES] {
                        sum[0] += u32::from(sample[0]);
                        sum[1] += u32::from(sample[1]);
                        sum[2] += u32::from(sample[2]);
                        sum[3] += u32::from(sample[3]);
                    }
                }
            }
        }
    }

    /// Returns the mean of the sub-frames over a soft studio background of the given colour.
    pub fn exposure(&self, base: Colour) -> Exposure {
        let (width, height) = (self.width, self.height);
        let quota = ((SAMPLES * SAMPLES) as u32 * self.subframes.max(1)) as f32;
        let mut data = Vec::with_capacity(width * height * 3);
        for (k, sum) in self.sums.iter().enumerate() {
            let v = (k / width) as f32 / height as f32 - 0.4;
            let u = ((k % width) as f32 - width as f32 * 0.42) / height as f32;
            let empty = 1.0 - sum[3] as f32 / (quota * 255.0);
            let light = 255.0 * (1.06 - 0.42 * (u * u + v * v)).max(0.5) * empty;
            data.extend((0..3).map(|n| sum[n] as f32 / quota + base[n] * light));
        }
        Exposure { width, height, data }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::simulate::{Emotion, SimulateOptions, SimulatedSequence};

    /// Period of the test pattern on the plane, model units.
    const PERIOD: f64 = 0.2;

    /// A texture that encodes one coordinate: red is its sine, green its cosine, blue a reference that shading changes in the same way.
    fn pattern(texture: &Texture, pick: fn(f32, f32) -> f32) -> Texture {
        texture.repainted(|x, y| {
            let angle = f64::from(pick(x, y)) / PERIOD * TAU;
            [(100.0 + 90.0 * angle.sin()).round() as u8, (100.0 + 90.0 * angle.cos()).round() as u8, 100]
        })
    }

    /// Returns the difference between the plane coordinate in a sample and the expected one; model units, modulo whole periods.
    fn miss(samples: &Samples, x: usize, y: usize, expected: f64) -> f64 {
        let [sine, cosine, light, _] = samples.data[y * samples.width + x].map(f64::from);
        let angle = (sine / light * 100.0 - 100.0).atan2(cosine / light * 100.0 - 100.0) - expected / PERIOD * TAU;
        angle.sin().atan2(angle.cos()) / TAU * PERIOD
    }

    #[test]
    fn the_picture_shows_every_node_at_its_true_position() {
        let options = SimulateOptions { frames: 2, yaw_degrees: 5.0, pitch_degrees: 5.0, ..SimulateOptions::default() };
        let subject = Subject::new(&options, 2).unwrap();
        let patterns = [pattern(&subject.texture, |x, _| x), pattern(&subject.texture, |_, y| y)];
        let px = super::super::motion::px_per_unit(&options);
        // At the edge of an opening the sample may show the eye or the mouth; eyeballs are not skin.
        let lips = [87, 81, 82, 88, 89, 40, 83, 84];
        let edge: Vec<u16> = LID_MARGINS.concat().concat().into_iter().chain(lips).collect();
        let mut checked = 0;
        for (emotion, frame) in [(Emotion::Anger, 0), (Emotion::Surprise, 1), (Emotion::Happiness, 1), (Emotion::Disgust, 1)] {
            let sequence = SimulatedSequence::new(&subject, emotion, &options).unwrap();
            let (nodes, offsets, pose) = (sequence.nodes(frame), sequence.offsets(frame as f64), sequence.pose(frame));
            for anchor in subject.mesh.anchors() {
                let Anchor::Node(node) = anchor else { continue };
                if edge.contains(&node.0) {
                    continue;
                }
                // The pose is shifted so that the node falls on a sample in the middle of a small picture; no interpolation is needed.
                let pose = pose.shifted(Samples::to_image(32, 32) - nodes[node.index()]);
                let plane = subject.neutral()[node.index()];
                let [x, y] = patterns.each_ref().map(|p| render(&subject, p, &offsets, &pose, (32, 32)));
                let error = miss(&x, 32, 32, plane.x).hypot(miss(&y, 32, 32, plane.y)) * px;
                // 8 bits resolve 0.5 / 90 / tau of the period (0.03 px), or twice that where shading darkens, in x and in y.
                assert!(error < 0.1, "{emotion} frame {frame} node {node}: {error:.3} px");
                checked += 1;
            }
        }
        // 96 skin nodes minus 16 of the lid margins and 8 of the inner lips, each in four frames.
        assert_eq!(checked, (96 - 16 - 8) * 4);
    }

    #[test]
    fn expressions_hardly_fold_the_surface() {
        let options = SimulateOptions { frames: 2, width: 64, height: 64, ..SimulateOptions::default() };
        for index in 0..8 {
            let subject = Subject::new(&options, index).unwrap();
            let mesh = &subject.mesh;
            for emotion in Emotion::ALL {
                let offsets = SimulatedSequence::new(&subject, emotion, &options).unwrap().offsets(1.0);
                let moved = mesh.refine(&coarse(mesh, &offsets));
                let area = |t: &[u32; 3], share: f64| {
                    let [a, b, c] = t.map(|k| mesh.plane()[k as usize] + moved[k as usize].xy() * share);
                    (b - a).perp(&(c - a)) / 2.0
                };
                let folded: f64 =
                    mesh.triangles().iter().filter(|t| area(t, 0.0) * area(t, 1.0) < 0.0).map(|t| area(t, 1.0).abs()).sum();
                // The face covers about 2 square units. A lid may slide under its fold, and a lip under the nose.
                assert!(folded < 0.006, "subject {index}, {emotion}: {folded} square units are folded");
            }
        }
    }

    #[test]
    fn an_open_mouth_is_dark_and_eyes_show_a_pupil() {
        let options = SimulateOptions { noise_sigma: 0.0, ..SimulateOptions::default() };
        let subject = Subject::new(&options, 0).unwrap();
        let sequence = SimulatedSequence::new(&subject, Emotion::Surprise, &options).unwrap();
        let apex = sequence.frame(options.frames - 1);
        let grey = |p: Point2<f64>| {
            let [r, g, b] = apex.image.get_pixel(p.x.round() as u32, p.y.round() as u32).0.map(f64::from);
            (r + g + b) / 3.0
        };
        let (upper, lower) = (apex.nodes[87], apex.nodes[40]);
        assert!(lower.y - upper.y > 15.0, "the lips part by {:.1} px", lower.y - upper.y);
        let inside = grey(upper + (lower - upper) * 0.5);
        let chin = grey(nalgebra::center(&apex.nodes[9], &apex.nodes[10]));
        assert!(inside < 0.5 * chin, "inside {inside:.0}, chin {chin:.0}");
        let pupil = nalgebra::center(
            &nalgebra::center(&apex.nodes[67], &apex.nodes[68]),
            &nalgebra::center(&apex.nodes[71], &apex.nodes[72]),
        );
        assert!(grey(pupil) < 0.3 * chin, "pupil {:.0}", grey(pupil));
    }
}
