//! `grimace fap`: commands and their output.

use crate::common::Work;

/// Returns what `grimace fap ARGS` prints as JSON.
fn json(work: &Work, args: &str) -> serde_json::Value {
    serde_json::from_str(&work.grimace(args).stdout).unwrap()
}

/// Returns a mask line with the given FAPs set.
fn mask(faps: &[usize]) -> String {
    (1..=68).map(|n| if faps.contains(&n) { "1" } else { "0" }).collect::<Vec<_>>().join(" ")
}

/// Returns a file in the strict subset: FAPs 4, 31 and 51 over three frames, 25 frames per second.
fn strict() -> String {
    let m = mask(&[4, 31, 51]);
    format!("2.1 joy 25 3\n{m}\n0 0 0 0\n{m}\n1 10 -20 30\n{m}\n2 40 -60 80\n")
}

#[test]
fn info_prints_name_rate_duration_and_the_extremes_of_every_fap() {
    let work = Work::new();
    work.write("joy.fap", strict());
    let expected = "\
joy.fap: `joy`, version 2.1
  3 frames, 25 fps, 0.12 s
  3 FAPs set: 4,31,51
  FAP  name               unit      min  max  apex  frame
    4  lower_t_midlip     MNS/1024    0   40    40      2
   31  raise_l_i_eyebrow  ENS/1024  -60    0   -60      2
   51  lower_t_midlip_o   MNS/1024    0   80    80      2
";
    assert_eq!(work.grimace("fap info joy.fap").exit(0).stdout, expected);
}

#[test]
fn values_that_look_like_a_mask_are_values() {
    let work = Work::new();
    // FAP 1 with its four fields, and 63 other FAPs: 68 words, 0 or 1, in a neutral frame.
    let faps: Vec<usize> = std::iter::once(1).chain(3..=65).collect();
    let (mask, zeros) = (mask(&faps), ["0"; 67].join(" "));
    work.write("still.fap", format!("2.1 still 25 2\n{mask}\n0 {zeros}\n{mask}\n1 {zeros}\n"));
    work.grimace("fap info still.fap").exit(0);
    work.grimace("fap convert still.fap -o again.fap").exit(0);
    work.grimace("fap info again.fap").exit(0);
}

#[test]
fn info_gives_json_with_units_and_schema_version() {
    let work = Work::new();
    work.write("joy.fap", strict());
    let json = json(&work, "fap info --json joy.fap");
    assert_eq!(json["schema_version"], 1);
    assert!(json["units"].as_str().unwrap().contains("fps: 1/s"));
    let file = &json["files"][0];
    assert_eq!((&file["name"], &file["frames"], &file["seconds"]), (&"joy".into(), &3.into(), &0.12.into()));
    assert_eq!(file["faps"][1]["unit"], "ENS/1024");
    assert_eq!(file["faps"][1]["apex"], -60.0);
}

#[test]
fn info_reads_the_good_files_when_one_is_bad() {
    let work = Work::new();
    work.write("a.fap", strict()).write("b.fap", "nonsense\n").write("c.fap", strict());
    work.grimace("fap info a.fap b.fap c.fap")
        .exit(1)
        .prints(&["a.fap: `joy`", "c.fap: `joy`"])
        .says(&["b.fap:1: error header", "1 file could not be read"]);
    work.grimace("fap info missing.fap").exit(1).says(&["cannot read missing.fap"]);
}

#[test]
fn check_passes_the_strict_subset() {
    let work = Work::new();
    work.write("joy.fap", strict());
    assert_eq!(work.grimace("fap check --strict joy.fap").exit(0).stdout, "1 file checked: 0 errors, 0 warnings\n");
}

