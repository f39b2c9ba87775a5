//! The light that falls into a mouth, estimated from the white of the eyes and the skin around it.
//!
//! [`Light::of`] samples eyes and cheeks, compares their colours with means in white light, and returns the colours of teeth and flesh.

use super::luma;
use crate::warp::{Texture, Warp};

/// Sampled positions of an eye's white, as fractions of the way from the iris' centre to the corner of the eye; the brightest is used. One sample
/// at 0.5 hits lashes in narrow and painted eyes, and makes teeth too dark (one of 90 people).
const WHITE_AT: [f64; 3] = [0.3, 0.4, 0.5];
/// Red, green and blue over green of the white of the eye (mean of the two brightest of four places) and of cheeks: means of
/// 90 people in white light. The visible front teeth of 16 of them have 1.037 and 0.956 (red and blue), a tint that the picture of the teeth
/// already contains.
const WHITE: [f32; 3] = [1.048, 1.0, 0.991];
const SKIN: [f32; 3] = [1.256, 1.0, 0.887];
/// Colour of the flesh inside a mouth in white light, at the brightness of the lips.
const FLESH: [f32; 3] = [1.45, 0.86, 0.84];
/// Brightness of the front teeth (levels) at a reference brightness of the white of the eye (levels), and the exponent with which they follow it.
/// Teeth are as bright in dark faces as in fair ones (of the same 16: 180 to 242), and brow and lid shade the white of an eye to varying
/// degrees. On held-out people the root mean square error is 17 levels with an exponent of 0, 19 with 0.5, and 26 with 1 (white sampled at
/// 0.5, which is equivalent except in narrow eyes). All stood in one light, however, and darker pictures have darker teeth. The level
/// that fits these people is 200, but their light comes from the front; room light comes from above and from the sides and leaves teeth darker
/// than the white of the eye predicts. The brightest teeth of six people in videos by three cameras have 0.56 to 1.05 of what 200 gives (mean 0.82).
const TEETH: (f32, f32, f32) = (188.0, 165.0, 0.5);
/// Upper limits of the teeth's brightness: in levels, and relative to the brightest white of the eye. The third value is the least
/// brightness of that white relative to the skin, because eyes may lie in shadow. `DARKEST` is the lower limit, relative to the skin.
const BRIGHTEST: (f32, f32, f32) = (204.0, 1.67, 0.68);
const DARKEST: f32 = 0.85;
/// Mean brightness of the white of the eye relative to the skin in the studio light of those people, and the exponent with which darker whites
/// darken the teeth: light from above leaves eyes and mouths in shadow. In videos of six people by three cameras, visible teeth are 0.75 to
/// 1.1 times as bright as the skin; without this correction they were 1.0 to 1.4 times as bright.
const SHADED: (f32, f32) = (1.0, 1.0);
/// Variation between people of white and skin around these means in one light, as logarithms; the excess counts as a cast of the light. For
/// skin it is three standard deviations of the same 90 people; for the white, a quarter of three, as some show only lashes there.
const DIFFER: (f32, f32) = (0.03, 0.16);
/// Weight of the white of the eye in the colour cast; skin has the rest. Teeth lie between lips as the white lies between lids, and both
/// are reddened by the flesh around them. On the same videos red over green of teeth is 1.20 to 1.75 of the value in white light, that of the
/// whites 1.07 to 1.51, in the same order with one exception.
const BY_WHITE: f32 = 0.75;
/// Strongest cast of light, as a factor between two colours.
const STRONGEST: f32 = 3.0;

/// Colours inside a mouth in the light of a photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Colour of teeth, levels.
    pub enamel: [f32; 3],
    /// Colour of flesh, relative to its brightness.
    pub flesh: [f32; 3],
}

impl Light {
    /// Estimates the light of a face on its photograph.
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

    /// Estimates the light from the white of the eye, at its second brightest and its brightest place, and the colour of the skin, levels.
    fn by(whites: [[f32; 3]; 2], skin: [f32; 3]) -> Self {
        let white: [f32; 3] = std::array::from_fn(|c| f32::midpoint(whites[0][c], whites[1][c]));
        // On a small picture the white of an eye is mixed with the skin beside it.
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
        // The picture of the teeth already has their colour in white light.
        Self { enamel: lit([1.0; 3], cast, bright), flesh: lit(FLESH, cast, luma(FLESH)) }
    }
}

/// A colour under a cast of light, scaled to a brightness.
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
            // White light leaves colours unchanged, and so does skin that is redder than the mean.
            assert!(over_green(light.enamel).iter().zip([1.0, 1.0]).all(|(is, ought)| (is - ought).abs() < 1e-5), "{light:?}");
            assert!(light.flesh.iter().zip(FLESH).all(|(is, ought)| (is - ought).abs() < 1e-5), "{light:?}");
        }
    }

    #[test]
    fn teeth_lie_in_the_shadow_that_eyes_lie_in() {
        // Whites at two thirds of their brightness in studio light: 165 levels over a skin of 247.
        let (white, skin) = (WHITE.map(|c| c * 165.0 / luma(WHITE)), SKIN.map(|c| c * 1.5 * 165.0 / luma(SKIN)));
        let light = Light::by([white; 2], skin);
        // 188 times two thirds lies below the lower limit relative to the skin.
        assert!((luma(light.enamel) - (DARKEST * luma(skin)).min(BRIGHTEST.0)).abs() < 1e-3, "{light:?}");
        // Only a tenth darker.
        let skin = SKIN.map(|c| c * 1.1 * 165.0 / luma(SKIN));
        assert!((luma(Light::by([white; 2], skin).enamel) - 188.0 / 1.1).abs() < 1e-2);
    }

    #[test]
    fn a_dark_picture_has_darker_teeth_and_orange_light_has_orange_ones() {
        // With a quarter of the light on the white, teeth get half of theirs, 94, limited to 1.67 of the white, 69.
        let dark = WHITE.map(|c| c * 41.25 / luma(WHITE));
        let light = Light::by([dark; 2], SKIN.map(|c| c * 30.0));
        assert!((luma(light.enamel) - 1.67 * 41.25).abs() < 1e-3, "{light:?}");
        // Eyes in deep shadow in a bright face: teeth are no darker than 0.85 of the skin.
        let (shadow, skin) = (WHITE.map(|c| c * 40.0 / luma(WHITE)), SKIN.map(|c| c * 150.0 / luma(SKIN)));
        let light = Light::by([shadow; 2], skin);
        assert!((luma(light.enamel) - DARKEST * 150.0).abs() < 1e-3, "{light:?}");
        // Half of the blue is missing everywhere, so teeth and flesh lose it, except for what people differ by: exp(0.75 * 0.03 + 0.25 * 0.16).
        let orange = |colour: [f32; 3]| [colour[0], colour[1], 0.5 * colour[2]];
        let light = Light::by([orange(WHITE.map(|c| c * 160.0)); 2], orange(SKIN.map(|c| c * 120.0)));
        let blue = 0.5 * 0.0625_f32.exp();
        assert!((over_green(light.enamel)[1] - blue).abs() < 1e-5, "{light:?}");
        assert!((over_green(light.flesh)[1] - blue * 0.84 / 0.86).abs() < 1e-5, "{light:?}");
        assert!((luma(light.flesh) - luma(FLESH)).abs() < 1e-5, "{light:?}");
        // Black has no colour to estimate from.
        assert!(Light::by([[0.0; 3]; 2], [0.0; 3]).enamel.iter().all(|c| c.is_finite() && *c >= 0.0));
    }
}
