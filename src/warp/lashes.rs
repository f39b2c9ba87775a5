//! Lashes below a brow that rises.
//!
//! A brow that rises draws out the skin below it, and with it what stands over that skin: lashes become threads, and the shade under them a smear.
//! Lashes stand on the margin of the lid and keep their shape. So the skin that is drawn out is what it is without them (see `lid_skin`), and what
//! the photograph has of them, its ratio to that skin, is laid over it as high above the margin as it was. The page of `play` does the same where
//! it has WebGL (`player/assets/rig.js`, `lids.js` and `gl.js`): who changes one changes the other.

use image::RgbImage;
use nalgebra::Point2;

use super::{Deformation, Texture, Warp, layout, lid_skin::LidSkin, mesh::OpeningMesh, openings, raster, sample};
use crate::{geometry::Similarity, interpolation::smooth_step};

/// By how much the way from the lid to the brow is longer than on the photograph where lashes begin to stand by themselves, and do wholly.
pub const DRAWN_OUT: (f64, f64) = (1.04, 1.22);
/// The darkest that lashes are over skin; they are never lighter.
pub const DARKEST: f32 = 0.15;
/// Levels that count as noise in the dark.
pub const FLOOR: f32 = 4.0;
/// How far beyond the corners of the eye they stand, over its width.
pub const BEYOND: f64 = 0.08;

/// An upper lid whose skin is without lashes in a frame.
pub struct BareLid<'a> {
    pub skin: &'a LidSkin,
    pub(super) opening: &'a OpeningMesh,
    /// How far it is, since its eye shuts, and since its lashes stand by themselves below a brow that rises, 0 to 1; on an eye that shuts they are a
    /// line, and do not.
    pub(super) shut: f64,
    stands: f64,
    /// How the head has moved.
    pub(super) head: Similarity,
}

/// The lids without lashes in a frame.
pub fn bare_lids<'a>(warp: &'a Warp, deformation: &Deformation) -> Vec<BareLid<'a>> {
    let head = openings::head(warp, deformation);
    let pairs = warp.mesh.openings.iter().zip(&warp.lids);
    let lids = pairs.filter_map(|(opening, skin)| {
        let skin = skin.as_ref()?;
        let gap = |vertices| openings::gap(warp, opening, vertices);
        let shut = LidSkin::share(1.0 - gap(&deformation.vertices) / (head.scale * gap(&warp.source)).max(1e-9));
        let stands = share(drawn_out(warp, opening, deformation, &head)?) * (1.0 - shut);
        Some(BareLid { skin, opening, shut, stands, head })
    });
    lids.filter(|lid| lid.gone() > 0.0).collect()
}

/// How far lashes stand by themselves where the way from lid to brow is so many times as long as on the photograph.
fn share(drawn_out: f64) -> f64 {
    smooth_step(DRAWN_OUT.0, DRAWN_OUT.1, drawn_out)
}

/// How many times as long as on the photograph a brow that rises makes the way from the lid to itself; `None` for the mouth.
pub(super) fn drawn_out(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation, head: &Similarity) -> Option<f64> {
    let skin = layout::lid_skin_of(opening.opening)?;
    let middle = |nodes: &[Point2<f64>], pair: [u16; 2]| {
        let [a, b] = pair.map(|n| nodes[usize::from(n)]);
        nalgebra::center(&a, &b)
    };
    let above_corners = |nodes: &[Point2<f64>]| (middle(nodes, skin.brow) - middle(nodes, skin.corners)).norm();
    let room = (middle(&warp.nodes, skin.brow) - warp.nodes[usize::from(skin.lid[1])]).norm();
    let rise = above_corners(&deformation.nodes) / head.scale.max(1e-9) - above_corners(&warp.nodes);
    Some(1.0 + rise / room.max(1e-9))
}

impl BareLid<'_> {
    /// How far its skin takes the place of the photograph's, 0 to 1.
    pub fn gone(&self) -> f64 {
        self.shut.max(self.stands)
    }

    /// Lays the lashes that stand by themselves over the skin.
    pub fn draw_lashes(&self, warp: &Warp, texture: &Texture, deformation: &Deformation, frame: &mut RgbImage) {
        if self.stands <= 0.0 {
            return;
        }
        let size = frame.dimensions();
        let up = -warp.frame.down.into_inner() * self.skin.reach();
        let moved = self.head.apply_vector(&up);
        let (source, goes) = (self.margin(&warp.source), self.margin(&deformation.vertices));
        for k in 1..source.len() {
            let from = [source[k - 1], source[k], source[k] + up, source[k - 1] + up];
            let to = [goes[k - 1], goes[k], goes[k] + moved, goes[k - 1] + moved];
            raster::fill_quadrangle(to, from, size, |x, y, at| {
                let ratio = self.skin.lashes(at, texture);
                let pixel = frame.get_pixel_mut(x, y);
                for (level, ratio) in pixel.0.iter_mut().zip(ratio) {
                    *level = sample::byte(f32::from(*level) * missing(ratio, self.stands as f32));
                }
            });
        }
    }

    /// The margin of the upper lid, and a little beyond both corners.
    fn margin(&self, vertices: &[Point2<f64>]) -> Vec<Point2<f64>> {
        let upper: Vec<Point2<f64>> = self.opening.upper.iter().map(|&v| vertices[v as usize]).collect();
        let (Some(&first), Some(&last)) = (upper.first(), upper.last()) else { return Vec::new() };
        let beyond = (last - first) * BEYOND;
        std::iter::once(first - beyond).chain(upper).chain([last + beyond]).collect()
    }
}

