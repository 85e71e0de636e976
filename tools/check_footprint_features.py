#!/usr/bin/env python3
"""Holds tools/export_footprint_features.py against the code that SAM 3 and Depth Anything 3 come with.

    target/features/bin/python tools/check_footprint_features.py           # small networks of the same architecture, half a minute
    target/features/bin/python tools/check_footprint_features.py --full    # at full size: minutes, 9 GB of memory

SAM 3's own code is `sam3` on PyPI (0.1.4; facebookresearch/sam3, SAM License). Its layers are built as its model_builder.py builds
them, given random numbers, and the same numbers are laid into transformers' Sam3Model under its names; both look at the same photo,
each brought to size by its own preprocessing. Depth Anything 3's backbone is its own code either way: what is compared is how photos are
brought to size, and its tokens with those that its `aux` hands out. Ends with code 1 where anything differs.
"""
import argparse
import re
import sys
import types
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import export_footprint_features as ours  # noqa: E402
import torch  # noqa: E402
from PIL import Image  # noqa: E402

# Where what is called … here is called … in transformers.
NAMES = [
    (r"^vision\.trunk\.patch_embed\.proj", "vision_encoder.backbone.embeddings.patch_embeddings.projection"),
    (r"^vision\.trunk\.ln_pre", "vision_encoder.backbone.layer_norm"),
    (r"^vision\.trunk\.blocks\.(\d+)\.norm(\d)", r"vision_encoder.backbone.layers.\1.layer_norm\2"),
    (r"^vision\.trunk\.blocks\.(\d+)\.attn\.proj", r"vision_encoder.backbone.layers.\1.attention.o_proj"),
    (r"^vision\.trunk\.blocks\.(\d+)\.attn", r"vision_encoder.backbone.layers.\1.attention"),
    (r"^vision\.trunk\.blocks\.(\d+)", r"vision_encoder.backbone.layers.\1"),
    (r"^vision\.convs\.(\d+)\.dconv_2x2_0", r"vision_encoder.neck.fpn_layers.\1.scale_layers.0"),
    (r"^vision\.convs\.(\d+)\.dconv_2x2_1", r"vision_encoder.neck.fpn_layers.\1.scale_layers.2"),
    (r"^vision\.convs\.(\d+)\.dconv_2x2", r"vision_encoder.neck.fpn_layers.\1.scale_layers.0"),
    (r"^vision\.convs\.(\d+)\.conv_1x1", r"vision_encoder.neck.fpn_layers.\1.proj1"),
    (r"^vision\.convs\.(\d+)\.conv_3x3", r"vision_encoder.neck.fpn_layers.\1.proj2"),
    (r"^text\.encoder\.transformer\.resblocks\.(\d+)\.attn\.out_proj", r"text_encoder.text_model.encoder.layers.\1.self_attn.out_proj"),
    (r"^text\.encoder\.transformer\.resblocks\.(\d+)\.attn", r"text_encoder.text_model.encoder.layers.\1.self_attn"),
    (r"^text\.encoder\.transformer\.resblocks\.(\d+)\.ln_(\d)", r"text_encoder.text_model.encoder.layers.\1.layer_norm\2"),
    (r"^text\.encoder\.transformer\.resblocks\.(\d+)\.mlp\.c_fc", r"text_encoder.text_model.encoder.layers.\1.mlp.fc1"),
    (r"^text\.encoder\.transformer\.resblocks\.(\d+)\.mlp\.c_proj", r"text_encoder.text_model.encoder.layers.\1.mlp.fc2"),
    (r"^text\.encoder\.token_embedding", "text_encoder.text_model.embeddings.token_embedding"),
    (r"^text\.encoder\.positional_embedding", "text_encoder.text_model.embeddings.position_embedding.weight"),
    (r"^text\.encoder\.ln_final", "text_encoder.text_model.final_layer_norm"),
    (r"^text\.resizer", "text_projection"),
    (r"^places\.cls_embed", "geometry_encoder.cls_embed"),
    (r"^places\.final_proj", "geometry_encoder.final_proj"),
    (r"^places\.norm", "geometry_encoder.prompt_layer_norm"),
    (r"^places\.encode_norm", "geometry_encoder.output_layer_norm"),
    (r"^places\.encode\.(\d+)", r"geometry_encoder.layers.\1"),
    (r"^fusion\.layers\.(\d+)", r"detr_encoder.layers.\1"),
    (r"^masks\.pixel_decoder", "mask_decoder.pixel_decoder"),
    (r"^masks\.cross_attend_prompt", "mask_decoder.prompt_cross_attn"),
    (r"^masks\.cross_attn_norm", "mask_decoder.prompt_cross_attn_norm"),
]
LAYER = [(r"\.cross_attn_image", ".cross_attn"), (r"\.linear(\d)", r".mlp.fc\1"), (r"\.norm(\d)", r".layer_norm\1"),
         (r"\.out_proj", ".o_proj")]


