//! Compares this project's KLT with OpenCV's.

use grimace::internal::{
    sequence::Frame,
    track::{Found, Klt, OpenCvKlt, PointTracker, Probe, Slot},
};
use image::{GrayImage, Luma};
use nalgebra::{Matrix2, Point2, Vector2};
use opencv::{
    core::{BORDER_CONSTANT, BORDER_REFLECT_101, CV_32F, Mat, Rect, Size, Vec2s, Vector},
    imgproc::gaussian_blur,
    prelude::*,
    video::build_optical_flow_pyramid,
};

/// Returns a smooth pattern that moves and grows slightly from frame to frame.
fn frame(number: u32) -> Frame {
    let (shift, scale) = (f64::from(number - 1), 1.0 + 0.004 * f64::from(number - 1));
    let image = GrayImage::from_fn(233, 187, |x, y| {
        let (x, y) = ((f64::from(x) - 1.7 * shift) / scale, (f64::from(y) + 0.9 * shift) / scale);
        let value = 120.0 + 50.0 * (0.31 * x).sin() * (0.27 * y).cos() + 40.0 * (0.11 * x + 0.19 * y).sin();
        Luma([(value + 6.0 * (1.3 * x - 0.9 * y).sin()) as u8])
    });
    Frame::new(number, image)
}

/// Returns points all over the image and outside its border.
fn points() -> Vec<Point2<f64>> {
    let grid = |from: i32, to: i32| (from..to).step_by(7).map(|v| f64::from(v) + 0.31);
    grid(-12, 200).flat_map(|y| grid(-12, 245).map(move |x| Point2::new(x, y))).collect()
}

fn mat_of(frame: &Frame) -> Mat {
    let image = frame.image();
    Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.as_raw()).unwrap().try_clone().unwrap()
}

fn probes() -> Vec<Probe> {
    points().into_iter().map(|p| Probe { position: p, guess: p }).collect()
}

#[test]
fn points_are_found_where_opencv_finds_them() {
    // Builds the program that OpenCV's tracker starts, in case only these tests were built.
    crate::common::grimace();
    for window in [9, 15] {
        let (mut ours, mut theirs) = (Klt::new(4, window), OpenCvKlt::new(4, window).unwrap());
        let (mut distances, mut odd) = (Vec::new(), 0);
        ours.advance(&frame(1)).unwrap();
        theirs.advance(&frame(1)).unwrap();
        for number in 2..5 {
            ours.advance(&frame(number)).unwrap();
            theirs.advance(&frame(number)).unwrap();
            for (from, to) in [(Slot::Previous, Slot::Current), (Slot::Current, Slot::Previous), (Slot::Neutral, Slot::Current)] {
                let a = ours.find(from, to, window, 4, &probes()).unwrap();
                let b = theirs.find(from, to, window, 4, &probes()).unwrap();
                for (a, b) in a.into_iter().zip(b) {
                    match (a, b) {
                        (Found::At { position: a, .. }, Found::At { position: b, .. }) => distances.push((a - b).norm()),
                        (a, b) => odd += u32::from(a != b),
                    }
                }
            }
        }
        distances.sort_by(f64::total_cmp);
        // A search that diverges ends elsewhere when the last digit of a sum changes.
        assert!(
            distances.len() > 5000 && odd < 60,
            "{} points found, {odd} of them by only one of the trackers",
            distances.len()
        );
        let (middle, most) = (distances[distances.len() / 2], distances[distances.len() * 95 / 100]);
        assert!(middle < 1e-4 && most < 1e-2, "window {window}: median {middle}, 95 % {most}");
    }
}

#[test]
fn gradients_are_those_of_opencv() {
    let mut ours = Klt::new(3, 11);
    ours.advance(&frame(1)).unwrap();
    let mat = mat_of(&frame(1));
    let (mut pyramid, window) = (Vector::<Mat>::new(), Size::new(11, 11));
    build_optical_flow_pyramid(&mat, &mut pyramid, window, 0, true, BORDER_REFLECT_101, BORDER_CONSTANT, false).unwrap();
    // The image and its Scharr derivatives, 32 times the grey levels per px.
    let derivatives = pyramid.get(1).unwrap();
    let inside: Vec<_> = points().into_iter().filter(|p| p.x > 0.0 && p.y > 0.0 && p.x < 232.0 && p.y < 186.0).collect();
    for (point, found) in inside.iter().zip(ours.gradients(Slot::Neutral, 11, &inside).unwrap()) {
        let range = |centre: f64, size: i32| (centre.round() as i32 - 5).max(0)..(centre.round() as i32 + 6).min(size);
        let (mut sum, mut count) = (Matrix2::zeros(), 0.0);
        for y in range(point.y, 187) {
            for x in range(point.x, 233) {
                let pixel = derivatives.at_2d::<Vec2s>(y, x).unwrap();
                let gradient = Vector2::new(f64::from(pixel[0]), f64::from(pixel[1])) / 32.0;
                sum += gradient * gradient.transpose();
                count += 1.0;
            }
        }
        assert!((found - sum / count).norm() <= 1e-9 * (sum / count).norm(), "{point}");
    }
}

#[test]
fn smoothing_is_that_of_opencv() {
    let mut ours = Klt::new(3, 11);
    ours.advance(&frame(1)).unwrap();
    let corners = [Point2::new(20.5, 30.0), Point2::new(300.0, 90.0)];
    for smoothing in [0.0, 0.3, 1.1] {
        let found = ours.patch(Slot::Current, &corners, 12.0, smoothing).unwrap().unwrap();
        let part = Rect::new(found.left as i32, found.top as i32, found.width as i32, found.height as i32);
        assert_eq!(part, Rect::new(8, 18, 225, 85));
        let mat = mat_of(&frame(1));
        let (mut grey, mut smooth) = (Mat::default(), Mat::default());
        mat.roi(part).unwrap().convert_to(&mut grey, CV_32F, 1.0, 0.0).unwrap();
        smooth = if smoothing > 0.0 {
            gaussian_blur(&grey, &mut smooth, Size::default(), smoothing, smoothing, BORDER_REFLECT_101).unwrap();
            smooth
        } else {
            grey
        };
        let values = smooth.data_typed::<f32>().unwrap();
        assert!(found.values.iter().zip(values).all(|(a, b)| (a - b).abs() < 1e-3), "{smoothing}");
    }
    let outside = [Point2::new(-90.0, 20.0), Point2::new(-60.0, 40.0)];
    assert!(ours.patch(Slot::Current, &outside, 12.0, 0.3).unwrap().is_none());
}
