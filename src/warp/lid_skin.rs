//! The skin of the upper lids without lashes, for eyes that shut and for brows that rise (see `lashes`).
//!
//! A shutting lid pulls down the skin above it, which would draw the lashes in front of it out to stripes. This module estimates the skin
//! without them: at each position along the lid, the brighter colours between lid and brow, above any lash, are extended down to the edge.
//! This estimate replaces the photograph while the lid goes down. The area where the eye was is painted (see `shut_lid`), and the
//! line of lashes is drawn on top (see `lash_line`). The page of `play` does the same (`player/assets/lids.js`): change both together.

use nalgebra::{Point2, Vector2};

use super::{
    Texture, Warp,
    layout::{OPENINGS, lid_skin_of},
    mesh::OpeningMesh,
    mouth::{luma, on_line},
    sample::Bounds,
    shut_lid::{cheek, shut_colour},
};
use crate::interpolation::smooth_step;

/// Least and greatest height above the lid that is sampled, in eye distances, and (`BROW_SHARE`) the greatest fraction of the way to the brow.
const HEIGHTS: (f64, f64) = (0.05, 0.15);
const BROW_SHARE: f64 = 0.6;
/// Step upwards, in eye distances; number of positions along the lid.
const STEP: f64 = 0.006;
const PLACES: usize = 28;
/// Number of positions to either side whose colours are pooled.
const BESIDE: usize = 3;
/// Quantiles of brightness between which the colours above a position count as skin without lashes.
const SKIN: (f64, f64) = (0.75, 0.95);
/// Brightness relative to that skin at which lashes end: of the mean over neighbouring positions, and of the second darkest of them.
const LASHLESS: f64 = 0.93;
const THREADLESS: f64 = 0.90;
/// Steepest slope of the height of the lashes along the lid.
const FALL: f64 = 0.6;
/// Least height of the band of lashes, and the height over which the replacement fades above it, in eye distances. The fade ends before the
/// brow (`BEFORE_BROW`, fraction of the way there), but has at least `LEAST_FADE`.
pub const LEAST_BAND: f64 = 0.03;
const FADE: f64 = 0.055;
const BEFORE_BROW: f64 = 0.85;
const LEAST_FADE: f64 = 0.015;
/// Skin from above the lashes is laid over the estimate with this opacity. It is compressed in height by `FOLDED`. `CLEAR`: it is not used where it
/// is darker than the first value relative to the estimate, and fully used from the second on.
pub const GRAIN: f32 = 0.55;
pub const FOLDED: f64 = 0.4;
pub const CLEAR: (f64, f64) = (0.80, 0.95);
/// Sideways offsets, in eye distances, of the skin samples that are averaged, so that single higher lashes do not become stripes.
pub const STRIPS: [f64; 5] = [-0.024, -0.012, 0.0, 0.012, 0.024];
/// Positions along the lid between which the replacement fades in at the outer corner and fades out at the inner one.
pub const ENDS: [(f64, f64); 2] = [(-0.06, 0.10), (0.90, 1.06)];
/// Closed fractions of the opening at which the replacement begins and is complete.
pub const SHUT: (f64, f64) = (0.25, 0.70);

/// The skin above one eye without lashes.
#[derive(Clone, Debug)]
pub struct LidSkin {
    /// Outer corner of the eye, and the vector to the inner one.
    pub from: Point2<f64>,
    pub across: Vector2<f64>,
    down: Vector2<f64>,
    eye_distance: f64,
    /// Height of the lid at each position along it, above the line between the corners, px.
    pub edge: Vec<f64>,
    /// The skin at each position, levels, and the height of the lashes, px.
    pub skin: Vec<[f32; 3]>,
    pub band: Vec<f64>,
    /// Colour of the shut lid where the eye was, levels (see `shut_lid`).
    pub shut: [f32; 3],
    /// Height over which the replacement fades above the lashes, px.
    pub fade: f64,
}

impl LidSkin {
    /// Finds the skin above both eyes, the subject's left one first; `None` if there is too little room.
    pub fn find(warp: &Warp, texture: &Texture) -> [Option<Self>; 2] {
        [1, 2].map(|k: usize| Self::new(warp, warp.mesh.openings.get(k)?, texture))
    }

