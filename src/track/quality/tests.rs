//! Tests of summaries and verdicts, with answers that can be counted by hand.

use std::collections::BTreeMap;

use nalgebra::Point2;

use super::{judge::missing_frames, *};
use crate::{
    track::{LossReason, NodeState, TrackedNode},
    units::NodeId,
    wireframe::{Region, Tables},
};

#[test]
fn shares_and_worst_nodes_are_counted() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    let node = |k: usize, state, residual| TrackedNode::new(w.frontal()[k] * 100.0, state, residual);
    let neutral = (0..113).map(|k| node(k, NodeState::Fitted, None)).collect();
    let mut moved: Vec<_> = (0..113).map(|k| node(k, NodeState::Tracked, Some(0.5))).collect();
    moved[31].state = NodeState::Recovered(LossReason::Extreme);
    moved[4].state = NodeState::Follows; // not live: does not count
    let frames = [neutral, moved.clone(), moved].map(|nodes| TrackedFrame { number: 1, nodes });
    let summary = summarize(&frames, &w, &t);
    assert_eq!(summary.frames, 3);
    assert!((summary.tracked_share - 103.0 / 104.0).abs() < 1e-12);
    assert!((summary.mean_residual_px - 0.5).abs() < 1e-12);
    assert!((summary.eye_distance_px - 61.3).abs() < 1e-9);
    assert_eq!(summary.recovered, BTreeMap::from([("extreme".to_owned(), 2)]));
    assert_eq!(summary.worst_nodes, [(NodeId(31), 2)]);
}

#[test]
fn what_the_pictures_told_is_carried_over() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    let nodes: Vec<_> = w.frontal().iter().map(|&p| TrackedNode::new(p * 100.0, NodeState::Fitted, None)).collect();
    let again = || summarize(&[TrackedFrame { number: 1, nodes: nodes.clone() }], &w, &t);
    let covered = "the mouth is covered".to_owned();
    let back = "back to neutral".to_owned();
    let earlier = again().with_marks_beside(vec!["the chin".to_owned()]).with_covered(Some(covered.clone()));
    let hand = "a hand".to_owned();
    let earlier = earlier.with_mouth_back(Some(back.clone())).with_covered_at_apex(Some(hand.clone()));
    let told = again().told_by_the_pictures_of(&earlier);
    assert_eq!(told, earlier);
    assert_eq!((told.verdict, told.covered), (Verdict::LookAgain, Some(covered.clone())));
    assert!(told.reasons.ends_with(&["the chin".to_owned(), covered, back, hand]), "{:?}", told.reasons);
    assert_eq!(again().told_by_the_pictures_of(&again()), again());
}

#[test]
fn missing_frames_are_reported_where_they_matter() {
    let gap = |numbers: &[u32]| missing_frames(numbers.to_vec());
    let without = |from: u32, to: u32| (1..=24).filter(|n| !(from..=to).contains(n)).collect::<Vec<u32>>();
    assert_eq!(gap(&without(14, 23)), Some((14, 23)));
    assert_eq!(gap(&without(14, 16)), None);
    assert_eq!(gap(&[1, 40]), None);
    assert_eq!(gap(&[10, 20, 30, 40]), None);
    // Every tenth frame, the later one first.
    assert_eq!(gap(&[200, 190, 180, 80, 70, 60]), Some((90, 170)));
}

/// A face of 61.3 px between the pupils, in whose later frames every third node goes 1 px further down.
fn place(w: &Wireframe, number: u32, k: usize) -> Point2<f64> {
    let down = if k.is_multiple_of(3) { f64::from(number) } else { 0.0 };
    Point2::new(w.frontal()[k].x * 100.0, w.frontal()[k].y * 100.0 + down)
}

#[test]
fn a_still_face_has_the_verdict_look_again() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    // The head shifts and rotates; relative to it only the first `count` live nodes move, by 1 px of 61.3.
    let frame = |number: u32, count: usize| TrackedFrame {
        number,
        nodes: (0..113)
            .map(|k| {
                let p = place(&w, 0, k);
                let moved = w.live_nodes().iter().take(count).any(|id| id.index() == k);
                let p = Point2::new(p.x + if moved { 1.0 } else { 0.0 }, p.y);
                let (sin, cos) = (0.1 * f64::from(number - 1)).sin_cos();
                let turned = Point2::new(cos * p.x - sin * p.y + 5.0 * f64::from(number), sin * p.x + cos * p.y);
                TrackedNode::new(turned, if number == 1 { NodeState::Fitted } else { NodeState::Tracked }, None)
            })
            .collect(),
    };
    let still = summarize(&[frame(1, 0), frame(2, 0)], &w, &t);
    assert_eq!(still.verdict, Verdict::LookAgain);
    let said = "the face does not move: in frame 2 fewer than 5 nodes are more than 0.6 px (1 % of the eye distance) from their place in frame 1";
    assert_eq!(still.reasons, [said]);
    assert_eq!(summarize(&[frame(1, 0), frame(2, 4)], &w, &t).reasons, [said]);
    assert_eq!(summarize(&[frame(1, 0), frame(2, 6)], &w, &t).verdict, Verdict::Good);
}

