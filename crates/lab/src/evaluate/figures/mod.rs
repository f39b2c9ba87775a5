//! The figures and tables of both papers, made anew by this program: KP's from a dataset and the run over it, ZL's from a bank.

mod kp;
mod scaling;
mod zl;

use image::RgbImage;

use super::{EvaluateError, LineChart, Table};
use grimace::internal::{clone::Sheet, render::Labelled};

pub use kp::{KpFigures, PUBLISHED_DISPERSIONS};
pub use scaling::{ScalingRow, scaling_rows, scaling_table};
pub use zl::{ZlFigures, zl_plates};

/// What a plate holds.
#[derive(Clone, Debug)]
pub enum PlateContent {
    /// Pictures of faces: PNG.
    Picture(RgbImage),
    /// A plot: SVG.
    Chart(LineChart),
    /// Numbers: CSV.
    Table(Table),
}

/// One figure or table.
#[derive(Clone, Debug)]
pub struct Plate {
    /// File name without extension, such as `kp_fig3`.
    pub name: String,
    /// What it is in the paper.
    pub what: String,
    /// What is seen, of whom, and how it was made.
    pub caption: String,
    /// The content.
    pub content: PlateContent,
}

impl Plate {
    fn new(name: &str, what: &str, caption: impl Into<String>, content: PlateContent) -> Self {
        Self { name: name.to_owned(), what: what.to_owned(), caption: caption.into(), content }
    }
}

/// Height of a picture in a sheet, px.
const HEIGHT: u32 = 300;

/// Rows of labelled pictures in one picture.
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
