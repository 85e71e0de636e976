//! How good footprints from masks are, on simulated towns seen with realistic errors.
//!
//! `make accuracy-footprints` prints the table of docs/accuracy.md.

use std::path::PathBuf;

use geo_types::Polygon;
use sizeup::crs::Crs;
use sizeup::evaluate::{FootprintEvaluation, evaluate_footprints};
use sizeup::footprint::{
    ConsensusConfig, ContourFineness, ContourKind, ContourSource, DetectionSettings, InputAccuracy, Instances,
    Vectorising, ViewContours, ViewFault, contours, detect,
};
use sizeup::raster::Raster;
use sizeup::simulate::{
    ErrorConfig, MaskErrors, MaskLevel, SimulateConfig, SimulatedTown, TownKind, disturbed_poses, masks_with_errors,
    plan, roofs, world,
};
use sizeup::survey::{View, ViewKind};

/// Masks in memory, by position of the view.
struct Masks {
    masks: Vec<Raster<u32>>,
    views: Vec<View>,
    instances: Instances,
}

impl ContourSource for Masks {
    fn contours(&self, view: &View, look: ContourFineness) -> Result<ViewContours, ViewFault> {
        let i = self.views.iter().position(|v| v.id == view.id).unwrap();
        let how =
            Vectorising { instances: self.instances, min_area_px2: look.min_area_px2, tolerance_px: look.tolerance_px };
        let mask = &self.masks[i];
        let mask = if self.instances == Instances::ByContact { mask.map(|l| u32::from(*l > 0)) } else { mask.clone() };
        let found = contours(&mask, how);
        Ok(found.map_err(|fault| ViewFault::Mask { path: PathBuf::from("memory"), fault })?.into())
    }

    fn file_of(&self, _: &View) -> Option<PathBuf> {
        None
    }
}

/// A town and its nadir views with the poses that a survey would have.
struct Scene {
    world: SimulatedTown,
    true_views: Vec<View>,
    views: Vec<View>,
    seed: u64,
}

impl Scene {
    /// Nadir views up to 15° off the vertical: the camera is unsteady by 6° (standard deviation), and known to be.
    fn new(kind: TownKind, n_buildings: usize, seed: u64) -> Self {
        let mut config = SimulateConfig { seed, ..SimulateConfig::default() };
        config.town.kind = kind;
        config.town.n_buildings = n_buildings;
        config.flight.wobble_deg = 6.0;
        (config.camera.width_px, config.camera.height_px) = (1344, 1008);
        config.errors = ErrorConfig { position_m: 0.05, angle_deg: 0.05, ..ErrorConfig::default() };
        let world = world(&config).unwrap();
        let all = plan(&config, &world);
        let true_views: Vec<View> = all.into_iter().filter(|v| v.kind() == ViewKind::Nadir).collect();
        let views = disturbed_poses(&true_views, &config.errors, seed);
        Self { world, true_views, views, seed }
    }

    fn truth(&self) -> Vec<Polygon<f64>> {
        self.world.buildings.iter().map(|b| b.footprint.clone()).collect()
    }

    fn masks(&self, errors: &MaskErrors) -> Vec<Raster<u32>> {
        let of_view = |(i, view): (usize, &View)| {
            masks_with_errors(view, i, &self.world.buildings, &self.world.terrain, errors, self.seed)
                .map(|l| u32::from(*l))
        };
        self.true_views.iter().enumerate().map(of_view).collect()
    }

    fn found(&self, masks: &[Raster<u32>], instances: Instances, consensus: &ConsensusConfig) -> Vec<Polygon<f64>> {
        self.found_as(masks, instances, consensus, ContourKind::Ground)
    }

    fn found_as(
        &self,
        masks: &[Raster<u32>],
        instances: Instances,
        consensus: &ConsensusConfig,
        contour: ContourKind,
    ) -> Vec<Polygon<f64>> {
        let source = Masks { masks: masks.to_vec(), views: self.views.clone(), instances };
        let accuracy = InputAccuracy::default();
        let settings = DetectionSettings { contour, accuracy: &accuracy, consensus, cadastre: None };
        let crs = Crs::parse(&self.world.crs).unwrap();
        let found = detect(&source, &self.views, &self.world.terrain, settings, &crs).unwrap();
        found.layer.footprints.into_iter().map(|f| f.polygon).collect()
    }

