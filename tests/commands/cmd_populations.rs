//! Landmark files as input, comparison of groups, and models in one file: commands and their output.

use crate::cmd_landmarks::{moved, own};
use crate::common::{Ran, Run, SEQUENCES, Work, assert_same_files};
use grimace::internal::{
    columnar::{ColumnarModels, ColumnarRow, ColumnarWriter},
    model::{DynamicExpressionModel, FrameExpressionModel},
    units::SequenceId,
};
use std::path::Path;

/// Writes a dataset of landmark files with subject, smile and metadata columns.
pub fn people(work: &Work, header: &str, rows: &[(&str, f64, &str)]) {
    let mut manifest = format!("subject,sequence,emotion,frames{header}\n");
    for (subject, smile, metadata) in rows {
        work.write(&format!("people/{subject}.csv"), own(&[(1, 0.0), (2, *smile)]));
        manifest += &format!("{subject},1,happiness,{subject}.csv{metadata}\n");
    }
    work.write("people/manifest.csv", manifest);
}

#[test]
fn groups_are_compared_in_all_tables_and_in_the_report() {
    let work = Work::new();
    let mut rows: Vec<(String, f64, &str)> = Vec::new();
    for k in 0..14 {
        rows.push((format!("a{k:02}"), 4.0 + 0.3 * f64::from(k), ",north"));
        rows.push((format!("b{k:02}"), 11.0 + 0.3 * f64::from(k), ",south"));
    }
    rows.push(("c00".to_owned(), 7.0, ",island"));
    rows.push(("d00".to_owned(), 7.0, ","));
    let rows: Vec<(&str, f64, &str)> = rows.iter().map(|(s, x, m)| (s.as_str(), *x, *m)).collect();
    people(&work, ",place", &rows);
    let ran = work.grimace("run people -o out --resample linear --by place --permutations 999 --bootstrap 200").exit(0);
    ran.prints(&[
        "not tested: happiness: island and north (a group of 1 is too small for a test)",
        "not compared with other groups",
    ]);
    let comparisons = work.rows("out/comparisons.csv");
    // Island, north, south: three pairs; `unknown` is not compared.
    assert_eq!(comparisons.len(), 3);
    let tested = comparisons.iter().find(|r| r["group_a"] == "north" && r["group_b"] == "south").unwrap();
    let number = |name: &str| tested[name].parse::<f64>().unwrap();
    assert_eq!((number("p"), number("p_holm")), (0.001, 0.001));
    assert!(number("effect") > 3.0 * number("effect_by_chance"));
    assert_eq!((tested["subjects_a"].as_str(), tested["exhaustive"].as_str()), ("14", "false"));
    let island = comparisons.iter().find(|r| r["group_a"] == "island").unwrap();
    assert_eq!((island["p"].as_str(), island["not_tested"].as_str()), ("", "a group of 1 is too small for a test"));
    // The corners of the mouth differ. The landmark of the chin moves in nobody; the chin differs only by what the springs
    // transfer.
    let nodes = work.rows("out/comparison_nodes.csv");
    let value = |node: &str, column: &str| nodes.iter().find(|r| r["node"] == node).unwrap()[column].parse::<f64>().unwrap();
    assert!(value("31", "p") <= 0.01 && value("64", "p") <= 0.01);
    assert!(value("31", "energy") > 100.0 * value("10", "energy").abs());
    let intervals = work.rows("out/intervals.csv");
    let all = intervals.iter().find(|r| r["group_place"].is_empty()).unwrap();
    let value = |name: &str| all[name].parse::<f64>().unwrap();
    // In the population people scatter more than around their own median: `low` may be above `dispersion`.
    assert!(0.0 < value("low") && value("low") < value("high") && value("dispersion") < value("high"));
    assert_eq!(intervals.iter().find(|r| r["group_place"] == "island").unwrap()["low"], "");
    let report = work.read("out/report.html");
    for text in ["is not “alike”", "A small group, fewer than 10 people", "Not tested: happiness: island and north", "unknown"]
    {
        assert!(report.contains(text), "{text}");
    }
    // The top of the report has the differences with the p that decides.
    let start = report.find("id=\"groups-conclusions\"").unwrap();
    let top = &report[start..start + report[start..].find("</section>").unwrap()];
    assert!(top.contains("happiness differs between north and south (energy distance"), "{top}");
    assert!(top.contains("happiness is stronger in south than in north: "), "{top}");
    for table in ["id=\"amplitudes-c\"", "id=\"omnibus-c\""] {
        assert!(report.contains(table), "{table}");
    }
    // The list of files has every table of groups, and no table of covariates, because none was requested.
    let files = report[report.find("<ul class=\"files\">").unwrap()..].split_once("</ul>").unwrap().0;
    for table in ["comparisons", "comparison_nodes", "group_tests", "amplitude_comparisons", "intervals"] {
        assert!(files.contains(&format!(">{table}.csv</a>")) && work.path(&format!("out/{table}.csv")).exists(), "{table}");
    }
    assert!(!files.contains("covariate"), "{files}");
    // No study is planned with more than 100,000 people.
    let amplitudes = work.rows("out/amplitude_comparisons.csv");
    let planned = amplitudes.iter().filter_map(|r| r["people_for_power"].parse::<usize>().ok());
    assert!(planned.max().is_some_and(|most| most <= 100_000));
    // Tests depend on the seed, not on the number of threads.
    work.grimace("analyze out/tracks -o one --resample linear --by place --permutations 999 --bootstrap 200 -j 1").exit(0);
    for file in ["comparisons.csv", "intervals.csv", "comparison_nodes.csv"] {
        assert_eq!(work.read(&format!("out/{file}")), work.read(&format!("one/{file}")), "{file}");
    }
    let other = "analyze out/tracks -o other --resample linear --by place --permutations 999 --bootstrap 200 --seed 2";
    work.grimace(other).exit(0);
    assert_ne!(work.read("out/intervals.csv"), work.read("other/intervals.csv"));
}

