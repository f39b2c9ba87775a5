//! `grimace evaluate clone --sheets` and `--grades`.

use std::{
    path::{Path, PathBuf},
    sync::atomic::Ordering,
};

use anyhow::Context;
use grimace::internal::{
    cli::{Outcome, portrait, shared::stop_flag},
    clone::{CloneOptions, encode_png},
    output::write_atomic,
    pipeline::Workbench,
};
use grimace_lab::evaluate::{Cell, SheetSource, Table, clone_grades_table, draw_clone_sheet};
use serde_json::json;

use super::{Folder, bar, clone::Args};

/// The table for the grader, and the key with the content of every picture.
const GRADES: &str = "grades.csv";
const KEY: &str = "key.csv";

/// Meanings of the grades.
const RUBRIC: &str = "5: passes as a photograph; 4: one flaw when searched for; 3: one flaw seen at once; 2: several; 1: no face";

/// Draws a sheet for every photograph.
pub fn draw(args: &Args, photographs: &[PathBuf], mut folder: Folder, bench: &Workbench) -> anyhow::Result<Outcome> {
    let read = |path: &PathBuf| SheetSource::read(path, bench).with_context(|| path.display().to_string());
    let sources: Vec<SheetSource> = args.sources.iter().map(read).collect::<Result<_, _>>()?;
    let stop = stop_flag()?;
    let options = CloneOptions::default();
    let mut key = Table::new(["sheet", "picture", "source"]);
    let mut grades = Table::new(["sheet", "picture", "read_as", "grade", "artefact"]);
    let mut failed = 0;
    let bar = bar(args.common.quiet, "sheets", photographs.len());
    for (index, path) in photographs.iter().enumerate() {
        let drawn = portrait::target(path, None, &args.marks.marks, bench).and_then(|target| {
            let sheet = draw_clone_sheet(&target, &sources, &options, args.common.seed, index as u64, bench);
            Ok((target.name.clone(), sheet.with_context(|| path.display().to_string())?))
        });
        match drawn {
            Ok((name, sheet)) => {
                // Two photographs in different folders may have the same name.
                let taken = key.rows.iter().any(|row| row[0] == Cell::text(&name));
                let name = if taken { format!("{name}-{}", index + 1) } else { name };
                write_atomic(&folder.path.join(format!("{name}.png")), |writer| encode_png(&sheet.picture, writer))?;
                folder.files.push(format!("{name}.png"));
                for (k, source) in sheet.key.iter().enumerate() {
                    key.rows.push(vec![Cell::text(&name), Cell::Count(k + 1), Cell::text(source)]);
                    grades.rows.push(vec![Cell::text(&name), Cell::Count(k + 1), Cell::Empty, Cell::Empty, Cell::Empty]);
                }
            }
            Err(error) => {
                failed += 1;
                bar.suspend(|| eprintln!("failed: {}", grimace::internal::cli::chain(&error)));
            }
        }
        bar.inc(1);
        anyhow::ensure!(!stop.load(Ordering::Relaxed), "interrupted");
    }
    bar.finish_and_clear();
    folder.table(KEY, &key)?;
    folder.table(GRADES, &grades)?;
    let drawn = photographs.len() - failed;
    if !args.common.quiet {
        println!(
            "{drawn} sheets. Ask a person who did not make them to fill in {GRADES} without seeing {KEY}: the recognized expression \
             ({}), a grade, and the worst artefact.\n{RUBRIC}\nThen: grimace evaluate clone --grades {} -o GRADED",
            sources.iter().map(SheetSource::name).collect::<Vec<_>>().join(", "),
            folder.path.join(GRADES).display()
        );
    }
    let results = json!({ "sheets": drawn, "failed": failed, "rubric": RUBRIC });
    let names: Vec<&str> = sources.iter().map(SheetSource::name).collect();
    folder.finish("clone-sheets", None, args.common.seed, json!({ "clone": options, "sources": names }), results)?;
    Ok(match (drawn, failed) {
        (_, 0) => Outcome::Done,
        (0, _) => Outcome::Failed,
        _ => Outcome::SomeFailed,
    })
}

/// Summarizes the grades.
pub fn grade(args: &Args, grades: &Path, mut folder: Folder) -> anyhow::Result<Outcome> {
    let table = clone_grades_table(grades, &grades.with_file_name(KEY))?;
    folder.table("graded.csv", &table)?;
    folder.print(&format!("Grades of clones. {RUBRIC}"), &table);
    folder.finish("clone-grades", None, args.common.seed, json!({ "grades": grades.display().to_string() }), json!({}))?;
    Ok(Outcome::Done)
}
