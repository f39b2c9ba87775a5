//! The colours of a made inside.

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

/// How much flatter the row's edge is than in a smile, over the eye distance, at the square of the distance from the midline, where the lower lip
/// has dropped, and where the upper one is raised.
const FLATTER: (f64, f64) = (0.12, 0.22);
/// The same of a mouth that gapes, on top: the row is seen from below, and runs back to the molars.
const FLATTER_GAPING: f64 = 0.38;
/// The same of lips that a dropped jaw parts a little: the row goes on to the sides in the shadow of the lip, and is no patch in the middle.
const FLATTER_PARTED: f64 = 0.25;
/// How far the lower incisors reach below the closed lips, over the eye distance: they bite behind the upper ones.
const LOWER_BELOW_LIPS: f64 = 0.012;
/// Size of the lower teeth over that of the upper ones, across and down.
const LOWER_SIZE: (f64, f64) = (0.70, 0.75);
/// How much of the lower teeth a lower lip leaves bare, over the eye distance, that goes with the jaw, and one that goes beyond it: it covers them until
/// it is drawn down by itself. How far beyond, over the eye distance, that begins and ends.
const LOWER_ABOVE_LIP: (f64, f64) = (-0.007, 0.054);
const DRAWN_DOWN: (f64, f64) = (0.05, 0.12);
/// Distances of the lips, over the eye distance, between which a mouth begins to gape and gapes.
const GAPING: (f64, f64) = (0.14, 0.34);
/// How much higher the lower row is to the sides in a mouth that gapes, over the eye distance, at the square of the distance from the midline:
/// a jaw that has turned down shows its arch from above.
const LOWER_ARCH: f64 = 1.5;
/// Share of the chin's way that the lower incisors go: they are nearer to the joint of the jaw.
const LOWER_SHARE: f64 = 0.88;
/// A zone along a lip that is still its own wet colour: its greatest width, over the eye distance, its largest share of the gap, and that
/// colour, of the lip's own.
struct Wet(f64, f64, [f32; 3]);
/// Of lips in shadow, and of the upper and the lower one in the light.
const WET: Wet = Wet(0.024, 0.28, [0.74, 0.60, 0.60]);
const WET_LIT: [Wet; 2] = [Wet(0.020, 0.34, [0.83, 0.76, 0.76]), Wet(0.022, 0.26, [0.90, 0.76, 0.76])];
/// Light on what lies behind the upper lip, and on the tops of the teeth, of all that falls on it further down: in the shadow of a lip, and
/// where it is raised. On smiles of 32 people nothing below it is darker than the lip itself.
const BEHIND_LIP: (f64, f64) = (0.58, 0.85);
const TOPS: (f64, f64) = (0.56, 0.80);
/// How much less light falls on the upper teeth of a mouth that gapes, which stand back behind the lip.
const DIMMER: f64 = 0.08;
/// How much darker the side teeth are, which turn away, and how far from the corners their dark begins, likewise. The picture has what the same
/// 32 smiles lose to the sides: a raised lip takes hardly more.
const TURNED: (f64, f64) = (0.40, 0.10);
const CORNERS_DARK: (f64, f64) = (0.14, 0.10);
/// The edge of the row on the picture, at the square of the distance from the midline.
const ROW_EDGE: f64 = 0.60;
/// How much of the crowns the picture shows, over the eye distance: of the incisors, how much less at the square of the distance from the midline,
/// and at least. Lips cover the rest in the smiles that it is made of; a lip that is raised further shows it, up to the whole crown.
const CROWNS_SHOWN: (f64, f64, f64) = (0.122, 0.35, 0.05);
const CROWN: f64 = 0.165;
/// Half the width of a mouth that the row reaches the corners of, over the eye distance: up to that of a broad smile. In one that is drawn wider it is wider
/// by as much, and does not end before them.
const ROW_REACHES: f64 = 0.48;
/// How far crowns go under the lip.
const TUCKED: f64 = 0.01;
/// What is seen between two crowns, of the row's light, its tint, and how much of it covers what lies behind.
const BETWEEN: (f64, [f32; 3], f64) = (0.55, [0.92, 0.86, 0.80], 0.85);
/// How far above the row's edge that begins and is wholly there, over the eye distance: the notches between the edges of crowns are dark.
const ABOVE_NOTCHES: (f64, f64) = (0.010, 0.024);
/// How far from the corners the lips of a mouth that is hardly open lie on each other, over the eye distance.
const SEALED: f64 = 0.16;
/// Distances of lips that a dropped jaw parts, over the eye distance, at a place up to which they lie on each other there, and from which on they do not.
const TOUCHING: (f64, f64) = (0.004, 0.030);
/// Where the throat is between the lips, 0 to 1, how far around it the dark reaches, and how much darker it is in a mouth that gapes.
const THROAT: (f64, f64, f64) = (0.40, 0.34, 0.16);
/// How much lighter the skin inside the cheeks is, in the corners of a mouth that is wide open.
const CHEEKS: f64 = 0.13;
/// The light in the depth of a mouth that gapes, and how much less of it reaches the corners; and how much less of red, green and blue there is than
/// behind lips that part a little. Over the skin, the darker quarter of what five people of videos show between wide open lips has 0.15 to 0.47 of its
/// brightness on the median, in the corners on all of them; with a light of 0.22 it had 0.14 to 0.20. There is 2.1 times as much red as green in it.
const DEPTH: (f64, f64) = (0.45, 0.42);
const DEPTH_TINT: [f32; 3] = [0.10, 0.0, 0.02];
/// How unevenly the light falls there.
const UNEVEN: f64 = 0.18;
/// How much lighter it is behind lips that a dropped jaw parts a little.
const PARTED_LIGHT: f64 = 0.08;
/// How much less red it is than the throat.
const PALE: f32 = 0.14;
/// Light on the lower teeth, of a mouth that is hardly open, and how much less of it there is in one that gapes.
const LOWER_LIGHT: (f64, f64) = (0.69, 0.18);
/// Colour of the lower teeth, which lie in reddish light, over that of the upper ones.
const LOWER_TINT: [f32; 3] = [1.0, 0.94, 0.84];
/// The tongue: half its width over that of the mouth, brightness behind and how much more of it there is at the tip, and its colour over that of flesh.
const TONGUE: (f64, f64, f64, [f32; 3]) = (0.38, 0.40, 0.72, [1.0, 0.95, 0.96]);
/// In a mouth that gapes: half the width of the tongue over that of the mouth; how much higher it is, over the gap, and how much more its back slopes
/// to the sides; over how much of the gap its back runs into the dark, above and below its outline; brightness at the back, how much more of it there is on the tongue's
/// blade, and how much less at the tip, which turns down; what is left at its sides.
const GAPING_TONGUE: GapingTongue =
    GapingTongue { half: 0.50, higher: 0.19, slope: 0.7, runs: (0.10, 0.20), light: (0.27, 0.50, 0.14), sides: 0.34 };
