//! Lashes below a rising brow.
//!
//! A rising brow stretches the skin below it together with the lashes in front of it: lashes become threads, and their shade a smear. Real
//! lashes stand on the margin of the lid and keep their shape. So the stretched skin is replaced by skin without lashes (see `lid_skin`), and
//! the photograph's ratio to that skin, which contains the lashes, is laid over it at its original height above the margin. The page of `play`
//! does the same with WebGL (`player/assets/rig.js`, `lids.js` and `gl.js`): change both together.

use image::RgbImage;
use nalgebra::Point2;

use super::{Deformation, Texture, Warp, layout, lid_skin::LidSkin, mesh::OpeningMesh, openings, raster, sample};
use crate::{geometry::Similarity, interpolation::smooth_step};

/// Relative length of the way from lid to brow (1 on the photograph) at which the separate lashes fade in, and are complete.
pub const DRAWN_OUT: (f64, f64) = (1.04, 1.22);
/// Darkest ratio of lashes to skin; they are never lighter than the skin.
pub const DARKEST: f32 = 0.15;
/// Levels that count as noise in dark areas.
pub const FLOOR: f32 = 4.0;
/// Extent of the lashes beyond the corners of the eye, over its width.
pub const BEYOND: f64 = 0.08;

/// An upper lid whose skin is drawn without lashes in a frame.
pub struct BareLid<'a> {
    pub skin: &'a LidSkin,
    pub(super) opening: &'a OpeningMesh,
    /// Opacity of that skin, 0 to 1: because the eye shuts, and (`stands`) because its lashes are drawn separately below a rising brow. On a shutting
    /// eye the lashes are a line instead.
    pub(super) shut: f64,
    stands: f64,
    /// Motion of the head.
    pub(super) head: Similarity,
}

/// The lids that are drawn without lashes in a frame.
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

/// Opacity of the separate lashes for a relative length of the way from lid to brow.
fn share(drawn_out: f64) -> f64 {
    smooth_step(DRAWN_OUT.0, DRAWN_OUT.1, drawn_out)
}

/// Relative length of the way from lid to brow, 1 as on the photograph; `None` for the mouth.
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
    /// Opacity of the skin without lashes, 0 to 1.
    pub fn gone(&self) -> f64 {
        self.shut.max(self.stands)
    }

    /// Draws the separate lashes over the skin.
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

    /// The margin of the upper lid, extended a little beyond both corners.
    fn margin(&self, vertices: &[Point2<f64>]) -> Vec<Point2<f64>> {
        let upper: Vec<Point2<f64>> = self.opening.upper.iter().map(|&v| vertices[v as usize]).collect();
        let (Some(&first), Some(&last)) = (upper.first(), upper.last()) else { return Vec::new() };
        let beyond = (last - first) * BEYOND;
        std::iter::once(first - beyond).chain(upper).chain([last + beyond]).collect()
    }
}

/// Factor that gives skin the full darkness `ratio` of its lashes: `ratio` if it is bare (`bare` 1), 1 if it still has all of them (0), and
/// in between what is missing.
fn missing(ratio: f32, bare: f32) -> f32 {
    ratio / (ratio + (1.0 - ratio) * bare)
}

impl LidSkin {
    /// Ratio of the photograph's red, green and blue to the skin without lashes.
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
        // Height of the dark above the middle of a lid, in tenths of a pixel.
        let height = |picture: &RgbImage, lid: Point2<f64>| {
            let texture = Texture::new(picture);
            (0..300).filter(|&k| texture.sample(Point2::new(lid.x, lid.y - 0.1 * f64::from(k)))[0] < 120.0).count() as f64
        };
        for eye in &OPENINGS[1..] {
            let lid = usize::from(eye.upper[2]);
            let (was, is) = (height(&picture, nodes[lid]), height(&frame, deformation.node(lid)));
            // The skin there is stretched by a quarter or more.
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
        // Lashes that leave a fifth of the light: all of that, none, and the missing part at the half, where 0.6 of the light is left.
        assert_eq!((missing(0.2, 1.0), missing(0.2, 0.0), missing(1.0, 0.5)), (0.2, 1.0, 1.0));
        assert!((0.6 * missing(0.2, 0.5) - 0.2).abs() < 1e-6);
    }
}
