//! Mistakes that people make in the first hour: message, hint and exit code of each.

use std::fs;

use serde_json::json;

use crate::tiny_scene::{N_BUILDINGS, Scene};

/// One mistake: how it is made, what is called, and what is said of it.
struct Mistake {
    made: &'static str,
    make: fn(&Scene),
    args: &'static [&'static str],
    code: i32,
    /// Words of the message, before the hint.
    says: &'static [&'static str],
    /// Words of the hint.
    hint: &'static [&'static str],
}

const RUN: &[&str] = &["run", "sizeup.toml"];
const TILED: &[&str] = &["run", "sizeup.toml", "--tiled", "--heights", "none"];

fn nothing(_: &Scene) {}

/// Writes something else into the configuration.
fn set(scene: &Scene, from: &str, to: &str) {
    scene.edit("sizeup.toml", |text| text.replace(from, to));
}

fn points(scene: &Scene) {
    scene.change_footprints(|features| {
        for feature in features {
            let corner = feature["geometry"]["coordinates"][0][0].clone();
            feature["geometry"] = json!({ "type": "Point", "coordinates": corner });
        }
    });
}

fn without_terrain(scene: &Scene) {
    scene.edit("sizeup.toml", |text| {
        let table = text.find("[terrain]").unwrap();
        let next = text[table + 1..].find("\n[").map_or(text.len(), |at| table + 1 + at);
        format!("# Our town, from the air\n{}{}", &text[..table], &text[next..])
    });
}

/// Moves the poses, metres.
fn offset(scene: &Scene, by: [f64; 3]) {
    let text = fs::read_to_string(scene.path("sizeup.toml")).unwrap();
    let line = text.lines().find(|line| line.starts_with("offset")).unwrap();
    let numbers = line.split_once('[').unwrap().1.trim_end_matches(']');
    let offset = numbers.split(',').zip(by).map(|(number, by)| number.trim().parse::<f64>().unwrap() + by);
    set(scene, line, &format!("offset = {:?}", offset.collect::<Vec<f64>>()));
}

fn elsewhere(scene: &Scene) {
    offset(scene, [5000.0, 0.0, 0.0]);
    // A constant ground everywhere: the terrain model would not reach there.
    set(scene, "dtm = \"dtm.tif\"", "constant_m = 0.0");
}

/// Footprints and poses are in zone 32, and said to be in zone 33; the terrain model is where it belongs.
fn all_in_zone_33(scene: &Scene) {
    scene.change_footprints(|_| {});
    scene.edit("footprints.geojson", |text| text.replace("25832", "25833"));
    set(scene, "EPSG:25832", "EPSG:25833");
}

/// One corner of the first footprint lies far in the east.
fn long_footprint(scene: &Scene) {
    scene.change_footprints(|features| {
        let corner = &mut features[0]["geometry"]["coordinates"][0][1][0];
        *corner = json!(corner.as_f64().unwrap() + 1_000_000.0);
    });
}

fn square_priors(scene: &Scene) {
    for stem in scene.stems() {
        scene.write_prior(&stem, 100, 100, &vec![1.0; 100 * 100]);
    }
}

fn footprints_as_table(scene: &Scene) {
    fs::write(scene.path("footprints.csv"), "id;WKT\na;\"POLYGON ((0 0, 9 0, 9 9, 0 9, 0 0))\"\n").unwrap();
    set(scene, "footprints.gpkg", "footprints.csv");
}

fn metres_as_degrees(scene: &Scene) {
    let mut layer = scene.json("truth.geojson");
    layer.as_object_mut().unwrap().remove("crs");
    fs::write(scene.path("footprints.geojson"), layer.to_string()).unwrap();
    set(scene, "footprints.gpkg", "footprints.geojson");
}

fn poses_without_angles(scene: &Scene) {
    fs::write(scene.path("poses.csv"), "name,x,y,z\na.jpg,565000,5932000,100\n").unwrap();
    set(scene, "format = \"colmap\"", "format = \"csv\"");
    set(scene, "\"sparse\"", "\"poses.csv\"");
}

