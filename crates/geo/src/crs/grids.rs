//! What PROJ's own database knows: grid files of transformations, codes of names.

use gdal::vector::{Feature, LayerAccess as _, sql::Dialect};

use super::{Better, Crs};

/// A grid file.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Grid {
    name: String,
    url: String,
}

impl std::fmt::Display for Grid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.url.is_empty() { f.write_str(&self.name) } else { write!(f, "{} from {}", self.name, self.url) }
    }
}

/// Grids between the ellipsoid and the vertical systems of either side; empty where neither has one or the database
/// cannot be read.
pub(super) fn of_heights(from: &Crs, to: &Crs) -> Vec<Grid> {
    let mut grids: Vec<Grid> = [from, to]
        .into_iter()
        .filter_map(Crs::vertical_epsg)
        .flat_map(|code| of_vertical(code).unwrap_or_default())
        .collect();
    grids.sort();
    grids.dedup();
    grids
}

fn of_vertical(epsg: u32) -> Option<Vec<Grid>> {
    let query = format!(
        "SELECT DISTINCT COALESCE(NULLIF(a.proj_grid_name, ''), g.grid_name) AS name, a.url AS url \
         FROM grid_transformation g LEFT JOIN grid_alternatives a ON a.original_grid_name = g.grid_name \
         WHERE g.deprecated = 0 AND g.grid_name <> '' AND ((g.target_crs_auth_name = 'EPSG' AND g.target_crs_code = '{epsg}') \
         OR (g.source_crs_auth_name = 'EPSG' AND g.source_crs_code = '{epsg}'))"
    );
    rows(&query, |feature| Some(Grid { name: text(feature, "name")?, url: text(feature, "url").unwrap_or_default() }))
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
        let grid = Grid { name: text(feature, "grid")?, url: text(feature, "url").unwrap_or_default() };
        let accuracy_m = text(feature, "accuracy")?.parse().ok()?;
        Some(Better { name: text(feature, "operation")?, accuracy_m, grid: grid.to_string() })
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

/// What a query of PROJ's database yields; `None` where the database cannot be read.
fn rows<T>(query: &str, row: impl Fn(&Feature<'_>) -> Option<T>) -> Option<Vec<T>> {
    crate::gdal_log::route_messages();
    let folders = proj::ProjBuilder::new().lib_info().ok()?.searchpath;
    let separator = if cfg!(windows) { ';' } else { ':' };
    let database = folders.split(separator).map(|f| std::path::Path::new(f).join("proj.db")).find(|f| f.is_file())?;
    let dataset = gdal::Dataset::open(&database).ok()?;
    let Some(mut found) = dataset.execute_sql(query, None, Dialect::DEFAULT).ok()? else { return Some(Vec::new()) };
    Some(found.features().filter_map(|feature| row(&feature)).collect())
}

fn text(feature: &Feature<'_>, field: &str) -> Option<String> {
    let index = feature.field_index(field).ok()?;
    feature.field_as_string(index).ok().flatten()
}
