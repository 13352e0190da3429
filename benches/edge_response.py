#!/usr/bin/env python3
"""Lateral resolution of clouds of a step: how far from the edge the height goes from 10 to 90 %.

    edge_response.py SCENE CLOUD TRUTH [CLOUD TRUTH ...]

SCENE holds a box named "step" on a plate (configs/step.scene.toml); each TRUTH, from `fringetool simulate`, states where the part stood. Heights of all
clouds are averaged over bins of the distance from each of the four edges. Beside it stands what footprint, matching and smoothing let expect
of a pixel on the plate. Only pair 1 of the demo's rig faces the plate. Needs numpy.
"""
import argparse
import math
import tomllib

import numpy as np
from common import cloud, places

# Distances from the edge: of the bins, of the flats that give the two heights, mm.
BIN, REACH, FLAT = 0.04, 2.4, 1.4


def rotation(degrees):
    """Rz Ry Rx."""
    (sx, cx), (sy, cy), (sz, cz) = ((math.sin(a), math.cos(a)) for a in map(math.radians, degrees))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def edges(points, body, truth):
    """Distance outwards, place along and height of the points near each edge, mm."""
    pose = truth["world_from_part"]
    in_part = (points - pose["translation_mm"]) @ np.array(pose["rotation"])
    x, y, z = ((in_part - body["position_mm"]) @ rotation(body["rotation_deg"])).T
    width, depth, height = body["geometry"]["size_mm"]
    sides = {"x+": (x - width / 2, y, depth), "x-": (-x - width / 2, y, depth)}
    sides |= {"y+": (y - depth / 2, x, width), "y-": (-y - depth / 2, x, width)}
    for name, (outwards, along, length) in sides.items():
        near = (abs(outwards) < REACH) & (abs(along) < length / 2 - 4)
        yield name, outwards[near], z[near] + height / 2


def crossing(distance, share, level):
    """Where the share falls through a level, nearest to the edge."""
    at = [i for i in range(len(share) - 1) if (share[i] - level) * (share[i + 1] - level) <= 0 and share[i] > share[i + 1]]
    found = [distance[i] + (share[i] - level) / (share[i] - share[i + 1]) * (distance[i + 1] - distance[i]) for i in at]
    return min(found, key=abs)


def response(outwards, height):
    """Height of the step and its width from 10 to 90 %, mm; largest overshoot."""
    low, high = height[outwards > FLAT].mean(), height[outwards < -FLAT].mean()
    bins = np.arange(-REACH, REACH, BIN)
    number = np.digitize(outwards, bins) - 1
    filled = [i for i in range(len(bins)) if (number == i).sum() > 4]
    distance = np.array([outwards[number == i].mean() for i in filled])
    share = np.array([(height[number == i].mean() - low) / (high - low) for i in filled])
    width = crossing(distance, share, 0.1) - crossing(distance, share, 0.9)
    return high - low, width, max(share.max() - 1, -share.min()), np.std(height[outwards > FLAT])


def expected(footprint_px, window_px):
    """Width from 10 to 90 % of a straight edge, px: the mean of a view and of one read from quadratics over four pixels, smoothed."""
    spread = math.sqrt(2) * footprint_px
    seen = np.vectorize(lambda x: 0.5 * (1 + math.erf(x / spread)))
    four = np.array([-1.5, -0.5, 0.5, 1.5])
    places = np.linspace(-0.475, 0.475, 20)
    fit = np.linalg.pinv(np.vander(four, 3))

    def both(x):
        read = [sum(w * seen(x + s - t) for w, s in zip(np.vander([t], 3)[0] @ fit, four)) for t in places]
        return 0.5 * (seen(x) + np.mean(read, axis=0))

    half = window_px // 2
    across = np.arange(-half, half + 1)
    weights = np.linalg.pinv(np.vander(across, 3))[2] if half else [1.0]
    x = np.arange(0, 4, 0.001)
    smoothed = sum(w * both(x - k) for w, k in zip(weights, across))
    return 2 * x[np.argmax(smoothed >= 0.9)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("clouds", nargs="+", metavar="CLOUD TRUTH")
    parser.add_argument("--pixel-mm", type=float, default=500 / 2330, help="pixel on the plate, mm")
    parser.add_argument("--footprint-px", type=float, default=0.577, help="standard deviation of blur and pixel, px")
    parser.add_argument("--window-px", type=int, default=5, help="smoothing window of the clouds, px")
    args = parser.parse_args()
    load = lambda path: tomllib.load(open(path, "rb"))
    body = next(body for body in load(args.scene)["body"] if body["name"] == "step")
    near = {}
    for path, truth in zip(args.clouds[::2], args.clouds[1::2]):
        for name, outwards, height in edges(places(cloud(path)), body, load(truth)):
            near.setdefault(name, []).append((outwards, height))
    near["all"] = [part for parts in near.values() for part in parts]
    for name, parts in near.items():
        step, width, over, scatter = response(*map(np.concatenate, zip(*parts)))
        print(f"edge {name:3}: step {1e3 * step:.1f} µm, 10-90 % in {width:.3f} mm, overshoot {100 * over:.0f} %, scatter of points {1e3 * scatter:.1f} µm")
    sharp, smooth = (args.pixel_mm * expected(args.footprint_px, window) for window in (1, args.window_px))
    print(f"expected: {sharp:.3f} mm where the step is far above the noise, {smooth:.3f} mm where it hides in it (window {args.window_px} px)")


main()
