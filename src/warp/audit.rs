//! Checks the coverage of a frame by the skin.

use nalgebra::Point2;

use super::{Deformation, Warp, convex_hull, raster};
use crate::geometry::polygon::inside;

/// Coverage of a frame by the skin ([`Warp::audit`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Audit {
    /// Skin triangles that are turned over.
    pub folded: usize,
    /// Pixels inside the border of the mesh.
    pub inside: usize,
    /// Of these, pixels that neither skin nor an opening covers.
    pub holes: usize,
    /// Of these, pixels that skin covers more than once.
    pub doubled: usize,
}

impl Warp {
    /// Counts how often skin and openings cover each pixel of a frame; for tests and checks.
    pub fn audit(&self, deformation: &Deformation, size: (u32, u32)) -> Audit {
        // Skin adds 1, an opening 16.
        const OPENING: u8 = 16;
        let mut counts = vec![0_u8; size.0 as usize * size.1 as usize];
        let mut cover = |triangles: &[[u32; 3]], step: u8| {
            for t in triangles {
                let corners = t.map(|v| deformation.vertices[v as usize]);
                raster::fill(corners, corners, size, |x, y, _| {
                    let count = &mut counts[(y * size.0 + x) as usize];
                    *count = count.saturating_add(step);
                });
            }
        };
        cover(&self.mesh.skin, 1);
        for opening in &self.mesh.openings {
            cover(&opening.triangles, OPENING);
        }
        let mut audit = Audit { folded: self.folded(&deformation.vertices).count(), ..Audit::default() };
        // The border of the mesh does not move; inside it every pixel must be covered by skin once, or by an opening.
        let border = convex_hull(self.mesh.fixed.iter().map(|&v| deformation.vertices[v as usize]).collect());
        for y in 0..size.1 {
            for x in 0..size.0 {
                let count = counts[(y * size.0 + x) as usize];
                if inside(&border, &Point2::new(f64::from(x), f64::from(y))) {
                    audit.inside += 1;
                    audit.holes += usize::from(count == 0);
                    audit.doubled += usize::from(count % OPENING > 1);
                }
            }
        }
        audit
    }
}
