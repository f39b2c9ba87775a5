//! Wrinkles and teeth of the source's own frames, which no warp produces.
//!
//! Wrinkles follow the expression ratio image (Liu, Shan and Zhang, *Expressive expression mapping with ratio images*, SIGGRAPH 2001):
//! where a source frame is darker or lighter than the neutral frame at the same point of the skin, the target changes by the same factor.
//! The mesh maps both source pictures to the geometry of the target's photograph, and the ratio of their grey levels is applied. The ratio is
//! reduced where it is unreliable: slow changes (light, exposure) are removed, strong edges of either source frame (hair, brows, nostrils,
//! lips) and their neighbourhood are down-weighted because they lie elsewhere on another face, and factors are limited. The effect fades
//! out at the border of the face. The inside of the source's mouth is shown, in the target's light, on the source's own face or on request.

use std::sync::Arc;

use image::{GrayImage, RgbImage};
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use super::{CloneError, SourceMotion, Target};
use crate::{
    geometry::{
        Similarity,
        blur::gaussian,
        polygon::{self, inside_depth_within},
    },
    interpolation::smooth_step,
    warp::{MouthInside, Placement, Texture, Warp, byte},
};

/// What an open mouth shows.
///
/// ```
/// use grimace::clone::{CloneOptions, Teeth};
///
/// let options = CloneOptions { teeth: Teeth::Dark, ..CloneOptions::default() };
/// assert_eq!(serde_json::to_value(options)?["teeth"], "dark");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Teeth {
    /// The inside of the source's mouth if the source's frames are given and the target is its own neutral frame; drawn teeth otherwise. Teeth
    /// belong to a person: on another face the light, the sharpness of the camera and the opening of the lips do not match.
    #[default]
    Auto,
    /// The inside of the source's mouth on every face, if the source's frames are given.
    Source,
    /// Always a dark mouth without teeth.
    Dark,
    /// Always drawn teeth.
    Drawn,
}

/// Sigma of the smoothing of both pictures before their ratio is taken, in eye distances.
const SMOOTHING: f64 = 0.010;
/// Grey levels added to both pictures before the ratio, so that noise in dark areas does not count as a wrinkle.
pub(super) const FLOOR: f32 = 12.0;
/// Asymptotic limit of the logarithm of a ratio.
const LOG_LIMIT: f32 = 0.38;
/// Sigma (in eye distances) of the changes that count as light rather than wrinkles, and the fraction of them that is removed.
const SLOW: (f64, f32) = (0.20, 0.75);
/// Slope of the logarithm of grey levels per eye distance that halves the weight of the ratio: `EDGE` in the neutral frame, `MOVED_EDGE` in the
/// other frame, where wrinkles are edges, too, but weaker than hair.
pub(super) const EDGE: f32 = 6.0;
pub(super) const MOVED_EDGE: f32 = 14.0;
/// Radius in which an edge lowers the weight, in eye distances.
const EDGE_REACH: f64 = 0.022;
/// Fraction of the ratio that is applied to lips, whose colour and shine differ between people.
pub(super) const LIPS: f32 = 0.35;
/// Logarithm of brightness relative to the surroundings at which a point of the source begins to count as shine, and counts fully.
/// Shine depends on the skin's oil and the lamp, not on the expression.
const SHINE: (f64, f64) = (0.16, 0.40);
/// Sigma of the smoothing that leaves the light of a face, in eye distances.
const LIGHT: f64 = 0.35;
/// Correlation of the light on both faces up to which wrinkles keep `LEAST_ALIKE` of their strength, and from which they keep all of it. Lit
/// from the other side, a furrow is bright where the source's is dark.
const LIGHT_ALIKE: (f64, f64) = (0.0, 0.75);
const LEAST_ALIKE: f64 = 0.35;
/// Least and greatest factor on the brightness of the source's mouth; the limit keeps teeth from glaring.
const LIGHT_LIMITS: (f32, f32) = (0.6, 1.15);
/// Width of the fade at the border of the face, in eye distances.
const FADE: f64 = 0.30;
/// Lips of the source nearer than this, in its eye distances, count as closed.
const TEETH_GAP: f64 = 0.012;

