//! The light that a mouth stands in, as the eyes and the skin around it tell.

use super::luma;
use crate::warp::{Texture, Warp};

/// How far from the middle of the iris to the corner of the eye its white is looked for: where it is brightest of these. Half way alone lies on lashes in
/// narrow and painted eyes, and teeth were made as dark as slate (one of 90 people).
const WHITE_AT: [f64; 3] = [0.3, 0.4, 0.5];
/// Red, green and blue over green of the white of the eye (the mean of the second brightest and the brightest of four places) and of cheeks, on
/// the mean of 90 people in white light. The front teeth of 16 of them who show them when they smile have 1.037 and 0.956, which the picture of
/// the teeth has by itself.
const WHITE: [f32; 3] = [1.048, 1.0, 0.991];
const SKIN: [f32; 3] = [1.256, 1.0, 0.887];
/// Flesh inside of a mouth in white light, of the brightness of the lips.
const FLESH: [f32; 3] = [1.45, 0.86, 0.84];
/// Level of the front teeth where the white of the eye has the second one, and the power of it by which they follow: teeth are as bright in
/// dark faces as in fair ones (of the same 16: 180 to 242), and the white of an eye is in the shadow of brow and lid, more or less. With a power
/// of 0 what is left is a root mean square of 17 levels, with 0.5 of 19, with 1 of 26, on people left out (with the white half way, which is as good but
/// for narrow eyes); but these people stood in one
/// light, and darker pictures have darker teeth. In that light it would be 200: it lies in front of the mouth, and in the light of rooms, which comes
/// from above and beside, teeth are darker than the white of the eye tells. Those of six people of videos by three cameras, measured where they are
/// brightest while they speak or smile, have 0.56 to 1.05 of what 200 gives (mean 0.82).
const TEETH: (f32, f32, f32) = (188.0, 165.0, 0.5);
/// Teeth are no brighter than this, levels, and than this of the brightest white of the eye, which is taken for no darker than that of the skin, for
/// eyes may lie in shadow; and no darker than this of the skin.
const BRIGHTEST: (f32, f32, f32) = (204.0, 1.67, 0.68);
const DARKEST: f32 = 0.85;
/// Whites of eyes in the studio light of those people are so bright over their skin on the mean. Where light falls from above, eyes and mouths lie in
/// shadow, and the whites are darker: teeth then are, too, by that power of it. On videos of six people by three cameras, whose teeth it was seen
/// on, they are 0.75 to 1.1 times as bright as the skin, and were made 1.0 to 1.4 times as bright.
const SHADED: (f32, f32) = (1.0, 1.0);
/// How far the white of people's eyes and their skin lie from these means in one light, as logarithms (three standard deviations of the same 90
/// people, of skin; the white's are a quarter of that, for some have no more than lashes there): what lies further is a cast of the light.
const DIFFER: (f32, f32) = (0.03, 0.16);
/// Share of the white of the eye in the cast, skin having the rest: teeth lie between lips as the white lies between lids, and what is redder there than
/// the light is, they are, too. On the same videos red over green of teeth is 1.20 to 1.75 of what it is in white light, that of the whites 1.07 to
/// 1.51, in the same order but for one.
const BY_WHITE: f32 = 0.75;
/// A cast of light is no stronger than this, as a factor between two colours.
const STRONGEST: f32 = 3.0;

/// Colours of what a mouth holds in the light of a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Of teeth, levels.
    pub enamel: [f32; 3],
    /// Of flesh, over its brightness.
    pub flesh: [f32; 3],
}

impl Light {
    /// The light of a face on its photograph.
    pub fn of(warp: &Warp, texture: &Texture) -> Self {
        // Between the iris and the corners of the eye.
        let mut whites = [(67, 20, 68), (71, 23, 72), (69, 53, 70), (73, 56, 74)].map(|(a, corner, b): (usize, usize, usize)| {
            let iris = nalgebra::center(&warp.nodes[a], &warp.nodes[b]);
            let places = WHITE_AT.map(|share| texture.sample(iris + (warp.nodes[corner] - iris) * share));
            places.into_iter().max_by(|a, b| luma(*a).total_cmp(&luma(*b))).unwrap_or_default()
        });
        whites.sort_by(|a, b| luma(*a).total_cmp(&luma(*b)));
        let cheeks = [27_usize, 60, 90, 91].map(|n| texture.sample(warp.nodes[n]));
        let skin = std::array::from_fn(|c| cheeks.iter().map(|cheek| cheek[c]).sum::<f32>() / 4.0);
        Self::by([whites[2], whites[3]], skin)
    }

