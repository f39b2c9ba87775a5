//! Decides whether the faces in two consecutive frames belong to the same person.
//!
//! A cut between two people before the same background changes the picture little, and the tracker moves from one face to the other: it
//! loses two thirds of its nodes in that step, and none in the next. Blinks and hands lose up to a third, sometimes more. Where many nodes
//! are lost, the skin around eyes and nose is therefore compared. Both faces are sampled at corresponding points by the marks found in each,
//! light and contrast are removed, and the samples are correlated. The eyes themselves do not count, because a blink changes them in one
//! step; people are told apart as well without them.
//!
//! One face with noise, and marks that vary by 2 % of the eye distance, has a correlation of 0.99 with itself. Of 4005 pairs of 90 people it
//! is at most 0.865 in 99 of 100 (0.862 with the eyes). Between rest and apex one person has 0.77 to 0.99, but no face changes that much in
//! one step.

use nalgebra::Point2;

use super::super::found::found_faces;

use crate::{
    fit::Correspondence,
    geometry::Similarity,
    locate::Picture,
    pipeline::{FoundFace, FoundMarksError, Workbench},
    pose::HEAD_ES,
    sequence::Frame,
    track::TrackedFrame,
    units::NodeId,
};

/// Share of lost nodes in a step from which the face may be another person's.
const SUSPECT: f64 = 0.4;
/// Correlation below which two faces belong to different people.
const SAME: f64 = 0.87;
/// Largest distance of a detected face from the centre of the tracked wireframe, in eye distances.
const NEAR: f64 = 1.5;
/// Corners of the eyes.
const EYES: [u16; 4] = [20, 23, 53, 56];
/// Samples per eye distance.
const DENSITY: f64 = 24.0;
/// Sampled area around the midpoint of the eyes, in samples: half the width, above, below; and the largest shift.
const HALF_WIDTH: i32 = 23;
const ABOVE: i32 = 12;
const BELOW: i32 = 17;
const SHIFT: i32 = 2;
/// Radii in samples: of the smoothing, and of the area over which light is assumed even.
const SMOOTH: i32 = 1;
const EVEN: i32 = 6;
/// Contrast in grey levels below which the signal is noise.
const NOISE: f32 = 2.0;
/// Half the width and half the height of the part around an eye that a blink changes, in eye distances.
const EYE: [f64; 2] = [0.3, 0.2];

/// Whether another person's face appears in the step from one tracked frame to the next: many nodes are lost, and the detected faces
/// differ.
pub(super) fn is_another(
    (before, was): (&Frame, &TrackedFrame),
    (after, is): (&Frame, &TrackedFrame),
    eye_distance: f64,
    bench: &Workbench,
) -> Result<bool, FoundMarksError> {
    let live = bench.wireframe.live_nodes();
    if is.lost(live) as f64 <= SUSPECT * live.len() as f64 {
        return Ok(false);
    }
    let (Some(first), Some(second)) = (face_at(before, was, eye_distance)?, face_at(after, is, eye_distance)?) else {
        return Ok(false);
    };
    Ok(likeness((before, &first.marks), (after, &second.marks), bench).is_some_and(|likeness| likeness < SAME))
}

/// The surroundings of the eyes in a frame, and its marks there.
#[derive(Clone, Debug)]
pub(super) struct Portrait {
    frame: Frame,
    marks: Vec<Correspondence>,
}

/// Distance from the middle of the eyes up to which a portrait reaches, in distances between their outer corners: more than is compared.
const REACH: f64 = 1.2;

impl Portrait {
    /// Cuts a face out of its frame; `None` without marks on both eyes.
    pub fn of(frame: &Frame, marks: &[Correspondence]) -> Option<Self> {
        let eye = |node: &u16| marks.iter().find(|m| m.node == NodeId(*node)).map(|m| m.position);
        let eyes: Vec<Point2<f64>> = EYES.iter().filter_map(eye).collect();
        let width = eyes.iter().flat_map(|a| eyes.iter().map(move |b| (a - b).norm())).fold(0.0, f64::max);
        if eyes.len() < EYES.len() || !(width > 0.0 && width.is_finite()) {
            return None;
        }
        let middle = eyes.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / eyes.len() as f64;
        let image = frame.image();
        // Conversions saturate at the edges of the picture.
        let part = |middle: f64, size: u32| {
            let (from, to) = ((middle - REACH * width).floor() as u32, (middle + REACH * width).ceil() as u32);
            (from.min(size.saturating_sub(1)), to.min(size))
        };
        let ((left, right), (top, bottom)) = (part(middle.x, image.width()), part(middle.y, image.height()));
        let cut = image::imageops::crop_imm(image, left, top, right.saturating_sub(left), bottom.saturating_sub(top)).to_image();
        let shift = nalgebra::Vector2::new(f64::from(left), f64::from(top));
        let marks = marks.iter().map(|m| Correspondence { position: m.position - shift, ..*m }).collect();
        Some(Self { frame: Frame::new(frame.number(), cut), marks })
    }

