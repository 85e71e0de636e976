//! The files of a tileset, from the leaves up: each tile knows the box of those below.

use std::path::Path;

use glam::DVec3;
use serde_json::{Value, json};

use super::super::OutputError;
use super::super::textured::TexturedCity;
use super::content::{Content, Contents, GROUND, Pictures};
use super::quadtree::Node;
use super::shown::ShownBuildings;
use super::volume::{bounding_box, rounded_up};
use sizeup_geo::files::write_whole_unflushed;

/// After the name of a tile that is seen from far away.
const FAR: &str = "-far";
/// Error of what is seen from far away, in its pixels: viewers go on to the near one where an error is larger than some 16 pixels of
/// the screen, so where one of its pixels covers two of them.
const FAR_PIXELS: f64 = 8.0;

/// Writes the files of tiles into a folder.
pub struct TileFiles<'a> {
    pub contents: Contents<'a>,
    pub shown: &'a ShownBuildings,
    pub folder: &'a Path,
}

/// A tile that is written.
struct WrittenTile {
    json: Value,
    /// Box of the tile and all below, in glTF's axes.
    bounds: [DVec3; 2],
}

impl TileFiles<'_> {
    /// Writes the tree, and the grounds beside it; without any tile errors are as large as `size_m`.
    pub fn write(&self, tree: &Node, size_m: f64) -> Result<Value, OutputError> {
        let tree = self.tile(tree, size_m)?;
        let Some(textured) = self.contents.textured.filter(|textured| !textured.grounds.is_empty()) else {
            return Ok(tree.json);
        };
        let grounds = (0..textured.grounds.len()).map(|i| self.ground(textured, i));
        let all: Vec<WrittenTile> = std::iter::once(Ok(tree)).chain(grounds).collect::<Result<_, _>>()?;
        let bounds = around(&all);
        Ok(json!({
            "boundingVolume": { "box": bounding_box(bounds) },
            "geometricError": rounded_up((bounds[1] - bounds[0]).length()),
            "children": all.into_iter().map(|of| of.json).collect::<Vec<Value>>(),
        }))
    }

    /// Writes a ground of a textured city: near, and for far away where that is smaller.
    fn ground(&self, textured: &TexturedCity, i: usize) -> Result<WrittenTile, OutputError> {
        let name = format!("{}{GROUND}", textured.grounds[i].0);
        let near = self.put(&name, &self.contents.ground(textured, i)?)?;
        let Some((far, px_m)) = self.contents.far_ground(textured, i)? else { return Ok(near) };
        Ok(near.after(self.put(&format!("{name}{FAR}"), &far)?, px_m))
    }

    /// Writes a tile and all below it; without it errors are as large as `size_m`.
    fn tile(&self, node: &Node, size_m: f64) -> Result<WrittenTile, OutputError> {
        // A tile of another tree's may have lost all its buildings.
        let own = if node.members.is_empty() { None } else { Some(self.own(node)?) };
        let below = node.children.iter().map(|child| self.tile(child, node.error_m));
        let below: Vec<WrittenTile> = below.collect::<Result<_, _>>()?;
        let bounds = around(own.iter().chain(&below));
        let mut json =
            json!({ "boundingVolume": { "box": bounding_box(bounds) }, "geometricError": rounded_up(node.error_m) });
        let mut children: Vec<Value> = below.into_iter().map(|tile| tile.json).collect();
        if let Some(mut own) = own {
            if own.json["children"].is_array() {
                // A nearer one replaces it alone, not the tiles below.
                let error_m = own.json["geometricError"].as_f64().unwrap_or(0.0);
                json["geometricError"] = json!(rounded_up(size_m).max(error_m));
                children.insert(0, own.json);
            } else {
                json["content"] = own.json["content"].take();
            }
        }
        if !children.is_empty() {
            json["children"] = Value::Array(children);
        }
        Ok(WrittenTile { json, bounds })
    }

    /// Writes what a tile shows itself: near, and for far away where that is smaller.
    fn own(&self, node: &Node) -> Result<WrittenTile, OutputError> {
        let blocks = self.shown.read(&node.members)?;
        let mesh = self.contents.mesh(&blocks)?;
        let put =
            |name: &str, pictures: &Pictures| self.put(name, &self.contents.of(&mesh, &blocks, &node.name, pictures));
        let near = put(&node.name, &self.contents.pictures(&mesh.of)?)?;
        let Some((far, px_m)) = self.contents.far_pictures(&mesh.of)? else { return Ok(near) };
        Ok(near.after(put(&format!("{}{FAR}", node.name), &far)?, px_m))
    }

    /// Writes a file, and returns the tile that it is.
    fn put(&self, name: &str, content: &Content) -> Result<WrittenTile, OutputError> {
        let (uri, bounds) = (format!("tiles/{name}.glb"), content.bounds);
        write_whole_unflushed(&self.folder.join(&uri), |out| out.write_all(&content.bytes))?;
        let volume = json!({ "box": bounding_box(bounds) });
        let json = json!({
            "boundingVolume": volume, "geometricError": 0, "content": { "uri": uri, "boundingVolume": volume },
        });
        Ok(WrittenTile { json, bounds })
    }
}

impl WrittenTile {
    /// This tile after one that shows the same from far away, with pixels of a size in metres.
    fn after(self, far: Self, px_m: f64) -> Self {
        let bounds = around([&far, &self]);
        let mut json = far.json;
        json["boundingVolume"] = json!({ "box": bounding_box(bounds) });
        json["geometricError"] = json!(rounded_up(FAR_PIXELS * px_m));
        json["refine"] = json!("REPLACE");
        json["children"] = json!([self.json]);
        Self { json, bounds }
    }
}

/// Box around some tiles.
fn around<'a>(tiles: impl IntoIterator<Item = &'a WrittenTile>) -> [DVec3; 2] {
    let boxes = tiles.into_iter().map(|tile| tile.bounds);
    boxes.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]).unwrap_or_default()
}
