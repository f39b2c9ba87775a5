//! Draws the inside of the mouth where the lips part.

use nalgebra::{Point2, Vector3};

use super::{motion::HeadPose, noise, render::Samples, subject::Subject};

/// Nodes of the inner upper lip, and (`LOWER`) of the lower one, from the subject's left corner to the right.
const UPPER: [usize; 5] = [88, 81, 87, 82, 89];
const LOWER: [usize; 5] = [88, 83, 40, 84, 89];
/// Right edges of the upper teeth from the midline, model units: incisors, canine, premolars.
const TOOTH_EDGES: [f64; 6] = [0.052, 0.094, 0.135, 0.170, 0.200, 0.225];
/// Length of the incisors below the lip line at rest, model units.
const TEETH_BELOW_LINE: f64 = 0.040;

/// Draws the inside of the mouth into the opening between the lips.
pub fn draw_mouth(samples: &mut Samples, subject: &Subject, offsets: &[Vector3<f64>], pose: &HeadPose) {
    let place = |n: usize| pose.project(&(subject.neutral()[n] + offsets[n]));
    let (upper, lower) = (UPPER.map(place), LOWER.map(place));
    let Some(plane_from_image) = pose.image_from_plane().try_inverse() else { return };
    // Upper teeth are fixed to the skull, relative to the lip line at rest. The tongue moves down with the jaw.
    let rest = subject.neutral()[87];
    let origin = pose.project(&rest);
    let drop = -offsets[40].y;
    let local = |p: Point2<f64>| plane_from_image * (p - origin);
    let upper_lip = upper.map(local);
    let height_at = |lip: &[nalgebra::Vector2<f64>; 5], x: f64| {
        lip.windows(2)
            .find(|w| x <= w[0].x && x >= w[1].x)
            .map(|w| w[1].y + (w[0].y - w[1].y) * (x - w[1].x) / (w[0].x - w[1].x).max(1e-9))
    };
    let mut all = upper.to_vec();
    all.extend(lower);
    let (columns, rows) = samples.window(&all, 4.0);
    for y in rows {
        for x in columns.clone() {
            if samples.data[y * samples.width + x][3] > 0 {
                continue;
            }
            let p = local(Samples::to_image(x, y));
            let below_lip = height_at(&upper_lip, p.x).map_or(0.0, |lip| lip - p.y);
            let colour = inside(p.x, p.y, drop, below_lip.max(0.0), subject.appearance().noise);
            samples.lay(x, y, 1.0, colour.map(|c| c * 255.0));
        }
    }
}

/// Returns the colour at a position relative to the middle of the lip line at rest (model units).
fn inside(x: f64, y: f64, drop: f64, below_lip: f64, seed: u32) -> [f32; 3] {
    let side = (1.0 - (x / 0.21).powi(2)).clamp(0.0, 1.0);
    let mut colour = [0.13, 0.045, 0.045].map(|c: f64| c * (0.5 + 0.5 * side));
    let mut mix = |over: [f64; 3], share: f64| {
        for (c, o) in colour.iter_mut().zip(over) {
            *c += (o - *c) * share.clamp(0.0, 1.0);
        }
    };
    // The tongue moves with the jaw.
    let jaw_y = y + drop;
    let tongue = 1.0 - ((x / 0.13).powi(2) + ((jaw_y - 0.01) / 0.075).powi(2));
    let grain = f64::from(noise::value(x as f32 * 90.0, y as f32 * 90.0, seed ^ 0x71)) * 0.05;
    mix([0.52 + grain, 0.25 + grain, 0.25 + grain], (tongue * 2.5).min(0.75));
    // The upper teeth move with the skull; their edge rises to the sides.
    let upper_edge = -TEETH_BELOW_LINE + 0.55 * x * x + 0.006 * (1.0 - tooth(x, seed ^ 1));
    let upper_teeth = ((y - upper_edge) / 0.005 + 0.5).clamp(0.0, 1.0) * ((0.215 - x.abs()) / 0.02).clamp(0.0, 1.0);
    let shade = (0.35 + 0.65 * side) * tooth(x, seed) * (0.58 + 0.42 * (below_lip / 0.03).min(1.0));
    mix([0.93 * shade, 0.90 * shade, 0.83 * shade], upper_teeth);
    // The gums above the teeth.
    let gum = ((y - 0.045 + 0.2 * x * x) / 0.008).clamp(0.0, 1.0);
    mix([0.66 * side, 0.36 * side, 0.36 * side], gum * 0.9);
    colour.map(|c| c as f32)
}

/// Returns the brightness across a row of teeth: 1 on a tooth, darker in the gaps.
fn tooth(x: f64, seed: u32) -> f64 {
    let x = x.abs();
    let gap = std::iter::once(0.0).chain(TOOTH_EDGES).map(|edge| (x - edge).abs()).fold(f64::INFINITY, f64::min);
    let tone = f64::from(noise::value(x as f32 * 24.0, 0.5, seed ^ 0x72)) * 0.03;
    (1.0 + tone) * (1.0 - 0.42 * (-(gap / 0.0045).powi(2)).exp())
}
