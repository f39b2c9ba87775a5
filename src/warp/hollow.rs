//! The hollow between a brow and an upper lid.
//!
//! Below the bone of the brow the skin lies in a shaded hollow. A rising brow pulls that skin out of the shade, which lightens it in proportion;
//! stretching the photograph would instead leave a large dark patch. So the shade is measured once on the photograph: the ratio to the bright
//! skin of the hollow or of the forehead, per channel, without lashes (see `lid_skin`) and without fine detail. It is reduced as the hollow is
//! drawn out. The page of `play` does the same with WebGL (`player/assets/brows.js` and `gl.js`): change both together.

use nalgebra::Point2;

use super::{
    Deformation, Texture, Warp,
    lashes::{self, FLOOR},
    layout,
    lid_skin::{self, LidSkin},
    mouth::{luma, on_line},
    openings,
    sample::Bounds,
};
use crate::interpolation::smooth_step;

/// Size of the grid of the shade: between the corners of the eye, and between lid and brow.
pub const COLUMNS: usize = 24;
pub const ROWS: usize = 10;
/// First and last column, as fractions of the way from the outer to the inner corner.
pub const ALONG: (f64, f64) = (-0.25, 1.55);
/// Widths of the fades: at both ends of the columns, then (as fractions of the way from lid to brow) above the lid and below the brow.
const BEGINS: (f64, f64) = (0.22, 0.35);
const ABOVE_LID: f64 = 0.20;
const BELOW_BROW: f64 = 0.25;
/// Samples averaged per grid point, each way.
const GRAINS: usize = 3;
/// Quantiles of brightness between which the skin between the corners counts as not shaded.
const BRIGHT: (f64, f64) = (0.70, 0.90);
/// Where the skin of the forehead is read: above the lower edge of the brow, as fractions of the way from lid to brow; its quantiles of
/// brightness that count, since hair is darker and shine is brighter; and the largest ratio to the bright skin of the hollow.
const ABOVE_BROW: [f64; 4] = [0.9, 1.1, 1.3, 1.5];
const EVEN: (f64, f64) = (0.40, 0.70);
const BRIGHTER: f32 = 1.35;
/// Darkest value, as the logarithm of a ratio; the page cannot lighten anything by more than a factor of two.
pub const DARKEST: f32 = -0.85;
/// Factor on the lightening that follows from the length of the skin alone, and the largest fraction of the shade that is removed.
pub const LIGHTER: f64 = 1.6;
pub const MOST: f64 = 0.95;

/// The shade between one brow and its lid.
#[derive(Clone, Debug)]
pub struct Hollow {
    /// Height of the brow's lower edge at each column, above the line between the corners, px.
    pub brow: Vec<f64>,
    /// Logarithms of the ratio to bright skin (at most 0), row by row from the lid upwards.
    pub logs: Vec<[f32; 3]>,
}

impl Hollow {
    /// Finds the hollows above both eyes; one entry per opening.
    pub fn find(warp: &Warp, texture: &Texture) -> Vec<Option<Self>> {
        let pairs = warp.mesh.openings.iter().zip(&warp.lids);
        pairs.map(|(opening, lid)| Self::new(warp, layout::lid_skin_of(opening.opening)?, lid.as_ref()?, texture)).collect()
    }

    fn new(warp: &Warp, nodes: &layout::LidSkin, lid: &LidSkin, texture: &Texture) -> Option<Self> {
        // The lower edge of the brow from its outer end to its inner one.
        let edge = [nodes.tail, nodes.brow[1], nodes.brow[0]].map(|n| lid.place(&warp.nodes[usize::from(n)]));
        let brow: Vec<f64> = (0..COLUMNS).map(|k| on_line(&edge, along(k))).collect();
        let mut hollow = Self { brow, logs: Vec::new() };
        let colours: Vec<[f32; 3]> = (0..ROWS * COLUMNS).map(|k| hollow.skin(lid, k % COLUMNS, k / COLUMNS, texture)).collect();
        let is_between = |k: &usize| (0.0..1.0).contains(&along(k % COLUMNS)) && (1..ROWS - 1).contains(&(k / COLUMNS));
        let mut bright: Vec<[f32; 3]> = (0..colours.len()).filter(is_between).map(|k| colours[k]).collect();
        bright.sort_by(|a, b| luma(*a).total_cmp(&luma(*b)));
        let part = |share: f64| (share * bright.len() as f64) as usize;
        let bright = lid_skin::mean(bright.get(part(BRIGHT.0)..part(BRIGHT.1))?)?;
        let bright = hollow.lit(lid, bright, texture);
        let log = |level: f32, bright: f32| ((level.max(0.0) + FLOOR) / (bright.max(0.0) + FLOOR)).ln().clamp(DARKEST, 0.0);
        let logs = colours.iter().enumerate().map(|(k, colour)| {
            let share = share_at(k % COLUMNS, k / COLUMNS);
            std::array::from_fn(|c| share * log(colour[c], bright[c]))
        });
        hollow.logs = logs.collect();
        Some(hollow)
    }

