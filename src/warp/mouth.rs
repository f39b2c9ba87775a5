//! The inside of a mouth: dark, the photograph's own teeth, or teeth that are drawn.

use nalgebra::{Point2, Vector2};

use super::{Deformation, Texture, Warp, layer::Layer, mesh::OpeningMesh, openings::smooth_step};

/// The inside of a mouth of which no picture is known.
pub fn dark(warp: &Warp, opening: &OpeningMesh, texture: &Texture, deformation: &Deformation, gap: f64, layer: &mut Layer) {
    // Lip colour under the light of the photograph.
    let lips = [8_usize, 85, 86].map(|n| texture.sample(warp.nodes[n] + (warp.nodes[40] - warp.nodes[8]) * 0.4));
    let lip: [f32; 3] = std::array::from_fn(|c| (lips[0][c] + lips[1][c] + lips[2][c]) / 3.0);
    let last = opening.upper.len() as f64 - 1.0;
    let mut place: Vec<(u32, Point2<f64>)> = Vec::new();
    for (edge, t) in [(&opening.upper, 0.0), (&opening.lower, 1.0)] {
        for (k, &v) in edge.iter().enumerate() {
            place.push((v, Point2::new(k as f64 / last, t)));
        }
    }
    place.sort_by_key(|p| p.0);
    let at = |v: u32| place.binary_search_by_key(&v, |p| p.0).map_or(Point2::origin(), |k| place[k].1);
    let wide = smooth_step(0.10, 0.30, gap / warp.frame.eye_distance);
    for triangle in &opening.triangles {
        let to = triangle.map(|v| deformation.vertices[v as usize]);
        layer.fill(to, triangle.map(at), |at, _| {
            let side = (std::f64::consts::PI * at.x.clamp(0.0, 1.0)).sin();
            let tongue = wide * smooth_step(0.45, 0.95, at.y) * side;
            let light = 0.12 + 0.10 * side * at.y + 0.26 * tongue;
            let warm = [1.0, 0.72 + 0.1 * tongue, 0.70 + 0.1 * tongue];
            std::array::from_fn(|c| lip[c] * (light * warm[c]) as f32)
        });
    }
}

/// Right edges of the upper teeth from the midline, over the eye distance: incisors, canine, premolars (8.5, 6.5, 7.5, 7 and 7 mm of a
/// mean 63 mm between the pupils, the outer ones foreshortened).
const TOOTH_EDGES: [f64; 6] = [0.130, 0.225, 0.315, 0.385, 0.435, 0.475];
/// Where the row begins to be lost in the dark of the cheeks, and where it is, over the eye distance from the midline.
const LAST_TEETH: (f64, f64) = (0.26, 0.46);
/// How far the incisors reach below the closed lips, over the eye distance (2 mm).
const TEETH_BELOW_LIPS: f64 = 0.032;

