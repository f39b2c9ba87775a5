//! `grimace learn head-mesh`: makes the embedded head from a dense face model.

use std::path::Path;

use super::{
    BankError,
    feature_points::place_feature_points,
    head_mesh::{HeadMesh, mirrored, twin},
    source::BankSource,
};
use crate::{
    mesh::{TriangleMesh, dot, sub},
    synthesis::FeaturePointVertex,
};

/// Where the neck is cut, cm: below this height at depth 0, and lower by this fraction of the depth towards the front.
const NECK: (f32, f32) = (-10.6, 0.22);
/// Largest allowed distance of a vertex from its mirror image, and of a middle vertex from the midline, cm.
const SYMMETRY: f32 = 0.02;
/// A corrective shape for `jawOpen`; used alone, it turns the lips inside out.
const LEFT_OUT: &str = "mouthClose";

/// Reduces a symmetric face model to a [`HeadMesh`]; returns it with the BLAKE3 hash of its source.
///
/// The model is in centimetres, with shapes that have `ARKit` names and with 68 landmarks. The neck is cut off, and the right
/// side becomes the mirror image of the left.
///
/// # Errors
/// [`BankError`] for a folder that is no model, or for a model without landmarks or without symmetry.
pub fn learn_head_mesh(folder: &Path) -> Result<(HeadMesh, String), BankError> {
    let error = |reason: String| BankError::Source { path: folder.to_owned(), reason };
    let mut source = BankSource::open(folder, None)?;
    let landmarks = source.about.landmarks.clone().ok_or_else(|| error("no `landmarks` in manifest.json".to_owned()))?;
    let feature_points = place_feature_points(&source.mesh, &landmarks)?;
    let mesh = source.mesh.clone();
    let twins = mirror_images(mesh.positions()).map_err(error)?;
    let above = |v: u32| {
        let [_, y, z] = mesh.positions()[v as usize];
        y > NECK.0 - NECK.1 * z
    };
    let is_left = |v: u32| mesh.positions()[v as usize][0] > 0.0 && twins[v as usize] != v;
    let is_middle = |v: u32| twins[v as usize] == v;
    let kept: Vec<[u32; 3]> =
        mesh.triangles().iter().filter(|t| t.iter().all(|&v| above(v) && (is_left(v) || is_middle(v)))).copied().collect();
    let crossing =
        mesh.triangles().iter().filter(|t| t.iter().any(|&v| is_left(v)) && t.iter().any(|&v| !is_left(v) && !is_middle(v)));
    if let Some(triangle) = crossing.into_iter().next() {
        return Err(error(format!("triangle {triangle:?} reaches over the middle")));
    }
    let mut used: Vec<u32> = kept.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let (middle, left): (Vec<u32>, Vec<u32>) = used.into_iter().partition(|&v| is_middle(v));
    // Source vertices in the order of the head mesh.
    let order: Vec<u32> = left.iter().chain(&middle).copied().chain(left.iter().map(|&v| twins[v as usize])).collect();
    let mut place = vec![None; mesh.vertex_count()];
    order.iter().enumerate().for_each(|(new, &old)| place[old as usize] = Some(new as u32));
    let found = |v: u32| place[v as usize].ok_or_else(|| error(format!("vertex {v} of a landmark or feature point is cut off")));
    let landmarks = landmarks.iter().map(|&v| found(v)).collect::<Result<Vec<_>, _>>()?;
    let feature_points = feature_points
        .iter()
        .map(|p| Ok(FeaturePointVertex { fp: p.fp, vertex: found(p.vertex)? }))
        .collect::<Result<Vec<_>, BankError>>()?;
    let mut triangles: Vec<[u32; 3]> = kept.iter().map(|t| t.map(|v| place[v as usize].unwrap_or_default())).collect();
    let reflect = |v: u32| mirrored(v, left.len(), middle.len());
    triangles.extend(triangles.clone().iter().map(|&[a, b, c]| [reflect(a), reflect(c), reflect(b)]));
    let mut positions: Vec<[f32; 3]> = order.iter().map(|&v| mesh.positions()[v as usize]).collect();
    let cut = mesh.triangles().iter().filter(|t| t.iter().any(|&v| !above(v))).flatten();
    for &v in cut {
        if let Some(new) = place[v as usize] {
            let [_, y, z] = &mut positions[new as usize];
            *y = NECK.0 - NECK.1 * *z;
        }
    }
    let mut hash = blake3::Hasher::new();
    hash.update(bytemuck::cast_slice(mesh.positions()));
    let (mut names, mut shapes) = (Vec::new(), Vec::new());
    for name in source.names.clone() {
        let shape = source.next_member(&name)?;
        hash.update(name.as_bytes()).update(bytemuck::cast_slice(&shape));
        if name != LEFT_OUT {
            shapes.push(order.iter().map(|&v| shape[v as usize]).collect::<Vec<_>>());
            names.push(name);
        }
    }
    if let Some(alone) = names.iter().find(|name| twin(name).is_some_and(|twin| !names.contains(&twin))) {
        return Err(error(format!("shape `{alone}` has no other side")));
    }
    let head =
        HeadMesh { left: left.len(), middle: middle.len(), positions, triangles, landmarks, feature_points, names, shapes };
    TriangleMesh::new(head.positions.clone(), head.triangles.clone())?;
    Ok((head, hash.finalize().to_hex().to_string()))
}

/// Returns the mirror vertex of every vertex; a middle vertex mirrors itself.
fn mirror_images(positions: &[[f32; 3]]) -> Result<Vec<u32>, String> {
    // Only vertices with a similar x are compared.
    let mut by_x: Vec<u32> = (0..positions.len() as u32).collect();
    by_x.sort_by(|&a, &b| positions[a as usize][0].total_cmp(&positions[b as usize][0]).then(a.cmp(&b)));
    let far = |a: [f32; 3], b: [f32; 3]| dot(sub(a, b), sub(a, b));
    let mut images = Vec::with_capacity(positions.len());
    for (v, &[x, y, z]) in positions.iter().enumerate() {
        let wanted = [-x, y, z];
        let start = by_x.partition_point(|&u| positions[u as usize][0] < -x - SYMMETRY);
        let near = by_x[start..].iter().take_while(|&&u| positions[u as usize][0] <= SYMMETRY - x);
        let best = near
            .min_by(|&&a, &&b| far(positions[a as usize], wanted).total_cmp(&far(positions[b as usize], wanted)).then(a.cmp(&b)));
        match best {
            Some(&u) if far(positions[u as usize], wanted) <= SYMMETRY * SYMMETRY => images.push(u),
            _ => return Err(format!("vertex {v} at ({x}, {y}, {z}) has no mirror image")),
        }
    }
    match (0..images.len()).find(|&v| images[images[v] as usize] != v as u32) {
        Some(v) => Err(format!("the mirror image of vertex {v} mirrors another")),
        None => Ok(images),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirror_images_are_found_in_pairs() {
        let positions = [[1.0, 2.0, 0.0], [0.0, 5.0, 0.0], [-1.0, 2.001, 0.0], [2.0, 0.0, 1.0], [-2.0, 0.0, 1.0]];
        assert_eq!(mirror_images(&positions).unwrap(), [2, 1, 0, 4, 3]);
        assert!(mirror_images(&positions[1..]).unwrap_err().contains("has no mirror image"));
    }
}
