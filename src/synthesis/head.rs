//! The embedded head: an average face with eyes, mouth, brows and colours, its expression shapes, and the bank mixed from them.
//!
//! The skin and its shapes come from `candide/head_mesh.bin`, which `grimace learn head-mesh` reduces from ICT-FaceKit. The other
//! parts are generated on demand ([`super::head_parts`]).

use nalgebra::{Matrix3, Vector3};

use super::{
    Bank, BankError, BankInfo, Composition, Recipe, arkit,
    head_mesh::HeadMesh,
    head_parts::{Attached, Parts, parts, skin_colours},
    mix::mix,
};
use crate::{
    mesh::{TriangleMesh, dot, sub},
    output::MADE_BY,
};

const FILE: &str = "candide/head_mesh.bin";
const EMBEDDED: &[u8] = include_bytes!("../../candide/head_mesh.bin");

/// Movements of both sides that become the bank's members after the six expressions: the shapes the expressions are mixed of, and
/// other common ones.
const MOVEMENTS: [&str; 24] = [
    "browDown",
    "browInnerUp",
    "browOuterUp",
    "eyeBlink",
    "eyeLookDown",
    "eyeLookUp",
    "eyeSquint",
    "eyeWide",
    "cheekSquint",
    "noseSneer",
    "jawOpen",
    "mouthSmile",
    "mouthFrown",
    "mouthStretch",
    "mouthDimple",
    "mouthPress",
    "mouthUpperUp",
    "mouthLowerDown",
    "mouthPucker",
    "mouthFunnel",
    "mouthRollLower",
    "mouthRollUpper",
    "mouthShrugLower",
    "mouthShrugUpper",
];

/// Names in the bank of the shapes that model looking eyes in the source.
///
/// Here they only open or lower the lids; no eyeball turns. Under their `ARKit` names they would roll the eyes of another face.
/// In files of coefficients they count as `eyeBlink` and `eyeWide` (`arkit::LID_SHARES`).
const LIDS: [(&str, &str); 2] = [("eyeLookDown", "lidsDown"), ("eyeLookUp", "lidsUp")];

/// Returns the name of a shape in the bank.
fn bank_name(shape: &str) -> String {
    let lids = LIDS.iter().find_map(|(eyes, lids)| Some(format!("{lids}{}", shape.strip_prefix(eyes)?)));
    lids.unwrap_or_else(|| shape.to_owned())
}

/// Strength of the blink: in ICT-FaceKit's blink the lids nearly meet; at this strength they meet.
const BLINK: (&str, f32) = ("eyeBlink", 1.08);

/// Landmarks along the jaw, and the distance from them up to which skin moves with the jaw bone, cm.
const JAW_LINE: std::ops::RangeInclusive<usize> = 5..=11;
const JAW_REACH: f32 = 1.2;

/// A rotation about a point followed by a shift: the motion of the jaw in a shape.
struct Turn {
    from: Vector3<f64>,
    to: Vector3<f64>,
    rotation: Matrix3<f64>,
}

impl Turn {
    /// Fits the rigid motion nearest to these pairs of positions (Kabsch).
    fn of(places: &[([f32; 3], [f32; 3])]) -> Option<Self> {
        let vector = |v: [f32; 3]| Vector3::from(v.map(f64::from));
        let count = places.len() as f64;
        let from = places.iter().map(|p| vector(p.0)).sum::<Vector3<f64>>() / count;
        let to = from + places.iter().map(|p| vector(p.1)).sum::<Vector3<f64>>() / count;
        let products = places.iter().map(|&(p, d)| (vector(p) + vector(d) - to) * (vector(p) - from).transpose());
        let svd = products.sum::<Matrix3<f64>>().svd(true, true);
        let (u, v) = (svd.u?, svd.v_t?);
        let mirrors = (u * v).determinant() < 0.0;
        let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, if mirrors { -1.0 } else { 1.0 })) * v;
        Some(Self { from, to, rotation })
    }

    fn displacement(&self, at: [f32; 3]) -> [f32; 3] {
        let place = Vector3::from(at.map(f64::from));
        let moved = self.to + self.rotation * (place - self.from) - place;
        [0, 1, 2].map(|k| moved[k] as f32)
    }
}

/// The skin of the embedded head and its shapes.
pub fn head_skin() -> Result<HeadMesh, BankError> {
    let broken = |reason: String| BankError::Source { path: FILE.into(), reason };
    Ok(HeadMesh::from_bytes(EMBEDDED).map_err(broken)?.0)
}

struct Head {
    skin: HeadMesh,
    parts: Parts,
    mesh: TriangleMesh,
    colours: Vec<[u8; 3]>,
    /// Vertices of the skin that move with the jaw bone.
    jaw: Vec<u32>,
}

