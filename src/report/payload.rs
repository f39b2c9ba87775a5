//! Data for the page's script, as compact JSON.

use std::{
    borrow::Cow,
    collections::{BTreeMap, BTreeSet},
};

use base64::{Engine, prelude::BASE64_STANDARD};
use nalgebra::{Point3, Vector3};
use serde_json::{Map, Value, json};

use super::{
    ApexFap, ReportData, TrackQuality,
    numbers::{length, rounded},
    view::group_text,
};
use crate::{
    statistics::Representative,
    track::FrameQuality,
    units::{NodeId, SequenceId},
    wireframe::{Tables, Wireframe},
};

/// Feature contours as node chains, `contour,weight,nodes`; the weight is `strong` or `fine`.
const CONTOURS: &str = include_str!("assets/contours.csv");
/// Shades of a triangle, from dark to lit.
const SHADES: usize = 10;
/// Direction to the light: from the viewer's upper left.
const LIGHT: [f64; 3] = [-0.45, 0.55, 0.7];

/// Lists of names to which rows refer by index.
struct Index<'a> {
    ids: BTreeMap<&'a SequenceId, usize>,
    emotions: BTreeMap<&'a str, usize>,
    reasons: BTreeMap<&'a str, usize>,
}

/// The data as JSON that is safe inside a script element: `<` is escaped wherever it occurs.
pub(super) fn json(data: &ReportData<'_>) -> String {
    let live = data.wireframe.live_nodes();
    let shown: Vec<Cow<'_, Representative>> = data.representatives.iter().map(shown).collect();
    let index = Index::new(data, &shown);
    let mut faps: BTreeMap<u8, (&str, &str, bool)> = BTreeMap::new();
    for fap in data.apex_faps.iter().flatten() {
        faps.entry(fap.number).or_insert((&fap.name, &fap.unit, fap.is_angle));
    }
    let no_faps = Vec::new();
    let representatives: Vec<Value> = shown
        .iter()
        .enumerate()
        .map(|(k, r)| {
            let mut value = representative(r, live, &index, data.apex_faps.get(k).unwrap_or(&no_faps));
            if let (Some(variation), Value::Object(map)) = (data.variations.get(k).and_then(Option::as_ref), &mut value) {
                let along = super::covariates::of_emotion(data, &r.label.emotion);
                map.insert("variation".to_owned(), super::variation::payload(variation, &along, live));
            }
            value
        })
        .collect();
    let value = json!({
        "ids": index.ids.keys().map(|id| [&id.subject, &id.sequence]).collect::<Vec<_>>(),
        "emotions": index.emotions.keys().collect::<Vec<_>>(),
        "reasons": index.reasons.keys().collect::<Vec<_>>(),
        "wireframe": wireframe(data.wireframe),
        "nodes": node_names(data.wireframe, data.tables),
        "faps": faps,
        "representatives": representatives,
        "pairs": data.groups.as_ref().map(|groups| super::groups::payload(groups, data)),
        "tracks": data.tracks.iter().map(|t| track(t, &index, data.tracked_here)).collect::<Vec<_>>(),
        "player": data.player,
        "glossary": glossary(super::GLOSSARY),
    });
    // `<` occurs inside strings only, where JSON allows the escape.
    value.to_string().replace('<', "\\u003c")
}

