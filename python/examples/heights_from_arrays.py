# %% [markdown]
# # Heights from arrays
# Footprints, poses and depth maps as NumPy arrays in; one height per building out. No file, no GIS. Each `# %%` is a cell in editors
# that know notebooks; as a script it runs from top to bottom: `python heights_from_arrays.py`.

# %%
import numpy as np
from numpy.typing import NDArray

import sizeup

Floats = NDArray[np.float64]
GROUND_M = 48.0

# %% [markdown]
# Two footprints in metres of a projected CRS, east and north. Shapely's polygons and GeoJSON will do as well.

# %%
house = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 10.0], [0.0, 10.0]])
tower = np.array([[25.0, 5.0], [45.0, 5.0], [45.0, 22.0], [25.0, 22.0]])

# %% [markdown]
# Depth maps come from a network or a matcher. Here NumPy stands in for one: it follows the ray of every pixel to the ground or to
# the nearest of two blocks whose heights we know. It shares no code with sizeup.

# %%
TRUE_HEIGHTS_M = {"house": 9.0, "tower": 21.5}
BLOCKS = [(house, TRUE_HEIGHTS_M["house"]), (tower, TRUE_HEIGHTS_M["tower"])]


def depth_of(camera: sizeup.Camera, eye: Floats, rotation: Floats) -> Floats:
    """Depth along the optical axis for every pixel, metres."""
    x, y = np.meshgrid(np.arange(camera.width_px) + 0.5, np.arange(camera.height_px) + 0.5)
    right, down = (x - camera.width_px / 2) / camera.fx_px, (y - camera.height_px / 2) / camera.fx_px
    in_camera = np.stack([right, down, np.ones_like(x)], axis=-1)
    rays = in_camera @ rotation  # rotation takes map to camera, so rows times it go back
    depth: Floats = np.where(rays[..., 2] < 0, (GROUND_M - eye[2]) / rays[..., 2], np.nan)  # no ground in the sky
    for footprint, height_m in BLOCKS:
        low = np.array([*footprint.min(axis=0), GROUND_M])
        high = np.array([*footprint.max(axis=0), GROUND_M + height_m])
        near, far = np.sort([(low - eye) / rays, (high - eye) / rays], axis=0)
        enter, leave = near.max(axis=-1), far.min(axis=-1)
        is_hit = (enter < leave) & (enter > 0)
        depth = np.where(is_hit & ~(depth < enter), enter, depth)
    return depth


# %% [markdown]
# Eight oblique photos around the place. What the "network" says is right up to scale and shift, and noisy: sizeup needs no metres.

# %%
camera = sizeup.Camera(width_px=400, height_px=300, fx_px=380.0)
place = np.array([22.0, 11.0, GROUND_M])
noise = np.random.default_rng(seed=7)
views = []
for i, angle in enumerate(np.arange(8) * np.pi / 4):
    eye = place + [90.0 * np.cos(angle), 90.0 * np.sin(angle), 110.0]
    pose = sizeup.Pose.looking_at(eye, place)
    metres = depth_of(camera, eye, np.array(pose.rotation))
    told = 0.02 * metres * noise.normal(1.0, 0.005, metres.shape) + 0.7
    views.append(sizeup.View(f"photo {i}", camera, pose, depth=told, kind="depth"))

# %% [markdown]
# The heights, each with a standard deviation and, where it is doubtful, reasons.

# %%
heights = sizeup.estimate_heights([house, tower], views, ground_m=GROUND_M)
for (name, truth_m), found in zip(TRUE_HEIGHTS_M.items(), heights):
    assert found.height_m is not None and found.sigma_m is not None
    print(f"{name}: {found.height_m:.2f} ± {found.sigma_m:.2f} m from {len(found.views)} photos (truth {truth_m} m)")
    assert abs(found.height_m - truth_m) < 0.5, "within half a metre"
