//! Export of a prepared face as plain numbers, for the page of [`crate::player`].

use image::{Rgba32FImage, RgbaImage};
use nalgebra::{Point2, Vector2};

use super::{
    Opening, Texture, Warp, folds, furrows::Furrows, hollow::Hollow, lash_line, layout, lid_skin::LidSkin, mouth, tone::Tone,
};

/// Everything needed to move a face: its mesh on the photograph, the weights of the nodes, and what lies behind lips and lids.
#[derive(Clone, Debug)]
pub struct Rig {
    /// Nodes as passed in, px.
    pub given: Vec<Point2<f64>>,
    /// Nodes on the texture, px: those passed in, with nearly closed lips closed and edges moved to where the photograph shows them.
    pub nodes: Vec<Point2<f64>>,
    /// Positions of the vertices on the photograph, px.
    pub vertices: Vec<Point2<f64>>,
    /// Triangles of the skin.
    pub skin: Vec<[u32; 3]>,
    /// Twice the least area of each skin triangle, px²; a smaller area counts as folded. Negative infinity for triangles that may fold.
    pub least_areas: Vec<f64>,
    /// Driving nodes and their vertices.
    pub drivers: Vec<(u16, u32)>,
    /// Weights of the driving nodes for each vertex, row by row.
    pub weights: Vec<f64>,
    /// Indices in `drivers` of the driving nodes near each driving node.
    pub neighbours: Vec<Vec<usize>>,
    /// Index in `drivers` of the driving node on the other side of the face, for each driving node.
    pub partners: Vec<usize>,
    /// Mouth, left eye, right eye.
    pub openings: Vec<RigOpening>,
    /// Vertices of the upper and the lower lip's edge, with their offsets (px, downwards) from the arches through their nodes.
    pub bows: [Vec<(usize, f64)>; 2],
    /// Furrows of the forehead.
    pub furrows: Option<Furrows>,
    /// Whether the photograph shows a closed mouth.
    pub closed: bool,
    /// Distance between the centres of the eyes, px.
    pub eye_distance: f64,
    /// Blur of the photograph: sigma of the Gaussian that softens its edges, px.
    pub softness: f64,
    /// Unit vector from forehead to chin.
    pub down: Vector2<f64>,
    /// Colour of the lips, levels.
    pub lip: [f32; 3],
    /// Colour of teeth in the light of the photograph, levels.
    pub enamel: [f32; 3],
    /// Colour of flesh in the light of the photograph, relative to its brightness.
    pub flesh: [f32; 3],
    /// Picture of the upper teeth (see [`TEETH_PICTURES`]); the fourth channel is its opacity.
    pub teeth: RgbaImage,
    /// Size of the teeth relative to the picture's.
    pub teeth_size: f64,
    /// Distance that the upper incisors reach below the closed lips, in eye distances, and the height of the tongue over the gap of the lips.
    pub inside: [f64; 2],
    /// Tone of a photograph without colours: level at brightness 0 and slope for red, green and blue, and the fraction that is applied.
    pub tone: ([[f32; 2]; 3], f32),
}

/// An opening of the face.
#[derive(Clone, Debug)]
pub struct RigOpening {
    /// Which opening.
    pub opening: Opening,
    /// Vertices of its upper edge.
    pub upper: Vec<u32>,
    /// Vertices of its lower edge, equally many.
    pub lower: Vec<u32>,
    /// Vertices on the eyeball: index along the edges, fraction of the way from the upper to the lower edge, vertex.
    pub eyeball: Vec<(usize, f64, u32)>,
    /// Indices along the edges of the five nodes.
    pub stops: [usize; 5],
    /// Triangles inside.
    pub triangles: Vec<[u32; 3]>,
    /// The five nodes of the upper edge.
    pub upper_nodes: [u16; 5],
    /// The five nodes of the lower edge.
    pub lower_nodes: [u16; 5],
    /// Nodes of the iris; empty for the mouth.
    pub iris: &'static [u16],
    /// Inner and outer node of the lower edge of the brow above it; `None` for the mouth.
    pub brow: Option<[u16; 2]>,
    /// Colour of the lashes, levels.
    pub lashes: [f32; 3],
    /// Skin of its upper lid without lashes.
    pub lid: Option<LidSkin>,
    /// The hollow above it.
    pub hollow: Option<Hollow>,
}

