//! Irises of a drawn face, before and after its lids moved.

use std::f64::consts::TAU;

use image::{Rgb, RgbImage};

use super::*;
use crate::{
    geometry::polygon::inside,
    warp::test_face::{self, EYES, nodes},
    warp::{MouthInside, NODE_COUNT, mouth::luma},
};

/// Offset of its irises from the middle of their nodes, px, and their size, in eye distances.
const BESIDE: Vector2<f64> = Vector2::new(3.0, 1.0);
const DRAWN: f64 = 0.097;
const SKIN: [f64; 3] = [205.0, 160.0, 140.0];
const WHITE: [f64; 3] = [232.0, 228.0, 224.0];
const IRIS: [f64; 3] = [88.0, 66.0, 52.0];
/// Number of directions in which an outline is measured.
const ANGLES: usize = 72;

fn centre(nodes: &[Point2<f64>], eye: usize) -> Point2<f64> {
    let iris = OPENINGS[eye].iris;
    Point2::from(iris.iter().map(|&n| nodes[usize::from(n)].coords).sum::<Vector2<f64>>() / iris.len() as f64)
}

/// Skin, with a white between the lids that holds a round iris and a pupil; edges are one pixel soft.
fn drawn(nodes: &[Point2<f64>]) -> RgbImage {
    let warp = test_face::warp();
    let outlines: Vec<Vec<Point2<f64>>> = warp.mesh.openings[1..]
        .iter()
        .map(|o| o.upper.iter().chain(o.lower.iter().rev()).map(|&v| warp.source[v as usize]).collect())
        .collect();
    RgbImage::from_fn(300, 380, |x, y| {
        let at = Point2::new(f64::from(x), f64::from(y));
        let Some(eye) = outlines.iter().position(|o| inside(o, &at)) else { return Rgb(SKIN.map(|c| c as u8)) };
        let distance = (at - centre(nodes, eye + 1) - BESIDE).norm();
        let share = |radius: f64| (radius - distance + 0.5).clamp(0.0, 1.0);
        let (iris, pupil) = (share(DRAWN * EYES), share(0.4 * DRAWN * EYES));
        Rgb(std::array::from_fn(|c| ((WHITE[c] + (IRIS[c] - WHITE[c]) * iris) * (1.0 - 0.8 * pupil)) as u8))
    })
}

/// Circle fitted to points (I. Kasa's least squares): centre and radius.
fn circle(points: &[Point2<f64>]) -> (Point2<f64>, f64) {
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let origin = points[0];
    for p in points.iter().map(|p| p - origin) {
        let row = Vector3::new(2.0 * p.x, 2.0 * p.y, 1.0);
        normal += row * row.transpose();
        right += row * p.norm_squared();
    }
    let found = normal.lu().solve(&right).unwrap();
    let centre = Vector2::new(found.x, found.y);
    (origin + centre, (found.z + centre.norm_squared()).sqrt())
}

/// Largest deviation of an iris' outline from the fitted circle, relative to its radius, and the fraction of directions in which it is visible
/// between the lids.
fn roundness(warp: &Warp, frame: &RgbImage, deformation: &super::super::Deformation, eye: usize, at: Point2<f64>) -> (f64, f64) {
    let opening = &warp.mesh.openings[eye];
    let lids: Vec<Point2<f64>> =
        opening.upper.iter().chain(opening.lower.iter().rev()).map(|&v| deformation.vertices[v as usize]).collect();
    let texture = Texture::new(frame);
    let level = |p: Point2<f64>| f64::from(luma(texture.sample(p)));
    let half = f64::midpoint(f64::from(luma(WHITE.map(|c| c as f32))), f64::from(luma(IRIS.map(|c| c as f32))));
    let expected = DRAWN * EYES;
    let mut outline = Vec::new();
    for k in 0..ANGLES {
        let angle = TAU * k as f64 / ANGLES as f64;
        let direction = Vector2::new(angle.cos(), angle.sin());
        let free = |r: f64| {
            let p = at + direction * r;
            let mut closed = lids.clone();
            closed.push(lids[0]);
            inside(&lids, &p) && distance_to_line(&closed, &p) > 2.5
        };
        if !free(expected * 1.25) {
            continue;
        }
        let mut radius = 0.5 * expected;
        while radius < 2.0 * expected && level(at + direction * radius) < half {
            radius += 0.1;
        }
        outline.push(at + direction * radius);
    }
    if outline.len() < 6 {
        return (0.0, 0.0);
    }
    let (middle, radius) = circle(&outline);
    let deviation = |p: &Point2<f64>| ((p - middle).norm() / radius - 1.0).abs();
    let worst = outline.iter().map(deviation).fold((radius / expected - 1.0).abs(), f64::max);
    (worst, outline.len() as f64 / ANGLES as f64)
}

