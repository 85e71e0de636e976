//! All the files that a layer or a raster is read from: itself, what lies beside it, and what it refers to.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::files;

/// Files of the same stem that readers of a format look into, by its extension.
const BESIDE: [(&str, &[&str]); 9] = [
    ("shp", &["dbf", "shx", "prj", "cpg", "qpj"]),
    ("tab", &["dat", "map", "id", "ind"]),
    ("mif", &["mid"]),
    ("csv", &["csvt", "prj"]),
    ("gml", &["xsd", "gfs"]),
    ("img", &["ige"]),
    ("bil", &["hdr", "prj", "blw"]),
    ("flt", &["hdr", "prj"]),
    ("asc", &["prj"]),
];
/// Extensions of world files and definitions of a CRS beside a raster.
const BESIDE_RASTERS: [&str; 10] = ["prj", "wld", "tfw", "tifw", "tiffw", "pgw", "pngw", "jgw", "jpgw", "j2w"];
const RASTERS: [&str; 8] = ["tif", "tiff", "png", "jpg", "jpeg", "jp2", "bmp", "webp"];
/// Endings appended to a whole name: metadata, masks, and what a database has not taken over yet.
const APPENDED: [&str; 4] = [".aux.xml", ".msk", "-wal", "-journal"];
/// Descriptions of rasters refer to each other no deeper.
const DEEPEST: usize = 8;

/// Every file that a source is read from, sorted: those of a folder, or the file, what lies beside it and what a VRT refers
/// to. Files that are not there are left out.
#[must_use]
pub fn files_of(path: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    collect(path, DEEPEST, &mut found);
    found
}

fn collect(path: &Path, depth: usize, found: &mut BTreeSet<PathBuf>) {
    if let Ok(entries) = std::fs::read_dir(path) {
        found.extend(entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| p.is_file()));
        return;
    }
    if !path.is_file() || !found.insert(path.to_owned()) {
        return;
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let of_format = BESIDE.iter().filter(|(of, _)| *of == extension).flat_map(|(_, beside)| beside.iter().copied());
    let of_raster = RASTERS.contains(&extension.as_str()).then_some(BESIDE_RASTERS).into_iter().flatten();
    for other in of_format.chain(of_raster) {
        let is_there = |p: &PathBuf| p.is_file();
        let either = [path.with_extension(other), path.with_extension(other.to_uppercase())];
        found.extend(either.into_iter().find(is_there));
    }
    for end in APPENDED {
        let mut name: OsString = path.as_os_str().to_owned();
        name.push(end);
        // What readers leave behind of a database that nobody writes to is empty.
        let is_filled = |p: &PathBuf| p.metadata().is_ok_and(|found| found.is_file() && found.len() > 0);
        let is_remark = |p: &PathBuf| end == ".aux.xml" && has_statistics_alone(p);
        found.extend(Some(PathBuf::from(name)).filter(|p| is_filled(p) && !is_remark(p)));
    }
    if let (true, Some(depth)) = (matches!(extension.as_str(), "vrt" | "ovrt"), depth.checked_sub(1)) {
        referred(path).iter().for_each(|other| collect(other, depth, found));
    }
}

/// Whether metadata beside a raster are statistics alone, such as QGIS leaves behind when it draws one: they do not change how it is read.
fn has_statistics_alone(path: &Path) -> bool {
    const STATISTICS: [&str; 10] = [
        "PAMDataset",
        "PAMRasterBand",
        "Histograms",
        "HistItem",
        "HistMin",
        "HistMax",
        "BucketCount",
        "IncludeOutOfRange",
        "Approximate",
        "HistCounts",
    ];
    let Ok(bytes) = files::read_bytes(path) else { return false };
    let text = String::from_utf8_lossy(&bytes);
    // `Metadata` without attributes is the plain domain; its items are told by their keys.
    let is_statistics = |element: &str| match element.split_whitespace().next() {
        Some("Metadata") => element.trim_end_matches('/').trim() == "Metadata",
        Some("MDI") => element.contains("key=\"STATISTICS_"),
        Some(name) => STATISTICS.contains(&name.trim_end_matches('/')),
        None => false,
    };
    let mut opened =
        text.split('<').skip(1).filter(|rest| !rest.starts_with('/')).filter_map(|rest| rest.split('>').next());
    text.contains("<PAMDataset") && opened.all(is_statistics)
}

