//! `grimace synthesize` and `evaluate synthesis`: inputs, outputs and errors.

use crate::cmd_synthesize_faps::mask;
use crate::common::{Work, root};
use serde_json::Value;

pub fn report(work: &Work, folder: &str) -> Value {
    serde_json::from_str(&work.read(&format!("{folder}/synthesis.json"))).unwrap()
}

/// Returns a representative in face units: Candide-3's nodes, with the mouth corners moving up and out over five frames.
fn representative() -> String {
    let wireframe = grimace::internal::wireframe::Wireframe::candide3();
    let mut text = String::from("frame,node,x,y\n");
    for frame in 0..5 {
        for (node, point) in wireframe.frontal().iter().enumerate() {
            let (mut x, mut y) = (point.x * 1024.0 / 0.613, point.y * 1024.0 / 0.613);
            let share = f64::from(frame) / 4.0;
            // Corners and their neighbours move; everything else jitters by less than a hundredth of that.
            match node {
                31 | 88 => (x, y) = (x + 90.0 * share, y + 100.0 * share),
                64 | 89 => (x, y) = (x - 90.0 * share, y + 100.0 * share),
                79 | 85 => (x, y) = (x + 40.0 * share, y + 40.0 * share),
                80 | 86 => (x, y) = (x - 40.0 * share, y + 40.0 * share),
                _ => x += 0.5 * f64::from((node as u32 + frame) % 3) * share,
            }
            text += &format!("{frame},{node},{x},{y}\n");
        }
    }
    text
}

#[test]
fn a_representative_drives_the_embedded_bank() {
    let work = Work::new();
    work.write("happiness.csv", representative());
    let ran = work.grimace("synthesize -b candide -m happiness.csv -o out --bound-starts 2").exit(0);
    let ran = ran.prints(&["25 frames, 24 of them move", "share of the bound", "jump in time"]);
    let report = report(&work, "out");
    assert!(report["fitness"].as_f64().unwrap() > 0.7, "{report}");
    assert!((0.9..=1.0).contains(&report["share_of_bound"].as_f64().unwrap()), "{report}");
    // The share shown, which the fitness does not contain, is in the summary, the report and the table of frames.
    let shown = report["shown"].as_f64().unwrap();
    ran.prints(&[&format!("share shown       {shown:.4}")]);
    let rows = work.rows("out/fitness.csv");
    assert!(work.read("out/fitness.csv").starts_with("frame,region,fitness,bound,share_of_bound,shown\n0,whole,,,,\n"));
    let mean = rows[1..].iter().map(|row| row["shown"].parse::<f64>().unwrap()).sum::<f64>() / 24.0;
    assert!((mean - shown).abs() < 1e-6 && (0.3..1.0).contains(&shown), "{mean} {shown}");
    let number = |row: &std::collections::BTreeMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
    assert!(rows[1..].iter().all(|row| number(row, "fitness") <= number(row, "bound")));
    assert_eq!(report["motion"]["kind"], "model");
    let (document, _, _) = gltf::import(work.path("out/animation.glb")).unwrap();
    assert_eq!(document.animations().next().unwrap().name(), Some("happiness"));
    let names = document.meshes().next().unwrap().extras().as_ref().unwrap().get().to_owned();
    assert!(names.contains("targetNames") && names.contains("happiness"), "{names}");
    for file in ["contact_sheet.png", "turntable.png"] {
        assert!(work.bytes(&format!("out/{file}")).starts_with(b"\x89PNG"));
    }
    assert!(work.bytes("out/turntable.gif").starts_with(b"GIF89a"));
    assert_eq!(work.read("out/weights.csv").lines().count(), 26);
    // The units of Candide have no ARKit names.
    assert!(!work.path("out/arkit.csv").exists());
    assert!(!work.path("out/unfinished.txt").exists());
    work.grimace("synthesize -b candide -m happiness.csv -o out").exit(1).says(&["out is not empty", "--force"]);
}

