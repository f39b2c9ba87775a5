//! Reads and writes Candide `.wfm` files [Candide-3, appendix D].
//!
//! The structure is determined by order and counts alone; headings are comments. Sections 1 to 4 (vertices, triangles, animation
//! units, shape units) define the wireframe. The rest is the state of an animation; it is not read, because copies in circulation
//! differ there. Values are not changed: triangles keep the winding of the file, and coincident and unused vertices keep their
//! numbers.

use std::{
    fmt::{self, Write as _},
    io::{self, Read as _},
    path::{Path, PathBuf},
};

use nalgebra::{Point3, Vector3};

use super::{Fapu, MotionUnit, UnitKind, Wireframe, WireframeError};
use crate::{text::excerpt, units::NodeId};

/// Largest file accepted, bytes. Candide-3 has 35 kB.
const MAX_BYTES: u64 = 64 << 20;

/// Largest number of vertices that [`NodeId`] can address.
const MAX_VERTICES: usize = u16::MAX as usize;

/// Misspelt words in the unit names of copies in circulation, and their corrections.
const SPELLINGS: [(&str, &str); 3] = [("strecth", "stretch"), ("strecher", "stretcher"), ("Motuh", "Mouth")];

/// The sections of a `.wfm` file that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WfmSection {
    /// Section 1.
    Vertices,
    /// Section 2.
    Triangles,
    /// Section 3.
    AnimationUnits,
    /// Section 4.
    ShapeUnits,
}

impl WfmSection {
    fn name(self) -> &'static str {
        match self {
            Self::Vertices => "vertex list",
            Self::Triangles => "face list",
            Self::AnimationUnits => "animation units list",
            Self::ShapeUnits => "shape units list",
        }
    }
}

/// What is wrong with a `.wfm` file.
///
/// ```
/// use grimace::wireframe::{WfmErrorKind, read_wfm};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("cut.wfm");
/// std::fs::write(&path, "3\n0 0 0\n1 0 0\n")?;
/// let error = read_wfm(&path).unwrap_err();
/// assert!(matches!(error.kind, WfmErrorKind::Ends { line: 3, section, .. } if section.to_string() == "vertex list"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum WfmErrorKind {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The file is larger than any wireframe.
    #[error("has more than {MAX_BYTES} bytes; this is not a wireframe")]
    TooLarge,
    /// The file ends before section 4 does.
    #[error("line {line}, {section}: the file ends where {expected} was expected; it is truncated or a count is too large")]
    Ends {
        /// Number of the last line, from 1.
        line: usize,
        /// Name of the incomplete section, as in Candide-3's file.
        section: &'static str,
        /// What was expected next.
        expected: String,
    },
    /// A line with unexpected content.
    #[error("line {line}, {section}: found `{found}` where {expected} was expected")]
    Line {
        /// Line number, from 1.
        line: usize,
        /// Name of the section it is in, as in Candide-3's file.
        section: &'static str,
        /// What was expected.
        expected: String,
        /// The line, shortened.
        found: String,
    },
    /// The content does not form a wireframe.
    #[error(transparent)]
    Wireframe(#[from] WireframeError),
}

/// Error for a `.wfm` file that cannot be read.
///
/// ```
/// use grimace::wireframe::{WfmErrorKind, read_wfm};
///
/// let error = read_wfm("no-such-file.wfm".as_ref()).unwrap_err();
/// assert_eq!(error.path.to_str(), Some("no-such-file.wfm"));
/// assert!(matches!(error.kind, WfmErrorKind::Io(_)));
/// ```
#[derive(Debug, thiserror::Error)]
#[error("{}: {kind}", path.display())]
pub struct WfmError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    pub kind: WfmErrorKind,
}