#[test]
fn check_names_line_severity_rule_and_field() {
    let work = Work::new();
    let m = mask(&[3]);
    work.write("a.fap", format!("2.1 a 25 2\n{m} 0\n0 -5\n{m} 0\n1 9.5\n"));
    let text = work.grimace("fap check a.fap").exit(0).stdout;
    let expected = [
        "a.fap:2: warning mask-count: mask: 69 flags; expected 68",
        "a.fap:3: warning unidirectional: FAP 3: open_jaw is -5;",
        "a.fap:5: warning integer: values: FAP 3 is `9.5`;",
        "1 file checked: 0 errors, 3 warnings",
    ];
    assert_eq!(text.lines().count(), expected.len());
    for (line, start) in text.lines().zip(expected) {
        assert!(line.starts_with(start), "{line}");
    }
    assert!(text.contains("other readers fail) (2 times)"), "{text}");
    work.grimace("fap check --strict a.fap").exit(1).prints(&["3 errors, 0 warnings"]);
    let json = json(&work, "fap check --json a.fap");
    assert_eq!((&json["schema_version"], &json["files"][0]["warnings"]), (&1.into(), &3.into()));
    assert_eq!(json["files"][0]["findings"][1]["rule"], "unidirectional");
    assert_eq!(json["files"][0]["findings"][1]["line"], 3);
}

#[test]
fn check_counts_over_files_and_fails_on_errors_only() {
    let work = Work::new();
    work.write("good.fap", strict()).write("crlf.fap", strict().replace('\n', "\r\n")).write("bad.fap", "");
    work.grimace("fap check good.fap crlf.fap").exit(0).prints(&["2 files checked: 0 errors, 1 warning\n"]);
    work.grimace("fap check good.fap bad.fap gone.fap")
        .exit(1)
        .prints(&["bad.fap:1: error header: header: the file has no header"])
        .prints(&["gone.fap: error: cannot be read"])
        .prints(&["3 files checked: 2 errors, 0 warnings"])
        .says(&["2 files did not pass"]);
}

/// Files of known tools are read with a warning that names the violated rule, and are written in the strict subset.
#[test]
fn files_of_known_tools_are_read() {
    let m = mask(&[4, 31, 51]);
    let compound = mask(&[1, 2, 4, 31, 51]);
    let one = |from: &str, to: &str| strict().replacen(from, to, 1);
    let from_1 = one("\n2 40", "\n3 40").replacen("\n1 10", "\n2 10", 1).replacen("\n0 0 0 0", "\n1 0 0 0", 1);
    let cases = [
        ("69 flags", strict().replace(&m, &format!("{m} 0")), "mask-count"),
        ("float values", one(" 10 ", " 10.25 "), "integer"),
        ("CRLF", strict().replace('\n', "\r\n"), "line-ending"),
        ("tabs", one("\n1 10", "\n1\t10"), "tab"),
        ("trailing blanks", one(" 80\n", " 80 \n"), "trailing-blank"),
        ("a comment before the header", format!("# visage\n{}", strict()), "comment"),
        ("a comment between frames", one("\n0 0 0 0\n", "\n0 0 0 0\n# next\n"), "comment"),
        ("a name with a blank", one("joy", "my joy"), "name"),
        ("first frame 1", from_1, "frame-order"),
        ("version 2.0", one("2.1 ", "2.0 "), "version"),
        ("version 2.2", one("2.1 ", "2.2 "), "version"),
        ("single FAPs 1 and 2", format!("2.1 x 25 1\n{compound}\n0 3 1 9 9 9\n"), "high-level"),
        ("full FAPs 1 and 2", format!("2.1 x 25 1\n{compound}\n0 1 2 63 0 1 63 0 0 0 1 9 9 9\n"), "high-level"),
        ("streaming", one("25 3", "25 10000"), "frame-count"),
        ("no final newline", strict().trim_end().to_owned(), "final-newline"),
    ];
    for (case, text, rule) in cases {
        let work = Work::new();
        work.write("a.fap", text);
        work.grimace("fap check a.fap").exit(0).prints(&[&format!("warning {rule}: ")]);
        work.grimace("fap info a.fap").exit(0).prints(&["tolerated"]);
        work.grimace("fap convert a.fap -o strict.fap").exit(0);
        assert_eq!(
            work.grimace("fap check --strict strict.fap").exit(0).stdout,
            "1 file checked: 0 errors, 0 warnings\n",
            "{case}"
        );
    }
}

