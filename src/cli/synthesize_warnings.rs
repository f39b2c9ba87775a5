//! Warnings of `synthesize` about motion that a bank cannot show, with advice.

use std::path::Path;

use grimace::{
    output::{count, listed},
    synthesis::{
        EmbeddedBank, FpMotion, FrameAnswer, HeldBack, Motion, MotionKind, RegionScheme, Signs, Solver, Synthesizer, Unshown,
    },
};

use super::shared::are;

/// Mean fitness below which a warning says that the bank does not have the expression.
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
    let why = "it cannot show turns of the eyes, depth, tongue, ears, visemes, expressions, and feature points that it lacks";
    anyhow::ensure!(
        !motion.is_still(),
        "{}: FAP {faps} cannot be shown by this bank ({why}), and no other FAP moves; give a motion with other FAPs",
        path.display()
    );
    eprintln!(
        "warning: {}: FAP {faps} cannot be shown by this bank ({why}) and {} ignored",
        path.display(),
        are(motion.not_shown.len())
    );
    Ok(())
}

/// Notes where a head that turns is shown.
pub fn note_turns(path: &Path, motion: &Motion, is_glb: bool) {
    if !motion.turns() {
        return;
    }
    let place = if is_glb { "animation.glb; all other files show it upright" } else { "animation.glb alone (--format glb)" };
    eprintln!("note: {}: the head turns (FAPs 48 to 50) in {place}", path.display());
}

/// Notes that a motion has frames that its file does not have.
pub fn note_frames_between(path: &Path, motion: &Motion) {
    if let Some(found) = motion.uneven {
        eprintln!(
            "note: {}: {} in the file, shown as {} evenly spaced frames: frame numbers are missing, or frames have uneven times",
            path.display(),
            count(found, "frame", "frames"),
            motion.frames.len()
        );
    }
}

/// Notes that frames are shown at another rate than their own.
pub fn note_other_rate(path: &Path, kind: MotionKind, own: Option<f64>, fps: f64) {
    let Some(own) = own.filter(|own| (fps / own - 1.0).abs() > 1e-9) else { return };
    let (faster, how) = if fps > own { (fps / own, "fast") } else { (own / fps, "slow") };
    let to_do =
        if kind == MotionKind::Fap { format!("; `grimace fap convert --fps {fps}` keeps the duration") } else { String::new() };
    eprintln!(
        "note: {}: the motion has {own} frames per second and is shown at {fps}: it plays {faster:.3} times as {how}{to_do}",
        path.display()
    );
}

/// Warns of motion that the bank does not show.
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
            "warning: {path}: the bank cannot show this motion well (mean fitness {fitness:.2}; 1 is best). {}",
            advice(bank, synthesizer)
        );
    }
    if let Some(HeldBack { point, rests, frame, moved, asked, shown }) = &held {
        let sides = match synthesizer.regions().scheme() {
            RegionScheme::Whole if synthesizer.is_one_sided(motions) => {
                " The motion is on one side of the face: give --regions 2."
            }
            _ => "",
        };
        let (which, instead) = if *rests { ("points that should rest", "instead of resting") } else { ("other points", "too") };
        let advised =
            if unshown.is_some() || fitness < POOR_FITNESS { String::new() } else { format!(" {}", advice(bank, synthesizer)) };
        eprintln!(
            "warning: {path}: the bank also moves {which}, so only {:.0} % of the motion is shown in frame {frame}: \
             feature point {point} moves {moved:.3} {} {instead}; the largest motion required there is {asked:.3}.{sides}{advised}",
            100.0 * shown,
            synthesizer.bank().info().unit,
        );
    }
    let is_whole = synthesizer.regions().scheme() == RegionScheme::Whole;
    if held.is_none() && unshown.is_none() && is_whole && synthesizer.answers_both_sides(answers, motions) {
        eprintln!(
            "note: {path}: the motion is on one side of the face, and the bank moves both: --regions 2 moves one side alone"
        );
    }
    if let Some(folded) = synthesizer.folded(answers, motions) {
        eprintln!(
            "warning: {path}: the surface folds from frame {} on; in frame {}, {} of its {} triangles are turned over. The motion is too strong \
             for the bank: give an --emphasis below {}",
            folded.first,
            folded.worst,
            folded.turned,
            folded.of,
            synthesizer.options().emphasis
        );
    }
}

/// Message about regions and frames that rest.
pub fn nothing_shown(Unshown { regions, frames, moving }: &Unshown) -> String {
    let what = match regions.as_slice() {
        ["whole"] => "the face rests".to_owned(),
        [one] => format!("the region {one} rests"),
        several => {
            format!("one or more of the regions {} rest", listed(&several.iter().map(ToString::to_string).collect::<Vec<_>>(), 4))
        }
    };
    let frames = match (*frames, *moving) {
        (_, 1) => "the only frame with motion".to_owned(),
        (all, moving) if all == moving => format!("all {all} frames with motion"),
        (some, moving) => format!("{some} of the {moving} frames with motion"),
    };
    format!("no mixture of the bank's members moves the feature points like this (fitness 0), so {what} in {frames}")
}

/// Advice if a bank does not show a motion.
fn advice(bank: &Path, synthesizer: &Synthesizer<'_>) -> String {
    let options = synthesizer.options();
    let climbs = matches!(options.solver, Solver::Refined | Solver::Cosine);
    let subtracts = options.signs == Signs::Any;
    let mut advice = match EmbeddedBank::of_path(bank) {
        Some(EmbeddedBank::Head) => "The shapes of `head` move each side separately, and the jaw and the mouth sideways: list the needed shapes in W.csv \
             (member,shape,weight: a row jawLeft,jawLeft,1), run `grimace bank mix head --weights W.csv -o own.bank`, and give --bank own.bank"
            .to_owned(),
        Some(EmbeddedBank::Candide) => "The bank `head` has more movements: give --bank head".to_owned(),
        None if synthesizer.bank().info().composition.is_some() => "Add a member that moves only these points: a further row in the \
             weights of `grimace bank mix`"
            .to_owned(),
        None => "Build a bank with a member that moves only these points (`grimace bank build`)".to_owned(),
    };
    if climbs && !subtracts {
        advice += "; or allow negative weights: --weights any";
    }
    advice
}
