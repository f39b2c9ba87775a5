//! Every reader on hostile files: seeds of `fuzz/seeds` with random changes, and the files of `fuzz/regressions`, which once did harm.
//!
//! The number of executions is limited, and every run is the same. `scripts/fuzz N` sets `GRIMACE_FUZZ_EXECUTIONS` for more executions;
//! `GRIMACE_FUZZ_TARGET` selects one reader, `GRIMACE_FUZZ_SEED` other changes, and `GRIMACE_FUZZ_FIRST` the first execution. A file that
//! makes a reader panic, or that takes longer than [`PATIENCE`], is saved in `fuzz/found`.

use std::{
    fs,
    panic::{AssertUnwindSafe, catch_unwind},
    path::{Path, PathBuf},
    sync::{Mutex, mpsc},
    time::{Duration, Instant},
};

use grimace::internal::fuzzing::{TARGETS, Target, dictionary, mutate, target};

/// Number of executions of a reader of text in the ordinary tests; other readers get a tenth.
const EXECUTIONS: u64 = 1000;

/// Time after which a reader of a file of some kilobytes counts as hanging.
const PATIENCE: Duration = Duration::from_secs(60);

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz").join(name)
}

/// Returns the files of a folder, by name; none when the folder does not exist.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<_> = entries.map(|e| e.unwrap().path()).collect();
    files.sort();
    files.iter().map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), fs::read(p).unwrap())).collect()
}

fn seeds(target: &Target) -> Vec<(String, Vec<u8>)> {
    files(&folder("seeds").join(target.name))
}

fn setting(name: &str) -> Option<u64> {
    std::env::var(name)
        .ok()
        .map(|text| text.parse().unwrap_or_else(|_| panic!("{name} is `{text}`; a whole number was expected")))
}

