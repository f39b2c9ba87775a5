//! Draws what shows between lids and between lips.

use image::RgbImage;
use nalgebra::{Point2, Vector2};

use super::{
    Deformation, MouthInside, Texture, Warp,
    eyeball::{Eyeball, Turned},
    lash_line,
    layer::Layer,
    layout::{Frame, OPENINGS, Opening, OpeningNodes},
    mesh::OpeningMesh,
    motion::eye_motion,
    mouth::{self, Arches, line_at},
    sample,
    seam::{Seam, gapes},
    tone::{self, Tone},
};
use crate::{
    geometry::{Similarity, polygon::distance_within},
    interpolation::smooth_step,
};

/// Width of the zone in which lips turn inwards, in eye distances; `ROLLED`: gaps at which this begins and is complete; `ROLLED_COLOUR`: factors on
/// red, green and blue at the edge.
const ROLL: f64 = 0.040;
const ROLLED: (f64, f64) = (0.01, 0.10);
const ROLLED_COLOUR: [f32; 3] = [0.78, 0.64, 0.64];
/// Factors on that darkening where the upper lip is raised: on the upper lip, and on the lower one, which then faces the light.
const ROLLED_LIT: [f64; 2] = [0.5, 0.4];
/// Local distance of the lips, relative to their widest distance, from which they turn inwards fully. Towards the corners lips touch, unless
/// the mouth gapes.
const ROLLS_APART: f64 = 0.6;
/// Reduction of the darkening on the upper and the lower lip of a gaping mouth, where it would look like a rim.
const ROLLED_LESS: [f64; 2] = [0.25, 0.6];

/// Draws what lies behind an opening over the frame.
pub fn draw(
    warp: &Warp,
    opening: &OpeningMesh,
    texture: &Texture,
    deformation: &Deformation,
    inside: &MouthInside,
    seam: &Seam,
    frame: &mut RgbImage,
) {
    let vertices = &deformation.vertices;
    let outline: Vec<Point2<f64>> = opening
        .upper
        .iter()
        .chain(opening.lower[1..opening.lower.len() - 1].iter().rev())
        .map(|&v| vertices[v as usize])
        .collect();
    let all = opening.upper.iter().chain(&opening.lower);
    if all.clone().all(|&v| vertices[v as usize] == warp.source[v as usize]) && behind_is_still(warp, opening, deformation) {
        return;
    }
    let Some(mut layer) = Layer::new(&outline, frame.dimensions(), warp.softness) else { return };
    extend_edges(warp, opening, texture, deformation, seam, &mut layer);
    layer.lay_under(frame);
    match (opening.opening, inside) {
        (Opening::Mouth, MouthInside::Picture { texture: source, placement }) => {
            let tone = Tone::of(texture, &warp.nodes);
            // The cast of the source's light, estimated from its skin.
            let skin = || warp.mesh.drivers.iter().map(|(_, v)| *v as usize);
            let seen = |texture: &Texture, places: &[Point2<f64>]| skin().map(|v| texture.sample(places[v])).collect::<Vec<_>>();
            let factors = tone::cast(&seen(source, &placement.0), &seen(texture, &warp.source));
            let in_light = |colour: [f32; 3]| std::array::from_fn(|c| (colour[c] * factors[c]).min(255.0));
            for triangle in &opening.triangles {
                let to = triangle.map(|v| vertices[v as usize]);
                let from = triangle.map(|v| placement.0[v as usize]);
                layer.fill(to, from, |at, _| tone.apply(in_light(source.sample(at))));
            }
        }
        (Opening::Mouth, MouthInside::Dark | MouthInside::Teeth) => {
            let arches = if warp.closed && matches!(inside, MouthInside::Teeth) { Arches::Shown } else { Arches::Hidden };
            mouth::made(warp, opening, texture, deformation, seam, arches, &mut layer);
            if !warp.closed {
                mouth::own(warp, opening, texture, deformation, &mut layer);
            }
        }
        _ => {
            if let Some(eye) = eyeball(warp, opening) {
                let turned = turned(warp, opening, deformation);
                let back = turned.head.inverse();
                layer.paint(|at| eye.colour(at, &turned, &back, texture));
            } else {
                let behind = behind(warp, opening, deformation);
                for (triangle, corners) in opening.triangles.iter().zip(&behind) {
                    let from = triangle.map(|v| warp.source[v as usize]);
                    layer.fill(*corners, from, |at, _| texture.sample(at));
                }
            }
        }
    }
    layer.spread();
    if opening.opening == Opening::Mouth && warp.closed && !matches!(inside, MouthInside::Picture { .. }) {
        let at = |edge: &[u32]| edge.iter().map(|&v| vertices[v as usize]).collect::<Vec<_>>();
        let lips = [at(&opening.upper), at(&opening.lower)];
        roll_lips(&lips, &warp.frame, seam, &Tone::of(texture, &warp.nodes), frame);
        layer.soften(warp.softness, frame);
    } else {
        // The content already has its own blur, and content that hardly moves is nearly the photograph.
        let moved = all.map(|&v| (vertices[v as usize] - warp.source[v as usize]).norm()).fold(0.0, f64::max);
        layer.soften_border(warp.softness * moved.min(1.0));
    }
    layer.lay_on(frame);
    if opening.opening != Opening::Mouth {
        lash_line::draw(warp, opening, texture, vertices, frame);
    }
}

