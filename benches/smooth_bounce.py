#!/usr/bin/env python3
"""Light that bounces between the faces of a groove, without the grain of random rays: what it does to points, and what `max_bounce_rad` finds of it.

    smooth_bounce.py FRINGETOOL FOLDER [--angle DEG] [--method phase|projector] [--albedo SHARE] [--period PX] [--steps N]
        [--limit RAD] [--placements N] [--keep]

The digital twin of `bounce.py` follows some dozens of random rays for each pixel: most of what they do to a point is light of that pixel alone, which real parts
have none of. Here the light that one face throws on the other is an integral over small areas, known on a grid (0.5 mm, finer towards the edge in which the
faces meet) and linear between: smooth, as it is on real parts. Nothing of the program is used but its file formats; cameras, projector and patterns are those of
`second_simulation.py`, two cameras beside the projector. What counts as wrong, flagged and left out is said in `bounce.py`. Needs numpy, numba and Pillow.
"""
import math
import os
import tomllib

import numpy as np
from PIL import Image
from bounce import judged, planes, views
from common import arguments, run
from second_simulation import CAMERAS, FOCAL, GAIN_DN, PAIRS, PROJECTOR, PROJECTOR_FOCAL, READ_DN, SIZE, Eye, Sequence, configuration, patterns

LENGTH, WIDTH = 70.0, 50.0
FINE, REACH, WHITE_DN = 4, 3, 200.0
SEEING = PAIRS["beside"]


class Face:
    """A rectangle from the edge in which the faces meet: `away` from it, `along` it, and its normal."""

    def __init__(self, corner, along, away, normal):
        self.corner, self.along, self.away, self.normal = corner, along, away, normal
        # Distances from the edge grow by a tenth up to half a millimetre: near the edge light varies over as short a way.
        steps = np.minimum(0.05 * 1.1 ** np.arange(400), 0.5)
        self.far = np.r_[0.05, 0.05 + np.cumsum(steps)]
        self.far = self.far[self.far < WIDTH]
        self.side = np.arange(-LENGTH / 2, LENGTH / 2 + 0.25, 0.5)

    def places(self, far, side):
        return self.corner + far[..., None] * self.away + side[..., None] * self.along


def groove(angle, rng):
    """Two faces that open towards the projector, the edge between them turned and shifted."""
    towards = Eye(0.0, 48.0, PROJECTOR, PROJECTOR_FOCAL, 0.0).centre / 500.0
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    turn = rng.uniform(-0.6, 0.6)
    along = math.cos(turn) * np.cross(towards, right) + math.sin(turn) * right
    across = np.cross(along, towards)
    lean, corner = rng.uniform(-0.12, 0.12), rng.uniform(-5.0, 5.0, 3) - 20.0 * towards
    faces = []
    for side in (1.0, -1.0):
        a = side * math.radians(angle) / 2 + lean
        away = math.cos(a) * towards + math.sin(a) * across
        normal = side * (math.sin(a) * towards - math.cos(a) * across)
        faces.append(Face(corner, along, away, normal))
    return faces


def light_on(face, light, places):
    """Share of the projector's light on places of a face, and the column that it comes from."""
    to = light.centre - places
    far = np.linalg.norm(to, axis=-1)
    return np.maximum(to @ face.normal / far, 0.0) * (500.0 / far) ** 2, light.pixels(places)[..., 0]


def shown(table, column):
    """Light of all frames at columns of the projector; shape (frames, ...)."""
    at = np.clip((column + 0.5) * 32 - 0.5, 0, table.shape[1] - 1.001)
    low = at.astype(int)
    part = (at - low).astype(np.float32)
    return table[:, low] * (1 - part) + table[:, low + 1] * part


def thrown(onto, source, light, table, albedo):
    """Light of all frames that one face throws on the other, at the grid of the other; shape (frames, far, side)."""
    edges = np.r_[0.0, 0.5 * (source.far[1:] + source.far[:-1]), WIDTH]
    middle, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    sides = np.arange(-LENGTH / 2 + 0.2, LENGTH / 2, 0.4)
    far, side = (v.ravel() for v in np.meshgrid(middle, sides, indexing="ij"))
    areas = np.repeat(width, len(sides)) * 0.4
    places = source.places(far, side)
    share, column = light_on(source, light, places)
    sent = (albedo / math.pi * share * areas)[:, None] * shown(table, column).T
    out = np.zeros((len(table), len(onto.far), len(onto.side)), np.float32)
    for i, distance in enumerate(onto.far):
        here = onto.places(np.full(len(onto.side), distance), onto.side)
        to = (places[None] - here[:, None]).astype(np.float32)
        square = (to**2).sum(-1)
        kernel = np.maximum(to @ onto.normal.astype(np.float32), 0.0) * np.maximum(-(to @ source.normal.astype(np.float32)), 0.0) / square**2
        out[:, i] = (kernel @ sent.astype(np.float32)).T
    return out