impl<'a> Index<'a> {
    fn new(data: &ReportData<'a>, representatives: &'a [Cow<'_, Representative>]) -> Self {
        fn number<T: Ord>(set: BTreeSet<T>) -> BTreeMap<T, usize> {
            set.into_iter().enumerate().map(|(k, item)| (item, k)).collect()
        }
        let tracks = data.tracks;
        let ids = tracks.iter().map(|t| &t.id).chain(representatives.iter().flat_map(|r| &r.sequences));
        let emotions = tracks.iter().map(|t| t.emotion.as_str());
        let emotions = emotions.chain(representatives.iter().map(|r| r.label.emotion.as_str()));
        Self {
            ids: number(ids.collect()),
            emotions: number(emotions.collect()),
            reasons: number(tracks.iter().flat_map(|t| t.summary.recovered.keys().map(String::as_str)).collect()),
        }
    }
}

/// Word and meaning of every row of the glossary; a row with several words gives several entries.
fn glossary(markdown: &str) -> Vec<[&str; 2]> {
    let rows = markdown.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | "));
    let rows = rows.filter(|(words, _)| !words.starts_with("---") && *words != "word");
    rows.flat_map(|(words, meaning)| words.split([',', '(', ')']).map(move |word| [word.trim(), meaning]))
        .filter(|[word, _]| !word.is_empty())
        .collect()
}

/// Triangles and contours over live nodes (by their index in the list of live nodes), and a fixed shade per triangle.
fn wireframe(wireframe: &Wireframe) -> Value {
    let place: BTreeMap<NodeId, usize> = wireframe.live_nodes().iter().enumerate().map(|(k, &n)| (n, k)).collect();
    let corners = wireframe.triangles().iter().flatten().filter_map(|n| place.get(n));
    json!({
        "live": wireframe.live_nodes(),
        "triangles": corners.collect::<Vec<_>>(),
        "shades": wireframe.triangles().iter().map(|t| shade(wireframe.vertices(), *t)).collect::<Vec<_>>(),
        "shadeCount": SHADES,
        "contours": contours(wireframe, &place, "strong"),
        "fine": contours(wireframe, &place, "fine"),
    })
}

/// Contours of a weight, by the indices of their nodes.
fn contours(wireframe: &Wireframe, place: &BTreeMap<NodeId, usize>, weight: &str) -> Vec<Vec<usize>> {
    let chains = contour_chains(wireframe, weight);
    chains.iter().filter_map(|chain| chain.iter().map(|n| place.get(n).copied()).collect()).collect()
}

/// Contours of a weight (`strong`, `fine`) as chains of nodes, if the wireframe has all their nodes.
pub(super) fn contour_chains(wireframe: &Wireframe, weight: &str) -> Vec<Vec<NodeId>> {
    let live = |node: &str| {
        let node = NodeId(node.parse().ok()?);
        wireframe.live_nodes().contains(&node).then_some(node)
    };
    let rows = CONTOURS.lines().skip(1).filter_map(|line| line.split_once(',')?.1.split_once(','));
    rows.filter(|&(w, _)| w == weight).filter_map(|(_, nodes)| nodes.split_whitespace().map(live).collect()).collect()
}

/// Lambert shade of a neutral triangle under [`LIGHT`], 0 to `SHADES` - 1; independent of the winding.
fn shade(vertices: &[Point3<f64>], triangle: [NodeId; 3]) -> usize {
    let [a, b, c] = triangle.map(|n| vertices[n.index()]);
    let normal = (b - a).cross(&(c - a));
    let normal = if normal.z < 0.0 { -normal } else { normal };
    let lit = normal.try_normalize(1e-12).map_or(0.0, |n| n.dot(&Vector3::from(LIGHT).normalize()).max(0.0));
    ((lit * SHADES as f64) as usize).min(SHADES - 1)
}

/// Name of each live node: its feature point, else its region.
fn node_names(wireframe: &Wireframe, tables: &Tables) -> Vec<String> {
    let mut names: BTreeMap<NodeId, String> = BTreeMap::new();
    for row in &tables.feature_points {
        for &node in &row.nodes {
            names.entry(node).or_insert_with(|| format!("{} ({})", row.description, row.fp));
        }
    }
    let name = |n: &NodeId| names.get(n).cloned().unwrap_or_else(|| tables.region(*n).to_string());
    wireframe.live_nodes().iter().map(name).collect()
}

/// Most sequences of a class that the report draws as dots.
pub(super) const MOST_DOTS: usize = crate::statistics::scale::MANY_MODELS;

/// A representative reduced to the number of sequences that the report draws, at regular intervals.
fn shown(r: &Representative) -> Cow<'_, Representative> {
    let n = r.sequences.len();
    if n <= MOST_DOTS {
        return Cow::Borrowed(r);
    }
    let chosen: Vec<usize> = (0..MOST_DOTS).map(|k| k * n / MOST_DOTS).collect();
    let rows = |field: usize| chosen.iter().filter_map(move |i| r.trimming.get(field * n + i).cloned());
    let fields = r.trimming.len() / n;
    Cow::Owned(Representative {
        label: r.label.clone(),
        model: r.model.clone(),
        sequences: chosen.iter().map(|&i| r.sequences[i].clone()).collect(),
        trimming: (0..fields).flat_map(rows).collect(),
        certificate: r.certificate.clone(),
        distances: chosen.iter().map(|&i| r.distances[i]).collect(),
        distances_untrimmed: chosen.iter().map(|&i| r.distances_untrimmed[i]).collect(),
        node_dispersion: r.node_dispersion.clone(),
        ..*r
    })
}

