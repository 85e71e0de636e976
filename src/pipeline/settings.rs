//! Which settings decide what a stage, or a part of a city, comes out as: those that a recipe is kept of.
//!
//! What is listed here is what does *not* count. A table of the configuration that nobody has thought of counts from the
//! first stage on: at worst something is made again that need not be.

use serde_json::{Map, Value, json};

use super::{Stage, poses};
use crate::config::RunConfig;
use sizeup_footprints::FootprintSource;

/// The first stage that a table of the configuration has a say in; the last for those that only writers ask.
fn first_stage(table: &str) -> Stage {
    match table {
        "footprints" | "terrain" | "dtm" | "ground" => Stage::Footprints,
        "seed" | "heights" | "prior" | "optimise" | "refinement" => Stage::Heights,
        "reviews" | "output" | "limits" => Stage::Output,
        _ => Stage::Survey,
    }
}

/// The tables of a configuration; of `auto` priors those that it chooses.
fn tables(config: &RunConfig) -> Map<String, Value> {
    let Value::Object(mut tables) = json!(config) else { return Map::new() };
    tables.insert("prior".to_owned(), json!(*config.prior.chosen()));
    tables
}

/// One table of a configuration.
fn table_of(config: &RunConfig, table: &str) -> Value {
    tables(config).remove(table).unwrap_or_default()
}

/// Whether footprints are found by a network that may take its depth from the run's priors.
fn depth_of_footprints_is_prior(config: &RunConfig) -> bool {
    matches!(&config.footprints, FootprintSource::Network(network) if network.depth.is_none())
}

/// Takes keys out of one of the tables.
fn without(tables: &mut Map<String, Value>, table: &str, keys: &[&str]) {
    if let Some(Value::Object(table)) = tables.get_mut(table) {
        keys.iter().for_each(|&key| drop(table.remove(key)));
    }
}

/// The settings that decide what a stage and those before it come out as, a table of tables, wherever the results go.
pub(super) fn of_stage(config: &RunConfig, stage: Stage) -> Value {
    let saved = config.saved();
    let mut tables = tables(&saved);
    tables.retain(|name, _| first_stage(name) <= stage && first_stage(name) < Stage::Output);
    // Results go where they go; the day and the name of the datum are for writers.
    without(&mut tables, "project", &["output", "vertical_reference", "reference_date"]);
    if poses::asks(config) {
        tables.insert("ground of poses".to_owned(), json!(saved.terrain));
    } else {
        tables.remove("align");
    }
    if stage >= Stage::Footprints && depth_of_footprints_is_prior(config) {
        let depth = json!([table_of(&saved, "prior"), saved.heights]);
        tables.insert("depth of footprints".to_owned(), depth);
    }
    // A level is held against the poses; photos are looked at where depth is matched from them.
    tables.insert("level of poses".to_owned(), json!(saved.terrain.constant_m));
    tables.insert("photos are looked at".to_owned(), json!(config.prior.matches_photos()));
    Value::Object(tables)
}

