//! Animated photographs: a portrait's wireframe performs a known expression, and the texture engine ([`grimace::internal::warp`]) moves the
//! picture with it.
//!
//! The nodes of a frame are the positions to which the engine moved the skin, not the requested ones, so they are exact even when the
//! engine smooths the motion. Roll, shift and change of scale move the whole picture; yaw and pitch move the nodes, at Candide-3's depths,
//! in front of it. A sequence starts with the unchanged photograph.

use std::path::Path;

use image::RgbImage;
use nalgebra::{Point2, Point3, Vector3};
use rayon::prelude::*;
use serde_json::json;

use super::{
    DatasetSummary, Emotion, SimulateError, SimulateOptions, SimulatedFrame,
    blink::{Blink, close_lids},
    camera::{Exposure, develop},
    expression::{apex_offsets, fap_offsets},
    files::{ManifestRow, Performance, begin, finish, write_sequence},
    motion::Course,
    portrait::{Portrait, PortraitError},
    subject::place_followers,
};
use grimace::internal::{
    fap::FapSequence,
    geometry::Similarity,
    warp::{MouthInside, WarpError},
    wireframe::Wireframe,
};

/// Smallest code of motions from FAP files, which follow the emotions' codes; also their first sequence number.
const FIRST_FAP_CODE: u8 = 8;
/// Largest number of motions from FAP files.
pub const MAX_FAP_MOTIONS: usize = 8;

/// The motion that a portrait performs.
#[derive(Clone, Debug, PartialEq)]
pub enum PortraitMotion {
    /// An emotion, from neutral to the apex.
    Emotion(Emotion),
    /// FAP curves, stretched over the frames of the sequence.
    Faps {
        /// Label of the sequence.
        label: String,
        /// The curves.
        faps: FapSequence,
    },
}

impl PortraitMotion {
    fn label(&self) -> &str {
        match self {
            Self::Emotion(emotion) => emotion.label(),
            Self::Faps { label, .. } => label,
        }
    }
}

/// A portrait that performs a motion.
#[derive(Debug)]
pub struct AnimatedPortrait<'a> {
    portrait: &'a Portrait,
    options: &'a SimulateOptions,
    wireframe: &'a Wireframe,
    index: u32,
    code: u8,
    course: Course,
    blink: Option<Blink>,
    /// Offsets at the apex, or at every frame of the FAP curves, in model units of face space.
    offsets: Vec<Vec<Vector3<f64>>>,
    is_curve: bool,
}

impl<'a> AnimatedPortrait<'a> {
    /// Makes performance number `index` of a portrait. `code` is that of the emotion, or 8 to 15 for FAP curves.
    pub fn new(
        portrait: &'a Portrait,
        motion: &PortraitMotion,
        options: &'a SimulateOptions,
        wireframe: &'a Wireframe,
        index: u32,
        code: u8,
    ) -> Self {
        let (offsets, is_curve) = match motion {
            PortraitMotion::Emotion(emotion) => {
                let apex = apex_offsets(wireframe, &portrait.fapus, *emotion, 1.0, options.seed, index);
                (vec![apex], false)
            }
            PortraitMotion::Faps { faps, .. } => {
                (faps.frames.iter().map(|frame| fap_offsets(wireframe, &portrait.fapus, frame)).collect(), true)
            }
        };
        Self {
            portrait,
            options,
            wireframe,
            index,
            code,
            course: Course::from_rest(options, index, code, portrait.image_from_face.scale),
            blink: Blink::new(options, index, code),
            offsets,
            is_curve,
        }
    }

    /// Returns the number of frames.
    pub fn frame_count(&self) -> usize {
        self.options.frames
    }

    /// Returns the offsets from neutral at a time in frames, in model units of face space.
    fn offsets_at(&self, time: f64) -> Vec<Vector3<f64>> {
        let mut offsets: Vec<Vector3<f64>> = if self.is_curve {
            let last = self.offsets.len().saturating_sub(1);
            let place = (time / (self.options.frames - 1) as f64).clamp(0.0, 1.0) * last as f64;
            let below = (place.floor() as usize).min(last);
            let (a, b) = (&self.offsets[below], &self.offsets[(below + 1).min(last)]);
            a.iter().zip(b).map(|(a, b)| a + (b - a) * (place - below as f64)).collect()
        } else {
            let intensity = self.course.intensity(time);
            self.offsets[0].iter().map(|d| d * intensity).collect()
        };
        if let Some(blink) = &self.blink {
            close_lids(&self.portrait.neutral, &mut offsets, blink.closure(time));
        }
        offsets
    }

    /// Returns the requested positions of the nodes at a time in frames, and the motion of the whole picture.
    fn wanted(&self, time: f64) -> (Vec<Point2<f64>>, Similarity) {
        let Portrait { image_from_face, neutral, warp, .. } = self.portrait;
        let mut nodes: Vec<Point3<f64>> = neutral.iter().zip(self.offsets_at(time)).map(|(n, d)| n + d).collect();
        place_followers(self.wireframe, &mut nodes);
        let (rest, pose) = (self.course.pose(0.0), self.course.pose(time));
        // The motion is added to the nodes on the photograph, so that the positions at rest are exactly equal to them.
        let motion = |(start, node): (&Point3<f64>, &Point3<f64>)| pose.project(node) - rest.project(start);
        let motions = neutral.iter().zip(&nodes).map(motion);
        let wanted = warp.nodes().iter().zip(motions).map(|(p, m)| p + image_from_face.apply_vector(&m)).collect();
        let flat = pose.flat();
        let whole =
            if flat == Similarity::identity() { flat } else { image_from_face.after(&flat).after(&image_from_face.inverse()) };
        (wanted, whole)
    }

