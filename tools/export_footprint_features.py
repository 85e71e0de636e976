#!/usr/bin/env python3
"""Computes the frozen features of the paper's footprint network from photos: SAM 3's and Depth Anything 3's.

    make deps-features                                             # PyTorch, transformers and Depth Anything 3, in target/features
    target/features/bin/python tools/export_footprint_features.py SET FEATURES --sam3 WEIGHTS/sam3 --da3 WEIGHTS/DA3MONO-LARGE
    target/features/bin/python tools/export_footprint_features.py SET FEATURES --sam3 … --da3 … --graphs GRAPHS

SET is what `sizeup-train dataset` wrote (SET/SCENE/images/*), or any folder of photos, which then is the scene. FEATURES gets
SCENE/PHOTO.safetensors each, for `features` of a training; GRAPHS gets texture.onnx and geometry.onnx, for
`[footprints.backbones]` of profile "fpsam.v1". What is done already is left as it is.

A file holds, as channels × rows × columns (of one tile of 1008 × 1008 pixels, in brackets):

  tex0, tex1, tex2  texture: the image encoder's pyramid at strides 3.5, 7 and 14 (256 × 288 × 288, 256 × 144 × 144, 256 × 72 × 72)
  sem               semantic: the pixel embedding of the branch that the prompt guides (256 × 288 × 288)
  geo               geometry: patch tokens of the last block of Depth Anything 3's ViT-L, normalised (1024 × 72 × 72; of a photo of
                    4:3 1024 × 54 × 72)

All maps are of the whole photo: cell (row, column) of a map of R × C cells is the mean look at columns W·column/C to W·(column + 1)/C of
the photo's W, and rows likewise. A photo of up to `--tile` pixels is brought to SAM 3's square as a whole, as its own preprocessing
does; a larger one is cut into tiles of that many pixels, as `sizeup footprints` does, brought to a size whose tiles begin at whole
cells, so that maps of neighbouring tiles are blended cell by cell, without being resampled.

Weights are folders as Hugging Face has them (config.json, model.safetensors), and are not fetched. `--random` takes the real
architectures with random weights instead: shapes and speed are right, what the maps say means nothing. Licences of weights: SAM License
(SAM 3: acknowledge in publications, no military use); CC BY-NC 4.0 (DA3-LARGE); Apache-2.0 (DA3MONO-LARGE, DA3METRIC-LARGE).
"""
import argparse
import hashlib
import json
import math
import os
import resource
import sys
import time
import warnings
from pathlib import Path

INSTALL = "`make deps-features`, then run this with target/features/bin/python"
PHOTOS = {".jpg", ".jpeg", ".png", ".tif", ".tiff"}
PATCH = 14
"""Pixels per patch, of both networks."""
# "building" between start and end, by the vocabulary of CLIP that SAM 3 uses, for weights that come without a tokenizer.
START, BUILDING, END, N_TOKENS = 49406, 2307, 49407, 32
LEAST_WEIGHT = 0.02
"""Of a cell at a tile's border, as in crates/footprints/src/segment/tiles.rs."""
LICENCES = {
    "sam3": "SAM License",
    "da3-large": "CC BY-NC 4.0",
    "da3mono-large": "Apache-2.0",
    "da3metric-large": "Apache-2.0",
}


class Fault(Exception):
    """What is wrong with what was given, in words."""


def say(text):
    print(text, file=sys.stderr, flush=True)


os.environ.setdefault("DA3_LOG_LEVEL", "ERROR")
warnings.filterwarnings("ignore", category=UserWarning, module="depth_anything_3|omegaconf|torch")
warnings.filterwarnings("ignore", category=FutureWarning)
try:
    import numpy as np
    import torch
    from PIL import Image
    from safetensors import safe_open
    from safetensors.torch import load_file, save_file
    from torchvision.transforms.v2 import functional as pixels
