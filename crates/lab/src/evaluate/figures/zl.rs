//! Figures 3b, 6b, 7 to 11, Table 1 and the regions of [ZL], made from a bank and from expressions that are not in it.

use image::RgbImage;

use super::{Plate, PlateContent, failed, sheet};
use crate::evaluate::{
    Cell, EvaluateError, LineChart, Series, SynthesisStudy, SynthesisTarget, Table, crossover_table, evaluate_crossovers,
};
use grimace::internal::{
    render::{Canvas, Shade, Vertex},
    synthesis::{
        Bank, Crossover, FaceScene, FpBasis, FpMotion, GaOptions, Goal, OVERLAP, RegionScheme, Regions, Solver, SynthesisOptions,
        Synthesizer, View, choose_targets, evolve,
    },
};

/// Extent of the computation.
#[derive(Clone, Copy, Debug)]
pub struct ZlFigures {
    /// Number of target expressions, which are not in the bank and are chosen by the seed [ZL: 20, of which 10 for the regions].
    pub targets: usize,
    /// Number of runs of the genetic algorithm on each target [ZL: 10].
    pub runs: usize,
    /// Seed.
    pub seed: u64,
}

/// Side of a rendered face, px.
const SIDE: u32 = 360;

/// Makes all plates.
///
/// # Errors
/// [`EvaluateError`] for options out of range, a bank without expressions to search for, or when `go_on` returns `false`.
pub fn zl_plates(
    bank: &Bank,
    unseen: &Bank,
    options: &ZlFigures,
    go_on: &(impl Fn() -> bool + Sync),
) -> Result<Vec<Plate>, EvaluateError> {
    let names = unseen.names();
    let targets: Vec<SynthesisTarget<'_>> = choose_targets(unseen.member_count(), options.targets, options.seed)
        .into_iter()
        .map(|k| SynthesisTarget { name: names[k].clone(), truth: unseen.displacements(k) })
        .filter(|t| t.truth.iter().any(|d| *d != [0.0; 3]))
        .collect();
    let Some(first) = targets.first() else {
        return Err(failed("the figures of Zhu and Lee")(&"the bank has no expressions to search for"));
    };
    let ga = GaOptions { seed: options.seed, crossover: Crossover::Line, ..GaOptions::default() };
    let view = View::front(SIDE, SIDE);
    let scene = FaceScene::new(bank);
    let motion = FpMotion::of_surface(bank, first.truth);
    let who = format!("bank of {} expressions, target `{}`, which is not among them", bank.member_count(), first.name);

    let draw = |solver: Solver, regions: RegionScheme, emphasis: f64, motion: &FpMotion| -> Result<RgbImage, EvaluateError> {
        let synthesizer = Synthesizer::new(bank, solve_with(solver, regions, emphasis, &ga))?;
        let answer = synthesizer.solve(motion, 0);
        Ok(scene.draw(&synthesizer.surface(&answer, motion), view))
    };
    let whole = RegionScheme::Whole;
    let truth = scene.draw(first.truth, view);
    let interpolation = sheet(vec![vec![
        (scene.draw_feature_points(view), "feature points".to_owned()),
        (truth.clone(), "target".to_owned()),
        (draw(Solver::Rbf, whole, 1.0, &motion)?, "radial basis functions".to_owned()),
        (draw(Solver::Ga, whole, 1.0, &motion)?, "genetic algorithm".to_owned()),
    ]]);
    let mut plates = vec![Plate::new(
        "zl_fig3b",
        "ZL, Fig. 3b and 6",
        format!(
            "What interpolation by radial basis functions makes of the feature points' motion, beside the target and the genetic algorithm's answer; {who}."
        ),
        interpolation,
    )];

    let basis = FpBasis::new(bank);
    if let Some(goal) = Goal::new(&basis, &motion, |_| true) {
        let run = evolve(&goal, &ga, 0, 0, 0);
        let curve = |name: &str, pick: fn(&grimace::internal::synthesis::Generation) -> f64| Series {
            name: name.to_owned(),
            points: run.history.iter().enumerate().map(|(g, h)| (g as f64, pick(h))).collect(),
        };
        let chart = LineChart {
            title: "One run of the genetic algorithm, line crossover".to_owned(),
            x_label: "generation".to_owned(),
            y_label: "fitness (mean cosine)".to_owned(),
            series: vec![curve("best so far", |g| g.best), curve("offspring", |g| g.offspring)],
        };
        let caption = format!(
            "Fitness of the offspring of each generation, as the paper draws it, and of the best individual so far; {who}."
        );
        plates.push(Plate::new("zl_fig6b", "ZL, Fig. 6b", caption, PlateContent::Chart(chart)));
    }

    let mut row = Vec::new();
    for c in [0.7, 1.0, 1.4] {
        row.push((draw(Solver::Ga, whole, c, &motion)?, format!("c = {c}")));
    }
    plates.push(Plate::new("zl_fig7", "ZL, Fig. 7", format!("The emphasis level c; {who}."), sheet(vec![row])));

    for (name, what, scheme) in
        [("zl_fig8", "ZL, Fig. 8", RegionScheme::Halves), ("zl_fig11", "ZL, Fig. 11", RegionScheme::Quarters)]
    {
        let regions = Regions::new(bank, scheme, OVERLAP)?;
        let caption = format!("The face in {} regions, mixed in colour where they overlap.", regions.count());
        plates.push(Plate::new(name, what, caption, PlateContent::Picture(coloured(bank, &regions))));
    }
    plates.push(overlap_plate(bank)?);
    plates.push(asymmetric_plate(bank, &targets, &scene, view, &ga)?);

    let study = SynthesisStudy {
        bank,
        targets: targets.clone(),
        region_targets: targets.len(),
        runs: options.runs,
        crossovers: vec![Crossover::Blx { alpha: 0.2 }, Crossover::Midpoint, Crossover::Line],
        ga,
        overlap: OVERLAP,
        bound_starts: 0,
    };
    let rows = evaluate_crossovers(&study, go_on)?;
    let caption = format!(
        "Mean over {} targets of the mean best fitness of {} runs, and its standard deviation over runs, beside the paper's; bank of {} \
         expressions, the targets not among them.",
        targets.len(),
        options.runs,
        bank.member_count()
    );
    plates.push(Plate::new("zl_table1", "ZL, Table 1", caption, PlateContent::Table(crossover_table(&rows))));
    plates.push(regions_plate(&study, go_on)?);
    Ok(plates)
}

