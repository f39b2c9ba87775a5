//! Makes figures of a finished run, as files, from its results files alone.

mod read;

use std::{
    collections::BTreeSet,
    fmt::Write as _,
    path::{Path, PathBuf},
};

use serde::Serialize;

use self::read::{Class, Results};
use super::{ModelFileError, RunJsonError, Workbench};
use crate::{
    features::Course,
    input::InputError,
    output::{self, OutputError, count, nine_digits},
    report::{
        drawing::Drawing,
        figures::{self, FieldScale, Lines, Model, StripRow, view_box},
        mean_course, p_value,
    },
    statistics::{
        compare::{group_values, is_of_whole},
        scale::MANY_MODELS,
    },
};

/// Why figures cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum FiguresError {
    /// The folder has no results.
    #[error("{}: this folder has no representatives; give the output folder of `run` or `analyze`", path.display())]
    NoResults {
        /// The folder.
        path: PathBuf,
    },
    /// The record of the run cannot be read.
    #[error(transparent)]
    Run(#[from] RunJsonError),
    /// The description of a representative cannot be read.
    #[error("{}: {reason}", path.display())]
    About {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A model of another wireframe.
    #[error("{}: it has {found} nodes, but the wireframe has {expected}; give the --wireframe of the run", path.display())]
    OtherWireframe {
        /// The file.
        path: PathBuf,
        /// Its nodes.
        found: usize,
        /// Nodes of the wireframe.
        expected: usize,
    },
    /// A model cannot be read.
    #[error(transparent)]
    Model(#[from] ModelFileError),
    /// A table cannot be read.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// A figure with its caption data.
#[derive(Debug)]
pub struct Figure {
    /// File name without extension.
    pub name: String,
    /// The drawing.
    pub drawing: Drawing,
    /// Its content and the people it shows.
    pub about: FigureAbout,
}

/// A row of `captions.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct FigureAbout {
    /// Name of the files, without extension.
    pub figure: String,
    /// Kind of figure.
    pub kind: &'static str,
    /// Emotion; empty for all.
    pub emotion: String,
    /// Values of the columns grouped by; empty for all people.
    pub group: String,
    /// Sequences.
    pub sequences: usize,
    /// People.
    pub people: usize,
    /// Share of models trimmed.
    pub alpha: f64,
    /// Method of computing the representative.
    pub method: String,
    /// The caption.
    pub caption: String,
}

/// Most FAP curves in one figure.
const MOST_BANDS: usize = 6;

/// Makes all figures of the results in a folder. Also returns messages about figures left out because a file is missing.
///
/// # Errors
/// [`FiguresError`] when there are no results, or a file of them cannot be read.
pub fn figures_of(out: &Path, bench: &Workbench) -> Result<(Vec<Figure>, Vec<String>), FiguresError> {
    let results = Results::read(out, bench)?;
    let lines = Lines::new(&bench.wireframe);
    let models = || results.classes.iter().map(|c| &c.model);
    let (scale, within) = (FieldScale::of(models(), &lines), view_box(models(), &lines));
    let mut figures = vec![overview(&results, &lines)];
    for class in &results.classes {
        figures.push(class.figure(
            "fields",
            "displacement fields",
            figures::fields(&class.model, &class.label(), scale, within, &lines),
            &format!(
                "Displacement fields of {}: the motion of every node of the wireframe from each key frame to the next. Arrows are {} times as \
                 long as the motion, the same in all figures of this run; nodes that hardly move have a dot or nothing.",
                class.who(),
                scale.gain
            ),
        ));
        if class.about.sequences.len() > 1 {
            figures.push(dispersion(class, &lines));
            figures.push(class.figure("distances", "distances", distances(class), &distances_caption(class)));
        }
        let courses: Vec<(&str, &Course)> = class.courses.iter().map(|(who, course)| (who.as_str(), course)).collect();
        if let Some(drawing) = mean_course(&courses, &class.label()) {
            let what = "Intensities of the strongest action units (0 to 5) from the neutral to the apex frame";
            let who: BTreeSet<&str> = courses.iter().map(|(who, _)| *who).collect();
            let interval = if who.len() > 1 { " with its 95 % interval (Student's t)" } else { "" };
            let of = count(courses.len(), "sequence", "sequences");
            let people = count(who.len(), "person", "people");
            let caption = format!(
                "{what}: the mean of {people}{interval}, each person by the mean of their own sequences ({of}); {}.",
                class.label()
            );
            figures.push(class.figure("courses", "courses of action units", drawing, &caption));
        }
        if !class.bands.is_empty() {
            let shown = class.bands.len().min(MOST_BANDS);
            let drawing = figures::bands(&class.label(), &class.bands[..shown]);
            let caption = format!(
                "Courses of the {shown} FAPs that move most, over the key frames: {}, the mean, and the ranges of half and nine tenths \
                 of the people in each frame; FAP units.",
                class.who()
            );
            figures.push(class.figure("bands", "courses of FAPs", drawing, &caption));
        }
        if let Some([minus, mean, plus]) = &class.variation {
            let drawing = figures::spread(&class.label(), minus, mean, plus, &lines);
            let caption = format!(
                "How {} differ most in {}: the apex of the mean, moved by two standard deviations along the first principal component in \
                 either direction.",
                people(class),
                class.label()
            );
            figures.push(class.figure("variation", "variation", drawing, &caption));
        }
    }
    figures.extend(results.pairs.iter().filter_map(|pair| difference(pair, &results, bench, &lines)));
    Ok((figures, results.left_out()))
}

fn people(class: &Class) -> String {
    count(class.about.subjects, "person", "people")
}

impl Class {
    /// Text for emotion and group.
    fn label(&self) -> String {
        let group = group_values(&self.about.group);
        if group.is_empty() { self.about.emotion.clone() } else { format!("{}, {group}", self.about.emotion) }
    }

    /// Description of the representative.
    fn who(&self) -> String {
        let n = count(self.about.sequences.len(), "sequence", "sequences");
        format!("the representative of {} ({n} of {}; {})", self.label(), people(self), self.method_text())
    }

    /// Whether trimming was requested but dropped nothing.
    fn drops_none(&self) -> bool {
        let dropped_none = !self.fields.is_empty() && self.fields.values().flatten().all(|(_, dropped)| !dropped);
        self.about.alpha > 0.0 && dropped_none
    }

    fn method_text(&self) -> String {
        self.method_with(&if self.drops_none() {
            format!("nothing trimmed (too few models for {} %)", nine_digits(self.about.alpha * 100.0))
        } else {
            self.trimmed_text()
        })
    }

    /// Text about trimming, if there are enough models to trim any.
    fn trimmed_text(&self) -> String {
        let a = &self.about;
        if a.alpha > 0.0 {
            // A person with several sequences weighs one; above this number all sequences count alike.
            let is_weighted = a.weighting == "person" && a.sequences.len() <= MANY_MODELS;
            format!(
                "at most {} % of {} trimmed per {}",
                nine_digits(a.alpha * 100.0),
                if is_weighted { "the weight of the models" } else { "the models" },
                if a.trim == "model" { "model" } else { "displacement field" }
            )
        } else {
            "nothing trimmed".to_owned()
        }
    }

    /// Text about the method of the representative and the given trimming.
    fn method_with(&self, trimmed: &str) -> String {
        let a = &self.about;
        let run = if self.method.is_empty() { String::new() } else { format!(", {}", self.method) };
        format!("{} generalized median, {trimmed}, equal weight for every {}{run}", a.median, a.weighting)
    }

    fn figure(&self, kind: &str, kind_in_words: &'static str, drawing: Drawing, caption: &str) -> Figure {
        const UNIT: &str = " A face unit is 1/1024 of the eye separation.";
        const SIDES: &str = " The subject\u{2019}s left is on the right.";
        let (unit, sides) = match kind {
            "courses" | "bands" => ("", ""),
            "distances" => (UNIT, ""),
            "representatives" | "variation" => ("", SIDES),
            _ => (UNIT, SIDES),
        };
        let name = format!("{kind}_{}", self.stem);
        let about = FigureAbout {
            figure: name.clone(),
            kind: kind_in_words,
            emotion: self.about.emotion.clone(),
            group: group_values(&self.about.group),
            sequences: self.about.sequences.len(),
            people: self.about.subjects,
            alpha: self.about.alpha,
            method: self.method_text(),
            caption: format!("{caption}{unit}{sides}"),
        };
        Figure { name, drawing, about }
    }
}

/// Text about the method of all representatives. If only some classes are large enough for trimming, it names the others.
fn method_of_all(classes: &[Class]) -> String {
    let first = &classes[0];
    let untrimmed: Vec<String> = classes.iter().filter(|c| c.drops_none()).map(Class::label).collect();
    if untrimmed.is_empty() || untrimmed.len() == classes.len() {
        return first.method_text();
    }
    let of_them = format!(
        "{} (nothing of {}: too few models for {} %)",
        first.trimmed_text(),
        untrimmed.join("; "),
        nine_digits(first.about.alpha * 100.0)
    );
    first.method_with(&of_them)
}

/// Figure of all representatives at the apex.
fn overview(results: &Results, lines: &Lines) -> Figure {
    let models: Vec<(String, &Model)> = results.classes.iter().map(|c| (c.label(), &c.model)).collect();
    let drawing = figures::representatives(&models, lines);
    let whole = || results.classes.iter().filter(|c| c.about.group.is_empty());
    let mut caption =
        "The representative of every class at its apex, at the same scale, with the neutral in grey behind it:".to_owned();
    for (k, class) in results.classes.iter().enumerate() {
        let n = count(class.about.sequences.len(), "sequence", "sequences");
        let separator = if k == 0 { "" } else { ";" };
        let _ = write!(caption, "{separator} {} ({n} of {})", class.label(), people(class));
    }
    let first = &results.classes[0];
    let method = method_of_all(&results.classes);
    let mut figure = first.figure("representatives", "representatives", drawing, &format!("{caption}. Each is the {method}."));
    figure.about.method = method;
    "representatives".clone_into(&mut figure.name);
    figure.about.figure.clone_from(&figure.name);
    figure.about.emotion.clear();
    figure.about.group.clear();
    figure.about.sequences = whole().map(|c| c.about.sequences.len()).sum();
    figure.about.people = results.people;
    figure
}

fn dispersion(class: &Class, lines: &Lines) -> Figure {
    let about = &class.about;
    let drawing = figures::dispersion(&class.label(), &class.model, &about.node_dispersion, lines);
    let number = |v: Option<f64>| v.map_or_else(|| "unknown".to_owned(), |v| format!("{v:.2}"));
    let caption = format!(
        "Dispersion of people around {}. At each node: the median over the models of the mean distance over the kept fields. The colours \
         cover its own range and are even in lightness (viridis). Dispersion of the whole face: {} face units after trimming, {} before.",
        class.who(),
        number(about.dispersion),
        number(about.dispersion_untrimmed)
    );
    class.figure("dispersion", "dispersion", drawing, &caption)
}

fn distances(class: &Class) -> Drawing {
    let about = &class.about;
    let points = about.distances.values().flatten().map(|d| (*d, false)).collect();
    let mut rows = vec![StripRow { label: "to the median".to_owned(), points, median: about.dispersion }];
    for (frame, points) in &class.fields {
        rows.push(StripRow { label: format!("field {frame} to {}", frame + 1), points: points.clone(), median: None });
    }
    figures::distances(&class.label(), &rows)
}

fn distances_caption(class: &Class) -> String {
    format!(
        "Distances of the models of {}. First row: to the representative, over the fields in which each model was kept; the line is the median, \
         which is the dispersion. Other rows: mean distance to the other models in each displacement field; trimming drops the largest.",
        class.who()
    )
}

/// Figure of the difference between two groups, if both representatives exist.
fn difference(pair: &read::Pair, results: &Results, bench: &Workbench, lines: &Lines) -> Option<Figure> {
    let of = |group: &str| {
        results
            .classes
            .iter()
            .find(|c| c.about.emotion == pair.emotion && !c.about.group.is_empty() && group_values(&c.about.group) == group)
    };
    let (a, b) = (of(&pair.groups[0])?, of(&pair.groups[1])?);
    let differs = pair.p.is_some_and(|p| p <= results.significance);
    let differing: Vec<_> =
        pair.nodes.iter().filter(|(_, (_, p))| differs && *p <= results.significance).map(|(n, _)| *n).collect();
    let described = if differing.is_empty() { bench.wireframe.live_nodes() } else { &differing };
    let directions = figures::directions(&a.model, &b.model, described, &bench.tables);
    let [first, second] = [pair.groups[0].as_str(), pair.groups[1].as_str()];
    let energy = |n| pair.nodes.get(&n).map_or(0.0, |(energy, _)| energy.max(0.0));
    let title = format!("{}: {first} and {second}", pair.emotion);
    let of_whole = |&(p, holm): &(f64, f64)| is_of_whole([p, holm], pair.clearest.unwrap_or(1.0), results.significance);
    let not_whole = pair.whole.filter(|whole| differs && !of_whole(whole));
    let within = if pair.strata.is_empty() { String::new() } else { format!(", within {}", pair.strata) };
    let by_p = |p| format!("(p of either test after Holm's correction{within}: {})", p_value(p));
    let verdict = match (pair.p, differs) {
        (Some(p), true) if let Some((_, whole)) = not_whole => format!(
            "The groups differ at single nodes {}; as a whole they are not shown to differ (p after Holm's correction: {})",
            by_p(p),
            p_value(whole)
        ),
        (Some(p), true) => format!("The groups differ {}", by_p(p)),
        (Some(p), false) => format!("The groups are not shown to differ {}", by_p(p)),
        (None, _) => "The groups were not tested".to_owned(),
    };
    let mut words: Vec<String> = verdict.split("; ").map(|part| format!("{part}.")).collect();
    if directions.is_empty() {
        words.push(format!("At the apex {first} and {second} look alike."));
    } else {
        words
            .push(format!("At the apex of {first}, compared with {second}{}:", if differs { "" } else { ", perhaps by chance" }));
        words.extend(directions.iter().cloned());
    }
    let drawing =
        figures::difference(&title, [first, second], [&a.model, &b.model], (&energy, differs), &differing, &words, lines);
    let in_words = if directions.is_empty() {
        String::new()
    } else {
        format!(" At the apex of {first}, compared with {second}: {}.", directions.join("; "))
    };
    let doubt = if differs { "" } else { " Visible differences may be due to chance." };
    let effect =
        pair.effect.filter(|_| not_whole.is_none()).map(|e| format!(", effect {:.1} %", 100.0 * e.max(0.0))).unwrap_or_default();
    let caption = format!(
        "{}: {first} ({}) and {second} ({}). Left: their representatives at the apex. Right: energy distance of every node over its whole \
         motion. Rings: nodes that differ at a level of {} % over all nodes of the pair ({}). {verdict}{effect}.{in_words}{doubt}",
        pair.emotion,
        people(a),
        people(b),
        nine_digits(100.0 * results.significance),
        differing.len()
    );
    let mut figure = a.figure("difference", "difference between groups", drawing, &caption);
    figure.name = format!("difference_{}_and_{}", a.stem, b.stem);
    figure.about.figure.clone_from(&figure.name);
    figure.about.group = format!("{first}; {second}");
    figure.about.sequences += b.about.sequences.len();
    figure.about.people += b.about.subjects;
    Some(figure)
}

/// Names of the caption files.
const CAPTIONS: [&str; 2] = ["captions.csv", "captions.md"];

/// Names of the files that [`write_figures`] writes.
pub fn figure_files(figures: &[Figure]) -> Vec<String> {
    let of = |figure: &Figure| ["svg", "pdf"].map(|extension| format!("{}.{extension}", figure.name));
    figures.iter().flat_map(of).chain(CAPTIONS.map(str::to_owned)).collect()
}

/// Writes every figure as SVG and PDF, and their captions as `captions.csv` and `captions.md`, into a folder.
///
/// # Errors
/// [`FiguresError::Output`].
pub fn write_figures(
    figures: &[Figure],
    folder: &Path,
    mut wrote: impl FnMut(&str) -> Result<(), OutputError>,
) -> Result<(), FiguresError> {
    for figure in figures {
        let title = &figure.about.caption;
        let [svg, pdf] = ["svg", "pdf"].map(|extension| format!("{}.{extension}", figure.name));
        output::write_bytes(&folder.join(&svg), figure.drawing.svg(title).as_bytes())?;
        wrote(&svg)?;
        output::write_bytes(&folder.join(&pdf), &figure.drawing.pdf(title))?;
        wrote(&pdf)?;
    }
    let [table, captions] = CAPTIONS;
    output::write_csv(&folder.join(table), figures.iter().map(|f| &f.about))?;
    wrote(table)?;
    let mut text = String::from("# Figures\n");
    for (k, figure) in figures.iter().enumerate() {
        let of = &figure.about;
        let _ = writeln!(text, "\n**Figure {}** (`{}.svg`, `{}.pdf`). {}", k + 1, figure.name, figure.name, of.caption);
    }
    output::write_bytes(&folder.join(captions), text.as_bytes())?;
    Ok(wrote(captions)?)
}