#[test]
fn every_seed_parses() {
    let mut wrong = Vec::new();
    for target in &TARGETS {
        let seeds = seeds(target);
        assert!(!seeds.is_empty(), "{} has no seed", target.name);
        for (name, bytes) in seeds {
            if let Err(reason) = target.read(&bytes) {
                wrong.push(format!("{}/{name}: {reason}", target.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Files are named after their effect.
#[test]
fn formerly_harmful_files_are_refused() {
    let mut count = 0;
    for target in &TARGETS {
        for (name, bytes) in files(&folder("regressions").join(target.name)) {
            let started = Instant::now();
            assert!(target.read(&bytes).is_err(), "{}/{name} is read without an error", target.name);
            assert!(started.elapsed() < PATIENCE, "{}/{name} takes {:?}", target.name, started.elapsed());
            count += 1;
        }
    }
    assert!(count > 0, "no regression found in {}", folder("regressions").display());
}

/// Runs one execution. Returns the reason when the reader did not end normally.
fn execute(target: &Target, bytes: &[u8]) -> Result<bool, String> {
    let outcome = catch_unwind(AssertUnwindSafe(|| target.read(bytes)));
    outcome.map(|read| read.is_ok()).map_err(|payload| {
        let text = payload.downcast_ref::<String>().cloned();
        text.or_else(|| payload.downcast_ref::<&str>().map(|&s| s.to_owned())).unwrap_or_default()
    })
}

fn keep(target: &Target, index: u64, bytes: &[u8]) -> PathBuf {
    let path = folder("found").join(format!("{}-{index}", target.name));
    fs::create_dir_all(folder("found")).unwrap();
    fs::write(&path, bytes).unwrap();
    path
}

/// A running execution: start time, target, number and bytes.
type Execution = (Instant, &'static Target, u64, Vec<u8>);

/// Ends the program when an execution hangs, because a thread cannot be ended.
fn watch(current: &'static Mutex<Option<Execution>>, stop: mpsc::Receiver<()>) {
    while stop.recv_timeout(Duration::from_secs(1)) == Err(mpsc::RecvTimeoutError::Timeout) {
        if let Some((started, target, index, bytes)) = current.lock().unwrap().as_ref()
            && started.elapsed() > PATIENCE
        {
            let path = keep(target, *index, bytes);
            eprintln!("{}: execution {index} hangs; the file is {}", target.name, path.display());
            std::process::exit(101);
        }
    }
}

#[test]
fn no_hostile_file_ends_a_reader() {
    static CURRENT: Mutex<Option<Execution>> = Mutex::new(None);
    let executions = setting("GRIMACE_FUZZ_EXECUTIONS").unwrap_or(EXECUTIONS);
    let (seed, first) = (setting("GRIMACE_FUZZ_SEED").unwrap_or(0), setting("GRIMACE_FUZZ_FIRST").unwrap_or(0));
    let chosen: Vec<&Target> = match std::env::var("GRIMACE_FUZZ_TARGET") {
        Ok(name) => vec![target(&name).unwrap_or_else(|| panic!("there is no target {name}"))],
        Err(_) => TARGETS.iter().collect(),
    };
    let (stop, stopped) = mpsc::channel();
    let watcher = std::thread::spawn(move || watch(&CURRENT, stopped));
    let mut harm = Vec::new();
    println!("{:<16} {:>12} {:>12} {:>10} {:>9}", "reader", "executions", "read", "harm", "seconds");
    for target in chosen {
        let seeds: Vec<Vec<u8>> = seeds(target).into_iter().map(|(_, bytes)| bytes).collect();
        let words = fs::read_to_string(folder("dictionaries").join(format!("{}.dict", target.name))).unwrap_or_default();
        let words = dictionary(&words);
        let count = if target.is_text { executions } else { executions.div_ceil(10) };
        let (started, mut read, before) = (Instant::now(), 0_u64, harm.len());
        for index in first..first + count {
            let bytes = mutate(&seeds, &words, seed, index);
            *CURRENT.lock().unwrap() = Some((Instant::now(), target, index, bytes.clone()));
            match execute(target, &bytes) {
                Ok(is_read) => read += u64::from(is_read),
                Err(reason) => {
                    let path = keep(target, index, &bytes);
                    harm.push(format!("{}: execution {index} panics ({reason}); the file is {}", target.name, path.display()));
                }
            }
            if harm.len() - before >= 20 {
                break;
            }
        }
        *CURRENT.lock().unwrap() = None;
        let seconds = started.elapsed().as_secs_f64();
        println!("{:<16} {count:>12} {read:>12} {:>10} {seconds:>9.1}", target.name, harm.len() - before);
    }
    drop(stop);
    watcher.join().unwrap();
    assert!(harm.is_empty(), "{}", harm.join("\n"));
}

/// Writes the seeds that only this program can write. Run manually: `cargo test --test hostile -- --ignored write_seeds`.
#[test]
#[ignore = "writes into fuzz/seeds"]
fn write_seeds() {
    use grimace::internal::{
        columnar::{ColumnarRow, ColumnarWriter},
        units::SequenceId,
    };
    let at = |target: &str, name: &str| {
        let path = folder("seeds").join(target).join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    };
    let mut writer = ColumnarWriter::create(&at("columnar", "two.parquet"), &["sex".to_owned()], 2, 2).unwrap();
    for (subject, x) in [("a", 1.0), ("b", 2.0)] {
        let id = SequenceId { subject: subject.to_owned(), sequence: "1".to_owned() };
        let coordinates = vec![0.0, 0.0, 10.0, 0.0, x, 1.0, 10.0, x];
        writer.push(ColumnarRow { id, emotion: "fear".to_owned(), metadata: vec!["f".to_owned()], coordinates }).unwrap();
    }
    writer.finish().unwrap();
    let image = image::RgbImage::from_fn(16, 16, |x, y| image::Rgb([x as u8 * 9, y as u8 * 9, 7]));
    for name in ["small.jpg", "deep.png"] {
        image.save(at("picture", name)).unwrap();
    }
    let names = grimace::internal::synthesis::candide_bank().unwrap().names().to_vec();
    let recipes = format!("member,shape,weight\nsmile,{},0.5\nsmile,{},0.25\nfrown,{},-1\n", names[0], names[1], names[0]);
    fs::write(at("recipes", "two.csv"), recipes).unwrap();
    let source = tempfile::tempdir().unwrap();
    let mesh = |y: f64| format!("v 0 0 0\nv 1 0 0\nv 0 {y} 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 2 4\n");
    fs::write(source.path().join("neutral.obj"), mesh(1.0)).unwrap();
    fs::write(source.path().join("smile.obj"), mesh(1.5)).unwrap();
    fs::write(source.path().join("feature_points.csv"), "fp,vertex\n8.3,1\n8.4,2\n").unwrap();
    grimace::internal::synthesis::build_bank(
        source.path(),
        &at("bank", "tetra.bank"),
        &grimace::internal::synthesis::BuildOptions::default(),
    )
    .unwrap();
}
