//! Marks that somebody gave, held against the face that is read in the picture: of another frame, of another size, or beside a feature.

use image::GrayImage;
use nalgebra::{Point2, Vector2};

use crate::{
    fit::{Correspondence, FittedWireframe, MEDIAN_OVER_DEVIATION},
    locate::{LocatedFace, LocatedPoint, Locator, PUPILS},
    robust::median,
    units::NodeId,
    wireframe::mark_deviation,
};

/// A part of the face that is held against the picture by itself.
#[derive(Debug)]
struct Part {
    name: &'static str,
    nodes: &'static [u16],
    /// Distance, over the eye distance, up to which nothing is said: above the largest one of good marks, landmarks of networks among them,
    /// which set brows along the upper edge and the chin higher than people do.
    limit: f64,
}

/// All parts; left and right are the subject's own.
const PARTS: [Part; 9] = [
    Part { name: "left brow", nodes: &[15, 16, 17], limit: 0.22 },
    Part { name: "right brow", nodes: &[48, 49, 50], limit: 0.22 },
    Part { name: "left eye", nodes: &[20, 21, 22, 23, 97, 99, 105, 107], limit: 0.13 },
    Part { name: "right eye", nodes: &[53, 54, 55, 56, 98, 100, 106, 108], limit: 0.13 },
    Part { name: "nose", nodes: &[5, 6, 26, 59, 111, 112], limit: 0.13 },
    Part { name: "left mouth corner", nodes: &[31], limit: 0.2 },
    Part { name: "right mouth corner", nodes: &[64], limit: 0.2 },
    Part { name: "lips", nodes: &[7, 8, 33, 40, 66, 79, 80, 81, 82, 83, 84, 85, 86, 87], limit: 0.14 },
    Part { name: "chin", nodes: &[10], limit: 0.35 },
];

/// Deviation of a mark at a feature that nobody says how well it is marked, in x and in y, over the eye distance.
const OTHER_DEVIATION: f64 = 0.03;

/// Marks further from the nearest face than this, over its eye distance, may be those of another one that was not found.
const ELSEWHERE: f64 = 0.5;

/// All limits grow where the face is read less surely than strangers' photographs are: by as much again for every so much of its median expected
/// error, over the eye distance, beyond the first number. 24 strangers' photographs, small, dark, noisy or smiling, were read with 0.021 at most;
/// rendered faces are read with 0.024 and more, and the corners of their mouths elsewhere than they were painted.
const UNSURE: (f64, f64) = (0.021, 0.01);

/// Marks lie beside the face where half of the parts are further from where they are read than this, over the eye distance, all in one
/// direction, and further than [`WHOLE_FACTOR`] times what is to be expected;
const WHOLE: f64 = 0.065;
/// the eyes, which are read best and of which no open mouth takes any, further than this;
const EYES_TOO: f64 = 0.045;
/// or where half of the parts are further off than this, in whatever direction.
const ANY_WAY: f64 = 0.12;
/// See [`WHOLE`].
const WHOLE_FACTOR: f64 = 1.7;
/// They are those of a face of another size where its logarithm differs by more than this.
const SIZE: f64 = 0.12;
/// A part lies beside its feature where it is further off than its limit, and than this many times what is to be expected;
const PART_FACTOR: f64 = 3.5;
/// one that is not marked, but fitted, also further than this, over the eye distance.
const FITTED: f64 = 0.14;
/// What two parts say together is surer than what one says. Both brows lie beside theirs where they are nearer to the eyes than they are read by
/// more than this on the mean, over the eye distance;
const BROWS_LOW: f64 = 0.11;
/// both mouth corners where they are further out, or further in, by more than this on the mean, and by more than [`PAIR_FACTOR`] times what is to
/// be expected of one; each by half of that at least.
const CORNERS_OUT: f64 = 0.1;
/// See [`CORNERS_OUT`].
const PAIR_FACTOR: f64 = 3.2;
/// Names of the brows.
const BROWS: [&str; 2] = ["left brow", "right brow"];
/// Names of the eyes.
const EYES: [&str; 2] = ["left eye", "right eye"];
/// Names of the mouth corners.
const CORNERS: [&str; 2] = ["left mouth corner", "right mouth corner"];

