//! Trackers to compare: the program's own tracker with different options, plain KLT, and existing tracks.

use std::path::{Path, PathBuf};

use nalgebra::Point2;
use serde_json::Value;

use super::EvaluateError;
use grimace::internal::{
    fit::FittedWireframe,
    sequence::{Frame, SequenceError},
    track::{
        AlignOptions, Found, Klt, PointTracker, Probe, Slot, TrackError, TrackFileError, TrackOptions, TrackPlan, TrackedFrame,
        TrackedNode, read_track, track_sequence,
    },
    wireframe::Wireframe,
};

/// Window of plain KLT, px.
pub const PLAIN_WINDOW_PX: u32 = 21;
/// Number of pyramid levels of plain KLT.
pub const PLAIN_LEVELS: u32 = 4;

/// What a variant runs.
#[derive(Clone, Debug, PartialEq)]
pub enum VariantKind {
    /// The program's tracker with these options.
    Options(TrackOptions),
    /// Plain KLT from frame to frame, with [`PLAIN_WINDOW_PX`] and [`PLAIN_LEVELS`] and no check; a lost node stays in place.
    PlainKlt,
    /// An existing track: a file, or a folder of files `SUBJECT_SEQUENCE.csv`.
    Tracks(PathBuf),
}

/// A named tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerVariant {
    /// Name in tables and figures.
    pub name: String,
    /// What it runs.
    pub kind: VariantKind,
}

/// A node in a frame: its position, and whether it was tracked into the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placed {
    pub position: Point2<f64>,
    pub tracked: bool,
    /// Expected error, px.
    pub expected: Option<f64>,
}

/// Returns the standard variants: the tracker with `options`, the tracker without deformation [KP, Fig. 3], and plain KLT.
///
/// The first two also run without the alignment with the neutral frame (or with it, when `options` disable it), so that each effect is
/// measured alone.
pub fn standard_variants(options: &TrackOptions) -> Vec<TrackerVariant> {
    let variant = |name: &str, kind| TrackerVariant { name: name.to_owned(), kind };
    let (gain, other) = if options.align.gain > 0.0 { (0.0, "not aligned") } else { (AlignOptions::default().gain, "aligned") };
    let align = AlignOptions { gain, ..options.align };
    vec![
        variant("with deformation", VariantKind::Options(*options)),
        variant("without deformation", VariantKind::Options(TrackOptions { deform: false, ..*options })),
        variant(&format!("with deformation, {other}"), VariantKind::Options(TrackOptions { align, ..*options })),
        variant(
            &format!("without deformation, {other}"),
            VariantKind::Options(TrackOptions { deform: false, align, ..*options }),
        ),
        variant("plain KLT", VariantKind::PlainKlt),
    ]
}

impl TrackerVariant {
    /// Parses a variant from `name:key=value,key=value`. Keys are fields of [`TrackOptions`], with dots for nested fields; `base` supplies
    /// the other fields.
    ///
    /// # Errors
    /// [`EvaluateError::Variant`] for text of another form, an unknown key, or a value of the wrong type.
    pub fn parse(text: &str, base: &TrackOptions) -> Result<Self, EvaluateError> {
        let error = |reason: String| EvaluateError::Variant { text: text.to_owned(), reason };
        let (name, settings) = text.split_once(':').unwrap_or((text, ""));
        if name.trim().is_empty() {
            return Err(error("it has no name; expected name:key=value,key=value".to_owned()));
        }
        let mut options = serde_json::to_value(base).map_err(|e| error(e.to_string()))?;
        for setting in settings.split(',').map(str::trim).filter(|s| !s.is_empty()) {
            let (key, value) =
                setting.split_once('=').ok_or_else(|| error(format!("`{setting}` is not of the form key=value")))?;
            let mut place = &mut options;
            for part in key.trim().split('.') {
                let names: Vec<String> = place.as_object().map(|o| o.keys().cloned().collect()).unwrap_or_default();
                place = place
                    .get_mut(part)
                    .ok_or_else(|| error(format!("there is no option `{}`; choose from {}", key.trim(), names.join(", "))))?;
            }
            let value = value.trim();
            *place = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
        }
        let options = serde_json::from_value(options).map_err(|e| error(e.to_string()))?;
        Ok(Self { name: name.trim().to_owned(), kind: VariantKind::Options(options) })
    }