/// Reads a `.wfm` file of any Candide version.
///
/// Tolerates CRLF, tabs, blank lines, `#` and `//` comments anywhere, missing headings, bytes in comments that are not UTF-8,
/// vertices listed twice in a unit (offsets add up), any number of units, and anything after the shape units. The comment above a
/// unit's count gives its name and kind: `AUV2 Lip stretcher (AU20)` is action unit vector 2; `FAP 31 raise_l_i_eyebrow` with
/// `ENS` in the next comment is FAP 31 in ENS. Known misspellings are corrected.
///
/// ```
/// use grimace::wireframe::read_wfm;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("triangle.wfm");
/// // Three vertices, one triangle, no animation units and no shape units.
/// std::fs::write(&path, "3\n0 0 0\n1 0 0\n0 1 0\n1\n0 1 2\n0\n0\n")?;
/// let wireframe = read_wfm(&path)?;
/// assert_eq!((wireframe.node_count(), wireframe.triangles().len()), (3, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`WfmError`] with the line, the section, what was expected and what was found.
pub fn read_wfm(path: &Path) -> Result<Wireframe, WfmError> {
    let read = || {
        let mut bytes = Vec::new();
        crate::input::open_file(path)?.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 > MAX_BYTES { Err(WfmErrorKind::TooLarge) } else { parse(&bytes) }
    };
    read().map_err(|kind| WfmError { path: path.to_owned(), kind })
}

fn parse(bytes: &[u8]) -> Result<Wireframe, WfmErrorKind> {
    let mut lines = DataLines::new(bytes);
    let section = WfmSection::Vertices;
    let vertex_count = lines.count(section, "the number of vertices", MAX_VERTICES)?;
    let mut vertices = Vec::new();
    for k in 0..vertex_count {
        let (line, [x, y, z]) = lines.fields(section, || format!("vertex {k} of {vertex_count}, `x y z`"))?;
        let number = |field| finite(section, line, field);
        vertices.push(Point3::new(number(x)?, number(y)?, number(z)?));
    }

    let section = WfmSection::Triangles;
    let triangle_count = lines.count(section, "the number of triangles", usize::MAX)?;
    let mut triangles = Vec::new();
    for k in 0..triangle_count {
        let (line, [a, b, c]) = lines.fields(section, || format!("triangle {k} of {triangle_count}, three vertex numbers"))?;
        let node = |field| node_id(section, line, field, vertex_count);
        triangles.push([node(a)?, node(b)?, node(c)?]);
    }

    let action_units = motion_units(&mut lines, WfmSection::AnimationUnits, vertex_count)?;
    let shape_units = motion_units(&mut lines, WfmSection::ShapeUnits, vertex_count)?;
    Ok(Wireframe::new(vertices, triangles, action_units, shape_units)?)
}

fn motion_units(lines: &mut DataLines<'_>, section: WfmSection, vertex_count: usize) -> Result<Vec<MotionUnit>, WfmErrorKind> {
    let unit_count = lines.count(section, "the number of units", usize::MAX)?;
    let mut units = Vec::new();
    for unit in 0..unit_count {
        lines.comments.clear();
        let offset_count = lines.count(section, &format!("the number of vertices of unit {unit} of {unit_count}"), usize::MAX)?;
        let (name, kind) = unit_name(&lines.comments, section, unit);
        let mut offsets = Vec::new();
        for k in 0..offset_count {
            let expected = || format!("`vertex dx dy dz` ({k} of {offset_count}) of unit {unit} of {unit_count}, `{name}`,");
            let (line, [node, dx, dy, dz]) = lines.fields(section, expected)?;
            let number = |field| finite(section, line, field);
            let offset = Vector3::new(number(dx)?, number(dy)?, number(dz)?);
            offsets.push((node_id(section, line, node, vertex_count)?, offset));
        }
        units.push(MotionUnit { name, kind, offsets });
    }
    Ok(units)
}

/// Determines name and kind of a unit from the comments between the previous unit and its count. The name is the last comment
/// that is not a FAPU, unless an earlier one has the form `AUV<k> name` or `FAP<n> name`.
fn unit_name(comments: &[String], section: WfmSection, unit: usize) -> (String, UnitKind) {
    let fapu = comments.last().and_then(|c| length_fapu(c));
    let names = || comments.iter().rev().filter(|c| length_fapu(c).is_none());
    if section == WfmSection::AnimationUnits {
        for comment in names() {
            if let Some((number, name)) = numbered(comment, "AUV") {
                return (named(name, &format!("AUV{number}")), UnitKind::Action { number });
            }
            if let Some((number, name)) = numbered(comment, "FAP") {
                return (named(name, &format!("FAP{number}")), UnitKind::Fap { number, fapu });
            }
        }
        let name = names().next().map_or("", String::as_str);
        return (named(name, &format!("animation unit {unit}")), UnitKind::Other);
    }
    let name = names().next().map_or("", String::as_str);
    (named(name, &format!("shape unit {unit}")), UnitKind::Shape)
}

