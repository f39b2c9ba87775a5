//! Gives the eyes of a dense head the colour of a portrait's irises.

use image::RgbImage;
use nalgebra::Point2;

use crate::{units::FeaturePoint, wireframe::Tables};

/// Radius of an iris, over the distance between the pupils: 11.7 mm of 63 mm is its diameter.
const RADIUS: f64 = 0.093;
/// Part of the iris whose colour counts, in radii: outside the largest pupil, inside the dark border.
const RING: (f64, f64) = (0.45, 0.80);
/// Largest distance above and below the pupil, in radii: lids and lashes cover the rest.
const BAND: f64 = 0.45;
/// Fewest pixels of both eyes that give a colour.
const FEWEST: usize = 12;
/// Brightest and darkest channel between which a vertex of an eye belongs to its iris, sRGB: beyond are the white and the pupil.
const IRIS: (u8, u8) = (20, 130);
/// Range of the brightness of a ring of the iris over that of the median ring.
const SHADES: (f64, f64) = (0.5, 1.25);

/// Returns the colour of the irises in a portrait with these nodes, px; `None` where they are too small. It is the median of every channel,
/// so a highlight does not count.
pub(super) fn iris_colour(portrait: &RgbImage, nodes: &[Point2<f64>], tables: &Tables) -> Option<[u8; 3]> {
    let pupil = |point: u8| {
        let of = tables.feature_point_nodes(FeaturePoint { group: 3, point })?;
        let places: Option<Vec<Point2<f64>>> = of.iter().map(|node| nodes.get(node.index()).copied()).collect();
        let places = places.filter(|places| !places.is_empty())?;
        Some(Point2::from(places.iter().map(|place| place.coords).sum::<nalgebra::Vector2<f64>>() / places.len() as f64))
    };
    let pupils = [pupil(5)?, pupil(6)?];
    let radius = RADIUS * (pupils[0] - pupils[1]).norm();
    let mut channels: [Vec<u8>; 3] = Default::default();
    for pupil in pupils {
        let (left, top) = ((pupil.x - radius).floor().max(0.0), (pupil.y - BAND * radius).floor().max(0.0));
        for y in top as u32..((pupil.y + BAND * radius).ceil().max(0.0) as u32).min(portrait.height()) {
            for x in left as u32..((pupil.x + radius).ceil().max(0.0) as u32).min(portrait.width()) {
                let offset = Point2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - pupil;
                if offset.y.abs() <= BAND * radius && (RING.0..=RING.1).contains(&(offset.norm() / radius)) {
                    channels.iter_mut().zip(portrait.get_pixel(x, y).0).for_each(|(channel, value)| channel.push(value));
                }
            }
        }
    }
    if channels[0].len() < FEWEST {
        return None;
    }
    Some(channels.map(|mut channel| {
        channel.sort_unstable();
        channel[channel.len() / 2]
    }))
}

/// Gives the irises among the vertices of the eyes a colour; lighter and darker rings stay so.
pub(super) fn colour_irises(colours: &mut [[u8; 3]], eyes: &[[u32; 3]], colour: [u8; 3]) {
    let light = |c: [u8; 3]| 0.299 * f64::from(c[0]) + 0.587 * f64::from(c[1]) + 0.114 * f64::from(c[2]);
    let mut of_iris: Vec<usize> = eyes.as_flattened().iter().map(|&v| v as usize).filter(|&v| v < colours.len()).collect();
    of_iris.sort_unstable();
    of_iris.dedup();
    of_iris.retain(|&v| (IRIS.0..=IRIS.1).contains(&colours[v].into_iter().max().unwrap_or(0)));
    let mut lights: Vec<f64> = of_iris.iter().map(|&v| light(colours[v])).collect();
    let Some(median) = crate::robust::median(&mut lights).filter(|median| *median > 0.0) else { return };
    for v in of_iris {
        let shade = (light(colours[v]) / median).clamp(SHADES.0, SHADES.1);
        colours[v] = colour.map(|c| (f64::from(c) * shade).round().min(255.0) as u8);
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::wireframe::Face;

    #[test]
    fn the_ring_between_pupil_and_border_gives_the_colour() {
        let tables = Face::candide3().tables;
        // Pupils 100 px apart: irises of 9.3 px, brown around a pupil of 3 px, under lids from 5 px on, with a highlight.
        let mut nodes = vec![Point2::origin(); 113];
        for (point, x) in [(5, 150.0), (6, 50.0)] {
            let of = tables.feature_point_nodes(FeaturePoint { group: 3, point }).unwrap();
            of.iter().for_each(|node| nodes[node.index()] = Point2::new(x, 40.0));
        }
        let portrait = RgbImage::from_fn(200, 80, |x, y| {
            let off = |pupil: f64| (f64::from(x) + 0.5 - pupil).hypot(f64::from(y) + 0.5 - 40.0);
            Rgb(match off(50.0).min(off(150.0)) {
                _ if (f64::from(y) + 0.5 - 40.0).abs() > 5.0 => [200, 150, 130],
                r if r < 3.0 => [5, 5, 5],
                r if r < 9.0 && x % 9 == 0 => [255, 255, 255],
                r if r < 9.0 => [90, 60, 30],
                _ => [230, 225, 220],
            })
        });
        assert_eq!(iris_colour(&portrait, &nodes, &tables), Some([90, 60, 30]));
        // Eyes 10 px apart have no iris to look at.
        let small: Vec<Point2<f64>> = nodes.iter().map(|node| node / 10.0).collect();
        assert_eq!(iris_colour(&portrait, &small, &tables), None);
        assert_eq!(iris_colour(&portrait, &nodes[..20], &tables), None);
    }

    #[test]
    fn rings_keep_their_shade_and_pupil_and_white_their_colour() {
        // Pupil, a dark, a middle and a light ring, white; and skin, which is no part of the eyes.
        let mut colours = [[10, 10, 12], [40; 3], [80; 3], [90; 3], [230; 3], [80; 3]];
        colour_irises(&mut colours, &[[0, 1, 2], [2, 3, 4]], [100, 60, 20]);
        assert_eq!(colours, [[10, 10, 12], [50, 30, 10], [100, 60, 20], [113, 68, 23], [230; 3], [80; 3]]);
    }
}