/// The settings that decide what a part of a city comes out as, a table of tables: not those of the survey, whose views are
/// given, nor of the reviews, which are read, nor those of what is made of all parts.
#[must_use]
pub fn part_settings(config: &RunConfig) -> Value {
    let mut tables = tables(config);
    for given in ["survey", "align", "reviews", "limits"] {
        tables.remove(given);
    }
    without(&mut tables, "project", &["output"]);
    without(&mut tables, "output", &["pictures", "geopackage", "report", "textures"]);
    Value::Object(tables)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;

    use super::*;
    use crate::recipe::Recipe;

    const TEXT: &str = "\
        [project]\ncrs = \"EPSG:25832\"\n[survey]\npath = \"poses\"\n[footprints]\npath = \"a.gpkg\"\n\
        [terrain]\nconstant_m = 3.0\n[prior]\nsource = \"files\"\npath = \"{stem}.npy\"\nkind = \"depth\"\n";
    /// Poses are taken as they are.
    const AS_GIVEN: &str = "align.when=\"never\"";

    fn with(assignments: &[&str]) -> RunConfig {
        let assignments: Vec<String> = assignments.iter().map(|&a| a.to_owned()).collect();
        RunConfig::from_text(TEXT, Path::new("sizeup.toml"), &assignments).unwrap()
    }

    /// Whether one configuration makes what another came out as stale, by the first stages up to one.
    fn is_stale(stage: Stage, before: &RunConfig, now: &RunConfig) -> bool {
        let recipe = |config: &RunConfig| Recipe::new(&of_stage(config, stage));
        recipe(now).why_stale(&recipe(before)).is_some()
    }

    /// One change of each table, where poses are taken as they are: the first stage that it makes stale, and whether it
    /// does a part of a city.
    const CHANGES: [(&str, Option<Stage>, bool); 22] = [
        ("seed=7", Some(Stage::Heights), true),
        ("project.crs=\"EPSG:25833\"", Some(Stage::Survey), true),
        ("project.output=\"elsewhere\"", None, false),
        ("project.vertical_reference=\"NAP\"", None, true),
        ("project.reference_date=\"2026-05-01\"", None, true),
        ("survey.accept_unsound=true", Some(Stage::Survey), false),
        ("align.when=\"always\"", Some(Stage::Survey), false),
        ("footprints.path=\"b.gpkg\"", Some(Stage::Footprints), true),
        ("terrain.vertical_offset_m=1.0", Some(Stage::Footprints), true),
        ("terrain.constant_m=4.0", Some(Stage::Survey), true),
        ("dtm.spacing_m=20.0", Some(Stage::Footprints), true),
        ("ground.reference=\"mean\"", Some(Stage::Footprints), true),
        ("heights.max_m=12.0", Some(Stage::Heights), true),
        ("prior.kind=\"inverse_depth\"", Some(Stage::Heights), true),
        ("optimise.working_px=300", Some(Stage::Heights), true),
        ("refinement.min_score=0.9", Some(Stage::Heights), true),
        ("refinement.enabled=false", Some(Stage::Heights), true),
        ("reviews.path=\"reviews.geojson\"", None, false),
        ("output.fallback.source=\"attribute\"", None, true),
        ("output.pictures=false", None, false),
        ("output.textures.enabled=true", None, false),
        ("limits.input_mb=100", None, false),
    ];

    #[test]
    fn a_change_of_any_table_makes_stale_what_it_decides_and_nothing_else() {
        let stages = [Stage::Survey, Stage::Footprints, Stage::Heights];
        let recipe = |config: &RunConfig, stage| Recipe::new(&of_stage(config, stage));
        let before = with(&[AS_GIVEN]);
        let mut seen: BTreeMap<String, bool> = BTreeMap::new();
        for (change, first, is_of_part) in CHANGES {
            let now = with(&[AS_GIVEN, change]);
            assert!(now != before, "{change} is a change");
            for stage in stages {
                let why = recipe(&now, stage).why_stale(&recipe(&before, stage));
                assert_eq!(why.is_some(), first.is_some_and(|first| first <= stage), "{change}, {stage:?}: {why:?}");
            }
            let why = Recipe::new(&part_settings(&now)).why_stale(&Recipe::new(&part_settings(&before)));
            assert_eq!(why.is_some(), is_of_part, "{change}, a part: {why:?}");
            seen.insert(change.split(['.', '=']).next().unwrap_or_default().to_owned(), true);
        }
        let Value::Object(tables) = json!(with(&["dtm.spacing_m=20.0", "reviews.path=\"reviews.geojson\""])) else {
            panic!("a configuration is a table")
        };
        let forgotten: Vec<&String> = tables.keys().filter(|name| !seen.contains_key(*name)).collect();
        assert!(forgotten.is_empty(), "tables that no change here is of: {forgotten:?}");
    }

    /// Poses that may be aligned with the photos stand over the ground: another ground, or no say of photos, other poses.
    #[test]
    fn the_ground_counts_for_poses_that_may_be_aligned() {
        for change in ["terrain.vertical_offset_m=1.0", "refinement.enabled=false", AS_GIVEN] {
            assert!(is_stale(Stage::Survey, &with(&[]), &with(&[change])), "{change}");
        }
        assert!(!is_stale(Stage::Survey, &with(&[]), &with(&["refinement.min_score=0.9"])));
        let before = with(&["refinement.enabled=false"]);
        assert!(!is_stale(
            Stage::Survey,
            &before,
            &with(&["refinement.enabled=false", "terrain.vertical_offset_m=1.0"])
        ));
    }

    /// A network that has no depth of its own takes the run's: other priors, other footprints.
    #[test]
    fn priors_count_for_footprints_where_the_network_takes_its_depth_from_them() {
        let own = "footprints={source=\"network\", depth={path=\"d/{stem}.npy\", kind=\"depth\"}}";
        let stale = |network: &str| {
            is_stale(Stage::Footprints, &with(&[network]), &with(&[network, "prior.kind=\"inverse_depth\""]))
        };
        assert!(stale("footprints={source=\"network\"}") && !stale(own));
    }

    #[test]
    fn a_table_that_nobody_thought_of_counts_from_the_first_stage() {
        assert_eq!(first_stage("new"), Stage::Survey);
    }
}
