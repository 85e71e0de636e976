//! What PROJ's own database knows: grid files of transformations, codes of names.

use std::path::PathBuf;

use gdal::vector::{Feature, LayerAccess as _, sql::Dialect};

use super::{Better, Crs};

/// Address at which PROJ's own grid files are handed out, and `projsync` gets them.
const HANDED_OUT: &str = "https://cdn.proj.org/";
/// Endings of the names of grid files.
const ENDINGS: [&str; 4] = ["tif", "gsb", "gtx", "ct2"];

/// A grid file of a transformation.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct GridFile {
    /// Name of the grid's file.
    pub name: String,
    /// Address at which it is handed out; empty where PROJ's database does not know.
    pub url: String,
}

impl GridFile {
    /// Whether it lies in one of PROJ's folders.
    #[must_use]
    pub fn is_present(&self) -> bool {
        data_folders().iter().any(|folder| folder.join(&self.name).is_file())
    }

    /// The command that brings it; `None` for one that PROJ does not hand out.
    #[must_use]
    pub fn command(&self) -> Option<String> {
        self.url.starts_with(HANDED_OUT).then(|| format!("projsync --file {}", self.name))
    }
}

/// Folders that PROJ looks for its database and for grids in, the first first.
#[must_use]
pub fn data_folders() -> Vec<PathBuf> {
    let Ok(info) = proj::ProjBuilder::new().lib_info() else { return Vec::new() };
    let separator = if cfg!(windows) { ';' } else { ':' };
    info.searchpath.split(separator).filter(|folder| !folder.is_empty()).map(PathBuf::from).collect()
}

/// The version of PROJ; empty where it does not say.
#[must_use]
pub fn proj_version() -> String {
    proj::ProjBuilder::new().lib_info().map(|info| info.version).unwrap_or_default()
}

/// Names of the grid files in PROJ's folders, in order.
#[must_use]
pub fn grids_present() -> Vec<String> {
    let entries = data_folders().into_iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten();
    let is_grid = |path: &PathBuf| path.extension().is_some_and(|end| ENDINGS.iter().any(|known| end == *known));
    let files = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_grid);
    let mut names: Vec<String> = files.filter_map(|path| Some(path.file_name()?.to_str()?.to_owned())).collect();
    names.sort();
    names.dedup();
    names
}

impl std::fmt::Display for GridFile {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.url.is_empty() { f.write_str(&self.name) } else { write!(f, "{} from {}", self.name, self.url) }
    }
}

/// So many grids of each side are named: any one does, the best comes first.
const MOST_NAMED: usize = 2;

/// Grids that lead from the heights of one system to the other's: between both, else between the ellipsoid and either. The best
/// first, those for the place (longitude and latitude, degrees); without one, for the middle of the systems' area of use. Empty
/// where neither has one or the database cannot be read.
#[must_use]
pub fn of_heights(from: &Crs, to: &Crs, place_deg: Option<(f64, f64)>) -> Vec<GridFile> {
    let middle = |crs: &Crs| {
        let [west, south, east, north] = crs.area_of_use_deg()?;
        // The whole world has no middle.
        (east - west < 180.0).then(|| (f64::midpoint(west, east), f64::midpoint(south, north)))
    };
    let place_deg = place_deg.or_else(|| middle(from)).or_else(|| middle(to));
    let codes: Vec<u32> = [from, to].into_iter().filter_map(Crs::vertical_epsg).collect();
    let best = |code: u32, other: Option<u32>| -> Vec<GridFile> {
        let at_place = of_vertical(code, other, place_deg).unwrap_or_default();
        let found = if at_place.is_empty() { of_vertical(code, other, None).unwrap_or_default() } else { at_place };
        let mut named = Vec::new();
        for grid in found {
            if !named.contains(&grid) && named.len() < MOST_NAMED {
                named.push(grid);
            }
        }
        named
    };
    if let [from, to] = codes[..] {
        let between = best(from, Some(to));
        if !between.is_empty() {
            return between;
        }
    }
    codes.into_iter().flat_map(|code| best(code, None)).collect()
}

