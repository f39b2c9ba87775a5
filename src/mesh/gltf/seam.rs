//! Cuts a mesh along the seam of its texture.
//!
//! A vertex has one place in the texture, but where the texture meets itself a triangle on one side needs one border and a triangle on
//! the other side the other. Such vertices get copies with another place; otherwise a triangle would show the whole texture, mirrored.

use std::collections::HashMap;

use super::write::GltfSurface;

/// Largest extent of a triangle along either axis of the texture.
const MOST: f32 = 0.5;
/// Rounding of that extent.
const ROUNDING: f32 = 1e-4;

/// A mesh after the cut.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seam {
    /// The vertex that each additional vertex copies.
    pub copies: Vec<u32>,
    /// The surfaces with their new corners.
    pub surfaces: Vec<GltfSurface>,
    /// Places of all vertices in the texture, with those of the copies.
    pub places: Vec<[f32; 2]>,
}

impl Seam {
    /// Cuts surfaces so that no triangle extends over more than half of the texture. If the texture goes around the head and `repeats`
    /// along u, only u counts, and a copy lies one texture further; where this does not help (a triangle around a pole), copies lie near
    /// the triangle's middle corner.
    pub fn new(surfaces: &[GltfSurface], places: &[[f32; 2]], repeats: bool) -> Self {
        let mut cut = Self { copies: Vec::new(), surfaces: surfaces.to_vec(), places: places.to_vec() };
        let mut known: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
        for triangle in cut.surfaces.iter_mut().flat_map(|surface| &mut surface.triangles) {
            let corners = triangle.map(|vertex| places[vertex as usize]);
            let Some(moved) = narrowed(corners, repeats) else { continue };
            for ((vertex, _), to) in triangle.iter_mut().zip(corners).zip(moved).filter(|((_, from), to)| from != to) {
                let (copies, all) = (&mut cut.copies, &mut cut.places);
                *vertex = *known.entry((*vertex, to.map(f32::to_bits))).or_insert_with(|| {
                    copies.push(*vertex);
                    all.push(to);
                    (all.len() - 1) as u32
                });
            }
        }
        cut
    }

    /// Values of all vertices, with those of the copies.
    pub fn all<T: Copy>(&self, values: &[T]) -> Vec<T> {
        values.iter().copied().chain(self.copies.iter().map(|&vertex| values[vertex as usize])).collect()
    }

    /// Some vertices, ascending, with their copies; `count` vertices are no copies.
    pub fn with_copies(&self, vertices: &[u32], count: usize) -> Vec<u32> {
        let copies = (count as u32..).zip(&self.copies).filter(|(_, copied)| vertices.binary_search(copied).is_ok());
        vertices.iter().copied().chain(copies.map(|(index, _)| index)).collect()
    }
}

/// Other places of a triangle's corners; `None` if it is small enough.
fn narrowed(corners: [[f32; 2]; 3], repeats: bool) -> Option<[[f32; 2]; 3]> {
    let span = |corners: &[[f32; 2]; 3], axis: usize| {
        let values = corners.map(|corner| corner[axis]);
        values.into_iter().fold(f32::MIN, f32::max) - values.into_iter().fold(f32::MAX, f32::min)
    };
    let axes = if repeats { 0..1 } else { 0..2 };
    let is_large = |corners: &[[f32; 2]; 3]| axes.clone().any(|axis| span(corners, axis) > MOST + ROUNDING);
    if !is_large(&corners) {
        return None;
    }
    let most = corners.iter().map(|corner| corner[0]).fold(f32::MIN, f32::max);
    let shifted = corners.map(|[u, v]| [if repeats && most - u > MOST { u + 1.0 } else { u }, v]);
    if !is_large(&shifted) {
        return Some(shifted);
    }
    let mut near = shifted;
    for axis in axes.clone().filter(|&axis| span(&shifted, axis) > MOST + ROUNDING) {
        let mut values = shifted.map(|corner| corner[axis]);
        values.sort_by(f32::total_cmp);
        near.iter_mut().for_each(|corner| corner[axis] = corner[axis].clamp(values[1] - MOST / 2.0, values[1] + MOST / 2.0));
    }
    Some(near)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(triangles: Vec<[u32; 3]>) -> Vec<GltfSurface> {
        vec![GltfSurface { name: "skin", triangles, roughness: 0.5, textured: true }]
    }

    #[test]
    fn triangles_across_the_seam_get_copies_one_texture_further() {
        // A strip of three places around a head: 0.9 and 0.05 are neighbours across the seam.
        let places = [[0.9, 0.0], [0.9, 1.0], [0.05, 0.0], [0.05, 1.0], [0.3, 0.0]];
        let cut = Seam::new(&surface(vec![[0, 1, 2], [1, 3, 2], [2, 3, 4]]), &places, true);
        assert_eq!(cut.copies, [2, 3]);
        assert_eq!(cut.surfaces[0].triangles, [[0, 1, 5], [1, 6, 5], [2, 3, 4]]);
        assert_eq!(cut.places[5..], [[1.05, 0.0], [1.05, 1.0]]);
        assert_eq!(cut.all(&[10, 11, 12, 13, 14]), [10, 11, 12, 13, 14, 12, 13]);
        assert_eq!(cut.with_copies(&[0, 3], 5), [0, 3, 6]);
    }

    #[test]
    fn a_triangle_around_a_pole_stays_near_its_middle_corner() {
        let places = [[0.1, 0.0], [0.45, 0.0], [0.8, 0.0]];
        for repeats in [true, false] {
            let cut = Seam::new(&surface(vec![[0, 1, 2]]), &places, repeats);
            let u = cut.surfaces[0].triangles[0].map(|vertex| cut.places[vertex as usize][0]);
            let span = u.into_iter().fold(f32::MIN, f32::max) - u.into_iter().fold(f32::MAX, f32::min);
            assert!(span <= MOST + ROUNDING && !cut.copies.is_empty(), "{u:?}");
        }
        // Half of the texture is allowed.
        assert_eq!(Seam::new(&surface(vec![[0, 1, 2]]), &[[0.2, 0.0], [0.7, 0.5], [0.3, 0.1]], true).copies, [0_u32; 0]);
    }
}
