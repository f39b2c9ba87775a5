//! The colours of a synthetic mouth: cavity, tongue, teeth, gums, shadows and the wet edges of the lips.
//!
//! [`Interior::colour`] computes each pixel from its position between the lips, the opening of the mouth (`gap`, `jaw`) and the light on
//! the lips' edges (`lit`). Many constants are pairs: for lips in shadow, and for lips in the light. Lengths are in eye distances.

use image::Rgba32FImage;
use nalgebra::{Point2, Vector2};

use super::{
    Light,
    grain::{grain, grain_of_light},
    line_at, luma,
    proportions::Proportions,
    teeth::{TEETH_WHITE, sampled},
};
use crate::{
    interpolation::smooth_step,
    warp::{seam::gapes, tone::Tone},
};

/// Flattening of the row's edge against a smile, in eye distances at the square of the distance from the midline, where the lower lip has
/// dropped, and where the upper one is raised.
const FLATTER: (f64, f64) = (0.12, 0.22);
/// Additional flattening in a gaping mouth: the row is seen from below and runs back to the molars.
const FLATTER_GAPING: f64 = 0.38;
/// Additional flattening where a dropped jaw parts the lips a little: the row continues to the sides in the shadow of the lip.
const FLATTER_PARTED: f64 = 0.25;
/// Distance of the lower incisors below the closed lips, in eye distances: they bite behind the upper ones.
const LOWER_BELOW_LIPS: f64 = 0.012;
/// Size of the lower teeth relative to the upper ones, across and down.
const LOWER_SIZE: (f64, f64) = (0.70, 0.75);
/// Height of the lower teeth that a lower lip leaves bare, in eye distances: one that moves with the jaw, and one that is drawn down further.
/// `DRAWN_DOWN`: distances beyond the jaw's motion between which this changes.
const LOWER_ABOVE_LIP: (f64, f64) = (-0.007, 0.054);
const DRAWN_DOWN: (f64, f64) = (0.05, 0.12);
/// Distances of the lips, in eye distances, between which a mouth begins to gape and gapes fully.
const GAPING: (f64, f64) = (0.14, 0.34);
/// Rise of the lower row to the sides in a gaping mouth, in eye distances at the square of the distance from the midline: a jaw that has
/// turned down shows its arch from above.
const LOWER_ARCH: f64 = 1.5;
/// Motion of the lower incisors relative to the chin's: they are nearer to the joint of the jaw.
const LOWER_SHARE: f64 = 0.88;
/// A zone along a lip that has the lip's own wet colour: its greatest width in eye distances, its largest fraction of the gap, and its colour
/// relative to the lip's.
struct Wet(f64, f64, [f32; 3]);
/// The wet zone of lips in shadow; `WET_LIT`: that of the upper and the lower lip in the light.
const WET: Wet = Wet(0.024, 0.28, [0.74, 0.60, 0.60]);
const WET_LIT: [Wet; 2] = [Wet(0.020, 0.34, [0.83, 0.76, 0.76]), Wet(0.022, 0.26, [0.90, 0.76, 0.76])];
/// Light behind the upper lip, and (`TOPS`) on the tops of the teeth, relative to the light further down: in the shadow of a lip, and below a
/// raised lip. In the smiles of 32 people nothing below a raised lip is darker than the lip itself.
const BEHIND_LIP: (f64, f64) = (0.58, 0.85);
const TOPS: (f64, f64) = (0.56, 0.80);
/// Reduction of the light on the upper teeth of a gaping mouth, which stand back behind the lip.
const DIMMER: f64 = 0.08;
/// Darkening of the side teeth, which turn away, and (`CORNERS_DARK`) width of the dark at the corners; both for lips in shadow and in the light. The
/// picture already contains the loss of light to the sides of the same 32 smiles, so a raised lip adds little.
const TURNED: (f64, f64) = (0.40, 0.10);
const CORNERS_DARK: (f64, f64) = (0.14, 0.10);
/// Curvature of the row's edge on the picture, at the square of the distance from the midline.
const ROW_EDGE: f64 = 0.60;
/// Height of the crowns on the picture, in eye distances: of the incisors, its decrease at the square of the distance from the midline, and its
/// minimum. Lips cover the rest in the smiles of the picture; a lip raised further shows more, up to the whole crown (`CROWN`).
const CROWNS_SHOWN: (f64, f64, f64) = (0.122, 0.35, 0.05);
const CROWN: f64 = 0.165;
/// Half the width, in eye distances, up to which the row reaches the corners of a mouth: that of a broad smile. In a wider mouth the row is
/// widened in proportion.
const ROW_REACHES: f64 = 0.48;
/// Distance that crowns extend under the lip, in eye distances.
const TUCKED: f64 = 0.01;
/// The gap between two crowns: light relative to the row's, tint, and opacity.
const BETWEEN: (f64, [f32; 3], f64) = (0.55, [0.92, 0.86, 0.80], 0.85);
/// Heights above the row's edge between which that gap fades in, in eye distances; the notches between the edges of crowns are dark.
const ABOVE_NOTCHES: (f64, f64) = (0.010, 0.024);
/// Distance from the corners within which the lips of a hardly open mouth touch, in eye distances.
const SEALED: f64 = 0.16;
/// Local distances of lips parted by a dropped jaw, in eye distances: up to the first they touch, from the second on they do not.
const TOUCHING: (f64, f64) = (0.004, 0.030);
/// The throat: its position between the lips (0 to 1), its extent, and its darkening in a wide open mouth.
const THROAT: (f64, f64, f64) = (0.40, 0.34, 0.16);
/// Lightening of the skin inside the cheeks, in the corners of a wide open mouth.
const CHEEKS: f64 = 0.13;
/// Light in the depth of a gaping mouth, and its reduction in the corners. `DEPTH_TINT`: reduction of red, green and blue against slightly parted
/// lips. Between the wide open lips of five people in videos, the darker quarter has 0.15 to 0.47 of the skin's brightness (median),
/// and lies in the corners on all of them; a light of 0.22 gave 0.14 to 0.20. There is 2.1 times as much red as green in it.
const DEPTH: (f64, f64) = (0.45, 0.42);
const DEPTH_TINT: [f32; 3] = [0.10, 0.0, 0.02];
/// Unevenness of that light.
const UNEVEN: f64 = 0.18;
/// Lightening behind lips that a dropped jaw parts a little.
const PARTED_LIGHT: f64 = 0.08;
/// Reduction of the redness in the corners against the throat.
const PALE: f32 = 0.14;
/// Light on the lower teeth of a hardly open mouth, and its reduction in a wide open one.
const LOWER_LIGHT: (f64, f64) = (0.69, 0.18);
/// Colour of the lower teeth relative to the upper ones: they lie in reddish light.
const LOWER_TINT: [f32; 3] = [1.0, 0.94, 0.84];
/// The tongue: half its width over that of the mouth, brightness at the back, its increase to the tip, and colour relative to flesh.
const TONGUE: (f64, f64, f64, [f32; 3]) = (0.38, 0.40, 0.72, [1.0, 0.95, 0.96]);
/// The tongue in a gaping mouth: half its width over that of the mouth; additional height, over the gap; exponent of its slope to the sides;
/// extent of the fade into the dark above and below its outline, over the gap; brightness at the back, increase on the blade, and decrease at the
/// tip, which turns down; fraction of the light left at its sides.
const GAPING_TONGUE: GapingTongue =
    GapingTongue { half: 0.50, higher: 0.19, slope: 0.7, runs: (0.10, 0.20), light: (0.27, 0.50, 0.14), sides: 0.34 };
