//! Findings in a FAP file: line, field and violated rule.

use std::{collections::BTreeMap, fmt};

use serde::Serialize;

/// Severity of a finding.
///
/// ```
/// use grimace::fap::{Severity, check_fap};
///
/// let bytes = std::fs::read_to_string("fixtures/golden/fap/happiness.fap")?.replace('\n', "\r\n");
/// // Lines of Windows are read as meant.
/// let findings = check_fap(bytes.as_bytes());
/// assert!(!findings.is_empty() && findings.iter().all(|finding| finding.severity == Severity::Warning));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Outside the strict subset, but a known writer does it: read as intended.
    Warning,
    /// Unreadable.
    Error,
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Warning => "warning",
            Self::Error => "error",
        })
    }
}

/// A rule of the strict subset that every known reader accepts.
///
/// ```
/// use grimace::fap::{Rule, check_fap};
///
/// assert_eq!(check_fap(b"2.1 smile 25 1\n0 1\n0 5\n")[0].rule, Rule::MaskCount);
/// assert_eq!(Rule::MaskCount.to_string(), "mask-count");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// The file has a header line.
    Header,
    /// The version is 2.1.
    Version,
    /// The name is one ASCII token of 1 to 100 characters, not starting with `#`.
    Name,
    /// The frame rate is a positive integer.
    FpsInteger,
    /// The header has the right number of frames.
    FrameCount,
    /// The mask has 68 flags.
    MaskCount,
    /// A flag is 0 or 1.
    MaskFlag,
    /// Every frame has the same mask.
    MaskVaries,
    /// FAPs 1 and 2 are masked out.
    HighLevel,
    /// Frames are numbered 0, 1, 2 and so on.
    FrameOrder,
    /// A mask line is followed by a line of values.
    FrameLines,
    /// There is a value for each flag that is 1.
    ValueCount,
    /// A value is a number.
    NotNumeric,
    /// A value is finite and fits into 32 bits.
    NotFinite,
    /// Values are decimal integers.
    Integer,
    /// Values lie within the range of the standard.
    Range,
    /// A unidirectional FAP is not negative.
    Unidirectional,
    /// Inner and outer lips are both written.
    LipsMirrored,
    /// No lip is 0 in a frame in which its twin is not; this affects only Xface.
    LipAtRest,
    /// No comments.
    Comment,
    /// No blank lines.
    BlankLine,
    /// No blanks at the end of a line.
    TrailingBlank,
    /// No blanks at the start of a line.
    LeadingBlank,
    /// One blank between words.
    Spacing,
    /// No tabs.
    Tab,
    /// Lines end with LF.
    LineEnding,
    /// The last line ends, too.
    FinalNewline,
    /// The last line also ends with LF.
    ByteOrderMark,
    /// Not a rule: reading stopped after too many errors.
    TooManyErrors,
}

impl fmt::Display for Rule {
    /// Writes the id of the rule, as in JSON: `mask-count`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// One finding in a FAP file.
///
/// ```
/// use grimace::fap::{Finding, Rule, check_fap};
///
/// // An editor has added an empty line behind the 51 there are.
/// let bytes = std::fs::read("fixtures/golden/fap/happiness.fap")?;
/// let findings = check_fap(&[&bytes[..], b"\n"].concat());
/// let Finding { line, times, .. } = findings.iter().find(|finding| finding.rule == Rule::BlankLine).expect("a finding");
/// assert_eq!((*line, *times), (52, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Line, from 1; the first if there are several.
    pub line: usize,
    /// The field concerned: `fps`, `mask`, `FAP 3`, ...
    pub field: String,
    /// The violated rule.
    pub rule: Rule,
    /// Severity.
    pub severity: Severity,
    /// What was found, what was expected, and what to do.
    pub message: String,
    /// Number of occurrences in the file, at least 1.
    pub times: usize,
}

impl fmt::Display for Finding {
    /// Writes `severity rule: field: message`, with the number of further occurrences.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}: {}: {}", self.severity, self.rule, self.field, self.message)?;
        if self.times > 1 {
            write!(f, " ({} times)", self.times)?;
        }
        Ok(())
    }
}

/// Number of errors after which reading stops, because the file is no FAP file.
const MAX_ERRORS: usize = 100;

/// Collects findings: each warning once for its rule and field, and every error.
#[derive(Debug, Default)]
pub(super) struct Findings {
    list: Vec<Finding>,
    warnings: BTreeMap<(Rule, String), usize>,
    errors: usize,
}

impl Findings {
    /// Adds a warning, or counts it if there is one with the same rule and field.
    pub(super) fn warning(&mut self, line: usize, field: impl Into<String>, rule: Rule, message: impl FnOnce() -> String) {
        let field = field.into();
        if let Some(&place) = self.warnings.get(&(rule, field.clone())) {
            self.list[place].times += 1;
            return;
        }
        self.warnings.insert((rule, field.clone()), self.list.len());
        self.list.push(Finding { line, field, rule, severity: Severity::Warning, message: message(), times: 1 });
    }

    /// Adds an error, up to a limit.
    pub(super) fn error(&mut self, line: usize, field: impl Into<String>, rule: Rule, message: String) {
        self.errors += 1;
        let (field, rule, message) = match self.errors {
            ..=MAX_ERRORS => (field.into(), rule, message),
            n if n == MAX_ERRORS + 1 => {
                ("file".to_owned(), Rule::TooManyErrors, format!("more than {MAX_ERRORS} errors; reading stopped here"))
            }
            _ => return,
        };
        self.list.push(Finding { line, field, rule, severity: Severity::Error, message, times: 1 });
    }

    /// Whether the limit of errors was reached, so that reading should stop.
    pub(super) fn given_up(&self) -> bool {
        self.errors > MAX_ERRORS
    }

    /// Returns the findings sorted by line; those of one line stay in order.
    pub(super) fn into_sorted(mut self) -> Vec<Finding> {
        self.list.sort_by_key(|finding| finding.line);
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repeated_warning_is_counted_and_errors_are_capped() {
        let mut findings = Findings::default();
        for line in 1..=3 {
            findings.warning(line, "line", Rule::TrailingBlank, || "blank".into());
        }
        for line in 1..=200 {
            findings.error(line, "mask", Rule::MaskFlag, "no flag".into());
        }
        assert!(findings.given_up());
        let list = findings.into_sorted();
        assert_eq!(list[0].to_string(), "warning trailing-blank: line: blank (3 times)");
        assert_eq!(list[1].to_string(), "error mask-flag: mask: no flag");
        assert_eq!(list.len(), 102);
        assert_eq!(list[101].rule, Rule::TooManyErrors);
    }
}
