//! Regions of the face that are solved independently, and how their surfaces are joined [ZL, section 5].

use serde::{Deserialize, Serialize};

use super::{Bank, SynthesisError};
use crate::units::FeaturePoint;

/// Division of the face into regions.
///
/// ```
/// use grimace::synthesis::RegionScheme;
///
/// assert_eq!(RegionScheme::of_count(2)?.names(), ["right", "left"]);
/// assert!(RegionScheme::of_count(3).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RegionScheme {
    /// One region [ZL, section 3].
    #[default]
    Whole,
    /// Right and left [ZL, Fig. 8].
    Halves,
    /// Upper right, upper left, lower right and lower left [ZL, Fig. 11].
    Quarters,
}

impl RegionScheme {
    /// Returns the scheme with 1, 2 or 4 regions.
    ///
    /// # Errors
    /// [`SynthesisError::Option`] for any other number.
    pub fn of_count(count: usize) -> Result<Self, SynthesisError> {
        match count {
            1 => Ok(Self::Whole),
            2 => Ok(Self::Halves),
            4 => Ok(Self::Quarters),
            _ => Err(SynthesisError::Option { what: "the number of regions", found: count.to_string(), expected: "1, 2 or 4" }),
        }
    }

    /// Names of the regions; left and right are the subject's own.
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Whole => &["whole"],
            Self::Halves => &["right", "left"],
            Self::Quarters => &["upper_right", "upper_left", "lower_right", "lower_left"],
        }
    }
}

/// Default width D of the overlap, as a fraction of the face's width: half the width of a mouth. The corners of the mouth, where
/// a face stretches most, then lie inside a region and not between two.
pub const OVERLAP: f64 = 0.2;

/// Regions of a bank: the share of each region in every vertex and feature point. The shares sum to 1.
///
/// Across the overlap of width D, the share falls with the distance d to the border, `1 - d/D` and `d/D` [ZL, section 5]. With
/// four regions, the shares of side and height are multiplied. The overlap lies around the midline and around the height halfway
/// between eyes and mouth. A feature point belongs to every region that has a share in it: "points surrounding the borders should
/// be included in both regions".
#[derive(Clone, Debug)]
pub struct Regions {
    scheme: RegionScheme,
    /// Shares of the vertices in each region.
    vertices: Vec<Vec<f32>>,
    /// Shares of the feature points in each region.
    points: Vec<Vec<f64>>,
}

impl Regions {
    /// Divides a bank's face into regions. `overlap` is D divided by the width of the neutral mesh, greater than 0 and at most 1.
    ///
    /// # Errors
    /// [`SynthesisError::Option`] for an overlap out of range.
    pub fn new(bank: &Bank, scheme: RegionScheme, overlap: f64) -> Result<Self, SynthesisError> {
        if !(overlap > 0.0 && overlap <= 1.0) {
            let found = overlap.to_string();
            return Err(SynthesisError::Option { what: "the overlap", found, expected: "a share of more than 0 and at most 1" });
        }
        let positions = bank.mesh().positions();
        let [low, high] = bank.mesh().bounds().map(|p| p.map(f64::from));
        let width = overlap * (high[0] - low[0]);
        let (middle, height) = borders(bank, low, high);
        let ramp = |value: f64, border: f64| if width > 0.0 { ((value - border) / width + 0.5).clamp(0.0, 1.0) } else { 0.5 };
        let shares = |p: &[f32; 3]| -> Vec<f64> {
            let (left, upper) = (ramp(f64::from(p[0]), middle), ramp(f64::from(p[1]), height));
            match scheme {
                RegionScheme::Whole => vec![1.0],
                RegionScheme::Halves => vec![1.0 - left, left],
                RegionScheme::Quarters => {
                    vec![(1.0 - left) * upper, left * upper, (1.0 - left) * (1.0 - upper), left * (1.0 - upper)]
                }
            }
        };
        let count = scheme.names().len();
        let mut vertices = vec![Vec::with_capacity(positions.len()); count];
        for position in positions {
            shares(position).iter().zip(&mut vertices).for_each(|(&share, list)| list.push(share as f32));
        }
        let points = (0..count)
            .map(|region| bank.feature_points().iter().map(|p| shares(&positions[p.vertex as usize])[region]).collect())
            .collect();
        Ok(Self { scheme, vertices, points })
    }

