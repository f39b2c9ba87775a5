//! Simulated people: facial proportions, colours and metadata.

use nalgebra::{Point2, Point3};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::{
    SimulateError, SimulateOptions,
    mesh::SkinMesh,
    motion::px_per_unit,
    random::{Purpose, generator},
    render::Surface,
    texture::{Texture, paint},
};
use grimace::internal::wireframe::{Fapus, Tables, Wireframe};

/// Mean and standard deviation of Candide-3's shape units in the simulated population, by unit number. The means make Candide-3's angular
/// default face rounder: narrower and more open eyes, so that the iris fills them as in people, slightly higher brows, and a narrower jaw.
const SHAPE: [(u16, f64, f64); 12] = [
    (0, 0.00, 0.20),
    (1, 0.20, 0.12),
    (2, 0.00, 0.11),
    (3, -0.30, 0.15),
    (4, 0.22, 0.10),
    (5, 0.00, 0.20),
    (6, 0.20, 0.30),
    (7, 0.00, 0.30),
    (8, 0.00, 0.22),
    (10, 0.10, 0.22),
    (11, 0.00, 0.28),
    (13, -0.35, 0.30),
];
/// Limit of the shape parameters, in standard deviations from their mean.
const SHAPE_LIMIT_SD: f64 = 2.0;
/// Strength of the expressions of cohort B relative to cohort A.
const COHORT_B_STRENGTH: f64 = 0.75;
/// Texels per image pixel: the renderer takes two samples per pixel and direction.
const TEXELS_PER_PX: f64 = 2.0;

/// Sex of a simulated subject; it affects hair, brows, lips and beard shadow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sex {
    /// `f` in the manifest.
    Female,
    /// `m` in the manifest.
    Male,
}

/// Half of the population that a subject belongs to: a group difference for `--by`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cohort {
    /// Expressions at full strength.
    A,
    /// Expressions at three quarters of full strength.
    B,
}

/// An RGB colour, components in [0, 1].
pub type Colour = [f32; 3];

/// Colours and details of a face.
#[derive(Clone, Debug)]
pub struct Appearance {
    /// Base colour of the skin.
    pub skin: Colour,
    /// 0 for the lightest skin, 1 for the darkest.
    pub darkness: f32,
    /// Base colour of hair and brows.
    pub hair: Colour,
    /// Colour of the iris.
    pub iris: Colour,
    /// Colour of the clothes.
    pub cloth: Colour,
    /// Colour of the background in the middle of the picture.
    pub background: Colour,
    /// Whether hair falls beside the face; short hair ends above the ears.
    pub long_hair: bool,
    /// Side of the parting, -1 to 1.
    pub parting: f32,
    /// Height of the hairline above the default, model units.
    pub hairline: f32,
    /// Strength of the beard shadow, 0 for none.
    pub beard: f32,
    /// Number of freckles.
    pub freckles: usize,
    /// Thickness of the brows relative to the average of 1.
    pub brow: f32,
    /// Strength of the lips' colour.
    pub lip: f32,
    /// Seed of all surface noise.
    pub noise: u32,
}

/// A simulated person.
#[derive(Clone, Debug)]
pub struct Subject {
    index: u32,
    sex: Sex,
    cohort: Cohort,
    neutral: Vec<Point3<f64>>,
    fapus: Fapus,
    appearance: Appearance,
    pub(super) mesh: SkinMesh,
    pub(super) surface: Surface,
    pub(super) texture: Texture,
}

const SKINS: [[u8; 3]; 8] = [
    [244, 206, 186],
    [240, 198, 174],
    [232, 186, 158],
    [222, 170, 138],
    [206, 150, 116],
    [176, 122, 90],
    [142, 95, 68],
    [112, 74, 54],
];
const HAIRS: [[u8; 3]; 6] = [[30, 25, 24], [48, 34, 27], [74, 51, 36], [104, 74, 48], [158, 122, 78], [112, 58, 34]];
const IRISES: [[u8; 3]; 6] = [[74, 46, 26], [52, 33, 22], [104, 80, 42], [92, 108, 70], [88, 120, 144], [108, 124, 132]];
const CLOTHS: [[u8; 3]; 6] = [[58, 68, 84], [92, 60, 58], [70, 82, 66], [196, 194, 188], [44, 44, 50], [112, 120, 138]];
const BACKGROUNDS: [[u8; 3]; 4] = [[158, 168, 176], [176, 170, 162], [146, 158, 150], [170, 170, 178]];

fn colour(rgb: [u8; 3]) -> Colour {
    rgb.map(|c| f32::from(c) / 255.0)
}

impl Subject {
    /// Makes subject number `index` (from 0) of a dataset.
    ///
    /// # Errors
    /// [`SimulateError`] when the options are out of range.
    pub fn new(options: &SimulateOptions, index: u32) -> Result<Self, SimulateError> {
        options.check()?;
        let sex = if index.is_multiple_of(2) { Sex::Female } else { Sex::Male };
        let cohort = if (index / 2).is_multiple_of(2) { Cohort::A } else { Cohort::B };
        let wireframe = Wireframe::candide3();
        let neutral = identity(&wireframe, options.seed, index);
        let frontal: Vec<Point2<f64>> = neutral.iter().map(nalgebra::OPoint::xy).collect();
        let fapus = Fapus::measure(&Tables::candide3().fapus, &frontal)?;
        let mesh = SkinMesh::new(&wireframe, &frontal);
        let surface = Surface::new(&mesh, &neutral);
        let appearance = appearance(options.seed, index, sex);
        let texture = paint(&frontal, sex, &appearance, (px_per_unit(options) * TEXELS_PER_PX) as f32);
        Ok(Self { index, sex, cohort, neutral, fapus, appearance, mesh, surface, texture })
    }

