//! `grimace locate`, and runs without hand-set marks.

use std::{collections::BTreeMap, fs};

use image::{GrayImage, Luma};

use crate::common::{Work, root};

/// The first frames of two people of the shipped sample.
const FACES: [&str; 2] = ["S001/005/S001_005_00000001.jpg", "S002/007/S002_007_00000001.jpg"];

/// Makes `a.jpg` and `b.jpg` with a face, and `waves.png` without one.
fn work() -> Work {
    let work = Work::new();
    for (name, face) in ["a.jpg", "b.jpg"].iter().zip(FACES) {
        fs::copy(root().join("fixtures/simulated").join(face), work.path(name)).unwrap();
    }
    GrayImage::from_fn(320, 240, |x, y| Luma([(128.0 + 90.0 * (f64::from(x) / 9.0).sin() * (f64::from(y) / 14.0).cos()) as u8]))
        .save(work.path("waves.png"))
        .unwrap();
    work
}

#[test]
fn faces_are_found_and_a_picture_without_a_face_is_reported() {
    let work = work();
    // A picture that is named twice is processed once.
    work.grimace("locate a.jpg b.jpg ./a.jpg -o points.csv --overlay pictures").exit(0).prints(&["2 pictures, 2 faces"]);
    assert_eq!(work.header("points.csv"), "image,face,node,x,y,expected_error");
    let rows = work.rows("points.csv");
    let of = |image: &str, node: &str| -> (f64, f64) {
        let row = rows.iter().find(|r| r["image"] == image && r["node"] == node && r["face"] == "1").unwrap();
        assert!(row["expected_error"].parse::<f64>().unwrap() > 0.0);
        (row["x"].parse().unwrap(), row["y"].parse().unwrap())
    };
    for image in ["a.jpg", "b.jpg"] {
        let (left_eye, right_eye, mouth, chin) = (of(image, "20"), of(image, "53"), of(image, "7"), of(image, "10"));
        assert!(left_eye.0 > right_eye.0, "the subject's left is on the right of the picture");
        assert!(left_eye.1 < mouth.1 && mouth.1 < chin.1);
    }
    assert!(work.path("pictures/0001_a.png").is_file());
    let ran = work.grimace("locate a.jpg waves.png -o more.csv").exit(3);
    ran.says(&["waves.png: no face found"]).prints(&["1 without a face"]);
    work.grimace("locate waves.png -o none.csv").exit(3);
    assert_eq!(work.read("none.csv"), "image,face,node,x,y,expected_error\n");
    assert_eq!(work.rows("more.csv").iter().filter(|r| r["image"] == "a.jpg").count(), rows.len() / 2);
}

#[test]
fn marks_of_the_sample_are_found_again() {
    let work = work();
    work.grimace("locate a.jpg -o points.csv").exit(0);
    let truth = fs::read_to_string(root().join("fixtures/simulated/S001/005/correspondences.csv")).unwrap();
    let rows = work.rows("points.csv");
    let place = |node: &str| {
        rows.iter().find(|r| r["node"] == node).map(|r| (r["x"].parse::<f64>().unwrap(), r["y"].parse::<f64>().unwrap()))
    };
    let (left, right) = (place("20").unwrap(), place("53").unwrap());
    let width = (left.0 - right.0).hypot(left.1 - right.1);
    for line in truth.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let (x, y): (f64, f64) = (fields[1].parse().unwrap(), fields[2].parse().unwrap());
        if let Some(found) = place(fields[0]) {
            // The outer corners of the eyes are about 1.4 eye distances apart; a simulated face is not a photograph.
            assert!(
                (found.0 - x).hypot(found.1 - y) < 0.12 * width,
                "node {} was found at {found:?}, but is at {x}, {y}",
                fields[0]
            );
        }
    }
}

#[test]
fn all_faces_of_a_group_are_found_and_those_beyond_the_limit_are_reported() {
    let work = Work::new();
    let face = image::open(root().join("fixtures/portraits/P01.jpg")).unwrap().to_luma8();
    let face = image::imageops::thumbnail(&face, 110, 140);
    let mut group = GrayImage::new(5 * 110, 4 * 140);
    (0..20).for_each(|k| image::imageops::replace(&mut group, &face, k % 5 * 110, k / 5 * 140));
    group.save(work.path("group.png")).unwrap();
    work.grimace("locate group.png -o points.csv").exit(0).prints(&["1 picture, 20 faces"]);
    let ran = work.grimace("locate group.png -o some.csv --faces 16").exit(0);
    ran.prints(&["1 picture, 16 faces"]).says(&["group.png: at least", "left out; raise --faces 16 to take more"]);
}

