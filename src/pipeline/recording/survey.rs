//! The first pass over a recording: counts frames, finds cuts, and detects faces several times a second.
//!
//! A *look* is a frame in which faces are detected.

use image::{GrayImage, imageops::FilterType};
use nalgebra::Point2;
use rayon::prelude::*;

use super::{
    super::found::{found_faces, middle_of},
    Recording, RecordingError, RecordingStep, Tick,
    persons::followed,
};
use crate::{
    dataset::{FrameSource, unread_beside},
    fit::Correspondence,
    geometry::Similarity,
    locate::FacePart,
    normalize::stable_nodes,
    output::{count, listed, per_second},
    pipeline::{FoundFace, Workbench},
    segment::densest,
    sequence::{Clock, Frame, ImageSize, SequenceReader},
    track::usual_step,
    units::NodeId,
};

/// Seconds between two looks for a face.
const BETWEEN_LOOKS: f64 = 0.4;
/// Tolerance for times, which files store in whole milliseconds, s.
const TIME_STEP: f64 = 0.002;
/// Number of looks processed in parallel.
const TOGETHER: usize = 8;
/// Size in px of the reduced pictures that are compared to find cuts.
const SMALL: (u32, u32) = (32, 24);
/// Mean grey difference of two reduced pictures, without brightness, from which there may be a cut.
const CUT: f32 = 14.0;
/// Ratio to the previous differences between frames that a cut must exceed.
const CUT_FACTOR: f32 = 4.0;
/// Frame rate of folders of images without a given rate.
pub(super) const USUAL_FPS: f64 = 25.0;
/// Nodes that expressions move; they determine the most typical face of a stretch.
const MOVED: [u16; 15] = [31, 64, 7, 8, 10, 15, 16, 17, 48, 49, 50, 87, 40, 85, 86];
/// Distance within which two faces are alike: the norm of the differences of these nodes, in eye distances.
const ALIKE: f32 = 0.08;

/// A frame in which faces were detected.
pub(super) struct Look {
    /// Index of the frame among all frames.
    pub place: usize,
    /// The followed face, if it was detected.
    pub face: Option<FoundFace>,
    /// Index of its person in the scene.
    pub person: usize,
}

impl Look {
    /// Parts of the face that something hides.
    fn covered(&self) -> &[FacePart] {
        self.face.as_ref().map_or(&[], |face| &face.covered)
    }
}

/// Contents of a recording.
pub(super) struct Survey {
    /// Frame numbers, ascending.
    pub numbers: Vec<u32>,
    /// Usual difference of the numbers of consecutive frames.
    pub step: u32,
    pub size: ImageSize,
    pub fps: f64,
    /// Times of the frames; empty if no video states them.
    pub clock: Clock,
    /// Notes on the video.
    pub notes: Vec<String>,
    /// Indices of the first frames after cuts.
    pub cuts: Vec<usize>,
    pub looks: Vec<Look>,
    /// BLAKE3 of the names and bytes of its files.
    pub content: blake3::Hash,
}

/// Consecutive frames without a cut, with a face throughout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stretch {
    /// Index of its first frame.
    pub first: usize,
    /// Index of its last frame.
    pub last: usize,
    /// Indices of the first and the last frame that may also belong to it: those up to the adjacent looks without the face.
    pub reach: (usize, usize),
}

/// An event between stretches that is reported to the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// First frame after a cut.
    Cut(usize),
    /// First look without a face.
    Gone(usize),
    /// First look with a face again.
    Back(usize),
    /// First look with another person's face.
    Other(usize),
}

/// Frames in which something hides parts of the followed face.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Covered {
    /// Index of the first frame.
    pub first: usize,
    /// Index of the last frame.
    pub last: usize,
    /// What is hidden.
    pub parts: Vec<FacePart>,
}

/// Number of looks in a row in which a face is covered, if it is: in a single one, a strong expression may look so.
const COVERED_LOOKS: usize = 2;

/// Shortest stretch that may show a rest and an expression, seconds.
pub(super) const SHORTEST: f64 = 1.0;
/// Shortest stretch that is tracked, seconds: it can be measured against the rest of another one.
pub(super) const SHORTEST_TRACKED: f64 = 0.3;

/// Message about frames that last less than [`SHORTEST`].
pub(super) fn too_short(named: &str, frames: usize, fps: f64) -> String {
    let (found, least) = (count(frames, "frame", "frames"), (SHORTEST * fps).ceil().max(2.0));
    format!("{named}: too short for a rest and an expression: {found}; at least {least} are needed at {}", per_second(fps))
}

