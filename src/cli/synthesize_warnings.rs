//! What `synthesize` warns of: what a bank cannot show of a motion, and what to do then.

use std::path::Path;

use grimace::{
    output::{count, listed},
    synthesis::{
        EmbeddedBank, FpMotion, FrameAnswer, HeldBack, Motion, MotionKind, RegionScheme, Signs, Solver, Synthesizer, Unshown,
    },
};

use super::shared::are;

/// Mean fitness below which a person should be told that the bank does not have the expression.
const POOR_FITNESS: f64 = 0.5;

/// Warns of FAPs that the bank cannot show.
///
/// # Errors
/// For a FAP file of which nothing at all can be shown.
pub fn warn_of_not_shown(path: &Path, motion: &Motion) -> anyhow::Result<()> {
    if motion.not_shown.is_empty() {
        return Ok(());
    }
    let faps = motion.not_shown.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let why = "turns of head and eyes, depth, tongue, ears, visemes, expressions, feature points that it lacks";
    anyhow::ensure!(
        !motion.is_still(),
        "{}: FAP {faps} cannot be shown by this bank ({why}), and nothing else moves; give a motion of other FAPs",
        path.display()
    );
    eprintln!(
        "warning: {}: FAP {faps} cannot be shown by this bank ({why}) and {} left out",
        path.display(),
        are(motion.not_shown.len())
    );
    Ok(())
}

/// Says that a motion has frames that its file does not have.
pub fn note_frames_between(path: &Path, motion: &Motion) {
    if let Some(found) = motion.uneven {
        eprintln!(
            "note: {}: {} in the file, shown as {} that are evenly apart: some are missing by their numbers, or have times of their own",
            path.display(),
            count(found, "frame", "frames"),
            motion.frames.len()
        );
    }
}

/// Says that frames are shown at another rate than their own.
pub fn note_other_rate(path: &Path, kind: MotionKind, own: Option<f64>, fps: f64) {
    let Some(own) = own.filter(|own| (fps / own - 1.0).abs() > 1e-9) else { return };
    let (faster, how) = if fps > own { (fps / own, "fast") } else { (own / fps, "slow") };
    let to_do = if kind == MotionKind::Fap {
        format!("; `grimace fap convert --fps {fps}` makes a file that lasts as long")
    } else {
        String::new()
    };
    eprintln!(
        "note: {}: {own} frames per second shown at {fps}: it plays {faster:.3} times as {how}, every frame as it is{to_do}",
        path.display()
    );
}

/// Warns of what the bank does not show of a motion.
pub fn warn_of_answers(path: &Path, bank: &Path, synthesizer: &Synthesizer<'_>, motions: &[FpMotion], answers: &[FrameAnswer]) {
    let path = path.display();
    let fitness: Vec<f64> = answers.iter().filter_map(|a| a.fitness).collect();
    let fitness = if fitness.is_empty() { 1.0 } else { fitness.iter().sum::<f64>() / fitness.len() as f64 };
    let unshown = synthesizer.unshown(answers);
    let held = synthesizer.held_back(answers, motions);
    if let Some(unshown) = &unshown {
        eprintln!("warning: {path}: {}. {}", nothing_shown(unshown), advice(bank, synthesizer));
    } else if fitness < POOR_FITNESS {
        eprintln!(
            "warning: {path}: the bank shows nothing like this motion (mean fitness {fitness:.2}; 1 is the best). {}",
            advice(bank, synthesizer)
        );
    }
    if let Some(HeldBack { point, frame, moved, asked, shown }) = held {
        let sides = match synthesizer.regions().scheme() {
            RegionScheme::Whole => " For one side of the face alone: --regions 2.",
            RegionScheme::Halves | RegionScheme::Quarters => "",
        };
        let advised =
            if unshown.is_some() || fitness < POOR_FITNESS { String::new() } else { format!(" {}", advice(bank, synthesizer)) };
        eprintln!(
            "warning: {path}: the bank moves points that should rest along with those that should move, so only {:.0} % of the motion is shown: in \
             frame {frame} feature point {point} goes {moved:.3} {} instead of resting, where the farthest motion asked for is {asked:.3}.{sides}{advised}",
            100.0 * shown,
            synthesizer.bank().info().unit,
        );
    }
    if let Some(folded) = synthesizer.folded(answers, motions) {
        eprintln!(
            "warning: {path}: the surface folds from frame {} on, and in frame {} {} of its {} triangles are turned over: the motion goes further \
             than the bank can; choose a smaller --emphasis than {}",
            folded.first,
            folded.worst,
            folded.turned,
            folded.of,
            synthesizer.options().emphasis
        );
    }
}

/// What rests, and in how many frames.
pub fn nothing_shown(Unshown { regions, frames, moving }: &Unshown) -> String {
    let what = match regions.as_slice() {
        ["whole"] => "the face rests".to_owned(),
        [one] => format!("the region {one} rests"),
        several => {
            format!("of the regions {} one or more rest", listed(&several.iter().map(ToString::to_string).collect::<Vec<_>>(), 4))
        }
    };
    let frames = match (*frames, *moving) {
        (_, 1) => "the one frame that moves".to_owned(),
        (all, moving) if all == moving => format!("all {all} frames that move"),
        (some, moving) => format!("{some} of the {moving} frames that move"),
    };
    format!("no mixture of the bank's members moves the feature points that way (fitness 0), so {what} in {frames}")
}

/// What helps where a bank does not show a motion.
fn advice(bank: &Path, synthesizer: &Synthesizer<'_>) -> String {
    let options = synthesizer.options();
    let climbs = matches!(options.solver, Solver::Refined | Solver::Cosine);
    let subtracts = options.signs == Signs::Any;
    let mut advice = match EmbeddedBank::of_path(bank) {
        Some(EmbeddedBank::Head) => "The shapes of `head` move each side by itself, and the jaw and the mouth sideways: list those that are needed \
             in W.csv (member,shape,weight: a row jawLeft,jawLeft,1), then `grimace bank mix head --weights W.csv -o own.bank`, and --bank \
             own.bank"
            .to_owned(),
        Some(EmbeddedBank::Candide) => "The bank `head` has more movements: --bank head".to_owned(),
        None if synthesizer.bank().info().composition.is_some() => "Mix a bank with a member of these points alone: a further row of the \
             weights that `grimace bank mix` reads"
            .to_owned(),
        None => "Build a bank with a member that moves these points alone (`grimace bank build`)".to_owned(),
    };
    if climbs && !subtracts {
        advice += "; or allow members to be subtracted, --weights any";
    }
    advice
}
