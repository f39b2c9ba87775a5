//! Renders many training pictures from one photograph: other sizes, rotations, lights, backgrounds, clothes, hair, glasses, cameras.

use image::{GrayImage, ImageEncoder, codecs::jpeg::JpegEncoder};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{
    covers::cover,
    faces::{TrainingFace, within},
    scenery::{Canvas, background},
};
use crate::modules::locate::{
    PUPILS,
    picture::Picture,
    points,
    shape::{Placement, Point, Shape},
};

/// A rendered picture with the positions of its points.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Index of the face.
    pub face: usize,
    /// Grey pixels.
    pub image: GrayImage,
    /// The points, px.
    pub truth: Shape,
    /// Covered share of each point, 0 to 1; empty if nothing is covered.
    pub covered: Vec<f32>,
}

/// Returns a uniform random number between two bounds.
pub fn uniform(random: &mut ChaCha8Rng, low: f32, high: f32) -> f32 {
    low + (high - low) * random.random::<f32>()
}

/// Returns a normal random number with a mean and a standard deviation.
pub fn normal(random: &mut ChaCha8Rng, mean: f32, deviation: f32) -> f32 {
    let value: f32 = StandardNormal.sample(random);
    mean + deviation * value
}

fn chance(random: &mut ChaCha8Rng, share: f32) -> bool {
    random.random::<f32>() < share
}

/// Returns the random number stream of one picture.
pub fn stream(seed: u64, purpose: u64, unit: u64) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(purpose << 48 | unit);
    random
}

/// A photograph prepared for sampling.
#[derive(Debug)]
pub struct Source {
    grey: Picture,
    background: Picture,
    inside: Picture,
    shape: Shape,
}

impl Source {
    /// Returns `None` for a photograph without pixels.
    pub fn new(face: &TrainingFace) -> Option<Self> {
        let masks = face.masks();
        Some(Self {
            grey: Picture::new(&face.grey)?,
            background: Picture::new(&masks.background)?,
            inside: Picture::new(&masks.inside)?,
            shape: face.shape.clone(),
        })
    }
}

/// Returns the approximate depth of a face towards the camera at a position relative to the middle of the face; eye distances.
fn depth(u: f32, v: f32) -> f32 {
    (-(u * u + v * v / 2.6)).exp() + 0.3 * (-(u * u / 0.04 + (v - 0.05) * (v - 0.05) / 0.0625)).exp()
}

/// Pose and shape change of one picture, about the middle of the face.
struct Pose {
    yaw: f32,
    pitch: f32,
    roll: f32,
    aspect: f32,
}

impl Pose {
    fn draw(random: &mut ChaCha8Rng) -> Self {
        let turned = chance(random, 0.5);
        let yaw = if turned { normal(random, 0.0, 6.0).clamp(-15.0, 15.0) } else { 0.0 };
        let pitch = if turned { normal(random, 0.0, 4.0).clamp(-10.0, 10.0) } else { 0.0 };
        let roll = normal(random, 0.0, 6.0).clamp(-18.0, 18.0);
        Self {
            yaw: yaw.to_radians(),
            pitch: pitch.to_radians(),
            roll: roll.to_radians(),
            aspect: normal(random, 0.0, 0.025).exp(),
        }
    }

    fn forward(&self, [u, v]: Point) -> Point {
        let z = depth(u, v);
        let (x, y) = ((u * self.yaw.cos() + z * self.yaw.sin()) * self.aspect, v * self.pitch.cos() + z * self.pitch.sin());
        [x * self.roll.cos() - y * self.roll.sin(), x * self.roll.sin() + y * self.roll.cos()]
    }

    fn back(&self, [a, b]: Point) -> Point {
        let x = (a * self.roll.cos() + b * self.roll.sin()) / self.aspect;
        let y = b * self.roll.cos() - a * self.roll.sin();
        let (mut u, mut v) = (x, y);
        for _ in 0..6 {
            let z = depth(u, v);
            (u, v) = ((x - z * self.yaw.sin()) / self.yaw.cos(), (y - z * self.pitch.sin()) / self.pitch.cos());
        }
        [u, v]
    }
}

/// Spacing of the grid on which the change of pose is computed, px.
const GRID: usize = 6;

