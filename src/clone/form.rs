//! Folds for a motion without pictures, computed from its form: the shading of [`crate::synthesis`]' embedded head, deformed by the nodes.
//!
//! Where the motion raises the upper lip, the cheek gets the fold measured on smiling people instead: a coarse head bulges there without
//! folding, and its shading is only an arc around the wing of the nose.

use std::sync::OnceLock;

use nalgebra::{Point2, Vector2};

use super::{
    CloneError, Skin, SourceMotion, detail,
    skin::{NOSTRILS, ORIGIN, SCALE, SIZE, SKIN_LOG_LIMIT, eye_distance, layout_nodes, log_of},
};
use crate::{geometry::polygon::inside_depth, interpolation::smooth_step, synthesis::Relief, warp::fill_triangle};

/// Skin change of 90 people's smiles on the layout (made by `scripts/smile_skin`).
const SMILE: &[u8] = include_bytes!("../../candide/smile_skin.png");
/// Strength of that fold without a smile's wide mouth, which extends it below the corners; at full strength and length it looks like a stain.
const OF_SMILE: f32 = 0.55;
/// Nodes of the upper lip and beside the corners of the mouth. `FOLDS`: their mean rise, in eye distances, at which cheeks begin to fold, and fold
/// as in a smile.
const RAISED: [usize; 4] = [79, 80, 90, 91];
const FOLDS: (f64, f64) = (0.02, 0.09);
/// Borders of the cheeks in units of the wireframe: outwards from the nose, and down from the wings of the nose. Each pair goes from not cheek to
/// fully cheek.
const BESIDE_NOSE: (f64, f64) = (0.12, 0.22);
const OUTWARDS: (f64, f64) = (0.85, 0.70);
const BELOW_EYES: (f64, f64) = (0.06, -0.06);
const ABOVE_CHIN: (f64, f64) = (-0.80, -0.62);
const ABOVE_MOUTH: (f64, f64) = (-0.40, -0.22);

/// Fraction of the lightening that a clone shows: half of that of 90 people's smiling cheeks, where it is soft light; here it is a wedge.
const LIGHTER: f32 = 0.25;
/// Factor on the darkening, because the head has hollows but no folds. The darkest fiftieth beside the mouth has a logarithm of -0.20 on smiling
/// people and -0.09 with the form alone. A factor of two looks smeared, because the shade is wider than a fold.
const DARKER: f32 = 1.5;
/// Sigma of the smoothing after drawing triangle by triangle, px of the layout.
const SMOOTHING: f64 = 1.8;
/// Margin around the nostrils, in eye distances.
const NOSTRIL_ROOM: f64 = 0.06;

impl Skin {
    /// Computes the folds that the form of an average head makes in the strongest frame of a motion.
    ///
    /// # Errors
    /// [`CloneError::Bank`]; does not occur with the embedded head.
    pub fn of_form(motion: &SourceMotion) -> Result<Self, CloneError> {
        let relief = Relief::shipped()?;
        let offsets: Vec<Vector2<f64>> = motion.offsets[motion.apex()].iter().map(|o| o / motion.fapus.es).collect();
        let shading = relief.shading(&offsets);
        let on_layout = |v: usize| {
            let p = relief.places()[v];
            Point2::new(ORIGIN.0 + SCALE * p.x, ORIGIN.1 - SCALE * p.y)
        };
        let mut logs = vec![0.0_f32; (SIZE.0 * SIZE.1) as usize];
        for triangle in relief.triangles() {
            let values = triangle.map(|v| Point2::new(f64::from(shading[v]), 0.0));
            fill_triangle(triangle.map(on_layout), values, SIZE, |x, y, at| logs[(y * SIZE.0 + x) as usize] = at.x as f32);
        }
        let nodes = layout_nodes();
        let unit = eye_distance(&nodes);
        let nostrils = NOSTRILS.map(|n| nodes[n]);
        let mask = detail::mask_of(&nodes, unit, SIZE, 0.0);
        let mut logs = detail::smooth(&logs, SIZE.0, SIZE.1, SMOOTHING);
        for (k, (log, share)) in logs.iter_mut().zip(&mask).enumerate() {
            let at = Point2::new(f64::from(k as u32 % SIZE.0), f64::from(k as u32 / SIZE.0));
            let off = (-inside_depth(&nostrils, &at) / (NOSTRIL_ROOM * unit)).clamp(0.0, 1.0) as f32;
            let darker = if *log < 0.0 { DARKER } else { 1.0 };
            *log = (*log * darker * share * off).clamp(-SKIN_LOG_LIMIT, SKIN_LOG_LIMIT);
        }
        let raised = RAISED.iter().filter_map(|&n| offsets.get(n)).map(|off| off.y).sum::<f64>() / RAISED.len() as f64;
        let folded = smooth_step(FOLDS.0, FOLDS.1, raised) as f32;
        if folded > 0.0
            && let Some(smile) = smile()
        {
            for (k, (log, smiling)) in logs.iter_mut().zip(smile).enumerate() {
                *log += (smiling * OF_SMILE * above_mouth(k) - *log) * folded * cheek(k);
            }
        }
        Ok(Self { logs, people: 0, lighter: LIGHTER })
    }
}

