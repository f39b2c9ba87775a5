//! Checks FAP files: reports everything the reader notes, and values that the standard or a reader treats differently.

use super::{
    catalog::{Directionality, FapCatalog, FapNumber},
    finding::{Finding, Findings, Rule, Severity},
    parser::{ParsedFap, parse_fap},
    sequence::{FapFrame, FapSequence},
};

/// Checks the bytes of a FAP file against the strict subset that every known reader accepts.
///
/// Findings are sorted by line. An error means that the file cannot be read; a warning means that some reader interprets it
/// differently than intended. The rules about values are checked on all readable frames, whatever other errors there are.
///
/// ```
/// use grimace::fap::{Severity, check_fap};
///
/// let has_errors = |bytes: &[u8]| check_fap(bytes).iter().any(|finding| finding.severity == Severity::Error);
/// assert!(!has_errors(&std::fs::read("fixtures/golden/fap/happiness.fap")?));
/// assert!(has_errors(b"not a FAP file\n"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check_fap(bytes: &[u8]) -> Vec<Finding> {
    let ParsedFap { frames, findings: mut all, .. } = parse_fap(bytes);
    let mut findings = Findings::default();
    let catalog = FapCatalog::mpeg4();
    for (line, frame) in &frames {
        ranges(&mut findings, catalog, *line, frame);
    }
    lips(&mut findings, catalog, &frames);
    all.extend(findings.into_sorted());
    all.sort_by_key(|finding| finding.line);
    all
}

/// Finds the FAPs of a sequence that exceed the range of the standard in some frame: one finding for each, with the index of its
/// first such frame, from 0, as the line.
pub fn beyond_range(sequence: &FapSequence) -> Vec<Finding> {
    let mut findings = Findings::default();
    for (index, frame) in sequence.frames.iter().enumerate() {
        ranges(&mut findings, FapCatalog::mpeg4(), index, frame);
    }
    findings.into_sorted()
}

/// Checks values against the range of the standard.
fn ranges(findings: &mut Findings, catalog: &FapCatalog, line: usize, frame: &FapFrame) {
    for row in catalog.rows() {
        let field = || format!("FAP {}", row.number);
        let fields = frame.fields(row.number).unwrap_or_default();
        for (field_row, &value) in catalog.fields(row.number).zip(fields) {
            let (min, max) = field_row.range;
            if !(min..=max).contains(&value) {
                let message = || format!("{} is {value}; the standard allows {min} to {max}", field_row.name);
                findings.warning(line, field(), Rule::Range, message);
                // One finding per frame, for any number of its fields.
                break;
            }
        }
        let (Some(value), Some((min, max))) = (frame.value(row.number), row.range) else { continue };
        if value < 0.0 && row.directionality == Some(Directionality::Unidirectional) {
            let message = || format!("{} is {value}; it moves in one direction only and must be 0 or more", row.name);
            findings.warning(line, field(), Rule::Unidirectional, message);
        } else if !(f64::from(min)..=f64::from(max)).contains(&value) {
            let message = || format!("{} is {value}; the standard allows {min} to {max}", row.name);
            findings.warning(line, field(), Rule::Range, message);
        }
    }
}

/// Finds lip FAPs that do not move while their twin on the other contour moves: one reader overwrites them with the twin's
/// values.
fn lips(findings: &mut Findings, catalog: &FapCatalog, frames: &[(usize, FapFrame)]) {
    let first_moving = |fap: FapNumber| frames.iter().find(|(_, frame)| frame.value(fap).is_some_and(|v| v != 0.0));
    for &(inner, outer) in catalog.lip_twins() {
        let (line, moving, still) = match (first_moving(inner), first_moving(outer)) {
            (Some((line, _)), None) => (*line, inner, outer),
            (None, Some((line, _))) => (*line, outer, inner),
            _ => continue,
        };
        let message = || format!("0 or unset in all frames while FAP {moving} moves; Xface copies that FAP: write both lips");
        findings.warning(line, format!("FAP {still}"), Rule::LipsMirrored, message);
    }
}

/// Finds lip FAPs that are 0 or unset in single frames in which their twin on the other contour is not: Xface shows the twin's
/// value there.
///
/// Files of the strict subset have such frames whenever one contour moves and the other does not; they are warnings, never
/// errors.
pub fn check_lips(bytes: &[u8]) -> Vec<Finding> {
    let ParsedFap { frames, .. } = parse_fap(bytes);
    let moves = |fap: FapNumber| frames.iter().any(|(_, frame)| frame.value(fap).is_some_and(|v| v != 0.0));
    let mut found = Vec::new();
    for &(inner, outer) in FapCatalog::mpeg4().lip_twins() {
        // If one of them never moves, `check_fap` reports it.
        if !moves(inner) || !moves(outer) {
            continue;
        }
        for (still, moving) in [(inner, outer), (outer, inner)] {
            let overwritten = |frame: &FapFrame| {
                let value = frame.value(moving).filter(|&v| v != 0.0)?;
                (frame.value(still).unwrap_or(0.0) == 0.0).then_some(value)
            };
            let there: Vec<(usize, f64)> = frames.iter().filter_map(|(line, frame)| Some((*line, overwritten(frame)?))).collect();
            let Some(&(line, _)) = there.first() else { continue };
            let largest = there.iter().map(|(_, v)| *v).fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
            let message = format!(
                "FAP {still} is 0 where FAP {moving} is not (at most {largest}); Xface shows the other's value: \
                 `fap convert --profile xface` keeps it"
            );
            let (field, times) = (format!("FAP {still}"), there.len());
            found.push(Finding { line, field, rule: Rule::LipAtRest, severity: Severity::Warning, message, times });
        }
    }
    found.sort_by_key(|finding| finding.line);
    found
}