/// Wrinkles and teeth of a source's frames, prepared for one target.
///
/// ```
/// # use grimace::{clone as cloning, correspondence, fit, sequence};
/// let face = grimace::wireframe::Face::candide3();
/// # let marks = "fixtures/portraits/P01_correspondences.csv".as_ref();
/// # let marks = correspondence::read_correspondences(marks, &face.tables, 113)?;
/// # let fitter = fit::Fitter::new(&face.wireframe, Default::default());
/// # let picture = image::open("fixtures/portraits/P01.jpg")?.into_rgb8();
/// # let target = grimace::clone::Target::new("P01", picture, &marks, &fitter, &face)?;
/// use grimace::clone::{CloneError, Details, SourceMotion};
///
/// // `target` is a portrait with its marks.
/// // A FAP file has no pictures to take wrinkles from.
/// let source = SourceMotion::read("fixtures/golden/fap/happiness.fap".as_ref(), &face)?;
/// assert!(matches!(Details::new(&target, &source, vec![]), Err(CloneError::NoSourceFrames(_))));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Details {
    frames: Arc<[RgbImage]>,
    /// Grey levels of the neutral frame in the geometry of the target.
    neutral: Vec<f32>,
    placements: Vec<Placement>,
    /// Whether the lips of each frame are apart.
    open: Vec<bool>,
    /// Whether the target is the source's own neutral frame.
    same_face: bool,
    /// Weight of the ratio for each pixel of the target.
    mask: Vec<f32>,
    /// Brightness of the target relative to the source.
    light: f32,
    /// Factor on the strength of wrinkles from the similarity of the light on both faces.
    alike: f32,
    sigma_px: f64,
    /// Columns and rows of the target's picture.
    size: (u32, u32),
}

impl Details {
    /// Prepares the details of a source for a target. `frames` are the colour pictures of the source's track, in its order. They are not
    /// copied: pass an [`Arc`] to share them with other targets.
    ///
    /// # Errors
    /// [`CloneError::NoSourceFrames`] if the source is not a track or has another number of frames.
    pub fn new(target: &Target, source: &SourceMotion, frames: impl Into<Arc<[RgbImage]>>) -> Result<Self, CloneError> {
        let frames = frames.into();
        if source.frames.is_empty() {
            let reason = "wrinkles and teeth need a tracked sequence as source: a representative or a FAP file has no pictures";
            return Err(CloneError::NoSourceFrames(reason.to_owned()));
        }
        if frames.len() != source.frames.len() {
            let reason = format!("the track has {} frames, but {} pictures were found", source.frames.len(), frames.len());
            return Err(CloneError::NoSourceFrames(reason));
        }
        let warp = target.warp();
        let same_face = frames.first().is_some_and(|neutral| *neutral == target.picture);
        let placements = placements(warp, source, frames.first().filter(|_| !same_face))?;
        let sigma_px = (SMOOTHING * warp.eye_distance()).max(0.4);
        let mut details = Self {
            neutral: Vec::new(),
            open: source.frames.iter().map(|(_, nodes)| is_open(nodes)).collect(),
            same_face,
            mask: mask(target),
            placements,
            frames,
            light: 1.0,
            alike: 1.0,
            sigma_px,
            size: target.picture.dimensions(),
        };
        details.neutral = details.carried(target, 0);
        let own = grey(&target.picture);
        details.alike = light_alike(&own, &details.neutral, &details.mask, target);
        let smoothed = smooth(&details.neutral, target.picture.width(), target.picture.height(), sigma_px);
        distrust_edges(&mut details.mask, &smoothed, EDGE, target);
        let (mut of_target, mut of_source) = (0.0_f64, 0.0_f64);
        for ((&m, &t), &s) in details.mask.iter().zip(&own).zip(&details.neutral) {
            of_target += f64::from(m * t);
            of_source += f64::from(m * s);
        }
        if of_source > 0.0 {
            details.light = ((of_target / of_source) as f32).clamp(LIGHT_LIMITS.0, LIGHT_LIMITS.1);
        }
        Ok(details)
    }

    /// Checks that they were made for a target and for a source of so many frames.
    ///
    /// # Errors
    /// [`CloneError::OtherDetails`].
    pub(super) fn check(&self, target: &Target, needed: usize) -> Result<(), CloneError> {
        let (frames, of, size) = (self.frames.len(), self.size, target.picture.dimensions());
        if needed <= frames && of == size { Ok(()) } else { Err(CloneError::OtherDetails { frames, of, needed, size }) }
    }