    fn new(warp: &Warp, opening: &OpeningMesh, texture: &Texture) -> Option<Self> {
        let unit = warp.frame.eye_distance;
        let nodes = OPENINGS.iter().find(|o| o.opening == opening.opening)?;
        let upper: Vec<Point2<f64>> = opening.upper.iter().map(|&v| warp.source[v as usize]).collect();
        let (from, to) = (*upper.first()?, *upper.last()?);
        let across = to - from;
        let down = warp.frame.down.into_inner();
        if across.norm_squared() < 1e-9 {
            return None;
        }
        let (edge, skin, band) = (Vec::new(), Vec::new(), Vec::new());
        let mut lid = Self { from, across, down, eye_distance: unit, edge, skin, band, shut: [0.0; 3], fade: FADE * unit };
        let spots: Vec<(f64, f64)> = upper.iter().map(|p| lid.place(p)).collect();
        lid.edge = (0..PLACES).map(|k| on_line(&spots, along(k))).collect();
        let brow = lid_skin_of(opening.opening)?.brow.map(|n| warp.nodes[usize::from(n)]);
        let room = lid.place(&nalgebra::center(&brow[0], &brow[1])).1 - lid.place(&warp.nodes[usize::from(nodes.upper[2])]).1;
        let height = (BROW_SHARE * room / unit).min(HEIGHTS.1);
        if height < HEIGHTS.0 {
            return None;
        }
        let steps = (height / STEP) as usize;
        let column = |k: usize| -> Vec<[f32; 3]> {
            let at = from + across * along(k);
            (0..steps).map(|m| texture.sample(at - down * (lid.edge[k] + m as f64 * STEP * unit))).collect()
        };
        let columns: Vec<Vec<[f32; 3]>> = (0..PLACES).map(column).collect();
        for k in 0..PLACES {
            let beside = &columns[k.saturating_sub(BESIDE)..(k + BESIDE + 1).min(PLACES)];
            let mut colours: Vec<[f32; 3]> = beside.iter().flatten().copied().collect();
            colours.sort_by(|a, b| luma(*a).total_cmp(&luma(*b)));
            let part = |share: f64| (share * colours.len() as f64) as usize;
            lid.skin.push(mean(&colours[part(SKIN.0)..part(SKIN.1)])?);
            let limit = LASHLESS as f32 * luma(lid.skin[k]);
            let row = |m: usize| beside.iter().map(|column| luma(column[m])).sum::<f32>() / beside.len() as f32;
            // Long lashes stand apart: their mean is nearly as bright as the skin, and single ones are not.
            let thread = |m: usize| {
                let mut levels: Vec<f32> = beside.iter().map(|column| luma(column[m])).collect();
                levels.sort_by(f32::total_cmp);
                levels[1.min(levels.len() - 1)]
            };
            let is_skin = |m: usize| row(m) >= limit && thread(m) >= THREADLESS as f32 * luma(lid.skin[k]);
            let reach = (0..steps).find(|&m| m as f64 * STEP >= LEAST_BAND && is_skin(m)).unwrap_or(steps);
            lid.band.push(reach as f64 * STEP * unit);
        }
        lid.skin = smoothed(&lid.skin, |list| mean(list).unwrap_or_default());
        lid.band = smoothed(&lid.band, |list| list.iter().copied().fold(0.0, f64::max));
        // The slope is limited: the crease runs down to the corners.
        let fall = FALL * across.norm() / PLACES as f64;
        for order in [(1..PLACES).map(|k| (k - 1, k)).collect::<Vec<_>>(), (1..PLACES).rev().map(|k| (k, k - 1)).collect()] {
            order.into_iter().for_each(|(from, to)| lid.band[to] = lid.band[to].max(lid.band[from] - fall));
        }
        // Smoothed along the lid, because skin has no steps.
        for _ in 0..2 {
            lid.band = smoothed(&lid.band, |list| list.iter().sum::<f64>() / list.len() as f64);
            lid.skin = smoothed(&lid.skin, |list| mean(list).unwrap_or_default());
        }
        lid.shut = shut_colour(mean(&lid.skin)?, cheek(warp, &warp.nodes[usize::from(nodes.lower[2])], texture)?);
        lid.fade = (BEFORE_BROW * room - lid.highest_band()).clamp(LEAST_FADE * unit, FADE * unit);
        Some(lid)
    }

