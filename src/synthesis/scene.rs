//! Draws a face: its mesh, eyeballs in holes for eyes, and dark cavities in its other openings.

use image::RgbImage;

use super::{Bank, HeadTexture};
use crate::{
    mesh::{add, colour::linear, sphere_front, vertex_normals},
    render::{Canvas, Shade, Vertex},
    units::FeaturePoint,
};

/// Viewpoint and picture size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Width and height of the picture, px.
    pub size: (u32, u32),
    /// Turn of the head about y, degrees; positive shows more of its right side.
    pub yaw_degrees: f32,
    /// Nod of the head about x, degrees; positive looks down.
    pub pitch_degrees: f32,
}

impl View {
    /// The view from the front.
    pub fn front(width: u32, height: u32) -> Self {
        Self { size: (width, height), yaw_degrees: 0.0, pitch_degrees: 0.0 }
    }

    /// The view with the head turned by this yaw.
    pub fn turned(self, yaw_degrees: f32) -> Self {
        Self { yaw_degrees, ..self }
    }
}

/// A part that does not move, with its own triangles.
#[derive(Clone, Debug)]
struct Prop {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    shade: Shade,
}

/// The drawable parts of a bank's mesh.
#[derive(Debug)]
pub struct FaceScene<'b> {
    bank: &'b Bank,
    /// Appearance of each triangle of the mesh.
    shades: Vec<Shade>,
    /// Whether each triangle of a painted mesh is a hair, that is a part of its own.
    hairs: Vec<bool>,
    hides_hair: bool,
    /// Colours of the vertices of a painted bank, linear light.
    paint: Option<Vec<[f32; 3]>>,
    eyes: Vec<Prop>,
    /// Borders of the openings other than eyes, as closed chains of vertices.
    openings: Vec<Vec<u32>>,
    /// Middle of the face, and half its larger extent.
    middle: [f32; 3],
    reach: f32,
}

/// Fraction of the picture's smaller side that the face fills.
const FILLING: f32 = 0.90;
/// Depth of the inside of an opening behind its border, as a fraction of its width.
const CAVITY_DEPTH: f32 = 0.25;
/// Radius of an eyeball, as a fraction of half the width of its opening.
const EYE_FIT: f32 = 1.02;
/// Radius of an iris as a fraction of the opening of the lids, slightly more than half so that they cover part of it; and its
/// largest radius as a fraction of the eyeball's.
const IRIS: (f32, f32) = (0.60, 0.48);

/// sRGB colours of vertices: white of the eye; pupil, iris and rim, each up to this fraction of the radius of the iris.
const WHITE: [u8; 3] = [230, 224, 217];
const EYE: [(f32, [u8; 3]); 3] = [(0.42, [13, 13, 15]), (1.0, [74, 102, 117]), (1.12, [51, 61, 69])];

/// Radius of the iris of an eyeball.
fn iris(bank: &Bank, eyeball: f32) -> f32 {
    let lid = |point: u8| bank.feature_point_position(FeaturePoint { group: 3, point });
    let opening = lid(1).zip(lid(3)).map_or(f32::INFINITY, |(upper, lower)| (upper[1] - lower[1]).abs());
    (IRIS.0 * opening).min(IRIS.1 * eyeball)
}

/// An eyeball that is added to a mesh.
#[derive(Clone, Copy, Debug)]
pub struct DrawnEye<'a> {
    /// Its vertices.
    pub positions: &'a [[f32; 3]],
    /// Its triangles.
    pub triangles: &'a [[u32; 3]],
    /// Centre of the ball.
    pub centre: [f32; 3],
    /// Radius of the iris.
    pub iris: f32,
}

impl<'b> FaceScene<'b> {
    /// Default colour of skin, sRGB.
    pub const SKIN: [u8; 3] = [199, 148, 125];