/// Note about numbers that are missing, if there are any.
fn gaps_said(numbers: &[u32], step: u32) -> Option<String> {
    let gaps = numbers.windows(2).filter(|pair| pair[1].saturating_sub(pair[0]) > step);
    let named: Vec<String> = gaps
        .map(|pair| match (pair[0].saturating_add(step), pair[1].saturating_sub(step)) {
            (first, last) if first < last => format!("{first} to {last}"),
            (only, _) => only.to_string(),
        })
        .collect();
    (!named.is_empty()).then(|| format!("frames are missing: {}", listed(&named, 6)))
}

impl Survey {
    /// Runs the first pass.
    pub fn new(recording: &Recording, tick: Tick<'_>) -> Result<Self, RecordingError> {
        let (source, fps) = (&recording.frames, recording.fps);
        if matches!(source, FrameSource::Images(files) if files.len() == 1) {
            return Err(RecordingError::Nothing { reasons: vec![too_short("the only frame", 1, fps.unwrap_or(USUAL_FPS))] });
        }
        let mut reader = SequenceReader::open(source)?;
        let total = match source {
            FrameSource::Images(files) => Some(files.len()),
            FrameSource::Video { .. } => reader.stated_frames(),
        };
        let stated = fps.or_else(|| reader.fps()).unwrap_or(USUAL_FPS);
        let step = ((BETWEEN_LOOKS * stated).round() as usize).max(1);
        let (mut numbers, mut cuts, mut looks, mut size) = (Vec::new(), Vec::new(), Vec::new(), None);
        let mut waiting: Vec<(usize, Frame)> = Vec::new();
        let mut scenes = Scenes::default();
        // A video's stated rate may be wrong; then the times of the frames determine the next look.
        let (longest, mut looked) = (BETWEEN_LOOKS + 0.5 / stated, None);
        while let Some(frame) = reader.next() {
            let frame = frame?;
            let time = reader.time().filter(|_| fps.is_none());
            let is_due = time.zip(looked).is_some_and(|(time, looked)| time - looked > longest + TIME_STEP);
            let place = numbers.len();
            numbers.push(frame.number());
            size.get_or_insert(frame.size());
            let is_cut = scenes.is_cut(frame.image());
            if is_cut {
                cuts.push(place);
            }
            let is_regular = is_due || place.is_multiple_of(step);
            if is_regular {
                looked = time.or(looked);
            }
            if is_cut || is_regular {
                waiting.push((place, frame));
            }
            if waiting.len() == TOGETHER {
                looks.extend(look_at(std::mem::take(&mut waiting))?);
            }
            if !tick(RecordingStep::Looking, place + 1, total) {
                return Err(RecordingError::Interrupted);
            }
        }
        looks.extend(look_at(waiting)?);
        let size = size.ok_or(RecordingError::NoFrames)?;
        let marked =
            recording.marks.as_ref().and_then(|(frame, marks)| Some((numbers.binary_search(frame).ok()?, middle_of(marks))));
        let scene_of = |place: usize| cuts.partition_point(|&cut| cut <= place);
        let mut scenes: Vec<Vec<(usize, Vec<FoundFace>)>> = vec![Vec::new(); cuts.len() + 1];
        for look in looks {
            scenes[scene_of(look.0)].push(look);
        }
        let marked_in = |scene: usize| marked.filter(|(place, _)| scene_of(*place) == scene);
        let looks = scenes.into_iter().enumerate().flat_map(|(k, looks)| followed(looks, marked_in(k))).collect();
        let clock = fps.map_or_else(|| reader.clock(), |fps| Clock::even(Some(fps)));
        let step = usual_step(&numbers);
        let gaps = gaps_said(&numbers, step);
        let notes =
            clock.remark().into_iter().chain(gaps).chain(reader.remark()).chain(unread_beside(&recording.frames)).collect();
        let fps = clock.fps.unwrap_or(USUAL_FPS);
        let clock = Clock { fps: Some(fps), ..clock };
        Ok(Self { numbers, step, size, fps, clock, notes, cuts, looks, content: reader.into_content_blake3()? })
    }

    /// Whether no frame is missing between two numbers.
    pub fn are_consecutive(&self, a: u32, b: u32) -> bool {
        a.abs_diff(b) <= self.step
    }

