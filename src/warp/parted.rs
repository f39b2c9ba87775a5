//! Detects where teeth begin and end between the lips of a mouth that is open on its photograph. Everything above the lower lip moves with the
//! skull; a dropping lip would reveal any error as a rim of teeth or of lip. Marks are not exact enough, and few of them say nothing about the
//! gap between the lips.

use nalgebra::Point2;

use super::{
    Texture,
    layout::{CLOSED_GAP, Frame},
    mouth::{luma, whiteness},
};
use crate::locate::{LIP_LINES, redness, steps_to_teeth};

/// Number of positions on a line from its first to its last node.
const PLACES: usize = 64;
/// Half the width that is averaged at each, in eye distances.
const HALF_WIDTH: f64 = 0.012;
/// Least detectable difference in whiteness between teeth and lip, levels.
const LEAST: f32 = 18.0;
/// Brightness relative to the lip below which a gap is detected between teeth and lip; the upper edge of a lip with a glistening middle is brighter.
const GAP_LIGHT: f32 = 0.45;
/// Redness where the lip begins, as a share of the way from the teeth's to the lip's, and brightness over the lip's. `LEAST_RED`: least
/// detectable difference in redness. Chosen by eye on 43 smiles of the London Set that show teeth.
const LIP_RED: f32 = 0.6;
const LIP_LIGHT: f32 = 0.75;
const LEAST_RED: f32 = 0.15;
/// Largest shift of an edge upwards and downwards, in eye distances.
const REACH: (f64, f64) = (0.05, 0.11);

