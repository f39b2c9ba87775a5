//! FAP files and feature points in `grimace synthesize`: what is free, interpolated, or not shown.

use crate::cmd_synthesize::report;
use crate::common::{Work, root};

#[test]
fn faps_that_a_file_does_not_set_are_free() {
    let work = Work::new();
    // Only the upper lids: nothing else sets in.
    let mask = |set: &[usize]| (1..=68).map(|k| if set.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    let lids = mask(&[19, 20]);
    work.write("lids.fap", format!("2.1 blink 25 3\n{lids}\n0 0 0\n{lids}\n1 450 450\n{lids}\n2 900 900\n"));
    // Only the inner corners of the lips, alike.
    let smile = mask(&[12, 13]);
    work.write("smile.fap", format!("2.1 smile 25 3\n{smile}\n0 0 0\n{smile}\n1 200 200\n{smile}\n2 400 400\n"));
    work.grimace("fap convert smile.fap --mask all -o all.fap").exit(0);
    // Brows that rise: members that move the mouth to and fro would leave its feature points where they are.
    let brows = mask(&[31, 32, 33, 34, 35, 36]);
    work.write("brows.fap", format!("2.1 brows 25 2\n{brows}\n0 0 0 0 0 0 0\n{brows}\n1 300 300 250 250 200 200\n"));
    work.grimace("synthesize -b head -m brows.fap -o brows --bound-starts 0 --format glb").exit(0);
    let rows = work.rows("brows/weights.csv");
    let mouth = rows[1].iter().filter(|(name, _)| name.starts_with("mouth") || name.as_str() == "sadness");
    let mouth: f64 = mouth.map(|(_, weight)| weight.parse::<f64>().unwrap()).sum();
    assert!(mouth < 0.1 && report(&work, "brows")["shown"].as_f64().unwrap() > 0.9, "{:?}", rows[1]);
    let ran = ["lids", "smile", "all"]
        .map(|name| work.grimace(&format!("synthesize -b head -m {name}.fap -o {name} --bound-starts 0 --format glb")).exit(0));
    let rows = work.rows("lids/weights.csv");
    let weight = |member: &str| rows[2][member].parse::<f64>().unwrap();
    assert!(weight("jawOpen") < 0.05 && weight("surprise") < 0.05 && weight("mouthSmile") < 0.05, "{:?}", rows[2]);
    // The smile is shown, and nothing that has no part in it. With all other FAPs at 0 hardly any of it can be.
    let shown = ["smile", "all"].map(|name| report(&work, name)["shown"].as_f64().unwrap());
    assert!(shown[0] > 0.8 && shown[1] < 0.5, "{shown:?}");
    let [_, smile, all] = ran;
    assert!(!smile.stderr.contains("warning"), "{}", smile.stderr);
    // The motion is the same on both sides: regions would not help.
    assert!(
        all.stderr.contains("the bank also moves points that should rest") && !all.stderr.contains("--regions"),
        "{}",
        all.stderr
    );
}

/// Returns the mask of a FAP file with these FAPs set.
pub fn mask(faps: &[usize]) -> String {
    (1..=68).map(|k| if faps.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ")
}

#[test]
fn faps_that_only_some_frames_set_are_interpolated_in_the_others() {
    let work = Work::new();
    let (none, smile) = (mask(&[]), mask(&[53, 54, 59, 60]));
    // The second frame lies between two that set the smile, the last one after them.
    let (rest, half, full) = ("0 0 0 0", "100 100 80 80", "200 200 160 160");
    work.write("some.fap", format!("2.1 some 25 4\n{smile}\n0 {rest}\n{none}\n1\n{smile}\n2 {full}\n{none}\n3\n"));
    let all = format!("2.1 all 25 4\n{smile}\n0 {rest}\n{smile}\n1 {half}\n{smile}\n2 {full}\n{smile}\n3 {full}\n");
    work.write("all.fap", all);
    for name in ["some", "all"] {
        work.grimace(&format!("synthesize -b candide -m {name}.fap -o {name} --bound-starts 0 --between 3 --format glb")).exit(0);
        let portrait = root().join("fixtures/portraits/P01.jpg");
        let clone = format!("clone --source {name}.fap --target {} -o {name}-clone --teeth dark -q", portrait.display());
        work.grimace(&clone).exit(0);
    }
    assert_eq!(work.read("some/weights.csv"), work.read("all/weights.csv"));
    // Equal except for the name in the first line.
    let values =
        |name: &str| work.read(&format!("{name}-clone/clone.fap")).lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(values("some"), values("all"));
    // Inserted frames add no time: the motion has its own rate.
    let report = report(&work, "some");
    assert_eq!((report["frames"].clone(), report["motion"]["fps"].clone()), (13.into(), 100.0.into()), "{report}");
}

#[test]
fn key_frames_of_feature_points_have_frames_between() {
    let work = Work::new();
    work.write("keys.csv", "frame,fp,dx,dy\n0,8.3,0,0\n10,8.3,0.1,0\n20,8.3,0.2,0\n");
    work.grimace("synthesize -b candide -m keys.csv -o out --bound-starts 0 --format glb").exit(0);
    assert_eq!(report(&work, "out")["frames"], 21);
}

#[test]
fn free_points_are_not_moved_far_to_fit_a_few_others() {
    let work = Work::new();
    // Only the wings of the nose, which no member of the bank moves much.
    let mask = (1..=68).map(|k| if k == 61 || k == 62 { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    work.write("flare.fap", format!("2.1 flare 25 3\n{mask}\n0 0 0\n{mask}\n1 100 100\n{mask}\n2 200 200\n"));
    for solver in ["refined", "ga"] {
        work.grimace(&format!("synthesize -b head -m flare.fap -o {solver} --bound-starts 0 --format npy --solver {solver}"))
            .exit(0)
            .says(&["flare.fap: the bank also moves other points", "% of the motion is shown"]);
        // Without this limit the surface moved by 3 cm, and by 6 cm with the genetic algorithm alone; the wings of the nose
        // should move by 0.9 cm.
        let bytes = work.bytes(&format!("{solver}/surface.npy"));
        let (_, data) = bytes.split_at(10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]])));
        let numbers: Vec<f32> = data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let farthest = numbers.as_chunks::<3>().0.iter().map(|[x, y, z]| x.hypot(*y).hypot(*z)).fold(0.0, f32::max);
        assert!(farthest < 0.9, "{solver}: {farthest} cm");
    }
}