/// A part of a face as it was given, against where it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldPart {
    /// Its name.
    pub name: &'static str,
    /// Whether it is marked; if not, its fitted nodes are compared.
    pub marked: bool,
    /// From where it is read to where it was given, over the eye distance: the mean of its nodes.
    pub offset: Vector2<f64>,
    /// What both expect of that: root of the sum of the squared mean expected errors, over the eye distance.
    pub expected: f64,
    /// Up to which distance nothing is said, over the eye distance.
    pub limit: f64,
}

impl HeldPart {
    fn is_beside(&self) -> bool {
        self.offset.norm() > self.limit
    }
}

/// Marks and nodes, held against the face that is read in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// Distance of the pupils that are read, px.
    pub eye_distance: f64,
    /// The parts that both know.
    pub parts: Vec<HeldPart>,
    /// Size of the given face over that of the one that is read.
    pub size: f64,
    /// What limits are multiplied by, 1 or more: see [`UNSURE`].
    pub doubt: f64,
    /// From the right eye to the left one, a unit vector of the picture: the subject's left is on its right.
    pub across: Vector2<f64>,
}

/// What the marked parts of a face say together, over the eye distance.
struct Whole {
    /// How far they lie beside it in one direction,
    together: f64,
    /// and in whatever direction.
    any_way: f64,
    /// What is to be expected of that.
    expected: f64,
    /// How far the eyes do, where they are marked.
    eyes: Option<f64>,
}

impl Held {
    /// What a person should know, a sentence each; empty where all is as expected.
    pub fn said(&self) -> Vec<String> {
        let whole = self.whole_beside();
        if !whole.is_empty() {
            return whole;
        }
        let (brows, corners) = (self.brows_low(), self.corners_out());
        let is_said = |part: &&HeldPart| {
            let in_pair = |pair: &Option<String>, names: [&str; 2]| pair.is_some() && names.contains(&part.name);
            !in_pair(&brows, BROWS) && !in_pair(&corners, CORNERS)
        };
        let off = |marked: bool| -> Vec<&HeldPart> {
            self.parts.iter().filter(|part| part.marked == marked && part.is_beside()).filter(is_said).collect()
        };
        let (marked, fitted) = (off(true), off(false));
        let listed = |parts: &[&HeldPart]| {
            parts.iter().map(|p| format!("{} {}", p.name, self.far(p.offset.norm()))).collect::<Vec<_>>().join(", ")
        };
        let marked = (!marked.is_empty())
            .then(|| format!("some marks do not lie on their features in the picture: {}; check them", listed(&marked)));
        let of_marks: Vec<String> = brows.into_iter().chain(corners).chain(marked).collect();
        // Nodes that no mark holds follow the others: where these are wrong, they are the ones to set.
        let alone = of_marks.is_empty() && !fitted.is_empty();
        let fitted = alone.then(|| {
            format!(
                "these features have no marks, and their fitted nodes do not lie on them in the picture: {}; mark them",
                listed(&fitted)
            )
        });
        of_marks.into_iter().chain(fitted).collect()
    }

    /// That the marks are not those of this face.
    fn whole_beside(&self) -> Vec<String> {
        let Whole { together, any_way, .. } = self.whole();
        let is_beside = self.whole_share() > 1.0;
        let is_resized = self.size_share() > 1.0;
        let far = self.far(together.max(any_way));
        match (is_beside, is_resized) {
            (false, false) => Vec::new(),
            (true, false) => {
                vec![format!(
                    "the marks lie {far} from the face found in the picture; check that they belong to this frame and this person"
                )]
            }
            (true, true) => vec![format!(
                "the marks lie {far} from the face found in the picture and fit a face {:.2} times as large; check that they belong to a \
                 picture of this size",
                self.size
            )],
            (false, true) => vec![format!(
                "the marks fit a face {:.2} times as large as the face found in the picture; check that they belong to this frame",
                self.size
            )],
        }
    }

