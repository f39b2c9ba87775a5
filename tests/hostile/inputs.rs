//! Inputs that are not regular files, such as pipes and devices, and pictures that claim more pixels than memory can hold. Each is an
//! immediate error; pipes are read through `-`.

use std::{
    fs,
    io::{Read, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use tempfile::TempDir;

/// Time after which a command counts as hanging: it is ended, and the test fails.
const PATIENCE: Duration = Duration::from_secs(120);

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Runs a command in a folder with the given standard input. Returns exit status, standard output and standard error.
fn grimace(folder: &TempDir, arguments: &[&str], input: &[u8]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_grimace"));
    command.args(arguments).current_dir(folder.path());
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // A command that reads no input closes the pipe.
    let _ = child.stdin.take().unwrap().write_all(input);
    let mut out = child.stdout.take().unwrap();
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        out.read_to_end(&mut text).map(|_| String::from_utf8_lossy(&text).into_owned()).unwrap()
    });
    let mut err = child.stderr.take().unwrap();
    let errors = std::thread::spawn(move || {
        let mut text = Vec::new();
        err.read_to_end(&mut text).map(|_| String::from_utf8_lossy(&text).into_owned()).unwrap()
    });
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begun.elapsed() > PATIENCE {
            child.kill().unwrap();
            panic!("grimace {} hangs", arguments.join(" "));
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    (status.code(), reader.join().unwrap(), errors.join().unwrap())
}

/// Makes a folder with the first sequence of the sample as `faces/`, and its first frame as `face.jpg`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("faces")).unwrap();
    for entry in fs::read_dir(repository("fixtures/simulated/S001/005")).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, folder.path().join("faces").join(path.file_name().unwrap())).unwrap();
    }
    fs::rename(folder.path().join("faces/correspondences.csv"), folder.path().join("marks.csv")).unwrap();
    fs::copy(folder.path().join("faces/S001_005_00000001.jpg"), folder.path().join("face.jpg")).unwrap();
    folder
}

#[cfg(unix)]
fn pipe(path: &Path) {
    if path.exists() {
        fs::remove_file(path).unwrap();
    }
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[cfg(unix)]
#[test]
fn a_pipe_in_place_of_a_file_is_an_error_at_once() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let expected = "it is a named pipe; a regular file was expected";
    let refused = |arguments: &[&str], name: &str| {
        let (status, _, said) = grimace(&folder, arguments, b"");
        assert_eq!(status, Some(1), "{arguments:?}: {said}");
        assert!(said.contains(name) && said.contains(expected), "{arguments:?}: {said}");
    };
    pipe(&at("pipe.jpg"));
    pipe(&at("pipe.csv"));
    refused(&["fit", "pipe.jpg", "--correspondences", "marks.csv", "-o", "fit.csv"], "pipe.jpg");
    refused(&["fit", "face.jpg", "--correspondences", "pipe.csv", "-o", "fit.csv"], "pipe.csv");
    refused(&["synthesize", "--bank", "candide", "--motion", "pipe.csv", "-o", "out"], "pipe.csv");
    pipe(&at("pipe.fap"));
    refused(&["fap", "info", "pipe.fap"], "pipe.fap");
    // A mesh of a bank, and a buffer that a glTF file names.
    fs::create_dir(at("meshes")).unwrap();
    fs::write(at("meshes/neutral.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    fs::write(at("meshes/feature_points.csv"), "fp,vertex\n8.3,1\n").unwrap();
    pipe(&at("meshes/smile.obj"));
    refused(&["bank", "build", "meshes", "-o", "b.bank"], "smile.obj");
    let gltf = r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":36,"uri":"pipe.bin"}],"bufferViews":[{"buffer":0,"byteLength":36}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]}"#;
    fs::write(at("face.gltf"), gltf).unwrap();
    pipe(&at("pipe.bin"));
    refused(&["bank", "build", "face.gltf", "-o", "b.bank"], "face.gltf");
    // Among the frames of a sequence.
    pipe(&at("faces/S001_005_00000003.jpg"));
    refused(&["track", "faces", "--correspondences", "marks.csv", "-o", "S001_005.csv", "-q"], "S001_005_00000003.jpg");
}

#[cfg(unix)]
#[test]
fn devices_are_not_pictures() {
    let folder = folder();
    let link = folder.path().join("zero.png");
    std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
    let (status, _, said) = grimace(&folder, &["fit", "zero.png", "--correspondences", "marks.csv", "-o", "fit.csv"], b"");
    assert_eq!(status, Some(1));
    assert!(said.contains("zero.png") && said.contains("it is a device"), "{said}");
}

#[test]
fn standard_input_is_read_through_a_dash() {
    let folder = folder();
    let fap = fs::read(repository("fixtures/golden/fap/happiness.fap")).unwrap();
    fs::write(folder.path().join("happiness.fap"), &fap).unwrap();
    let (status, named, said) = grimace(&folder, &["fap", "info", "happiness.fap"], b"");
    assert_eq!(status, Some(0), "{said}");
    let (status, piped, said) = grimace(&folder, &["fap", "info", "-"], &fap);
    assert_eq!(status, Some(0), "{said}");
    let after_the_name = |text: &str| text.lines().skip(1).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(after_the_name(&named), after_the_name(&piped));
    let (status, _, said) = grimace(&folder, &["fap", "check", "-"], b"no FAP file");
    assert_ne!(status, Some(0));
    assert!(said.len() < 2000 && !said.is_empty(), "{said}");
}

/// Returns a PNG file that claims `side` x `side` grey pixels but contains the data of a few.
fn bomb(side: u32) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8; 4], data: &[u8]| {
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(kind);
        bytes.extend(data);
        let check = [&kind[..], data].concat().iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { 0xEDB8_8320 ^ (crc >> 1) } else { crc >> 1 })
        });
        bytes.extend((!check).to_be_bytes());
    };
    let size = side.to_be_bytes();
    chunk(b"IHDR", &[&size[..], &size[..], &[8, 0, 0, 0, 0]].concat());
    chunk(b"IDAT", &[0x78, 0x9c, 0x63, 0x60, 0x60, 0x60, 0, 0, 0, 4, 0, 1]);
    chunk(b"IEND", &[]);
    bytes
}

