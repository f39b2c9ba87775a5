//! Frames of a track in order of time: their seconds, gaps between their numbers, and their FAPs at an even rate.

use super::FrameFeatures;
use crate::{
    fap::{FapCatalog, FapFrame, FapNumber, FapSequence, whole_rate},
    sequence::Clock,
    track::MOST_FILLED,
};

/// Returns the rows in order of time, whatever the tracking order.
pub(super) fn in_time(features: &[FrameFeatures]) -> Vec<&FrameFeatures> {
    let mut rows: Vec<&FrameFeatures> = features.iter().collect();
    rows.sort_by_key(|row| row.frame);
    rows
}

/// Returns the FAPs of a track as a file, limited to the ranges of the standard, frames by ascending number; missing frames are
/// interpolated. Frames with uneven times are resampled evenly at a whole frame rate ([`FapSequence::at_whole_rate`]). `usual` is the frame
/// rate for tracks of unknown rate.
pub fn fap_sequence(features: &[FrameFeatures], name: &str, clock: &Clock, usual: f64) -> FapSequence {
    let rows = in_time(features);
    let own = clock.fps.unwrap_or(usual);
    // Resampled frames are placed at the times of the written rate.
    let fps = if clock.times.is_some() { whole_rate(own).written } else { own };
    let limited = |fap: FapNumber, value: f64| {
        let row = FapCatalog::mpeg4().row(fap);
        if row.frontal.is_measured() { row.limited(value) } else { value }
    };
    let frame = |(k, share): (usize, f64)| {
        let mut frame = FapFrame::default();
        for &(fap, value) in &rows[k].faps {
            let value = limited(fap, value);
            let next = rows.get(k + 1).filter(|_| share > 0.0);
            let next = next.and_then(|next| next.faps.iter().find(|(other, _)| *other == fap));
            let after = next.map_or(value, |(_, after)| limited(fap, *after));
            frame.set_value(fap, Some(value + (after - value) * share));
        }
        frame
    };
    let numbers: Vec<u32> = rows.iter().map(|row| row.frame).collect();
    let frames = even_frames(&numbers, clock, fps).into_iter().map(frame).collect();
    let mut sequence = FapSequence { version: "2.1".to_owned(), name: crate::fap::name_token(name), fps, frames }.at_whole_rate();
    sequence.round();
    sequence
}

/// Returns [`every_frame`] for frames that are even in time; otherwise the positions of even frames between the existing ones.
fn even_frames(numbers: &[u32], clock: &Clock, fps: f64) -> Vec<(usize, f64)> {
    let first = numbers.first().copied().unwrap_or_default();
    let own = |times: &Vec<f64>| numbers.iter().map(|n| times.get(n.saturating_sub(first) as usize).copied()).collect();
    let Some(times): Option<Vec<f64>> = clock.times.as_ref().and_then(own) else { return every_frame(numbers) };
    let count = (times.last().copied().unwrap_or_default() * fps).round() as usize;
    if count as u64 > MOST_FILLED * numbers.len() as u64 {
        return every_frame(numbers);
    }
    let at = |m: usize| {
        let time = m as f64 / fps;
        let k = times.partition_point(|t| *t <= time).saturating_sub(1);
        let share = times.get(k + 1).map_or(0.0, |next| (time - times[k]) / (next - times[k]));
        (k, share)
    };
    (0..=count).map(at).collect()
}

/// Returns the number of frames between the first and each of ascending numbers, counted as in [`every_frame`]: folders may be numbered in
/// steps.
pub(crate) fn frame_steps(numbers: &[u32]) -> Vec<u32> {
    let mut steps = vec![0; numbers.len()];
    for (step, (k, share)) in (0..).zip(every_frame(numbers)) {
        if share == 0.0
            && let Some(place) = steps.get_mut(k)
        {
            *place = step;
        }
    }
    steps
}

/// Returns all frames from the first to the last of ascending numbers, each as the index of the last existing frame and the share of the
/// way to the next one. If the numbers do not count frames, returns the existing frames only.
fn every_frame(numbers: &[u32]) -> Vec<(usize, f64)> {
    let steps: Vec<u32> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // The largest step of which all are multiples: the smallest one may itself skip frames.
    let usual = steps.iter().copied().reduce(common_divisor).unwrap_or(1).max(1);
    let total: u64 = steps.iter().map(|step| u64::from(step / usual)).sum();
    let frames = total <= MOST_FILLED * numbers.len() as u64;
    let of = |k: usize| {
        let count = steps.get(k).filter(|_| frames).map_or(1, |step| step / usual).max(1);
        (0..count).map(move |m| (k, f64::from(m) / f64::from(count)))
    };
    (0..numbers.len()).flat_map(of).collect()
}

/// Greatest common divisor.
fn common_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_frames_are_filled_where_numbers_count_frames() {
        assert_eq!(every_frame(&[3, 4, 7, 8]), [(0, 0.0), (1, 0.0), (1, 1.0 / 3.0), (1, 2.0 / 3.0), (2, 0.0), (3, 0.0)]);
        assert_eq!(every_frame(&[10, 20, 30]), [(0, 0.0), (1, 0.0), (2, 0.0)]);
        assert_eq!(
            (frame_steps(&[3, 4, 7, 8]), frame_steps(&[10, 20, 40]), frame_steps(&[7])),
            (vec![0, 1, 4, 5], vec![0, 1, 3], vec![0])
        );
        assert_eq!(every_frame(&[1, 3, 6, 9, 12]).len(), 12, "no two in a row");
        // Milliseconds, and a neutral frame from another time.
        assert_eq!(every_frame(&[33, 66, 100]).len(), 3);
        assert_eq!(every_frame(&[1, 500, 501]).len(), 3);
        assert_eq!(every_frame(&[5]), [(0, 0.0)]);
        assert!(every_frame(&[]).is_empty());
    }
}