#[test]
fn only_its_own_files_are_overwritten_and_removed() {
    let work = Work::new();
    work.write("a.csv", "frame,fp,dx,dy\n0,8.3,0,0\n1,8.3,0.1,0\n").write("b.csv", "frame,fp,dx,dy\n0,8.3,0,0\n1,8.3,0.2,0\n");
    let command = "synthesize -b candide --bound-starts 0 --solver nnls --format glb,obj -q -o out";
    work.grimace(&format!("{command} -m a.csv b.csv")).exit(0);
    assert!(work.path("out/a/obj/frame_001.obj").exists() && !work.path("out/unfinished.txt").exists());
    // After an interruption the next run adopts its files and removes those that it does not make again.
    work.write("out/unfinished.txt", "").write("out/a/mine.txt", "mine").write("out/b/fitness.csv", "cut off");
    work.grimace(&format!("{command} -m a.csv"))
        .exit(0)
        .says(&["b/fitness.csv: this file of an earlier `synthesize` was changed by hand and is kept"]);
    assert!(!work.path("out/unfinished.txt").exists() && !work.path("out/a/obj").exists());
    assert!(work.path("out/obj/frame_001.obj").exists() && work.path("out/a/mine.txt").exists());
    // With --force it overwrites its own results, but no other files.
    work.grimace(&format!("{command} -m a.csv")).exit(1).says(&["out is not empty", "--force"]);
    work.grimace(&format!("{command} -m b.csv --force")).exit(0);
    work.write("out/animation.glb", "mine");
    let kept = work.files("out");
    work.grimace(&format!("{command} -m b.csv --force"))
        .exit(1)
        .says(&["out/animation.glb: this file exists and differs from what an earlier `synthesize` wrote; move it away, or choose another folder"]);
    crate::common::assert_same_files(&kept, &work.files("out"));
    std::fs::remove_file(work.path("out/animation.glb")).unwrap();
    // Two runs at the same time.
    let record = std::fs::File::options().append(true).open(work.path("out/synthesize.b3")).unwrap();
    record.lock().unwrap();
    work.grimace(&format!("{command} -m b.csv --force")).exit(1).says(&["another command is writing into this folder"]);
    drop(record);
    work.grimace(&format!("{command} -m b.csv --force")).exit(0);
    work.write("file", "").grimace("synthesize -b candide -m a.csv -o file --force").exit(1).says(&["file: this is a file"]);
    work.write("c/a.csv", work.read("b.csv"));
    // Motions of one name get what tells them apart, and one that cannot be read does not stop the others.
    work.write("bad.fap", "nonsense");
    work.grimace(&format!("{command}2 -m a.csv bad.fap c/a.csv")).exit(3).says(&["failed: bad.fap"]);
    assert!(work.path("out2/a/synthesis.json").exists() && work.path("out2/a-c/synthesis.json").exists());
    let (document, _, _) = gltf::import(work.path("out2/animation.glb")).unwrap();
    assert_eq!(document.animations().map(|one| one.name().unwrap().to_owned()).collect::<Vec<_>>(), ["a", "a-c"]);
    work.grimace(&format!("{command}3 -m bad.fap gone.fap")).exit(1).says(&[
        "no motion can be synthesized",
        "bad.fap",
        "gone.fap",
    ]);
    assert!(!work.path("out3").exists());
}

#[test]
fn a_motion_that_the_bank_cannot_show_is_reported_and_rests() {
    let work = Work::new();
    // The jaw moves sideways, the nose bends: no member of `head` does this, because both sides of its members move alike.
    for (fap, name) in [(15, "jaw"), (64, "nose")] {
        let mask = mask(&[fap]);
        work.write(&format!("{name}.fap"), format!("2.1 {name} 25 3\n{mask}\n0 0\n{mask}\n1 150\n{mask}\n2 300\n"));
        for regions in [1, 4] {
            let out = format!("{name}-{regions}");
            let ran = work
                .grimace(&format!(
                    "synthesize -b head -m {name}.fap -o {out} --format npy --regions {regions} --bound-starts 0 -q"
                ))
                .exit(0);
            assert!(!ran.stderr.contains("% of the motion is shown"), "{}", ran.stderr);
            ran.says(&[
                "warning: ",
                "no mixture of the bank's members moves the feature points like this (fitness 0), so ",
                "2 frames with motion",
            ]);
            let weights = work.rows(&format!("{out}/weights.csv"));
            let rests = |(name, value): (&String, &String)| name == "frame" || name == "region" || value == "0";
            assert!(weights.iter().all(|row| row.iter().all(rests)), "{weights:?}");
            assert_eq!(report(&work, &out)["fitness"], 0.0);
        }
    }
    // The suggested commands work and show the motion.
    work.write("W.csv", "member,shape,weight\njawLeft,jawLeft,1\njawRight,jawRight,1\n");
    work.grimace("bank mix head --weights W.csv -o own.bank").exit(0);
    let ran = work.grimace("synthesize -b own.bank -m jaw.fap -o own --format npy --bound-starts 0").exit(0);
    assert!(!ran.stderr.contains("no mixture"), "{}", ran.stderr);
    assert!(report(&work, "own")["fitness"].as_f64().unwrap() > 0.3);
}

