//! Signals in time: smoothing, opening, runs.

use super::RecordedFrame;

/// Standard deviation of the smoothing, seconds.
const SMOOTHING: f64 = 0.05;

/// Intensity number `k` of every frame. An unusable frame has the value of the previous one.
pub(super) fn held(frames: &[RecordedFrame], k: usize) -> Vec<f64> {
    let first = frames.iter().find(|f| f.reason.is_none()).map_or(0.0, |f| f64::from(f.units[k]));
    let mut last = first;
    let value = |frame: &RecordedFrame| {
        if frame.reason.is_none() {
            last = f64::from(frame.units[k]);
        }
        last
    };
    frames.iter().map(value).collect()
}

/// Smooths by a Gaussian, truncated and renormalized at the ends.
pub(super) fn smooth(values: &[f64], fps: f64) -> Vec<f64> {
    let sigma = SMOOTHING * fps;
    let reach = (3.0 * sigma).ceil().max(0.0) as usize;
    let kernel: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / sigma.max(1e-9)).powi(2)).exp()).collect();
    let at = |t: usize| {
        let range = t.saturating_sub(reach)..=(t + reach).min(values.len() - 1);
        let (sum, weight) =
            range.fold((0.0, 0.0), |(sum, weight), s| (sum + kernel[t.abs_diff(s)] * values[s], weight + kernel[t.abs_diff(s)]));
        sum / weight
    };
    (0..values.len()).map(at).collect()
}

/// Minimum, or with `most` maximum, in windows of `width` around every index.
fn extreme(values: &[f64], width: usize, most: bool, shift: usize) -> Vec<f64> {
    let before = (width - 1) / 2 + shift;
    let after = width - 1 - before;
    let at = |t: usize| {
        let range = t.saturating_sub(before)..=(t + after).min(values.len() - 1);
        let window = values[range].iter().copied();
        if most { window.fold(f64::NEG_INFINITY, f64::max) } else { window.fold(f64::INFINITY, f64::min) }
    };
    (0..values.len()).map(at).collect()
}

/// Morphological opening: removes rises that last less than `width` frames.
pub(super) fn opened(values: &[f64], width: usize) -> Vec<f64> {
    // Dilation uses the mirrored window, which differs if the width is even.
    let shift = usize::from(width.is_multiple_of(2));
    extreme(&extreme(values, width, false, 0), width, true, shift)
}

/// Euclidean norm over the channels for which `counts` is true, by frame.
pub(super) fn norm(channels: &[Vec<f64>], counts: impl Fn(usize) -> bool) -> Vec<f64> {
    let frames = channels.first().map_or(0, Vec::len);
    let at = |t: usize| {
        let counted = channels.iter().enumerate().filter(|(place, _)| counts(*place));
        counted.map(|(_, channel)| channel[t] * channel[t]).sum::<f64>().sqrt()
    };
    (0..frames).map(at).collect()
}

/// Runs of values above a limit.
pub(super) fn runs(values: &[f64], limit: f64) -> Vec<std::ops::RangeInclusive<usize>> {
    let mut out = Vec::new();
    let mut start = None;
    for (t, &value) in values.iter().enumerate() {
        match (value > limit, start) {
            (true, None) => start = Some(t),
            (false, Some(first)) => {
                out.push(first..=t - 1);
                start = None;
            }
            _ => {}
        }
    }
    out.extend(start.map(|first| first..=values.len() - 1));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opening_cuts_what_is_short_and_keeps_what_lasts() {
        let mut values = vec![0.0; 20];
        values[3..5].fill(2.0);
        values[9..14].fill(3.0);
        for width in [3, 4, 5] {
            let opened = opened(&values, width);
            assert!(opened[..9].iter().all(|&v| v == 0.0), "width {width}: {opened:?}");
            assert_eq!(opened[9..14], [3.0; 5], "width {width}");
            assert_eq!(opened[14], 0.0, "width {width}");
        }
        assert_eq!(opened(&values, 1), values);
        assert_eq!(opened(&values, 6), [0.0; 20]);
    }

    #[test]
    fn runs_are_what_is_above_the_limit() {
        assert_eq!(runs(&[2.0, 0.0, 2.0, 2.0, 1.0], 1.0), [0..=0, 2..=3]);
        assert_eq!(runs(&[0.0, 2.0], 1.0), [1..=1]);
        assert!(runs(&[], 1.0).is_empty());
    }

    #[test]
    fn smoothing_keeps_what_is_even() {
        assert!(smooth(&[2.0; 9], 25.0).iter().all(|v| (v - 2.0).abs() < 1e-12));
        assert!(smooth(&[], 25.0).is_empty());
    }
}