    /// Returns the picture and the exact nodes of a frame, `frame` in `0..frame_count()`.
    ///
    /// # Errors
    /// [`WarpError`] when the picture cannot be warped to the nodes.
    pub fn frame(&self, frame: usize) -> Result<SimulatedFrame, WarpError> {
        let Portrait { warp, texture, .. } = self.portrait;
        let deform = |time: f64| {
            let (nodes, whole) = self.wanted(time);
            warp.deform_with(&nodes, &whole)
        };
        let deformation = deform(frame as f64)?;
        let half = self.options.camera.shutter / 2.0;
        let extent = if half > 0.0 {
            let [open, close] = [-half, half].map(|dt| self.wanted(frame as f64 + dt).0);
            open.iter().zip(&close).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max)
        } else {
            0.0
        };
        let times = self.options.camera.exposure_times(frame, extent);
        let (mut sums, mut size) = (Vec::new(), (0, 0));
        let mut picture = RgbImage::default();
        for &time in &times {
            warp.render_into(texture, &deform(time)?, &MouthInside::Dark, &mut picture);
            size = picture.dimensions();
            sums.resize(picture.as_raw().len(), 0_u32);
            sums.iter_mut().zip(picture.as_raw()).for_each(|(sum, &value)| *sum += u32::from(value));
        }
        let count = times.len().max(1) as f32;
        let data = sums.into_iter().map(|sum| sum as f32 / count).collect();
        let exposure = Exposure { width: size.0 as usize, height: size.1 as usize, data };
        let image = develop(exposure, self.options, self.index, self.code, frame);
        Ok(SimulatedFrame { image, nodes: deformation.nodes().to_vec() })
    }
}

/// Columns of a portrait's manifest that are not copied, because their values do not apply to the sequences made from it.
const OWN_COLUMNS: [&str; 12] = [
    "subject",
    "sequence",
    "emotion",
    "frames",
    "first_frame",
    "last_frame",
    "correspondences",
    "landmarks",
    "fps",
    "face_id",
    "segment",
    "portrait",
];

/// Writes a dataset of animated photographs, like [`super::simulate_dataset`] for rendered faces. Metadata of a portrait's person are
/// copied to the manifest.
///
/// The number of subjects is [`SimulateOptions::subjects`]. Portraits are used in turn; in further rounds they perform differently and
/// their names end in `-2`, `-3` and so on. The size in the options is ignored; frames have the size of the photograph.
///
/// # Errors
/// [`SimulateError`] for options out of range, a portrait that cannot be warped, more than [`MAX_FAP_MOTIONS`] motions from FAP files, a
/// folder that is not empty (unless `force`), or a file that cannot be written.
pub fn simulate_photographs(
    portraits: &[Portrait],
    motions: &[PortraitMotion],
    options: &SimulateOptions,
    out: &Path,
    force: bool,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<DatasetSummary, SimulateError> {
    options.check()?;
    let faps = motions.iter().filter(|m| matches!(m, PortraitMotion::Faps { .. })).count();
    if faps > MAX_FAP_MOTIONS {
        return Err(SimulateError::OutOfRange {
            option: "fap",
            value: format!("given {faps} times"),
            range: "given at most 8 times",
        });
    }
    let record = begin(out, force)?;
    let wireframe = Wireframe::candide3();
    let mut next = FIRST_FAP_CODE;
    let coded: Vec<(u8, &PortraitMotion)> = motions
        .iter()
        .map(|motion| match motion {
            PortraitMotion::Emotion(emotion) => (emotion.code(), motion),
            PortraitMotion::Faps { .. } => {
                next += 1;
                (next - 1, motion)
            }
        })
        .collect();
    let cases: Vec<(u32, &Portrait, u8, &PortraitMotion)> = (0..options.subjects)
        .zip(portraits.iter().cycle())
        .flat_map(|(index, portrait)| coded.iter().map(move |&(code, motion)| (index, portrait, code, motion)))
        .collect();
    let mut columns: Vec<&str> = portraits.iter().flat_map(|p| p.metadata().keys()).map(String::as_str).collect();
    columns.retain(|name| !name.is_empty() && !OWN_COLUMNS.contains(name));
    columns.sort_unstable();
    columns.dedup();
    columns.insert(0, "portrait");
    let total = cases.len() * options.frames;
    let done = std::sync::atomic::AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, total);
    let rows: Vec<ManifestRow> = cases
        .par_iter()
        .map(|&(index, portrait, code, motion)| {
            let sequence = AnimatedPortrait::new(portrait, motion, options, &wireframe, index, code);
            let round = index as usize / portraits.len().max(1) + 1;
            let performance = Performance {
                subject: if round > 1 { format!("{}-{round}", portrait.id()) } else { portrait.id().to_owned() },
                sequence: format!("{code:03}"),
                emotion: motion.label().to_owned(),
                stream: (index, code),
                frame: |k| {
                    let error = |source| SimulateError::from(PortraitError::Warp { id: portrait.id().to_owned(), source });
                    sequence.frame(k).map_err(error)
                },
            };
            let known = columns[1..].iter().map(|&name| portrait.metadata().get(name).cloned().unwrap_or_default());
            Ok(write_sequence(&performance, options, &record, &tick)?.with([portrait.id().to_owned()].into_iter().chain(known)))
        })
        .collect::<Result<_, SimulateError>>()?;
    let sequences = rows.len();
    let mut further = serde_json::Map::new();
    further.insert("portraits".to_owned(), json!(portraits.iter().map(Portrait::id).collect::<Vec<_>>()));
    finish(record, out, options, &further, &columns, rows)?;
    Ok(DatasetSummary { sequences, frames: total })
}