fn solve_with(solver: Solver, regions: RegionScheme, emphasis: f64, ga: &GaOptions) -> SynthesisOptions {
    SynthesisOptions { solver, regions, emphasis, ga: *ga, bound_starts: 0, ..SynthesisOptions::default() }
}

/// Fitness by number of regions, next to the .960, .972 and .981 of the paper; all rows use the same targets.
fn regions_plate(study: &SynthesisStudy<'_>, go_on: &(impl Fn() -> bool + Sync)) -> Result<Plate, EvaluateError> {
    let mut table = Table::new(["regions", "targets", "fitness", "ZL fitness"]);
    for (scheme, published) in [(RegionScheme::Whole, 0.960), (RegionScheme::Halves, 0.972), (RegionScheme::Quarters, 0.981)] {
        let synthesizer = Synthesizer::new(study.bank, solve_with(Solver::Ga, scheme, 1.0, &study.ga))?;
        let mut sum = 0.0;
        for (frame, target) in study.targets.iter().enumerate() {
            if !go_on() {
                return Err(EvaluateError::Interrupted);
            }
            let answer = synthesizer.solve(&FpMotion::of_surface(study.bank, target.truth), frame);
            sum += answer.mean_region_fitness().unwrap_or(0.0);
        }
        let count = study.targets.len();
        table.rows.push(vec![
            Cell::Count(scheme.names().len()),
            Cell::Count(count),
            Cell::Number(sum / count.max(1) as f64, 4),
            Cell::Number(published, 3),
        ]);
    }
    let caption = "Mean best fitness of the genetic algorithm (line crossover) with the whole face, two and four regions, on the same \
                   targets in every row; the paper's figures beside it are of 10 targets of its own.";
    Ok(Plate::new("zl_regions", "ZL, section 5, regions", caption, PlateContent::Table(table)))
}

