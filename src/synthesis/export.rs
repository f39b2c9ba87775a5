//! Writes the files of a synthesized animation: glTF, meshes, arrays, weights, and pictures.

use std::{borrow::Cow, path::Path};

use image::{RgbImage, codecs::jpeg::JpegEncoder};
use nalgebra::{UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::{FaceScene, FpMotion, FrameAnswer, HeadTexture, Solver, SynthesisError, Synthesizer, View, fapu_length, head_pivot};
use crate::{
    mesh::{
        add,
        gltf::{GltfAnimation, GltfLook, GltfSurface, GltfTarget, GltfTexture, write_glb},
        write_npy_f32, write_obj, write_ply,
    },
    output::{OutputError, nine_digits, write_atomic, write_bytes},
    overlay::png_bytes,
    render::{Labelled, contact_sheet, gif_bytes},
    wireframe::Fapu,
};

/// An animation: a synthesizer's answers to the frames of a motion, to be written by [`write_gltf`].
///
/// ```
/// use grimace::synthesis::{Animation, Synthesizer, candide_bank, read_motion};
///
/// let bank = candide_bank()?;
/// let motion = read_motion("fixtures/golden/fap/happiness.fap".as_ref(), &bank, None)?;
/// let synthesizer = Synthesizer::new(&bank, Default::default())?;
/// // The answers to the first two frames alone do not make an animation of all 25.
/// let answers = synthesizer.animate(&motion.frames[..2], || ());
/// assert!(Animation::new(&synthesizer, &motion.frames, &answers, "smile", 25.0).is_err());
/// assert!(Animation::new(&synthesizer, &motion.frames[..2], &answers, "smile", 25.0).is_ok());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Animation<'a> {
    /// The synthesizer that made the answers.
    #[doc(hidden)]
    pub synthesizer: &'a Synthesizer<'a>,
    /// The motion.
    #[doc(hidden)]
    pub motions: &'a [FpMotion],
    /// One answer for every frame.
    #[doc(hidden)]
    pub answers: &'a [FrameAnswer],
    /// Name of the animation.
    #[doc(hidden)]
    pub name: &'a str,
    /// Frames per second.
    #[doc(hidden)]
    pub fps: f64,
    /// Texture of the skin; `None` for the bank's colours.
    #[doc(hidden)]
    pub texture: Option<&'a HeadTexture>,
}

impl<'a> Animation<'a> {
    /// Creates the animation of a motion, in the bank's colours. `answers` are those of `synthesizer` to the frames of the motion, one each
    /// ([`Synthesizer::animate`]); `fps` frames are shown per second.
    ///
    /// # Errors
    /// [`SynthesisError::Animation`] for a motion without frames, answers that are not one for each frame or of another bank, and a frame
    /// rate that is not a finite number above 0.
    pub fn new(
        synthesizer: &'a Synthesizer<'a>,
        motion: &'a [FpMotion],
        answers: &'a [FrameAnswer],
        name: &'a str,
        fps: f64,
    ) -> Result<Self, SynthesisError> {
        let animation = Self { synthesizer, motions: motion, answers, name, fps, texture: None };
        animation.check(synthesizer).map(|()| animation)
    }

    /// Checks that the answers are of the bank and the regions of a synthesizer.
    fn check(&self, synthesizer: &Synthesizer<'_>) -> Result<(), SynthesisError> {
        let wrong = |reason: String| SynthesisError::Animation { name: self.name.to_owned(), reason };
        let (frames, answers) = (self.motions.len(), self.answers.len());
        if frames == 0 || frames != answers {
            return Err(wrong(format!("{answers} answers for {frames} frames; one for each, and at least one, was expected")));
        }
        if !(self.fps.is_finite() && self.fps > 0.0) {
            return Err(wrong(format!("{} frames per second; a finite number above 0 was expected", self.fps)));
        }
        let bank = synthesizer.bank();
        let (points, expected) = (bank.feature_points().len(), bank.vertex_count());
        if let Some(k) = self.motions.iter().position(|motion| motion.offsets.len() != points) {
            let found = self.motions[k].offsets.len();
            return Err(wrong(format!("frame {k} has {found} feature points, but the bank has {points}")));
        }
        let found = self.synthesizer.bank().vertex_count();
        if found != expected {
            return Err(wrong(format!("its bank has {found} vertices, but that of the first animation has {expected}")));
        }
        let shape = (synthesizer.regions().count(), bank.member_count());
        let has_shape = |a: &FrameAnswer| a.weights.len() == shape.0 && a.weights.iter().all(|w| w.len() == shape.1);
        if synthesizer.options().solver != Solver::Rbf
            && let Some(k) = self.answers.iter().position(|answer| !has_shape(answer))
        {
            let (regions, members) = shape;
            return Err(wrong(format!(
                "the answer to frame {k} has not {regions} x {members} weights, regions x members of the bank"
            )));
        }
        Ok(())
    }
}

