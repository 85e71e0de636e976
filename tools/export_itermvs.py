#!/usr/bin/env python3
"""Exports IterMVS to ONNX: depth of one photo from others that see the same ground, with poses.

Wang et al., "IterMVS: Iterative Probability Estimation for Efficient Multi-View Stereo", CVPR 2022. Written anew from the
paper and the names and shapes in its checkpoint (github.com/FangjinhuaWang/IterMVS, MIT), so that the graph takes photos of
any size and number, and uses nothing that inference engines lack.

  images       1 × n × 3 × H × W   the view first, then its sources; −1 to 1, free of lens distortion; H, W multiples of 32
  extrinsics   1 × n × 4 × 4       world to camera; the first one is the identity
  intrinsics   1 × n × 3 × 3       pixels of these photos, the first pixel's centre is (0.5, 0.5); no skew
  depth_range  1 × 2               nearest and farthest depth that is looked for, in the unit of the poses
  depth, confidence  1 × 1 × H × W  along the optical axis; confidence 0 to 1

Written are the graph without its weights, and a table that says where in the checkpoint they are: what `sizeup model get
itermvs` needs to put the network together, and what lies in crates/photos/src/prior/network/graphs/ (the graph in a ZIP). The weights
themselves are nowhere in sizeup. itermvs.f32 is what PyTorch finds in photos that a formula paints, for
fixtures/onnx/itermvs.f32.

Usage: target/networks/bin/python tools/export_itermvs.py CHECKPOINT FOLDER, after `make deps-networks`
"""
import hashlib
import json
import sys
from pathlib import Path

import onnx
import torch
import torch.nn.functional as F

ITERATIONS = 4
GROUPS = 8  # of channels, correlated apart
FIRST_DEPTHS = 32  # planes of the first sweep
CLASSES = 256  # of inverse depth, in a pixel's distribution
RADIUS = 4  # classes around the most probable one, that the depth is the mean of
# Where each level is correlated anew, in classes from the present depth.
OFFSETS = {1: [-2.0, -2.0 / 3, 2.0 / 3, 2.0], 2: [-8.0, -8.0 / 3, 8.0 / 3, 8.0], 3: [-32.0, 32.0]}


def resized(x, factor):
    return F.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)


