//! The table of the 68 FAPs [MPEG-4, Table C-1], one row each, from `candide/faps.csv`.

use std::{fmt, str::FromStr, sync::LazyLock};

use serde::Deserialize;

use crate::{
    units::{FeaturePoint, NodeId},
    wireframe::{Axis, Fapu},
};

const FAPS: &str = include_str!("../../candide/faps.csv");
const HIGH_LEVEL_FAPS: &str = include_str!("../../candide/high_level_faps.csv");

/// Number of a FAP, 1 to 68.
///
/// ```
/// use grimace::fap::FapNumber;
///
/// let jaw: FapNumber = "3".parse()?;
/// assert_eq!(jaw, FapNumber::try_from(3)?);
/// assert_eq!((jaw.get(), jaw.index(), jaw.is_high_level()), (3, 2, false));
/// assert_eq!((FapNumber::all().count(), FapNumber::low_level().count()), (68, 66));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FapNumber(u8);

/// Error for a number or text that is no FAP number.
///
/// ```
/// use grimace::fap::FapNumber;
///
/// let error = "69".parse::<FapNumber>().unwrap_err();
/// assert_eq!(error.to_string(), "`69` is not a FAP number; FAPs are numbered 1 to 68");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a FAP number; FAPs are numbered 1 to 68")]
pub struct ParseFapNumberError(pub String);

impl FapNumber {
    /// Number of FAPs.
    pub const COUNT: usize = 68;
    /// FAP 1: the visemes of speech.
    pub const VISEME: Self = Self(1);
    /// FAP 2: the primary facial expressions.
    pub const EXPRESSION: Self = Self(2);

    /// All FAPs in ascending order.
    pub fn all() -> impl DoubleEndedIterator<Item = Self> + Clone {
        (1..=68).map(Self)
    }

    /// The low-level FAPs, 3 to 68, which have a single value each.
    pub fn low_level() -> impl DoubleEndedIterator<Item = Self> + Clone {
        (3..=68).map(Self)
    }

    /// The number, 1 to 68.
    pub fn get(self) -> u8 {
        self.0
    }

    /// Index in an array over all FAPs, 0 to 67.
    pub fn index(self) -> usize {
        usize::from(self.0 - 1)
    }

    /// Whether it is one of the compound FAPs, 1 and 2.
    pub fn is_high_level(self) -> bool {
        self.0 <= 2
    }
}

impl TryFrom<u8> for FapNumber {
    type Error = ParseFapNumberError;

    fn try_from(number: u8) -> Result<Self, Self::Error> {
        if (1..=68).contains(&number) { Ok(Self(number)) } else { Err(ParseFapNumberError(number.to_string())) }
    }
}

impl FromStr for FapNumber {
    type Err = ParseFapNumberError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let number: u8 = text.trim().parse().map_err(|_| ParseFapNumberError(crate::text::excerpt(text)))?;
        Self::try_from(number)
    }
}

impl fmt::Display for FapNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Whether a FAP moves in one or both directions from neutral.
///
/// ```
/// use grimace::fap::{Directionality, FapCatalog};
///
/// // The jaw only opens; the lower lip goes down and up.
/// let [jaw, lip] = [3, 4].map(|k| FapCatalog::mpeg4().rows()[k - 1].directionality);
/// assert_eq!([jaw, lip], [Some(Directionality::Unidirectional), Some(Directionality::Bidirectional)]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Directionality {
    /// Values are 0 or positive.
    #[serde(rename = "U")]
    Unidirectional,
    /// Values have either sign.
    #[serde(rename = "B")]
    Bidirectional,
}

/// Kind and axis of a FAP's motion, in face axes.
///
/// ```
/// use grimace::{fap::{FapCatalog, FapMotion}, wireframe::Axis};
///
/// let pitch = FapCatalog::mpeg4().row("48".parse()?).motion.expect("FAP 48 moves the head");
/// assert_eq!((pitch, pitch.is_angle(), pitch.frontal_axis()), (FapMotion::Pitch, true, Some(Axis::Y)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FapMotion {
    /// Shift along x.
    X,
    /// Shift along y.
    Y,
    /// Shift along z; not visible in a frontal view.
    Z,
    /// Rotation about y: a point in front moves along x.
    Yaw,
    /// Rotation about x: a point in front moves along y.
    Pitch,
    /// Rotation about z.
    Roll,
}