fn representative(r: &Representative, live: &[NodeId], index: &Index<'_>, faps: &[ApexFap]) -> Value {
    let at = |m: usize, n: NodeId| r.model.frames()[m].node(n).unwrap_or_default();
    let neutral = live.iter().flat_map(|&n| [length(at(0, n).x), length(at(0, n).y)]);
    let offsets = |m: usize| -> Vec<Value> {
        live.iter()
            .flat_map(|&n| {
                let offset = at(m, n) - at(0, n);
                [length(offset.x), length(offset.y)]
            })
            .collect()
    };
    let mut map = Map::new();
    let mut set = |key: &str, value: Value| map.insert(key.to_owned(), value);
    set("emotion", json!(index.emotions.get(r.label.emotion.as_str())));
    set("group", json!(group_text(&r.label)));
    set("neutral", neutral.collect());
    set("offsets", (1..r.model.frame_count()).map(offsets).collect());
    set("sequences", r.sequences.iter().map(|id| json!(index.ids.get(id))).collect());
    set("faps", faps.iter().map(|fap| json!([fap.number, fap.value])).collect());
    if r.sequences.len() > 1 {
        let per_node = |n: &NodeId| length(r.node_dispersion.get(n.index()).copied().unwrap_or(0.0));
        set("nodeDispersion", live.iter().map(per_node).collect());
        set("dispersion", r.dispersion.map_or(Value::Null, length));
        set("dispersionUntrimmed", r.dispersion_untrimmed.map_or(Value::Null, length));
        set("distances", r.distances.iter().map(|d| d.map_or(Value::Null, length)).collect());
        set("distancesUntrimmed", r.distances_untrimmed.iter().copied().map(length).collect());
        let (distances, dropped) = trimming(r);
        set("fieldDistances", distances);
        set("dropped", dropped);
    }
    Value::Object(map)
}

/// Trimming by field: the distance of every sequence (in the order of `sequences`), and the indices of the dropped ones.
fn trimming(r: &Representative) -> (Value, Value) {
    let place: BTreeMap<&SequenceId, usize> = r.sequences.iter().enumerate().map(|(k, id)| (id, k)).collect();
    let fields = r.model.frame_count() - 1;
    let mut distances = vec![vec![Value::Null; r.sequences.len()]; fields];
    let mut dropped: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); fields];
    for row in r.trimming.iter().filter(|row| row.field < fields) {
        if let Some(&k) = place.get(&row.id) {
            distances[row.field][k] = length(row.distance);
            if row.dropped {
                dropped[row.field].insert(k);
            }
        }
    }
    (json!(distances), json!(dropped))
}