impl Head {
    fn new() -> Result<Self, BankError> {
        let mut head = head_skin()?;
        for (_, shape) in head.names.iter().zip(&mut head.shapes).filter(|(name, _)| name.starts_with(BLINK.0)) {
            shape.as_flattened_mut().iter_mut().for_each(|c| *c *= BLINK.1);
        }
        let skin = TriangleMesh::new(head.positions.clone(), head.triangles.clone())?;
        let parts = parts(&head, &skin);
        let positions = [skin.positions(), &parts.positions].concat();
        let mesh = TriangleMesh::new(positions, [skin.triangles(), &parts.triangles].concat())?;
        let colours = [&skin_colours(&head, &skin)[..], &parts.colours].concat();
        let line: Vec<[f32; 3]> = JAW_LINE.filter_map(|k| head.landmarks.get(k)).map(|&v| head.positions[v as usize]).collect();
        let near = |p: [f32; 3], q: [f32; 3]| dot(sub(p, q), sub(p, q)) < JAW_REACH * JAW_REACH;
        let on_jaw = |v: &u32| line.iter().any(|&p| near(p, head.positions[*v as usize]));
        let jaw = (0..head.positions.len() as u32).filter(on_jaw).collect();
        Ok(Self { skin: head, parts, mesh, colours, jaw })
    }

    /// Returns the displacements of skin and parts in a shape.
    fn displacements(&self, shape: usize) -> Vec<[f32; 3]> {
        let skin = &self.skin.shapes[shape];
        let places: Vec<_> = self.jaw.iter().map(|&v| (self.skin.positions[v as usize], skin[v as usize])).collect();
        let turn = self.skin.names[shape].starts_with("jaw").then(|| Turn::of(&places)).flatten();
        let part = |(&at, attached): (&[f32; 3], &Attached)| match attached {
            Attached::Skull => [0.0; 3],
            Attached::Jaw => turn.as_ref().map_or([0.0; 3], |turn| turn.displacement(at)),
            Attached::Skin(shares) => {
                [0, 1, 2].map(|k| shares.iter().map(|&(v, share)| share * skin[v as usize][k]).sum::<f32>())
            }
        };
        let mut all = skin.clone();
        all.extend(self.parts.positions.iter().zip(&self.parts.attached).map(part));
        all
    }

    fn bank(
        &self,
        names: Vec<String>,
        displacements: Vec<[f32; 3]>,
        composition: Option<Composition>,
    ) -> Result<Bank, BankError> {
        let info = BankInfo {
            made_by: MADE_BY.to_owned(),
            unit: "centimetre".to_owned(),
            source: "ICT-FaceKit's average head, reduced by `grimace learn head-mesh`; eyes, teeth, tongue and brows are ours".to_owned(),
            credit: "ICT-FaceKit: Li et al., Learning Formation of Physically-Based Face Attributes, CVPR 2020 (MIT, Copyright (c) 2020 \
                     USC Institute for Creative Technologies)"
                .to_owned(),
            composition,
            paint: Some(self.colours.clone()),
        };
        Bank::new(self.mesh.clone(), names, displacements, self.skin.feature_points.clone(), info)
    }

    fn shapes(&self) -> Result<Bank, BankError> {
        let displacements = (0..self.skin.names.len()).flat_map(|k| self.displacements(k)).collect();
        self.bank(self.skin.names.clone(), displacements, None)
    }
}

/// Whether a shape is a movement or one side of it.
fn is_of(shape: &str, movement: &str) -> bool {
    shape == movement || shape.strip_prefix(movement).is_some_and(|side| side == "_L" || side == "_R")
}

/// Returns the shapes of the embedded head: 52 movements with `ARKit` names, one for each side where the movement has sides.
///
/// # Errors
/// [`BankError`], only if the embedded file is defective.
pub fn head_shapes() -> Result<Bank, BankError> {
    Head::new()?.shapes()
}

