//! The effect of an expression on the skin of many people: their mean expression ratio image.
//!
//! A representative has node positions only; folds, furrows and shadows are not part of it. Following Liu, Shan and Zhang (*Expressive expression
//! mapping with ratio images*, SIGGRAPH 2001), the grey levels of a person's apex frame are divided by those of the neutral frame at the
//! same point of the skin. Both frames are first mapped to a common layout, the wireframe seen from the front, so that people can be averaged.
//! Each pixel is the mean logarithm of the ratios without the upper and the lower quarter, shrunk towards 0 according to its uncertainty. Slow
//! changes (light, exposure) are removed. Areas that are not skin or differ between faces (eyes, lips, brows, nostrils, hair) have no weight.

use std::{
    io,
    path::{Path, PathBuf},
};

use image::{GrayImage, ImageEncoder, RgbImage, codecs::png::PngEncoder};
use nalgebra::Point2;

use super::{
    CloneError, SourceKind, SourceMotion,
    detail::{self, smooth},
};
use crate::{
    geometry::polygon::inside_depth,
    warp::{Texture, Warp},
    wireframe::Wireframe,
};

/// Fraction of the lightening in a mean of people that a clone shows; folds are shadows.
const LIGHTER: f32 = 0.35;
/// Size of the layout, px.
pub(super) const SIZE: (u32, u32) = (128, 176);
/// Position of the wireframe's origin in the layout, px. `SCALE` is px per wireframe unit: the eyes are 60 px apart.
pub(super) const ORIGIN: (f64, f64) = (63.5, 85.0);
pub(super) const SCALE: f64 = 100.0;
/// Logarithm of a ratio that level 255 of the file means; level 1 means its negative, 128 no change.
pub const SKIN_LOG_LIMIT: f32 = 0.4;
/// Level of the file that means no change.
pub const NO_CHANGE: u8 = 128;
/// Suffix of the file name, after the representative's stem.
pub const SKIN_SUFFIX: &str = "_skin.png";
/// Smallest number of people in a mean; with fewer, it would show individual faces.
pub const LEAST_SKIN_PEOPLE: usize = 5;
/// Largest number of people per class whose frames are read.
pub const MOST_SKIN_PEOPLE: usize = 64;
/// Smallest root mean square of a mean (logarithm) that counts as shading; less is left by warping and noise.
const LEAST_SHADING: f64 = 0.010;
/// Smallest eye distance of a picture that shows folds, px.
const LEAST_EYE_DISTANCE: f64 = 40.0;
/// Sigma of the smoothing of both pictures before their ratio is taken, and (`SLOW`) of what counts as light, in eye distances.
const SMOOTHING: f64 = 0.014;
const SLOW: f64 = 0.30;
/// Number of standard errors at which a pixel's mean is halved.
const SHRINK: f32 = 1.5;
/// Sigma of the neighbourhood in which the depth of folds is compared, px of the layout. `DEPTH_NOISE`: depth (logarithm) that counts as
/// noise. `DEEPEST`: largest factor on the mean's folds.
const DEPTH_REACH: f64 = 4.2;
const DEPTH_NOISE: f32 = 0.012;
const DEEPEST: f32 = 2.0;
/// Factor on the darkening in a mean, whose folds are spread instead of lying in one line. Beside the mouths of 90 smiling
/// people the darkest fiftieth has a logarithm of -0.20 on the median (quartiles -0.28 and -0.13), in their mean -0.12.
const DARKER: f32 = 1.7;
/// Weight below which a person's pixel is ignored.
const LEAST_WEIGHT: f32 = 0.25;
/// Value of a face's mask from which a skin change is applied fully.
const BORDER: f32 = 0.5;
/// Margin around the brows that does not count as skin, in eye distances.
const BROW_ROOM: f64 = 0.05;
/// The brows: upper edge from the outer to the inner end, then the lower edge back.
const BROWS: [[usize; 4]; 2] = [[15, 16, 17, 18], [48, 49, 50, 51]];
/// The underside of the nose; the position of nostrils differs between faces.
pub(super) const NOSTRILS: [usize; 3] = [26, 6, 59];