def between(face, grid, far, side):
    """Values of a grid of a face at places on it, linear between its points."""
    row = np.clip(np.interp(far, face.far, np.arange(len(face.far))), 0, len(face.far) - 1.001)
    column = np.clip((side + LENGTH / 2) / 0.5, 0, len(face.side) - 1.001)
    r, c = row.astype(int), column.astype(int)
    pr, pc = (row - r).astype(np.float32), (column - c).astype(np.float32)
    return (grid[r, c] * (1 - pc) + grid[r, c + 1] * pc) * (1 - pr) + (grid[r + 1, c] * (1 - pc) + grid[r + 1, c + 1] * pc) * pr


def blurred(fine, sigma):
    """Pixels of a fine picture, each the mean of its area after the lens has spread the light by a Gaussian of so many pixels along x and y."""
    size = 2 * REACH * FINE + FINE
    at = (np.arange(size) - REACH * FINE + 0.5) / FINE - 0.5
    for s in sigma:
        weights = np.array([math.erf((a + 0.5) / (math.sqrt(2) * s)) - math.erf((a - 0.5) / (math.sqrt(2) * s)) for a in at])
        weights = (weights / weights.sum()).astype(np.float32)
        count = (fine.shape[1] - size) // FINE + 1
        fine = sum(w * fine[:, k : k + FINE * (count - 1) + 1 : FINE] for k, w in enumerate(weights)).T
    return fine


def pictures(eye, sigma, faces, light, table, bounced):
    """All frames of a camera, without and with the bounce; before noise."""
    x = (np.arange((SIZE[0] + 2 * REACH) * FINE) + 0.5) / FINE - 0.5 - REACH
    y = (np.arange((SIZE[1] + 2 * REACH) * FINE) + 0.5) / FINE - 0.5 - REACH
    out = np.zeros((2, len(table), SIZE[1], SIZE[0]), np.float32)
    band = 30
    for top in range(0, SIZE[1], band):
        rows = y[top * FINE : (top + band + 2 * REACH) * FINE]
        gx, gy = np.meshgrid(x, rows)
        rays = eye.rays(gx.ravel(), gy.ravel())
        best = np.full(len(rays), np.inf)
        lit = []
        for face in faces:
            length = ((face.corner - eye.centre) @ face.normal) / (rays @ face.normal)
            from_corner = eye.centre + rays * length[:, None] - face.corner
            far, side = from_corner @ face.away, from_corner @ face.along
            hit = (far > 0) & (far < WIDTH) & (abs(side) < LENGTH / 2) & (length > 0) & (length < best)
            best[hit] = length[hit]
            lit.append((hit, far, side))
        if not np.isfinite(best).any():
            continue
        direct = np.zeros((len(table), len(rays)), np.float32)
        more = np.zeros_like(direct)
        for face, grid, (hit, far, side) in zip(faces, bounced, lit):
            share, column = light_on(face, light, face.places(far[hit], side[hit]))
            direct[:, hit] = share.astype(np.float32) * shown(table, column)
            for frame in range(len(table)):
                more[frame, hit] = between(face, grid[frame], far[hit], side[hit])
        for frame in range(len(table)):
            for i, values in enumerate((direct[frame], direct[frame] + more[frame])):
                out[i, frame, top : top + band] = blurred(values.reshape(gx.shape), sigma)[: SIZE[1] - top]
    return out