#[test]
fn a_truth_with_holes_and_a_face_in_other_units_are_refused() {
    let work = Work::new();
    work.write("m.csv", "frame,fp,dx,dy\n0,8.3,0,0\n1,8.3,0.1,0\n");
    work.grimace("synthesize -b candide -m m.csv -o truth --format npy --solver nnls").exit(0);
    let whole = work.bytes("truth/surface.npy");
    let vertices = 23_424;
    for bad in [f32::NAN, f32::INFINITY] {
        let mut bytes = whole.clone();
        let start = bytes.len() - vertices * 12 + 7 * 12 + 4;
        bytes[start..start + 4].copy_from_slice(&bad.to_le_bytes());
        work.write("bad.npy", bytes);
        work.grimace("synthesize -b candide -m m.csv -o x --format npy --truth bad.npy")
            .exit(1)
            .says(&["bad.npy: frame 1 has vertex 7 at (", "finite numbers were expected"]);
        assert!(!work.path("x").exists());
    }
    let text = std::fs::read_to_string(root().join("fixtures/golden/representatives/happiness.csv")).unwrap();
    let changed = |change: &dyn Fn(f64, f64) -> (f64, f64)| {
        let row = |line: &str| {
            let fields: Vec<&str> = line.split(',').collect();
            let (x, y) = change(fields[2].parse().unwrap(), fields[3].parse().unwrap());
            format!("{},{},{x},{y}\n", fields[0], fields[1])
        };
        text.lines().next().unwrap().to_owned() + "\n" + &text.lines().skip(1).map(row).collect::<String>()
    };
    work.write("right.csv", &text);
    work.write("down.csv", changed(&|x, y| (x, -y))).write("px.csv", changed(&|x, y| (300.0 + x / 10.0, 200.0 - y / 10.0)));
    work.write("side.csv", changed(&|x, y| (-x, y))).write("small.csv", changed(&|x, y| (x / 1024.0, y / 1024.0)));
    let portrait = root().join("fixtures/portraits/P01.jpg");
    for (name, said) in [
        ("down", "is upside down"),
        ("px", "is upside down"),
        ("side", "is mirrored"),
        ("small", "0.001 times as wide and 0.001 times as high"),
    ] {
        let says = format!("{name}.csv: its neutral face {}{said}", if name == "small" { "is " } else { "" });
        for command in [
            format!("synthesize -b candide -m {name}.csv -o x"),
            format!("clone -s {name}.csv -t {} -o x", portrait.display()),
            format!("play {name}.csv -o x.html"),
        ] {
            work.grimace(&command).exit(1).says(&[&says]);
        }
    }
    work.grimace("play right.csv --bank candide -o right.html -q").exit(0);
}

#[test]
fn another_rate_is_reported_and_keeps_the_frames() {
    let work = Work::new();
    let jaw = mask(&[3]);
    work.write("jaw.fap", format!("2.1 jaw 25 3\n{jaw}\n0 0\n{jaw}\n1 200\n{jaw}\n2 400\n"));
    let command = "synthesize -b candide -m jaw.fap --solver nnls --bound-starts 0 --format glb";
    work.grimace(&format!("{command} --fps 50 -o fast"))
        .exit(0)
        .says(&["jaw.fap: the motion has 25 frames per second and is shown at 50: it plays 2.000 times as fast"]);
    assert_eq!(report(&work, "fast")["frames"], 3);
    let ran = work.grimace(&format!("{command} --fps 25 -o same")).exit(0);
    assert!(!ran.stderr.contains("frames per second"), "{}", ran.stderr);
}