class Sam3(torch.nn.Module):
    """SAM 3 by its own code, as its Sam3Image puts its parts together for a prompt of words alone."""

    def __init__(self, config):
        super().__init__()
        # The package's own front door builds trackers and fetches weights; its layers are what is wanted.
        import importlib.util

        package = types.ModuleType("sam3")
        package.__path__ = list(importlib.util.find_spec("sam3").submodule_search_locations)
        sys.modules["sam3"] = package
        from sam3.model.encoder import TransformerEncoderFusion, TransformerEncoderLayer
        from sam3.model.geometry_encoders import SequenceGeometryEncoder
        from sam3.model.maskformer_segmentation import PixelDecoder, UniversalSegmentationHead
        from sam3.model.model_misc import MultiheadAttentionWrapper as Attention
        from sam3.model.necks import Sam3DualViTDetNeck
        from sam3.model.position_encoding import PositionEmbeddingSine
        from sam3.model.text_encoder_ve import VETextEncoder
        from sam3.model.vitdet import ViT

        vit, text = config.vision_config.backbone_config, config.text_config
        width, wide = config.detr_encoder_config.hidden_size, config.detr_encoder_config.intermediate_size
        n_heads = config.detr_encoder_config.num_attention_heads

        def sine():
            return PositionEmbeddingSine(num_pos_feats=width, normalize=True, scale=None, temperature=10000)

        def attention(**more):
            return Attention(num_heads=n_heads, embed_dim=width, dropout=0.0, **more)

        def layer(at_attention, at_keys, batch_first):
            return TransformerEncoderLayer(
                activation="relu", d_model=width, dim_feedforward=wide, dropout=0.0, pre_norm=True, pos_enc_at_attn=at_attention,
                pos_enc_at_cross_attn_keys=at_keys, pos_enc_at_cross_attn_queries=False, self_attention=attention(batch_first=batch_first),
                cross_attention=attention(batch_first=batch_first))

        trunk = ViT(
            img_size=vit.image_size, pretrain_img_size=vit.pretrain_image_size, patch_size=14, embed_dim=vit.hidden_size,
            depth=vit.num_hidden_layers, num_heads=vit.num_attention_heads, mlp_ratio=vit.intermediate_size / vit.hidden_size,
            norm_layer="LayerNorm", qkv_bias=True, use_abs_pos=True, tile_abs_pos=True, global_att_blocks=tuple(vit.global_attn_indexes),
            rel_pos_blocks=(), use_rope=True, use_interp_rope=True, window_size=vit.window_size, pretrain_use_cls_token=True,
            retain_cls_token=False, ln_pre=True, ln_post=False, return_interm_layers=False, bias_patch_embed=False)
        self.vision = Sam3DualViTDetNeck(position_encoding=sine(), d_model=width, scale_factors=[4.0, 2.0, 1.0, 0.5], trunk=trunk)
        self.text = VETextEncoder(d_model=width, tokenizer=None, width=text.hidden_size, heads=text.num_attention_heads,
                                  layers=text.num_hidden_layers)
        self.places = SequenceGeometryEncoder(
            pos_enc=sine(), encode_boxes_as_points=False, points_direct_project=True, points_pool=True, points_pos_enc=True,
            boxes_direct_project=True, boxes_pool=True, boxes_pos_enc=True, d_model=width, num_layers=config.geometry_encoder_config.num_layers,
            layer=layer(False, True, False), add_cls=True, add_post_encode_proj=True)
        self.fusion = TransformerEncoderFusion(
            layer=layer(True, False, True), num_layers=config.detr_encoder_config.num_layers, d_model=width, num_feature_levels=1,
            frozen=False, use_act_checkpoint=True, add_pooled_text_to_img_feat=False, pool_text_with_mask=True)
        self.masks = UniversalSegmentationHead(
            hidden_dim=width, upsampling_stages=3, aux_masks=False, presence_head=False, dot_product_scorer=None, act_ckpt=False,
            cross_attend_prompt=attention(), pixel_decoder=PixelDecoder(num_upsampling_stages=3, interpolation_mode="nearest", hidden_dim=width))

    def forward(self, image):
        from sam3.model.geometry_encoders import Prompt

        if not torch.cuda.is_available():
            torch.Tensor.pin_memory = lambda tensor: tensor
        levels, positions, _, _ = self.vision(image)
        levels, position = levels[:3], positions[2]
        ids = torch.zeros(1, 32, dtype=torch.long)
        ids[0, :3] = torch.tensor([ours.START, ours.BUILDING, ours.END])
        self.text.tokenizer = lambda texts, context_length: ids
        is_padding, words, _ = self.text(["building"], device=image.device)
        flat, flat_position = (x.flatten(2).permute(2, 0, 1) for x in (levels[2], position))
        sizes = [levels[2].shape[-2:]]
        nothing = Prompt(box_embeddings=torch.zeros(0, 1, 4), box_mask=torch.zeros(1, 0, dtype=torch.bool))
        places, places_mask = self.places(geo_prompt=nothing, img_feats=[flat], img_sizes=sizes, img_pos_embeds=[flat_position])
        prompt, mask = torch.cat([words, places]), torch.cat([is_padding, places_mask], dim=1)
        fused = self.fusion(src=[flat], src_pos=[flat_position], prompt=prompt, prompt_pos=torch.zeros_like(prompt),
                            prompt_key_padding_mask=mask, feat_sizes=sizes)["memory"]
        embedded = []
        self.masks.pixel_decoder.register_forward_hook(lambda _module, _given, found: embedded.append(found))
        self.masks(backbone_feats=levels, obj_queries=torch.zeros(1, 1, 1, levels[2].shape[1]), image_ids=torch.tensor([0]),
                   encoder_hidden_states=fused, prompt=prompt, prompt_mask=mask)
        return (*levels, embedded[0].reshape(levels[0].shape))


