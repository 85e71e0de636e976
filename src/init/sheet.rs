//! What the configuration says, table by table.

use std::path::Path;

use super::InitRequest;
use super::checks::n_uncalibrated;
use super::file::{ConfigEntry, ConfigText, quoted};
use super::folder::name_of;
use super::placing::Placed;
use super::project::{Findings, Story, home_of};
use sizeup_survey::{Format, PoseWorld};

/// The configuration with its comments.
pub(super) fn text(request: &InitRequest, story: &Story) -> String {
    let home = home_of(&request.output);
    let mut sheet = ConfigText::default();
    head(&mut sheet, request, story);
    project(&mut sheet, story.placed.as_ref());
    survey(&mut sheet, &home, &story.found, story.placed.as_ref());
    footprints(&mut sheet, &home, &story.found);
    terrain(&mut sheet, &home, &story.found, story.placed.as_ref());
    sheet.table("prior");
    let about = "depth: a network if one is in place (`sizeup model list`), else stereo from the photos";
    sheet.entries(&[ConfigEntry::new("source", "\"auto\"", about)]);
    if n_uncalibrated(&story.found).is_some() {
        sheet.table("align");
        let about = "the cameras are not calibrated: their focal length is found with the poses";
        sheet.entries(&[ConfigEntry::new("focal_sigma_percent", "5.0", about)]);
    }
    sheet.into_text()
}

fn head(sheet: &mut ConfigText, request: &InitRequest, story: &Story) {
    let (folder, output) = (request.folder.display(), request.output.display());
    sheet.note(&format!("A sizeup project, begun by `sizeup init {folder}`. `sizeup schema run` lists all keys."));
    sheet.note(&story.flight.in_words());
    story.flight.positioning_in_words().iter().for_each(|words| sheet.note(words));
    let lacks: Vec<String> =
        story.notes.lacks.iter().map(|lack| format!("{}: {}. How: {}", lack.what, lack.why, lack.how)).collect();
    if lacks.is_empty() {
        sheet.note(&format!("Nothing is missing: sizeup run {output}"));
    }
    sheet.list("MISSING, before it can be run:", &lacks);
    sheet.list("To know of:", &story.notes.warnings);
    let unused = &story.flight.unused;
    sheet.list(&format!("{} photos or poses are not used, such as:", story.flight.n_unused), unused);
}

fn project(sheet: &mut ConfigText, placed: Option<&Placed>) {
    sheet.table("project");
    let Some(placed) = placed else {
        sheet.entries(&[ConfigEntry::off(
            "crs",
            "\"EPSG:25832\"",
            "MISSING: the projected CRS in metres of the results",
        )]);
        return;
    };
    let frame = &placed.frame;
    let why = format!("{}: {}", frame.crs.name(), frame.why);
    let mut entries = vec![ConfigEntry::new("crs", quoted(&frame.definition), why)];
    match (&placed.datum.vertical_reference, frame.crs.vertical_name()) {
        (_, Some(_)) => {}
        (Some(words), None) => {
            entries.push(ConfigEntry::new("vertical_reference", quoted(words), "what heights count from, in words"));
        }
        (None, None) => entries.push(ConfigEntry::off(
            "vertical_reference",
            "\"DHHN2016\"",
            "what heights count from, in words; the files do not say",
        )),
    }
    entries.push(ConfigEntry::new("output", "\"result\"", "folder of the results, beside this file"));
    sheet.entries(&entries);
}

fn survey(sheet: &mut ConfigText, home: &Path, found: &Findings, placed: Option<&Placed>) {
    let config = &found.source.config;
    sheet.table("survey");
    let converted = placed.map_or("", |placed| placed.datum.unit_of_poses.as_str());
    let mut entries = vec![
        ConfigEntry::new("format", quoted(&config.format.name()), ""),
        ConfigEntry::path("path", &config.path, home, found.why_these_poses() + converted),
    ];
    match &found.images {
        Some(images) if config.format == Format::Photos && images.starts_with(&config.path) => {}
        Some(images) => {
            entries.push(ConfigEntry::path(
                "images",
                images,
                home,
                "folder of the photos, matched to the poses by name",
            ));
        }
        None => entries.push(ConfigEntry::off("images", "\"photos\"", "MISSING: the folder of the photos")),
    }
    if let Some(crs) = &config.crs {
        let by = found.source.placed_by.as_deref().unwrap_or("what the positions look like");
        entries.push(ConfigEntry::new("crs", quoted(&super::frame::short(crs)), format!("of the poses, by {by}")));
    }
    entries.extend(placed.and_then(|placed| datum_to_declare(found, placed)));
    if config.offset != [0.0; 3] {
        let by = found.source.placed_by.as_deref().unwrap_or_default();
        entries.push(ConfigEntry::new(
            "offset",
            format!("{:?}", config.offset),
            format!("added to every position, by {by}"),
        ));
    } else if !found.source.is_placed() {
        let about = "MISSING: what was taken off the positions, metres: easting, northing, height";
        entries.push(ConfigEntry::off("offset", "[565000.0, 5933000.0, 0.0]", about));
    }
    sheet.entries(&entries);
    sheet.list("Also here, not used:", &passed_poses(home, found));
    declared(sheet, config);
    let height = placed.map(|placed| placed.datum.height_entries.as_slice()).unwrap_or_default();
    if !height.is_empty() {
        let is_set = placed.is_some_and(|placed| placed.datum.lacks.is_empty());
        if is_set {
            sheet.table("survey.height");
        } else {
            sheet.table_off("survey.height");
        }
        sheet.entries(height);
    }
}