/// Renders a picture; part of the face is covered if a random stream for covers is given.
pub fn render(
    source: &Source,
    (face, mirrored): (usize, bool),
    random: &mut ChaCha8Rng,
    cover_random: Option<&mut ChaCha8Rng>,
) -> Sample {
    let shape = source.grey.view(mirrored).turn_shape(&source.shape);
    let (right, left) = (shape[PUPILS[1]], shape[PUPILS[0]]);
    let unit = (left[0] - right[0]).hypot(left[1] - right[1]);
    let middle = [0.5 * (left[0] + right[0]), 0.5 * (left[1] + right[1]) + 0.6 * unit];
    let eyes = uniform(random, 32.0_f32.ln(), 115.0_f32.ln()).exp();
    let pose = Pose::draw(random);
    let (width, height) = ((eyes * uniform(random, 3.0, 4.4)) as usize, (eyes * uniform(random, 3.8, 5.0)) as usize);
    let centre =
        [width as f32 * 0.5 + uniform(random, -0.3, 0.3) * eyes, height as f32 * 0.5 + uniform(random, -0.15, 0.35) * eyes];
    let relative: Shape = shape.iter().map(|p| [(p[0] - middle[0]) / unit, (p[1] - middle[1]) / unit]).collect();
    let place = |p: Point| {
        let q = pose.forward(p);
        [q[0] * eyes + centre[0], q[1] * eyes + centre[1]]
    };
    let truth: Shape = relative.iter().map(|&p| place(p)).collect();
    // Source position of each pixel, relative to the middle of the face.
    let (columns, rows) = (width / GRID + 2, height / GRID + 2);
    let knots: Vec<Point> = (0..columns * rows)
        .map(|k| {
            let (x, y) = ((k % columns * GRID) as f32, (k / columns * GRID) as f32);
            pose.back([(x - centre[0]) / eyes, (y - centre[1]) / eyes])
        })
        .collect();
    let from = |x: usize, y: usize| -> Point {
        let (i, j) = (x / GRID, y / GRID);
        let (fx, fy) = ((x % GRID) as f32 / GRID as f32, (y % GRID) as f32 / GRID as f32);
        let at = |i: usize, j: usize| knots[j * columns + i];
        std::array::from_fn(|d| {
            (at(i, j)[d] * (1.0 - fx) + at(i + 1, j)[d] * fx) * (1.0 - fy)
                + (at(i, j + 1)[d] * (1.0 - fx) + at(i + 1, j + 1)[d] * fx) * fy
        })
    };
    let map: Vec<Point> = (0..width * height).map(|k| from(k % width, k / width)).collect();
    let read = |picture: &Picture| -> Vec<f32> {
        let view = picture.view(mirrored);
        let scale = unit / eyes;
        map.iter().map(|p| view.sample([p[0] * unit + middle[0], p[1] * unit + middle[1]], scale)).collect()
    };
    let mut canvas = Canvas { width, height, values: read(&source.grey) };
    let inside = read(&source.inside);
    if chance(random, 0.75) {
        let behind = background(random, width, height);
        let mask = read(&source.background);
        for ((value, other), share) in canvas.values.iter_mut().zip(&behind.values).zip(&mask) {
            *value += (other - *value) * share / 255.0;
        }
    }
    dress(random, &mut canvas, &map, &inside, &relative);
    let levels = [
        named(&relative, "left brow: highest point"),
        named(&relative, "left mouth corner"),
        named(&relative, "lowest point of the chin"),
    ];
    let covered = cover_random
        .map(|chance| cover(chance, &mut canvas, (&map, &inside), &relative, levels.map(|p| p[1])))
        .unwrap_or_default();
    light(random, &mut canvas, |x, y| [(x - centre[0]) / eyes, (y - centre[1]) / eyes]);
    Sample { face, image: camera(random, &canvas), truth, covered }
}

/// Returns a point by its description; the middle of the face if there is none.
fn named(relative: &[Point], description: &str) -> Point {
    points().iter().position(|p| p.description == description).and_then(|k| relative.get(k)).copied().unwrap_or_default()
}

