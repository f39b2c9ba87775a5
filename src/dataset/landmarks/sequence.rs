//! Landmarks from the neutral to the apex frame, with the missing frames in between.

use nalgebra::Point2;

use super::{LandmarkTrack, LandmarksError};

/// One frame of a [`LandmarkSequence`].
///
/// ```
/// use grimace::dataset::LandmarkFrame;
///
/// // A frame in which the face was lost keeps its number.
/// let lost = LandmarkFrame { number: 7, points: None };
/// assert!(lost.number == 7 && lost.points.is_none());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkFrame {
    /// Frame number.
    pub number: u32,
    /// The landmarks in image pixels; `None` for a lost or missing frame.
    pub points: Option<Vec<Point2<f64>>>,
}

/// Landmarks from the neutral to the apex frame: at least two frames, the first and the last with landmarks.
///
/// ```
/// use grimace::dataset::read_landmarks;
///
/// // The table at `path` has frames 1, 2 and 4.
/// let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("landmarks.csv");
/// # let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
/// # let row: String = (0..68).map(|k| format!(",{k},{}", k * k)).collect();
/// # std::fs::write(&path, format!("frame{header}\n1{row}\n2{row}\n4{row}\n"))?;
/// let sequence = read_landmarks(&path)?.sequence(None, None)?;
/// let is_there: Vec<(u32, bool)> = sequence.frames.iter().map(|frame| (frame.number, frame.points.is_some())).collect();
/// assert_eq!(is_there, [(1, true), (2, true), (3, false), (4, true)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LandmarkSequence {
    /// Frames from neutral to apex, with equally spaced numbers; descending if the apex was recorded first.
    pub frames: Vec<LandmarkFrame>,
}

impl LandmarkSequence {
    /// Warnings about images before its first or after its last frame: that frame became the neutral one or the apex, although the
    /// recording continues. `images` are the numbers of the images, in any order. There is no warning if there are as many images as
    /// landmarks, since they are then numbered differently.
    pub(crate) fn ends_early(&self, images: &[u32]) -> Vec<String> {
        let (Some(neutral), Some(apex)) = (self.frames.first(), self.frames.last()) else { return Vec::new() };
        if images.len() <= self.frames.len() {
            return Vec::new();
        }
        let is_backward = neutral.number > apex.number;
        let beyond = |end: u32, is_behind: bool| {
            let mut numbers: Vec<u32> = images.iter().copied().filter(|&n| if is_behind { n > end } else { n < end }).collect();
            numbers.sort_unstable();
            numbers
        };
        let said = |(frame, what, column, is_behind): (&LandmarkFrame, &str, &str, bool)| {
            let without = beyond(frame.number, is_behind);
            let (first, last) = (without.first()?, without.last()?);
            let named = if first == last { format!("frame {first} has") } else { format!("frames {first} to {last} have") };
            Some(format!(
                "{named} an image but no landmarks, so frame {0} became the {what}; add the landmarks, or write {0} into the column \
                 `{column}` to confirm it, or leave --prefer-landmarks out to track the images",
                frame.number
            ))
        };
        [(neutral, "neutral frame", "first_frame", is_backward), (apex, "apex", "last_frame", !is_backward)]
            .into_iter()
            .filter_map(said)
            .collect()
    }
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

impl LandmarkTrack {
    /// The landmarks of the neutral frame: of `first`, by default of the first frame of the file.
    ///
    /// # Errors
    /// [`LandmarksError`] when that frame does not exist or the face was lost in it.
    pub(crate) fn neutral_frame(&self, first: Option<u32>) -> Result<&[Point2<f64>], LandmarksError> {
        let (found_first, found_last) = self.ends();
        if self.frames.is_empty() {
            let (path, frames) = (self.path.clone(), self.lost.len());
            return Err(LandmarksError::AllLost { path, frames, least: self.least_confidence });
        }
        let frame = first.unwrap_or_else(|| self.lost.iter().copied().fold(found_first, u32::min));
        if self.lost.contains(&frame) {
            let (path, first, last) = (self.path.clone(), found_first, found_last);
            return Err(LandmarksError::EndLost { path, frame, what: "neutral", column: "first_frame", first, last });
        }
        self.frame(frame)
    }

