//! Metashape's "Export Cameras", Omega Phi Kappa: `PhotoID X Y Z Omega Phi Kappa r11 … r33`, tabs or commas. It carries no camera.

use super::config::CsvConfig;
use super::formats::FileMarks;
use super::poses::Poses;
use super::{SurveyConfig, SurveyError, csv};

/// A file that names `PhotoID` in its first bytes.
pub(crate) fn recognises(marks: &FileMarks) -> bool {
    !marks.is_folder && marks.head.contains("PhotoID")
}

/// Reads the table; the camera is the declared one.
pub(crate) fn read(config: &SurveyConfig) -> Result<Poses, SurveyError> {
    config.declared_camera("Metashape's omega-phi-kappa export")?;
    let header = ["name", "x", "y", "z", "omega", "phi", "kappa"].map(str::to_owned).to_vec();
    let table = CsvConfig { header: Some(header), ..CsvConfig::default() };
    csv::read_table(&config.path, &table, config.camera.as_ref())
}
