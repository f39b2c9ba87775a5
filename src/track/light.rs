//! Compensates light that changes over a sequence: automatic exposure, a dimmed lamp, flicker.
//!
//! KLT and the alignment compare grey values and assume constant light from frame to frame (Bouguet's assumption). If a face darkens by a
//! few percent per frame, nodes are lost or drift. This module compares the brightness around every node with that in the neutral frame.
//! The median ratio is the change of the light, because an expression makes some parts brighter and others darker. Frames whose light
//! changed by more than [`LEAST_CHANGE`] are scaled to the light of the neutral frame.

use image::GrayImage;
use nalgebra::Point2;

use super::TrackedFrame;
use crate::{sequence::Frame, units::NodeId, wireframe::Wireframe};

/// Smallest relative change of brightness that is compensated.
const LEAST_CHANGE: f64 = 0.02;
/// Largest factor that is compensated: beyond it a frame has too few grey levels, or shows something else.
const MOST: f64 = 4.0;
/// Brightness, grey levels, below which a node is not used.
const DARK: f64 = 4.0;
/// Fewest nodes needed for an estimate.
const FEWEST: usize = 12;

/// Brightness of the neutral face.
#[derive(Clone, Debug)]
pub struct Light {
    /// Mean grey level around each live node; `None` outside the frame.
    neutral: Vec<Option<f64>>,
    /// Half the side of the square around a node, px.
    half: i64,
}

impl Light {
    /// Measures the light of the neutral frame, whose nodes are at `nodes`. `window`: side of the KLT window, px.
    pub fn new(frame: &Frame, live: &[NodeId], nodes: &[Point2<f64>], window: u32) -> Self {
        let half = i64::from(window);
        Self { neutral: means(frame.image(), live, nodes, half), half }
    }

    /// Returns a frame in the light of the neutral one, given the previous tracked frame; `None` if it already has that light.
    pub fn undone_at(&self, frame: &Frame, wireframe: &Wireframe, before: &TrackedFrame) -> Option<Frame> {
        let nodes: Vec<_> = before.nodes.iter().map(|n| n.position).collect();
        self.undone(frame, wireframe.live_nodes(), &nodes)
    }

    /// Same, with the approximate positions of the nodes.
    fn undone(&self, frame: &Frame, live: &[NodeId], nodes: &[Point2<f64>]) -> Option<Frame> {
        let now = means(frame.image(), live, nodes, self.half);
        let ratio = |(was, is): (&Option<f64>, Option<f64>)| match (*was, is) {
            (Some(was), Some(is)) if was >= DARK => Some(is / was),
            _ => None,
        };
        let mut ratios: Vec<f64> = self.neutral.iter().zip(now).filter_map(ratio).collect();
        if ratios.len() < FEWEST {
            return None;
        }
        let change = crate::robust::median(&mut ratios)?;
        if (change - 1.0).abs() <= LEAST_CHANGE || !(1.0 / MOST..=MOST).contains(&change) {
            return None;
        }
        let levels: [u8; 256] = std::array::from_fn(|level| (level as f64 / change).round().clamp(0.0, 255.0) as u8);
        let image = frame.image();
        let pixels = image.as_raw().iter().map(|level| levels[usize::from(*level)]).collect();
        Some(Frame::new(frame.number(), GrayImage::from_raw(image.width(), image.height(), pixels)?))
    }
}

/// Returns mean grey levels of squares around nodes.
fn means(image: &GrayImage, live: &[NodeId], nodes: &[Point2<f64>], half: i64) -> Vec<Option<f64>> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mean = |node: &NodeId| {
        let at = nodes.get(node.index())?;
        let range = |at: f64, size: usize| {
            let bound = |v: f64| v.clamp(0.0, size as f64) as usize;
            let middle = at.round();
            bound(middle - half as f64)..bound(middle + half as f64 + 1.0)
        };
        let (columns, rows) = (range(at.x, width), range(at.y, height));
        let count = columns.len() * rows.len();
        let lines = image.as_raw().chunks_exact(width.max(1)).skip(rows.start).take(rows.len());
        let sum: u64 = lines.flat_map(|line| &line[columns.clone()]).map(|level| u64::from(*level)).sum();
        (count > 0).then(|| sum as f64 / count as f64)
    };
    live.iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use image::Luma;

    use super::*;

    fn frame(number: u32, share: f64) -> Frame {
        let level = |x: u32, y: u32| 60.0 + f64::from(x) * 0.5 + f64::from((x / 8 + y / 8) % 2) * 40.0;
        Frame::new(number, GrayImage::from_fn(160, 120, |x, y| Luma([(level(x, y) * share).round() as u8])))
    }

    fn nodes() -> (Vec<NodeId>, Vec<Point2<f64>>) {
        let places = (0..24).map(|k| Point2::new(20.0 + 5.0 * f64::from(k), 20.0 + 3.0 * f64::from(k))).collect();
        ((0..24).map(NodeId).collect(), places)
    }

    #[test]
    fn a_darker_frame_gets_the_light_of_the_neutral_one() {
        let (live, places) = nodes();
        let light = Light::new(&frame(1, 1.0), &live, &places, 9);
        for share in [0.8, 0.9, 1.2] {
            let undone = light.undone(&frame(2, share), &live, &places).unwrap();
            let off = |(a, b): (&u8, &u8)| a.abs_diff(*b);
            let worst = undone.image().as_raw().iter().zip(frame(1, 1.0).image().as_raw()).map(off).max().unwrap();
            assert!(worst <= 1 && undone.number() == 2, "{share}: {worst}");
        }
    }

    #[test]
    fn equal_and_unmeasurable_light_is_left_unchanged() {
        let (live, places) = nodes();
        let light = Light::new(&frame(1, 1.0), &live, &places, 9);
        assert!(light.undone(&frame(2, 1.01), &live, &places).is_none());
        assert!(light.undone(&frame(2, 0.1), &live, &places).is_none(), "ten times darker");
        let outside: Vec<_> = places.iter().map(|p| p + nalgebra::Vector2::new(1e6, f64::NAN)).collect();
        assert!(light.undone(&frame(2, 0.8), &live, &outside).is_none());
    }
}
