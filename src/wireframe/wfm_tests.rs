//! Tests of the `.wfm` reader and writer.

use std::sync::LazyLock;

use proptest::prelude::*;

use super::*;

/// A triangle with one unit of each kind.
const SMALL: &str = "\
# VERTEX LIST:
3
0 0 0
1 0 -0
0 1.5 0.25

# FACE LIST:
1
0 1 2

# ANIMATION UNITS LIST:
3

# AUV2 Lip stretcher (AU20)
1
1 0.1 0 0

# FAP 6 stretch_l_cornerlip
# MW
1
1 1 0 0

# blink
1
2 0 -1 0

# FAPs not implemented:
# FAP 1 viseme

# SHAPE UNITS LIST:
1

# Mouth width
2
0 -0.5 0 0
1 0.5 0 0
";

static CANDIDE3: LazyLock<String> = LazyLock::new(|| write_wfm(&Wireframe::candide3()));

fn names(units: &[MotionUnit]) -> Vec<(&str, UnitKind)> {
    units.iter().map(|u| (u.name.as_str(), u.kind.clone())).collect()
}

fn message(text: &str) -> String {
    parse(text.as_bytes()).unwrap_err().to_string()
}

#[test]
fn a_small_file_reads_with_names_and_kinds() {
    let w = parse(SMALL.as_bytes()).unwrap();
    assert_eq!(w.vertices()[2], Point3::new(0.0, 1.5, 0.25));
    assert_eq!(w.triangles(), [[NodeId(0), NodeId(1), NodeId(2)]]);
    assert_eq!(
        names(w.action_units()),
        [
            ("Lip stretcher (AU20)", UnitKind::Action { number: 2 }),
            ("stretch_l_cornerlip", UnitKind::Fap { number: 6, fapu: Some(Fapu::Mw) }),
            ("blink", UnitKind::Other),
        ]
    );
    // The list of missing FAPs above section 4 is not the name of a unit.
    assert_eq!(names(w.shape_units()), [("Mouth width", UnitKind::Shape)]);
    assert_eq!(w.shape_units()[0].offsets[1], (NodeId(1), Vector3::new(0.5, 0.0, 0.0)));
}

#[test]
fn the_embedded_candide3_survives_writing_and_reading() {
    let w = Wireframe::candide3();
    assert_eq!(parse(CANDIDE3.as_bytes()).unwrap(), w);
    assert!(CANDIDE3.is_ascii());
    assert!(CANDIDE3.contains("\n# AUV14 Lip corner depressor (AU13/15)\n"));
    assert!(CANDIDE3.contains("\n# FAP 3 open_jaw\n# MNS\n3\n10 0.000000 -1.000000 0.000000\n"));
    assert!(CANDIDE3.contains("\n# FAP23 yaw_l_eyeball\n"));
    assert!(CANDIDE3.ends_with("0.000000 0.000000 0.000000\n\n# END OF FILE\n"));
    assert!(!CANDIDE3.contains("-0.000000"));
}

#[test]
fn line_ends_tabs_comments_and_missing_headings_do_not_matter() {
    let expected = parse(SMALL.as_bytes()).unwrap();
    let crlf = SMALL.replace('\n', "\r\n").replace("1 0.1 0 0", "\t1\t0.1   0 0  # here ");
    let slashes = SMALL.replace("# ", "//");
    let mut latin1 = b"# Jonas \xC5hlberg, Link\xF6ping\n".to_vec();
    latin1.extend_from_slice(SMALL.trim_end().as_bytes());
    for bytes in [crlf.as_bytes(), slashes.as_bytes(), latin1.as_slice(), format!("\u{FEFF}{SMALL}").as_bytes()] {
        assert_eq!(parse(bytes).unwrap(), expected);
    }
    let bare: String = SMALL.lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect();
    let bare = parse(bare.as_bytes()).unwrap();
    assert_eq!(bare.vertices(), expected.vertices());
    assert_eq!(names(bare.action_units())[1], ("animation unit 1", UnitKind::Other));
    assert_eq!(names(bare.shape_units())[0], ("shape unit 0", UnitKind::Shape));
}

#[test]
fn derivative_files_read_up_to_the_shape_units() {
    // Bare values instead of counted parameters, texture coordinates without a count, no global motion.
    let tail = "# ANIMATION PARAMETERS:\n0.0\n0.1\n# TEXTURE:\n0.5 0.5\nface.bmp\n";
    let expected = parse(SMALL.as_bytes()).unwrap();
    assert_eq!(parse(format!("{SMALL}{tail}").as_bytes()).unwrap(), expected);
    // The same vertex twice in a unit: both contributions are kept, and add up where the unit is applied.
    let twice = SMALL.replace("# Mouth width\n2\n0 -0.5", "# Mouth width\n3\n1 0.25 0 0\n0 -0.5");
    let twice = parse(twice.as_bytes()).unwrap();
    let offsets = &twice.shape_units()[0].offsets;
    assert_eq!(offsets.iter().filter(|(n, _)| *n == NodeId(1)).map(|(_, d)| d.x).sum::<f64>(), 0.75);
}

#[test]
fn misspellings_and_spacing_in_names_are_corrected() {
    let text = SMALL
        .replace("# AUV2 Lip stretcher (AU20)", "#   auv 2   Lip  strecher (AU20) ")
        .replace("# FAP 6 stretch_l_cornerlip", "# FAP6: strecth_l_cornerlip")
        .replace("# Mouth width", "## Motuh width ##");
    let w = parse(text.as_bytes()).unwrap();
    let expected = parse(SMALL.as_bytes()).unwrap();
    assert_eq!(names(w.action_units()), names(expected.action_units()));
    assert_eq!(names(w.shape_units()), names(expected.shape_units()));
}