    /// Identifies the parts of a bank's mesh.
    ///
    /// A part without feature points that no member moves is an eyeball. A hole around the corners of an eye gets an eyeball if
    /// the mesh has none. Other holes are openings.
    pub fn new(bank: &'b Bank) -> Self {
        let part = parts(bank);
        let (shades, has_eyes) = shades(bank, &part);
        let mut loops = bank.mesh().border_loops();
        // The longest border on the part with feature points is the outline of the face; eyeballs have outlines of their own.
        let face = bank.feature_points().first().map_or(0, |p| part[p.vertex as usize]);
        loops.retain(|walk| part[walk[0] as usize] == face);
        let mut openings = if loops.is_empty() { Vec::new() } else { loops.split_off(1) };
        let mut eyes = Vec::new();
        openings.retain(|walk| match eyeball(bank, walk) {
            Some(eye) => {
                eyes.push(eye);
                false
            }
            None => true,
        });
        if has_eyes {
            eyes.clear();
        }
        let [low, high] = bank.mesh().bounds();
        let middle = add(low, high).map(|c| c / 2.0);
        let reach = (0..2).map(|k| (high[k] - low[k]) / 2.0).fold(0.0, f32::max);
        let paint = bank.paint().map(|paint| paint.iter().map(|colour| colour.map(linear)).collect());
        let is_painted = bank.paint().is_some();
        let mut sizes = vec![0_usize; part.len()];
        part.iter().for_each(|&p| sizes[p as usize] += 1);
        let is_hair = |t: &[u32; 3]| is_painted && part[t[0] as usize] != face && sizes[part[t[0] as usize] as usize] <= 3;
        let hairs = bank.mesh().triangles().iter().map(is_hair).collect();
        Self { bank, shades, hairs, hides_hair: false, paint, eyes, openings, middle, reach }
    }

