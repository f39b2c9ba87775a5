//! The expressions of the emotions as sums of Candide-3's motion units.

use std::{fmt, str::FromStr, sync::LazyLock};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize, Serializer};

use super::{Fapus, UnitKind, Wireframe, tables::rows};
use crate::units::NodeId;

const EXPRESSIONS: &str = include_str!("../../candide/expressions.csv");

/// An emotion with a known expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Emotion {
    /// Brows down and together, lids tight, lips pressed.
    Anger,
    /// One corner of the mouth tightened and raised.
    Contempt,
    /// Nose wrinkled, upper lip raised.
    Disgust,
    /// Inner brows up and together, upper lids up, lips stretched and parted.
    Fear,
    /// Corners of the mouth out and up, cheeks lifted.
    Happiness,
    /// Inner brows up, corners of the mouth down.
    Sadness,
    /// Brows up, eyes wide, jaw dropped.
    Surprise,
}

/// Error for a text that names no emotion.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is not an emotion that can be simulated; choose from anger, contempt, disgust, fear, happiness, sadness, surprise"
)]
pub struct ParseEmotionError(pub String);

impl Emotion {
    /// All seven, ordered by the emotion codes 1 to 7 of the extended Cohn-Kanade database.
    pub const ALL: [Self; 7] =
        [Self::Anger, Self::Contempt, Self::Disgust, Self::Fear, Self::Happiness, Self::Sadness, Self::Surprise];

    /// The six basic emotions.
    pub const BASIC: [Self; 6] = [Self::Anger, Self::Disgust, Self::Fear, Self::Happiness, Self::Sadness, Self::Surprise];

    /// Name of the emotion in a manifest.
    pub fn label(self) -> &'static str {
        match self {
            Self::Anger => "anger",
            Self::Contempt => "contempt",
            Self::Disgust => "disgust",
            Self::Fear => "fear",
            Self::Happiness => "happiness",
            Self::Sadness => "sadness",
            Self::Surprise => "surprise",
        }
    }

    /// Emotion code 1 to 7 of the extended Cohn-Kanade database; also the number of the simulated sequence.
    pub fn code(self) -> u8 {
        self as u8 + 1
    }
}

impl fmt::Display for Emotion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.label())
    }
}

impl FromStr for Emotion {
    type Err = ParseEmotionError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|e| e.label() == text).ok_or_else(|| ParseEmotionError(text.to_owned()))
    }
}

impl Serialize for Emotion {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.label())
    }
}

/// A motion unit of Candide-3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpressionUnit {
    /// Action unit vector with its number in the list of Rydfalk. The weight is Candide's parameter, 1 for full strength.
    Auv(u16),
    /// MPEG-4 FAP. The weight is a FAP value divided by 1024: the motion in the subject's own FAPU length.
    Fap(u16),
}

/// One row of the table of expressions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpressionRow {
    /// The emotion.
    pub emotion: Emotion,
    /// The unit.
    pub unit: ExpressionUnit,
    /// Its weight at an average person's apex.
    pub weight: f64,
}

/// The table of expressions, `candide/expressions.csv`: the units and weights of an average person's apex.
pub fn expressions() -> &'static [ExpressionRow] {
    static TABLE: LazyLock<Vec<ExpressionRow>> = LazyLock::new(|| {
        #[derive(Deserialize)]
        struct Row {
            emotion: String,
            kind: String,
            number: u16,
            weight: f64,
        }
        let row = |row: Row| {
            let emotion = row.emotion.parse().map_err(|e: ParseEmotionError| e.to_string())?;
            let unit = match row.kind.as_str() {
                "AUV" => ExpressionUnit::Auv(row.number),
                "FAP" => ExpressionUnit::Fap(row.number),
                other => return Err(format!("`{other}` is neither AUV nor FAP")),
            };
            Ok(ExpressionRow { emotion, unit, weight: row.weight })
        };
        let table = rows::<Row>("expressions.csv", EXPRESSIONS).map_err(|e| e.to_string());
        let table = table.and_then(|table| table.into_iter().map(row).collect());
        table.unwrap_or_else(|error: String| unreachable!("embedded table: {error}"))
    });
    &TABLE
}

