//! Times of the frames of a video.
//!
//! The frame rate in a container may be a time base (1000 for a browser's recording), or a mean of uneven frames (telephones, screens,
//! cameras that drop frames). The frames' own times are therefore used.

use crate::output::{nine_digits, per_second};

/// Smallest share of frames with a time for times to be used. Codecs give no times for the last frames.
const TIMED: f64 = 0.5;
/// Largest deviations from even times, as shares of a frame distance. Within the first, times confirm the stated rate; within the second,
/// they are even at another rate.
const EVEN: [f64; 2] = [0.5, 0.25];
/// Tolerance for times, s. Files store whole milliseconds, so that each time, including the first, has an error of up to half of one.
const ROUNDED: f64 = 1.001e-3;
/// Largest mean number of frame numbers per frame with a time; above it, the numbers do not count frames.
const NUMBERS_FOR_A_FRAME: usize = 100;
/// Number of frame distances from which unknown times are extrapolated.
const CONTINUED: usize = 9;

/// Frames per second, with the frames' own times if these are uneven.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clock {
    /// Frames per second, if known; the mean if frames have their own times.
    pub fps: Option<f64>,
    /// Seconds from the first frame to every frame, by ascending number, if uneven.
    pub times: Option<Vec<f64>>,
}

impl Clock {
    /// Frames at even distances.
    pub fn even(fps: Option<f64>) -> Self {
        Self { fps, times: None }
    }

    /// The clock of frames with these ascending numbers and times in seconds from an arbitrary start. It is unknown for fewer than two
    /// frames, or if the numbers do not count frames.
    pub(crate) fn of_times(frames: impl IntoIterator<Item = (u32, f64)>) -> Self {
        let times = FrameTimes(frames.into_iter().map(|(number, seconds)| (number, Some(seconds))).collect());
        let span = times.0.first().zip(times.0.last()).map_or(0, |(first, last)| last.0.saturating_sub(first.0));
        let counts_frames = span as usize <= NUMBERS_FOR_A_FRAME * times.0.len();
        if counts_frames { times.clock(None, None) } else { Self::default() }
    }

    /// Seconds from the first frame to the one `steps` numbers later; `None` if unknown.
    pub fn seconds(&self, steps: u32) -> Option<f64> {
        let own = self.times.as_ref().and_then(|times| times.get(steps as usize).copied());
        own.or_else(|| self.fps.filter(|fps| *fps > 0.0).map(|fps| f64::from(steps) / fps))
    }

    /// Note about uneven times.
    pub fn remark(&self) -> Option<String> {
        /// Frames per second below which the times may be milliseconds.
        const SLOW: f64 = 1.0;
        if let Some(fps) = self.fps.filter(|fps| *fps < SLOW) {
            return Some(format!(
                "the times give a rate of {}; if they are in milliseconds, convert them to seconds",
                per_second((fps * 1e4).round() / 1e4)
            ));
        }
        let times = self.times.as_ref()?;
        let apart = times.windows(2).map(|pair| pair[1] - pair[0]);
        let (least, most) = apart.fold((f64::INFINITY, 0.0_f64), |(least, most), d| (least.min(d), most.max(d)));
        let mean = (self.fps? * 100.0).round() / 100.0;
        let ms = |seconds: f64| nine_digits((seconds * 1e3).round());
        Some(format!(
            "the frames are {} to {} ms apart (mean rate: {}); every frame keeps its own time",
            ms(least),
            ms(most),
            per_second(mean)
        ))
    }
}

/// Times of the frames of a video, collected during reading.
#[derive(Clone, Debug, Default)]
pub(super) struct FrameTimes(Vec<(u32, Option<f64>)>);

impl FrameTimes {
    /// Adds a frame and its time from the start of the video, s.
    pub(super) fn enter(&mut self, number: u32, seconds: Option<f64>) {
        self.0.push((number, seconds));
    }

    /// Time of the last added frame.
    pub(super) fn last(&self) -> Option<f64> {
        self.0.last().and_then(|(_, seconds)| *seconds)
    }

