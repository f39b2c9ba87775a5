//! A smooth map of space that interpolates given points.

use nalgebra::{DMatrix, MatrixXx3, Point3, RowVector3, Vector3};

/// Biharmonic spline in space with an affine part.
#[derive(Clone, Debug)]
pub struct SplineWarp {
    centres: Vec<Vector3<f64>>,
    weights: MatrixXx3<f64>,
}

impl SplineWarp {
    /// Returns the warp that maps the points of `source` to those of `target`, or `None` if the source points lie in a plane, on a line
    /// or on one point.
    pub fn new(source: &[Vector3<f64>], target: &[Vector3<f64>]) -> Option<Self> {
        let n = source.len();
        let mut matrix = DMatrix::zeros(n + 4, n + 4);
        let mut right = MatrixXx3::zeros(n + 4);
        for (row, p) in source.iter().enumerate() {
            for (column, q) in source.iter().enumerate() {
                matrix[(row, column)] = (p - q).norm();
            }
            for (k, value) in [1.0, p.x, p.y, p.z].into_iter().enumerate() {
                matrix[(row, n + k)] = value;
                matrix[(n + k, row)] = value;
            }
            right.set_row(row, &target[row].transpose());
        }
        let weights = matrix.lu().solve(&right)?;
        weights.iter().all(|w| w.is_finite()).then(|| Self { centres: source.to_vec(), weights })
    }

    /// Returns the image of a point.
    pub fn apply(&self, point: &Point3<f64>) -> Vector3<f64> {
        let n = self.centres.len();
        let mut sum = RowVector3::zeros();
        for (k, centre) in self.centres.iter().enumerate() {
            sum += self.weights.row(k) * (point.coords - centre).norm();
        }
        for (k, value) in [1.0, point.x, point.y, point.z].into_iter().enumerate() {
            sum += self.weights.row(n + k) * value;
        }
        sum.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn given_points_go_where_they_should_and_affine_maps_are_kept() {
        let source = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]].map(Vector3::from);
        // x doubled and shifted by one.
        let target = source.map(|p| Vector3::new(2.0 * p.x + 1.0, p.y, p.z));
        let warp = SplineWarp::new(&source, &target).unwrap();
        for (p, q) in source.iter().zip(&target) {
            assert!((warp.apply(&Point3::from(*p)) - q).norm() < 1e-9);
        }
        assert!((warp.apply(&Point3::new(0.5, 0.25, 3.0)) - Vector3::new(2.0, 0.25, 3.0)).norm() < 1e-9);
        let line = [0.0, 1.0, 2.0, 3.0].map(|x| Vector3::new(x, 0.0, 0.0));
        assert!(SplineWarp::new(&line, &line).is_none());
    }
}
