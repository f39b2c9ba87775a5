//! Detects where teeth begin and end between the lips of a mouth that is open on its photograph. Everything above the lower lip moves with the
//! skull; a dropping lip would reveal any error as a rim of teeth or of lip. Marks are not exact enough, and few of them say nothing about the
//! gap between the lips.

use nalgebra::Point2;

use super::{
    Texture,
    layout::{CLOSED_GAP, Frame},
    mouth::{luma, whiteness},
};
use crate::locate::{LIP_LINES, steps_to_teeth};

/// Nodes on three lines across the lips: the upper lip's lower edge, and the lower lip's upper and lower edge.
const LINES: [[usize; 3]; 3] = [[81, 83, 85], [87, 40, 8], [82, 84, 86]];

/// Number of positions on a line from its first to its last node.
const PLACES: usize = 64;
/// Half the width that is averaged at each, in eye distances.
const HALF_WIDTH: f64 = 0.012;
/// Least detectable difference in whiteness between teeth and lip, levels.
const LEAST: f32 = 18.0;
/// Brightness relative to the lip below which a gap is detected between teeth and lip; the upper edge of a lip with a glistening middle is brighter.
const GAP_LIGHT: f32 = 0.45;
/// Largest shift of an edge upwards and downwards, in eye distances.
const REACH: (f64, f64) = (0.05, 0.11);