    /// Returns the eyeballs that are added because the mesh has none.
    pub fn eyes(&self) -> impl Iterator<Item = DrawnEye<'_>> {
        self.eyes.iter().filter_map(|prop| match prop.shade {
            Shade::Eye { centre, iris } => {
                Some(DrawnEye { positions: &prop.positions, triangles: &prop.triangles, centre, iris })
            }
            _ => None,
        })
    }

    /// Colours of all vertices, sRGB: the bank's own, or the colours of skin and of the mesh's eyes; `None` if everything is
    /// skin.
    pub fn colours(&self) -> Option<Vec<[u8; 3]>> {
        if let Some(paint) = self.bank.paint() {
            return Some(paint.to_vec());
        }
        let mut colours = vec![Self::SKIN; self.bank.vertex_count()];
        let mut found = false;
        for (triangle, shade) in self.bank.mesh().triangles().iter().zip(&self.shades) {
            let Shade::Eye { centre, iris } = *shade else { continue };
            found = true;
            for &v in triangle {
                let [x, y, _] = self.bank.mesh().positions()[v as usize];
                let far = (x - centre[0]).hypot(y - centre[1]) / iris;
                colours[v as usize] = EYE.iter().find(|(reach, _)| far < *reach).map_or(WHITE, |(_, colour)| *colour);
            }
        }
        found.then_some(colours)
    }

    /// Replaces the skin's colours by those of a texture, sampled at the vertices, and hides the hair.
    #[must_use]
    pub fn with_texture(mut self, texture: &HeadTexture) -> Self {
        self.paint = Some(texture.colours.iter().map(|colour| colour.map(linear)).collect());
        for shade in self.shades.iter_mut().filter(|shade| matches!(shade, Shade::Skin)) {
            *shade = Shade::Painted { wet: false };
        }
        self.hides_hair = true;
        self
    }

    /// Triangles of the skin.
    pub fn skin(&self) -> Vec<[u32; 3]> {
        self.surfaces().swap_remove(0).1
    }

    /// Triangles of the eyes; none if the mesh has no eyes of its own.
    pub fn eye_triangles(&self) -> Vec<[u32; 3]> {
        self.surfaces().into_iter().find(|(name, _)| *name == "eyes").map(|(_, eyes)| eyes).unwrap_or_default()
    }

    /// Triangles by kind: `skin`, `eyes`, `mouth` and `hair`, in this order; the last three only if there are any.
    pub fn surfaces(&self) -> Vec<(&'static str, Vec<[u32; 3]>)> {
        let mut surfaces: Vec<(&'static str, Vec<[u32; 3]>)> =
            ["skin", "eyes", "mouth", "hair"].map(|name| (name, Vec::new())).into();
        let height =
            |triangle: &[u32; 3]| triangle.iter().map(|&v| self.bank.mesh().positions()[v as usize][1]).sum::<f32>() / 3.0;
        // Eyes are above the tip of the nose.
        let nose = self.bank.feature_point_position(FeaturePoint { group: 9, point: 3 }).map_or(f32::INFINITY, |p| p[1]);
        for ((triangle, shade), is_hair) in self.bank.mesh().triangles().iter().zip(&self.shades).zip(&self.hairs) {
            let place = match shade {
                _ if *is_hair => 3,
                Shade::Eye { .. } => 1,
                Shade::Painted { wet: true } if height(triangle) > nose => 1,
                Shade::Painted { wet: true } => 2,
                _ => 0,
            };
            surfaces[place].1.push(*triangle);
        }
        surfaces.retain(|(name, triangles)| *name == "skin" || !triangles.is_empty());
        surfaces
    }

    /// Borders of the openings other than eyes, as closed chains of vertices.
    pub fn openings(&self) -> &[Vec<u32>] {
        &self.openings
    }

    /// Draws the face with displacements from neutral.
    pub fn draw(&self, displacements: &[[f32; 3]], view: View) -> RgbImage {
        self.canvas(displacements, view).picture()
    }

    /// Draws the neutral face with its feature points as dots.
    pub fn draw_feature_points(&self, view: View) -> RgbImage {
        let still = vec![[0.0; 3]; self.bank.vertex_count()];
        let mut canvas = self.canvas(&still, view);
        let camera = Camera::new(self, view);
        let radius = 0.009 * view.size.0.min(view.size.1) as f32;
        for point in self.bank.feature_points() {
            let position = self.bank.mesh().positions()[point.vertex as usize];
            let at = camera.place(position);
            for (size, colour, lift) in [(1.35, [0.02, 0.02, 0.02], 0.049), (1.0, [0.93, 0.68, 0.0], 0.05)] {
                disc(&mut canvas, [at[0], at[1], at[2] + lift * self.reach], size * radius, colour);
            }
        }
        canvas.picture()
    }

    fn canvas(&self, displacements: &[[f32; 3]], view: View) -> Canvas {
        let mesh = self.bank.mesh();
        let positions: Vec<[f32; 3]> = mesh.positions().iter().zip(displacements).map(|(&p, &d)| add(p, d)).collect();
        let normals = vertex_normals(&positions, mesh.triangles());
        let camera = Camera::new(self, view);
        let mut canvas = Canvas::new(view.size.0, view.size.1);
        let models = self.paint.as_deref().unwrap_or(mesh.positions());
        let corners: Vec<Vertex> =
            positions.iter().zip(&normals).zip(models).map(|((&p, &n), &m)| camera.vertex(p, n, m)).collect();
        for ((triangle, &shade), &is_hair) in mesh.triangles().iter().zip(&self.shades).zip(&self.hairs) {
            if is_hair && self.hides_hair {
                continue;
            }
            // The colour of an eyeball depends on the position in the model, whatever the colour of the skin.
            let is_eye = matches!(shade, Shade::Eye { .. });
            let corner =
                |v: u32| Vertex { model: if is_eye { mesh.positions() } else { models }[v as usize], ..corners[v as usize] };
            canvas.triangle(triangle.map(corner), shade);
        }
        for eye in &self.eyes {
            let corners: Vec<Vertex> = eye.positions.iter().zip(&eye.normals).map(|(&p, &n)| camera.vertex(p, n, p)).collect();
            for triangle in &eye.triangles {
                canvas.triangle(triangle.map(|v| corners[v as usize]), eye.shade);
            }
        }
        for walk in &self.openings {
            let (positions, triangles) = cavity(walk, &positions);
            let corners: Vec<Vertex> = positions.iter().map(|&p| camera.vertex(p, [0.0, 0.0, 1.0], p)).collect();
            for triangle in triangles {
                canvas.triangle(triangle.map(|v| corners[v as usize]), Shade::Cavity);
            }
        }
        canvas
    }
}

