//! Chooses the person to follow in a recording whose frames show several faces.

use nalgebra::Point2;

use super::survey::Look;
use crate::pipeline::FoundFace;

/// Largest distance, in eye distances, between the faces of one person in consecutive looks. Adjacent heads are about two apart; the
/// nearest person is chosen first.
const NEAR: f64 = 2.5;
/// Weight of a change in size by a factor of e, as a distance in eye distances.
const GROWTH: f64 = 2.0;

/// A person seen in a scene.
struct Person {
    middle: Point2<f64>,
    eye_distance: f64,
    /// Sum of the eye distances over all looks; large for people who are large or seen for long.
    weight: f64,
}

impl Person {
    /// Distance of a face from this person's last one, in eye distances.
    fn apart(&self, face: &FoundFace) -> f64 {
        let larger = self.eye_distance.max(face.eye_distance).max(1.0);
        let growth = (face.eye_distance.max(1.0) / self.eye_distance.max(1.0)).ln().abs();
        (face.middle() - self.middle).norm() / larger + GROWTH * growth
    }
}

/// Chooses a person from the looks of a scene, each with all faces found in it, the largest first. Returns each look with that person's
/// face.
///
/// If every look shows at most one face, these faces are the person, wherever they are. Otherwise faces of consecutive looks are assigned
/// to persons by position and size. The result is the person with the largest sum of sizes, or the one at `marked` (frame index and a point
/// on the face). Looks without that person return the next person.
pub(super) fn followed(looks: Vec<(usize, Vec<FoundFace>)>, marked: Option<(usize, Point2<f64>)>) -> Vec<Look> {
    if looks.iter().all(|(_, faces)| faces.first().is_none_or(|face| face.others == 0)) {
        let first = |(place, faces): (usize, Vec<FoundFace>)| Look { place, face: faces.into_iter().next(), person: 0 };
        return looks.into_iter().map(first).collect();
    }
    let (mut persons, seen) = persons(&looks);
    if let Some((place, point)) = marked
        && let Some(k) = (0..looks.len()).filter(|&k| !looks[k].1.is_empty()).min_by_key(|&k| looks[k].0.abs_diff(place))
    {
        let apart = |face: usize| (looks[k].1[face].middle() - point).norm();
        let nearest = seen[k].iter().min_by(|a, b| apart(a.1).total_cmp(&apart(b.1))).map(|seen| seen.0);
        if let Some(person) = nearest.and_then(|person| persons.get_mut(person)) {
            person.weight = f64::INFINITY;
        }
    }
    let mut order: Vec<usize> = (0..persons.len()).collect();
    order.sort_by(|&a, &b| persons[b].weight.total_cmp(&persons[a].weight));
    let face_of = |person: usize, k: usize| seen.get(k)?.iter().find(|seen| seen.0 == person).map(|seen| seen.1);
    let mut before = order.first().copied().unwrap_or_default();
    let mut chosen: Vec<(usize, Option<usize>)> = Vec::with_capacity(looks.len());
    for k in 0..looks.len() {
        // A person who is missed in a single look counts as present.
        let is_there = |person: usize, k: usize| face_of(person, k).is_some();
        let is_missed = |person: usize| k > 0 && is_there(person, k - 1) && is_there(person, k + 1);
        let person = order.iter().copied().find(|&person| is_there(person, k) || is_missed(person));
        before = person.unwrap_or(before);
        chosen.push((before, face_of(before, k)));
    }
    let look = |((place, faces), (person, face)): ((usize, Vec<FoundFace>), (usize, Option<usize>))| Look {
        place,
        face: face.and_then(|face| faces.into_iter().nth(face)),
        person,
    };
    looks.into_iter().zip(chosen).map(look).collect()
}