/// Files that no known tool writes are refused with line and rule, and nothing is written.
#[test]
fn files_that_no_tool_writes_are_refused_with_line_and_rule() {
    let m = mask(&[4, 31, 51]);
    let one = |from: &str, to: &str| strict().replacen(from, to, 1);
    let cases = [
        ("a 69th flag that is 1", one(&m, &format!("{m} 1")), 2, "mask-count"),
        ("67 flags", one(&m, &m[2..]), 2, "mask-count"),
        ("70 flags", one(&m, &format!("{m} 0 0")), 2, "mask-count"),
        ("a flag 2", one(&m, &m.replacen('0', "2", 1)), 2, "mask-flag"),
        ("too few values", one("\n1 10 -20 30", "\n1 10 -20"), 5, "value-count"),
        ("too many values", one("\n1 10 -20 30", "\n1 10 -20 30 4"), 5, "value-count"),
        ("a word", one("-20", "low"), 5, "not-numeric"),
        ("a decimal comma", one("-20", "-2,0"), 5, "not-numeric"),
        ("NaN", one("-20", "NaN"), 5, "not-finite"),
        ("infinity", one("-20", "inf"), 5, "not-finite"),
        ("a frame left out", one("\n2 40", "\n3 40"), 7, "frame-order"),
        ("a frame twice", one("\n2 40", "\n1 40"), 7, "frame-order"),
        ("a first frame 2", one("\n0 0 0 0", "\n2 0 0 0"), 3, "frame-order"),
        ("a missing line of values", one("\n1 10 -20 30", ""), 5, "frame-lines"),
        ("a cut file", one("\n2 40 -60 80\n", "\n"), 6, "frame-lines"),
        ("fewer frames than announced", one("25 3", "25 30"), 1, "frame-count"),
        ("more frames than announced", one("25 3", "25 2"), 1, "frame-count"),
        ("a huge number of frames", one("25 3", "25 18446744073709551615"), 1, "frame-count"),
        ("version 3", one("2.1", "3"), 1, "version"),
        ("no name", one("2.1 joy 25 3", "2.1 25 3"), 1, "header"),
        ("a frame rate of 0", one(" 25 ", " 0 "), 1, "fps-integer"),
        ("lines that end with CR", strict().replace('\n', "\r"), 1, "line-ending"),
        ("an empty file", String::new(), 1, "header"),
    ];
    for (case, text, line, rule) in cases {
        let work = Work::new();
        work.write("a.fap", text);
        let named = format!("a.fap:{line}: error {rule}: ");
        work.grimace("fap check a.fap").exit(1).prints(&[named.as_str()]);
        work.grimace("fap info a.fap").exit(1).says(&[named.as_str()]);
        work.grimace("fap convert a.fap -o b.fap").exit(1).says(&[named.as_str()]);
        assert!(!work.path("b.fap").exists(), "{case}");
    }
}

#[test]
fn convert_of_a_strict_file_is_identity() {
    let work = Work::new();
    work.write("joy.fap", strict());
    work.grimace("fap convert joy.fap -o copy.fap").exit(0).only_says("");
    assert_eq!(work.read("copy.fap"), strict());
}

#[test]
fn convert_reports_values_outside_the_range_of_the_standard() {
    let work = Work::new();
    work.write("big.csv", "frame,fap,name,value\n0,3,open_jaw,0\n1,3,open_jaw,9000\n2,3,open_jaw,4000\n");
    let said = "warning: FAP 3 in frame 1: open_jaw is 9000; the standard allows 0 to 4320; the value is written unchanged";
    work.grimace("fap convert big.csv --fps 25 -o big.fap").exit(0).says(&[said]);
    assert!(work.read("big.fap").contains("\n1 9000\n"));
    work.grimace("fap check --strict big.fap").exit(1);
    // The same when writing a table.
    work.grimace("fap convert big.fap -o again.csv").exit(0).says(&[said]);
    assert!(work.read("again.csv").contains("1,3,open_jaw,9000\n"));
}

#[test]
fn convert_refuses_to_overwrite_without_force() {
    let work = Work::new();
    work.write("joy.fap", strict()).write("out.fap", "mine");
    work.grimace("fap convert joy.fap -o out.fap").exit(1).says(&["out.fap exists; give --force"]);
    assert_eq!(work.read("out.fap"), "mine");
    work.grimace("fap convert joy.fap -o out.fap --force").exit(0);
    work.grimace("fap convert joy.fap -o joy.fap --force --fps 50").exit(0);
    assert!(work.read("joy.fap").starts_with("2.1 joy 50 6\n"));
}