/// What light the wet tongue reflects there as a mirror, over that of enamel.
const SHEEN: f64 = 0.11;
struct GapingTongue {
    half: f64,
    higher: f64,
    slope: f64,
    runs: (f64, f64),
    light: (f64, f64, f64),
    sides: f64,
}
/// How much of the upper incisors lips show that a dropped jaw parts, at least, over the eye distance and of the gap: the upper lip is stretched
/// around the opening, and drawn up a little.
const SHOWN_DROPPED: (f64, f64) = (0.062, 0.66);
/// By how much the shadow above a lower lip is lighter in a mouth that gapes: a tongue lies there, and no gap.
const LIGHTER_ABOVE_LIP: f64 = 0.10;
/// The wet edge of lips that a dropped jaw parts: of the lips' own colour, at least; how much of what is missing the upper and the lower one get; how much
/// more of the gap it takes where the gap is small, and how small.
const WET_LEAST: f32 = 0.85;
const WET_SHARES: [f64; 2] = [0.35, 0.60];
const WET_MORE: (f64, (f64, f64)) = (0.18, (0.08, 0.03));
/// How far the wet edge of the lower lip of a mouth that gapes is in the light: it turns outwards.
const WET_GAPING: f64 = 0.8;
/// The colour between lips that lie on each other, of that of their edges, and how much more of it there is below a dropped jaw; and how much it gets there of what
/// their edges are darker than the lips.
const CREASE: (f64, f64, f32) = (0.52, 0.10, 0.30);
/// Height of what a raised lip bares above the teeth, over the eye distance.
const GUM_ABOVE: f64 = 0.163;