/// Roughness of the materials: 0 is a mirror, 1 is matt.
const ROUGHNESS: [(&str, f32); 4] = [("skin", 0.65), ("eyes", 0.12), ("mouth", 0.3), ("hair", 0.8)];
/// JPEG quality of the texture.
const TEXTURE_QUALITY: u8 = 90;

/// Rotations of the head in every frame, quaternions x, y, z, w: about x, then y, then z, as poses of heads are taken apart. None if it
/// does not turn.
fn turns(animation: &Animation<'_>) -> Vec<[f32; 4]> {
    let turns = animation.motions.iter().map(|motion| motion.turn);
    if turns.clone().all(|turn| turn == Vector3::zeros()) {
        return Vec::new();
    }
    let quaternion = |turn: Vector3<f64>| UnitQuaternion::from_euler_angles(turn.x, turn.y, turn.z);
    turns.map(|turn| quaternion(turn).coords.map(|c| c as f32).into()).collect()
}

fn jpeg_bytes(picture: &RgbImage) -> Result<Vec<u8>, image::ImageError> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, TEXTURE_QUALITY).encode_image(picture)?;
    Ok(jpeg)
}

/// Distance between the pupils of a head, m: the adult mean.
const EYE_SEPARATION_M: f64 = 0.063;

/// Writes animations as binary glTF (`.glb`), in metres at the size of a head. All must have the same bank and the same scheme of regions.
///
/// ```
/// use grimace::{pipeline::read_model, synthesis::{Animation, Motion, Synthesizer, candide_bank, write_gltf}};
///
/// let bank = candide_bank()?;
/// let model = read_model("fixtures/golden/representatives/happiness.csv".as_ref())?;
/// // Five frames between those of the model, 25 a second.
/// let motion = Motion::from_model("happiness", &model, &bank, None)?.as_animated(None, None)?;
/// let synthesizer = Synthesizer::new(&bank, Default::default())?;
/// let answers = synthesizer.animate(&motion.frames, || ());
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("happiness.glb");
/// write_gltf(&path, &[Animation::new(&synthesizer, &motion.frames, &answers, "happiness", 25.0)?])?;
/// assert_eq!(&std::fs::read(&path)?[..4], b"glTF");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// - The file has one animation for each item. The animations share the morph targets.
/// - Members with a weight in any frame become morph targets under their names. With several regions there is one target for
///   every member and region, `NAME.REGION`, which moves the vertices by their share in the region.
/// - Viewers accept weights from 0 to 1. A target whose weights exceed 1 is enlarged, and its weights are divided by the same
///   factor. Weights below 0 stay as they are.
/// - A head that turns ([`FpMotion::turn`]) turns as a whole, about feature point 7.1 or, in a bank without it, about a point near the
///   top of the spine.
/// - A surface without weights ([`Solver::Rbf`]) becomes one target for every frame.
/// - Skin, eyes, the inside of the mouth and hair have one material each. With a texture, the skin uses it, and hair is left out
///   because the portrait shows its own.
///
/// # Errors
/// [`SynthesisError`] for no animation, animations of different banks or regions, and a file that cannot be written.
pub fn write_gltf(path: &Path, animations: &[Animation<'_>]) -> Result<(), SynthesisError> {
    let Some(first) = animations.first() else {
        let name = path.display().to_string();
        return Err(SynthesisError::Animation { name, reason: "there is no animation to write".to_owned() });
    };
    animations.iter().try_for_each(|animation| animation.check(first.synthesizer))?;
    let (bank, regions, texture) = (first.synthesizer.bank(), first.synthesizer.regions(), first.texture);
    let metres = fapu_length(bank, Fapu::Es).map(|es| EYE_SEPARATION_M / es);
    let scene = FaceScene::new(bank);
    let mut paint = scene.colours();
    let mut surfaces = scene.surfaces();
    if let Some(texture) = texture {
        let eyes = surfaces.iter().filter(|(name, _)| *name == "eyes").flat_map(|(_, eyes)| eyes.as_flattened());
        if let Some(paint) = &mut paint {
            eyes.for_each(|&v| paint[v as usize] = texture.colours[v as usize]);
        }
        surfaces.retain(|(name, _)| *name != "hair");
        let is_of = |name: &'static str| move |surface: &&mut (&str, Vec<[u32; 3]>)| surface.0 == name;
        if let Some((_, skin)) = surfaces.iter_mut().find(is_of("skin")) {
            skin.clone_from(&texture.worn);
        }
        match surfaces.iter_mut().find(is_of("mouth")) {
            Some((_, mouth)) => mouth.extend(&texture.inside),
            None if texture.inside.is_empty() => {}
            None => surfaces.push(("mouth", texture.inside.clone())),
        }
    }
    let roughness = |name: &str| ROUGHNESS.iter().find(|r| r.0 == name).map_or(ROUGHNESS[0].1, |r| r.1);
    let surface = |(name, triangles): (&'static str, _)| GltfSurface {
        name,
        triangles,
        roughness: roughness(name),
        textured: name == "skin",
    };
    let jpeg = texture.map(|texture| jpeg_bytes(&texture.picture)).transpose()?;
    let look = GltfLook {
        paint: paint.as_deref(),
        surfaces: surfaces.into_iter().map(surface).collect(),
        texture: texture.zip(jpeg).map(|(texture, jpeg)| GltfTexture { jpeg, places: &texture.places }),
        copyright: &bank.info().credit,
        pivot: head_pivot(bank),
    };
    let times = |a: &Animation<'_>| (0..a.answers.len()).map(|frame| (frame as f64 / a.fps) as f32).collect::<Vec<f32>>();
    if first.synthesizer.options().solver == Solver::Rbf {
        let places: Vec<(usize, usize)> =
            animations.iter().enumerate().flat_map(|(k, a)| (0..a.answers.len()).map(move |frame| (k, frame))).collect();
        let targets: Vec<GltfTarget> =
            (0..places.len()).map(|k| GltfTarget { name: format!("frame_{k:03}"), vertices: None }).collect();
        let shown = |(k, a): (usize, &Animation<'_>)| {
            let of = |frame: usize| places.iter().map(move |&place| f32::from(u8::from(place == (k, frame))));
            let weights = (0..a.answers.len()).flat_map(of).collect();
            GltfAnimation { name: a.name.to_owned(), times_s: times(a), weights, turns: turns(a) }
        };
        let shown: Vec<GltfAnimation> = animations.iter().enumerate().map(shown).collect();
        let surface = |k: usize| Cow::Owned(animations[places[k].0].surface(places[k].1));
        return Ok(write_atomic(path, |out| write_glb(out, (bank.mesh(), &look), &targets, &surface, &shown, metres))?);
    }
    // Smallest and largest weight of a target.
    let span = |region: usize, member: usize| {
        let weights = animations.iter().flat_map(|a| a.answers).map(move |a| a.weights[region][member]);
        weights.fold((0.0_f64, 0.0_f64), |(low, high), w| (low.min(w), high.max(w)))
    };
    let pairs: Vec<(usize, usize, f64)> = (0..bank.member_count())
        .flat_map(|member| (0..regions.count()).map(move |region| (member, region)))
        .filter_map(|(member, region)| match span(region, member) {
            (low, high) if low == 0.0 && high == 0.0 => None,
            (low, high) => Some((member, region, if low < 0.0 { 1.0 } else { high.max(1.0) })),
        })
        .collect();
    let names = regions.scheme().names();
    let target = |&(member, region, _): &(usize, usize, f64)| {
        let name = &bank.names()[member];
        if regions.count() == 1 {
            return GltfTarget { name: name.clone(), vertices: None };
        }
        let shares = regions.vertex_shares(region).iter().enumerate();
        let vertices = shares.filter(|(_, share)| **share > 0.0).map(|(v, _)| v as u32).collect();
        GltfTarget { name: format!("{name}.{}", names[region]), vertices: Some(vertices) }
    };
    let targets: Vec<GltfTarget> = pairs.iter().map(target).collect();
    let displacements = |k: usize| -> Cow<'_, [[f32; 3]]> {
        let (member, region, larger) = pairs[k];
        let all = bank.displacements(member);
        if regions.count() == 1 && larger <= 1.0 {
            return Cow::Borrowed(all);
        }
        let larger = larger as f32;
        Cow::Owned(all.iter().zip(regions.vertex_shares(region)).map(|(d, &share)| d.map(|c| c * share * larger)).collect())
    };
    let weights = |a: &Animation<'_>| {
        let of = |a: &FrameAnswer| pairs.iter().map(|&(m, r, larger)| (a.weights[r][m] / larger) as f32).collect::<Vec<_>>();
        let weights = a.answers.iter().flat_map(of).collect();
        GltfAnimation { name: a.name.to_owned(), times_s: times(a), weights, turns: turns(a) }
    };
    let shown: Vec<GltfAnimation> = animations.iter().map(weights).collect();
    Ok(write_atomic(path, |out| write_glb(out, (bank.mesh(), &look), &targets, &displacements, &shown, metres))?)
}

