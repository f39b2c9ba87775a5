//! Calibration of a recognizer's probabilities: compares the mean probability of a class of sequences with their accuracy.
//!
//! Every sequence is recognized by discriminants that were learned from other people.

use std::fmt::Write as _;

use super::{Cell, LabelledSequence, Recognition, RecognizedSequence, Table, wilson};
use grimace::internal::{
    statistics::recognize::{RecognizeError, Recognized, Recognizer},
    wireframe::Wireframe,
};

/// Upper ends of the classes of probability.
const CLASSES: [f64; 6] = [0.5, 0.7, 0.9, 0.97, 0.99, 1.0];

/// The sequences whose most probable label has a probability within one class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationClass {
    /// Upper end of the class.
    pub most: f64,
    /// Number of sequences.
    pub sequences: usize,
    /// Number of correctly recognized sequences.
    pub right: usize,
    /// Mean probability of the most probable label.
    pub claimed: f64,
}

/// Results of the discriminants, leaving out every person in turn.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    /// The recognized sequences.
    pub recognition: Recognition,
    /// Calibration by class of probability.
    pub classes: Vec<CalibrationClass>,
    /// Number of sequences recognized as none of the labels, at the given level.
    pub none: usize,
}

/// Recognizes every sequence by discriminants of other people and counts the correct ones by class of probability.
///
/// # Errors
/// [`RecognizeError`] for fewer than two labels or three people.
pub fn evaluate_discriminants(
    sequences: &[LabelledSequence],
    wireframe: &Wireframe,
    level: f64,
    tick: impl Fn() + Sync,
) -> Result<Calibration, RecognizeError> {
    let mut sorted: Vec<&LabelledSequence> = sequences.iter().collect();
    sorted.sort_by(|a, b| a.model.id.cmp(&b.model.id));
    let labelled: Vec<_> = sorted.iter().map(|s| (&s.model, s.label.as_str())).collect();
    let recognizer = Recognizer::new(&labelled, wireframe.live_nodes(), tick)?;
    let pairs: Vec<(&&LabelledSequence, &Recognized)> = sorted.iter().zip(&recognizer.left_out).collect();
    let of_sequence = |(s, r): &(&&LabelledSequence, &Recognized)| {
        let own = recognizer.labels.iter().position(|label| *label == s.label);
        // A label that nobody else shows has no probability.
        let judged = own.is_some_and(|own| r.probabilities[own] > 0.0 || r.label == s.label);
        RecognizedSequence {
            id: s.model.id.clone(),
            label: s.label.clone(),
            recognized: judged.then(|| r.label.clone()),
            distance: r.distance,
            distance_own: None,
        }
    };
    let mut classes: Vec<CalibrationClass> =
        CLASSES.iter().map(|&most| CalibrationClass { most, sequences: 0, right: 0, claimed: 0.0 }).collect();
    for (s, r) in &pairs {
        let class = CLASSES.iter().position(|&most| r.probability <= most).unwrap_or(CLASSES.len() - 1);
        classes[class].sequences += 1;
        classes[class].right += usize::from(r.label == s.label);
        classes[class].claimed += r.probability;
    }
    classes.iter_mut().filter(|c| c.sequences > 0).for_each(|c| c.claimed /= c.sequences as f64);
    Ok(Calibration {
        recognition: Recognition { labels: recognizer.labels.clone(), sequences: pairs.iter().map(of_sequence).collect() },
        classes,
        none: pairs.iter().filter(|(_, r)| r.is_none(level)).count(),
    })
}

impl Calibration {
    /// Returns a row for each class of probability: mean probability, and accuracy with its 95 % interval.
    pub fn table(&self) -> Table {
        let mut table =
            Table::new(["probability_up_to", "sequences", "claimed_percent", "right_percent", "low_percent", "high_percent"]);
        for c in self.classes.iter().filter(|c| c.sequences > 0) {
            let (low, high) = wilson(c.right, c.sequences);
            table.rows.push(vec![
                Cell::Number(c.most, 2),
                Cell::Count(c.sequences),
                Cell::Number(100.0 * c.claimed, 1),
                Cell::Number(100.0 * c.right as f64 / c.sequences as f64, 1),
                Cell::Number(100.0 * low, 1),
                Cell::Number(100.0 * high, 1),
            ]);
        }
        table
    }

    /// Returns the reliability diagram as SVG: accuracy against probability, with intervals. Calibrated probabilities lie on the diagonal.
    pub fn svg(&self) -> String {
        const SIDE: f64 = 300.0;
        const EDGE: f64 = 50.0;
        let at = |share: f64| EDGE + SIDE * share;
        let up = |share: f64| EDGE + SIDE * (1.0 - share);
        let size = SIDE + 2.0 * EDGE;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{size}\" height=\"{size}\" viewBox=\"0 0 {size} {size}\" \
             font-family=\"sans-serif\" font-size=\"12\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\
             <rect x=\"{EDGE}\" y=\"{EDGE}\" width=\"{SIDE}\" height=\"{SIDE}\" fill=\"none\" stroke=\"#999\"/>\
             <line x1=\"{EDGE}\" y1=\"{}\" x2=\"{}\" y2=\"{EDGE}\" stroke=\"#999\" stroke-dasharray=\"4 4\"/>\n",
            up(0.0),
            at(1.0)
        );
        // Writing to a string does not fail.
        for c in self.classes.iter().filter(|c| c.sequences > 0) {
            let (low, high) = wilson(c.right, c.sequences);
            let (x, y) = (at(c.claimed), up(c.right as f64 / c.sequences as f64));
            let _ = writeln!(
                svg,
                "<line x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{x:.1}\" y2=\"{:.1}\" stroke=\"#084081\"/>\
                 <circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"#084081\"/><text x=\"{:.1}\" y=\"{:.1}\" fill=\"#5c6066\">{}</text>",
                up(low),
                up(high),
                x + 7.0,
                y + 4.0,
                c.sequences
            );
        }
        let _ = writeln!(
            svg,
            "<text x=\"{EDGE}\" y=\"{}\">0 %</text><text x=\"{}\" y=\"{}\" text-anchor=\"end\">100 % claimed</text>\
             <text x=\"{EDGE}\" y=\"{}\">right, 0 to 100 %; numbers of sequences</text></svg>",
            up(0.0) + 18.0,
            at(1.0),
            up(0.0) + 18.0,
            EDGE - 12.0
        );
        svg
    }
}