    /// Returns the stretches with a face, and the events between them.
    pub fn stretches(&self) -> (Vec<Stretch>, Vec<Turn>) {
        let (mut stretches, mut turns): (Vec<Stretch>, Vec<Turn>) = (Vec::new(), Vec::new());
        let starts: Vec<usize> = std::iter::once(0).chain(self.cuts.iter().copied()).collect();
        turns.extend(self.cuts.iter().map(|&cut| Turn::Cut(cut)));
        // Whether the loss of the face was reported.
        let mut gone = false;
        for (k, &start) in starts.iter().enumerate() {
            let end = starts.get(k + 1).copied().unwrap_or(self.numbers.len());
            let looks: Vec<&Look> = self.looks.iter().filter(|look| (start..end).contains(&look.place)).collect();
            // A face that is missed in a single look counts as seen.
            let is_seen = |k: usize| {
                let at = |k: usize| looks.get(k).is_some_and(|look| look.face.is_some());
                at(k) || (k > 0 && at(k - 1) && at(k + 1))
            };
            // First look of the stretch, and first frame that may belong to it.
            let mut open: Option<(usize, usize)> = None;
            for (k, look) in looks.iter().enumerate() {
                let before = k.checked_sub(1).map_or(start, |k| looks[k].place);
                match (is_seen(k), open) {
                    (true, None) => open = Some(if k == 0 { (start, start) } else { (look.place, before + 1) }),
                    (false, Some((first, from))) => {
                        stretches.push(Stretch { first, last: before, reach: (from, look.place - 1) });
                        open = None;
                    }
                    (true, Some((first, from))) if looks[k - 1].person != look.person => {
                        stretches.push(Stretch { first, last: before, reach: (from, before) });
                        open = Some((look.place, look.place));
                        turns.push(Turn::Other(look.place));
                    }
                    _ => {}
                }
                if is_seen(k) == gone {
                    turns.push(if gone { Turn::Back(look.place) } else { Turn::Gone(look.place) });
                    gone = !gone;
                }
            }
            stretches.extend(open.map(|(first, from)| Stretch { first, last: end - 1, reach: (from, end - 1) }));
        }
        (stretches, turns)
    }

    /// Returns the frames in which something covers parts of the followed face. When it came and went is known to a look: the frames
    /// between the last look without it and the next one count.
    pub fn covered(&self) -> Vec<Covered> {
        let scene_of = |look: &Look| self.cuts.partition_point(|&cut| cut <= look.place);
        let is_one = |a: &Look, b: &Look| scene_of(a) == scene_of(b) && a.covered().is_empty() == b.covered().is_empty();
        let mut start = 0;
        let mut covered = Vec::new();
        for run in self.looks.chunk_by(is_one) {
            let (from, to) = (start, start + run.len());
            start = to;
            if run.len() < COVERED_LOOKS || run.iter().any(|look| look.covered().is_empty()) {
                continue;
            }
            let scene = scene_of(&run[0]);
            let (begin, end) = (
                scene.checked_sub(1).and_then(|k| self.cuts.get(k)).copied().unwrap_or(0),
                self.cuts.get(scene).copied().unwrap_or(self.numbers.len()),
            );
            let before = from.checked_sub(1).and_then(|k| self.looks.get(k)).map_or(begin, |look| look.place + 1);
            let after = self.looks.get(to).map_or(end, |look| look.place);
            let parts = FacePart::ALL.into_iter().filter(|part| run.iter().any(|look| look.covered().contains(part))).collect();
            covered.push(Covered { first: before.max(begin), last: after.min(end).saturating_sub(1), parts });
        }
        covered
    }

    /// Message about covered parts of a face.
    pub fn covered_message(&self, covered: &Covered) -> String {
        let number = |place: usize| self.numbers.get(place).copied().unwrap_or_default();
        let said = FacePart::said_covered(&covered.parts).unwrap_or_default();
        format!("frames {} to {}: {said}; they are left out", number(covered.first), number(covered.last))
    }

    /// Message about an event. `tracked` has the indices of the first and last frames of all tracked ranges.
    pub fn turn_message(&self, turn: Turn, tracked: &[(usize, usize)]) -> String {
        let number = |place: usize| self.numbers.get(place).copied().unwrap_or_default();
        match turn {
            Turn::Cut(place) => {
                let end = self.cuts.iter().copied().find(|&cut| cut > place).unwrap_or(self.numbers.len());
                let shows = self.looks.iter().any(|look| (place..end).contains(&look.place) && look.face.is_some());
                let person = "; if it shows another person, give its sequences another subject";
                format!("frame {}: a new scene begins{}", number(place), if shows { person } else { ", without a face" })
            }
            Turn::Gone(place) => {
                let before = self.looks.iter().map(|look| look.place).take_while(|&look| look < place).last().unwrap_or_default();
                let ends = tracked.iter().map(|&(_, last)| last + 1).filter(|end| (before + 1..=place).contains(end)).max();
                format!("frame {}: from here no face is found", number(ends.unwrap_or(place)))
            }
            Turn::Back(place) => {
                let first =
                    tracked.iter().find(|&&(first, last)| (first..=last).contains(&place)).map_or(place, |&(first, _)| first);
                format!("frame {}: a face is found again", number(first))
            }
            Turn::Other(place) => {
                format!("frame {}: from here another face is followed; give its sequences another subject", number(place))
            }
        }
    }

