//! The motion of a bank's feature points over time.

mod bank_face;
mod read;
mod single;

use nalgebra::Vector3;

use super::{FpMotion, Solver};
use crate::{
    fap::{FapNumber, InterpolateError, MAX_FRAMES},
    interpolation::{Curve, Even, FPS, FRAMES_BETWEEN, Moment},
    units::FeaturePoint,
};

pub use bank_face::{fapu_length, head_pivot};
pub use read::read_motion;
pub(crate) use single::{SingleFap, SingleFaps};

/// Kind of source that a motion was read from.
///
/// ```
/// use grimace::synthesis::{MotionKind, candide_bank, read_motion};
///
/// let motion = read_motion("fixtures/golden/fap/happiness.fap".as_ref(), &candide_bank()?, None)?;
/// assert_eq!((motion.kind, motion.fps), (MotionKind::Fap, Some(25.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionKind {
    /// `frame,fp,dx,dy,dz` in the bank's unit.
    FeaturePoints,
    /// `frame,node,x,y`: a representative or a normalized model, face units.
    Model,
    /// `frame,node,x,y,state,residual`: a track, pixels.
    Track,
    /// A FAP file.
    Fap,
}

/// A motion of the bank's feature points over time.
///
/// ```
/// use grimace::{fap::read_fap, pipeline::read_model, synthesis::{Motion, candide_bank, read_motion}};
///
/// let bank = candide_bank()?;
/// // A representative, as `statistics::representative` finds it or from its file: five key frames.
/// let model = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// let motion = Motion::from_model("happiness", &model, &bank, None)?;
/// assert_eq!((motion.frames.len(), motion.is_still()), (5, false));
/// // Two frames between every two of them.
/// assert_eq!(motion.with_frames_between(2)?.frames.len(), 13);
/// // FAPs, as `FapSequence::from_model` makes them or from a file, which `read_motion` reads, too.
/// let path = "fixtures/golden/fap/happiness.fap".as_ref();
/// let motion = Motion::from_fap("happiness", &read_fap(path)?.sequence, &bank, None)?;
/// assert_eq!(motion, read_motion(path, &bank, None)?);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Kind of the source.
    pub kind: MotionKind,
    /// Frames in order, equally spaced in time.
    pub frames: Vec<FpMotion>,
    /// Frames per second; `None` when the source does not give them.
    pub fps: Option<f64>,
    /// Feature points of the motion that the bank does not have.
    pub ignored: Vec<FeaturePoint>,
    /// FAPs of a FAP file that have values but move nothing in the bank: rotations of the eyes, depth, tongue, visemes, expressions,
    /// and FAPs of feature points that the bank does not have.
    pub not_shown: Vec<FapNumber>,
    /// Bank units per face unit along x and y for the five FAPUs in the order of the standard; `None` for motion in the bank's
    /// unit.
    pub scale: Option<[f64; 5]>,
    /// Number of frames of the source if frame numbers are missing or frames have their own times; `frames` are then
    /// interpolated.
    pub uneven: Option<usize>,
}

/// Default noise threshold, as a fraction of the farthest motion: tracking may give this much motion to a point at rest.
pub const NOISE: f64 = 0.05;

impl Motion {
    /// Returns the motion as it is animated.
    ///
    /// By default, 5 frames are inserted between the key frames of a model, none in other kinds. Motion below `NOISE` counts as
    /// rest, except for feature points from a CSV file.
    ///
    /// # Errors
    /// As [`Motion::with_frames_between`].
    pub fn as_animated(&self, between: Option<usize>, noise: Option<f64>) -> Result<Self, InterpolateError> {
        let between = between.unwrap_or(if self.kind == MotionKind::Model { FRAMES_BETWEEN } else { 0 });
        self.without_noise(noise.unwrap_or_else(|| self.default_noise())).with_frames_between(between)
    }

    /// Default noise threshold for this kind of motion, as a fraction of the farthest motion.
    pub fn default_noise(&self) -> f64 {
        if self.kind == MotionKind::FeaturePoints { 0.0 } else { NOISE }
    }

    /// Inserts `between` frames between every two frames.
    ///
    /// Every coordinate follows a monotone cubic, as in the FAP file of the same motion. A feature point is known in an inserted
    /// frame only if both neighbours know it.
    ///
    /// # Errors
    /// [`InterpolateError::TooManyFrames`], as for a FAP file.
    pub fn with_frames_between(&self, between: usize) -> Result<Self, InterpolateError> {
        let steps = self.frames.len().saturating_sub(1);
        let last = steps.saturating_mul(between.saturating_add(1));
        if last == 0 || between == 0 {
            return Ok(self.clone());
        }
        if last >= MAX_FRAMES {
            return Err(InterpolateError::TooManyFrames { frames: last as f64 + 1.0 });
        }
        Ok(Self { frames: self.at((0..=last).map(|k| Moment::of_frame(k, last, steps))), ..self.clone() })
    }

