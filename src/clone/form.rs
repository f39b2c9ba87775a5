//! Folds of a motion for which no pictures are at hand: those that its form makes ([`crate::synthesis`]' embedded head, bent as the nodes go).

use nalgebra::{Point2, Vector2};

use super::{
    CloneError, Skin, SourceMotion, detail,
    skin::{NOSTRILS, ORIGIN, SCALE, SIZE, SKIN_LOG_LIMIT, eye_distance, layout_nodes},
};
use crate::{geometry::polygon::inside_depth, synthesis::Relief, warp::fill_triangle};

/// Share of what grows lighter that a clone shows: half of what 90 people's smiling cheeks do, for there it is one soft light, and here a wedge.
const LIGHTER: f32 = 0.25;
/// By how much what is darker is darker than the form of a head tells, which has hollows and no folds. People who smile have a logarithm of -0.20 in
/// the darkest fiftieth beside the mouth, the form alone -0.09; twice as dark as that it looks like smears, for it is wider than a fold.
const DARKER: f32 = 1.5;
/// Smoothing of what is drawn triangle by triangle, px of the layout.
const SMOOTHING: f64 = 1.8;
/// Room around the nostrils, over the eye distance.
const NOSTRIL_ROOM: f64 = 0.06;

impl Skin {
    /// The folds that the form of an average head makes in the strongest frame of a motion.
    ///
    /// # Errors
    /// [`CloneError::Bank`] never for the head that is compiled in.
    pub fn of_form(motion: &SourceMotion) -> Result<Self, CloneError> {
        let relief = Relief::shipped()?;
        let offsets: Vec<Vector2<f64>> = motion.offsets[motion.apex()].iter().map(|o| o / motion.fapus.es).collect();
        let shading = relief.shading(&offsets);
        let place = |v: usize| {
            let p = relief.places()[v];
            Point2::new(ORIGIN.0 + SCALE * p.x, ORIGIN.1 - SCALE * p.y)
        };
        let mut logs = vec![0.0_f32; (SIZE.0 * SIZE.1) as usize];
        for triangle in relief.triangles() {
            let values = triangle.map(|v| Point2::new(f64::from(shading[v]), 0.0));
            fill_triangle(triangle.map(place), values, SIZE, |x, y, at| logs[(y * SIZE.0 + x) as usize] = at.x as f32);
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
        Ok(Self { logs, people: 0, lighter: LIGHTER })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Face;

    /// Shading at a node of the layout, and so far from it, in units of Candide-3.
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
}
