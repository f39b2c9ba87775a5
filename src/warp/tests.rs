//! Tests with whole frames of a drawn face.

use std::sync::LazyLock;

use image::{Rgb, RgbImage};
use proptest::prelude::*;

use super::*;
use crate::wireframe::Wireframe;

/// Candide-3 with 49 px between the eyes.
fn face() -> Vec<Point2<f64>> {
    Wireframe::candide3().vertices().iter().map(|v| Point2::new(100.0 + 80.0 * v.x, 110.0 - 80.0 * v.y)).collect()
}

/// Its warp, made once for all tests.
fn warp() -> &'static Warp {
    static WARP: LazyLock<Warp> = LazyLock::new(|| Warp::new(&face()).unwrap());
    &WARP
}

fn photograph() -> RgbImage {
    RgbImage::from_fn(200, 230, |x, y| Rgb([(x * 5 % 256) as u8, (y * 3 % 256) as u8, ((x * y) % 251) as u8]))
}

#[test]
fn a_still_face_is_the_photograph_to_the_bit() {
    let warp = warp();
    let picture = warp.render(&Texture::new(&photograph()), &warp.deform(&face()).unwrap(), &MouthInside::Dark);
    assert!(picture == photograph());
}

#[test]
fn driving_nodes_are_where_they_were_asked_to_be_and_the_map_agrees() {
    let warp = warp();
    let mut moved = face();
    moved[31] += Vector2::new(4.0, -3.0);
    moved[16] += Vector2::new(0.5, -4.0);
    let frame = warp.deform(&moved).unwrap();
    for n in [31, 16, 64, 5, 10] {
        assert!((frame.node(n) - moved[n]).norm() < 1e-9, "node {n}");
        assert!((warp.map(&frame, &face()[n]).unwrap() - moved[n]).norm() < 1e-6, "map of node {n}");
    }
    assert!(warp.map(&frame, &Point2::new(1.0, 1.0)).is_none());
}

#[test]
fn a_blink_covers_the_eye_and_does_not_squeeze_it() {
    // Skin is white and eyes are black, so a shut lid leaves no black.
    let nodes = face();
    let mut picture = RgbImage::from_pixel(200, 230, Rgb([255; 3]));
    for eye in &OPENINGS[1..] {
        let middle = nalgebra::center(&nodes[usize::from(eye.upper[0])], &nodes[usize::from(eye.upper[4])]);
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            if (Point2::new(f64::from(x), f64::from(y)) - middle).norm() < 2.0 {
                *pixel = Rgb([0; 3]);
            }
        }
    }
    let mut shut = nodes.clone();
    for eye in &OPENINGS[1..] {
        for k in 1..4 {
            shut[usize::from(eye.upper[k])] = shut[usize::from(eye.lower[k])];
        }
    }
    let warp = warp();
    let frame = warp.render(&Texture::new(&picture), &warp.deform(&shut).unwrap(), &MouthInside::Dark);
    assert!(frame.pixels().all(|p| p.0[0] > 200), "black shows through closed lids");
}

#[test]
fn a_lid_that_shuts_unfolds_the_skin_below_its_crease_and_leaves_the_brow() {
    let nodes = face();
    let mut shut = nodes.clone();
    for eye in &OPENINGS[1..] {
        for k in 1..4 {
            shut[usize::from(eye.upper[k])] = shut[usize::from(eye.lower[k])];
        }
    }
    let warp = warp();
    let frame = warp.deform(&shut).unwrap();
    for (lid, brow) in [(21, [17, 18]), (54, [50, 51])] {
        let above = nalgebra::center(&nodes[brow[0]], &nodes[brow[1]]);
        let goes = |share: f64| {
            let point = nodes[lid] + (above - nodes[lid]) * share;
            (warp.map(&frame, &point).unwrap() - point).y / (shut[lid] - nodes[lid]).y
        };
        assert!(goes(0.95).abs() < 0.06 && goes(0.75).abs() < 0.15, "{} {}", goes(0.95), goes(0.75));
        assert!(goes(0.1) > 0.5, "{}", goes(0.1));
    }
}

