//! Finds the rest: the face to which a person returns most often.

/// Distance within which two frames are alike: the norm of the differences of intensities, each 0 to 5.
const ALIKE: f32 = 1.5;
/// Largest number of frames compared with each other, evenly spread.
const COMPARED: usize = 600;

/// Index of the vector with the highest density of others, by a Gaussian kernel of standard deviation `radius`. Of equals it is the first;
/// `None` without vectors.
pub fn densest(vectors: &[&[f32]], radius: f32) -> Option<usize> {
    let square = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f32>();
    let density = |a: &&[f32]| vectors.iter().map(|b| f64::from(-0.5 * square(a, b) / (radius * radius)).exp()).sum::<f64>();
    let densities: Vec<f64> = vectors.iter().map(density).collect();
    (0..vectors.len()).max_by(|&a, &b| densities[a].total_cmp(&densities[b]).then(b.cmp(&a)))
}

/// The frame that defines the rest among those for which `may_rest` is true, and all frames alike to it.
pub(super) fn rest(vectors: &[Vec<f32>], may_rest: impl Fn(usize) -> bool) -> Option<(usize, Vec<usize>)> {
    let usable: Vec<usize> = (0..vectors.len()).filter(|&t| may_rest(t)).collect();
    let step = usable.len().div_ceil(COMPARED).max(1);
    let compared: Vec<usize> = usable.iter().copied().step_by(step).collect();
    let chosen: Vec<&[f32]> = compared.iter().map(|&t| vectors[t].as_slice()).collect();
    let rest = *compared.get(densest(&chosen, ALIKE)?)?;
    let distance = |t: usize| vectors[t].iter().zip(&vectors[rest]).map(|(x, y)| (x - y) * (x - y)).sum::<f32>().sqrt();
    let near = usable.into_iter().filter(|&t| distance(t) <= ALIKE).collect();
    Some((rest, near))
}

/// The frame that is nearest to neutral among those for which `may_rest` is true, and all frames whose intensities have at most this norm.
pub(super) fn known(vectors: &[Vec<f32>], may_rest: impl Fn(usize) -> bool, limit: f32) -> Option<(usize, Vec<usize>)> {
    let norm = |&t: &usize| vectors[t].iter().map(|x| x * x).sum::<f32>().sqrt();
    let near: Vec<usize> = (0..vectors.len()).filter(|&t| may_rest(t)).filter(|t| norm(t) <= limit).collect();
    let rest = near.iter().copied().min_by(|a, b| norm(a).total_cmp(&norm(b)))?;
    Some((rest, near))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_densest_place_wins_and_ties_go_to_the_first() {
        let vectors: [&[f32]; 5] = [&[9.0], &[0.0], &[0.2], &[0.1], &[5.0]];
        assert_eq!(densest(&vectors, 1.0), Some(3));
        assert_eq!(densest(&[&[0.0], &[9.0]], 1.0), Some(0));
        assert_eq!(densest(&[], 1.0), None);
    }

    #[test]
    fn a_known_rest_is_low_however_often_another_face_is_shown() {
        let vectors: Vec<Vec<f32>> = [4.0, 4.0, 4.0, 4.0, 0.9, 0.3, 4.0].map(|v| vec![v, 0.0]).to_vec();
        assert_eq!(rest(&vectors, |_| true).unwrap().0, 0);
        assert_eq!(known(&vectors, |_| true, 1.4), Some((5, vec![4, 5])));
        assert_eq!(known(&vectors, |t| t < 4, 1.4), None);
    }
}