    /// The light that gives the white of the eye, its second brightest and its brightest place, and the skin these colours, levels.
    fn by(whites: [[f32; 3]; 2], skin: [f32; 3]) -> Self {
        let white: [f32; 3] = std::array::from_fn(|c| f32::midpoint(whites[0][c], whites[1][c]));
        // The white of an eye on a small picture has some of the skin beside it.
        let cast: [f32; 3] = std::array::from_fn(|c| {
            let beyond = |colour: [f32; 3], mean: [f32; 3], differ: f32| {
                let log = (colour[c].max(1.0) / colour[1].max(1.0) / mean[c]).ln();
                log - log.clamp(-differ, differ)
            };
            let (white, skin) = (beyond(white, WHITE, DIFFER.0), beyond(skin, SKIN, DIFFER.1));
            (BY_WHITE * white + (1.0 - BY_WHITE) * skin).clamp(-STRONGEST.ln(), STRONGEST.ln()).exp()
        });
        let shaded = (luma(white) / (SHADED.0 * luma(skin)).max(1.0)).min(1.0).powf(SHADED.1);
        let bright = TEETH.0 * (luma(white) / TEETH.1).powf(TEETH.2) * shaded;
        let brightest = (BRIGHTEST.1 * luma(whites[1]).max(BRIGHTEST.2 * luma(skin))).min(BRIGHTEST.0);
        let bright = bright.max(DARKEST * luma(skin)).min(brightest);
        // In white light the picture of the teeth has their colour by itself.
        Self { enamel: lit([1.0; 3], cast, bright), flesh: lit(FLESH, cast, luma(FLESH)) }
    }
}

/// A colour in a cast of light, at a brightness.
fn lit(colour: [f32; 3], cast: [f32; 3], bright: f32) -> [f32; 3] {
    let seen: [f32; 3] = std::array::from_fn(|c| colour[c] * cast[c]);
    let factor = bright / luma(seen).max(1e-3);
    seen.map(|c| c * factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn over_green(colour: [f32; 3]) -> [f32; 2] {
        [colour[0] / colour[1], colour[2] / colour[1]]
    }

    #[test]
    fn teeth_are_as_bright_in_a_dark_face_as_in_a_fair_one() {
        let white = WHITE.map(|c| c * TEETH.1 / luma(WHITE));
        for skin in [60.0, 140.0] {
            let light = Light::by([white; 2], [1.1 * SKIN[0] * skin, skin, SKIN[2] * skin]);
            assert!((luma(light.enamel) - TEETH.0).abs() < 1e-3, "{light:?}");
            // White light leaves colours as they are; so does a skin that is redder than the mean.
            assert!(over_green(light.enamel).iter().zip([1.0, 1.0]).all(|(is, ought)| (is - ought).abs() < 1e-5), "{light:?}");
            assert!(light.flesh.iter().zip(FLESH).all(|(is, ought)| (is - ought).abs() < 1e-5), "{light:?}");
        }
    }

    #[test]
    fn teeth_lie_in_the_shadow_that_eyes_lie_in() {
        // Whites at two thirds of what studio light leaves them: 165 levels over a skin of 247.
        let (white, skin) = (WHITE.map(|c| c * 165.0 / luma(WHITE)), SKIN.map(|c| c * 1.5 * 165.0 / luma(SKIN)));
        let light = Light::by([white; 2], skin);
        // 188 times two thirds, below the least that teeth are over the skin.
        assert!((luma(light.enamel) - (DARKEST * luma(skin)).min(BRIGHTEST.0)).abs() < 1e-3, "{light:?}");
        // A tenth darker only.
        let skin = SKIN.map(|c| c * 1.1 * 165.0 / luma(SKIN));
        assert!((luma(Light::by([white; 2], skin).enamel) - 188.0 / 1.1).abs() < 1e-2);
    }

    #[test]
    fn a_dark_picture_has_darker_teeth_and_orange_light_has_orange_ones() {
        // A quarter of the light on the white: half of it on the teeth, 94, but not beyond 1.67 of the white, 69.
        let dark = WHITE.map(|c| c * 41.25 / luma(WHITE));
        let light = Light::by([dark; 2], SKIN.map(|c| c * 30.0));
        assert!((luma(light.enamel) - 1.67 * 41.25).abs() < 1e-3, "{light:?}");
        // Eyes in deep shadow, in a face that is not: teeth are no darker than 0.85 of the skin.
        let (shadow, skin) = (WHITE.map(|c| c * 40.0 / luma(WHITE)), SKIN.map(|c| c * 150.0 / luma(SKIN)));
        let light = Light::by([shadow; 2], skin);
        assert!((luma(light.enamel) - DARKEST * 150.0).abs() < 1e-3, "{light:?}");
        // Half of the blue is missing in all that is seen: in teeth and flesh, too, but for what people differ by, exp(0.75 * 0.03 + 0.25 * 0.16).
        let orange = |colour: [f32; 3]| [colour[0], colour[1], 0.5 * colour[2]];
        let light = Light::by([orange(WHITE.map(|c| c * 160.0)); 2], orange(SKIN.map(|c| c * 120.0)));
        let blue = 0.5 * 0.0625_f32.exp();
        assert!((over_green(light.enamel)[1] - blue).abs() < 1e-5, "{light:?}");
        assert!((over_green(light.flesh)[1] - blue * 0.84 / 0.86).abs() < 1e-5, "{light:?}");
        assert!((luma(light.flesh) - luma(FLESH)).abs() < 1e-5, "{light:?}");
        // Black has no colour to tell anything by.
        assert!(Light::by([[0.0; 3]; 2], [0.0; 3]).enamel.iter().all(|c| c.is_finite() && *c >= 0.0));
    }
}
