//! Rendering of frames.

use image::RgbImage;

use super::{
    Deformation, Placement, Texture, Warp,
    furrows::{self, Deepened},
    hollow::{DrawnOut, drawn_out_hollows},
    lashes::{BareLid, bare_lids},
    openings, raster,
    sample::{self, Bounds, Pixels},
    seam::Seam,
};
use crate::geometry::Similarity;

/// What shows between parted lips.
#[derive(Clone, Copy, Debug)]
pub enum MouthInside<'a> {
    /// A dark mouth; if the photograph itself shows an open mouth, its own inside.
    Dark,
    /// A dark mouth with drawn teeth. The upper ones are fixed to the skull, so that a raised lip bares them and a dropped jaw does not.
    Teeth,
    /// The inside of a mouth on another picture.
    Picture {
        /// The picture.
        texture: &'a Texture,
        /// Position of the mesh on it, see [`Warp::place`].
        placement: &'a Placement,
    },
}

/// Changes to the colours of skin.
enum Change<'a> {
    Seam(&'a Seam),
    Lid(&'a BareLid<'a>),
    Hollow(&'a DrawnOut<'a>),
    Furrows(&'a Deepened<'a>),
}

impl Warp {
    /// Renders a frame of the size of the photograph.
    pub fn render(&self, texture: &Texture, deformation: &Deformation, inside: &MouthInside) -> RgbImage {
        let mut frame = RgbImage::default();
        self.render_into(texture, deformation, inside, &mut frame);
        frame
    }

    /// [`Warp::render`] into an image that can be reused.
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
        let lids = bare_lids(self, deformation);
        let seam = Seam::new(self, deformation, texture);
        let hollows = drawn_out_hollows(self, deformation);
        let furrows = furrows::deepened(self, deformation);
        // In the order in which they are applied to the photograph.
        let seams = seam.bounds().map(|bounds| (bounds, Change::Seam(&seam)));
        let bare = lids.iter().filter_map(|lid| Some((lid.skin.bounds()?, Change::Lid(lid))));
        let drawn_out = hollows.iter().filter_map(|hollow| Some((hollow.bounds()?, Change::Hollow(hollow))));
        let deepened = furrows.iter().filter_map(|furrows| Some((furrows.bounds()?, Change::Furrows(furrows))));
        let (bounds, changes): (Vec<Bounds>, Vec<Change>) =
            seams.into_iter().chain(bare).chain(drawn_out).chain(deepened).unzip();
        let change = |number: usize, at, colour| match changes[number] {
            Change::Seam(seam) => seam.colour(at, colour, texture),
            Change::Lid(lid) => lid.skin.colour(at, lid.gone(), colour, texture),
            Change::Hollow(hollow) => hollow.colour(at, colour),
            Change::Furrows(furrows) => furrows.colour(at, colour),
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
        for lid in &lids {
            lid.draw_lashes(self, texture, deformation, frame);
            lid.draw_shut(self, texture, &deformation.vertices, frame);
        }
        for opening in &self.mesh.openings {
            openings::draw(self, opening, texture, deformation, inside, &seam, frame);
        }
    }

    /// Maps another picture to the geometry of the photograph: each point of the mesh there is drawn at the same point here. Pixels
    /// outside the mesh are not changed.
    pub fn unwarp(&self, picture: &Texture, placement: &Placement, into: &mut RgbImage) {
        let size = into.dimensions();
        let mut pixels = Pixels::new(picture, size.0);
        for triangle in &self.mesh.skin {
            let to = triangle.map(|v| self.source[v as usize]);
            let from = triangle.map(|v| placement.0[v as usize]);
            raster::fill_rows(to, from, size, |span| pixels.add(span, |pixels| pixels.draw(into, &[], |_, _, colour| colour)));
        }
        pixels.draw(into, &[], |_, _, colour| colour);
    }
}