/// Specular light of the wet tongue in a gaping mouth, relative to enamel.
const SHEEN: f64 = 0.11;
struct GapingTongue {
    half: f64,
    higher: f64,
    slope: f64,
    runs: (f64, f64),
    light: (f64, f64, f64),
    sides: f64,
}
/// Least visible height of the upper incisors where a dropped jaw parts the lips: in eye distances, and as a fraction of the gap (the smaller
/// applies). The upper lip is stretched around the opening and drawn up a little.
const SHOWN_DROPPED: (f64, f64) = (0.062, 0.66);
/// Lightening of the shadow above the lower lip in a gaping mouth, where the tongue lies.
const LIGHTER_ABOVE_LIP: f64 = 0.10;
/// The wet edge of lips that a dropped jaw parts: least brightness relative to the lips' own colour; fractions of the missing brightness that the
/// upper and the lower edge get; additional width as a fraction of a small gap, and the gaps between which it applies.
const WET_LEAST: f32 = 0.85;
const WET_SHARES: [f64; 2] = [0.35, 0.60];
const WET_MORE: (f64, (f64, f64)) = (0.18, (0.08, 0.03));
/// Light on the wet edge of the lower lip in a gaping mouth, where it turns outwards.
const WET_GAPING: f64 = 0.8;
/// Colour between touching lips relative to that of their edges; its increase below a dropped jaw; and the fraction of the edges' missing brightness
/// that is added there.
const CREASE: (f64, f64, f32) = (0.52, 0.10, 0.30);
/// Height above the edge of the teeth from which gum shows, in eye distances.
const GUM_ABOVE: f64 = 0.163;

