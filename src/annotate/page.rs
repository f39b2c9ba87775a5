//! The page itself: files embedded in the binary, and the wireframe data that it needs.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use crate::{
    dataset::DEFAULT_LANDMARK_NODES,
    overlay::legend,
    pipeline::Workbench,
    track::NodeState,
    units::NodeId,
    wireframe::{markable_nodes, suggested_marks},
};

/// Feature contours as node chains, as in the report.
const CONTOURS: &str = include_str!("../report/assets/contours.csv");

/// Number of marks that the page asks for; the suggested nodes begin with these.
const ASKED_FOR: usize = DEFAULT_LANDMARK_NODES.len();

/// Name, media type and content of every file of the page.
const FILES: [(&str, &str, &str); 10] = [
    ("", "text/html; charset=utf-8", include_str!("assets/index.html")),
    ("app.css", "text/css; charset=utf-8", include_str!("assets/app.css")),
    ("main.js", SCRIPT, include_str!("assets/main.js")),
    ("server.js", SCRIPT, include_str!("assets/server.js")),
    ("stage.js", SCRIPT, include_str!("assets/stage.js")),
    ("marking.js", SCRIPT, include_str!("assets/marking.js")),
    ("diagram.js", SCRIPT, include_str!("assets/diagram.js")),
    ("scrubber.js", SCRIPT, include_str!("assets/scrubber.js")),
    ("tracking.js", SCRIPT, include_str!("assets/tracking.js")),
    ("icon.svg", "image/svg+xml", include_str!("assets/icon.svg")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// Media type and content of a file of the page.
pub fn file(name: &str) -> Option<(&'static str, &'static str)> {
    FILES.iter().find(|(known, ..)| *known == name).map(|&(_, kind, content)| (kind, content))
}

/// A node in the page's data.
#[derive(Serialize)]
struct Node {
    id: NodeId,
    /// Frontal view, face space with y down.
    x: f64,
    y: f64,
    name: String,
    fp: Option<String>,
    region: crate::wireframe::Region,
    live: bool,
    /// Whether a person can locate it in an image.
    markable: bool,
}

/// Data that the page needs before it shows a sequence.
pub fn setup(bench: &Workbench, mode: &str, title: &str, key: &str) -> Value {
    let frontal = bench.wireframe.frontal();
    let fps: BTreeMap<NodeId, &crate::wireframe::FeaturePointRow> = bench
        .tables
        .feature_points
        .iter()
        .filter_map(|row| match row.nodes[..] {
            [node] => Some((node, row)),
            _ => None,
        })
        .collect();
    let names: BTreeMap<NodeId, &str> = markable_nodes().iter().map(|m| (m.node, m.description.as_str())).collect();
    let live = bench.wireframe.live_nodes();
    let node = |(k, p): (usize, &nalgebra::Point2<f64>)| {
        let id = NodeId(k as u16);
        let row = fps.get(&id);
        let fallback = || row.map_or_else(|| format!("{} node", bench.tables.region(id)), |row| row.description.clone());
        Node {
            id,
            x: p.x,
            y: -p.y,
            name: names.get(&id).map_or_else(fallback, |&name| name.to_owned()),
            fp: row.map(|row| row.fp.to_string()),
            region: bench.tables.region(id),
            live: live.contains(&id),
            markable: names.contains_key(&id),
        }
    };
    let states: Vec<Value> = legend().into_iter().chain([(NodeState::Corrected, [255, 255, 255])]).map(state).collect();
    json!({
        "mode": mode,
        "title": title,
        "key": key,
        "version": env!("CARGO_PKG_VERSION"),
        "nodes": frontal.iter().enumerate().map(node).collect::<Vec<_>>(),
        "edges": bench.wireframe.edges(),
        "contours": { "strong": contours("strong", frontal.len()), "fine": contours("fine", frontal.len()) },
        "suggested": suggested(frontal.len()),
        "askedFor": ASKED_FOR,
        "enough": super::ENOUGH_MARKS,
        "minimum": crate::fit::MINIMUM_MARKS,
        "states": states,
    })
}

fn state((state, [red, green, blue]): (NodeState, [u8; 3])) -> Value {
    json!({ "name": state.name(), "colour": format!("#{red:02x}{green:02x}{blue:02x}") })
}

/// Suggested nodes of the wireframe, best first.
fn suggested(node_count: usize) -> Vec<NodeId> {
    suggested_marks().iter().map(|m| m.node).filter(|n| n.index() < node_count).collect()
}

/// Chains of nodes of a weight that exist in the wireframe.
fn contours(weight: &str, node_count: usize) -> Vec<Vec<u16>> {
    let rows = CONTOURS.lines().skip(1).filter_map(|line| line.split_once(',')?.1.split_once(','));
    let chain = |nodes: &str| nodes.split_whitespace().map(|n| n.parse().ok().filter(|&n| usize::from(n) < node_count)).collect();
    rows.filter(|&(w, _)| w == weight).filter_map(|(_, nodes)| chain(nodes)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::PipelineOptions;

    #[test]
    fn the_suggested_nodes_can_be_marked_and_have_names() {
        let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
        let setup = setup(&bench, "marks", "faces", "");
        let suggested = setup["suggested"].as_array().unwrap();
        assert_eq!((suggested.len(), suggested[0].as_u64()), (15, Some(20)));
        for node in suggested {
            let node = &setup["nodes"][node.as_u64().unwrap() as usize];
            assert!(node["markable"] == true && node["live"] == true && node["name"].as_str().unwrap().len() > 5, "{node}");
        }
        assert_eq!(setup["nodes"][64]["name"], "right mouth corner");
        // The subject's right is on the left of the image, and y points down: the mouth is below the eyes.
        assert!(
            setup["nodes"][64]["x"].as_f64() < Some(0.0) && setup["nodes"][64]["y"].as_f64() > setup["nodes"][53]["y"].as_f64()
        );
    }

    #[test]
    fn nothing_of_the_page_comes_from_elsewhere() {
        for (name, _, content) in FILES {
            let outside = content.replace("http://www.w3.org/2000/svg", "");
            assert!(!outside.contains("http://") && !outside.contains("https://") && !outside.contains("//cdn"), "{name}");
            assert!(
                !content.contains("innerHTML") && !content.contains("eval("),
                "{name}: texts are inserted as text, not as markup"
            );
        }
        assert!(file("main.js").is_some() && file("../main.js").is_none());
    }
}
