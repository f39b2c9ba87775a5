//! Compares given marks with the face that the locator reads in the picture.
//!
//! The comparison finds marks that belong to another frame, to a picture of another size, or that miss the feature they name. Distances are
//! fractions of the eye distance. Each part of the face has its own limit; the limits grow with the locator's expected error.

use image::GrayImage;
use nalgebra::{Point2, Vector2};

use crate::{
    fit::{Correspondence, FittedWireframe, MEDIAN_OVER_DEVIATION},
    locate::{LocatedFace, LocatedPoint, Locator, PUPILS},
    robust::median,
    units::NodeId,
    wireframe::mark_deviation,
};

/// A part of the face that is compared with the picture on its own.
#[derive(Debug)]
struct Part {
    name: &'static str,
    nodes: &'static [u16],
    /// Largest distance without a message, in eye distances. It lies above the largest distance of good marks, including those of networks,
    /// which place brows along the upper edge and the chin higher than people do.
    limit: f64,
}

/// All parts. Left and right are the subject's own.
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

/// Standard deviation in x and in y, in eye distances, of a mark at a feature without a known marking accuracy.
const OTHER_DEVIATION: f64 = 0.03;

/// Distance to the nearest detected face, in eye distances, above which the marks may belong to a face that was not detected.
const ELSEWHERE: f64 = 0.5;

/// Expected error of the face, in eye distances, above which the limits (except [`EYES_TOO`]) grow, and the excess that adds the limit once
/// again.
///
/// The locator's median expected error is at most 0.021 on 24 photographs of people outside its training data (small, dark, noisy or
/// smiling), and 0.024 and more on rendered faces, whose mouth corners it reads in other positions than they were painted.
const UNSURE: (f64, f64) = (0.021, 0.01);

/// Common displacement of half of the parts, in eye distances, above which the marks miss the face. It must also exceed [`WHOLE_FACTOR`]
/// times the expected error, and the eyes must exceed [`EYES_TOO`].
const WHOLE: f64 = 0.065;
/// Displacement of the eyes, in eye distances, that [`WHOLE`] also requires. The eyes are read most accurately, and an open mouth does not
/// affect them.
const EYES_TOO: f64 = 0.045;
/// Displacement of half of the parts in any direction, in eye distances, above which the marks miss the face.
const ANY_WAY: f64 = 0.12;
/// See [`WHOLE`].
const WHOLE_FACTOR: f64 = 1.7;
/// Absolute logarithm of the ratio of face sizes above which the marks belong to a face of another size.
const SIZE: f64 = 0.12;
/// Multiple of the expected error that the displacement of a part must exceed, besides its limit, to be reported.
const PART_FACTOR: f64 = 3.5;
/// Smallest limit of a part that has no marks but only fitted nodes, in eye distances.
const FITTED: f64 = 0.14;
/// Mean distance, in eye distances, by which both brows must be marked nearer to the eyes than they are read to be reported. Two parts that
/// agree are stronger evidence than one, so this limit is lower than theirs.
const BROWS_LOW: f64 = 0.11;
/// Mean distance, in eye distances, by which both mouth corners must be marked further out (or in) than they are read to be reported. It
/// must also exceed [`PAIR_FACTOR`] times the expected error of one corner, and each corner must reach half of it.
const CORNERS_OUT: f64 = 0.1;
/// See [`CORNERS_OUT`].
const PAIR_FACTOR: f64 = 3.2;
/// Names of the brows.
const BROWS: [&str; 2] = ["left brow", "right brow"];
/// Names of the eyes.
const EYES: [&str; 2] = ["left eye", "right eye"];
/// Names of the mouth corners.
const CORNERS: [&str; 2] = ["left mouth corner", "right mouth corner"];

/// A given part of a face compared with the same part as it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldPart {
    /// Its name.
    pub name: &'static str,
    /// Whether the part is marked. If not, its fitted nodes are compared.
    pub marked: bool,
    /// Mean displacement of its nodes, from where they are read to where they were given, in eye distances.
    pub offset: Vector2<f64>,
    /// Expected length of the displacement in eye distances: root of the sum of both squared mean expected errors.
    pub expected: f64,
    /// Largest displacement without a message, in eye distances.
    pub limit: f64,
}

impl HeldPart {
    fn is_beside(&self) -> bool {
        self.offset.norm() > self.limit
    }
}

/// Given marks and fitted nodes compared with the face that is read in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// Distance of the pupils as read, px.
    pub eye_distance: f64,
    /// The parts for which both the given and the read face have points.
    pub parts: Vec<HeldPart>,
    /// Size of the given face divided by that of the read face.
    pub size: f64,
    /// Factor on the limits, at least 1: see [`UNSURE`].
    pub doubt: f64,
    /// Unit vector in the picture from the subject's right eye (on the left of the picture) to the left eye.
    pub across: Vector2<f64>,
}

