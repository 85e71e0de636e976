//! Building heights from depths of unknown scale in oblique aerial photos: the height method of sizeup, without files, GDAL or
//! networks.
//!
//! A footprint becomes a prism of unknown height. Its rays are traced once through the scene; for any height they say what a
//! photo would show, and a depth prior (a network's or a matcher's) says what it does show. The two are correlated (`robust`, the
//! default) or compared by the order of their depths (`paper`), so that a prior need not be in metres.
//!
//! ```
//! use geo_types::polygon;
//! use glam::DVec3;
//! use sizeup_heights::prelude::*;
//! # fn network(footprint: &geo_types::Polygon<f64>, pose: Rigid<Cam, Map>, camera: &Camera) -> DepthPrior {
//! #     use sizeup_heights::render::{PlacedCamera, image::SceneTracer};
//! #     use sizeup_heights::scene::{HeightBounds, Scene};
//! #     let bounds = HeightBounds { min_m: 2.0, max_m: 50.0 };
//! #     let scene = Scene::new(&[(footprint, GroundLevel::flat(100.0))], &Terrain::Constant(100.0), bounds, 200.0);
//! #     let depth = SceneTracer::new(&scene, &[12.5]).render(&PlacedCamera::new(camera.clone(), pose, scene.origin)).depth;
//! #     DepthPrior { values: depth.map(|metres| 3.0 / metres - 0.002), kind: PriorKind::InverseDepth, geometry: PriorGeometry::ZDepth }
//! # }
//!
//! let footprint = polygon![(x: 0.0, y: 0.0), (x: 20.0, y: 0.0), (x: 20.0, y: 12.0), (x: 0.0, y: 12.0)];
//! let camera = Camera::pinhole(320, 240, 300.0);
//! let views: Vec<View> = [(10.0, -80.0), (90.0, 6.0), (10.0, 92.0), (-70.0, 6.0)]
//!     .iter()
//!     .map(|(east, north)| {
//!         let camera_from_map = Rigid::looking_at(DVec3::new(*east, *north, 180.0), DVec3::new(10.0, 6.0, 100.0));
//!         let prior = Some(network(&footprint, camera_from_map, &camera));
//!         View { name: format!("{east}_{north}.jpg"), camera: camera.clone(), camera_from_map, prior, picture: None, green: None }
//!     })
//!     .collect();
//!
//! let buildings = [Building { footprint, ground: GroundLevel::flat(100.0) }];
//! let heights = estimate_heights(&buildings, &Terrain::Constant(100.0), &views, &Settings::default());
//! assert!((heights[0].height_m().unwrap() - 12.5).abs() < 0.3);
//! ```
//!
//! # The way of a height
//! 1. [`scene`]: footprints on the ground ([`terrain`]) become prisms, one unknown height each.
//! 2. [`views`]: few views that see every building well are selected (`SiZeUp`, "Dynamic view selection").
//! 3. [`render`]: each view's rays are traced once ([`render::profile`]); what they see is then known for any height.
//! 4. `evidence`: a view's prior is sampled along its rays, brought to metres and cleared of what is not in the scene.
//! 5. `score`: how well one height of one building explains the prior of one view, blind to scale and shift.
//! 6. `search`: the best height of each building with all others as they are, in sweeps; footprints of two levels; footprints
//!    and layers that lie elsewhere. `paper`, in its place: the paper's pairwise ordinal loss ([`ordinal`]) and its gradient.
//! 7. `roofs`: flat, gabled, hipped or of two levels.
//! 8. [`optimise`]: these passes in their order, and what is known in the end, with a standard deviation.
//! 9. [`estimate`]: the whole method: splits footprints, refines roofs by photos ([`photo_consistency`]), doubts.
//!
//! # Frames
//! | frame | axes | unit, type |
//! |---|---|---|
//! | [`Map`](frames::Map) | easting, northing, up in a projected CRS | metres, `f64` |
//! | [`Local`](frames::Local) | `Map` minus a fixed origin | metres, `f64`; `f32` in [`scene`] and [`render`] |
//! | [`Cam`](frames::Cam) | x right, y down, z forward | metres, `f64` |
//! | Image | the top-left pixel's centre is (0.5, 0.5) | pixels, `f64` |
//!
//! A [`Rigid<To, From>`](frames::Rigid) is named `to_from_from`. Depth is z-depth (along the optical axis) unless a name
//! says `ray_t`.
//!
//! # Symbols of the paper
//! | symbol | meaning | here |
//! |---|---|---|
//! | `D`, `D'` | depth prior of a view; median/MAD normalised | [`prior::DepthPrior`]; `farness` in [`optimise`]; `d` in [`ordinal`] |
//! | `R`, `R'` | depth of the rendered proxies; normalised | [`render::profile::Profiles::sight`]; `r` in [`ordinal`] |
//! | `Ω_k` | pixels of view `k` that are compared | [`optimise::Region`] |
//! | `τ_d` | least prior contrast of a pair that has a vote | [`min_contrast`](optimise::OrdinalConfig::min_contrast) |
//! | `m` | margin of the hinge | [`margin`](optimise::OrdinalConfig::margin) |
//! | `s = sign(Δd)` | which pixel of a pair is nearer | [`ordinal::DepthOrder`] |
//! | `Q_N` | buildings a view sees | length of [`Visibility::buildings`](views::Visibility) |
//! | `Q_A` | surface a view sees, m² | [`Visibility::surface_m2`](views::Visibility) |
//! | `k` (views) | views each building is to be seen from | [`min_views_per_building`](views::ViewsConfig::min_views_per_building) |
//! | #Sel | views kept by farthest point sampling | [`n_spread`](views::ViewsConfig::n_spread) |
//! | #Used | distinct views whose prior was used | [`Solution::used_views`](optimise::Solution::used_views) |
//! | MAD | median absolute deviation | [`stats::median_and_mad`] |

pub mod camera;
mod config;
pub mod estimate;
mod evidence;
pub mod frames;
pub mod ids;
pub mod optimise;
pub mod ordinal;
mod paper;
pub mod photo_consistency;
pub mod picture;
pub mod prior;
pub mod raster;
pub mod ray;
pub mod render;
mod roofs;
pub mod scene;
mod score;
mod search;
pub mod seed;
pub mod simd;
mod split;
pub mod stats;
pub mod terrain;
pub mod views;

pub use estimate::{Building, Settings, View, estimate_heights};

/// Names that a program needs that calls [`estimate_heights`].
pub mod prelude {
    pub use crate::camera::Camera;
    pub use crate::frames::{Cam, Map, Rigid};
    pub use crate::optimise::{OptimiseConfig, Preset, SolvedHeight};
    pub use crate::prior::{DepthPrior, PriorGeometry, PriorKind};
    pub use crate::raster::Raster;
    pub use crate::scene::HeightsConfig;
    pub use crate::terrain::{GroundLevel, Terrain};
    pub use crate::{Building, Settings, View, estimate_heights};
}