    /// Returns the number of the subject, from 0.
    pub fn index(&self) -> u32 {
        self.index
    }

    /// Returns the name in the manifest: `S001` and up.
    pub fn id(&self) -> String {
        format!("S{:03}", self.index + 1)
    }

    /// Returns the sex.
    pub fn sex(&self) -> Sex {
        self.sex
    }

    /// Returns the cohort.
    pub fn cohort(&self) -> Cohort {
        self.cohort
    }

    /// Returns the strength of expressions in this person's cohort.
    pub fn strength(&self) -> f64 {
        match self.cohort {
            Cohort::A => 1.0,
            Cohort::B => COHORT_B_STRENGTH,
        }
    }

    /// Returns all N neutral nodes in face space, model units, with followers at the mean of their leaders.
    pub fn neutral(&self) -> &[Point3<f64>] {
        &self.neutral
    }

    /// Returns the FAPUs of the neutral face, model units.
    pub fn fapus(&self) -> &Fapus {
        &self.fapus
    }

    /// Returns the colours and details.
    pub fn appearance(&self) -> &Appearance {
        &self.appearance
    }
}

/// Returns the neutral nodes of a seeded person.
pub(super) fn identity(wireframe: &Wireframe, seed: u64, index: u32) -> Vec<Point3<f64>> {
    let mut random = generator(seed, Purpose::Shape, index, 0, 0);
    let mut nodes = wireframe.vertices().to_vec();
    // Shape units have no numbers in a wireframe; they are in the order of the file, which numbers them from 0.
    for (number, mean, sd) in SHAPE {
        let z: f64 = StandardNormal.sample(&mut random);
        let parameter = mean + sd * z.clamp(-SHAPE_LIMIT_SD, SHAPE_LIMIT_SD);
        let Some(unit) = wireframe.shape_units().get(usize::from(number)) else { continue };
        for &(node, offset) in &unit.offsets {
            nodes[node.index()] += offset * parameter;
        }
    }
    place_followers(wireframe, &mut nodes);
    nodes
}

/// Puts every node without a triangle at the mean of its leaders, in three dimensions.
pub(super) fn place_followers(wireframe: &Wireframe, nodes: &mut [Point3<f64>]) {
    for follower in wireframe.followers() {
        let sum: nalgebra::Vector3<f64> = follower.leaders.iter().map(|n| nodes[n.index()].coords).sum();
        nodes[follower.node.index()] = Point3::from(sum / follower.leaders.len() as f64);
    }
}

fn appearance(seed: u64, index: u32, sex: Sex) -> Appearance {
    let mut random = generator(seed, Purpose::Appearance, index, 0, 0);
    let male = sex == Sex::Male;
    let skin_index = random.random_range(0..SKINS.len());
    let darkness = skin_index as f32 / (SKINS.len() - 1) as f32;
    let mut pick = |list: &[[u8; 3]], limit: usize| colour(list[random.random_range(0..limit.min(list.len()))]);
    // Dark skin is combined with dark hair and eyes.
    let hair = pick(&HAIRS, if skin_index > 3 { 2 } else { 6 });
    let iris = pick(&IRISES, if skin_index > 3 { 2 } else { 6 });
    let cloth = pick(&CLOTHS, 6);
    let background = pick(&BACKGROUNDS, 4);
    let freckled = skin_index < 4 && random.random_bool(0.5);
    Appearance {
        skin: colour(SKINS[skin_index]),
        darkness,
        hair,
        iris,
        cloth,
        background,
        long_hair: !male && random.random_bool(0.75),
        parting: random.random_range(-0.6..0.6),
        hairline: random.random_range(-0.03..0.06),
        beard: if male { random.random_range(0.15..0.8) } else { 0.0 },
        freckles: if freckled { random.random_range(60..220) } else { random.random_range(4..16) },
        brow: if male { random.random_range(1.05..1.35) } else { random.random_range(0.75..1.0) },
        lip: if male { random.random_range(0.45..0.65) } else { random.random_range(0.65..1.0) },
        noise: random.random(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neutral_faces_differ_and_keep_their_order() {
        let w = Wireframe::candide3();
        for index in 0..50 {
            let nodes = identity(&w, 1, index);
            assert_ne!(nodes, identity(&w, 1, index + 1));
            assert_ne!(nodes, identity(&w, 2, index));
            // From top to bottom: brow, upper lid, lower lid, nose base, upper lip, lower lip, chin.
            let down = [16, 21, 22, 6, 7, 8, 10].map(|n: usize| nodes[n].y);
            assert!(down.windows(2).all(|d| d[0] > d[1]), "{index}: {down:?}");
            // From the subject's right to the left: eye corners.
            let across = [53, 56, 23, 20].map(|n: usize| nodes[n].x);
            assert!(across.windows(2).all(|x| x[0] < x[1]), "{index}: {across:?}");
            assert_eq!(nodes[35], nodes[2]);
        }
    }

    #[test]
    fn sexes_and_cohorts_are_balanced() {
        let options = SimulateOptions { width: 64, height: 64, ..SimulateOptions::default() };
        let four: Vec<Subject> = (0..4).map(|k| Subject::new(&options, k).unwrap()).collect();
        let kinds: Vec<_> = four.iter().map(|s| (s.sex(), s.cohort())).collect();
        use {
            Cohort::{A, B},
            Sex::{Female, Male},
        };
        assert_eq!(kinds, [(Female, A), (Male, A), (Female, B), (Male, B)]);
        assert_eq!(four[3].id(), "S004");
    }
}