except ImportError as missing:
    sys.exit(f"error: {missing}\nhint: {INSTALL}")


# Networks ---------------------------------------------------------------------------------------------------------------------


class Texture(torch.nn.Module):
    """SAM 3 up to its pixel embedding; the prompt is folded in, the text encoder is gone."""

    names = ("tex0", "tex1", "tex2", "sem")
    mean, std = (0.5, 0.5, 0.5), (0.5, 0.5, 0.5)

    def __init__(self, model, token_ids):
        super().__init__()
        ids = torch.tensor([token_ids])
        # Padding follows the last token, which is the end.
        is_word = torch.arange(ids.shape[1])[None] <= token_ids.index(END)
        prompt = model.get_text_features(input_ids=ids, attention_mask=is_word.long(), return_dict=True).pooler_output
        # What is padded is masked out wherever the prompt is looked at: the words alone say the same, and need no mask.
        self.register_buffer("prompt", prompt[:, : int(is_word.sum())].clone())
        self.vision, self.fusion, self.masks = model.vision_encoder, model.detr_encoder, model.mask_decoder
        for norm in (part for part in self.vision.backbone.modules() if isinstance(part, torch.nn.LayerNorm)):
            # As SAM 3 was trained (vitdet.py of its own code); transformers' configuration says 1e-6.
            norm.eps = 1e-5
        self.places = model.geometry_encoder
        # Only what encodes places that a user points at, and there are none.
        for unused in ("boxes_direct_project", "boxes_pool_project", "boxes_pos_enc_project", "label_embed", "vision_layer_norm"):
            delattr(self.places, unused)
        # Queries only matter to masks, which nobody asks for.
        self.register_buffer("query", torch.zeros(1, 1, self.masks.config.hidden_size))
        self.side = model.config.image_size
        self.cells = self.side // PATCH
        self.per_cell = {"tex0": 4, "tex1": 2, "tex2": 1, "sem": 4}

    def forward(self, image):
        seen = self.vision(image)
        # The fourth level is coarser than a patch, and SAM 3 itself drops it.
        pyramid, position = seen.fpn_hidden_states[:3], seen.fpn_position_encoding[2]
        prompt = torch.cat([self.prompt, self.nowhere(pyramid[2], position)], dim=1)
        fused = self.fusion(vision_features=[pyramid[2]], text_features=prompt, vision_pos_embeds=[position])
        embedded = []
        hook = self.masks.pixel_decoder.register_forward_hook(lambda _module, _given, found: embedded.append(found))
        try:
            self.masks(decoder_queries=self.query, backbone_features=list(pyramid), encoder_hidden_states=fused.last_hidden_state,
                       prompt_features=prompt)
        finally:
            hook.remove()
        return (*pyramid, embedded[0])

    def nowhere(self, map, position):
        """The token that says of places "nowhere in particular". SAM 3's own code puts it behind the words of every prompt
        (Sam3Image._encode_prompt, SequenceGeometryEncoder.forward of facebookresearch/sam3, sam3 0.1.4 on PyPI); Sam3Model of
        transformers 5.24 leaves it out where there are no boxes, and says otherwise than SAM 3 does."""
        map, position = (x.flatten(2).transpose(1, 2) for x in (map, position))
        token = self.places.prompt_layer_norm(self.places.final_proj(self.places.cls_embed.weight[None]))
        for layer in self.places.layers:
            token = layer(prompt_feats=token, vision_feats=map, vision_pos_encoding=position, prompt_mask=None)
        return self.places.output_layer_norm(token)


class Geometry(torch.nn.Module):
    """Depth Anything 3's backbone: the last block's patch tokens as a map."""

    names = ("geo",)
    mean, std = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)

    def __init__(self, backbone, side):
        super().__init__()
        self.backbone, self.side = backbone, side
        self.cells = side // PATCH
        self.per_cell = {"geo": 1}

    def forward(self, image):
        last = len(self.backbone.blocks) - 1
        _, [tokens] = self.backbone.get_intermediate_layers(image[:, None], [last], export_feat_layers=[last])
        rows, columns = image.shape[-2] // PATCH, image.shape[-1] // PATCH
        return (tokens[:, 0].transpose(1, 2).reshape(1, -1, rows, columns),)