def in_transformers(tensors):
    """Numbers of SAM 3's own layers under transformers' names."""
    renamed = {}
    for name, tensor in tensors.items():
        if name == "vision.trunk.pos_embed":
            # The first position is that of a token that is not there any more.
            renamed["vision_encoder.backbone.embeddings.position_embeddings"] = tensor[:, 1:]
            continue
        if name.endswith("freqs_cis"):
            # Angles, computed there too.
            continue
        new = next((re.sub(old, new, name) for old, new in NAMES if re.match(old, name)), None)
        if new is None:
            continue
        if new.startswith(("geometry_encoder.layers", "detr_encoder.layers", "mask_decoder.prompt_cross_attn.")):
            for old, other in LAYER:
                new = re.sub(old, other, new)
        if threefold := re.search(r"\.(in_proj_|qkv\.)(weight|bias)$", new):
            for part, of in zip(tensor.chunk(3), "qkv"):
                renamed[new[: threefold.start()] + f".{of}_proj.{threefold[2]}"] = part
        else:
            renamed[new] = tensor
    return renamed


def apart(found, expected):
    """Largest difference, as a share of the spread of what is expected."""
    return ((found - expected).abs().max() / expected.std()).item() if found.shape == expected.shape else float("inf")


def check_sam3(photo, full, say):
    from torchvision.transforms import v2
    from transformers import Sam3Config, Sam3Model

    config = Sam3Config() if full else Sam3Config(**ours.tiny_sam3())
    torch.manual_seed(3)
    theirs = Sam3(config).eval()
    for parameter in theirs.parameters():
        # Zeros and ones would hide mistakes.
        parameter.data += 0.02 * torch.randn_like(parameter)
    model = Sam3Model(config).eval()
    given = in_transformers(theirs.state_dict())
    own = model.state_dict()
    if strange := sorted(set(given) - set(own)):
        raise SystemExit(f"transformers has no {strange[:3]}")
    used = ("vision_encoder", "text_", "detr_encoder", "mask_decoder.pixel", "mask_decoder.prompt", "geometry_encoder.layers")
    if missing := sorted(name for name in own if name.startswith(used) and name not in given and "text_encoder.text_projection" not in name):
        raise SystemExit(f"nothing is laid into {missing[:3]}")
    model.load_state_dict(given, strict=False)
    del given, own
    side = config.image_size
    # The lines of sam3_image_processor.py's Sam3Processor.
    bring = v2.Compose([v2.ToDtype(torch.uint8, scale=True), v2.Resize(size=(side, side)), v2.ToDtype(torch.float32, scale=True),
                        v2.Normalize(mean=[0.5] * 3, std=[0.5] * 3)])
    with torch.inference_mode():
        expected = theirs(bring(v2.functional.to_image(Image.fromarray(photo)))[None])
    del theirs
    with torch.no_grad():
        texture = ours.Texture(model, ours.token_ids(None, "building"))
    plan = ours.Plan((photo.shape[1], photo.shape[0]), texture, texture.cells, side, 0.2)
    with torch.inference_mode():
        found = ours.maps_of(photo, texture, plan, "cpu")
    for name, map in zip(texture.names, expected):
        say(f"{name}, {' × '.join(str(n) for n in found[name].shape)}: of SAM 3's own code", apart(found[name], map[0]), 1e-4)


