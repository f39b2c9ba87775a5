//! The banks that come with the library, by name.

use std::path::Path;

use super::{Bank, BankError, candide, head};

/// A bank that needs no file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmbeddedBank {
    /// An average head with eyes, mouth and colours, `head`.
    Head,
    /// Candide-3 made smooth, `candide`.
    Candide,
}

impl EmbeddedBank {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Head, Self::Candide];

    /// The word that stands for it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Candide => "candide",
        }
    }

    /// The one that a path stands for, unless there is a file of that name.
    pub fn of_path(path: &Path) -> Option<Self> {
        Self::ALL.into_iter().find(|bank| path.as_os_str() == bank.name()).filter(|_| !path.is_file())
    }

    /// The bank.
    ///
    /// # Errors
    /// [`BankError`], which for the embedded tables would mean a mistake in them.
    pub fn bank(self) -> Result<Bank, BankError> {
        match self {
            Self::Head => head::head_bank(),
            Self::Candide => candide::candide_bank(),
        }
    }

    /// The shapes that its members are mixed of.
    ///
    /// # Errors
    /// As [`Self::bank`].
    pub fn shapes(self) -> Result<Bank, BankError> {
        match self {
            Self::Head => head::head_shapes(),
            Self::Candide => candide::candide_shapes(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_stands_for_a_bank_and_a_path_does_not() {
        for bank in EmbeddedBank::ALL {
            assert_eq!(EmbeddedBank::of_path(Path::new(bank.name())), Some(bank));
        }
        assert_eq!(EmbeddedBank::of_path(Path::new("./head")), None);
        assert_eq!(EmbeddedBank::of_path(Path::new("face.bank")), None);
    }

    #[test]
    fn a_file_of_that_name_is_meant_where_there_is_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("head");
        std::fs::write(&path, "").unwrap();
        assert_eq!(EmbeddedBank::of_path(&path), None);
    }
}
