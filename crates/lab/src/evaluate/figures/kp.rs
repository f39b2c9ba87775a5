//! Figures 1, 2, 5, 6, 7 and Table 1 of [KP], made from a run over a dataset.

use std::path::Path;

use image::{DynamicImage, GrayImage, Luma, RgbImage};
use nalgebra::Point2;

use super::{Plate, PlateContent, failed, sheet};
use crate::evaluate::{Cell, EvaluateError, FitMethod, Table};
use grimace::internal::{
    clone::{Rescale, SourceMotion, Target},
    dataset::{DEFAULT_LANDMARK_NODES, Dataset, FrameSource, may_publish},
    fit::{Correspondence, FitOptions, Fitter, PriorKind},
    input::CsvFile,
    model::DynamicExpressionModel,
    overlay::draw_overlay,
    pipeline::{Workbench, read_model, showcase_target},
    sequence::{Frame, read_colour_frames},
    track::{NodeState, TrackedFrame, TrackedNode, read_track, read_track_info},
    units::{FaceUnit, NodeId},
    warp::MouthInside,
};

/// Dispersions published in [KP, Table 1]; happiness is their laughter.
pub const PUBLISHED_DISPERSIONS: [(&str, f64); 6] =
    [("anger", 11.13), ("disgust", 9.80), ("fear", 11.39), ("happiness", 10.89), ("sadness", 13.46), ("surprise", 13.57)];

/// A tracked sequence, with its frames.
struct Performance {
    subject: String,
    name: String,
    emotion: String,
    track: Vec<TrackedFrame>,
    frames: FrameSource,
    marks: Vec<Correspondence>,
}

impl Performance {
    fn picture(&self, frame: &TrackedFrame) -> Result<RgbImage, EvaluateError> {
        let failed = failed("a frame");
        let read = read_colour_frames(&self.frames, &[frame.number]).map_err(|e| failed(&e))?;
        read.into_iter().next().map(|(_, picture)| picture).ok_or_else(|| failed(&format!("frame {} is not there", frame.number)))
    }

    /// Returns the neutral and the last frame.
    fn ends(&self) -> [&TrackedFrame; 2] {
        // A track has at least two frames.
        [&self.track[0], &self.track[self.track.len() - 1]]
    }
}

/// The figures from a run over a dataset.
pub struct KpFigures<'a> {
    bench: &'a Workbench,
    run: &'a Path,
    /// Tracked sequences of people who permit publication.
    performances: Vec<Performance>,
    /// Number of tracked sequences, published or not; the representatives are made of them.
    tracked: usize,
    emotions: Vec<String>,
    /// Description of the people, for the captions.
    who: String,
}

impl<'a> KpFigures<'a> {
    /// Reads the tracks of a run over a dataset.
    ///
    /// # Errors
    /// [`EvaluateError::Figure`] when the dataset or a track cannot be read, or when there is no tracked sequence with pictures that may be
    /// published.
    pub fn new(dataset: &Path, run: &'a Path, who: &str, bench: &'a Workbench) -> Result<Self, EvaluateError> {
        let failed = failed("the figures of Krinidis and Pitas");
        let opened = Dataset::open(dataset).map_err(|e| failed(&e))?;
        let (mut performances, mut tracked) = (Vec::new(), 0);
        let mut emotions: Vec<String> = Vec::new();
        for entry in &opened.sequences {
            let path = run.join(format!("tracks/{}.csv", entry.id));
            let Ok(frames) = entry.frames() else { continue };
            if !path.is_file() {
                continue;
            }
            let track = read_track(&path).map_err(|e| failed(&e))?;
            let Some(info) = read_track_info(&path).map_err(|e| failed(&e))?.filter(|_| track.len() > 1) else { continue };
            tracked += 1;
            emotions.push(entry.emotion.clone());
            // People who do not permit publication are part of the representatives, but appear in no figure.
            if !may_publish(&entry.metadata) {
                continue;
            }
            let marks = info.marks.iter().map(|&(node, x, y, _)| Correspondence::mark(NodeId(node), Point2::new(x, y)));
            performances.push(Performance {
                subject: entry.id.subject.clone(),
                name: entry.id.to_string(),
                emotion: entry.emotion.clone(),
                track,
                frames,
                marks: default_marks(marks.collect()),
            });
        }
        if performances.is_empty() {
            return Err(failed(&"no sequence with pictures was tracked that may be shown"));
        }
        emotions.sort();
        emotions.dedup();
        Ok(Self { bench, run, performances, tracked, emotions, who: who.to_owned() })
    }