/// Inputs for the colours of a synthetic mouth in one frame.
pub struct Interior<'a> {
    /// Point where the closed lips meet, moved with the skull, px.
    pub origin: Point2<f64>,
    pub across: Vector2<f64>,
    pub down: Vector2<f64>,
    pub unit: f64,
    /// Inner edges of the lips along the mouth's own axes, in eye distances, sorted by x.
    pub upper: Vec<(f64, f64)>,
    pub lower: Vec<(f64, f64)>,
    /// Drop of the jaw, in eye distances.
    pub jaw: f64,
    /// Greatest distance of the lips, in eye distances.
    pub gap: f64,
    /// Light on the edges of the lips, 0 to 1.
    pub lit: f64,
    pub lip: [f32; 3],
    pub light: Light,
    pub tone: Tone,
    /// Size of the teeth relative to the picture's.
    pub size: f64,
    pub proportions: Proportions,
    pub teeth: Option<&'a Rgba32FImage>,
}

impl Interior<'_> {
    /// Colour of a pixel between the lips; `lip` is the colour of the nearest lip.
    pub fn colour(&self, place: Point2<f64>, lip: [f32; 3]) -> [f32; 3] {
        let p = place - self.origin;
        let (x, y) = (p.dot(&self.across) / self.unit, p.dot(&self.down) / self.unit);
        let (Some(upper), Some(lower)) = (line_at(&self.upper, x), line_at(&self.lower, x)) else { return lip };
        let (below_upper, above_lower) = (y - upper, lower - y);
        let corners = (self.upper[0].0, self.upper[self.upper.len() - 1].0);
        let from_corner = (x - corners.0).min(corners.1 - x);
        // Light enters from the front and above: it increases as the lips part, and then also reaches the skin in the corners.
        let open = smooth_step(0.02, 0.40, self.gap);
        let side = smooth_step(0.0, 0.20, from_corner);
        let depth = (below_upper / (lower - upper).max(1e-6)).clamp(0.0, 1.0);
        // Darkest in the middle, where the throat is.
        let throat = (-((depth - THROAT.0) / THROAT.1).powi(2)).exp() * side;
        let light = 0.27 + (0.20 * depth - 0.12) * open * side - THROAT.2 * throat * open.sqrt() + CHEEKS * (1.0 - side) * open;
        // A dropping jaw opens the mouth far enough for light to enter, less of it in the corners.
        let (dropped, gapes) = (1.0 - self.lit, gapes(self.gap, self.lit));
        let uneven = 1.0 + UNEVEN * grain((x + self.proportions.own()) / 0.07, y / 0.05);
        let deep = DEPTH.0 * (1.0 - DEPTH.1 * (1.0 - side)) * uneven;
        let light = light + PARTED_LIGHT * dropped * (1.0 - open);
        let light = light + (deep - light) * gapes;
        let pale = PALE * ((1.0 - side) * (1.0 - gapes)) as f32;
        let tint = [1.0, 0.60 + pale, 0.57 + pale];
        let mut colour = self.tinted(std::array::from_fn(|c| tint[c] - DEPTH_TINT[c] * gapes as f32), light);
        self.lay_tongue((x, y), lower, (open, gapes), &mut colour);
        self.lay_arches((x, y), below_upper, above_lower, from_corner, &mut colour);
        // Shadow of the lips (the upper one's is deeper) and the rounding of the lips themselves.
        let behind = self.by_light(BEHIND_LIP);
        let above = 0.75 + LIGHTER_ABOVE_LIP * gapes;
        let shadow = (behind + (1.0 - behind) * smooth_step(0.0, 0.06, below_upper))
            * (above + (1.0 - above) * smooth_step(0.0, 0.03, above_lower));
        let more = WET_MORE.0 * dropped * smooth_step(WET_MORE.1.0, WET_MORE.1.1, lower - upper);
        let rounds: [f64; 2] = std::array::from_fn(|k| {
            let (most, share) = (self.by_light((WET.0, WET_LIT[k].0)), self.by_light((WET.1, WET_LIT[k].1)) + more);
            let width = most.min(share * (lower - upper).max(0.0)).max(1e-6);
            1.0 - smooth_step(0.0, width, [below_upper, above_lower][k])
        });
        let sealed = 1.0 - smooth_step(0.0, SEALED * (1.0 - 0.7 * open), from_corner);
        let touching = dropped * (1.0 - smooth_step(TOUCHING.0, TOUCHING.1, lower - upper));
        let sealed = sealed.max(touching);
        // The edge of a lip is darker than the lip; this is the difference.
        let missing = |c: usize, of: f32| (of * self.lip[c] - lip[c]).max(0.0) * dropped as f32;
        std::array::from_fn(|c| {
            let inside = colour[c] * shadow as f32;
            let crease = (CREASE.0 + CREASE.1 * dropped) as f32 * lip[c] + CREASE.2 * missing(c, 1.0);
            let inside = inside + (crease - inside) * (0.9 * sealed) as f32;
            let wet = |k: usize, inside: f32| {
                let lit = self.lit.max([0.0, WET_GAPING][k] * gapes) as f32;
                let colour = WET.2[c] + (WET_LIT[k].2[c] - WET.2[c]) * lit;
                let edge = lip[c] + missing(c, WET_LEAST) * WET_SHARES[k] as f32;
                inside + (edge * colour - inside) * (0.85 * rounds[k]) as f32
            };
            wet(0, wet(1, inside))
        })
    }

    /// Interpolates between the values for lips in shadow and for lips in the light.
    fn by_light(&self, (dark, light): (f64, f64)) -> f64 {
        dark + (light - dark) * self.lit
    }

    /// Colour of flesh, tinted by `warm`, at a brightness relative to the lips.
    fn tinted(&self, warm: [f32; 3], light: f64) -> [f32; 3] {
        // Flesh in the light on the lips: 0.4 of the lips' own colour, 0.6 of that of the inside of a mouth.
        let luma = luma(self.lip).max((0.5 * luma(self.light.enamel)).min(60.0));
        let flesh = self.light.flesh.map(|c| c * luma);
        std::array::from_fn(|c| (0.4 * self.lip[c] + 0.6 * flesh[c]) * warm[c] * light as f32)
    }

    /// The tongue: a mound behind the lower teeth, lighter towards its tip, with a shallow groove.
    fn lay_tongue(&self, (x, y): (f64, f64), lower: f64, (open, gapes): (f64, f64), colour: &mut [f32; 3]) {
        let by_gape = |(part, wide): (f64, f64)| part + (wide - part) * gapes;
        let shape = GAPING_TONGUE;
        let half = by_gape((TONGUE.0, shape.half)) * (self.upper[self.upper.len() - 1].0 - self.upper[0].0);
        let within = 1.0 - (x / half.max(1e-6)).powi(2);
        if within <= 0.0 {
            return;
        }
        let floor = line_at(&self.lower, 0.0).unwrap_or(lower);
        let height = (self.proportions.tongue + shape.higher * gapes) * self.gap * within.powf(by_gape((0.5, shape.slope)));
        let top = floor - height;
        let (from, to) = (-0.015 - shape.runs.0 * self.gap * gapes, 0.05 + shape.runs.1 * self.gap * gapes);
        let cover = smooth_step(from, to, y - top) * open.sqrt().max(gapes) * smooth_step(0.0, 0.25, within);
        if cover <= 0.0 {
            return;
        }
        let towards_tip = ((y - top) / height.max(1e-6)).clamp(0.0, 1.0);
        let groove = 1.0 - by_gape((0.20, 0.17)) * (-(x / 0.026).powi(2)).exp() * (0.3 + 0.7 * towards_tip);
        let parted = (TONGUE.1 + TONGUE.2 * towards_tip) * (0.66 + 0.34 * open) * (0.42 + 0.58 * within);
        let (back, blade, tip) = shape.light;
        let wide = back + blade * smooth_step(0.0, 0.70, towards_tip) - tip * smooth_step(0.75, 1.0, towards_tip);
        let light = by_gape((parted, wide * (shape.sides + (1.0 - shape.sides) * within))) * groove;
        // Grain, glints on the wet surface, and a broad sheen near the tip.
        let grain = 1.0 + 0.045 * grain(x / 0.011, y / 0.011);
        let own = x + self.proportions.own();
        let wet =
            by_gape((0.34, 0.24)) * smooth_step(0.30, 0.8, grain_of_light(own, y)) * (towards_tip * (1.0 - towards_tip) * 4.0);
        let band = smooth_step(0.25, 0.60, towards_tip) * smooth_step(1.05, 0.70, towards_tip);
        let sheen = 0.13 * band * (0.6 + 0.4 * grain_of_light(0.4 * own, 0.6 * y + 3.0));
        let wet = (wet + sheen) * open * within;
        let cooler = 0.03 * gapes as f32;
        let tongue = self.tinted([TONGUE.3[0] - cooler, TONGUE.3[1], TONGUE.3[2] + cooler], light * grain + wet);
        let mirrored = SHEEN * gapes * band * within * (0.5 + 0.5 * grain_of_light(0.3 * own + 5.0, 0.5 * y));
        let tongue: [f32; 3] = std::array::from_fn(|c| tongue[c] + self.light.enamel[c] * mirrored as f32);
        (0..3).for_each(|c| colour[c] += (tongue[c] - colour[c]) * cover as f32);
    }

    /// Widening of the rows of teeth in a mouth wider than a smile; 1 otherwise.
    fn wider(&self) -> f64 {
        let half = 0.5 * (self.upper[self.upper.len() - 1].0 - self.upper[0].0);
        (half / (ROW_REACHES * self.size)).max(1.0)
    }

    /// Fills the gaps between the upper crowns with teeth in their own shadow instead of the dark of the mouth.
    fn lay_between(&self, x: f64, above_edge: f64, light: f64, from_corner: f64, colour: &mut [f32; 3]) {
        let along = smooth_step(0.44, 0.38, x.abs() / self.size) * smooth_step(0.0, 0.035, from_corner);
        let cover =
            BETWEEN.2 * smooth_step(ABOVE_NOTCHES.0, ABOVE_NOTCHES.1, above_edge) * smooth_step(0.125, 0.095, above_edge) * along;
        (0..3).for_each(|c| {
            let seen = self.light.enamel[c] * BETWEEN.1[c] * (BETWEEN.0 * light) as f32;
            colour[c] += (seen - colour[c]) * cover as f32;
        });
    }

    /// Draws both rows of teeth and the gum above the upper one.
    fn lay_arches(&self, (x, y): (f64, f64), below_upper: f64, above_lower: f64, from_corner: f64, colour: &mut [f32; 3]) {
        let Some(picture) = self.teeth else { return };
        let x = x / self.wider();
        // The row turns away to the sides and disappears in the dark of the cheeks towards the corners.
        let turned = 1.0 - self.by_light(TURNED) * smooth_step(0.10, 0.30, x.abs() / self.size);
        let side = (0.25 + 0.75 * smooth_step(0.0, self.by_light(CORNERS_DARK), from_corner)) * turned;
        let row = |dx: f64, dy: f64, brightness: f64, tint: [f32; 3], colour: &mut [f32; 3]| {
            let Some((tooth, cover)) = sampled(picture, dx / self.size, dy / self.size) else { return };
            let cover = cover * smooth_step(0.0, 0.035, from_corner) as f32;
            // Enamel is translucent at its edge.
            let edge = 1.0 - 0.16 * smooth_step(-0.024, 0.0, dy);
            for c in 0..3 {
                let lit = tooth[c] / TEETH_WHITE * self.light.enamel[c] * tint[c] * (brightness * side * edge) as f32;
                colour[c] += (lit - colour[c]) * cover;
            }
        };
        // The lower row is deeper in the mouth and shaded by everything above it.
        let lip = line_at(&self.lower, 0.0).unwrap_or(0.0);
        let gaping = smooth_step(GAPING.0, GAPING.1, self.gap);
        let drawn = smooth_step(DRAWN_DOWN.0, DRAWN_DOWN.1, lip - self.jaw);
        let bare = LOWER_ABOVE_LIP.0 + (LOWER_ABOVE_LIP.1 - LOWER_ABOVE_LIP.0) * drawn;
        let lower_y = y - (LOWER_BELOW_LIPS + LOWER_SHARE * self.jaw).max(lip - bare) + LOWER_ARCH * gaping * x * x;
        let lower_light = LOWER_LIGHT.0 - LOWER_LIGHT.1 * smooth_step(0.0, 0.30, self.gap);
        let shown = smooth_step(0.02, 0.08, self.jaw);
        if shown > 0.0 {
            let before = *colour;
            row(
                x / LOWER_SIZE.0,
                -lower_y / LOWER_SIZE.1,
                lower_light * (0.7 + 0.3 * smooth_step(0.0, 0.02, above_lower)),
                LOWER_TINT,
                colour,
            );
            (0..3).for_each(|c| colour[c] = before[c] + (colour[c] - before[c]) * shown as f32);
        }
        let shown = line_at(&self.upper, 0.0).unwrap_or(0.0) + SHOWN_DROPPED.0.min(SHOWN_DROPPED.1 * self.gap);
        let more = (shown - self.proportions.incisors).max(0.0) * (1.0 - self.lit);
        let upper_y = y - self.proportions.incisors - more - flatter(self.lit, gaping) * x * x;
        // Above the crowns is gum.
        let gum = smooth_step(GUM_ABOVE - 0.03, GUM_ABOVE, -upper_y - 0.20 * x * x) * smooth_step(0.36, 0.26, x.abs());
        if gum > 0.0 {
            let pink = self.tinted([1.0, 0.80, 0.80], 0.62 * side);
            (0..3).for_each(|c| colour[c] += (pink[c] - colour[c]) * gum as f32);
        }
        // The lip's shadow on the tops of the teeth.
        let tops = self.by_light(TOPS);
        let light = (tops + (1.0 - tops) * smooth_step(0.0, 0.05, below_upper)) * (1.0 - DIMMER * (1.0 - self.lit) * gaping);
        let edge = -ROW_EDGE * x * x / self.size;
        let above_edge = (edge - upper_y) / crowns_longer(x / self.size, (edge - upper_y + below_upper) / self.size);
        self.lay_between(x, above_edge, light * side, from_corner, colour);
        // A sliver of tooth that the lip nearly hides is in the lip's shadow.
        let bared = smooth_step(0.0, 0.03, below_upper + above_lower);
        let before = *colour;
        row(x, edge - above_edge, light, [1.0; 3], colour);
        (0..3).for_each(|c| colour[c] = before[c] + (colour[c] - before[c]) * bared as f32);
    }
}