/// Returns a name with single spaces and known misspellings corrected; `otherwise` if it is empty.
fn named(name: &str, otherwise: &str) -> String {
    let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
    let name = SPELLINGS.iter().fold(name, |name, (wrong, right)| name.replace(wrong, right));
    if name.is_empty() { otherwise.to_owned() } else { name }
}

/// Returns `12` and `name` for `AUV12 name`, `AUV 12 name` or `AUV12`; the case of the prefix does not matter.
fn numbered<'a>(comment: &'a str, prefix: &str) -> Option<(u16, &'a str)> {
    let (head, rest) = comment.split_at_checked(prefix.len())?;
    let rest = rest.trim_start();
    let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let (number, name) = rest.split_at(digits);
    let separated = name.is_empty() || name.starts_with(|c: char| c.is_whitespace() || c == ':');
    let number = number.parse().ok().filter(|_| separated && head.eq_ignore_ascii_case(prefix))?;
    Some((number, name.trim_start_matches(':').trim()))
}

/// Returns the FAPU length if the comment consists of its name.
fn length_fapu(comment: &str) -> Option<Fapu> {
    comment.parse().ok().filter(|fapu| Fapu::LENGTHS.contains(fapu))
}

/// Iterates over the lines with data; collects the comments since the last data line or section.
struct DataLines<'a> {
    lines: std::slice::Split<'a, u8, fn(&u8) -> bool>,
    /// Number of the last line read, from 1.
    line: usize,
    /// Comments that contain a letter or digit, without `#` or `//`.
    comments: Vec<String>,
}

impl<'a> DataLines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        let bytes = bytes.strip_suffix(b"\n").unwrap_or(bytes);
        let is_end: fn(&u8) -> bool = |&b| b == b'\n';
        Self { lines: bytes.split(is_end), line: 0, comments: Vec::new() }
    }

    /// Returns the next line with data, without surrounding white space and comment.
    fn next(&mut self) -> Option<(usize, &'a [u8])> {
        for text in self.lines.by_ref() {
            self.line += 1;
            let (data, comment) = split_comment(text);
            let comment = String::from_utf8_lossy(comment);
            let comment = comment.trim_matches(|c: char| c == '#' || c == '/' || c.is_whitespace());
            if comment.contains(char::is_alphanumeric) {
                self.comments.push(comment.to_owned());
            }
            let data = data.trim_ascii();
            if !data.is_empty() {
                return Some((self.line, data));
            }
        }
        None
    }

    /// Returns the next data line, split into exactly `K` fields.
    fn fields<const K: usize>(
        &mut self,
        section: WfmSection,
        expected: impl Fn() -> String,
    ) -> Result<(usize, [&'a [u8]; K]), WfmErrorKind> {
        let Some((line, data)) = self.next() else {
            return Err(WfmErrorKind::Ends { line: self.line, section: section.name(), expected: expected() });
        };
        let mut fields: [&[u8]; K] = [&[]; K];
        let mut found = 0;
        for field in data.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty()) {
            if let Some(slot) = fields.get_mut(found) {
                *slot = field;
            }
            found += 1;
        }
        if found == K { Ok((line, fields)) } else { Err(bad_line(section, line, data, expected())) }
    }

    /// Returns the next data line as a count.
    fn count(&mut self, section: WfmSection, what: &str, most: usize) -> Result<usize, WfmErrorKind> {
        let expected = || match most {
            usize::MAX => what.to_owned(),
            most => format!("{what}, at most {most},"),
        };
        let (line, [field]) = self.fields(section, expected)?;
        let count = text(field).parse().ok().filter(|&count: &usize| count <= most);
        count.ok_or_else(|| bad_line(section, line, field, expected()))
    }
}

/// Splits a line into data and comment; the comment includes its mark.
fn split_comment(line: &[u8]) -> (&[u8], &[u8]) {
    let starts = |k: &usize| line[*k] == b'#' || line[*k..].starts_with(b"//");
    line.split_at((0..line.len()).find(starts).unwrap_or(line.len()))
}

/// Parses a field as a finite number.
fn finite(section: WfmSection, line: usize, field: &[u8]) -> Result<f64, WfmErrorKind> {
    let value = text(field).parse::<f64>().ok().filter(|v| v.is_finite());
    value.ok_or_else(|| bad_line(section, line, field, "a finite number".to_owned()))
}