/// Adds clothes, shade on the neck, hair, and glasses.
fn dress(random: &mut ChaCha8Rng, canvas: &mut Canvas, map: &[Point], inside: &[f32], relative: &[Point]) {
    let chin = named(relative, "lowest point of the chin");
    let brow = named(relative, "left brow: highest point")[1].min(named(relative, "right brow: highest point")[1]);
    let mouth = named(relative, "left mouth corner")[1];
    if chance(random, 0.5) {
        let shade = normal(random, 0.0, 0.35).exp();
        let depth = uniform(random, 0.05, 0.5);
        for ((value, p), inner) in canvas.values.iter_mut().zip(map).zip(inside) {
            let below = ((p[1] - mouth) / depth).clamp(0.0, 1.0);
            *value *= 1.0 + (shade - 1.0) * below * (1.0 - inner / 255.0);
        }
    }
    if chance(random, 0.65) {
        let (gap, slope, bend) = (uniform(random, 0.04, 0.9), uniform(random, -0.2, 0.9), uniform(random, -0.3, 0.3));
        let (grey, edge) = (uniform(random, 0.0, 255.0), normal(random, 0.0, 40.0));
        let cloth = if chance(random, 0.5) { Some(background(random, canvas.width, canvas.height)) } else { None };
        for (k, ((value, p), inner)) in canvas.values.iter_mut().zip(map).zip(inside).enumerate() {
            let x = (p[0] - chin[0]).abs();
            let line = chin[1] + gap - slope * x + bend * x * x;
            let share = ((p[1] - line) / 0.03).clamp(0.0, 1.0) * (1.0 - inner / 255.0);
            let hem = if p[1] - line < 0.08 { edge } else { 0.0 };
            let own = cloth.as_ref().map_or(grey, |c| 0.6 * grey + 0.4 * c.values[k]) + hem;
            *value += (own - *value) * share;
        }
    }
    let hair = uniform(random, 0.0, 200.0);
    let streak = |p: Point, phase: f32| 18.0 * (p[0] * 37.0 + 3.0 * (p[1] * 9.0 + phase).sin()).sin();
    if chance(random, 0.3) {
        let (height, slope, wave) = (brow - uniform(random, 0.08, 0.7), normal(random, 0.0, 0.25), uniform(random, 0.0, 0.06));
        let phase = uniform(random, 0.0, 6.3);
        for (value, &p) in canvas.values.iter_mut().zip(map) {
            let line = height + slope * p[0] + wave * (p[0] * 21.0 + phase).sin() + 0.25 * p[0] * p[0];
            let share = ((line - p[1]) / 0.04).clamp(0.0, 1.0);
            *value += (hair + streak(p, phase) - *value) * share;
        }
    }
    if chance(random, 0.35) {
        let (left, right) = (uniform(random, 0.85, 1.3), uniform(random, 0.85, 1.3));
        let (top, lean, phase) = (uniform(random, -1.6, -0.4), normal(random, 0.0, 0.12), uniform(random, 0.0, 6.3));
        let bottom = uniform(random, 0.2, 3.0);
        for (value, &p) in canvas.values.iter_mut().zip(map) {
            let side = if p[0] > 0.0 { p[0] - left } else { -p[0] - right };
            let side = side - lean * p[1] - 0.03 * (p[1] * 13.0 + phase).sin();
            let share = (side / 0.04).clamp(0.0, 1.0) * if p[1] > top && p[1] < bottom { 1.0 } else { 0.0 };
            *value += (hair + streak([p[1], p[0]], phase) - *value) * share;
        }
    }
    if chance(random, 0.12) {
        let (rx, ry) = (uniform(random, 0.3, 0.42), uniform(random, 0.2, 0.32));
        let (thick, grey, strength) = (uniform(random, 0.02, 0.06), uniform(random, 0.0, 120.0), uniform(random, 0.4, 1.0));
        let (power, drop) = (uniform(random, 2.0, 4.0), uniform(random, 0.0, 0.1));
        for (value, &p) in canvas.values.iter_mut().zip(map) {
            let nearest = PUPILS.map(|k| relative[k]).into_iter().map(|c| {
                let (u, v) = (((p[0] - c[0]) / rx).abs(), ((p[1] - c[1] - drop) / ry).abs());
                (u.powf(power) + v.powf(power)).powf(1.0 / power)
            });
            let reach = nearest.fold(f32::MAX, f32::min);
            let bridge = p[0].abs() < 0.5 - rx && (p[1] - relative[0][1] - drop).abs() < thick * 0.5;
            if (reach > 1.0 && reach < 1.0 + thick / ry.min(rx)) || bridge {
                *value += (grey - *value) * strength;
            }
        }
    }
}

