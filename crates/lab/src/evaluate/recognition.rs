//! Recognition of expressions by the nearest representative of other people: measures how well representatives separate labels.
//!
//! One subject is left out at a time. The representatives of all labels are made of the other subjects [KP, sections 4.3 and 4.4], and each
//! sequence of the left-out subject gets the label whose representative is nearest in d [KP, eq. (5)]. When only the left-out subject shows
//! a label, it has no representative; its sequences count as not judged.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write as _,
};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{Cell, Table};
use grimace::internal::{
    statistics::{
        ClassLabel, EMOTIONS, SequenceModel, StatisticsError, StatisticsOptions, distance::DisplacementFields, representative,
    },
    units::SequenceId,
    wireframe::Wireframe,
};

/// A model with its label.
#[derive(Clone, Debug)]
pub struct LabelledSequence {
    /// The normalized model and its sequence.
    pub model: SequenceModel,
    /// Its label, such as the emotion.
    pub label: String,
}

/// Result for one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct RecognizedSequence {
    /// The sequence.
    pub id: SequenceId,
    /// Its label.
    pub label: String,
    /// The label of the nearest representative; `None` when its own label has no representative without its subject.
    pub recognized: Option<String>,
    /// Distance d to the nearest representative, face units.
    pub distance: f64,
    /// Distance to the representative of its own label, face units; `None` when there is none.
    pub distance_own: Option<f64>,
}

/// Results of the experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognition {
    /// Labels in the order of the project's emotions, then alphabetically.
    pub labels: Vec<String>,
    /// Results, ordered by sequence id.
    pub sequences: Vec<RecognizedSequence>,
}

/// Accuracy of the recognition.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct RecognitionSummary {
    /// Number of judged sequences.
    pub judged: usize,
    /// Number of sequences that were not judged.
    pub not_judged: usize,
    /// Number of subjects with judged sequences.
    pub subjects: usize,
    /// Share of the judged sequences that were recognized correctly.
    pub accuracy: f64,
    /// 95 % interval of the accuracy: percentiles of a bootstrap over subjects.
    pub accuracy_interval: [f64; 2],
    /// Mean over the labels of the share recognized correctly.
    pub balanced_accuracy: f64,
    /// Share of the most frequent label: the accuracy of a constant answer.
    pub most_frequent: f64,
    /// One over the number of labels: the balanced accuracy of guessing.
    pub guessing: f64,
}

/// Number of bootstrap replicates for the interval of the accuracy.
const REPLICATES: usize = 2000;

/// Why recognition failed.
#[derive(Debug, thiserror::Error)]
pub enum RecognitionError {
    /// Too few labels to distinguish.
    #[error("found {found} label{}; recognition needs sequences of at least two labels", if *found == 1 { "" } else { "s" })]
    TooFewLabels {
        /// Labels found.
        found: usize,
    },
    /// Too few people for leaving one out.
    #[error("found {found} subject{}; leave-one-subject-out needs at least two", if *found == 1 { "" } else { "s" })]
    TooFewSubjects {
        /// Subjects found.
        found: usize,
    },
    /// A representative cannot be made.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
}