/// The files that a VRT names; none where it cannot be read, which its reader says better.
fn referred(path: &Path) -> Vec<PathBuf> {
    let Ok(bytes) = files::read_bytes(path) else { return Vec::new() };
    let text = String::from_utf8_lossy(&bytes);
    let folder = path.parent().unwrap_or(Path::new(""));
    let of_tag = |tag: &'static str| text.split(tag).skip(1).filter_map(move |rest| file_named(rest, folder));
    ["<SourceFilename", "<SourceDataset", "<SrcDataSource"].into_iter().flat_map(of_tag).collect()
}

/// The file that an element names, from behind its name on.
fn file_named(element: &str, folder: &Path) -> Option<PathBuf> {
    let (attributes, rest) = element.split_once('>')?;
    let (name, _) = rest.split_once('<')?;
    let name = name.trim().replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&");
    let is_relative = ["relativeToVRT=\"1\"", "relativetoVRT=\"1\""].iter().any(|mark| attributes.contains(mark));
    Some(if is_relative { folder.join(name) } else { PathBuf::from(name) }).filter(|path| path.is_file())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn statistics_that_qgis_leaves_beside_a_terrain_are_no_part_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let (terrain, beside) = (folder.path().join("dtm.tif"), folder.path().join("dtm.tif.aux.xml"));
        fs::write(&terrain, "tif").unwrap();
        let band = |more: &str| {
            format!(
                "<PAMDataset>\n  <PAMRasterBand band=\"1\">\n    <Histograms><HistItem><HistMin>1</HistMin></HistItem></Histograms>\n    \
                 <Metadata>\n      <MDI key=\"STATISTICS_MEAN\">31.2</MDI>{more}\n    </Metadata>\n  </PAMRasterBand>\n</PAMDataset>\n"
            )
        };
        for (text, n_files) in [
            (band(""), 1),
            (band("<MDI key=\"AREA\">x</MDI>"), 2),
            (band("").replace("<Metadata>", "<NoDataValue>0</NoDataValue><Metadata>"), 2),
            ("<PAMDataset><SRS>EPSG:25832</SRS></PAMDataset>".to_owned(), 2),
            ("no XML".to_owned(), 2),
        ] {
            fs::write(&beside, &text).unwrap();
            assert_eq!(files_of(&terrain).len(), n_files, "{text}");
        }
    }

    #[test]
    fn what_lies_beside_a_source_and_what_it_refers_to_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("east")).unwrap();
        let names =
            ["a.shp", "a.dbf", "a.PRJ", "a.txt", "b.gpkg", "b.gpkg-wal", "c.gpkg", "t.tif", "t.tfw", "t.tif.aux.xml"];
        names.iter().for_each(|name| fs::write(at(name), "x").unwrap());
        fs::write(at("c.gpkg-wal"), "").unwrap();
        fs::write(at("east/u & v.tif"), "x").unwrap();
        let source = |tag: &str, name: &str| format!("<{tag} relativeToVRT=\"1\" shared=\"0\">{name}</{tag}>");
        fs::write(at("inner.vrt"), source("SourceFilename", "east/u &amp; v.tif")).unwrap();
        let all = ["t.tif", "inner.vrt", "outer.vrt", "gone.tif"].map(|name| source("SourceFilename", name)).concat();
        fs::write(at("outer.vrt"), format!("<VRTDataset>{all}</VRTDataset>")).unwrap();
        let found = |name: &str| -> Vec<String> {
            let files = files_of(&at(name));
            files.iter().map(|path| path.strip_prefix(folder.path()).unwrap().display().to_string()).collect()
        };
        assert_eq!(found("a.shp"), ["a.PRJ", "a.dbf", "a.shp"]);
        assert_eq!(found("b.gpkg"), ["b.gpkg", "b.gpkg-wal"]);
        assert_eq!(found("c.gpkg"), ["c.gpkg"], "an empty one is a reader's");
        let terrain = ["east/u & v.tif", "inner.vrt", "outer.vrt", "t.tfw", "t.tif", "t.tif.aux.xml"];
        assert_eq!(found("outer.vrt"), terrain);
        assert_eq!(found("east"), ["east/u & v.tif"]);
        assert!(found("nowhere.tif").is_empty());
    }
}