    /// Colour of the hollow's skin out of the shade: that of its own bright skin, or of the forehead above the brow where that is brighter.
    /// In deep-set eyes all of the hollow lies in the shade.
    fn lit(&self, lid: &LidSkin, bright: [f32; 3], texture: &Texture) -> [f32; 3] {
        let columns = (0..COLUMNS).filter(|&k| (0.0..1.0).contains(&along(k)));
        let above = columns.flat_map(|k| {
            let way = self.brow[k] - lid.edge_at(along(k));
            ABOVE_BROW.map(|share| texture.sample(lid.at(along(k), self.brow[k] + share * way)))
        });
        let mut above: Vec<[f32; 3]> = above.collect();
        above.sort_by(|a, b| luma(*a).total_cmp(&luma(*b)));
        let part = |share: f64| (share * above.len() as f64) as usize;
        let Some(forehead) = above.get(part(EVEN.0)..part(EVEN.1)).and_then(lid_skin::mean) else { return bright };
        if luma(forehead) <= luma(bright) {
            return bright;
        }
        let ratio = |c: usize| ((forehead[c].max(0.0) + FLOOR) / (bright[c].max(0.0) + FLOOR)).clamp(1.0, BRIGHTER);
        std::array::from_fn(|c| bright[c] * ratio(c))
    }

    /// Mean skin around a grid point, without lashes.
    fn skin(&self, lid: &LidSkin, column: usize, row: usize, texture: &Texture) -> [f32; 3] {
        let off = |k: usize| (k as f64 + 0.5) / GRAINS as f64 - 0.5;
        let step = (ALONG.1 - ALONG.0) / (COLUMNS - 1) as f64;
        let mut sum = [0.0; 3];
        for (across, up) in (0..GRAINS * GRAINS).map(|k| (off(k % GRAINS), off(k / GRAINS))) {
            let along = along(column) + across * step;
            let share = ((row as f64 + up) / (ROWS - 1) as f64).clamp(0.0, 1.0);
            let edge = lid.edge_at(along);
            let at = lid.at(along, edge + share * (self.brow[column] - edge));
            let colour = lid.colour(at, 1.0, texture.sample(at), texture);
            (0..3).for_each(|c| sum[c] += colour[c] / (GRAINS * GRAINS) as f32);
        }
        sum
    }

    /// The box outside of which there is no shade.
    fn bounds(&self, lid: &LidSkin) -> Option<Bounds> {
        let corners = self
            .brow
            .iter()
            .enumerate()
            .flat_map(|(k, brow)| [lid.edge_at(along(k)), *brow].map(|height| lid.at(along(k), height)));
        Bounds::around(corners)
    }

    /// Colour of the skin at a point of the photograph when a fraction `gone` of the shade is removed.
    fn colour(&self, lid: &LidSkin, at: Point2<f64>, gone: f64, colour: [f32; 3]) -> [f32; 3] {
        let (along, height) = lid.place(&at);
        let column = (along - ALONG.0) / (ALONG.1 - ALONG.0) * (COLUMNS - 1) as f64;
        if !(0.0..=(COLUMNS - 1) as f64).contains(&column) {
            return colour;
        }
        let (k, t) = cell(column, COLUMNS);
        let brow = self.brow[k] + (self.brow[k + 1] - self.brow[k]) * t;
        let edge = lid.edge_at(along);
        let row = (height - edge) / (brow - edge).max(1e-6) * (ROWS - 1) as f64;
        if !(0.0..=(ROWS - 1) as f64).contains(&row) {
            return colour;
        }
        let (m, u) = cell(row, ROWS);
        let (t, u) = (t as f32, u as f32);
        std::array::from_fn(|c| {
            let beside = |m: usize| {
                let [from, to] = [k, k + 1].map(|k| self.logs[m * COLUMNS + k][c]);
                from + (to - from) * t
            };
            let log = beside(m) + (beside(m + 1) - beside(m)) * u;
            colour[c] * (-log * gone as f32).exp()
        })
    }
}

/// A hollow that is drawn out in a frame.
pub struct DrawnOut<'a> {
    hollow: &'a Hollow,
    lid: &'a LidSkin,
    /// Fraction of its shade that is removed.
    gone: f64,
}

/// The hollows that are drawn out in a frame.
pub fn drawn_out_hollows<'a>(warp: &'a Warp, deformation: &Deformation) -> Vec<DrawnOut<'a>> {
    let head = openings::head(warp, deformation);
    let each = warp.mesh.openings.iter().zip(warp.lids.iter().zip(&warp.hollows));
    let drawn = each.filter_map(|(opening, (lid, hollow))| {
        let gone = gone(lashes::drawn_out(warp, opening, deformation, &head)?);
        Some(DrawnOut { hollow: hollow.as_ref()?, lid: lid.as_ref()?, gone })
    });
    drawn.filter(|drawn| drawn.gone > 0.0).collect()
}

