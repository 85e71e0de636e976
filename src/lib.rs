//! # sizeup: from a drone flight to a georeferenced LOD1 city
//!
//! Calibrated oblique photos, building footprints and depth priors go in at the top; a city model leaves at the
//! bottom. The method is that of "`SiZeUp`: Fast 3D Proxy from Aerial Images via Depth Ordinal Loss" (2026), called the
//! paper below, and a local search of our own over the same evidence.
//!
//! # The pipeline
//! [`pipeline`] runs four stages; the modules below stand in the order in which data flows through them.
//!
//! 1. [`survey`]: photos and poses, in whatever format, into the project's CRS ([`crs`], [`camera`]).
//! 2. [`footprint`], [`terrain`]: building outlines, and the ground under each.
//! 3. [`optimise`]: one height per building. Views are chosen ([`views`]); their rays are traced once through the
//!    [`scene`] ([`render`]) and compared with the [`prior`] for any height ([`ordinal`] and the local search).
//! 4. [`output`]: `CityJSON`, `GeoPackage`, issues, lineage and pictures; [`report`]: the page that shows them.
//!
//! [`simulate`] makes input with known truth; [`evaluate`] compares a result with a truth; [`baseline`] holds the
//! yardsticks; [`benchmark`] runs all of them and writes the tables of the documentation.
//!
//! # Frames
//! | frame | axes | unit, type |
//! |---|---|---|
//! | [`Map`](frames::Map) | easting, northing, up in the project's projected CRS | metres, `f64` |
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
//! | `D`, `D'` | depth prior of a view; median/MAD normalised | [`prior::DepthPrior`]; `farness` in `optimise`; `d` in [`ordinal`] |
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
//! | MAD | median absolute deviation | [X |

pub use sizeup_footprints as footprint;
pub use sizeup_geo::{cloud, crs, files, geodata, hashes, issue, limits, paths, template, terrain, unfinished};
pub use sizeup_heights as heights;
pub use sizeup_heights::{camera, frames, ids, optimise, ordinal, raster, ray, render, scene, seed, stats, views};
pub use sizeup_lab::{baseline, evaluate, simulate};
pub use sizeup_photos::{dtm, onnx, photometry, prior};
pub use sizeup_results::{output, report};
pub use sizeup_survey as survey;

pub mod benchmark;
pub mod cli;
pub mod config;
pub mod pipeline;
pub mod recipe;
pub mod tiles;