#[test]
fn groups_that_cannot_be_formed_or_tested_are_reported() {
    let work = Work::new();
    people(&work, ",place,note", &[("a", 5.0, ",north,"), ("b", 6.0, ",north,"), ("c", 7.0, ",south,"), ("d", 8.0, ",south,")]);
    work.grimace("run people -o out --by nation").exit(1).says(&["no sequence has a column `nation`", "note, place"]);
    work.grimace("run people -o out --by note").exit(1).says(&["column `note` is empty in all 4 sequences"]);
    let few = work.grimace("run people -o out --by place --bootstrap 2").exit(2);
    few.says(&["expected a whole number from 99 to 1000000, or 0 for no intervals"]);
    // Person c is in both groups.
    let manifest = work.read("people/manifest.csv") + "c,2,happiness,c.csv,north,\n";
    work.write("people/manifest.csv", manifest);
    work.grimace("run people -o out --by place --resample linear")
        .exit(0)
        .prints(&["c is in both groups; a test needs different people"]);
    assert_eq!(work.rows("out/comparisons.csv")[0]["not_tested"], "c is in both groups; a test needs different people");
    // Two against two can never reach 5 %: there are only 6 splits.
    work.grimace("analyze out/tracks/a_1.csv out/tracks/b_1.csv out/tracks/c_1.csv out/tracks/d_1.csv -o two --by place").exit(0);
    let row = work.rows("two/comparisons.csv").remove(0);
    assert_eq!((row["permutations"].as_str(), row["exhaustive"].as_str()), ("6", "true"));
    assert!(row["least_p"].parse::<f64>().unwrap() > 0.3);
    assert!(work.read("two/report.html").contains("cannot be shown to differ"));
    // Too many groups are refused at once, before anything is tracked.
    let rows: String = (0..1500).map(|k| format!("a,{k},happiness,a.csv,p{k},\n")).collect();
    work.write("people/manifest.csv", format!("subject,sequence,emotion,frames,place,note\n{rows}"));
    let many = work.grimace("run people -o many --by place --resample linear").exit(1);
    many.says(&["grouping by place makes 1501 classes", "more than 1000"]);
    assert!(!work.path("many").exists());
}