/// Figure 9: the shares of both halves across the middle of the face.
fn overlap_plate(bank: &Bank) -> Result<Plate, EvaluateError> {
    let regions = Regions::new(bank, RegionScheme::Halves, OVERLAP)?;
    let [low, high] = bank.mesh().bounds();
    let width = f64::from(high[0] - low[0]);
    let share = |region: usize| {
        let places = bank.mesh().positions().iter().zip(regions.vertex_shares(region));
        let mut points: Vec<(f64, f64)> =
            places.map(|(p, s)| (100.0 * f64::from(p[0] - low[0]) / width, f64::from(*s))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        // One point for each percent is enough for a line.
        points.dedup_by_key(|p| p.0.round() as i64);
        points
    };
    let names = RegionScheme::Halves.names();
    let chart = LineChart {
        title: "Shares of the two halves".to_owned(),
        x_label: "place across the face, percent of its width, from its right to its left".to_owned(),
        y_label: "share of the region's motion".to_owned(),
        series: (0..2).map(|r| Series { name: names[r].to_owned(), points: share(r) }).collect(),
    };
    let caption = format!(
        "How the motions of the two halves are mixed: by the distance to the border over the width D of the overlap, here {OVERLAP} of \
         the face."
    );
    Ok(Plate::new("zl_fig9", "ZL, Fig. 9", caption, PlateContent::Chart(chart)))
}

/// Figure 10: one expression on the right half and another on the left.
fn asymmetric_plate(
    bank: &Bank,
    targets: &[SynthesisTarget<'_>],
    scene: &FaceScene<'_>,
    view: View,
    ga: &GaOptions,
) -> Result<Plate, EvaluateError> {
    let synthesizer = Synthesizer::new(bank, solve_with(Solver::Ga, RegionScheme::Halves, 1.0, ga))?;
    let middle = {
        let [low, high] = bank.mesh().bounds();
        f32::midpoint(low[0], high[0])
    };
    let mut row = Vec::new();
    for pair in targets.windows(2).step_by(2).take(3) {
        let [a, b] = [&pair[0], &pair[1]];
        let (right, left) = (FpMotion::of_surface(bank, a.truth), FpMotion::of_surface(bank, b.truth));
        let of_point = |(k, p): (usize, &grimace::internal::synthesis::FeaturePointVertex)| {
            let is_left = bank.mesh().positions()[p.vertex as usize][0] > middle;
            if is_left { left.offsets[k] } else { right.offsets[k] }
        };
        let offsets = bank.feature_points().iter().enumerate().map(of_point).collect();
        let motion = FpMotion { offsets, planar: false, ..FpMotion::default() };
        let answer = synthesizer.solve(&motion, 0);
        row.push((scene.draw(&synthesizer.surface(&answer, &motion), view), format!("{} | {}", a.name, b.name)));
    }
    let caption = "Asymmetric expressions: the feature points of the right half move as in one expression, those of the left as in \
                   another; two regions, a search each.";
    Ok(Plate::new("zl_fig10", "ZL, Fig. 10", caption, sheet(vec![row])))
}

/// Draws the neutral face from the front, each triangle in the mixture of its regions' colours.
fn coloured(bank: &Bank, regions: &Regions) -> RgbImage {
    const COLOURS: [[f32; 3]; 4] = [[0.05, 0.30, 0.60], [0.75, 0.25, 0.02], [0.02, 0.42, 0.25], [0.60, 0.22, 0.42]];
    let mesh = bank.mesh();
    let [low, high] = mesh.bounds();
    let middle = [f32::midpoint(low[0], high[0]), f32::midpoint(low[1], high[1])];
    let scale = 0.9 * SIDE as f32 / (high[0] - low[0]).max(high[1] - low[1]);
    let half = SIDE as f32 / 2.0;
    let normals = grimace::internal::mesh::vertex_normals(mesh.positions(), mesh.triangles());
    let corner = |v: u32| {
        let (p, normal) = (mesh.positions()[v as usize], normals[v as usize]);
        Vertex { at: [half + (p[0] - middle[0]) * scale, half - (p[1] - middle[1]) * scale, p[2] * scale], normal, model: p }
    };
    let mut canvas = Canvas::new(SIDE, SIDE);
    for triangle in mesh.triangles() {
        let mut colour = [0.0f32; 3];
        for (region, base) in COLOURS.iter().enumerate().take(regions.count()) {
            let shares = regions.vertex_shares(region);
            let share: f32 = triangle.iter().map(|&v| shares[v as usize]).sum::<f32>() / 3.0;
            // A light from the front makes the shape visible.
            let light = 0.35 + 0.65 * triangle.iter().map(|&v| normals[v as usize][2].max(0.0)).sum::<f32>() / 3.0;
            colour.iter_mut().zip(base).for_each(|(c, b)| *c += share * b * light);
        }
        canvas.triangle(triangle.map(corner), Shade::Flat(colour));
    }
    canvas.picture()
}
