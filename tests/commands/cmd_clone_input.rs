//! What `grimace clone` makes of unusual pictures and sources: sizes, turns, formats, videos.

use crate::cmd_clone::{clone, picture, work};
use crate::common::Work;
use image::{DynamicImage, ImageFormat, RgbImage};
use std::io::Cursor;

#[test]
fn a_folder_in_use_by_another_command_is_not_changed() {
    let work = work();
    clone(&work, "--source S001_005.csv -o out").exit(0);
    let before = work.files("out");
    let record = std::fs::File::options().append(true).open(work.path("out/frames.b3")).unwrap();
    record.lock().unwrap();
    clone(&work, "--source S001_005.csv -o out --fps 50 --force").exit(1).says(&["another command is writing into this folder"]);
    crate::common::assert_same_files(&before, &work.files("out"));
    drop(record);
    clone(&work, "--source S001_005.csv -o out --fps 50 --force").exit(0);
}

#[test]
fn a_fap_file_of_several_hours_is_refused_at_once() {
    let work = work();
    let flags = (1..=68).map(|k| if k == 3 { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    let frames: String = (0..20_001).map(|k| format!("{flags}\n{k} 100\n")).collect();
    work.write("long.fap", format!("2.1 long 25 20001\n{frames}"));
    clone(&work, "--source long.fap -o out").exit(1).says(&["long", "it has 20001 frames, more than 20000", "fap convert --fps"]);
}

#[test]
fn the_option_marks_without_a_landmark_file_is_refused() {
    let work = work();
    work.grimace("clone --source S001_005.csv --target target.png --marks default -o out")
        .exit(1)
        .says(&["target.png: --marks selects landmarks of a file, but no file is given", "--correspondences"]);
}

#[test]
fn targets_without_marks_turned_away_or_of_another_size_are_reported() {
    let work = work();
    work.grimace("clone --source S001_005.csv --target target.png target.png -c marks.csv -o out")
        .exit(1)
        .says(&["or none to find the marks"]);
    work.write("empty.csv", "node,x,y\n");
    let with = |marks: &str| work.grimace(&format!("clone --source S001_005.csv --target target.png -c {marks} -o out"));
    with("empty.csv").exit(1).says(&["empty.csv", "at least 3"]);
    with("gone.csv").exit(1).says(&["gone.csv"]);
    // A profile: the subject's left half appears a fifth as wide as the right half.
    let middle = 100.0;
    let rows = work.rows("marks.csv");
    let turned: String = rows
        .iter()
        .map(|row| {
            let x: f64 = row["x"].parse().unwrap();
            let x = if x > middle { middle + 0.12 * (x - middle) } else { x };
            format!("{},{x},{}\n", row["node"], row["y"])
        })
        .collect();
    work.write("profile.csv", format!("node,x,y\n{turned}"));
    let ran = with("profile.csv").exit(1);
    // The fit reports the first mark that is impossible in a frontal face.
    assert!(
        ran.stderr.contains("turned away by about") || ran.stderr.contains("the other marks expect it near"),
        "{}",
        ran.stderr
    );
    let outside = work.read("marks.csv").replace("node,x,y\n", "node,x,y\n94,5000,10\n");
    work.write("outside.csv", outside);
    with("outside.csv").exit(1).says(&["5000"]);
    work.write("short.csv", "point,x,y\n0,1,1\n1,2,2\n");
    with("short.csv").exit(1).says(&["2 landmarks; the points 0 to 67"]);
    work.grimace("clone --source S001_005.csv --target target.png target.png -c marks.csv -o out")
        .exit(1)
        .says(&["2 targets but 1 files of --correspondences"]);
}

/// Returns the marks of `marks.csv` multiplied by a factor.
fn scaled_marks(work: &Work, factor: f64) -> String {
    let row = |row: &std::collections::BTreeMap<String, String>| {
        let scale = |column: &str| (row[column].parse::<f64>().unwrap() + 0.5) * factor - 0.5;
        format!("{},{},{}\n", row["node"], scale("x"), scale("y"))
    };
    format!("node,x,y\n{}", work.rows("marks.csv").iter().map(row).collect::<String>())
}

pub fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn tiny_and_huge_pictures_work_or_say_what_is_missing() {
    let work = work();
    let original = picture(&work, "target.png");
    let resized = |factor: f64| {
        let (w, h) = original.dimensions();
        let side = |s: u32| (f64::from(s) * factor) as u32;
        image::imageops::resize(&original, side(w), side(h), image::imageops::FilterType::Triangle)
    };
    for (name, factor) in [("small", 0.25), ("large", 12.0)] {
        work.write(&format!("{name}.png"), png(resized(factor))).write(&format!("{name}.csv"), scaled_marks(&work, factor));
        work.grimace(&format!("clone --source S001_005.csv --target {name}.png -c {name}.csv -o {name} --fps 1 --duration 1"))
            .exit(0);
        assert_eq!(picture(&work, &format!("{name}/frames/{name}_00000002.png")).dimensions(), resized(factor).dimensions());
    }
    // In a picture 32 px wide, the eyes are 5 px apart.
    work.write("tiny.png", png(resized(0.08))).write("tiny.csv", scaled_marks(&work, 0.08));
    work.grimace("clone --source S001_005.csv --target tiny.png -c tiny.csv -o tiny").exit(1).says(&["px apart; at least 6 px"]);
    let wide = RgbImage::new(16_400, 40);
    work.write("wide.png", png(wide));
    work.grimace("clone --source S001_005.csv --target wide.png -c marks.csv -o wide")
        .exit(1)
        .says(&["16400x40, larger than 16384 px"]);
}

/// Returns a JPEG that EXIF data mark as lying on its side (orientation 6: rotate clockwise to see it upright).
fn on_its_side(upright: &RgbImage) -> Vec<u8> {
    let mut jpeg = Cursor::new(Vec::new());
    image::imageops::rotate270(upright).write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
    let jpeg = jpeg.into_inner();
    let tiff = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    let mut out = jpeg[..2].to_vec();
    out.extend([0xFF, 0xE1]);
    out.extend((2 + 6 + tiff.len() as u16).to_be_bytes());
    out.extend(b"Exif\0\0");
    out.extend(tiff);
    out.extend(&jpeg[2..]);
    out
}

#[test]
fn sixteen_bit_transparent_and_rotated_pictures_are_the_same_face() {
    let work = work();
    let original = picture(&work, "target.png");
    clone(&work, "--source S001_005.csv -o plain").exit(0);
    let apex = picture(&work, "plain/frames/target_00000006.png");
    let apex_of = |name: &str, file: &str| {
        work.grimace(&format!("clone --source S001_005.csv --target {file} -c marks.csv -o {name}")).exit(0);
        picture(&work, &format!("{name}/frames/{}_00000006.png", file.split('.').next().unwrap()))
    };
    let deep = image::ImageBuffer::from_fn(original.width(), original.height(), |x, y| {
        image::Rgb(original.get_pixel(x, y).0.map(|c| u16::from(c) * 257))
    });
    work.write("deep.png", png(DynamicImage::ImageRgb16(deep)));
    assert_eq!(apex_of("deep", "deep.png"), apex);
    work.write("clear.png", png(DynamicImage::ImageRgb8(original.clone()).to_rgba8()));
    assert_eq!(apex_of("clear", "clear.png"), apex);
    work.write("grey.png", png(image::imageops::grayscale(&original)));
    assert_eq!(apex_of("grey", "grey.png").dimensions(), apex.dimensions());
    work.write("side.jpg", on_its_side(&original));
    let side = apex_of("side", "side.jpg");
    assert_eq!(side.dimensions(), apex.dimensions());
    let difference: f64 = side.as_raw().iter().zip(apex.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
    assert!(difference / (apex.as_raw().len() as f64) < 6.0, "upright, up to JPEG compression");
}

#[test]
fn unsuitable_sources_are_reported() {
    let work = work();
    work.write("other.csv", "frame,node,x,y\n0,0,1,1\n0,1,2,2\n1,0,1,1\n1,1,2,2\n");
    clone(&work, "--source other.csv -o out").exit(1).says(&["other.csv has 2 nodes, but the wireframe has 113"]);
    work.write("smile.fap", std::fs::read(crate::common::root().join("fixtures/golden/fap/happiness.fap")).unwrap());
    clone(&work, "--source smile.fap --head -o nod").exit(0).says(&["smile.fap: --head has no effect: only tracks"]);
    let track = clone(&work, "--source S001_005.csv --head -o turn").exit(0);
    assert!(!track.stderr.contains("--head"), "{}", track.stderr);
    // With y counted from the bottom, and from a mirrored picture.
    let text = String::from_utf8(work.bytes("S001_005.csv")).unwrap();
    for (name, column, says) in
        [("below.csv", 3, "y must be counted downwards from the top"), ("side.csv", 2, "left and right are swapped")]
    {
        let flipped = text.lines().enumerate().map(|(line, row)| {
            let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
            if line > 0 {
                cells[column] = (300.0 - cells[column].parse::<f64>().unwrap()).to_string();
            }
            cells.join(",") + "\n"
        });
        work.write(name, flipped.collect::<String>());
        clone(&work, &format!("--source {name} -o out")).exit(1).says(&[name, says]);
    }
    clone(&work, "--source below.csv side.csv -o out").exit(1).says(&["no source could be read: below.csv: ", "; side.csv: "]);
    clone(&work, "--source target.png -o out")
        .exit(1)
        .says(&["target.png: this is neither a track or model (.csv) nor a FAP file"]);
    clone(&work, "--source gone.csv -o out").exit(1).says(&["gone.csv"]);
    clone(&work, "--source S001_005.csv --wrinkles -o out").exit(1).says(&["--wrinkles needs the frames of the source"]);
    work.grimace("analyze S001_005.csv -o analysed -q").exit(0);
    clone(&work, "--source analysed/representatives/happiness.csv --source-frames faces/S001/005 --wrinkles -o out")
        .exit(1)
        .says(&["belong to a track"]);
    for k in 1..=6 {
        let small = image::imageops::thumbnail(&picture(&work, &format!("faces/S001/005/S001_005_{k:08}.png")), 40, 40);
        work.write(&format!("small/S001_005_{k:08}.png"), png(small));
    }
    clone(&work, "--source S001_005.csv --source-frames small --wrinkles -o out")
        .exit(1)
        .says(&["small: frame 1 is 40x40, but the frames of the track S001_005 are"]);
    // Frames of another person with the same size and number; and the right frames in another folder.
    let other = "other: S002_005_00000001.png is not one of the files that the track S001_005 was made from (S001_005_00000001.png and others)";
    std::fs::rename(work.path("faces/S002/005"), work.path("other")).unwrap();
    clone(&work, "--source S001_005.csv --source-frames other --wrinkles -o out").exit(1).says(&[other]);
    for (name, bytes) in work.files("faces/S001/005") {
        work.write(&format!("moved/{name}"), bytes);
    }
    // Frames of another person with the same names, as when all frames are named by number.
    for (name, bytes) in work.files("other") {
        work.write(&format!("namesake/{}", name.replace("S002", "S001")), bytes);
    }
    clone(&work, "--source S001_005.csv --source-frames namesake --wrinkles -o out").exit(1).says(&[
        "namesake: the files have the same names as those that the track S001_005 was made from, but another content; give the folder",
    ]);
    // A folder with additional pictures still counts as the same.
    work.write("moved/S001_005_00000007.png", work.bytes("target.png"));
    clone(&work, "--source S001_005.csv --source-frames moved --wrinkles -o moved-clone").exit(0);
    std::fs::remove_file(work.path("faces/S001/005/S001_005_00000003.png")).unwrap();
    clone(&work, "--source S001_005.csv --source-frames faces/S001/005 --wrinkles -o out")
        .exit(1)
        .says(&["has only 5 of the 6 frames of the track S001_005"]);
}

#[test]
fn videos_are_written_or_refused_with_a_reason() {
    let work = work();
    for format in ["mp4", "webm"] {
        let ran = clone(&work, &format!("--source S001_005.csv -o {format} --film {format}"));
        // OpenCV warns if a codec is used under another tag than requested; users do not see this.
        assert!(!ran.stderr.contains("tag"), "{}", ran.stderr);
        if ran.status == Some(0) {
            // A track of the film has one frame per frame of the clone, with the size of the picture.
            work.grimace(&format!("track {format}/clone.{format} --correspondences marks.csv -o {format}.csv")).exit(0);
            let rows = work.rows(&format!("{format}.csv"));
            assert_eq!(rows.iter().map(|r| &r["frame"]).collect::<std::collections::BTreeSet<_>>().len(), 6, "{format}");
        } else {
            ran.exit(1).says(&["no encoder"]);
        }
    }
}
