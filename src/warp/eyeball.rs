//! The eyeballs of a photograph as separate layers.
//!
//! The wireframe has the iris as a box of four nodes, and stretching the skin from lid to lid would distort it. So the iris is detected in
//! the picture as a circle (see `iris`). What the lids hide on the photograph is filled: the white by a smooth function from corner to
//! corner, the iris by its mirror image and its mean colours around the centre. In a frame the white stays with the skull, the iris
//! turns over it with the gaze, and the lids cover both. Visible parts of the photograph are kept.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::{
    Texture, Warp,
    iris::{self, Search},
    layout::OPENINGS,
    mesh::OpeningMesh,
    mouth::whiteness,
};
use crate::{
    geometry::{
        Similarity,
        polygon::{distance_to_line, inside_depth},
    },
    interpolation::smooth_step,
};

/// Radii at which the iris ends and the white is complete, relative to the radius of the iris.
const LIMBUS: (f64, f64) = (1.03, 1.20);
/// Widths of the bands along the upper and the lower lid where the photograph shows lashes with their shadow, and the wet edge of the lid, in eye
/// distances. Once the lid moves away these bands are replaced; that of a lower lid would be a light line over the dark iris at once.
const LASHES: f64 = 0.035;
const WET_EDGE: f64 = 0.022;
/// Movement of the upper and the lower lid, in eye distances, from which the whole band is replaced.
const GONE: [f64; 2] = [0.03, 0.008];
/// Depth of the upper lid's shadow on filled areas, and its width in eye distances.
const SHADOW: (f64, f64) = (0.42, 0.035);
/// Margin of a patch around the lids, in eye distances.
const ROOM: f64 = 0.16;
/// Turn of the gaze, in eye distances, from which the iris is fully drawn as a separate layer.
const TURNED: f64 = 0.015;

/// The eyeball of one eye on its photograph.
#[derive(Clone, Debug)]
pub struct Eyeball {
    /// Centre of the iris, px.
    pub centre: Point2<f64>,
    /// Radius of the iris, px.
    pub radius: f64,
    left: i64,
    top: i64,
    width: usize,
    height: usize,
    /// The white without iris and lids, and the iris without lids, row by row.
    white: Vec<[f32; 3]>,
    iris: Vec<[f32; 3]>,
    /// Distance of each pixel from the lids, px, positive between them.
    pub(super) depth: Vec<f32>,
    pub(super) eye_distance: f64,
}

/// Position of an eyeball in a frame.
#[derive(Clone, Debug)]
pub struct Turned {
    /// Map from the photograph to the frame, without the gaze.
    pub head: Similarity,
    /// Additional motion of the iris by the gaze, px of the frame.
    pub gaze: Vector2<f64>,
    /// The upper lid in the frame.
    pub lid: Vec<Point2<f64>>,
    /// Both lids on the photograph, with the distance each point moved away from the other lid, in eye distances.
    edges: [Vec<(Point2<f64>, f64)>; 2],
    /// Whether a lid uncovers something that the photograph does not show.
    uncovers: bool,
}

impl Turned {
    /// Creates the position from its fields.
    pub fn new(head: Similarity, gaze: Vector2<f64>, lid: Vec<Point2<f64>>, edges: [Vec<(Point2<f64>, f64)>; 2]) -> Self {
        let uncovers = edges.iter().flatten().any(|e| e.1 > 0.0);
        Self { head, gaze, lid, edges, uncovers }
    }