/// Parses a field as the index of one of `count` vertices.
fn node_id(section: WfmSection, line: usize, field: &[u8], count: usize) -> Result<NodeId, WfmErrorKind> {
    let node = text(field).parse().ok().filter(|&node: &u16| usize::from(node) < count).map(NodeId);
    let expected = || match count {
        0 => "no vertex number (there are no vertices)".to_owned(),
        count => format!("a vertex number, 0 to {},", count - 1),
    };
    node.ok_or_else(|| bad_line(section, line, field, expected()))
}

/// Returns a field as text; if it is not UTF-8, empty text, which does not parse as a number.
fn text(field: &[u8]) -> &str {
    std::str::from_utf8(field).unwrap_or_default()
}

fn bad_line(section: WfmSection, line: usize, found: &[u8], expected: String) -> WfmErrorKind {
    /// Number of bytes used for an excerpt; a file may be a single line.
    const ENOUGH: usize = 400;
    let found = excerpt(&String::from_utf8_lossy(&found[..found.len().min(ENOUGH)]));
    WfmErrorKind::Line { line, section: section.name(), expected, found }
}

/// Formats a wireframe as the text of a `.wfm` file: nine sections with headings, 6 decimals, LF, ASCII.
///
/// [`read_wfm`] reads the text back as an equal wireframe, except for further decimals and names that are not ASCII.
#[must_use]
pub fn write_wfm(wireframe: &Wireframe) -> String {
    let mut out = String::from("# CANDIDE WIREFRAME\n\n");
    // Writing to a String does not fail.
    let _ = write_sections(&mut out, wireframe);
    out
}

fn write_sections(out: &mut String, wireframe: &Wireframe) -> fmt::Result {
    writeln!(out, "# VERTEX LIST:\n{}", wireframe.node_count())?;
    for v in wireframe.vertices() {
        writeln!(out, "{} {} {}", decimal(v.x), decimal(v.y), decimal(v.z))?;
    }
    writeln!(out, "\n# FACE LIST:\n{}", wireframe.triangles().len())?;
    for [a, b, c] in wireframe.triangles() {
        writeln!(out, "{a} {b} {c}")?;
    }
    writeln!(out, "\n# ANIMATION UNITS LIST:\n{}\n", wireframe.action_units().len())?;
    wireframe.action_units().iter().try_for_each(|unit| write_unit(out, unit))?;
    writeln!(out, "# SHAPE UNITS LIST:\n{}\n", wireframe.shape_units().len())?;
    wireframe.shape_units().iter().try_for_each(|unit| write_unit(out, unit))?;
    for heading in ["ANIMATION PARAMETERS:", "SHAPE PARAMETERS:", "TEXTURE:"] {
        writeln!(out, "# {heading}\n0\n")?;
    }
    writeln!(out, "# GLOBAL MOTION:")?;
    for value in [0.0, 1.0, 0.0].map(decimal) {
        writeln!(out, "{value} {value} {value}")?;
    }
    writeln!(out, "\n# END OF FILE")
}

fn write_unit(out: &mut String, unit: &MotionUnit) -> fmt::Result {
    let name = ascii(&unit.name);
    match unit.kind {
        UnitKind::Action { number } => writeln!(out, "# AUV{number} {name}")?,
        UnitKind::Fap { number, .. } if number < 10 => writeln!(out, "# FAP {number} {name}")?,
        UnitKind::Fap { number, .. } => writeln!(out, "# FAP{number} {name}")?,
        UnitKind::Shape | UnitKind::Other => writeln!(out, "# {name}")?,
    }
    if let UnitKind::Fap { fapu: Some(fapu), .. } = unit.kind {
        writeln!(out, "# {fapu}")?;
    }
    writeln!(out, "{}", unit.offsets.len())?;
    for (node, d) in &unit.offsets {
        writeln!(out, "{node} {} {} {}", decimal(d.x), decimal(d.y), decimal(d.z))?;
    }
    writeln!(out)
}

/// Formats a number with six decimals; zero has no sign.
fn decimal(value: f64) -> String {
    let text = format!("{value:.6}");
    if text == "-0.000000" { "0.000000".to_owned() } else { text }
}

/// Replaces all characters other than printable ASCII by `?`.
fn ascii(name: &str) -> String {
    name.chars().map(|c| if c == ' ' || c.is_ascii_graphic() { c } else { '?' }).collect()
}

#[cfg(test)]
#[path = "wfm_tests.rs"]
#[allow(clippy::float_cmp, clippy::format_collect)]
mod tests;