#[test]
fn a_head_wears_a_portrait_in_gltf_and_pictures() {
    let work = Work::new();
    work.write("happiness.csv", representative());
    let folder = crate::common::root().join("fixtures/portraits");
    std::fs::copy(folder.join("P03.jpg"), work.path("anna.jpg")).unwrap();
    std::fs::copy(folder.join("P03_correspondences.csv"), work.path("marks.csv")).unwrap();
    let command = "synthesize --bank head --motion happiness.csv --between 0 --bound-starts 0";
    work.grimace(&format!("{command} -o plain")).exit(0);
    work.grimace(&format!("{command} -o worn --portrait anna.jpg --correspondences marks.csv")).exit(0);
    work.grimace(&format!("{command} -o found --portrait anna.jpg --format glb")).exit(0);
    let read = |name: &str| gltf::import(work.path(&format!("{name}/animation.glb"))).unwrap();
    let materials = |name: &str| read(name).0.materials().map(|m| m.name().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(materials("plain"), ["skin", "eyes", "mouth", "hair"]);
    assert_eq!(materials("worn"), ["skin", "eyes", "mouth"]);
    assert!(read("plain").2.is_empty());
    assert_eq!((read("worn").2[0].width, read("found").2.len()), (2048, 1));
    // The same motion, another skin.
    assert_eq!(work.bytes("plain/weights.csv"), work.bytes("worn/weights.csv"));
    assert_ne!(work.bytes("plain/turntable.png"), work.bytes("worn/turntable.png"));
    assert_eq!(report(&work, "worn")["portrait"]["correspondences"]["file"], "marks.csv");
    // The output can be the source of a bank. Each vertex appears once, although three materials use it.
    // Copies along the seam of the texture follow those of the bank.
    let (document, _, _) = read("worn");
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    let vertices = primitive.get(&gltf::Semantic::Positions).unwrap().count() as u64;
    let of_bank = report(&work, "worn")["bank"]["vertices"].as_u64().unwrap();
    assert!((of_bank..of_bank + 50).contains(&vertices), "{vertices} of {of_bank}");
    let points = |last: u64| format!("fp,vertex\n8.3,10\n8.4,20\n3.11,{last}\n");
    work.write("points.csv", points(vertices - 1)).write("beyond.csv", points(vertices));
    work.grimace("bank build worn/animation.glb --feature-points points.csv -o again.bank").exit(0);
    work.grimace("bank build worn/animation.glb --feature-points beyond.csv -o x.bank")
        .exit(1)
        .says(&[&format!("has {vertices} vertices")]);
    work.grimace(&format!("{command} -o x --correspondences marks.csv")).exit(2).says(&["--portrait"]);
    work.grimace("synthesize --bank candide --motion happiness.csv -o x --portrait anna.jpg")
        .exit(1)
        .says(&["`candide`", "--bank head"]);
    work.grimace(&format!("{command} -o x --portrait gone.jpg")).exit(1).says(&["gone.jpg"]);
    work.write("empty.png", "");
    work.grimace(&format!("{command} -o x --portrait empty.png")).exit(1).says(&["empty.png"]);
}

#[test]
fn several_motions_are_animations_of_one_file_in_metres_and_loop() {
    let work = Work::new();
    work.write("smile.csv", representative()).write("wide.csv", representative());
    let options = "--loop --format glb --solver nnls --bound-starts 0";
    work.grimace(&format!("synthesize -b candide -m smile.csv wide.csv {options} -c 2 -o out"))
        .exit(0)
        .prints(&["smile:", "wide:"]);
    let (document, buffers, _) = gltf::import(work.path("out/animation.glb")).unwrap();
    let names: Vec<_> = document.animations().map(|a| a.name().unwrap().to_owned()).collect();
    assert_eq!(names, ["smile", "wide"]);
    assert_eq!(document.meshes().count(), 1);
    for animation in document.animations() {
        let channel = animation.channels().next().unwrap();
        let reader = channel.reader(|b| Some(&buffers[b.index()]));
        // 25 frames there, half a second of 12.5 frames, 24 back.
        assert_eq!(reader.read_inputs().unwrap().count(), 25 + 13 + 24);
        let gltf::animation::util::ReadOutputs::MorphTargetWeights(weights) = reader.read_outputs().unwrap() else { panic!() };
        let weights: Vec<f32> = weights.into_f32().collect();
        assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)) && weights.iter().any(|w| *w > 0.1), "{weights:?}");
        let targets = weights.len() / (25 + 13 + 24);
        assert_eq!(weights[..targets], weights[weights.len() - targets..]);
    }
    // The pupils of a head are 63 mm apart: its face is about a quarter of a metre high.
    let scale = document.nodes().next().unwrap().transform().decomposed().2[1];
    let bounds = document.meshes().next().unwrap().primitives().next().unwrap().bounding_box();
    let height = scale * (bounds.max[1] - bounds.min[1]);
    assert!((0.15..0.35).contains(&height), "{height} m");
    // The files of each motion are in a separate folder.
    for name in names {
        assert!(
            work.path(&format!("out/{name}/weights.csv")).exists() && !work.path(&format!("out/{name}/animation.glb")).exists()
        );
        assert_eq!(report(&work, &format!("out/{name}"))["frames"], 62);
    }
    work.grimace(&format!("synthesize -b candide -m smile.csv smile.csv {options} -o twice"))
        .exit(1)
        .says(&["smile.csv: this motion is given twice"]);
}