/// Returns the bank of the embedded head: the six dominant expressions and 24 movements of both sides, 30 members.
///
/// The members after the six expressions are single movements, not frames of a performance as in [`super::candide_bank`]. The
/// weights of a planar motion are not negative, and no non-negative mixture of mixed frames shows one movement alone.
///
/// ```
/// use grimace::synthesis::head_bank;
///
/// let bank = head_bank()?;
/// assert_eq!(bank.member_count(), 30);
/// assert_eq!(bank.names()[0], "anger");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Same as `head_shapes`.
pub fn head_bank() -> Result<Bank, BankError> {
    let head = Head::new()?;
    let shapes = head.shapes()?;
    let none = || BankError::Source { path: FILE.into(), reason: "its shapes have no ARKit names".to_owned() };
    let expressions = arkit::dominant_expressions(shapes.names()).ok_or_else(none)?;
    let alone = |movement: &str| shapes.names().iter().map(|shape| f64::from(u8::from(is_of(shape, movement)))).collect();
    let movements = MOVEMENTS.iter().map(|&movement| (bank_name(movement), alone(movement)));
    let recipes: Vec<Recipe> = expressions.into_iter().chain(movements).map(|(name, weights)| Recipe { name, weights }).collect();
    let displacements = recipes.iter().flat_map(|r| mix(&shapes, &r.weights)).collect();
    let names = recipes.iter().map(|r| r.name.clone()).collect();
    let weights = recipes.into_iter().map(|r| r.weights).collect();
    let shapes = shapes.names().iter().map(|shape| bank_name(shape)).collect();
    head.bank(names, displacements, Some(Composition { shapes, weights }))
}

#[cfg(test)]
mod tests {
    use super::{
        super::{
            head_mesh::mirrored,
            head_parts::{EYE_CENTRE, EYE_RADIUS},
            testing::check_dominant_expressions,
        },
        *,
    };

    /// Positions of a member at a strength.
    fn posed(bank: &Bank, member: &str, strength: f32) -> Vec<[f32; 3]> {
        let member = bank.names().iter().position(|n| n == member).unwrap();
        let pairs = bank.mesh().positions().iter().zip(bank.displacements(member));
        pairs.map(|(p, d)| [0, 1, 2].map(|k| p[k] + strength * d[k])).collect()
    }

    fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
        dot(sub(a, b), sub(a, b)).sqrt()
    }

    /// Vertices of the left eyeball: those of the parts that lie on its sphere.
    fn left_eyeball(head: &Head) -> Vec<usize> {
        let skin = head.skin.positions.len();
        let on_ball = |v: &usize| (distance(head.mesh.positions()[*v], EYE_CENTRE) - EYE_RADIUS).abs() < 1e-3;
        (skin..head.mesh.vertex_count()).filter(on_ball).collect()
    }

    #[test]
    fn lids_that_open_are_no_look_of_the_eyes() {
        let bank = head_bank().unwrap();
        let shapes = &bank.info().composition.as_ref().unwrap().shapes;
        assert!(bank.names().iter().any(|name| name == "lidsUp") && shapes.iter().any(|shape| shape == "lidsDown_L"));
        // No coefficient of the eyes' gaze can differ from 0.
        let gaze =
            |name: &String| arkit::coefficient(name).is_some_and(|k| crate::features::COEFFICIENTS[k].starts_with("eyeLook"));
        for (k, shape) in shapes.iter().enumerate().filter(|(_, shape)| gaze(shape)) {
            assert!(bank.info().composition.as_ref().unwrap().weights.iter().all(|row| row[k] == 0.0), "{shape}");
        }
    }

    #[test]
    fn lids_count_as_far_as_they_move() {
        // How far the lids of the left eye close in the middle (feature points 3.1 and 3.3), relative to the blink.
        let shapes = head_shapes().unwrap();
        let lid = |fp: &str| {
            let point = shapes.feature_point_index(fp.parse().unwrap()).unwrap();
            shapes.feature_points()[point].vertex as usize
        };
        let (upper, lower) = (lid("3.1"), lid("3.3"));
        let shuts = |shape: &str| {
            let shape = shapes.names().iter().position(|name| name == shape).unwrap();
            let moved = |vertex: usize| f64::from(shapes.displacements(shape)[vertex][1]);
            moved(lower) - moved(upper)
        };
        let blink = shuts("eyeBlink_L");
        for (shape, named) in [("eyeLookDown_L", "lidsDown_L"), ("eyeLookUp_L", "lidsUp_L"), ("eyeWide_L", "eyeWide_L")] {
            let (found, share) = (shuts(shape) / blink, arkit::lid_share(named).unwrap());
            assert!((found - share).abs() < 1e-3, "{named}: {found}, not {share}");
        }
    }

    #[test]
    fn the_file_is_small_and_names_whose_it_is() {
        assert!(EMBEDDED.len() < 300_000, "{}", EMBEDDED.len());
        let (head, origin) = HeadMesh::from_bytes(EMBEDDED).unwrap();
        assert!(origin.credit.contains("MIT") && origin.credit.contains("ICT"), "{origin:?}");
        assert_eq!((head.left, head.middle, head.names.len(), head.landmarks.len()), (5157, 174, 52, 68));
    }

    #[test]
    fn the_bank_has_thirty_members_and_all_feature_points_and_is_symmetric() {
        let bank = head_bank().unwrap();
        assert_eq!((bank.member_count(), bank.feature_points().len()), (30, 56));
        assert_eq!(bank.names()[..6], ["anger", "disgust", "fear", "happiness", "sadness", "surprise"]);
        assert_eq!(bank.paint().unwrap().len(), bank.vertex_count());
        assert!((10_000..20_000).contains(&bank.vertex_count()), "{}", bank.vertex_count());
        let (left, middle) = (5157, 174);
        let reflected = |[x, y, z]: [f32; 3]| [-x, y, z];
        for v in 0..(2 * left + middle) as u32 {
            let (a, b) = (v as usize, mirrored(v, left, middle) as usize);
            let positions = bank.mesh().positions();
            assert!(distance(positions[a], reflected(positions[b])) < 2e-3);
            for member in 0..30 {
                let d = bank.displacements(member);
                assert!(distance(d[a], reflected(d[b])) < 1e-3, "{} at {v}", bank.names()[member]);
            }
        }
        let at = |fp: &str| bank.feature_point_position(fp.parse().unwrap()).unwrap();
        // The corners of the mouth are 5.07 cm apart.
        assert!((at("8.3")[0] - at("8.4")[0] - 5.07).abs() < 0.01, "{:?}", at("8.3"));
    }

    #[test]
    fn the_dominant_expressions_move_the_right_way() {
        check_dominant_expressions(&head_bank().unwrap(), [0.8, 0.2, 0.2, 1.0]);
    }

    #[test]
    fn lids_close_over_the_eyeballs() {
        let head = Head::new().unwrap();
        let bank = head_bank().unwrap();
        let ball = left_eyeball(&head);
        assert_eq!(ball.len(), 1 + 15 * 40);
        let skin = &head.skin.triangles;
        // The fraction of the eyeball's vertices with no skin in front of them.
        let bare = |positions: &[[f32; 3]]| {
            let is_bare = |&&v: &&usize| {
                let [x, y, z] = positions[v];
                !skin.iter().any(|t| {
                    let [a, b, c] = t.map(|v| positions[v as usize]);
                    let area = |q: [f32; 3], r: [f32; 3]| (q[0] - x) * (r[1] - y) - (q[1] - y) * (r[0] - x);
                    let shares = [area(b, c), area(c, a), area(a, b)];
                    let whole: f32 = shares.iter().sum();
                    whole > 0.0
                        && shares.iter().all(|&s| s >= 0.0)
                        && (shares[0] * a[2] + shares[1] * b[2] + shares[2] * c[2]) / whole > z
                })
            };
            ball.iter().filter(is_bare).count() as f64 / ball.len() as f64
        };
        let [open, half, closed] = [0.0, 0.5, 1.0].map(|strength| bare(&posed(&bank, "eyeBlink", strength)));
        assert!(closed < 0.01 && half < 0.7 * open && open > 0.4, "{closed} {half} {open}");
    }

    #[test]
    fn the_lower_teeth_turn_with_the_jaw_as_a_whole_and_the_upper_ones_rest() {
        let head = Head::new().unwrap();
        let bank = head_bank().unwrap();
        let skin = head.skin.positions.len();
        let all = &head.parts.attached;
        let of = |attached: Attached| (0..all.len()).filter(move |&k| all[k] == attached).map(move |k| k + skin);
        let (still, open) = (posed(&bank, "jawOpen", 0.0), posed(&bank, "jawOpen", 1.0));
        assert!(of(Attached::Skull).all(|v| still[v] == open[v]));
        let jaw: Vec<usize> = of(Attached::Jaw).collect();
        for pair in jaw.windows(2) {
            assert!((distance(still[pair[0]], still[pair[1]]) - distance(open[pair[0]], open[pair[1]])).abs() < 1e-3);
        }
        // In front the teeth drop by nearly 3 cm, at the root of the tongue by less.
        assert!(jaw.iter().all(|&v| still[v][1] - open[v][1] > if still[v][2] > 10.0 { 2.5 } else { 0.5 }));
    }

    #[test]
    fn paint_travels_in_the_bank_file_and_must_fit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("head.bank");
        let bank = head_bank().unwrap().select(&[3]).unwrap();
        bank.write(&path).unwrap();
        assert_eq!(Bank::open(&path).unwrap().paint(), bank.paint());
        let info = BankInfo { paint: Some(vec![[0; 3]; 7]), ..bank.info().clone() };
        let short = Bank::new(
            bank.mesh().clone(),
            bank.names().to_vec(),
            bank.displacements(0).to_vec(),
            bank.feature_points().to_vec(),
            info,
        );
        assert!(short.unwrap_err().to_string().contains('7'));
    }
}