    /// Weight of the photograph, 0 to 1, at a point that lies `depth` px between its lids. It is low along a lid that moved away, where the
    /// photograph shows lashes and their shadow.
    fn trust(&self, p: Point2<f64>, depth: f64, eye_distance: f64) -> f32 {
        let one = |edge: &[(Point2<f64>, f64)], width: f64, gone: f64| {
            let mut nearest = (f64::INFINITY, 0.0);
            for pair in edge.windows(2) {
                let (a, along) = (pair[0].0, pair[1].0 - pair[0].0);
                let t = ((p - a).dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
                let distance = (p - a - along * t).norm_squared();
                if distance < nearest.0 {
                    nearest = (distance, pair[0].1 + (pair[1].1 - pair[0].1) * t);
                }
            }
            let (distance, opened) = (nearest.0.sqrt(), nearest.1);
            if opened <= 0.0 {
                return 1.0;
            }
            let band = width * eye_distance * smooth_step(0.0, gone, opened);
            smooth_step(-0.5, 0.5 + band, if depth < 0.0 { -distance } else { distance })
        };
        one(&self.edges[0], LASHES, GONE[0]).min(one(&self.edges[1], WET_EDGE, GONE[1])) as f32
    }
}

/// The surroundings of an eye and their colours, before the iris is detected.
struct Patch {
    eye: Eyeball,
    photograph: Vec<[f32; 3]>,
}

impl Patch {
    /// Cuts out the surroundings of an opening; `None` outside the picture.
    fn new(warp: &Warp, opening: &OpeningMesh, texture: &Texture) -> Option<Self> {
        let nodes = OPENINGS.iter().find(|o| o.opening == opening.opening)?;
        let unit = warp.frame.eye_distance;
        let sum: Vector2<f64> = nodes.iris.iter().map(|&n| warp.nodes[usize::from(n)].coords).sum();
        let expected = Point2::from(sum / nodes.iris.len().max(1) as f64);
        let lower = opening.lower[1..opening.lower.len() - 1].iter().rev();
        let outline: Vec<Point2<f64>> = opening.upper.iter().chain(lower).map(|&v| warp.source[v as usize]).collect();
        let (mut low, mut high) = (expected, expected);
        for p in &outline {
            (low, high) = (low.inf(p), high.sup(p));
        }
        let size = texture.dimensions();
        let clip = |v: f64, size: u32| v.clamp(0.0, f64::from(size)) as i64;
        let room = ROOM * unit;
        let (left, top) = (clip(low.x - room, size.0), clip(low.y - room, size.1));
        let (right, bottom) = (clip(high.x + room + 1.0, size.0), clip(high.y + room + 1.0, size.1));
        let (width, height) = (usize::try_from(right - left).ok()?, usize::try_from(bottom - top).ok()?);
        if width < 3 || height < 3 {
            return None;
        }
        let mut eye = Eyeball {
            centre: expected,
            radius: 0.0,
            left,
            top,
            width,
            height,
            white: Vec::new(),
            iris: Vec::new(),
            depth: Vec::new(),
            eye_distance: unit,
        };
        let places: Vec<Point2<f64>> = (0..width * height).map(|k| eye.at(k)).collect();
        eye.depth = places.iter().map(|at| inside_depth(&outline, at) as f32).collect();
        let photograph = places.iter().map(|at| texture.sample(*at)).collect();
        Some(Self { eye, photograph })
    }
}

impl Eyeball {
    /// Finds the eyeballs of both eyes; `None` where the picture shows no iris.
    pub fn find(warp: &Warp, texture: &Texture) -> [Option<Self>; 2] {
        let down = warp.frame.down.into_inner();
        let patches = [1, 2].map(|k: usize| Patch::new(warp, warp.mesh.openings.get(k)?, texture));
        let searches = patches.each_ref().map(|patch| {
            let patch = patch.as_ref()?;
            Search::new(&patch.eye, &patch.photograph, down)
        });
        let circles = iris::both(&searches);
        let mut circles = circles.into_iter();
        patches.map(|patch| {
            let (circle, Patch { mut eye, photograph }) = (circles.next()??, patch?);
            (eye.centre, eye.radius) = (circle.centre, circle.radius);
            eye.white = eye.filled_white(&photograph, down);
            eye.iris = eye.filled_iris(&photograph, down);
            Some(eye)
        })
    }

    /// Position of pixel `k` of the patch, px.
    fn at(&self, k: usize) -> Point2<f64> {
        Point2::new((self.left + (k % self.width) as i64) as f64, (self.top + (k / self.width) as i64) as f64)
    }

