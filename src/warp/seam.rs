//! The dark line where closed lips meet, removed as the mouth opens.
//!
//! Where the upper lip is raised, the line disappears: each lip is as bright at its edge as beside the line. On the photograph the line is part
//! of the skin and would become a dark rim around the opening. As the lips part, whatever is darker than the lip beside it is therefore
//! brightened to that lip's level. The line stays towards the corners, where lips shade each other, and where the lower lip drops, because
//! its edge turns away from the light.

use nalgebra::{Point2, Vector2};

use super::{
    Deformation, Texture, Warp,
    mouth::{line_at, luma, whiteness},
    openings,
    sample::Bounds,
};
use crate::interpolation::smooth_step;

/// Distances of the lips, in eye distances, at which the line begins to fade and is fully faded.
const PARTED: (f64, f64) = (0.008, 0.06);
/// Fraction of the line that is removed on the upper lip (in its own shadow) and on the lower one.
const GONE: [f64; 2] = [0.55, 0.85];
/// The same fractions in a gaping mouth, relative to those of lips in the light: the line would be a rim around the opening.
const GONE_DROPPED: [f64; 2] = [0.6, 0.8];
/// Half the width of the line, in eye distances.
const WIDTH: f64 = 0.032;
/// Distances from the ends of the opening, over the width of the mouth, at which the removal begins and is complete.
const WITHIN: (f64, f64) = (0.06, 0.34);
/// The same in a gaping mouth, whose corners are no slit.
const WITHIN_GAPING: (f64, f64) = (0.01, 0.14);
/// Relative darkness against the surroundings from which a pixel certainly belongs to the line.
const DARKER: f64 = 0.10;

/// Detection of teeth that a photograph shows between lips that count as closed. `TEETH_WITHIN`: search distance from the line, in eye distances.
/// `TEETH_BESIDE` and `TEETH_AROUND`: extent of the surroundings replaced with them, along the line (fully, at most) and across it.
/// `TEETH_WHITER`: levels by which they are whiter than both lips, from possible to certain.
const TEETH_WITHIN: f64 = 0.022;
const TEETH_BESIDE: (f64, f64) = (0.05, 0.13);
const TEETH_AROUND: f64 = 0.072;
const TEETH_WHITER: (f64, f64) = (16.0, 32.0);

/// Fractions of the gap by which the lower lip has dropped, between which its edge turns away from the light.
pub const TURNED_AWAY: (f64, f64) = (0.60, 0.90);

/// The line in one frame, and the parting of the lips.
pub struct Seam {
    /// The line on the photograph from one end of the opening to the other: coordinates along the face's horizontal and down, px.
    line: Vec<(f64, f64)>,
    across: Vector2<f64>,
    down: Vector2<f64>,
    /// Fraction of the line that is removed on the upper and on the lower lip; 0 for a mouth that is open on its photograph.
    gone: [f64; 2],
    /// Distances from the ends of the opening at which the removal begins and is complete, over the width of the mouth.
    within: (f64, f64),
    /// Parting of lips that are closed on the photograph, 0 to 1.
    parted: f64,
    /// Certainty of visible teeth along the line; empty if there are none.
    teeth: Vec<(f64, f64)>,
    unit: f64,
    /// Greatest distance of the lips, px.
    pub gap: f64,
    /// Light on the inner edges of the lips, 0 to 1.
    pub lit: f64,
}

impl Seam {
    /// Prepares the line of a mouth for a frame.
    pub fn new(warp: &Warp, deformation: &Deformation, texture: &Texture) -> Self {
        let (unit, mouth) = (warp.frame.eye_distance, &warp.mesh.openings[0]);
        let gap = openings::gap(warp, mouth, &deformation.vertices);
        let lit = lit(warp, deformation);
        let parted = if warp.closed { smooth_step(PARTED.0, PARTED.1, gap / unit) } else { 0.0 };
        let gaping = gapes(gap / unit, lit);
        let gone = [0, 1].map(|lip| GONE[lip] * (lit + GONE_DROPPED[lip] * gaping) * parted);
        let wider = |from: f64, to: f64| from + (to - from) * gaping;
        let within = (wider(WITHIN.0, WITHIN_GAPING.0), wider(WITHIN.1, WITHIN_GAPING.1));
        let line = warp.frame.line(mouth.upper.iter().map(|&v| warp.source[v as usize].coords));
        let (across, down) = (warp.frame.across(), warp.frame.down.into_inner());
        let mut seam = Self { line, across, down, gone, within, parted, teeth: Vec::new(), unit, gap, lit };
        if parted > 0.0 {
            seam.teeth = seam.teeth_along(texture);
        }
        seam
    }

