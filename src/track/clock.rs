//! Times at which the frames of a track are shown.

use super::TrackInfo;
use crate::{interpolation::FPS, sequence::Clock};

/// Most frames per existing frame: with larger gaps, the numbers do not count frames.
pub(crate) const MOST_FILLED: u64 = 10;

/// Returns the usual step of ascending numbers, at least 1: the median one.
pub(crate) fn usual_step(numbers: &[u32]) -> u32 {
    let mut steps: Vec<u32> = numbers.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).collect();
    steps.sort_unstable();
    steps.get(steps.len() / 2).copied().unwrap_or(1).max(1)
}

/// Returns the smallest step of ascending numbers and their total span in such steps; `None` if a step is not a multiple of the smallest.
fn whole_steps(numbers: &[u32]) -> Option<(u32, u64)> {
    let steps = || numbers.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
    let usual = steps().min().unwrap_or(1).max(1);
    steps().all(|step| step.is_multiple_of(usual)).then(|| (usual, steps().map(|step| u64::from(step / usual)).sum()))
}

/// What the frame numbers of a track count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Counted {
    /// Consecutive frames of a video.
    Frames,
    /// Pictures, which may be numbered in steps.
    Pictures,
    /// Numbers of landmark frames, of unknown kind.
    Landmarks,
}

impl Counted {
    /// Whether one step of the numbers is one frame.
    fn is_in_steps(self, step: u32, clock: &Clock) -> bool {
        match self {
            Self::Frames => false,
            Self::Pictures => true,
            // Numbers are milliseconds when the step is a frame's duration. Small steps may be every tenth frame of a fast camera.
            Self::Landmarks => {
                let is_frame = |fps: f64| (1000.0 / fps).round() == f64::from(step);
                u64::from(step) > MOST_FILLED && clock.times.is_none() && clock.fps.is_some_and(is_frame)
            }
        }
    }
}

/// Returns `clock` with its rate per unit of the frame numbers, if one step of the numbers is one frame.
pub(super) fn by_number(clock: Clock, counted: Counted, numbers: impl IntoIterator<Item = u32>) -> Clock {
    let mut numbers: Vec<u32> = numbers.into_iter().collect();
    numbers.sort_unstable();
    match whole_steps(&numbers) {
        Some((usual, _)) if usual > 1 && counted.is_in_steps(usual, &clock) => {
            Clock::even(clock.fps.map(|fps| fps * f64::from(usual)))
        }
        _ => clock,
    }
}

/// Whether ascending numbers count frames of which some are missing: all steps are multiples of one step, most are equal to it, and most
/// frames are there. Numbers may also be milliseconds, dates or a camera's counter.
fn counts_frames(numbers: &[u32]) -> bool {
    whole_steps(numbers).is_some_and(|(usual, all)| {
        let as_usual = numbers.windows(2).filter(|pair| pair[1].saturating_sub(pair[0]) == usual).count();
        2 * as_usual >= numbers.len().saturating_sub(1) && all <= MOST_FILLED * numbers.len() as u64
    })
}

/// Whether ascending numbers may count frames, some of them missing, when the rate is known: their span is not much larger than their
/// count.
fn may_count_frames(numbers: &[u32]) -> bool {
    let span = || numbers.first().zip(numbers.last()).map_or(0, |(first, last)| u64::from(last.saturating_sub(*first)));
    whole_steps(numbers).map_or_else(span, |(_, all)| all) <= MOST_FILLED * numbers.len() as u64
}

