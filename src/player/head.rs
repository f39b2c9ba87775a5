//! The data of a dense head in the page: its mesh, the shapes that its bank is mixed of, and their weights in each motion.

use nalgebra::Vector3;
use serde_json::{Value, json};

use super::{PlayerError, Shown, pack};
use crate::{
    fap::{FAP_UNITS_PER_FAPU, FapCatalog, FapMotion, FapNumber, FapRow, InterpolateError},
    synthesis::{
        Bank, DrawnEye, ELSEWHERE, FREE_FAR, FREE_NEAR, FaceScene, FpMotion, Motion, MotionKind, PLANAR_RIDGE, SMOOTHING_FRAMES,
        SingleFap, SingleFaps, Solver, SynthesisError, SynthesisOptions, Synthesizer, Unshown, fapu_length, interpolate,
    },
    units::FeaturePoint,
    wireframe::Axis,
};

/// Size of the picture, px.
const SIZE: (u32, u32) = (480, 600);
/// Fraction of the picture that the head fills.
const FILLING: f64 = 0.92;
/// Motion of a vertex in a shape that does not count, px.
const LEAST_MOTION: f64 = 2e-3;
/// Largest number of vertices: indices have 16 bits, and pages would get too large.
const MOST_VERTICES: usize = 65_535;

/// A dense head to show motions on.
#[derive(Debug)]
pub struct Head<'a> {
    /// Label of the head.
    pub label: &'a str,
    /// Its bank of expression meshes.
    pub bank: &'a Bank,
    /// The shapes that the bank's members are mixed of, if known. They serve single FAPs: a member may move both lids, a shape one.
    pub shapes: Option<&'a Bank>,
    /// The page's motions, in the same order, as motions of the bank's feature points.
    pub motions: Vec<Motion>,
}

impl Head<'_> {
    /// The bank whose members the page mixes, and the weights of those for each member of the head's bank, if they are not its own.
    fn mixed(&self) -> (&Bank, Option<&[Vec<f64>]>) {
        let composition = self.bank.info().composition.as_ref();
        match (self.shapes, composition) {
            (Some(shapes), Some(of)) if shapes.member_count() == of.shapes.len() => (shapes, Some(&of.weights)),
            _ => (self.bank, None),
        }
    }

    /// The solver for the weights of a motion.
    fn synthesizer(&self, kind: MotionKind) -> Result<Synthesizer<'_>, PlayerError> {
        // Key frames are too few for smoothing in time.
        let smoothing_frames = if kind == MotionKind::Model { 0.0 } else { SMOOTHING_FRAMES };
        let options = SynthesisOptions { solver: Solver::Nnls, bound_starts: 0, smoothing_frames, ..SynthesisOptions::default() };
        Synthesizer::new(self.bank, options).map_err(|e| PlayerError::Head { name: self.label.to_owned(), reason: e.to_string() })
    }

    /// The motion as it is shown: its own frames, without noise.
    fn animated(&self, motion: &Motion) -> Result<Motion, PlayerError> {
        let failed = |e: InterpolateError| PlayerError::Head { name: self.label.to_owned(), reason: e.to_string() };
        motion.as_animated(Some(0), None).map_err(failed)
    }

    /// For each motion, what the head does not show, and whether it shows a motion of one side on both sides.
    ///
    /// # Errors
    /// [`PlayerError::Head`] if the weights cannot be computed.
    pub(crate) fn unshown(&self) -> Result<Vec<(Option<Unshown>, bool)>, PlayerError> {
        let of = |motion: &Motion| {
            let motion = self.animated(motion)?;
            let synthesizer = self.synthesizer(motion.kind)?;
            let answers = synthesizer.animate(&motion.frames, || {});
            Ok((synthesizer.unshown(&answers), synthesizer.answers_both_sides(&answers, &motion.frames)))
        };
        self.motions.iter().map(of).collect()
    }
}

/// Maps the bank's unit (y up) to px (y down), with depth towards the viewer.
struct Camera {
    middle: [f64; 3],
    scale: f64,
}