    /// Returns all figures that these sequences allow, and the reasons why others are missing.
    ///
    /// # Errors
    /// [`EvaluateError::Figure`] when a file of the run cannot be read, or a picture cannot be made.
    pub fn plates(&self) -> Result<(Vec<Plate>, Vec<String>), EvaluateError> {
        let mut plates = self.fitting()?;
        plates.push(self.tracking()?);
        plates.push(self.representatives()?);
        plates.push(self.table()?);
        let mut missing = Vec::new();
        for made in [self.cloning()?, self.mapping()?] {
            match made {
                Ok(plate) => plates.push(plate),
                Err(why) => missing.push(why),
            }
        }
        Ok((plates, missing))
    }

    fn overlay(&self, picture: &RgbImage, nodes: &[Point2<f64>], marks: &[Correspondence]) -> RgbImage {
        let frame = Frame::new(1, DynamicImage::ImageRgb8(picture.clone()).to_luma8());
        let nodes: Vec<TrackedNode> = nodes.iter().map(|&p| TrackedNode::new(p, NodeState::Fitted, None)).collect();
        let marks: Vec<Point2<f64>> = marks.iter().map(|m| m.position).collect();
        draw_overlay(&frame, &self.bench.wireframe, &nodes, &marks)
    }

    /// Draws the wireframe of one frame of a normalized model on a light background.
    fn wireframe(&self, model: &DynamicExpressionModel<FaceUnit>, frame: usize) -> RgbImage {
        const SIDE: f64 = 360.0;
        const FACE_UNITS: f64 = 3200.0;
        let nodes = model.frames()[frame].nodes();
        let place = |p: &Point2<f64>| Point2::new(SIDE * (0.5 + p.x / FACE_UNITS), SIDE * (0.5 - p.y / FACE_UNITS));
        let nodes: Vec<TrackedNode> = nodes.iter().map(|p| TrackedNode::new(place(p), NodeState::Fitted, None)).collect();
        let blank = Frame::new(1, GrayImage::from_pixel(SIDE as u32, SIDE as u32, Luma([250])));
        draw_overlay(&blank, &self.bench.wireframe, &nodes, &[])
    }

    /// Figure 1: the wireframe scaled to the marks, then deformed by the springs.
    fn fitting(&self) -> Result<Vec<Plate>, EvaluateError> {
        let failed = failed("KP Fig. 1");
        let p = &self.performances[0];
        let picture = p.picture(p.ends()[0])?;
        let wireframe = &self.bench.wireframe;
        let scaled = FitMethod::similarity(wireframe).place(wireframe, &p.marks).map_err(|e| failed(&e))?;
        let springs = Fitter::new(wireframe, FitOptions { prior: PriorKind::None, ..FitOptions::default() });
        let deformed = springs.fit(wireframe, &p.marks).map_err(|e| failed(&e))?;
        let ours = self.bench.fitter().fit(wireframe, &p.marks).map_err(|e| failed(&e))?;
        let count = p.marks.len();
        let caption =
            |what: &str| format!("{what} Neutral frame of {}, {}; {count} marks (yellow rings), nodes blue.", p.name, self.who);
        Ok(vec![
            Plate::new(
                "kp_fig1a",
                "KP, Fig. 1a",
                caption("The wireframe after the scaling, before the springs: the least-squares similarity to the marks."),
                PlateContent::Picture(self.overlay(&picture, &scaled, &p.marks)),
            ),
            Plate::new(
                "kp_fig1b",
                "KP, Fig. 1b",
                caption("The same after the deformation by the springs, without a shape prior, as the paper has it."),
                PlateContent::Picture(self.overlay(&picture, deformed.model.nodes(), &p.marks)),
            ),
            Plate::new(
                "kp_fig1b_default",
                "KP, Fig. 1b, this program's default",
                caption("The same with the default's shape prior ahead of the springs."),
                PlateContent::Picture(self.overlay(&picture, ours.model.nodes(), &p.marks)),
            ),
        ])
    }