/// The eyeball detected behind an opening.
fn eyeball<'a>(warp: &'a Warp, opening: &OpeningMesh) -> Option<&'a Eyeball> {
    let place = warp.mesh.openings.iter().position(|o| o.opening == opening.opening)?;
    warp.eyes.get(place)?.as_ref()
}

/// The middle between the corners of an eye.
fn middle_of_eye(points: &[Point2<f64>], eye: &OpeningNodes) -> Point2<f64> {
    nalgebra::center(&points[usize::from(eye.upper[0])], &points[usize::from(eye.upper[4])])
}

/// Position, size and rotation of the head in a frame, from the line between the eyes.
pub(super) fn head(warp: &Warp, deformation: &Deformation) -> Similarity {
    let eyes = |points: &[Point2<f64>]| [1, 2].map(|k: usize| middle_of_eye(points, &OPENINGS[k]));
    Similarity::fit(&eyes(&warp.nodes), &eyes(&deformation.nodes), None).unwrap_or_else(|_| Similarity::identity())
}

/// Position of an eyeball in a frame. Its size and rotation follow the head, from the line between the eyes; the corners of its own eye,
/// which a squint moves, give its position only.
fn turned(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation) -> Turned {
    let nodes = nodes_of(opening);
    let head = head(warp, deformation);
    let off = middle_of_eye(&deformation.nodes, nodes) - head.apply(&middle_of_eye(&warp.nodes, nodes));
    let head = Similarity { translation: head.translation + off, ..head };
    let iris = |points: &[Point2<f64>]| {
        Point2::from(
            nodes.iris.iter().map(|&n| points[usize::from(n)].coords).sum::<Vector2<f64>>() / nodes.iris.len().max(1) as f64,
        )
    };
    let gaze = iris(&deformation.nodes) - head.apply(&iris(&warp.nodes));
    let at = |edge: &[u32]| edge.iter().map(|&v| deformation.vertices[v as usize]).collect::<Vec<_>>();
    let edge = |edge: &[u32], sign: f64| -> Vec<(Point2<f64>, f64)> {
        let one = |&v: &u32| {
            let (was, is) = (warp.source[v as usize], deformation.vertices[v as usize]);
            let opened = sign * (warp.frame.height(&is) - warp.frame.height(&head.apply(&was)));
            (was, opened / warp.frame.eye_distance)
        };
        edge.iter().map(one).collect()
    };
    Turned::new(head, gaze, at(&opening.upper), [edge(&opening.upper, -1.0), edge(&opening.lower, 1.0)])
}