/// Number of frames whose surfaces are in memory at once while files are written.
const BATCH: usize = 8;

impl Animation<'_> {
    /// Displacements of the surface of a frame.
    pub fn surface(&self, frame: usize) -> Vec<[f32; 3]> {
        self.synthesizer.surface(&self.answers[frame], &self.motions[frame])
    }

    /// Passes the surfaces to `take` in order. They are computed a few at a time, in parallel.
    ///
    /// # Errors
    /// The errors of `take`.
    pub fn for_each_surface<E>(&self, mut take: impl FnMut(usize, Vec<[f32; 3]>) -> Result<(), E>) -> Result<(), E> {
        for start in (0..self.answers.len()).step_by(BATCH) {
            let end = (start + BATCH).min(self.answers.len());
            let surfaces: Vec<_> = (start..end).into_par_iter().map(|frame| self.surface(frame)).collect();
            for (frame, surface) in (start..end).zip(surfaces) {
                take(frame, surface)?;
            }
        }
        Ok(())
    }

    /// Writes `surface.npy`: frames x vertices x 3, displacements from neutral.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write_npy(&self, path: &Path) -> Result<(), OutputError> {
        let shape = [self.answers.len(), self.synthesizer.bank().vertex_count(), 3];
        write_atomic(path, |out| {
            write_npy_f32(out, &shape, |push| self.for_each_surface(|_, surface| push(surface.as_flattened())))
        })
    }

    /// Returns the file name of the OBJ or PLY file of a frame: `frame_000.obj`.
    pub fn mesh_name(frame: usize, as_ply: bool) -> String {
        format!("frame_{frame:03}.{}", if as_ply { "ply" } else { "obj" })
    }

    /// Writes one OBJ or PLY file for every frame into a folder; calls `wrote` with the name of each.
    ///
    /// # Errors
    /// [`OutputError`], and the errors of `wrote`.
    pub fn write_meshes(
        &self,
        folder: &Path,
        as_ply: bool,
        mut wrote: impl FnMut(&str) -> Result<(), OutputError>,
    ) -> Result<(), OutputError> {
        let mesh = self.synthesizer.bank().mesh();
        self.for_each_surface(|frame, surface| {
            let positions: Vec<[f32; 3]> = mesh.positions().iter().zip(&surface).map(|(&p, &d)| add(p, d)).collect();
            let write = if as_ply { write_ply } else { write_obj };
            let name = Self::mesh_name(frame, as_ply);
            write_atomic(&folder.join(&name), |out| write(out, &positions, mesh.triangles()))?;
            wrote(&name)
        })
    }

    /// Writes the weights as CSV: `frame,region` and one column for every member.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write_weights(&self, path: &Path) -> Result<(), OutputError> {
        let names = self.synthesizer.regions().scheme().names();
        write_atomic(path, |out| {
            let mut csv = crate::output::csv_writer(out);
            csv.write_record(["frame", "region"].into_iter().chain(self.synthesizer.bank().names().iter().map(String::as_str)))?;
            for (frame, answer) in self.answers.iter().enumerate() {
                for (region, weights) in names.iter().zip(&answer.weights) {
                    let start = [frame.to_string(), (*region).to_owned()];
                    csv.write_record(start.into_iter().chain(weights.iter().map(|&w| nine_digits(w))))?;
                }
            }
            csv.flush()
        })
    }

    /// Writes `frame,region,fitness,bound,share_of_bound,shown`: one row for every frame and region.
    ///
    /// With several regions, a row `joined` describes the joined surface, whose bound is unknown. Regions that do not move have
    /// empty cells.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write_fitness(&self, path: &Path) -> Result<(), OutputError> {
        let names = self.synthesizer.regions().scheme().names();
        let number = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();
        write_atomic(path, |out| {
            let mut csv = crate::output::csv_writer(out);
            csv.write_record(["frame", "region", "fitness", "bound", "share_of_bound", "shown"])?;
            for (frame, answer) in self.answers.iter().enumerate() {
                let frame = frame.to_string();
                for (region, name) in names.iter().enumerate() {
                    let (fitness, bound) = (answer.region_fitness[region], answer.region_bound[region]);
                    let share = fitness.zip(bound).and_then(|(f, b)| (b > 0.0).then(|| f / b));
                    let numbers = [fitness, bound, share, answer.region_shown[region]].map(number);
                    csv.write_record([&frame, *name].into_iter().chain(numbers.iter().map(String::as_str)))?;
                }
                if names.len() > 1 {
                    csv.write_record([&frame, "joined", &number(answer.fitness), "", "", &number(answer.shown)])?;
                }
            }
            csv.flush()
        })
    }

    /// Writes `frame,region,run,generation,offspring,best`: the progress of every run of the genetic algorithm [ZL, Fig. 6b].
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write_history(&self, path: &Path) -> Result<(), OutputError> {
        let names = self.synthesizer.regions().scheme().names();
        write_atomic(path, |out| {
            let mut csv = crate::output::csv_writer(out);
            csv.write_record(["frame", "region", "run", "generation", "offspring", "best"])?;
            for (frame, answer) in self.answers.iter().enumerate() {
                for (region, runs) in names.iter().zip(&answer.runs) {
                    for (run, history) in runs.iter().map(|r| &r.history).enumerate() {
                        for (generation, g) in history.iter().enumerate() {
                            let place = [frame, run, generation].map(|n| n.to_string());
                            let values = [g.offspring, g.best].map(nine_digits);
                            csv.write_record([&place[0], *region, &place[1], &place[2], &values[0], &values[1]])?;
                        }
                    }
                }
            }
            csv.flush()
        })
    }

    /// Returns the indices of up to `count` frames, evenly spaced from the first to the last.
    fn chosen_frames(&self, count: usize) -> Vec<usize> {
        let frames = self.answers.len();
        let count = count.min(frames);
        (0..count).map(|k| if count == 1 { frames - 1 } else { (k * (frames - 1) + (count - 1) / 2) / (count - 1) }).collect()
    }

    fn scene(&self) -> FaceScene<'_> {
        let scene = FaceScene::new(self.synthesizer.bank());
        match self.texture {
            Some(texture) => scene.with_texture(texture),
            None => scene,
        }
    }

    /// Index of the frame with the largest motion.
    pub fn apex(&self) -> usize {
        let length = |k: &usize| self.motions[*k].total_length();
        (0..self.motions.len()).max_by(|a, b| length(a).total_cmp(&length(b)).then(b.cmp(a))).unwrap_or(0)
    }

    /// Writes a sheet of eight frames, from the front and from the side, each with its fitness and the share of the motion that
    /// it shows.
    ///
    /// # Errors
    /// [`SynthesisError`] when the picture cannot be encoded or written.
    pub fn write_contact_sheet(&self, path: &Path) -> Result<(), SynthesisError> {
        let scene = self.scene();
        let frames = self.chosen_frames(SHEET_COLUMNS);
        let cells: Vec<(usize, f32)> = [0.0, SHEET_YAW].iter().flat_map(|&yaw| frames.iter().map(move |&f| (f, yaw))).collect();
        let pictures: Vec<Labelled> = cells
            .par_iter()
            .map(|&(frame, yaw)| {
                let fit = self.answers[frame].fitness.zip(self.answers[frame].shown);
                let fit = fit.map_or("rest".to_owned(), |(fitness, shown)| format!("{fitness:.3} {:.0} %", 100.0 * shown));
                Labelled {
                    picture: scene.draw(&self.surface(frame), View::front(SHEET_CELL.0, SHEET_CELL.1).turned(yaw)),
                    label: format!("frame {frame} {fit}"),
                }
            })
            .collect();
        write_png(path, &contact_sheet(&pictures, frames.len()))
    }

    /// Writes the frame with the largest motion, seen from seven directions, as a PNG file.
    ///
    /// # Errors
    /// [`SynthesisError`] when the picture cannot be encoded or written.
    pub fn write_turntable(&self, path: &Path) -> Result<(), SynthesisError> {
        let scene = self.scene();
        let apex = self.surface(self.apex());
        let pictures: Vec<Labelled> = (0..TURNTABLE_VIEWS)
            .into_par_iter()
            .map(|k| {
                let yaw = TURNTABLE_YAW * (2.0 * k as f32 / (TURNTABLE_VIEWS - 1) as f32 - 1.0);
                let picture = scene.draw(&apex, View::front(SHEET_CELL.0, SHEET_CELL.1).turned(yaw));
                Labelled { picture, label: format!("{yaw:+.0} degrees") }
            })
            .collect();
        write_png(path, &contact_sheet(&pictures, TURNTABLE_VIEWS))
    }

    /// Writes the animation on a turning head as an endless GIF file.
    ///
    /// # Errors
    /// [`SynthesisError`] when a picture cannot be encoded or written.
    pub fn write_turning(&self, path: &Path) -> Result<(), SynthesisError> {
        let scene = self.scene();
        let steps: Vec<RgbImage> = (0..GIF_FRAMES)
            .into_par_iter()
            .map(|step| {
                let share = step as f32 / GIF_FRAMES as f32;
                let yaw = GIF_YAW * (share * std::f32::consts::TAU).sin();
                // The animation plays forward and back twice during one turn.
                let play = 1.0 - (1.0 - (2.0 * share).fract() * 2.0).abs();
                let frame = (play * (self.answers.len() - 1) as f32).round() as usize;
                scene.draw(&self.surface(frame), View::front(GIF_SIZE.0, GIF_SIZE.1).turned(yaw))
            })
            .collect();
        Ok(write_bytes(path, &gif_bytes(&steps, GIF_CENTISECONDS)?)?)
    }
}

