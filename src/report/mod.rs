//! Renders the report: one self-contained HTML file.
//!
//! The page contains its style sheet, its script and its data, and loads nothing (a content security policy enforces this). Text and tables
//! are rendered here; the page's script draws figures from the embedded data. The bytes depend on the input alone: no clock, no random
//! names, lengths rounded to 0.01 face units.

mod conclusions;
mod courses;
mod covariates;
pub mod drawing;
mod failure;
pub mod figures;
mod group_tables;
mod groups;
mod numbers;
mod payload;
mod variation;
mod view;

use std::collections::BTreeMap;

use minijinja::{
    Environment, UndefinedBehavior, context,
    syntax::SyntaxConfig,
    value::{Serde, Value},
};

use crate::{
    features::Course,
    player,
    statistics::{
        Representative,
        amplitude::AmplitudeComparison,
        bootstrap::DispersionInterval,
        compare::{CompareOptions, Comparisons, GroupOptions},
    },
    track::TrackQuality,
    units::SequenceId,
    wireframe::{Fapus, Tables, Wireframe},
};

pub use courses::{mean_course, mean_course_svg};
pub use covariates::CovariateData;
pub use failure::{Failure, Stage, failed_id, failed_name};
pub use groups::p_value;
pub use variation::{BandCurve, VariationData};

const TEMPLATE: &str = include_str!("assets/report.html");
/// Terms of the field, explained on the page.
const GLOSSARY: &str = include_str!("../../docs/glossary.md");
const STYLE: &str = include_str!("assets/report.css");
/// The parts of the page's script, in order of dependence.
const SCRIPTS: [&str; 8] = [
    include_str!("assets/core.js"),
    include_str!("assets/maps.js"),
    include_str!("assets/charts.js"),
    include_str!("assets/groups.js"),
    include_str!("assets/variation.js"),
    include_str!("assets/quality.js"),
    include_str!("assets/page.js"),
    include_str!("assets/glossary.js"),
];

/// One FAP of a representative's apex frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ApexFap {
    /// FAP number, 3 to 68.
    pub number: u8,
    /// Name in the standard.
    pub name: String,
    /// Unit of the value, such as `ENS/1024`.
    pub unit: String,
    /// Whether the value is an angle. Angles are listed but not drawn together with lengths.
    pub is_angle: bool,
    /// The value, in its unit.
    pub value: i32,
}

/// Data of the report.
#[derive(Debug)]
pub struct ReportData<'a> {
    /// Heading, such as the dataset's folder name.
    pub title: String,
    /// Program version and the options as label and value, in display order.
    pub options: Vec<(String, String)>,
    /// The representatives, by emotion and group.
    pub representatives: &'a [Representative],
    /// One row per tracked sequence, sorted by id.
    pub tracks: &'a [TrackQuality],
    /// Pose and action units over time, for sequences that have them.
    pub courses: &'a BTreeMap<SequenceId, Course>,
    /// What failed.
    pub failures: &'a [Failure],
    /// Notes on sequences that are copies of others.
    pub same: &'a [String],
    /// Note about sequences with fewer frames than a model, if there are any.
    pub too_short: Option<String>,
    /// Topology and canonical neutral.
    pub wireframe: &'a Wireframe,
    /// Regions and feature points.
    pub tables: &'a Tables,
    /// FAPUs of the canonical neutral, face units.
    pub fapus: Fapus,
    /// FAP values at the apex of every representative (same order).
    pub apex_faps: Vec<Vec<ApexFap>>,
    /// Data of a player that shows every representative (same order) on one face, made by the module `player`; `None` without a player.
    pub player: Option<serde_json::Value>,
    /// Name of that face.
    pub face: String,
    /// Variation of the people of every representative (same order); `None` for one without, empty if there is none at all.
    pub variations: Vec<Option<VariationData<'a>>>,
    /// Stems of the files of every representative (same order), for links; empty for none.
    pub stems: Vec<String>,
    /// Names of the files written beside the report, for the list of files.
    pub files: Vec<String>,
    /// Whether tracks and models are beside the report and can be linked.
    pub tracked_here: bool,
    /// Associations of emotions with numbers of the people; empty if not requested.
    pub covariates: Vec<CovariateData<'a>>,
    /// Options of the tests.
    pub compare: CompareOptions,
    /// Columns within whose values labels and numbers are exchanged; empty if among all people.
    pub strata: &'a [String],
    /// Comparison of groups; `None` without groups.
    pub groups: Option<GroupsData<'a>>,
}

/// Report data on groups.
#[derive(Debug)]
pub struct GroupsData<'a> {
    /// Tests between groups.
    pub comparisons: &'a Comparisons,
    /// Comparisons of amplitudes.
    pub amplitudes: &'a [AmplitudeComparison],
    /// Options of tests and bootstrap.
    pub options: &'a GroupOptions,
    /// Number of people and interval of every representative (same order).
    pub classes: Vec<(usize, Option<DispersionInterval>)>,
}

/// Renders the report.
///
/// All texts of the user (title, labels, ids, reasons) are escaped. The data is embedded as JSON in which `<` is written `\u003c`, so that
/// no text can end the script element or open a comment. Non-finite numbers are shown as a dash.
///
/// # Errors
/// When the template cannot be rendered (a programming error).
pub fn render_html(data: &ReportData<'_>) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_syntax(SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build()?);
    // The name ends in `.html`: minijinja escapes every value that is not marked safe.
    environment.add_template("report.html", TEMPLATE)?;
    let player = data.player.as_ref().map(|_| player::script()).unwrap_or_default();
    environment.get_template("report.html")?.render(context! {
        report => Value::from(Serde(view::View::new(data))),
        payload => Value::from_safe_string(payload::json(data)),
        style => Value::from_safe_string(format!("{STYLE}{}", player::STYLE)),
        script => Value::from_safe_string(format!("{player}{}", SCRIPTS.join("\n"))),
    })
}
