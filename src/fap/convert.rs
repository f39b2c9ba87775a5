//! Converts face units to FAP values and back; no other module does this.
//!
//! A shift has the value `sign * o * 1024 / FAPU0`. Here o is the mean offset of the driving nodes from neutral along the FAP's
//! axis, and FAPU0 is the length of the FAP's unit in the canonical neutral [MPEG-4].
//!
//! The gaze (FAPs 23 to 26) is an angle, but Candide-3 only shifts its irises: `value = sign * asin(s / r) / 1e-5 rad`, with s
//! the shift of the iris centroid and r the radius of the eyeball. The mean offset of the two corners of that eye is subtracted
//! from s, because head motion left by the normalization moves corners and iris alike and is not gaze. (At r = 195 face units, 10
//! units of residual motion would appear as three degrees.) For the other FAPs there are no such fixed points, and nothing is
//! subtracted.
//!
//! Face units are normalized by one IRISD0 for both eyes. If the face on which a motion was measured is known, FAPs of the lids
//! are in openings of each eye ([`LidUnits`]).

use std::{collections::BTreeMap, f64::consts::FRAC_PI_2};

use nalgebra::Vector2;

use super::{
    catalog::{FapCatalog, FapMotion, FapNumber, FapRow},
    interpolate::InterpolateError,
    sequence::{FapFrame, FapSequence, VERSION, name_token},
};
use crate::{
    model::DynamicExpressionModel,
    units::{FaceUnit, NodeId},
    wireframe::{Axis, Fapu, Fapus, LidUnits},
};

/// Number of FAP units in one FAPU length [MPEG-4].
pub(crate) const FAP_UNITS_PER_FAPU: f64 = 1024.0;
/// One unit of an angular FAP, rad [MPEG-4].
pub(crate) const ANGLE_UNIT_RAD: f64 = 1e-5;
/// Mean radius of the adult eyeball, mm: half of 24 mm (Bekerman, Gottlieb, Vaiman: *Variations in eyeball diameters of the
/// healthy adults*, J. Ophthalmology 2014).
const EYEBALL_RADIUS_MM: f64 = 12.0;
/// Mean adult interpupillary distance, mm (Dodgson: *Variation and extrema of human interpupillary distance*, SPIE 2004).
const INTERPUPILLARY_DISTANCE_MM: f64 = 63.0;

/// A measured value outside the range of the standard that was set to the limit.
///
/// ```
/// use grimace::{fap::{Clamped, FapCatalog, FapSequence}, model::DynamicExpressionModel, normalize::Canonical};
///
/// let face = grimace::wireframe::Face::candide3();
/// let Canonical { neutral, fapus } = Canonical::new(&face.wireframe, &face.tables)?;
/// // The chin goes down by five times the distance of mouth and nose: more than FAP 3 allows.
/// # let mut open = neutral.nodes().to_vec();
/// # open[10].y -= 5.0 * fapus.mns;
/// # let open = grimace::model::FrameExpressionModel::new(open);
/// let model = DynamicExpressionModel::new(vec![neutral, open])?;
/// let (_, clamped) = FapSequence::from_model(&model, &fapus, FapCatalog::mpeg4(), "jaw", 25, 0)?;
/// let Clamped { fap, frame, limit, .. } = clamped[0];
/// assert_eq!((fap.get(), frame, limit), (3, 1, 4320));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clamped {
    /// The FAP.
    pub fap: FapNumber,
    /// Frame index in the model, from 0.
    pub frame: usize,
    /// Measured value, FAP units.
    pub value: f64,
    /// Value written instead.
    pub limit: i32,
}

/// Error for a model from which FAP values cannot be computed.
///
/// ```
/// use grimace::{fap::{ConvertError, FapCatalog, measure_faps}, normalize::Canonical, pipeline::read_model, wireframe::Fapus};
///
/// let face = grimace::wireframe::Face::candide3();
/// let model = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// let fapus = Fapus { mw: 0.0, ..Canonical::new(&face.wireframe, &face.tables)?.fapus };
/// let error = measure_faps(&model, &fapus, FapCatalog::mpeg4()).unwrap_err();
/// assert_eq!(error.to_string(), "MW0 is 0; it must be positive, because it is the unit of measurement");
/// assert!(matches!(error, ConvertError::Fapu { .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConvertError {
    /// The model lacks a node that a FAP is measured on.
    #[error("FAP {fap} is measured at node {node}, but the model has {count} nodes; FAPs need Candide-3's node numbers")]
    NoSuchNode {
        /// The FAP.
        fap: FapNumber,
        /// The node.
        node: NodeId,
        /// Number of nodes.
        count: usize,
    },
    /// A FAPU that is not a positive length.
    #[error("{fapu}0 is {value}; it must be positive, because it is the unit of measurement")]
    Fapu {
        /// The unit.
        fapu: Fapu,
        /// Its length.
        value: f64,
    },
    /// Too many frames between key frames.
    #[error(transparent)]
    Interpolate(#[from] InterpolateError),
}

