//! A custom point tracker. The method asks it where points moved and does the rest (lost points, springs, states).
//!
//! This tracker knows the truth: it reads the position of every node in every frame from a table `frame,node,x,y`, and loses one
//! node.
//!
//!     cargo run --example point_tracker -- fixtures/simulated/S001/005 fixtures/simulated/truth/S001_005.csv

use std::{collections::BTreeMap, env, error::Error, path::Path};

use grimace::{
    correspondence::read_correspondences,
    dataset::list_frames,
    fit::{FitOptions, Fitter},
    sequence::{Frame, SequenceReader},
    track::{Found, PointTracker, Probe, Slot, Track, TrackError, TrackOptions, TrackPlan, track_with},
    wireframe::Face,
};
use nalgebra::Point2;

/// Positions of all nodes by frame number.
type Positions = BTreeMap<u32, Vec<Point2<f64>>>;

/// The tracker: the positions, and the numbers of the frames in its slots.
struct Known {
    positions: Positions,
    seen: Vec<u32>,
    lost: usize,
}

impl Known {
    /// Positions of all nodes in the frame of a slot.
    fn nodes(&self, slot: Slot) -> &[Point2<f64>] {
        let number = match slot {
            Slot::Neutral => self.seen.first(),
            Slot::Previous => self.seen.iter().rev().nth(1),
            Slot::Current => self.seen.last(),
        };
        number.and_then(|number| self.positions.get(number)).map_or(&[], Vec::as_slice)
    }
}

impl PointTracker for Known {
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError> {
        self.seen.push(frame.number());
        Ok(())
    }

    /// Moves a point like the nearest known node.
    fn find(&mut self, from: Slot, to: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        let (before, after) = (self.nodes(from), self.nodes(to));
        let find = |probe: &Probe| {
            let distance = |k: &usize| (before[*k] - probe.position).norm();
            let nearest = (0..before.len().min(after.len())).min_by(|a, b| distance(a).total_cmp(&distance(b)));
            match nearest {
                Some(k) if k != self.lost => Found::At { position: probe.position + (after[k] - before[k]), difference: 0.0 },
                _ => Found::Lost,
            }
        };
        Ok(probes.iter().map(find).collect())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    match env::args().skip(1).collect::<Vec<_>>().as_slice() {
        [folder, table] => {
            let track = run(Path::new(folder), Path::new(table), 20)?;
            println!("node 20 in the last frame: {:?}", track.frames.last().map(|frame| frame.nodes[20].state));
            Ok(())
        }
        _ => Err("usage: point_tracker FOLDER_OF_FRAMES POSITIONS.csv".into()),
    }
}

/// Tracks a folder of frames by a table of positions; one node is lost in every frame.
///
/// # Errors
/// Any error of the steps.
pub fn run(folder: &Path, table: &Path, lost: usize) -> Result<Track, Box<dyn Error>> {
    let mut positions = Positions::new();
    for row in csv::Reader::from_path(table)?.deserialize() {
        let (frame, _, x, y): (u32, u16, f64, f64) = row?;
        positions.entry(frame).or_default().push(Point2::new(x, y));
    }
    let Face { wireframe, tables } = Face::candide3();
    let marks = read_correspondences(&folder.join("correspondences.csv"), &tables, wireframe.node_count())?;
    let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks)?;
    let frames = SequenceReader::open(&list_frames(folder, None, None)?)?;
    let plan = TrackPlan::new(&wireframe, &tables);
    let mut tracker = Known { positions, seen: Vec::new(), lost };
    Ok(track_with(&mut tracker, &wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)?)
}