    /// Figure 2: first and last frames with the tracked wireframe.
    fn tracking(&self) -> Result<Plate, EvaluateError> {
        const ROWS: usize = 4;
        let mut rows = Vec::new();
        for emotion in self.emotions.iter().take(ROWS) {
            let Some(p) = self.of(emotion) else { continue };
            let mut row = Vec::new();
            for (frame, when) in p.ends().into_iter().zip(["first frame", "last frame"]) {
                let nodes: Vec<Point2<f64>> = frame.nodes.iter().map(|n| n.position).collect();
                row.push((self.overlay(&p.picture(frame)?, &nodes, &[]), format!("{emotion}, {}, {when}", p.name)));
            }
            rows.push(row);
        }
        let caption = format!("The wireframe in the first frame and tracked to the last, one sequence an emotion; {}.", self.who);
        Ok(Plate::new("kp_fig2", "KP, Fig. 2", caption, sheet(rows)))
    }

    fn of(&self, emotion: &str) -> Option<&Performance> {
        self.performances.iter().find(|p| p.emotion == emotion)
    }

    fn representative(&self, emotion: &str) -> Result<DynamicExpressionModel<FaceUnit>, EvaluateError> {
        read_model(&self.run.join(format!("representatives/{emotion}.csv"))).map_err(|e| failed("a representative")(&e))
    }

    /// Draws the frame `place` of a motion on a face.
    fn on_face(&self, motion: &SourceMotion, target: &Target, place: f64) -> Result<RgbImage, EvaluateError> {
        let failed = failed("a face");
        let nodes = target.nodes_at(motion, &motion.at(place), Rescale::default(), 1.0, false, self.bench);
        let deformation = target.warp().deform(&nodes).map_err(|e| failed(&e))?;
        Ok(target.warp().render(target.texture(), &deformation, &MouthInside::Teeth))
    }

    /// Figure 5: frames 3 and 5 of every representative, as a wireframe and on a face.
    fn representatives(&self) -> Result<Plate, EvaluateError> {
        let failed = failed("KP Fig. 5");
        let target = showcase_target(self.bench).map_err(|e| failed(&e))?;
        let mut rows = Vec::new();
        for emotion in &self.emotions {
            let model = self.representative(emotion)?;
            let motion = SourceMotion::from_model(emotion, &model, self.bench).map_err(|e| failed(&e))?;
            let mut row = Vec::new();
            for frame in [2, 4] {
                row.push((self.wireframe(&model, frame), format!("{emotion}, frame {}", frame + 1)));
            }
            for frame in [2, 4] {
                row.push((self.on_face(&motion, &target, f64::from(frame))?, format!("{emotion}, frame {}", frame + 1)));
            }
            rows.push(row);
        }
        let caption = format!(
            "Frames 3 and 5 of the representative of each emotion, the generalized median after trimming at frame level: the model, and \
             on a composite portrait. Made of {} sequences; {}.",
            self.tracked, self.who
        );
        Ok(Plate::new("kp_fig5", "KP, Fig. 5", caption, sheet(rows)))
    }

    /// Table 1: dispersions next to the published ones.
    fn table(&self) -> Result<Plate, EvaluateError> {
        let failed = failed("KP Table 1");
        let csv = CsvFile::open(&self.run.join("statistics.csv")).map_err(|e| failed(&e))?;
        let names = ["emotion", "sequences", "dispersion", "dispersion_untrimmed", "dispersion_literal", "dispersion_field"];
        let columns = csv.require(names).map_err(|e| failed(&e))?;
        let mut table = Table::new(names.into_iter().chain(["published"]));
        for row in csv.rows() {
            let row = row.map_err(|e| failed(&e))?;
            let emotion = row.get(columns[0]).to_owned();
            let published = PUBLISHED_DISPERSIONS.iter().find(|(name, _)| *name == emotion).map(|p| p.1);
            let mut cells = vec![Cell::text(emotion.as_str()), Cell::text(row.get(columns[1]))];
            cells.extend(columns[2..].iter().map(|&c| Cell::maybe(row.number(c).ok(), 2)));
            cells.push(Cell::maybe(published, 2));
            table.rows.push(cells);
        }
        let caption = format!(
            "Dispersion of each emotion, eq. (8), face units (ES0 / 1024): after trimming, before, eq. (8) to the letter after \
             trimming, and by field; the last column is the paper's, of Cohn-Kanade, in units it does not state. {}.",
            self.who
        );
        Ok(Plate::new("kp_table1", "KP, Table 1", caption, PlateContent::Table(table)))
    }