/// Returns the times at which the frames of a track are shown, in the order of its table.
///
/// The clock has a rate if known, and the seconds from the first frame to each where frames are missing or have their own times. `info` is
/// the content of the `.json` beside the table. Without a rate, frames are counted at [`FPS`] if their numbers count frames. Frames may go
/// back in time, as from an apex; if they are in no order, the times are unknown.
pub(crate) fn clock_of_frames(numbers: &[u32], info: Option<&TrackInfo>) -> Clock {
    /// Largest deviation, as a share of a frame, of frames that count as even.
    const TOLERANCE: f64 = 1e-3;
    let fps = info.and_then(|info| info.fps);
    let mut numbers = numbers.to_vec();
    let goes_back = numbers.first() > numbers.last();
    if goes_back {
        numbers.reverse();
    }
    let clock = match info.filter(|info| info.clock() != Clock::default()) {
        // Numbers of a video are its frames, even if few of them are in the table.
        Some(info) if info.times.is_some() || info.is_of_video() || may_count_frames(&numbers) => {
            info.clock_of_numbers(numbers.iter().copied())
        }
        None if counts_frames(&numbers) => {
            by_number(Clock::even(Some(f64::from(FPS))), Counted::Pictures, numbers.iter().copied())
        }
        _ => return Clock::even(fps),
    };
    let (Some(&first), true) = (numbers.first(), numbers.is_sorted_by(|a, b| a < b)) else { return Clock::even(fps) };
    let times: Option<Vec<f64>> = numbers.iter().map(|number| clock.seconds(number - first)).collect();
    let Some(mut times) = times.filter(|times| times.len() > 1 && times.is_sorted_by(|a, b| a < b)) else {
        return Clock::even(fps);
    };
    if goes_back {
        let last = times[times.len() - 1];
        times = times.into_iter().rev().map(|time| last - time).collect();
    }
    let step = times[1];
    if times.windows(2).any(|pair| (pair[1] - pair[0] - step).abs() >= TOLERANCE * step) {
        return Clock { fps, times: Some(times) };
    }
    // For example, a track of every second frame of a video has half its rate.
    Clock::even(fps.map(|fps| if (fps * step - 1.0).abs() < TOLERANCE { fps } else { 1.0 / step }))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::{
        fit::FitOptions,
        sequence::ImageSize,
        track::{TRACK_SCHEMA, TrackOptions, read_track, summarize},
        units::SequenceId,
        wireframe::Face,
    };

    #[test]
    fn frames_that_are_missing_take_their_time() {
        let near = |clock: Clock, fps: Option<f64>, times: &[f64]| {
            assert_eq!(clock.fps, fps);
            let found = clock.times.unwrap_or_default();
            assert_eq!(found.len(), times.len(), "{found:?}");
            assert!(found.iter().zip(times).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        };
        // Unknown rate: 25 frames per second. Folders may be numbered in steps.
        near(clock_of_frames(&[1, 2, 5], None), None, &[0.0, 0.04, 0.16]);
        near(clock_of_frames(&[2, 4, 10], None), None, &[0.0, 0.04, 0.16]);
        near(clock_of_frames(&[9, 8, 5], None), None, &[0.0, 0.04, 0.16]);
        for even in [&[3, 4, 5][..], &[2, 4, 6], &[5, 4, 3], &[7], &[1, 5, 2]] {
            near(clock_of_frames(even, None), None, &[]);
        }
        // Numbers that are milliseconds or dates, or include an unrelated frame, do not show missing frames.
        for other in [&[120_000, 120_033, 120_066, 120_100, 120_133][..], &[20_240_101, 20_240_102, 20_240_201], &[1, 500, 501]] {
            near(clock_of_frames(other, None), None, &[]);
        }
        // Pictures numbered in steps of one frame each: the rate of numbers is higher by the step.
        assert_eq!(by_number(Clock::even(Some(12.5)), Counted::Pictures, [2, 4, 10]), Clock::even(Some(25.0)));
        assert_eq!(by_number(Clock::even(Some(12.5)), Counted::Landmarks, [2, 4, 10]), Clock::even(Some(12.5)));
    }

    fn info_of_landmarks(fps: f64) -> TrackInfo {
        let face = Face::candide3();
        let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref()).unwrap();
        TrackInfo {
            schema_version: TRACK_SCHEMA,
            made_by: String::new(),
            units: BTreeMap::new(),
            id: SequenceId { subject: "S001".to_owned(), sequence: "005".to_owned() },
            emotion: "happiness".to_owned(),
            metadata: BTreeMap::new(),
            source: vec!["landmarks.csv".to_owned()],
            image_size: ImageSize { width: 0, height: 0 },
            fps: Some(fps),
            times: None,
            notes: Vec::new(),
            marks_from: "landmarks".to_owned(),
            marks: Vec::new(),
            read: Vec::new(),
            fit: FitOptions::default(),
            track: TrackOptions::default(),
            summary: summarize(&track, &face.wireframe, &face.tables),
            inputs_blake3: String::new(),
            frames_blake3: None,
            csv_blake3: String::new(),
            neutral_frame: None,
            apex_frame: None,
            corrections: None,
        }
    }

    #[test]
    fn a_video_is_one_file_that_is_not_a_picture() {
        let mut info = info_of_landmarks(25.0);
        assert!(!info.is_of_video() && !info.has_pictures());
        info.image_size = ImageSize { width: 64, height: 48 };
        for (source, is_of_video) in [(&["smile.mp4"][..], true), (&["1.png"], false), (&["1.png", "2.png"], false)] {
            info.source = source.iter().map(|&name| name.to_owned()).collect();
            assert_eq!(info.is_of_video(), is_of_video, "{source:?}");
        }
    }

    #[test]
    fn numbers_that_count_something_else_put_nothing_between_at_a_known_rate() {
        // Landmarks: the kind of their numbers is unknown.
        let mut info = info_of_landmarks(25.0);
        let clock = |numbers: &[u32], info: &TrackInfo| clock_of_frames(numbers, Some(info));
        for other in [&[20_240_101, 20_240_102, 20_240_201][..], &[0, 33, 66, 100, 133], &[1, 2, 900]] {
            assert_eq!(clock(other, &info), Clock::even(Some(25.0)), "{other:?}");
        }
        // Milliseconds of frames at this rate, one of them missing; every 25th frame is one a second.
        assert_eq!(clock(&[0, 40, 80, 160], &info).times.unwrap_or_default(), [0.0, 0.04, 0.08, 0.16]);
        assert_eq!(clock(&[40, 80, 120], &info), Clock::even(Some(25.0)));
        assert_eq!(clock(&[1, 26, 51], &info), Clock::even(Some(1.0)));
        assert_eq!(clock(&[1, 11, 21], &info_of_landmarks(100.0)), Clock::even(Some(10.0)));
        let missing = |info: &TrackInfo| clock(&[1, 5, 9, 20], info).times.unwrap_or_default();
        assert_eq!(missing(&info), [0.0, 0.16, 0.32, 0.76]);
        // The numbers of a video count its frames, and recorded times take precedence.
        (info.source, info.image_size) = (vec!["smile.mp4".to_owned()], ImageSize { width: 64, height: 48 });
        assert_eq!(clock(&[1, 2, 901], &info).times.unwrap_or_default(), [0.0, 0.04, 36.0]);
        assert_eq!(clock(&[1, 41, 81], &info), Clock::even(Some(1.0 / 1.6)));
    }
}