/// Index of the connected part of every vertex.
fn parts(bank: &Bank) -> Vec<u32> {
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    let mut parent: Vec<u32> = (0..bank.vertex_count() as u32).collect();
    for &[a, b, c] in bank.mesh().triangles() {
        for (from, to) in [(a, b), (b, c)] {
            let (p, q) = (root(&mut parent, from), root(&mut parent, to));
            parent[p.max(q) as usize] = p.min(q);
        }
    }
    (0..parent.len() as u32).map(|v| root(&mut parent, v)).collect()
}

/// Returns the appearance of every triangle, and whether the mesh has its own eyeballs.
fn shades(bank: &Bank, part: &[u32]) -> (Vec<Shade>, bool) {
    let mut moving = vec![false; part.len()];
    bank.feature_points().iter().for_each(|p| moving[part[p.vertex as usize] as usize] = true);
    for member in 0..bank.member_count() {
        for (v, displacement) in bank.displacements(member).iter().enumerate() {
            if *displacement != [0.0; 3] {
                moving[part[v] as usize] = true;
            }
        }
    }
    let mut bounds = vec![[[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]]; part.len()];
    for (position, &part) in bank.mesh().positions().iter().zip(part) {
        let [low, high] = &mut bounds[part as usize];
        for k in 0..3 {
            low[k] = low[k].min(position[k]);
            high[k] = high[k].max(position[k]);
        }
    }
    let mut sizes = vec![0_usize; part.len()];
    part.iter().for_each(|&p| sizes[p as usize] += 1);
    let face = bank.feature_points().first().map_or(0, |p| part[p.vertex as usize] as usize);
    let shade = |triangle: &[u32; 3]| {
        let part = part[triangle[0] as usize] as usize;
        if bank.paint().is_some() {
            // Eyes, teeth and the tongue are separate parts, and so are hairs, of a single triangle each.
            return Shade::Painted { wet: part != face && sizes[part] > 3 };
        }
        if moving[part] {
            return Shade::Skin;
        }
        let [low, high] = bounds[part];
        Shade::Eye { centre: add(low, high).map(|c| c / 2.0), iris: iris(bank, (high[0] - low[0]) / 2.0) }
    };
    let shades: Vec<Shade> = bank.mesh().triangles().iter().map(shade).collect();
    let has_eyes = bank.paint().is_some() || shades.iter().any(|s| matches!(s, Shade::Eye { .. }));
    (shades, has_eyes)
}