#[test]
fn a_head_that_nods_nods_in_the_gltf_file() {
    let work = Work::new();
    // The head goes down by 0.3 rad (48) and to its left by 0.1 (49); in the second file the jaw opens, too.
    let (nod, both) = (mask(&[48, 49]), mask(&[3, 48, 49]));
    work.write("nod.fap", format!("2.1 nod 25 2\n{nod}\n0 0 0\n{nod}\n1 30000 10000\n"));
    work.write("both.fap", format!("2.1 both 25 2\n{both}\n0 0 0 0\n{both}\n1 500 30000 0\n"));
    let options = "--format glb --solver nnls --bound-starts 0";
    work.grimace(&format!("synthesize -b head -m nod.fap both.fap {options} -o out"))
        .exit(0)
        .says(&["nod.fap: the head turns (FAPs 48 to 50) in animation.glb"]);
    let (document, buffers, _) = gltf::import(work.path("out/animation.glb")).unwrap();
    // All animations share the targets, so the nod has weights as well: zeros.
    for animation in document.animations() {
        let names: Vec<_> = animation.channels().map(|c| c.target().node().name().unwrap().to_owned()).collect();
        assert_eq!(names, ["face", "head"]);
    }
    let nod = document.animations().find(|a| a.name() == Some("nod")).unwrap();
    let channel = nod.channels().nth(1).unwrap();
    let reader = channel.reader(|b| Some(&buffers[b.index()]));
    let Some(gltf::animation::util::ReadOutputs::Rotations(turns)) = reader.read_outputs() else { panic!("no rotations") };
    let turns: Vec<[f32; 4]> = turns.into_f32().collect();
    let expected = nalgebra::UnitQuaternion::from_euler_angles(0.3_f32, 0.1, 0.0).coords;
    assert_eq!(turns[0], [0.0, 0.0, 0.0, 1.0]);
    assert!((0..4).all(|k| (turns[1][k] - expected[k]).abs() < 1e-6), "{turns:?} {expected}");
    // The joint lies behind and below the eyes, some 9 cm and 4 cm off.
    let head = document.nodes().find(|n| n.name() == Some("head")).unwrap();
    let at = head.transform().decomposed().0;
    let [_, y, z] = head.children().next().unwrap().transform().decomposed().0;
    assert!((at[1] + y).abs() < 1e-6 && (at[2] + z).abs() < 1e-6 && at[0].abs() < 0.01, "{at:?}");
}

#[test]
fn faps_that_a_bank_cannot_show_are_reported_and_a_still_file_is_valid() {
    let work = Work::new();
    // The lower lip comes forward (16); in the second file the jaw also opens (3).
    let (push, jaw) = (mask(&[16]), mask(&[3, 16]));
    work.write("push.fap", format!("2.1 push 25 2\n{push}\n0 0\n{push}\n1 90\n"));
    work.write("jaw.fap", format!("2.1 jaw 25 2\n{jaw}\n0 0 0\n{jaw}\n1 500 40\n"));
    let options = "--format glb --solver nnls --bound-starts 0";
    let nothing = "the motion contains no movement: animation.glb holds the neutral face, without an animation";
    work.grimace(&format!("synthesize -b head -m push.fap {options} -o push"))
        .exit(1)
        .says(&["push.fap: FAP 16 cannot be shown", "no other FAP moves"]);
    assert!(!work.path("push").exists());
    let lids = mask(&[19]);
    work.write("still.fap", format!("2.1 still 25 2\n{lids}\n0 0\n{lids}\n1 0\n"));
    work.grimace(&format!("synthesize -b head -m still.fap {options} -o still")).exit(0).says(&[nothing]);
    let (document, ..) = gltf::import(work.path("still/animation.glb")).unwrap();
    let credit = &document.as_json().asset.copyright;
    assert!(credit.as_ref().is_some_and(|text| text.contains("ICT-FaceKit") && text.contains("MIT")), "{credit:?}");
    assert_eq!((document.animations().count(), document.meshes().count()), (0, 1));
    assert!(document.accessors().all(|a| a.count() > 0) && document.views().all(|v| v.length() > 0));
    let moves = work.grimace(&format!("synthesize -b head -m jaw.fap {options} -o jaw")).exit(0);
    assert!(!moves.stderr.contains("no movement"), "{}", moves.stderr);
    moves.says(&["jaw.fap: FAP 16 cannot be shown by this bank"]);
    assert_eq!(report(&work, "jaw")["motion"]["faps_not_shown"], serde_json::json!([16]));
    let (document, ..) = gltf::import(work.path("jaw/animation.glb")).unwrap();
    assert_eq!(document.animations().count(), 1);
    // A still face beside a moving one: an animation of two key frames with weights 0.
    work.grimace(&format!("synthesize -b head -m still.fap jaw.fap {options} -o both")).exit(0);
    assert_eq!(gltf::import(work.path("both/animation.glb")).unwrap().0.animations().count(), 2);
}
