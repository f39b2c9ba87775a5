//! The face used by tests of clones.

use std::sync::LazyLock;

use image::RgbImage;

use super::Target;
use crate::{
    correspondence::read_correspondences,
    fit::{FitOptions, Fitter},
    wireframe::Face,
};

/// The first shipped portrait.
pub fn portrait() -> RgbImage {
    image::open("fixtures/portraits/P01.jpg").unwrap().into_rgb8()
}

/// The target of that portrait, made once for all tests.
pub fn portrait_target() -> &'static Target {
    static TARGET: LazyLock<Target> = LazyLock::new(|| target(portrait()));
    &TARGET
}

/// A target with a picture and the marks of that portrait.
pub fn target(picture: RgbImage) -> Target {
    let face = Face::candide3();
    let marks = read_correspondences("fixtures/portraits/P01_correspondences.csv".as_ref(), &face.tables, 113).unwrap();
    let fitter = Fitter::new(&face.wireframe, FitOptions::default());
    Target::new("P01", picture, &marks, &fitter, &face).unwrap()
}
