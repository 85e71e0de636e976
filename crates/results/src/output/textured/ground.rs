//! The ground of a textured city: a mesh over its terrain with the photos laid on it.

use glam::{DVec2, DVec3};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use super::super::grid::OutputGrid;

/// Ground with a picture of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TexturedGround {
    /// The ground from above, north up; beside the numbers in files.
    #[serde(skip)]
    pub picture: RgbImage,
    /// Western, southern, eastern and northern edge of the picture, map frame, metres.
    pub bounds_m: [f64; 4],
    /// Columns and rows of the nodes, evenly from edge to edge, at least 2 each.
    pub n_nodes: [usize; 2],
    /// Heights of the nodes, row by row from the north, metres.
    pub heights_m: Vec<f64>,
    /// Cells between the nodes that no photo shows, row by row from the north: the mesh leaves them out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hidden_cells: Vec<usize>,
    /// Names of the photos.
    pub photos: Vec<String>,
}

/// Nodes of the mesh in glTF's axes, their places on the picture, and the triangles between them.
pub(super) struct GroundMesh {
    pub positions: Vec<[f32; 3]>,
    pub uv: Vec<[f32; 2]>,
    pub indices: Vec<u32>,
}

impl TexturedGround {
    /// Place of a node on the picture, shares from its upper left corner.
    pub(in crate::output) fn share(&self, node: usize) -> DVec2 {
        let [columns, rows] = self.n_nodes;
        let [last_x, last_y] = [columns - 1, rows - 1].map(|last| last as f64);
        DVec2::new((node % columns) as f64 / last_x, (node / columns) as f64 / last_y)
    }

    /// Nodes in the map, metres.
    pub(in crate::output) fn nodes(&self) -> Vec<DVec3> {
        let [west_m, south_m, east_m, north_m] = self.bounds_m;
        let node = |i: usize| {
            let at = self.share(i);
            DVec3::new(west_m + at.x * (east_m - west_m), north_m - at.y * (north_m - south_m), self.heights_m[i])
        };
        (0..self.n_nodes[0] * self.n_nodes[1]).map(node).collect()
    }

    /// Triangles between the nodes, counter-clockwise seen from above.
    pub(in crate::output) fn triangles(&self) -> Vec<u32> {
        let [columns, rows] = self.n_nodes;
        let is_shown = |cell: &usize| self.hidden_cells.binary_search(cell).is_err();
        let below = columns as u32;
        let triangles = |cell: usize| {
            let i = (cell / (columns - 1) * columns + cell % (columns - 1)) as u32;
            [i, i + below, i + 1, i + 1, i + below, i + below + 1]
        };
        (0..(columns - 1) * (rows - 1)).filter(is_shown).flat_map(triangles).collect()
    }

    /// The same with another picture, and with so many cells along a side at most.
    pub(super) fn coarser(&self, picture: RgbImage, most_cells: usize) -> Self {
        let n_nodes = self.n_nodes.map(|n| n.min(most_cells + 1));
        let at = |axis: usize, i: usize| (i * (self.n_nodes[axis] - 1)) / (n_nodes[axis] - 1);
        let height = |i: usize| self.heights_m[at(1, i / n_nodes[0]) * self.n_nodes[0] + at(0, i % n_nodes[0])];
        let heights_m = (0..n_nodes[0] * n_nodes[1]).map(height).collect();
        let is_hidden = |cell: &usize| {
            let [col, row] = [cell % (n_nodes[0] - 1), cell / (n_nodes[0] - 1)];
            let of_row = |row: usize| (at(0, col)..at(0, col + 1)).map(move |col| row * (self.n_nodes[0] - 1) + col);
            let mut cells = (at(1, row)..at(1, row + 1)).flat_map(of_row);
            cells.all(|cell| self.hidden_cells.binary_search(&cell).is_ok())
        };
        let hidden_cells = (0..(n_nodes[0] - 1) * (n_nodes[1] - 1)).filter(is_hidden).collect();
        Self { picture, n_nodes, heights_m, hidden_cells, bounds_m: self.bounds_m, photos: self.photos.clone() }
    }

    pub(super) fn mesh(&self, grid: &OutputGrid) -> GroundMesh {
        let origin = DVec3::from_array(grid.origin_m);
        let position = |node: &DVec3| {
            let local = *node - origin;
            DVec3::new(local.x, local.z, -local.y).as_vec3().to_array()
        };
        let n = self.n_nodes[0] * self.n_nodes[1];
        GroundMesh {
            positions: self.nodes().iter().map(position).collect(),
            uv: (0..n).map(|i| self.share(i).as_vec2().to_array()).collect(),
            indices: self.triangles(),
        }
    }

    /// The picture as JPEG.
    pub(super) fn jpeg(&self) -> Vec<u8> {
        super::jpeg(&self.picture)
    }
}
