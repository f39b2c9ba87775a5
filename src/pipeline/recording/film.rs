//! Makes a film of a whole recording with the wireframe, the head's axes, the strongest action units, phase and activity.

use std::{collections::HashMap, path::Path};

use image::{Rgb, RgbImage};

use super::{Recording, RecordingError, RecordingFrame, RecordingStep, SegmentedRecording, Tick};
use crate::{
    features::{ACTION_UNITS, FULL},
    overlay::{draw_axes, draw_on_colour},
    pipeline::Workbench,
    render::write_label,
    segment::Phase,
    sequence::{ColourReader, write_video},
};

/// Height of the band below the picture, px.
const BAND: u32 = 112;
/// Number of action units shown.
const UNITS: usize = 6;
/// Length of the activity curve in seconds.
const COURSE: f64 = 6.0;
/// Width of the text at the left of the band, px.
const TEXT: u32 = 200;
const PAPER: Rgb<u8> = Rgb([250, 250, 248]);
const BAR: Rgb<u8> = Rgb([0, 114, 178]);
const EMPTY: Rgb<u8> = Rgb([226, 226, 222]);

/// Colours of the phases in the curve, from the palette of Okabe and Ito.
fn colour(phase: Phase) -> Rgb<u8> {
    Rgb(match phase {
        Phase::Rest => [0, 158, 115],
        Phase::Onset => [230, 159, 0],
        Phase::Apex => [213, 94, 0],
        Phase::Offset => [86, 180, 233],
        Phase::Other => [160, 160, 160],
    })
}

/// Writes a film of a segmented recording, MP4 or `WebM` by the extension of the path.
///
/// # Errors
/// [`RecordingError`] when the recording cannot be read, or no encoder for the format is available.
pub fn write_recording_film(
    path: &Path,
    (recording, found): (&Recording, &SegmentedRecording),
    bench: &Workbench,
    tick: Tick<'_>,
) -> Result<(), RecordingError> {
    let places: HashMap<u32, usize> = found.frames.iter().enumerate().map(|(k, f)| (f.measured.number, k)).collect();
    let frames = ColourReader::open(&recording.frames)?.map(|frame| {
        let (number, picture) = frame?;
        if !tick(RecordingStep::Drawing, 1, Some(found.frame_count)) {
            return Err(RecordingError::Interrupted);
        }
        Ok(film_frame(&picture, number, places.get(&number).copied(), found, bench))
    });
    write_video(path, frames, found.fps)
}

fn film_frame(picture: &RgbImage, number: u32, place: Option<usize>, found: &SegmentedRecording, bench: &Workbench) -> RgbImage {
    let seen = place.and_then(|k| found.frames.get(k));
    let mut drawn = match seen {
        Some(frame) => draw_on_colour(picture, &bench.wireframe, &frame.nodes.expanded(1.0).nodes),
        None => picture.clone(),
    };
    if let Some(pose) = seen.and_then(|frame| frame.pose.as_ref()) {
        let width = drawn.width();
        draw_axes(&mut drawn, width, pose);
    }
    let mut film = RgbImage::from_pixel(drawn.width(), drawn.height() + BAND, PAPER);
    image::imageops::replace(&mut film, &drawn, 0, 0);
    let top = drawn.height();
    let line = |film: &mut RgbImage, row: u32, text: &str| write_label(film, text, 6, top + 6 + 12 * row, TEXT);
    let seconds = found.seconds(number).unwrap_or_default();
    line(&mut film, 0, &format!("frame {number}  {seconds:.2} s"));
    let (Some(frame), Some(place)) = (seen, place) else {
        line(&mut film, 1, "no face");
        return film;
    };
    line(&mut film, 1, &format!("stretch {}  {}", frame.stretch, frame.phase.name()));
    match &frame.measured.reason {
        None => {
            let [yaw, pitch, roll] = frame.measured.pose;
            line(&mut film, 2, &format!("yaw   {yaw:+6.1}"));
            line(&mut film, 3, &format!("pitch {pitch:+6.1}"));
            line(&mut film, 4, &format!("roll  {roll:+6.1}"));
            line(&mut film, 5, &format!("eyes {:.2} {:.2}", frame.measured.eyes[0], frame.measured.eyes[1]));
            line(&mut film, 6, &format!("activity {:.1}", frame.activity));
            units(&mut film, top, frame);
        }
        Some(reason) => {
            // The reason, broken into lines of the text's width.
            let letters: Vec<char> = reason.chars().collect();
            for (k, part) in letters.chunks((TEXT / 8) as usize).take(6).enumerate() {
                line(&mut film, 2 + k as u32, &part.iter().collect::<String>());
            }
        }
    }
    course(&mut film, top, place, found);
    film
}

/// Fills the part of a rectangle that lies in the picture.
fn fill(film: &mut RgbImage, (x, y): (u32, u32), (width, height): (u32, u32), with: Rgb<u8>) {
    for py in y..(y + height).min(film.height()) {
        for px in x..(x + width).min(film.width()) {
            film.put_pixel(px, py, with);
        }
    }
}

/// Draws the strongest action units as bars.
fn units(film: &mut RgbImage, top: u32, frame: &RecordingFrame) {
    let mut order: Vec<usize> = (0..ACTION_UNITS.len()).collect();
    order.sort_by(|&a, &b| frame.measured.units[b].total_cmp(&frame.measured.units[a]).then(a.cmp(&b)));
    let left = TEXT + 10;
    let length = 60;
    for (row, &k) in order.iter().take(UNITS).enumerate() {
        let y = top + 6 + 16 * row as u32;
        let value = frame.measured.units[k];
        write_label(film, &format!("AU{:02} {value:.1}", ACTION_UNITS[k].number), left, y, 80);
        fill(film, (left + 80, y), (length, 8), EMPTY);
        let share = (f64::from(value) / FULL).clamp(0.0, 1.0);
        fill(film, (left + 80, y), ((f64::from(length) * share).round() as u32, 8), BAR);
    }
}

/// Draws the activity of the last seconds in the colours of the phases.
fn course(film: &mut RgbImage, top: u32, place: usize, found: &SegmentedRecording) {
    let left = TEXT + 10 + 80 + 60 + 16;
    let Some(width) = film.width().checked_sub(left + 8).filter(|w| *w > 20) else { return };
    let height = BAND - 16;
    fill(film, (left, top + 8), (width, height), EMPTY);
    let span = (COURSE * found.fps).max(1.0);
    for x in 0..width {
        let back = (f64::from(width - 1 - x) / f64::from(width) * span).round() as usize;
        let Some(frame) = place.checked_sub(back).and_then(|k| found.frames.get(k)) else { continue };
        let share = (frame.activity / (2.0 * FULL)).clamp(0.0, 1.0);
        let tall = ((f64::from(height) * share).round() as u32).max(2);
        fill(film, (left + x, top + 8 + height - tall), (1, tall), colour(frame.phase));
    }
}