/// A mean expression ratio image: logarithms of ratios on the layout.
#[derive(Clone, Debug, PartialEq)]
pub struct Skin {
    /// Logarithms of the ratios, row by row.
    pub(super) logs: Vec<f32>,
    /// Number of people in the mean; 0 if it was read from a file or generated.
    pub people: usize,
    /// Fraction of the lightening that a clone shows.
    pub(super) lighter: f32,
}

/// One person's log ratios on the layout, with weights.
#[derive(Clone, Debug)]
pub struct SkinSample {
    logs: Vec<f32>,
    weights: Vec<f32>,
}

/// Why there is no mean skin change.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoSkin {
    /// Skins were not computed: only a run has the pictures.
    #[error("only `run` computes skins, because it has the pictures")]
    NotCollected,
    /// No sequence has pictures that may be used.
    #[error(
        "no sequence has pictures that may be shown ({landmarks} use landmarks only, {hidden} show people who may not be shown)"
    )]
    NoPictures {
        /// Sequences that landmarks drive.
        landmarks: usize,
        /// Sequences with pictures that may not be shown.
        hidden: usize,
    },
    /// Too few people with pictures.
    #[error("{found} people have pictures that show folds; at least {LEAST_SKIN_PEOPLE} are needed")]
    TooFewPeople {
        /// People with pictures.
        found: usize,
    },
    /// The pictures have no shading in common.
    #[error("the pictures have no shading in common (root mean square {:.4}; at least {LEAST_SHADING} is needed)", shading)]
    NoShading {
        /// Root mean square of the mean's logarithms.
        shading: f64,
    },
}

/// The layout on which people are compared.
#[derive(Debug)]
pub struct SkinLayout {
    warp: Warp,
    mask: Vec<f32>,
}

impl SkinLayout {
    /// Creates the layout of Candide-3; `None` if the wireframe cannot be warped, which does not happen with Candide-3.
    pub fn new() -> Option<Self> {
        let nodes = layout_nodes();
        let warp = Warp::new(&nodes).ok()?;
        let unit = warp.eye_distance();
        let mut mask = detail::mask_of(&nodes, unit, SIZE, 0.0);
        let polygon = |list: &[usize]| list.iter().map(|&n| nodes[n]).collect::<Vec<_>>();
        let hidden: Vec<Vec<Point2<f64>>> = BROWS.iter().map(|b| polygon(b)).chain([polygon(&NOSTRILS)]).collect();
        for (k, value) in mask.iter_mut().enumerate() {
            let point = Point2::new(f64::from(k as u32 % SIZE.0), f64::from(k as u32 / SIZE.0));
            let depth = hidden.iter().map(|h| inside_depth(h, &point)).fold(f64::NEG_INFINITY, f64::max);
            *value *= (-depth / (BROW_ROOM * unit)).clamp(0.0, 1.0) as f32;
        }
        Some(Self { warp, mask })
    }

    /// Measures the change of one person's skin from the neutral to the apex frame, each with its nodes (px). `None` if the face is too small or
    /// the nodes do not form a face.
    pub fn measure(&self, neutral: (&RgbImage, &[Point2<f64>]), apex: (&RgbImage, &[Point2<f64>])) -> Option<SkinSample> {
        let unit = self.warp.eye_distance();
        let [neutral, apex] = [neutral, apex].map(|(picture, nodes)| self.carried(picture, nodes));
        let (neutral, apex) = (neutral?, apex?);
        let sigma = (SMOOTHING * unit).max(0.5);
        let [neutral, apex] = [neutral, apex].map(|levels| smooth(&levels, SIZE.0, SIZE.1, sigma));
        let mut weights = self.mask.clone();
        detail::distrust_edges_of(&mut weights, &neutral, detail::EDGE, SIZE, unit);
        detail::distrust_edges_of(&mut weights, &apex, detail::MOVED_EDGE, SIZE, unit);
        let logs: Vec<f32> = apex.iter().zip(&neutral).map(|(a, n)| ((a + detail::FLOOR) / (n + detail::FLOOR)).ln()).collect();
        let weighted: Vec<f32> = logs.iter().zip(&weights).map(|(l, w)| l * w).collect();
        let slow = SLOW * unit;
        let (sums, totals) = (smooth(&weighted, SIZE.0, SIZE.1, slow), smooth(&weights, SIZE.0, SIZE.1, slow));
        let logs = logs.iter().zip(sums.iter().zip(&totals)).map(|(l, (s, t))| l - s / t.max(1e-3)).collect();
        Some(SkinSample { logs, weights })
    }