def recordings(folder, eyes, light, sequence, table, faces, albedo, rng):
    """Four recordings: without and with the bounce, each in 16 bits without noise and in 8 bits with it."""
    bounced = [thrown(onto, source, light, table, albedo) for onto, source in (faces, faces[::-1])]
    for name in SEEING:
        drawn = pictures(eyes[name], CAMERAS[name][3], faces, light, table, bounced)
        for i, frames in enumerate(drawn):
            frames = 3.0 + WHITE_DN * 0.9 * frames / drawn[1].max()
            for noise in (False, True):
                place = f"{folder}-{'noisy' if noise else 'clean'}-{i}/frames/proj1/{name}"
                os.makedirs(place, exist_ok=True)
                for number, frame in enumerate(frames):
                    if noise:
                        frame = frame + rng.normal(size=frame.shape) * np.sqrt(READ_DN**2 - 1 / 12 + GAIN_DN * frame)
                        Image.fromarray(np.clip(np.round(frame), 0, 255).astype(np.uint8)).save(f"{place}/{number:03}.png", compress_level=1)
                    else:
                        Image.fromarray(np.round(frame * 256).astype(np.uint16)).save(f"{place}/{number:03}.png", compress_level=1)
    names = ", ".join(f'"{name}"' for name in SEEING)
    for kind in ("clean", "noisy"):
        for i in (0, 1):
            with open(f"{folder}-{kind}-{i}/recording.toml", "w") as file:
                file.write(
                    f'format = "fringecell-recording/1"\n[[projector]]\nname = "proj1"\nwidth_px = {PROJECTOR[0]}\nheight_px = {PROJECTOR[1]}\ncameras = [{names}]\n{sequence.toml()}'
                )


def rig(path, eyes, light, noise, method):
    text = 'format = "fringecell-rig/1"\n\n'
    for name in SEEING:
        footprint = [math.sqrt(s**2 + 1 / 12) for s in CAMERAS[name][3]]
        known = f"noise = {{ read_dn = {READ_DN}, gain_dn = {GAIN_DN} }}\n" if noise else ""
        text += eyes[name].toml("camera", name, f"footprint_px = {footprint}\n{known}")
    text += light.toml("projector", "proj1")
    pairs = [(name, "proj1") for name in SEEING] if method == "projector" else [SEEING]
    for left, right in pairs:
        text += f'[[pair]]\nname = "{left}-{right}"\nleft = "{left}"\nright = "{right}"\nprojector = "proj1"\n\n'
    with open(path, "w") as file:
        file.write(text)


def main():
    parser = arguments(__doc__)
    parser.add_argument("--angle", type=float, default=84.0, help="between the faces, degrees")
    parser.add_argument("--method", choices=["phase", "projector"], default="phase", help="two cameras, or each camera against the projector")
    parser.add_argument("--albedo", type=float, default=0.7)
    parser.add_argument("--period", type=float, default=16.0, help="columns of a fringe")
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--limit", type=float, default=0.05, help="max_bounce_rad")
    parser.add_argument("--placements", type=int, default=3)
    args = parser.parse_args()
    os.makedirs(args.folder, exist_ok=True)
    sequence = Sequence(args.period, args.steps)
    eyes = {name: Eye(*CAMERAS[name][:2], SIZE, FOCAL, CAMERAS[name][2]) for name in SEEING}
    light = Eye(0.0, 48.0, PROJECTOR, PROJECTOR_FOCAL, 0.0)
    table = patterns(sequence).astype(np.float32)
    for kind in ("clean", "noisy"):
        rig(f"{args.folder}/{kind}.toml", eyes, light, kind == "noisy", args.method)
        for limit in (0.0, args.limit):
            path = f"{args.folder}/{kind}-{limit}.config.toml"
            configuration(path, f"{kind}.toml", sequence, 70.0)
            with open(path) as file:
                text = file.read()
            for name in set(CAMERAS) - set(SEEING):
                text = text.replace(f'[[camera]]\nname = "{name}"\ndriver = "twin"\n', "").replace(f', "{name}"', "")
            with open(path, "w") as file:
                file.write(f"{text}\n[decode]\nmax_bounce_rad = {limit}\n")
    with open(f"{args.folder}/noisy.toml", "rb") as file:
        cell = tomllib.load(file)
    for number in range(args.placements):
        rng = np.random.default_rng(number)
        name = f"{args.folder}/g{number}"
        faces = groove(args.angle, rng)
        if not (args.keep and os.path.exists(f"{name}-noisy-1/recording.toml")):
            recordings(name, eyes, light, sequence, table, faces, args.albedo, rng)
        found = {}
        for clean in (True, False):
            kind = "clean" if clean else "noisy"
            for bounce in (0, 1):
                for limit in (0.0,) if clean else (0.0, args.limit):
                    ply = f"{name}-{kind}-{bounce}-{limit}.ply"
                    run(args.fringetool, "reconstruct", "--config", f"{args.folder}/{kind}-{limit}.config.toml", "--out", ply, "--force", f"{name}-{kind}-{bounce}")
                    found[clean, bounce, limit] = planes(views(ply, cell))
        judged(f"groove {number} of {args.angle:g} degrees", found, 1, args.limit)


if __name__ == "__main__":
    main()
