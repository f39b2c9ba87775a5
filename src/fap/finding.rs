//! What is found wrong in a FAP file, by line, field and rule.

use std::{collections::BTreeMap, fmt};

use serde::Serialize;

/// How bad a finding is.
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
    /// Off the strict subset, yet a known writer does it: read as meant.
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

/// A rule of the strict subset that every known reader takes.
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
    /// The header counts the frames.
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
    /// No lip is 0 in a frame in which its twin is not; only Xface minds.
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
    /// No byte order mark.
    ByteOrderMark,
    /// Reading stopped after too many errors.
    TooManyErrors,
}

impl fmt::Display for Rule {
    /// The rule's id, as in JSON: `mask-count`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// One thing found in a FAP file.
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
    /// Line, from 1; where the thing happens more than once, the first.
    pub line: usize,
    /// What it is about: `fps`, `mask`, `FAP 3`, ...
    pub field: String,
    /// Rule that is broken.
    pub rule: Rule,
    /// How bad it is.
    pub severity: Severity,
    /// What was found, what was expected, what to do.
    pub message: String,
    /// How often it happens in the file, at least 1.
    pub times: usize,
}

impl fmt::Display for Finding {
    /// `severity rule: field: message`, with the number of further places.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}: {}: {}", self.severity, self.rule, self.field, self.message)?;
        if self.times > 1 {
            write!(f, " ({} times)", self.times)?;
        }
        Ok(())
    }
}

/// Errors after which a file is given up: it is none of these.
const MAX_ERRORS: usize = 100;

/// Gathers findings: a warning once for each rule and field, every error.
#[derive(Debug, Default)]
pub(super) struct Findings {
    list: Vec<Finding>,
    warnings: BTreeMap<(Rule, String), usize>,
    errors: usize,
}

impl Findings {
    /// Adds a warning, or counts it when its rule and field had one.
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

    /// Whether reading on is pointless.
    pub(super) fn given_up(&self) -> bool {
        self.errors > MAX_ERRORS
    }

    /// The findings by line, those of one line in the order they were made.
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
