//! The ground as photos show it, under the map of the page.

use std::io::Cursor;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::{GrayAlphaImage, GrayImage, ImageFormat, LumaA, RgbImage};
use serde::Serialize;

use super::city::round_cm;
use super::evidence::data_uri;

/// Photos laid on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Backdrop {
    /// North up, without rotation.
    pub picture: RgbImage,
    /// Above 0 where a photo shows the ground; `None` where they show all of it.
    pub shown: Option<GrayImage>,
    /// Western, southern, eastern and northern edge of the picture, map frame, metres.
    pub bounds_m: [f64; 4],
    /// Names of the photos.
    pub photos: Vec<String>,
}

/// [`Backdrop`] as the page has it.
#[derive(Debug, Serialize)]
pub struct BackdropData<'a> {
    picture: String,
    /// As opaque as the photos show the ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    shown: Option<String>,
    bounds: [f64; 4],
    photos: &'a [String],
}

impl<'a> From<&'a Backdrop> for BackdropData<'a> {
    fn from(backdrop: &'a Backdrop) -> Self {
        Self {
            picture: data_uri(&backdrop.picture),
            shown: backdrop.shown.as_ref().map(mask_uri),
            bounds: backdrop.bounds_m.map(round_cm),
            photos: &backdrop.photos,
        }
    }
}

/// A mask as an address that holds it: PNG, as its edges are sharp.
fn mask_uri(shown: &GrayImage) -> String {
    let opaque = GrayAlphaImage::from_fn(shown.width(), shown.height(), |x, y| LumaA([0, shown.get_pixel(x, y)[0]]));
    let mut png = Cursor::new(Vec::new());
    opaque.write_to(&mut png, ImageFormat::Png).expect("a picture in memory is encoded");
    format!("data:image/png;base64,{}", STANDARD.encode(png.get_ref()))
}