/// Assigns the faces of each look to persons. Returns the persons of a scene, and (person, face) pairs for each look.
fn persons(looks: &[(usize, Vec<FoundFace>)]) -> (Vec<Person>, Vec<Vec<(usize, usize)>>) {
    let (mut persons, mut seen): (Vec<Person>, Vec<Vec<(usize, usize)>>) = (Vec::new(), Vec::new());
    for (_, faces) in looks {
        let pairs = persons.iter().enumerate().flat_map(|(person, p)| {
            faces.iter().enumerate().map(move |(face, f)| (p.apart(f), person, face)).filter(|pair| pair.0 < NEAR)
        });
        let mut pairs: Vec<(f64, usize, usize)> = pairs.collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut known: Vec<(usize, usize)> = Vec::new();
        for (_, person, face) in pairs {
            if known.iter().all(|k| k.0 != person && k.1 != face) {
                known.push((person, face));
            }
        }
        for (face, found) in faces.iter().enumerate() {
            let (middle, eye_distance) = (found.middle(), found.eye_distance);
            let person = known.iter().find(|k| k.1 == face).map(|k| k.0);
            if let Some(person) = person.and_then(|person| persons.get_mut(person)) {
                *person = Person { middle, eye_distance, weight: person.weight + eye_distance };
            } else if found.trusted {
                known.push((persons.len(), face));
                persons.push(Person { middle, eye_distance, weight: eye_distance });
            }
        }
        seen.push(known);
    }
    (persons, seen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{fit::Correspondence, units::NodeId};

    fn face(x: f64, eye_distance: f64, others: usize) -> FoundFace {
        let marks = vec![Correspondence::found(NodeId(5), Point2::new(x, 100.0), 1.0)];
        FoundFace { marks, expected_error: 0.01, eye_distance, trusted: true, others, covered: Vec::new() }
    }

    fn middles(looks: &[Look]) -> Vec<Option<f64>> {
        looks.iter().map(|look| look.face.as_ref().map(|face| face.middle().x)).collect()
    }

    /// Two persons, each of whom is detected as the larger one at times; the left one has the larger sum.
    fn two(looks: usize) -> Vec<(usize, Vec<FoundFace>)> {
        let pair = |k: usize| {
            let (left, right) = (face(100.0 + k as f64, 62.0, 1), face(400.0, if k.is_multiple_of(3) { 64.0 } else { 59.0 }, 1));
            (10 * k, if k.is_multiple_of(3) { vec![right, left] } else { vec![left, right] })
        };
        (0..looks).map(pair).collect()
    }

    #[test]
    fn the_person_who_is_largest_on_the_whole_is_followed() {
        let looks = followed(two(9), None);
        assert!(middles(&looks).iter().all(|x| x.is_some_and(|x| x < 110.0)), "{:?}", middles(&looks));
        assert!(looks.iter().all(|look| look.person == looks[0].person));
        let marked = followed(two(9), Some((43, Point2::new(390.0, 110.0))));
        assert_eq!(middles(&marked), [Some(400.0); 9]);
    }

    #[test]
    fn a_person_missed_once_is_kept_and_one_who_leaves_is_replaced() {
        let mut looks = two(9);
        for (k, (_, faces)) in looks.iter_mut().enumerate() {
            faces.retain(|face| face.middle().x > 200.0 || (k != 2 && k < 6));
            faces.iter_mut().filter(|face| face.middle().x < 200.0).for_each(|face| face.eye_distance = 120.0);
        }
        let looks = followed(looks, None);
        let (left, right) = (looks[0].person, looks[8].person);
        assert_ne!(left, right);
        assert_eq!(looks.iter().map(|look| look.person).collect::<Vec<_>>(), [[left; 6].as_slice(), &[right; 3]].concat());
        assert_eq!(looks.iter().map(|look| look.face.is_some()).collect::<Vec<_>>()[..4], [true, true, false, true]);
    }

    #[test]
    fn a_single_face_is_followed_wherever_it_is() {
        let looks = (0..6).map(|k| (10 * k, vec![face(if k < 3 { 100.0 } else { 500.0 }, 60.0, 0)])).collect();
        let looks = followed(looks, None);
        assert!(looks.iter().all(|look| look.person == 0 && look.face.is_some()));
    }
}
