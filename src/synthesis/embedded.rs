//! The banks that are embedded in the library, by name.

use std::path::Path;

use super::{Bank, BankError, candide, head};

/// A bank that needs no file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmbeddedBank {
    /// `head`: an average head with eyes, mouth and colours.
    Head,
    /// `candide`: a smooth Candide-3.
    Candide,
}

impl EmbeddedBank {
    /// All embedded banks.
    pub const ALL: [Self; 2] = [Self::Head, Self::Candide];

    /// Its name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Head => "head",
            Self::Candide => "candide",
        }
    }

    /// The embedded bank that a path names; `None` when a file of that name exists.
    pub fn of_path(path: &Path) -> Option<Self> {
        Self::ALL.into_iter().find(|bank| path.as_os_str() == bank.name()).filter(|_| !path.is_file())
    }

    /// Returns the bank.
    ///
    /// # Errors
    /// [`BankError`], only if the embedded tables are defective.
    pub fn bank(self) -> Result<Bank, BankError> {
        match self {
            Self::Head => head::head_bank(),
            Self::Candide => candide::candide_bank(),
        }
    }

    /// Returns the shapes that its members are mixed of.
    ///
    /// # Errors
    /// Same as [`Self::bank`].
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
