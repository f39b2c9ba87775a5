//! Moving the face of a photograph: the texture engine of cloning [KP, section 5] and of animated photographs.
//!
//! From a photograph, the positions of Candide-3's nodes on it, and the positions they are to have, comes a frame: skin that follows
//! the nodes smoothly, surroundings that follow the skin, and a background that is not touched.
//!
//! KP leave texture to "a well-known texture mapping technique". Mapping each of the 184 triangles by itself shows their edges as
//! creases, so the wireframe only *drives* a finer mesh here:
//!
//! 1. *Reference*: the face as given, with mouth and eyes open, triangulated around the edges of lips and lids. In it the two lips
//!    of a closed mouth are apart, so that each can go its own way.
//! 2. *Weights*: how each vertex follows the driving nodes, from the smoothest field through them that ends in 0 on a ring around
//!    the face (see `field`). Solved once for a face; a frame is one product.
//! 3. *Texture*: each small triangle is filled from where it lies on the photograph, by bicubic sampling; triangles that do not move
//!    are not touched, so a still face gives the photograph back to the bit.
//! 4. *Openings*: the eyeball stays behind the lids (a closing lid covers the iris, it does not squeeze it), has a round iris that is
//!    found in the photograph, and turns with the iris nodes; lips open onto the inside of a mouth.
//!
//! The positions that vertices and nodes have in a frame are known exactly ([`Deformation::node`], [`Warp::map`]), which makes frames
//! with ground truth. Nothing here depends on OpenCV, on threads or on chance.
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

/// Most skin that may be folded on the photograph, in squares of the eye distance: the nodes of a fit are not where a face's are to the
/// pixel, and where lips close a sliver may turn.
const MOST_FOLDED: f64 = 0.04;
/// Distance from a corner of an eye, over the eye distance, within which skin may fold.
const BESIDE_CORNER: f64 = 0.07;

/// Why a face cannot be warped.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WarpError {
    /// Another wireframe.
    #[error("the model has {found} nodes, but warping a face needs the {NODE_COUNT} nodes of Candide-3")]
    NodeCount {
        /// Nodes given.
        found: usize,
    },
    /// A position that is NaN or infinite.
    #[error("a node is not at a finite position")]
    NotFinite,
    /// No face: the eyes coincide.
    #[error("both eyes of the face are at the same position")]
    NoEyes,
    /// The nodes do not lie like a face seen from the front.
    #[error(
        "the edges of mouth and eyes cross: the nodes do not form a face seen from the front; check the fit with `grimace fit --overlay` \
         and mark more points"
    )]
    Folded,
}

/// Nodes that lie elsewhere, and by how much.
fn shifts(nodes: &[Point2<f64>], placed: &[Point2<f64>]) -> Vec<(usize, Vector2<f64>)> {
    (0..NODE_COUNT).map(|n| (n, placed[n] - nodes[n])).filter(|(_, shift)| shift.norm() > 0.0).collect()
}

/// A place of the skin: a triangle, and how far along its first two edges.
#[derive(Clone, Debug)]
struct Place {
    triangle: usize,
    shares: [f64; 2],
}

/// A face of a photograph, ready to be moved.
#[derive(Clone, Debug)]
pub struct Warp {
    mesh: Mesh,
    weights: Weights,
    frame: Frame,
    /// The nodes as given.
    given: Vec<Point2<f64>>,
    /// The nodes of the texture: as given, but lips that are as good as closed are closed, and edges lie where the photograph has them.
    nodes: Vec<Point2<f64>>,
    /// Nodes whose edges lie elsewhere on the photograph than given, and by how much.
    placed: Vec<(usize, Vector2<f64>)>,
    /// Where the nodes of the texture are on the skin; none of those that drive it, and of those that lie beside it.
    places: Vec<Option<Place>>,
    reference_nodes: Vec<Point2<f64>>,
    /// Whether the photograph shows a closed mouth.
    closed: bool,
    /// The vertices on the photograph.
    source: Vec<Point2<f64>>,
    /// Skin triangles that may fold: they have no area on the photograph (at the corners of closed lips), or are too small for that to be seen.
    is_flat: Vec<bool>,
    /// Driving nodes around each driving node, for unfolding.
    neighbours: Vec<Vec<usize>>,
    /// The driving node on the other side of the face for each, as places.
    partners: Vec<usize>,
    /// How far vertices of the upper and the lower lip's edge lie below the arches through their nodes, px; closed lips meet in a bow.
    bows: [Vec<(usize, f64)>; 2],
    /// Eyeballs found in the photograph, one for each opening; none for the mouth, and for an eye in which no iris was found.
    eyes: Vec<Option<Eyeball>>,
    /// The skin of their upper lids without lashes.
    lids: Vec<Option<LidSkin>>,
    /// The hollows above them.
    hollows: Vec<Option<Hollow>>,
    /// How soft the photograph is, px; 0 before it is known.
    softness: f64,
    /// The furrows of its forehead.
    furrows: Option<Furrows>,
    /// The teeth that it shows where its mouth is made; none before they are seen.
    dentition: OnceLock<Option<Rgba32FImage>>,
}

