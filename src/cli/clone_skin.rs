//! Choice of the skin that `grimace clone` puts on a target.

use std::path::{Path, PathBuf};

use grimace::{
    clone::{SKIN_SUFFIX, Skin, SourceKind, SourceMotion},
    pipeline::Workbench,
};

/// Whose skin a clone gets.
#[derive(Clone, Debug)]
pub(super) enum SkinChoice {
    Auto,
    Form,
    None,
    Of(PathBuf),
}

impl std::str::FromStr for SkinChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "auto" => Self::Auto,
            "form" => Self::Form,
            "none" => Self::None,
            path => Self::Of(PathBuf::from(path)),
        })
    }
}

/// The skin of a class, with its representative, or of a motion's form.
pub(super) struct SourceSkin {
    /// The file of a class's skin.
    pub(super) path: Option<PathBuf>,
    pub(super) skin: Skin,
    pub(super) representative: SourceMotion,
}

/// Returns the skin for a source, if there is one.
pub(super) fn skin_of(
    choice: &SkinChoice,
    path: &Path,
    motion: &SourceMotion,
    bench: &Workbench,
) -> anyhow::Result<Option<SourceSkin>> {
    let of_form = || {
        let skin = Skin::of_form(motion)?;
        Ok(Some(SourceSkin { path: None, skin, representative: motion.clone() }))
    };
    let (path, representative) = match choice {
        SkinChoice::None => return Ok(None),
        SkinChoice::Form => return of_form(),
        SkinChoice::Auto => {
            let (skin, path) = Skin::going_with(path, motion)?;
            return Ok(Some(SourceSkin { path, skin, representative: motion.clone() }));
        }
        SkinChoice::Of(csv) => {
            let representative = SourceMotion::read(csv, bench)?;
            anyhow::ensure!(
                representative.kind == SourceKind::Model,
                "--skin {}: this is not a representative; give a .csv of OUT/representatives with a {SKIN_SUFFIX} beside it",
                csv.display()
            );
            let picture = Skin::path_beside(csv, representative.kind).ok_or_else(|| {
                anyhow::anyhow!(
                    "{}: there is no {SKIN_SUFFIX} beside it; `run` writes it if at least {} people of a class have pictures that show folds",
                    csv.display(),
                    grimace::clone::LEAST_SKIN_PEOPLE
                )
            })?;
            (picture, representative)
        }
    };
    Ok(Some(SourceSkin { skin: Skin::read(&path)?, path: Some(path), representative }))
}