    /// Maps the grey levels of a picture to the layout.
    fn carried(&self, picture: &RgbImage, nodes: &[Point2<f64>]) -> Option<Vec<f32>> {
        let unit = self.warp.eye_distance();
        let middle = |a: usize, b: usize| Some(nalgebra::center(nodes.get(a)?, nodes.get(b)?));
        let eyes = (middle(20, 23)? - middle(53, 56)?).norm();
        if !(eyes >= LEAST_EYE_DISTANCE) {
            return None;
        }
        // Scaled down to the size of the layout to avoid aliasing of finer detail.
        let (width, height) = picture.dimensions();
        let factor = (unit / eyes).min(1.0);
        let side = |s: u32| (f64::from(s) * factor).round().max(1.0) as u32;
        let grey = image::imageops::grayscale(picture);
        let small = if factor < 1.0 {
            image::imageops::resize(&grey, side(width), side(height), image::imageops::FilterType::Triangle)
        } else {
            grey
        };
        let (sx, sy) = (f64::from(small.width()) / f64::from(width), f64::from(small.height()) / f64::from(height));
        let there: Vec<Point2<f64>> = nodes.iter().map(|p| Point2::new((p.x + 0.5) * sx - 0.5, (p.y + 0.5) * sy - 0.5)).collect();
        let placement = self.warp.place(&there).ok()?;
        let mut layout = RgbImage::new(SIZE.0, SIZE.1);
        self.warp.unwarp(&Texture::from_gray(&small), &placement, &mut layout);
        Some(layout.pixels().map(|p| f32::from(p.0[0])).collect())
    }
}

/// Distance between the centres of the eyes.
pub(super) fn eye_distance(nodes: &[Point2<f64>]) -> f64 {
    (nalgebra::center(&nodes[20], &nodes[23]) - nalgebra::center(&nodes[53], &nodes[56])).norm()
}

pub(super) fn layout_nodes() -> Vec<Point2<f64>> {
    Wireframe::candide3().vertices().iter().map(|v| Point2::new(ORIGIN.0 + SCALE * v.x, ORIGIN.1 - SCALE * v.y)).collect()
}

/// Restores the depth of folds in a mean. Folds differ in position between people, so their mean is wide and shallow. As Tiddeman, Burt
/// and Perrett (*Prototyping and transforming facial textures for perception research*, IEEE CG&A 2001) do for averages of faces, the
/// mean is multiplied by the people's average magnitude around a pixel over that of the mean. Noise, which people have and the mean has not, is
/// subtracted.
fn deepen(logs: &mut [f32], samples: &[&SkinSample]) {
    let around = |values: &[f32]| smooth(values, SIZE.0, SIZE.1, DEPTH_REACH);
    let mut depths = vec![0.0_f32; logs.len()];
    for sample in samples {
        let weighted = sample.logs.iter().zip(&sample.weights);
        let magnitudes: Vec<f32> = weighted.map(|(log, weight)| weight * (log.abs() - DEPTH_NOISE).max(0.0)).collect();
        let (sums, totals) = (around(&magnitudes), around(&sample.weights));
        for (depth, (sum, total)) in depths.iter_mut().zip(sums.iter().zip(&totals)) {
            *depth += sum / total.max(0.05) / samples.len() as f32;
        }
    }
    let of_mean = around(&logs.iter().map(|log| log.abs()).collect::<Vec<f32>>());
    for (log, (depth, own)) in logs.iter_mut().zip(depths.iter().zip(&of_mean)) {
        *log = (*log * (depth / (own + DEPTH_NOISE)).clamp(1.0, DEEPEST)).clamp(-SKIN_LOG_LIMIT, SKIN_LOG_LIMIT);
    }
}