impl DrawnOut<'_> {
    /// The box outside of which nothing changes.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        self.hollow.bounds(self.lid)
    }

    /// Colour of the skin at a point of the photograph.
    pub fn colour(&self, at: Point2<f64>, colour: [f32; 3]) -> [f32; 3] {
        self.hollow.colour(self.lid, at, self.gone, colour)
    }
}

/// Fraction of the shade that is removed when the way from lid to brow is `drawn_out` times as long as on the photograph.
pub fn gone(drawn_out: f64) -> f64 {
    (LIGHTER * (1.0 - 1.0 / drawn_out.max(1.0))).min(MOST)
}

/// Position along the lid of a column.
fn along(column: usize) -> f64 {
    ALONG.0 + (ALONG.1 - ALONG.0) * column as f64 / (COLUMNS - 1) as f64
}

/// Index of the interval of a fractional grid index, and the fraction within it.
fn cell(place: f64, count: usize) -> (usize, f64) {
    let k = (place.max(0.0) as usize).min(count - 2);
    (k, place - k as f64)
}

/// Weight of the shade at a grid point; it fades out at the border.
fn share_at(column: usize, row: usize) -> f32 {
    let (along, up) = (along(column), row as f64 / (ROWS - 1) as f64);
    let across = smooth_step(ALONG.0, ALONG.0 + BEGINS.0, along) * (1.0 - smooth_step(ALONG.1 - BEGINS.1, ALONG.1, along));
    (across * smooth_step(0.0, ABOVE_LID, up) * (1.0 - smooth_step(1.0 - BELOW_BROW, 1.0, up))) as f32
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::warp::{
        MouthInside,
        layout::{BROWS, OPENINGS},
        test_face::{EYES, lashed, nodes, warp},
    };

    /// The middle between a lid and its brow.
    fn middle(nodes: &[Point2<f64>], side: usize) -> Point2<f64> {
        let [inner, _, below, _] = BROWS[side].map(usize::from);
        let lid = nodes[usize::from(OPENINGS[1 + side].upper[2])];
        nalgebra::center(&lid, &nalgebra::center(&nodes[inner], &nodes[below]))
    }

    /// Faces with even skin, and with the shade of a hollow: 0.6 of the light in its middle.
    fn faces() -> [RgbImage; 2] {
        let nodes = nodes();
        let even = lashed(&nodes, 2.0);
        let shaded = RgbImage::from_fn(300, 380, |x, y| {
            let at = Point2::new(f64::from(x), f64::from(y));
            let near =
                (0..2).map(|side| (at - middle(&nodes, side)).component_div(&nalgebra::Vector2::new(14.0, 6.0)).norm_squared());
            let light = 1.0 - 0.4 * (-near.fold(f64::INFINITY, f64::min)).exp();
            Rgb(even.get_pixel(x, y).0.map(|level| (f64::from(level) * light).round() as u8))
        });
        [even, shaded]
    }

    fn with_brows(by: f64) -> Vec<Point2<f64>> {
        let mut nodes = nodes();
        BROWS.iter().flatten().for_each(|&n| nodes[usize::from(n)].y -= by * EYES);
        nodes
    }

    #[test]
    fn a_hollow_grows_light_as_its_brow_rises_and_even_skin_stays_as_it_is() {
        let [even, shaded] = faces().map(|picture| {
            let texture = Texture::new(&picture);
            let warp = warp().with_eyes(&texture);
            let level = |by: f64| {
                let moved = warp.deform(&with_brows(by)).unwrap();
                let frame = warp.render(&texture, &moved, &MouthInside::Dark);
                // Where the darkest point of the photograph moves to.
                let at = warp.map(&moved, &middle(&warp.nodes, 0)).unwrap();
                f64::from(frame.get_pixel(at.x.round() as u32, at.y.round() as u32).0[0])
            };
            [0.0, 0.05, 0.15, -0.05].map(level)
        });
        assert!(even.iter().all(|level| (level - even[0]).abs() <= 2.0), "{even:?}");
        let [calm, half, whole, lowered] = shaded;
        // 0.6 of 205 levels; when the brow rises by 0.15 eye distances, most of the shade is removed.
        assert!((calm - 123.0).abs() < 4.0 && (lowered - calm).abs() < 4.0, "{shaded:?}");
        assert!(half > calm + 10.0 && whole > half + 10.0 && whole < 205.0, "{shaded:?}");
    }

    #[test]
    fn nothing_is_gone_of_a_brow_that_stays_or_goes_down() {
        assert_eq!((gone(1.0), gone(0.7)), (0.0, 0.0));
        // Half as long again: a third of its length is new. Four times as long: the maximum.
        assert!((gone(1.5) - LIGHTER / 3.0).abs() < 1e-9 && gone(4.0) == MOST);
    }
}
