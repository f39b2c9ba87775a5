//! `grimace bank`: sources, mixing, messages and errors.

use std::fs;

use crate::common::{Work, root};

/// Writes a face of nine vertices in a folder of OBJ files: neutral, `smile` (corners up) and `open` (lower row down).
fn meshes(work: &Work) {
    let obj = |offset: &dyn Fn(usize) -> [f64; 3]| {
        let mut text = String::from("# a face\n");
        for k in 0..9 {
            let [x, y, z] = offset(k);
            text += &format!("v {} {} {}\n", (k % 3) as f64 - 1.0 + x, (k / 3) as f64 - 1.0 + y, z);
        }
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let a = 3 * row + column + 1;
            text += &format!("f {a} {} {} {}\n", a + 1, a + 4, a + 3);
        }
        text
    };
    work.write("meshes/neutral.obj", obj(&|_| [0.0; 3]));
    work.write("meshes/smile.obj", obj(&|k| if k == 3 || k == 5 { [0.0, 0.5, 0.1] } else { [0.0; 3] }));
    work.write("meshes/open.obj", obj(&|k| if k < 3 { [0.0, -0.4, 0.0] } else { [0.0; 3] }));
    work.write("meshes/feature_points.csv", "fp,vertex\n8.3,5\n8.4,3\n2.1,1\n");
}

#[test]
fn a_folder_becomes_a_bank_that_describes_its_content() {
    let work = Work::new();
    meshes(&work);
    let ran = work.grimace("bank build meshes -o face.bank --unit cm --credit me").exit(0);
    ran.prints(&["9 vertices, 8 triangles, 2 members", "3 feature points", "lacks 53 of the 56 feature points"]);
    let ran = work.grimace("bank info face.bank --picture face.png --save-feature-points fp.csv").exit(0);
    ran.prints(&[
        "vertices        9",
        "members         2",
        "unit            cm",
        "credit          me",
        "8.3 8.4 2.1",
        "smile",
        "0.5099",
    ]);
    assert_eq!(work.read("fp.csv"), "fp,vertex\n8.3,5\n8.4,3\n2.1,1\n");
    assert!(work.bytes("face.png").starts_with(b"\x89PNG"));
    work.grimace("bank build meshes -o face.bank").exit(1).says(&["face.bank exists; give --force"]);
    let first = work.bytes("face.bank");
    work.grimace("bank build meshes -o face.bank --unit cm --credit me --force").exit(0);
    assert_eq!(work.bytes("face.bank"), first);
}

#[test]
fn texts_of_a_bank_file_are_printed_on_one_line() {
    let work = Work::new();
    meshes(&work);
    work.grimace("bank build meshes -o face.bank --unit cm --credit abcde").exit(0);
    let mut bytes = work.bytes("face.bank");
    // A line break in a name and in the credit, as in JSON within JSON.
    for (found, odd) in [(b"abcde", br"a\\ne"), (b"smile", br"s\\ne")] {
        let at = bytes.windows(5).position(|w| w == found).unwrap();
        bytes.splice(at..at + 5, odd.iter().copied());
    }
    work.write("odd.bank", bytes);
    work.grimace("bank info odd.bank").exit(0).prints(&["credit          a\\ne\n", "  s\\ne "]);
}

#[test]
fn files_from_which_a_bank_is_built_are_not_overwritten() {
    let work = Work::new();
    meshes(&work);
    let before = work.files("meshes");
    for file in ["neutral.obj", "smile.obj", "feature_points.csv"] {
        let over = format!("{file}: --output would overwrite a file of SOURCE; give it another name");
        work.grimace(&format!("bank build meshes -o meshes/{file} --force")).exit(1).says(&[&over]);
        let save = format!("bank build meshes -o face.bank --save-feature-points meshes/{file} --force");
        work.grimace(&save).exit(1).says(&["--save-feature-points would overwrite a file of SOURCE"]);
    }
    crate::common::assert_same_files(&before, &work.files("meshes"));
    // A bank may be in the folder of its meshes, and may be built again.
    for _ in 0..2 {
        work.grimace("bank build meshes -o meshes/face.bank --force").exit(0);
    }
    // A .gltf file with its buffers beside it; arrays with their description.
    work.write("a.gltf", r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4,"uri":"a%62.bin"}]}"#).write("ab.bin", "1234");
    for file in ["a.gltf", "ab.bin"] {
        work.grimace(&format!("bank build a.gltf -o {file} --force")).exit(1).says(&["would overwrite"]);
    }
    work.write("arrays/neutral_vertices.npy", "x").write("arrays/manifest.json", "{}");
    work.grimace("bank build arrays -o arrays/manifest.json --force").exit(1).says(&["would overwrite a file of SOURCE"]);
}