#[test]
fn designs_without_a_test_give_the_reason_and_no_table_has_a_nan() {
    let work = Work::new();
    let no_nan = |folder: &str| {
        for (name, bytes) in work.files(folder) {
            let text = String::from_utf8_lossy(&bytes).to_lowercase();
            let is_table = name.ends_with(".csv");
            assert!(!is_table || text.lines().all(|l| l.split(',').all(|f| !["nan", "inf", "-inf"].contains(&f))), "{name}");
        }
    };
    let reason = |folder: &str, table: &str| work.rows(&format!("{folder}/{table}.csv")).remove(0)["not_tested"].clone();
    // Group, site, age: sites coincide with groups, one age is missing, and one person is alone in a stratum.
    let rows: Vec<(String, f64, String)> = (0..12)
        .map(|k| {
            let (group, site) = if k < 6 { ("north", "here") } else { ("south", "there") };
            let age = if k == 3 { "" } else { "30" };
            (
                format!("p{k:02}"),
                4.0 + 0.5 * f64::from(k),
                format!(",{group},{site},{age},{}", if k == 0 { "alone" } else { "all" }),
            )
        })
        .collect();
    let rows: Vec<(&str, f64, &str)> = rows.iter().map(|(s, x, m)| (s.as_str(), *x, m.as_str())).collect();
    people(&work, ",place,site,age,one", &rows);
    let run = "run people --resample linear --by place --permutations 199 --bootstrap 99";
    for (folder, strata, expected) in [
        ("site", "site", "groups and strata coincide"),
        ("age", "age", "1 of the people have no value in `age`, for example p03"),
    ] {
        work.grimace(&format!("{run} -o {folder} --strata {strata}")).exit(0);
        for table in ["comparisons", "group_tests", "amplitude_comparisons"] {
            let why = reason(folder, table);
            assert!(why.contains(expected), "{table}: {why}");
        }
        no_nan(folder);
    }
    // A stratum of one person has nobody to exchange with, but does no harm.
    work.grimace(&format!("{run} -o one --strata one")).exit(0);
    assert_eq!(reason("one", "comparisons"), "");
    no_nan("one");
    work.grimace(&format!("{run} -o none --strata nation")).exit(1).says(&["no sequence has a column `nation`"]);
    // A single person; and people who all smile in the same way.
    people(&work, ",place", &[("a", 5.0, ",north")]);
    let alone = work.grimace("run people -o alone --resample linear").exit(0);
    alone.prints(&["no amplitudes, because there is only one person: happiness"]);
    assert_eq!(work.rows("alone/variation.csv")[0]["not_made"], "found 1 person; principal components need at least 3 people");
    assert!(
        work.rows("alone/amplitudes.csv").iter().all(|r| r["amplitude"].is_empty() && r["no_amplitude"].contains("one person"))
    );
    no_nan("alone");
    people(&work, ",place", &[("a", 5.0, ",n"), ("b", 5.0, ",n"), ("c", 5.0, ",s"), ("d", 5.0, ",s")]);
    work.grimace("run people -o equal --resample linear --by place").exit(0);
    let why = reason("equal", "amplitude_comparisons");
    assert!(why.starts_with("all amplitudes within each group are equal"), "{why}");
    assert_eq!(
        work.rows("equal/variation.csv")[0]["not_made"],
        "all sequences are equal; principal components need sequences that differ"
    );
    no_nan("equal");
}

#[test]
fn spellings_are_one_group_near_twins_are_named_and_people_count_once() {
    let work = Work::new();
    people(
        &work,
        ",gender",
        &[("a", 5.0, ",FEMALE"), ("b", 6.0, ",female"), ("c", 7.0, ", Female "), ("d", 8.0, ",male"), ("e", 9.0, ",femele")],
    );
    let manifest = work.read("people/manifest.csv");
    let more: String = (2..8).map(|k| format!("a,{k},Happiness,a.csv,FEMALE\n")).collect();
    work.write("people/manifest.csv", manifest + &more);
    let ran = work.grimace("run people -o out --resample linear --by gender").exit(0);
    ran.prints(&[
        "one may be misspelt or abbreviated; they are kept separate: gender female and femele",
        "every person has equal weight",
    ]);
    let statistics = work.rows("out/statistics.csv");
    let of = |gender: &str| statistics.iter().filter(|r| r["gender"].eq_ignore_ascii_case(gender)).collect::<Vec<_>>();
    assert_eq!(of("female").len(), 1);
    assert_eq!((of("female")[0]["sequences"].as_str(), of("female")[0]["subjects"].as_str()), ("9", "3"));
    assert_eq!(of("")[0]["weighting"], "person");
    for table in ["trimming", "verdicts", "amplitudes", "variation_scores"] {
        assert!(work.rows(&format!("out/{table}.csv")).iter().any(|r| r["id"] == "a_2"), "{table}");
    }
}

#[test]
fn different_words_for_one_emotion_stay_separate_and_are_reported_once() {
    let work = Work::new();
    let [one, other] = ["a", "b"].map(|name| (name, 5.0, ""));
    people(&work, "", &[one, other]);
    let manifest = work.read("people/manifest.csv");
    work.write("people/manifest.csv", manifest.clone() + "a,2,Joy,a.csv\na,3,surprise,a.csv\nb,3,surprised,b.csv\n");
    let said = "each is treated as a separate emotion: happiness and joy; surprise and surprised (if they mean the same, give them one label)";
    let ran = work.grimace("run people -o out --resample linear").exit(0).prints(&[said]);
    assert!(!ran.stdout.contains("misspelt"));
    assert_eq!(work.rows("out/statistics.csv").len(), 4);
}

