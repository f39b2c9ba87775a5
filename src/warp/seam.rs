//! The line in which closed lips meet, on a mouth that opens.
//!
//! Closed lips meet in a dark line. Where the upper lip is raised, it is gone: each lip is as bright to its edge as it is beside the line. What the
//! photograph has of it goes with the skin, so that it would be a dark rim around the opening. It is taken away as lips part: what is darker than
//! the lip beside it becomes as bright. Towards the corners it stays, where lips are in each other's shadow, and where the lower lip drops, whose
//! edge is turned away from the light.

use nalgebra::{Point2, Vector2};

use super::{
    Deformation, Texture, Warp,
    mouth::{line_at, luma},
    openings,
    sample::Bounds,
};
use crate::interpolation::smooth_step;

/// Distance of the lips over the eye distance at which the line begins to go, and at which it has gone.
const PARTED: (f64, f64) = (0.008, 0.06);
/// How much of it then is gone on the upper lip, which is in its own shadow, and on the lower one.
const GONE: [f64; 2] = [0.55, 0.85];
/// Half its width, over the eye distance: beyond, it is the lip.
const WIDTH: f64 = 0.032;
/// How far from the ends of the opening it begins to go, and goes wholly, over the width of the mouth.
const WITHIN: (f64, f64) = (0.06, 0.34);
/// How much darker than its surroundings, as a share, a place is that belongs to the line for certain.
const DARKER: f64 = 0.10;

/// Shares of the gap by which the lower lip has dropped between which its edge turns away from the light.
pub const TURNED_AWAY: (f64, f64) = (0.60, 0.90);

/// The line in one frame, and how lips part there.
pub struct Seam {
    /// From the one end of the opening to the other on the photograph: along the face's horizontal and down, px.
    line: Vec<(f64, f64)>,
    across: Vector2<f64>,
    down: Vector2<f64>,
    /// How much of it is gone; nothing of a mouth that is open on its photograph.
    gone: f64,
    unit: f64,
    /// Widest distance of the lips, px.
    pub gap: f64,
    /// How far the light falls on their inner edges, 0 to 1.
    pub lit: f64,
}

impl Seam {
    /// The line of a mouth in a frame.
    pub fn new(warp: &Warp, deformation: &Deformation) -> Self {
        let (unit, mouth) = (warp.frame.eye_distance, &warp.mesh.openings[0]);
        let gap = openings::gap(warp, mouth, &deformation.vertices);
        let lit = lit(warp, deformation);
        let gone = if warp.closed { lit * smooth_step(PARTED.0, PARTED.1, gap / unit) } else { 0.0 };
        let line = warp.frame.line(mouth.upper.iter().map(|&v| warp.source[v as usize].coords));
        Self { line, across: warp.frame.across(), down: warp.frame.down.into_inner(), gone, unit, gap, lit }
    }

    /// The box outside of which [`Seam::colour`] is the photograph; `None` where it is so everywhere.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        let width = WIDTH * self.unit;
        let ends = |&(x, y): &(f64, f64)| [-width, width].map(|off| Point2::from(self.across * x + self.down * (y + off)));
        (self.gone > 0.0).then(|| Bounds::around(self.line.iter().flat_map(ends))).flatten()
    }

    /// The photograph's colour at a place of the skin without the line.
    pub fn colour(&self, at: Point2<f64>, photograph: [f32; 3], texture: &Texture) -> [f32; 3] {
        if self.gone <= 0.0 {
            return photograph;
        }
        self.below(&at).map_or(photograph, |below| self.on_lip(at, below, usize::from(below > 0.0), photograph, texture))
    }

    /// The colour of the edge of the upper (0) or of the lower lip (1) at a place of the line.
    pub fn edge(&self, at: Point2<f64>, lip: usize, texture: &Texture) -> [f32; 3] {
        let photograph = texture.sample(at);
        self.below(&at).map_or(photograph, |below| self.on_lip(at, below, lip, photograph, texture))
    }

    /// How far a place lies below the line, px; `None` beside its ends.
    fn below(&self, at: &Point2<f64>) -> Option<f64> {
        let (x, y) = (at.coords.dot(&self.across), at.coords.dot(&self.down));
        line_at(&self.line, x).map(|line| y - line)
    }

    /// 0 at the ends of the opening, 1 in its middle.
    fn within_ends(&self, at: &Point2<f64>) -> f64 {
        let x = at.coords.dot(&self.across);
        let [(first, _), .., (last, _)] = self.line[..] else { return 0.0 };
        smooth_step(WITHIN.0, WITHIN.1, (x - first).min(last - x) / (last - first).max(1e-9))
    }

    fn on_lip(&self, at: Point2<f64>, below: f64, lip: usize, photograph: [f32; 3], texture: &Texture) -> [f32; 3] {
        let width = WIDTH * self.unit;
        if below.abs() >= width || self.gone <= 0.0 {
            return photograph;
        }
        let side = if lip == 0 { -1.0 } else { 1.0 };
        let guess = texture.sample(at + self.down * (side * width - below));
        let inside = smooth_step(0.0, 1.0, 1.5 * (1.0 - below.abs() / width)) * self.within_ends(&at);
        lightened(photograph, guess, GONE[lip] * self.gone * inside)
    }
}