#[test]
fn a_covered_mouth_is_reported_and_its_points_have_large_expected_errors() {
    let work = Work::new();
    let mut picture = image::open(root().join("fixtures/portraits/P01.jpg")).unwrap().to_luma8();
    picture.save(work.path("open.png")).unwrap();
    let ran = work.grimace("locate open.png -o open.csv").exit(0);
    assert!(!ran.stderr.contains("covered") && !ran.stdout.contains("covered"), "{}", ran.stderr);
    let number = |file: &str, node: &str, column: &str| -> f64 {
        work.rows(file).iter().find(|r| r["node"] == node).unwrap()[column].parse().unwrap()
    };
    // A sheet of paper, lit from the left, covers the face from above the lips to below the chin.
    let (nose, chin) = (number("open.csv", "6", "y"), number("open.csv", "10", "y"));
    let (right, left) = (number("open.csv", "64", "x"), number("open.csv", "31", "x"));
    let (top, side) = (nose + 0.15 * (number("open.csv", "7", "y") - nose), 0.6 * (left - right));
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let (x, y) = (f64::from(x), f64::from(y));
        if (top..chin + 0.4 * (chin - nose)).contains(&y) && (right - side..left + side).contains(&x) {
            *pixel = Luma([(190.0 - 60.0 * (x - right) / (left - right)) as u8]);
        }
    }
    picture.save(work.path("covered.png")).unwrap();
    let ran = work.grimace("locate covered.png -o covered.csv").exit(0).prints(&["1 partly covered"]);
    ran.says(&["covered.png: face 1: the mouth and the chin look covered", "the median expected error there is"]);
    for node in ["7", "8", "31", "64", "10"] {
        let [open, covered] = ["open.csv", "covered.csv"].map(|file| number(file, node, "expected_error"));
        assert!(covered > 2.0 * open, "node {node}: {open} and {covered} px");
    }
    // The eyes are found as before.
    for node in ["20", "53"] {
        let [open, covered] = ["open.csv", "covered.csv"].map(|file| number(file, node, "expected_error"));
        assert!(covered < 2.0 * open, "node {node}: {open} and {covered} px");
    }
    // Too much is covered: the result must be reviewed before it is used.
    work.grimace("fit covered.png -o fit.csv").exit(1).says(&["not trusted", "and the mouth and the chin look covered"]);
}

/// Returns a portrait with teeth drawn between the lips, a fifth of the mouth's width high; the part below moves down.
fn with_teeth(work: &Work) -> image::RgbImage {
    let portrait = image::open(root().join("fixtures/portraits/P01.jpg")).unwrap().to_rgb8();
    portrait.save(work.path("closed.png")).unwrap();
    work.grimace("locate closed.png -o closed.csv").exit(0);
    let at = |node: &str| {
        let row = work.rows("closed.csv").into_iter().find(|row| row["node"] == node).unwrap();
        ["x", "y"].map(|axis| row[axis].parse::<f64>().unwrap())
    };
    let ([right, _], [left, _], [_, line]) = (at("64"), at("31"), at("87"));
    let (middle, half) = (0.5 * (left + right), 0.5 * (left - right));
    let mut drawn = portrait.clone();
    for x in (middle - 0.85 * half) as u32..=(middle + 0.85 * half) as u32 {
        let height = (0.2 * half * (1.0 - ((f64::from(x) - middle) / half).powi(2))).round() as u32;
        let top = line.round() as u32;
        for y in top..top + height {
            // As bright as the lip beside it, but less red.
            drawn.put_pixel(x, y, image::Rgb([150; 3]));
        }
        for y in 0..(0.3 * half) as u32 {
            drawn.put_pixel(x, top + height + y, *portrait.get_pixel(x, top + y));
        }
    }
    drawn
}

#[test]
fn teeth_are_distinguished_from_a_lower_lip_by_colour() {
    let work = Work::new();
    let drawn = with_teeth(&work);
    drawn.save(work.path("colour.png")).unwrap();
    image::imageops::grayscale(&drawn).save(work.path("grey.png")).unwrap();
    for command in ["locate", "fit"] {
        let gap = |picture: &str| {
            work.grimace(&format!("{command} {picture}.png -o {command}_{picture}.csv")).exit(0);
            let rows = work.rows(&format!("{command}_{picture}.csv"));
            let y = |node: &str| rows.iter().find(|row| row["node"] == node).unwrap()["y"].parse::<f64>().unwrap();
            y("40") - y("87")
        };
        // The drawn area is about 8 px high.
        let (colour, grey) = (gap("colour"), gap("grey"));
        assert!((5.0..11.0).contains(&colour) && grey < 2.0, "{command}: {colour} and {grey} px");
    }
}

