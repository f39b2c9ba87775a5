//! What the locator sees in the first and in the last frame of a sequence: a mouth that goes from an expression back to neutral, and parts of
//! the face that something covers.
//!
//! The locator estimates how far the mouth is from that of a neutral face ([`crate::locate`], moved mouths). People differ in what they look
//! like at rest, and the difference between two pictures of one person is free of that.

use image::GrayImage;
use nalgebra::Point2;

use crate::locate::{FacePart, Locator, Look, known_nodes};

/// A sequence is reported if the corners of the mouth come nearer to those of a neutral face by more than this, over the eye distance, and
/// if the lips do not part by [`PARTED`] meanwhile. Both were chosen on 50 sequences of photographs, morphs and videos and on the smiles of
/// 90 people in two photographs, played forwards and backwards; see docs/evaluation.md.
const BACK: f64 = 0.025;
/// See [`BACK`]. Lips that part are an expression, wherever the corners go.
const PARTED: f64 = 0.02;

/// Shares of lost nodes below which nothing covers a face: in every frame, and on average. A hand before the mouth costs a third of them where
/// it comes and a quarter where it goes; the quick rise of both brows, which look covered then, a tenth in one frame.
const SEEN_THROUGH: (f64, f64) = (0.12, 0.02);

/// Whether the tracker sees through what looks like a cover: it hardly loses a node. `lost`: number of lost nodes in each frame, of `live`.
pub(crate) fn sees_through(lost: impl Iterator<Item = usize> + Clone, live: usize) -> bool {
    let (frames, all) = (lost.clone().count() as f64, live as f64);
    let within = |count: usize, share: f64| (count as f64) < share * all;
    lost.clone().max().is_some_and(|most| within(most, SEEN_THROUGH.0)) && within(lost.sum(), SEEN_THROUGH.1 * frames)
}

/// What the locator sees in the first and in the last frame of a sequence.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Ends {
    /// By how much the mouth moved away from that of a neutral face, from the first to the last frame: the corners of the mouth and the
    /// distance between the lips, over the eye distance. `None` if one of the frames shows no face there, or a covered mouth.
    pub mouth_moved: Option<[f64; 2]>,
    /// Parts of the face that something covers in the last frame, but not in the first.
    pub covered: Vec<FacePart>,
}

impl Ends {
    /// Looks at two pictures of a person, each with its nodes.
    pub(crate) fn look(before: (&GrayImage, &[Point2<f64>]), after: (&GrayImage, &[Point2<f64>])) -> Self {
        let Ok(locator) = Locator::shipped() else { return Self::default() };
        let look = |(image, nodes): (&GrayImage, &[Point2<f64>])| locator.look(image, &known_nodes(nodes));
        let (Some(first), Some(last)) = (look(before), look(after)) else { return Self::default() };
        let moved = |(before, after): ([f64; 2], [f64; 2])| std::array::from_fn(|k| after[k] - before[k]);
        Self { mouth_moved: first.mouth.zip(last.mouth).map(moved), covered: covered(locator, &first, &last, after) }
    }
}

/// Returns the message about parts that something covers in the frame with a number, the last one; `None` if there are none.
pub(crate) fn covered_at_apex_said(covered: &[FacePart], last: u32) -> Option<String> {
    let them = if covered.len() == 1 { "it" } else { "them" };
    FacePart::said_covered(covered)
        .map(|said| format!("{said} in frame {last}: what was tracked there may be what covers {them}; end the sequence before"))
}

/// Parts that are covered in the last picture and were not in the first. A single look says that too often: both readings must say so.
fn covered(locator: &Locator, first: &Look, last: &Look, (image, nodes): (&GrayImage, &[Point2<f64>])) -> Vec<FacePart> {
    let appeared: Vec<FacePart> = last.covered.iter().copied().filter(|part| !first.covered.contains(part)).collect();
    if appeared.is_empty() {
        return appeared;
    }
    let Some(face) = locator.read_near(image, &known_nodes(nodes)) else { return Vec::new() };
    appeared.into_iter().filter(|part| face.covered.contains(part)).collect()
}