impl FapMotion {
    /// Axis of a frontal view along which the motion is visible: x or y; `None` for depth and roll.
    pub fn frontal_axis(self) -> Option<Axis> {
        match self {
            Self::X | Self::Yaw => Some(Axis::X),
            Self::Y | Self::Pitch => Some(Axis::Y),
            Self::Z | Self::Roll => None,
        }
    }

    /// Whether it is a rotation.
    pub fn is_angle(self) -> bool {
        matches!(self, Self::Yaw | Self::Pitch | Self::Roll)
    }
}

/// How well a frontal 2-D wireframe can measure a FAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FrontalRating {
    /// Compound FAPs 1 and 2: not measured.
    HighLevel,
    /// Measured directly.
    Yes,
    /// Measured with limitations: sometimes hidden, little texture, or inferred.
    Partial,
    /// Not measured: depth, tongue, ears, pupils.
    No,
    /// Head motion, which normalization removes.
    Global,
}

impl FrontalRating {
    /// Whether a FAP with this rating is measured.
    pub fn is_measured(self) -> bool {
        matches!(self, Self::Yes | Self::Partial)
    }
}

/// One FAP: a row of the table.
///
/// ```
/// use grimace::{fap::{FapCatalog, FapRow}, units::NodeId};
///
/// let FapRow { name, nodes, range, .. } = FapCatalog::mpeg4().row("3".parse()?);
/// assert_eq!((name.as_str(), &nodes[..], *range), ("open_jaw", &[NodeId(10)][..], Some((0, 4320))));
/// assert_eq!(FapCatalog::mpeg4().row("3".parse()?).unit_name(), "MNS/1024");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FapRow {
    /// Its number.
    pub number: FapNumber,
    /// Its name in the standard, such as `open_jaw`.
    pub name: String,
    /// Unit: values are in 1/1024 of its length, or in 1e-5 rad for [`Fapu::Au`]. `None` for FAPs 1 and 2.
    pub fapu: Option<Fapu>,
    /// Whether it moves in one or both directions; `None` for FAPs 1 and 2.
    pub directionality: Option<Directionality>,
    /// Feature points that move.
    pub feature_points: Vec<FeaturePoint>,
    /// Driving nodes: the FAP measures their mean position. Empty if Candide-3 lacks the feature point.
    pub nodes: Vec<NodeId>,
    /// Nodes whose mean motion is subtracted: the corners of the eye, for the gaze. Usually empty.
    pub relative_to: Vec<NodeId>,
    /// Kind and axis of its motion; `None` for FAPs 1, 2, 29 and 30.
    pub motion: Option<FapMotion>,
    /// +1 if motion towards the positive axis gives a positive value, -1 if it gives a negative one.
    pub sign: f64,
    /// How well a frontal view can measure it.
    pub(crate) frontal: FrontalRating,
    /// Smallest and largest value in the standard, FAP units; `None` for FAPs 1 and 2.
    pub range: Option<(i32, i32)>,
    /// Quantizer step of the standard's bit stream, FAP units.
    pub quantizer_step: u32,
}

impl FapRow {
    /// Returns a value limited to the range of the standard; as it is without one.
    pub(crate) fn limited(&self, value: f64) -> f64 {
        self.range.map_or(value, |(min, max)| value.clamp(f64::from(min), f64::from(max)))
    }

    /// Whether it moves a node of the wireframe in a way that is visible from the front.
    pub(crate) fn shows_from_front(&self) -> bool {
        self.fapu.is_some() && self.motion.and_then(FapMotion::frontal_axis).is_some() && !self.nodes.is_empty()
    }

    /// The unit of its values as written in reports: `ENS/1024`, `1e-5 rad`, or `code` for FAPs 1 and 2.
    pub fn unit_name(&self) -> String {
        match self.fapu {
            Some(Fapu::Au) => "1e-5 rad".to_owned(),
            Some(fapu) => format!("{fapu}/1024"),
            None => "code".to_owned(),
        }
    }
}

