//! Simulates covered parts of a face: masks, hands, scarves, dark glasses, hair, and light or blur that hides everything.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{
    augment::{normal, uniform},
    scenery::{Canvas, background},
};
use crate::modules::locate::{
    PUPILS,
    shape::{Point, distance},
};

/// Half width of a cover's border, over the eye distance.
const BORDER: f32 = 0.02;
/// Radius around a point that counts as its surroundings, over the eye distance.
const AROUND: f32 = 0.09;

/// Position and outline of a cover. Positions are relative to the middle of the face, in eye distances; the outline is rotated about
/// `middle`.
struct Cover {
    middle: Point,
    angle: f32,
    outline: Outline,
}

enum Outline {
    /// Half width, half height, and exponent of a superellipse: 2 is an ellipse.
    Box { half: Point, power: f32 },
    /// Everything below the middle along a bent edge, limited to the side and downward.
    Below { bend: f32, side: f32, depth: f32 },
    /// Parallel fingers: number, width, length, and extent of the back of the hand.
    Hand { fingers: usize, width: f32, length: f32, back: f32 },
    /// Both lenses and the bridge.
    Glasses { half: Point, power: f32, bridge: f32 },
}

impl Cover {
    fn draw(random: &mut ChaCha8Rng, eyes: [Point; 2], [top, mouth, chin]: [f32; 3]) -> Self {
        let turn = |random: &mut ChaCha8Rng, most: f32| uniform(random, -most, most);
        let anywhere = |random: &mut ChaCha8Rng| [uniform(random, -0.7, 0.7), uniform(random, top, chin)];
        match random.random_range(0..9) {
            0 | 1 => {
                let start = uniform(random, 0.35 * mouth + 0.65 * eyes[0][1], mouth - 0.05);
                Self {
                    middle: [normal(random, 0.0, 0.04), start],
                    angle: turn(random, 0.1),
                    outline: Outline::Below {
                        bend: uniform(random, -0.2, 0.5),
                        side: uniform(random, 0.7, 1.1),
                        depth: chin - start + uniform(random, -0.15, 0.3),
                    },
                }
            }
            2 => Self {
                middle: [normal(random, 0.0, 0.1), uniform(random, mouth - 0.6, chin - 0.1)],
                angle: turn(random, 0.4),
                outline: Outline::Below { bend: uniform(random, -0.3, 0.3), side: 9.0, depth: 9.0 },
            },
            3 => Self {
                middle: [normal(random, 0.0, 0.1), uniform(random, top, eyes[0][1] + 0.2)],
                angle: std::f32::consts::PI + turn(random, 0.4),
                outline: Outline::Below { bend: uniform(random, -0.3, 0.3), side: 9.0, depth: 9.0 },
            },
            4 => {
                let side = if random.random_range(0..2) == 0 { 1.0 } else { -1.0 };
                Self {
                    middle: [side * uniform(random, -0.2, 0.6), 0.0],
                    angle: -side * std::f32::consts::FRAC_PI_2 + turn(random, 0.4),
                    outline: Outline::Below { bend: uniform(random, -0.2, 0.2), side: 9.0, depth: 9.0 },
                }
            }
            5 => Self {
                middle: [0.5 * (eyes[0][0] + eyes[1][0]), 0.5 * (eyes[0][1] + eyes[1][1]) + uniform(random, -0.05, 0.12)],
                angle: (eyes[0][1] - eyes[1][1]).atan2(eyes[0][0] - eyes[1][0]) + turn(random, 0.05),
                outline: Outline::Glasses {
                    half: [uniform(random, 0.3, 0.46), uniform(random, 0.17, 0.34)],
                    power: uniform(random, 2.0, 6.0),
                    bridge: uniform(random, 0.03, 0.3),
                },
            },
            6 => Self {
                middle: anywhere(random),
                angle: turn(random, 3.2),
                outline: Outline::Hand {
                    fingers: random.random_range(1..5),
                    width: uniform(random, 0.1, 0.16),
                    length: uniform(random, 0.4, 1.0),
                    back: uniform(random, 0.3, 1.0),
                },
            },
            _ => Self {
                middle: anywhere(random),
                angle: turn(random, 0.8),
                outline: Outline::Box {
                    half: [uniform(random, 0.2, 0.9), uniform(random, 0.15, 0.6)],
                    power: uniform(random, 2.0, 9.0),
                },
            },
        }
    }