    /// The clock of the frames. `stated` is the container's rate, frames per second, `duration` that of the video, s.
    pub(super) fn clock(&self, stated: Option<f64>, duration: Option<f64>) -> Clock {
        let Some(known) = self.known() else { return Clock::even(stated) };
        let ([first, .., last], Some(&(lowest, _))) = (known.as_slice(), self.0.iter().min_by_key(|(number, _)| *number)) else {
            return Clock::even(stated);
        };
        let is_even = |fps: f64, tolerance: f64| {
            known.iter().all(|(number, time)| (time - first.1 - f64::from(number - first.0) / fps).abs() <= tolerance)
        };
        let mean = f64::from(last.0 - first.0) / (last.1 - first.1);
        let whole = mean.round().max(1.0);
        let (broadcast, mean) = (whole / 1.001, (mean * 1e6).round() / 1e6);
        let believable = stated.filter(|&fps| is_even(fps, EVEN[0] / fps));
        let usual = || [whole, broadcast].into_iter().find(|&fps| is_even(fps, ROUNDED));
        let even = believable.or_else(usual).or_else(|| Some(mean).filter(|&fps| is_even(fps, EVEN[1] / fps)));
        match even {
            Some(fps) => Clock::even(Some(fps)),
            None => Clock { fps: Some(mean), times: Some(self.filled(&known, lowest, duration)) },
        }
    }

    /// End of the last frame, s from the start of the video.
    pub(super) fn end(&self) -> Option<f64> {
        let known = self.known()?;
        let ([.., last], (highest, _)) = (known.as_slice(), self.0.iter().max_by_key(|(number, _)| *number)?) else {
            return None;
        };
        Some(last.1 + f64::from(highest - last.0 + 1) * step(&known))
    }

    /// Numbers and times, both ascending, of the frames that have a time; `None` if too few have.
    fn known(&self) -> Option<Vec<(u32, f64)>> {
        let mut frames = self.0.clone();
        frames.sort_by_key(|(number, _)| *number);
        let mut known: Vec<(u32, f64)> = Vec::with_capacity(frames.len());
        for (number, seconds) in frames {
            let later = |t: &f64| t.is_finite() && known.last().is_none_or(|(before, time)| number > *before && t > time);
            if let Some(seconds) = seconds.filter(later) {
                known.push((number, seconds));
            }
        }
        (known.len() >= 2 && known.len() as f64 >= TIMED * self.0.len() as f64).then_some(known)
    }

    /// Seconds of all frames from the first, with unknown times interpolated or extrapolated. Decoders give no times to the frames that
    /// they still hold at the end of the file; these share the remaining duration of the video.
    fn filled(&self, known: &[(u32, f64)], lowest: u32, duration: Option<f64>) -> Vec<f64> {
        let highest = self.0.iter().map(|(number, _)| *number).max().unwrap_or(lowest);
        let reversed: Vec<(u32, f64)> = known.iter().rev().copied().collect();
        let ahead = step(&reversed);
        let left = |&(number, time): &(u32, f64)| duration.map(|end| (end - time) / f64::from(highest - number + 1));
        let behind = known.last().and_then(left).filter(|&step| is_usual(known, step)).unwrap_or_else(|| step(known));
        let at = |number: u32| {
            let after = known.partition_point(|(other, _)| *other < number);
            match (after.checked_sub(1).and_then(|k| known.get(k)), known.get(after)) {
                (_, Some(&(other, time))) if other == number => time,
                (Some(&(a, from)), Some(&(b, to))) => from + (to - from) * f64::from(number - a) / f64::from(b - a),
                (Some(&(a, from)), None) => from + f64::from(number - a) * behind,
                (None, Some(&(b, to))) => to - f64::from(b - number) * ahead,
                (None, None) => 0.0,
            }
        };
        let start = at(lowest);
        (lowest..=highest).map(|number| ((at(number) - start) * 1e6).round() / 1e6).collect()
    }
}

/// Whether `step`, s, is a usual distance of the frames, within rounding.
fn is_usual(known: &[(u32, f64)], step: f64) -> bool {
    let apart = known.windows(2).map(|pair| (pair[1].1 - pair[0].1) / f64::from(pair[1].0.abs_diff(pair[0].0).max(1)));
    let (least, most) = apart.fold((f64::INFINITY, 0.0_f64), |(least, most), d| (least.min(d), most.max(d)));
    (least - ROUNDED..=most + ROUNDED).contains(&step)
}