#[test]
fn ages_used_as_groups_are_reported() {
    let work = Work::new();
    people(&work, ",age", &[("a", 5.0, ",23"), ("b", 6.0, ",31"), ("c", 7.0, ",45.5"), ("d", 8.0, ",23")]);
    let said = "each number forms its own group: `age` (3 numbers of 4 people); to test whether expressions change with numbers, use \
         --covariate; for groups of several people, add a column of classes, such as `age_group`";
    work.grimace("run people -o out --resample linear --by age").exit(0).prints(&[said]);
    let ran = work.grimace("analyze out/tracks -o again --resample linear --force").exit(0);
    assert!(!ran.stdout.contains("each number"));
}

#[test]
fn a_smile_that_grows_with_age_is_found_and_shown() {
    let work = Work::new();
    let ages =
        [(4.0, ",21,x"), (5.0, ",26,x"), (6.0, ",\"32,5\",y"), (7.0, ",38,y"), (8.0, ",41,x"), (9.0, ",60,y"), (30.0, ",NA,x")];
    let rows: Vec<(String, f64, &str)> =
        ages.into_iter().enumerate().map(|(k, (smile, age))| (format!("p{k}"), smile, age)).collect();
    people(&work, ",age,site", &rows.iter().map(|(s, x, m)| (s.as_str(), *x, *m)).collect::<Vec<_>>());
    let ran = work.grimace("run people -o out --resample linear --covariate age").exit(0);
    ran.prints(&[
        "change with a numeric column, after correction for all tests: happiness with age (",
        "1 person without a number is excluded",
    ]);
    let rows = work.rows("out/covariates.csv");
    let row = &rows[0];
    assert_eq!((row["subjects"].as_str(), row["without"].as_str(), row["permutations"].as_str()), ("6", "1", "720"));
    assert_eq!((row["low"].as_str(), row["high"].as_str(), row["exhaustive"].as_str()), ("21", "60", "true"));
    assert!(row["p_either_holm"].parse::<f64>().unwrap() <= 0.05);
    // Of six people one fifth. One test alone needs no correction.
    assert_eq!((row["share_by_chance"].as_str(), &row["p_holm"]), ("0.2", &row["p"]));
    // The corner of the mouth is farther out at 60 than at 21.
    let [low, high] = ["low", "high"].map(|end| moved(&work, &format!("out/covariates/happiness_age_{end}.csv"), "31"));
    assert!(0.0 < low && low < high, "{low} {high}");
    let face = work.rows("out/covariate_amplitudes.csv").into_iter().find(|r| r["region"] == "face").unwrap();
    assert!(face["slope"].parse::<f64>().unwrap() > 0.0 && face["subjects"] == "6");
    let report = work.read("out/report.html");
    for text in ["happiness changes with age (", "happiness is stronger at higher age (", ">covariate_amplitudes.csv</a>"] {
        assert!(report.contains(text), "{text}");
    }
    let sequences = work.rows("out/sequences.csv");
    assert_eq!((sequences.len(), sequences[2]["age"].as_str(), sequences[2]["verdict"].as_str()), (7, "32,5", "good"));
    // With three people at each of two sites there are 3! * 3! = 36 permutations.
    work.grimace("analyze out/tracks -o again --resample linear --covariate age --strata site --permutations 99").exit(0);
    assert_eq!(work.rows("again/covariates.csv")[0]["permutations"], "36");
    assert!(work.read("again/report.html").contains("within equal values of site"));
    // Every column that `units.json` lists is in the table of that name.
    work.grimace("analyze out/tracks -o units --resample linear --covariate age --by site --permutations 99").exit(0);
    assert_eq!((work.rows("units/comparisons.csv").len(), work.rows("units/covariates.csv").len()), (1, 1));
    let units: serde_json::Value = serde_json::from_str(&work.read("units/units.json")).unwrap();
    let tables = units["files"].as_object().unwrap().iter().filter(|(file, _)| !file.contains('*') && file.ends_with(".csv"));
    for (file, columns) in tables.filter(|(file, _)| work.path(&format!("units/{file}")).exists()) {
        let header = work.header(&format!("units/{file}"));
        let header: Vec<&str> = header.split(',').collect();
        for column in columns.as_object().unwrap().keys().filter(|c| !c.contains("..") && !c.contains("LABEL")) {
            assert!(header.contains(&column.as_str()), "{file} has no column {column}: {header:?}");
        }
    }
    let few =
        work.grimace("analyze out/tracks -o few --resample linear --covariate age --permutations 99 --test-people 5").exit(0);
    few.prints(&["tests of numeric columns used a random draw of people (increase it with --test-people): happiness (5 of 6)"]);
    // Of a, b, c and the person without a number: 21, 26 and 32.5 years, too few for a test.
    let four = ["p0", "p1", "p2", "p6"].map(|who| format!("out/tracks/{who}_1.csv")).join(" ");
    work.grimace(&format!("analyze {four} -o four --resample linear --covariate age")).exit(0);
    let row = work.rows("four/covariates.csv").remove(0);
    assert_eq!((row["subjects"].as_str(), row["without"].as_str(), row["mean"].as_str()), ("3", "1", "26.5"));
    assert!(row["sd"].starts_with("5.766") && row["not_tested"].starts_with("only 3 of the people have a number"), "{row:?}");
    work.grimace("run people -o none --resample linear --covariate site")
        .exit(1)
        .says(&["the column `site` has no numbers (a value is "]);
    work.grimace("run people -o none --resample linear --covariate ages").exit(1).says(&["no sequence has a column `ages`"]);
}

