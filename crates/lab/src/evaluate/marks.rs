//! Choices of nodes to mark, and the search for the best order of marks.
//!
//! The default marks were chosen by the accuracy of the resulting motion (`candide/README.md`). The search ranks them by their value for
//! the fit, and adds the best further nodes. Its criterion is the mean node error in percent of the eye distance, over all known nodes of
//! all people, averaged over the populations; every mark has the typical error of its feature (`candide/markable_nodes.csv`).
//!
//! One order of nodes is used for all numbers of marks: a prefix of it is marked. The search removes default marks one at a time, always
//! the one whose removal raises the error least, until three remain; marks removed later come earlier in the order. Then it appends the
//! node that lowers the error most, one at a time, up to fifteen.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{Cell, EvaluateError, FitMethod, MarkNoise, Person, Population, Table, fit::person_errors};
use grimace::internal::{
    dataset::DEFAULT_LANDMARK_NODES,
    units::NodeId,
    wireframe::{MarkableNode, Region, SuggestedMark, Tables, Wireframe, markable_nodes, suggested_marks},
};

/// Length of the suggested order of marks.
pub const SUGGESTED_COUNT: usize = 15;

/// Smallest number of marks that determines a fit.
const FEWEST: usize = 3;

/// A rule to choose which nodes are marked.
#[derive(Clone, Debug, PartialEq)]
pub struct MarkChoice {
    /// Name in tables and figures.
    pub name: String,
    order: Order,
}

#[derive(Clone, Debug, PartialEq)]
enum Order {
    /// The first nodes of this list.
    Fixed(Vec<NodeId>),
    /// A random sample of these nodes, drawn for each person.
    Random(Vec<NodeId>),
}

impl MarkChoice {
    /// Returns a choice of the first nodes of an order; nodes that a person's data lack are skipped.
    pub fn fixed(name: impl Into<String>, nodes: Vec<NodeId>) -> Self {
        Self { name: name.into(), order: Order::Fixed(nodes) }
    }

    /// Returns a choice of random nodes, drawn for each person.
    pub fn random(name: impl Into<String>, nodes: Vec<NodeId>) -> Self {
        Self { name: name.into(), order: Order::Random(nodes) }
    }

    /// Returns the `count` marked nodes of the person with index `index`, or `None` when there are too few nodes.
    pub fn nodes(&self, person: &Person, index: u32, count: usize, seed: u64) -> Option<Vec<NodeId>> {
        let known = |nodes: &[NodeId]| nodes.iter().copied().filter(|&n| person.knows(n)).collect::<Vec<_>>();
        let mut nodes = match &self.order {
            Order::Fixed(nodes) => known(nodes),
            Order::Random(nodes) => {
                let mut nodes = known(nodes);
                let mut random = ChaCha8Rng::seed_from_u64(seed);
                // The top bit separates this stream from the streams of the marks' errors.
                random.set_stream(1 << 63 | u64::from(index));
                for k in 0..nodes.len() {
                    let other = random.random_range(k..nodes.len());
                    nodes.swap(k, other);
                }
                nodes
            }
        };
        if nodes.len() < count {
            return None;
        }
        nodes.truncate(count);
        Some(nodes)
    }
}

/// Returns the standard choices: suggested order, corners and chin followed by other features, upper face only, and random.
pub fn standard_choices(tables: &Tables) -> Vec<MarkChoice> {
    let markable: Vec<NodeId> = markable_nodes().iter().map(|m| m.node).collect();
    let suggested = suggested_marks().iter().map(|m| m.node).collect();
    // Corners of eyes and mouth and the chin, in an order whose first three are far apart; then nose, lips and brows.
    let [left_outer, left_inner, right_outer, right_inner, left_mouth, right_mouth, chin, ..] = DEFAULT_LANDMARK_NODES;
    let further = [6, 7, 8, 15, 48, 26, 59, 16].map(NodeId);
    let first = [left_outer, right_outer, chin, left_mouth, right_mouth, left_inner, right_inner];
    let corners = first.into_iter().chain(further).collect();
    let is_upper = |n: &NodeId| matches!(tables.region(*n), Region::Brow | Region::Eye | Region::Nose | Region::Forehead);
    let upper = markable.iter().copied().filter(is_upper).collect();
    vec![
        MarkChoice::fixed("suggested", suggested),
        MarkChoice::fixed("corners and chin", corners),
        MarkChoice::fixed("upper face only", upper),
        MarkChoice::random("random", markable),
    ]
}

