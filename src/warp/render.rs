//! One frame.

use image::RgbImage;

use super::{
    Deformation, Placement, Texture, Warp,
    lashes::{self, Lashes},
    lid_skin::LidSkin,
    mesh::OpeningMesh,
    openings, raster,
    sample::{self, Bounds, Pixels},
    seam::Seam,
};
use crate::geometry::Similarity;

/// What is seen between lips that part.
#[derive(Clone, Copy, Debug)]
pub enum MouthInside<'a> {
    /// A dark mouth. Where the photograph itself shows an open mouth, its own inside.
    Dark,
    /// A dark mouth with upper teeth, drawn: they hang from the skull, so that a raised lip bares them and a dropped jaw does not.
    Teeth,
    /// The inside of a mouth on another picture: its texture, and where the mesh lies on it.
    Picture {
        /// The picture.
        texture: &'a Texture,
        /// The mesh there, see [`Warp::place`].
        placement: &'a Placement,
    },
}

impl Warp {
    /// Renders a frame, as large as the photograph.
    pub fn render(&self, texture: &Texture, deformation: &Deformation, inside: &MouthInside) -> RgbImage {
        let mut frame = RgbImage::default();
        self.render_into(texture, deformation, inside, &mut frame);
        frame
    }

    /// [`Warp::render`] into an image that is used again and again.
    pub fn render_into(&self, texture: &Texture, deformation: &Deformation, inside: &MouthInside, frame: &mut RgbImage) {
        let size = texture.dimensions();
        if frame.dimensions() != size {
            *frame = RgbImage::new(size.0, size.1);
        }
        let still = deformation.background == Similarity::identity();
        if still {
            texture.copy_to(frame);
        } else {
            let back = deformation.background.inverse();
            *frame = sample::resample(texture, size, |p| Some(back.apply(&p)));
        }
        let lashes = lashes::standing(self, deformation);
        let lids = self.bare_lids(deformation, &lashes);
        let seam = Seam::new(self, deformation, texture);
        let bounds: Vec<Bounds> = seam.bounds().into_iter().chain(lids.iter().filter_map(|(lid, _)| lid.bounds())).collect();
        let change = |at, photograph| {
            let without_line = seam.colour(at, photograph, texture);
            lids.iter().fold(without_line, |colour, (lid, gone)| lid.colour(at, *gone, colour, texture))
        };
        let mut pixels = Pixels::new(texture, size.0);
        for triangle in &self.mesh.skin {
            let to = triangle.map(|v| deformation.vertices[v as usize]);
            let from = triangle.map(|v| self.source[v as usize]);
            if still && to == from {
                continue;
            }
            raster::fill_rows(to, from, size, |span| pixels.add(span, |pixels| pixels.draw(frame, &bounds, change)));
        }
        pixels.draw(frame, &bounds, change);
        for lashes in &lashes {
            lashes.draw(self, texture, deformation, frame);
        }
        for opening in &self.mesh.openings {
            openings::draw(self, opening, texture, deformation, inside, &seam, frame);
        }
    }

    /// The lids whose skin is without lashes in a frame, since they shut or since their lashes stand by themselves, and how far it takes the place of
    /// the photograph's.
    fn bare_lids<'a>(&'a self, deformation: &Deformation, standing: &[Lashes<'a>]) -> Vec<(&'a LidSkin, f64)> {
        let head = openings::head(self, deformation);
        let pairs = self.mesh.openings.iter().zip(&self.lids);
        let bare = pairs.filter_map(|(opening, lid)| {
            let lid = lid.as_ref()?;
            let stands = standing.iter().find(|lashes| std::ptr::eq(lashes.lid, lid)).map_or(0.0, |lashes| lashes.share);
            Some((lid, self.shut(opening, deformation, &head).max(stands)))
        });
        bare.filter(|(_, gone)| *gone > 0.0).collect()
    }

    /// How far an opening has shut for its lid's skin to take the place of the photograph's, on a head that has moved so.
    pub(super) fn shut(&self, opening: &OpeningMesh, deformation: &Deformation, head: &Similarity) -> f64 {
        let gap = |vertices| openings::gap(self, opening, vertices);
        LidSkin::share(1.0 - gap(&deformation.vertices) / (head.scale * gap(&self.source)).max(1e-9))
    }

    /// Carries another picture into the geometry of the photograph: what lies at a point of the mesh there is drawn at the same
    /// point here. Pixels outside the mesh are left as they are.
    pub fn unwarp(&self, picture: &Texture, placement: &Placement, into: &mut RgbImage) {
        let size = into.dimensions();
        let mut pixels = Pixels::new(picture, size.0);
        for triangle in &self.mesh.skin {
            let to = triangle.map(|v| self.source[v as usize]);
            let from = triangle.map(|v| placement.0[v as usize]);
            raster::fill_rows(to, from, size, |span| pixels.add(span, |pixels| pixels.draw(into, &[], |_, colour| colour)));
        }
        pixels.draw(into, &[], |_, colour| colour);
    }
}
