//! Image warping of a face: the texture engine of cloning [KP, section 5] and of animated photographs.
//!
//! Input: a photograph, the positions of Candide-3's nodes on it, and their new positions. Output: a frame in which the skin follows the nodes
//! smoothly, the surroundings follow the skin, and the background does not change.
//!
//! KP refer to "a well-known texture mapping technique". Mapping each of the 184 triangles separately shows their edges as creases.
//! Here the wireframe only *drives* a finer mesh:
//!
//! 1. *Reference*: the face with mouth and eyes open, triangulated around the edges of lips and lids. It separates the two lips of a closed
//!    mouth, so that they can move independently.
//! 2. *Weights*: how each vertex follows the driving nodes. They come from the smoothest field through these nodes that is 0 on a ring around
//!    the face (see `field`). They are solved once per face; a frame then takes one matrix product.
//! 3. *Texture*: each small triangle is filled from its position on the photograph by bicubic sampling. Triangles that do not move
//!    are not touched, so a still face reproduces the photograph bit for bit.
//! 4. *Openings*: the eyeball is a layer behind the lids, so a closing lid covers the iris instead of squeezing it. The iris is a circle
//!    detected in the photograph and turns with the iris nodes. Parted lips show the inside of a mouth.
//!
//! The exact positions of vertices and nodes in a frame are known ([`Deformation::node`], [`Warp::map`]), so frames have ground truth.
//! The module does not depend on OpenCV, threads or random numbers.
//!
//!
//! ```
//! # use grimace::{internal::warp::{MouthInside, Texture, Warp}, wireframe::Wireframe};
//! # use nalgebra::{Point2, Vector2};
//! # let photograph = image::RgbImage::new(160, 200);
//! let neutral: Vec<Point2<f64>> =
//!     Wireframe::candide3().vertices().iter().map(|v| Point2::new(80.0 + 80.0 * v.x, 90.0 - 80.0 * v.y)).collect();
//! let warp = Warp::new(&neutral)?;
//! let mut smile = neutral.clone();
//! smile[31] += Vector2::new(5.0, -4.0);
//! let frame = warp.deform(&smile)?;
//! let picture = warp.render(&Texture::new(&photograph), &frame, &MouthInside::Dark);
//! assert_eq!(frame.node(31), smile[31]);
//! # assert_eq!(picture.dimensions(), (160, 200));
//! # Ok::<(), grimace::internal::warp::WarpError>(())
//! ```

mod audit;
mod eyeball;
mod field;
mod folds;
mod followers;
pub(crate) mod furrows;
pub(crate) mod hollow;
mod iris;
pub(crate) mod lash_line;
pub(crate) mod lashes;
mod layer;
mod layout;
pub(crate) mod lid_skin;
mod lids;
mod lip_line;
mod mesh;
mod motion;
mod mouth;
mod openings;
mod parted;
mod raster;
mod render;
mod rig;
mod sample;
mod seam;
pub(crate) mod shut_lid;
mod softness;
mod tone;

use std::sync::OnceLock;

use image::Rgba32FImage;
use nalgebra::{Point2, Vector2};

use self::{eyeball::Eyeball, field::Weights, furrows::Furrows, hollow::Hollow, layout::Frame, lid_skin::LidSkin, mesh::Mesh};
use crate::geometry::Similarity;

pub(crate) use layout::OPENINGS;
pub use layout::{NODE_COUNT, Opening};
pub use mesh::convex_hull;
pub(crate) use raster::fill as fill_triangle;
pub use render::MouthInside;
pub use rig::{RigOpening, TEETH_PICTURES};
pub use sample::Texture;
pub(crate) use sample::byte;
pub(crate) use softness::SHARP;
pub(crate) use tone::one_tone;

/// Largest area of folded skin on the photograph, in squares of the eye distance; more is an error. Some is tolerated because fitted nodes
/// are not exact to the pixel and slivers may flip where lips close.
const MOST_FOLDED: f64 = 0.04;
/// Radius around a corner of an eye, in eye distances, within which skin may fold.
const BESIDE_CORNER: f64 = 0.07;

/// Why a face cannot be warped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WarpError {
    /// The model has another wireframe.
    #[error("the model has {found} nodes, but warping a face needs the {NODE_COUNT} nodes of Candide-3")]
    NodeCount {
        /// Nodes given.
        found: usize,
    },
    /// A position that is NaN or infinite.
    #[error("a node is not at a finite position")]
    NotFinite,
    /// Both eyes are at the same position.
    #[error("both eyes of the face are at the same position")]
    NoEyes,
    /// The nodes do not form a face seen from the front.
    #[error(
        "the edges of mouth and eyes cross: the nodes do not form a face seen from the front; check the fit with `grimace fit --overlay` \
         and mark more points"
    )]
    Folded,
}