    /// Certainty of teeth, or of the dark beside them, along the line; empty if there are none.
    fn teeth_along(&self, texture: &Texture) -> Vec<(f64, f64)> {
        let shown: Vec<(f64, f64)> =
            self.line.iter().map(|&(x, y)| (x, self.shows_teeth(self.across * x + self.down * y, texture))).collect();
        if shown.iter().all(|place| place.1 <= 0.0) {
            return Vec::new();
        }
        let beside = |off: f64| 1.0 - smooth_step(TEETH_BESIDE.0, TEETH_BESIDE.1, off.abs() / self.unit);
        let most = |x: f64| shown.iter().map(|place| place.1 * beside(place.0 - x)).fold(0.0, f64::max);
        shown.iter().map(|&(x, _)| (x, most(x))).collect()
    }

    /// Certainty of teeth at a point of the line, 0 to 1: it is whiter than both lips, where closed lips have their dark line.
    fn shows_teeth(&self, at: Vector2<f64>, texture: &Texture) -> f64 {
        let white = |off: f64| whiteness(texture.sample(Point2::from(at + self.down * (off * self.unit))));
        let between = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|share| white(share * TEETH_WITHIN)).into_iter().fold(f32::MIN, f32::max);
        let lips = [-1.0, -0.7, 0.7, 1.0].map(|share| white(share * TEETH_AROUND)).into_iter().fold(f32::MIN, f32::max);
        self.within_ends(&Point2::from(at)) * smooth_step(TEETH_WHITER.0, TEETH_WHITER.1, f64::from(between - lips))
    }

    /// Bounds outside of which [`Seam::colour`] equals the photograph; `None` if it does so everywhere.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        let width = if self.teeth.is_empty() { WIDTH } else { TEETH_AROUND } * self.unit;
        let ends = |&(x, y): &(f64, f64)| [-width, width].map(|off| Point2::from(self.across * x + self.down * (y + off)));
        self.changes().then(|| Bounds::around(self.line.iter().flat_map(ends))).flatten()
    }

    fn changes(&self) -> bool {
        self.gone[1] > 0.0 || !self.teeth.is_empty()
    }

    /// Colour of the photograph at a point of the skin, with the line removed.
    pub fn colour(&self, at: Point2<f64>, photograph: [f32; 3], texture: &Texture) -> [f32; 3] {
        if !self.changes() {
            return photograph;
        }
        self.below(&at).map_or(photograph, |below| self.on_lip(at, below, usize::from(below > 0.0), photograph, texture))
    }

    /// Colour of the edge of the upper (0) or the lower lip (1) at a point of the line.
    pub fn edge(&self, at: Point2<f64>, lip: usize, texture: &Texture) -> [f32; 3] {
        let photograph = texture.sample(at);
        self.below(&at).map_or(photograph, |below| self.on_lip(at, below, lip, photograph, texture))
    }

    /// Distance below the line, px; `None` beyond its ends.
    fn below(&self, at: &Point2<f64>) -> Option<f64> {
        let (x, y) = (at.coords.dot(&self.across), at.coords.dot(&self.down));
        line_at(&self.line, x).map(|line| y - line)
    }

    /// Weight that is 0 at the ends of the opening and 1 in its middle.
    fn within_ends(&self, at: &Point2<f64>) -> f64 {
        let x = at.coords.dot(&self.across);
        let [(first, _), .., (last, _)] = self.line[..] else { return 0.0 };
        smooth_step(self.within.0, self.within.1, (x - first).min(last - x) / (last - first).max(1e-9))
    }

    fn on_lip(&self, at: Point2<f64>, below: f64, lip: usize, photograph: [f32; 3], texture: &Texture) -> [f32; 3] {
        let side = if lip == 0 { -1.0 } else { 1.0 };
        let photograph = self.without_teeth(at, below, side, photograph, texture);
        let width = WIDTH * self.unit;
        if below.abs() >= width || self.gone[lip] <= 0.0 {
            return photograph;
        }
        let guess = texture.sample(at + self.down * (side * width - below));
        let inside = smooth_step(0.0, 1.0, 1.5 * (1.0 - below.abs() / width)) * self.within_ends(&at);
        lightened(photograph, guess, self.gone[lip] * inside)
    }

    /// Colour of a lip without the teeth, or the dark around them: repeats the skin of that lip further out.
    fn without_teeth(&self, at: Point2<f64>, below: f64, side: f64, photograph: [f32; 3], texture: &Texture) -> [f32; 3] {
        let around = TEETH_AROUND * self.unit;
        let left = around - below.abs();
        let teeth = line_at(&self.teeth, at.coords.dot(&self.across)).unwrap_or(0.0);
        if left <= 0.0 || teeth <= 0.0 {
            return photograph;
        }
        let share = (self.parted * teeth * smooth_step(0.0, 0.3, left / around)) as f32;
        let repeated = texture.sample(at + self.down * (side * (around + 0.5 * left) - below));
        std::array::from_fn(|c| photograph[c] + (repeated[c] - photograph[c]) * share)
    }
}

