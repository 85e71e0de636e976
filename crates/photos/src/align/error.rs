//! Why a survey cannot be aligned.

/// Why a survey as a whole cannot be aligned.
#[derive(Debug, thiserror::Error)]
pub enum AlignError {
    /// A setting out of range.
    #[error("align: `{field}` is out of range\nhint: expected {expected}")]
    Config {
        /// Name of the setting.
        field: &'static str,
        /// Values that are allowed, in words.
        expected: &'static str,
    },
    /// No ground to say where photos look.
    #[error(
        "align: nothing says how high the ground is\nhint: `--ground METRES`, `--dtm FILE` or [terrain] in the configuration; \
         some metres off do no harm"
    )]
    NoTerrain,
    /// Fewer photos than an alignment needs.
    #[error(
        "align: {n_photos} of {n_views} poses have a photo; expected at least 3\nhint: `--images FOLDER` says where the photos are"
    )]
    FewPhotos {
        /// Poses with a photo.
        n_photos: usize,
        /// Number of poses.
        n_views: usize,
    },
    /// No photo sees what another sees.
    #[error(
        "align: no two of {n_photos} photos see the same ground under a fair angle\nhint: photos have to overlap; are the ground's \
         height and the poses' CRS right? `sizeup survey inspect` tells"
    )]
    NoOverlap {
        /// Number of photos.
        n_photos: usize,
    },
    /// Nothing was found again.
    #[error(
        "align: no photo shows enough of what others show ({n_photos} photos, {n_unreadable} of them cannot be read{})\n\
         hint: are they the photos that the poses belong to, and the poses within `align.position_sigma_m` and \
         `align.angle_sigma_deg`?",
        first.as_ref().map_or_else(String::new, |first| format!("; the first: {first}"))
    )]
    NothingMatches {
        /// Number of photos.
        n_photos: usize,
        /// Those that cannot be read.
        n_unreadable: usize,
        /// Why the first of these cannot be read.
        first: Option<String>,
    },
}

impl AlignError {
    /// Whether the settings are at fault, not the survey.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Config { .. })
    }
}