/// Nodes whose positions differ between `nodes` and `placed`, with the shifts.
fn shifts(nodes: &[Point2<f64>], placed: &[Point2<f64>]) -> Vec<(usize, Vector2<f64>)> {
    (0..NODE_COUNT).map(|n| (n, placed[n] - nodes[n])).filter(|(_, shift)| shift.norm() > 0.0).collect()
}

/// A position on the skin: a triangle and the barycentric weights of its second and third vertex.
#[derive(Clone, Debug)]
struct Place {
    triangle: usize,
    shares: [f64; 2],
}

/// The face of a photograph, prepared for warping.
#[derive(Clone, Debug)]
pub struct Warp {
    mesh: Mesh,
    weights: Weights,
    frame: Frame,
    /// The nodes as passed in.
    given: Vec<Point2<f64>>,
    /// The nodes on the texture: those passed in, with nearly closed lips closed and edges moved to where the photograph shows them.
    nodes: Vec<Point2<f64>>,
    /// Nodes moved to the edges seen on the photograph, with their shifts in px.
    placed: Vec<(usize, Vector2<f64>)>,
    /// Positions of the texture nodes on the skin; `None` for driving nodes and for nodes outside the skin.
    places: Vec<Option<Place>>,
    reference_nodes: Vec<Point2<f64>>,
    /// Whether the photograph shows a closed mouth.
    closed: bool,
    /// Positions of the vertices on the photograph.
    source: Vec<Point2<f64>>,
    /// Skin triangles that may fold: they have no area (at the corners of closed lips, in the outermost ring), or are too small for a fold to show.
    is_flat: Vec<bool>,
    /// Indices of the driving nodes around each driving node, for unfolding.
    neighbours: Vec<Vec<usize>>,
    /// Index of the driving node on the other side of the face, for each driving node.
    partners: Vec<usize>,
    /// Offsets (px, downwards) of the vertices of the upper and the lower lip's edge from the arches through their nodes: closed lips meet in a bow.
    bows: [Vec<(usize, f64)>; 2],
    /// Detected eyeballs, one per opening; `None` for the mouth and for an eye without a detected iris.
    eyes: Vec<Option<Eyeball>>,
    /// Skin of the upper lids without lashes, one per opening.
    lids: Vec<Option<LidSkin>>,
    /// Hollows above the eyes.
    hollows: Vec<Option<Hollow>>,
    /// Blur of the photograph (sigma), px; 0 until it is measured.
    softness: f64,
    /// Furrows of the forehead.
    furrows: Option<Furrows>,
    /// Upper teeth of the synthetic mouth; computed on first use.
    dentition: OnceLock<Option<Rgba32FImage>>,
}

/// Positions of everything in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Deformation {
    /// Vertices of the mesh.
    vertices: Vec<Point2<f64>>,
    nodes: Vec<Point2<f64>>,
    background: Similarity,
    /// Rounds of smoothing until no triangle was folded.
    rounds: usize,
}

impl Deformation {
    /// Position of a node in this frame, px. It is the requested one, except where lips or lids would pass through each other, where the skin would
    /// fold, beside the middle of a lid that shuts, and at the lower edge of a brow that would change its thickness.
    ///
    /// # Panics
    /// If Candide-3 has no such node (a programmer's error).
    pub fn node(&self, node: usize) -> Point2<f64> {
        self.nodes[node]
    }

    /// Positions of all nodes, px.
    pub fn nodes(&self) -> &[Point2<f64>] {
        &self.nodes
    }

    /// Motion of everything around the face.
    pub fn background(&self) -> &Similarity {
        &self.background
    }

    /// Rounds of smoothing that the motion needed so that no skin folds; 0 when the requested motion is rendered unchanged.
    pub fn unfolding_rounds(&self) -> usize {
        self.rounds
    }
}

/// Positions of the mesh's vertices on another picture of a face ([`Warp::place`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Placement(Vec<Point2<f64>>);

impl Placement {
    /// The vertices, in the order of [`Rig::vertices`].
    pub fn vertices(&self) -> &[Point2<f64>] {
        &self.0
    }
}