    /// Whether two portraits show the same person; `None` where the faces cannot be read.
    pub fn is_same(&self, other: &Self, bench: &Workbench) -> Option<bool> {
        likeness((&self.frame, &self.marks), (&other.frame, &other.marks), bench).map(|likeness| likeness >= SAME)
    }
}

/// The trusted face detected nearest to a tracked one.
fn face_at(frame: &Frame, tracked: &TrackedFrame, eye_distance: f64) -> Result<Option<FoundFace>, FoundMarksError> {
    let apart = |face: &FoundFace| {
        let at = |m: &Correspondence| tracked.nodes.get(m.node.index()).map(|n| n.position - m.position);
        let moves: Vec<_> = face.marks.iter().filter_map(at).collect();
        let sum: nalgebra::Vector2<f64> = moves.iter().sum();
        (sum / moves.len().max(1) as f64).norm()
    };
    let near = found_faces(frame, None)?.into_iter().filter(|face| face.trusted).map(|face| (apart(&face), face));
    let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(nearest.filter(|(apart, _)| *apart < NEAR * eye_distance).map(|(_, face)| face))
}

/// Correlation of two faces around eyes and nose, -1 to 1; `None` where they cannot be read.
fn likeness(
    (first, first_marks): (&Frame, &[Correspondence]),
    (second, second_marks): (&Frame, &[Correspondence]),
    bench: &Workbench,
) -> Option<f64> {
    let frontal = bench.wireframe.frontal();
    let own = |node: NodeId| frontal.get(node.index()).map(|p| Point2::new(p.x, -p.y));
    let eyes: Vec<Point2<f64>> = EYES.iter().filter_map(|&node| own(NodeId(node))).collect();
    let own_eyes: Vec<Point2<f64>> = eyes.chunks_exact(2).map(|pair| nalgebra::center(&pair[0], &pair[1])).collect();
    let eyes_at: Vec<Point2<f64>> =
        EYES.iter().filter_map(|&node| Some(first_marks.iter().find(|m| m.node == NodeId(node))?.position)).collect();
    let middle = eyes.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / eyes.len().max(1) as f64;
    let to_first = Similarity::fit(&eyes, &eyes_at, None).ok()?;
    let common = first_marks.iter().filter_map(|m| Some((m.position, second_marks.iter().find(|o| o.node == m.node)?.position)));
    let (from, to): (Vec<_>, Vec<_>) = common.unzip();
    let to_second = Similarity::fit(&from, &to, None).ok()?.after(&to_first);
    let place = |(column, row): (i32, i32)| {
        let off = nalgebra::Vector2::new(f64::from(column - HALF_WIDTH - SHIFT), f64::from(row - ABOVE - SHIFT));
        Point2::from(middle + off * (HEAD_ES / DENSITY))
    };
    let read = |frame: &Frame, to_image: &Similarity| -> Option<Grid> {
        let picture = Picture::new(frame.image())?;
        let view = picture.view(false);
        let scale = (to_image.scale * HEAD_ES / DENSITY) as f32;
        let values = Grid::places().map(|sample| {
            let at = to_image.apply(&place(sample));
            view.sample([at.x as f32, at.y as f32], scale)
        });
        Some(Grid { values: values.collect() }.detail())
    };
    let (first, second) = (read(first, &to_first)?, read(second, &to_second)?);
    let shifts = (-SHIFT..=SHIFT).flat_map(|dy| (-SHIFT..=SHIFT).map(move |dx| (dx, dy)));
    let is_of_eye = |sample: &(i32, i32)| {
        own_eyes.iter().map(|eye| place(*sample) - eye).any(|off| (off.x / EYE[0]).hypot(off.y / EYE[1]) < HEAD_ES)
    };
    let compared: Vec<(i32, i32)> = Grid::middle().filter(|sample| !is_of_eye(sample)).collect();
    shifts.map(|shift| first.correlation(&second, shift, &compared)).max_by(f64::total_cmp)
}

/// Values around eyes and nose, row by row.
struct Grid {
    values: Vec<f32>,
}