/// Displacement of all marked parts together, in eye distances.
struct Whole {
    /// Length of the common displacement: the medians of its x and y.
    together: f64,
    /// Median length of the displacements, whatever their directions.
    any_way: f64,
    /// [`WHOLE_FACTOR`] times the median expected error.
    expected: f64,
    /// Length of the mean displacement of the marked eyes; `None` without one.
    eyes: Option<f64>,
}

impl Held {
    /// Messages to the user, one sentence each; empty if marks and picture agree.
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
        // Unmarked nodes follow the marks. Only where the marks are right should the user mark these nodes, too.
        let alone = of_marks.is_empty() && !fitted.is_empty();
        let fitted = alone.then(|| {
            format!(
                "these features have no marks, and their fitted nodes do not lie on them in the picture: {}; mark them",
                listed(&fitted)
            )
        });
        of_marks.into_iter().chain(fitted).collect()
    }

    /// Messages that the marks as a whole do not fit this face.
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

    /// Agreement of marks and picture: 1 for perfect agreement, 0 or less where a message is due.
    pub fn agreement(&self) -> f64 {
        let parts = self.parts.iter().map(|p| p.offset.norm() / p.limit);
        let pairs = [self.brows_share(), self.corners_share()].into_iter().flatten();
        let all = parts.chain(pairs).chain([self.whole_share(), self.size_share()]);
        1.0 - all.fold(0.0, f64::max)
    }

    /// Displacement of the marked parts together.
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

    /// Displacement of all marks divided by its limit.
    fn whole_share(&self) -> f64 {
        let Whole { together, any_way, expected, eyes } = self.whole();
        let eyes = eyes.map_or(f64::INFINITY, |eyes| eyes / EYES_TOO);
        (together / expected.max(WHOLE * self.doubt)).min(eyes).max(any_way / expected.max(ANY_WAY * self.doubt))
    }

    /// Deviation of the size ratio from 1 divided by its limit.
    fn size_share(&self) -> f64 {
        self.size.ln().abs() / (SIZE * self.doubt)
    }

    /// Mean distance by which both brows are marked nearer to the eyes, divided by its limit.
    fn brows_share(&self) -> Option<f64> {
        Some(self.low()? / (BROWS_LOW * self.doubt))
    }

    /// Mean distance by which both mouth corners are marked further out or in, divided by its limit.
    fn corners_share(&self) -> Option<f64> {
        let [left, right, limit] = self.out()?;
        let least = left.min(right).max((-left).min(-right)).max(0.0);
        // Each corner must reach half of the limit.
        Some((f64::midpoint(left, right).abs() / limit).min(2.0 * least / limit))
    }

    /// Mean distance by which the brows are marked below where they are read, in eye distances.
    fn low(&self) -> Option<f64> {
        let down = Vector2::new(-self.across.y, self.across.x);
        let low = self.pair(BROWS)?.map(|part| part.offset.dot(&down));
        Some(f64::midpoint(low[0], low[1]))
    }

    /// Distances by which the left and the right mouth corner are marked further out than read, and their limit, in eye distances.
    fn out(&self) -> Option<[f64; 3]> {
        let corners = self.pair(CORNERS)?;
        let [left, right] = corners.map(|part| part.offset.dot(&self.across));
        let expected = f64::midpoint(corners[0].expected, corners[1].expected);
        Some([left, -right, (CORNERS_OUT * self.doubt).max(PAIR_FACTOR * expected)])
    }

    /// Message that both brows are marked too near to the eyes.
    fn brows_low(&self) -> Option<String> {
        let low = self.low()?;
        (self.brows_share()? > 1.0).then(|| {
            let far = self.far(low);
            format!("the brow marks lie {far} nearer to the eyes than the brows in the picture; check that they do not lie on the lids")
        })
    }

    /// Message that both mouth corners are marked too far out or in.
    fn corners_out(&self) -> Option<String> {
        let [left, right, _] = self.out()?;
        let out = f64::midpoint(left, right);
        (self.corners_share()? > 1.0).then(|| {
            let (far, way) = (self.far(out.abs()), if out > 0.0 { "out" } else { "in" });
            format!("both marks of the mouth corners lie {far} further {way} than the corners in the picture; check them")
        })
    }

    /// Two parts, if both are marked.
    fn pair(&self, names: [&str; 2]) -> Option<[&HeldPart; 2]> {
        let of = |name: &str| self.parts.iter().find(|p| p.name == name && p.marked);
        Some([of(names[0])?, of(names[1])?])
    }

    /// Text for a distance that is given in eye distances.
    fn far(&self, distance: f64) -> String {
        format!("{:.0} px ({distance:.2} of the eye distance)", distance * self.eye_distance)
    }
}

/// Compares marks, and the nodes fitted to them, with a face.
pub fn held(face: &LocatedFace, marks: &[Correspondence], fitted: &FittedWireframe) -> Held {
    let unit = face.eye_distance.max(f64::MIN_POSITIVE);
    let doubt = 1.0 + (face.expected_error() - UNSURE.0).max(0.0) / UNSURE.1;
    let expected = fitted.expected_errors();
    // Position of a node's mark and its expected error, px.
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

/// Marks paired with the points of a face at the same nodes.
fn common<'a>(
    face: &'a LocatedFace,
    marks: &'a [Correspondence],
) -> impl Iterator<Item = (&'a Correspondence, &'a LocatedPoint)> {
    marks.iter().filter_map(|mark| Some((mark, face.points.iter().find(|p| p.node == mark.node)?)))
}

