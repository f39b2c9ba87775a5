//! The report as text: its content, safety, size and reproducibility.

use crate::report_data::Fixture;
use grimace::internal::report::{Stage, render_html};

/// Returns the parsed embedded data.
fn payload(html: &str) -> serde_json::Value {
    let start = html.find(r#"id="data">"#).unwrap() + r#"id="data">"#.len();
    let length = html[start..].find("</script>").unwrap();
    serde_json::from_str(&html[start..start + length]).unwrap()
}

#[test]
fn every_emotion_has_a_section_and_its_dispersion() {
    let fixture = Fixture::new("Six emotions", [9, 12, 8, 24, 10, 30], &[]);
    let html = render_html(&fixture.data()).unwrap();
    for (index, emotion) in ["anger", "disgust", "fear", "happiness", "sadness", "surprise"].into_iter().enumerate() {
        let listed = format!(r##"<a href="#r{index}"><span class="cap">{emotion}</span></a>"##);
        assert!(html.contains(&listed), "{emotion} in the contents");
        assert!(html.contains(&format!(r#"<article class="card" id="r{index}""#)), "{emotion} has a card");
        let dispersion = format!("{:.2}", fixture.representatives[index].dispersion.unwrap());
        assert!(html.contains(&format!(r#"<td class="num strong">{dispersion}</td>"#)), "{emotion}: {dispersion} in the table");
    }
    // 9 + 12 + 8 + 24 + 10 + 30 = 93.
    assert!(html.contains("93 sequences tracked · 6 emotions · 6 representatives · no failures"));
    for published in ["11.13", "9.80", "11.39", "10.89", "13.46", "13.57"] {
        assert!(html.contains(&format!(r#"<td class="num">{published}</td>"#)));
    }
    assert!(html.contains("values of Krinidis &amp; Pitas for the Cohn-Kanade database. Their units are not stated"));
}

#[test]
fn the_data_holds_the_models_of_live_nodes() {
    let fixture = Fixture::new("Data", [2, 3, 4, 5, 6, 7], &[]);
    let data = payload(&render_html(&fixture.data()).unwrap());
    let anger = &data["representatives"][0];
    // 104 live nodes, x and y alternating; four frames after the neutral one.
    assert_eq!(anger["neutral"].as_array().unwrap().len(), 208);
    assert_eq!(anger["offsets"].as_array().unwrap().len(), 4);
    // The first live node is node 0, at (0, 1.061) model units; 1.061 * 1024 / 0.613 = 1772.37.
    assert_eq!(anger["neutral"][0].as_f64().unwrap(), 0.0);
    assert_eq!(anger["neutral"][1].as_f64().unwrap(), 1772.37);
    assert_eq!(data["tracks"].as_array().unwrap().len(), 27);
    assert_eq!(data["nodes"].as_array().unwrap().len(), 104);
}

#[test]
fn a_user_s_text_can_not_become_markup() {
    let evil = "</script><script>alert(1)</script><!-- \" ' & {{ 7 * 7 }}";
    let mut fixture = Fixture::new(evil, [2; 6], &[]).fail(evil, evil, Stage::Track, evil);
    fixture.tracks[0].id.subject = evil.into();
    fixture.tracks[0].emotion = evil.into();
    fixture.tracks[0].summary.recovered.insert(evil.into(), 3);
    fixture.representatives[0].label.emotion = evil.into();
    fixture.representatives[0].label.group.insert(evil.into(), evil.into());
    fixture.representatives[1].sequences[0].subject = evil.into();
    let html = render_html(&fixture.data()).unwrap();
    assert!(!html.contains("<script>alert"), "script element");
    assert!(!html.contains("<!-- "), "comment");
    assert!(html.contains("{{ 7 * 7 }}"), "not a template");
    // Those of the page itself: the data and the script.
    assert_eq!(html.matches("<script").count(), 2);
    assert_eq!(html.matches("</script").count(), 2);
    assert_eq!(payload(&html)["ids"].as_array().unwrap().iter().filter(|id| id[0] == evil).count(), 2);
}

#[test]
fn nothing_comes_from_outside() {
    let html = render_html(&Fixture::new("Alone", [2; 6], &[]).data()).unwrap();
    // The name of the SVG name space is the only address, and it is never fetched.
    assert_eq!(
        html.matches("http").count(),
        html.matches("http://www.w3.org/2000/svg").count() + html.matches("http-equiv").count()
    );
    assert!(!html.contains("@import") && !html.contains("url("));
    assert!(html.contains("default-src 'none'"));
}

#[test]
fn numbers_that_are_not_finite_become_dashes() {
    let mut fixture = Fixture::new("Gaps", [4; 6], &[]);
    let r = &mut fixture.representatives[0];
    r.dispersion = Some(f64::NAN);
    r.sums.greedy_gap = f64::INFINITY;
    r.node_dispersion[0] = f64::NAN;
    r.distances[0] = None;
    fixture.tracks[0].summary.mean_residual_px = f64::NAN;
    let html = render_html(&fixture.data()).unwrap();
    let start = html.find(r#"id="data">"#).unwrap();
    let (text, script) = (&html[..start], payload(&html).to_string());
    for bad in ["NaN", ">inf", "Infinity"] {
        assert!(!text.contains(bad) && !script.contains(bad), "{bad}");
    }
    assert!(text.contains("– %"));
}

#[test]
fn a_single_sequence_and_a_small_class_are_marked() {
    let fixture = Fixture::new("Few", [1, 4, 5, 9, 9, 9], &[]);
    let html = render_html(&fixture.data()).unwrap();
    assert_eq!(html.matches("single sequence: no dispersion").count(), 1);
    assert_eq!(html.matches("small class: fewer than 5 people").count(), 1);
    assert!(html.contains("<td class=\"num strong\">–<sup>†</sup></td>"));
    let data = payload(&html);
    assert!(data["representatives"][0].get("nodeDispersion").is_none());
    assert!(data["representatives"][1].get("nodeDispersion").is_some());
}

#[test]
fn groups_have_a_block_of_rows_each() {
    let html = render_html(&Fixture::new("Grouped", [6; 6], &["f", "m"]).data()).unwrap();
    assert_eq!(html.matches(r#"<tr class="block">"#).count(), 2);
    assert!(html.contains(r#"colspan="7">sex = f</th>"#) && html.contains(r#"colspan="7">sex = m</th>"#));
    assert!(html.contains("12 representatives"));
}

#[test]
fn failures_come_first() {
    let html =
        render_html(&Fixture::new("Failed", [2; 6], &[]).fail("S9", "1", Stage::Fit, "2 marks; at least 3 are needed").data())
            .unwrap();
    let place = |text: &str| html.find(text).unwrap_or_else(|| panic!("{text}"));
    assert!(place("2 marks; at least 3 are needed") < place("<h2 id=\"dispersion-h\">"));
    assert!(html.contains("· 1 failure<"));
}

#[test]
fn an_empty_run_still_makes_a_report() {
    let mut fixture = Fixture::new("Nothing", [1; 6], &[]).fail("S1", "1", Stage::Dataset, "no frames");
    fixture.representatives.clear();
    fixture.tracks.clear();
    let html = render_html(&fixture.data()).unwrap();
    assert!(html.contains("0 sequences tracked") && html.contains("No class has a representative"));
}

#[test]
fn same_input_same_bytes() {
    let html = || render_html(&Fixture::new("Same", [3; 6], &["f", "m"]).data()).unwrap();
    assert_eq!(html(), html());
}

#[test]
fn the_file_is_small() {
    let size = |count: usize| render_html(&Fixture::new("Size", [count; 6], &[]).data()).unwrap().len();
    let (small, large) = (size(20), size(120));
    // Six classes, each with drawings of its fields, map and courses: 180 kB per class.
    assert!(small < 1_300_000, "{small} bytes for 120 sequences");
    // 6 * (120 - 20) = 600 more sequences.
    let each = (large - small) / 600;
    // One row, and two numbers for each of its 8 to 36 frames.
    assert!(each <= 400, "{each} bytes per sequence");
}