/// Where everything is in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Deformation {
    /// Vertices of the mesh.
    vertices: Vec<Point2<f64>>,
    nodes: Vec<Point2<f64>>,
    background: Similarity,
    /// Rounds of smoothing it took until no triangle was folded.
    rounds: usize,
}

impl Deformation {
    /// Where a node is in this frame. That is where it was asked to be, unless lips or lids would have passed through each other, a lid shuts
    /// in its middle, or the skin would have folded.
    ///
    /// # Panics
    /// If Candide-3 has no such node (a programmer's error).
    pub fn node(&self, node: usize) -> Point2<f64> {
        self.nodes[node]
    }

    /// All nodes.
    pub fn nodes(&self) -> &[Point2<f64>] {
        &self.nodes
    }

    /// How everything around the face moved.
    pub fn background(&self) -> &Similarity {
        &self.background
    }

    /// Rounds of smoothing that the motion needed so that no skin folds; 0 for a motion that is rendered as it was asked for.
    pub fn unfolding_rounds(&self) -> usize {
        self.rounds
    }
}

/// Vertices of the mesh on some picture of a face ([`Warp::place`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Placement(Vec<Point2<f64>>);

impl Placement {
    /// The vertices, in the order of [`Rig::vertices`].
    pub fn vertices(&self) -> &[Point2<f64>] {
        &self.0
    }
}

impl Warp {
    /// The warp of a face with its nodes at the given positions (px, all of Candide-3's, neutral).
    ///
    /// # Errors
    /// [`WarpError`] for another number of nodes, or positions that are not those of a face seen from the front.
    pub fn new(nodes: &[Point2<f64>]) -> Result<Self, WarpError> {
        check(nodes)?;
        Self::cut(nodes, nodes)
    }