/// The mistakes of a first hour.
const MISTAKES: [Mistake; 48] = [
    Mistake {
        made: "points in place of footprints",
        make: points,
        args: RUN,
        code: 3,
        says: &[
            "[footprints]",
            "none of the 6 footprints can be used: 6 footprint_not_a_polygon",
            "its geometry is not a polygon",
        ],
        hint: &["polygons"],
    },
    Mistake {
        made: "a terrain model that is not there",
        make: |scene| fs::remove_file(scene.path("dtm.tif")).unwrap(),
        args: RUN,
        code: 3,
        says: &["[terrain]", "dtm.tif does not exist"],
        hint: &["path"],
    },
    Mistake {
        made: "a table left out, below a comment",
        make: without_terrain,
        args: RUN,
        code: 2,
        says: &["the table [terrain] is missing"],
        hint: &["dtm = ", "constant_m = "],
    },
    Mistake {
        made: "a prior without its source",
        make: |scene| set(scene, "source = \"files\"\n", ""),
        args: RUN,
        code: 2,
        says: &["source"],
        hint: &["\"files\"", "\"network\"", "\"stereo\"", "\"auto\""],
    },
    Mistake {
        made: "a misspelt preset",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "optimise.preset=papr"],
        code: 2,
        says: &["--set optimise.preset=papr"],
        hint: &["did you mean `paper`?", "robust", "paper"],
    },
    Mistake {
        made: "a misspelt kind of prior in the file",
        make: |scene| set(scene, "inverse_depth", "invrese_depth"),
        args: RUN,
        code: 2,
        says: &["sizeup.toml", "invrese_depth"],
        hint: &["depth, inverse-depth"],
    },
    Mistake {
        made: "an output that is a file",
        make: |scene| fs::write(scene.path("notes.txt"), "mine").unwrap(),
        args: &["run", "sizeup.toml", "--output", "notes.txt"],
        code: 2,
        says: &["notes.txt is a file", "folder"],
        hint: &["--output"],
    },
    Mistake {
        made: "a folder in place of the priors' files",
        make: |scene| set(scene, "priors/{stem}.npy", "priors"),
        args: RUN,
        code: 3,
        says: &["[prior]", "is a folder"],
        hint: &["priors/{stem}.npy"],
    },
    Mistake {
        made: "cameras below the ground",
        make: |scene| offset(scene, [0.0, 0.0, -300.0]),
        args: RUN,
        code: 3,
        says: &["below the ground"],
        hint: &["survey.offset", "terrain.vertical_offset_m"],
    },
    Mistake {
        made: "poses five kilometres off",
        make: elsewhere,
        args: &["run", "sizeup.toml", "--until", "footprints"],
        code: 3,
        says: &["no view sees any footprint"],
        hint: &["offset", "CRS"],
    },
    Mistake {
        made: "poses five kilometres off, in tiles",
        make: elsewhere,
        args: TILED,
        code: 3,
        says: &["no view sees any footprint"],
        hint: &["offset", "CRS"],
    },
    Mistake {
        made: "priors of another shape",
        make: square_priors,
        args: RUN,
        code: 3,
        says: &["none of the", "priors", "100 × 100"],
        hint: &["resized photos"],
    },
    Mistake {
        made: "degrees as the project's CRS",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "project.crs=EPSG:4326"],
        code: 2,
        says: &["EPSG:4326", "WGS 84", "projected CRS in metres"],
        hint: &["UTM"],
    },
    Mistake {
        made: "Web Mercator as the project's CRS",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "project.crs=EPSG:3857"],
        code: 2,
        says: &["EPSG:3857", "Web Mercator"],
        hint: &["UTM"],
    },
    Mistake {
        made: "a CRS that nobody knows",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "project.crs=EPSG:99999999"],
        code: 2,
        says: &["unknown CRS", "EPSG:99999999"],
        hint: &["EPSG:25832"],
    },
    Mistake {
        made: "the neighbouring zone",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "project.crs=EPSG:25833"],
        code: 3,
        says: &["no view sees any footprint", " km from the cameras", "the cameras in E"],
        hint: &["CRS is the likely cause", "project.crs = \"EPSG:25832\""],
    },
    Mistake {
        made: "the neighbouring zone where the photos are to tell the ground",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "project.crs=EPSG:25833", "--set", "dtm.within_m=15"],
        code: 3,
        says: &["no view sees any footprint", " km from the cameras"],
        hint: &["project.crs = \"EPSG:25832\""],
    },
    Mistake {
        made: "the neighbouring zone for all but the terrain model",
        make: all_in_zone_33,
        args: RUN,
        code: 3,
        says: &["[terrain]", "dtm.tif", " km away"],
        hint: &["not the model", "project.crs = \"EPSG:25832\""],
    },
    Mistake {
        made: "an inverted prior",
        make: |scene| set(scene, "kind = \"inverse_depth\"", "kind = \"depth\""),
        args: RUN,
        code: 3,
        says: &["[prior] the prior is inverted: in all ", "rank correlation -"],
        hint: &["prior.kind = \"inverse_depth\" (now \"depth\")"],
    },
    Mistake {
        made: "a Windows path in double quotes that is no TOML",
        make: |scene| set(scene, "path = \"sparse\"", r#"path = "D:\survey\sparse""#),
        args: RUN,
        code: 2,
        says: &["sizeup.toml", r"D:\survey\sparse"],
        hint: &["\"D:/survey/sparse\"", r"'D:\survey\sparse'"],
    },
    Mistake {
        made: "a Windows path in double quotes that TOML reads as something else",
        make: |scene| set(scene, "path = \"sparse\"", r#"path = "C:\flight\new""#),
        args: RUN,
        code: 2,
        says: &[r#"`survey.path = "C:\flight\new"` holds control characters"#],
        hint: &["\"C:/flight/new\"", r"'C:\flight\new'"],
    },
    Mistake {
        made: "the same on the command line",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", r#"terrain.dtm="D:\dtm.tif""#],
        code: 2,
        says: &["--set terrain.dtm=", "\"D:/dtm.tif\""],
        hint: &["--set"],
    },
    Mistake {
        made: "another source of priors on the command line, without photos",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "prior.source=stereo"],
        code: 2,
        says: &["[prior]", "computed from the photos"],
        hint: &["survey.images"],
    },
    Mistake {
        made: "a footprint with a corner a thousand kilometres away",
        make: long_footprint,
        args: RUN,
        code: 3,
        says: &["[footprints] the footprint ", "is 1000 km long"],
        hint: &["mend the footprint"],
    },
    Mistake {
        made: "a footprint with a corner a thousand kilometres away, in tiles",
        make: long_footprint,
        args: TILED,
        code: 3,
        says: &["[footprints] the footprint ", "is 1000 km long"],
        hint: &["mend the footprint"],
    },
    Mistake {
        made: "footprints without a CRS",
        make: footprints_as_table,
        args: RUN,
        code: 3,
        says: &["footprints.csv", "no CRS"],
        hint: &["`crs`"],
    },
    Mistake {
        made: "metres that claim to be degrees",
        make: metres_as_degrees,
        args: RUN,
        code: 3,
        says: &["footprints.geojson", "no longitude and latitude"],
        hint: &["`crs`"],
    },
    Mistake {
        made: "a layer without a feature",
        make: |scene| scene.change_footprints(Vec::clear),
        args: RUN,
        code: 3,
        says: &["footprints.geojson", "is empty"],
        hint: &["`layer`"],
    },
    Mistake {
        made: "footprints that are not there",
        make: |scene| fs::remove_file(scene.path("footprints.gpkg")).unwrap(),
        args: RUN,
        code: 3,
        says: &["[footprints]", "footprints.gpkg does not exist"],
        hint: &["path"],
    },
    Mistake {
        made: "a field of ids that is not there",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "footprints.id_field=gml_id"],
        code: 3,
        says: &["footprints.gpkg", "gml_id"],
        hint: &["id_field", "id"],
    },
    Mistake {
        made: "a layer of the file that is not there",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "footprints.layer=houses"],
        code: 3,
        says: &["no layer \"houses\"", "footprints"],
        hint: &["layer"],
    },
    Mistake {
        made: "a raster in place of footprints",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "footprints.path=dtm.tif"],
        code: 3,
        says: &["dtm.tif", "no format of layers"],
        hint: &["extension"],
    },
    Mistake {
        made: "a misspelt key",
        make: |scene| set(scene, "path = \"sparse\"", "pth = \"sparse\""),
        args: RUN,
        code: 2,
        says: &["sizeup.toml", "unknown field `pth`", "`path`"],
        hint: &["did you mean `path`?", "sizeup schema run"],
    },
    Mistake {
        made: "a misspelt table",
        make: |scene| set(scene, "[ground]", "[gruond]"),
        args: RUN,
        code: 2,
        says: &["unknown field `gruond`", "`ground`"],
        hint: &["did you mean `ground`?", "sizeup schema run"],
    },
    Mistake {
        made: "a key without a value",
        make: |scene| set(scene, "seed = 1", "seed ="),
        args: RUN,
        code: 2,
        says: &["sizeup.toml", "line 2"],
        hint: &["sizeup schema run"],
    },
    Mistake {
        made: "a configuration that is not there",
        make: nothing,
        args: &["run", "absent.toml"],
        code: 2,
        says: &["cannot read the configuration absent.toml"],
        hint: &["sizeup init FOLDER"],
    },
    Mistake {
        made: "a raster in place of the configuration",
        make: nothing,
        args: &["run", "dtm.tif"],
        code: 2,
        says: &["cannot read the configuration dtm.tif"],
        hint: &["text file"],
    },
    Mistake {
        made: "a setting without a value",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "optimise.preset"],
        code: 2,
        says: &["--set optimise.preset", "key=value"],
        hint: &["--set optimise.preset=paper"],
    },
    Mistake {
        made: "a setting that there is none of",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "optimise.prest=paper"],
        code: 2,
        says: &["unknown field `prest`", "`preset`"],
        hint: &["did you mean `preset`?", "sizeup schema run"],
    },
    Mistake {
        made: "heights that cannot be",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "heights.min_m=20", "--set", "heights.max_m=20"],
        code: 2,
        says: &["heights from 20 to 20 m"],
        hint: &["heights.min_m", "heights.max_m"],
    },
    Mistake {
        made: "a fallback without its attribute",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "output.fallback.source=attribute"],
        code: 2,
        says: &["no attribute is named"],
        hint: &["storeys"],
    },
    Mistake {
        made: "a fallback from an attribute of no footprint",
        make: nothing,
        args: &[
            "run",
            "sizeup.toml",
            "--set",
            "output.fallback={source=\"attribute\",attribute=\"storeys\",metres_per_unit=3}",
        ],
        code: 2,
        says: &["none of the footprints has an attribute", "storeys"],
        hint: &["ogrinfo"],
    },
    Mistake {
        made: "a folder of photos that is not there",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "survey.images=imagse"],
        code: 3,
        says: &["no folder imagse"],
        hint: &["folder of the photos"],
    },
    Mistake {
        made: "poses that are not there",
        make: |scene| fs::remove_dir_all(scene.path("sparse")).unwrap(),
        args: RUN,
        code: 3,
        says: &["sparse", "images.txt"],
        hint: &["folder of the model"],
    },
    Mistake {
        made: "poses without angles",
        make: poses_without_angles,
        args: RUN,
        code: 3,
        says: &["poses.csv, line 1", "no column", "omega"],
        hint: &["[survey.csv]"],
    },
    Mistake {
        made: "two kinds of ground",
        make: |scene| set(scene, "dtm = \"dtm.tif\"", "dtm = \"dtm.tif\"\nconstant_m = 3.0"),
        args: RUN,
        code: 3,
        says: &["both `dtm` and `constant_m`"],
        hint: &["one of them"],
    },
    Mistake {
        made: "stages in the wrong order",
        make: nothing,
        args: &["run", "sizeup.toml", "--from", "output", "--until", "survey"],
        code: 2,
        says: &["--from output comes after --until survey"],
        hint: &["survey, footprints, heights, output"],
    },
    Mistake {
        made: "stereo without photos",
        make: nothing,
        args: &["run", "sizeup.toml", "--set", "prior={source=\"stereo\"}"],
        code: 2,
        says: &["[prior]", "computed from the photos"],
        hint: &["survey.images"],
    },
];

