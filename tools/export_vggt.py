#!/usr/bin/env python3
"""Exports VGGT to ONNX: depth of one photo and its neighbours, and the poses that the network finds for them, no poses in.

Wang et al., "VGGT: Visual Geometry Grounded Transformer", CVPR 2025. The network is the authors' own code
(github.com/facebookresearch/vggt), which has to be where Python finds it: no package registry has it.

  images       1 × n × 3 × H × W   the view first; 0 to 1; H, W multiples of 14, the longer side 518
  depth        1 × n × H × W × 1   along the optical axis, in the network's unit
  depth_conf   1 × n × H × W       from 1; grows with how sure it is
  pose_enc     1 × n × 9           world to camera: translation in the depth's unit, quaternion x y z w, fields of view

That is what the profile `vggt` takes (`sizeup model inspect GRAPH`): laid over the photos' poses, those of the network bring the depth to
metres. The number of photos and their size are written into the graph.

Weights have their own licences: `VGGT-1B` is for research only, `VGGT-1B-Commercial` may be used commercially within its terms. Neither
is fetched here. Without a checkpoint, a narrow network of the same architecture with random weights is written, to try engines on.

Usage: PYTHONPATH=VGGT target/networks/bin/python tools/export_vggt.py GRAPH [CHECKPOINT] [--photos 4] [--size 392x518]
       (rows x columns), after `make deps-networks`
"""
import argparse
from functools import partial
from pathlib import Path

import torch

import export_depth_networks as exporter  # what PyTorch 1.13 lacks
from vggt.heads import dpt_head
from vggt.heads.camera_head import CameraHead
from vggt.layers import vision_transformer
from vggt.models.aggregator import Aggregator

# Width, heads and layers of the narrow network, and the layers whose tokens the depth is made from.
NARROW = {"embed_dim": 384, "num_heads": 6, "depth": 4}
NARROW_LAYERS = [0, 1, 2, 3]


def constants_of(function):
    """The same function, which computes once and in single precision: what depends on the photos' size alone is a constant of the
    graph, and not computed in double precision as the authors do, which engines lack."""
    known = {}

    def constant(grid, *more):
        key = tuple(int(n) for n in (*grid.shape, *more))  # while it is traced, sizes are tensors
        if key not in known:
            known[key] = function(grid, *more).float()
        return known[key]

    return constant


dpt_head.position_grid_to_embed = constants_of(dpt_head.position_grid_to_embed)


class OfPhotos(torch.nn.Module):
    """Depth, confidence and poses of photos: the parts of VGGT that depth needs."""

    def __init__(self, aggregator, camera_head, depth_head):
        super().__init__()
        self.aggregator, self.camera_head, self.depth_head = aggregator, camera_head, depth_head

    def forward(self, images):
        tokens, first_patch = self.aggregator(images)
        depth, confidence = self.depth_head(tokens, images=images, patch_start_idx=first_patch)
        return depth, confidence, self.camera_head(tokens)[-1]


def narrow():
    width = NARROW["embed_dim"]
    aggregator = Aggregator(patch_embed="conv", **NARROW)
    # The real patch embedding, a ViT; by hand, as some copies of the code fetch its weights.
    aggregator.patch_embed = vision_transformer.vit_small(
        img_size=518, patch_size=14, num_register_tokens=4, init_values=1.0, block_chunks=0)
    depth_head = dpt_head.DPTHead(dim_in=2 * width, output_dim=2, activation="exp", conf_activation="expp1",
                         intermediate_layer_idx=NARROW_LAYERS)
    return OfPhotos(aggregator, CameraHead(dim_in=2 * width, trunk_depth=1), depth_head)


def trained(checkpoint):
    from vggt.models.vggt import VGGT
    network = VGGT()
    network.load_state_dict(torch.load(checkpoint, map_location="cpu"))
    return OfPhotos(network.aggregator, network.camera_head, network.depth_head)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("graph", type=Path)
    parser.add_argument("checkpoint", type=Path, nargs="?")
    parser.add_argument("--photos", type=int, default=4)
    parser.add_argument("--size", default="392x518")
    arguments = parser.parse_args()
    rows, columns = map(int, arguments.size.split("x"))
    torch.manual_seed(1)
    network = (trained(arguments.checkpoint) if arguments.checkpoint else narrow()).eval()
    embedding = network.aggregator.patch_embed
    with torch.no_grad():
        tokens = torch.zeros(1, 1 + rows // 14 * (columns // 14), embedding.embed_dim)
        positions = embedding.interpolate_pos_encoding(tokens, rows, columns)
    # Their cubic resizing has no operator in ONNX; the size is fixed, so they are constants.
    embedding.interpolate_pos_encoding = partial(lambda constant, *_: constant, positions)
    arguments.graph.parent.mkdir(parents=True, exist_ok=True)
    unfolded = arguments.graph.with_suffix(".unfolded.onnx")
    example = torch.rand(1, arguments.photos, 3, rows, columns)
    with torch.no_grad():
        network(example)  # makes the constants, outside of what is traced
    exporter.export(network, ["images"], ["depth", "depth_conf", "pose_enc"], example, None, unfolded)
    exporter.fold(unfolded, arguments.graph)


if __name__ == "__main__":
    main()