/// Usual distance of the last frames of a list, s.
fn step(known: &[(u32, f64)]) -> f64 {
    let apart = |pair: &[(u32, f64)]| (pair[1].1 - pair[0].1).abs() / f64::from(pair[1].0.abs_diff(pair[0].0).max(1));
    let mut steps: Vec<f64> = known.windows(2).rev().take(CONTINUED).map(apart).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(ms: impl IntoIterator<Item = f64>) -> FrameTimes {
        let mut times = FrameTimes::default();
        (1..).zip(ms).for_each(|(number, ms)| times.enter(number, Some(ms / 1e3)));
        times
    }

    #[test]
    fn tables_tell_times_of_their_own() {
        // Four frames in 0.16 seconds; the frames between do not exist.
        assert_eq!(Clock::of_times([(1, 0.04), (5, 0.2)]), Clock::even(Some(25.0)));
        let uneven = Clock::of_times([(7, 1.0), (8, 1.04), (9, 1.2), (10, 1.24)]);
        assert_eq!(uneven.times, Some(vec![0.0, 0.04, 0.2, 0.24]));
        // Equal times, a single frame, and numbers that do not count frames.
        assert_eq!(Clock::of_times([(1, 0.04), (2, 0.04)]), Clock::default());
        assert_eq!(Clock::of_times([(1, 0.04)]), Clock::default());
        assert_eq!(Clock::of_times([(1, 0.0), (4_000_000_000, 1.0)]), Clock::default());
    }

    #[test]
    fn a_rate_that_the_times_bear_out_is_kept() {
        let even = times((0..40).map(|k| f64::from(k) * 1001.0 / 24.0));
        assert_eq!(even.clock(Some(23.976), None), Clock::even(Some(23.976)));
        // A telephone's frames deviate by a few milliseconds, and the last ones have no time.
        let mut shaken = times((0..40).map(|k| f64::from(k) * 40.0 + f64::from(k % 3) * 4.0));
        (41..=43).for_each(|number| shaken.enter(number, None));
        assert_eq!(shaken.clock(Some(25.0), None), Clock::even(Some(25.0)));
        // Too little information for another rate.
        assert_eq!(times([0.0]).clock(Some(25.0), None), Clock::even(Some(25.0)));
        assert_eq!(times([0.0; 9]).clock(None, None), Clock::default());
    }

    #[test]
    fn a_time_base_is_no_rate() {
        let of = |fps: f64| times((0..90).map(|k| (f64::from(k) * 1e3 / fps).round())).clock(Some(1000.0), None);
        assert_eq!(of(25.0), Clock::even(Some(25.0)));
        assert_eq!(of(30.0), Clock::even(Some(30.0)));
        assert_eq!(of(30.0 / 1.001), Clock::even(Some(30.0 / 1.001)));
        assert!((of(12.7).fps.unwrap() - 12.7).abs() < 0.01 && of(12.7).times.is_none());
        assert_eq!(times((0..9).map(f64::from)).clock(Some(1000.0), None), Clock::even(Some(1000.0)));
    }

    #[test]
    fn frames_that_are_not_even_have_their_own_times() {
        // 5 frames 40 ms apart, then 80 ms, and two without a time.
        let mut uneven = times([0.0, 40.0, 80.0, 120.0, 160.0, 240.0, 320.0, 400.0, 480.0, 560.0, 640.0]);
        uneven.enter(12, None);
        uneven.enter(13, Some(0.0));
        let clock = uneven.clock(Some(20.0), None);
        assert_eq!(clock.fps, Some(15.625), "10 frames in 0.64 s");
        let expected = [0.0, 0.04, 0.08, 0.12, 0.16, 0.24, 0.32, 0.4, 0.48, 0.56, 0.64, 0.72, 0.8];
        assert_eq!(clock.times.as_deref(), Some(&expected[..]));
        assert_eq!((clock.seconds(5), clock.seconds(12)), (Some(0.24), Some(0.8)));
        assert_eq!(
            clock.remark().unwrap(),
            "the frames are 40 to 80 ms apart (mean rate: 15.63 frames per second); every frame keeps its own time"
        );
        assert!((uneven.end().unwrap() - 0.88).abs() < 1e-9);
        // The video is 0.78 s long: three frames share 0.14 s. Of 20 s the last frame would last 6.
        let ends = |duration| uneven.clock(Some(20.0), Some(duration)).times.unwrap()[11..].to_vec();
        assert_eq!(ends(0.78), [0.686667, 0.733333]);
        assert_eq!(ends(20.0), [0.72, 0.8]);
        // In reverse order, from the middle of the video, with a frame without a time in between: the first is at 0.
        let mut back = FrameTimes::default();
        for (number, ms) in [(9, 900.0), (8, 700.0), (6, 500.0), (5, 470.0)] {
            back.enter(number, Some(ms / 1e3));
        }
        back.enter(7, None);
        assert_eq!(back.clock(None, None).times.unwrap(), [0.0, 0.03, 0.13, 0.23, 0.43]);
    }
}