    /// Interpolates values of a patch at a point; `None` outside.
    pub(super) fn sampled<T>(&self, values: &[T], p: Point2<f64>, of: impl Fn(&T) -> [f32; 3]) -> Option<[f32; 3]> {
        let (x, y) = (p.x - self.left as f64, p.y - self.top as f64);
        let inside = x >= 0.0 && y >= 0.0 && x <= (self.width - 1) as f64 && y <= (self.height - 1) as f64;
        if !inside {
            return None;
        }
        let (left, top) = ((x as usize).min(self.width - 2), (y as usize).min(self.height - 2));
        let (fx, fy) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let mut sum = [0.0; 3];
        for (dx, dy, share) in
            [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)]
        {
            let value = of(values.get((top + dy) * self.width + left + dx)?);
            (0..3).for_each(|c| sum[c] += share * value[c]);
        }
        Some(sum)
    }

    /// Distance from the lids of the photograph, px, positive between them.
    pub(super) fn depth_at(&self, p: Point2<f64>) -> f64 {
        self.sampled(&self.depth, p, |d| [*d, 0.0, 0.0]).map_or(f64::NEG_INFINITY, |d| f64::from(d[0]))
    }

    /// The white without iris and lids: a parabola from corner to corner, fitted to the whitest visible pixels.
    fn filled_white(&self, photograph: &[[f32; 3]], down: Vector2<f64>) -> Vec<[f32; 3]> {
        let across = Vector2::new(down.y, -down.x);
        let along = |k: usize| (self.at(k) - self.centre).dot(&across) / (4.0 * self.radius);
        let candidates = |beyond: f64| -> Vec<usize> {
            let is_white = |k: &usize| {
                f64::from(self.depth[*k]) > 0.018 * self.eye_distance && (self.at(*k) - self.centre).norm() > beyond * self.radius
            };
            let mut found: Vec<usize> = (0..photograph.len()).filter(is_white).collect();
            found.sort_by(|&a, &b| whiteness(photograph[b]).total_cmp(&whiteness(photograph[a])));
            found.truncate((found.len() * 3).div_ceil(5));
            found
        };
        let mut chosen = candidates(LIMBUS.1 + 0.1);
        if chosen.len() < 8 {
            chosen = candidates(1.0);
        }
        let mut normal = Matrix3::identity() * (0.02 * chosen.len().max(1) as f64);
        let mut right = [Vector3::zeros(); 3];
        let mean: [f64; 3] = std::array::from_fn(|c| {
            chosen.iter().map(|&k| f64::from(photograph[k][c])).sum::<f64>() / chosen.len().max(1) as f64
        });
        for &k in &chosen {
            let u = along(k);
            let row = Vector3::new(1.0, u, u * u);
            normal += row * row.transpose();
            for c in 0..3 {
                right[c] += row * (f64::from(photograph[k][c]) - mean[c]);
            }
        }
        let inverse = normal.try_inverse().unwrap_or_else(Matrix3::zeros);
        let courses = right.map(|r| inverse * r);
        let limits: [(f64, f64); 3] = std::array::from_fn(|c| {
            let mut values: Vec<f64> = chosen.iter().map(|&k| f64::from(photograph[k][c])).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: usize| values.get(values.len() * share / 10).copied().unwrap_or(200.0);
            (at(1), at(9))
        });
        (0..photograph.len())
            .map(|k| {
                let u = along(k);
                let row = Vector3::new(1.0, u, u * u);
                std::array::from_fn(|c| (mean[c] + courses[c].dot(&row)).clamp(limits[c].0, limits[c].1) as f32)
            })
            .collect()
    }