/// How far the light falls on the inner edges of lips that part: where the upper lip is raised, teeth stand close behind the lower one, whose edge
/// faces the light; where the lower lip has dropped, with a jaw, its edge is turned away, and dark lies behind it.
fn lit(warp: &Warp, deformation: &Deformation) -> f64 {
    let down = warp.frame.down.into_inner();
    let moved = |n: usize| (deformation.nodes[n] - warp.nodes[n]).dot(&down);
    let (gap, dropped) = ((deformation.nodes[40] - deformation.nodes[87]).dot(&down), moved(40) - moved(6));
    if gap > 0.0 { 1.0 - smooth_step(TURNED_AWAY.0, TURNED_AWAY.1, dropped / gap) } else { 1.0 }
}

/// A colour drawn to another one by a share, as far as it is the darker of the two.
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
        let seam = Seam::new(&warp, &raised);
        let on_line = |at: &Point2<f64>| seam.below(at).is_some_and(|below| below.abs() <= 2.0);
        let picture = RgbImage::from_fn(300, 380, |x, y| {
            if on_line(&Point2::new(f64::from(x), f64::from(y))) { Rgb([60, 30, 30]) } else { Rgb([200, 140, 130]) }
        });
        let texture = Texture::new(&picture);
        let red = |at: Point2<f64>| seam.colour(at, texture.sample(at), &texture)[0];
        let middle = warp.nodes[40];
        // Of 140 levels, a sixth is left on the lower lip, half on the upper one; away from the line nothing changes.
        assert!(red(middle + Vector2::new(0.0, 1.0)) > 170.0 && (110.0..170.0).contains(&red(middle - Vector2::new(0.0, 1.0))));
        assert!((red(middle + Vector2::new(0.0, 8.0)) - 200.0).abs() < 1e-3);
        // As long as lips are closed it is the photograph; open, the lower lip is light to its edge, but not where it dropped.
        let closed = Seam::new(&warp, &warp.deform(&nodes).unwrap());
        assert_eq!(closed.colour(middle, [60.0, 30.0, 30.0], &texture), [60.0, 30.0, 30.0]);
        let below_edge = |frame: &Deformation| {
            let at = frame.node(40) + Vector2::new(0.0, 1.0);
            warp.render(&texture, frame, &MouthInside::Dark).get_pixel(at.x.round() as u32, at.y.round() as u32).0[0]
        };
        let (raised, dropped) = (below_edge(&raised), below_edge(&dropped));
        assert!(raised > 130 && dropped < raised - 30, "{raised} {dropped}");
    }

    #[test]
    fn what_is_lighter_than_its_surroundings_stays() {
        assert_eq!(lightened([200.0; 3], [100.0; 3], 1.0), [200.0; 3]);
        assert_eq!(lightened([50.0; 3], [100.0; 3], 1.0), [100.0; 3]);
        assert_eq!(lightened([50.0; 3], [100.0; 3], 0.5), [75.0; 3]);
    }
}