/// The forehead node between the brows, the inner and upper nodes of the brows, and the fraction of their rise that the forehead
/// node follows. No unit of Candide-3 moves it, so raised brows would push their skin over it.
const FOREHEAD: usize = 2;
const RISING_BROW: [usize; 4] = [16, 17, 49, 50];
const FOREHEAD_SHARE: f64 = 0.5;

/// Corrects summed units: raised brows take the forehead along, and lips do not pass through each other.
pub fn settle_offsets(wireframe: &Wireframe, offsets: &mut [Vector3<f64>]) {
    let raised = RISING_BROW.iter().map(|&n| offsets[n].y).sum::<f64>() / RISING_BROW.len() as f64;
    offsets[FOREHEAD].y += FOREHEAD_SHARE * raised.max(0.0);
    keep_lips_apart(wireframe, offsets);
}

/// Returns the index of the unit, and the length in model units of a weight of 1.
pub fn find_unit(wireframe: &Wireframe, fapus: &Fapus, unit: ExpressionUnit) -> Option<(usize, f64)> {
    wireframe.action_units().iter().enumerate().find_map(|(index, candidate)| match (unit, &candidate.kind) {
        (ExpressionUnit::Auv(wanted), UnitKind::Action { number }) if wanted == *number => Some((index, 1.0)),
        (ExpressionUnit::Fap(wanted), UnitKind::Fap { number, fapu }) if wanted == *number => {
            Some((index, fapu.and_then(|fapu| fapus.length(fapu)).unwrap_or(1.0)))
        }
        _ => None,
    })
}

/// Inner upper lip nodes and the lower lip nodes opposite to them.
pub(crate) const LIP_TWINS: [(u16, u16); 3] = [(87, 40), (81, 83), (82, 84)];

/// Prevents lips from passing through each other: if an upper inner lip node ends below its lower counterpart, both move to the
/// middle.
pub fn keep_lips_apart(wireframe: &Wireframe, offsets: &mut [Vector3<f64>]) {
    for (upper, lower) in LIP_TWINS.map(|(u, l)| (NodeId(u).index(), NodeId(l).index())) {
        let gap = (wireframe.vertices()[upper].y + offsets[upper].y) - (wireframe.vertices()[lower].y + offsets[lower].y);
        if gap < 0.0 {
            offsets[upper].y -= gap / 2.0;
            offsets[lower].y += gap / 2.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Tables;

    #[test]
    fn every_row_names_a_unit_that_the_wireframe_has() {
        let w = Wireframe::candide3();
        let fapus = Fapus::measure(&Tables::candide3().fapus, &w.frontal()).unwrap();
        for row in expressions() {
            assert!(find_unit(&w, &fapus, row.unit).is_some(), "{row:?}");
            assert!(row.weight != 0.0 && row.weight.abs() <= 1.2, "{row:?}");
        }
        for emotion in Emotion::ALL {
            let units: Vec<_> = expressions().iter().filter(|r| r.emotion == emotion).map(|r| r.unit).collect();
            assert!(units.len() >= 5);
            assert!(units.iter().enumerate().all(|(k, u)| !units[..k].contains(u)), "{emotion} lists a unit twice");
        }
    }

    #[test]
    fn labels_parse_back() {
        for emotion in Emotion::ALL {
            assert_eq!(emotion.label().parse(), Ok(emotion));
        }
        assert_eq!("joy".parse::<Emotion>(), Err(ParseEmotionError("joy".to_owned())));
        assert_eq!((Emotion::Anger.code(), Emotion::Surprise.code()), (1, 7));
    }
}