fn write_png(picture: &GrayImage, writer: &mut dyn io::Write) -> io::Result<()> {
    PngEncoder::new(writer)
        .write_image(picture.as_raw(), picture.width(), picture.height(), image::ExtendedColorType::L8)
        .map_err(io::Error::other)
}

/// Fades a level towards no change where the face's mask is low.
pub(super) fn bordered(level: u8, share: f32) -> u8 {
    let change = f32::from(level) - f32::from(NO_CHANGE);
    (f32::from(NO_CHANGE) + change * (share / BORDER).min(1.0)).round() as u8
}

/// The logarithm of a ratio that a level of the file means.
pub(super) fn log_of(level: u8) -> f32 {
    (f32::from(level) - f32::from(NO_CHANGE)) / 127.0 * SKIN_LOG_LIMIT
}

impl Skin {
    /// Computes the robust mean of people, one sample each.
    ///
    /// # Errors
    /// [`NoSkin`] for too few people or no common shading.
    pub fn mean(samples: &[&SkinSample]) -> Result<Self, NoSkin> {
        let people = samples.len();
        if people < LEAST_SKIN_PEOPLE {
            return Err(NoSkin::TooFewPeople { found: people });
        }
        let mut logs = vec![0.0_f32; (SIZE.0 * SIZE.1) as usize];
        let (mut square, mut weight) = (0.0, 0.0);
        let mut values: Vec<(f32, f32)> = Vec::with_capacity(people);
        for (k, log) in logs.iter_mut().enumerate() {
            values.clear();
            values.extend(samples.iter().map(|s| (s.logs[k], s.weights[k])).filter(|v| v.1 >= LEAST_WEIGHT));
            // Where most people have hair or an edge, the remaining ones are not representative.
            if values.len() < LEAST_SKIN_PEOPLE.max(people / 2) {
                continue;
            }
            values.sort_by(|a, b| a.0.total_cmp(&b.0));
            let cut = values.len() / 4;
            let kept = &values[cut..values.len() - cut];
            let total: f32 = kept.iter().map(|v| v.1).sum();
            let mean = kept.iter().map(|v| v.0 * v.1).sum::<f32>() / total;
            let share = total / kept.len() as f32;
            // Interquartile range over that of the standard normal distribution.
            let spread = (kept[kept.len() - 1].0 - kept[0].0) / 1.349;
            let error = SHRINK * spread / (values.len() as f32).sqrt();
            let sure = mean * mean / (mean * mean + error * error).max(1e-12);
            *log = (mean * sure * share).clamp(-SKIN_LOG_LIMIT, SKIN_LOG_LIMIT);
            square += f64::from(share * *log * *log);
            weight += f64::from(share);
        }
        deepen(&mut logs, samples);
        for log in logs.iter_mut().filter(|log| **log < 0.0) {
            *log = (*log * DARKER).max(-SKIN_LOG_LIMIT);
        }
        let shading = (square / weight.max(1e-9)).sqrt();
        if !(shading >= LEAST_SHADING) {
            return Err(NoSkin::NoShading { shading });
        }
        Ok(Self { logs: smooth(&logs, SIZE.0, SIZE.1, 0.7), people, lighter: LIGHTER })
    }

    /// The picture that is written: 128 is no change, 1 and 255 are factors of exp(-0.4) and exp(0.4).
    pub fn picture(&self) -> GrayImage {
        let byte = |log: f32| (f32::from(NO_CHANGE) + (log / SKIN_LOG_LIMIT * 127.0).round()).clamp(1.0, 255.0) as u8;
        GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| image::Luma([byte(self.logs[(y * SIZE.0 + x) as usize])]))
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// [`io::Error`] if `writer` fails.
    pub fn write(&self, writer: &mut dyn io::Write) -> io::Result<()> {
        write_png(&self.picture(), writer)
    }