/// Whether what lies behind an opening has not moved.
fn behind_is_still(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation) -> bool {
    let nodes = nodes_of(opening);
    nodes.iris.iter().all(|&n| deformation.nodes[usize::from(n)] == warp.nodes[usize::from(n)])
}

fn nodes_of(opening: &OpeningMesh) -> &'static OpeningNodes {
    OPENINGS.iter().find(|o| o.opening == opening.opening).unwrap_or(&OPENINGS[0])
}

/// Darkens the lips towards the edge of an open mouth: they turn away from the light there, and the inner surface of the lips is redder and
/// wet. `lips` are the inner edges of the upper and the lower lip.
fn roll_lips(lips: &[Vec<Point2<f64>>; 2], face: &Frame, seam: &Seam, tone: &Tone, frame: &mut RgbImage) {
    let unit = face.eye_distance;
    let strength = smooth_step(ROLLED.0, ROLLED.1, seam.gap / unit);
    if strength <= 0.0 {
        return;
    }
    let width = ROLL * unit;
    let mut shares = ROLLED_LIT.map(|share| 1.0 - (1.0 - share) * seam.lit);
    let gaping = gapes(seam.gap / unit, seam.lit);
    shares.iter_mut().zip(ROLLED_LESS).for_each(|(share, less)| *share -= less * gaping);
    let lines = lips.each_ref().map(|lip| face.line(lip.iter().map(|p| p.coords)));
    let all: Vec<Point2<f64>> = lips.concat();
    for (x, y) in pixels_around(&all, width, frame.dimensions()) {
        let at = Point2::new(f64::from(x), f64::from(y));
        let near = lips.each_ref().map(|lip| (1.0 - distance_within(lip, &at, width) / width).max(0.0));
        let near = (shares[0] * near[0] * near[0]).max(shares[1] * near[1] * near[1]);
        if near > 0.0 {
            let apart = apart(&lines, at.coords.dot(&face.across()), seam.gap);
            let share = (strength * near * (apart + (1.0 - apart) * gaping)) as f32;
            let pixel = frame.get_pixel_mut(x, y);
            let level = pixel.0.map(f32::from);
            let rolled: [f32; 3] = std::array::from_fn(|c| level[c] * (1.0 - share * (1.0 - ROLLED_COLOUR[c])));
            pixel.0 = tone.apply(rolled).map(sample::byte);
        }
    }
}

/// Local distance of the lips, given as lines across the face, at coordinate `x`: 0 where they touch, 1 from [`ROLLS_APART`] of the widest distance.
fn apart(lines: &[Vec<(f64, f64)>; 2], x: f64, widest: f64) -> f64 {
    let [upper, lower] = lines.each_ref().map(|line| line_at(line, x));
    upper.zip(lower).map_or(0.0, |(upper, lower)| smooth_step(0.0, ROLLS_APART, (lower - upper) / widest.max(1e-9)))
}

