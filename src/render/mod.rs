//! Pictures of dense faces: a software rasterizer, the scene it draws, and the sheets and animations made of its pictures.
//!
//! Nothing here needs a display or a graphics card, and the same face gives the same bytes.

mod palette;
mod raster;
mod sheet;

pub use palette::in_few_colours;
pub use raster::{Canvas, Shade, Vertex};
pub use sheet::{LABEL_HEIGHT, Labelled, contact_sheet, gif_bytes, write_label};
