//! Options and errors of the simulation.

use std::path::PathBuf;

use serde::Serialize;

use super::{CameraOptions, Emotion, PortraitError};
use grimace::internal::{output::OutputError, wireframe::FapusError};

/// File format of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase", tag = "name")]
pub enum FrameFormat {
    /// Lossless.
    Png,
    /// JPEG of the given quality, 1 to 100.
    Jpg {
        /// 1 (small) to 100 (good).
        quality: u8,
    },
}

impl FrameFormat {
    /// File name extension.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpg { .. } => "jpg",
        }
    }
}

/// Layout of a dataset on disk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DatasetLayout {
    /// `manifest.csv`, a folder `SUBJECT/SEQUENCE` of frames, and correspondences next to the frames.
    #[default]
    Manifest,
    /// The three folders of Cohn-Kanade: images, emotion labels, and landmarks of every frame (true positions without error).
    CohnKanade,
}

impl DatasetLayout {
    // Serde passes a reference.
    #[allow(clippy::trivially_copy_pass_by_ref)]
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Frames in which a head has the requested yaw and pitch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TurnCourse {
    /// From one seeded angle within the limits to another.
    #[default]
    Free,
    /// Frontal in the neutral frame, at the limits (with seeded signs) at the apex.
    During,
    /// At the limits (with seeded signs) in every frame.
    Throughout,
}

impl TurnCourse {
    // Serde passes a reference.
    #[allow(clippy::trivially_copy_pass_by_ref)]
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Options of a simulation.
///
/// | option | default | range |
/// | --- | --- | --- |
/// | `subjects` | 4 | 1 to 999 |
/// | `emotions` | the six basic ones | at least one, each once |
/// | `frames` | 24 | 2 to 9999, neutral and apex included |
/// | `width`, `height` | 640 x 480 px | 64 to 4096 |
/// | `seed` | 1 | |
/// | `noise_sigma` | 1.5 grey levels | 0 to 64 |
/// | `roll_degrees` | 4 | 0 to 30 |
/// | `yaw_degrees` | 0 | 0 to 30 |
/// | `pitch_degrees` | 0 | 0 to 15 |
/// | `turn` | free | [`TurnCourse`] |
/// | `shift_px` | 6 | 0 to 200 |
/// | `scale_change` | 0.02 | 0 to 0.2 |
/// | `blink` | 0 | 0 to 1 |
/// | `marks_noise_px` | 0.5 | 0 to 50 |
/// | `fps` | 25 | above 0 |
/// | `camera` | perfect | [`CameraOptions`] |
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SimulateOptions {
    /// Number of subjects.
    pub subjects: u32,
    /// Emotions each subject performs.
    pub emotions: Vec<Emotion>,
    /// Frames per sequence N', the neutral and the apex frame included.
    pub frames: usize,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Standard deviation of the Gaussian pixel noise, grey levels of 0 to 255.
    pub noise_sigma: f64,
    /// Largest roll of the head, degrees; every sequence goes from one seeded angle within this limit to another.
    pub roll_degrees: f64,
    /// Largest yaw, degrees.
    pub yaw_degrees: f64,
    /// Largest pitch, degrees.
    pub pitch_degrees: f64,
    /// Frames in which the head has its yaw and pitch.
    #[serde(skip_serializing_if = "TurnCourse::is_default")]
    pub turn: TurnCourse,
    /// Largest shift of the head from the middle of the picture, pixels, in x and in y.
    pub shift_px: f64,
    /// Largest relative change of scale.
    pub scale_change: f64,
    /// Share of the sequences in which the eyes blink once, 0 to 1.
    #[serde(skip_serializing_if = "is_zero")]
    pub blink: f64,
    /// File format of the frames.
    pub format: FrameFormat,
    /// Layout of the dataset on disk.
    #[serde(skip_serializing_if = "DatasetLayout::is_default")]
    pub layout: DatasetLayout,
    /// Standard deviation of the error of a mark, pixels, in x and in y.
    pub marks_noise_px: f64,
    /// Frame rate in the manifest.
    pub fps: f64,
    /// Faults of camera and light.
    #[serde(skip_serializing_if = "CameraOptions::is_perfect")]
    pub camera: CameraOptions,
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self {
            subjects: 4,
            emotions: Emotion::BASIC.to_vec(),
            frames: 24,
            width: 640,
            height: 480,
            seed: 1,
            noise_sigma: 1.5,
            roll_degrees: 4.0,
            yaw_degrees: 0.0,
            pitch_degrees: 0.0,
            turn: TurnCourse::default(),
            shift_px: 6.0,
            scale_change: 0.02,
            blink: 0.0,
            format: FrameFormat::Png,
            layout: DatasetLayout::default(),
            marks_noise_px: 0.5,
            fps: 25.0,
            camera: CameraOptions::default(),
        }
    }
}

/// Whether an option is 0; such options are not written.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// Why a simulation failed.
#[derive(Debug, thiserror::Error)]
pub enum SimulateError {
    /// An option outside its range.
    #[error("--{option} is {value}; it must be {range}")]
    OutOfRange {
        /// Option as on the command line.
        option: &'static str,
        /// What was asked for.
        value: String,
        /// What is possible.
        range: &'static str,
    },
    /// The same emotion twice: both would be the same sequence.
    #[error("emotion {0} is listed twice; name each emotion once")]
    DuplicateEmotion(Emotion),
    /// The output folder is not empty.
    #[error("{} is not empty; choose a new folder, or give --force to write into it", path.display())]
    NotEmpty {
        /// The folder.
        path: PathBuf,
    },
    /// A file that would be read as part of the dataset, but was not written by a simulation or was changed since.
    #[error(
        "{} was not written by a simulation into this folder, or was changed since, and would be read as part of the dataset; move it \
         away and simulate again",
        path.display()
    )]
    NotSimulated {
        /// The file.
        path: PathBuf,
    },
    /// A label without a code in the Cohn-Kanade layout.
    #[error(
        "the layout of Cohn-Kanade has no code for the emotion `{emotion}`, only for neutral, anger, contempt, disgust, fear, happiness, \
         sadness and surprise; choose one of them as label, or give --layout manifest"
    )]
    NoCode {
        /// The label.
        emotion: String,
    },
    /// A file that could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A portrait that cannot be animated.
    #[error(transparent)]
    Portrait(#[from] PortraitError),
    /// A face whose FAPUs cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
}