/// Inputs of the search for the best order.
struct Search<'a> {
    wireframe: &'a Wireframe,
    populations: &'a [Population],
    method: &'a FitMethod,
    markable: &'a [MarkableNode],
}

impl Search<'_> {
    /// Returns the mean node error in percent of the eye distance, averaged over nodes, then people, then populations. The result is
    /// infinite when a person cannot be fitted.
    fn error(&self, nodes: &[NodeId]) -> f64 {
        let noise = MarkNoise::Reliability(self.markable);
        let of_person = |person: &Person| {
            let errors = person_errors(self.wireframe, self.method, person, nodes, noise, false)?;
            let mean = errors.iter().map(|e| e.0).sum::<f64>() / errors.len() as f64;
            Some(100.0 * mean / person.eye_distance)
        };
        let of_population = |population: &Population| {
            let errors: Vec<f64> = population.people.iter().map(|p| of_person(p).unwrap_or(f64::INFINITY)).collect();
            errors.iter().sum::<f64>() / errors.len() as f64
        };
        self.populations.iter().map(of_population).sum::<f64>() / self.populations.len() as f64
    }

    /// Returns the candidate with the smallest error of the order that `order_with` makes with it; the first one in case of a tie.
    fn best(&self, candidates: &[NodeId], order_with: impl Fn(NodeId) -> Vec<NodeId> + Sync) -> Option<NodeId> {
        let errors: Vec<f64> = candidates.par_iter().map(|&node| self.error(&order_with(node))).collect();
        (0..candidates.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b]).then(a.cmp(&b))).map(|k| candidates[k])
    }
}

/// Searches for the best order of marks for a fit method on populations, as described in the module's documentation.
///
/// `progress` is called with the number of finished steps and of all steps, and may return `false` to stop.
///
/// # Errors
/// [`EvaluateError::TooFewCandidates`] when fewer than [`SUGGESTED_COUNT`] nodes can be marked on every person, or
/// [`EvaluateError::Interrupted`].
pub fn suggest_marks(
    wireframe: &Wireframe,
    tables: &Tables,
    populations: &[Population],
    method: &FitMethod,
    mut progress: impl FnMut(usize, usize) -> bool,
) -> Result<Vec<SuggestedMark>, EvaluateError> {
    let markable = markable_nodes();
    let everywhere = |n: &NodeId| populations.iter().all(|p| p.people.iter().all(|person| person.knows(*n)));
    let candidates: Vec<NodeId> = markable.iter().map(|m| m.node).filter(everywhere).collect();
    if candidates.len() < SUGGESTED_COUNT {
        return Err(EvaluateError::TooFewCandidates { found: candidates.len(), needed: SUGGESTED_COUNT });
    }
    let search = Search { wireframe, populations, method, markable };
    let (mut done, total) = (0, SUGGESTED_COUNT - FEWEST);
    let mut step = || {
        done += 1;
        if progress(done, total) { Ok(()) } else { Err(EvaluateError::Interrupted) }
    };

    let mut order: Vec<NodeId> = DEFAULT_LANDMARK_NODES.into_iter().filter(everywhere).collect();
    let mut last = Vec::new();
    while order.len() > FEWEST {
        let without = |node: NodeId| order.iter().copied().filter(|&n| n != node).collect();
        let Some(dropped) = search.best(&order, without) else { break };
        order.retain(|&n| n != dropped);
        last.push(dropped);
        step()?;
    }
    order.extend(last.into_iter().rev());
    while order.len() < SUGGESTED_COUNT {
        let others: Vec<NodeId> = candidates.iter().copied().filter(|c| !order.contains(c)).collect();
        let Some(next) = search.best(&others, |node| order.iter().copied().chain([node]).collect()) else { break };
        order.push(next);
        step()?;
    }

    let mark = |(k, node): (usize, &NodeId)| SuggestedMark {
        rank: k + 1,
        node: *node,
        fp: tables.feature_points.iter().find(|row| row.nodes == [*node]).map(|row| row.fp),
        error_after: (k + 1 >= FEWEST).then(|| search.error(&order[..=k])),
        description: markable.iter().find(|m| m.node == *node).map(|m| m.description.clone()).unwrap_or_default(),
    };
    Ok(order.iter().enumerate().map(mark).collect())
}

