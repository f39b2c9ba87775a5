//! Accuracy of a newly learned locator on people left out in turn.

use std::collections::BTreeMap;

use super::{CoverSummary, MouthSummary, calibrate::JudgedReading};
use crate::modules::locate::{expect::signs, model::ErrorModel, points};

/// Errors of one part of the face, percent of the eye distance.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupErrors {
    /// Part of the face, as in the table of points.
    pub group: String,
    /// Mean error.
    pub mean: f64,
    /// 95th percentile over the faces.
    pub percentile_95: f64,
    /// Error of the worst face.
    pub worst: f64,
}

/// Accuracy of a locator on people left out in turn.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnSummary {
    /// Number of people.
    pub people: usize,
    /// Number of their pictures that were read.
    pub pictures: usize,
    /// Errors by part of the face; the last entry is all points.
    pub groups: Vec<GroupErrors>,
    /// For each fifth of the points by expected error, ascending: median expected and actual error, percent of the eye distance.
    pub quintiles: Vec<[f64; 2]>,
    /// Share of pictures in which the template proposes the face.
    pub proposed: f64,
    /// Share of faces that the verifier accepts.
    pub accepted: f64,
    /// Share of false alarms that the verifier accepts.
    pub false_alarms: f64,
    /// Results for covered parts.
    pub covers: Option<CoverSummary>,
    /// Results for moved mouths by kind of picture; `None` without pictures of them.
    pub mouth: Option<Vec<MouthSummary>>,
}

impl LearnSummary {
    pub(super) fn new(
        people: usize,
        judged: &[JudgedReading],
        model: &ErrorModel,
        proposed: f64,
        (faces, others): (Vec<f32>, Vec<f32>),
    ) -> Self {
        let mut members: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        points().iter().enumerate().for_each(|(k, p)| members.entry(&p.group).or_default().push(k));
        let mut groups: Vec<(String, Vec<usize>)> = members.into_iter().map(|(g, m)| (g.to_owned(), m)).collect();
        groups.push(("all".to_owned(), (0..points().len()).collect()));
        let groups = groups.into_iter().map(|(group, members)| group_errors(group, &members, judged)).collect();
        let mut pairs: Vec<(f32, f32)> = judged
            .iter()
            .flat_map(|r| {
                let expected = |k: usize| model.expect(k, &signs(k, &r.apart, [&r.readings[0], &r.readings[1]], r.eye_distance));
                (0..points().len()).map(|k| (expected(k), r.errors[k])).collect::<Vec<_>>()
            })
            .collect();
        pairs.sort_by(|p, q| p.0.total_cmp(&q.0));
        let quintiles = pairs.chunks(pairs.len().div_ceil(5).max(1)).map(|part| {
            let middle = |mut values: Vec<f32>| {
                values.sort_by(f32::total_cmp);
                100.0 * f64::from(values.get(values.len() / 2).copied().unwrap_or(0.0))
            };
            [middle(part.iter().map(|p| p.0).collect()), middle(part.iter().map(|p| p.1).collect())]
        });
        let accepted = |scores: &[f32]| {
            scores.iter().filter(|&&s| s >= crate::locate::LEAST_SCORE).count() as f64 / scores.len().max(1) as f64
        };
        Self {
            people,
            pictures: judged.len(),
            groups,
            quintiles: quintiles.collect(),
            proposed,
            accepted: accepted(&faces),
            false_alarms: accepted(&others),
            covers: None,
            mouth: None,
        }
    }
}

fn group_errors(group: String, members: &[usize], judged: &[JudgedReading]) -> GroupErrors {
    let of =
        |r: &JudgedReading| 100.0 * members.iter().map(|&k| f64::from(r.errors[k])).sum::<f64>() / members.len().max(1) as f64;
    let mut errors: Vec<f64> = judged.iter().map(of).collect();
    errors.sort_by(f64::total_cmp);
    let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
    let percentile_95 = errors.get(errors.len() * 95 / 100).copied().unwrap_or(0.0);
    GroupErrors { group, mean, percentile_95, worst: errors.last().copied().unwrap_or(0.0) }
}