/// Moves the lips' edges apart where the photograph shows teeth beyond the inner ones, as those of a smile between lips that were fitted
/// closed. Nodes for which `is_set` returns true were placed by a person and stay.
pub fn part_lips(nodes: &mut [Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool, frame: &Frame) {
    let lips = LIP_LINES.map(|line| line.map(|node| nodes[usize::from(node.0)]));
    let colour = |at: Point2<f64>| Some(photograph.sample(at).map(f64::from));
    let Some(steps) = steps_to_teeth(&lips, frame.eye_distance, colour) else { return };
    for (line, steps) in LIP_LINES.iter().zip(steps) {
        line.iter().zip(steps).filter(|(node, _)| !is_set(node.0)).for_each(|(node, step)| nodes[usize::from(node.0)] += step);
    }
}

/// Moves the lower lip's inner edge to where the photograph shows it. Nodes for which `is_set` returns true were placed by a person and stay.
pub fn place_lower_lip(nodes: &mut [Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool, frame: &Frame) {
    let [upper, lower, _] = LINES[1].map(|n| frame.height(&nodes[n]));
    if lower - upper < CLOSED_GAP * frame.eye_distance {
        return;
    }
    for [upper, lower, end] in LINES {
        if is_set(lower as u16) {
            continue;
        }
        let line = [nodes[upper], nodes[lower], nodes[end]];
        if let Some(at) = edge(line, photograph, frame) {
            nodes[lower] = at;
        }
    }
}

/// The point on the line from the upper lip through the lower one at which teeth end and the lip begins.
fn edge([start, found, end]: [Point2<f64>; 3], photograph: &Texture, frame: &Frame) -> Option<Point2<f64>> {
    let way = end - start;
    let length = way.norm();
    let across = frame.across() * (HALF_WIDTH * frame.eye_distance);
    let at = |k: usize| start + way * (k as f64 / (PLACES - 1) as f64);
    let values: Vec<[f32; 2]> = (0..PLACES)
        .map(|k| {
            let seen = [-1.0, 0.0, 1.0].map(|side| photograph.sample(at(k) + across * side));
            [whiteness, luma].map(|of| seen.iter().map(|colour| of(*colour)).sum::<f32>() / 3.0)
        })
        .collect();
    let place = ((found - start).dot(&way) / (length * length).max(1e-9)).clamp(0.0, 1.0);
    let k = teeth_end(&values, place)?;
    let shift = (k as f64 / (PLACES - 1) as f64 - place) * length / frame.eye_distance;
    (-REACH.0..=REACH.1).contains(&shift).then(|| at(k))
}

/// Index of the first position of the lip below the teeth. `line` holds whiteness and brightness at positions from the upper lip's lower edge to the
/// lower lip's lower edge; `found` is the fraction at which the fit has the lower lip begin.
fn teeth_end(line: &[[f32; 2]], found: f64) -> Option<usize> {
    let last = line.len().checked_sub(1)?;
    let [values, lights] = [0, 1].map(|of| line.iter().map(|place| place[of]).collect::<Vec<f32>>());
    let found = (found * last as f64).round() as usize;
    let (teeth, lip) = (values.get(..=found)?, values.get(usize::midpoint(found, last)..last)?);
    let brightest = teeth.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map(|(k, _)| k)?;
    let half = median(teeth.iter().copied());
    let (tooth, lip) = (median(teeth.iter().copied().filter(|v| *v >= half)), median(lip.iter().copied()));
    let lip_light = median(lights[usize::midpoint(found, last)..last].iter().copied());
    if tooth - lip < LEAST {
        return None;
    }
    let between = 0.5 * (tooth + lip);
    let falls = |k: &usize| values[*k..(*k + 3).min(values.len())].iter().all(|v| *v < between);
    let fallen = (brightest..last).find(falls)?;
    // Anything darker than the lip is a gap between the two.
    let dark = lip - 0.35 * (tooth - lip);
    let gap = (fallen..last.min(fallen + values.len() / 8)).find(|&k| values[k] < dark && lights[k] < GAP_LIGHT * lip_light);
    match gap {
        Some(k) => (k..last).find(|&k| values[k] >= lip - 0.15 * (tooth - lip)),
        None => Some(fallen),
    }
}

fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::warp::test_face::nodes;

    /// A line of 64 positions: teeth of 200 up to a position, then a gap, then lip of 100.
    fn line(teeth: usize, gap: usize) -> Vec<[f32; 2]> {
        let level = |k: usize| match k {
            k if k < teeth => 200.0,
            k if k < teeth + gap => 20.0,
            _ => 100.0,
        };
        (0..64).map(|k| [level(k); 2]).collect()
    }

    #[test]
    fn teeth_end_where_the_lip_begins_whatever_was_found() {
        for found in [0.3, 0.4, 0.5] {
            assert_eq!(teeth_end(&line(26, 0), found), Some(26));
        }
        // A dark gap belongs to the mouth.
        assert_eq!(teeth_end(&line(26, 4), 0.4), Some(30));
        // A highlight on the lip is not a tooth.
        let mut shiny = line(26, 0);
        shiny[40..44].fill([210.0; 2]);
        assert_eq!(teeth_end(&shiny, 0.4), Some(26));
        // The red edge of a lip with a glistening middle is not a gap.
        let mut glistens = line(26, 4);
        glistens[26..30].fill([20.0, 70.0]);
        assert_eq!(teeth_end(&glistens, 0.4), Some(26));
    }

    #[test]
    fn lips_fitted_closed_on_teeth_are_parted() {
        let neutral = nodes();
        let frame = Frame::of(&neutral).unwrap();
        let [above, line, below] = [7, 87, 8].map(|n| neutral[n].y);
        let half = 0.04 * frame.eye_distance;
        let drawn = |between: [u8; 3]| {
            Texture::new(&RgbImage::from_fn(300, 380, |x, y| {
                let (x, y) = (f64::from(x), f64::from(y));
                let mouth = (neutral[64].x..neutral[31].x).contains(&x);
                Rgb(match y {
                    y if mouth && (y - line).abs() < half => between,
                    y if mouth && (above..below + half).contains(&y) => [150, 80, 80],
                    _ => [180, 140, 120],
                })
            }))
        };
        let parted = |between: [u8; 3], is_set: fn(u16) -> bool| {
            let mut nodes = neutral.clone();
            part_lips(&mut nodes, &drawn(between), is_set, &frame);
            nodes
        };
        let teeth = [200, 195, 180];
        let nodes = parted(teeth, |_| false);
        for [upper, lower] in [[81, 83], [87, 40], [82, 84]] {
            // Teeth are read in steps of 0.0125 eye distances.
            assert!((nodes[lower].y - nodes[upper].y - 2.0 * half).abs() < 0.025 * frame.eye_distance, "{upper}");
        }
        let set = parted(teeth, |n| n == 87 || n == 40);
        assert!(set[87] == neutral[87] && set[40] == neutral[40] && set[81] != neutral[81]);
        // Lips that meet, or a dark gap.
        assert!([[150, 80, 80], [40, 25, 25]].iter().all(|between| parted(*between, |_| false) == neutral));
    }

    #[test]
    fn without_teeth_nothing_is_moved() {
        assert_eq!(teeth_end(&[[100.0; 2]; 64], 0.4), None);
        assert_eq!(teeth_end(&line(0, 20), 0.4), None);
        assert_eq!(teeth_end(&[], 0.4), None);
    }
}