    /// Message that several faces are seen, with the followed one, from the first look that shows them; `None` if marks select the face.
    pub fn several(&self, marked: bool) -> Option<String> {
        let (taken, another) = ("the largest on average is followed", "to follow another face, give its marks for a frame");
        let message = |look: &Look| {
            let said = look.face.as_ref()?.chosen_of_several(taken, another)?;
            Some(format!("frame {}: {said}", self.numbers.get(look.place)?))
        };
        if marked { None } else { self.looks.iter().find_map(message) }
    }

    /// The look with the most typical face of a stretch, among trusted faces.
    pub fn usual_face(&self, stretch: Stretch, bench: &Workbench) -> Option<&Look> {
        let trusted = |look: &&Look| {
            (stretch.first..=stretch.last).contains(&look.place) && look.face.as_ref().is_some_and(|face| face.trusted)
        };
        let looks: Vec<&Look> = self.looks.iter().filter(trusted).collect();
        let shapes: Vec<Vec<f32>> =
            looks.iter().map(|look| look.face.as_ref().map(|face| shape(&face.marks, bench)).unwrap_or_default()).collect();
        let shapes: Vec<&[f32]> = shapes.iter().map(Vec::as_slice).collect();
        looks.get(densest(&shapes, ALIKE)?).copied()
    }
}

/// Detects the faces of frames, the largest first.
fn look_at(frames: Vec<(usize, Frame)>) -> Result<Vec<(usize, Vec<FoundFace>)>, RecordingError> {
    let look = |(place, frame): (usize, Frame)| Ok((place, found_faces(&frame, None)?));
    frames.into_par_iter().map(look).collect()
}

/// Coordinates of the nodes that expressions move, in head axes and eye distances.
fn shape(marks: &[Correspondence], bench: &Workbench) -> Vec<f32> {
    let frontal = bench.wireframe.frontal();
    let place = |node: u16| marks.iter().find(|m| m.node == NodeId(node)).map(|m| Point2::new(m.position.x, -m.position.y));
    let still = stable_nodes(&bench.tables, bench.wireframe.node_count());
    let pairs: Vec<(Point2<f64>, Point2<f64>)> =
        still.iter().filter_map(|&k| Some((place(u16::try_from(k).ok()?)?, frontal[k]))).collect();
    let (seen, own): (Vec<_>, Vec<_>) = pairs.into_iter().unzip();
    let upright = Similarity::fit(&seen, &own, None).unwrap_or_else(|_| Similarity::identity());
    let at = |&node: &u16| place(node).map_or_else(|| frontal[usize::from(node)], |p| upright.apply(&p));
    MOVED.iter().map(at).flat_map(|p| [p.x, p.y]).map(|v| (v / crate::pose::HEAD_ES) as f32).collect()
}

/// Distinguishes cuts from motion.
#[derive(Default)]
struct Scenes {
    before: Option<Vec<f32>>,
    usual: f32,
}

