//! One libtiff in the module: PROJ reads its grids (most are TIFF) with the copy inside GDAL, so that the wheel needs none of the
//! system's, with all that hangs on it.

/// What PROJ 9.6 uses of libtiff: `nm -u libproj.a | grep -o 'TIFF[A-Za-z0-9]*' | sort -u`. A name that is missing here makes the module need the system's libtiff.
const OF_TIFF: [&str; 14] = [
    "TIFFClientOpen",
    "TIFFClose",
    "TIFFCurrentDirOffset",
    "TIFFGetField",
    "TIFFIsCODECConfigured",
    "TIFFIsTiled",
    "TIFFMergeFieldInfo",
    "TIFFReadDirectory",
    "TIFFReadEncodedStrip",
    "TIFFReadEncodedTile",
    "TIFFSetSubDirectory",
    "TIFFSetTagExtender",
    "TIFFStripSize64",
    "TIFFTileSize64",
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let is_bundled = std::env::var_os("CARGO_FEATURE_BUNDLED_LIBRARIES").is_some();
    // Linkers of other systems give second names in other ways: there libtiff is put beside the module.
    let is_linux = std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "linux");
    if is_bundled && is_linux {
        for name in OF_TIFF {
            // GDAL's copy has names of its own, so that it never meets another.
            println!("cargo::rustc-link-arg-cdylib=-Wl,--defsym={name}=gdal_{name}");
        }
    }
}