    /// Makes a target from a sequence's neutral picture.
    fn target(&self, p: &Performance) -> Result<Target, EvaluateError> {
        let picture = p.picture(p.ends()[0])?;
        self.bench.target(&p.name, picture, &p.marks).map_err(|e| failed("a target")(&e))
    }

    fn motion(&self, p: &Performance) -> Result<SourceMotion, EvaluateError> {
        SourceMotion::from_track(&p.name, &p.track, &[], self.bench).map_err(|e| failed("a tracked motion")(&e))
    }

    /// Figure 6: one person's smile cloned onto two other people.
    fn cloning(&self) -> Result<Result<Plate, String>, EvaluateError> {
        let Some(source) = self.of("happiness") else {
            return Ok(Err("KP Fig. 6: the dataset has no sequence of happiness".to_owned()));
        };
        let mut others: Vec<&Performance> = Vec::new();
        for p in &self.performances {
            if p.subject != source.subject && others.iter().all(|o| o.subject != p.subject) {
                others.push(p);
            }
        }
        if others.len() < 2 {
            return Ok(Err("KP Fig. 6: this figure needs three people".to_owned()));
        }
        let motion = self.motion(source)?;
        let apex = motion.apex() as f64;
        let mut row = vec![(source.picture(source.ends()[1])?, format!("(a) {}, original", source.name))];
        for (p, letter) in others.iter().zip(["b", "c"]) {
            row.push((self.on_face(&motion, &self.target(p)?, apex)?, format!("({letter}) on {}", p.subject)));
        }
        let caption =
            format!("A smile (a), tracked, on the neutral pictures of two other people (b, c), at its apex; {}.", self.who);
        Ok(Ok(Plate::new("kp_fig6", "KP, Fig. 6", caption, sheet(vec![row]))))
    }

    /// Figure 7: a person's sadness, the same expression synthesized on the person's neutral picture, and the representative; the models
    /// below.
    fn mapping(&self) -> Result<Result<Plate, String>, EvaluateError> {
        let Some(p) = self.of("sadness") else { return Ok(Err("KP Fig. 7: the dataset has no sequence of sadness".to_owned())) };
        let failed = failed("KP Fig. 7");
        let target = self.target(p)?;
        let own = self.motion(p)?;
        let model = self.representative("sadness")?;
        let representative = SourceMotion::from_model("sadness", &model, self.bench).map_err(|e| failed(&e))?;
        let last = p.ends()[1];
        let pictures = vec![
            (p.picture(last)?, format!("(a) {}, original", p.name)),
            (self.on_face(&own, &target, own.apex() as f64)?, "(b) own expression, synthesized".to_owned()),
            (self.on_face(&representative, &target, 4.0)?, "(c) representative sadness".to_owned()),
        ];
        let own_model = read_model(&self.run.join(format!("models/{}.csv", p.name))).map_err(|e| failed(&e))?;
        let nodes: Vec<Point2<f64>> = last.nodes.iter().map(|n| n.position).collect();
        let models = vec![
            (self.overlay(&p.picture(last)?, &nodes, &[]), "tracked".to_owned()),
            (self.wireframe(&own_model, 4), "the person's normalized model".to_owned()),
            (self.wireframe(&model, 4), "the representative's model".to_owned()),
        ];
        let caption = format!(
            "Sadness of {} (a), the same expression put on the person's own neutral picture (b), and the representative's (c); below, \
             the wireframe as tracked, the person's normalized model, and the representative. {}.",
            p.name, self.who
        );
        Ok(Ok(Plate::new("kp_fig7", "KP, Fig. 7", caption, sheet(vec![pictures, models]))))
    }
}

/// Returns the default marks when at least five are set, otherwise all marks.
fn default_marks(marks: Vec<Correspondence>) -> Vec<Correspondence> {
    let chosen: Vec<Correspondence> = marks.iter().filter(|m| DEFAULT_LANDMARK_NODES.contains(&m.node)).copied().collect();
    if chosen.len() >= 5 { chosen } else { marks }
}
