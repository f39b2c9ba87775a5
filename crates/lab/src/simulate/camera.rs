//! The camera between scene and file: shutter, lens, light, sensor and compression. None of them moves a node.
//!
//! The order is the physical one: sub-frames are averaged while the shutter is open (motion blur along the true motion), the lens blurs,
//! the light scales the brightness and adds a gradient, the sensor adds noise and rounds, and JPEG compresses.

use std::io;

use image::{ImageEncoder, ImageFormat, RgbImage, codecs::jpeg::JpegEncoder};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;

use super::{
    SimulateError, SimulateOptions,
    random::{Purpose, generator},
};

/// Motion during the exposure for each sub-frame, px.
const SUBFRAME_PX: f64 = 0.5;
/// Largest number of sub-frames in a frame.
const MAX_SUBFRAMES: usize = 16;
/// Wavelength of the light gradient relative to the width of the picture; a face covers about a third of it.
const GRADIENT_WAVE: f64 = 1.5;
/// Largest motion of the light gradient over a sequence, as a share of its wavelength.
const GRADIENT_WAY: f64 = 0.25;
/// Radius of the defocus kernel, in standard deviations.
const KERNEL_SD: f64 = 3.0;

/// Faults of a camera and its light, all 0 (and no compression) by default. They change pictures, but not positions.
///
/// | option | range | hard simulation |
/// | --- | --- | --- |
/// | `shutter` | 0 to 1 | 0.5: the 180 degree shutter of film |
/// | `defocus_px` | 0 to 10 | 0.8 |
/// | `gain_change` | 0 to 0.9 | 0.15 |
/// | `bias_change` | 0 to 100 | 8 |
/// | `light_gradient` | 0 to 0.9 | 0.15 |
/// | `compression` | 1 to 100 | 75 |
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CameraOptions {
    /// Share of the time between two frames for which the shutter is open, centred on the time of the frame.
    pub shutter: f64,
    /// Standard deviation of the Gaussian blur of the lens, pixels.
    pub defocus_px: f64,
    /// Largest relative change of brightness: a sequence goes from one seeded gain within 1 ± this value to another.
    pub gain_change: f64,
    /// Largest change of the black level, in grey levels of 0 to 255: a sequence goes from one seeded level to another.
    pub bias_change: f64,
    /// Strength of a smooth gradient of light that moves over the picture: brightness is multiplied by up to 1 ± this value.
    pub light_gradient: f64,
    /// Quality, 1 to 100, of a JPEG compression applied to every picture, independent of the file format; `None` for no compression.
    pub compression: Option<u8>,
}

impl CameraOptions {
    /// Whether the camera has no faults.
    pub fn is_perfect(&self) -> bool {
        *self == Self::default()
    }

    /// Checks every range.
    pub(super) fn check(&self) -> Result<(), SimulateError> {
        let numbers = [
            ("shutter", self.shutter, 1.0, "0 to 1 of the time between two frames"),
            ("defocus", self.defocus_px, 10.0, "0 to 10 pixels"),
            ("gain-change", self.gain_change, 0.9, "0 to 0.9"),
            ("bias-change", self.bias_change, 100.0, "0 to 100 grey levels"),
            ("light-gradient", self.light_gradient, 0.9, "0 to 0.9"),
        ];
        for (option, value, limit, range) in numbers {
            if !(0.0..=limit).contains(&value) {
                return Err(SimulateError::OutOfRange { option, value: value.to_string(), range });
            }
        }
        match self.compression {
            Some(quality) if !(1..=100).contains(&quality) => {
                Err(SimulateError::OutOfRange { option: "compression", value: quality.to_string(), range: "1 to 100" })
            }
            _ => Ok(()),
        }
    }

    /// Returns the times, in frames, of the sub-frames of a frame. `extent_px` is the motion of the fastest node while the shutter is open.
    pub(super) fn exposure_times(&self, frame: usize, extent_px: f64) -> Vec<f64> {
        let count = if self.shutter > 0.0 { (extent_px / SUBFRAME_PX).ceil() as usize } else { 1 };
        let count = count.clamp(1, MAX_SUBFRAMES);
        let place = |k: usize| (k as f64 + 0.5) / count as f64 - 0.5;
        (0..count).map(|k| frame as f64 + self.shutter * place(k)).collect()
    }
}