#[test]
fn the_same_bytes_for_any_number_of_threads() {
    let work = Work::new();
    work.write("m.csv", representative());
    let run = |out: &str, threads: u8| {
        let args = format!(
            "synthesize -b candide -m m.csv -o {out} --solver ga --runs 2 --regions 4 --bound-starts 2 -j {threads} --between 1 --history"
        );
        work.grimace(&args).exit(0);
    };
    run("one", 1);
    run("three", 3);
    crate::common::assert_same_files(&work.files("one"), &work.files("three"));
}

#[test]
fn tracks_and_fap_files_are_motions_too() {
    let work = Work::after_run(&["S001_005"], "results");
    for (motion, kind) in [("results/tracks/S001_005.csv", "track"), ("results/fap/happiness.fap", "fap")] {
        work.grimace(&format!("synthesize -b candide -m {motion} -o {kind} --format npy --bound-starts 1")).exit(0);
        let report = report(&work, kind);
        assert_eq!(report["motion"]["kind"], kind);
        // The fitness for a noisy track of small frames depends on the bank; the solver must nearly reach the bound.
        assert!(report["share_of_bound"].as_f64().unwrap() > 0.8, "{report}");
    }
    // All 6 frames of the track; the FAP file has 25.
    assert_eq!((report(&work, "track")["frames"].clone(), report(&work, "fap")["frames"].clone()), (6.into(), 25.into()));
}

#[test]
fn every_solver_and_format_runs_and_truth_is_compared() {
    let work = Work::new();
    work.write("m.csv", "frame,fp,dx,dy,dz\n0,8.3,0.1,0.1,0\n0,8.4,-0.1,0.1,0\n0,2.1,0,-0.05,0\n1,8.3,0.2,0.2,0\n1,8.4,-0.2,0.2,0\n1,2.1,0,-0.1,0\n");
    work.grimace("synthesize -b candide -m m.csv -o truth --format npy --solver nnls --smooth 0").exit(0);
    for solver in ["best", "rbf", "nnls", "ga", "refined", "cosine"] {
        let args = format!(
            "synthesize -b candide -m m.csv -o {solver} --solver {solver} --format npy,glb --truth truth/surface.npy --smooth 0 --bound-starts 2"
        );
        work.grimace(&args).exit(0).prints(&["surface error"]);
    }
    assert_eq!(report(&work, "nnls")["surface_error"]["mean"], 0.0);
    assert!(report(&work, "rbf")["surface_error"]["mean"].as_f64().unwrap() > 0.1);
    work.grimace("synthesize -b candide -m m.csv -o meshes --format obj,ply --regions 2").exit(0);
    let (obj, ply) = (work.path("meshes/obj/frame_001.obj"), work.path("meshes/ply/frame_001.ply"));
    let (obj, ply) = (grimace::internal::mesh::read_obj(&obj).unwrap(), grimace::internal::mesh::read_ply(&ply).unwrap());
    assert_eq!(obj, ply);
    assert_eq!(obj.vertex_count(), 23_424);
    work.grimace("synthesize -b candide -m m.csv -o x --truth rbf/synthesis.json").exit(1).says(&["no .npy array"]);
}