/// Recognizes every sequence by the nearest representative of other people.
///
/// Representatives are made with `options`. Models must be normalized and of one shape, in any order. `tick` is called from many threads
/// after every subject.
///
/// # Errors
/// [`RecognitionError`] for fewer than two labels or subjects, or models that do not give a representative.
pub fn evaluate_recognition(
    sequences: &[LabelledSequence],
    wireframe: &Wireframe,
    options: &StatisticsOptions,
    tick: impl Fn() + Sync,
) -> Result<Recognition, RecognitionError> {
    let rank = |label: &str| EMOTIONS.iter().position(|&e| e == label).unwrap_or(EMOTIONS.len());
    let found: BTreeSet<(usize, &str)> = sequences.iter().map(|s| (rank(&s.label), s.label.as_str())).collect();
    let labels: Vec<String> = found.into_iter().map(|(_, label)| label.to_owned()).collect();
    if labels.len() < 2 {
        return Err(RecognitionError::TooFewLabels { found: labels.len() });
    }
    let subjects: BTreeSet<&str> = sequences.iter().map(|s| s.model.id.subject.as_str()).collect();
    if subjects.len() < 2 {
        return Err(RecognitionError::TooFewSubjects { found: subjects.len() });
    }
    let live = wireframe.live_nodes();
    let one = |subject: &&str| -> Result<Vec<RecognizedSequence>, RecognitionError> {
        let mut centers = BTreeMap::new();
        for (place, label) in labels.iter().enumerate() {
            let others = sequences.iter().filter(|s| s.label == *label && s.model.id.subject != **subject).map(|s| &s.model);
            let others: Vec<&SequenceModel> = others.collect();
            if !others.is_empty() {
                let class = ClassLabel { emotion: label.clone(), group: BTreeMap::new() };
                let made = representative(class, &others, wireframe, options)?;
                centers.insert(place, DisplacementFields::of_model(&made.model, live));
            }
        }
        let own = sequences.iter().filter(|s| s.model.id.subject == **subject);
        let recognized = own.map(|s| {
            let fields = DisplacementFields::of_model(&s.model.model, live);
            let distances: Vec<(f64, usize)> = centers.iter().map(|(&place, center)| (fields.distance(center), place)).collect();
            let distance_own = distances.iter().find(|(_, place)| labels[*place] == s.label).map(|(d, _)| *d);
            // In case of a tie, the first label wins.
            let nearest = distances.iter().min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            RecognizedSequence {
                id: s.model.id.clone(),
                label: s.label.clone(),
                recognized: nearest.filter(|_| distance_own.is_some()).map(|(_, place)| labels[*place].clone()),
                distance: nearest.map_or(f64::NAN, |(d, _)| *d),
                distance_own,
            }
        });
        let recognized = recognized.collect();
        tick();
        Ok(recognized)
    };
    let subjects: Vec<&str> = subjects.into_iter().collect();
    let all = subjects.par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
    let mut sequences = all.concat();
    sequences.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(Recognition { labels, sequences })
}

impl Recognition {
    /// Returns the number of sequences by true label (rows) and recognized label (columns), in the order of `labels`.
    pub fn confusion(&self) -> Vec<Vec<usize>> {
        let place = |label: &str| self.labels.iter().position(|l| l == label).unwrap_or(0);
        let mut counts = vec![vec![0; self.labels.len()]; self.labels.len()];
        for s in &self.sequences {
            if let Some(recognized) = &s.recognized {
                counts[place(&s.label)][place(recognized)] += 1;
            }
        }
        counts
    }

    /// Summarizes the results; `seed` is that of the bootstrap.
    pub fn summary(&self, seed: u64) -> RecognitionSummary {
        let counts = self.confusion();
        let sums: Vec<usize> = counts.iter().map(|row| row.iter().sum()).collect();
        let judged: usize = sums.iter().sum();
        let right: usize = (0..counts.len()).map(|k| counts[k][k]).sum();
        let share = |part: usize, whole: usize| if whole > 0 { part as f64 / whole as f64 } else { 0.0 };
        let recalls: Vec<f64> = (0..counts.len()).filter(|&k| sums[k] > 0).map(|k| share(counts[k][k], sums[k])).collect();
        // Numbers of correct and of judged sequences by subject.
        let mut subjects: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for s in self.sequences.iter().filter(|s| s.recognized.is_some()) {
            let entry = subjects.entry(&s.id.subject).or_default();
            entry.0 += usize::from(s.recognized.as_ref() == Some(&s.label));
            entry.1 += 1;
        }
        let people: Vec<(usize, usize)> = subjects.into_values().collect();
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut replicates: Vec<f64> = (0..if people.is_empty() { 0 } else { REPLICATES })
            .map(|_| {
                let drawn = (0..people.len()).map(|_| people[random.random_range(0..people.len())]);
                let (right, all) = drawn.fold((0, 0), |(r, n), (right, all)| (r + right, n + all));
                share(right, all)
            })
            .collect();
        replicates.sort_by(f64::total_cmp);
        let at =
            |part: f64| replicates.get((part * (replicates.len().max(1) - 1) as f64).round() as usize).copied().unwrap_or(0.0);
        RecognitionSummary {
            judged,
            not_judged: self.sequences.len() - judged,
            subjects: people.len(),
            accuracy: share(right, judged),
            accuracy_interval: [at(0.025), at(0.975)],
            balanced_accuracy: recalls.iter().sum::<f64>() / recalls.len().max(1) as f64,
            most_frequent: share(sums.iter().copied().max().unwrap_or(0), judged),
            guessing: 1.0 / self.labels.len() as f64,
        }
    }