/// The header is checked before memory is allocated. All commands that read pictures share one limit and one option.
#[test]
fn a_picture_bomb_is_refused_by_its_header_in_every_command() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("dark")).unwrap();
    fs::write(at("bomb.png"), bomb(32_000)).unwrap();
    for frame in 1..=2 {
        fs::write(at(&format!("dark/{frame}.png")), bomb(32_000)).unwrap();
    }
    fs::copy(repository("fixtures/golden/fap/happiness.fap"), at("happiness.fap")).unwrap();
    let commands: [(&str, i32); 5] = [
        ("fit bomb.png --correspondences marks.csv -o fit.csv", 1),
        ("track dark --correspondences marks.csv -o S_1.csv", 1),
        ("clone -s happiness.fap -t bomb.png -c marks.csv -o out", 1),
        ("clone -s happiness.fap -t bomb.png -o out", 1),
        ("locate bomb.png -o points.csv", 3),
    ];
    for (command, expected) in commands {
        let arguments: Vec<&str> = command.split(' ').collect();
        let (status, out, said) = grimace(&folder, &arguments, b"");
        let said = said + &out;
        assert_eq!(status, Some(expected), "{command}: {said}");
        assert!(said.contains("32000") && said.contains("128") && said.contains("--max-pixels"), "{command}: {said}");
    }
    let manifest = "subject,sequence,emotion,frames,correspondences\nS1,1,anger,dark,marks.csv\n";
    fs::write(at("manifest.csv"), manifest).unwrap();
    let (status, _, said) = grimace(&folder, &["run", "manifest.csv", "-o", "out", "-q"], b"");
    assert_eq!(status, Some(1), "{said}");
    let failures = fs::read_to_string(at("out/failures.csv")).unwrap();
    assert!(failures.contains("32000") && failures.contains("--max-pixels"), "{failures}");
}

/// A successful run with --quiet prints nothing on either stream, including messages of libraries.
#[test]
fn quiet_prints_nothing() {
    let folder = folder();
    let (status, out, said) =
        grimace(&folder, &["track", "faces", "--correspondences", "marks.csv", "-o", "S001_005.csv", "-q"], b"");
    assert_eq!((status, out.as_str(), said.as_str()), (Some(0), "", ""));
    fs::copy(repository("fixtures/golden/fap/happiness.fap"), folder.path().join("happiness.fap")).unwrap();
    for film in ["gif", "mp4", "webm"] {
        let (status, out, said) = grimace(
            &folder,
            &[
                "clone",
                "-s",
                "happiness.fap",
                "-t",
                "face.jpg",
                "-c",
                "marks.csv",
                "-o",
                film,
                "-q",
                "--duration",
                "0.2",
                "--film",
                film,
            ],
            b"",
        );
        if said.contains("has no encoder") {
            eprintln!("SKIPPED: this OpenCV has no encoder for {film}");
            continue;
        }
        assert_eq!((status, out.as_str(), said.as_str()), (Some(0), "", ""), "{film}");
    }
    // Video frames are read by libraries that print messages of their own; this film is damaged.
    fs::write(folder.path().join("broken.mp4"), b"\0\0\0\x18ftypmp42\0\0\0\0mp42isom\0\0\0\x08moov").unwrap();
    let (status, out, said) =
        grimace(&folder, &["track", "broken.mp4", "--correspondences", "marks.csv", "-o", "S001_006.csv", "-q"], b"");
    assert_eq!((status, out.as_str()), (Some(1), ""));
    assert!(said.lines().all(|line| line.starts_with("error: ") || line.starts_with("  ")), "{said}");
}