/// Grids of the vertical systems on the datum of one (in other units they have codes of their own), to those of another or to the
/// ellipsoid, the most accurate first.
fn of_vertical(epsg: u32, other: Option<u32>, place_deg: Option<(f64, f64)>) -> Option<Vec<GridFile>> {
    let on_datum_of = |epsg: u32| {
        format!(
            "(SELECT v.code FROM vertical_crs v JOIN vertical_crs one ON v.datum_code = one.datum_code \
             AND v.datum_auth_name = one.datum_auth_name WHERE one.auth_name = 'EPSG' AND one.code = '{epsg}')"
        )
    };
    let own = on_datum_of(epsg);
    let theirs =
        other.map_or_else(|| "(SELECT code FROM geodetic_crs WHERE auth_name = 'EPSG')".to_owned(), on_datum_of);
    let there = place_deg.map_or_else(String::new, |(lon_deg, lat_deg)| {
        // Alaska reaches across the date line.
        format!(
            "AND {lat_deg} BETWEEN e.south_lat AND e.north_lat AND ({lon_deg} BETWEEN e.west_lon AND e.east_lon \
             OR (e.west_lon > e.east_lon AND ({lon_deg} >= e.west_lon OR {lon_deg} <= e.east_lon)))"
        )
    });
    let query = format!(
        "SELECT COALESCE(NULLIF(a.proj_grid_name, ''), g.grid_name) AS name, a.url AS url \
         FROM grid_transformation g LEFT JOIN grid_alternatives a ON a.original_grid_name = g.grid_name \
         JOIN usage u ON u.object_table_name = 'grid_transformation' AND u.object_auth_name = g.auth_name \
         AND u.object_code = g.code \
         JOIN extent e ON e.auth_name = u.extent_auth_name AND e.code = u.extent_code \
         WHERE g.deprecated = 0 AND g.grid_name <> '' \
         AND ((g.target_crs_auth_name = 'EPSG' AND g.target_crs_code IN {own} AND g.source_crs_code IN {theirs}) \
         OR (g.source_crs_auth_name = 'EPSG' AND g.source_crs_code IN {own} AND g.target_crs_code IN {theirs})) {there} \
         ORDER BY a.url LIKE '{HANDED_OUT}%' DESC, g.accuracy IS NULL, g.accuracy, name"
    );
    rows(&query, |feature| {
        Some(GridFile { name: text(feature, "name")?, url: text(feature, "url").unwrap_or_default() })
    })
}

/// Transformations by grid between two geographic systems, by their names, at a longitude and latitude in degrees, the most
/// accurate first; empty where the database has none or cannot be read.
pub(super) fn of_planes(from: &str, to: &str, (lon_deg, lat_deg): (f64, f64)) -> Vec<Better> {
    let list = |name: &str| -> Option<String> {
        let codes: Vec<String> = codes_of_name(name)?.iter().map(|code| format!("'{code}'")).collect();
        (!codes.is_empty()).then(|| codes.join(", "))
    };
    let (Some(from), Some(to)) = (list(from), list(to)) else { return Vec::new() };
    let query = format!(
        "SELECT g.name AS operation, g.accuracy AS accuracy, COALESCE(NULLIF(a.proj_grid_name, ''), g.grid_name) AS grid, \
         a.url AS url FROM grid_transformation g \
         LEFT JOIN grid_alternatives a ON a.original_grid_name = g.grid_name \
         JOIN usage u ON u.object_table_name = 'grid_transformation' AND u.object_auth_name = g.auth_name \
         AND u.object_code = g.code \
         JOIN extent e ON e.auth_name = u.extent_auth_name AND e.code = u.extent_code \
         WHERE g.deprecated = 0 AND g.accuracy IS NOT NULL AND g.source_crs_auth_name = 'EPSG' \
         AND g.target_crs_auth_name = 'EPSG' \
         AND ((g.source_crs_code IN ({from}) AND g.target_crs_code IN ({to})) \
         OR (g.source_crs_code IN ({to}) AND g.target_crs_code IN ({from}))) \
         AND {lat_deg} BETWEEN e.south_lat AND e.north_lat AND {lon_deg} BETWEEN e.west_lon AND e.east_lon \
         ORDER BY g.accuracy, a.url LIKE 'https://cdn.proj.org/%' DESC, g.auth_name, g.code"
    );
    let row = |feature: &Feature<'_>| {
        let grid = GridFile { name: text(feature, "grid")?, url: text(feature, "url").unwrap_or_default() };
        let accuracy_m = text(feature, "accuracy")?.parse().ok()?;
        Some(Better { name: text(feature, "operation")?, accuracy_m, grid })
    };
    rows(&query, row).unwrap_or_default()
}