/// The pixels of a picture in the box around a line with a margin, row by row.
pub(super) fn pixels_around(line: &[Point2<f64>], width: f64, size: (u32, u32)) -> impl Iterator<Item = (u32, u32)> {
    let bounds = |axis: usize, size: u32| {
        let (low, high) = line.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
        let clip = |v: f64| v.clamp(0.0, f64::from(size)) as u32;
        clip(low - width)..clip(high + width + 1.0)
    };
    let columns = bounds(0, size.0);
    bounds(1, size.1).flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

/// Extends the skin at the edges into the opening, so that the edge has something to blend with and a shut opening shows no slit. Each
/// half gets the colours of its edge.
fn extend_edges(
    warp: &Warp,
    opening: &OpeningMesh,
    texture: &Texture,
    deformation: &Deformation,
    seam: &Seam,
    layer: &mut Layer,
) {
    let mut place: Vec<(u32, usize, f64)> = opening.eyeball.iter().map(|&(k, share, v)| (v, k, share)).collect();
    place.extend(opening.upper.iter().enumerate().map(|(k, &v)| (v, k, 0.0)));
    let inner = 1..opening.lower.len() - 1;
    place.extend(opening.lower[inner].iter().enumerate().map(|(k, &v)| (v, k + 1, 1.0)));
    place.sort_by_key(|p| p.0);
    for triangle in &opening.triangles {
        let corners = triangle.map(|v| place.binary_search_by_key(&v, |p| p.0).map_or((0, 0.5), |k| (place[k].1, place[k].2)));
        let above = corners.map(|(k, _)| warp.source[opening.upper[k] as usize]);
        let below = corners.map(|(k, _)| warp.source[opening.lower[k] as usize]);
        let to = triangle.map(|v| deformation.vertices[v as usize]);
        let unit = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0), Point2::new(0.0, 1.0)];
        layer.fill(to, unit, |at, _| {
            let shares = [1.0 - at.x - at.y, at.x, at.y];
            let share: f64 = shares.iter().zip(&corners).map(|(s, c)| s * c.1).sum();
            let (lip, edge) = if share < 0.5 { (0, above) } else { (1, below) };
            let sum: Vector2<f64> = shares.iter().zip(&edge).map(|(s, p)| p.coords * *s).sum();
            let at = Point2::from(sum);
            if opening.opening == Opening::Mouth { seam.edge(at, lip, texture) } else { texture.sample(at) }
        });
    }
}

/// Greatest distance of the edges, px.
pub(super) fn gap(warp: &Warp, opening: &OpeningMesh, vertices: &[Point2<f64>]) -> f64 {
    let height = |v: u32| warp.frame.height(&vertices[v as usize]);
    opening.upper.iter().zip(&opening.lower).map(|(&a, &b)| height(b) - height(a)).fold(0.0, f64::max)
}

/// The triangles behind the lids. The photograph's content there moves with the head and the gaze only; where the eye is wider open than on
/// the photograph, its edge is stretched to meet the lid.
fn behind(warp: &Warp, opening: &OpeningMesh, deformation: &Deformation) -> Vec<[Point2<f64>; 3]> {
    let moved = &deformation.vertices;
    let (rigid, gaze) = eye_motion(nodes_of(opening), &warp.nodes, &deformation.nodes, warp.frame.eye_distance);
    let mut place: Vec<(u32, Point2<f64>)> = Vec::new();
    for &(_, _, v) in &opening.eyeball {
        place.push((v, rigid.apply(&warp.source[v as usize]) + gaze));
    }
    for (edge, sign) in [(&opening.upper, -1.0), (&opening.lower, 1.0)] {
        for &v in edge {
            let stays = rigid.apply(&warp.source[v as usize]) + gaze;
            let goes = moved[v as usize];
            let outer = if sign * (warp.frame.height(&goes) - warp.frame.height(&stays)) > 0.0 { goes } else { stays };
            place.push((v, outer));
        }
    }
    place.sort_by_key(|p| p.0);
    let at = |v: u32| place.binary_search_by_key(&v, |p| p.0).map_or(moved[v as usize], |k| place[k].1);
    opening.triangles.iter().map(|t| t.map(at)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lips_turn_inwards_where_they_are_apart_and_not_where_they_lie_on_each_other() {
        // From corner to corner 10 px, 4 px apart in the middle.
        let lines = [vec![(0.0, 0.0), (5.0, -1.0), (10.0, 0.0)], vec![(0.0, 0.0), (5.0, 3.0), (10.0, 0.0)]];
        assert_eq!([5.0, 0.0, 12.0].map(|x| apart(&lines, x, 4.0)), [1.0, 0.0, 0.0]);
        // 1.2 px apart are half of the 2.4 px, 0.6 of the widest, from which on they do so wholly.
        assert!((apart(&lines, 1.5, 4.0) - 0.5).abs() < 1e-12);
    }
}