#[test]
fn feature_points_that_mpeg4_does_not_have_are_refused() {
    let work = Work::new();
    meshes(&work);
    work.write("meshes/feature_points.csv", "fp,vertex\n8.3,5\n99.3,3\n");
    work.grimace("bank build meshes -o face.bank").exit(1).says(&["feature_points.csv, line 3: fp is `99.3`", "MPEG-4"]);
    // The same for a bank file: 8.3 becomes 77.3.
    work.write("meshes/feature_points.csv", "fp,vertex\n8.3,5\n");
    work.grimace("bank build meshes -o face.bank").exit(0);
    let mut bytes = work.bytes("face.bank");
    let point = [8_u32, 3, 5].map(u32::to_le_bytes).concat();
    let place = bytes.windows(12).position(|w| w == point).unwrap();
    bytes[place] = 77;
    work.write("odd.bank", bytes);
    work.grimace("bank info odd.bank")
        .exit(1)
        .says(&["odd.bank is not a readable bank: feature point 77.3 (vertex 5) is not one of the 84"]);
}

#[test]
fn subdivision_keeps_the_numbers_of_feature_points() {
    let work = Work::new();
    meshes(&work);
    // 16 edges of 8 triangles: 9 + 16 vertices, 32 triangles.
    work.grimace("bank build meshes -o fine.bank --subdivide 1").exit(0).prints(&["25 vertices, 32 triangles"]);
    work.grimace("bank info fine.bank --save-feature-points fp.csv").exit(0);
    assert_eq!(work.read("fp.csv"), "fp,vertex\n8.3,5\n8.4,3\n2.1,1\n");
}

#[test]
fn arrays_and_gltf_are_sources_too() {
    let work = Work::new();
    meshes(&work);
    work.grimace("bank build meshes -o face.bank").exit(0);
    work.write("m.csv", "frame,fp,dx,dy,dz\n0,8.3,0,1,0.2\n0,8.4,0,1,0.2\n0,2.1,0,-0.4,0\n");
    work.grimace("synthesize -b face.bank -m m.csv -o out --format glb").exit(0);
    work.write("fp.csv", "fp,vertex\n8.3,5\n8.4,3\n2.1,1\n");
    work.grimace("bank build out/animation.glb --feature-points fp.csv -o again.bank")
        .exit(0)
        .prints(&["9 vertices, 8 triangles, 2 members"]);
    work.grimace("bank build out/animation.glb --feature-points fp.csv -o x.bank --mesh Nose")
        .exit(1)
        .says(&["`Nose`", "(2 targets)"]);
    work.grimace("bank build meshes -o x.bank --mesh Nose")
        .exit(1)
        .says(&["needs a .glb or .gltf file; other sources have no named meshes"]);
    work.grimace("bank info again.bank").exit(0).prints(&["smile", "open", "unit            metre"]);
}

#[test]
fn shapes_mix_to_members() {
    let work = Work::new();
    meshes(&work);
    work.grimace("bank build meshes -o shapes.bank").exit(0);
    work.write("mix.csv", "member,shape,weight\nlaugh,smile,1\nlaugh,open,0.5\nwide,smile,2\n");
    work.grimace("bank mix shapes.bank --weights mix.csv -o face.bank --save-weights again.csv").exit(0).prints(&["2 members"]);
    work.grimace("bank info face.bank").exit(0).prints(&["mixed from      2 shapes", "laugh", "wide                     1.0198"]);
    assert!(work.read("again.csv").contains("laugh,open,0.5"));
    work.write("bad.csv", "member,shape,weight\nlaugh,frown,1\n");
    work.grimace("bank mix shapes.bank --weights bad.csv -o b.bank")
        .exit(1)
        .says(&["there is no `frown`; choose from open, smile"]);
    work.grimace("bank mix shapes.bank --performance 20 -o b.bank").exit(1).says(&["do not have ARKit names", "--expressions"]);
    work.grimace("bank mix shapes.bank -o b.bank").exit(2);
    let seeded = "bank mix shapes.bank --performance 40 --expressions mix.csv --members 6 --unseen rest.bank";
    work.grimace(&format!("{seeded} --seed 4 -o p.bank")).exit(0).prints(&["6 members", "34 members"]);
    work.grimace("bank info p.bank").exit(0).prints(&["laugh", "frame_0"]);
}