    /// Writes the picture faded out at the border of the face, for readers that have no mask of the face.
    ///
    /// # Errors
    /// [`io::Error`] if `writer` fails.
    pub fn write_in_face(&self, writer: &mut dyn io::Write) -> io::Result<()> {
        let nodes = layout_nodes();
        let mask = detail::mask_of(&nodes, eye_distance(&nodes), SIZE, detail::LIPS);
        let mut picture = self.picture();
        for (level, share) in picture.iter_mut().zip(&mask) {
            *level = bordered(*level, *share);
        }
        write_png(&picture, writer)
    }

    /// The picture with folds softened by a Gaussian of `sigma` px.
    pub(super) fn softened(&self, sigma: f64) -> GrayImage {
        if sigma > 0.0 { Self { logs: smooth(&self.logs, SIZE.0, SIZE.1, sigma), ..*self }.picture() } else { self.picture() }
    }

    /// Fraction of the lightening that a clone shows.
    pub fn lighter(&self) -> f32 {
        self.lighter
    }

    /// Returns the skin change for a motion, and its file: that of the class next to a representative's table, otherwise (without a file) the
    /// folds that follow from the motion's form.
    ///
    /// # Errors
    /// [`CloneError`] for an invalid file.
    pub fn going_with(source: &Path, motion: &SourceMotion) -> Result<(Self, Option<PathBuf>), CloneError> {
        match Self::path_beside(source, motion.kind) {
            Some(path) => Ok((Self::read(&path)?, Some(path))),
            None => Ok((Self::of_form(motion)?, None)),
        }
    }

    /// Path of the skin change next to a representative's table; `None` for other motions, and if the file does not exist.
    pub fn path_beside(source: &Path, kind: SourceKind) -> Option<PathBuf> {
        let stem = source.file_stem()?.to_string_lossy();
        let picture = source.with_file_name(format!("{stem}{SKIN_SUFFIX}"));
        (kind == SourceKind::Model && picture.is_file()).then_some(picture)
    }

