//! Description of an animation, on the terminal and in synthesis.json.

use std::{collections::BTreeSet, path::Path};

use grimace::{
    input::file_blake3,
    output::{MADE_BY, count},
    synthesis::{Animation, Bank, FrameAnswer, Motion, jump},
};
use serde_json::json;

use super::synthesize::{Args, Played};

/// Version of the layout of `synthesis.json`.
const SCHEMA_VERSION: u32 = 1;

/// What an animation comes to.
pub struct Report {
    moving: usize,
    fitness: Option<f64>,
    /// Share of the motion asked for that is shown.
    shown: Option<f64>,
    region_fitness: Option<f64>,
    region_shown: Option<f64>,
    share_of_bound: Option<f64>,
    /// Root mean square of second differences over that of the motion: of the target, of the result.
    jumps: (Option<f64>, Option<f64>),
    /// Of the frames whose truth moves.
    errors: Option<(f64, f64)>,
}

impl Report {
    pub fn new(animation: &Animation<'_>, errors: Option<&[Option<f64>]>) -> Self {
        let mean = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
        let answers = animation.answers;
        let flat = |m: &grimace::synthesis::FpMotion| {
            m.offsets.iter().map(|o| o.map_or([0.0; 3], |v| [v.x, v.y, v.z])).collect::<Vec<_>>()
        };
        let known: Vec<usize> = animation.motions.first().map_or(Vec::new(), |first| {
            (0..first.offsets.len()).filter(|&k| animation.motions.iter().all(|m| m.offsets[k].is_some())).collect()
        });
        let planar = animation.motions.iter().any(|m| m.planar);
        let pick = |all: Vec<[f64; 3]>| -> Vec<[f64; 3]> {
            known.iter().map(|&k| if planar { [all[k][0], all[k][1], 0.0] } else { all[k] }).collect()
        };
        let target: Vec<_> = animation.motions.iter().map(|m| pick(flat(m))).collect();
        let result: Vec<_> = animation.synthesizer.point_motions(answers, animation.motions).into_iter().map(pick).collect();
        let errors = errors.map(|e| e.iter().flatten().copied().collect::<Vec<f64>>());
        Self {
            moving: answers.iter().filter(|a| a.fitness.is_some()).count(),
            fitness: mean(answers.iter().filter_map(|a| a.fitness).collect()),
            shown: mean(answers.iter().filter_map(|a| a.shown).collect()),
            region_fitness: mean(answers.iter().filter_map(FrameAnswer::mean_region_fitness).collect()),
            region_shown: mean(answers.iter().filter_map(FrameAnswer::mean_region_shown).collect()),
            share_of_bound: mean(answers.iter().filter_map(FrameAnswer::share_of_bound).collect()),
            jumps: (jump(&target), jump(&result)),
            errors: errors.and_then(|e| mean(e.clone()).map(|m| (m, e.into_iter().fold(0.0, f64::max)))),
        }
    }

    pub fn json(
        &self,
        args: &Args,
        played: &Played<'_>,
        animation: &Animation<'_>,
        files: &BTreeSet<String>,
    ) -> serde_json::Value {
        let (bank, motion) = (animation.synthesizer.bank(), &played.motion);
        let text = |p: &Path| p.file_name().unwrap_or(p.as_os_str()).to_string_lossy().into_owned();
        json!({
            "schema_version": SCHEMA_VERSION,
            "made_by": MADE_BY,
            "bank": {
                "file": text(&args.bank), "blake3": file_blake3(&args.bank), "unit": bank.info().unit, "credit": bank.info().credit,
                "vertices": bank.vertex_count(), "members": bank.member_count(), "feature_points": bank.feature_points().len(),
            },
            "motion": {
                "file": text(played.path), "blake3": file_blake3(played.path), "kind": motion.kind, "fps": animation.fps,
                "bank_units_per_face_unit": motion.scale, "noise": played.noise,
                "faps_not_shown": motion.not_shown.iter().map(|fap| fap.get()).collect::<Vec<_>>(),
                "ignored_feature_points": motion.ignored.iter().map(ToString::to_string).collect::<Vec<_>>(),
            },
            "portrait": args.portrait.as_ref().map(|path| json!({
                "file": text(path), "blake3": file_blake3(path),
                "correspondences": args.correspondences.as_ref().map(|path| json!({ "file": text(path), "blake3": file_blake3(path) })),
            })),
            "units": {
                "surface": "the bank's unit; displacements from neutral", "fitness": "mean cosine, -1 to 1",
                "shown": "share of the motion asked for: how far feature points go along it over how far they should, 0 or more, mean over frames",
                "surface_error": "root of summed squared distances to the truth over that of the true motion",
                "jump": "root mean square of second differences in time over that of the motion of the feature points",
            },
            "options": animation.synthesizer.options(),
            "frames": animation.answers.len(),
            "frames_that_move": self.moving,
            "fitness": self.fitness,
            "shown": self.shown,
            "region_fitness": self.region_fitness,
            "region_shown": self.region_shown,
            "share_of_bound": self.share_of_bound,
            "jump": { "target": self.jumps.0, "result": self.jumps.1 },
            "surface_error": self.errors.map(|(mean, largest)| json!({ "mean": mean, "largest": largest })),
            "files": files,
        })
    }

    pub fn print(&self, motion: &Motion, bank: &Bank, out: &Path) {
        println!(
            "{}, {} of them {}; bank of {}, {} vertices",
            count(motion.frames.len(), "frame", "frames"),
            self.moving,
            if self.moving == 1 { "moves" } else { "move" },
            count(bank.member_count(), "member", "members"),
            bank.vertex_count()
        );
        if !motion.ignored.is_empty() {
            let points: Vec<String> = motion.ignored.iter().map(ToString::to_string).collect();
            println!("feature points ignored, because the bank does not have them: {}", points.join(" "));
        }
        let Some(fitness) = self.fitness else {
            if motion.turns() {
                println!("the head turns, and the face does not move: every frame is the neutral face");
            } else {
                println!("the motion contains no movement: every frame is the neutral face");
            }
            println!("written to {}", out.display());
            return;
        };
        println!("fitness           {fitness:.4} (mean over the frames that move)");
        let regions = self.region_fitness.filter(|f| (f - fitness).abs() > 5e-5);
        if let Some(fitness) = regions {
            println!("  in the regions  {fitness:.4}");
        }
        if let Some(shown) = self.shown {
            println!("share shown       {shown:.4} (of the motion of the feature points)");
        }
        if let Some(shown) = self.region_shown.filter(|_| regions.is_some()) {
            println!("  in the regions  {shown:.4}");
        }
        match self.share_of_bound {
            Some(share) => println!("share of the bound {share:.4}"),
            None => println!("no bound to compare with"),
        }
        if let (Some(target), Some(result)) = self.jumps {
            println!("jump in time      {result:.4} (the motion itself {target:.4})");
        }
        if let Some((mean, largest)) = self.errors {
            println!("surface error     {mean:.4}, at most {largest:.4}");
        }
        println!("written to {}", out.display());
    }
}