class IterMvs(torch.nn.Module):
    """The network as one function of its weights, by their names in the checkpoint."""

    def __init__(self, weights):
        super().__init__()
        self.names, self.kernels = {}, {}
        for name, tensor in weights.items():
            name = name.removeprefix("module.")
            if name.endswith("num_batches_tracked") or ".inner3." in name:
                continue
            self.names[name] = name.replace(".", "_")
            self.kernels[name] = tensor.shape[-1] if tensor.dim() == 4 else None
            self.register_parameter(self.names[name], torch.nn.Parameter(tensor, requires_grad=False))

    def weight(self, name):
        return getattr(self, self.names[name]) if name in self.names else None

    def conv(self, x, name, stride=1, dilation=1):
        padding = dilation * (self.kernels[name + ".weight"] // 2)
        return F.conv2d(x, self.weight(name + ".weight"), self.weight(name + ".bias"), stride, padding, dilation)

    def grown(self, x, name):
        return F.conv_transpose2d(x, self.weight(name + ".weight"), stride=2, padding=1, output_padding=1)

    def conv_norm(self, x, name, stride=1):
        x = self.conv(x, name + ".conv", stride)
        of = [self.weight(f"{name}.bn.{part}") for part in ("running_mean", "running_var", "weight", "bias")]
        return F.batch_norm(x, *of, training=False)

    def residual(self, x, name, stride):
        y = self.conv_norm(F.relu(self.conv_norm(x, name + ".conv1", stride)), name + ".conv2")
        return F.relu(y + (x if stride == 1 else self.conv_norm(x, name + ".downsample", stride)))

    def features(self, images):
        """Of all photos at a half, a quarter and an eighth of their size."""
        at = {0: F.relu(self.conv_norm(images, "feature_net.conv1"))}
        for level in (1, 2, 3):
            half = self.residual(at[level - 1], f"feature_net.layer{level}.0", 2)
            at[level] = self.residual(half, f"feature_net.layer{level}.1", 1)
        features, below = {3: self.conv(at[3], "feature_net.output3")}, at[3]
        for level in (2, 1):
            below = resized(below, 2) + self.conv(at[level], f"feature_net.inner{level}")
            features[level] = self.conv(below, f"feature_net.output{level}")
        return features

    def correlation(self, features, of_view, depths, to_source, level, step):
        """How alike the view and each source are at these depths: n × groups × depths × rows × columns. The depths' pixels
        lie `step` pixels of the level apart."""
        n_depths, rows, columns = depths.shape[1], depths.shape[2], depths.shape[3]
        sources = features[level][1:]
        turn, shift = to_source[level]
        column = torch.ones_like(depths[0, 0]).cumsum(1) - 1.0
        row = torch.ones_like(depths[0, 0]).cumsum(0) - 1.0
        rays = torch.stack([(column * step).reshape(-1), (row * step).reshape(-1), torch.ones_like(row).reshape(-1)])
        points = (turn @ rays)[:, :, None] * depths.reshape(1, 1, n_depths, -1) + shift[:, :, :, None]
        z = points[:, 2]
        is_ahead = (z > 1e-2).to(z.dtype)
        z = z * is_ahead + (1.0 - is_ahead)
        size = sources.shape[2:]
        outside = 2.0 * (1.0 - is_ahead)
        x = (points[:, 0] * is_ahead) / z * (2.0 / (size[1] - 1)) - 1.0 + 2.0 * outside
        y = (points[:, 1] * is_ahead) / z * (2.0 / (size[0] - 1)) - 1.0 + 2.0 * outside
        grid = torch.stack([x, y], dim=3)
        grid = grid.reshape(grid.shape[0], n_depths * rows, columns, 2)
        warped = F.grid_sample(sources, grid, mode="bilinear", padding_mode="zeros", align_corners=True)
        channels = 16 * level // GROUPS
        pair = warped.reshape(-1, GROUPS, channels, n_depths, rows * columns) * \
            of_view.reshape(1, GROUPS, channels, 1, rows * columns)
        return pair.mean(2).reshape(-1, GROUPS, n_depths, rows, columns)

    def by_depth(self, x):
        """Depths as a batch of pictures."""
        x = x.permute(0, 2, 1, 3, 4)
        return x.reshape(-1, GROUPS, x.shape[3], x.shape[4])

    def view_weights(self, correlation):
        name = "iter_mvs.evaluation.pixel_view_weight.conv"
        x = self.conv(F.relu(self.conv(self.by_depth(correlation), name + ".0.conv")), name + ".1")
        x = x.reshape(-1, FIRST_DEPTHS, x.shape[2], x.shape[3])
        return torch.softmax(x, 1).max(1, keepdim=True)[0]

    def aggregated(self, correlation, weights, level):
        """One score per depth: the mean over sources by weight, then a small U-Net over the picture."""
        weights = weights.unsqueeze(1)
        x = (correlation * weights).sum(0, keepdim=True) / (1e-5 + weights.sum(0, keepdim=True))
        n_depths = correlation.shape[2]
        name = f"iter_mvs.evaluation.corr_conv1.{level - 1}"
        whole = F.relu(self.conv(self.by_depth(x), name + ".conv0.conv"))
        half = F.relu(self.conv(whole, name + ".conv1.conv", 2))
        quarter = F.relu(self.conv(half, name + ".conv2.conv", 2))
        half = half + self.grown(quarter, name + ".conv3")
        whole = self.conv(whole + self.grown(half, name + ".conv4"), name + ".conv5")
        return whole.reshape(1, n_depths, whole.shape[2], whole.shape[3])

    def place(self, hidden):
        """The depth of each pixel as a share of the range of inverse depth, from its distribution."""
        name = "iter_mvs.update.depth_head"
        x = F.relu(self.conv(hidden, name + ".0", dilation=2))
        probability = torch.softmax(self.conv(F.relu(self.conv(x, name + ".2")), name + ".4"), 1)
        best = probability.argmax(1, keepdim=True)
        mean, total = 0.0, 1e-6
        for offset in range(-RADIUS, RADIUS + 1):
            index = (best + offset).clamp(0, CLASSES - 1)
            there = torch.gather(probability, 1, index)
            mean, total = mean + index.to(there.dtype) * there, total + there
        return mean / total / (CLASSES - 1.0)

    def gru(self, hidden, x):
        gate = lambda name, x: self.conv(x, "iter_mvs.update.gru.conv" + name, dilation=2)
        both = torch.cat([hidden, x], 1)
        update, reset = torch.sigmoid(gate("z", both)), torch.sigmoid(gate("r", both))
        return (1.0 - update) * hidden + update * torch.tanh(gate("q", torch.cat([reset * hidden, x], 1)))

    def confidence(self, hidden):
        name = "iter_mvs.update.confidence_head"
        return torch.sigmoid(self.conv(F.relu(self.conv(hidden, name + ".0", dilation=2)), name + ".2"))

    def enlarged(self, x, features):
        """Four times as large: each pixel a mean of the nine around it, with weights of its own."""
        weights = self.conv(F.relu(self.conv(features, "iter_mvs.upsample.0")), "iter_mvs.upsample.2")
        rows, columns = x.shape[2], x.shape[3]
        weights = torch.softmax(weights.reshape(9, 16, rows, columns), 0)
        x = torch.cat([x[:, :, :1], x, x[:, :, -1:]], 2)
        x = torch.cat([x[:, :, :, :1], x, x[:, :, :, -1:]], 3)
        nine = [x[:, 0, r:r + rows, c:c + columns] for r in range(3) for c in range(3)]
        x = (torch.stack(nine) * weights).sum(0).reshape(4, 4, rows, columns)
        return x.permute(2, 0, 3, 1).reshape(1, 1, 4 * rows, 4 * columns)

    def forward(self, images, extrinsics, intrinsics, depth_range):
        images, extrinsics, intrinsics = images[0], extrinsics[0], intrinsics[0]
        farthest, nearest = 1.0 / depth_range[0, 1], 1.0 / depth_range[0, 0]
        depth_at = lambda share: 1.0 / (farthest + share * (nearest - farthest))
        to_source = {level: between(extrinsics, intrinsics, 0.5 ** level) for level in (1, 2, 3)}
        features = self.features(images)

        planes = torch.arange(FIRST_DEPTHS).reshape(1, FIRST_DEPTHS, 1, 1).to(images.dtype) / (FIRST_DEPTHS - 1)
        planes = planes + 0.0 * features[3][:1, :1]
        correlation = self.correlation(features, features[3][:1], depth_at(planes), to_source, 3, 1.0)
        weights = self.view_weights(correlation)
        scores = self.aggregated(correlation, weights, 3)
        weights = resized(weights, 2)

        name = "iter_mvs.update.hidden_init_head"
        hidden = self.conv(F.relu(self.conv(scores, name + ".0")), name + ".2")
        hidden = torch.tanh(resized(hidden, 2))
        share = self.place(hidden)
        of_view = {1: resized(features[1][:1], 0.5), 2: features[2][:1], 3: resized(features[3][:1], 2)}
        for _ in range(ITERATIONS):
            scores = []
            for level, offsets in OFFSETS.items():
                offsets = torch.tensor(offsets).reshape(1, -1, 1, 1) / CLASSES
                depths = depth_at((share + offsets).clamp(0.0, 1.0))
                correlation = self.correlation(features, of_view[level], depths, to_source, level, 2.0 ** (2 - level))
                scores.append(self.aggregated(correlation, weights, level))
            hidden = self.gru(hidden, torch.cat([share, *scores], 1))
            share = self.place(hidden)
        depth = depth_at(self.enlarged(share, features[2][:1]))
        return depth, resized(self.confidence(hidden), 4)


def between(extrinsics, intrinsics, scale):
    """From a pixel of the view (column, row, 1) times depth to one of each source: turn n × 3 × 3, shift n × 3 × 1. Pixels are
    counted from the first one's centre; a convolution of stride 2 keeps that place."""
    def matrix(of):
        fx, fy = of[:, 0, 0] * scale, of[:, 1, 1] * scale
        cx, cy = (of[:, 0, 2] - 0.5) * scale, (of[:, 1, 2] - 0.5) * scale
        return fx, fy, cx, cy

    zero = intrinsics[:, 0, 0] * 0.0
    fx, fy, cx, cy = matrix(intrinsics)
    forward = torch.stack([torch.stack([fx, zero, cx], 1), torch.stack([zero, fy, cy], 1),
                           torch.stack([zero, zero, zero + 1.0], 1)], 1)
    backward = torch.stack([torch.stack([1.0 / fx, zero, -cx / fx], 1), torch.stack([zero, 1.0 / fy, -cy / fy], 1),
                            torch.stack([zero, zero, zero + 1.0], 1)], 1)
    turn = forward[1:] @ extrinsics[1:, :3, :3] @ backward[:1]
    return turn, forward[1:] @ extrinsics[1:, :3, 3:4]


def read(checkpoint):
    return {name.removeprefix("module."): tensor for name, tensor in torch.load(checkpoint, map_location="cpu")["model"].items()}


def example(n=4, rows=64, columns=96):
    """Photos of a level plane that a formula paints, which tests in Rust paint again; the cameras side by side."""
    y, x = torch.arange(rows).reshape(-1, 1), torch.arange(columns).reshape(1, -1)
    photo = lambda i, c: (x + 6 * i) * (x + 6 * i) * 7 + y * 31 + (x + 6 * i) * y * 5 + c * 83
    images = torch.stack([torch.stack([photo(i, c) % 256 for c in range(3)]) for i in range(n)])[None] / 127.5 - 1.0
    extrinsics = torch.eye(4).repeat(1, n, 1, 1)
    extrinsics[0, :, 0, 3] = torch.arange(n) * -5.0
    intrinsics = torch.tensor([[120.0, 0.0, columns / 2], [0.0, 120.0, rows / 2], [0.0, 0.0, 1.0]]).repeat(1, n, 1, 1)
    return images, extrinsics, intrinsics, torch.tensor([[40.0, 120.0]])


def exported(network, path):
    inputs, outputs = ["images", "extrinsics", "intrinsics", "depth_range"], ["depth", "confidence"]
    axes = {"images": {1: "n", 3: "height", 4: "width"}, "extrinsics": {1: "n"}, "intrinsics": {1: "n"},
            "depth": {2: "height", 3: "width"}, "confidence": {2: "height", 3: "width"}}
    with torch.no_grad():
        torch.onnx.export(network, example(), str(path), input_names=inputs, output_names=outputs, dynamic_axes=axes,
                          opset_version=16, do_constant_folding=False, training=torch.onnx.TrainingMode.PRESERVE)


def without_weights(path, network, checkpoint):
    """Points the graph to a file of weights beside it, and says where in the checkpoint each of them is."""
    content = Path(checkpoint).read_bytes()
    names = {parameter: name for name, parameter in network.names.items()}
    graph = onnx.load(str(path))
    table, end = [], 0
    for tensor in graph.graph.initializer:
        if tensor.name not in names:
            continue
        data = tensor.raw_data
        if data not in content:
            sys.exit(f"{names[tensor.name]} does not stand in the checkpoint as it is in the graph")
        start = -(-end // 64) * 64  # engines map weights into memory
        end = start + len(data)
        table.append({"name": names[tensor.name], "checkpoint_offset": content.index(data), "offset": start, "bytes": len(data)})
        tensor.ClearField("raw_data")
        tensor.data_location = onnx.TensorProto.EXTERNAL
        for key, value in (("location", "itermvs.onnx_data"), ("offset", start), ("length", len(data))):
            entry = tensor.external_data.add()
            entry.key, entry.value = key, str(value)
    onnx.save(graph, str(path))
    return {"checkpoint_bytes": len(content), "checkpoint_sha256": hashlib.sha256(content).hexdigest(), "weights_bytes": end,
            "tensors": table}


if __name__ == "__main__":
    checkpoint, folder = Path(sys.argv[1]), Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    network = IterMvs(read(checkpoint))
    exported(network, folder / "itermvs.onnx")
    table = without_weights(folder / "itermvs.onnx", network, checkpoint)
    (folder / "itermvs.json").write_text(json.dumps(table, indent=1) + "\n")
    with torch.no_grad():
        found = network(*example())
    # What a test compares engines with: every other row and column of depth, then of confidence.
    (folder / "itermvs.f32").write_bytes(b"".join(map[0, 0, ::2, ::2].numpy().tobytes() for map in found))
    print(f"{folder / 'itermvs.onnx'}: {(folder / 'itermvs.onnx').stat().st_size} bytes, {len(table['tensors'])} tensors apart")
