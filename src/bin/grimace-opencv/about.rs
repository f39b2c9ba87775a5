//! `--about`: reports the version of OpenCV and the codecs with which it writes films.

use opencv::{
    core::{Size, get_version_string},
    prelude::*,
    videoio::{VideoWriter, get_backend_name, get_stream_backends},
};

use crate::encode::codecs;

/// Side of the test films, px.
const SIDE: i32 = 64;

/// Lines of the report.
pub fn lines() -> Vec<String> {
    let version = get_version_string().unwrap_or_else(|_| "of unknown version".to_owned());
    let readers = get_stream_backends().unwrap_or_default();
    let names: Vec<String> = readers.iter().filter_map(|backend| get_backend_name(backend).ok()).collect();
    let mut lines = vec![format!("OpenCV {version}"), format!("videos are read by: {}", or_nothing(&names))];
    for format in ["mp4", "webm"] {
        let written = codecs(Some(format)).unwrap_or_default().iter().filter(|codec| writes(format, codec));
        let names: Vec<String> = written.map(|codec| String::from_utf8_lossy(*codec).into_owned()).collect();
        lines.push(format!("{format} is written with: {}", or_nothing(&names)));
    }
    lines
}

fn or_nothing(names: &[String]) -> String {
    if names.is_empty() { "nothing".to_owned() } else { names.join(", ") }
}

/// Whether a film of a format can be started with a codec.
fn writes(format: &str, codec: &[u8; 4]) -> bool {
    let Ok(folder) = tempfile::tempdir() else { return false };
    let path = folder.path().join(format!("film.{format}"));
    let name = path.to_string_lossy().into_owned();
    let [a, b, c, d] = codec.map(char::from);
    let open = || -> opencv::Result<bool> {
        let fourcc = VideoWriter::fourcc(a, b, c, d)?;
        VideoWriter::new(&name, fourcc, 25.0, Size::new(SIDE, SIDE), true)?.is_opened()
    };
    open().unwrap_or(false)
}