/// Number of frames on a contact sheet, size of a cell in px, and yaw of the second row in degrees.
const SHEET_COLUMNS: usize = 8;
const SHEET_CELL: (u32, u32) = (220, 260);
const SHEET_YAW: f32 = 38.0;
/// Number of views on the turntable and their largest yaw in degrees.
const TURNTABLE_VIEWS: usize = 7;
const TURNTABLE_YAW: f32 = 60.0;
/// Number of frames of the GIF animation, their duration in 1/100 s, its size in px and its largest yaw in degrees.
const GIF_FRAMES: usize = 48;
const GIF_CENTISECONDS: u32 = 6;
const GIF_SIZE: (u32, u32) = (280, 330);
const GIF_YAW: f32 = 35.0;

/// Writes a picture as PNG.
///
/// # Errors
/// [`SynthesisError`] when it cannot be encoded or written.
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), SynthesisError> {
    Ok(write_bytes(path, &png_bytes(picture)?)?)
}

/// Writes a picture of a bank: neutral from three sides, its feature points, and every member.
///
/// # Errors
/// [`SynthesisError`] when it cannot be encoded or written.
pub fn write_bank_picture(bank: &super::Bank, path: &Path) -> Result<(), SynthesisError> {
    let scene = FaceScene::new(bank);
    let still = vec![[0.0; 3]; bank.vertex_count()];
    let view = View::front(SHEET_CELL.0, SHEET_CELL.1);
    let neutral = |yaw: f32, label: &str| Labelled { picture: scene.draw(&still, view.turned(yaw)), label: label.to_owned() };
    let points = |yaw: f32, label: String| Labelled { picture: scene.draw_feature_points(view.turned(yaw)), label };
    let mut pictures = vec![
        neutral(0.0, "neutral"),
        neutral(SHEET_YAW, "neutral"),
        neutral(-SHEET_YAW, "neutral"),
        points(0.0, format!("{} feature points", bank.feature_points().len())),
        points(SHEET_YAW, "feature points".to_owned()),
        points(-SHEET_YAW, "feature points".to_owned()),
    ];
    let members = (0..bank.member_count()).into_par_iter();
    pictures.par_extend(
        members.map(|k| Labelled { picture: scene.draw(bank.displacements(k), view), label: bank.names()[k].clone() }),
    );
    write_png(path, &contact_sheet(&pictures, 6))
}