    /// Position along the way from the outer to the inner corner (0 to 1), and height above the line between them, px.
    pub(super) fn place(&self, p: &Point2<f64>) -> (f64, f64) {
        let off = p - self.from;
        // Along the line between the corners, with heights along the face's vertical.
        let determinant = self.across.perp(&self.down);
        (off.perp(&self.down) / determinant, -self.across.perp(&off) / determinant)
    }

    /// Inverse of [`LidSkin::place`].
    pub(super) fn at(&self, along: f64, height: f64) -> Point2<f64> {
        self.from + self.across * along - self.down * height
    }

    /// Height of the lid at a position along it, px; beyond the ends that of the end.
    pub(super) fn edge_at(&self, along: f64) -> f64 {
        let place = (along * PLACES as f64 - 0.5).clamp(0.0, (PLACES - 1) as f64);
        let k = (place as usize).min(PLACES - 2);
        self.edge[k] + (self.edge[k + 1] - self.edge[k]) * (place - k as f64)
    }

    fn highest_band(&self) -> f64 {
        self.band.iter().copied().fold(0.0, f64::max)
    }

    /// Greatest height above the lid at which the photograph is replaced, px.
    pub fn reach(&self) -> f64 {
        self.highest_band() + self.fade
    }

    /// Opacity of the replacement (0 to 1) when a fraction `shut` of the opening is closed.
    pub fn share(shut: f64) -> f64 {
        smooth_step(SHUT.0, SHUT.1, shut)
    }

    /// The box outside of which [`LidSkin::colour`] equals the photograph.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        let unit = self.eye_distance;
        let lowest = self.edge.iter().copied().fold(f64::INFINITY, f64::min) - 0.5 * LEAST_BAND * unit;
        let highest = self.edge.iter().copied().fold(f64::NEG_INFINITY, f64::max) + self.reach();
        let corners = [-0.5, PLACES as f64 + 0.5].map(|k| k / PLACES as f64);
        let corner = |along: f64| [lowest, highest].map(|height| self.at(along, height));
        Bounds::around(corners.into_iter().flat_map(corner))
    }

    /// Blends the photograph's colour at a point with the skin without lashes; `gone` is the opacity from [`LidSkin::share`].
    pub fn colour(&self, at: Point2<f64>, gone: f64, photograph: [f32; 3], texture: &Texture) -> [f32; 3] {
        let (along, height) = self.place(&at);
        let place = along * PLACES as f64 - 0.5;
        if !(-1.0..=PLACES as f64).contains(&place) {
            return photograph;
        }
        let k = (place.max(0.0) as usize).min(PLACES - 2);
        let t = (place - k as f64).clamp(0.0, 1.0);
        let between = |a: f64, b: f64| a + (b - a) * t;
        let above = height - self.edge_at(along);
        let band = between(self.band[k], self.band[k + 1]);
        // Beyond the corners, too, the photograph is used.
        let inside = smooth_step(ENDS[0].0, ENDS[0].1, along) * (1.0 - smooth_step(ENDS[1].0, ENDS[1].1, along));
        let share = gone * inside * (1.0 - smooth_step(band, band + self.fade, above));
        if share <= 0.0 || above < -0.5 * LEAST_BAND * self.eye_distance {
            return photograph;
        }
        let guess: [f32; 3] = std::array::from_fn(|c| self.skin[k][c] + (self.skin[k + 1][c] - self.skin[k][c]) * t as f32);
        let missing = (band - above).max(0.0);
        let rise = FOLDED * missing + missing + 0.5 * self.fade;
        let unit = self.across * (self.eye_distance / self.across.norm());
        let strips = STRIPS.map(|off| texture.sample(at - self.down * rise + unit * off));
        let beyond: [f32; 3] = std::array::from_fn(|c| strips.iter().map(|colour| colour[c]).sum::<f32>() / STRIPS.len() as f32);
        let clear = smooth_step(CLEAR.0, CLEAR.1, f64::from(luma(beyond) / luma(guess).max(1.0)));
        let grain = GRAIN * clear as f32;
        std::array::from_fn(|c| {
            let skin = guess[c] + (beyond[c] - guess[c]) * grain;
            photograph[c] + (skin - photograph[c]) * share as f32
        })
    }
}