    /// Tracks all N nodes through all frames, the neutral frame included.
    pub(super) fn track(
        &self,
        id: &str,
        wireframe: &Wireframe,
        plan: &TrackPlan,
        fitted: Option<&FittedWireframe>,
        frames: impl IntoIterator<Item = Result<Frame, SequenceError>>,
    ) -> Result<Vec<(u32, Vec<Placed>)>, VariantError> {
        // Without a fit, only existing tracks can be compared.
        match (&self.kind, fitted) {
            (VariantKind::Tracks(path), _) => read_placed(path, id, wireframe),
            (_, None) => Ok(Vec::new()),
            (VariantKind::PlainKlt, Some(fitted)) => Ok(plain_klt(wireframe, fitted, frames)?),
            (VariantKind::Options(options), Some(fitted)) => {
                let track = track_sequence(wireframe, plan, fitted, frames, options, |_| true)?;
                Ok(placed_frames(&track.frames))
            }
        }
    }
}

/// Why a variant has no track of a sequence.
#[derive(Debug, thiserror::Error)]
pub(super) enum VariantError {
    /// Tracking failed.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] TrackFileError),
    /// A track of another wireframe.
    #[error("{}: the track has {found} nodes, but the wireframe has {expected}", path.display())]
    Nodes {
        /// The file.
        path: PathBuf,
        /// Its nodes.
        found: usize,
        /// The wireframe's.
        expected: usize,
    },
}

fn placed_frames(frames: &[TrackedFrame]) -> Vec<(u32, Vec<Placed>)> {
    let placed = |n: &TrackedNode| Placed { position: n.position, tracked: n.state.loss().is_none(), expected: n.expected_error };
    frames.iter().map(|f| (f.number, f.nodes.iter().map(placed).collect())).collect()
}

/// Reads the track of a sequence from a file, or from a folder of files named after sequences.
fn read_placed(path: &Path, id: &str, wireframe: &Wireframe) -> Result<Vec<(u32, Vec<Placed>)>, VariantError> {
    let path = if path.is_dir() { path.join(format!("{id}.csv")) } else { path.to_owned() };
    let frames = read_track(&path)?;
    let (found, expected) = (frames.first().map_or(0, |f| f.nodes.len()), wireframe.node_count());
    if found != expected {
        return Err(VariantError::Nodes { path, found, expected });
    }
    Ok(placed_frames(&frames))
}

fn plain_klt(
    wireframe: &Wireframe,
    fitted: &FittedWireframe,
    frames: impl IntoIterator<Item = Result<Frame, SequenceError>>,
) -> Result<Vec<(u32, Vec<Placed>)>, TrackError> {
    let mut klt = Klt::new(PLAIN_LEVELS, PLAIN_WINDOW_PX);
    let mut nodes = fitted.model.nodes().to_vec();
    let live = wireframe.live_nodes();
    let mut out: Vec<(u32, Vec<Placed>)> = Vec::new();
    for frame in frames {
        let frame = frame?;
        klt.advance(&frame)?;
        let mut tracked = vec![true; nodes.len()];
        if !out.is_empty() {
            let probe = |p: Point2<f64>| Probe { position: p, guess: p };
            let probes: Vec<Probe> = live.iter().map(|n| probe(nodes[n.index()])).collect();
            let found = klt.find(Slot::Previous, Slot::Current, PLAIN_WINDOW_PX, PLAIN_LEVELS, &probes)?;
            for (node, found) in live.iter().zip(found) {
                match found {
                    Found::At { position, .. } => nodes[node.index()] = position,
                    Found::Lost => tracked[node.index()] = false,
                }
            }
            wireframe.place_followers(&mut nodes);
        }
        let placed = nodes.iter().zip(tracked).map(|(&position, tracked)| Placed { position, tracked, expected: None });
        out.push((frame.number(), placed.collect()));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_change_the_options_they_name() {
        let base = TrackOptions { levels: 3, ..TrackOptions::default() };
        let variant = TrackerVariant::parse("wide : window = 0.2, deform=false", &base).unwrap();
        assert_eq!(variant.name, "wide");
        assert_eq!(variant.kind, VariantKind::Options(TrackOptions { window: 0.2, deform: false, ..base }));
        assert_eq!(TrackerVariant::parse("same", &base).unwrap().kind, VariantKind::Options(base));
    }

    #[test]
    fn an_impossible_variant_is_explained() {
        let message = |text: &str| TrackerVariant::parse(text, &TrackOptions::default()).unwrap_err().to_string();
        assert!(message("a:windw=1").contains("there is no option `windw`; choose from "));
        assert!(message("a:windw=1").contains("window"));
        assert!(message("a:window").contains("`window` is not of the form key=value"));
        assert!(message("a:deform=7").contains("invalid type"));
        assert!(message("a:window.x=7").contains("there is no option `window.x`"));
        assert!(message(":window=1").contains("it has no name"));
    }
}