impl Mistake {
    /// What is wrong with the answer to it.
    fn faults(&self) -> Vec<String> {
        let scene = Scene::new();
        (self.make)(&scene);
        let outcome = scene.sizeup(self.args);
        let (said, advice) = outcome.stderr.split_once("hint: ").unwrap_or((&outcome.stderr, ""));
        let mut faults = Vec::new();
        if outcome.code != self.code {
            faults.push(format!("code {}, expected {}", outcome.code, self.code));
        }
        let lacks = |text: &str, words: &[&str]| -> Vec<String> {
            words.iter().filter(|word| !text.contains(**word)).map(|word| format!("{word:?} is missing")).collect()
        };
        faults.extend(lacks(said, self.says).into_iter().chain(lacks(advice, self.hint)));
        let noise = ["NULL", "panicked", "Our town", "`survey.accept_unsound", "tracing rays"];
        let told = noise.iter().filter(|word| outcome.stderr.contains(**word));
        faults.extend(told.map(|word| format!("{word:?} is said")));
        if scene.path("result/city.gpkg").exists() || scene.path("result/stages/heights.json").exists() {
            faults.push("something was computed".to_owned());
        }
        faults.iter().map(|fault| format!("{}: {fault}: {}", self.made, outcome.stderr)).collect()
    }
}