    /// Returns the confusion matrix with the share of correct recognitions of every label.
    pub fn confusion_table(&self) -> Table {
        let header: Vec<&str> = std::iter::once("label")
            .chain(self.labels.iter().map(String::as_str))
            .chain(["sequences", "recognized_percent"])
            .collect();
        let mut table = Table::new(header);
        for (k, counts) in self.confusion().into_iter().enumerate() {
            let sum: usize = counts.iter().sum();
            let mut row = vec![Cell::text(&self.labels[k])];
            row.extend(counts.iter().map(|&n| Cell::Count(n)));
            row.push(Cell::Count(sum));
            row.push(Cell::maybe((sum > 0).then(|| 100.0 * counts[k] as f64 / sum as f64), 1));
            table.rows.push(row);
        }
        table
    }

    /// Returns a row for each sequence.
    pub fn sequence_table(&self) -> Table {
        let mut table = Table::new(["subject", "sequence", "label", "recognized", "distance", "distance_own"]);
        for s in &self.sequences {
            table.rows.push(vec![
                Cell::text(&s.id.subject),
                Cell::text(&s.id.sequence),
                Cell::text(&s.label),
                s.recognized.as_ref().map_or(Cell::Empty, Cell::text),
                Cell::Number(s.distance, 3),
                Cell::maybe(s.distance_own, 3),
            ]);
        }
        table
    }