impl FapSequence {
    /// Converts a normalized model to integer values of every FAP that a frontal view measures.
    ///
    /// The frames of the model are key frames; `between` frames are inserted between consecutive ones. With 25 frames per second
    /// and 5 between, the defaults of the command line, the five frames of a model last a second. `fapus` are those of the
    /// canonical neutral, in face units. Values are limited to the range of the standard (the minimum of unidirectional FAPs is
    /// 0); the second result lists the values that were limited. In `name`, all characters except ASCII letters, digits and
    /// punctuation become `_`, because readers of FAP files expect one word. [`measure_faps`] returns the key frames only,
    /// without rounding.
    ///
    /// # Errors
    /// [`ConvertError`] for a model without Candide-3's nodes, FAPUs that are not positive, or too many frames.
    pub fn from_model(
        model: &DynamicExpressionModel<FaceUnit>,
        fapus: &Fapus,
        catalog: &FapCatalog,
        name: &str,
        fps: u32,
        between: usize,
    ) -> Result<(Self, Vec<Clamped>), ConvertError> {
        Self::from_measured(model, (fapus, LidUnits::CANONICAL), catalog, name, fps, between)
    }

    /// Same as [`FapSequence::from_model`], for a model measured on one face: FAPs of the lids are in openings of that face's
    /// lids.
    ///
    /// # Errors
    /// Same as [`FapSequence::from_model`].
    pub(crate) fn from_measured(
        model: &DynamicExpressionModel<FaceUnit>,
        units: (&Fapus, LidUnits),
        catalog: &FapCatalog,
        name: &str,
        fps: u32,
        between: usize,
    ) -> Result<(Self, Vec<Clamped>), ConvertError> {
        let (frames, clamped) = key_frames(model, units, catalog)?;
        let keys = Self { version: VERSION.to_owned(), name: name_token(name), fps: f64::from(fps), frames };
        let mut sequence = keys.with_frames_between(between)?;
        sequence.round();
        Ok((sequence, clamped))
    }
}

/// Measures the FAP values of every frame of a normalized model, neither limited to the standard's ranges nor rounded.
///
/// This is for calculations; for a file, whose values have ranges, use [`FapSequence::from_model`]. `fapus` are as in that
/// function.
///
/// ```
/// use grimace::{fap::{FapCatalog, measure_faps}, normalize::Canonical, pipeline::read_model, wireframe::Face};
///
/// let face = Face::candide3();
/// let fapus = Canonical::new(&face.wireframe, &face.tables)?.fapus;
/// let model = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// let frames = measure_faps(&model, &fapus, FapCatalog::mpeg4())?;
/// // FAP 6 stretches the left corner of the lips: it rests in the first frame, and is pulled out in the last.
/// let stretch = "6".parse()?;
/// assert_eq!((frames.len(), frames[0].value(stretch)), (5, Some(0.0)));
/// assert!(frames[4].value(stretch) > Some(50.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`ConvertError`] for a model without Candide-3's nodes, or FAPUs that are not positive.
pub fn measure_faps(
    model: &DynamicExpressionModel<FaceUnit>,
    fapus: &Fapus,
    catalog: &FapCatalog,
) -> Result<Vec<FapFrame>, ConvertError> {
    let frame = |index: usize| {
        let mut frame = FapFrame::default();
        for (row, value) in values(&model.neutral_offsets(index), (fapus, LidUnits::CANONICAL), catalog)? {
            frame.set_value(row.number, Some(value));
        }
        Ok(frame)
    };
    (0..model.frame_count()).map(frame).collect()
}

/// Computes FAP values from the offsets of one frame from neutral, neither limited to the standard's ranges nor rounded. `units`
/// are as in [`FapSequence::from_measured`].
///
/// # Errors
/// Same as [`measure_faps`].
pub fn unlimited_faps(
    offsets: &[Vector2<f64>],
    units: (&Fapus, LidUnits),
    catalog: &FapCatalog,
) -> Result<Vec<(FapNumber, f64)>, ConvertError> {
    Ok(values(offsets, units, catalog)?.into_iter().map(|(row, value)| (row.number, value)).collect())
}