    /// Of all views that show eight buildings whole, or as many as any view does, the one with the best F1 over these: what is found in it alone, and of
    /// the same buildings what all views together gave (`merged`).
    fn best_single_view(
        &self,
        masks: &[Raster<u32>],
        consensus: &ConsensusConfig,
        merged: &[Polygon<f64>],
    ) -> Option<(FootprintEvaluation, FootprintEvaluation)> {
        let accuracy = InputAccuracy::default();
        let settings =
            DetectionSettings { contour: ContourKind::Ground, accuracy: &accuracy, consensus, cadastre: None };
        let crs = Crs::parse(&self.world.crs).unwrap();
        let exact = self.masks(&MaskLevel::Exact.errors());
        let one = |i: usize| {
            let view = std::slice::from_ref(&self.views[i]);
            let source = Masks { masks: vec![masks[i].clone()], views: view.to_vec(), instances: Instances::ByLabel };
            let found = detect(&source, view, &self.world.terrain, settings, &crs).ok()?;
            // What the border cuts off counts neither for nor against the view.
            let cut = |mask: &Raster<u32>| -> std::collections::BTreeSet<u32> {
                let (w, h) = (mask.width(), mask.height());
                let border = (0..w).flat_map(|c| [(c, 0), (c, h - 1)]).chain((0..h).flat_map(|r| [(0, r), (w - 1, r)]));
                border.map(|at| mask[at]).collect()
            };
            let cut = cut(&exact[i]);
            let mut shown: Vec<u32> = exact[i].data().to_vec();
            shown.sort_unstable();
            shown.dedup();
            let truth: Vec<Polygon<f64>> = shown
                .into_iter()
                .filter(|l| *l > 0 && !cut.contains(l))
                .map(|l| self.world.buildings[l as usize - 1].footprint.clone())
                .collect();
            let whole = found.candidates.iter().filter(|c| !c.is_cut).filter_map(|c| c.building);
            let results: Vec<Polygon<f64>> = whole.map(|b| found.layer.footprints[b].polygon.clone()).collect();
            // Detection counts the same for both: what overlaps one of these buildings.
            let is_near = |p: &Polygon<f64>| truth.iter().any(|t| geo::Intersects::intersects(t, p));
            let near: Vec<Polygon<f64>> = merged.iter().filter(|p| is_near(p)).cloned().collect();
            Some((evaluate_footprints(&results, &truth), evaluate_footprints(&near, &truth)))
        };
        let all: Vec<_> = (0..self.views.len()).filter_map(one).collect();
        let most = all.iter().map(|(single, _)| single.n_truth).max()?;
        let telling = all.into_iter().filter(|(single, _)| single.n_truth >= most.min(8));
        telling.max_by(|a, b| a.0.f1.total_cmp(&b.0.f1))
    }
}

/// The aims of the design, on one town of the kind with courtyards and rows.
#[test]
fn exact_masks_give_footprints_within_the_aims() {
    let scene = Scene::new(TownKind::District, 24, 11);
    let masks = scene.masks(&MaskLevel::Exact.errors());
    let found = scene.found(&masks, Instances::ByLabel, &ConsensusConfig::default());
    let evaluation = evaluate_footprints(&found, &scene.truth());
    println!("{evaluation}");
    assert!(evaluation.iou >= 0.93 && evaluation.detection_f1 >= 0.98, "{evaluation}");
    assert!(evaluation.corner_median_m.unwrap() <= 0.25, "{evaluation}");
    // Neighbours share their borders: no overlap beyond what the output grid leaves.
    let overlap_m2: f64 =
        pairs(&found).map(|(a, b)| geo::Area::unsigned_area(&geo::BooleanOps::intersection(a, b))).sum();
    assert!(overlap_m2 < 0.1, "{overlap_m2} m²");
}

fn pairs(polygons: &[Polygon<f64>]) -> impl Iterator<Item = (&Polygon<f64>, &Polygon<f64>)> {
    polygons.iter().enumerate().flat_map(|(i, a)| polygons[i + 1..].iter().map(move |b| (a, b)))
}

#[test]
#[ignore = "slow: make test-slow"]
fn merging_views_beats_the_best_single_view_with_masks_of_a_network() {
    let scene = Scene::new(TownKind::District, 30, 5);
    let masks = scene.masks(&MaskLevel::Network.errors());
    let consensus = ConsensusConfig::default();
    let all = scene.found(&masks, Instances::ByLabel, &consensus);
    let (single, merged) = scene.best_single_view(&masks, &consensus, &all).expect("a view that shows eight buildings");
    println!("merged {merged}single {single}");
    assert!(merged.f1 > single.f1 && merged.iou > single.iou, "{merged}{single}");
    assert!(evaluate_footprints(&all, &scene.truth()).detection_f1 > 0.95);
}