impl Grid {
    const WIDTH: i32 = 2 * (HALF_WIDTH + SHIFT) + 1;
    const HEIGHT: i32 = ABOVE + BELOW + 2 * SHIFT + 1;

    fn at(&self, column: i32, row: i32) -> f32 {
        let (column, row) = (column.clamp(0, Self::WIDTH - 1), row.clamp(0, Self::HEIGHT - 1));
        self.values.get((row * Self::WIDTH + column) as usize).copied().unwrap_or_default()
    }

    fn places() -> impl Iterator<Item = (i32, i32)> {
        (0..Self::HEIGHT).flat_map(|row| (0..Self::WIDTH).map(move |column| (column, row)))
    }

    /// The places that lie within another grid, however it is shifted.
    fn middle() -> impl Iterator<Item = (i32, i32)> {
        (SHIFT..Self::HEIGHT - SHIFT).flat_map(|row| (SHIFT..Self::WIDTH - SHIFT).map(move |column| (column, row)))
    }

    /// Means over squares with a side of 2 `radius` + 1 samples.
    fn means(&self, radius: i32) -> Self {
        let count = (2 * radius + 1).pow(2) as f32;
        let around = |(x, y): (i32, i32)| {
            (y - radius..=y + radius)
                .flat_map(|y| (x - radius..=x + radius).map(move |x| (x, y)))
                .map(|(x, y)| self.at(x, y))
                .sum::<f32>()
        };
        Self { values: Self::places().map(|place| around(place) / count).collect() }
    }

    /// The samples without light, divided by their contrast.
    fn detail(&self) -> Self {
        let (smooth, light) = (self.means(SMOOTH), self.means(EVEN));
        let detail = Self { values: smooth.values.iter().zip(&light.values).map(|(a, b)| a - b).collect() };
        let squares = Self { values: detail.values.iter().map(|v| v * v).collect() }.means(EVEN);
        Self { values: detail.values.iter().zip(&squares.values).map(|(v, s)| v / (s.sqrt() + NOISE)).collect() }
    }

    /// Correlation of these places with those of another grid, shifted; 0 where one of them is constant.
    fn correlation(&self, other: &Self, (dx, dy): (i32, i32), places: &[(i32, i32)]) -> f64 {
        let count = places.len() as f64;
        let pairs = || places.iter().map(|&(x, y)| (f64::from(self.at(x, y)), f64::from(other.at(x + dx, y + dy))));
        let (a, b) = pairs().fold((0.0, 0.0), |sum, (a, b)| (sum.0 + a / count, sum.1 + b / count));
        let products = pairs().map(|(p, q)| ((p - a) * (q - b), (p - a).powi(2), (q - b).powi(2)));
        let (both, first, second) = products.fold((0.0, 0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1, sum.2 + p.2));
        if first * second > 0.0 { both / (first * second).sqrt() } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, imageops};

    use super::*;
    use crate::pipeline::PipelineOptions;

    fn portrait(name: &str) -> GrayImage {
        image::open(std::path::Path::new("fixtures/portraits").join(name)).unwrap().to_luma8()
    }

    #[test]
    fn a_face_is_like_itself_and_unlike_those_of_others() {
        let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
        let found = |image: GrayImage| {
            let frame = Frame::new(1, image);
            let marks = found_faces(&frame, None).unwrap().remove(0).marks;
            (frame, marks)
        };
        let like = |a: &(Frame, Vec<Correspondence>), b: &(Frame, Vec<Correspondence>)| {
            likeness((&a.0, &a.1), (&b.0, &b.1), &bench).unwrap()
        };
        let (first, others) = (portrait("P10.jpg"), ["P01.jpg", "P03.jpg", "P11.jpg"].map(|name| found(portrait(name))));
        // Smaller, shifted, and with half the light.
        let mut changed = GrayImage::from_pixel(500, 500, image::Luma([90]));
        let mut dim = imageops::resize(&first, 352, 448, imageops::FilterType::Triangle);
        dim.pixels_mut().for_each(|p| p.0[0] /= 2);
        imageops::replace(&mut changed, &dim, 110, 30);
        let (first, changed) = (found(first), found(changed));
        assert!(like(&first, &changed) > 0.95, "{}", like(&first, &changed));
        for other in &others {
            assert!(like(&first, other) < SAME, "{}", like(&first, other));
        }
        // A picture without contrast gives no answer.
        let even = (Frame::new(2, GrayImage::from_pixel(440, 560, image::Luma([128]))), first.1.clone());
        assert!(like(&first, &even).abs() < 1e-9);
    }
}