#[test]
fn each_of_the_mistakes_has_its_message_hint_and_exit_code() {
    let faults: Vec<String> = MISTAKES.iter().flat_map(Mistake::faults).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_hyphen_is_no_mistake() {
    let scene = Scene::new();
    let hyphen = scene.run(&["--set", "prior.kind=inverse-depth", "--until", "survey"]);
    assert_eq!(hyphen.code, 0, "{}", hyphen.stderr);
}

#[test]
fn footprints_that_no_photo_shows_are_counted_before_the_heights() {
    let scene = Scene::new();
    scene.change_footprints(|features| {
        let mut far = features[0].clone();
        let corners = far["geometry"]["coordinates"][0].as_array_mut().unwrap();
        corners.iter_mut().for_each(|at| at[0] = json!(at[0].as_f64().unwrap() + 5000.0));
        far["properties"]["id"] = json!("far");
        features.push(far);
    });
    scene.edit("sizeup.toml", |text| text.replace("dtm = \"dtm.tif\"", "constant_m = 0.0"));
    let outcome = scene.run(&["--until", "footprints"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let message = format!("1 of {} footprints are in no photo", N_BUILDINGS + 1);
    assert!(outcome.stderr.contains(&format!("above all: {message}")), "{}", outcome.stderr);
    assert_eq!(scene.issues("footprints_unseen")[0]["message"], message);
}

#[test]
fn photos_that_are_missing_are_failed_items_of_a_tiled_run_too() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    let stems = scene.stems();
    for stem in &stems[1..] {
        fs::write(scene.path(&format!("images/{stem}.jpg")), b"").unwrap();
    }
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    scene.edit("sizeup.toml", |text| text.replace("[optimise]\n", "[refinement]\nenabled = false\n\n[optimise]\n"));
    let outcome = scene.run(&["--tiled"]);
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("1 photo missing"), "{}", outcome.stderr);
    assert_eq!(scene.json("result/summary.json")["n_photos_missing"], 1);
}

#[test]
fn photos_that_are_missing_are_failed_items() {
    let scene = Scene::new();
    fs::create_dir(scene.path("images")).unwrap();
    let stems = scene.stems();
    for stem in &stems[stems.len() / 2..] {
        fs::write(scene.path(&format!("images/{stem}.jpg")), b"").unwrap();
    }
    scene.edit("sizeup.toml", |text| text.replace("path = \"sparse\"", "path = \"sparse\"\nimages = \"images\""));
    scene.edit("sizeup.toml", |text| text.replace("[optimise]\n", "[refinement]\nenabled = false\n\n[optimise]\n"));
    let outcome = scene.run(&[]);
    assert_eq!(outcome.code, 5, "{}", outcome.stderr);
    assert_eq!(scene.json("result/summary.json")["n_photos_missing"], stems.len() / 2);
}

#[test]
fn the_doctor_names_what_a_configuration_lacks() {
    let scene = Scene::new();
    let sound = scene.sizeup(&["check", "sizeup.toml"]);
    assert_eq!(sound.code, 0, "{}{}", sound.stdout, sound.stderr);
    for word in ["GDAL's GPKG: there", "memory: ", "survey.path: ", "prior.path: "] {
        assert!(sound.stdout.contains(word), "{word:?} is missing in: {}", sound.stdout);
    }
    fs::remove_file(scene.path("dtm.tif")).unwrap();
    let lacking = scene.sizeup(&["check", "sizeup.toml"]);
    assert_eq!(lacking.code, 3, "{}", lacking.stdout);
    let line = lacking.stdout.lines().find(|line| line.starts_with("MISSING")).unwrap();
    assert!(line.contains("terrain.dtm") && line.contains("does not exist"), "{line}");
    let json: serde_json::Value =
        serde_json::from_str(&scene.sizeup(&["check", "sizeup.toml", "--json"]).stdout).unwrap();
    let states: Vec<&str> = json.as_array().unwrap().iter().filter_map(|f| f["state"].as_str()).collect();
    assert_eq!(states.iter().filter(|state| **state == "missing").count(), 1, "{json}");
}

/// An empty folder of PROJ's, with its database alone.
fn proj_without_grids() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let database = sizeup::crs::data_folders().into_iter().map(|f| f.join("proj.db")).find(|f| f.is_file()).unwrap();
    fs::copy(database, folder.path().join("proj.db")).unwrap();
    folder
}