def fingerprint(files):
    """Tells weights apart without reading gigabytes: sizes, and both ends of each file."""
    digest = hashlib.sha256()
    for path in sorted(files):
        size = path.stat().st_size
        with open(path, "rb") as file:
            digest.update(f"{path.name} {size}".encode() + file.read(1 << 20))
            file.seek(max(0, size - (1 << 20)))
            digest.update(file.read())
    return digest.hexdigest()[:16]


def weights_of(folder, what):
    if not folder.is_dir():
        raise Fault(f"{folder} is no folder: `--{what}` names one with config.json and model.safetensors")
    files = sorted(folder.glob("*.safetensors"))
    if not files or not (folder / "config.json").is_file():
        raise Fault(f"{folder} has no config.json with *.safetensors beside it: weights as Hugging Face lays them out are expected")
    return files


def token_ids(folder, prompt):
    if folder and any((folder / name).is_file() for name in ("tokenizer.json", "vocab.json")):
        from transformers import AutoTokenizer

        tokenizer = AutoTokenizer.from_pretrained(folder, local_files_only=True)
        ids = tokenizer(prompt, padding="max_length", max_length=N_TOKENS, truncation=True)["input_ids"]
        if END not in ids:
            raise Fault(f"the tokenizer in {folder} is not that of SAM 3: it says {ids} of {prompt!r}")
        return ids
    if prompt != "building":
        raise Fault(f"{folder or 'random weights'}: there is no tokenizer (tokenizer.json), and only \"building\" is known without one")
    return [START, BUILDING] + [END] * (N_TOKENS - 2)


def sam3(args):
    try:
        from transformers import Sam3Config, Sam3Model
        from transformers.utils import logging
    except ImportError as missing:
        raise Fault(f"{missing}: transformers 5 has SAM 3. {INSTALL}") from missing
    logging.disable_progress_bar()
    logging.set_verbosity_error()
    if args.sam3:
        files = weights_of(args.sam3, "sam3")
        kind = json.loads((args.sam3 / "config.json").read_text()).get("model_type")
        if kind not in ("sam3", "sam3_video"):
            raise Fault(f"{args.sam3} holds a {kind!r}, no SAM 3")
        model, about = Sam3Model.from_pretrained(args.sam3, local_files_only=True, dtype=torch.float32, output_loading_info=True)
        lacking = sorted(about["missing_keys"]) + sorted(str(key) for key in about.get("mismatched_keys", []))
        if lacking:
            raise Fault(f"{args.sam3} lacks {len(lacking)} tensors of SAM 3, {lacking[0]} among them")
        name = f"SAM 3 from {args.sam3.name} ({fingerprint(files)})"
    else:
        config = Sam3Config(**tiny_sam3()) if args.tiny else Sam3Config()
        torch.manual_seed(args.seed)
        model = Sam3Model(config)
        name = f"{'a tiny ' if args.tiny else ''}SAM 3 with RANDOM weights, seed {args.seed}: it has learned nothing"
    with torch.inference_mode(False), torch.no_grad():
        texture = Texture(model.eval(), token_ids(args.sam3, args.prompt))
    n_millions = sum(p.numel() for p in texture.parameters()) / 1e6
    say(f"texture and semantic: {name}; {n_millions:.0f} million parameters, prompt {args.prompt!r}; {LICENCES['sam3']}")
    return texture, name, LICENCES["sam3"]