impl Warp {
    /// Creates the warp of a face with its neutral nodes at the given positions (px, all nodes of Candide-3).
    ///
    /// # Errors
    /// [`WarpError`] for another number of nodes, or positions that are not those of a face seen from the front.
    pub fn new(nodes: &[Point2<f64>]) -> Result<Self, WarpError> {
        check(nodes)?;
        Self::cut(nodes, nodes)
    }

    /// Creates a warp whose upper lids and lip line lie where the photograph shows them: a fit knows them to a few percent of the eye distance only.
    /// Nodes for which `is_set` returns true were marked by a person and are not moved. Later requests and results use the positions passed in here.
    ///
    /// # Errors
    /// As [`Warp::new`].
    pub fn on_photograph(nodes: &[Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool) -> Result<Self, WarpError> {
        check(nodes)?;
        let placed = lids::placed_edges(nodes, photograph, is_set);
        Self::cut(nodes, &placed).or_else(|_| Self::cut(nodes, nodes))
    }

    /// Shifts (node, px) from the nodes passed to [`Warp::on_photograph`] to the edges of lids and lips seen on the photograph.
    pub fn edge_shifts(&self) -> &[(usize, Vector2<f64>)] {
        &self.placed
    }

    /// Returns the same shifts for nodes on any photograph, without creating a warp.
    ///
    /// # Errors
    /// [`WarpError`] as of [`Warp::new`] for another number of nodes, or positions that are not finite.
    pub fn edge_shifts_on(nodes: &[Point2<f64>], photograph: &Texture) -> Result<Vec<(usize, Vector2<f64>)>, WarpError> {
        check(nodes)?;
        Ok(shifts(nodes, &lids::placed_edges(nodes, photograph, |_| false)))
    }

    /// Creates the warp of a face with nodes at `nodes`, which lie at `placed` on the texture.
    fn cut(nodes: &[Point2<f64>], placed: &[Point2<f64>]) -> Result<Self, WarpError> {
        let frame = Frame::of(nodes).ok_or(WarpError::NoEyes)?;
        let (source_nodes, closed) = layout::source(placed, &frame);
        let reference_nodes = layout::reference(&source_nodes, &frame);
        let mesh = Mesh::new(&reference_nodes, &frame)?;
        let weights = Weights::new(&mesh)?;
        let neighbours = folds::neighbours(&mesh, &reference_nodes);
        let partners = folds::partners(&mesh);
        let triangles = mesh.skin.len();
        let mut warp = Self {
            mesh,
            weights,
            frame,
            given: nodes.to_vec(),
            placed: shifts(nodes, placed),
            nodes: source_nodes,
            places: Vec::new(),
            closed,
            source: Vec::new(),
            is_flat: vec![false; triangles],
            reference_nodes,
            neighbours,
            partners,
            bows: Default::default(),
            eyes: Vec::new(),
            lids: Vec::new(),
            hollows: Vec::new(),
            furrows: None,
            softness: 0.0,
            dentition: OnceLock::new(),
        };
        let identity = Similarity::identity();
        warp.source = warp.solve(&warp.mesh.vertices, &warp.reference_nodes, &warp.nodes, &identity);
        if closed {
            // Between the nodes, too, the lips meet in one line.
            let mouth = &warp.mesh.openings[0];
            for (&a, &b) in mouth.upper.iter().zip(&mouth.lower) {
                let middle = nalgebra::center(&warp.source[a as usize], &warp.source[b as usize]);
                (warp.source[a as usize], warp.source[b as usize]) = (middle, middle);
            }
        }
        warp.bows = warp.lip_bows();
        let drives = |n: usize| warp.mesh.drivers.iter().any(|(node, _)| node.index() == n);
        warp.places = (0..NODE_COUNT).map(|n| if drives(n) { None } else { warp.place_of(&warp.nodes[n]) }).collect();
        let flat: Vec<usize> = warp.folded(&warp.source).collect();
        flat.iter().for_each(|&k| warp.is_flat[k] = true);
        // At the corners of an eye a few pixels of a shutting lid pass skin that does not move; the lid's skin and lashes hide that.
        // Unfolding them would smooth the whole lid.
        let corners = OPENINGS[1..].iter().flat_map(|eye| [eye.upper[0], eye.upper[4]]).map(|n| warp.nodes[usize::from(n)]);
        let corners: Vec<Point2<f64>> = corners.collect();
        for (k, triangle) in warp.mesh.skin.iter().enumerate() {
            let middle = triangle.iter().map(|&v| warp.source[v as usize].coords).sum::<Vector2<f64>>() / 3.0;
            let is_near = |corner: &Point2<f64>| (middle - corner.coords).norm() < BESIDE_CORNER * frame.eye_distance;
            let is_sliver = folds::is_sliver(triangle.map(|v| warp.mesh.vertices[v as usize]), frame.eye_distance);
            warp.is_flat[k] |= is_sliver || corners.iter().any(is_near);
        }
        // Slivers of a pixel or two at the edges of the lips may fold, too, where a flattened edge compresses them. A fold large enough to be
        // visible also turns triangles next to them, which are checked.
        for (is_flat, triangle) in warp.is_flat.iter_mut().zip(&warp.mesh.skin) {
            let mouth = &warp.mesh.openings[0];
            *is_flat |= triangle.iter().any(|v| mouth.upper.contains(v) || mouth.lower.contains(v));
        }
        let area = |k: usize| {
            let [a, b, c] = warp.mesh.skin[k].map(|v| warp.mesh.vertices[v as usize]);
            (b - a).perp(&(c - a)).abs()
        };
        let folded: f64 = flat.iter().map(|&k| area(k)).sum();
        if folded > MOST_FOLDED * frame.eye_distance.powi(2) {
            return Err(WarpError::Folded);
        }
        Ok(warp)
    }

    /// Adds what is found in the photograph: eyeballs as separate layers, lid skin, hollows, furrows and blur. Irises then stay round behind
    /// moving lids. Without an eyeball, the area between the lids is stretched where they open further.
    #[must_use]
    pub fn with_eyes(mut self, photograph: &Texture) -> Self {
        let [left, right] = Eyeball::find(&self, photograph);
        self.eyes = vec![None, left, right];
        let [left, right] = LidSkin::find(&self, photograph);
        self.lids = vec![None, left, right];
        self.hollows = Hollow::find(&self, photograph);
        self.furrows = Furrows::find(&self, photograph);
        self.softness = softness::softness(&self, photograph);
        self
    }

    /// Distance of the lips in the middle, in eye distances, if the photograph shows the inside of the mouth; `None` for a closed mouth.
    /// A visible inside is kept and moves with the upper jaw; a synthetic one, without teeth, shows only behind it.
    pub fn lips_apart(&self) -> Option<f64> {
        let [upper, lower] = [OPENINGS[0].upper[2], OPENINGS[0].lower[2]].map(|n| self.nodes[usize::from(n)]);
        (!self.closed).then(|| (lower - upper).norm() / self.frame.eye_distance)
    }

    /// Centre and radius (px) of the iris detected in each eye, the subject's left one first; `None` if not found or before [`Warp::with_eyes`].
    pub fn irises(&self) -> [Option<(Point2<f64>, f64)>; 2] {
        [1, 2].map(|k: usize| self.eyes.get(k)?.as_ref().map(|eye| (eye.centre, eye.radius)))
    }

    /// The nodes as passed in.
    // Not those of the texture, whose lips are closed.
    #[allow(clippy::misnamed_getters)]
    pub fn nodes(&self) -> &[Point2<f64>] {
        &self.given
    }

    /// The nodes on the photograph: nearly closed lips are closed, and edges lie where they are seen.
    pub fn texture_nodes(&self) -> &[Point2<f64>] {
        &self.nodes
    }

    /// The upper teeth of the synthetic mouth.
    fn teeth(&self) -> Option<&Rgba32FImage> {
        let made = || {
            let (proportions, size) = (mouth::Proportions::of(self), mouth::teeth_size(self));
            Some(mouth::seen_at(&mouth::dentition(&proportions, size)?, size * self.frame.eye_distance))
        };
        self.dentition.get_or_init(made).as_ref()
    }

    /// Distance between the centres of the eyes, px.
    pub fn eye_distance(&self) -> f64 {
        self.frame.eye_distance
    }

    /// Blur of the photograph as the sigma of a Gaussian, px; 0 before [`Warp::with_eyes`].
    pub fn softness(&self) -> f64 {
        self.softness
    }

    /// Unit vector from forehead to chin on the photograph.
    pub fn down(&self) -> Vector2<f64> {
        self.frame.down.into_inner()
    }

    /// Computes the frame with the nodes at `nodes` and a still background.
    ///
    /// # Errors
    /// [`WarpError`] for another number of nodes or positions that are not finite.
    pub fn deform(&self, nodes: &[Point2<f64>]) -> Result<Deformation, WarpError> {
        self.deform_with(nodes, &Similarity::identity())
    }

    /// Computes the frame with the nodes at `nodes`. `background` maps the photograph to the frame for everything around the face
    /// (camera motion or motion of the whole picture).
    ///
    /// # Errors
    /// As [`Warp::deform`].
    pub fn deform_with(&self, nodes: &[Point2<f64>], background: &Similarity) -> Result<Deformation, WarpError> {
        check(nodes)?;
        let mut wanted: Vec<Point2<f64>> =
            (0..NODE_COUNT).map(|k| background.apply(&self.nodes[k]) + (nodes[k] - background.apply(&self.given[k]))).collect();
        if *background == Similarity::identity() {
            layout::keep_brows(&mut wanted, &self.nodes, &self.frame);
        }
        self.close_lids(&mut wanted);
        self.separate(&mut wanted);
        let (vertices, rounds) = self.unfolded(&mut wanted, background);
        // Driving nodes lie at their vertices; the others follow the skin or the eye around them.
        let carried = |(node, place): (&Point2<f64>, &Option<Place>)| {
            place.as_ref().map_or_else(|| background.apply(node), |place| self.at(&vertices, place))
        };
        let mut found: Vec<Point2<f64>> = self.nodes.iter().zip(&self.places).map(carried).collect();
        for &(node, vertex) in &self.mesh.drivers {
            found[node.index()] = vertices[vertex as usize];
        }
        for (n, shift) in &self.placed {
            found[*n] -= background.apply_vector(shift);
        }
        for nodes in &OPENINGS[1..] {
            let (eye, gaze) = motion::eye_motion(nodes, &self.nodes, &wanted, self.frame.eye_distance);
            for &n in nodes.iris {
                found[usize::from(n)] = eye.apply(&self.nodes[usize::from(n)]) + gaze;
            }
        }
        Ok(Deformation { vertices, nodes: found, background: *background, rounds })
    }

    /// Places the mesh on another picture of a face, of the same or another person, from the nodes there: each vertex then lies on the same
    /// point of the face in both.
    ///
    /// # Errors
    /// [`WarpError`] for another number of nodes, positions that are not finite, or nodes that all coincide.
    pub fn place(&self, nodes: &[Point2<f64>]) -> Result<Placement, WarpError> {
        check(nodes)?;
        let pick = |points: &[Point2<f64>]| self.mesh.drivers.iter().map(|d| points[d.0.index()]).collect::<Vec<_>>();
        let there = Similarity::fit(&pick(&self.reference_nodes), &pick(nodes), None).map_err(|_| WarpError::NoEyes)?;
        let mut wanted = nodes.to_vec();
        self.separate(&mut wanted);
        Ok(Placement(self.solve(&self.mesh.vertices, &self.reference_nodes, &wanted, &there)))
    }

    /// Maps a point of the photograph to a frame. `None` for a point outside the mesh (it moves with the background) or inside an opening.
    pub fn map(&self, deformation: &Deformation, point: &Point2<f64>) -> Option<Point2<f64>> {
        Some(self.at(&deformation.vertices, &self.place_of(point)?))
    }

    /// Position of a point of the photograph on the skin; `None` outside it.
    fn place_of(&self, point: &Point2<f64>) -> Option<Place> {
        self.mesh.skin.iter().enumerate().find_map(|(triangle, t)| {
            let [a, b, c] = t.map(|v| self.source[v as usize]);
            let area = (b - a).perp(&(c - a));
            let shares = [(point - a).perp(&(c - a)) / area, (b - a).perp(&(point - a)) / area];
            let inside = shares[0] >= -1e-9 && shares[1] >= -1e-9 && shares[0] + shares[1] <= 1.0 + 1e-9;
            inside.then_some(Place { triangle, shares })
        })
    }

    /// The point at a position of the skin, for vertices at `vertices`.
    fn at(&self, vertices: &[Point2<f64>], place: &Place) -> Point2<f64> {
        let [p, q, r] = self.mesh.skin[place.triangle].map(|v| vertices[v as usize]);
        p + (q - p) * place.shares[0] + (r - p) * place.shares[1]
    }
}

fn check(nodes: &[Point2<f64>]) -> Result<(), WarpError> {
    if nodes.len() != NODE_COUNT {
        return Err(WarpError::NodeCount { found: nodes.len() });
    }
    if nodes.iter().any(|p| !(p.x.is_finite() && p.y.is_finite())) {
        return Err(WarpError::NotFinite);
    }
    Ok(())
}

#[cfg(test)]
mod test_face;
#[cfg(test)]
mod tests;