    /// Resamples the motion to equally spaced frames at its own rate, from its first to its last frame, as clones and pages show
    /// it.
    ///
    /// `times` are the times of the present frames in seconds from the first, ascending.
    ///
    /// # Errors
    /// The number of frames if it would exceed [`MOST_EVEN`](crate::interpolation::MOST_EVEN).
    pub(crate) fn evenly(&self, times: &[f64]) -> Result<Self, f64> {
        let (Some(&end), true) = (times.last(), times.len() == self.frames.len()) else { return Ok(self.clone()) };
        let Even { last, fps } = Even::over(end, self.fps.unwrap_or(f64::from(FPS)))?;
        let frames = self.at((0..=last).map(|k| Moment::at_time(times, k as f64 / last as f64 * end)));
        Ok(Self { frames, fps: self.fps.map(|_| fps), uneven: Some(self.frames.len()), ..self.clone() })
    }

    /// Interpolates frames at moments between the frames.
    fn at(&self, moments: impl Iterator<Item = Moment>) -> Vec<FpMotion> {
        let count = self.frames.first().map_or(0, |f| f.offsets.len());
        let curve = |point: usize, axis: usize| {
            Curve::through(self.frames.iter().map(|f| Some(f.offsets.get(point)?.as_ref()?[axis])).collect())
        };
        let curves: Vec<[Curve; 3]> = (0..count).map(|point| [0, 1, 2].map(|axis| curve(point, axis))).collect();
        let turns = [0, 1, 2].map(|axis| Curve::through(self.frames.iter().map(|f| Some(f.turn[axis])).collect()));
        let frame = |moment: Moment| {
            if moment.share == 0.0 {
                return self.frames[moment.key].clone();
            }
            let point = |[x, y, z]: &[Curve; 3]| Some(Vector3::new(x.at(moment)?, y.at(moment)?, z.at(moment)?));
            let planar = self.frames[moment.key].planar || self.frames[moment.key + 1].planar;
            FpMotion {
                offsets: curves.iter().map(point).collect(),
                planar,
                free_axes: self.frames[moment.key].free_axes.clone(),
                turn: Vector3::from(turns.each_ref().map(|turn| turn.at(moment).unwrap_or(0.0))),
            }
        };
        moments.map(frame).collect()
    }

    /// Sets feature points at rest whose motion is smaller than `share` of the farthest motion. A point is judged by its largest
    /// offset in all frames.
    ///
    /// The fitness gives every moving feature point the same weight \[ZL\], and a tracker gives some motion to all of them.
    pub fn without_noise(&self, share: f64) -> Self {
        let count = self.frames.first().map_or(0, |f| f.offsets.len());
        let largest = |point: usize| self.frames.iter().filter_map(|f| f.offsets[point]).map(|v| v.norm()).fold(0.0, f64::max);
        let reach: Vec<f64> = (0..count).map(largest).collect();
        let least = share * reach.iter().copied().fold(0.0, f64::max);
        let still =
            |(offset, reach): (&Option<Vector3<f64>>, &f64)| offset.map(|v| if *reach < least { Vector3::zeros() } else { v });
        let frame = |f: &FpMotion| FpMotion { offsets: f.offsets.iter().zip(&reach).map(still).collect(), ..f.clone() };
        Self { frames: self.frames.iter().map(frame).collect(), ..self.clone() }
    }

    /// Returns the motion as a solver needs it: for radial basis functions, feature points that a FAP file leaves free rest, because
    /// nothing else holds the rest of the surface.
    pub fn for_solver(mut self, solver: Solver) -> Self {
        if self.kind == MotionKind::Fap && solver == Solver::Rbf {
            let offsets = self.frames.iter_mut().flat_map(|frame| &mut frame.offsets);
            offsets.for_each(|offset| *offset = Some(offset.unwrap_or_else(Vector3::zeros)));
        }
        self
    }

    /// Holds the last frame for `hold` more frames, then plays the motion backwards to its first frame.
    pub fn there_and_back(&self, hold: usize) -> Self {
        let mut frames = self.frames.clone();
        if let Some(apex) = self.frames.last() {
            frames.extend(std::iter::repeat_n(apex.clone(), hold));
            frames.extend(self.frames.iter().rev().skip(1).cloned());
        }
        Self { frames, ..self.clone() }
    }