/// EPSG codes of the systems of a name; `None` where the database cannot be read. PROJ itself would print its own line
/// about a name that it does not know.
pub(super) fn codes_of_name(name: &str) -> Option<Vec<u32>> {
    let name = name.replace('\'', "''");
    let query = format!(
        "SELECT code FROM crs_view WHERE auth_name = 'EPSG' AND deprecated = 0 AND name = '{name}' ORDER BY code"
    );
    rows(&query, |feature| text(feature, "code")?.parse().ok())
}

/// Names of EPSG's geographic systems on a datum, by its name; empty where it has none or the database cannot be read.
pub(super) fn systems_on_datum(name: &str) -> Vec<String> {
    let name = name.replace('\'', "''");
    let query = format!(
        "SELECT g.name AS name FROM geodetic_crs g JOIN geodetic_datum d ON d.auth_name = g.datum_auth_name \
         AND d.code = g.datum_code WHERE d.name = '{name}' AND g.type = 'geographic 2D' AND g.auth_name = 'EPSG' \
         AND g.deprecated = 0 ORDER BY g.code"
    );
    rows(&query, |feature| text(feature, "name")).unwrap_or_default()
}

/// Result of a query of PROJ's database; `None` where the database cannot be read.
fn rows<T>(query: &str, row: impl Fn(&Feature<'_>) -> Option<T>) -> Option<Vec<T>> {
    crate::gdal_log::route_messages();
    let database = data_folders().into_iter().map(|folder| folder.join("proj.db")).find(|file| file.is_file())?;
    let dataset = gdal::Dataset::open(&database).ok()?;
    let Some(mut found) = dataset.execute_sql(query, None, Dialect::DEFAULT).ok()? else { return Some(Vec::new()) };
    Some(found.features().filter_map(|feature| row(&feature)).collect())
}

fn text(feature: &Feature<'_>, field: &str) -> Option<String> {
    let index = feature.field_index(field).ok()?;
    feature.field_as_string(index).ok().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_says_whether_it_is_there_and_what_brings_it() {
        let heights = of_heights(&Crs::parse("EPSG:7415").unwrap(), &Crs::parse("EPSG:4979").unwrap(), None);
        assert!(heights.iter().any(|grid| grid.name == "nl_nsgi_nlgeo2018.tif"), "{heights:?}");
        for grid in &heights {
            assert_eq!(grid.is_present(), grids_present().contains(&grid.name), "{grid}");
            let command = grid.command().unwrap_or_default();
            assert_eq!(command.ends_with(&grid.name), grid.url.starts_with(HANDED_OUT), "{grid}: {command}");
        }
        let nobody = GridFile { name: "nobody_has_it.tif".to_owned(), url: String::new() };
        assert_eq!((nobody.is_present(), nobody.command()), (false, None));
        assert!(proj_version().contains('.') && !data_folders().is_empty());
    }

    #[test]
    fn grids_of_heights_are_those_for_the_place() {
        let crs = |text: &str| Crs::parse(text).unwrap();
        let named = |from: &str, to: &str, place| -> Vec<String> {
            of_heights(&crs(from), &crs(to), place).into_iter().map(|grid| grid.name).collect()
        };
        let new_york = Some((-74.0, 40.75));
        for navd88 in ["EPSG:4326+5703", "EPSG:4326+6360"] {
            assert_eq!(named("EPSG:4979", navd88, new_york)[0], "us_noaa_g2018u0.tif", "{navd88}");
        }
        let anchorage = named("EPSG:4979", "EPSG:4326+5703", Some((-149.9, 61.2)));
        assert!(anchorage.iter().all(|name| name.contains("ak") || name.contains("ba0")), "{anchorage:?}");
        // A grid for one place says which: the middle of its area of use.
        assert_eq!(named("EPSG:32118+5703", "EPSG:4979", None)[0], "us_noaa_g2018u0.tif");
        let levels = named("EPSG:4326+7968", "EPSG:4326+5703", new_york);
        assert!(levels.iter().all(|name| name.contains("vertcon")), "{levels:?}");
    }
}