/// Entry that may bring the poses into a CRS that they do not reach as they are: the datum that they were really taken in.
fn datum_to_declare(found: &Findings, placed: &Placed) -> Option<ConfigEntry> {
    let is_on_earth = matches!(&found.source.look.world, PoseWorld::Named(crs) if crs.is_geographic());
    let base = placed.frame.crs.geographic_base().ok().filter(|_| placed.survey.views.is_empty() && is_on_earth)?;
    let about = "of the poses, if a base station gave them in the datum of the project's CRS";
    Some(ConfigEntry::off("crs", quoted(&super::frame::short(&base)), about))
}

/// Declarations on a table by settings beside the poses: written as they are.
fn declared(sheet: &mut ConfigText, config: &sizeup_survey::SurveyConfig) {
    let Some(csv) = &config.csv else { return };
    let Ok(toml::Value::Table(table)) = toml::Value::try_from(csv) else { return };
    sheet.table("survey.csv");
    sheet.raw(&table.to_string());
}

fn passed_poses(home: &Path, found: &Findings) -> Vec<String> {
    let name = |path: &Path| sizeup_geo::paths::named_from(home, path).display().to_string();
    found.passed.iter().map(|passed| format!("{} ({}): {}", name(&passed.path), passed.format, passed.why)).collect()
}

fn footprints(sheet: &mut ConfigText, home: &Path, found: &Findings) {
    let others: Vec<String> =
        found.footprints.passed.iter().map(|passed| format!("{}: {}", passed.name, passed.why)).collect();
    if let Some(layer) = &found.footprints.chosen {
        sheet.table("footprints");
        let mut entries = vec![ConfigEntry::path("path", &layer.path, home, layer.why.clone())];
        entries
            .extend(layer.layer.as_ref().map(|name| ConfigEntry::new("layer", quoted(name), "of the file's layers")));
        entries.extend(layer.id_field.as_ref().map(|field| {
            ConfigEntry::new("id_field", quoted(field), "attribute that names each building in the results")
        }));
        sheet.entries(&entries);
        sheet.list("Also here, not used:", &others);
        return;
    }
    sheet.table_off("footprints");
    sheet.note("MISSING: the footprints of the buildings. Take the # off when they are there.");
    let about = "a cadastre's, or OpenStreetMap's: .gpkg, .geojson, .shp, .fgb, .osm, .osm.pbf";
    sheet.entries(&[ConfigEntry::off("path", "\"buildings.gpkg\"", about)]);
    sheet.note("or from masks of the photos that look straight down (docs/footprints.md):");
    sheet.entries(&[
        ConfigEntry::off("source", "\"masks\"", ""),
        ConfigEntry::off("path", "\"masks/{stem}.png\"", ""),
        ConfigEntry::off("kind", "\"instance\"", ""),
    ]);
    sheet.list("Looked at, not used:", &others);
}

fn terrain(sheet: &mut ConfigText, home: &Path, found: &Findings, placed: Option<&Placed>) {
    let others: Vec<String> =
        found.ground.passed.iter().map(|passed| format!("{}: {}", name_of(&passed.path), passed.why)).collect();
    let datum = placed.map(|placed| &placed.datum);
    let model = found.ground.chosen.as_ref().filter(|_| datum.is_none_or(|datum| datum.constant_m.is_none()));
    let is_known = model.is_some() || datum.is_some_and(|datum| datum.constant_m.is_some());
    if !is_known {
        sheet.table_off("terrain");
        if placed.is_none_or(|placed| placed.survey.views.is_empty()) {
            sheet.note("The photos may tell the ground once the poses are in place: then run `sizeup init` again with --force.");
        }
        sheet.note("MISSING: where the ground is. Take the # off one of these.");
        sheet.entries(&[
            ConfigEntry::off("dtm", "\"dtm.tif\"", "a terrain model (not a surface model)"),
            ConfigEntry::off(
                "constant_m",
                "12.0",
                "or one height of the ground, in what the poses' heights count from",
            ),
        ]);
        sheet.list("Looked at, not used:", &others);
        return;
    }
    sheet.table("terrain");
    if let Some(model) = model {
        let about = datum.map_or_else(|| model.why.clone(), |datum| datum.ground_in_words.clone());
        sheet.entries(&[ConfigEntry::path("dtm", &model.path, home, about)]);
    }
    sheet.entries(datum.map(|datum| datum.terrain_entries.as_slice()).unwrap_or_default());
    sheet.list("Also here, not used:", &others);
    if let Some(datum) = datum.filter(|datum| datum.is_sharpened) {
        sheet.table("dtm");
        sheet.note("The run finds the terrain in the photos, starting from [terrain].");
        let about = "metres above and below in which it looks; more for hilly places";
        sheet.entries(&[ConfigEntry::new("within_m", format!("{:?}", datum.within_m), about)]);
    } else if model.is_none() {
        sheet.table_off("dtm");
        sheet.note("With this table the run finds the terrain in the photos, starting from [terrain].");
    }
}