/// Logarithms of the skin change in smiles; `None` if the picture cannot be decoded.
fn smile() -> Option<&'static [f32]> {
    static LOGS: OnceLock<Option<Vec<f32>>> = OnceLock::new();
    let read = || {
        let picture = image::load_from_memory_with_format(SMILE, image::ImageFormat::Png).ok()?.to_luma8();
        (picture.dimensions() == SIZE).then(|| picture.as_raw().iter().map(|&level| log_of(level)).collect())
    };
    LOGS.get_or_init(read).as_deref()
}

/// Position of a pixel of the layout in units of the wireframe: distance from the midline, and height.
fn place(k: usize) -> (f64, f64) {
    let (x, y) = (f64::from(k as u32 % SIZE.0), f64::from(k as u32 / SIZE.0));
    (((x - ORIGIN.0) / SCALE).abs(), (ORIGIN.1 - y) / SCALE)
}

/// Smooth step from 0 at `from` to 1 at `to`; `to` may be below `from`.
fn share((from, to): (f64, f64), at: f64) -> f64 {
    smooth_step(0.0, 1.0, (at - from) / (to - from))
}

/// Weight of the fold at a pixel of the layout, 0 to 1.
fn above_mouth(k: usize) -> f32 {
    share(ABOVE_MOUTH, place(k).1) as f32
}

/// Weight of a pixel of the layout as cheek, 0 to 1.
fn cheek(k: usize) -> f32 {
    let (x, y) = place(k);
    (share(BESIDE_NOSE, x) * share(OUTWARDS, x) * share(BELOW_EYES, y) * share(ABOVE_CHIN, y)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Face;

    /// Shading at an offset from a node of the layout, in units of Candide-3.
    fn at(skin: &Skin, node: usize, off: (f64, f64)) -> f32 {
        let p = layout_nodes()[node] + Vector2::new(off.0, -off.1) * SCALE;
        skin.logs[(p.y.round() as u32 * SIZE.0 + p.x.round() as u32) as usize]
    }

    #[test]
    fn a_smile_has_its_folds_beside_the_nose_and_a_still_face_none() {
        let face = Face::candide3();
        let mut smile = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &face).unwrap();
        let skin = Skin::of_form(&smile).unwrap();
        // Between the wing of the nose and the cheek.
        let fold = (-6..=6).map(|k| at(&skin, 26, (0.02 * f64::from(k), -0.08))).fold(f32::INFINITY, f32::min);
        assert!(fold < -0.03, "{fold}");
        smile.offsets.iter_mut().flatten().for_each(|offset| *offset = Vector2::zeros());
        assert!(Skin::of_form(&smile).unwrap().logs.iter().all(|log| *log == 0.0));
    }

    #[test]
    fn a_raised_lip_has_the_fold_of_a_smile_and_a_lowered_one_has_not() {
        let mut motion = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &Face::candide3()).unwrap();
        let fold = 108 * SIZE.0 as usize + 89;
        let mut of_lip = |rise: f64| {
            let es = motion.fapus.es;
            motion.offsets.iter_mut().flatten().for_each(|offset| *offset = Vector2::zeros());
            let apex = motion.offsets.len() - 1;
            RAISED.iter().for_each(|&n| motion.offsets[apex][n].y = rise * es);
            Skin::of_form(&motion).unwrap().logs[fold]
        };
        let (raised, half, lowered) = (of_lip(0.10), of_lip(0.055), of_lip(-0.10));
        let expected = OF_SMILE * smile().unwrap()[fold] * above_mouth(fold);
        assert!((raised - expected).abs() < 1e-6, "{raised} {expected}");
        assert!(raised < -0.04 && (raised + 0.005..-0.01).contains(&half) && lowered > -0.05, "{raised} {half} {lowered}");
        // Not on the nose, on the forehead or on the chin.
        assert!([(63, 105), (89, 40), (89, 168)].iter().all(|(x, y)| cheek(y * SIZE.0 as usize + x) == 0.0));
    }
}