/// A picture before the sensor: RGB in grey levels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Exposure {
    pub width: usize,
    pub height: usize,
    /// Three values per pixel.
    pub data: Vec<f32>,
}

/// The light of one sequence: gain, bias and phase of the gradient in the first and the last frame.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Light {
    ends: [[f64; 3]; 2],
    /// Direction of the gradient, radians.
    direction: f64,
    strength: f64,
}

/// Gain, bias and phase of the gradient in one frame.
type Moment = [f64; 3];

impl Light {
    fn new(options: &SimulateOptions, subject: u32, emotion_code: u8) -> Self {
        let camera = &options.camera;
        let mut random = generator(options.seed, Purpose::Light, subject, emotion_code, 0);
        let mut within = |limit: f64| limit * random.random_range(-1.0..=1.0);
        let direction = within(std::f64::consts::PI);
        let start = within(0.5);
        let mut end = |phase: f64| [1.0 + within(camera.gain_change), within(camera.bias_change), phase];
        let first = end(start);
        let last = end(start);
        let way = within(GRADIENT_WAY);
        Self { ends: [first, [last[0], last[1], start + way]], direction, strength: camera.light_gradient }
    }

    /// Returns the light at a share of the sequence, 0 to 1.
    fn at(&self, time: f64) -> Moment {
        std::array::from_fn(|k| self.ends[0][k] + (self.ends[1][k] - self.ends[0][k]) * time)
    }

    fn fall(&self, [gain, bias, phase]: Moment, exposure: &mut Exposure) {
        let (sine, cosine) = self.direction.sin_cos();
        let wave = GRADIENT_WAVE * exposure.width as f64;
        let width = exposure.width;
        for (k, pixel) in exposure.data.chunks_exact_mut(3).enumerate() {
            let (x, y) = ((k % width) as f64, (k / width) as f64);
            let angle = std::f64::consts::TAU * ((x * cosine + y * sine) / wave + phase);
            let factor = (gain * (1.0 + self.strength * angle.sin())) as f32;
            pixel.iter_mut().for_each(|value| *value = *value * factor + bias as f32);
        }
    }
}

/// Returns the picture that the camera makes of an exposure. `frame` is the number of the frame, from 0, in a subject's sequence.
pub fn develop(mut exposure: Exposure, options: &SimulateOptions, subject: u32, emotion_code: u8, frame: usize) -> RgbImage {
    let camera = &options.camera;
    if camera.defocus_px > 0.0 {
        defocus(&mut exposure, camera.defocus_px);
    }
    if camera.gain_change > 0.0 || camera.bias_change > 0.0 || camera.light_gradient > 0.0 {
        let light = Light::new(options, subject, emotion_code);
        light.fall(light.at(frame as f64 / (options.frames - 1) as f64), &mut exposure);
    }
    let mut random = generator(options.seed, Purpose::Noise, subject, emotion_code, frame as u32);
    let mut pixels = Vec::with_capacity(exposure.data.len());
    for pixel in exposure.data.chunks_exact(3) {
        let noise = if options.noise_sigma > 0.0 {
            let z: f32 = StandardNormal.sample(&mut random);
            z * options.noise_sigma as f32
        } else {
            0.0
        };
        pixels.extend(pixel.iter().map(|value| ((value + noise).clamp(0.0, 255.0) + 0.5) as u8));
    }
    // The buffer has exactly width x height x 3 bytes.
    let image = RgbImage::from_raw(exposure.width as u32, exposure.height as u32, pixels).unwrap_or_default();
    match camera.compression {
        None => image,
        // Compression cannot fail for a picture of checked size and quality.
        Some(quality) => compress(&image, quality).unwrap_or(image),
    }
}