#[test]
fn covariates_with_similar_names_have_separate_files() {
    let work = Work::new();
    let long = "x".repeat(300);
    let word = |k: usize| if k == 2 { "3O".to_owned() } else { k.to_string() };
    let rows: Vec<(String, f64, String)> =
        (0..6).map(|k| (format!("p{k}"), 4.0 + k as f64, format!(",{k},{},{}", 5 - k, word(k)))).collect();
    let rows: Vec<(&str, f64, &str)> = rows.iter().map(|(s, x, m)| (s.as_str(), *x, m.as_str())).collect();
    people(&work, &format!(",a b,a-b,{long}"), &rows);
    let columns = format!("a b,a-b,a b,{long}");
    let run = || -> Ran {
        let mut command = work.command();
        command.args(["run", "people", "-o", "out", "--resample", "linear", "--covariate", &columns]).run()
    };
    run().exit(0).prints(&["values that are not numbers are ignored: `3O` in the column", "(1 person)"]);
    let tests = work.rows("out/covariates.csv");
    let models: Vec<&str> = tests.iter().map(|r| r["models"].as_str()).collect();
    assert_eq!((models.len(), &models[..2]), (3, ["covariates/happiness_a-b", "covariates/happiness_a-b~2"].as_slice()));
    let corner = |stem: &str| moved(&work, &format!("out/{stem}_low.csv"), "31");
    assert!(corner(models[0]) < corner(models[1]), "one increases with the smile, the other decreases");
    work.write(&format!("out/{}_low.csv", models[0]), "mine");
    run().exit(1).says(&["covariates/happiness_a-b_low.csv"]);
    assert_eq!(work.read(&format!("out/{}_low.csv", models[0])), "mine");
    work.grimace("run people -o none --resample linear --covariate subject").exit(1).says(&["`subject` identifies sequences"]);
}

#[test]
fn words_for_missing_values_make_no_group() {
    let work = Work::new();
    let rows: Vec<(String, f64, &str)> = [",20,x", ",20,x", ",30,x", ",30,x", ",NA,n/a", ",na,x", ",,x"]
        .into_iter()
        .enumerate()
        .map(|(k, metadata)| (format!("p{k}"), 4.0 + k as f64, metadata))
        .collect();
    let rows: Vec<(&str, f64, &str)> = rows.iter().map(|(s, x, m)| (s.as_str(), *x, *m)).collect();
    people(&work, ",age,site", &rows);
    let ran = work.grimace("run people -o out --resample linear --by age --permutations 99 --bootstrap 0").exit(0);
    ran.prints(&[
        "treated as missing: `NA` in the column `age` (1 sequence); `na` in the column `age` (1 sequence)",
        "such as `NA group`",
    ]);
    let groups: Vec<String> =
        work.rows("out/statistics.csv").into_iter().map(|r| r["age"].clone() + ":" + &r["sequences"]).collect();
    assert_eq!(groups, [":7", "20:2", "30:2", "unknown:3"]);
    assert_eq!(work.rows("out/comparisons.csv").len(), 1);
    let strata = work.grimace("analyze out/tracks -o strata --resample linear --by age --strata site --permutations 99").exit(0);
    strata.prints(&["`n/a` in the column `site` (1 sequence)"]);
    work.grimace("analyze out/tracks/p4_1.csv out/tracks/p5_1.csv -o none --by age").exit(1).says(&["column `age` is empty"]);
    // p0 and p1 are 20 years old; of p4 and p6 nothing is known.
    let tracks = "out/tracks/p0_1.csv out/tracks/p1_1.csv out/tracks/p4_1.csv out/tracks/p6_1.csv";
    let reason = "only one group, 20, has people; 2 people have no value (`unknown`)";
    let one = work.grimace(&format!("analyze {tracks} -o one --by age --bootstrap 0")).exit(0);
    one.prints(&[&format!("no groups to compare: happiness ({reason})")]);
    assert!(work.read("one/report.html").contains(&format!("Not tested: happiness: {reason}.")));
}