def tiny_sam3():
    """The same architecture of a few thousand parameters that looks at 112 × 112 pixels, for tests."""
    width = {"hidden_size": 32, "intermediate_size": 32, "num_attention_heads": 2}
    inner = {**width, "num_layers": 1}
    vit = {**width, "model_type": "sam3_vit_model", "num_hidden_layers": 2, "image_size": 112, "pretrain_image_size": 56,
           "window_size": 4, "global_attn_indexes": [1]}
    return {
        "vision_config": {"model_type": "sam3_vision_model", "backbone_config": vit, "fpn_hidden_size": 32,
                          "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]]},
        "text_config": {**width, "intermediate_size": 128, "model_type": "clip_text_model", "num_hidden_layers": 1, "vocab_size": 49408,
                        "projection_dim": 32, "max_position_embeddings": N_TOKENS, "hidden_act": "gelu"},
        "geometry_encoder_config": inner, "detr_encoder_config": inner, "detr_decoder_config": {**inner, "num_queries": 4},
        "mask_decoder_config": {"hidden_size": 32, "num_attention_heads": 2, "num_upsampling_stages": 3},
    }


def da3(args):
    try:
        from depth_anything_3.model.dinov2.dinov2 import DinoV2
        from depth_anything_3.model.dinov2.vision_transformer import DinoVisionTransformer
    except ImportError as missing:
        raise Fault(f"{missing}: depth-anything-3 of PyPI has the network. {INSTALL}") from missing
    # Settings of its configs/da3-large.yaml, and of da3mono-large.yaml and da3metric-large.yaml.
    plain = {"alt_start": -1, "qknorm_start": -1, "rope_start": -1, "cat_token": False}
    any_view = {"alt_start": 8, "qknorm_start": 8, "rope_start": 8, "cat_token": True}
    if args.da3:
        files = weights_of(args.da3, "da3")
        tensors = {name: tensor for file in files for name, tensor in load_file(file).items()}
        mark = "backbone.pretrained."
        own = {name.split(mark, 1)[1]: tensor.float() for name, tensor in tensors.items() if mark in name}
        if len(own) < sum(mark in name for name in tensors):
            raise Fault(f"{args.da3} holds several backbones (a nested model): weights of one ViT-L are expected")
        width = own["cls_token"].shape[-1] if "cls_token" in own else 0
        if width != 1024:
            found = f"one of width {width}" if own else "no backbone"
            raise Fault(f"{args.da3} holds {found}: the ViT-L of DA3-LARGE, DA3MONO-LARGE or DA3METRIC-LARGE is expected, of width 1024")
        kind = any_view if "camera_token" in own else plain
        backbone = DinoV2("vitl", out_layers=[23], **kind).pretrained
        try:
            backbone.load_state_dict(own)
        except RuntimeError as unfit:
            raise Fault(f"{args.da3} does not fit: {str(unfit).splitlines()[-1].strip()}") from unfit
        named = json.loads((args.da3 / "config.json").read_text()).get("model_name") or args.da3.name
        family = named.lower().replace("_", "-").removesuffix("-1.1")
        licence = LICENCES["da3-large"] if kind is any_view else LICENCES.get(family, "that of its model card")
        name = f"Depth Anything 3 from {args.da3.name} ({fingerprint(files)})"
    else:
        torch.manual_seed(args.seed)
        if args.tiny:
            backbone = DinoVisionTransformer(patch_size=PATCH, img_size=56, embed_dim=32, depth=2, num_heads=2, **plain)
        else:
            backbone = DinoV2("vitl", out_layers=[23], **plain).pretrained
        for parameter in (backbone.cls_token, backbone.pos_embed):
            torch.nn.init.normal_(parameter, std=0.02)
        licence = "that of the weights in their place"
        name = f"{'a tiny ' if args.tiny else ''}Depth Anything 3 with RANDOM weights, seed {args.seed}: it has learned nothing"
    geometry = Geometry(backbone.eval(), args.da3_side)
    n_millions = sum(p.numel() for p in geometry.parameters()) / 1e6
    say(f"geometry: {name}; {n_millions:.0f} million parameters; {licence}")
    return geometry, name, licence


# Tiles ------------------------------------------------------------------------------------------------------------------------


def along(photo_px, tile_px, cells, coarse, overlap):
    """Cells of one axis of a photo, and those that its tiles begin at: whole multiples of `coarse`, spread evenly."""
    if photo_px <= tile_px:
        return cells, [0]
    # At least one step more than a tile: the photo is larger than that.
    n = max(round(photo_px / tile_px * cells / coarse) * coarse, cells + coarse)
    step = max(cells - math.floor(overlap * cells), coarse)
    n_tiles = -(-(n - cells) // step) + 1
    return n, [i * (n - cells) // (n_tiles - 1) // coarse * coarse for i in range(n_tiles)]


class Plan:
    """Where the tiles of a photo lie, for one network."""

    def __init__(self, photo, network, coarsest, tile_px, overlap):
        """`coarsest`: cells of the network with the fewest per tile; tiles of all networks begin at its cells."""
        if network.cells % coarsest:
            raise Fault(f"tiles of {network.cells} and {coarsest} cells: the one has to be a multiple of the other")
        width, height = photo
        coarse = network.cells // coarsest
        self.columns, self.lefts = along(width, tile_px, network.cells, coarse, overlap)
        self.rows, self.tops = along(height, tile_px, network.cells, coarse, overlap)
        self.tile = (network.cells, network.cells)
        if isinstance(network, Geometry):
            # Depth Anything 3 keeps a photo's shape: the longer side is the tile's, both are whole patches.
            across, down = shaped(min(width, tile_px), min(height, tile_px), network.side)
            self.tile = (down, across)
            self.columns = across if len(self.lefts) == 1 else self.columns
            self.rows = down if len(self.tops) == 1 else self.rows

    def starts(self):
        return [(top, left) for top in self.tops for left in self.lefts]


def shaped(width, height, side):
    """Patches across and down of a picture whose longer side is `side` pixels, as Depth Anything 3's `upper_bound_resize` has them."""
    scale = side / max(width, height)
    return tuple(max(1, (max(1, round(length * scale)) + PATCH // 2) // PATCH) for length in (width, height))


def prepared(photo, plan, network):
    """The photo as the network takes it, at the size of the plan's cells: 1 × 3 × rows × columns."""
    rows, columns = plan.rows * PATCH, plan.columns * PATCH
    if isinstance(network, Geometry):
        import cv2

        if len(plan.lefts) == len(plan.tops) == 1:
            longest = max(photo.shape[:2])
            scale = network.side / longest
            photo = resized(cv2, photo, *(max(1, round(length * scale)) for length in photo.shape[:2]), cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
        grows = rows > photo.shape[0] or columns > photo.shape[1]
        image = torch.from_numpy(resized(cv2, photo, rows, columns, cv2.INTER_CUBIC if grows else cv2.INTER_AREA)).permute(2, 0, 1)
    else:
        image = pixels.resize(torch.from_numpy(photo).permute(2, 0, 1), [rows, columns], antialias=True)
    mean, std = (torch.tensor(v)[:, None, None] for v in (network.mean, network.std))
    return ((image.float() / 255 - mean) / std)[None]


def resized(cv2, photo, rows, columns, how):
    return photo if photo.shape[:2] == (rows, columns) else cv2.resize(photo, (columns, rows), interpolation=how)


def tent(n):
    """Weights of a tile's cells: they fall towards its border, where networks see least."""
    i = torch.arange(n)
    return ((torch.minimum(i, n - 1 - i) + 0.5) / (0.5 * n)).clamp(min=LEAST_WEIGHT)


def maps_of(photo, network, plan, device):
    """The network's maps of a photo, by name."""
    image = prepared(photo, plan, network)
    tile_rows, tile_columns = plan.tile
    sums, weights = {}, {}
    for top, left in plan.starts():
        part = image[..., top * PATCH : (top + tile_rows) * PATCH, left * PATCH : (left + tile_columns) * PATCH]
        found = [maps[0].float().cpu() for maps in network(part.to(device))]
        for name, tile in zip(network.names, found):
            k = network.per_cell[name]
            expected = (tile_rows * k, tile_columns * k)
            if tuple(tile.shape[1:]) != expected:
                raise Fault(f"{name} of a tile has {tuple(tile.shape[1:])} cells, expected {expected}: another version of the network?")
            if len(plan.starts()) == 1:
                sums[name] = tile
                continue
            if name not in sums:
                sums[name] = torch.zeros(tile.shape[0], plan.rows * k, plan.columns * k)
                weights[name] = torch.zeros(plan.rows * k, plan.columns * k)
            weight = tent(expected[0])[:, None] * tent(expected[1])[None]
            place = (slice(top * k, top * k + expected[0]), slice(left * k, left * k + expected[1]))
            sums[name][:, place[0], place[1]] += weight * tile
            weights[name][place] += weight
    for name, weight in weights.items():
        sums[name] /= weight
    return sums


# Files ------------------------------------------------------------------------------------------------------------------------


def photos_in(folder):
    """Photos by scene: of a set, or of any folder, which then is the scene."""
    if not folder.is_dir():
        raise Fault(f"{folder} is no folder")
    scenes = {path.parent.name: path for path in sorted(folder.glob("*/images")) if path.is_dir()}
    found = []
    for scene, images in (scenes or {folder.resolve().name: folder}).items():
        paths = sorted(path for path in images.iterdir() if path.suffix.lower() in PHOTOS)
        stems = [path.stem for path in paths]
        if twice := sorted({stem for stem in stems if stems.count(stem) > 1}):
            raise Fault(f"{images} has several photos called {twice[0]}: each becomes a file of that name")
        found += [(scene, path) for path in paths]
    if not found:
        raise Fault(f"no photos ({', '.join(sorted(PHOTOS))}) in {folder} or in its */images: expected what `sizeup-train dataset` "
                    "wrote, or a folder of photos")
    return found


def read(path):
    """Colours as they are stored: like sizeup, what a camera says of which way is up is not followed."""
    try:
        with Image.open(path) as image:
            if image.mode.startswith(("I", "F")):
                raise Fault(f"{path} has numbers of mode {image.mode}: photos of 8 bits are expected")
            return np.array(image.convert("RGB"))
    except OSError as damaged:
        raise Fault(f"{path} cannot be read: {damaged}") from damaged


def write(path, maps, about, half):
    tensors = {}
    for name, tensor in maps.items():
        if not torch.isfinite(tensor).all():
            raise Fault(f"{name} of {path.stem} has values that are no numbers: are these the right weights?")
        if half and tensor.abs().max() > torch.finfo(torch.float16).max:
            raise Fault(f"{name} of {path.stem} has values beyond half precision: leave `--half` out")
        tensors[name] = (tensor.half() if half else tensor).contiguous()
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        save_file(tensors, part, metadata=about)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return sum(tensor.nbytes for tensor in tensors.values())


def is_done(path, about):
    if not path.exists():
        return False
    try:
        with safe_open(path, "pt") as file:
            before = file.metadata() or {}
    except Exception as damaged:
        raise Fault(f"{path} cannot be read: {damaged}. Delete it, and it is made anew") from damaged
    if other := sorted(key for key in about if before.get(key) != about[key]):
        key = other[0]
        raise Fault(f"{path} was made with another {key} ({before.get(key)!r}, now {about[key]!r}): choose another folder")
    return True


# Graphs -----------------------------------------------------------------------------------------------------------------------


def write_graph(network, size, path, about, device):
    """The network as ONNX for one tile, weights beside it, as `[footprints.backbones]` wants it."""
    try:
        import onnx
        import onnxscript  # noqa: F401, the exporter needs it
    except ImportError as missing:
        raise Fault(f"{missing}. {INSTALL}") from missing
    rows, columns = size
    example = torch.zeros(1, 3, rows * PATCH, columns * PATCH, device=device)
    part = path.with_name(f"{path.stem}.part.onnx")
    with torch.no_grad():
        torch.onnx.export(network.eval(), (example,), str(part), input_names=["image"], output_names=list(network.names), dynamo=True,
                          external_data=True, opset_version=18, verbose=False)
    # Weights go into one file under the graph's final name; the graph itself is small.
    graph = onnx.load(part)
    onnx.helper.set_model_props(graph, about)
    data = path.with_name(f"{path.name}.data")
    data.unlink(missing_ok=True)
    onnx.save(graph, path, save_as_external_data=True, location=data.name, size_threshold=1024)
    for left in path.parent.glob(f"{part.name}*"):
        left.unlink()
    data.chmod(path.stat().st_mode)
    say(f"{path}: image 1 × 3 × {rows * PATCH} × {columns * PATCH}; {(path.stat().st_size + data.stat().st_size) / 1e6:.0f} MB")


# Command line -----------------------------------------------------------------------------------------------------------------


def arguments():
    words = __doc__.split("\n\n")
    parser = argparse.ArgumentParser(description=words[0], epilog="\n\n".join(words[1:]), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path, metavar="SET", help="folder of a set, or of photos")
    parser.add_argument("output", type=Path, metavar="FEATURES", help="folder of the features")
    parser.add_argument("--sam3", type=Path, metavar="FOLDER", help="weights of SAM 3 (facebook/sam3)")
    parser.add_argument("--da3", type=Path, metavar="FOLDER", help="weights of DA3-LARGE, DA3MONO-LARGE or DA3METRIC-LARGE")
    parser.add_argument("--random", action="store_true", help="random weights for what has no folder: to try the way, not to use")
    parser.add_argument("--tiny", action="store_true", help="with --random: networks of a few thousand parameters, for tests")
    parser.add_argument("--seed", type=int, default=1, help="of random weights (1)")
    parser.add_argument("--prompt", default="building", help='what SAM 3 is asked for ("building")')
    parser.add_argument("--without", action="append", default=[], choices=["texture", "geometry"], help="leave one backbone out")
    parser.add_argument("--tile", type=int, help="pixels of a photo that SAM 3 sees at once, as `footprints.tile_px` (1008)")
    parser.add_argument("--overlap", type=float, default=0.2, help="share of a tile that overlaps the next one, 0 to 0.5 (0.2)")
    parser.add_argument("--da3-side", type=int, help="longer side of what Depth Anything 3 sees, pixels: 1008, 504, 336 or 252 (1008)")
    parser.add_argument("--half", action="store_true", help="half precision: files of half the size")
    parser.add_argument("--scene", action="append", default=[], help="this scene alone; may be repeated")
    parser.add_argument("--limit", type=int, help="so many photos of each scene at most")
    parser.add_argument("--graphs", type=Path, metavar="FOLDER", help="write both networks as ONNX, for photos like the first one")
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu", help='"cuda" where there is one, else "cpu"')
    args = parser.parse_args()
    side = 112 if args.tiny else 1008
    args.tile, args.da3_side = args.tile or side, args.da3_side or side
    if args.tiny and not args.random:
        raise Fault("--tiny goes with --random")
    for what, backbone in (("sam3", "texture"), ("da3", "geometry")):
        if not getattr(args, what) and not args.random and backbone not in args.without:
            raise Fault(f"--{what} is missing: a folder with the weights (docs/footprint-network.md says which), or --random for the real "
                        f"architecture with random weights, or --without {backbone}")
    if len(set(args.without)) == 2:
        raise Fault("without both there is nothing to do")
    if args.da3_side % PATCH or (side // PATCH) % (args.da3_side // PATCH or 1):
        raise Fault(f"--da3-side {args.da3_side}: expected 1008, 504, 336 or 252, so that its cells are whole ones of SAM 3's")
    if not 0 <= args.overlap <= 0.5 or args.tile < 16:
        raise Fault(f"--overlap {args.overlap}, --tile {args.tile}: shares from 0 to 0.5, tiles from 16 pixels on")
    return args


def run(args):
    photos = photos_in(args.photos)
    if args.scene:
        if unknown := sorted(set(args.scene) - {scene for scene, _ in photos}):
            raise Fault(f"{args.photos} has no scene {unknown[0]!r}")
        photos = [photo for photo in photos if photo[0] in args.scene]
    if args.limit is not None:
        first = {scene: [p for p in photos if p[0] == scene][: args.limit] for scene, _ in photos}
        photos = [photo for some in first.values() for photo in some]
    started = time.monotonic()
    loaded = [load(args) for name, load in (("texture", sam3), ("geometry", da3)) if name not in args.without]
    networks = [network.to(args.device) for network, _, _ in loaded]
    about = {"made_by": "tools/export_footprint_features.py", "half": str(args.half).lower(), "tile_px": str(args.tile), "overlap": str(args.overlap)}
    for network, name, licence in loaded:
        kind = "geometry" if isinstance(network, Geometry) else "texture"
        about |= {f"{kind}.network": name, f"{kind}.licence": licence}
        about |= {"geometry.side_px": str(network.side)} if kind == "geometry" else {"texture.prompt": args.prompt}
    is_random = any("RANDOM" in name for _, name, _ in loaded)
    if is_random:
        say("WARNING: random weights. Shapes are right; what these features say means nothing.")
    say(f"{len(photos)} photos, on {args.device}; networks in {time.monotonic() - started:.0f} s")
    coarsest = min(network.cells for network in networks)
    if args.graphs:
        size = Image.open(photos[0][1]).size
        args.graphs.mkdir(parents=True, exist_ok=True)
        for network in networks:
            plan = Plan(size, network, coarsest, args.tile, args.overlap)
            name = "geometry" if isinstance(network, Geometry) else "texture"
            write_graph(network, plan.tile, args.graphs / f"{name}.onnx", about, args.device)
    n_new = 0
    for scene, photo in photos:
        path = args.output / scene / f"{photo.stem}.safetensors"
        with Image.open(photo) as image:
            size = image.size
        plans = [Plan(size, network, coarsest, args.tile, args.overlap) for network in networks]
        of_photo = about | {"photo": f"{size[0]}x{size[1]}", "tiles": f"{len(plans[0].tops)}x{len(plans[0].lefts)}"}
        for network, plan in zip(networks, plans):
            of_photo |= {f"tile.{name}": "x".join(str(n * k) for n in plan.tile) for name, k in network.per_cell.items()}
        if is_done(path, of_photo):
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        at = time.monotonic()
        colours, maps = read(photo), {}
        with torch.inference_mode():
            for network, plan in zip(networks, plans):
                maps |= maps_of(colours, network, plan, args.device)
        n_bytes = write(path, maps, of_photo, args.half)
        shapes = ", ".join(f"{name} {' × '.join(map(str, tensor.shape))}" for name, tensor in maps.items())
        say(f"{scene}/{photo.name}: {of_photo['tiles']} tiles, {time.monotonic() - at:.1f} s, {n_bytes / 1e6:.0f} MB; {shapes}")
        n_new += 1
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20 if sys.platform != "darwin" else 1 << 30)
    say(f"{n_new} new, {len(photos) - n_new} were there; {time.monotonic() - started:.0f} s, {most:.1f} GiB of memory at most"
        + ("; RANDOM weights" if is_random else ""))


def main():
    try:
        run(arguments())
    except Fault as fault:
        sys.exit(f"error: {fault}")


if __name__ == "__main__":
    main()
