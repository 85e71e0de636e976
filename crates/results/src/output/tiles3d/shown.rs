//! The buildings of a tileset, on disk while their tiles are chosen: a city is never in memory.

use std::path::Path;

use glam::DVec3;

use super::super::buildings::Wholes;
use super::super::footprints::FootprintRows;
use super::super::grid::OutputGrid;
use super::super::prism::{MIN_THICKNESS_M, SnappedPrism};
use super::super::roof_solid::{self, Detail};
use super::super::textured::TexturedCity;
use super::super::{OutputError, Records};
use super::mesh::TileBuilding;
use super::quadtree::{Node, TreeItem};
use sizeup_geo::files::{FileError, Stored, UnnamedFile};

/// The buildings that have something to show.
pub struct ShownBuildings {
    file: UnnamedFile,
    /// Place of each in the file.
    stored: Vec<Stored>,
    /// Each as a tree has it, and the name of its tile in a textured city; empty once they are in a tree.
    items: Vec<(TreeItem, String)>,
    /// The others, and those of which a part has nothing.
    pub hidden: Wholes,
}

impl ShownBuildings {
    /// Puts buildings into a file in a folder that takes as much as the city has.
    pub fn of<R: Records + ?Sized>(
        records: &R,
        (folder, textured): (&Path, Option<&TexturedCity>),
        rows: &FootprintRows,
        grid: &OutputGrid,
    ) -> Result<Self, OutputError> {
        let mut shown = Self::none(folder)?;
        records.visit(&mut |record| {
            let prism = SnappedPrism::of(record, grid, MIN_THICKNESS_M);
            shown.hidden.add_if(prism.is_err(), record);
            let Ok(prism) = prism else { return Ok(()) };
            let tile = textured.and_then(|textured| textured.tile(&record.id)).unwrap_or_default();
            let painted = textured.map(|textured| textured.solid(&record.id, &prism, grid)).transpose()?;
            let (roofed, paints) = match painted.flatten() {
                Some((faces, paints)) => (Some(faces), paints),
                None => (roof_solid::faces(record, &prism, grid, Detail::Slopes), Vec::new()),
            };
            let height_m = record.height_m.unwrap_or(0.0);
            let block = TileBuilding { prism, roofed, paints, values: rows.row(record).values, height_m };
            shown.items.push((item(shown.items.len(), &block, grid), tile.to_owned()));
            Ok(shown.push(&block)?)
        })?;
        Ok(shown)
    }

    fn none(folder: &Path) -> Result<Self, FileError> {
        let file = UnnamedFile::new(folder)?;
        Ok(Self { file, stored: Vec::new(), items: Vec::new(), hidden: Wholes::default() })
    }

    fn push(&mut self, block: &TileBuilding) -> Result<(), FileError> {
        let bytes = serde_json::to_vec(block).map_err(|e| self.file.lost(e.into()))?;
        self.stored.push(self.file.put(&bytes)?);
        Ok(())
    }

    /// Takes the tree over all of them: that of a textured city, or one with so many buildings in a tile at most; `None` without any.
    pub fn take_tree(&mut self, textured: Option<&TexturedCity>, max_buildings: usize) -> Option<Node> {
        let items = std::mem::take(&mut self.items);
        match textured {
            Some(_) => Node::named(items),
            None => Node::root(items.into_iter().map(|(item, _)| item).collect(), max_buildings),
        }
    }

    /// Reads back the buildings at some positions.
    pub fn read(&self, positions: &[usize]) -> Result<Vec<TileBuilding>, FileError> {
        let read = |&at: &usize| {
            let bytes = self.file.get(self.stored[at])?;
            serde_json::from_slice(&bytes).map_err(|e| self.file.lost(e.into()))
        };
        positions.iter().map(read).collect()
    }
}

fn item(idx: usize, block: &TileBuilding, grid: &OutputGrid) -> TreeItem {
    let exterior = &block.prism.footprint().rings()[0];
    let low: [i64; 2] = std::array::from_fn(|a| exterior.iter().map(|p| p[a]).min().unwrap_or(0));
    let high: [i64; 2] = std::array::from_fn(|a| exterior.iter().map(|p| p[a]).max().unwrap_or(0));
    let low = DVec3::from_array(grid.metres([low[0], low[1], block.prism.base()]));
    let top = block.roofed.iter().flatten().flat_map(|face| face.rings.iter().flatten()).map(|p| p[2]);
    let high = DVec3::from_array(grid.metres([high[0], high[1], top.fold(block.prism.roof(), i64::max)]));
    let middle = (low + high) / 2.0;
    TreeItem { idx, centre: [middle.x, middle.y], size_m: (high - low).length() }
}

#[cfg(test)]
mod tests {
    use geo_types::polygon;
    use serde_json::Value;

    use super::*;
    use crate::output::grid::OutputGrid;
    use crate::output::prism::SnappedPrism;
    use crate::output::record::tests::record;

    #[test]
    fn blocks_come_back_in_any_order_to_the_last_bit() {
        let grid = OutputGrid { scale_m: 0.001, origin_m: [0.0; 3] };
        let block = |i: usize| {
            let x = 20.0 * i as f64;
            let footprint = polygon![(x: x, y: 0.0), (x: x + 9.7, y: 0.0), (x: x + 3.3, y: 7.1)];
            let prism = SnappedPrism::of(&record("a", footprint, 1.0, 1.0, 5.0 + i as f64), &grid, 0.1).unwrap();
            TileBuilding {
                roofed: None,
                paints: Vec::new(),
                prism,
                values: vec![Value::from(0.1 + i as f64), Value::from("Ä\n")],
                height_m: 1.0 / (i + 3) as f64,
            }
        };
        let blocks: Vec<TileBuilding> = (0..30).map(block).collect();
        let folder = tempfile::tempdir().unwrap();
        let mut shown = ShownBuildings::none(folder.path()).unwrap();
        for block in &blocks {
            shown.push(block).unwrap();
        }
        assert_eq!((shown.stored.len(), std::fs::read_dir(folder.path()).unwrap().count()), (30, 0));
        let positions = [29, 3, 0, 17, 3];
        let expected: Vec<TileBuilding> = positions.iter().map(|&at| blocks[at].clone()).collect();
        assert_eq!(shown.read(&positions).unwrap(), expected);
        // A file that loses them is none of the input.
        shown.file = UnnamedFile::new(folder.path()).unwrap();
        assert_eq!(OutputError::from(shown.read(&positions).unwrap_err()).exit_code(), 4);
    }
}