/// Flattening of the row's edge against a smile, for the light on the lips' edges and the degree of gaping.
fn flatter(lit: f64, gaping: f64) -> f64 {
    let (dropped, raised) = FLATTER;
    dropped + (raised - dropped) * lit + FLATTER_GAPING * gaping + FLATTER_PARTED * (1.0 - lit) * (1.0 - gaping)
}

/// Factor on the length of the crowns against the picture, at a position of the row, for a lip at a height above their edge.
fn crowns_longer(x: f64, lip_above: f64) -> f64 {
    let shown = (CROWNS_SHOWN.0 - CROWNS_SHOWN.1 * x * x).max(CROWNS_SHOWN.2);
    ((lip_above + TUCKED) / shown).clamp(1.0, CROWN / shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crowns_are_as_long_as_a_raised_lip_shows_them_and_no_longer() {
        // A lip that hides their tops leaves them as on the picture.
        assert_eq!(crowns_longer(0.0, 0.08), 1.0);
        assert_eq!(crowns_longer(0.3, 0.05), 1.0);
        // A lip raised above what the picture shows reveals more, in the middle and beside it.
        let longer = crowns_longer(0.0, 0.14);
        assert!((longer * CROWNS_SHOWN.0 - (0.14 + TUCKED)).abs() < 1e-12 && crowns_longer(0.35, 0.14) > longer);
        // Above a whole crown is gum.
        assert!((crowns_longer(0.0, 0.5) * CROWNS_SHOWN.0 - CROWN).abs() < 1e-12);
        assert!((crowns_longer(0.4, 0.5) * (CROWNS_SHOWN.0 - CROWNS_SHOWN.1 * 0.16) - CROWN).abs() < 1e-12);
    }

    #[test]
    fn a_row_of_teeth_is_flatter_the_less_it_is_of_a_smile() {
        // Raised lips: 0.22. Dropped ones: 0.12, plus 0.25 if they part a little or 0.38 if they gape.
        assert!((flatter(1.0, 0.0) - 0.22).abs() < 1e-12);
        assert!((flatter(0.0, 0.0) - 0.37).abs() < 1e-12);
        assert!((flatter(0.0, 1.0) - 0.50).abs() < 1e-12);
    }

    #[test]
    fn rows_reach_the_corners_of_a_mouth_that_is_wider_than_a_smile() {
        let mouth = dropped(0.06);
        assert_eq!(mouth.wider(), 1.0);
        let drawn = |line: &[(f64, f64)]| line.iter().map(|(x, y)| (1.44 * x, *y)).collect();
        // Half of it is 0.576 wide: 1.2 times the reach of the row.
        let wide = Interior { upper: drawn(&mouth.upper), lower: drawn(&mouth.lower), ..mouth };
        assert!((wide.wider() - 1.2).abs() < 1e-9);
    }

    /// A mouth of grey lips around the origin, 0.8 eye distances (80 px) wide, whose jaw dropped by `gap` and whose lips form an arch.
    fn dropped(gap: f64) -> Interior<'static> {
        let line =
            |depth: f64| (0..=20).map(|k| f64::from(k - 10) / 25.0).map(|x| (x, depth * (1.0 - (x / 0.4).powi(2)))).collect();
        Interior {
            origin: Point2::origin(),
            across: Vector2::x(),
            down: Vector2::y(),
            unit: 100.0,
            upper: line(0.0),
            lower: line(gap),
            jaw: gap,
            gap,
            lit: 0.0,
            lip: [160.0, 110.0, 110.0],
            light: Light { enamel: [200.0; 3], flesh: [1.45, 0.86, 0.84] },
            tone: Tone { lines: [[0.0, 1.0]; 3], share: 0.0 },
            size: 1.0,
            proportions: Proportions { incisors: 0.02, tongue: 0.55 },
            teeth: super::super::teeth::picture(),
        }
    }

    #[test]
    fn a_mouth_that_gapes_shows_teeth_then_depth_then_a_tongue_as_light_as_the_lip() {
        let mouth = dropped(0.30);
        let level = |y: f64| luma(mouth.colour(Point2::new(5.0, y), [160.0, 110.0, 110.0]));
        let lip = luma(mouth.lip);
        // The incisors alone would end 0.02 below the lip, in its shadow; they are shown down to 0.062.
        let (teeth, depth, tongue) = (level(4.5), level(11.0), level(24.0));
        assert!(teeth > 90.0, "{teeth}");
        // The depth behind them is dark, but not black: a tenth to a third of the lip.
        assert!((0.08 * lip..0.35 * lip).contains(&depth), "{depth}");
        assert!((0.65 * lip..1.05 * lip).contains(&tongue), "{tongue}");
        // From the depth to the tongue the brightness increases smoothly, by less than a quarter of the lip per percent of the eye distance.
        let steps: Vec<f32> = (11..=20).map(|y| level(f64::from(y))).collect();
        assert!(steps.windows(2).all(|w| w[1] > w[0] - 1.0 && w[1] - w[0] < 0.25 * lip), "{steps:?}");
        // Nearly shut lips have, far from the corners, too, a crease half as bright as themselves instead of a dark slit.
        let slit = luma(dropped(0.004).colour(Point2::new(5.0, 0.2), [160.0, 110.0, 110.0]));
        assert!(slit > 0.5 * lip, "{slit}");
        // Slightly parted lips show the teeth down to their edge, and hardly any tongue.
        let hardly = dropped(0.06);
        let below = luma(hardly.colour(Point2::new(5.0, 4.5), [160.0, 110.0, 110.0]));
        assert!(below < 0.8 * lip, "{below}");
    }
}