#[test]
fn the_doctor_lists_projs_grids_and_names_the_one_that_a_configuration_lacks_with_what_brings_it() {
    let scene = Scene::new();
    let bare = proj_without_grids();
    let doctor = |more: &[&str], folder: &std::path::Path| -> (Option<i32>, Vec<serde_json::Value>) {
        let mut command = crate::tiny_scene::sizeup();
        command
            .current_dir(scene.path(""))
            .env("PROJ_DATA", folder)
            .env("PROJ_LIB", folder)
            .env("PROJ_USER_WRITABLE_DIRECTORY", folder);
        let output = command.args([&["check", "sizeup.toml", "--json"], more].concat()).output().unwrap();
        (output.status.code(), serde_json::from_slice(&output.stdout).unwrap())
    };
    let of = |found: &[serde_json::Value], what: &str| -> [String; 3] {
        let found = found.iter().find(|one| one["what"].as_str().unwrap().starts_with(what));
        let found = found.unwrap_or_else(|| panic!("{what}"));
        ["state", "found", "hint"].map(|key| found[key].as_str().unwrap_or_default().to_owned())
    };
    let (_, found) = doctor(&[], bare.path());
    assert_eq!(of(&found, "PROJ's grids")[1], "none");
    assert!(of(&found, "PROJ")[1].contains(bare.path().to_str().unwrap()), "{found:?}");

    // Heights above Amsterdam's zero need a grid where positions come from satellites, and only there.
    let dutch = ["--set", "project.crs=EPSG:7415"];
    let (_, found) = doctor(&dutch, bare.path());
    let [state, _, hint] = of(&found, "PROJ's grid of the heights");
    assert!(state == "absent" && hint.contains("`projsync --file nl_nsgi_nlgeo2018.tif`"), "{state}: {hint}");
    let satellites = [&dutch[..], &["--set", "survey.height={reference=\"ellipsoidal\"}"]].concat();
    let (code, found) = doctor(&satellites, bare.path());
    assert_eq!((code, of(&found, "PROJ's grid of the heights")[0].as_str()), (Some(3), "missing"));
    let stated = [&dutch[..], &["--set", "survey.height={reference=\"ellipsoidal\",geoid_offset=43.5}"]].concat();
    assert_eq!(of(&doctor(&stated, bare.path()).1, "PROJ's grid of the heights")[0], "absent");

    // Great Britain's plane is known to 2 m without its grid.
    let british = ["--set", "project.crs=EPSG:27700", "--set", "survey.crs=EPSG:4258"];
    let (_, found) = doctor(&british, bare.path());
    let [state, told, hint] = of(&found, "PROJ's way from survey.crs");
    assert!(
        state == "absent" && told.contains("OSTN15") && hint.contains("`projsync --file uk_os_OSTN15"),
        "{told}: {hint}"
    );

    fs::write(bare.path().join("any.tif"), "a grid").unwrap();
    assert_eq!(of(&doctor(&[], bare.path()).1, "PROJ's grids")[1], "any.tif");
}