/// Returns the message about a sequence whose mouth moves back to neutral; `None` otherwise. `moved`: see [`Ends`]; `first`, `last`:
/// numbers of the frames.
pub(crate) fn mouth_back_said(moved: Option<[f64; 2]>, first: u32, last: u32) -> Option<String> {
    let [corners, lips] = moved?;
    let why = || format!("the mouth of frame {first} looks further from a neutral one than that of frame {last}");
    (corners < -BACK && lips < PARTED).then(|| backwards_said(&why(), first, last))
}

/// Returns the message about a sequence from frame `first` to frame `last` whose apex seems to come first.
pub(crate) fn backwards_said(why: &str, first: u32, last: u32) -> String {
    format!(
        "the sequence seems to go from an expression back to neutral: {why}; if frame {last} is neutral, set it as first_frame and frame \
         {first} as last_frame in the manifest, and mark the neutral frame if you set marks"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{locate::LocateOptions, sequence::read_frame};

    #[test]
    fn a_mouth_goes_back_if_its_corners_do_and_its_lips_do_not_part() {
        let said = |moved| mouth_back_said(Some(moved), 1, 9).is_some();
        assert!(said([-0.1, -0.1]) && said([-0.03, 0.01]));
        assert!(!said([-0.02, -0.1]) && !said([-0.03, 0.03]) && !said([0.1, 0.1]));
        assert_eq!(mouth_back_said(None, 1, 9), None);
        let text = mouth_back_said(Some([-0.1, -0.1]), 1, 9).unwrap();
        assert!(
            text.contains("the mouth of frame 1 looks further from a neutral one than that of frame 9; if frame 9 is neutral")
        );
    }

    #[test]
    fn a_covered_mouth_is_not_compared_and_is_told() {
        let portrait = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/portraits/P01.jpg");
        let frame = read_frame(&portrait).unwrap();
        let face = Locator::shipped().unwrap().locate(frame.image(), &LocateOptions::default()).remove(0);
        let mut nodes = vec![Point2::origin(); 113];
        face.points.iter().for_each(|point| nodes[point.node.index()] = point.position);
        let alike = Ends::look((frame.image(), &nodes), (frame.image(), &nodes));
        assert_eq!(alike, Ends { mouth_moved: Some([0.0, 0.0]), covered: Vec::new() });
        assert_eq!(covered_at_apex_said(&alike.covered, 9), None);
        // A plain mask from below the nose to below the lips.
        let (unit, mouth) = (face.eye_distance, nodes[7] + (nodes[8] - nodes[7]) / 2.0);
        let mut masked = frame.image().clone();
        for (x, y, pixel) in masked.enumerate_pixels_mut() {
            let way = Point2::new(f64::from(x), f64::from(y)) - mouth;
            if way.x.abs() < 0.7 * unit && way.y.abs() < 0.28 * unit {
                pixel.0 = [230];
            }
        }
        // A mask that was there from the beginning is no news.
        assert_eq!(Ends::look((&masked, &nodes), (frame.image(), &nodes)), Ends::default());
        assert_eq!(Ends::look((&masked, &nodes), (&masked, &nodes)), Ends::default());
        let put_on = Ends::look((frame.image(), &nodes), (&masked, &nodes));
        assert!(put_on.mouth_moved.is_none() && put_on.covered.contains(&FacePart::Mouth), "{put_on:?}");
        let said = covered_at_apex_said(&put_on.covered, 9).unwrap();
        assert!(said.contains("the mouth") && said.contains(" in frame 9: what was tracked there"), "{said}");
    }

    #[test]
    fn nothing_is_said_of_pictures_without_a_face() {
        let (wall, nodes) = (GrayImage::new(320, 240), vec![Point2::new(160.0, 120.0); 113]);
        assert_eq!(Ends::look((&wall, &nodes), (&wall, &nodes)), Ends::default());
    }
}
