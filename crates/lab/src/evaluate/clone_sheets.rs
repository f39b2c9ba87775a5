//! Contact sheets of clones for blind grading, and a summary of the grades.
//!
//! A sheet shows a photograph and its clones with faces of equal height, numbered in random order, so that neither position nor name tells
//! the expression. A grader enters a grade from 1 to 5 and the recognized expression into a table. The key, which the grader does not see,
//! names the source of each number.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use grimace::internal::{
    clone::{CloneError, CloneOptions, ClonedSkin, Sheet, Skin, SourceMotion, Target, clone_expression},
    input::{CsvFile, InputError},
    pipeline::Workbench,
    render::Labelled,
};
use image::{RgbImage, imageops};
use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;

use super::{Cell, ErrorSummary, Table};

/// Height of a face with its surroundings on a sheet, px.
const FACE_HEIGHT: u32 = 500;
/// Pictures per row.
const COLUMNS: usize = 4;
/// Valid grades of the rubric, 1 to 5.
const GRADES: std::ops::RangeInclusive<f64> = 1.0..=5.0;

/// A motion to clone, with the skin detail that `clone` adds.
pub struct SheetSource {
    motion: SourceMotion,
    skin: Skin,
}

impl SheetSource {
    /// Reads a track, a representative, or a FAP file.
    ///
    /// # Errors
    /// [`CloneError`] for any other file.
    pub fn read(path: &Path, bench: &Workbench) -> Result<Self, CloneError> {
        let motion = SourceMotion::read(path, bench)?;
        let (skin, _) = Skin::going_with(path, &motion)?;
        Ok(Self { motion, skin })
    }

    /// Returns the name of the source's file.
    pub fn name(&self) -> &str {
        &self.motion.name
    }
}

/// The sheet of one target, and its key.
pub struct TargetSheet {
    /// The contact sheet.
    pub picture: RgbImage,
    /// Names of the sources of pictures 1, 2, ...
    pub key: Vec<String>,
}

/// Draws the sheet of a target: its photograph, and the strongest frame of every source. `seed` and `index` determine the order.
///
/// # Errors
/// [`CloneError`] of the first clone that failed.
pub fn draw_clone_sheet(
    target: &Target,
    sources: &[SheetSource],
    options: &CloneOptions,
    seed: u64,
    index: u64,
    bench: &Workbench,
) -> Result<TargetSheet, CloneError> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(index);
    let mut order: Vec<&SheetSource> = sources.iter().collect();
    order.shuffle(&mut random);
    let (left, top, width, height) = target.surroundings();
    let face = |picture: &RgbImage, label: String| {
        let cut = imageops::crop_imm(picture, left, top, width, height).to_image();
        let width = (f64::from(width) * f64::from(FACE_HEIGHT) / f64::from(height)).round().max(1.0) as u32;
        Labelled { picture: imageops::resize(&cut, width, FACE_HEIGHT, imageops::FilterType::CatmullRom), label }
    };
    let mut pictures = vec![face(&target.picture, format!("{}: photograph", target.name))];
    let mut key = Vec::new();
    for (k, source) in order.into_iter().enumerate() {
        let skin = ClonedSkin::new(target, &source.skin, &source.motion)?;
        let clone = clone_expression(&source.motion, target, None, options, bench)?.with_skin(&skin, &source.motion)?;
        pictures.push(face(&clone.picture(clone.apex())?, (k + 1).to_string()));
        key.push(source.name().to_owned());
    }
    let mut sheet = Sheet::new(FACE_HEIGHT);
    let mut pictures = pictures.into_iter().peekable();
    while pictures.peek().is_some() {
        sheet.push_labelled_row(pictures.by_ref().take(COLUMNS).collect());
    }
    Ok(TargetSheet { picture: sheet.draw(), key })
}

/// One row of a table of grades, joined with the key.
struct Graded {
    source: String,
    grade: f64,
    read_as: String,
    artefact: String,
}