/// Values of all FAPs that a frontal view measures and that have a range in the standard.
fn values<'a>(
    offsets: &[Vector2<f64>],
    (fapus, lids): (&Fapus, LidUnits),
    catalog: &'a FapCatalog,
) -> Result<Vec<(&'a FapRow, f64)>, ConvertError> {
    let mut found = Vec::new();
    for row in catalog.rows().iter().filter(|row| row.frontal.is_measured() && row.range.is_some()) {
        let Some(scale) = Scale::of(row, fapus)? else { continue };
        let shift = mean_offset(row, &row.nodes, offsets)? - mean_offset(row, &row.relative_to, offsets)?;
        let gaze = if scale.is_angle && scale.axis == Axis::Y { lids.gaze() } else { 1.0 };
        found.push((row, scale.value(along(scale.axis, shift) * gaze) * lids.of_fap(row.number.get())));
    }
    Ok(found)
}

/// FAP values of every frame of a model, limited to their ranges but not rounded, and the values that were limited.
fn key_frames(
    model: &DynamicExpressionModel<FaceUnit>,
    units: (&Fapus, LidUnits),
    catalog: &FapCatalog,
) -> Result<(Vec<FapFrame>, Vec<Clamped>), ConvertError> {
    let (mut frames, mut clamped) = (Vec::with_capacity(model.frame_count()), Vec::new());
    for index in 0..model.frame_count() {
        let mut frame = FapFrame::default();
        for (row, value) in values(&model.neutral_offsets(index), units, catalog)? {
            let limited = row.limited(value);
            if value.round() != limited.round() {
                clamped.push(Clamped { fap: row.number, frame: index, value, limit: limited as i32 });
            }
            frame.set_value(row.number, Some(limited));
        }
        frames.push(frame);
    }
    Ok((frames, clamped))
}

/// Offset of one node from neutral as far as FAPs determine it, face units; `None` along an axis that no FAP of the frame drives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartialOffset {
    /// Along x.
    pub x: Option<f64>,
    /// Along y.
    pub y: Option<f64>,
}

/// Converts a frame of FAP values to the offsets of the driving nodes from neutral, in the unit of `fapus` (face units for those
/// of the canonical neutral).
///
/// This is the inverse of [`FapSequence::from_model`], up to rounding. FAPs that are masked out, that move in depth or that have
/// no node drive nothing. All driving nodes of a FAP shift alike. The shift of an iris is relative to its eye.
///
/// # Errors
/// [`ConvertError::Fapu`] when a unit is not a positive length.
pub fn offsets_from_frame(
    frame: &FapFrame,
    fapus: &Fapus,
    catalog: &FapCatalog,
) -> Result<BTreeMap<NodeId, PartialOffset>, ConvertError> {
    let mut offsets: BTreeMap<NodeId, PartialOffset> = BTreeMap::new();
    for row in catalog.rows() {
        let Some(value) = frame.value(row.number) else { continue };
        let Some(scale) = Scale::of(row, fapus)? else { continue };
        for &node in &row.nodes {
            let offset = offsets.entry(node).or_default();
            let shift = Some(scale.shift(value));
            if scale.axis == Axis::X { offset.x = shift } else { offset.y = shift }
        }
    }
    Ok(offsets)
}

/// Conversion between a shift along an axis of the frontal view and a FAP value.
#[derive(Clone, Copy, Debug)]
struct Scale {
    /// x or y.
    axis: Axis,
    sign: f64,
    /// FAPU0 of a shift, or the radius of the eyeball, in the unit of the shift.
    length: f64,
    is_angle: bool,
}

impl Scale {
    /// Returns the scale of a FAP; `None` when it is not visible in a frontal view.
    fn of(row: &FapRow, fapus: &Fapus) -> Result<Option<Self>, ConvertError> {
        let (Some(axis), Some(fapu)) = (row.motion.and_then(FapMotion::frontal_axis), row.fapu) else { return Ok(None) };
        let (fapu, length) = match fapus.length(fapu) {
            Some(length) => (fapu, length),
            None => (Fapu::Es, fapus.es * (EYEBALL_RADIUS_MM / INTERPUPILLARY_DISTANCE_MM)),
        };
        if !(length > 0.0 && length.is_finite()) {
            return Err(ConvertError::Fapu { fapu, value: length });
        }
        Ok(Some(Self { axis, sign: row.sign, length, is_angle: row.motion.is_some_and(FapMotion::is_angle) }))
    }