#[test]
fn skin_above_brows_that_rise_slides_up_over_all_of_the_forehead() {
    const RISE: f64 = 6.0;
    // As in a fit, the forehead's nodes lie hardly above the brows.
    let mut nodes = face();
    for n in [1, 2, 13, 34, 46] {
        nodes[n].y = nodes[16].y - 5.0;
    }
    let warp = Warp::new(&nodes).unwrap();
    let mut raised = nodes.clone();
    layout::BROWS.iter().flatten().for_each(|&n| raised[usize::from(n)].y -= RISE);
    let frame = warp.deform(&raised).unwrap();
    assert_eq!(frame.unfolding_rounds(), 0);
    for brow in [16, 49] {
        let rise = |above: f64| {
            let point = nodes[brow] - Vector2::new(0.0, above);
            (point - warp.map(&frame, &point).unwrap()).y
        };
        assert!(rise(5.0) > 0.8 * RISE, "{}", rise(5.0));
        // No 3 px shrink to less than half.
        for k in 0..10 {
            let above = 3.0 * f64::from(k);
            assert!(rise(above) - rise(above + 3.0) < 1.5, "{above}: {} {}", rise(above), rise(above + 3.0));
        }
    }
}

#[test]
fn nothing_of_the_photograph_is_left_between_lips_that_open() {
    let nodes = face();
    let line = nodes[87].y;
    // Below the lower lip the photograph is blue; the lip and what moves into the gap are white. The red brow makes it a colour picture.
    let picture = RgbImage::from_fn(200, 230, |_, y| match f64::from(y) - line {
        below if below > 2.5 => Rgb([0, 0, 255]),
        below if below > -40.0 => Rgb([255; 3]),
        _ => Rgb([200, 60, 20]),
    });
    let mut open = nodes.clone();
    for n in [40, 83, 84, 8, 85, 86, 9, 10, 32, 65] {
        open[n].y += 12.0;
    }
    let warp = warp();
    let deformation = warp.deform(&open).unwrap();
    let frame = warp.render(&Texture::new(&picture), &deformation, &MouthInside::Dark);
    for x in 88..112 {
        let lip = warp.map(&deformation, &Point2::new(f64::from(x), line + 1.5)).unwrap().y;
        for y in line.ceil() as u32..lip as u32 {
            let [r, _, b] = frame.get_pixel(x, y).0.map(i32::from);
            assert!(b - r < 60, "({x}, {y}) is blue: {r} {b}");
        }
    }
}

#[test]
fn lips_open_onto_the_dark() {
    let mut open = face();
    for n in [40, 83, 84, 8, 85, 86, 9, 10, 32, 65] {
        open[n].y += 12.0;
    }
    let warp = warp();
    let white = RgbImage::from_pixel(200, 230, Rgb([255; 3]));
    let frame = warp.render(&Texture::new(&white), &warp.deform(&open).unwrap(), &MouthInside::Dark);
    let middle = nalgebra::center(&open[87], &open[40]);
    assert!(frame.get_pixel(middle.x as u32, middle.y as u32).0[0] < 120);
    let (lip, teeth) = (open[8], warp.render(&Texture::new(&white), &warp.deform(&open).unwrap(), &MouthInside::Teeth));
    assert_eq!(frame.get_pixel(lip.x as u32, (lip.y + 3.0) as u32).0, [255; 3]);
    assert!(teeth != frame);
}

#[test]
fn inputs_that_are_not_faces_are_refused() {
    assert_eq!(Warp::new(&face()[..50]).unwrap_err(), WarpError::NodeCount { found: 50 });
    let mut nan = face();
    nan[3].x = f64::NAN;
    assert_eq!(Warp::new(&nan).unwrap_err(), WarpError::NotFinite);
    assert_eq!(Warp::new(&vec![Point2::origin(); NODE_COUNT]).unwrap_err(), WarpError::NoEyes);
    assert_eq!(warp().deform(&nan).unwrap_err(), WarpError::NotFinite);
}

#[test]
fn the_background_moves_when_it_is_asked_to() {
    let warp = warp();
    let shift = Similarity { translation: Vector2::new(7.0, -4.0), ..Similarity::identity() };
    let moved: Vec<_> = face().iter().map(|p| shift.apply(p)).collect();
    let picture = photograph();
    let frame = warp.render(&Texture::new(&picture), &warp.deform_with(&moved, &shift).unwrap(), &MouthInside::Dark);
    for (x, y) in [(20, 20), (100, 100), (100, 150), (180, 200)] {
        assert_eq!(frame.get_pixel(x + 7, y - 4), picture.get_pixel(x, y));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn no_motion_leaves_a_hole_or_a_fold(offsets in prop::collection::vec((-6.0..6.0f64, -6.0..6.0f64), NODE_COUNT)) {
        let warp = warp();
        let moved: Vec<_> = face().iter().zip(&offsets).map(|(p, &(x, y))| p + Vector2::new(x, y)).collect();
        let audit = warp.audit(&warp.deform(&moved).unwrap(), (200, 230));
        prop_assert_eq!((audit.folded, audit.holes), (0, 0));
    }
}