/// What an inside is made of, at one frame.
pub struct Interior<'a> {
    /// Where the closed lips meet on the skull, px.
    pub origin: Point2<f64>,
    pub across: Vector2<f64>,
    pub down: Vector2<f64>,
    pub unit: f64,
    /// Inner edges of the lips in the mouth's own axes, in eye distances, by x.
    pub upper: Vec<(f64, f64)>,
    pub lower: Vec<(f64, f64)>,
    /// How far the jaw has dropped, in eye distances.
    pub jaw: f64,
    /// Widest distance of the lips, in eye distances.
    pub gap: f64,
    /// How far their edges are in the light.
    pub lit: f64,
    pub lip: [f32; 3],
    pub light: Light,
    pub tone: Tone,
    /// Size of the teeth over that of the picture's.
    pub size: f64,
    pub proportions: Proportions,
    pub teeth: Option<&'a Rgba32FImage>,
}

impl Interior<'_> {
    /// Colour at a pixel between the lips, `lip` being that of the nearest lip.
    pub fn colour(&self, place: Point2<f64>, lip: [f32; 3]) -> [f32; 3] {
        let p = place - self.origin;
        let (x, y) = (p.dot(&self.across) / self.unit, p.dot(&self.down) / self.unit);
        let (Some(upper), Some(lower)) = (line_at(&self.upper, x), line_at(&self.lower, x)) else { return lip };
        let (below_upper, above_lower) = (y - upper, lower - y);
        let corners = (self.upper[0].0, self.upper[self.upper.len() - 1].0);
        let from_corner = (x - corners.0).min(corners.1 - x);
        // Light falls in from the front and above: more of it the further the lips part, and then onto the skin in the corners, too.
        let open = smooth_step(0.02, 0.40, self.gap);
        let side = smooth_step(0.0, 0.20, from_corner);
        let depth = (below_upper / (lower - upper).max(1e-6)).clamp(0.0, 1.0);
        // Darkest in the middle, where the throat is.
        let throat = (-((depth - THROAT.0) / THROAT.1).powi(2)).exp() * side;
        let light = 0.27 + (0.20 * depth - 0.12) * open * side - THROAT.2 * throat * open.sqrt() + CHEEKS * (1.0 - side) * open;
        // A jaw that drops opens it so far that light falls in, less of it into the corners.
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
        // The shadow of the lips, the upper one's deeper, and the round of the lips themselves.
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
        // The edge of a lip is darker than the lip; how much is missing.
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

    /// A number between that of lips in shadow and that of lips in the light.
    fn by_light(&self, (dark, light): (f64, f64)) -> f64 {
        dark + (light - dark) * self.lit
    }

    /// The colour of the lips, made redder by `warm`, at a brightness.
    fn tinted(&self, warm: [f32; 3], light: f64) -> [f32; 3] {
        // Flesh in the light that falls on the lips: half as they are, half as the inside of every mouth is.
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
        // Its grain, the light that is broken on what is wet, and a broad sheen before the tip.
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

    /// How much wider than in a smile the rows are.
    fn wider(&self) -> f64 {
        let half = 0.5 * (self.upper[self.upper.len() - 1].0 - self.upper[0].0);
        (half / (ROW_REACHES * self.size)).max(1.0)
    }

    /// What is seen between the upper crowns: not the dark of the mouth, but teeth in their own shadow.
    fn lay_between(&self, x: f64, above_edge: f64, light: f64, from_corner: f64, colour: &mut [f32; 3]) {
        let along = smooth_step(0.44, 0.38, x.abs() / self.size) * smooth_step(0.0, 0.035, from_corner);
        let cover =
            BETWEEN.2 * smooth_step(ABOVE_NOTCHES.0, ABOVE_NOTCHES.1, above_edge) * smooth_step(0.125, 0.095, above_edge) * along;
        (0..3).for_each(|c| {
            let seen = self.light.enamel[c] * BETWEEN.1[c] * (BETWEEN.0 * light) as f32;
            colour[c] += (seen - colour[c]) * cover as f32;
        });
    }

    /// Both rows of teeth and the gum above the upper one.
    fn lay_arches(&self, (x, y): (f64, f64), below_upper: f64, above_lower: f64, from_corner: f64, colour: &mut [f32; 3]) {
        let Some(picture) = self.teeth else { return };
        let x = x / self.wider();
        // The row turns away to the sides, and is lost in the dark of the cheeks towards the corners.
        let turned = 1.0 - self.by_light(TURNED) * smooth_step(0.10, 0.30, x.abs() / self.size);
        let side = (0.25 + 0.75 * smooth_step(0.0, self.by_light(CORNERS_DARK), from_corner)) * turned;
        let row = |dx: f64, dy: f64, brightness: f64, tint: [f32; 3], colour: &mut [f32; 3]| {
            let Some((tooth, cover)) = sampled(picture, dx / self.size, dy / self.size) else { return };
            let cover = cover * smooth_step(0.0, 0.035, from_corner) as f32;
            // Enamel lets light through at its edge.
            let edge = 1.0 - 0.16 * smooth_step(-0.024, 0.0, dy);
            for c in 0..3 {
                let lit = tooth[c] / TEETH_WHITE * self.light.enamel[c] * tint[c] * (brightness * side * edge) as f32;
                colour[c] += (lit - colour[c]) * cover;
            }
        };
        // The lower row is deeper in the mouth, and in the shadow of all that is above it.
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
        // The lip's shadow on their tops.
        let tops = self.by_light(TOPS);
        let light = (tops + (1.0 - tops) * smooth_step(0.0, 0.05, below_upper)) * (1.0 - DIMMER * (1.0 - self.lit) * gaping);
        let edge = -ROW_EDGE * x * x / self.size;
        let above_edge = (edge - upper_y) / crowns_longer(x / self.size, (edge - upper_y + below_upper) / self.size);
        self.lay_between(x, above_edge, light * side, from_corner, colour);
        // A sliver of tooth that the lip all but hides is in the lip's shadow.
        let bared = smooth_step(0.0, 0.03, below_upper + above_lower);
        let before = *colour;
        row(x, edge - above_edge, light, [1.0; 3], colour);
        (0..3).for_each(|c| colour[c] = before[c] + (colour[c] - before[c]) * bared as f32);
    }
}

/// How much flatter the row's edge is than in a smile, of lips whose edges are so far in the light, in a mouth that gapes so far.
fn flatter(lit: f64, gaping: f64) -> f64 {
    let (dropped, raised) = FLATTER;
    dropped + (raised - dropped) * lit + FLATTER_GAPING * gaping + FLATTER_PARTED * (1.0 - lit) * (1.0 - gaping)
}

/// By how much the crowns at a place of the row are longer than the picture shows them, for a lip that is so high above their edge.
fn crowns_longer(x: f64, lip_above: f64) -> f64 {
    let shown = (CROWNS_SHOWN.0 - CROWNS_SHOWN.1 * x * x).max(CROWNS_SHOWN.2);
    ((lip_above + TUCKED) / shown).clamp(1.0, CROWN / shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crowns_are_as_long_as_a_raised_lip_shows_them_and_no_longer() {
        // A lip that hides their tops leaves them as the picture has them.
        assert_eq!(crowns_longer(0.0, 0.08), 1.0);
        assert_eq!(crowns_longer(0.3, 0.05), 1.0);
        // One that is raised above what the picture shows has them below it, in the middle as beside it.
        let longer = crowns_longer(0.0, 0.14);
        assert!((longer * CROWNS_SHOWN.0 - (0.14 + TUCKED)).abs() < 1e-12 && crowns_longer(0.35, 0.14) > longer);
        // Above a whole crown is gum.
        assert!((crowns_longer(0.0, 0.5) * CROWNS_SHOWN.0 - CROWN).abs() < 1e-12);
        assert!((crowns_longer(0.4, 0.5) * (CROWNS_SHOWN.0 - CROWNS_SHOWN.1 * 0.16) - CROWN).abs() < 1e-12);
    }

    #[test]
    fn a_row_of_teeth_is_flatter_the_less_it_is_of_a_smile() {
        // Raised lips 0.22, dropped ones 0.12 and 0.25 as long as they part a little, and 0.38 when they gape.
        assert!((flatter(1.0, 0.0) - 0.22).abs() < 1e-12);
        assert!((flatter(0.0, 0.0) - 0.37).abs() < 1e-12);
        assert!((flatter(0.0, 1.0) - 0.50).abs() < 1e-12);
    }

    #[test]
    fn rows_reach_the_corners_of_a_mouth_that_is_wider_than_a_smile() {
        let mouth = dropped(0.06);
        assert_eq!(mouth.wider(), 1.0);
        let drawn = |line: &[(f64, f64)]| line.iter().map(|(x, y)| (1.44 * x, *y)).collect();
        // Half of it 0.576 wide: 1.2 times as wide as the row reaches.
        let wide = Interior { upper: drawn(&mouth.upper), lower: drawn(&mouth.lower), ..mouth };
        assert!((wide.wider() - 1.2).abs() < 1e-9);
    }

    /// A mouth of grey lips around the origin, 0.8 eye distances wide, whose jaw has dropped by `gap` where the lips part as an arch, 100 px to the eye distance.
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
        // The incisors would end 0.02 below the lip, behind its shadow; they are shown down to 0.062.
        let (teeth, depth, tongue) = (level(4.5), level(11.0), level(24.0));
        assert!(teeth > 90.0, "{teeth}");
        // What lies behind is dark, but not a hole: a tenth to a third of the lip.
        assert!((0.08 * lip..0.35 * lip).contains(&depth), "{depth}");
        assert!((0.65 * lip..1.05 * lip).contains(&tongue), "{tongue}");
        // From the depth to the tongue it grows lighter step by step, without an edge: by less than a quarter of the lip for each percent of the eye distance.
        let steps: Vec<f32> = (11..=20).map(|y| level(f64::from(y))).collect();
        assert!(steps.windows(2).all(|w| w[1] > w[0] - 1.0 && w[1] - w[0] < 0.25 * lip), "{steps:?}");
        // Far from the corners, too, lips that are all but shut have a crease between them as light as half of themselves, and no dark slit.
        let slit = luma(dropped(0.004).colour(Point2::new(5.0, 0.2), [160.0, 110.0, 110.0]));
        assert!(slit > 0.5 * lip, "{slit}");
        // Lips that part a little show the teeth as far as they hang, and no tongue to speak of.
        let hardly = dropped(0.06);
        let below = luma(hardly.colour(Point2::new(5.0, 4.5), [160.0, 110.0, 110.0]));
        assert!(below < 0.8 * lip, "{below}");
    }
}