impl Camera {
    fn new(bank: &Bank) -> Self {
        let [low, high] = bank.mesh().bounds();
        let middle: [f64; 3] = std::array::from_fn(|k| f64::midpoint(f64::from(low[k]), f64::from(high[k])));
        let size = |k: usize| f64::from(high[k] - low[k]).max(1e-9);
        let scale = FILLING * (f64::from(SIZE.0) / size(0)).min(f64::from(SIZE.1) / size(1));
        Self { middle, scale }
    }

    fn place(&self, p: [f32; 3]) -> [f64; 3] {
        let [x, y, z] = std::array::from_fn(|k| (f64::from(p[k]) - self.middle[k]) * self.scale);
        [f64::from(SIZE.0) / 2.0 + x, f64::from(SIZE.1) / 2.0 - y, z]
    }

    fn displacement(&self, d: [f32; 3]) -> [f64; 3] {
        let [x, y, z] = d.map(|c| f64::from(c) * self.scale);
        [x, -y, z]
    }
}

/// Builds the data of a head.
///
/// # Errors
/// [`PlayerError::Head`] for a bank with too many vertices, or if its weights cannot be computed.
pub(super) fn payload(head: &Head, shown: &[Shown]) -> Result<Value, PlayerError> {
    let bank = head.bank;
    let failed = |reason: String| PlayerError::Head { name: head.label.to_owned(), reason };
    if bank.vertex_count() > MOST_VERTICES {
        return Err(failed(format!(
            "it has {} vertices, more than the {MOST_VERTICES} that a page can show",
            bank.vertex_count()
        )));
    }
    let camera = Camera::new(bank);
    let scene = FaceScene::new(bank);
    let (shapes, recipes) = head.mixed();
    let weights = |motion: &Motion| -> Result<Value, PlayerError> {
        let motion = head.animated(motion)?;
        let answers = head.synthesizer(motion.kind)?.animate(&motion.frames, || {});
        let of_members = answers.iter().map(|a| a.weights.first().cloned().unwrap_or_default());
        let flat: Vec<f64> = of_members.flat_map(|weights| of_shapes(weights, recipes)).collect();
        Ok(json!({ "frames": motion.frames.len(), "weights": pack::scaled(&flat) }))
    };
    let rests: Vec<bool> = (0..bank.vertex_count())
        .map(|v| (0..bank.member_count()).all(|member| bank.displacements(member)[v] == [0.0; 3]))
        .collect();
    let positions = |list: &[[f32; 3]]| pack::single(list.iter().flat_map(|&p| camera.place(p)));
    let eyes = scene.eyes().map(|DrawnEye { positions: places, triangles, centre, iris }| {
        let [x, y, _] = camera.place(centre);
        json!({
            "positions": positions(places),
            "triangles": pack::whole(triangles.iter().flatten().copied()),
            "centre": [x, y],
            "iris": f64::from(iris) * camera.scale,
        })
    });
    Ok(json!({
        "kind": "head",
        "label": head.label,
        "width": SIZE.0,
        "height": SIZE.1,
        "positions": positions(bank.mesh().positions()),
        "triangles": pack::whole(bank.mesh().triangles().iter().flatten().copied()),
        // Colours of the vertices, sRGB; null if all is skin.
        "colours": scene.colours().map(|colours| pack::bytes(colours.as_flattened())),
        "eyes": eyes.collect::<Vec<_>>(),
        "openings": scene.openings().iter().map(|walk| pack::whole(walk.iter().copied())).collect::<Vec<_>>(),
        "shapes": (0..shapes.member_count()).map(|k| shape(shapes.displacements(k), &camera)).collect::<Vec<_>>(),
        "motions": head.motions.iter().take(shown.len()).map(weights).collect::<Result<Vec<_>, _>>()?,
        "mixture": mixture(shapes, &camera).map_err(|e| failed(e.to_string()))?,
        // For FAPs that no mixture shows.
        "faps": FapCatalog::mpeg4().rows().iter().filter_map(|row| fap(row, bank, &camera, &rests)).collect::<Vec<_>>(),
    }))
}