    /// The iris without lids: its mirror image where that is visible on the photograph, otherwise the mean colour at that distance from the centre.
    fn filled_iris(&self, photograph: &[[f32; 3]], down: Vector2<f64>) -> Vec<[f32; 3]> {
        let band = LASHES * self.eye_distance;
        let bin = (self.radius / 16.0).max(0.5);
        let last = (LIMBUS.1 * self.radius / bin).ceil() as usize;
        let mut rings = vec![([0.0_f64; 3], 0.0_f64); last + 1];
        for (k, colour) in photograph.iter().enumerate() {
            let distance = (self.at(k) - self.centre).norm() / bin;
            if distance < last as f64 && f64::from(self.depth[k]) > band {
                let (near, share) = (distance as usize, distance.fract());
                for (ring, share) in [(near, 1.0 - share), (near + 1, share)] {
                    (0..3).for_each(|c| rings[ring].0[c] += share * f64::from(colour[c]));
                    rings[ring].1 += share;
                }
            }
        }
        // From the centre outwards: a hidden ring gets the colour of the last visible one.
        let mut colours: Vec<Option<[f32; 3]>> =
            rings.iter().map(|(sum, count)| (*count > 0.5).then(|| sum.map(|s| (s / count) as f32))).collect();
        let mut known = colours.iter().flatten().next().copied();
        for colour in &mut colours {
            known = colour.or(known);
            *colour = known;
        }
        let ring = |distance: f64| {
            let place = (distance / bin).min(last as f64 - 1.0).max(0.0);
            let [a, b] = [place as usize, place as usize + 1].map(|k| colours[k].unwrap_or([60.0; 3]));
            let t = place.fract() as f32;
            std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t)
        };
        (0..photograph.len())
            .map(|k| {
                let from_centre = self.at(k) - self.centre;
                let mean: [f32; 3] = ring(from_centre.norm());
                let mirrored = self.at(k) - down * (2.0 * from_centre.dot(&down));
                let share = smooth_step(0.5 * band, 1.2 * band, self.depth_at(mirrored)) as f32;
                match self.sampled(photograph, mirrored, |c| *c) {
                    Some(seen) if share > 0.0 => std::array::from_fn(|c| mean[c] + (seen[c] - mean[c]) * 0.8 * share),
                    _ => mean,
                }
            })
            .collect()
    }

    /// Colour of a pixel of a frame between the lids.
    pub fn colour(&self, at: Point2<f64>, turned: &Turned, back: &Similarity, texture: &Texture) -> [f32; 3] {
        let (still, moved) = (back.apply(&at), back.apply(&(at - turned.gaze)));
        let shade = if turned.uncovers {
            let depth = distance_to_line(&turned.lid, &at) / (SHADOW.1 * self.eye_distance);
            1.0 - SHADOW.0 * (-depth * depth).exp()
        } else {
            1.0
        };
        let trust = |p: Point2<f64>| if turned.uncovers { turned.trust(p, self.depth_at(p), self.eye_distance) } else { 1.0 };
        let iris_at = |p: Point2<f64>| 1.0 - smooth_step(LIMBUS.0, LIMBUS.1, (p - self.centre).norm() / self.radius) as f32;
        let mix = |a: [f32; 3], b: [f32; 3], share: f32| std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share);
        let fill = |patch: &[[f32; 3]], p: Point2<f64>| {
            self.sampled(patch, p, |c| *c).unwrap_or_else(|| texture.sample(p)).map(|c| c * shade as f32)
        };
        let seen = trust(still);
        let whole = if seen < 1.0 {
            mix(mix(fill(&self.white, still), fill(&self.iris, still), iris_at(still)), texture.sample(still), seen)
        } else {
            texture.sample(still)
        };
        let turn = smooth_step(0.0, TURNED, turned.gaze.norm() / self.eye_distance) as f32;
        if turn <= 0.0 {
            return whole;
        }
        let white = mix(fill(&self.white, still), texture.sample(still), seen * (1.0 - iris_at(still)));
        let iris = iris_at(moved);
        let under = if iris > 0.0 { mix(fill(&self.iris, moved), texture.sample(moved), trust(moved)) } else { white };
        mix(whole, mix(white, under, iris), turn)
    }
}

#[cfg(test)]
#[path = "eyeball_tests.rs"]
mod tests;
