//! Named scenes, and the ranges of settings.

use super::config::{FlightConfig, SimulateConfig, SimulatedPriors, TownConfig, TownKind};
use super::{SimulateError, mosaic};

/// Name, what is built, number of buildings, number of views and longer side of the prior.
///
/// The paper's seven scenes are stand-ins of our own that share their counts: buildings as in its proxy table, where
/// it states them (Res-1, Res-2, Ind-1, Ind-2; our choice elsewhere), views = used views over the used share.
const SCENES: [(&str, TownKind, usize, usize, u32); 11] = [
    ("demo", TownKind::District, 41, 40, 320),
    ("village", TownKind::Village, 96, 160, 448),
    ("district", TownKind::District, 64, 160, 448),
    ("downtown", TownKind::Downtown, 53, 140, 448),
    ("res-1", TownKind::District, 26, 374, 320),
    ("res-2", TownKind::District, 100, 1688, 224),
    ("res-3", TownKind::Village, 120, 1750, 224),
    ("res-4", TownKind::Village, 180, 2483, 224),
    ("ind-1", TownKind::Industry, 49, 1470, 224),
    ("ind-2", TownKind::Industry, 103, 1243, 224),
    ("city-1", TownKind::Downtown, 300, 5135, 192),
];
/// From this many views on a scene has priors only.
const MOST_PHOTOS: usize = 300;

impl SimulateConfig {
    /// Names that [`Self::preset`] knows.
    pub fn preset_names() -> impl Iterator<Item = &'static str> {
        SCENES.iter().map(|scene| scene.0)
    }

    /// A named scene.
    ///
    /// # Errors
    /// [`SimulateError::UnknownPreset`], with the names.
    pub fn preset(name: &str) -> Result<Self, SimulateError> {
        let known = || Self::preset_names().collect::<Vec<_>>().join(", ");
        let &(name, kind, n_buildings, n_views, longest_px) = SCENES
            .iter()
            .find(|scene| scene.0.eq_ignore_ascii_case(name))
            .ok_or_else(|| SimulateError::UnknownPreset { name: name.to_owned(), known: known() })?;
        let mut config = Self {
            town: TownConfig { kind, n_buildings, ..TownConfig::default() },
            flight: FlightConfig { n_views: Some(n_views), ..FlightConfig::default() },
            prior: SimulatedPriors { longest_px, ..SimulatedPriors::default() },
            ..Self::default()
        };
        config.images.enabled = n_views < MOST_PHOTOS;
        config.masks.enabled = config.images.enabled;
        if name == "demo" {
            (config.camera.width_px, config.camera.height_px) = (640, 480);
        }
        Ok(config)
    }

    /// Checks every range.
    ///
    /// # Errors
    /// [`SimulateError::Setting`] for the first setting out of range.
    pub fn validate(&self) -> Result<(), SimulateError> {
        let check = |is_good: bool, setting, found: String, expected| {
            if is_good { Ok(()) } else { Err(SimulateError::Setting { setting, found, expected }) }
        };
        let within = |value: f64, low: f64, high: f64| value >= low && value <= high;
        let (t, f, c, i) = (&self.terrain, &self.flight, &self.camera, &self.images);
        let n = self.town.n_buildings;
        check((1..=20_000).contains(&n), "town.n_buildings", n.to_string(), "1 to 20000")?;
        for (setting, value, low, high, expected) in [
            ("town.mean_height_m", self.town.mean_height_m.unwrap_or(10.0), 4.0, 200.0, "4 to 200 m"),
            ("town.trees_per_building", self.town.trees_per_building, 0.0, 1000.0, "0 to 1000"),
            ("town.cars_per_building", self.town.cars_per_building, 0.0, 1000.0, "0 to 1000"),
            ("town.trees_at_walls", self.town.trees_at_walls, 0.0, 1.0, "0 to 1"),
            ("terrain.relief_m", t.relief_m, 0.0, 200.0, "0 to 200 m"),
            ("terrain.cell_m", t.cell_m, 0.5, 50.0, "0.5 to 50 m"),
            ("terrain.margin_m", t.margin_m, 10.0, 20_000.0, "10 to 20000 m"),
            ("flight.height_m", f.height_m, 10.0, 5000.0, "10 to 5000 m"),
            ("flight.spacing_m", f.spacing_m, 2.0, 5000.0, "2 to 5000 m"),
            ("flight.tilt_deg", f.tilt_deg, 20.0, 60.0, "20 to 60 degrees"),
            ("camera.width_px", f64::from(c.width_px), 16.0, 20_000.0, "16 to 20000 pixels"),
            ("camera.height_px", f64::from(c.height_px), 16.0, 20_000.0, "16 to 20000 pixels"),
            ("camera.focal_ratio", c.focal_ratio, 0.3, 5.0, "0.3 to 5"),
            ("images.sun_elevation_deg", i.sun_elevation_deg, 5.0, 90.0, "5 to 90 degrees"),
            ("images.jpeg_quality", f64::from(i.jpeg_quality), 1.0, 100.0, "1 to 100"),
            ("prior.longest_px", f64::from(self.prior.longest_px), 16.0, 20_000.0, "16 to 20000 pixels"),
            ("points.per_view", self.points.per_view as f64, 0.0, 100_000.0, "0 to 100000"),
            ("points.noise_m", self.points.noise_m, 0.0, 100.0, "0 to 100 m"),
            ("points.gap_share", self.points.gap_share, 0.0, 1.0, "0 to 1"),
            ("points.gap_m", self.points.gap_m, 0.1, 1000.0, "0.1 to 1000 m"),
            ("points.blunder_share", self.points.blunder_share, 0.0, 1.0, "0 to 1"),
            ("points.blunder_m", self.points.blunder_m, 0.0, 1000.0, "0 to 1000 m"),
            ("errors.position_m", self.errors.position_m, 0.0, 100.0, "0 to 100 m"),
            ("errors.angle_deg", self.errors.angle_deg, 0.0, 45.0, "0 to 45 degrees"),
            ("errors.vertex_m", self.errors.vertex_m, 0.0, 10.0, "0 to 10 m"),
            ("errors.footprint_m", self.errors.footprint_m, -5.0, 5.0, "-5 to 5 m"),
            ("errors.building_m", self.errors.building_m, 0.0, 10.0, "0 to 10 m"),
            ("errors.shift_m", self.errors.shift_m[0], -50.0, 50.0, "-50 to 50 m each"),
            ("errors.shift_m", self.errors.shift_m[1], -50.0, 50.0, "-50 to 50 m each"),
        ] {
            check(within(value, low, high), setting, value.to_string(), expected)?;
        }
        self.mosaic.map_or(Ok(()), |mosaic| mosaic::check(self, &mosaic))
    }
}
