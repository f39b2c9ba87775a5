//! Reproduces the figures and tables of both papers: those of KP from a run over a dataset, those of ZL from a bank.

mod kp;
mod scaling;
mod zl;

use image::RgbImage;

use super::{EvaluateError, LineChart, Table};
use grimace::internal::{clone::Sheet, render::Labelled};

pub use kp::{KpFigures, PUBLISHED_DISPERSIONS};
pub use scaling::{ScalingRow, scaling_rows, scaling_table};
pub use zl::{ZlFigures, zl_plates};

/// Content of a plate, which determines its file format.
#[derive(Clone, Debug)]
pub enum PlateContent {
    /// A picture, written as PNG.
    Picture(RgbImage),
    /// A chart, written as SVG.
    Chart(LineChart),
    /// A table, written as CSV.
    Table(Table),
}

/// One figure or table.
#[derive(Clone, Debug)]
pub struct Plate {
    /// File name without extension, such as `kp_fig3`.
    pub name: String,
    /// The figure or table of the paper that it reproduces.
    pub what: String,
    /// What the plate shows, of whom, and how it was made.
    pub caption: String,
    /// The content.
    pub content: PlateContent,
}

impl Plate {
    fn new(name: &str, what: &str, caption: impl Into<String>, content: PlateContent) -> Self {
        Self { name: name.to_owned(), what: what.to_owned(), caption: caption.into(), content }
    }
}

/// Height of a picture on a sheet, px.
const HEIGHT: u32 = 300;

/// Arranges rows of labelled pictures in one picture.
fn sheet(rows: Vec<Vec<(RgbImage, String)>>) -> PlateContent {
    let mut sheet = Sheet::new(HEIGHT);
    for row in rows {
        sheet.push_labelled_row(row.into_iter().map(|(picture, label)| Labelled { picture, label }).collect());
    }
    PlateContent::Picture(sheet.draw())
}

fn failed(what: &str) -> impl Fn(&dyn std::fmt::Display) -> EvaluateError + '_ {
    move |reason| EvaluateError::Figure { title: what.to_owned(), reason: reason.to_string() }
}