    /// The warp of a face that is cut where its photograph shows upper lids and the ends of the lips, which a fit knows to a few percent of the
    /// eye distance; a node of which `is_set` says that a person placed it is believed. Nodes are asked for, and told, as they are given.
    ///
    /// # Errors
    /// As [`Warp::new`].
    pub fn on_photograph(nodes: &[Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool) -> Result<Self, WarpError> {
        check(nodes)?;
        let placed = lids::placed_edges(nodes, photograph, is_set);
        Self::cut(nodes, &placed).or_else(|_| Self::cut(nodes, nodes))
    }

    /// How far the edges of lids and lips lie on the photograph from the nodes that [`Warp::on_photograph`] was given: nodes, and px.
    pub fn edge_shifts(&self) -> &[(usize, Vector2<f64>)] {
        &self.placed
    }

    /// The same of nodes on some photograph.
    ///
    /// # Errors
    /// [`WarpError`] as of [`Warp::new`] for another number of nodes, or positions that are not finite.
    pub fn edge_shifts_on(nodes: &[Point2<f64>], photograph: &Texture) -> Result<Vec<(usize, Vector2<f64>)>, WarpError> {
        check(nodes)?;
        Ok(shifts(nodes, &lids::placed_edges(nodes, photograph, |_| false)))
    }

    /// The warp of a face with its nodes at `nodes`, of which the texture has those at `placed`.
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
        // At the corners of an eye the few pixels of a lid that shuts pass what does not move; the lid's own skin and lashes cover them. What
        // is smoothed for their sake is the whole lid.
        let corners = OPENINGS[1..].iter().flat_map(|eye| [eye.upper[0], eye.upper[4]]).map(|n| warp.nodes[usize::from(n)]);
        let corners: Vec<Point2<f64>> = corners.collect();
        for (k, triangle) in warp.mesh.skin.iter().enumerate() {
            let middle = triangle.iter().map(|&v| warp.source[v as usize].coords).sum::<Vector2<f64>>() / 3.0;
            let is_near = |corner: &Point2<f64>| (middle - corner.coords).norm() < BESIDE_CORNER * frame.eye_distance;
            warp.is_flat[k] |= corners.iter().any(is_near);
        }
        // So are the slivers at the edges of the lips, of a pixel or two, which an edge that is drawn flat presses upon: what would be seen to fold
        // takes the skin beyond them along.
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

    /// The warp with the eyeballs that the photograph shows as layers of their own: irises stay round behind lids that move.
    /// Without them, and for an eye in which no iris is found, what lies between the lids is stretched where they open further.
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

    /// How far the lips are apart in the middle over the eye distance, if the photograph shows the inside of the mouth: what is there stays,
    /// with the upper jaw, and none is made.
    pub fn lips_apart(&self) -> Option<f64> {
        let [upper, lower] = [OPENINGS[0].upper[2], OPENINGS[0].lower[2]].map(|n| self.nodes[usize::from(n)]);
        (!self.closed).then(|| (lower - upper).norm() / self.frame.eye_distance)
    }

    /// Centre and radius (px) of the iris found in each eye, the subject's left one first; `None` before [`Warp::with_eyes`], and
    /// where none was found.
    pub fn irises(&self) -> [Option<(Point2<f64>, f64)>; 2] {
        [1, 2].map(|k: usize| self.eyes.get(k)?.as_ref().map(|eye| (eye.centre, eye.radius)))
    }

    /// The nodes as given.
    // Not those of the texture, whose lips are closed.
    #[allow(clippy::misnamed_getters)]
    pub fn nodes(&self) -> &[Point2<f64>] {
        &self.given
    }

    /// The nodes as the photograph has them: lips closed that are as good as closed, edges where they are seen.
    pub fn texture_nodes(&self) -> &[Point2<f64>] {
        &self.nodes
    }

    /// The upper teeth of a face whose mouth is made.
    fn teeth(&self) -> Option<&Rgba32FImage> {
        let made = || {
            let (proportions, size) = (mouth::Proportions::of(self), mouth::teeth_size(self));
            Some(mouth::seen_at(&mouth::dentition(&proportions, size)?, size * self.frame.eye_distance))
        };
        self.dentition.get_or_init(made).as_ref()
    }

    /// Distance between the middles of the eyes, px.
    pub fn eye_distance(&self) -> f64 {
        self.frame.eye_distance
    }

    /// Sigma of the Gaussian that softens the photograph, px; 0 before [`Warp::with_eyes`].
    pub fn softness(&self) -> f64 {
        self.softness
    }

    /// Direction from forehead to chin on the photograph, of length 1.
    pub fn down(&self) -> Vector2<f64> {
        self.frame.down.into_inner()
    }

    /// The frame in which the nodes are at `nodes` and the background stays.
    ///
    /// # Errors
    /// [`WarpError`] for another number of nodes or positions that are not finite.
    pub fn deform(&self, nodes: &[Point2<f64>]) -> Result<Deformation, WarpError> {
        self.deform_with(nodes, &Similarity::identity())
    }

    /// The frame in which the nodes are at `nodes` and everything around the face has moved by `background`, a map from the
    /// photograph to the frame (camera or whole-picture motion).
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
        // Nodes that drive are where their vertex is; the others go with the skin or the eye around them.
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

    /// Where the mesh lies on another picture of a face, of the same or another person, given its nodes there: what is at a vertex
    /// here is at the same vertex there.
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

    /// Where a point of the photograph is in a frame; `None` for a point outside the mesh (it moves with the background) or inside
    /// an opening.
    pub fn map(&self, deformation: &Deformation, point: &Point2<f64>) -> Option<Point2<f64>> {
        Some(self.at(&deformation.vertices, &self.place_of(point)?))
    }

    /// Where a point of the photograph is on the skin; `None` beside it.
    fn place_of(&self, point: &Point2<f64>) -> Option<Place> {
        self.mesh.skin.iter().enumerate().find_map(|(triangle, t)| {
            let [a, b, c] = t.map(|v| self.source[v as usize]);
            let area = (b - a).perp(&(c - a));
            let shares = [(point - a).perp(&(c - a)) / area, (b - a).perp(&(point - a)) / area];
            let inside = shares[0] >= -1e-9 && shares[1] >= -1e-9 && shares[0] + shares[1] <= 1.0 + 1e-9;
            inside.then_some(Place { triangle, shares })
        })
    }

    /// The point at a place of the skin whose vertices are at `vertices`.
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