    /// How well marks and picture agree: 1 where they are at one, 0 and less where something is to be said.
    pub fn agreement(&self) -> f64 {
        let parts = self.parts.iter().map(|p| p.offset.norm() / p.limit);
        let pairs = [self.brows_share(), self.corners_share()].into_iter().flatten();
        let all = parts.chain(pairs).chain([self.whole_share(), self.size_share()]);
        1.0 - all.fold(0.0, f64::max)
    }

    /// What the marked parts say together.
    fn whole(&self) -> Whole {
        let marked: Vec<&HeldPart> = self.parts.iter().filter(|p| p.marked).collect();
        let middle = |of: &dyn Fn(&HeldPart) -> f64| median(&mut marked.iter().map(|p| of(p)).collect::<Vec<_>>()).unwrap_or(0.0);
        let eyes: Vec<_> = marked.iter().filter(|p| EYES.contains(&p.name)).map(|p| p.offset).collect();
        Whole {
            together: Vector2::new(middle(&|p| p.offset.x), middle(&|p| p.offset.y)).norm(),
            any_way: middle(&|p| p.offset.norm()),
            expected: WHOLE_FACTOR * middle(&|p| p.expected),
            eyes: (!eyes.is_empty()).then(|| eyes.iter().sum::<Vector2<f64>>().norm() / eyes.len() as f64),
        }
    }

    /// How far all marks lie beside the face, over what is to be said.
    fn whole_share(&self) -> f64 {
        let Whole { together, any_way, expected, eyes } = self.whole();
        let eyes = eyes.map_or(f64::INFINITY, |eyes| eyes / EYES_TOO);
        (together / expected.max(WHOLE * self.doubt)).min(eyes).max(any_way / expected.max(ANY_WAY * self.doubt))
    }

    /// How much larger or smaller their face is, over what is to be said.
    fn size_share(&self) -> f64 {
        self.size.ln().abs() / (SIZE * self.doubt)
    }

    /// How much nearer to the eyes both brows are marked, over what is to be said.
    fn brows_share(&self) -> Option<f64> {
        Some(self.low()? / (BROWS_LOW * self.doubt))
    }

    /// How far both mouth corners are marked out or in, over what is to be said.
    fn corners_share(&self) -> Option<f64> {
        let [left, right, limit] = self.out()?;
        let least = left.min(right).max((-left).min(-right)).max(0.0);
        // One of them alone says half as much.
        Some((f64::midpoint(left, right).abs() / limit).min(2.0 * least / limit))
    }

    /// How far the brows lie below where they are read, over the eye distance.
    fn low(&self) -> Option<f64> {
        let down = Vector2::new(-self.across.y, self.across.x);
        let low = self.pair(BROWS)?.map(|part| part.offset.dot(&down));
        Some(f64::midpoint(low[0], low[1]))
    }

    /// How far out the left and the right mouth corner are marked, over the eye distance, and up to where nothing is said.
    fn out(&self) -> Option<[f64; 3]> {
        let corners = self.pair(CORNERS)?;
        let [left, right] = corners.map(|part| part.offset.dot(&self.across));
        let expected = f64::midpoint(corners[0].expected, corners[1].expected);
        Some([left, -right, (CORNERS_OUT * self.doubt).max(PAIR_FACTOR * expected)])
    }

    /// That both brows are marked nearer to the eyes than they are.
    fn brows_low(&self) -> Option<String> {
        let low = self.low()?;
        (self.brows_share()? > 1.0).then(|| {
            let far = self.far(low);
            format!("the brow marks lie {far} nearer to the eyes than the brows in the picture; check that they do not lie on the lids")
        })
    }

