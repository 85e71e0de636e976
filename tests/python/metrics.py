#!/usr/bin/env python3
"""The measures of an evaluation, computed a second time with trimesh, shapely and scipy.

usage: metrics.py result.obj reference.obj result.geojson reference.geojson points.txt
prints one JSON object
"""

import json
import sys

import numpy as np
import shapely
import trimesh
from scipy.spatial import ConvexHull

VOXEL_M = 0.5
N_SAMPLES = 20_000


def meshes(path):
    """One closed mesh per object."""
    objects, current, vertices = [], [], []
    for line in open(path):
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(w) for w in words[1:4]])
        elif words[:1] == ["o"]:
            current = []
            objects.append(current)
        elif words[:1] == ["f"]:
            current.append([int(w) - 1 for w in words[1:4]])
    return [trimesh.Trimesh(vertices, faces, process=True, validate=True) for faces in objects]


def seen(parts):
    """Walls and roofs as one mesh."""
    whole = trimesh.util.concatenate(parts)
    keep = whole.face_normals[:, 2] >= -0.5
    return trimesh.Trimesh(whole.vertices, whole.faces[keep], process=False)


def samples(mesh, rng):
    face = rng.choice(len(mesh.faces), N_SAMPLES, p=mesh.area_faces / mesh.area_faces.sum())
    u, v = rng.random((2, N_SAMPLES))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = (mesh.triangles[face][:, i] for i in range(3))
    return a + (b - a) * u[:, None] + (c - a) * v[:, None]


def distances(points, mesh):
    return trimesh.proximity.closest_point(mesh, points)[1]


def voxel_iou(a, b):
    low = np.floor(np.minimum(*(np.min([m.bounds[0] for m in s], axis=0) for s in (a, b))) / VOXEL_M)
    high = np.ceil(np.maximum(*(np.max([m.bounds[1] for m in s], axis=0) for s in (a, b))) / VOXEL_M)
    axes = [np.arange(l, h) * VOXEL_M + VOXEL_M / 2 for l, h in zip(low, high)]
    # The same tiny shift as the program's columns have, so that no centre lies on a wall.
    axes[0] = axes[0] + 0.0037 * VOXEL_M
    axes[1] = axes[1] + 0.0061 * VOXEL_M
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside_a, inside_b = (np.any([m.contains(centres) for m in s], axis=0) for s in (a, b))
    return (inside_a & inside_b).sum() / (inside_a | inside_b).sum()


def prisms(path):
    def prism(feature):
        p = feature["properties"]
        return shapely.geometry.shape(feature["geometry"]), p["ground_z_m"], p["ground_z_m"] + p["height_m"]

    return [prism(feature) for feature in json.load(open(path))["features"]]


def prism_iou(a, b):
    common = sum(
        s.intersection(t).area * max(0.0, min(s_top, t_top) - max(s_low, t_low))
        for s, s_low, s_top in a
        for t, t_low, t_top in b
    )
    total = sum(footprint.area * (top - low) for footprint, low, top in a + b)
    return common / (total - common)


def main():
    result_obj, reference_obj, result_layer, reference_layer, points = sys.argv[1:]
    rng = np.random.default_rng(1)
    result, reference = meshes(result_obj), meshes(reference_obj)
    assert all(m.is_watertight for m in result + reference), "the test's meshes are closed"
    result_seen, reference_seen = seen(result), seen(reference)
    errors = distances(samples(result_seen, rng), reference_seen)
    covered = distances(samples(reference_seen, rng), result_seen)
    print(
        json.dumps(
            {
                "error_90_m": float(np.percentile(errors, 90)),
                "error_95_m": float(np.percentile(errors, 95)),
                "error_mean_m": float(errors.mean()),
                "completeness_05": float((covered <= 0.5).mean()),
                "completeness_1": float((covered <= 1.0).mean()),
                "volume_m3": [float(sum(m.volume for m in s)) for s in (result, reference)],
                "voxel_iou": float(voxel_iou(result, reference)),
                "prism_iou": prism_iou(prisms(result_layer), prisms(reference_layer)),
                "hull_volume_m3": float(ConvexHull(np.loadtxt(points)).volume),
            }
        )
    )


if __name__ == "__main__":
    main()