/// Moves the lips' edges apart where the photograph shows teeth beyond the inner ones, as those of a smile between lips that were fitted
/// closed. Nodes for which `is_set` returns true were placed by a person and stay.
pub fn part_lips(nodes: &mut [Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool, frame: &Frame) {
    let lips = LIP_LINES.map(|line| line.map(|node| nodes[usize::from(node.0)]));
    // The kernel may overshoot below black.
    let colour = |at: Point2<f64>| Some(photograph.sample(at).map(|level| f64::from(level.max(0.0))));
    let Some(steps) = steps_to_teeth(&lips, frame.eye_distance, colour) else { return };
    for (line, steps) in LIP_LINES.iter().zip(steps) {
        line.iter().zip(steps).filter(|(node, _)| !is_set(node.0)).for_each(|(node, step)| nodes[usize::from(node.0)] += step);
    }
}

/// Moves the lower lip's inner edge to where the photograph shows it. Nodes for which `is_set` returns true were placed by a person and stay.
pub fn place_lower_lip(nodes: &mut [Point2<f64>], photograph: &Texture, is_set: impl Fn(u16) -> bool, frame: &Frame) {
    let lines = LIP_LINES.map(|line| line.map(|node| usize::from(node.0)));
    let [_, upper, lower, _] = lines[1].map(|n| frame.height(&nodes[n]));
    if lower - upper < CLOSED_GAP * frame.eye_distance {
        return;
    }
    for [_, upper, lower, end] in lines {
        if is_set(lower as u16) {
            continue;
        }
        let line = [nodes[upper], nodes[lower], nodes[end]];
        if let Some(at) = edge(line, photograph, frame) {
            nodes[lower] = at;
        }
    }
}

/// What is seen at a position across the lips: whiteness and brightness in levels, and redness as the logarithm of red over green.
#[derive(Clone, Copy, Debug)]
struct Seen {
    whiteness: f32,
    light: f32,
    red: f32,
}

/// The point on the line from the upper lip through the lower one at which teeth end and the lip begins.
fn edge([start, found, end]: [Point2<f64>; 3], photograph: &Texture, frame: &Frame) -> Option<Point2<f64>> {
    let way = end - start;
    let length = way.norm();
    let across = frame.across() * (HALF_WIDTH * frame.eye_distance);
    let at = |k: usize| start + way * (k as f64 / (PLACES - 1) as f64);
    let values: Vec<Seen> = (0..PLACES)
        .map(|k| {
            let seen = [-1.0, 0.0, 1.0].map(|side| photograph.sample(at(k) + across * side));
            let mean: [f32; 3] = std::array::from_fn(|c| seen.iter().map(|colour| colour[c]).sum::<f32>() / 3.0);
            let whiteness = seen.iter().map(|colour| whiteness(*colour)).sum::<f32>() / 3.0;
            // The kernel may overshoot below black.
            let [red, green] = [mean[0], mean[1]].map(|level| f64::from(level.max(0.0)));
            Seen { whiteness, light: luma(mean), red: redness(red, green) as f32 }
        })
        .collect();
    let place = ((found - start).dot(&way) / (length * length).max(1e-9)).clamp(0.0, 1.0);
    let k = lip_by_colour(&values, place).or_else(|| teeth_end(&values, place))?;
    let shift = (k as f64 / (PLACES - 1) as f64 - place) * length / frame.eye_distance;
    (-REACH.0..=REACH.1).contains(&shift).then(|| at(k))
}

/// Index of the first position that is as red as a lip and no dark gap. Below upper teeth and a gap, lower teeth may follow, which are as bright
/// as a lip. `None` without a difference in colour.
fn lip_by_colour(line: &[Seen], found: f64) -> Option<usize> {
    let last = line.len().checked_sub(1)?;
    let found = (found * last as f64).round() as usize;
    let (above, below) = (line.get(..=found)?, line.get(found..)?);
    let tooth = quantile(above.iter().map(|seen| seen.red), 0.25)?;
    let lip = quantile(below.iter().map(|seen| seen.red), 0.9)?;
    let light = LIP_LIGHT * quantile(below.iter().map(|seen| seen.light), 0.25)?;
    if lip - tooth < LEAST_RED {
        return None;
    }
    let red = tooth + LIP_RED * (lip - tooth);
    let least_red = above.iter().enumerate().min_by(|a, b| a.1.red.total_cmp(&b.1.red)).map(|(k, _)| k)?;
    let is_lip = |seen: &Seen| seen.red > red && seen.light > light;
    line.windows(3).enumerate().skip(least_red).find(|(_, three)| three.iter().all(is_lip)).map(|(k, _)| k)
}

/// Index of the first position of the lip below the teeth. `line` has the positions from the upper lip's lower edge to the lower lip's lower
/// edge; `found` is the fraction at which the fit has the lower lip begin.
fn teeth_end(line: &[Seen], found: f64) -> Option<usize> {
    let last = line.len().checked_sub(1)?;
    let values: Vec<f32> = line.iter().map(|seen| seen.whiteness).collect();
    let lights: Vec<f32> = line.iter().map(|seen| seen.light).collect();
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

/// Value below which a share of the values lies; `None` for none.
fn quantile(values: impl Iterator<Item = f32>, share: f64) -> Option<f32> {
    let mut values: Vec<f32> = values.collect();
    values.sort_by(f32::total_cmp);
    values.get((values.len().saturating_sub(1) as f64 * share).round() as usize).copied()
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::warp::test_face::nodes;

    /// A line of 64 positions: teeth of 200 up to a position, then a gap, then lip of 100.
    fn line(teeth: usize, gap: usize) -> Vec<Seen> {
        let level = |k: usize| match k {
            k if k < teeth => 200.0,
            k if k < teeth + gap => 20.0,
            _ => 100.0,
        };
        (0..64).map(|k| grey(level(k), level(k))).collect()
    }

    fn grey(whiteness: f32, light: f32) -> Seen {
        Seen { whiteness, light, red: 0.1 }
    }

    #[test]
    fn a_lip_begins_below_the_lower_teeth_where_it_is_red() {
        // Upper teeth, a dark gap, lower teeth, and a lip.
        let seen = |k: usize| match k {
            0..24 => Seen { red: 0.1, ..grey(150.0, 170.0) },
            24..28 => Seen { red: 0.4, ..grey(30.0, 40.0) },
            28..34 => Seen { red: 0.2, ..grey(110.0, 130.0) },
            _ => Seen { red: 0.5, ..grey(60.0, 110.0) },
        };
        let line: Vec<Seen> = (0..64).map(seen).collect();
        for found in [0.3, 0.4, 0.5, 0.6] {
            assert_eq!(lip_by_colour(&line, found), Some(34), "{found}");
        }
        // The lip of a grey photograph is not red.
        assert_eq!(lip_by_colour(&self::line(26, 4), 0.4), None);
        assert_eq!(lip_by_colour(&[], 0.4), None);
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
        shiny[40..44].fill(grey(210.0, 210.0));
        assert_eq!(teeth_end(&shiny, 0.4), Some(26));
        // The red edge of a lip with a glistening middle is not a gap.
        let mut glistens = line(26, 4);
        glistens[26..30].fill(grey(20.0, 70.0));
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
        assert_eq!(teeth_end(&[grey(100.0, 100.0); 64], 0.4), None);
        assert_eq!(teeth_end(&line(0, 20), 0.4), None);
        assert_eq!(teeth_end(&[], 0.4), None);
    }
}
