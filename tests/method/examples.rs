//! The programs of `examples/`, run on the shipped dataset.

#[allow(dead_code)]
#[path = "../../examples/fap_file.rs"]
mod fap_file;
#[allow(dead_code)]
#[path = "../../examples/fit_to_fap.rs"]
mod fit_to_fap;
#[allow(dead_code)]
#[path = "../../examples/own_statistics.rs"]
mod own_statistics;
#[allow(dead_code)]
#[path = "../../examples/point_tracker.rs"]
mod point_tracker;

use grimace::internal::{
    fap::{FapNumber, read_fap},
    track::{LossReason, NodeState},
};

use crate::common::root;

#[test]
fn a_folder_of_frames_becomes_a_fap_file_and_a_larger_one() {
    let folder = tempfile::tempdir().unwrap();
    let (fap, larger) = (folder.path().join("happiness.fap"), folder.path().join("larger.fap"));
    fit_to_fap::run(&root().join("fixtures/simulated/S001/005"), &fap).unwrap();
    let sequence = read_fap(&fap).unwrap().sequence;
    assert_eq!((sequence.frames.len(), sequence.fps), (25, 25.0));
    // FAP 12, raise_l_cornerlip: a smile.
    let corner = FapNumber::try_from(12).unwrap();
    let raised = sequence.frames.last().unwrap().value(corner).unwrap();
    assert!(raised > 20.0, "{raised}");
    fap_file::run(&fap, 1.5, &larger).unwrap();
    assert_eq!(read_fap(&larger).unwrap().sequence.frames.last().unwrap().value(corner).unwrap(), (raised * 1.5).round());
}

#[test]
fn the_representative_of_custom_models_leaves_the_outlier_out() {
    let smile = own_statistics::run(&[0.6, 0.8, 1.0, 1.1, 5.0]).unwrap();
    // floor(0.2 * 5) = 1 model is dropped from each of the four fields: the smile of strength 5.
    let dropped: Vec<_> = smile.trimming.iter().filter(|row| row.dropped).map(|row| (row.field, row.id.to_string())).collect();
    assert_eq!(dropped, (0..4).map(|field| (field, "S005_smile".to_owned())).collect::<Vec<_>>());
    // Between the middle two of the remaining four.
    let corner = smile.model.frames()[4].nodes()[31] - smile.model.frames()[0].nodes()[31];
    let strength = corner.y / (0.05 * 1024.0);
    assert!((0.8..=1.0).contains(&strength), "{strength}");
}

#[test]
fn a_custom_tracker_is_called_and_its_lost_node_is_recovered() {
    let fixtures = root().join("fixtures/simulated");
    let track = point_tracker::run(&fixtures.join("S001/005"), &fixtures.join("truth/S001_005.csv"), 20).unwrap();
    let last = track.frames.last().unwrap();
    assert_eq!(last.nodes[20].state, NodeState::Recovered(LossReason::Klt));
    assert_eq!(last.nodes[31].state, NodeState::Tracked);
}
