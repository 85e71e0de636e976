//! Identifiers (what the user calls a thing) and dense indices (where we keep it).

use std::fmt;

use serde::{Deserialize, Serialize};

/// An id and those of the footprints that it may be a part of, its own first: `a#2#1`, `a#2`, `a`.
pub fn with_wholes(id: &str) -> impl Iterator<Item = &str> {
    std::iter::successors(Some(id), |id| Some(id.rsplit_once('#')?.0))
}

macro_rules! identifier {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub String);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&self.0)
            }
        }

        impl From<&str> for $name {
            fn from(id: &str) -> Self {
                Self(id.to_owned())
            }
        }
    };
}

macro_rules! dense_index {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub u32);

        impl $name {
            /// From a position in a slice.
            ///
            /// # Panics
            /// If there are more than 2³² items, which no scene of ours holds.
            #[must_use]
            pub fn new(position: usize) -> Self {
                Self(u32::try_from(position).expect("fewer than 2^32 items"))
            }

            /// As a position in a slice.
            #[must_use]
            pub fn at(self) -> usize {
                self.0 as usize
            }
        }
    };
}

identifier!(
    /// A building, as the user's layer names it.
    BuildingId
);
identifier!(
    /// A photo with a pose: its file name, as the survey names it.
    ViewId
);
dense_index!(
    /// Position of a building in the scene.
    BuildingIdx
);
dense_index!(
    /// Position of a view in the survey.
    ViewIdx
);