    /// Returns the covered share of a position, 0 to 1.
    fn share(&self, p: Point) -> f32 {
        let (x, y) = (p[0] - self.middle[0], p[1] - self.middle[1]);
        let (u, v) = (x * self.angle.cos() + y * self.angle.sin(), y * self.angle.cos() - x * self.angle.sin());
        let power = |u: f32, v: f32, power: f32| (u.abs().powf(power) + v.abs().powf(power)).powf(1.0 / power);
        // Distance of the position outside the outline, approximately in eye distances.
        let outside = match self.outline {
            Outline::Box { half, power: n } => (power(u / half[0], v / half[1], n) - 1.0) * half[0].min(half[1]),
            Outline::Below { bend, side, depth } => {
                let start = bend * u * u - v;
                // Narrower further down, as a face is.
                let narrow = side * (1.0 - 0.35 * (v / depth).clamp(0.0, 1.0).powi(2));
                start.max(v - depth).max(u.abs() - narrow)
            }
            Outline::Hand { fingers, width, length, back } => {
                let of_finger = |k: usize| {
                    let across = u - (k as f32 - 0.5 * (fingers - 1) as f32) * 2.05 * width;
                    // Fingers have different lengths.
                    let end = length * (1.0 - 0.12 * ((k as f32 * 2.4).sin() + 1.0));
                    let along = v.clamp(-end, 0.0);
                    across.hypot(v - along) - width
                };
                let palm = (u.abs() - width * 1.05 * fingers as f32).max(-v).max(v - back);
                (0..fingers).map(of_finger).fold(palm, f32::min)
            }
            Outline::Glasses { half, power: n, bridge } => {
                let lens = (power((u.abs() - 0.5) / half[0], v / half[1], n) - 1.0) * half[1];
                let join = (u.abs() - 0.5).max((v + 0.3 * half[1]).abs() - bridge);
                lens.min(join)
            }
        };
        (0.5 - 0.5 * outside / BORDER).clamp(0.0, 1.0)
    }

    /// Returns the covered share of the surroundings of a position, 0 to 1.
    fn share_around(&self, p: Point) -> f32 {
        let ring = (0..8).map(|k| {
            let angle = k as f32 * std::f32::consts::FRAC_PI_4;
            [p[0] + AROUND * angle.cos(), p[1] + AROUND * angle.sin()]
        });
        let half = (0..4).map(|k| {
            let angle = (k as f32 + 0.5) * std::f32::consts::FRAC_PI_2;
            [p[0] + 0.5 * AROUND * angle.cos(), p[1] + 0.5 * AROUND * angle.sin()]
        });
        let places: Vec<Point> = ring.chain(half).chain([p]).collect();
        places.iter().map(|&q| self.share(q)).sum::<f32>() / places.len() as f32
    }
}

/// Covers a part of a face. Returns the covered share of each point, 0 to 1. `map`: position of each pixel relative to the middle of the
/// face; `inside`: whether it is skin of the face (0 to 255); `relative`: positions of the face's points; `levels`: heights of the upper
/// end of the brows, of the mouth and of the chin.
pub fn cover(
    random: &mut ChaCha8Rng,
    canvas: &mut Canvas,
    (map, inside): (&[Point], &[f32]),
    relative: &[Point],
    levels: [f32; 3],
) -> Vec<f32> {
    let cover = Cover::draw(random, PUPILS.map(|k| relative[k]), levels);
    let shares: Vec<f32> = map.iter().map(|&p| cover.share(p)).collect();
    let filling = filling(random, canvas, map, inside);
    for ((value, other), share) in canvas.values.iter_mut().zip(&filling).zip(&shares) {
        *value += (other - *value) * share;
    }
    relative.iter().map(|&p| cover.share_around(p)).collect()
}

