//! A prepared face as plain numbers, for a renderer elsewhere: the page of [`crate::player`].

use image::{Rgba32FImage, RgbaImage};
use nalgebra::{Point2, Vector2};

use super::{
    Opening, Texture, Warp, folds, furrows::Furrows, hollow::Hollow, lash_line, layout, lid_skin::LidSkin, mouth, tone::Tone,
};

/// What it takes to move a face: the mesh on its photograph, how each vertex follows the nodes, and what lies behind lips and lids.
#[derive(Clone, Debug)]
pub struct Rig {
    /// Nodes as given, px.
    pub given: Vec<Point2<f64>>,
    /// Nodes of the texture: as given, but lips that are as good as closed are closed.
    pub nodes: Vec<Point2<f64>>,
    /// Vertices on the photograph, px.
    pub vertices: Vec<Point2<f64>>,
    /// Triangles of the skin.
    pub skin: Vec<[u32; 3]>,
    /// Least area that each of them may have, twice, px²; a smaller one counts as folded. Negative for those that cannot fold.
    pub least_areas: Vec<f64>,
    /// Driving nodes and their vertices.
    pub drivers: Vec<(u16, u32)>,
    /// Weights of every vertex over the driving nodes, row by row.
    pub weights: Vec<f64>,
    /// Driving nodes near each driving node, as places in `drivers`.
    pub neighbours: Vec<Vec<usize>>,
    /// The driving node on the other side of the face for each, as places in `drivers`.
    pub partners: Vec<usize>,
    /// Mouth, left eye, right eye.
    pub openings: Vec<RigOpening>,
    /// Vertices of the upper and the lower lip's edge, and how far below the arches through their nodes they lie, px.
    pub bows: [Vec<(usize, f64)>; 2],
    /// The furrows of its forehead.
    pub furrows: Option<Furrows>,
    /// Whether the photograph shows a closed mouth.
    pub closed: bool,
    /// Distance between the middles of the eyes, px.
    pub eye_distance: f64,
    /// How soft the photograph is: sigma of the Gaussian that softens its edges, px.
    pub softness: f64,
    /// Direction from forehead to chin, of length 1.
    pub down: Vector2<f64>,
    /// Colour of the lips, levels.
    pub lip: [f32; 3],
    /// Colour of teeth in the light of the photograph, levels.
    pub enamel: [f32; 3],
    /// Colour of flesh in it, over its brightness.
    pub flesh: [f32; 3],
    /// Picture of the upper teeth (see [`TEETH_PICTURES`]), with how much each pixel covers as its fourth channel.
    pub teeth: RgbaImage,
    /// Size of the teeth over that of the picture's.
    pub teeth_size: f64,
    /// How far the upper incisors reach below the closed lips, over the eye distance, and the height of the tongue over the gap of the lips.
    pub inside: [f64; 2],
    /// The tone of a photograph without colours: level at brightness 0 and its rise, for red, green and blue, and how much of that holds.
    pub tone: ([[f32; 2]; 3], f32),
}

/// An opening of the face.
#[derive(Clone, Debug)]
pub struct RigOpening {
    /// Which one.
    pub opening: Opening,
    /// Vertices of its upper edge.
    pub upper: Vec<u32>,
    /// Vertices of its lower edge, as many.
    pub lower: Vec<u32>,
    /// Vertices on the eyeball: place along the edges, share of the way from the upper to the lower one, vertex.
    pub eyeball: Vec<(usize, f64, u32)>,
    /// Where along the edges the five nodes are.
    pub stops: [usize; 5],
    /// Triangles inside.
    pub triangles: Vec<[u32; 3]>,
    /// The five nodes of the upper edge.
    pub upper_nodes: [u16; 5],
    /// The five nodes of the lower edge.
    pub lower_nodes: [u16; 5],
    /// Nodes of the iris; none in a mouth.
    pub iris: &'static [u16],
    /// Inner and outer node of the lower edge of the brow above it; none above a mouth.
    pub brow: Option<[u16; 2]>,
    /// Colour of the lashes, levels.
    pub lashes: [f32; 3],
    /// The skin of its upper lid without lashes.
    pub lid: Option<LidSkin>,
    /// The hollow above it.
    pub hollow: Option<Hollow>,
}

impl Warp {
    /// The face as plain numbers; colours are taken from its photograph.
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

/// Where pictures of the upper teeth belong: pixels for each eye distance, the place of the midline at the edge of the incisors (px), and their
/// level of a tooth as bright as the brightest.
pub const TEETH_PICTURES: (f64, (f64, f64), f32) = (mouth::TEETH_SCALE, mouth::TEETH_ORIGIN, DIMMED * mouth::TEETH_WHITE);
/// How much darker they are than ours, so that wet lights are not cut off.
const DIMMED: f32 = 0.75;

/// A picture of whole levels, dimmed.
fn levels(picture: &Rgba32FImage) -> RgbaImage {
    RgbaImage::from_fn(picture.width(), picture.height(), |x, y| {
        let [r, g, b, cover] = picture.get_pixel(x, y).0;
        image::Rgba([DIMMED * r, DIMMED * g, DIMMED * b, cover].map(super::sample::byte))
    })
}