#[test]
fn convert_keeps_the_duration_or_the_frames_at_another_rate() {
    let work = Work::new();
    work.write("joy.fap", strict());
    work.grimace("fap convert joy.fap --fps 50 -o fast.fap").exit(0);
    let fast = work.read("fast.fap");
    assert!(fast.starts_with("2.1 joy 50 6\n"), "{fast}");
    // The duration is 0.12 s as before. Former frames are kept: frame 1 becomes frame 2, and frame 2 becomes frame 4 and holds.
    assert!(fast.contains("\n2 10 -20 30\n") && fast.contains("\n4 40 -60 80\n") && fast.ends_with("\n5 40 -60 80\n"), "{fast}");
    work.grimace("fap convert joy.fap --fps 50 --keep-frames -o same.fap").exit(0);
    assert_eq!(work.read("same.fap"), strict().replace("joy 25", "joy 50"));
}

#[test]
fn a_fap_that_a_frame_leaves_out_is_interpolated_at_any_rate() {
    let work = Work::new();
    // The second of three frames sets no FAP.
    let (some, none) = (mask(&[4]), mask(&[]));
    work.write("gap.fap", format!("2.1 joy 25 3\n{some}\n0 90\n{none}\n1\n{some}\n2 30\n"));
    // The file itself is shown as it is.
    let info = json(&work, "fap info gap.fap --json");
    assert_eq!(info["files"][0]["faps"][0]["min"], 30.0, "{info}");
    work.grimace("fap check gap.fap").exit(0).prints(&["mask-varies"]);
    work.grimace("fap convert gap.fap --fps 50 -o once.fap")
        .exit(0)
        .says(&["interpolated 1 value in frames that leave a FAP out"]);
    work.grimace("fap convert gap.fap -o filled.fap").exit(0);
    assert_eq!(work.read("filled.fap"), format!("2.1 joy 25 3\n{some}\n0 90\n{some}\n1 60\n{some}\n2 30\n"));
    work.grimace("fap convert filled.fap --fps 50 -o twice.fap").exit(0);
    assert_eq!(work.read("once.fap"), work.read("twice.fap"));
    assert!(work.read("once.fap").contains("\n1 75\n"), "{}", work.read("once.fap"));
    // `-` means standard output.
    assert_eq!(work.grimace("fap convert gap.fap --fps 50 -o -").exit(0).stdout, work.read("once.fap"));
    assert!(!work.path("-").exists());
}

#[test]
fn a_byte_order_mark_is_tolerated_and_a_rate_of_0_is_not() {
    let work = Work::new();
    work.write("bom.fap", format!("\u{feff}{}", strict())).write("still.fap", strict().replace(" 25 ", " 0 "));
    work.grimace("fap check bom.fap").exit(0).prints(&["bom.fap:1: warning byte-order-mark"]);
    work.grimace("fap convert bom.fap -o plain.fap").exit(0);
    assert_eq!(work.read("plain.fap"), strict());
    work.grimace("fap check still.fap").exit(1).prints(&["`0` is not a frame rate; expected a positive number"]);
}

#[test]
fn convert_puts_frames_between_key_frames() {
    let work = Work::new();
    work.write("joy.fap", strict());
    work.grimace("fap convert joy.fap --between 5 --fps 30 -o all.fap").exit(0);
    let all = work.read("all.fap");
    assert!(all.starts_with("2.1 joy 30 13\n") && all.contains("\n6 10 -20 30\n") && all.ends_with("\n12 40 -60 80\n"), "{all}");
    work.grimace("fap convert joy.fap --between 999999999 -o b.fap").exit(1).says(&["more than 360000"]);
}

