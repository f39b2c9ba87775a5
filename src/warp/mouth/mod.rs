//! The inside of a mouth: the photograph's own, or a synthetic one modelled on real mouths.
//!
//! The synthetic one has, from back to front: a cavity that gets lighter as the lips part, a tongue behind the lower teeth, the lower arch,
//! which moves with the jaw, and the upper arch, which is fixed to the skull (a raised lip bares it, a dropped jaw does not). The teeth are a
//! picture: the mean of the smiles of 24 people, aligned tooth by tooth and mirrored, so that they belong to nobody (`candide/teeth.png`;
//! `candide/README.md` lists the sources). `dentition` adds irregularities that differ between faces. Near a lip everything lies in its
//! shadow, and the lip's own colour extends a little inwards, because a lip is round and wet. `player/assets/gl.js`, the page of
//! `play`, uses the same numbers: change both together.
//! it after these numbers (`player/assets/gl.js`): who changes one changes the other.

mod dentition;
mod grain;
mod interior;
mod light;
mod proportions;
mod teeth;

use nalgebra::Point2;

use self::interior::Interior;
use super::{Deformation, Texture, Warp, layer::Layer, mesh::OpeningMesh, seam::Seam, tone::Tone};
use crate::interpolation::smooth_step;

pub use dentition::dentition;
pub use light::Light;
pub use proportions::{Proportions, teeth_size};
pub use teeth::{TEETH_ORIGIN, TEETH_SCALE, TEETH_WHITE, seen_at};

/// Whether the inside of the mouth shows teeth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arches {
    /// Both rows.
    Shown,
    /// None: cavity and tongue alone.
    Hidden,
}

/// Draws a synthetic mouth where the photograph shows none. `layer` holds the colours of the nearest lip.
pub fn made(
    warp: &Warp,
    opening: &OpeningMesh,
    texture: &Texture,
    deformation: &Deformation,
    seam: &Seam,
    arches: Arches,
    layer: &mut Layer,
) {
    for triangle in &opening.triangles {
        let to = triangle.map(|v| deformation.vertices[v as usize]);
        layer.fill(to, [Point2::origin(); 3], |_, lip| lip);
    }
    let interior = Interior::new(warp, opening, texture, deformation, seam, arches);
    let (left, top, width) = (layer.left, layer.top, layer.width);
    for (k, (colour, is_set)) in layer.pixels.iter_mut().enumerate() {
        if *is_set {
            let place = Point2::new(f64::from(left + k as u32 % width), f64::from(top + k as u32 / width));
            *colour = interior.tone.apply(interior.colour(place, *colour));
        }
    }
}

impl<'a> Interior<'a> {
    fn new(
        warp: &'a Warp,
        opening: &OpeningMesh,
        texture: &Texture,
        deformation: &Deformation,
        seam: &Seam,
        arches: Arches,
    ) -> Interior<'a> {
        let unit = warp.frame.eye_distance;
        let (across, down) = (warp.frame.across(), warp.frame.down.into_inner());
        // The skull moves with the base of the nose.
        let moved = deformation.nodes[6] - warp.nodes[6];
        let rest = nalgebra::center(&warp.nodes[87], &warp.nodes[40]);
        let origin = rest + moved;
        let edge = |vertices: &[u32]| {
            let line = warp.frame.line(vertices.iter().map(|&v| deformation.vertices[v as usize] - origin));
            line.into_iter().map(|(x, y)| (x / unit, y / unit)).collect()
        };
        let chin = deformation.nodes[10] - warp.nodes[10] - moved;
        Interior {
            origin,
            across,
            down,
            unit,
            upper: edge(&opening.upper),
            lower: edge(&opening.lower),
            jaw: (chin.dot(&down) / unit).max(0.0),
            gap: seam.gap / unit,
            lit: seam.lit,
            lip: lip_colour(warp, texture),
            light: Light::of(warp, texture),
            tone: Tone::of(texture, &warp.nodes),
            size: teeth_size(warp),
            proportions: Proportions::of(warp),
            teeth: match arches {
                Arches::Shown => warp.teeth(),
                Arches::Hidden => None,
            },
        }
    }
}

/// Height of a line at `x`; `None` beyond its ends.
pub(super) fn line_at(line: &[(f64, f64)], x: f64) -> Option<f64> {
    let k = line.partition_point(|p| p.0 < x);
    let (a, b) = (line.get(k.checked_sub(1)?)?, line.get(k)?);
    Some(a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0).max(1e-9))
}

