//! The front half of a sphere, used as the visible part of an eyeball.

use std::f32::consts::{FRAC_PI_2, TAU};

/// Returns positions and triangles of the half of a sphere that faces z: the pole, then `rings` rings of `sectors` vertices each.
pub fn sphere_front(centre: [f32; 3], radius: f32, rings: u32, sectors: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let [x, y, z] = centre;
    let mut positions = vec![[x, y, z + radius]];
    for ring in 1..=rings {
        let (sin, cos) = (ring as f32 / rings as f32 * FRAC_PI_2).sin_cos();
        for sector in 0..sectors {
            let (up, right) = (sector as f32 / sectors as f32 * TAU).sin_cos();
            positions.push([x + radius * sin * right, y + radius * sin * up, z + radius * cos]);
        }
    }
    let at = |ring: u32, sector: u32| 1 + (ring - 1) * sectors + sector % sectors;
    let mut triangles = Vec::new();
    for sector in 0..sectors {
        triangles.push([0, at(1, sector), at(1, sector + 1)]);
        for ring in 1..rings {
            let (a, b, c, d) = (at(ring, sector), at(ring + 1, sector), at(ring + 1, sector + 1), at(ring, sector + 1));
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    (positions, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{cross, dot, sub};

    #[test]
    fn every_vertex_is_on_the_sphere_and_every_triangle_looks_out() {
        let (positions, triangles) = sphere_front([1.0, 2.0, 3.0], 0.5, 4, 8);
        assert_eq!((positions.len(), triangles.len()), (1 + 4 * 8, 8 + 3 * 8 * 2));
        let out = |p: [f32; 3]| sub(p, [1.0, 2.0, 3.0]);
        assert!(positions.iter().all(|&p| (dot(out(p), out(p)).sqrt() - 0.5).abs() < 1e-6 && p[2] >= 3.0 - 1e-6));
        for t in triangles {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            assert!(dot(cross(sub(b, a), sub(c, a)), out(a)) > 0.0);
        }
    }
}