/// Changes gamma, side light, contrast and brightness.
fn light(random: &mut ChaCha8Rng, canvas: &mut Canvas, place: impl Fn(f32, f32) -> Point) {
    let gamma = normal(random, 0.0, 0.3).exp();
    let angle = uniform(random, 0.0, std::f32::consts::TAU);
    let strength = normal(random, 0.0, 0.35).abs().min(0.8);
    let hard = chance(random, 0.5).then(|| (uniform(random, 1.0, 4.0), normal(random, 0.0, 0.5)));
    let width = canvas.width;
    for (k, value) in canvas.values.iter_mut().enumerate() {
        let [u, v] = place((k % width) as f32, (k / width) as f32);
        let along = u * angle.cos() + v * angle.sin();
        let ramp = hard.map_or(along.clamp(-1.3, 1.3), |(slope, shift)| (along * slope + shift).tanh());
        *value = (value.clamp(0.0, 255.0) / 255.0).powf(gamma) * (strength * ramp).exp() * 255.0;
    }
    let mean = canvas.values.iter().sum::<f32>() / canvas.values.len().max(1) as f32;
    let (contrast, brightness) = (uniform(random, 0.45, 1.25), uniform(random, 0.65, 1.2));
    canvas.values.iter_mut().for_each(|v| *v = (*v - mean) * contrast + mean * brightness);
}

/// Adds blur, noise, rounding and compression.
fn camera(random: &mut ChaCha8Rng, canvas: &Canvas) -> GrayImage {
    let blur = uniform(random, 0.0, 1.4);
    let mut image = canvas.image();
    if blur > 0.4 {
        image = image::imageops::fast_blur(&image, blur);
    }
    let noise = normal(random, 0.0, 5.0).abs();
    for pixel in image.iter_mut() {
        *pixel = (f32::from(*pixel) + normal(random, 0.0, noise)).round().clamp(0.0, 255.0) as u8;
    }
    if chance(random, 0.6) {
        let quality = random.random_range(35..95);
        image = compressed(&image, quality).unwrap_or(image);
    }
    image
}

fn compressed(image: &GrayImage, quality: u8) -> Option<GrayImage> {
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    encoder.write_image(image.as_raw(), image.width(), image.height(), image::ExtendedColorType::L8).ok()?;
    Some(image::load_from_memory(&bytes).ok()?.to_luma8())
}

/// Returns a picture with a face that must be rejected: upside down, on its side, inverted, or with its parts in disorder.
pub fn spoilt(sample: &Sample, random: &mut ChaCha8Rng) -> GrayImage {
    use image::imageops;
    let image = &sample.image;
    match random.random_range(0..5) {
        0 => imageops::rotate180(image),
        1 => imageops::rotate90(image),
        2 => imageops::flip_vertical(image),
        3 => {
            let mut negative = image.clone();
            imageops::invert(&mut negative);
            negative
        }
        _ => {
            // The face is painted over except for a piece.
            let outline = Placement::fit(&[[-0.5, 0.0], [0.5, 0.0]], &[sample.truth[PUPILS[1]], sample.truth[PUPILS[0]]]);
            let (left, top) = (uniform(random, -0.9, 0.3), uniform(random, -0.7, 0.9));
            let piece = [[left, top], [left + 0.6, top], [left + 0.6, top + 0.6], [left, top + 0.6]].map(|p| outline.apply(p));
            let grey = random.random_range(40..200);
            GrayImage::from_fn(image.width(), image.height(), |x, y| {
                let canonical = outline.invert([x as f32, y as f32]);
                let face = canonical[0].abs() < 1.1 && canonical[1] > -1.0 && canonical[1] < 1.9;
                if face && !within(&piece, x as f32, y as f32) { image::Luma([grey]) } else { *image.get_pixel(x, y) }
            })
        }
    }
}