/// Height of a line at `x`; beyond its ends that of the end, and 0 for an empty line.
pub(super) fn on_line(line: &[(f64, f64)], x: f64) -> f64 {
    let Some(pair) = line.windows(2).find(|pair| x <= pair[1].0).or(line.windows(2).last()) else {
        return line.first().map_or(0.0, |only| only.1);
    };
    let share = ((x - pair[0].0) / (pair[1].0 - pair[0].0).max(1e-9)).clamp(0.0, 1.0);
    pair[0].1 + (pair[1].1 - pair[0].1) * share
}

/// Brightness of a colour.
pub fn luma([r, g, b]: [f32; 3]) -> f32 {
    0.3 * r + 0.59 * g + 0.11 * b
}

/// Brightness minus a penalty for red: skin, and a lid below its crease, are not the white of an eye.
pub fn whiteness(colour: [f32; 3]) -> f32 {
    luma(colour) - 0.8 * (colour[0] - colour[1]).max(0.0)
}

/// Colour of the lower lip.
pub fn lip_colour(warp: &Warp, texture: &Texture) -> [f32; 3] {
    let inwards = warp.nodes[40] - warp.nodes[8];
    let lips = [8_usize, 85, 86].map(|n| texture.sample(warp.nodes[n] + inwards * 0.4));
    std::array::from_fn(|c| (lips[0][c] + lips[1][c] + lips[2][c]) / 3.0)
}

/// Distance, in eye distances, by which the photograph's inside of a mouth is stretched to follow a dropping lower lip; the photograph shows
/// nothing further down. Over this distance the lip's own colour at its edge fades.
const OWN_STRETCH: f64 = 0.02;
/// Width, in eye distances, of the fade from the photograph's edge to the synthetic mouth when the lower lip is that far away.
const OWN_FADE: f64 = 0.022;

/// Draws the photograph's own inside of an open mouth over the synthetic one. It is fixed to the skull; where the upper lip is higher than
/// on the photograph, its edge is stretched to meet the lip. A dropping lower lip moves away from it, as from the upper teeth.
pub fn own(warp: &Warp, opening: &OpeningMesh, texture: &Texture, deformation: &Deformation, layer: &mut Layer) {
    let moved = deformation.nodes[6] - warp.nodes[6];
    let (unit, down, across) = (warp.frame.eye_distance, warp.frame.down.into_inner(), warp.frame.across());
    let height = |p: &Point2<f64>| warp.frame.height(p);
    let lower = &opening.lower[1..opening.lower.len() - 1];
    let dropped = |v: u32| height(&deformation.vertices[v as usize]) - height(&(warp.source[v as usize] + moved));
    let at = |v: u32| {
        let (stays, lip) = (warp.source[v as usize] + moved, deformation.vertices[v as usize]);
        match (lower.contains(&v), dropped(v)) {
            (true, way) if way > 0.0 => stays + (lip - stays) * (OWN_STRETCH * unit / way).min(1.0),
            (true, _) => stays,
            (false, way) if way > 0.0 => stays,
            (false, _) => lip,
        }
    };
    let furthest = lower.iter().map(|&v| dropped(v)).fold(0.0, f64::max);
    let left = smooth_step(0.5 * OWN_STRETCH, 2.0 * OWN_STRETCH, furthest / unit);
    let edge = warp.frame.line(opening.lower.iter().map(|&v| warp.source[v as usize].coords));
    let faded = |at: Point2<f64>| {
        let above = line_at(&edge, at.coords.dot(&across)).map_or(0.0, |y| (y - at.coords.dot(&down)) / unit);
        left * (1.0 - smooth_step(0.0, OWN_FADE, above))
    };
    for triangle in &opening.triangles {
        let from = triangle.map(|v| warp.source[v as usize]);
        layer.fill(triangle.map(at), from, |at, made| {
            let (own, gone) = (texture.sample(at), faded(at) as f32);
            std::array::from_fn(|c| own[c] + (made[c] - own[c]) * gone)
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_followed_and_end() {
        let line = [(0.0, 1.0), (2.0, 3.0), (4.0, 3.0)];
        assert_eq!(line_at(&line, 1.0), Some(2.0));
        assert_eq!(line_at(&line, 3.0), Some(3.0));
        assert_eq!(line_at(&line, 4.5), None);
        assert_eq!(line_at(&line, -0.5), None);
        // 2 is half way from 1 to 3; the ends are extended.
        assert_eq!([-1.0, 0.0, 1.0, 4.0, 9.0].map(|x| on_line(&line, x)), [1.0, 1.0, 2.0, 3.0, 3.0]);
        let line = [(0.0, 2.0), (1.0, 4.0), (3.0, 0.0)];
        assert_eq!([-1.0, 0.5, 2.0, 9.0].map(|x| on_line(&line, x)), [2.0, 3.0, 2.0, 0.0]);
        assert_eq!(on_line(&[], 1.0), 0.0);
    }
}