#[test]
fn convert_writes_the_faps_of_a_mask() {
    let work = Work::new();
    work.write("joy.fap", strict());
    work.grimace("fap convert joy.fap --mask 31-33 -o brows.fap").exit(0);
    assert!(work.read("brows.fap").ends_with(&format!("{}\n2 -60 0 0\n", mask(&[31, 32, 33]))));
    work.grimace("fap convert joy.fap --mask all -o all.fap").exit(0);
    assert!(work.read("all.fap").contains(&mask(&(3..=68).collect::<Vec<_>>())));
    work.grimace("fap convert joy.fap --mask 0-3 -o x.fap").exit(2).says(&["FAPs are numbered 1 to 68"]);
}

#[test]
fn convert_writes_files_for_each_reader() {
    let work = Work::new();
    let m = mask(&[1, 4, 51]);
    work.write("a.fap", format!("2.1 my joy 10 1\n{m}\n0 1 2 63 0 0 30.5\n"));
    work.grimace("fap convert a.fap -o strict.fap").exit(0).says(&["became `my_joy`", "FAPs 1 and 2", "rounded 1 value"]);
    assert_eq!(work.read("strict.fap"), format!("2.1 my_joy 10 1\n{}\n0 0 31\n", mask(&[4, 51])));
    // Xface: FAP 1 in full, decimal numbers, and the inner lip is not overwritten.
    work.grimace("fap convert a.fap --profile xface --values float -o xface.fap").exit(0);
    assert_eq!(work.read("xface.fap"), format!("2.1 my_joy 10 1\n{m}\n0 1 2 63 0 1 30.5\n"));
    work.grimace("fap convert a.fap --profile visage -o visage.fap").exit(0);
    assert_eq!(work.read("visage.fap"), format!("2.2 my_joy 10 1\n{m}\n0 1 2 63 0 0 31\n"));
    // Greta plays 25 frames per second.
    work.grimace("fap convert a.fap --profile greta -o greta.fap").exit(0).says(&["10 to 25 frames"]);
    assert!(work.read("greta.fap").starts_with("2.1 my_joy 25 1\n"));
    work.grimace("fap convert a.fap --profile greta --fps 30 -o x.fap").exit(1).says(&["needs 25"]);
    work.grimace("fap convert a.fap --values float -o x.fap").exit(1).says(&["allows integers only"]);
    work.grimace("fap convert a.fap --profile maya -o x.fap").exit(2).says(&["strict, xface, greta or visage"]);
    assert!(!work.path("x.fap").exists());
}

/// Returns the number of flags that Greta's C++ readers find in a mask line: they read one flag before each blank.
fn flags_between_blanks(line: &str) -> usize {
    line.matches(' ').count()
}

#[test]
fn files_for_greta_have_and_keep_a_blank_after_every_mask() {
    let work = Work::new();
    work.write("joy.fap", strict());
    work.grimace("fap convert joy.fap --profile greta -o greta.fap").exit(0);
    let greta = work.read("greta.fap");
    let masks: Vec<&str> = greta.lines().skip(1).step_by(2).collect();
    assert!(masks.iter().all(|line| flags_between_blanks(line) == 68 && line.ends_with("0 ")), "{greta}");
    assert_eq!(greta.replace(" \n", "\n"), strict());
    work.grimace("fap check --strict greta.fap").exit(0).prints(&["1 file checked: 0 errors"]);
    // A converted file keeps its profile; it is written for all readers only on request.
    work.grimace("fap convert greta.fap -o again.fap").exit(0).says(&["written for Greta"]);
    assert_eq!(work.read("again.fap"), greta);
    work.grimace("fap convert greta.fap --profile strict -o strict.fap").exit(0);
    assert_eq!(work.read("strict.fap"), strict());
    work.grimace("fap convert greta.fap --fps 50 -o fast.fap").exit(0);
    assert!(work.read("fast.fap").starts_with("2.1 joy 50 6\n") && !work.read("fast.fap").contains(" \n"));
    // Another blank is still a violation.
    work.write("blank.fap", strict().replace("joy 25 3\n", "joy 25 3 \n"));
    work.grimace("fap check blank.fap").exit(0).prints(&["trailing-blank"]);
}