/// The factor by which skin is to be darkened that has so much of its lashes left, as a share of `ratio`, for it to have all of them: `ratio`
/// where it is bare (1), and 1 where it is as it is on the photograph (0).
fn missing(ratio: f32, bare: f32) -> f32 {
    ratio / (ratio + (1.0 - ratio) * bare)
}

impl LidSkin {
    /// What lashes leave of the skin's red, green and blue at a place of the photograph, as factors.
    fn lashes(&self, at: Point2<f64>, texture: &Texture) -> [f32; 3] {
        let photograph = texture.sample(at);
        let skin = self.colour(at, 1.0, photograph, texture);
        std::array::from_fn(|c| ((photograph[c].max(0.0) + FLOOR) / (skin[c].max(0.0) + FLOOR)).clamp(DARKEST, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warp::{
        MouthInside,
        layout::{BROWS, OPENINGS},
        test_face::{EYES, lashed, nodes, warp},
    };

    #[test]
    fn lashes_stand_as_high_below_a_brow_that_rises_as_below_one_that_does_not() {
        let nodes = nodes();
        // Lashes of 8 px.
        let picture = lashed(&nodes, 8.0);
        let texture = Texture::new(&picture);
        let warp = warp().with_eyes(&texture);
        let mut raised = nodes.clone();
        BROWS.iter().flatten().for_each(|&n| raised[usize::from(n)].y -= 0.16 * EYES);
        let deformation = warp.deform(&raised).unwrap();
        let lids = bare_lids(&warp, &deformation);
        assert!(lids.len() == 2 && lids.iter().all(|lid| lid.stands == 1.0));
        let frame = warp.render(&texture, &deformation, &MouthInside::Dark);
        // How high it is dark above the middle of a lid, in tenths of a pixel.
        let height = |picture: &RgbImage, lid: Point2<f64>| {
            let texture = Texture::new(picture);
            (0..300).filter(|&k| texture.sample(Point2::new(lid.x, lid.y - 0.1 * f64::from(k)))[0] < 120.0).count() as f64
        };
        for eye in &OPENINGS[1..] {
            let lid = usize::from(eye.upper[2]);
            let (was, is) = (height(&picture, nodes[lid]), height(&frame, deformation.node(lid)));
            // The skin there is drawn out by a quarter and more.
            assert!(was > 50.0 && (is / was - 1.0).abs() < 0.1, "{was} {is}");
        }
    }

    #[test]
    fn they_stand_by_themselves_where_skin_is_drawn_out_and_nowhere_else() {
        let warp = warp();
        let out = |by: f64| {
            let mut raised = nodes();
            BROWS.iter().flatten().for_each(|&n| raised[usize::from(n)].y -= by * EYES);
            let deformation = warp.deform(&raised).unwrap();
            warp.mesh
                .openings
                .iter()
                .map(|opening| drawn_out(&warp, opening, &deformation, &openings::head(&warp, &deformation)))
                .collect::<Vec<_>>()
        };
        assert!(out(0.0)[0].is_none() && out(0.0)[1..].iter().flatten().all(|out| (out - 1.0).abs() < 1e-9), "{:?}", out(0.0));
        assert!(out(0.1).iter().flatten().all(|out| *out > 1.2), "{:?}", out(0.1));
        assert!(out(-0.05).iter().flatten().all(|out| *out < 1.0));
        assert!(share(1.04) == 0.0 && (share(1.13) - 0.5).abs() < 1e-9 && share(1.22) == 1.0);
    }

    #[test]
    fn a_head_that_comes_nearer_or_turns_raises_no_brow() {
        let warp = warp();
        for (scale, angle) in [(1.15, 0.0), (0.9, 0.0), (1.0, 0.3)] {
            let head = Similarity { scale, angle, translation: nalgebra::Vector2::new(10.0, -5.0) };
            let nodes: Vec<Point2<f64>> = nodes().iter().map(|p| head.apply(p)).collect();
            let deformation = warp.deform(&nodes).unwrap();
            let found = openings::head(&warp, &deformation);
            let out = warp.mesh.openings.iter().filter_map(|opening| drawn_out(&warp, opening, &deformation, &found));
            assert!(
                out.clone().count() == 2 && out.clone().all(|out| share(out) < 1e-3),
                "{scale} {angle}: {:?}",
                out.collect::<Vec<_>>()
            );
        }
    }

    #[test]
    fn skin_that_is_half_bare_gets_half_of_its_lashes_back() {
        // Of lashes that leave a fifth of the light: all of it, none, and as much as is missing at the half, where 0.6 of the light is left.
        assert_eq!((missing(0.2, 1.0), missing(0.2, 0.0), missing(1.0, 0.5)), (0.2, 1.0, 1.0));
        assert!((0.6 * missing(0.2, 0.5) - 0.2).abs() < 1e-6);
    }
}