    /// Returns the FAP value of a shift.
    fn value(self, shift: f64) -> f64 {
        let Self { sign, length, is_angle, .. } = self;
        if is_angle {
            sign * (shift / length).clamp(-1.0, 1.0).asin() / ANGLE_UNIT_RAD
        } else {
            sign * shift * FAP_UNITS_PER_FAPU / length
        }
    }

    /// Returns the shift of a FAP value. An angle beyond 90 degrees, which no valid file has, counts as 90 degrees.
    fn shift(self, value: f64) -> f64 {
        let Self { sign, length, is_angle, .. } = self;
        if is_angle {
            sign * length * (value * ANGLE_UNIT_RAD).clamp(-FRAC_PI_2, FRAC_PI_2).sin()
        } else {
            sign * value * length / FAP_UNITS_PER_FAPU
        }
    }
}

fn along(axis: Axis, vector: Vector2<f64>) -> f64 {
    if axis == Axis::X { vector.x } else { vector.y }
}

/// Mean offset of some nodes from neutral; zero for none.
fn mean_offset(row: &FapRow, nodes: &[NodeId], offsets: &[Vector2<f64>]) -> Result<Vector2<f64>, ConvertError> {
    let mut sum = Vector2::zeros();
    for &node in nodes {
        let count = offsets.len();
        sum += offsets.get(node.index()).ok_or(ConvertError::NoSuchNode { fap: row.number, node, count })?;
    }
    Ok(sum / nodes.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Point2;
    use proptest::prelude::*;

    use super::*;
    use crate::{
        model::FrameExpressionModel,
        wireframe::{Tables, UnitKind, Wireframe},
    };

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    /// Canonical neutral (ES0 = 1024 face units) and its FAPUs. The neutral's lengths in model units are 0.613 ES, 0.4225 ENS,
    /// 0.196 MNS, 0.492 MW, 0.085 IRISD.
    fn canonical() -> (Vec<Point2<f64>>, Fapus) {
        let (tables, frontal) = (Tables::candide3(), Wireframe::candide3().frontal());
        let scale = 1024.0 / Fapus::measure(&tables.fapus, &frontal).unwrap().es;
        let neutral: Vec<_> = frontal.iter().map(|p| p * scale).collect();
        let fapus = Fapus::measure(&tables.fapus, &neutral).unwrap();
        (neutral, fapus)
    }

    /// A model of two frames: neutral, and neutral with some nodes shifted.
    fn model(shifts: &[(u16, f64, f64)]) -> DynamicExpressionModel<FaceUnit> {
        let (neutral, _) = canonical();
        let mut apex = neutral.clone();
        for &(node, x, y) in shifts {
            apex[usize::from(node)] += Vector2::new(x, y);
        }
        DynamicExpressionModel::new(vec![FrameExpressionModel::new(neutral), FrameExpressionModel::new(apex)]).unwrap()
    }

    fn convert(shifts: &[(u16, f64, f64)]) -> (FapSequence, Vec<Clamped>) {
        FapSequence::from_model(&model(shifts), &canonical().1, FapCatalog::mpeg4(), "a b", 25, 0).unwrap()
    }

    fn apex(sequence: &FapSequence, number: u8) -> f64 {
        sequence.frames.last().unwrap().value(fap(number)).unwrap()
    }

    #[test]
    fn a_still_face_has_zero_faps_and_only_those_a_frontal_view_measures() {
        let (sequence, clamped) = convert(&[]);
        assert!(clamped.is_empty());
        assert_eq!(sequence.name, "a_b");
        let measured: Vec<u8> = sequence.set_faps().iter().map(|f| f.get()).collect();
        let expected = (3..=13).chain([15]).chain(18..=26).chain(31..=42).chain(51..=64).collect::<Vec<_>>();
        assert_eq!(measured, expected);
        for frame in &sequence.frames {
            assert!(sequence.set_faps().iter().all(|&f| frame.value(f) == Some(0.0)));
        }
    }

    #[test]
    fn shifts_are_measured_in_the_unit_of_the_fap_with_the_sign_of_the_standard() {
        // One face unit is 1/1024 ES. In other units it is this times ES/FAPU0: MW 613/492 = 1.245935, MNS 613/196 = 3.127551,
        // ENS 6130/4225 = 1.450888.
        let (sequence, clamped) = convert(&[
            (31, 100.0, 50.0),  // left mouth corner outwards and up: 53 +124.59, 59 +156.38
            (64, -100.0, 50.0), // right one mirrored: 54 and 60 the same
            (8, 0.0, -200.0),   // lower lip down: 52 -625.51
            (17, -30.0, 80.0),  // left inner brow inwards and up: 37 +30, 31 +116.07
            (50, 30.0, 80.0),   // right one mirrored: 38 and 32 the same
            (7, 0.0, -10.0),    // upper lip down: 51 +31.28
            (10, 0.0, -150.0),  // chin down: 3 +469.13
        ]);
        assert!(clamped.is_empty());
        let values = [(53, 125.0), (54, 125.0), (59, 156.0), (60, 156.0), (52, -626.0), (37, 30.0), (38, 30.0)];
        let more = [(31, 116.0), (32, 116.0), (51, 31.0), (3, 469.0), (4, 0.0), (15, 0.0)];
        for (number, value) in values.into_iter().chain(more) {
            assert_eq!(apex(&sequence, number), value, "FAP {number}");
        }
    }

    #[test]
    fn candides_own_fap_vectors_measure_one_unit_of_their_fap() {
        // The FAP vectors of the wireframe file move the driving node by one FAPU, 1024 FAP units; here by half of one. Their
        // author made them without this table. They differ from the standard in FAP 15 (MNS instead of MW) and FAP 18
        // (downwards). The gaze is no shift.
        let ((_, fapus), catalog) = (canonical(), FapCatalog::mpeg4());
        let mut checked = 0;
        for unit in Wireframe::candide3().action_units() {
            let UnitKind::Fap { number, .. } = unit.kind else { continue };
            let row = catalog.row(fap(number as u8));
            let Some(length) = row.fapu.and_then(|u| fapus.length(u)).filter(|_| row.frontal.is_measured()) else { continue };
            let shifts: Vec<_> = unit.offsets.iter().map(|(n, o)| (n.0, o.x * length / 2.0, o.y * length / 2.0)).collect();
            let expected = if number == 18 { -420.0 } else { 512.0 }; // -512 is below the range of FAP 18
            assert_eq!(apex(&convert(&shifts).0, number as u8), expected, "FAP {number}");
            checked += 1;
        }
        assert_eq!(checked, 43); // the 47 measured without the four of the gaze
    }

    #[test]
    fn the_gaze_is_an_angle_relative_to_the_eye() {
        // r = 1024 * 12/63 = 195.0476 face units. Left iris by 97.5238 = r/2 to the left: asin(1/2) = pi/6 = 52360e-5 rad. Of the
        // right eye only one of the four iris nodes moves, by r: centroid r/4, asin(1/4) = 25268e-5 rad, downwards, which is
        // positive.
        let r = 1024.0 * 12.0 / 63.0;
        let left = [67, 68, 71, 72].map(|n| (n, r / 2.0, 0.0));
        let shifts: Vec<_> = left.into_iter().chain([(69, 0.0, -r)]).collect();
        let (sequence, _) = convert(&shifts);
        let gaze = [23, 24, 25, 26].map(|n| apex(&sequence, n));
        assert_eq!(gaze, [52360.0, 0.0, 0.0, 25268.0]);
        // A shift of the whole face by (20, -30) does not change the gaze, only the FAPs that are not relative.
        let all: Vec<_> = (0..113).map(|n| (n, 20.0, -30.0)).collect();
        let (moved, _) = convert(&all);
        assert_eq!([23, 24, 25, 26].map(|n| apex(&moved, n)), [0.0; 4]);
        assert_eq!(apex(&moved, 37), -20.0);
    }

    #[test]
    fn values_out_of_range_are_limited_and_reported() {
        // Chin up by 10 is -31.28 for the unidirectional open_jaw; iris r + 1 to the left is pi/2 rad, over the limit of 1.536.
        let shift = 1024.0 * 12.0 / 63.0 + 1.0;
        let (sequence, clamped) =
            convert(&[(10, 0.0, 10.0), (67, shift, 0.0), (68, shift, 0.0), (71, shift, 0.0), (72, shift, 0.0)]);
        assert_eq!((apex(&sequence, 3), apex(&sequence, 23)), (0.0, 153_600.0));
        let reported: Vec<_> = clamped.iter().map(|c| (c.fap.get(), c.frame, c.limit)).collect();
        assert_eq!(reported, [(3, 1, 0), (23, 1, 153_600)]);
        assert_relative_eq!(clamped[0].value, -10.0 * 613.0 / 196.0, epsilon = 1e-9);
        // A tenth of a unit below zero rounds to zero and is not reported.
        assert!(convert(&[(10, 0.0, 0.1)]).1.is_empty());
    }

    #[test]
    fn a_wireframe_without_the_nodes_and_folded_units_are_refused() {
        let small = || FrameExpressionModel::new(vec![Point2::origin(); 9]);
        let model = DynamicExpressionModel::new(vec![small(), small()]).unwrap();
        let (_, fapus) = canonical();
        let error = FapSequence::from_model(&model, &fapus, FapCatalog::mpeg4(), "x", 25, 0).unwrap_err();
        assert_eq!(error, ConvertError::NoSuchNode { fap: fap(3), node: NodeId(10), count: 9 });
        let flat = Fapus { mns: 0.0, ..fapus };
        let nothing = offsets_from_frame(&FapFrame::default(), &flat, FapCatalog::mpeg4()).unwrap();
        assert!(nothing.is_empty());
        let mut frame = FapFrame::default();
        frame.set_value(fap(3), Some(1.0));
        let error = offsets_from_frame(&frame, &flat, FapCatalog::mpeg4()).unwrap_err();
        assert_eq!(error, ConvertError::Fapu { fapu: Fapu::Mns, value: 0.0 });
    }

    #[test]
    fn offsets_of_a_frame_are_known_only_where_a_fap_is_set() {
        let mut frame = FapFrame::default();
        frame.set_value(fap(53), Some(1024.0)); // left corner outwards by MW0 = 1024 * 492/613 face units
        frame.set_value(fap(14), Some(100.0)); // depth: nothing in a frontal view
        frame.set_value(fap(48), Some(100.0)); // head: no node
        let offsets = offsets_from_frame(&frame, &canonical().1, FapCatalog::mpeg4()).unwrap();
        assert_eq!(offsets.keys().copied().collect::<Vec<_>>(), [NodeId(31)]);
        assert_relative_eq!(offsets[&NodeId(31)].x.unwrap(), 1024.0 * 492.0 / 613.0, epsilon = 1e-9);
        assert_eq!(offsets[&NodeId(31)].y, None);
    }

    #[test]
    fn five_key_frames_give_twenty_five() {
        let (neutral, fapus) = canonical();
        let frame = |k: f64| {
            let mut nodes = neutral.clone();
            nodes[31].x += 10.0 * k * k;
            FrameExpressionModel::new(nodes)
        };
        let model = DynamicExpressionModel::new((0..5).map(|k| frame(f64::from(k))).collect()).unwrap();
        let convert = |between| FapSequence::from_model(&model, &fapus, FapCatalog::mpeg4(), "x", 25, between).unwrap().0;
        let (keys, all) = (convert(0), convert(5));
        assert_eq!((keys.frames.len(), all.frames.len()), (5, 25));
        for k in 0..5 {
            assert_eq!(all.frames[6 * k], keys.frames[k]);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn offsets_to_values_and_back_is_identity_up_to_rounding(
            shifts in prop::collection::vec((-40.0..40.0_f64, -40.0..40.0_f64), 113),
        ) {
            // The eye corners do not move, so the iris shifts are relative to the eye; the four iris nodes move alike.
            let fixed = [20, 23, 53, 56];
            let alike = |node: usize| match node { 68 | 71 | 72 => 67, 70 | 73 | 74 => 69, n => n };
            let shift = |node: usize| if fixed.contains(&node) { (0.0, 0.0) } else { shifts[alike(node)] };
            let list: Vec<_> = (0..113).map(|n| { let (x, y) = shift(n); (n as u16, x, y) }).collect();
            let (sequence, clamped) = convert(&list);
            let offsets = offsets_from_frame(&sequence.frames[1], &canonical().1, FapCatalog::mpeg4()).unwrap();
            // Half a FAP unit is at most half of MW/1024 or ENS/1024 or ES/1024: 0.5 face units.
            for (node, offset) in offsets {
                let (x, y) = shift(node.index());
                let is_clamped = clamped.iter().any(|c| FapCatalog::mpeg4().row(c.fap).nodes.contains(&node));
                if is_clamped { continue; }
                prop_assert!(offset.x.is_none_or(|o| (o - x).abs() <= 0.5 + 1e-9), "node {} x", node);
                prop_assert!(offset.y.is_none_or(|o| (o - y).abs() <= 0.5 + 1e-9), "node {} y", node);
            }
        }
    }
}