/// Draws the upper teeth over a dark mouth.
pub fn teeth(warp: &Warp, texture: &Texture, deformation: &Deformation, layer: &mut Layer) {
    let unit = warp.frame.eye_distance;
    let down = warp.frame.down.into_inner();
    let across = Vector2::new(down.y, -down.x);
    // The skull goes with the base of the nose; the teeth end a little below the middle of the closed lips.
    let moved = deformation.nodes[6] - warp.nodes[6];
    let middle = warp.nodes[87] + moved;
    let enamel = enamel(warp, texture);
    let upper_lip = |x: f64| -> f64 {
        let points = [88_usize, 81, 87, 82, 89].map(|n| deformation.nodes[n] - middle);
        let at = points.map(|p| (p.dot(&across), p.dot(&down)));
        at.windows(2)
            .find(|w| (x - w[0].0) * (x - w[1].0) <= 0.0)
            .map_or(0.0, |w| w[0].1 + (w[1].1 - w[0].1) * (x - w[0].0) / (w[1].0 - w[0].0 + 1e-9))
    };
    let (left, top, width) = (layer.left, layer.top, layer.width);
    for (k, (colour, is_set)) in layer.pixels.iter_mut().enumerate() {
        if !*is_set {
            continue;
        }
        let place = Point2::new(f64::from(left + k as u32 % width), f64::from(top + k as u32 / width)) - middle;
        let (x, y) = (place.dot(&across), place.dot(&down));
        let side = x.abs() / unit;
        let Some(tooth) = TOOTH_EDGES.iter().position(|&edge| side < edge) else { continue };
        let from = if tooth == 0 { 0.0 } else { TOOTH_EDGES[tooth - 1] };
        let within = (side - from) / (TOOTH_EDGES[tooth] - from);
        // The row curves up towards the sides, and every tooth is rounded.
        let round = (2.0 * within - 1.0).powi(4) * 0.010;
        let edge = (TEETH_BELOW_LIPS - 0.20 * side * side - round - if tooth == 1 { 0.006 } else { 0.0 }) * unit;
        let cover = ((edge - y) / (0.008 * unit).max(0.7)).clamp(0.0, 1.0);
        let seam = smooth_step(0.0, 0.012, within.min(1.0 - within) * (TOOTH_EDGES[tooth] - from));
        // Darker under the lip, between the teeth and towards the corners of the mouth, where the row is lost in the dark.
        let shade = smooth_step(-0.01, 0.055, (y - upper_lip(x)) / unit);
        let brightness = (0.55 + 0.45 * shade) * (0.84 + 0.16 * seam) * (1.0 - 1.9 * side * side);
        // So are edges that the lip all but hides.
        let bared = smooth_step(0.0, 0.03, (edge - upper_lip(x)) / unit);
        let cover = cover * bared * (1.0 - smooth_step(LAST_TEETH.0, LAST_TEETH.1, side));
        for c in 0..3 {
            colour[c] += (enamel[c] * brightness as f32 - colour[c]) * cover as f32;
        }
    }
}

/// Colour of teeth in the light of the photograph: as bright as the white of its eyes (the second brightest of four places, which a
/// highlight does not reach), but not darker than the skin of the cheeks lets expect.
fn enamel(warp: &Warp, texture: &Texture) -> [f32; 3] {
    let luma = |p: Point2<f64>| {
        let c = texture.sample(p);
        0.3 * c[0] + 0.59 * c[1] + 0.11 * c[2]
    };
    // Between the iris and the corners of the eye.
    let mut whites = [(67, 20, 68), (71, 23, 72), (69, 53, 70), (73, 56, 74)].map(|(a, corner, b): (usize, usize, usize)| {
        let iris = nalgebra::center(&warp.nodes[a], &warp.nodes[b]);
        luma(nalgebra::center(&iris, &warp.nodes[corner]))
    });
    whites.sort_by(f32::total_cmp);
    let skin = [27_usize, 60, 90, 91].map(|n| luma(warp.nodes[n])).iter().sum::<f32>() / 4.0;
    let light = (skin * 0.95 + 55.0).max(whites[2]).min(228.0);
    [1.0, 0.965, 0.90].map(|c| c * light)
}

/// Draws what the photograph shows in its open mouth over the dark: it stays with the skull, and where the mouth is now wider open than
/// on the photograph, its edge is stretched to meet the lip.
pub fn own(warp: &Warp, opening: &OpeningMesh, texture: &Texture, deformation: &Deformation, layer: &mut Layer) {
    let moved = deformation.nodes[6] - warp.nodes[6];
    let height = |p: &Point2<f64>| warp.frame.height(p);
    let lower = &opening.lower[1..opening.lower.len() - 1];
    let at = |v: u32| {
        let (stays, lip) = (warp.source[v as usize] + moved, deformation.vertices[v as usize]);
        let inwards = if lower.contains(&v) { height(&lip) < height(&stays) } else { height(&lip) > height(&stays) };
        if inwards { stays } else { lip }
    };
    for triangle in &opening.triangles {
        let from = triangle.map(|v| warp.source[v as usize]);
        layer.fill(triangle.map(at), from, |at, _| texture.sample(at));
    }
}