/// Returns the suggested marks in the columns of `suggested_marks.csv`.
pub fn suggested_table(marks: &[SuggestedMark]) -> Table {
    let mut table = Table::new(["rank", "node", "fp", "error_after_percent_es", "description"]);
    for m in marks {
        table.rows.push(vec![
            Cell::Count(m.rank),
            Cell::Count(m.node.index()),
            Cell::Text(m.fp.map(|fp| fp.to_string()).unwrap_or_default()),
            Cell::maybe(m.error_after.map(|e| (e * 1e4).round() / 1e4), 2),
            Cell::text(&m.description),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        evaluate::{TruthNode, simulated_people},
        simulate::SimulateOptions,
    };

    #[test]
    fn markable_nodes_are_live_named_once_and_plausible() {
        let wireframe = Wireframe::candide3();
        let nodes = markable_nodes();
        let distinct: std::collections::BTreeSet<_> = nodes.iter().map(|m| m.node).collect();
        assert_eq!(distinct.len(), nodes.len());
        for m in nodes {
            assert!(wireframe.live_nodes().contains(&m.node), "{}", m.node);
            assert!((0.005..=0.1).contains(&m.deviation_es) && !m.description.is_empty(), "{}", m.node);
        }
        // A node and its mirror image are equally easy to click.
        let frontal = wireframe.frontal();
        for m in nodes {
            let p = frontal[m.node.index()];
            let mirrored = |other: &&MarkableNode| {
                let q = frontal[other.node.index()];
                (q.x + p.x).abs() < 1e-9 && (q.y - p.y).abs() < 1e-9
            };
            let twin = nodes.iter().find(mirrored).unwrap_or_else(|| panic!("node {} lacks its mirror", m.node));
            assert_eq!(twin.deviation_es, m.deviation_es, "{}", m.node);
        }
    }

    #[test]
    fn the_shipped_suggestion_is_an_order_of_markable_nodes_that_gets_better() {
        let marks = suggested_marks();
        let markable: Vec<NodeId> = markable_nodes().iter().map(|m| m.node).collect();
        assert_eq!(marks.iter().map(|m| m.rank).collect::<Vec<_>>(), (1..=SUGGESTED_COUNT).collect::<Vec<_>>());
        let distinct: std::collections::BTreeSet<_> = marks.iter().map(|m| m.node).collect();
        assert_eq!(distinct.len(), SUGGESTED_COUNT);
        let tables = Tables::candide3();
        for m in marks {
            assert!(markable.contains(&m.node) && !m.description.is_empty());
            assert_eq!(m.error_after.is_some(), m.rank >= 3);
            if let Some(fp) = m.fp {
                assert_eq!(tables.feature_point_nodes(fp), Some([m.node].as_slice()));
            }
        }
        let errors: Vec<f64> = marks.iter().filter_map(|m| m.error_after).collect();
        // The default marks are chosen by the motion, so one of them may add nothing to the neutral fit.
        assert!(errors.windows(2).all(|w| w[1] < 1.01 * w[0]), "{errors:?}");
        let defaults: std::collections::BTreeSet<_> = marks[..DEFAULT_LANDMARK_NODES.len()].iter().map(|m| m.node).collect();
        assert_eq!(
            defaults,
            DEFAULT_LANDMARK_NODES.into_iter().collect(),
            "the default marks, the suggested ones and the ones that the page requests are the same list"
        );
    }

    #[test]
    fn the_default_marks_come_first_and_the_least_useful_of_them_last() {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let options = SimulateOptions { subjects: 6, ..SimulateOptions::default() };
        let people = vec![simulated_people(&options, &wireframe, &tables).unwrap()];
        let method = FitMethod::similarity(&wireframe);
        let marks = suggest_marks(&wireframe, &tables, &people, &method, |_, _| true).unwrap();
        let markable = markable_nodes();
        let search = Search { wireframe: &wireframe, populations: &people, method: &method, markable };
        let found: Vec<NodeId> = marks.iter().map(|m| m.node).collect();
        let count = DEFAULT_LANDMARK_NODES.len();
        let sorted = |nodes: &[NodeId]| nodes.iter().copied().collect::<std::collections::BTreeSet<_>>();
        assert_eq!(sorted(&found[..count]), sorted(&DEFAULT_LANDMARK_NODES));
        let least = search.error(&found[..count - 1]);
        for &dropped in &DEFAULT_LANDMARK_NODES {
            let others: Vec<NodeId> = found[..count].iter().copied().filter(|&n| n != dropped).collect();
            assert!(search.error(&others) >= least - 1e-9, "{dropped}");
        }
        assert_eq!(marks[6].error_after, Some(search.error(&found[..7])));
        assert_eq!(suggest_marks(&wireframe, &tables, &people, &method, |_, _| true).unwrap(), marks);
        assert!(matches!(suggest_marks(&wireframe, &tables, &people, &method, |_, _| false), Err(EvaluateError::Interrupted)));
    }

    #[test]
    fn too_few_nodes_are_refused_with_their_number() {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let node = |n| TruthNode { node: NodeId(n), position: nalgebra::Point2::new(f64::from(n), 0.0), inner: true };
        let person = Person::new("p".to_owned(), 1.0, vec![node(20), node(53), node(10)], 1, 0);
        let people = [Population { name: "few".to_owned(), real: true, people: vec![person] }];
        let error = suggest_marks(&wireframe, &tables, &people, &FitMethod::similarity(&wireframe), |_, _| true).unwrap_err();
        assert!(error.to_string().starts_with("3 nodes can be marked on every person; at least 15"), "{error}");
    }

    #[test]
    fn choices_take_the_first_known_nodes_and_random_ones_differ_by_person() {
        let node = |n| TruthNode { node: NodeId(n), position: nalgebra::Point2::new(f64::from(n), 0.0), inner: true };
        let person = Person::new("p".to_owned(), 1.0, (0..30).map(node).collect(), 1, 0);
        let fixed = MarkChoice::fixed("f", [99, 3, 5, 7].map(NodeId).to_vec());
        assert_eq!(fixed.nodes(&person, 0, 2, 1), Some(vec![NodeId(3), NodeId(5)]));
        assert_eq!(fixed.nodes(&person, 0, 4, 1), None);
        let random = MarkChoice::random("r", (0..30).map(NodeId).collect());
        let draw = |index, seed| random.nodes(&person, index, 9, seed).unwrap();
        assert_eq!(draw(0, 1), draw(0, 1));
        assert_ne!(draw(0, 1), draw(1, 1));
        assert_ne!(draw(0, 1), draw(0, 2));
        // A larger number of marks contains the smaller one, so that curves over the number of marks are comparable.
        assert_eq!(random.nodes(&person, 0, 5, 1).unwrap(), draw(0, 1)[..5]);
    }
}