/// A row of a track: sequence, emotion, frames, eye distance px, tracked %, residual px, reasons with counts, nodes with counts, expected
/// error px, whether to review it, why, percent of lost nodes per frame, expected error px per frame, pictures of the neutral and the apex
/// frame, stem of its files, expected error of the placement px, what a person found when looking at it.
fn track(t: &TrackQuality, index: &Index<'_>, has_files: bool) -> Value {
    let reasons = t.summary.recovered.iter().filter(|&(_, &n)| n > 0);
    json!([
        index.ids.get(&t.id),
        index.emotions.get(t.emotion.as_str()),
        t.summary.frames,
        rounded(t.summary.eye_distance_px, 1),
        rounded(t.summary.tracked_share * 100.0, 2),
        rounded(t.summary.mean_residual_px, 3),
        reasons.flat_map(|(reason, &n)| [index.reasons.get(reason.as_str()).copied().unwrap_or(0), n]).collect::<Vec<_>>(),
        t.summary.worst_nodes.iter().flat_map(|&(node, n)| [usize::from(node.0), n]).collect::<Vec<_>>(),
        t.summary.expected_error_px.map_or(Value::Null, |px| rounded(px, 3)),
        t.is_to_look_at(),
        t.summary.reasons,
        steps(&t.course)
            .map(|frames| rounded(100.0 * worst(frames.iter().map(|f| f.lost)).unwrap_or(0.0), 0))
            .collect::<Vec<_>>(),
        steps(&t.course)
            .map(|frames| worst(frames.iter().filter_map(|f| f.expected_error_px)).map_or(Value::Null, |px| rounded(px, 2)))
            .collect::<Vec<_>>(),
        t.pictures.as_ref().map(|pictures| pictures.each_ref().map(|p| BASE64_STANDARD.encode(p))),
        has_files.then(|| t.id.to_string()),
        t.summary.placement_error_px.map_or(Value::Null, |px| rounded(px, 3)),
        t.look,
    ])
}

/// Most steps in the report's chart of a track over time.
const MOST_STEPS: usize = 40;

/// Groups frames into the steps that are drawn; each frame is a step if there are few.
fn steps(course: &[FrameQuality]) -> impl Iterator<Item = &[FrameQuality]> {
    course.chunks(course.len().div_ceil(MOST_STEPS).max(1))
}

fn worst(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_contour_is_a_chain_of_candide3_edges() {
        let w = Wireframe::candide3();
        let place: BTreeMap<NodeId, usize> = w.live_nodes().iter().enumerate().map(|(k, &n)| (n, k)).collect();
        let chains = [contours(&w, &place, "strong"), contours(&w, &place, "fine")].concat();
        assert_eq!(chains.len(), CONTOURS.lines().count() - 1);
        for pair in chains.iter().flat_map(|chain| chain.windows(2)) {
            let (a, b) = (w.live_nodes()[pair[0]], w.live_nodes()[pair[1]]);
            assert!(w.edges().contains(&(a.min(b), a.max(b))), "{a} {b}");
        }
    }

    #[test]
    fn the_glossary_has_every_word_with_its_meaning() {
        let words =
            glossary("# Words\n\n| word | means |\n| --- | --- |\n| action unit (AU) | a muscle |\n| mark, point | a place |\n");
        assert_eq!(words, [["action unit", "a muscle"], ["AU", "a muscle"], ["mark", "a place"], ["point", "a place"]]);
        assert!(glossary(crate::report::GLOSSARY).iter().any(|[word, _]| *word == "FAP"));
    }

    #[test]
    fn a_wireframe_without_the_nodes_has_no_contours() {
        assert!(contours(&Wireframe::candide3(), &BTreeMap::from([(NodeId(0), 0)]), "strong").is_empty());
    }

    #[test]
    fn shades_do_not_depend_on_the_winding() {
        // A triangle in the plane z = 0: its normal is (0, 0, 1); lit = 0.7 / |(0.45, 0.55, 0.7)| = 0.7 / 0.9975 = 0.70, shade 7.
        let v = [Point3::new(0.0, 0.0, 0.0), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
        let [a, b, c] = [NodeId(0), NodeId(1), NodeId(2)];
        assert_eq!(shade(&v, [a, b, c]), 7);
        assert_eq!(shade(&v, [a, c, b]), 7);
        assert_eq!(shade(&v, [a, a, b]), 0);
    }

    #[test]
    fn nodes_are_named_by_feature_point_or_region() {
        let names = node_names(&Wireframe::candide3(), &Tables::candide3());
        let live = Wireframe::candide3().live_nodes().to_vec();
        let name = |n: u16| names[live.iter().position(|&l| l == NodeId(n)).unwrap()].as_str();
        assert_eq!(name(31), "outer mouth corner L (8.3)");
        assert_eq!(name(14), "contour");
    }
}
