//! The wireframe and its tables as one.

use super::{Tables, Wireframe};

/// A wireframe with the tables that belong to it. Whoever needs both takes this, so that they always match.
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
    /// The tables that tie its nodes to MPEG-4 and to landmarks.
    pub tables: Tables,
}

impl Face {
    /// Candide-3 with its own tables.
    pub fn candide3() -> Self {
        Self::new(Wireframe::candide3())
    }

    /// A wireframe with Candide-3's node numbers, and Candide-3's tables.
    pub fn new(wireframe: Wireframe) -> Self {
        Self { wireframe, tables: Tables::candide3() }
    }
}
