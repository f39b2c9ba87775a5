//! Frames of a person who shows single action unit vectors of Candide-3 at given strengths.

use nalgebra::{Point2, Vector3};

use super::{
    SimulateOptions, SimulatedFrame, Subject,
    blink::close_lids,
    motion::{HeadPose, px_per_unit},
    recording::see,
};
use grimace::internal::wireframe::{ExpressionUnit, Wireframe, find_unit, settle_offsets};

/// Returns a frame of a person who shows action unit vectors (number, strength; 1 is Candide-3's own), with lids closed by `closure` (0 to
/// 1) and the head turned by yaw and pitch, degrees. `frame` selects the seed of the noise.
pub fn show_units(
    who: &Subject,
    units: &[(u16, f64)],
    closure: f64,
    [yaw, pitch]: [f64; 2],
    options: &SimulateOptions,
    frame: usize,
) -> SimulatedFrame {
    let wireframe = Wireframe::candide3();
    let mut offsets = vec![Vector3::zeros(); wireframe.node_count()];
    for &(number, strength) in units {
        let Some((unit, length)) = find_unit(&wireframe, who.fapus(), ExpressionUnit::Auv(number)) else { continue };
        for &(node, offset) in &wireframe.action_units()[unit].offsets {
            offsets[node.index()] += offset * (strength * length);
        }
    }
    settle_offsets(&wireframe, &mut offsets);
    close_lids(who.neutral(), &mut offsets, closure);
    let middle = Point2::new(f64::from(options.width - 1) / 2.0, f64::from(options.height - 1) / 2.0);
    let pose = HeadPose::new([0.0, yaw.to_radians(), pitch.to_radians(), 0.0, 0.0, 1.0], middle, px_per_unit(options));
    see(who, &wireframe, &offsets, &pose, options, frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jaw_drops_by_its_unit() {
        let options = SimulateOptions { width: 160, height: 120, ..SimulateOptions::default() };
        let who = Subject::new(&options, 0).unwrap();
        let chin = |strength: f64| show_units(&who, &[(11, strength)], 0.0, [0.0; 2], &options, 0).nodes[10].y;
        let (rest, half, full) = (chin(0.0), chin(0.5), chin(1.0));
        assert!(full > half && half > rest);
        assert!(((full - rest) - 2.0 * (half - rest)).abs() < 1e-9);
    }
}