    /// Grey levels of a source frame in the geometry of the target's photograph.
    fn carried(&self, target: &Target, frame: usize) -> Vec<f32> {
        let mut picture = target.picture.clone();
        target.warp().unwarp(&Texture::new(&self.frames[frame]), &self.placements[frame], &mut picture);
        grey(&picture)
    }

    /// Factor on the strength of wrinkles from the similarity of the light on source and target, 0 to 1.
    pub fn light_share(&self) -> f64 {
        f64::from(self.alike)
    }

    /// Returns the target's texture with the wrinkles of a frame. A `strength` of 1 gives those of the source where the light is alike.
    pub(crate) fn texture(&self, target: &Target, frame: usize, strength: f64) -> Texture {
        let mut picture = target.picture.clone();
        let (width, height) = picture.dimensions();
        let neutral = smooth(&self.neutral, width, height, self.sigma_px);
        let moved = smooth(&self.carried(target, frame), width, height, self.sigma_px);
        let logs: Vec<f32> = moved.iter().zip(&neutral).map(|(m, n)| ((m + FLOOR) / (n + FLOOR)).ln()).collect();
        let mut mask = self.mask.clone();
        distrust_edges(&mut mask, &moved, MOVED_EDGE, target);
        let weighted: Vec<f32> = logs.iter().zip(&mask).map(|(l, m)| l * m).collect();
        let slow_px = SLOW.0 * target.warp().eye_distance();
        let (sums, weights) = (smooth(&weighted, width, height, slow_px), smooth(&mask, width, height, slow_px));
        // The surroundings come from the neutral frame, which does not shine where the other frame does.
        let around = smooth(&neutral, width, height, slow_px);
        let strength = strength as f32 * self.alike;
        for (k, pixel) in picture.pixels_mut().enumerate() {
            let share = mask[k];
            if share > 0.0 {
                let mut log = logs[k] - SLOW.1 * sums[k] / weights[k].max(1e-3);
                if log > 0.0 {
                    let above = ((moved[k] + FLOOR) / (around[k] + FLOOR)).ln();
                    log *= 1.0 - smooth_step(SHINE.0, SHINE.1, f64::from(above)) as f32;
                }
                let factor = (LOG_LIMIT * (log / LOG_LIMIT).tanh() * share * strength).exp();
                pixel.0 = pixel.0.map(|c| byte(f32::from(c) * factor));
            }
        }
        Texture::new(&picture)
    }

    /// Whether the clone shows the inside of the source's mouth.
    pub(super) fn show_mouth(&self, teeth: Teeth) -> bool {
        teeth == Teeth::Source || (teeth == Teeth::Auto && self.same_face)
    }

    /// The source frame with the inside of its mouth, in the light of the target, and its mesh; `None` while the lips are closed.
    pub(crate) fn mouth(&self, frame: usize) -> Option<(Texture, &Placement)> {
        self.open[frame].then(|| {
            let mut picture = self.frames[frame].clone();
            if self.light != 1.0 {
                picture.pixels_mut().for_each(|p| p.0 = p.0.map(|c| byte(f32::from(c) * self.light)));
            }
            (Texture::new(&picture), &self.placements[frame])
        })
    }
}

/// Places the mesh on each frame of a source, with the edges of lids and lips shifted to where the neutral frame shows them. `neutral` is that
/// frame, or `None` if it is the target's own photograph, whose shifts are already known.
fn placements(warp: &Warp, source: &SourceMotion, neutral: Option<&RgbImage>) -> Result<Vec<Placement>, CloneError> {
    let Some((_, first)) = source.frames.first() else { return Ok(Vec::new()) };
    let shifts = match neutral {
        Some(neutral) => Warp::edge_shifts_on(first, &Texture::new(neutral))?,
        None => warp.edge_shifts().to_vec(),
    };
    let placed = |(_, nodes): &(u32, Vec<Point2<f64>>)| {
        let head = Similarity::fit(first, nodes, None).unwrap_or_else(|_| Similarity::identity());
        let mut nodes = nodes.clone();
        for (n, shift) in &shifts {
            if let Some(node) = nodes.get_mut(*n) {
                *node += head.apply_vector(shift);
            }
        }
        Ok(warp.place(&nodes)?)
    };
    source.frames.iter().map(placed).collect()
}