/// Reads displacements in the format of [`Animation::write_npy`] and returns the surface error of every frame against them.
///
/// # Errors
/// [`SynthesisError`] for an array that cannot be read, has another shape, or contains numbers that are not finite.
pub fn compare_with_truth(animation: &Animation<'_>, path: &Path) -> Result<Vec<Option<f64>>, SynthesisError> {
    let mut rows = crate::mesh::read_npy_rows(path).map_err(super::BankError::from)?;
    let expected = [animation.answers.len(), animation.synthesizer.bank().vertex_count(), 3];
    if rows.shape() != expected {
        let reason = format!("the array is of shape {:?}; frames x vertices x 3 = {expected:?} was expected", rows.shape());
        return Err(SynthesisError::Motion { path: path.to_owned(), reason });
    }
    let mut errors = Vec::with_capacity(expected[0]);
    animation.for_each_surface(|frame, surface| -> Result<(), SynthesisError> {
        let truth = rows.next_block().map_err(super::BankError::from)?;
        let truth = truth.as_chunks::<3>().0;
        if let Some(vertex) = truth.iter().position(|d| d.iter().any(|c| !c.is_finite())) {
            let [x, y, z] = truth[vertex];
            let reason =
                format!("frame {frame} has vertex {vertex} at ({x}, {y}, {z}) (both from 0); finite numbers were expected");
            return Err(SynthesisError::Motion { path: path.to_owned(), reason });
        }
        errors.push(super::surface_error(&surface, truth));
        Ok(())
    })?;
    Ok(errors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::{SynthesisOptions, testing};

    #[test]
    fn animations_whose_parts_do_not_fit_together_are_refused() {
        let bank = testing::bank();
        let synthesizer = Synthesizer::new(&bank, SynthesisOptions::default()).unwrap();
        let motion = vec![FpMotion::of_surface(&bank, bank.displacements(1)); 2];
        let answers = synthesizer.animate(&motion, || ());
        let why = |motion: &[FpMotion], answers: &[FrameAnswer], fps: f64| {
            Animation::new(&synthesizer, motion, answers, "up", fps).unwrap_err().to_string()
        };
        assert!(why(&motion, &answers[..1], 25.0).starts_with("up: 1 answers for 2 frames"));
        assert!(why(&[], &[], 25.0).starts_with("up: 0 answers for 0 frames"));
        for fps in [0.0, f64::NAN, f64::INFINITY] {
            assert!(why(&motion, &answers, fps).contains("frames per second; a finite number above 0"));
        }
        let empty = vec![FpMotion::default(); 2];
        assert_eq!(why(&empty, &answers, 25.0), "up: frame 0 has 0 feature points, but the bank has 3");
        let short: Vec<FrameAnswer> = answers.iter().map(|a| FrameAnswer { weights: vec![vec![1.0]], ..a.clone() }).collect();
        assert!(why(&motion, &short, 25.0).starts_with("up: the answer to frame 0 has not 1 x 3 weights"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("up.glb");
        assert!(write_gltf(&path, &[]).unwrap_err().to_string().ends_with("up.glb: there is no animation to write"));
        let fits = Animation::new(&synthesizer, &motion, &answers, "up", 25.0).unwrap();
        write_gltf(&path, &[fits, fits]).unwrap();
    }
}
