//! `bank mix`: makes expressions as weighted sums of shapes.

use std::{borrow::Cow, path::Path};

use super::{Bank, BankError, BankHead, BankInfo, Composition, FpBasis, file, performance::Recipe};
use crate::{
    input::CsvFile,
    output::{MADE_BY, OutputError, nine_digits, write_atomic},
};

/// Reads recipes from a CSV file with the columns `member`, `shape` and `weight`.
///
/// Members are in the order of their first row; shapes that are not listed have weight 0.
///
/// # Errors
/// [`BankError::Input`] for a file or row that cannot be read, [`BankError::NoSuchMember`] for a shape that does not exist,
/// [`BankError::NoMembers`] for an empty file.
pub fn read_recipes(path: &Path, shapes: &[String]) -> Result<Vec<Recipe>, BankError> {
    let file = CsvFile::open(path)?;
    let [member, shape, weight] = file.require(["member", "shape", "weight"])?;
    let mut recipes: Vec<Recipe> = Vec::new();
    for row in file.rows() {
        let row = row?;
        let name = row.get(member);
        let wanted = row.get(shape);
        let place = shapes
            .iter()
            .position(|s| s == wanted)
            .ok_or_else(|| BankError::NoSuchMember { name: wanted.to_owned(), found: shapes.to_vec() })?;
        let at = recipes.iter().position(|r| r.name == name).unwrap_or(recipes.len());
        if at == recipes.len() {
            recipes.push(Recipe { name: name.to_owned(), weights: vec![0.0; shapes.len()] });
        }
        recipes[at].weights[place] += row.number(weight)?;
    }
    if recipes.is_empty() { Err(BankError::NoMembers) } else { Ok(recipes) }
}

/// Writes recipes in the format of [`read_recipes`]; weights of 0 are left out.
///
/// # Errors
/// [`OutputError`].
pub fn write_recipes(path: &Path, shapes: &[String], recipes: &[Recipe]) -> Result<(), OutputError> {
    write_atomic(path, |writer| {
        let mut csv = crate::output::csv_writer(writer);
        csv.write_record(["member", "shape", "weight"])?;
        for recipe in recipes {
            for (shape, weight) in shapes.iter().zip(&recipe.weights).filter(|(_, w)| **w != 0.0) {
                csv.write_record([&recipe.name, shape, &nine_digits(*weight)])?;
            }
        }
        csv.flush()
    })
}

/// Writes a bank whose members are the weighted sums of a bank's shapes given by the recipes, with one member in memory at a
/// time.
///
/// The file stores the composition. If the shapes are mixtures themselves, it is expressed in the shapes they were mixed from.
///
/// # Errors
/// [`BankError`].
pub fn mix_bank(shapes: &Bank, recipes: &[Recipe], output: &Path) -> Result<(), BankError> {
    let names: Vec<String> = recipes.iter().map(|r| r.name.clone()).collect();
    let info = BankInfo { made_by: MADE_BY.to_owned(), composition: Some(composition(shapes, recipes)), ..shapes.info().clone() };
    let head = BankHead { mesh: shapes.mesh(), names: &names, feature_points: shapes.feature_points(), info: &info };
    file::write(output, &head, |member| Ok(Cow::Owned(mix(shapes, &recipes[member].weights))))
}

fn composition(shapes: &Bank, recipes: &[Recipe]) -> Composition {
    let Some(inner) = &shapes.info().composition else {
        return Composition { shapes: shapes.names().to_vec(), weights: recipes.iter().map(|r| r.weights.clone()).collect() };
    };
    let through = |recipe: &Recipe| {
        let mut sum = vec![0.0; inner.shapes.len()];
        for (weight, row) in recipe.weights.iter().zip(&inner.weights) {
            sum.iter_mut().zip(row).for_each(|(s, r)| *s += weight * r);
        }
        sum
    };
    Composition { shapes: inner.shapes.clone(), weights: recipes.iter().map(through).collect() }
}

/// Returns the weighted sum of a bank's members.
pub fn mix(shapes: &Bank, weights: &[f64]) -> Vec<[f32; 3]> {
    let mut sum = vec![[0.0_f32; 3]; shapes.vertex_count()];
    for (shape, &weight) in weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
        let weight = weight as f32;
        for (sum, value) in sum.iter_mut().zip(shapes.displacements(shape)) {
            (0..3).for_each(|axis| sum[axis] += weight * value[axis]);
        }
    }
    sum
}

/// Returns the motion of the feature points in every recipe, as flat arrays for [`super::choose_members`].
pub fn recipe_motions(shapes: &Bank, recipes: &[Recipe]) -> Vec<Vec<f64>> {
    let basis = FpBasis::new(shapes);
    let points = shapes.feature_points().len();
    let motion = |recipe: &Recipe| {
        let mut sum = vec![0.0; 3 * points];
        for (shape, &weight) in recipe.weights.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            for point in 0..points {
                let motion = basis.motion(shape, point);
                (0..3).for_each(|axis| sum[3 * point + axis] += weight * motion[axis]);
            }
        }
        sum
    };
    recipes.iter().map(motion).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthesis::testing;

    #[test]
    fn mixtures_add_up_and_remember_what_they_are_made_of() {
        let folder = tempfile::tempdir().unwrap();
        let shapes = testing::bank();
        let recipes = vec![
            Recipe { name: "diagonal".to_owned(), weights: vec![0.5, 2.0, 0.0] },
            Recipe { name: "out".to_owned(), weights: vec![0.0, 0.0, 1.0] },
        ];
        let path = folder.path().join("mixed.bank");
        mix_bank(&shapes, &recipes, &path).unwrap();
        let mixed = Bank::open(&path).unwrap();
        assert_eq!(mixed.displacements(0)[3], [0.5, 2.0, 0.0]);
        assert_eq!(mixed.displacements(1), shapes.displacements(2));
        // A mixture of mixtures is resolved to the shapes: 2 diagonal + out.
        let again = vec![Recipe { name: "both".to_owned(), weights: vec![2.0, 1.0] }];
        mix_bank(&mixed, &again, &path.with_extension("2")).unwrap();
        let both = Bank::open(&path.with_extension("2")).unwrap();
        assert_eq!(both.info().composition.as_ref().unwrap().weights, [[1.0, 4.0, 1.0]]);
    }

    #[test]
    fn recipes_read_back_and_unknown_shapes_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.csv");
        let names = testing::bank().names().to_vec();
        let recipes = vec![Recipe { name: "a".to_owned(), weights: vec![0.25, 0.0, -1.0] }];
        write_recipes(&path, &names, &recipes).unwrap();
        assert_eq!(read_recipes(&path, &names).unwrap(), recipes);
        std::fs::write(&path, "member,shape,weight\na,smile,1\n").unwrap();
        assert_eq!(read_recipes(&path, &names).unwrap_err().to_string(), "there is no `smile`; choose from right, up, out");
        std::fs::write(&path, "member,shape,weight\na,up,nan\n").unwrap();
        assert!(read_recipes(&path, &names).unwrap_err().to_string().contains("line 2: weight is `nan`"));
    }
}