/// Lowers a mask near strong edges of a smoothed picture in the geometry of the target; the slope `edge` halves it.
fn distrust_edges(mask: &mut [f32], smoothed: &[f32], edge: f32, target: &Target) {
    distrust_edges_of(mask, smoothed, edge, target.picture.dimensions(), target.warp().eye_distance());
}

/// [`distrust_edges`] for a picture of any size; `unit` is its eye distance, px.
pub(super) fn distrust_edges_of(mask: &mut [f32], smoothed: &[f32], edge: f32, (width, height): (u32, u32), unit: f64) {
    let logs: Vec<f32> = smoothed.iter().map(|v| (v + FLOOR).ln()).collect();
    let (w, h) = (width as usize, height as usize);
    let mut slopes = vec![0.0; logs.len()];
    for y in 1..h.saturating_sub(1) {
        for x in 1..w.saturating_sub(1) {
            let k = y * w + x;
            let (dx, dy) = ((logs[k + 1] - logs[k - 1]) / 2.0, (logs[k + w] - logs[k - w]) / 2.0);
            slopes[k] = (dx * dx + dy * dy) * (unit * unit) as f32;
        }
    }
    let slopes = smooth(&slopes, width, height, (EDGE_REACH * unit).max(0.5));
    for (share, slope) in mask.iter_mut().zip(slopes) {
        *share /= 1.0 + slope / (edge * edge);
    }
}

/// Factor on the strength of wrinkles from the correlation of the two faces' smoothed brightness over the skin.
fn light_alike(own: &[f32], other: &[f32], mask: &[f32], target: &Target) -> f32 {
    let (width, height) = target.picture.dimensions();
    let sigma = LIGHT * target.warp().eye_distance();
    let weights = smooth(mask, width, height, sigma);
    let course = |levels: &[f32]| -> Vec<f32> {
        let weighted: Vec<f32> = levels.iter().zip(mask).map(|(l, m)| (l + FLOOR).ln() * m).collect();
        smooth(&weighted, width, height, sigma).iter().zip(&weights).map(|(s, w)| s / w.max(1e-3)).collect()
    };
    let (a, b) = (course(own), course(other));
    let total: f64 = mask.iter().map(|&m| f64::from(m)).sum::<f64>().max(1e-9);
    let mean = |values: &[f32]| values.iter().zip(mask).map(|(v, m)| f64::from(v * m)).sum::<f64>() / total;
    let (of_a, of_b) = (mean(&a), mean(&b));
    let (mut both, mut square_a, mut square_b) = (0.0, 0.0, 0.0);
    for ((a, b), m) in a.iter().zip(&b).zip(mask) {
        let (a, b, m) = (f64::from(*a) - of_a, f64::from(*b) - of_b, f64::from(*m));
        both += m * a * b;
        square_a += m * a * a;
        square_b += m * b * b;
    }
    let correlation = both / (square_a * square_b).sqrt().max(1e-12);
    (LEAST_ALIKE + (1.0 - LEAST_ALIKE) * smooth_step(LIGHT_ALIKE.0, LIGHT_ALIKE.1, correlation)) as f32
}