#[test]
fn amplitudes_in_pairs_name_who_is_left_out_and_regions_without_a_test() {
    let work = Work::new();
    let mut manifest = "subject,sequence,emotion,frames,session\n".to_owned();
    let smiles = [("a", [4.0, 6.0]), ("b", [5.0, 8.0]), ("c", [6.0, 7.0]), ("d", [7.0, 9.0]), ("e", [8.0, 0.0])];
    for (subject, smiles) in smiles {
        for (session, smile) in ["before", "after"].into_iter().zip(smiles).filter(|(_, smile)| *smile > 0.0) {
            work.write(&format!("people/{subject}_{session}.csv"), own(&[(1, 0.0), (2, smile)]));
            manifest += &format!("{subject},{session},happiness,{subject}_{session}.csv,{session}\n");
        }
    }
    work.write("people/manifest.csv", manifest);
    let ran = work.grimace("run people -o out --resample linear --by session --permutations 99 --bootstrap 0").exit(0);
    ran.prints(&["amplitudes in pairs leave out people who are in one group only: happiness, after and before (without e)"]);
    let rows = work.rows("out/amplitude_comparisons.csv");
    let of = |region: &str| rows.iter().find(|r| r["region"] == region).unwrap();
    // Everybody of `after` was there before.
    let face = of("face");
    assert_eq!((face["paired"].as_str(), face["subjects_a"].as_str(), face["not_paired"].as_str()), ("true", "4", "e"));
    // One of the four regions hardly moves in such a smile.
    let untested: Vec<_> = rows.iter().filter(|r| r["p"].is_empty()).collect();
    assert!(rows.len() == 4 && untested.len() == 1 && untested[0]["not_tested"].contains("median motion"), "{rows:?}");
}

#[test]
fn two_people_with_the_same_frames_are_named() {
    let work = Work::new();
    people(&work, "", &[("a", 5.0, ""), ("b", 6.0, ""), ("c", 5.0, "")]);
    let said = "people with the same pictures or exactly the same motion: a and c (a_1 and c_1); are these two people?";
    work.grimace("run people -o out --resample linear").exit(0).prints(&[said]);
    assert!(work.read("out/report.html").contains(said));
    work.grimace("analyze out/tracks/a_1.csv out/tracks/c_1.csv -o two --resample linear").exit(0).prints(&[said]);
    let ran = work.grimace("analyze out/tracks/a_1.csv out/tracks/b_1.csv -o other --resample linear").exit(0);
    assert!(!ran.stdout.contains("two people?") && !work.read("other/report.html").contains("Copies?"), "{}", ran.stdout);
}

#[test]
fn people_are_counted_not_sequences_and_a_majority_of_one_is_named() {
    let work = Work::new();
    let mut manifest = "subject,sequence,emotion,frames\n".to_owned();
    let mut add = |subject: &str, sequence: usize, emotion: &str, smile: f64| {
        let name = format!("{subject}_{emotion}_{sequence}.csv");
        work.write(&format!("people/{name}"), own(&[(1, 0.0), (2, smile)]));
        manifest += &format!("{subject},{emotion}{sequence},{emotion},{name}\n");
    };
    for k in 0..6 {
        add("P", k, "alone", 5.0 + k as f64);
    }
    // Trimming drops two of P's eleven sequences; then Q alone outweighs the other nine.
    add("Q", 0, "pair", 5.0);
    for k in 0..11 {
        add("P", k, "pair", 4.0 + k as f64);
    }
    // Nine people, one of them with two sequences: the farthest sequence weighs a whole person, more than a tenth of nine.
    for k in 0..8 {
        add(&format!("m{k}"), 0, "many", if k == 0 { 30.0 } else { 5.0 + 0.1 * k as f64 });
    }
    add("m8", 0, "many", 5.3);
    add("m8", 1, "many", 5.4);
    for k in 0..10 {
        add(&format!("t{k}"), 0, "ten", 5.0 + k as f64);
    }
    work.write("people/manifest.csv", &manifest);
    let ran = work.grimace("run people -o out --resample linear").exit(0);
    ran.prints(&[
        "fewer than 5 people allow few conclusions about other people: alone (1); pair (2)",
        "dominates representative and dispersion: pair (Q, 55 %)",
        "nothing was trimmed, because alpha 0.1 needs at least 10 sequences: alone (6)",
        "nothing was trimmed, because the farthest sequence has more than 0.1 (alpha) of the weight of all people: many (10)",
    ]);
    assert!(work.read("out/report.html").contains("fewer than 5 people"));
    work.grimace("figures out -o figures -q").exit(0);
    let rows = work.rows("figures/captions.csv");
    let of = |name: &str| rows.iter().find(|r| r["figure"] == name).unwrap().clone();
    let expected = "at most 10 % of the weight of the models trimmed per displacement field (nothing of alone; many: too few models for \
                    10 %)";
    let overview = of("representatives");
    assert!(overview["caption"].contains(expected) && overview["method"].contains(expected), "{overview:?}");
    assert!(of("fields_ten")["method"].contains("at most 10 % of the weight of the models trimmed per displacement field,"));
    assert!(of("fields_alone")["method"].contains("nothing trimmed"));
}