/// Summarizes grades, for every source and for all: number of pictures, mean and worst grade, number of pictures recognized correctly, and
/// the most frequent artefact. Pictures without a grade are left out.
///
/// # Errors
/// [`InputError`] for tables that cannot be read, an invalid grade, or a picture that is not in the key.
pub fn clone_grades_table(grades: &Path, key: &Path) -> Result<Table, InputError> {
    let key = CsvFile::open(key)?;
    let columns = key.require(["sheet", "picture", "source"])?;
    let mut sources: BTreeMap<(String, u32), String> = BTreeMap::new();
    for row in key.rows() {
        let row = row?;
        sources.insert((row.get(columns[0]).to_owned(), row.whole_number(columns[1])?), row.get(columns[2]).to_owned());
    }
    let file = CsvFile::open(grades)?;
    let [sheet, picture, grade, read_as, artefact] = file.require(["sheet", "picture", "grade", "read_as", "artefact"])?;
    let mut graded = Vec::new();
    for row in file.rows() {
        let row = row?;
        if row.get(grade).trim().is_empty() {
            continue;
        }
        let value = row.number(grade)?;
        if !GRADES.contains(&value) {
            return Err(row.field_error(grade, "a grade from 1 to 5"));
        }
        let at = (row.get(sheet).to_owned(), row.whole_number(picture)?);
        let source =
            sources.get(&at).ok_or_else(|| row.field_error(picture, "a picture of this sheet that the key knows"))?.clone();
        let word = |column: usize| row.get(column).trim().to_lowercase();
        graded.push(Graded { source, grade: value, read_as: word(read_as), artefact: word(artefact) });
    }
    let mut table = Table::new(["source", "pictures", "mean_grade", "worst", "read_as_it_is", "costliest"]);
    let names: BTreeSet<&str> = graded.iter().map(|g| g.source.as_str()).collect();
    for name in names.into_iter().map(Some).chain([None]) {
        let of: Vec<&Graded> = graded.iter().filter(|g| name.is_none_or(|n| g.source == n)).collect();
        let values: Vec<f64> = of.iter().map(|g| g.grade).collect();
        let mut artefacts: BTreeMap<&str, usize> = BTreeMap::new();
        of.iter().filter(|g| !g.artefact.is_empty()).for_each(|g| *artefacts.entry(&g.artefact).or_default() += 1);
        let costliest = artefacts.iter().max_by_key(|(_, count)| **count).map_or("", |(word, _)| *word);
        table.rows.push(vec![
            Cell::text(name.unwrap_or("all")),
            Cell::Count(of.len()),
            Cell::maybe(ErrorSummary::of(&values).map(|s| s.mean), 2),
            Cell::maybe(values.iter().copied().reduce(f64::min), 0),
            Cell::Count(of.iter().filter(|g| g.read_as == g.source.to_lowercase()).count()),
            Cell::text(costliest),
        ]);
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grades_are_joined_with_the_key_and_averaged() {
        let folder = tempfile::tempdir().unwrap();
        let (key, grades) = (folder.path().join("key.csv"), folder.path().join("grades.csv"));
        std::fs::write(&key, "sheet,picture,source\nanna,1,fear\nanna,2,anger\nben,1,anger\n").unwrap();
        std::fs::write(
            &grades,
            "sheet,picture,read_as,grade,artefact\nanna,1,surprise,2,lids\nanna,2,Anger,4,\nben,1,anger,3,teeth\nben,2,,,\n",
        )
        .unwrap();
        let table = clone_grades_table(&grades, &key).unwrap();
        let line = |k: usize| table.rows[k].iter().map(|c| format!("{c:?}")).collect::<Vec<_>>().join(" ");
        assert_eq!(
            table.rows[0],
            [
                Cell::text("anger"),
                Cell::Count(2),
                Cell::Number(3.5, 2),
                Cell::Number(3.0, 0),
                Cell::Count(2),
                Cell::text("teeth")
            ]
        );
        assert!(line(1).contains("fear") && line(2).contains("Number(3.0, 2)"), "{} {}", line(1), line(2));
        std::fs::write(&grades, "sheet,picture,read_as,grade,artefact\nanna,1,x,6,\n").unwrap();
        assert!(clone_grades_table(&grades, &key).unwrap_err().to_string().contains("from 1 to 5"));
        std::fs::write(&grades, "sheet,picture,read_as,grade,artefact\nanna,7,x,3,\n").unwrap();
        assert!(clone_grades_table(&grades, &key).unwrap_err().to_string().contains("key knows"));
    }
}
