use super::*;

const FPS: f64 = 25.0;

/// Frames with intensities of some action units, given by number and time in frames.
fn frames(count: usize, unit: impl Fn(u8, f64) -> f64) -> Vec<RecordedFrame> {
    (0..count)
        .map(|t| RecordedFrame {
            number: t as u32 + 1,
            reason: None,
            confidence: 1.0,
            pose: [0.0; 3],
            units: ACTION_UNITS.map(|u| unit(u.number, t as f64) as f32),
            eyes: [1.0; 2],
            mouth: 0.0,
        })
        .collect()
}

/// Rises to `height` from `start` to `apex`, falls until `end`.
fn hill(t: f64, start: f64, apex: f64, end: f64, height: f64) -> f64 {
    let up = ((t - start) / (apex - start)).clamp(0.0, 1.0);
    let down = ((end - t) / (end - apex)).clamp(0.0, 1.0);
    height * up.min(down)
}

fn found(frames: &[RecordedFrame]) -> Segmentation {
    segment(frames, FPS, &SegmentOptions::default()).unwrap()
}

#[test]
fn an_expression_has_its_neutral_frame_before_it() {
    let frames = frames(100, |unit, t| if unit == 12 { hill(t, 40.0, 55.0, 75.0, 4.0) } else { 0.0 });
    let result = found(&frames);
    assert_eq!(result.expressions.len(), 1);
    let e = result.expressions[0];
    assert!(e.apex.abs_diff(55) <= 1, "{e:?}");
    assert!(e.onset.abs_diff(41) <= 2 && e.offset.abs_diff(73) <= 2, "{e:?}");
    assert!(e.neutral <= e.onset && e.neutral >= 25, "{e:?}");
    assert!(e.confidence > 0.5, "{e:?}");
    assert_eq!(
        (result.phases[10], result.phases[48], result.phases[55], result.phases[70]),
        (Phase::Rest, Phase::Onset, Phase::Apex, Phase::Offset)
    );
}

#[test]
fn a_recording_may_begin_with_an_expression() {
    let frames = frames(90, |unit, t| if unit == 26 { hill(t, -10.0, 4.0, 20.0, 4.0) } else { 0.0 });
    let e = found(&frames).expressions[0];
    assert!(e.apex.abs_diff(4) <= 1 && e.neutral >= 17, "{e:?}");
}

#[test]
fn blinks_and_speech_are_no_expressions() {
    let blink = |t: f64| hill(t, 30.0, 33.0, 36.0, 5.0);
    let speech = |t: f64| if (50.0..110.0).contains(&t) { 2.5 * (1.0 - (t * std::f64::consts::TAU / 6.0).cos()) } else { 0.0 };
    let frames = frames(160, |unit, t| match unit {
        7 | 45 => blink(t),
        26 => speech(t),
        16 => 0.7 * speech(t),
        _ => 0.0,
    });
    assert_eq!(found(&frames).expressions, []);
}

#[test]
fn two_expressions_without_a_rest_between_them_are_two() {
    // The second begins before the first has ended; its rest is the one after it.
    let frames = frames(140, |unit, t| match unit {
        12 => hill(t, 30.0, 45.0, 65.0, 4.0),
        1 => hill(t, 55.0, 75.0, 95.0, 4.0),
        _ => 0.0,
    });
    let result = found(&frames);
    let apexes: Vec<usize> = result.expressions.iter().map(|e| e.apex).collect();
    assert!(apexes.len() == 2 && apexes[0].abs_diff(45) <= 1 && apexes[1].abs_diff(75) <= 1, "{apexes:?}");
    assert!(result.expressions[0].neutral < 35 && result.expressions[1].neutral > 90, "{result:?}");
}

#[test]
fn a_rest_that_is_not_quite_neutral_is_a_rest_all_the_same() {
    let frames = frames(120, |unit, t| match unit {
        4 => 1.2,
        12 => hill(t, 40.0, 60.0, 80.0, 3.5),
        _ => 0.0,
    });
    let result = found(&frames);
    assert_eq!(result.expressions.len(), 1);
    assert!(result.activity[5] < 0.1, "{}", result.activity[5]);
}

#[test]
fn rates_and_options_that_are_none_are_an_error() {
    let frames = frames(100, |unit, t| if unit == 12 { hill(t, 40.0, 55.0, 75.0, 4.0) } else { 0.0 });
    for fps in [0.0, -25.0, f64::NAN, f64::INFINITY] {
        let said = segment(&frames, fps, &SegmentOptions::default()).unwrap_err().to_string();
        assert_eq!(said, format!("the frame rate is {fps}; it must be a finite number above 0"));
    }
    let options = SegmentOptions { rest: f64::NAN, ..SegmentOptions::default() };
    assert_eq!(segment(&frames, FPS, &options).unwrap_err().to_string(), "`rest` is NaN; it must be at least 0");
    // Slow, but a rate.
    assert!(segment(&frames, 1e-300, &SegmentOptions::default()).is_ok_and(|found| found.phases.len() == 100));
}

#[test]
fn a_missing_rest_is_reported() {
    let restless = frames(120, |unit, t| match unit {
        12 => 2.5 + 2.5 * (t / 3.0).sin(),
        26 => 2.5 + 2.5 * (t / 4.1).cos(),
        1 => 2.5 + 2.5 * (t / 5.3).cos(),
        _ => 0.0,
    });
    let error = segment(&restless, FPS, &SegmentOptions::default()).unwrap_err();
    assert!(error.to_string().contains("found no neutral rest"), "{error}");
    let short = frames(10, |_, _| 0.0);
    assert_eq!(segment(&short, FPS, &SegmentOptions::default()), Err(SegmentError::TooFew { found: 10, frames: 10 }));
}

#[test]
fn frames_that_cannot_be_used_are_no_rest_and_no_motion() {
    let mut frames = frames(100, |unit, t| if unit == 12 { hill(t, 40.0, 55.0, 75.0, 4.0) } else { 0.0 });
    for frame in &mut frames[30..39] {
        frame.reason = Some("turned".to_owned());
        frame.units = [5.0; ACTION_UNITS.len()];
    }
    let result = found(&frames);
    assert_eq!(result.expressions.len(), 1);
    assert!(!(30..39).contains(&result.expressions[0].neutral));
    assert_eq!(result.phases[33], Phase::Other);
}

#[test]
fn a_weak_expression_at_the_start_is_not_its_own_neutral_frame() {
    // Tightened lids are not part of the activity, so that the first frame, the apex, is as calm as a rest.
    let frames = frames(100, |unit, t| match unit {
        6 | 7 => hill(t, -20.0, 0.0, 30.0, 3.0),
        12 => hill(t, -20.0, 0.0, 30.0, 1.0),
        _ => 0.0,
    });
    let result = found(&frames);
    assert_eq!(result.expressions.len(), 1);
    let e = result.expressions[0];
    assert!(e.apex == 0 && e.neutral > 20, "{e:?}");
}