#[test]
fn a_cut_file_says_where_and_what_is_missing() {
    let cut = |lines: usize| SMALL.lines().take(lines).map(|l| format!("{l}\n")).collect::<String>();
    assert_eq!(
        message(&cut(4)),
        "line 4, vertex list: the file ends where vertex 2 of 3, `x y z` was expected; it is truncated or a count is too large"
    );
    assert!(message(&cut(6)).contains("face list: the file ends where the number of triangles"));
    assert!(message(&cut(13)).contains("animation units list: the file ends where the number of vertices of unit 0 of 3"));
    let last = SMALL.lines().count() - 1;
    assert!(message(&cut(last)).contains("`vertex dx dy dz` (1 of 2) of unit 0 of 1, `Mouth width`, was expected"));
    assert!(message("").contains("vertex list: the file ends where the number of vertices, at most 65535, was expected"));
    // Cut within a line: the last line lacks fields.
    assert!(message("1\n0.5 0.").contains("line 2, vertex list: found `0.5 0.` where vertex 0 of 1"));
}

#[test]
fn wrong_lines_are_named_with_what_was_expected() {
    let change = |from: &str, to: &str| message(&SMALL.replacen(from, to, 1));
    assert_eq!(change("0 1 2", "0 1 3"), "line 9, face list: found `3` where a vertex number, 0 to 2, was expected");
    assert!(change("0 1 2", "0 -1 2").contains("found `-1`"));
    assert!(change("1 0 -0", "1 nan 0").contains("line 4, vertex list: found `nan` where a finite number was expected"));
    assert!(change("1 0 -0", "1 0").contains("found `1 0` where vertex 1 of 3"));
    assert!(change("2 0 -1 0", "7 0 -1 0").contains("animation units list: found `7`"));
    assert!(change("\n3\n", "\n3.5\n").contains("found `3.5` where the number of vertices, at most 65535, was expected"));
    assert!(change("\n1\n0 1 2", "\n0").contains("no triangles"));
    assert!(message("\u{0}\u{1}PNG").contains("line 1, vertex list: found `\\u{0}\\u{1}PNG`"));
}

#[test]
fn huge_counts_cost_no_memory() {
    assert!(message("4000000000\n0 0 0\n").contains("at most 65535"));
    let huge = usize::MAX.to_string();
    assert!(message(&SMALL.replacen("\n1\n0 1 2", &format!("\n{huge}\n0 1 2"), 1)).contains("found `3`"));
    let cut = format!("1\n0 0 0\n{huge}\n0 0 0\n");
    assert!(message(&cut).contains(&format!("triangle 1 of {huge}")));
    assert!(message("99999999999999999999999\n").contains("found `99999999999999999999999`"));
}

#[test]
fn the_error_names_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wfm");
    let missing = read_wfm(&path).unwrap_err().to_string();
    assert!(missing.contains("a.wfm: cannot be read"), "{missing}");
    std::fs::write(&path, "3\n").unwrap();
    assert!(read_wfm(&path).unwrap_err().to_string().contains("a.wfm: line 1, vertex list"));
    std::fs::write(&path, &*CANDIDE3).unwrap();
    assert_eq!(read_wfm(&path).unwrap(), Wireframe::candide3());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn a_truncated_file_never_panics(length in 0_usize..100_000) {
        let bytes = CANDIDE3.as_bytes();
        let _ = parse(&bytes[..length.min(bytes.len())]);
    }

    #[test]
    fn a_cut_before_the_end_of_the_shape_units_is_an_error(share in 0.0..0.999_f64) {
        // The last row of the last shape unit ends where section 5 starts; a cut at the end of a line leaves all lines complete.
        let end = CANDIDE3.find("# ANIMATION PARAMETERS").unwrap();
        let lines: Vec<&str> = CANDIDE3[..end].trim_end().split_inclusive('\n').collect();
        let kept = (lines.len() as f64 * share) as usize;
        prop_assert!(parse(lines[..kept].concat().as_bytes()).is_err());
    }

    #[test]
    fn a_mutated_file_never_panics(changes in proptest::collection::vec((0_usize..SMALL.len(), any::<u8>()), 1..12)) {
        let mut bytes = SMALL.as_bytes().to_vec();
        for (place, byte) in changes {
            bytes[place] = byte;
        }
        let _ = parse(&bytes);
    }

    #[test]
    fn written_files_read_back_unchanged(
        coordinates in proptest::collection::vec((-2_000_000_i32..2_000_000, -9_i32..9), 3..40),
    ) {
        // Millionths are written exactly.
        let micro = |k: i32| f64::from(k) / 1e6;
        let vertices: Vec<_> = coordinates.iter().map(|&(a, b)| Point3::new(micro(a), micro(b), micro(a - b))).collect();
        let offsets = coordinates.iter().map(|&(a, b)| (NodeId(b.unsigned_abs() as u16 % 3), Vector3::repeat(micro(a)))).collect();
        let kind = UnitKind::Fap { number: 3, fapu: Some(Fapu::Mns) };
        let unit = MotionUnit { name: "open_jaw".to_owned(), kind, offsets };
        let w = Wireframe::new(vertices, vec![[NodeId(2), NodeId(0), NodeId(1)]], vec![unit], vec![]).unwrap();
        prop_assert_eq!(parse(write_wfm(&w).as_bytes()).unwrap(), w);
    }
}