#[test]
fn a_transparent_picture_is_read_as_it_is_seen_on_white() {
    let work = Work::new();
    let portrait = image::open(root().join("fixtures/portraits/P01.jpg")).unwrap().to_rgb8();
    let (width, height) = portrait.dimensions();
    // The left part is transparent, including the face; the colours below still show the face.
    let is_out = |x: u32| x < width * 2 / 5;
    let clear = image::RgbaImage::from_fn(width, height, |x, y| {
        let [r, g, b] = portrait.get_pixel(x, y).0;
        image::Rgba([r, g, b, if is_out(x) { 0 } else { 255 }])
    });
    let white =
        image::RgbImage::from_fn(width, height, |x, y| if is_out(x) { image::Rgb([255; 3]) } else { *portrait.get_pixel(x, y) });
    clear.save(work.path("clear.png")).unwrap();
    white.save(work.path("white.png")).unwrap();
    let found = |name: &str| {
        let ran = work.grimace(&format!("locate {name}.png -o {name}.csv"));
        let numbers = |row: BTreeMap<String, String>| [row["x"].clone(), row["y"].clone(), row["expected_error"].clone()];
        (
            work.rows(&format!("{name}.csv")).into_iter().map(numbers).collect::<Vec<_>>(),
            ran.stderr.contains("40 % of the pixels are transparent"),
        )
    };
    let (beneath, said) = found("clear");
    let (seen, said_of_white) = found("white");
    assert_eq!((said, said_of_white), (true, false));
    assert_eq!(beneath, seen);
}

#[test]
fn bad_input_is_named() {
    let work = work();
    work.grimace("locate gone.jpg -o points.csv").exit(1).says(&["gone.jpg: there is no such picture"]);
    work.write("broken.jpg", "no picture");
    work.grimace("locate broken.jpg a.jpg -o points.csv").exit(3).says(&["broken.jpg"]).prints(&["1 face"]);
    let gone = ["gone.jpg: there is no such picture"];
    work.grimace("locate a.jpg gone.jpg -o beside.csv --threads 1").exit(3).says(&gone).prints(&["1 face"]);
    work.grimace("locate a.jpg -o points.csv").exit(1).says(&["points.csv exists", "--force"]);
    work.write("model.bin", "nothing");
    work.grimace("locate a.jpg -o other.csv --model model.bin").exit(1).says(&["model.bin: this is not a model of the locator"]);
    work.grimace("learn locator . -o learned.bin").exit(1).says(&["delineation189.csv"]);
    fs::create_dir(work.path("empty")).unwrap();
    work.grimace("locate empty -o other.csv").exit(1).says(&["empty: this folder has no pictures"]);
}

#[test]
fn a_fit_needs_no_marks() {
    let work = work();
    work.grimace("fit a.jpg -o fit.csv").exit(0).prints(&["marks (0 hard)"]);
    assert_eq!(work.rows("fit.csv").len(), 113);
    work.grimace("fit waves.png -o none.csv").exit(1).says(&["no face was found", "annotate"]);
}

#[test]
fn a_dataset_without_marks_runs() {
    let work = Work::new();
    for sequence in ["S001/005", "S001/007", "S002/005", "S002/007"] {
        fs::create_dir_all(work.path(sequence)).unwrap();
        for file in fs::read_dir(root().join("fixtures/simulated").join(sequence)).unwrap() {
            let path = file.unwrap().path();
            if path.extension().is_some_and(|e| e == "jpg") {
                fs::copy(&path, work.path(sequence).join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    work.write(
        "manifest.csv",
        "subject,sequence,emotion\nS001,005,happiness\nS001,007,surprise\nS002,005,happiness\nS002,007,surprise\n",
    );
    work.grimace("run . -o out").exit(0).prints(&["4 sequences: 4 tracked"]);
    assert!(work.read("out/tracks/S001_005.json").contains("\"marks_from\": \"found\""));
    let ran = work.grimace("run . -o strict --marks default").exit(1);
    ran.says(&["no correspondences and no landmarks"]);
}