/// Rows of the table: a town and its masks, with the outcomes of all seeds.
#[derive(Default)]
struct Table(Vec<((&'static str, String), Vec<FootprintEvaluation>)>);

impl Table {
    fn add(&mut self, town: &'static str, masks: &str, outcome: FootprintEvaluation) {
        let key = (town, masks.to_owned());
        match self.0.iter_mut().find(|(k, _)| *k == key) {
            Some((_, outcomes)) => outcomes.push(outcome),
            None => self.0.push((key, vec![outcome])),
        }
    }

    fn print(&self) {
        println!(
            "| town | masks | IoU, least | P | R | F1 | F1 at IoU 0.5 | corners, median / P90 | corners found per true | found / true |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|");
        for ((town, masks), all) in &self.0 {
            let mean = |f: &dyn Fn(&FootprintEvaluation) -> f64| all.iter().map(f).sum::<f64>() / all.len() as f64;
            let least = all.iter().map(|e| e.iou).fold(f64::INFINITY, f64::min);
            let sum = |f: &dyn Fn(&FootprintEvaluation) -> usize| all.iter().map(f).sum::<usize>();
            println!(
                "| {town} | {masks} | {:.3}, {least:.3} | {:.3} | {:.3} | {:.3} | {:.3} | {:.2} / {:.2} m | {:.2} | {} / {} |",
                mean(&|e| e.iou),
                mean(&|e| e.precision),
                mean(&|e| e.recall),
                mean(&|e| e.f1),
                mean(&|e| e.detection_f1),
                mean(&|e| e.corner_median_m.unwrap_or(f64::NAN)),
                mean(&|e| e.corner_p90_m.unwrap_or(f64::NAN)),
                mean(&|e| e.corner_ratio.unwrap_or(f64::NAN)),
                sum(&|e| e.n_results),
                sum(&|e| e.n_truth)
            );
        }
    }
}

/// All rows of one scene.
fn measure(table: &mut Table, town: &'static str, scene: &Scene) {
    let truth = scene.truth();
    let consensus = ConsensusConfig::default();
    let as_they_are = ConsensusConfig { snap_deg: 0.0, ..ConsensusConfig::default() };
    for (what, level) in [("exact", MaskLevel::Exact), ("network", MaskLevel::Network), ("poor", MaskLevel::Poor)] {
        let masks = scene.masks(&level.errors());
        let with = |instances, consensus| evaluate_footprints(&scene.found(&masks, instances, consensus), &truth);
        let found = scene.found(&masks, Instances::ByLabel, &consensus);
        table.add(town, what, evaluate_footprints(&found, &truth));
        if level == MaskLevel::Exact {
            table.add(town, "exact, walls not turned", with(Instances::ByLabel, &as_they_are));
            let roofs: Vec<Raster<u32>> =
                scene.true_views.iter().map(|v| roofs(v, &scene.world.buildings).map(|l| u32::from(*l))).collect();
            let found = scene.found_as(&roofs, Instances::ByLabel, &consensus, ContourKind::Roof);
            table.add(town, "exact, of roofs at heights not known", evaluate_footprints(&found, &truth));
        } else if let Some((single, merged)) = scene.best_single_view(&masks, &consensus, &found) {
            table.add(town, &format!("{what}, best single view"), single);
            table.add(town, &format!("{what}, all views, the same buildings"), merged);
        }
        if level != MaskLevel::Poor {
            table.add(town, &format!("{what}, without instances"), with(Instances::ByContact, &consensus));
        }
    }
}

#[test]
#[ignore = "prints the table of docs/accuracy.md: make accuracy-footprints"]
fn table_of_accuracy() {
    let mut table = Table::default();
    for seed in [1, 2, 3] {
        for (name, kind) in [
            ("village", TownKind::Village),
            ("district", TownKind::District),
            ("downtown", TownKind::Downtown),
            ("industry", TownKind::Industry),
        ] {
            measure(&mut table, name, &Scene::new(kind, 30, seed));
        }
        println!("\nSeeds 1 to {seed}:\n");
        table.print();
    }
}

/// The full size of the design: run with `--ignored --nocapture`, and read wall and processor time.
#[test]
#[ignore = "a million contours: takes a minute, prints its time"]
fn a_million_contours_are_a_hundred_thousand_buildings() {
    use sizeup::footprint::{FootprintCandidate, SeenGround, agree};
    let seconds_in = |file: &str| {
        let stat = std::fs::read_to_string(file).unwrap_or_default();
        let fields: Vec<f64> = stat.split_whitespace().skip(13).take(2).filter_map(|f| f.parse().ok()).collect();
        fields.iter().sum::<f64>() / 100.0
    };
    let peak_mb = || {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = status.lines().find(|l| l.starts_with("VmHWM")).unwrap_or("").to_owned();
        line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1024.0
    };
    for n in [1_000_usize, 10_000, 100_000] {
        // Blocks of four: an L, two row houses, a courtyard; views of 150 m every 48 m, each off by some decimetres.
        let side = (n / 4).isqrt();
        let (mut candidates, mut seen) = (Vec::new(), Vec::new());
        let views = (side * 62 / 48 + 4, side * 50 / 48 + 4);
        for v in 0..views.0 * views.1 {
            let middle = [(v % views.0) as f64 * 48.0 - 75.0, (v / views.0) as f64 * 48.0 - 75.0];
            let low = geo_types::coord! { x: middle[0] - 75.0, y: middle[1] - 75.0 };
            let high = geo_types::coord! { x: middle[0] + 75.0, y: middle[1] + 75.0 };
            let area = geo_types::Rect::new(low, high);
            let off = [0, 1].map(|k| ((v * 31 + k * 17) % 13) as f64 * 0.05 - 0.3);
            let blocks = |m: f64, pitch: f64| {
                let first = ((m - 75.0) / pitch).floor().max(0.0) as usize;
                first..(((m + 75.0) / pitch).ceil().max(0.0) as usize).min(side)
            };
            for (i, j) in blocks(middle[0], 62.0).flat_map(|i| blocks(middle[1], 50.0).map(move |j| (i, j))) {
                for polygon in
                    block(i as f64 * 62.0 + off[0], j as f64 * 50.0 + off[1], 0.3 * ((i * 7 + j * 3) % 5) as f64)
                {
                    let rect = geo::BoundingRect::bounding_rect(&polygon).unwrap();
                    let is_whole =
                        rect.min().x > low.x && rect.max().x < high.x && rect.min().y > low.y && rect.max().y < high.y;
                    if !is_whole && !geo::Intersects::intersects(&rect, &area) {
                        continue;
                    }
                    let shape = if is_whole {
                        polygon.into()
                    } else {
                        geo::BooleanOps::intersection(&polygon, &area.to_polygon())
                    };
                    if geo::Area::unsigned_area(&shape) > 2.0 {
                        let shape = geo::orient::Orient::orient(&shape, geo::orient::Direction::Default);
                        candidates.push(FootprintCandidate {
                            view: v,
                            shape,
                            weight: 10.0,
                            score: 1.0,
                            is_cut: !is_whole,
                        });
                    }
                }
            }
            seen.push(SeenGround { area: area.to_polygon() });
        }
        // The thread that asks works alone between the parts that all cores share.
        let processor_s = || [seconds_in("/proc/self/stat"), seconds_in("/proc/thread-self/stat")];
        let (start, before_s) = (std::time::Instant::now(), processor_s());
        let agreed = agree(&candidates, &seen, &ConsensusConfig::default());
        println!(
            "{} contours of {} views -> {} buildings: {:.1} s, {:.1} s of processor time, {:.1} s of it on one core only, peak {:.0} MB",
            candidates.len(),
            seen.len(),
            agreed.buildings.len(),
            start.elapsed().as_secs_f64(),
            processor_s()[0] - before_s[0],
            processor_s()[1] - before_s[1],
            peak_mb()
        );
        let expected = 4 * side * side;
        assert!(
            agreed.buildings.len().abs_diff(expected) <= expected / 100,
            "{} of {expected}",
            agreed.buildings.len()
        );
    }
}

/// Four buildings turned by an angle.
fn block(x: f64, y: f64, angle: f64) -> Vec<Polygon<f64>> {
    let (sin, cos) = angle.sin_cos();
    let ring = |corners: &[(f64, f64)]| -> geo_types::LineString<f64> {
        corners.iter().map(|&(a, b)| (x + cos * a - sin * b, y + sin * a + cos * b)).collect()
    };
    let yard = ring(&[(39.0, 5.0), (39.0, 11.0), (47.0, 11.0), (47.0, 5.0)]);
    vec![
        Polygon::new(ring(&[(0.0, 0.0), (14.0, 0.0), (14.0, 6.0), (7.0, 6.0), (7.0, 12.0), (0.0, 12.0)]), vec![]),
        Polygon::new(ring(&[(18.0, 0.0), (24.0, 0.0), (24.0, 10.0), (18.0, 10.0)]), vec![]),
        Polygon::new(ring(&[(24.0, 0.0), (30.0, 0.0), (30.0, 10.0), (24.0, 10.0)]), vec![]),
        Polygon::new(ring(&[(34.0, 0.0), (52.0, 0.0), (52.0, 16.0), (34.0, 16.0)]), vec![yard]),
    ]
}
