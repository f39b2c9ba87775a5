//! `faces FOLDER FACE EYES EYES`: for every grey picture, sends the largest face that Haar cascades find, and candidates for its eyes.

use std::{ffi::OsString, path::Path};

use grimace::internal::companion::wire::{FaceBoxes, Reply};
use opencv::{
    core::{Mat, Rect, Size, Vector},
    imgproc::equalize_hist,
    objdetect::CascadeClassifier,
    prelude::*,
};

use crate::{
    Trouble,
    talk::{Heard, Talk},
};

/// Upper share of a face box in which eyes are searched.
const EYE_BAND: f64 = 0.6;

pub fn run(arguments: &[OsString], talk: &mut Talk) -> Result<(), Trouble> {
    let [folder, names @ ..] = arguments else { return Err(Trouble::Failed("no folder of cascades".to_owned())) };
    let load = |name: &OsString| {
        // OpenCV returns an empty classifier for a missing file.
        let classifier = CascadeClassifier::new(Path::new(folder).join(name)).ok();
        let whole = classifier.filter(|c| c.empty().is_ok_and(|empty| !empty));
        whole.ok_or_else(|| Trouble::Failed(name.to_string_lossy().into_owned()))
    };
    let [face, first, second] = names else { return Err(Trouble::Failed("three cascades are needed".to_owned())) };
    let (mut face, mut eyes) = (load(face)?, [load(first)?, load(second)?]);
    talk.say(&Reply::Ready)?;
    while let Heard::Picture(pixels) = talk.hear()? {
        let mat = Mat::new_rows_cols_with_data(pixels.height as i32, pixels.width as i32, &pixels.data)?;
        let mut grey = Mat::default();
        equalize_hist(&mat, &mut grey)?;
        let found = match largest(&detect(&mut face, &grey, 1.1, 40)?) {
            None => None,
            Some(face) => {
                let band = Rect::new(face.x, face.y, face.width, (f64::from(face.height) * EYE_BAND) as i32);
                let region = Mat::roi(&grey, band)?.try_clone()?;
                let mut boxes = [Vec::new(), Vec::new()];
                for (boxes, cascade) in boxes.iter_mut().zip(&mut eyes) {
                    *boxes = detect(cascade, &region, 1.05, face.width / 8)?.into_iter().map(sides).collect();
                }
                Some(FaceBoxes { face: sides(face), eyes: boxes })
            }
        };
        talk.say(&Reply::Face(found))?;
    }
    Ok(())
}

fn detect(cascade: &mut CascadeClassifier, image: &Mat, scale: f64, least: i32) -> Result<Vec<Rect>, Trouble> {
    let mut found = Vector::<Rect>::new();
    let least = Size::new(least.max(8), least.max(4) / 2);
    cascade.detect_multi_scale(image, &mut found, scale, 3, 0, least, Size::new(0, 0))?;
    Ok(found.to_vec())
}

fn largest(boxes: &[Rect]) -> Option<Rect> {
    boxes.iter().copied().max_by_key(|b| (b.width, std::cmp::Reverse((b.y, b.x))))
}

fn sides(found: Rect) -> [i32; 4] {
    [found.x, found.y, found.width, found.height]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_box_wins_and_of_two_the_upper_left_one() {
        let (small, wide) = (Rect::new(0, 0, 5, 5), Rect::new(9, 9, 7, 7));
        assert_eq!(largest(&[small, wide, Rect::new(9, 30, 7, 7)]), Some(wide));
        assert_eq!(largest(&[]), None);
    }
}