/// Position along the lid, 0 to 1 between the corners, of sample `k`.
fn along(k: usize) -> f64 {
    (k as f64 + 0.5) / PLACES as f64
}

pub(super) fn mean(colours: &[[f32; 3]]) -> Option<[f32; 3]> {
    let count = colours.len() as f32;
    (!colours.is_empty()).then(|| std::array::from_fn(|c| colours.iter().map(|colour| colour[c]).sum::<f32>() / count))
}

/// Combines each value with its neighbours.
fn smoothed<T: Copy>(values: &[T], of: impl Fn(&[T]) -> T) -> Vec<T> {
    (0..values.len()).map(|k| of(&values[k.saturating_sub(BESIDE)..(k + BESIDE + 1).min(values.len())])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warp::{
        MouthInside,
        test_face::{lashed, nodes, warp},
    };

    #[test]
    fn eyes_that_shut_have_lids_of_skin_and_one_line_of_lashes() {
        let nodes = nodes();
        let picture = lashed(&nodes, 4.0);
        let texture = Texture::new(&picture);
        let warp = warp().with_eyes(&texture);
        let mut shut = nodes.clone();
        for eye in &OPENINGS[1..] {
            for k in 1..4 {
                shut[usize::from(eye.upper[k])] = shut[usize::from(eye.lower[k])];
            }
        }
        let frame = warp.render(&texture, &warp.deform(&shut).unwrap(), &MouthInside::Dark);
        for eye in &OPENINGS[1..] {
            let [from, to] = [eye.upper[2], eye.lower[2]].map(|n| nodes[usize::from(n)]);
            let dark = |share: f64| {
                let at = from + (to - from) * share;
                frame.get_pixel(at.x.round() as u32, at.y.round() as u32).0[0] < 120
            };
            assert!((1..=6).all(|k| !dark(f64::from(k) / 10.0)), "lashes are left on the lid");
            assert!(dark(1.0), "the line of lashes is missing");
        }
        // The lid is brightest above its middle, darker towards the margin, and above the lid the photograph.
        for eye in &OPENINGS[1..] {
            let [from, to] = [eye.upper[2], eye.lower[2]].map(|n| nodes[usize::from(n)]);
            let level = |picture: &image::RgbImage, share: f64| {
                let at = from + (to - from) * share;
                picture.get_pixel(at.x.round() as u32, at.y.round() as u32).0[0]
            };
            assert!(level(&frame, 0.35) > level(&frame, 0.8) + 8, "{} {}", level(&frame, 0.35), level(&frame, 0.8));
            assert_eq!(level(&frame, -1.2), level(&picture, -1.2));
        }
        // Open, it is the photograph.
        assert_eq!(warp.render(&texture, &warp.deform(&nodes).unwrap(), &MouthInside::Dark), picture);
    }

    #[test]
    fn an_eye_that_shuts_in_the_middle_shuts_from_corner_to_corner() {
        let given = nodes();
        let warp = warp();
        let gap = |points: &[Point2<f64>], k: usize| {
            points[usize::from(OPENINGS[1].lower[k])].y - points[usize::from(OPENINGS[1].upper[k])].y
        };
        let left = |share: f64| {
            let mut asked = given.clone();
            for eye in &OPENINGS[1..] {
                let [upper, lower] = [eye.upper[2], eye.lower[2]].map(usize::from);
                asked[upper].y = asked[lower].y - share * (asked[lower].y - asked[upper].y);
            }
            warp.close_lids(&mut asked);
            [1, 2, 3].map(|k| gap(&asked, k) / gap(&given, k))
        };
        assert!(left(0.0).iter().all(|share| share.abs() < 1e-9), "{:?}", left(0.0));
        // Half shut: 1.35 times half beside the middle. Nearly open: as requested.
        let half = left(0.5);
        assert!((half[0] - 0.675).abs() < 1e-9 && (half[1] - 0.5).abs() < 1e-9 && (half[2] - 0.675).abs() < 1e-9, "{half:?}");
        assert_eq!(left(0.8)[0], 1.0);
    }
}