/// One integer field of FAP 1 or 2.
///
/// ```
/// use grimace::fap::{FapCatalog, FapNumber};
///
/// let first = FapCatalog::mpeg4().fields(FapNumber::VISEME).next().expect("FAP 1 has fields");
/// assert_eq!((first.name.as_str(), first.range), ("viseme_select1", (0, 14)));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HighLevelField {
    /// FAP 1 or 2.
    pub fap: FapNumber,
    /// Its name, such as `viseme_select1`.
    pub name: String,
    /// Smallest and largest value.
    pub range: (i32, i32),
}

/// The table of the 68 FAPs.
///
/// ```
/// use grimace::fap::FapCatalog;
///
/// let catalog = FapCatalog::mpeg4();
/// let jaw = catalog.row("3".parse()?);
/// assert_eq!((catalog.rows().len(), jaw.name.as_str()), (68, "open_jaw"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FapCatalog {
    rows: Vec<FapRow>,
    high_level: Vec<HighLevelField>,
    twins: Vec<(FapNumber, FapNumber)>,
}

impl FapCatalog {
    /// Returns the table of the standard.
    pub fn mpeg4() -> &'static Self {
        static CATALOG: LazyLock<FapCatalog> =
            LazyLock::new(|| FapCatalog::embedded().unwrap_or_else(|error| unreachable!("embedded FAP table: {error}")));
        &CATALOG
    }

    /// The rows in ascending order.
    pub fn rows(&self) -> &[FapRow] {
        &self.rows
    }

    /// The row of one FAP.
    pub fn row(&self, fap: FapNumber) -> &FapRow {
        &self.rows[fap.index()]
    }

    /// The integer fields of FAP 1 (4) or FAP 2 (6), in file order; empty for other FAPs.
    #[doc(hidden)]
    pub fn fields(&self, fap: FapNumber) -> impl ExactSizeIterator<Item = &HighLevelField> {
        self.high_level.iter().filter(move |field| field.fap == fap).collect::<Vec<_>>().into_iter()
    }

    /// Pairs of an inner-lip FAP and the outer-lip FAP of the same motion, (4, 51) to (13, 60).
    pub fn lip_twins(&self) -> &[(FapNumber, FapNumber)] {
        &self.twins
    }

    fn embedded() -> Result<Self, String> {
        #[derive(Deserialize)]
        struct Raw {
            fap: u8,
            name: String,
            fapu: Option<Fapu>,
            directionality: Option<Directionality>,
            fp: String,
            nodes: String,
            relative_to: String,
            motion: Option<FapMotion>,
            sign: Option<i8>,
            frontal: FrontalRating,
            value_min: Option<i32>,
            value_max: Option<i32>,
            quant_step: u32,
        }
        #[derive(Deserialize)]
        struct RawField {
            fap: u8,
            field: String,
            min: i32,
            max: i32,
        }
        let mut rows = Vec::new();
        for raw in records::<Raw>(FAPS)? {
            if usize::from(raw.fap) != rows.len() + 1 {
                return Err(format!("FAP {} stands in row {}", raw.fap, rows.len() + 1));
            }
            rows.push(FapRow {
                number: FapNumber::try_from(raw.fap).map_err(|e| e.to_string())?,
                name: raw.name,
                fapu: raw.fapu,
                directionality: raw.directionality,
                feature_points: words(&raw.fp)?,
                nodes: words(&raw.nodes)?.into_iter().map(NodeId).collect(),
                relative_to: words(&raw.relative_to)?.into_iter().map(NodeId).collect(),
                motion: raw.motion,
                sign: f64::from(raw.sign.unwrap_or(1)),
                frontal: raw.frontal,
                range: raw.value_min.zip(raw.value_max),
                quantizer_step: raw.quant_step,
            });
        }
        if rows.len() != FapNumber::COUNT {
            return Err(format!("{} rows", rows.len()));
        }
        let high_level = records::<RawField>(HIGH_LEVEL_FAPS)?
            .into_iter()
            .map(|raw| {
                let fap = FapNumber::try_from(raw.fap).map_err(|e| e.to_string())?;
                Ok(HighLevelField { fap, name: raw.field, range: (raw.min, raw.max) })
            })
            .collect::<Result<_, String>>()?;
        // The standard names the outer-lip FAPs after the inner-lip ones, with `_o` appended.
        let outer = |inner: &FapRow| rows.iter().find(|row: &&FapRow| row.name.strip_suffix("_o") == Some(&inner.name));
        let twins = rows.iter().filter_map(|inner| Some((inner.number, outer(inner)?.number))).collect();
        Ok(Self { rows, high_level, twins })
    }
}