/// Size of the first points relative to the second: the median ratio of the distances between pairs; 1 with fewer than two pairs.
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

/// Mean distance of marks from the points of a face, px.
fn apart(face: &LocatedFace, marks: &[Correspondence]) -> f64 {
    let apart: Vec<f64> = common(face, marks).map(|(mark, point)| (mark.position - point.position).norm()).collect();
    apart.iter().sum::<f64>() / apart.len().max(1) as f64
}

/// The face to compare marks with.
///
/// This is the face read at the position of the marks, if it agrees with them. Otherwise it is the nearest face detected in the picture or,
/// if none is near, the one read at the marks after all. Detecting all faces takes several times as long as reading one.
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

    /// Position of a Candide node in a face of 100 px between the pupils, whose midpoint is at about (200, 200).
    fn place(wireframe: &Wireframe, node: NodeId) -> Point2<f64> {
        let p = wireframe.frontal()[node.index()];
        Point2::new(200.0 + p.x * 100.0 / 0.613, 200.0 - p.y * 100.0 / 0.613)
    }

    /// A face read exactly at Candide's nodes, with an expected error of 2 px per point.
    fn read(wireframe: &Wireframe) -> LocatedFace {
        let known = points().iter().filter_map(|p| p.node);
        let found: Vec<LocatedPoint> =
            known.map(|node| LocatedPoint { node, position: place(wireframe, node), expected_error: 2.0 }).collect();
        let mut shape = vec![Point2::origin(); points().len()];
        (shape[PUPILS[0]], shape[PUPILS[1]]) = (Point2::new(250.0, 180.0), Point2::new(150.0, 180.0));
        let expected_errors = vec![2.0; shape.len()];
        LocatedFace { points: found, shape, expected_errors, eye_distance: 100.0, score: 1.0, covered: Vec::new() }
    }

    /// Messages about marks at these nodes after moving them.
    fn said(nodes: &[u16], moved: impl Fn(u16, Point2<f64>) -> Point2<f64>) -> Vec<String> {
        let wireframe = Wireframe::candide3();
        let mark = |&n: &u16| Correspondence::found(NodeId(n), moved(n, place(&wireframe, NodeId(n))), 2.0);
        let marks: Vec<_> = nodes.iter().map(mark).collect();
        let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks).unwrap();
        held(&read(&wireframe), &marks, &fitted).said()
    }

    const ELEVEN: [u16; 11] = [20, 23, 53, 56, 31, 64, 10, 15, 17, 48, 50];

    #[test]
    fn correct_marks_are_not_reported() {
        assert_eq!(said(&ELEVEN, |_, p| p), Vec::<String>::new());
        // 6 px of 100 are within the limits.
        assert_eq!(said(&ELEVEN, |_, p| p + Vector2::new(6.0, 0.0)), Vec::<String>::new());
    }

    #[test]
    fn misplaced_or_scaled_marks_are_reported_in_px_and_eye_distances() {
        let question = "from the face found in the picture; check that they belong to this frame and this person";
        assert_eq!(
            said(&ELEVEN, |_, p| p + Vector2::new(18.0, 24.0)),
            [format!("the marks lie 30 px (0.30 of the eye distance) {question}")]
        );
        let larger = said(&ELEVEN, |_, p| Point2::from(p.coords * 1.3));
        assert!(larger.len() == 1 && larger[0].contains("fit a face 1.30 times as large"), "{larger:?}");
        // Enlarged about its own centre: no part is far away, but the whole is too large.
        let middle = Vector2::new(200.0, 200.0);
        let grown = said(&ELEVEN, |_, p| Point2::from((p.coords - middle) * 1.2 + middle));
        assert!(grown.len() == 1 && grown[0].contains("1.20 times as large"), "{grown:?}");
    }

    #[test]
    fn a_misplaced_part_is_reported() {
        let cheek = |n: u16, p: Point2<f64>| if n == 31 { p + Vector2::new(18.0, -24.0) } else { p };
        let named = |what: &str| format!("some marks do not lie on their features in the picture: {what}; check them");
        assert_eq!(said(&ELEVEN, cheek), [named("left mouth corner 30 px (0.30 of the eye distance)")]);
        // The subject's left is on the right of the picture, so outward is to the right there.
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
        // Brows raised by as much may be marked along their upper edge.
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
        // Distances 2, 4, 6 divided by 1, 2, 3; a single pair has no ratio.
        assert!((size(&[pair(0.0, 0.0), pair(2.0, 1.0), pair(6.0, 3.0)]) - 2.0).abs() < 1e-12);
        assert!((size(&[pair(1.0, 5.0)]) - 1.0).abs() < 1e-12);
    }
}