/// Returns an eyeball for a hole if the corners of an eye lie on its border or next to it.
fn eyeball(bank: &Bank, walk: &[u32]) -> Option<Prop> {
    let position = |v: u32| bank.mesh().positions()[v as usize];
    let border: Vec<[f32; 3]> = walk.iter().map(|&v| position(v)).collect();
    let count = border.len() as f32;
    let centre = border.iter().fold([0.0; 3], |sum, &p| add(sum, p)).map(|c| c / count);
    let half = border.iter().map(|p| (p[0] - centre[0]).abs()).fold(0.0, f32::max);
    let corner = |group: u8, point: u8| bank.feature_point_position(FeaturePoint { group, point });
    let eyes = [(corner(3, 7), corner(3, 11)), (corner(3, 12), corner(3, 8))];
    let is_eye = eyes.iter().any(|&(outer, inner)| {
        outer.zip(inner).is_some_and(|(o, i)| {
            (f32::midpoint(o[0], i[0]) - centre[0]).hypot(f32::midpoint(o[1], i[1]) - centre[1]) < half / 2.0
        })
    });
    if !is_eye {
        return None;
    }
    let radius = EYE_FIT * half;
    // The centre lies behind the border, at the distance at which the ball meets the border on average.
    let across = border.iter().map(|p| (p[0] - centre[0]).powi(2) + (p[1] - centre[1]).powi(2)).sum::<f32>() / count;
    let behind = (radius * radius - across).max(0.0).sqrt();
    let centre = [centre[0], centre[1], centre[2] - behind];
    let (positions, triangles) = sphere_front(centre, radius, 24, 48);
    let normals = positions.iter().map(|p| [p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]].map(|c| c / radius)).collect();
    Some(Prop { positions, normals, triangles, shade: Shade::Eye { centre, iris: iris(bank, radius) } })
}

/// Returns the inside of an opening: a fan of triangles behind its border.
fn cavity(walk: &[u32], positions: &[[f32; 3]]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let border = walk.iter().map(|&v| positions[v as usize]);
    let (low, high) = border.clone().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), p| (l.min(p[0]), h.max(p[0])));
    let back = CAVITY_DEPTH * (high - low);
    let mut points: Vec<[f32; 3]> = border.map(|[x, y, z]| [x, y, z - 0.02 * back]).collect();
    let count = points.len() as u32;
    let middle = points.iter().fold([0.0; 3], |sum, &p| add(sum, p)).map(|c| c / count as f32);
    points.push([middle[0], middle[1], middle[2] - back]);
    (points, (0..count).map(|k| [k, (k + 1) % count, count]).collect())
}

fn disc(canvas: &mut Canvas, at: [f32; 3], radius: f32, colour: [f32; 3]) {
    const SIDES: u32 = 20;
    let vertex = |x: f32, y: f32| Vertex { at: [x, y, at[2]], normal: [0.0, 0.0, 1.0], model: [0.0; 3] };
    let rim = |k: u32| {
        let (sin, cos) = (k as f32 / SIDES as f32 * std::f32::consts::TAU).sin_cos();
        vertex(at[0] + radius * cos, at[1] + radius * sin)
    };
    for k in 0..SIDES {
        canvas.triangle([vertex(at[0], at[1]), rim(k), rim(k + 1)], Shade::Flat(colour));
    }
}

/// An orthographic camera that looks at the middle of the face.
struct Camera {
    middle: [f32; 3],
    scale: f32,
    half: [f32; 2],
    yaw: (f32, f32),
    pitch: (f32, f32),
}

impl Camera {
    fn new(scene: &FaceScene<'_>, view: View) -> Self {
        let (width, height) = (view.size.0 as f32, view.size.1 as f32);
        let scale = if scene.reach > 0.0 { FILLING * width.min(height) / (2.0 * scene.reach) } else { 1.0 };
        let turn = |degrees: f32| degrees.to_radians().sin_cos();
        Self {
            middle: scene.middle,
            scale,
            half: [width / 2.0, height / 2.0],
            yaw: turn(view.yaw_degrees),
            pitch: turn(view.pitch_degrees),
        }
    }

    fn rotate(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        let ((sy, cy), (sp, cp)) = (self.yaw, self.pitch);
        let (x, z) = (cy * x + sy * z, cy * z - sy * x);
        [x, cp * y - sp * z, sp * y + cp * z]
    }

    fn place(&self, position: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = self.rotate([position[0] - self.middle[0], position[1] - self.middle[1], position[2] - self.middle[2]]);
        [self.half[0] + self.scale * x, self.half[1] - self.scale * y, z]
    }

    fn vertex(&self, position: [f32; 3], normal: [f32; 3], model: [f32; 3]) -> Vertex {
        Vertex { at: self.place(position), normal: self.rotate(normal), model }
    }
}