/// Weights of the shapes, from those of the members.
fn of_shapes(members: Vec<f64>, recipes: Option<&[Vec<f64>]>) -> Vec<f64> {
    let Some(recipes) = recipes else { return members };
    let count = recipes.first().map_or(0, Vec::len);
    let sum = |shape: usize| members.iter().zip(recipes).map(|(weight, recipe)| weight * recipe[shape]).sum();
    (0..count).map(sum).collect()
}

/// A shape: the vertices that it moves, and how far.
fn shape(displacements: &[[f32; 3]], camera: &Camera) -> Value {
    let moved = displacements.iter().zip(0..).map(|(&d, v): (_, u32)| (v, camera.displacement(d)));
    let moved: Vec<(u32, [f64; 3])> = moved.filter(|(_, d)| d.iter().any(|c| c.abs() > LEAST_MOTION)).collect();
    json!({
        "vertices": pack::whole(moved.iter().map(|(v, _)| *v)),
        "offsets": pack::scaled(&moved.iter().flat_map(|(_, d)| *d).collect::<Vec<_>>()),
    })
}

/// What the page needs to mix the shapes for single FAPs. Offsets are in pixels of the picture.
fn mixture(bank: &Bank, camera: &Camera) -> Result<Value, SynthesisError> {
    let SingleFaps { drivable, faps } = SingleFaps::new(bank)?;
    let offset = |&(point, [x, y]): &(usize, [f64; 2])| json!([point, x * camera.scale, -y * camera.scale]);
    let of_fap = |fap: &SingleFap| {
        json!({
            "number": fap.number.get(),
            "twin": fap.twin.map(FapNumber::get),
            "points": fap.points.iter().map(offset).collect::<Vec<_>>(),
            "near": fap.near,
            "shows": fap.shows,
        })
    };
    Ok(json!({
        "points": pack::whole(bank.feature_points().iter().map(|p| p.vertex)),
        "drivable": drivable.as_flattened(),
        "free": { "near": FREE_NEAR, "far": FREE_FAR, "ridge": PLANAR_RIDGE, "elsewhere": ELSEWHERE },
        "faps": faps.iter().map(of_fap).collect::<Vec<_>>(),
    }))
}

/// Effect of a FAP of 1 on the head: its feature points move and the others rest; the skin between is interpolated. Returns its number, its
/// axis, and the offsets along it. Vertices that no member moves (eyeballs, upper teeth) rest. `None` for angles, for depth, and for FAPs
/// without a feature point in the bank.
fn fap(row: &FapRow, bank: &Bank, camera: &Camera, rests: &[bool]) -> Option<Value> {
    let axis = row.motion.filter(|motion| !motion.is_angle()).and_then(FapMotion::frontal_axis)?;
    let unit = row.sign * fapu_length(bank, row.fapu?)? / FAP_UNITS_PER_FAPU;
    let moves = |fp: &FeaturePoint| row.feature_points.contains(fp);
    if !bank.feature_points().iter().any(|p| moves(&p.fp)) {
        return None;
    }
    let (way, along) = match axis {
        Axis::X => (Vector3::x(), 0),
        Axis::Y => (Vector3::y(), 1),
        Axis::Z => return None,
    };
    let offset = |fp: &FeaturePoint| if moves(fp) { way * unit } else { Vector3::zeros() };
    let motion = FpMotion {
        offsets: bank.feature_points().iter().map(|p| Some(offset(&p.fp))).collect(),
        planar: true,
        ..FpMotion::default()
    };
    let offsets = interpolate(bank, &motion).into_iter().zip(rests);
    let flat: Vec<f64> = offsets.map(|(d, &rests)| if rests { 0.0 } else { camera.displacement(d)[along] }).collect();
    Some(json!({ "number": row.number.get(), "axis": along, "offsets": pack::small(&flat) }))
}