#[test]
fn a_motion_of_zeros_is_the_neutral_face_and_says_so() {
    let work = Work::new();
    work.write("m.csv", "frame,fp,dx,dy,dz\n0,8.3,0,0,0\n1,8.3,0,0,0\n");
    for solver in ["best", "rbf", "nnls", "ga", "refined", "cosine"] {
        // Pictures are made of a face at rest, too.
        let formats = if solver == "best" { "npy,pictures" } else { "npy" };
        let ran =
            work.grimace(&format!("synthesize -b candide -m m.csv -o {solver} --solver {solver} --format {formats}")).exit(0);
        ran.prints(&["the motion contains no movement: every frame is the neutral face"]);
        let bytes = work.bytes(&format!("{solver}/surface.npy"));
        assert!(bytes[bytes.len() - 2 * 23_424 * 12..].iter().all(|&b| b == 0 || b == 0x80), "{solver}");
    }
}

#[test]
fn a_target_opposite_to_every_member_has_a_result() {
    let work = Work::new();
    // No expression pushes the chin up by so much without moving anything else.
    work.write("m.csv", "frame,fp,dx,dy,dz\n0,2.1,0,1,0\n0,2.11,0,1,0\n0,2.12,0,1,0\n");
    let ran = work.grimace("synthesize -b candide -m m.csv -o out --solver ga --format npy").exit(0);
    ran.prints(&["share of the bound"]);
    work.grimace("synthesize -b candide -m m.csv -o nnls --solver nnls --format npy").exit(0);
    assert!(report(&work, "out")["fitness"].is_number());
}

#[test]
fn bad_input_is_named() {
    let work = Work::new();
    work.write("m.csv", "frame,fp,dx,dy\n0,8.3,1,1\n");
    let says = |args: &str, texts: &[&str]| {
        work.grimace(&format!("synthesize -o out {args}")).exit(1).says(texts);
        assert!(!work.path("out").exists());
    };
    says("-b gone.bank -m m.csv", &["gone.bank"]);
    says("-b candide -m gone.csv", &["gone.csv"]);
    work.grimace("synthesize -o out -b candide -m m.csv --regions 3").exit(2).says(&["expected 1, 2 or 4"]);
    // Values that would give no number, take all memory or never end.
    for beyond in
        ["--generations 18446744073709551615", "--population 1000000000000", "--fps 1e-40", "--fps 1e60", "--scale 1e40"]
    {
        work.grimace(&format!("synthesize -o out -b candide -m m.csv {beyond}")).exit(2).says(&["expected a"]);
    }
    for beyond in ["--smooth 3e8", "--smooth 1e-200", "-c 1e300"] {
        says(&format!("-b candide -m m.csv {beyond}"), &["expected"]);
    }
    work.write("fast.fap", "2.1 fast 2147483647 2\n".to_owned() + &format!("{0}\n0 0\n{0}\n1 9\n", mask(&[19])));
    says("-b candide -m fast.fap --loop", &["fast.fap: cannot write 2147483647 frames per second", "--fps"]);
    work.write("empty.csv", "frame,fp,dx,dy\n");
    says("-b candide -m empty.csv", &["the table has no rows"]);
    work.write("far.csv", "frame,fp,dx,dy\n0,8.3,1,1\n4000000000,8.3,1,1\n");
    says("-b candide -m far.csv", &["2 frames, numbered from 0 to 4000000000"]);
    says("-b candide -m m.csv --tournament 1", &["the tournament's size is 1"]);
    says("-b candide -m m.csv --solver ga --crossover blx --alpha 2", &["alpha is 2"]);
    says("-b candide -m m.csv --overlap 2", &["the overlap is 2"]);
    says("-b candide -m m.csv --smooth=-1", &["the smoothing is -1"]);
    says("-b candide -m m.csv --noise 1", &["--noise 1"]);
    work.write("bad.csv", "frame,fp,dx,dy\n0,8.3,1,inf\n");
    says("-b candide -m bad.csv", &["bad.csv, line 2: dy is `inf`"]);
    work.write("other.csv", "frame,fp,dx,dy\n0,6.1,1,1\n");
    says("-b candide -m other.csv", &["no feature points in common"]);
    work.write("bad.fap", "nonsense");
    says("-b candide -m bad.fap", &["bad.fap"]);
    work.grimace("synthesize -b candide -m m.csv -o out -c 0").exit(2);
    let file = "notes.txt: --output must name a folder, but this name ends in .txt like a file; name a folder (choose the files with --format";
    work.grimace("synthesize -b candide -m m.csv -o notes.txt").exit(1).says(&[file]);
}