impl Scenes {
    fn is_cut(&mut self, image: &GrayImage) -> bool {
        let small = image::imageops::resize(image, SMALL.0, SMALL.1, FilterType::Triangle);
        let values: Vec<f32> = small.as_raw().iter().map(|&v| f32::from(v)).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let values: Vec<f32> = values.into_iter().map(|v| v - mean).collect();
        let difference = self
            .before
            .as_ref()
            .map(|before| before.iter().zip(&values).map(|(a, b)| (a - b).abs()).sum::<f32>() / values.len() as f32);
        self.before = Some(values);
        let Some(difference) = difference else { return false };
        let is_cut = difference > CUT && difference > CUT_FACTOR * self.usual;
        if !is_cut {
            self.usual = 0.9 * self.usual + 0.1 * difference;
        }
        is_cut
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_scene_is_a_cut_and_motion_and_a_flash_are_none() {
        let picture = |shift: u32, bright: u8| {
            GrayImage::from_fn(64, 48, |x, y| image::Luma([bright + 90 * u8::from((x + shift) / 16 % 2 == y / 16 % 2)]))
        };
        let mut scenes = Scenes::default();
        let cuts: Vec<bool> = [(0, 10), (1, 10), (2, 10), (3, 100), (4, 100), (20, 10), (21, 10)]
            .map(|(s, b)| scenes.is_cut(&picture(s, b)))
            .to_vec();
        assert_eq!(cuts, [false, false, false, false, false, true, false]);
    }

    #[test]
    fn missing_numbers_are_named() {
        let said = |numbers: &[u32]| gaps_said(numbers, usual_step(numbers));
        assert_eq!(said(&[1, 2, 3, 4]), None);
        assert_eq!(said(&[2, 4, 6, 8]), None, "every second frame");
        assert_eq!(said(&[1, 2, 3, 5, 6, 7, 12, 13]).unwrap(), "frames are missing: 4; 8 to 11");
        assert_eq!(said(&[7]), None);
    }

    const CUT: &str = "frame 71: a new scene begins; if it shows another person, give its sequences another subject";

    /// A recording of 80 frames with a look at every tenth.
    fn survey(seen: [Option<usize>; 8], cuts: Vec<usize>) -> Survey {
        let face = || FoundFace {
            marks: Vec::new(),
            expected_error: 0.01,
            eye_distance: 60.0,
            trusted: true,
            others: 0,
            covered: Vec::new(),
        };
        let look = |(k, person): (usize, &Option<usize>)| Look {
            place: 10 * k,
            face: person.map(|_| face()),
            person: person.unwrap_or(0),
        };
        Survey {
            numbers: (1..=80).collect(),
            step: 1,
            size: ImageSize { width: 64, height: 48 },
            fps: 25.0,
            clock: Clock::even(Some(25.0)),
            notes: Vec::new(),
            cuts,
            looks: seen.iter().enumerate().map(look).collect(),
            content: blake3::hash(b""),
        }
    }

    #[test]
    fn faces_form_stretches_and_gaps_are_reported() {
        let (a, none) = (Some(0), None);
        let survey = survey([a, a, none, a, none, none, a, a], vec![70]);
        let (stretches, turns) = survey.stretches();
        let of = |first, last, reach| Stretch { first, last, reach };
        assert_eq!(stretches, [of(0, 30, (0, 39)), of(60, 69, (51, 69)), of(70, 79, (70, 79))]);
        let messages =
            |tracked: &[(usize, usize)]| turns.iter().map(|&turn| survey.turn_message(turn, tracked)).collect::<Vec<_>>();
        let said = [CUT, "frame 41: from here no face is found", "frame 61: a face is found again"];
        assert_eq!(messages(&[]), said);
        // The face is visible after the last look with it, and before the next look with it.
        let said = [CUT, "frame 36: from here no face is found", "frame 57: a face is found again"];
        assert_eq!(messages(&[(0, 34), (56, 69), (70, 79)]), said);
    }

    #[test]
    fn what_hides_a_face_is_told_where_two_looks_in_a_row_show_it() {
        let mut survey = survey([Some(0); 8], vec![60]);
        let mut cover = |looks: &[usize], part| {
            for &k in looks {
                survey.looks[k].face.as_mut().unwrap().covered.push(part);
            }
        };
        cover(&[0, 2, 3], FacePart::Mouth);
        cover(&[3, 6, 7], FacePart::Nose);
        let covered = survey.covered();
        // The single look at the start does not count. The next cover begins after the look before and ends before the look after; the
        // last one begins with its scene.
        assert_eq!(
            covered,
            [
                Covered { first: 11, last: 39, parts: vec![FacePart::Nose, FacePart::Mouth] },
                Covered { first: 60, last: 79, parts: vec![FacePart::Nose] },
            ]
        );
        assert_eq!(
            survey.covered_message(&covered[0]),
            "frames 12 to 40: the nose and the mouth look covered; they are left out"
        );
    }

    #[test]
    fn another_person_is_another_stretch() {
        let (a, b) = (Some(0), Some(1));
        let survey = survey([a, a, a, b, b, b, a, a], Vec::new());
        let (stretches, turns) = survey.stretches();
        assert_eq!(stretches, [(0, 20), (30, 50), (60, 79)].map(|reach| Stretch { first: reach.0, last: reach.1, reach }));
        assert_eq!(turns, [Turn::Other(30), Turn::Other(60)]);
        assert_eq!(
            survey.turn_message(turns[0], &[]),
            "frame 31: from here another face is followed; give its sequences another subject"
        );
    }
}
