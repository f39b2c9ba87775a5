//! A FAP file read, changed and written: every motion larger or smaller.
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

/// Multiplies the low-level FAPs of a file, within the ranges of the standard.
///
/// # Errors
/// What the steps say.
pub fn run(input: &Path, factor: f64, output: &Path) -> Result<(), Box<dyn Error>> {
    let file = read_fap(input)?;
    // Files of other programs are read tolerantly; what was tolerated is told.
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
