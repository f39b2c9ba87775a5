//! Reads, changes and writes a FAP file: scales every motion by a factor.
//!
//!     cargo run --example fap_file -- happiness.fap 1.5 happier.fap

use std::{env, error::Error, path::Path};

use grimace::fap::{FapCatalog, read_fap, write_fap};

fn main() -> Result<(), Box<dyn Error>> {
    match env::args().skip(1).collect::<Vec<_>>().as_slice() {
        [input, factor, output] => run(Path::new(input), factor.parse()?, Path::new(output)),
        _ => Err("usage: fap_file IN.fap FACTOR OUT.fap".into()),
    }
}

/// Multiplies the low-level FAPs of a file by `factor`, within the ranges of the standard.
///
/// # Errors
/// Any error of the steps.
pub fn run(input: &Path, factor: f64, output: &Path) -> Result<(), Box<dyn Error>> {
    let file = read_fap(input)?;
    // The reader tolerates files of other programs and reports what it tolerated.
    for finding in &file.findings {
        eprintln!("{finding}");
    }
    let mut sequence = file.sequence;
    let catalog = FapCatalog::mpeg4();
    for frame in &mut sequence.frames {
        for row in catalog.rows() {
            if let (Some(value), Some((least, most))) = (frame.value(row.number), row.range) {
                frame.set_value(row.number, Some((value * factor).clamp(least.into(), most.into())));
            }
        }
    }
    sequence.round();
    write_fap(output, &sequence)?;
    Ok(())
}
