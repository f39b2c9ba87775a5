//! The action units of FACS that are measured.

use super::FeaturesError;

/// An action unit of FACS and its expression shapes.
///
/// ```
/// use grimace::features::ActionUnit;
///
/// let smile: ActionUnit = "AU12".parse()?;
/// assert_eq!((smile.number, smile.name), (12, "lip corner puller"));
/// assert!("AU99".parse::<ActionUnit>().is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActionUnit {
    /// Number in FACS.
    pub number: u8,
    /// Its name.
    pub name: &'static str,
    /// Stems of the shapes; with sides they end in `_L` and `_R`.
    pub shapes: &'static [&'static str],
}

const fn unit(number: u8, name: &'static str, shapes: &'static [&'static str]) -> ActionUnit {
    ActionUnit { number, name, shapes }
}

/// Lips part: the one action unit without shapes of its own.
pub const LIPS_PART: u8 = 25;

/// The action units measured, ascending.
pub const ACTION_UNITS: [ActionUnit; 21] = [
    unit(1, "inner brow raiser", &["browInnerUp"]),
    unit(2, "outer brow raiser", &["browOuterUp"]),
    unit(4, "brow lowerer", &["browDown"]),
    unit(5, "upper lid raiser", &["eyeWide"]),
    unit(6, "cheek raiser", &["cheekSquint"]),
    unit(7, "lid tightener", &["eyeSquint"]),
    unit(9, "nose wrinkler", &["noseSneer"]),
    unit(10, "upper lip raiser", &["mouthUpperUp"]),
    unit(12, "lip corner puller", &["mouthSmile"]),
    unit(14, "dimpler", &["mouthDimple"]),
    unit(15, "lip corner depressor", &["mouthFrown"]),
    unit(16, "lower lip depressor", &["mouthLowerDown"]),
    unit(17, "chin raiser", &["mouthShrugLower"]),
    unit(18, "lip puckerer", &["mouthPucker"]),
    unit(20, "lip stretcher", &["mouthStretch"]),
    unit(22, "lip funneler", &["mouthFunnel"]),
    unit(23, "lip tightener", &["mouthPress"]),
    unit(24, "lip presser", &["mouthRollUpper", "mouthRollLower"]),
    // Measured on the lips themselves, whatever parts them.
    unit(LIPS_PART, "lips part", &[]),
    unit(26, "jaw drop", &["jawOpen"]),
    unit(45, "blink", &["eyeBlink"]),
];

/// Names of the action units that are measured.
pub(super) fn known() -> String {
    ACTION_UNITS.iter().map(|unit| format!("AU{:02}", unit.number)).collect::<Vec<_>>().join(" ")
}

impl std::str::FromStr for ActionUnit {
    type Err = FeaturesError;

    /// Parses `AU12`, `au12` or `12`.
    fn from_str(name: &str) -> Result<Self, FeaturesError> {
        let text = name.trim();
        let digits = text.strip_prefix("AU").or_else(|| text.strip_prefix("au")).unwrap_or(text);
        let number: Option<u8> = digits.parse().ok();
        let found = ACTION_UNITS.iter().find(|unit| Some(unit.number) == number);
        found.copied().ok_or_else(|| FeaturesError::UnknownActionUnit { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn action_units_are_named_by_their_numbers() {
        for name in ["AU04", "AU4", "au4", " 4 "] {
            assert_eq!(name.parse::<ActionUnit>().unwrap().name, "brow lowerer");
        }
        for name in ["AU3", "smile", "AU", "-4", "AU400"] {
            let error = name.parse::<ActionUnit>().unwrap_err().to_string();
            assert!(error.starts_with(&format!("`{name}` is not an action unit")) && error.contains("AU45"), "{error}");
        }
    }
}