#[test]
fn lips_that_xface_shows_differently_are_reported_by_the_strict_check() {
    let work = Work::new();
    let m = mask(&[4, 51]);
    work.write("lips.fap", format!("2.1 joy 25 3\n{m}\n0 5 10\n{m}\n1 0 20\n{m}\n2 0 30\n"));
    work.grimace("fap check lips.fap").exit(0).only_prints("1 file checked: 0 errors, 0 warnings\n");
    let strict = work.grimace("fap check --strict lips.fap").exit(0);
    strict.prints(&["lips.fap:5: warning lip-at-rest: FAP 4", "at most 30", "(2 times)"]);
    work.grimace("fap convert lips.fap --profile xface -o xface.fap").exit(0);
    work.grimace("fap check --strict xface.fap").exit(0).only_prints("1 file checked: 0 errors, 0 warnings\n");
}

#[test]
fn a_file_without_faps_survives_conversion_to_csv_and_back() {
    let work = Work::new();
    let m = mask(&[]);
    let nothing = format!("2.1 nothing 25 2\n{m}\n0\n{m}\n1\n");
    work.write("nothing.fap", &nothing);
    work.grimace("fap convert nothing.fap -o same.fap").exit(0);
    assert_eq!(work.read("same.fap"), nothing);
    work.grimace("fap convert nothing.fap -o nothing.csv").exit(0);
    assert_eq!(work.read("nothing.csv"), "frame,fap,name,value\n1,,,\n");
    work.grimace("fap convert nothing.csv -o nothing.fap --force").exit(0);
    assert_eq!(work.read("nothing.fap"), nothing);
}

#[test]
fn info_and_check_count_alike() {
    let work = Work::new();
    // FAP 31 exceeds the limit of 1800 of the standard; lines end in CRLF.
    work.write("wide.fap", strict().replace("-60", "9000").replace('\n', "\r\n"));
    let checked = json(&work, "fap check --json wide.fap")["files"][0]["findings"].as_array().unwrap().len();
    assert_eq!(checked, 2);
    assert_eq!(json(&work, "fap info --json wide.fap")["files"][0]["findings"].as_array().unwrap().len(), checked);
    work.grimace("fap info wide.fap").exit(0).prints(&["2 deviations tolerated"]);
}

#[test]
fn conversion_to_csv_and_back_changes_nothing() {
    let work = Work::new();
    work.write("joy.fap", strict());
    work.grimace("fap convert joy.fap -o joy.csv").exit(0);
    let table = work.read("joy.csv");
    assert!(table.starts_with("frame,fap,name,value\n0,4,lower_t_midlip,0\n0,31,raise_l_i_eyebrow,0\n"), "{table}");
    assert_eq!(table.lines().count(), 1 + 3 * 3);
    work.grimace("fap convert joy.csv -o back.fap").exit(0);
    assert_eq!(work.read("back.fap"), strict());
    work.grimace("fap convert joy.csv --fps 30 -o rate.fap").exit(0);
    assert_eq!(work.read("rate.fap"), strict().replace("joy 25", "joy 30"));
    work.write("one.csv", "frame,fap,value\n1,3,0\n2,3,100\n");
    work.grimace("fap convert one.csv -o one.fap").exit(0).says(&["no row for frame 0"]);
    work.write("bad.csv", "frame,fap,name,value\n0,4,lower_t_midlip,NaN\n");
    work.grimace("fap convert bad.csv -o x.fap").exit(1).says(&["bad.csv:2: `NaN` is not a finite number"]);
    work.grimace("fap convert joy.fap --profile xface -o x.csv").exit(1).says(&["is for .fap files"]);
}

#[test]
fn convert_reports_an_output_that_cannot_be_written() {
    let work = Work::new();
    work.write("joy.fap", strict()).write("file", "");
    work.grimace("fap convert joy.fap -o file/out.fap").exit(1).says(&["cannot write file/out.fap"]);
    work.grimace("fap convert joy.fap -o new/folder/out.fap").exit(0);
    assert_eq!(work.read("new/folder/out.fap"), strict());
}

#[test]
fn every_help_has_an_example() {
    let work = Work::new();
    for command in ["fap --help", "fap info --help", "fap check --help", "fap convert --help"] {
        assert!(work.grimace(command).exit(0).stdout.contains("\n  grimace fap "), "{command}");
    }
    work.grimace("fap info").exit(2);
    work.grimace("fap convert joy.fap").exit(2).says(&["--output"]);
}