/// Distances of the lips, in eye distances, between which a dropping jaw begins to let light into the mouth and does so fully.
const GAPES: (f64, f64) = (0.10, 0.24);

/// How far a mouth gapes, 0 to 1, from the distance of the lips in eye distances and the light on their edges. It is 0 where the upper lip is
/// raised.
pub fn gapes(gap: f64, lit: f64) -> f64 {
    (1.0 - lit) * smooth_step(GAPES.0, GAPES.1, gap)
}

/// Light on the inner edges of parting lips, 0 to 1. Where the upper lip is raised, teeth stand close behind the lower one, whose edge
/// faces the light. Where the lower lip drops with the jaw, its edge turns away and the dark lies behind it.
fn lit(warp: &Warp, deformation: &Deformation) -> f64 {
    let down = warp.frame.down.into_inner();
    let moved = |n: usize| (deformation.nodes[n] - warp.nodes[n]).dot(&down);
    let (gap, dropped) = ((deformation.nodes[40] - deformation.nodes[87]).dot(&down), moved(40) - moved(6));
    if gap > 0.0 { 1.0 - smooth_step(TURNED_AWAY.0, TURNED_AWAY.1, dropped / gap) } else { 1.0 }
}

/// Blends a colour towards another one by `share`, as far as it is the darker of the two.
fn lightened(colour: [f32; 3], guess: [f32; 3], share: f64) -> [f32; 3] {
    let darker = smooth_step(0.0, DARKER, f64::from(1.0 - luma(colour) / luma(guess).max(1.0)));
    let share = (share * darker) as f32;
    std::array::from_fn(|c| colour[c] + (guess[c] - colour[c]) * share)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::warp::{
        MouthInside,
        test_face::{nodes, warp},
    };

    #[test]
    fn the_line_between_lips_that_part_is_not_left_around_the_opening() {
        let nodes = nodes();
        let warp = warp();
        // Skin and lips of one colour; a dark line of 4 px where the lips meet.
        let moved = |nodes_moved: &[usize], by: f64| {
            let mut open = nodes.clone();
            nodes_moved.iter().for_each(|&n| open[n].y += by);
            warp.deform(&open).unwrap()
        };
        // By a raised upper lip, and by a jaw that drops.
        let raised = moved(&[87, 81, 82, 7, 33, 66], -12.0);
        let dropped = moved(&[40, 83, 84, 8, 10, 85, 86], 12.0);
        let plain = Texture::new(&RgbImage::from_pixel(300, 380, Rgb([200, 140, 130])));
        let seam = Seam::new(&warp, &raised, &plain);
        let on_line = |at: &Point2<f64>| seam.below(at).is_some_and(|below| below.abs() <= 2.0);
        let picture = RgbImage::from_fn(300, 380, |x, y| {
            if on_line(&Point2::new(f64::from(x), f64::from(y))) { Rgb([60, 30, 30]) } else { Rgb([200, 140, 130]) }
        });
        let texture = Texture::new(&picture);
        let red = |at: Point2<f64>| seam.colour(at, texture.sample(at), &texture)[0];
        let middle = warp.nodes[40];
        // Of 140 levels, a sixth remains on the lower lip and half on the upper one; away from the line nothing changes.
        assert!(red(middle + Vector2::new(0.0, 1.0)) > 170.0 && (110.0..170.0).contains(&red(middle - Vector2::new(0.0, 1.0))));
        assert!((red(middle + Vector2::new(0.0, 8.0)) - 200.0).abs() < 1e-3);
        // While lips are closed, the photograph is unchanged. In an open mouth the lower lip is light to its edge, unless it dropped.
        let closed = Seam::new(&warp, &warp.deform(&nodes).unwrap(), &texture);
        assert_eq!(closed.colour(middle, [60.0, 30.0, 30.0], &texture), [60.0, 30.0, 30.0]);
        let below_edge = |frame: &Deformation| {
            let at = frame.node(40) + Vector2::new(0.0, 1.0);
            warp.render(&texture, frame, &MouthInside::Dark).get_pixel(at.x.round() as u32, at.y.round() as u32).0[0]
        };
        let (raised, dropped) = (below_edge(&raised), below_edge(&dropped));
        assert!(raised > 130 && dropped < raised - 30, "{raised} {dropped}");
    }

    #[test]
    fn no_line_is_left_at_the_corners_of_a_mouth_that_gapes() {
        let nodes = nodes();
        let warp = warp();
        let dropped = |share: f64| {
            let mut open = nodes.clone();
            [40, 83, 84, 8, 10, 85, 86].iter().for_each(|&n: &usize| open[n].y += share * warp.frame.eye_distance);
            warp.deform(&open).unwrap()
        };
        let plain = Texture::new(&RgbImage::from_pixel(300, 380, Rgb([200, 140, 130])));
        let [parted, gaping] = [0.08, 0.30].map(|share| Seam::new(&warp, &dropped(share), &plain));
        // A tenth of the width from the end of the opening, on the line, which is 140 levels darker there.
        let at = nodes[89] + (nodes[88] - nodes[89]) * 0.1;
        let at = at - gaping.down * gaping.below(&at).unwrap();
        let picture = Texture::new(&RgbImage::from_fn(300, 380, |x, y| {
            let on_line = gaping.below(&Point2::new(f64::from(x), f64::from(y))).is_some_and(|below| below.abs() <= 2.0);
            if on_line { Rgb([60, 30, 30]) } else { Rgb([200, 140, 130]) }
        }));
        let red = |seam: &Seam| seam.colour(at + gaping.down * 0.5, [60.0, 30.0, 30.0], &picture)[0];
        assert!(red(&parted) < 65.0 && red(&gaping) > 100.0, "{} {}", red(&parted), red(&gaping));
    }

    #[test]
    fn teeth_that_show_between_closed_lips_do_not_part_with_them() {
        let nodes = nodes();
        let warp = warp();
        let mut open = nodes.clone();
        [40, 83, 84, 8, 10, 85, 86].iter().for_each(|&n: &usize| open[n].y += 12.0);
        let open = warp.deform(&open).unwrap();
        let lips = Texture::new(&RgbImage::from_pixel(300, 380, Rgb([200, 140, 130])));
        let line = Seam::new(&warp, &open, &lips);
        let middle = warp.nodes[40];
        // Teeth of 4 px in the middle of the lips, white as no lip is.
        let show = |at: &Point2<f64>| (at.x - middle.x).abs() < 12.0 && line.below(at).is_some_and(|below| below.abs() <= 2.0);
        let picture = RgbImage::from_fn(300, 380, |x, y| {
            if show(&Point2::new(f64::from(x), f64::from(y))) { Rgb([210, 205, 200]) } else { Rgb([200, 140, 130]) }
        });
        let texture = Texture::new(&picture);
        let seam = Seam::new(&warp, &open, &texture);
        let green = |seam: &Seam, below: f64| {
            let at = middle + Vector2::new(0.0, below);
            seam.colour(at, texture.sample(at), &texture)[1]
        };
        // Where the photograph has teeth, both lips continue to their edges. While they are closed, the photograph is unchanged.
        assert!((green(&seam, 1.0) - 140.0).abs() < 1.0 && (green(&seam, -1.0) - 140.0).abs() < 1.0);
        let closed = Seam::new(&warp, &warp.deform(&nodes).unwrap(), &texture);
        assert!(green(&closed, 1.0) > 200.0);
        // Without teeth nothing is detected, and the lips stay.
        assert!(line.teeth.is_empty());
    }

    #[test]
    fn a_mouth_gapes_by_a_jaw_that_drops_far_and_by_nothing_else() {
        assert_eq!((gapes(0.30, 0.0), gapes(0.05, 0.0), gapes(0.30, 1.0)), (1.0, 0.0, 0.0));
        // Half way between 0.10 and 0.24, for an edge in half the light.
        assert!((gapes(0.17, 0.5) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn what_is_lighter_than_its_surroundings_stays() {
        assert_eq!(lightened([200.0; 3], [100.0; 3], 1.0), [200.0; 3]);
        assert_eq!(lightened([50.0; 3], [100.0; 3], 1.0), [100.0; 3]);
        assert_eq!(lightened([50.0; 3], [100.0; 3], 0.5), [75.0; 3]);
    }
}