/// The nodes with the lids moved down by so many eye distances, except for the corners, and the irises moved by a gaze.
fn moved(upper: f64, lower: f64, corners: f64, gaze: Vector2<f64>) -> Vec<Point2<f64>> {
    let mut nodes = nodes();
    for eye in &OPENINGS[1..] {
        for k in 1..4 {
            nodes[usize::from(eye.upper[k])].y += upper * EYES;
            nodes[usize::from(eye.lower[k])].y += lower * EYES;
        }
        let (outer, inner) = (usize::from(eye.upper[0]), usize::from(eye.upper[4]));
        let apart = (nodes[outer] - nodes[inner]).normalize() * (corners * EYES);
        nodes[outer] += apart;
        eye.iris.iter().for_each(|&n| nodes[usize::from(n)] += gaze * EYES);
    }
    nodes
}

#[test]
fn a_drawn_iris_is_found_where_it_is() {
    let picture = drawn(&nodes());
    let warp = test_face::warp().with_eyes(&Texture::new(&picture));
    for (k, found) in warp.irises().into_iter().enumerate() {
        let (at, radius) = found.unwrap();
        assert!((at - centre(&nodes(), k + 1) - BESIDE).norm() < 0.012 * EYES, "{at} {radius}");
        assert!((radius / (DRAWN * EYES) - 1.0).abs() < 0.06, "{radius}");
    }
    assert_eq!(nodes().len(), NODE_COUNT);
    let plain = RgbImage::from_pixel(300, 380, Rgb([200; 3]));
    assert_eq!(test_face::warp().with_eyes(&Texture::new(&plain)).irises(), [None, None]);
}

#[test]
fn irises_stay_round_within_a_tenth_when_lids_open_narrow_and_squint_and_the_gaze_turns() {
    let picture = drawn(&nodes());
    let texture = Texture::new(&picture);
    let plain = test_face::warp();
    let warp = plain.clone().with_eyes(&texture);
    let none = Vector2::zeros();
    let motions = [
        ("wide", -0.09, 0.04, 0.0, none, 0.4),
        ("raised", -0.06, 0.0, 0.01, none, 0.3),
        ("narrow", 0.012, 0.0, 0.0, none, 0.08),
        ("squint", 0.006, -0.006, -0.02, none, 0.08),
        ("to the side", -0.03, 0.01, 0.0, Vector2::new(0.05, 0.0), 0.15),
        ("down", -0.05, 0.05, 0.0, Vector2::new(-0.02, 0.04), 0.2),
    ];
    let mut shields = 0;
    for (name, upper, lower, corners, gaze, least) in motions {
        let asked = moved(upper, lower, corners, gaze);
        let deformation = warp.deform(&asked).unwrap();
        let frame = warp.render(&texture, &deformation, &MouthInside::Dark);
        let before = plain.render(&texture, &deformation, &MouthInside::Dark);
        for eye in [1, 2] {
            let goes = centre(deformation.nodes(), eye) - centre(&nodes(), eye);
            assert!((goes - gaze * EYES).norm() < 0.5, "{name}: the iris goes by {goes}");
            let at = centre(&nodes(), eye) + BESIDE + goes;
            let (worst, seen) = roundness(&warp, &frame, &deformation, eye, at);
            assert!(seen >= least, "{name}, eye {eye}: only {seen} of the outline shows");
            assert!(worst < 0.10, "{name}, eye {eye}: {worst} from a circle");
            shields += usize::from(roundness(&plain, &before, &deformation, eye, at).0 > 0.10);
        }
    }
    // Without the layer the lids pull the iris along.
    assert!(shields >= 2, "{shields}");
}

#[test]
fn eyes_that_do_not_move_are_the_photograph_to_the_bit() {
    let picture = drawn(&nodes());
    let texture = Texture::new(&picture);
    let warp = test_face::warp().with_eyes(&texture);
    let mut smile = nodes();
    smile[31] += Vector2::new(6.0, -5.0);
    let frame = warp.render(&texture, &warp.deform(&smile).unwrap(), &MouthInside::Dark);
    let eye = centre(&nodes(), 1);
    for (dx, dy) in [(0.0, 0.0), (8.0, 0.0), (-12.0, 1.0), (0.0, -4.0)] {
        let (x, y) = ((eye.x + dx) as u32, (eye.y + dy) as u32);
        let (a, b) = (frame.get_pixel(x, y).0, picture.get_pixel(x, y).0);
        assert!(a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) <= 3), "{a:?} {b:?}");
    }
}

#[test]
fn the_wet_edge_of_a_lower_lid_that_drops_a_little_is_not_trusted_and_the_eye_above_it_is() {
    let line = |y: f64, opened: f64| [0.0, 40.0].map(|x| (Point2::new(x, y), opened)).to_vec();
    let at = |lower: f64, depth: f64| {
        let turned = Turned::new(Similarity::identity(), Vector2::zeros(), Vec::new(), [line(0.0, 0.0), line(14.0, lower)]);
        turned.trust(Point2::new(20.0, 14.0 - depth), depth, 110.0)
    };
    // 0.6 px of 110 between the eyes.
    assert!(at(0.0055, 0.5) < 0.4 && at(0.0055, 3.0) > 0.99, "{} {}", at(0.0055, 0.5), at(0.0055, 3.0));
    assert_eq!([at(0.0, 0.5), at(-0.02, 0.5)], [1.0; 2]);
}