fn records<T: for<'de> Deserialize<'de>>(text: &str) -> Result<Vec<T>, String> {
    csv::Reader::from_reader(text.as_bytes()).deserialize().collect::<Result<_, _>>().map_err(|e: csv::Error| e.to_string())
}

fn words<T: FromStr<Err: fmt::Display>>(text: &str) -> Result<Vec<T>, String> {
    text.split_whitespace().map(|word| word.parse().map_err(|e| format!("`{word}`: {e}"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Tables;

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    #[test]
    fn the_table_reads_and_counts_as_the_standard_does() {
        let catalog = FapCatalog::mpeg4();
        assert_eq!(catalog.rows().len(), 68);
        assert_eq!(catalog.fields(FapNumber::VISEME).len(), 4);
        assert_eq!(catalog.fields(FapNumber::EXPRESSION).len(), 6);
        assert_eq!(catalog.fields(fap(3)).len(), 0);
        let numbers =
            |keep: fn(&FapRow) -> bool| catalog.rows().iter().filter(|r| keep(r)).map(|r| r.number.get()).collect::<Vec<_>>();
        assert_eq!(numbers(|r| r.directionality == Some(Directionality::Unidirectional)), [3, 14, 41, 42, 47]);
        assert_eq!(numbers(|r| r.fapu == Some(Fapu::Au)), [23, 24, 25, 26, 47, 48, 49, 50]);
        assert_eq!(numbers(|r| r.frontal == FrontalRating::Global), [48, 49, 50]);
        // 3-13, 15, 18-26, 31-42, 51-64: 11 + 1 + 9 + 12 + 14 FAPs.
        assert_eq!(numbers(|r| r.frontal.is_measured()).len(), 47);
    }

    #[test]
    fn what_is_measured_has_nodes_an_axis_a_unit_and_a_range() {
        let catalog = FapCatalog::mpeg4();
        for row in catalog.rows().iter().filter(|r| r.frontal.is_measured()) {
            assert!(!row.nodes.is_empty() && row.motion.and_then(FapMotion::frontal_axis).is_some(), "FAP {}", row.number);
            let (min, max) = row.range.unwrap();
            let least = if row.directionality == Some(Directionality::Unidirectional) { 0 } else { -max };
            assert_eq!(min, least, "FAP {}", row.number);
            assert_eq!(row.motion.unwrap().is_angle(), row.fapu == Some(Fapu::Au), "FAP {}", row.number);
        }
    }

    #[test]
    fn driving_nodes_are_those_of_the_feature_point() {
        let tables = Tables::candide3();
        for row in FapCatalog::mpeg4().rows().iter().filter(|r| !r.nodes.is_empty()) {
            assert_eq!(tables.feature_point_nodes(row.feature_points[0]), Some(row.nodes.as_slice()), "FAP {}", row.number);
        }
    }

    #[test]
    fn no_two_faps_drive_one_coordinate_of_a_node() {
        // Otherwise the conversion from FAPs to offsets would be ambiguous.
        let mut seen = std::collections::BTreeSet::new();
        for row in FapCatalog::mpeg4().rows() {
            let Some(axis) = row.motion.and_then(FapMotion::frontal_axis) else { continue };
            for &node in &row.nodes {
                assert!(seen.insert((node, axis == Axis::X)), "FAP {} repeats node {node}", row.number);
            }
        }
    }

    #[test]
    fn inner_lips_pair_with_outer_lips() {
        let twins: Vec<_> = FapCatalog::mpeg4().lip_twins().iter().map(|&(i, o)| (i.get(), o.get())).collect();
        assert_eq!(twins, (4..=13).zip(51..=60).collect::<Vec<_>>());
    }

    #[test]
    fn numbers_parse_within_1_and_68() {
        assert_eq!("68".parse::<FapNumber>(), Ok(fap(68)));
        for bad in ["0", "69", "300", "-1", "x", ""] {
            assert!(bad.parse::<FapNumber>().is_err(), "{bad}");
        }
    }
}