#[test]
fn a_bank_of_one_member_and_arkit_names_work() {
    let work = Work::new();
    let obj = |y: f64| format!("v 0 0 0\nv 1 {y} 0\nv 0 1 0\nf 1 2 3\n");
    work.write("meshes/neutral.obj", obj(0.0));
    work.write("meshes/jawOpen.obj", obj(-0.5));
    work.write("meshes/feature_points.csv", "fp,vertex\n2.1,1\n");
    work.grimace("bank build meshes -o one.bank").exit(0);
    work.write("m.csv", "frame,fp,dx,dy,dz\n0,2.1,0,-0.25,0\n1,2.1,0,-0.5,0\n");
    for solver in ["best", "nnls", "ga", "refined", "cosine"] {
        let format = if solver == "best" { "pictures" } else { "npy" };
        work.grimace(&format!("synthesize -b one.bank -m m.csv -o {solver} --solver {solver} --format {format} --fps 10"))
            .exit(0)
            .prints(&["fitness           1.0000"]);
        let live_link = work.read(&format!("{solver}/livelink.csv"));
        // Ten frames per second: the second frame is number 1 of second 0.
        assert!(live_link.starts_with("Timecode,BlendShapeCount,EyeBlinkLeft,"), "{live_link}");
        assert!(live_link.lines().nth(2).unwrap().starts_with("00:00:00:01.000,61,0,"), "{live_link}");
        let arkit = work.read(&format!("{solver}/arkit.csv"));
        let mut rows = csv::Reader::from_reader(arkit.as_bytes());
        let header = rows.headers().unwrap().clone();
        assert_eq!(header.len(), 54);
        let jaw = header.iter().position(|h| h == "jawOpen").unwrap();
        let values: Vec<f64> = rows.records().map(|r| r.unwrap()[jaw].parse().unwrap()).collect();
        assert!((values[0] - 0.5).abs() < 1e-6 && (values[1] - 1.0).abs() < 1e-6, "{solver}: {values:?}");
        assert!(arkit.lines().nth(2).unwrap().starts_with("1,0.1,"));
    }
    // In the opposite direction the member could only be subtracted: it stays at rest.
    work.write("up.csv", "frame,fp,dx,dy,dz\n0,2.1,0,0.5,0\n");
    work.grimace("synthesize -b one.bank -m up.csv -o up --solver ga --format npy")
        .exit(0)
        .prints(&["fitness           0.0000"])
        .says(&["the face rests in the only frame with motion"]);
}

#[test]
fn evaluate_synthesis_repeats_the_papers_tables() {
    let work = Work::new();
    let args = "evaluate synthesis --targets 2 --region-targets 2 --runs 2 --bound-starts 2";
    work.grimace("bank mix candide --performance 12 --members 8 -o few.bank --unseen rest.bank").exit(0);
    work.grimace("evaluate synthesis few.bank --unseen few.bank -o seen")
        .exit(1)
        .says(&["--unseen few.bank: its member", "is also in the bank"]);
    let ran = work.grimace(&format!("{args} -o out")).exit(0);
    ran.prints(&["| midpoint", "| line", "| blx-0.2", "0.970", "| refined", "40000"]);
    for file in
        ["crossovers.csv", "solvers.csv", "time.csv", "history.csv", "history.svg", "surface_error.svg", "evaluation.json"]
    {
        assert!(work.path(&format!("out/{file}")).is_file(), "{file}");
    }
    // Six solvers with the whole face, five each with two and with four regions.
    assert_eq!(work.read("out/solvers.csv").lines().count(), 1 + 6 + 5 + 5);
    work.grimace(&format!("{args} -o again -j 1 -q")).exit(0);
    let (mut first, mut again) = (work.files("out"), work.files("again"));
    first.remove("time.csv");
    again.remove("time.csv");
    crate::common::assert_same_files(&first, &again);
    work.grimace("evaluate synthesis --alphas 2 -o x").exit(1).says(&["alpha is 2"]);
}
