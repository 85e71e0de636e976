#!/usr/bin/env python3
"""Exports the real architectures of depth networks, with random weights, to ONNX: to try engines on, not to use.

  depth-anything-v2-small.onnx   from transformers (DepthAnythingForDepthEstimation, the configuration of the small model)
  depth-anything-v2-small-392x518.onnx  the same for photos of 4:3 alone, with everything folded that then is constant
  da3-small-378x504.onnx         from depth-anything-3 (its small any-view network, one photo of 4:3), where that is installed
  da3-small-3x252x336.onnx       the same network for three photos with their poses and calibration, which gives poses back

The first takes any multiple of 14 per side. Trained weights have their own licences and are not fetched here; the same
export applies to a model that carries them.

Usage: target/networks/bin/python tools/export_depth_networks.py [FOLDER], after `make deps-networks`
"""
import sys
from pathlib import Path

import torch


def attention(query, key, value, attn_mask=None, dropout_p=0.0):
    """What PyTorch 2 has as scaled_dot_product_attention; distributions still have PyTorch 1.13."""
    weights = query @ key.transpose(-2, -1) / query.shape[-1] ** 0.5
    return torch.softmax(weights if attn_mask is None else weights + attn_mask, dim=-1) @ value


def meshgrid(first, second, indexing="ij"):
    """torch.meshgrid of two, in operators that PyTorch 1.13 exports."""
    if indexing == "xy":
        return tuple(reversed(meshgrid(second, first)))
    return first.reshape(-1, 1) + 0 * second.reshape(1, -1), 0 * first.reshape(-1, 1) + second.reshape(1, -1)


def cartesian_prod(first, second):
    """What ONNX has no operator for."""
    return torch.stack([axis.reshape(-1) for axis in meshgrid(first, second)], dim=-1)


torch.meshgrid, torch.cartesian_prod = meshgrid, cartesian_prod
# The exporter of PyTorch 1.13 does not know this name of a transposition; here it is only used on 1 × n × 3 × 3.
torch.onnx.register_custom_op_symbolic("aten::mT", lambda g, matrices: g.op("Transpose", matrices, perm_i=[0, 1, 3, 2]), 9)
if not hasattr(torch.nn.functional, "scaled_dot_product_attention"):
    torch.nn.functional.scaled_dot_product_attention = attention


def export(model, inputs, outputs, example, axes, path):
    model.eval()
    with torch.no_grad():
        torch.onnx.export(model, example, str(path), input_names=inputs, output_names=outputs, dynamic_axes=axes,
                          opset_version=16)
    print(f"{path}: {sum(p.numel() for p in model.parameters()) / 1e6:.1f} million parameters")


def fold(graph, folded):
    """Computes what does not depend on the photo once and for all: above all the cubic resizing of position embeddings,
    which leaves graphs of a fixed size without anything that sizeup's embedded engine refuses."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(folded)
    onnxruntime.InferenceSession(str(graph), options, providers=["CPUExecutionProvider"])
    graph.unlink()
    print(f"{folded}: folded")


def depth_anything_v2(folder):
    from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation, Dinov2Config
    from transformers.models.depth_anything import modeling_depth_anything
    stages = ["stage3", "stage6", "stage9", "stage12"]
    backbone = Dinov2Config(hidden_size=384, num_hidden_layers=12, num_attention_heads=6, image_size=518, patch_size=14,
                            out_features=stages, reshape_hidden_states=False, apply_layernorm=True)
    config = DepthAnythingConfig(backbone_config=backbone, reassemble_hidden_size=384, patch_size=14,
                                 neck_hidden_sizes=[48, 96, 192, 384], fusion_hidden_size=64, head_hidden_size=32)
    network = DepthAnythingForDepthEstimation(config)
    # From here on: int() would write the example's size into the graph.
    modeling_depth_anything.int = lambda value: value

    class Bare(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.network = network

        def forward(self, pixel_values):
            return self.network(pixel_values=pixel_values).predicted_depth

    axes = {"pixel_values": {0: "batch", 2: "height", 3: "width"}, "predicted_depth": {0: "batch", 1: "height", 2: "width"}}
    example = torch.zeros(1, 3, 392, 518)
    export(Bare(), ["pixel_values"], ["predicted_depth"], example, axes, folder / "depth-anything-v2-small.onnx")
    export(Bare(), ["pixel_values"], ["predicted_depth"], example, None, folder / "fixed.onnx")
    fold(folder / "fixed.onnx", folder / "depth-anything-v2-small-392x518.onnx")


def depth_anything_3(folder):
    from depth_anything_3.cfg import create_object, load_config
    from depth_anything_3.registry import MODEL_REGISTRY

    network = create_object(load_config(MODEL_REGISTRY["da3-small"]))

    class OnePhoto(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.network = network

        def forward(self, image):
            return self.network(image[:, None])["depth"]

    # Its position embeddings are traced for the example's size whatever is declared free, so the size is fixed.
    export(OnePhoto(), ["image"], ["depth"], torch.zeros(1, 3, 378, 504), None, folder / "fixed.onnx")
    fold(folder / "fixed.onnx", folder / "da3-small-378x504.onnx")
    depth_anything_3_with_poses(folder, network)


def depth_anything_3_with_poses(folder, network):
    class WithPoses(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.network = network

        def forward(self, image, extrinsics, intrinsics):
            found = self.network(image, extrinsics, intrinsics)
            return found["depth"], found["extrinsics"]

    n, height, width = 3, 252, 336
    poses = torch.eye(4).repeat(1, n, 1, 1)
    poses[0, 1, 0, 3], poses[0, 2, 1, 3] = 1.0, -1.2
    calibration = torch.tensor([[350.0, 0.0, width / 2], [0.0, 350.0, height / 2], [0.0, 0.0, 1.0]]).repeat(1, n, 1, 1)
    example = (torch.zeros(1, n, 3, height, width), poses, calibration)
    export(WithPoses(), ["image", "extrinsics", "intrinsics"], ["depth", "predicted_extrinsics"], example, None,
           folder / "fixed.onnx")
    fold(folder / "fixed.onnx", folder / "da3-small-3x252x336.onnx")


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "target/networks/graphs")
    target.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(1)
    depth_anything_v2(target)
    try:
        depth_anything_3(target)
    except ImportError as missing:
        print(f"Depth Anything 3 is left out: {missing}")