#[test]
fn a_bank_file_of_version_1_is_read_with_a_warning_and_converted() {
    let work = Work::new();
    work.write("old.bank", fs::read(root().join("fuzz/seeds/bank/version-1.bank")).unwrap());
    let ran = work.grimace("bank info old.bank").exit(0);
    let ran = ran.prints(&["vertices        4", "members         1", "mapped", "smile                    0.5000"]);
    ran.says(&["warning: old.bank: this bank file is of version 1; `grimace bank convert old.bank -o NEW.bank`"]);
    work.grimace("bank convert old.bank -o new.bank").exit(0).prints(&["1 member, 4 vertices, written to new.bank"]);
    work.grimace("bank convert old.bank -o new.bank").exit(1).says(&["new.bank exists; give --force"]);
    let ran = work.grimace("bank info new.bank").exit(0);
    let ran = ran.prints(&["vertices        4", "members         1", "mapped", "smile                    0.5000"]);
    assert!(!ran.stderr.contains("warning"), "{}", ran.stderr);
    // A length, a header, and tensors that any reader of the format finds.
    assert!(work.bytes("new.bank")[8..].starts_with(b"{\"__metadata__\":{\"grimace\":"));
    work.grimace("bank convert meshes -o x.bank").exit(1).says(&["meshes"]);
}

#[test]
fn the_embedded_bank_is_described() {
    let work = Work::new();
    let ran = work.grimace("bank info candide").exit(0);
    ran.prints(&[
        "vertices        23424",
        "triangles       46096",
        "members         30",
        "feature points  56",
        "happiness",
        "Ahlberg",
    ]);
}

#[test]
fn bad_sources_are_named_and_leave_no_file() {
    let work = Work::new();
    let says = |texts: &[&str]| {
        work.grimace("bank build meshes -o face.bank --force").exit(1).says(texts);
        assert!(!work.path("face.bank").exists());
    };
    work.grimace("bank build nowhere -o face.bank").exit(1).says(&["nowhere", "a folder, a .glb or a .gltf file was expected"]);
    work.write("meshes/readme.txt", "");
    says(&["no neutral.obj or neutral.ply"]);
    meshes(&work);
    let smile = work.read("meshes/smile.obj");
    work.write("meshes/smile.obj", smile.replace("f 1 2 5 4", "f 1 2 4"));
    says(&["member `smile` differs from the neutral mesh in triangle"]);
    work.write("meshes/smile.obj", format!("{smile}v 1 1 1\n"));
    says(&["member `smile` has 10 vertices, but the neutral mesh has 9"]);
    work.write("meshes/smile.obj", smile.replacen("v 0 -1 0", "v nan -1 0", 1));
    says(&["smile.obj", "vertex 1 is at (NaN, -1, 0)"]);
    work.write("meshes/smile.obj", &smile[..40]);
    says(&["smile.obj"]);
    work.write("meshes/smile.obj", &smile);
    work.write("meshes/feature_points.csv", "fp,vertex\n8.3,9\n");
    says(&["feature point 8.3 is at vertex 9, but the mesh has 9 vertices"]);
    work.write("meshes/feature_points.csv", "fp,vertex\n8.3,1\n8.3,2\n");
    says(&["feature point 8.3 appears twice"]);
    std::fs::remove_file(work.path("meshes/feature_points.csv")).unwrap();
    says(&["no feature points", "--feature-points"]);
    work.write("meshes/feature_points.csv", "fp,vertex\n8.3,1\n");
    work.grimace("bank build meshes -o face.bank --part nose")
        .exit(1)
        .says(&["the source has no part `nose` of its surface: it has no named parts"]);
    for name in ["smile", "open"] {
        std::fs::remove_file(work.path(&format!("meshes/{name}.obj"))).unwrap();
    }
    says(&["the bank has no member"]);
}

#[test]
fn damaged_arrays_gltf_and_banks_are_errors() {
    let work = Work::new();
    work.write("arrays/neutral_vertices.npy", b"\x93NUMPY\x01\x00nothing");
    work.grimace("bank build arrays -o a.bank").exit(1).says(&["neutral_vertices.npy"]);
    work.write("a.glb", b"glTF\x02\x00\x00\x00\xff\xff\xff\xff");
    work.grimace("bank build a.glb -o a.bank").exit(1).says(&["a.glb", "no valid glTF"]);
    work.write("a.bank", b"GRIMBANK");
    work.grimace("bank info a.bank").exit(1).says(&["a.bank is not a readable bank", "shorter than the header"]);
    work.grimace("bank info gone.bank").exit(1).says(&["gone.bank"]);
}