def check_da3(photo, full, say):
    from depth_anything_3.utils.io.input_processor import InputProcessor

    args = types.SimpleNamespace(da3=None, tiny=not full, seed=3, da3_side=1008 if full else 112)
    geometry, _, _ = ours.da3(args)
    plan = ours.Plan((photo.shape[1], photo.shape[0]), geometry, geometry.cells, geometry.side, 0.2)
    image, _, _ = InputProcessor()([photo], process_res=geometry.side, sequential=True)
    say("photo for geo: of InputProcessor of depth-anything-3", apart(ours.prepared(photo, plan, geometry)[0], image[0]), 1e-6)
    with torch.inference_mode():
        found = ours.maps_of(photo, geometry, plan, "cpu")["geo"]
        last = len(geometry.backbone.blocks) - 1
        _, aux = geometry.backbone.get_intermediate_layers(image[None], [last], export_feat_layers=[last])
    rows, columns = image.shape[-2] // 14, image.shape[-1] // 14
    expected = aux[0].reshape(rows, columns, -1).permute(2, 0, 1)
    say(f"geo, {' × '.join(str(n) for n in found.shape)}: of `aux` of depth-anything-3", apart(found, expected), 1e-5)


class Mean(torch.nn.Module):
    """A network that says of each patch how bright it is: of tiles it has to say what it says of the whole photo."""

    names, mean, std, per_cell = ("mean",), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), {"mean": 1}

    def __init__(self, side):
        super().__init__()
        self.side, self.cells = side, side // 14

    def forward(self, image):
        return (torch.nn.functional.avg_pool2d(image, 14),)


def check_tiles(say):
    rng = np.random.default_rng(4)
    for width, height in ((640, 333), (250, 900), (1009, 1008), (100, 100)):
        # Blurred noise: what lies elsewhere is of another brightness.
        small = rng.integers(0, 255, (height // 25, width // 25, 3), dtype=np.uint8)
        photo = np.array(Image.fromarray(small).resize((width, height), Image.Resampling.BICUBIC))
        network = Mean(112)
        plan = ours.Plan((width, height), network, 4, 200, 0.2)
        found = ours.maps_of(photo, network, plan, "cpu")["mean"]
        # Shares of the photo's width and height, whatever the number of pixels.
        whole = torch.from_numpy(photo).permute(2, 0, 1)[None].float() / 255
        expected = torch.nn.functional.adaptive_avg_pool2d(
            torch.nn.functional.interpolate(whole, size=(plan.rows * 42, plan.columns * 42), mode="bilinear"), (plan.rows, plan.columns))
        say(f"{width} × {height} pixels in {len(plan.tops)} × {len(plan.lefts)} tiles, {plan.rows} × {plan.columns} cells: where they lie",
            apart(found, expected[0]), 0.02)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="networks of full size")
    args = parser.parse_args()
    worst = []

    def say(what, difference, most):
        worst.append(difference <= most)
        print(f"{'same' if worst[-1] else 'DIFFERENT'}: {what}, apart by {difference:.1e} of its spread at most", flush=True)

    size = (750, 1000) if args.full else (84, 110)
    rows, columns = np.mgrid[: size[0], : size[1]]
    noise = np.random.default_rng(3).integers(0, 90, (*size, 3))
    photo = (noise + 80 * (rows // 30 % 2)[..., None] + (80 * columns / size[1])[..., None]).astype(np.uint8)
    check_tiles(say)
    check_da3(photo, args.full, say)
    check_sam3(photo, args.full, say)
    sys.exit(0 if all(worst) else 1)


if __name__ == "__main__":
    main()
