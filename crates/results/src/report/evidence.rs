//! Single buildings as the photos show them: cut-outs with the block drawn over them, and the scores of all heights.

use std::io::Cursor;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use serde::Serialize;

/// Quality of the pictures, 1 to 100: artefacts are below what the eye sees at this size.
const JPEG_QUALITY: u8 = 82;
/// Positions in a picture are written as shares of its sides in steps of this part.
const STEPS: f32 = 1000.0;

/// Evidence of one building.
#[derive(Debug, Clone)]
pub struct BuildingEvidence {
    /// Position among the records.
    pub building: usize,
    /// Heights that were tried, metres.
    pub heights_m: Vec<f32>,
    /// For each view that it was measured in: its position in the survey, and the score of every height.
    pub scores: Vec<(usize, Vec<f64>)>,
    /// It in single views, the most telling first.
    pub crops: Vec<Crop>,
}

/// One building in one view.
#[derive(Debug, Clone)]
pub struct Crop {
    /// Position of the view in the survey.
    pub view: usize,
    /// The photo, where there is one.
    pub photo: Option<RgbImage>,
    /// Depth of the model, in colours.
    pub rendered: RgbImage,
    /// The prior, in colours.
    pub prior: Option<RgbImage>,
    /// Edges of the blocks.
    pub lines: Vec<EdgeLine>,
    /// Pixels that are compared.
    pub pairs: Vec<ComparedPair>,
}

/// Owner of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LineKind {
    /// The roof of another building.
    Other,
    /// A wall of this building.
    Wall,
    /// The roof of this building.
    Roof,
}

/// An edge, in shares of the picture's width and height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeLine {
    /// Roof or wall that the edge belongs to.
    pub kind: LineKind,
    /// The two ends, x and y in shares of the picture.
    pub ends: [[f32; 2]; 2],
}

/// Two pixels whose order is compared, in shares of the picture's width and height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComparedPair {
    /// The two pixels, x and y in shares of the picture.
    pub ends: [[f32; 2]; 2],
    /// Cost of the hinge: 0 is in the right order by the margin.
    pub cost: f32,
}

/// [`BuildingEvidence`] as the page has it.
#[derive(Debug, Serialize)]
pub struct EvidenceData {
    building: usize,
    heights: Vec<f32>,
    scores: Vec<ViewScores>,
    crops: Vec<CropData>,
}

#[derive(Debug, Serialize)]
struct ViewScores {
    view: usize,
    score: Vec<f64>,
}

#[derive(Debug, Serialize)]
struct CropData {
    view: usize,
    size: [u32; 2],
    #[serde(skip_serializing_if = "Option::is_none")]
    photo: Option<String>,
    rendered: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    prior: Option<String>,
    /// Per kind: x and y of both ends of each edge, in thousandths.
    lines: [(LineKind, Vec<i32>); 3],
    /// x and y of both ends, and 1 if the pair costs something.
    pairs: Vec<[i32; 5]>,
}

impl From<&BuildingEvidence> for EvidenceData {
    fn from(evidence: &BuildingEvidence) -> Self {
        let rounded = |score: &f64| (score * 1e4).round() / 1e4;
        Self {
            building: evidence.building,
            heights: evidence.heights_m.iter().map(|h| (h * 100.0).round() / 100.0).collect(),
            scores: evidence
                .scores
                .iter()
                .map(|(view, scores)| ViewScores { view: *view, score: scores.iter().map(rounded).collect() })
                .collect(),
            crops: evidence.crops.iter().map(CropData::from).collect(),
        }
    }
}

impl From<&Crop> for CropData {
    fn from(crop: &Crop) -> Self {
        let lines = [LineKind::Other, LineKind::Wall, LineKind::Roof].map(|kind| {
            let own = crop.lines.iter().filter(|line| line.kind == kind);
            (kind, own.flat_map(|line| steps(line.ends)).collect())
        });
        let pair = |pair: &ComparedPair| {
            let [x0, y0, x1, y1] = steps(pair.ends);
            [x0, y0, x1, y1, i32::from(pair.cost > 0.0)]
        };
        Self {
            view: crop.view,
            size: crop.photo.as_ref().unwrap_or(&crop.rendered).dimensions().into(),
            photo: crop.photo.as_ref().map(data_uri),
            rendered: data_uri(&crop.rendered),
            prior: crop.prior.as_ref().map(data_uri),
            lines,
            pairs: crop.pairs.iter().map(pair).collect(),
        }
    }
}

/// Both ends in thousandths.
fn steps([[x0, y0], [x1, y1]]: [[f32; 2]; 2]) -> [i32; 4] {
    [x0, y0, x1, y1].map(|v| (v * STEPS).round() as i32)
}

/// A picture as an address that holds it.
pub fn data_uri(picture: &RgbImage) -> String {
    let mut jpeg = Cursor::new(Vec::new());
    let encoded = JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode_image(picture);
    encoded.expect("a picture in memory of less than 65,535 pixels a side is encoded");
    format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg.get_ref()))
}