    /// Whether the head turns in any frame.
    pub fn turns(&self) -> bool {
        self.frames.iter().any(|f| f.turn != Vector3::zeros())
    }

    /// Whether nothing moves in any frame.
    pub fn is_still(&self) -> bool {
        !self.turns() && self.frames.iter().all(|f| f.total_length() == 0.0)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use approx::assert_relative_eq;
    use nalgebra::Vector2;

    use super::{bank_face::BankFace, *};
    use crate::{
        synthesis::{SynthesisError, candide_bank, testing},
        units::NodeId,
    };

    fn read(text: &str) -> Result<Motion, SynthesisError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.csv");
        fs::write(&path, text).unwrap();
        read_motion(&path, &testing::bank(), None)
    }

    /// Reads a FAP file that sets the same FAPs in all frames, to these values.
    fn read_faps(bank: &super::super::Bank, faps: &[usize], frames: &[&str]) -> Motion {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.fap");
        let mask = (1..=68).map(|k| if faps.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
        let frames: String = frames.iter().enumerate().map(|(k, values)| format!("{mask}\n{k} {values}\n")).collect();
        let count = frames.lines().count() / 2;
        fs::write(&path, format!("2.1 m 25 {count}\n{frames}")).unwrap();
        read_motion(&path, bank, None).unwrap()
    }

    #[test]
    fn feature_points_are_read_in_space_and_in_the_plane() {
        let motion = read("frame,fp,dx,dy,dz\n3,8.4,1,2,3\n7,8.3,0,0,0\n7,2.1,1,1,1\n").unwrap();
        // Frames 4 to 6 are interpolated.
        assert_eq!((motion.frames.len(), motion.uneven), (5, Some(2)));
        assert_eq!(motion.frames[0].offsets, [Some(Vector3::new(1.0, 2.0, 3.0)), None, None]);
        assert!(!motion.frames[0].planar);
        assert_eq!(motion.ignored, ["2.1".parse().unwrap()]);
        let uneven = read("frame,fp,dx,dy\n0,8.4,0,0\n2,8.4,2,0\n3,8.4,6,0\n").unwrap();
        let x: Vec<f64> = uneven.frames.iter().map(|f| f.offsets[0].unwrap().x).collect();
        assert_eq!(x, [0.0, 1.0, 2.0, 6.0]);
        // The limit on interpolated frames is the same as for tracks and clones.
        let frames = |last: u32| read(&format!("frame,fp,dx,dy\n1,8.4,0,0\n{last},8.4,2,0\n")).map(|motion| motion.frames.len());
        assert_eq!(frames(100_000).unwrap(), 100_000);
        assert!(frames(100_001).is_err() && frames(4_000_000_000).is_err());
        assert!(read("frame,fp,dx,dy,dz\n3,8.4,1,2,\n").unwrap().frames[0].planar);
        assert!(read("frame,fp,dx,dy\n3,8.4,1,2\n").unwrap().frames[0].planar);
    }

    #[test]
    fn a_motion_in_memory_is_that_of_its_file() {
        let bank = candide_bank().unwrap();
        let path = std::path::Path::new("fixtures/golden/representatives/happiness.csv");
        let model = crate::positions::PositionTable::open(path).unwrap().model().unwrap();
        assert_eq!(Motion::from_model("happiness", &model, &bank, None).unwrap(), read_motion(path, &bank, None).unwrap());
        let path = std::path::Path::new("fixtures/golden/fap/happiness.fap");
        let mut faps = crate::fap::read_fap(path).unwrap().sequence;
        assert_eq!(Motion::from_fap("happiness", &faps, &bank, None).unwrap(), read_motion(path, &bank, None).unwrap());
        faps.frames.clear();
        let error = Motion::from_fap("happiness", &faps, &bank, None).unwrap_err().to_string();
        assert_eq!(error, "happiness: the FAP sequence has no frames");
        assert!(matches!(Motion::from_fap("x", &faps, &testing::bank(), None), Err(SynthesisError::Motion { .. })));
    }

    #[test]
    fn missing_frames_of_a_track_take_their_time() {
        let bank = candide_bank().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let whole = fs::read_to_string("fixtures/simulated/truth/S001_005.csv").unwrap();
        let number = |row: &str| row.split(',').next().and_then(|frame| frame.parse::<u32>().ok());
        let track = |name: &str, missing: std::ops::Range<u32>| {
            let path = folder.path().join(name);
            let rows = whole.lines().filter(|row| number(row).is_none_or(|frame| !missing.contains(&frame)));
            let states = rows.map(|row| row.to_owned() + if number(row).is_some() { ",tracked,\n" } else { ",state,residual\n" });
            fs::write(&path, states.collect::<String>()).unwrap();
            read_motion(&path, &bank, None).unwrap()
        };
        let (whole, gap) = (track("whole.csv", 0..0), track("gap.csv", 4..8));
        assert_eq!((whole.frames.len(), whole.uneven, gap.frames.len(), gap.uneven), (10, None, 10, Some(6)));
        // Given frames keep their values; in the gap a corner of the mouth moves from the value at one end to the other.
        for (frame, is_there) in [(2, true), (3, false), (6, false), (7, true)] {
            assert_eq!(gap.frames[frame] == whole.frames[frame], is_there, "{frame}");
        }
        let corner = bank.feature_point_index("8.3".parse().unwrap()).unwrap();
        let x: Vec<f64> = gap.frames[2..8].iter().map(|frame| frame.offsets[corner].unwrap().x).collect();
        assert!(x.is_sorted_by(|a, b| a < b), "{x:?}");
    }

    #[test]
    fn bad_motions_say_where() {
        let says = |text: &str, part: &str| {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        says("a,b\n1,2\n", "the header is `a,b`; expected frame,fp,dx,dy,dz");
        says("frame,fp,dx,dy\n0,8.4,1,x\n", "line 2: dy is `x`");
        says("frame,fp,dx,dy\n0,8.4,1,1\n0,8.4,1,1\n", "line 3: fp is `8.4`; one row for every feature point");
        says("frame,fp,dx,dy\n0,2.1,1,1\n", "no feature points in common with the bank, which has 8.4, 8.3, 3.11");
        // The tiny bank has no eyes from which its size can be measured.
        says("frame,node,x,y\n0,0,1,1\n", "3.7, 3.8, 3.11 and 3.12");
    }

    #[test]
    fn candide_measures_itself_at_its_own_size() {
        // The bank's neutral is Candide-3 in model units, rounded by the subdivision; ES0 is 0.613 model units and 1024 face
        // units.
        let bank = candide_bank().unwrap();
        let face = BankFace::new(&bank, None).unwrap();
        let expected = 0.613 / 1024.0;
        for scale in face.scale {
            assert!((scale / expected - 1.0).abs() < 0.25, "{scale}");
        }
        let motion = face.frame(|node| (node == NodeId(31)).then(|| Vector2::new(10.0, 0.0)));
        let corner = bank.feature_point_index("8.3".parse().unwrap()).unwrap();
        assert_relative_eq!(motion.offsets[corner].unwrap().x, 10.0 * face.scale[4], epsilon = 1e-12);
        assert_eq!(motion.offsets.iter().flatten().count(), 1);
    }

    #[test]
    fn feature_points_of_faps_that_a_file_never_sets_are_unknown() {
        let bank = candide_bank().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("brow.fap");
        // Inner brows in both frames, the left middle brow only in the first frame; the left inner corner of the lips.
        let mask = |set: &[u8]| (1..=68).map(|k| if set.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
        let [first, second] = [mask(&[12, 31, 32, 33]), mask(&[12, 31, 32])];
        fs::write(&path, format!("2.1 brow 25 2\n{first}\n0 0 0 0 80\n{second}\n1 50 100 100\n")).unwrap();
        let motion = read_motion(&path, &bank, None).unwrap();
        let offset =
            |frame: usize, fp: &str| motion.frames[frame].offsets[bank.feature_point_index(fp.parse().unwrap()).unwrap()];
        assert!(offset(1, "4.1").is_some_and(|v| v.y > 0.0) && offset(0, "4.1") == Some(Vector3::zeros()));
        // Lids, chin and the other corner of the mouth are free; the middle brow is held in the frame that leaves it out.
        assert!(["3.1", "8.4", "2.1", "4.4"].iter().all(|fp| offset(1, fp).is_none()));
        assert!(offset(1, "4.3").is_some_and(|v| v.y > 0.0) && offset(1, "4.3") == offset(0, "4.3"));
        // The outer contour of the lips follows the inner one.
        assert!(offset(1, "8.3").is_some_and(|v| v.y > 0.0) && offset(1, "8.3") == offset(1, "2.4"));
        let known = |motion: &Motion| motion.frames[1].offsets.iter().flatten().count();
        assert_eq!((known(&motion), known(&motion.clone().for_solver(Solver::Refined))), (5, 5));
        assert_eq!(known(&motion.for_solver(Solver::Rbf)), bank.feature_points().len());
    }

    #[test]
    fn a_file_that_sets_nothing_that_the_bank_has_rests() {
        let bank = candide_bank().unwrap();
        let motion = read_faps(&bank, &[16], &["0", "90"]);
        assert!(motion.is_still() && motion.not_shown == ["16".parse().unwrap()]);
    }

    #[test]
    fn head_turns_of_a_file_are_read_and_interpolated() {
        let bank = candide_bank().unwrap();
        let motion = read_faps(&bank, &[48, 49, 50], &["0 0 0", "20000 -10000 4000"]);
        assert!(motion.turns() && !motion.is_still() && motion.not_shown.is_empty());
        let between = motion.with_frames_between(1).unwrap();
        assert_eq!(between.frames.len(), 3);
        assert_relative_eq!(between.frames[1].turn, Vector3::new(0.1, -0.05, 0.02), epsilon = 1e-12);
        assert_relative_eq!(between.frames[2].turn, Vector3::new(0.2, -0.1, 0.04), epsilon = 1e-12);
        // What holds the apex and plays backwards takes the head along.
        let back = between.there_and_back(1);
        assert_eq!((back.frames.len(), back.frames[3].turn, back.frames[5].turn), (6, between.frames[2].turn, Vector3::zeros()));
    }

    #[test]
    fn a_single_pose_is_reached_from_the_neutral_face() {
        let bank = candide_bank().unwrap();
        let motion = read_faps(&bank, &[3], &["400"]);
        let chin = bank.feature_point_index("2.1".parse().unwrap()).unwrap();
        let y: Vec<f64> = motion.frames.iter().map(|frame| frame.offsets[chin].unwrap().y).collect();
        assert!(y.len() == 2 && y[0] == 0.0 && y[1] < 0.0, "{y:?}");
    }

    #[test]
    fn more_frames_in_between_than_a_fap_file_may_have_are_refused() {
        let motion = read("frame,fp,dx,dy\n0,8.4,0,0\n1,8.4,3,6\n").unwrap();
        for (between, frames) in [(50_000_000, 50_000_002.0), (MAX_FRAMES - 1, 360_001.0)] {
            assert_eq!(motion.with_frames_between(between), Err(InterpolateError::TooManyFrames { frames }));
        }
        assert!(motion.as_animated(Some(usize::MAX), None).is_err());
        assert!(motion.as_animated(Some(0), None).is_ok());
    }

    #[test]
    fn frames_in_between_lie_on_the_curve_of_fap_files() {
        let motion = read("frame,fp,dx,dy\n0,8.4,0,0\n1,8.4,3,6\n").unwrap().with_frames_between(2).unwrap();
        let x: Vec<f64> = motion.frames.iter().map(|f| f.offsets[0].unwrap().x).collect();
        assert_eq!(motion.frames.len(), 4);
        (0..4).for_each(|k| assert_relative_eq!(x[k], k as f64, epsilon = 1e-12));
        // Keys 0, 8, 8: 5 halfway through the first step, as for a FAP with the same keys; the second step is flat.
        let keys = read("frame,fp,dx,dy\n0,8.4,0,0\n1,8.4,8,-8\n2,8.4,8,-8\n").unwrap().with_frames_between(1).unwrap();
        let offsets: Vec<_> = keys.frames.iter().map(|f| f.offsets[0].unwrap()).map(|o| (o.x, o.y)).collect();
        assert_eq!(offsets, [(0.0, 0.0), (5.0, -5.0), (8.0, -8.0), (8.0, -8.0), (8.0, -8.0)]);
        // 8.3 moves at most 0.1 while 8.4 moves 6.7: less than 5 %.
        let noisy = read("frame,fp,dx,dy\n0,8.4,0,0\n0,8.3,0.1,0\n1,8.4,3,6\n1,8.3,0,0.1\n").unwrap();
        let quiet = noisy.without_noise(0.05);
        assert!(quiet.frames.iter().all(|f| f.offsets[1] == Some(Vector3::zeros())));
        assert_eq!(quiet.frames[1].offsets[0], noisy.frames[1].offsets[0]);
        assert_eq!(noisy.without_noise(0.0), noisy);
        assert!(!motion.is_still() && read("frame,fp,dx,dy\n0,8.4,0,0\n").unwrap().is_still());
    }
}