    /// That both mouth corners are marked further out, or further in, than they are.
    fn corners_out(&self) -> Option<String> {
        let [left, right, _] = self.out()?;
        let out = f64::midpoint(left, right);
        (self.corners_share()? > 1.0).then(|| {
            let (far, way) = (self.far(out.abs()), if out > 0.0 { "out" } else { "in" });
            format!("both marks of the mouth corners lie {far} further {way} than the corners in the picture; check them")
        })
    }

    /// Two parts that are both marked.
    fn pair(&self, names: [&str; 2]) -> Option<[&HeldPart; 2]> {
        let of = |name: &str| self.parts.iter().find(|p| p.name == name && p.marked);
        Some([of(names[0])?, of(names[1])?])
    }

    /// A distance in words, from one over the eye distance.
    fn far(&self, distance: f64) -> String {
        format!("{:.0} px ({distance:.2} of the eye distance)", distance * self.eye_distance)
    }
}

/// Holds marks, and the nodes fitted to them, against a face.
pub fn held(face: &LocatedFace, marks: &[Correspondence], fitted: &FittedWireframe) -> Held {
    let unit = face.eye_distance.max(f64::MIN_POSITIVE);
    let doubt = 1.0 + (face.expected_error() - UNSURE.0).max(0.0) / UNSURE.1;
    let expected = fitted.expected_errors();
    // From where a node is read to where it was given, and what both expect, px.
    let of_mark = |node: NodeId| {
        let mark = marks.iter().find(|m| m.node == node)?;
        let by_hand = || MEDIAN_OVER_DEVIATION * mark_deviation(node).unwrap_or(OTHER_DEVIATION) * unit;
        Some((mark.position, mark.expected_error.unwrap_or_else(by_hand)))
    };
    let of_fit = |node: NodeId| Some((*fitted.model.nodes().get(node.index())?, *expected.as_ref()?.get(node.index())?));
    let mut parts = Vec::new();
    for part in &PARTS {
        let points = || face.points.iter().filter(|p| part.nodes.contains(&p.node.0));
        let marked = points().any(|p| of_mark(p.node).is_some());
        let given = |p: &LocatedPoint| {
            let (at, error) = if marked { of_mark(p.node) } else { of_fit(p.node) }?;
            Some((at - p.position, error, p.expected_error))
        };
        let pairs: Vec<_> = points().filter_map(given).collect();
        if pairs.is_empty() {
            continue;
        }
        let mean = |of: fn(&(Vector2<f64>, f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / pairs.len() as f64 / unit;
        let expected = mean(|p| p.1).hypot(mean(|p| p.2));
        let least = if marked { part.limit } else { part.limit.max(FITTED) };
        parts.push(HeldPart {
            name: part.name,
            marked,
            offset: Vector2::new(mean(|p| p.0.x), mean(|p| p.0.y)),
            expected,
            limit: (least * doubt).max(PART_FACTOR * expected),
        });
    }
    let pairs: Vec<(Point2<f64>, Point2<f64>)> =
        common(face, marks).map(|(mark, point)| (mark.position, point.position)).collect();
    let [left, right] = PUPILS.map(|k| face.shape.get(k).copied().unwrap_or_default());
    let across = (left - right).try_normalize(0.0).unwrap_or_else(Vector2::x);
    Held { eye_distance: face.eye_distance, parts, size: size(&pairs), doubt, across }
}

/// Marks, each with the point of a face that it is to be.
fn common<'a>(
    face: &'a LocatedFace,
    marks: &'a [Correspondence],
) -> impl Iterator<Item = (&'a Correspondence, &'a LocatedPoint)> {
    marks.iter().filter_map(|mark| Some((mark, face.points.iter().find(|p| p.node == mark.node)?)))
}

/// How much further apart the first of each two points are than the second, the median over all pairs; 1 where there is no pair.
fn size(pairs: &[(Point2<f64>, Point2<f64>)]) -> f64 {
    let mut ratios = Vec::new();
    for (k, (given, read)) in pairs.iter().enumerate() {
        for (other_given, other_read) in &pairs[..k] {
            let ratio = (given - other_given).norm() / (read - other_read).norm();
            ratios.extend(ratio.is_finite().then_some(ratio));
        }
    }
    median(&mut ratios).unwrap_or(1.0)
}

/// How far apart marks and the points of a face are, px; the mean.
fn apart(face: &LocatedFace, marks: &[Correspondence]) -> f64 {
    let apart: Vec<f64> = common(face, marks).map(|(mark, point)| (mark.position - point.position).norm()).collect();
    apart.iter().sum::<f64>() / apart.len().max(1) as f64
}

/// The face that marks are to be held against: what is read at their own place, where they agree with that; else of the faces that are found
/// in the picture the nearest one, or what is read at their place where none is near. To find all faces takes some times as long as to read one.
pub fn face_of_marks(
    (locator, image): (&Locator, &GrayImage),
    marks: &[Correspondence],
    fitted: &FittedWireframe,
    find: impl FnOnce() -> Vec<LocatedFace>,
) -> Option<LocatedFace> {
    let places: Vec<_> = marks.iter().map(|mark| (mark.node, mark.position)).collect();
    let here = locator.read_near(image, &places);
    if here.as_ref().is_some_and(|face| face.trusted() && held(face, marks, fitted).said().is_empty()) {
        return here;
    }
    let nearest = find().into_iter().min_by(|a, b| apart(a, marks).total_cmp(&apart(b, marks)));
    let is_near = nearest.as_ref().is_some_and(|face| apart(face, marks) < ELSEWHERE * face.eye_distance);
    if is_near { nearest } else { here.or(nearest) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        fit::{FitOptions, Fitter},
        locate::points,
        wireframe::Wireframe,
    };

    /// Candide's nodes, 100 px between the pupils, the middle of the pupils at about (200, 200).
    fn place(wireframe: &Wireframe, node: NodeId) -> Point2<f64> {
        let p = wireframe.frontal()[node.index()];
        Point2::new(200.0 + p.x * 100.0 / 0.613, 200.0 - p.y * 100.0 / 0.613)
    }

    /// A face that is read where Candide's nodes are, each point expected to be 2 px off.
    fn read(wireframe: &Wireframe) -> LocatedFace {
        let known = points().iter().filter_map(|p| p.node);
        let found: Vec<LocatedPoint> =
            known.map(|node| LocatedPoint { node, position: place(wireframe, node), expected_error: 2.0 }).collect();
        let mut shape = vec![Point2::origin(); points().len()];
        (shape[PUPILS[0]], shape[PUPILS[1]]) = (Point2::new(250.0, 180.0), Point2::new(150.0, 180.0));
        let expected_errors = vec![2.0; shape.len()];
        LocatedFace { points: found, shape, expected_errors, eye_distance: 100.0, score: 1.0, covered: Vec::new() }
    }

    /// What is said of marks at these nodes, moved.
    fn said(nodes: &[u16], moved: impl Fn(u16, Point2<f64>) -> Point2<f64>) -> Vec<String> {
        let wireframe = Wireframe::candide3();
        let mark = |&n: &u16| Correspondence::found(NodeId(n), moved(n, place(&wireframe, NodeId(n))), 2.0);
        let marks: Vec<_> = nodes.iter().map(mark).collect();
        let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks).unwrap();
        held(&read(&wireframe), &marks, &fitted).said()
    }

    const ELEVEN: [u16; 11] = [20, 23, 53, 56, 31, 64, 10, 15, 17, 48, 50];

    #[test]
    fn of_marks_on_their_places_nothing_is_said() {
        assert_eq!(said(&ELEVEN, |_, p| p), Vec::<String>::new());
        // 6 px of 100 are within what the check leaves open.
        assert_eq!(said(&ELEVEN, |_, p| p + Vector2::new(6.0, 0.0)), Vec::<String>::new());
    }

    #[test]
    fn marks_of_another_place_or_size_are_said_in_px_and_eye_distances() {
        let question = "from the face found in the picture; check that they belong to this frame and this person";
        assert_eq!(
            said(&ELEVEN, |_, p| p + Vector2::new(18.0, 24.0)),
            [format!("the marks lie 30 px (0.30 of the eye distance) {question}")]
        );
        let larger = said(&ELEVEN, |_, p| Point2::from(p.coords * 1.3));
        assert!(larger.len() == 1 && larger[0].contains("fit a face 1.30 times as large"), "{larger:?}");
        // About its own middle: nothing is far away, but all is too large.
        let middle = Vector2::new(200.0, 200.0);
        let grown = said(&ELEVEN, |_, p| Point2::from((p.coords - middle) * 1.2 + middle));
        assert!(grown.len() == 1 && grown[0].contains("1.20 times as large"), "{grown:?}");
    }

    #[test]
    fn a_part_that_lies_beside_is_named() {
        let cheek = |n: u16, p: Point2<f64>| if n == 31 { p + Vector2::new(18.0, -24.0) } else { p };
        let named = |what: &str| format!("some marks do not lie on their features in the picture: {what}; check them");
        assert_eq!(said(&ELEVEN, cheek), [named("left mouth corner 30 px (0.30 of the eye distance)")]);
        // The subject's left is on the right of the picture: out is to the right there.
        let out = |n: u16, p: Point2<f64>| {
            p + Vector2::new(
                match n {
                    31 => 14.0,
                    64 => -16.0,
                    _ => 0.0,
                },
                0.0,
            )
        };
        let corners = "both marks of the mouth corners lie 15 px (0.15 of the eye distance) further out than the corners in the picture; \
             check them";
        assert_eq!(said(&ELEVEN, out), [corners]);
        let low = |n: u16, p: Point2<f64>| if [15, 17, 48, 50].contains(&n) { p + Vector2::new(0.0, 15.0) } else { p };
        let brows = "the brow marks lie 15 px (0.15 of the eye distance) nearer to the eyes than the brows in the picture; check that \
             they do not lie on the lids";
        assert_eq!(said(&ELEVEN, low), [brows]);
        // Raised as far they may be brows along their upper edge.
        let high = |n: u16, p: Point2<f64>| if [15, 17, 48, 50].contains(&n) { p - Vector2::new(0.0, 15.0) } else { p };
        assert_eq!(said(&ELEVEN, high), Vec::<String>::new());
    }

    #[test]
    fn large_expected_errors_explain_what_small_ones_do_not() {
        let wireframe = Wireframe::candide3();
        let part = |error: f64| {
            let mark = |n: u16| Correspondence::found(NodeId(n), place(&wireframe, NodeId(n)) + Vector2::new(0.0, 20.0), error);
            let marks = [20, 53, 31, 64, 10].map(mark);
            let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks).unwrap();
            held(&read(&wireframe), &marks, &fitted).said().len()
        };
        // Root of the sum of the squares of 2 and 12 px, times 1.7: 20.7 px.
        assert_eq!((part(2.0), part(12.0)), (1, 0));
    }

    #[test]
    fn the_size_is_the_median_of_all_pairs() {
        let pair = |x: f64, read: f64| (Point2::new(x, 0.0), Point2::new(read, 0.0));
        // Distances 2, 4, 6 over 1, 2, 3; one alone says nothing.
        assert!((size(&[pair(0.0, 0.0), pair(2.0, 1.0), pair(6.0, 3.0)]) - 2.0).abs() < 1e-12);
        assert!((size(&[pair(1.0, 5.0)]) - 1.0).abs() < 1e-12);
    }
}