/// Converts the inside of the mouth to what the warp renders.
pub fn inside<'a>(mouth: Option<&'a (Texture, &'a Placement)>, teeth: Teeth) -> MouthInside<'a> {
    match mouth {
        Some((texture, placement)) => MouthInside::Picture { texture, placement },
        None if teeth == Teeth::Dark => MouthInside::Dark,
        None => MouthInside::Teeth,
    }
}

/// Whether the inner lips are apart.
fn is_open(nodes: &[Point2<f64>]) -> bool {
    let eyes = (nalgebra::center(&nodes[20], &nodes[23]) - nalgebra::center(&nodes[53], &nodes[56])).norm();
    [(87, 40), (81, 83), (82, 84)].iter().any(|&(a, b)| (nodes[b] - nodes[a]).norm() > TEETH_GAP * eyes)
}

fn grey(picture: &RgbImage) -> Vec<f32> {
    let luma: GrayImage = image::imageops::grayscale(picture);
    luma.as_raw().iter().map(|&v| f32::from(v)).collect()
}

/// Mask that is 1 on the face and fades to 0 at its border and at the eyes, where lids hide something else on every face.
pub(super) fn mask(target: &Target) -> Vec<f32> {
    mask_of(target.fitted.model.nodes(), target.warp().eye_distance(), target.picture.dimensions(), LIPS)
}

/// [`mask`] for nodes in a picture, with the value for lips.
pub(super) fn mask_of(nodes: &[Point2<f64>], unit: f64, (width, height): (u32, u32), lip_share: f32) -> Vec<f32> {
    let outline: Vec<Point2<f64>> = OUTLINE.iter().map(|&n| nodes[n]).collect();
    let lips: Vec<Point2<f64>> = LIP_OUTLINE.iter().map(|&n| nodes[n]).collect();
    let eyes: Vec<Vec<Point2<f64>>> = EYES.iter().map(|eye| eye.iter().map(|&n| nodes[n]).collect()).collect();
    let mut mask = vec![0.0; width as usize * height as usize];
    let Some((low, high)) = polygon::bounds(&outline) else { return mask };
    for (k, value) in mask.iter_mut().enumerate() {
        let point = Point2::new(f64::from(k as u32 % width), f64::from(k as u32 / width));
        let in_box = low.x <= point.x && point.x <= high.x && low.y <= point.y && point.y <= high.y;
        if in_box && polygon::inside(&outline, &point) {
            let depth = inside_depth_within(&outline, &point, FADE * unit);
            let eye = eyes.iter().map(|eye| inside_depth_within(eye, &point, 0.06 * unit)).fold(f64::NEG_INFINITY, f64::max);
            let border = (depth / (FADE * unit)).min(1.0);
            let off_eye = (-eye / (0.06 * unit)).clamp(0.0, 1.0);
            let off_lips = (-inside_depth_within(&lips, &point, 0.05 * unit) / (0.05 * unit)).clamp(0.0, 1.0) as f32;
            *value = (border * border * (3.0 - 2.0 * border) * off_eye) as f32 * (lip_share + (1.0 - lip_share) * off_lips);
        }
    }
    mask
}

/// Outline of the face between hairline and chin.
const OUTLINE: [usize; 14] = [2, 13, 14, 29, 28, 30, 32, 10, 65, 63, 61, 62, 47, 46];
/// Outline of the lips.
const LIP_OUTLINE: [usize; 10] = [31, 79, 33, 7, 66, 80, 64, 86, 8, 85];
/// The lid margins.
const EYES: [[usize; 8]; 2] = [[20, 97, 21, 105, 23, 107, 22, 99], [53, 98, 54, 106, 56, 108, 55, 100]];

/// Separable Gaussian smoothing; the values at the border continue beyond it.
pub(super) fn smooth(values: &[f32], width: u32, height: u32, sigma_px: f64) -> Vec<f32> {
    gaussian(values, width as usize, height as usize, (sigma_px, sigma_px))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clone::test_target::{portrait, portrait_target};

    #[test]
    fn pictures_of_the_source_are_held_once_and_its_mouth_is_shown_on_its_own_face() {
        let face = crate::wireframe::Face::candide3();
        let picture = portrait();
        let target = portrait_target();
        let nodes = target.fitted.model.nodes().to_vec();
        let source = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &face).unwrap();
        let source = SourceMotion { frames: vec![(1, nodes.clone()), (2, nodes)], ..source };
        let frames: Arc<[RgbImage]> = vec![picture.clone(), picture.clone()].into();
        let details = Details::new(target, &source, Arc::clone(&frames)).unwrap();
        assert!(Arc::ptr_eq(&details.frames, &frames));
        // By default, the own mouth on the own face only; on another picture only on request.
        let shown =
            |details: &Details| [Teeth::Auto, Teeth::Source, Teeth::Drawn, Teeth::Dark].map(|teeth| details.show_mouth(teeth));
        assert_eq!(shown(&details), [true, true, false, false]);
        let brighter = RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
            image::Rgb(picture.get_pixel(x, y).0.map(|level| level.saturating_add(9)))
        });
        let other = Details::new(target, &source, vec![brighter.clone(), brighter]).unwrap();
        assert_eq!(shown(&other), [false, true, false, false]);
        assert!(details.check(target, 2).is_ok());
        let error = details.check(target, 3).unwrap_err();
        assert!(matches!(error, CloneError::OtherDetails { frames: 2, needed: 3, .. }), "{error}");
        let small = crate::clone::test_target::target(image::imageops::crop_imm(&picture, 0, 0, 440, 540).to_image());
        let error = details.check(&small, 2).unwrap_err();
        assert!(matches!(error, CloneError::OtherDetails { of: (440, 560), size: (440, 540), .. }), "{error}");
    }
}