    /// The scheme of the regions.
    pub fn scheme(&self) -> RegionScheme {
        self.scheme
    }

    /// Number of regions.
    pub fn count(&self) -> usize {
        self.vertices.len()
    }

    /// Share of a region in every vertex, 0 to 1.
    pub fn vertex_shares(&self, region: usize) -> &[f32] {
        &self.vertices[region]
    }

    /// Share of a region in every feature point, 0 to 1.
    pub fn point_shares(&self, region: usize) -> &[f64] {
        &self.points[region]
    }
}

/// The x coordinate of the midline and the height between upper and lower face: from the feature points if there are enough, else
/// from the bounds.
fn borders(bank: &Bank, low: [f64; 3], high: [f64; 3]) -> (f64, f64) {
    let at = |group: u8, point: u8| bank.feature_point_position(FeaturePoint { group, point });
    let mean = |points: &[(u8, u8)], axis: usize| {
        let found: Vec<f64> = points.iter().filter_map(|&(g, p)| at(g, p)).map(|p| f64::from(p[axis])).collect();
        (found.len() == points.len()).then(|| found.iter().sum::<f64>() / found.len() as f64)
    };
    let middle = mean(&[(8, 3), (8, 4)], 0).or_else(|| mean(&[(3, 8), (3, 11)], 0));
    let (eyes, mouth) = (mean(&[(3, 8), (3, 11)], 1), mean(&[(8, 3), (8, 4)], 1));
    let height = eyes.zip(mouth).map(|(eyes, mouth)| f64::midpoint(eyes, mouth));
    (middle.unwrap_or(f64::midpoint(low[0], high[0])), height.unwrap_or(f64::midpoint(low[1], high[1])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::{candide_bank, testing};

    #[test]
    fn shares_fall_with_the_distance_to_the_border() {
        // The unit square: middle 0.5 from its mouth corners at x 0 and 1, D = 0.5, so the overlap is 0.25 to 0.75.
        let bank = testing::bank();
        let regions = Regions::new(&bank, RegionScheme::Halves, 0.5).unwrap();
        assert_eq!(regions.vertex_shares(0), [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(regions.vertex_shares(1), [0.0, 1.0, 1.0, 0.0]);
        // Overlap over the whole width: a vertex on the border of the overlap belongs to one region only.
        let wide = Regions::new(&bank, RegionScheme::Halves, 1.0).unwrap();
        assert_eq!(wide.vertex_shares(1), [0.0, 1.0, 1.0, 0.0]);
        assert_eq!(Regions::new(&bank, RegionScheme::Whole, 0.5).unwrap().vertex_shares(0), [1.0; 4]);
        assert!(Regions::new(&bank, RegionScheme::Halves, 0.0).unwrap_err().to_string().contains("the overlap is 0"));
        assert!(RegionScheme::of_count(3).is_err());
    }

    #[test]
    fn shares_are_a_partition_of_unity_and_mirror_each_other() {
        let bank = candide_bank().unwrap();
        for scheme in [RegionScheme::Halves, RegionScheme::Quarters] {
            let regions = Regions::new(&bank, scheme, OVERLAP).unwrap();
            for vertex in 0..bank.vertex_count() {
                let shares: Vec<f32> = (0..regions.count()).map(|r| regions.vertex_shares(r)[vertex]).collect();
                assert!((shares.iter().sum::<f32>() - 1.0).abs() < 1e-6 && shares.iter().all(|s| (0.0..=1.0).contains(s)));
            }
            let sum = |r: usize| regions.vertex_shares(r).iter().map(|&s| f64::from(s)).sum::<f64>();
            assert!((sum(0) / sum(1) - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn points_around_the_border_belong_to_both_sides() {
        let bank = candide_bank().unwrap();
        let regions = Regions::new(&bank, RegionScheme::Quarters, OVERLAP).unwrap();
        let count = |fp: &str| {
            let point = bank.feature_point_index(fp.parse().unwrap()).unwrap();
            (0..4).filter(|&r| regions.point_shares(r)[point] > 0.0).count()
        };
        // Chin on the midline below; the left outer corner of the mouth; the outer end of the left brow.
        assert_eq!((count("2.1"), count("4.5")), (2, 1));
    }
}