impl SimulateOptions {
    /// Checks every range.
    ///
    /// # Errors
    /// [`SimulateError::OutOfRange`] and [`SimulateError::DuplicateEmotion`].
    pub fn check(&self) -> Result<(), SimulateError> {
        let bad =
            |option, value: &dyn ToString, range| Err(SimulateError::OutOfRange { option, value: value.to_string(), range });
        if !(1..=999).contains(&self.subjects) {
            return bad("subjects", &self.subjects, "1 to 999");
        }
        if self.emotions.is_empty() {
            return bad("emotions", &"empty", "at least one emotion");
        }
        if let Some((_, &twice)) = self.emotions.iter().enumerate().find(|(k, e)| self.emotions[..*k].contains(e)) {
            return Err(SimulateError::DuplicateEmotion(twice));
        }
        if !(2..=9999).contains(&self.frames) {
            return bad("frames", &self.frames, "2 to 9999: the neutral frame and the apex at least");
        }
        if ![self.width, self.height].iter().all(|side| (64..=4096).contains(side)) {
            return bad("size", &format!("{}x{}", self.width, self.height), "64 to 4096 pixels in each direction");
        }
        if let FrameFormat::Jpg { quality } = self.format
            && !(1..=100).contains(&quality)
        {
            return bad("quality", &quality, "1 to 100");
        }
        let numbers = [
            ("noise", self.noise_sigma, 64.0, "0 to 64 grey levels"),
            ("roll", self.roll_degrees, 30.0, "0 to 30 degrees"),
            ("yaw", self.yaw_degrees, 30.0, "0 to 30 degrees"),
            ("pitch", self.pitch_degrees, 15.0, "0 to 15 degrees"),
            ("shift", self.shift_px, 200.0, "0 to 200 pixels"),
            ("scale-change", self.scale_change, 0.2, "0 to 0.2"),
            ("blink", self.blink, 1.0, "0 to 1"),
            ("marks-noise", self.marks_noise_px, 50.0, "0 to 50 pixels"),
        ];
        for (option, value, limit, range) in numbers {
            if !(0.0..=limit).contains(&value) {
                return bad(option, &value, range);
            }
        }
        self.camera.check()?;
        if !(self.fps > 0.0 && self.fps <= 1000.0) {
            return bad("fps", &self.fps, "above 0, at most 1000");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_checked_and_named() {
        let ok = SimulateOptions::default();
        let perfect = CameraOptions::default();
        let camera = |camera| SimulateOptions { camera, ..SimulateOptions::default() };
        assert!(ok.check().is_ok());
        let cases = [
            (SimulateOptions { subjects: 0, ..ok.clone() }, "--subjects is 0"),
            (SimulateOptions { subjects: 1000, ..ok.clone() }, "--subjects is 1000"),
            (SimulateOptions { emotions: vec![], ..ok.clone() }, "--emotions is empty"),
            (SimulateOptions { emotions: vec![Emotion::Fear, Emotion::Fear], ..ok.clone() }, "fear is listed twice"),
            (SimulateOptions { frames: 1, ..ok.clone() }, "--frames is 1"),
            (SimulateOptions { width: 63, ..ok.clone() }, "--size is 63x480"),
            (SimulateOptions { format: FrameFormat::Jpg { quality: 0 }, ..ok.clone() }, "--quality is 0"),
            (SimulateOptions { noise_sigma: f64::NAN, ..ok.clone() }, "--noise is NaN"),
            (SimulateOptions { roll_degrees: -1.0, ..ok.clone() }, "--roll is -1"),
            (SimulateOptions { fps: 0.0, ..ok.clone() }, "--fps is 0"),
            (camera(CameraOptions { shutter: 1.5, ..perfect }), "--shutter is 1.5"),
            (camera(CameraOptions { defocus_px: f64::NAN, ..perfect }), "--defocus is NaN"),
            (camera(CameraOptions { light_gradient: 1.0, ..perfect }), "--light-gradient is 1"),
            (camera(CameraOptions { compression: Some(0), ..perfect }), "--compression is 0"),
        ];
        for (options, expected) in cases {
            let message = options.check().unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