    /// Reads a picture written by [`Skin::write`].
    ///
    /// # Errors
    /// [`CloneError`] for a file that is not a picture or has another size.
    pub fn read(path: &Path) -> Result<Self, CloneError> {
        let picture = image::imageops::grayscale(&crate::sequence::read_colour(path)?);
        if picture.dimensions() != SIZE {
            let (width, height) = picture.dimensions();
            return Err(CloneError::SkinSize { path: path.to_owned(), width, height, expected: SIZE });
        }
        Ok(Self { logs: picture.as_raw().iter().map(|&level| log_of(level)).collect(), people: 0, lighter: LIGHTER })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::geometry::Similarity;

    /// A grey face seen through a similarity, with a line across the left cheek that is darker by `fold`.
    fn face(view: &Similarity, fold: f64, light: f64) -> (RgbImage, Vec<Point2<f64>>) {
        let nodes: Vec<Point2<f64>> = layout_nodes().iter().map(|p| view.apply(p)).collect();
        let back = view.inverse();
        let picture = RgbImage::from_fn(400, 500, |x, y| {
            let at = back.apply(&Point2::new(f64::from(x), f64::from(y)));
            let dark = fold * (-((at.x - FOLD.0) / 2.5).powi(2) - ((at.y - FOLD.1) / 12.0).powi(2)).exp();
            image::Rgb([((140.0 + light * at.y) * (1.0 - dark)).round() as u8; 3])
        });
        (picture, nodes)
    }

    /// On the subject's left cheek.
    const FOLD: (f64, f64) = (96.0, 104.0);

    fn sample(layout: &SkinLayout, scale: f64, fold: f64) -> SkinSample {
        let view = Similarity { scale, angle: 0.05, translation: Vector2::new(20.0, 15.0) };
        let ((neutral, nodes), (apex, _)) = (face(&view, 0.0, 0.0), face(&view, fold, 0.15));
        layout.measure((&neutral, &nodes), (&apex, &nodes)).unwrap()
    }

    #[test]
    fn folds_that_lie_a_little_elsewhere_on_everybody_keep_their_depth() {
        // A fold 0.2 deep and 3 px wide, at one of seven positions 3 px apart for each person.
        let fold = |shift: f32| -> Vec<f32> {
            let at = |k: usize| (k as u32 % SIZE.0) as f32 - 60.0 - shift;
            (0..(SIZE.0 * SIZE.1) as usize).map(|k| if at(k).abs() < 1.5 { -0.2 } else { 0.0 }).collect()
        };
        let people: Vec<SkinSample> =
            (-3..=3).map(|k| SkinSample { logs: fold(3.0 * k as f32), weights: vec![1.0; (SIZE.0 * SIZE.1) as usize] }).collect();
        let samples: Vec<&SkinSample> = people.iter().collect();
        let deepest = |values: &[f32]| values.iter().copied().fold(0.0, f32::min);
        // The mean of all is a seventh as deep everywhere. Apart from noise it has the people's magnitude, and stays as it is.
        let mut wide: Vec<f32> = (0..people[0].logs.len()).map(|k| people.iter().map(|p| p.logs[k]).sum::<f32>() / 7.0).collect();
        let before = deepest(&wide);
        deepen(&mut wide, &samples);
        assert!((deepest(&wide) - before).abs() < 1e-6, "{before} {}", deepest(&wide));
        // Depth lost by trimming and shrinking is restored, at most by a factor of two.
        let mut shy: Vec<f32> = fold(0.0).iter().map(|log| 0.05 * log).collect();
        deepen(&mut shy, &samples);
        assert!((-0.02..-0.015).contains(&deepest(&shy)), "{}", deepest(&shy));
        let mut none = vec![0.0; shy.len()];
        deepen(&mut none, &samples);
        assert!(none.iter().all(|log| *log == 0.0));
    }

    #[test]
    fn a_fold_of_all_people_is_found_at_its_place_and_light_is_not() {
        let layout = SkinLayout::new().unwrap();
        let samples: Vec<SkinSample> = [1.6, 2.0, 1.8, 2.2, 1.7].iter().map(|&s| sample(&layout, s, 0.3)).collect();
        let skin = Skin::mean(&samples.iter().collect::<Vec<_>>()).unwrap();
        let at = |x: f64, y: f64| skin.logs[y as usize * SIZE.0 as usize + x as usize];
        // A third of the way from 0.7 to the smoothed and thinned line of ln(0.7) = -0.36.
        assert!(at(FOLD.0, FOLD.1) < -0.10, "{}", at(FOLD.0, FOLD.1));
        let mirrored = 2.0 * ORIGIN.0 - FOLD.0;
        assert!(at(mirrored, FOLD.1).abs() < 0.03, "{}", at(mirrored, FOLD.1));
    }

    #[test]
    fn a_feature_of_one_person_in_five_is_not_shared() {
        let layout = SkinLayout::new().unwrap();
        let folds = [0.0, 0.0, 0.4, 0.0, 0.0];
        let samples: Vec<SkinSample> = folds.iter().map(|&f| sample(&layout, 1.8, f)).collect();
        let all: Vec<&SkinSample> = samples.iter().collect();
        assert!(matches!(Skin::mean(&all), Err(NoSkin::NoShading { .. })));
        assert_eq!(Skin::mean(&all[..4]), Err(NoSkin::TooFewPeople { found: 4 }));
    }

    #[test]
    fn a_skin_is_read_as_it_was_written() {
        let mut logs = vec![0.0; (SIZE.0 * SIZE.1) as usize];
        (logs[5], logs[9]) = (SKIN_LOG_LIMIT, -SKIN_LOG_LIMIT / 127.0);
        let skin = Skin { logs, people: 7, lighter: LIGHTER };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("skin.png");
        skin.write(&mut std::fs::File::create(&path).unwrap()).unwrap();
        let read = Skin::read(&path).unwrap();
        assert!(read.logs.iter().zip(&skin.logs).all(|(a, b)| (a - b).abs() < 1e-6));
        assert_eq!(skin.picture().as_raw()[4..10], [128, 255, 128, 128, 128, 127]);
        image::GrayImage::new(3, 3).save(&path).unwrap();
        assert!(matches!(Skin::read(&path), Err(CloneError::SkinSize { width: 3, .. })));
    }
}
