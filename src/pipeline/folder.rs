//! The output folder of a run: write checks, its record, and removal of old files.

use std::{collections::BTreeMap, fs, io, path::Path, sync::atomic::AtomicBool};

use super::{
    AnalysisError, Event, MADE_BY, RunError, RunJson, RunJsonError, SCHEMA_VERSION, Workbench,
    differing::{differing_options, differing_wireframes},
    files::{read_run_json, run_units},
    ledger::JOURNAL,
    recording::{SEGMENTS_FOLDER, expand},
};
use crate::{
    dataset::{Dataset, MANIFEST_NAME, SequenceEntry},
    output::{OutputError, create_folders, sweep_once},
    statistics::{check_columns, check_groups, check_numbers},
    track::{CORRECTIONS_FOLDER, LOOKED_AT},
};

/// Name of the provenance file.
pub(super) use super::files::RUN_JSON;

/// What becomes of the tracks of a run whose results are replaced by one of this version.
pub(super) const TRACKS_KEPT: &str = "unchanged tracks are kept";

/// Opens the dataset, checks that the output may be written, and segments recordings into sequences.
pub(super) fn open(
    dataset: &Path,
    out: &Path,
    bench: &Workbench,
    force: bool,
    watch: (&AtomicBool, &(dyn Fn(Event) + Sync)),
) -> Result<(Dataset, String, Option<RunJson>), RunError> {
    let mut opened = open_dataset(dataset, bench)?;
    let name = dataset_name(dataset);
    let earlier = check_output(out, &name, bench, force)?;
    // Only `annotate` writes there, and it may have been killed.
    sweep_once(&out.join(CORRECTIONS_FOLDER));
    expand(&mut opened, out, bench, watch)?;
    if opened.sequences.is_empty() && opened.failures.is_empty() {
        return Err(RunError::Empty { path: dataset.to_owned() });
    }
    Ok((opened, name, earlier))
}

/// Opens a dataset and checks that the options can group it.
pub(super) fn open_dataset(dataset: &Path, bench: &Workbench) -> Result<Dataset, RunError> {
    let opened = Dataset::open(dataset)?;
    // Checked before hours of tracking.
    for columns in [&bench.options.by, &bench.options.strata] {
        check_columns(columns, opened.sequences.iter().map(|s| &s.metadata)).map_err(AnalysisError::from)?;
    }
    check_numbers(&bench.options.covariates, &opened.sequences.iter().map(|s| &s.metadata)).map_err(AnalysisError::from)?;
    check_groups(&bench.options.by, opened.sequences.iter().map(SequenceEntry::labels)).map_err(AnalysisError::from)?;
    Ok(opened)
}

/// The record of a starting run.
pub(super) fn new_record(dataset: String, skipped: Vec<(String, String)>, bench: &Workbench) -> RunJson {
    RunJson {
        schema_version: SCHEMA_VERSION,
        made_by: MADE_BY.to_owned(),
        dataset,
        units: run_units(),
        method: super::Method::name_of(&bench.options).to_owned(),
        options: bench.options.clone(),
        wireframe_blake3: bench.wireframe_blake3.clone(),
        complete: false,
        sequences: Vec::new(),
        skipped,
        outputs: BTreeMap::new(),
        kept: BTreeMap::new(),
        representatives: Vec::new(),
        warnings: Vec::new(),
        to_look_at: 0,
        looks_blake3: None,
    }
}

/// The recorded name of a dataset: its folder's, and its manifest's if that is not `manifest.csv`.
fn dataset_name(path: &Path) -> String {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = |path: &Path| path.file_name().map_or_else(|| "dataset".to_owned(), |n| n.to_string_lossy().into_owned());
    if !full.is_file() {
        return name(&full);
    }
    let folder = full.parent().map_or_else(|| "dataset".to_owned(), name);
    if name(&full) == MANIFEST_NAME { folder } else { format!("{folder}/{}", name(&full)) }
}

/// Checks that `out` may be written. Returns the earlier run found there, if any.
fn check_output(out: &Path, dataset: &str, bench: &Workbench, force: bool) -> Result<Option<RunJson>, RunError> {
    let error = |source: io::Error| OutputError { path: out.to_owned(), source };
    let mut entries = match fs::read_dir(out) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            create_folders(out).map_err(error)?;
            return Ok(None);
        }
        Err(e) if e.kind() == io::ErrorKind::NotADirectory => {
            let reason = "is a file, but the results need a folder; give another name";
            return Err(error(io::Error::new(io::ErrorKind::NotADirectory, reason)).into());
        }
        Err(e) => return Err(error(e).into()),
    };
    let earlier: Option<RunJson> = match read_run_json(out) {
        Ok(earlier) => earlier,
        Err(RunJsonError::Io { path, source }) => return Err(OutputError { path, source }.into()),
        Err(_) if force => None,
        Err(RunJsonError::Damaged { path, source }) => return Err(RunError::DamagedRecord { path, source }),
        Err(RunJsonError::Newer { path, found }) => return Err(RunError::NewerRecord { path, found }),
    };
    let Some(earlier) = earlier else {
        // The first written file removes leftovers of a killed writer; a run that ended before its first result leaves its journal.
        let is_left = |name: &std::ffi::OsStr| {
            name == JOURNAL
                || name == SEGMENTS_FOLDER
                || name == LOOKED_AT
                || name.to_str().is_some_and(|n| n.starts_with(".grimace-") && Path::new(n).extension() == Some("tmp".as_ref()))
        };
        let empty = entries.all(|e| e.is_ok_and(|e| is_left(&e.file_name())));
        return if empty || force { Ok(None) } else { Err(RunError::ForeignFolder { path: out.to_owned() }) };
    };
    // A track says which version made it; a run of one version has no tracks of another.
    let is_other_version = earlier.made_by != MADE_BY;
    let what = if is_other_version {
        Some(format!("another version, {}", earlier.made_by))
    } else if earlier.dataset != dataset {
        Some(format!("another dataset, `{}`", earlier.dataset))
    } else if earlier.options != bench.options {
        Some(format!("other options ({})", differing_options(&earlier.options, &bench.options).join("; ")))
    } else {
        differing_wireframes(earlier.wireframe_blake3.as_deref(), bench.wireframe_blake3.as_deref()).map(str::to_owned)
    };
    match what {
        Some(what) if !force => {
            let tracks = if is_other_version { "all sequences are tracked again" } else { TRACKS_KEPT };
            Err(RunError::OtherRun { path: out.to_owned(), what, tracks })
        }
        Some(_) if is_other_version => Ok(Some(RunJson { complete: false, sequences: Vec::new(), ..earlier })),
        Some(_) => Ok(Some(RunJson { complete: false, ..earlier })),
        None => Ok(Some(earlier)),
    }
}