    /// Returns the frames from `first` to `last`, both included; by default the first and the last of the file.
    ///
    /// The spacing of frames is the greatest common divisor of the distances between the existing numbers. Numbers without landmarks at
    /// this spacing are missing frames: 1, 2 and 4 lack 3, whereas a neutral and an apex alone, 1 and 24, lack nothing.
    ///
    /// # Errors
    /// [`LandmarksError`] when every frame was lost, a requested frame does not exist, the face was lost in the neutral or the apex frame,
    /// fewer than two frames are left, or fewer than half of the frames have landmarks.
    pub fn sequence(&self, first: Option<u32>, last: Option<u32>) -> Result<LandmarkSequence, LandmarksError> {
        let path = || self.path.clone();
        let (found_first, found_last) = self.ends();
        if self.frames.is_empty() {
            return Err(LandmarksError::AllLost { path: path(), frames: self.lost.len(), least: self.least_confidence });
        }
        let mut numbers: Vec<u32> = self.frames.keys().chain(&self.lost).copied().collect();
        numbers.sort_unstable();
        let end = |asked: Option<u32>, default: Option<&u32>, what, column| {
            let frame = asked.or(default.copied()).unwrap_or(found_first);
            if self.frames.contains_key(&frame) {
                Ok(frame)
            } else if self.lost.contains(&frame) {
                Err(LandmarksError::EndLost { path: path(), frame, what, column, first: found_first, last: found_last })
            } else {
                Err(self.frame(frame).map(|_| ()).err().unwrap_or(LandmarksError::Empty { path: path() }))
            }
        };
        let first = end(first, numbers.first(), "neutral", "first_frame")?;
        let last = end(last, numbers.last(), "apex", "last_frame")?;
        let is_backward = first > last;
        let (first, last) = (first.min(last), first.max(last));
        numbers.retain(|number| (first..=last).contains(number));
        if numbers.len() < 2 {
            return Err(LandmarksError::TooFew { path: path(), found: numbers.len() });
        }
        let step = numbers.iter().map(|&n| u64::from(n - first)).fold(0, greatest_common_divisor).max(1);
        let count = u64::from(last - first) / step + 1;
        let found = numbers.iter().filter(|&n| self.frames.contains_key(n)).count();
        if (found as u64) * 2 < count {
            return Err(LandmarksError::MostlyLost { path: path(), frames: count, first, last, found });
        }
        let number = |m: u64| u32::try_from(u64::from(first) + m * step).unwrap_or(last);
        let frame = |number| LandmarkFrame { number, points: self.frames.get(&number).cloned() };
        let mut frames: Vec<LandmarkFrame> = (0..count).map(number).map(frame).collect();
        if is_backward {
            frames.reverse();
        }
        Ok(LandmarkSequence { frames })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_beyond_the_landmarks_are_reported() {
        let said = |landmarks: &[u32], images: &[u32]| {
            let frames = landmarks.iter().map(|&number| LandmarkFrame { number, points: None }).collect();
            LandmarkSequence { frames }.ends_early(images)
        };
        let all: Vec<u32> = (1..=10).collect();
        let behind = said(&[1, 2, 3, 4], &all);
        assert_eq!(
            behind,
            [
                "frames 5 to 10 have an image but no landmarks, so frame 4 became the apex; add the landmarks, or write 4 into the \
                 column `last_frame` to confirm it, or leave --prefer-landmarks out to track the images"
            ]
        );
        // In reverse order the apex has the lowest number.
        let both = said(&[9, 8, 7, 6, 5, 4, 3], &all);
        assert!(both[0].starts_with("frame 10 has an image but no landmarks, so frame 9 became the neutral frame"), "{both:?}");
        assert!(both[1].starts_with("frames 1 to 2 have an image but no landmarks, so frame 3 became the apex"), "{both:?}");
        assert_eq!(said(&all, &all), [""; 0]);
        // Every second frame, and landmarks that are counted from 0.
        assert_eq!(said(&[1, 3, 5], &[1, 2, 3, 4, 5]), [""; 0]);
        assert_eq!(said(&[0, 1, 2, 3], &[1, 2, 3, 4]), [""; 0]);
    }
}