/// Applies a Gaussian blur in place; pixels outside repeat the border.
fn defocus(exposure: &mut Exposure, sigma: f64) {
    let radius = (KERNEL_SD * sigma).ceil().max(1.0) as usize;
    let weights: Vec<f64> = (0..=2 * radius).map(|k| (-0.5 * ((k as f64 - radius as f64) / sigma).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let kernel: Vec<f32> = weights.iter().map(|w| (w / total) as f32).collect();
    let (width, height) = (exposure.width, exposure.height);
    let at = |place: usize, k: usize, size: usize| (place + k).saturating_sub(radius).min(size - 1);
    let mut across = vec![0.0_f32; exposure.data.len()];
    for y in 0..height {
        let row = &exposure.data[y * width * 3..(y + 1) * width * 3];
        for x in 0..width {
            for c in 0..3 {
                let sum = kernel.iter().enumerate().map(|(k, w)| w * row[at(x, k, width) * 3 + c]).sum();
                across[(y * width + x) * 3 + c] = sum;
            }
        }
    }
    let stride = width * 3;
    exposure.data.fill(0.0);
    for y in 0..height {
        let row = &mut exposure.data[y * stride..(y + 1) * stride];
        for (k, w) in kernel.iter().enumerate() {
            let source = at(y, k, height) * stride;
            row.iter_mut().zip(&across[source..source + stride]).for_each(|(sum, value)| *sum += w * value);
        }
    }
}

fn compress(image: &RgbImage, quality: u8) -> image::ImageResult<RgbImage> {
    let mut bytes = io::Cursor::new(Vec::new());
    let (width, height) = image.dimensions();
    JpegEncoder::new_with_quality(&mut bytes, quality).write_image(image, width, height, image::ExtendedColorType::Rgb8)?;
    Ok(image::load_from_memory_with_format(bytes.get_ref(), ImageFormat::Jpeg)?.into_rgb8())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(camera: CameraOptions) -> SimulateOptions {
        SimulateOptions { noise_sigma: 0.0, camera, ..SimulateOptions::default() }
    }

    fn grey(value: f32) -> Exposure {
        Exposure { width: 16, height: 12, data: vec![value; 16 * 12 * 3] }
    }

    #[test]
    fn sub_frames_are_spread_evenly_about_the_frame() {
        let camera = CameraOptions { shutter: 0.5, ..CameraOptions::default() };
        // 1 px in steps of 0.5 px gives two sub-frames, each a quarter of the opening from the centre: 0.5 / 4 = 0.125 frames.
        assert_eq!(camera.exposure_times(3, 1.0), [2.875, 3.125]);
        assert_eq!(camera.exposure_times(3, 0.2), [3.0]);
        assert_eq!(camera.exposure_times(3, 1e9).len(), MAX_SUBFRAMES);
        assert_eq!(CameraOptions::default().exposure_times(3, 100.0), [3.0]);
    }

    #[test]
    fn defocus_keeps_the_light_and_spreads_it() {
        let mut exposure = grey(0.0);
        let centre = (6 * 16 + 8) * 3;
        exposure.data[centre] = 100.0;
        defocus(&mut exposure, 1.0);
        let red: f32 = exposure.data.iter().step_by(3).sum();
        assert!((red - 100.0).abs() < 1e-3, "{red}");
        // With standard deviation 1 the peak of the two-dimensional Gaussian is 1 / tau, within 1 % for a sampled and normalized kernel.
        assert!((exposure.data[centre] / 100.0 - 1.0 / std::f32::consts::TAU).abs() < 0.002);
        assert!((exposure.data[centre - 3] - exposure.data[centre + 3]).abs() < 1e-4);
        let mut even = grey(90.0);
        defocus(&mut even, 2.0);
        assert!(even.data.iter().all(|v| (v - 90.0).abs() < 1e-3));
    }

    #[test]
    fn light_stays_within_what_was_asked_for_and_changes() {
        let camera = CameraOptions { gain_change: 0.2, bias_change: 5.0, light_gradient: 0.1, ..CameraOptions::default() };
        let means: Vec<f64> = [0, 23]
            .map(|frame| {
                let image = develop(grey(100.0), &options(camera), 1, 1, frame);
                // At most 100 * 1.2 * 1.1 + 5 = 137, at least 100 * 0.8 * 0.9 - 5 = 67, after rounding.
                assert!(image.iter().all(|&v| (67..=137).contains(&v)));
                image.iter().map(|&v| f64::from(v)).sum::<f64>() / image.len() as f64
            })
            .to_vec();
        assert!((means[0] - means[1]).abs() > 1.0, "{means:?}");
    }

    #[test]
    fn a_perfect_camera_changes_nothing_and_compression_little() {
        let plain = develop(grey(100.0), &options(CameraOptions::default()), 0, 1, 0);
        assert!(plain.iter().all(|&v| v == 100));
        let jpeg = CameraOptions { compression: Some(75), ..CameraOptions::default() };
        let image = develop(grey(100.0), &options(jpeg), 0, 1, 0);
        assert!(image.iter().all(|&v| v.abs_diff(100) <= 2));
    }
}