#[test]
fn the_doctor_names_networks_masks_and_a_folder_that_nobody_can_write() {
    let scene = Scene::new();
    let of = |more: &[&str]| {
        let networks = scene.path("networks").to_string_lossy().into_owned();
        let args = [&["check", "sizeup.toml", "--json"], more].concat();
        let output = crate::tiny_scene::sizeup()
            .current_dir(scene.path(""))
            .env("SIZEUP_MODELS", networks)
            .args(args)
            .output()
            .unwrap();
        let found: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
        let of_name = move |what: &str| {
            let found = found.iter().find(|one| one["what"] == what).unwrap_or_else(|| panic!("{what}: {found:?}"));
            [&found["state"], &found["hint"]].map(|word| word.as_str().unwrap_or_default().to_owned())
        };
        (output.status.code(), of_name)
    };
    let (code, found) = of(&[]);
    assert_eq!(
        (code, found("network itermvs")),
        (Some(0), ["absent", "`sizeup model get itermvs`"].map(str::to_owned))
    );
    assert_eq!(found("project.output")[0], "ok");
    let network = "prior={source=\"network\",model=\"itermvs\"}";
    let (code, found) = of(&["--set", network]);
    assert_eq!((code, found("prior.model")[0].as_str()), (Some(3), "missing"));
    assert!(found("prior.model")[1].contains("sizeup model get itermvs"), "{:?}", found("prior.model"));
    let masks = "footprints={source=\"masks\",path=\"nowhere/{stem}.png\",kind=\"instance\"}";
    let (code, found) = of(&["--set", masks]);
    assert_eq!((code, found("footprints.path")[0].as_str()), (Some(3), "missing"));
    fs::write(scene.path("file"), "mine").unwrap();
    let (code, found) = of(&["--set", "project.output=file/result"]);
    assert_eq!((code, found("project.output")[0].as_str()), (Some(3), "missing"));
    let outcome = scene.run(&["--set", network]);
    assert_eq!(outcome.code, 3, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("hint: `sizeup model get itermvs` brings it"), "{}", outcome.stderr);
}

#[test]
fn a_height_that_is_a_guess_is_not_called_measured() {
    let scene = Scene::new();
    let outcome = scene.lab(&["baseline", "constant", "sizeup.toml", "--known", "truth.geojson", "--output", "guess"]);
    assert!([0, 5].contains(&outcome.code), "{}", outcome.stderr);
    let city = scene.json("guess/city.city.json");
    for (id, object) in city["CityObjects"].as_object().unwrap() {
        let attributes = &object["attributes"];
        assert_eq!((&attributes["status"], &attributes["n_views"]), (&json!("fallback"), &json!(0)), "{id}");
        assert_eq!((&attributes["reasons"], &attributes["quality_ok"]), (&json!(["guessed"]), &json!(0)), "{id}");
    }
}