/// Returns the texture of a cover: grey values of the whole picture.
fn filling(random: &mut ChaCha8Rng, canvas: &Canvas, map: &[Point], inside: &[f32]) -> Vec<f32> {
    let (width, height) = (canvas.width, canvas.height);
    let slope = |random: &mut ChaCha8Rng, strength: f32| {
        let (angle, strength) = (uniform(random, 0.0, 6.3), normal(random, 0.0, strength));
        let bulge = normal(random, 0.0, 0.6 * strength.abs());
        move |p: Point| (strength * (p[0] * angle.cos() + (p[1] - 0.5) * angle.sin()) - bulge * p[0] * p[0]).exp()
    };
    let skin = {
        let pairs = canvas.values.iter().zip(inside);
        let (sum, weight) = pairs.fold((0.0, 0.0), |(s, w), (v, i)| (s + v * i, w + i));
        if weight > 0.0 { sum / weight } else { 128.0 }
    };
    let pixels_per_eye_distance = match map {
        [first, .., last] => ((width * width + height * height) as f32).sqrt() / distance(*first, *last).max(1e-3),
        _ => 1.0,
    };
    match random.random_range(0..10) {
        // Cloth or paper of one grey value, with or without folds.
        0..=2 => {
            let (grey, light) = (uniform(random, 5.0, 250.0), slope(random, 0.3));
            let (folds, period) = (normal(random, 0.0, 10.0).abs(), uniform(random, 0.06, 0.4));
            let (tilt, phase) = (uniform(random, -0.3, 0.3), uniform(random, 0.0, 6.3));
            let folds = if random.random_range(0..2) == 0 { folds } else { 0.0 };
            let fold = |p: Point| folds * ((p[1] + tilt * p[0]) / period * std::f32::consts::TAU + phase).sin();
            map.iter().map(|&p| grey * light(p) + fold(p)).collect()
        }
        // Skin of another part, or of another person.
        3 | 4 => {
            let (grey, light) = (skin * normal(random, 0.0, 0.2).exp(), slope(random, 0.35));
            let clouds = background(random, width, height);
            let mean = clouds.values.iter().sum::<f32>() / clouds.values.len().max(1) as f32;
            let strength = uniform(random, 0.0, 0.12);
            map.iter().zip(&clouds.values).map(|(&p, c)| grey * light(p) + strength * (c - mean)).collect()
        }
        // Any background texture may also be in front of a face.
        5 | 6 => {
            let cloth = background(random, width, height);
            let light = slope(random, 0.2);
            map.iter().zip(&cloth.values).map(|(&p, c)| c * light(p)).collect()
        }
        // A knitted scarf.
        7 => {
            let (grey, depth, period) = (uniform(random, 30.0, 220.0), uniform(random, 5.0, 60.0), uniform(random, 0.04, 0.2));
            let (angle, light) = (uniform(random, 0.0, 3.2), slope(random, 0.3));
            let wave = |v: f32| (v / period * std::f32::consts::TAU).sin();
            let knit = |p: Point| {
                let (u, v) = (p[0] * angle.cos() + p[1] * angle.sin(), p[1] * angle.cos() - p[0] * angle.sin());
                wave(u) * wave(v + 0.3 * u)
            };
            map.iter().map(|&p| grey * light(p) + depth * knit(p)).collect()
        }
        // Light or shade without any detail.
        8 => {
            let level = if random.random_range(0..2) == 0 { 0.0 } else { 255.0 };
            vec![level; map.len()]
        }
        // Out of focus, or in front of the camera.
        _ => {
            let radius = uniform(random, 0.12, 0.35) * pixels_per_eye_distance;
            let blurred = image::imageops::fast_blur(&canvas.image(), radius);
            blurred.as_raw().iter().map(|&v| f32::from(v)).collect()
        }
    }
}