#[test]
fn two_distant_pictures_are_reported_if_nodes_were_lost() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    let frame = |number: u32, lost: usize, reason| TrackedFrame {
        number,
        nodes: (0..113)
            .map(|k| {
                let is_lost = number > 1 && w.live_nodes().iter().take(lost).any(|id| id.index() == k);
                let state = if is_lost { NodeState::Recovered(reason) } else { NodeState::Tracked };
                TrackedNode::new(place(&w, number, k), if number == 1 { NodeState::Fitted } else { state }, None)
            })
            .collect(),
    };
    let said = |frames: &[TrackedFrame]| {
        let reasons = summarize(frames, &w, &t).reasons;
        reasons.iter().any(|r| r.starts_with("there are only two pictures, 1 and 2, and they lie far apart for a tracker"))
    };
    let of = |lost, reason| [frame(1, 0, reason), frame(2, lost, reason)];
    // 104 live nodes: 11 are more than a tenth.
    assert!(said(&of(11, LossReason::Klt)) && !said(&of(10, LossReason::Klt)));
    assert!(!said(&of(11, LossReason::LostFrame)), "landmarks were there");
    assert!(!said(&of(60, LossReason::Jump)), "placed by the located face, with no other reason to look again");
    let mut vague = of(60, LossReason::Jump);
    // Two thirds of the nodes are expected to be 5 % of the eye distance off.
    vague[1].nodes.iter_mut().take(80).for_each(|n| n.expected_error = Some(3.1));
    assert!(said(&vague));
    let [neutral, apex] = of(11, LossReason::Klt);
    assert!(!said(&[neutral, frame(3, 11, LossReason::Klt), apex]), "three pictures");
}

#[test]
fn a_region_with_large_placement_errors_has_the_verdict_look_again() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    // 61.3 px between the pupils; the limit is 3.065 px.
    let frame = |number: u32, brow: f64| TrackedFrame {
        number,
        nodes: (0..113)
            .map(|k| {
                let expected = if t.region(NodeId(k as u16)) == Region::Brow { brow } else { 0.5 };
                let state = if number == 1 { NodeState::Fitted } else { NodeState::Tracked };
                TrackedNode { expected_error: Some(expected), ..TrackedNode::new(place(&w, number, k), state, None) }
            })
            .collect(),
    };
    let good = summarize(&[frame(1, 2.0), frame(2, 0.5)], &w, &t);
    assert_eq!((good.verdict, good.placement_error_px, good.expected_error_px), (Verdict::Good, Some(0.5), Some(0.5)));
    // A position error of 3 px and a motion error of 1 px give sqrt(10) px.
    let again = summarize(&[frame(1, 3.0), frame(2, 1.0)], &w, &t);
    assert_eq!(again.verdict, Verdict::LookAgain);
    assert_eq!(
        again.reasons,
        [
            "brow: the expected error at the apex is 3.2 px (5.2 % of the eye distance; its place on the face 4.9 %, its motion 1.6 \
             %); mark the brow in the neutral frame, or, if you set marks, try without them"
        ]
    );
}

#[test]
fn corners_of_the_mouth_do_not_hide_in_the_mean_of_the_mouth() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    // The limit is 3.065 px, on the mean of both.
    let said = |left: f64, right: f64| {
        let mut frames = [1, 2].map(|number| TrackedFrame {
            number,
            nodes: (0..113)
                .map(|k| {
                    let state = if number == 1 { NodeState::Fitted } else { NodeState::Tracked };
                    TrackedNode { expected_error: Some(0.5), ..TrackedNode::new(place(&w, number, k), state, None) }
                })
                .collect(),
        });
        for (k, expected) in [(31, left), (64, right)] {
            frames[1].nodes[k].expected_error = Some(expected);
        }
        summarize(&frames, &w, &t).reasons
    };
    assert!(said(5.0, 1.0).is_empty());
    assert_eq!(
        said(5.0, 1.2),
        ["corners of the mouth: the expected error of their motion up to the apex is 3.1 px (5.1 % of the eye distance)"]
    );
}

#[test]
fn a_node_without_a_landmark_is_not_lost() {
    let (w, t) = (Wireframe::candide3(), Tables::candide3());
    let frame = |number: u32, state: fn(usize) -> NodeState| TrackedFrame {
        number,
        nodes: (0..113).map(|k| TrackedNode::new(place(&w, number, k), state(k), None)).collect(),
    };
    let neutral = || frame(0, |_| NodeState::Fitted);
    let without = |k: usize| k.is_multiple_of(2);
    // Half of the nodes have no landmark: still good.
    let driven = frame(1, |k| if k % 2 == 0 { NodeState::Recovered(LossReason::NoLandmark) } else { NodeState::Tracked });
    assert_eq!(summarize(&[neutral(), driven.clone()], &w, &t).verdict, Verdict::Good);
    // A frame without landmarks loses the nodes that have one, and these are counted.
    let lost = frame(2, |_| NodeState::Recovered(LossReason::LostFrame));
    let summary = summarize(&[neutral(), driven, lost], &w, &t);
    let with = w.live_nodes().iter().filter(|id| !without(id.index())).count();
    let share = 100.0 * 104.0 / (104 + with) as f64;
    let expected = [
        format!("{share:.0} % of the nodes were lost in all frames together"),
        "104 of 104 nodes were lost in frame 2".to_owned(),
    ];
    assert_eq!(summary.reasons, expected);
}