impl Warp {
    /// Exports the face as plain numbers, with colours from its photograph.
    pub fn rig(&self, texture: &Texture) -> Rig {
        let area = |points: &[Point2<f64>], t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| points[v as usize]);
            (b - a).perp(&(c - a))
        };
        let least = |(k, t): (usize, &[u32; 3])| {
            if self.is_flat[k] {
                f64::NEG_INFINITY
            } else {
                folds::least_area(area(&self.mesh.vertices, t), area(&self.source, t))
            }
        };
        let openings = self.mesh.openings.iter().zip(&layout::OPENINGS).enumerate().map(|(k, (mesh, nodes))| RigOpening {
            opening: mesh.opening,
            upper: mesh.upper.clone(),
            lower: mesh.lower.clone(),
            eyeball: mesh.eyeball.clone(),
            stops: mesh.stops,
            triangles: mesh.triangles.clone(),
            upper_nodes: nodes.upper,
            lower_nodes: nodes.lower,
            iris: nodes.iris,
            brow: layout::lid_skin_of(mesh.opening).map(|skin| skin.brow),
            lashes: lash_line::colour(self, mesh, texture),
            lid: self.lids.get(k).cloned().flatten(),
            hollow: self.hollows.get(k).cloned().flatten(),
        });
        let (tone, proportions) = (Tone::of(texture, &self.nodes), mouth::Proportions::of(self));
        let light = mouth::Light::of(self, texture);
        Rig {
            given: self.given.clone(),
            nodes: self.nodes.clone(),
            vertices: self.source.clone(),
            skin: self.mesh.skin.clone(),
            least_areas: self.mesh.skin.iter().enumerate().map(least).collect(),
            drivers: self.mesh.drivers.iter().map(|&(n, v)| (n.0, v)).collect(),
            weights: (0..self.mesh.vertices.len()).flat_map(|v| self.weights.of(v).iter().copied()).collect(),
            neighbours: self.neighbours.clone(),
            partners: self.partners.clone(),
            openings: openings.collect(),
            bows: self.bows.clone(),
            furrows: self.furrows.clone(),
            closed: self.closed,
            eye_distance: self.frame.eye_distance,
            softness: self.softness,
            down: self.frame.down.into_inner(),
            lip: mouth::lip_colour(self, texture),
            enamel: light.enamel,
            flesh: light.flesh,
            teeth: self.teeth().map_or_else(|| RgbaImage::new(1, 1), levels),
            teeth_size: mouth::teeth_size(self),
            inside: [proportions.incisors, proportions.tongue],
            tone: (tone.lines, tone.share),
        }
    }
}

/// Geometry and level of the pictures of the upper teeth: pixels per eye distance, the position of the midline at the edge of the incisors
/// (px), and the level of a tooth as bright as the brightest one.
pub const TEETH_PICTURES: (f64, (f64, f64), f32) = (mouth::TEETH_SCALE, mouth::TEETH_ORIGIN, DIMMED * mouth::TEETH_WHITE);
/// Factor on the levels of the exported pictures, so that wet lights are not clipped.
const DIMMED: f32 = 0.75;

/// The picture in bytes, dimmed by [`DIMMED`].
fn levels(picture: &Rgba32FImage) -> RgbaImage {
    RgbaImage::from_fn(picture.width(), picture.height(), |x, y| {
        let [r, g, b, cover] = picture.get_pixel(x, y).0;
        image::Rgba([DIMMED * r, DIMMED * g, DIMMED * b, cover].map(super::sample::byte))
    })
}
