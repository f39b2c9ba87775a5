//! The wireframe together with its tables.

use super::{Tables, Wireframe};

/// A wireframe with the tables that belong to it. Code that needs both takes this type, so that they always match.
///
/// ```
/// use grimace::wireframe::Face;
///
/// let Face { wireframe, tables } = Face::candide3();
/// assert_eq!(wireframe.node_count(), 113);
/// assert_eq!(tables.regions.len(), 113);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// The wireframe.
    pub wireframe: Wireframe,
    /// The tables that relate its nodes to MPEG-4 and to landmarks.
    pub tables: Tables,
}

impl Face {
    /// Returns Candide-3 with its own tables.
    pub fn candide3() -> Self {
        Self::new(Wireframe::candide3())
    }

    /// Combines a wireframe that has Candide-3's node numbers with Candide-3's tables.
    pub fn new(wireframe: Wireframe) -> Self {
        Self { wireframe, tables: Tables::candide3() }
    }
}