    /// Returns the confusion matrix as SVG: cells show counts, and are darker for a larger share of their row.
    pub fn confusion_svg(&self) -> String {
        const CELL: usize = 64;
        const CAPTION: usize = 320;
        let n = self.labels.len();
        // Room for the longest label: 8 px for each letter, or 6 px in labels at 45 degrees.
        let longest = self.labels.iter().map(|label| label.chars().count()).max().unwrap_or(0);
        let (left, top) = (70 + 8 * longest, 30 + 6 * longest);
        let (width, height) = ((left + n * CELL + 6 * longest).max(CAPTION), top + n * CELL + 40);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"13\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        );
        // Writing to a string does not fail.
        for (i, counts) in self.confusion().iter().enumerate() {
            let sum: usize = counts.iter().sum();
            let label = escaped(&self.labels[i]);
            let middle = top + i * CELL + CELL / 2;
            let _ = writeln!(svg, "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{label} ({sum})</text>", left - 10, middle + 5);
            let (x, y) = (left + i * CELL + CELL / 2, top - 10);
            let _ = writeln!(svg, "<text transform=\"translate({x} {y}) rotate(-45)\">{label}</text>");
            for (j, &count) in counts.iter().enumerate() {
                let share = if sum > 0 { count as f64 / sum as f64 } else { 0.0 };
                let tone = |light: f64, dark: f64| (light + (dark - light) * share).round() as u8;
                let fill = format!("#{:02x}{:02x}{:02x}", tone(247.0, 8.0), tone(251.0, 64.0), tone(255.0, 129.0));
                let ink = if share > 0.5 { "#fff" } else { "#1c1e21" };
                let (x, y) = (left + j * CELL, top + i * CELL);
                let _ = writeln!(
                    svg,
                    "<rect x=\"{x}\" y=\"{y}\" width=\"{CELL}\" height=\"{CELL}\" fill=\"{fill}\" stroke=\"#fff\"/>\
                     <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" fill=\"{ink}\">{count}</text>\
                     <text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-size=\"10\" fill=\"{ink}\">{:.0} %</text>",
                    x + CELL / 2,
                    y + CELL / 2,
                    x + CELL / 2,
                    y + CELL / 2 + 15,
                    100.0 * share,
                );
            }
        }
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" fill=\"#5c6066\">columns: recognized as; rows: label (sequences)</text></svg>",
            10,
            top + n * CELL + 26
        );
        svg
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};

    use super::*;
    use grimace::internal::model::{DynamicExpressionModel, FrameExpressionModel};

    /// A model in which every node moves by the vector, starting from Candide-3's frontal view.
    fn sequence(subject: &str, label: &str, x: f64, y: f64) -> LabelledSequence {
        let neutral: Vec<Point2<f64>> = Wireframe::candide3().frontal();
        let moved = neutral.iter().map(|p| p + Vector2::new(x, y)).collect();
        let model = DynamicExpressionModel::new(vec![FrameExpressionModel::new(neutral), FrameExpressionModel::new(moved)]);
        let id = SequenceId { subject: subject.to_owned(), sequence: label.to_owned() };
        LabelledSequence { model: SequenceModel { id, model: model.unwrap() }, label: label.to_owned() }
    }

    fn recognize(sequences: &[LabelledSequence]) -> Result<Recognition, RecognitionError> {
        evaluate_recognition(sequences, &Wireframe::candide3(), &StatisticsOptions::default(), || {})
    }

    #[test]
    fn the_nearest_representative_of_others_decides() {
        // Without subject a: happiness at 10 or 12, surprise at -10; a's happiness at -9 is nearer to surprise.
        let recognition = recognize(&[
            sequence("a", "happiness", -9.0, 0.0),
            sequence("b", "happiness", 10.0, 0.0),
            sequence("c", "happiness", 12.0, 0.0),
            sequence("a", "surprise", -10.0, 0.0),
            sequence("b", "surprise", -10.0, 0.0),
            sequence("c", "bliss", 0.0, 50.0),
        ])
        .unwrap();
        assert_eq!(recognition.labels, ["happiness", "surprise", "bliss"]);
        // Rows: happiness has 2 correct and 1 as surprise. Nobody else shows bliss, so it is not judged.
        assert_eq!(recognition.confusion(), [[2, 1, 0], [0, 2, 0], [0, 0, 0]]);
        let summary = recognition.summary(1);
        assert_eq!((summary.judged, summary.not_judged, summary.accuracy), (5, 1, 0.8));
        assert!((summary.balanced_accuracy - 5.0 / 6.0).abs() < 1e-12);
        assert_eq!((summary.most_frequent, summary.guessing), (0.6, 1.0 / 3.0));
        assert!(summary.accuracy_interval[0] <= 0.8 && summary.accuracy_interval[1] >= 0.8);
        let own = &recognition.sequences[0];
        assert_eq!((own.id.to_string().as_str(), own.distance), ("a_happiness", 1.0));
        assert!(recognition.confusion_svg().matches("<rect").count() == 10);
    }

    #[test]
    fn too_few_labels_or_people_are_an_error() {
        let one = [sequence("a", "fear", 1.0, 0.0), sequence("b", "fear", 1.0, 0.0)];
        assert!(recognize(&one).unwrap_err().to_string().starts_with("found 1 label; recognition needs"));
        let alone = [sequence("a", "fear", 1.0, 0.0), sequence("a", "anger", 2.0, 0.0)];
        assert!(recognize(&alone).unwrap_err().to_string().starts_with("found 1 subject; leave-one-subject-out"));
    }

    #[test]
    fn labels_are_escaped_in_the_picture() {
        let recognition = recognize(&[sequence("a", "<b>&", 1.0, 0.0), sequence("b", "y", 9.0, 0.0)]).unwrap();
        assert!(recognition.confusion_svg().contains("&lt;b&gt;&amp;") && recognition.summary(1).judged == 0);
    }
}