/// Writes `count` people interpolated between those of a file of models, without fitting any.
fn write_between(models: &Path, count: usize, path: &Path) {
    let file = ColumnarModels::open(models).unwrap();
    let known = file.models().unwrap();
    let mut writer = ColumnarWriter::create(path, &[], known[0].frame_count(), known[0].node_count()).unwrap();
    for k in 0..count {
        let (one, other) = (&known[k % known.len()], &known[(k + 1) % known.len()]);
        let share = k as f64 / count as f64;
        let between = one.frames().iter().zip(other.frames()).map(|(a, b)| {
            let nodes = a.nodes().iter().zip(b.nodes()).map(|(a, b)| a + (b - a) * share);
            FrameExpressionModel::new(nodes.collect())
        });
        let model = DynamicExpressionModel::new(between.collect()).unwrap();
        let id = SequenceId { subject: format!("m{k:04}"), sequence: "1".to_owned() };
        writer.push(ColumnarRow::new(id, "happiness".to_owned(), Vec::new(), &model)).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_columnar_file_gives_the_statistics_of_the_tracks() {
    let work = Work::new();
    let rows: Vec<(String, f64)> = (0..12).map(|k| (format!("a{k:02}"), 4.0 + f64::from(k))).collect();
    people(&work, "", &rows.iter().map(|(s, x)| (s.as_str(), *x, "")).collect::<Vec<_>>());
    work.grimace("run people -o out --resample linear --columnar --median exact").exit(0);
    work.grimace("analyze --models out/models.parquet -o again --median exact").exit(0).prints(&["12 models"]);
    for file in ["statistics.csv", "trimming.csv", "representatives/happiness.csv", "fap/happiness.fap"] {
        assert_eq!(work.read(&format!("out/{file}")), work.read(&format!("again/{file}")), "{file}");
    }
    // With little memory the computation is node by node: the same median and dispersion in the written digits, with certified
    // trimming. The displacements lie on a line, and an odd number of them is kept: between the middle two of an even number,
    // every point is a median.
    write_between(&work.path("out/models.parquet"), 901, &work.path("many.parquet"));
    work.grimace("analyze --models many.parquet -o all --median exact").exit(0).prints(&["901 models"]);
    work.grimace("analyze --models many.parquet -o streamed --median exact --memory 16MB").exit(0);
    let value = |folder: &str, name: &str| work.rows(&format!("{folder}/statistics.csv"))[0][name].parse::<f64>().unwrap();
    for name in ["dispersion", "dispersion_untrimmed", "sum_of_distances_exact"] {
        let (a, b) = (value("all", name), value("streamed", name));
        assert!((a - b).abs() <= 1e-8 * a, "{name}: {a} {b}");
    }
    let json: serde_json::Value = serde_json::from_str(&work.read("streamed/representatives/happiness.json")).unwrap();
    assert!(json["trimming_certificate"]["decided_exactly"].is_u64());
    work.grimace("analyze --models many.parquet -o b --memory 16MB --by subject").exit(1).says(&["more than the 16 MB"]);
    work.write("bad.parquet", "PAR1 no")
        .grimace("analyze --models bad.parquet -o c")
        .exit(1)
        .says(&["is not a readable Parquet file"]);
}

#[test]
fn a_run_in_parts_gives_the_bytes_of_a_plain_run() {
    let work = Work::with_faces();
    let options = "--by cohort --permutations 99 --bootstrap 99";
    work.grimace(&format!("run faces -o plain {options}")).exit(0);
    work.grimace(&format!("run faces -o parts --part 1/3 {options}"))
        .exit(1)
        .says(&["no run was started in this folder", "--plan"]);
    let plan = work.grimace(&format!("run faces -o parts --plan {options}")).exit(0);
    plan.prints(&[r#"{"sequences":6,"emotions":[["happiness",3],["surprise",3]]}"#]);
    for part in ["2/4", "1/4", "4/4", "3/4"] {
        work.grimace(&format!("run faces -o parts --part {part} {options}")).exit(0);
    }
    assert_eq!(work.files("parts/tracks").len(), 12);
    for emotion in ["surprise", "happiness"] {
        work.grimace(&format!("run faces -o parts --emotion {emotion} {options}")).exit(0);
    }
    assert!(work.path("parts/parts/happiness.json").exists());
    work.grimace(&format!("run faces -o parts {options}")).exit(0).prints(&["0 tracked, 6 unchanged"]);
    assert_same_files(&work.files("plain"), &work.files("parts"));
    work.grimace("run faces -o parts --part 5/4").exit(2).says(&["expected K/N"]);
    work.grimace(&format!("run faces -o parts --emotion joy {options}")).exit(1).says(&["no sequence shows the emotion `joy`"]);
    work.grimace("run faces -o parts --emotion happiness").exit(1).says(&["other options"]);
}

#[test]
fn recognition_leaves_one_subject_out() {
    let work = Work::after_run(&SEQUENCES, "out");
    let ran = work.grimace("evaluate recognition out/tracks -o recognition").exit(0);
    ran.prints(&["evaluated 6 of 6 sequences of 3 subjects", "chance, mean over labels 50.0 %"]);
    let confusion = work.rows("recognition/confusion.csv");
    assert_eq!(confusion.len(), 2);
    let count = |row: usize, name: &str| confusion[row][name].parse::<usize>().unwrap();
    // A simulated smile and a simulated surprise must not be confused.
    assert_eq!((count(0, "happiness"), count(0, "surprise"), count(1, "surprise")), (3, 0, 3));
    assert_eq!(work.rows("recognition/recognition.csv").len(), 6);
    assert!(work.read("recognition/confusion.svg").starts_with("<svg"));
    work.grimace("evaluate recognition out/tracks -o by-cohort --label cohort").exit(0);
    work.grimace("evaluate recognition out/tracks -o none --label nation").exit(1).says(&["no sequence has a column `nation`"]);
    let one = "evaluate recognition out/tracks/S001_005.csv out/tracks/S002_005.csv -o one";
    work.grimace(one).exit(1).says(&["found 1 label; recognition needs sequences of at least two labels"]);
}

#[test]
fn the_smiles_of_ninety_real_people_are_smiles() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/people");
    if !data.is_dir() {
        eprintln!("SKIPPED the_smiles_of_ninety_real_people_are_smiles: ../shared/data/people does not exist");
        return;
    }
    let work = Work::new();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/people_dataset");
    let made = std::process::Command::new(script).arg(&data).arg(work.path("people")).status().unwrap();
    assert!(made.success());
    let options = "--resample linear --permutations 999 --bootstrap 100";
    work.grimace(&format!("run people -o out --by gender --columnar {options}")).exit(0).prints(&["90 sequences: 90 tracked"]);
    // Node 31 is the left corner of the mouth, at positive x: a smile moves both corners out and up, in every group.
    for stem in ["happiness", "happiness_gender-female", "happiness_gender-male"] {
        let rows = work.rows(&format!("out/representatives/{stem}.csv"));
        let at = |frame: &str, node: &str, axis: &str| {
            rows.iter().find(|r| r["frame"] == frame && r["node"] == node).unwrap()[axis].parse::<f64>().unwrap()
        };
        let moved = |node: &str, axis: &str| at("4", node, axis) - at("0", node, axis);
        assert!(moved("31", "x") > 20.0 && moved("64", "x") < -20.0, "{stem}");
        assert!(moved("31", "y") > 20.0 && moved("64", "y") > 20.0, "{stem}");
        // Corners of the eyes move with the head only, so they hardly move.
        assert!(moved("23", "x").abs() < 10.0 && moved("56", "y").abs() < 10.0, "{stem}");
    }
    work.grimace(&format!("analyze --models out/models.parquet -o ethnicity --by ethnicity {options}")).exit(0);
    let comparisons = work.rows("ethnicity/comparisons.csv");
    // Five values, one of them of a single person: 10 pairs, 4 of them without a test.
    assert_eq!(comparisons.len(), 10);
    assert_eq!(comparisons.iter().filter(|r| r["not_tested"] == "a group of 1 is too small for a test").count(), 4);
    for row in comparisons.iter().filter(|r| !r["p"].is_empty()) {
        assert!(row["p_holm"].parse::<f64>().unwrap() >= row["p"].parse::<f64>().unwrap());
    }
}
