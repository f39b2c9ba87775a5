//! The skin change of a class on one face.

use image::RgbImage;
use nalgebra::{Point2, Vector2};

use super::{
    CloneError, Skin, SourceMotion, Target, detail,
    skin::{NO_CHANGE, SIZE, bordered, eye_distance, layout_nodes, log_of},
    timing::Moment,
};
use crate::warp::{SHARP, Texture, one_tone};

/// The skin change of a class on a target, and the measure of how far a motion has progressed towards it.
#[derive(Debug)]
pub struct ClonedSkin {
    /// Changed pixels of the target's photograph, line by line: row, first column, and the level of the skin's picture at each pixel.
    lines: Vec<(usize, usize, Vec<u8>)>,
    /// Apex offsets of the class's representative, relative to its eye separation.
    apex: Vec<Vector2<f64>>,
    lighter: f32,
    /// Exponents of the ratio of brightness for red, green and blue.
    powers: [f32; 3],
}

/// Largest strength of a skin change: a motion stronger than the class's own gets no deeper folds than this.
pub const MOST_SKIN: f64 = 1.3;
/// Exponents of the ratio of brightness for red, green and blue in a fold: shadows are lit through the skin around them. Measured on the cheeks
/// of 90 smiling people (on their mean 0.76, 1.09, 1.16; on their own fine shading 0.82, 1.06, 1.14).
const CHANNELS: [f32; 3] = [0.80, 1.07, 1.15];
/// Additional blur of faint skin shades against the edges of eyes, from cameras and picture compression, px (sigma).
const FAINT: f64 = 1.3;
/// Smallest blur that is applied, px of the layout; less is not visible.
const LEAST_SOFTENING: f64 = 0.25;
/// Smallest strength that is applied.
const LEAST_SKIN: f64 = 0.01;

/// Exponents of the ratio of brightness in the folds of a target, for red, green and blue; all are 1 on a photograph in one tone.
pub fn fold_powers(target: &Target) -> [f32; 3] {
    let toned = one_tone(target.texture(), target.warp().texture_nodes());
    CHANNELS.map(|power| power + (1.0 - power) * toned)
}

/// Sigma of the Gaussian that blurs folds like the skin on a target's photograph, px of the layout; 0 if that is not visible.
pub fn fold_softening(target: &Target) -> f64 {
    let softness = target.warp().softness();
    let beyond = (softness * softness - SHARP * SHARP).max(0.0).sqrt();
    let sigma = beyond.hypot(FAINT) * eye_distance(&layout_nodes()) / target.warp().eye_distance();
    if sigma >= LEAST_SOFTENING { sigma } else { 0.0 }
}

/// Positions of the vertices of a target's mesh on the layout, as fractions of its width and height.
///
/// # Errors
/// [`CloneError::Folded`]; does not occur for a target that could be created.
pub fn places_on_skin(target: &Target) -> Result<Vec<Point2<f64>>, CloneError> {
    let placement = target.warp().place(&layout_nodes())?;
    let share = |p: &Point2<f64>| Point2::new((p.x + 0.5) / f64::from(SIZE.0), (p.y + 0.5) / f64::from(SIZE.1));
    Ok(placement.vertices().iter().map(share).collect())
}

impl ClonedSkin {
    /// Maps the skin change of a class to a target; `representative` is the class's own motion.
    ///
    /// # Errors
    /// [`CloneError::Folded`]; does not occur for a target that could be created.
    pub fn new(target: &Target, skin: &Skin, representative: &SourceMotion) -> Result<Self, CloneError> {
        let (width, height) = target.picture.dimensions();
        let mut carried = RgbImage::from_pixel(width, height, image::Rgb([NO_CHANGE; 3]));
        let placement = target.warp().place(&layout_nodes())?;
        let picture = skin.softened(fold_softening(target));
        target.warp().unwarp(&Texture::from_gray(&picture), &placement, &mut carried);
        let mask = detail::mask(target);
        // Faded out at the border of the face, because a fit does not know where a forehead ends.
        let levels: Vec<u8> = carried.pixels().zip(&mask).map(|(p, share)| bordered(p.0[0], *share)).collect();
        let changes = |level: &u8| *level != NO_CHANGE;
        let line = |(y, row): (usize, &[u8])| {
            let (first, last) = (row.iter().position(changes)?, row.iter().rposition(changes)?);
            Some((y, first, row[first..=last].to_vec()))
        };
        let lines = levels.chunks(width.max(1) as usize).enumerate().filter_map(line).collect();
        let apex = representative.offsets[representative.apex()].iter().map(|o| o / representative.fapus.es).collect();
        Ok(Self { lines, apex, lighter: skin.lighter, powers: fold_powers(target) })
    }

    /// Progress of a moment towards the class's motion: 0 at neutral, 1 at the representative's apex, at most [`MOST_SKIN`].
    pub fn growth(&self, source: &SourceMotion, moment: &Moment, emphasis: f64) -> f64 {
        let (mut along, mut whole) = (0.0, 0.0);
        for (offset, apex) in moment.offsets.iter().zip(&self.apex) {
            along += (offset / source.fapus.es).dot(apex);
            whole += apex.norm_squared();
        }
        if whole > 0.0 { (emphasis * along / whole).clamp(0.0, MOST_SKIN) } else { 0.0 }
    }

    /// The target's texture with the skin change at a strength; `None` if it is too weak.
    pub fn texture(&self, target: &Target, growth: f64) -> Option<Texture> {
        (growth >= LEAST_SKIN).then(|| {
            // Lightening comes from skin that bulges towards a light other than this one; most of it is omitted.
            let log = |level: usize| log_of(level as u8) * if level > usize::from(NO_CHANGE) { self.lighter } else { 1.0 };
            let factors = self
                .powers
                .map(|power| -> [f32; 256] { std::array::from_fn(|level| (power * log(level) * growth as f32).exp()) });
            target.texture().times(self.lines.iter().map(|(y, x, levels)| (*y, *x, &levels[..])), &factors)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        clone::test_target::{portrait, portrait_target, target},
        wireframe::Face,
    };

    #[test]
    fn folds_are_as_soft_as_the_photograph() {
        let face = Face::candide3();
        let (sharp, soft) = (portrait_target(), &target(image::imageops::blur(&portrait(), 2.0)));
        let [before, after] = [sharp, soft].map(fold_softening);
        // Difference of squares of 2 px and the photograph's own blur, on a layout with 60 px between the eyes.
        let unit = 60.0 / soft.warp().eye_distance();
        assert!((after.powi(2) - before.powi(2) - (2.0 * unit).powi(2)).abs() < 0.4 * (2.0 * unit).powi(2), "{before} {after}");
        let motion = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &face).unwrap();
        let skin = Skin::of_form(&motion).unwrap();
        let deepest = |target: &Target| {
            let cloned = ClonedSkin::new(target, &skin, &motion).unwrap();
            cloned.lines.iter().flat_map(|(_, _, levels)| levels).copied().min().unwrap()
        };
        let [of_sharp, of_soft] = [sharp, soft].map(deepest);
        assert!(of_sharp < of_soft && of_soft < NO_CHANGE, "{of_sharp} {of_soft}");
    }
}