#[cfg(test)]
mod tests {
    use super::{super::writer::fap_text, *};
    use crate::fap::{FapSequence, Profile, ValueFormat};

    fn fap(number: u8) -> FapNumber {
        FapNumber::try_from(number).unwrap()
    }

    fn check(frames: &[&[(u8, f64)]]) -> Vec<(usize, String, Rule, usize)> {
        let frame = |values: &&[(u8, f64)]| {
            let mut frame = FapFrame::default();
            values.iter().for_each(|&(n, v)| frame.set_value(fap(n), Some(v)));
            frame
        };
        let frames = frames.iter().map(frame).collect();
        let sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames };
        let text = fap_text(&sequence, Profile::Strict, ValueFormat::Integer).unwrap();
        check_fap(text.as_bytes()).into_iter().map(|f| (f.line, f.field, f.rule, f.times)).collect()
    }

    #[test]
    fn frames_are_counted_and_not_their_fields() {
        let mut frame = FapFrame::default();
        frame.set_fields(fap(1), Some(vec![99, 99, 0, 0]));
        let sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames: vec![frame; 3] };
        let found: Vec<_> = beyond_range(&sequence).into_iter().map(|f| (f.line, f.field, f.times)).collect();
        assert_eq!(found, [(0, "FAP 1".to_owned(), 3)]);
    }

    #[test]
    fn values_within_range_pass_at_their_limits() {
        assert_eq!(check(&[&[(3, 0.0), (31, -1800.0)], &[(3, 4320.0), (31, 1800.0)]]), []);
    }

    #[test]
    fn frames_beyond_the_range_are_named_by_their_number() {
        let frame = |value: f64| {
            let mut frame = FapFrame::default();
            frame.set_value(fap(3), Some(value));
            frame
        };
        let frames = [0.0, 4320.0, 5000.0, 6000.0, -7.0].map(frame).to_vec();
        let sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames };
        let found = beyond_range(&sequence);
        let said: Vec<_> = found.iter().map(|f| (f.line, f.field.as_str(), f.rule, f.times)).collect();
        assert_eq!(said, [(2, "FAP 3", Rule::Range, 2), (4, "FAP 3", Rule::Unidirectional, 1)]);
        assert_eq!(found[0].message, "open_jaw is 5000; the standard allows 0 to 4320");
    }

    #[test]
    fn ranges_and_directions_are_checked_by_fap() {
        let found = check(&[&[(3, -1.0), (31, 1801.0)], &[(3, -2.0), (31, 0.0)]]);
        assert_eq!(found, [(3, "FAP 3".into(), Rule::Unidirectional, 2), (3, "FAP 31".into(), Rule::Range, 1)]);
    }

    #[test]
    fn lips_that_one_reader_would_mirror_are_named_once() {
        // 51 moves from the second frame on (line 5); its twin 4 is unset. 52 and 5 both move at some time.
        let found = check(&[&[(5, 3.0), (51, 0.0), (52, 0.0)], &[(5, 0.0), (51, 9.0), (52, 4.0)]]);
        assert_eq!(found, [(5, "FAP 4".into(), Rule::LipsMirrored, 1)]);
    }

    #[test]
    fn a_lip_that_rests_for_a_frame_is_named_beside_its_moving_twin() {
        // 5 and 52 are twins: 5 is 0 in the second frame (line 5), where 52 is 4; both move at some time.
        let frames = [&[(5, 3.0), (52, 2.0)][..], &[(5, 0.0), (52, 4.0)], &[(5, 0.0), (52, -7.0)]];
        let frame = |values: &&[(u8, f64)]| {
            let mut frame = FapFrame::default();
            values.iter().for_each(|&(n, v)| frame.set_value(fap(n), Some(v)));
            frame
        };
        let frames = frames.iter().map(frame).collect();
        let mut sequence = FapSequence { version: "2.1".into(), name: "x".into(), fps: 25.0, frames };
        let text = |s: &FapSequence| fap_text(s, Profile::Xface, ValueFormat::Integer).unwrap();
        let found = check_lips(text(&sequence).as_bytes());
        assert_eq!(found.len(), 1);
        let Finding { line, ref field, rule, severity, ref message, times } = found[0];
        assert_eq!((line, field.as_str(), rule, severity, times), (5, "FAP 5", Rule::LipAtRest, Severity::Warning, 2));
        assert!(message.contains("at most -7"), "{message}");
        Profile::Xface.prepare(&mut sequence);
        assert_eq!(check_lips(text(&sequence).as_bytes()), []);
    }

    #[test]
    fn codes_out_of_range_are_found_though_another_line_is_broken() {
        let mask = format!("1 {}0\n", "0 ".repeat(66));
        let text = format!("2.1 x 25 2\n{mask}0 15 0 63 0\nnonsense\n");
        let rules: Vec<_> = check_fap(text.as_bytes()).into_iter().map(|f| (f.line, f.rule)).collect();
        assert!(rules.contains(&(3, Rule::Range)) && rules.contains(&(4, Rule::MaskCount)), "{rules:?}");
    }
}
