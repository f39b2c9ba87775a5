//! Pictures without a face: backgrounds, and negative examples.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::augment::{normal, uniform};

/// Grey values, row by row, 0 to 255 or slightly beyond.
#[derive(Clone, Debug)]
pub struct Canvas {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Grey values.
    pub values: Vec<f32>,
}

impl Canvas {
    /// Creates a canvas of one grey value.
    pub fn new(width: usize, height: usize, grey: f32) -> Self {
        Self { width, height, values: vec![grey; width * height] }
    }

    /// Returns the canvas as an 8-bit picture.
    pub fn image(&self) -> image::GrayImage {
        let pixel = |x: u32, y: u32| self.values[y as usize * self.width + x as usize].clamp(0.0, 255.0).round() as u8;
        image::GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| image::Luma([pixel(x, y)]))
    }

    fn each(&mut self, mut change: impl FnMut(f32, f32, &mut f32)) {
        for (k, value) in self.values.iter_mut().enumerate() {
            change((k % self.width) as f32, (k / self.width) as f32, value);
        }
    }
}

/// Adds smooth noise: random numbers on a coarse grid, interpolated.
fn add_clouds(random: &mut ChaCha8Rng, canvas: &mut Canvas, across: usize, strength: f32) {
    let knots: Vec<f32> = (0..(across + 1) * (across + 1)).map(|_| normal(random, 0.0, strength)).collect();
    let (sx, sy) = (across as f32 / canvas.width as f32, across as f32 / canvas.height as f32);
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    canvas.each(|x, y, value| {
        let (u, v) = (x * sx, y * sy);
        let (i, j) = ((u as usize).min(across - 1), (v as usize).min(across - 1));
        let (fu, fv) = (smooth(u - i as f32), smooth(v - j as f32));
        let at = |i: usize, j: usize| knots[j * (across + 1) + i];
        *value +=
            (at(i, j) * (1.0 - fu) + at(i + 1, j) * fu) * (1.0 - fv) + (at(i, j + 1) * (1.0 - fu) + at(i + 1, j + 1) * fu) * fv;
    });
}

/// Adds a rotated ellipse or box of one grey value.
fn add_shape(random: &mut ChaCha8Rng, canvas: &mut Canvas) {
    let side = canvas.width.min(canvas.height) as f32;
    let (cx, cy) = (uniform(random, 0.0, canvas.width as f32), uniform(random, 0.0, canvas.height as f32));
    let (rx, ry) = (uniform(random, 0.02, 0.4) * side, uniform(random, 0.02, 0.4) * side);
    let (angle, grey, round) = (uniform(random, 0.0, 3.2), uniform(random, 0.0, 255.0), random.random_range(0..2) == 0);
    let hollow = random.random_range(0..4) == 0;
    canvas.each(|x, y, value| {
        let (dx, dy) = (x - cx, y - cy);
        let (u, v) = ((dx * angle.cos() + dy * angle.sin()) / rx, (dy * angle.cos() - dx * angle.sin()) / ry);
        let reach = if round { u.hypot(v) } else { u.abs().max(v.abs()) };
        if reach < 1.0 && !(hollow && reach < 0.85) {
            *value = grey;
        }
    });
}

fn add_stripes(random: &mut ChaCha8Rng, canvas: &mut Canvas) {
    let (angle, period) = (uniform(random, 0.0, 3.2), uniform(random, 4.0, 60.0));
    let (strength, phase, hard) = (uniform(random, 10.0, 100.0), uniform(random, 0.0, 6.3), random.random_range(0..2) == 0);
    canvas.each(|x, y, value| {
        let wave = ((x * angle.cos() + y * angle.sin()) / period * std::f32::consts::TAU + phase).sin();
        *value += strength * if hard { wave.signum() } else { wave };
    });
}

/// Adds letter-like marks: short strokes in lines.
fn add_strokes(random: &mut ChaCha8Rng, canvas: &mut Canvas) {
    let (height, grey) = (uniform(random, 6.0, 30.0), uniform(random, 0.0, 255.0));
    let lines = (canvas.height as f32 / (height * 1.7)) as usize;
    for line in 0..lines {
        let mut x = uniform(random, 0.0, height);
        while x < canvas.width as f32 {
            let (w, h) = (uniform(random, 0.1, 0.8) * height, uniform(random, 0.2, 1.0) * height);
            let (top, left) = (line as f32 * height * 1.7 + uniform(random, 0.0, height - h), x);
            canvas.each(|px, py, value| {
                if px >= left && px < left + w && py >= top && py < top + h.max(2.0) {
                    *value = grey;
                }
            });
            x += w + uniform(random, 0.1, 0.5) * height;
        }
    }
}

/// Returns a random background.
pub fn background(random: &mut ChaCha8Rng, width: usize, height: usize) -> Canvas {
    let grey = uniform(random, 0.0, 255.0);
    let mut canvas = Canvas::new(width, height, grey);
    match random.random_range(0..6) {
        0 => {}
        1 => add_clouds(random, &mut canvas, 1, 90.0),
        2 => (0..random.random_range(2..14)).for_each(|_| add_shape(random, &mut canvas)),
        3 => add_stripes(random, &mut canvas),
        _ => {
            for across in [3, 6, 12, 25] {
                let strength = uniform(random, 0.0, 45.0);
                add_clouds(random, &mut canvas, across, strength);
            }
        }
    }
    canvas
}

/// Returns a picture without a face: overlapping clouds, shapes, stripes and letters.
pub fn faceless(random: &mut ChaCha8Rng, width: usize, height: usize) -> Canvas {
    let mut canvas = background(random, width, height);
    for _ in 0..random.random_range(1..5) {
        match random.random_range(0..5) {
            0 => (0..random.random_range(1..30)).for_each(|_| add_shape(random, &mut canvas)),
            1 => add_stripes(random, &mut canvas),
            2 if random.random_range(0..3) == 0 => add_strokes(random, &mut canvas),
            _ => {
                for across in [4, 9, 20, 45, 90] {
                    let strength = uniform(random, 0.0, 40.0);
                    add_clouds(random, &mut canvas, across, strength);
                }
            }
        }
    }
    let noise = uniform(random, 0.0, 20.0);
    canvas.values.iter_mut().for_each(|v| *v += normal(random, 0.0, noise));
    canvas
}
