#!/usr/bin/env python3
"""A part in pictures that another program draws: errors of all points and of features, over what the program states.

    part_simulation.py FRINGETOOL FOLDER [--rig two|four] [--placements N] [--first N] [--recordings N] [--method phase|projector|both]
        [--disturb NAME[=AMOUNT]]... [--rows] [--ideal] [--fine N] [--keep]

Nothing of the program is used but its file formats. Rays are cast through pinholes with one radial coefficient at 4 x 4 places of each pixel; their light is
weighted with the pixel's area and a Gaussian that differs from camera to camera (0.36 to 0.58 px). The part: a plate with a box 8 mm high, a ramp of 15 degrees,
balls of 28 and 24 mm that lie on it and a cylinder of 20 mm that dips into it; Lambert's cosine, the shadows of the projector, vignetting. The projector: pixels,
8 bits, a blur of 0.6 px. The camera: photon and read noise, 8 bits. Each placement turns the part about z by any angle, tilts it by up to 3 degrees, shifts it
by up to 4 mm. The rig file states geometry, footprint and noise as they are. Disturbances (amount by default): flicker (0.02, standard deviation of a
frame's light), room (2 DN, range of an even light that differs from frame to frame), drift (4 DN of it over the sequence), saturate (1.5, exposure),
dim (0.12, exposure), defocus (2.5 px), gloss (1.0 of the diffuse light), gain (2.0 times the photon noise that the rig file states), gamma (1.3),
levels (1 LSB, errors of the pattern that every period has), texture (0.1), bright (2.0, reflectance of the box).

Judged is the signed distance of every point of the cloud from the nearest face of the part, along that face's normal, over the point's `sigma`. A point is
at an edge where a second face is nearer than 0.5 mm: edges, and creases with the plate. Needs numpy, numba and Pillow.
"""
import json
import math
import os
import subprocess

import numba
import numpy as np
from PIL import Image
from common import arguments, cloud, places
from second_simulation import Eye

SIZE, FOCAL, PROJECTOR, PROJECTOR_FOCAL = (640, 480), 1852.0, (608, 684), 1500.0
# Azimuth, elevation, distance, radial coefficient; blur along x and y, px.
RIGS = {
    "two": {"cameras": {"cam1": (-14.0, 60.0, 500.0, -0.08, (0.42, 0.45)), "cam2": (14.0, 60.0, 505.0, -0.06, (0.55, 0.50))}}
    | {"projectors": {"proj1": (0.0, 60.0, 520.0, -0.02)}, "pairs": {"pair1": ("cam1", "cam2", "proj1")}},
    "four": {
        "cameras": {"cam1": (-12.0, 48.0, 500.0, -0.08, (0.42, 0.45)), "cam2": (12.0, 48.0, 505.0, -0.06, (0.55, 0.50))}
        | {"cam3": (78.0, 48.0, 498.0, -0.07, (0.36, 0.36)), "cam4": (102.0, 48.0, 503.0, -0.05, (0.58, 0.55))},
        "projectors": {"proj1": (0.0, 48.0, 520.0, -0.02), "proj2": (90.0, 48.0, 515.0, -0.03)},
        "pairs": {"pair1": ("cam1", "cam2", "proj1"), "pair2": ("cam3", "cam4", "proj2")},
    },
}
DISTURBANCES = {"flicker": 0.02, "room": 2.0, "drift": 4.0, "saturate": 1.5, "dim": 0.12, "defocus": 2.5, "gloss": 1.0, "gain": 2.0, "gamma": 1.3, "levels": 1.0}
DISTURBANCES |= {"texture": 0.1, "bright": 2.0}
REGIONS = {"plate": [0], "box": [1], "ramp": [2], "balls": [3, 4], "cylinder": [5]}
PERIOD, STEPS = 16, 10
READ_DN, GAIN_DN, WHITE_DN, DARK_DN, AMBIENT_DN, LEAK = 0.35, 0.024, 190.0, 3.0, 3.0, 0.002
VIGNETTING, REACH = 0.2, 3
STEP, RAMP_DEG, BALLS, TUBE = 8.0, 15.0, ((28.0, -38.0, 22.0), (24.0, 42.0, 20.0)), (20.0, -14.0, 22.0, 32.0, 3.0)


def eye(azimuth, elevation, distance, k1, size, focal):
    """A camera or projector that far from the origin; those of the other simulation are 500 mm away."""
    made = Eye(azimuth, elevation, size, focal, k1)
    made.centre *= distance / 500.0
    made.numbers = np.concatenate([made.centre, made.axes.ravel(), made.middle, [focal, k1]])
    return made


def bodies(turn, shift):
    """Plate, box, ramp, balls and cylinder in the world: planes (normal out of the body, offset), and a quadric (1 ball or 2 cylinder, centre, axis, radius)."""
    tilt, (diameter, x0, x1, y, z) = math.radians(RAMP_DEG), TUBE
    planes, quadrics = np.full((6, 6, 4), np.inf), np.zeros((6, 8))
    sides = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    for i, (low, high) in enumerate((((-100, -75, -10), (100, 75, 0)), ((-52, -43, -2), (-12, -13, STEP)), ((10, -43, -2), (50, -13, 99)))):
        planes[i] = np.c_[sides, [high[0], -low[0], high[1], -low[1], high[2], -low[2]]]
    # The ramp's top rises from 4 mm above the plate at x = 10.
    planes[2, 4] = np.r_[-math.sin(tilt), 0, math.cos(tilt), 4 * math.cos(tilt) - 10 * math.sin(tilt)]
    for i, (d, at_x, at_y) in enumerate(BALLS, 3):
        quadrics[i] = np.r_[1, at_x, at_y, 0.5 * d, 0, 0, 0, 0.5 * d]
    quadrics[5] = np.r_[2, x0, y, z, 1, 0, 0, 0.5 * diameter]
    planes[5, :2] = np.c_[sides[:2], [x1, -x0]]
    there = np.isfinite(planes[:, :, 3])
    planes[there, :3] = planes[there, :3] @ turn.T
    planes[there, 3] += planes[there, :3] @ shift
    quadrics[3:, 1:4], quadrics[3:, 4:7] = quadrics[3:, 1:4] @ turn.T + shift, quadrics[3:, 4:7] @ turn.T
    return planes, quadrics


@numba.njit(cache=True)
def cast(o, d, planes, quadrics, normal):
    """First body that a ray enters beyond its start, and how far away it is; -1: none."""
    best, which = np.inf, -1
    for body in range(len(planes)):
        enter, leave, by = -np.inf, np.inf, -1
        for i in range(planes.shape[1]):
            p = planes[body, i]
            if p[3] == np.inf:
                continue
            rate = p[0] * d[0] + p[1] * d[1] + p[2] * d[2]
            gap = p[3] - (p[0] * o[0] + p[1] * o[1] + p[2] * o[2])
            if rate < 0.0 and gap / rate > enter:
                enter, by = gap / rate, i
            elif rate > 0.0:
                leave = min(leave, gap / rate)
            elif rate == 0.0 and gap < 0.0:
                leave = -np.inf
        q = quadrics[body]
        if q[0] > 0.0:
            x, y, z = o[0] - q[1], o[1] - q[2], o[2] - q[3]
            da, xa = d[0] * q[4] + d[1] * q[5] + d[2] * q[6], x * q[4] + y * q[5] + z * q[6]
            a = 1.0 - da * da
            b = x * d[0] + y * d[1] + z * d[2] - da * xa
            square = b * b - a * (x * x + y * y + z * z - xa * xa - q[7] * q[7])
            if square <= 0.0:
                continue
            root = math.sqrt(square)
            if (-b - root) / a > enter:
                enter, by = (-b - root) / a, 100
            leave = min(leave, (-b + root) / a)
        if enter < leave and enter > 1e-7 and enter < best:
            best, which = enter, body
            if by == 100:
                x, y, z = o[0] + enter * d[0] - q[1], o[1] + enter * d[1] - q[2], o[2] + enter * d[2] - q[3]
                xa = x * q[4] + y * q[5] + z * q[6]
                normal[0], normal[1], normal[2] = (x - xa * q[4]) / q[7], (y - xa * q[5]) / q[7], (z - xa * q[6]) / q[7]
            else:
                normal[:] = planes[body, by, :3]
    return which, best


@numba.njit(cache=True)
def picture(eye, light, size, fine, sigma, table, axis_of, planes, quadrics, surface, waves):
    """Projector's light of all frames in a camera, of white on a bright face across it. `surface`: gloss, texture, reflectance of the box."""
    frames, (width, height) = len(table), size
    half, taps = REACH * fine, 2 * REACH * fine + fine
    weights = np.zeros((2, taps))
    for i in range(2):
        for k in range(taps):
            at, s = (k - half + 0.5) / fine - 0.5, math.sqrt(2.0) * sigma[i]
            weights[i, k] = math.erf((at + 0.5) / s) - math.erf((at - 0.5) / s)
        weights[i] /= weights[i].sum()
    out = np.zeros((frames, height, width))
    row, narrow, (d, p, to, normal, shade) = np.zeros((frames, width * fine + 2 * half)), np.zeros((frames, width)), np.zeros((5, 3))
    for j in range(height * fine + 2 * half):
        row[:] = 0.0
        for i in range(row.shape[1]):
            xd = ((i - half + 0.5) / fine - 0.5 - eye[12]) / eye[14]
            yd = ((j - half + 0.5) / fine - 0.5 - eye[13]) / eye[14]
            x, y = xd, yd
            for _ in range(8):
                x, y = xd / (1.0 + eye[15] * (x * x + y * y)), yd / (1.0 + eye[15] * (x * x + y * y))
            for k in range(3):
                d[k] = x * eye[3 + k] + y * eye[6 + k] + eye[9 + k]
            d /= math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
            body, far = cast(eye[:3], d, planes, quadrics, normal)
            if body < 0:
                continue
            for k in range(3):
                p[k] = eye[k] + far * d[k]
                to[k] = light[k] - p[k]
            away = math.sqrt(to[0] * to[0] + to[1] * to[1] + to[2] * to[2])
            to /= away
            cosine = normal[0] * to[0] + normal[1] * to[1] + normal[2] * to[2]
            if cosine <= 0.0 or cast(p + 1e-5 * normal, to, planes, quadrics, shade)[0] >= 0:
                continue
            albedo = surface[2] if body == 1 else 1.0
            for w in waves:
                albedo *= 1.0 + surface[1] * math.sin(w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + w[3])
            share = albedo * cosine
            if surface[0] > 0.0:
                h = to - d
                share += surface[0] * max((normal * h).sum() / math.sqrt((h * h).sum()), 0.0) ** 80
            share *= (500.0 / away) ** 2
            cz = -to[0] * light[9] - to[1] * light[10] - to[2] * light[11]
            cx, cy = -(to * light[3:6]).sum() / cz, -(to * light[6:9]).sum() / cz
            scale = light[14] * (1.0 + light[15] * (cx * cx + cy * cy))
            for f in range(frames):
                # 32 places of a column, the first one at its edge half a pixel before the first centre.
                place = ((scale * cx + light[12] if axis_of[f] == 0 else scale * cy + light[13]) + 0.5) * 32 - 0.5
                low = int(math.floor(place))
                if low >= 0 and low + 1 < table.shape[1]:
                    row[f, i] = share * (table[f, low] + (place - low) * (table[f, low + 1] - table[f, low]))
        for f in range(frames):
            for i in range(width):
                narrow[f, i] = (weights[0] * row[f, i * fine : i * fine + taps]).sum()
        for y in range(max(0, (j - taps) // fine), min(height, j // fine + 1)):
            if 0 <= j - y * fine < taps:
                out[:, y] += weights[1, j - y * fine] * narrow
    return out


def judge(path, planes, quadrics, found):
    """Errors of a cloud, mm, and what is stated of them, by region: signed distances to the nearest face."""
    points = places(stated := cloud(path))
    best, second, signed, body = (np.full(len(points), v) for v in (np.inf, np.inf, 0.0, -1))
    for i, quadric in enumerate(quadrics):
        values = [points @ p[:3] - p[3] for p in planes[i] if np.isfinite(p[3])]
        if quadric[0] > 0:
            to = points - quadric[1:4]
            values.append(np.linalg.norm(to - np.outer(to @ quadric[4:7], quadric[4:7]), axis=1) - quadric[7])
        for k, value in enumerate(values):
            # A face ends where another one of its body begins.
            far = np.hypot(value, np.max([np.zeros(len(points))] + values[:k] + values[k + 1 :], axis=0))
            nearer = far < best
            second = np.where(nearer, best, np.minimum(second, far))
            best, signed, body = np.where(nearer, far, best), np.where(nearer, np.copysign(far, value), signed), np.where(nearer, i, body)
    edge = second < 0.5
    for name, where in ({"all": edge | True, "edges": edge} | {name: np.isin(body, of) & ~edge for name, of in REGIONS.items()}).items():
        found.setdefault(name, []).append(np.c_[signed, stated["sigma"]][where])


def summary(parts):
    """Points; mean and rms error in um and rms of error over sigma, both without gross errors; that rms with them; % beyond 3; points off by more than 0.3 mm."""
    error, sigma = np.concatenate(parts).T
    z, near = error / sigma, np.abs(error) < 0.3
    rms = lambda values: math.sqrt(np.mean(values**2)) if len(values) else math.nan
    return len(z), 1e3 * np.mean(error[near]), 1e3 * rms(error[near]), rms(z[near]), rms(z), 100 * np.mean(np.abs(z) > 3), int((~near).sum())


class Patterns:
    """Frames of a projector: fringes and a Gray code of stripes of half a fringe, for columns and on demand for rows too, white, black."""

    def __init__(self, rows, disturb, ideal):
        self.sets, levels, self.axis_of, rng = [], [], [], np.random.default_rng(5)
        for axis in range(2 if rows else 1):
            at = np.arange(PROJECTOR[axis])
            bits, stripe = math.ceil(math.log2(len(at) / (PERIOD // 2))), at // (PERIOD // 2)
            frames = [0.5 + 0.5 * np.cos(2 * np.pi * (at / PERIOD - i / STEPS)) for i in range(STEPS)]
            if "levels" in disturb:
                frames = [f + disturb["levels"] / 255 * rng.choice([-1, 0, 1], PERIOD)[at % PERIOD] for f in frames]
            frames += [((stripe ^ (stripe >> 1)) >> (bits - 1 - bit)) & 1 for bit in range(bits)]
            name = f'axis = "{"xy"[axis]}"'
            self.sets += [f'{{ set = "sine", {name}, period_px = {PERIOD}.0, steps = {STEPS} }}', f'{{ set = "gray", {name}, bits = {bits}, stripe_px = {PERIOD / 2} }}']
            levels, self.axis_of = levels + frames, self.axis_of + [axis] * len(frames)
        self.sets += ['{ set = "white" }', '{ set = "black" }']
        levels, self.axis_of = levels + [np.ones(PROJECTOR[0]), np.zeros(PROJECTOR[0])], np.array(self.axis_of + [0, 0])
        kernel = np.exp(-0.5 * (np.arange(-320, 321) / (32 * disturb.get("defocus", 0.6))) ** 2)
        self.table = np.zeros((len(levels), 32 * max(PROJECTOR)))
        for row, frame in zip(self.table, levels):
            frame = np.clip(np.asarray(frame, float), 0, 1)
            level = frame if ideal else (np.round(255 * frame) / 255) ** disturb.get("gamma", 1.0)
            fine = np.convolve(np.pad(np.repeat(level, 32), 320, mode="edge"), kernel / kernel.sum(), mode="valid")
            row[: len(fine)] = LEAK + (1 - LEAK) * fine


def camera(light, disturb, ideal, lamp, room, rng):
    """Grey values of all frames: exposure, vignetting, room, noise, bits."""
    y, x = (np.linspace(-1, 1, n) for n in SIZE[::-1])
    falloff = 1.0 - VIGNETTING * 0.5 * (x[None] ** 2 + y[:, None] ** 2)
    exposure = disturb.get("saturate", 1.0) * disturb.get("dim", 1.0)
    signal = falloff * (exposure * (WHITE_DN * lamp[:, None, None] * light + AMBIENT_DN) + room[:, None, None])
    if ideal:
        return np.clip(np.round(257 * (DARK_DN + signal)), 0, 65535).astype(np.uint16)
    noise = np.sqrt(READ_DN**2 + disturb.get("gain", 1.0) * GAIN_DN * signal)
    return np.clip(np.round(DARK_DN + signal + rng.normal(size=signal.shape) * noise), 0, 255).astype(np.uint8)


def rig(cell, eyes, lights, ideal):
    text = 'format = "fringecell-rig/1"\n\n'
    for name, (*_, sigma) in cell["cameras"].items():
        # Dark pixels show DARK_DN without photon noise; the model of noise in the file counts it from a grey value of 0.
        read = math.sqrt(READ_DN**2 + 1 / 12 - GAIN_DN * DARK_DN)
        more = f"footprint_px = {[math.sqrt((0 if ideal else s**2) + 1 / 12) for s in sigma]}\n"
        text += eyes[name].toml("camera", name, more + ("" if ideal else f"noise = {{ read_dn = {read}, gain_dn = {GAIN_DN} }}\n"))
    text += "".join(light.toml("projector", name) for name, light in lights.items())
    return text + "".join(f'[[pair]]\nname = "{n}"\nleft = "{a}"\nright = "{b}"\nprojector = "{p}"\n\n' for n, (a, b, p) in cell["pairs"].items())


def plan(turn, shift):
    row = lambda values: str([float(v) for v in values])
    tilt, (d, x0, x1, y, z) = math.radians(RAMP_DEG), TUBE
    text = f'format = "fringecell-plan/1"\nname = "part"\n[placement]\nrotation = [{", ".join(map(row, turn))}]\ntranslation_mm = {row(shift)}\n'
    text += '[alignment]\nplane = "plate"\nline = ["ball1", "ball2"]\norigin = "ball1"\nsearch_mm = 4.0\nsearch_deg = 3.0\n'

    def element(kind, name, tolerance, points, more):
        common = f"margin_mm = 0.8\nmax_reject_fraction = 0.003\nnormal_tolerance_deg = {tolerance}\nmin_points = {points}\n"
        return f'[[element]]\nkind = "{kind}"\nname = "{name}"\n{common}{more}\n'

    for i, (diameter, *at) in enumerate(BALLS, 1):
        text += element("sphere", f"ball{i}", 25.0, 300, f"center_mm = {row([*at, 0.5 * diameter])}\ndiameter_mm = {diameter}\nmax_polar_deg = 95.0\n")
    holes = [(-32, -28, "size_mm = [46.0, 36.0]"), (30, -28, "size_mm = [46.0, 36.0]"), (0.5 * (x0 + x1), y, f"size_mm = [{x1 - x0 + 6}, {d + 6}]")]
    cut = ", ".join(f"{{ center_mm = {row([a, b, 0])}, {what} }}" for a, b, what in holes + [(a, b, f"radius_mm = {0.5 * e}") for e, a, b in BALLS])
    up, along = [0, 0, 1], [1, 0, 0]
    for name, point, normal, side, size, more in (
        ("step", [-32, -28, STEP], up, along, [40, 30], ""),
        ("ramp", [30, -28, 4 + 20 * math.tan(tilt)], [-math.sin(tilt), 0, math.cos(tilt)], [0, 1, 0], [30, 40 / math.cos(tilt)], ""),
        ("plate", [0, 0, 0], up, along, [130, 110], f"exclude = [{cut}]\n"),
    ):
        face = f"point_mm = {row(point)}\nnormal = {row(normal)}\ndirection = {row(side)}\nsize_mm = {row(size)}\ninset_mm = 1.5\n"
        text += element("plane", name, 15.0, 500, face + more)
    tube = f"point_mm = [{0.5 * (x0 + x1)}, {y}, {z}]\naxis = [1.0, 0.0, 0.0]\ndiameter_mm = {d}\nlength_mm = {x1 - x0}\ninset_mm = 1.5\n"
    text += element("cylinder", "tube", 25.0, 500, tube + "direction = [0.0, 0.0, 1.0]\nsector_deg = 170.0\n")
    spacing = math.dist(*[(*at, 0.5 * diameter) for diameter, *at in BALLS])
    for name, kind, of, nominal, unit in (
        *((f"ball{i}", "sphere-diameter", f'element = "ball{i}"', BALLS[i - 1][0], "mm") for i in (1, 2)),
        ("spacing", "centre-distance", 'elements = ["ball1", "ball2"]', spacing, "mm"),
        ("step", "plane-distance", 'elements = ["plate", "step"]', STEP, "mm"),
        ("ramp", "plane-angle", 'elements = ["plate", "ramp"]', RAMP_DEG, "deg"),
        ("tube", "size", 'element = "tube"', d, "mm"),
    ):
        text += f'[[feature]]\nkind = "{kind}"\nname = "{name}"\n{of}\nnominal_{unit} = {nominal}\ntolerance_{unit} = [-1.0, 1.0]\n'
    return text


def place(seed):
    """Where a placement has the part."""
    rng, turn = np.random.default_rng(1000 + seed), np.eye(3)
    for axis, angle in ((2, rng.uniform(0, 2 * np.pi)), (0, math.radians(rng.uniform(-3, 3))), (1, math.radians(rng.uniform(-3, 3)))):
        c, s, (a, b), step = math.cos(angle), math.sin(angle), [(1, 2), (2, 0), (0, 1)][axis], np.eye(3)
        step[a, a], step[a, b], step[b, a], step[b, b] = c, -s, s, c
        turn = step @ turn
    return turn, rng.uniform(-4, 4, 3)


def draw(folder, cell, patterns, disturb, ideal, pictures, seen, rng):
    """One recording; `seen` keeps the light of a placement for the next one."""
    text, count = 'format = "fringecell-recording/1"\n', len(patterns.table)
    for projector in cell["projectors"]:
        names = [name for pair in cell["pairs"].values() if pair[2] == projector for name in pair[:2]]
        lamp = 1.0 + disturb.get("flicker", 0.0) * rng.normal(size=count)
        room = disturb.get("room", 0.0) * rng.uniform(size=count) + disturb.get("drift", 0.0) * np.linspace(0, 1, count)
        for name in names:
            if name not in seen:
                seen[name] = pictures(name, projector)
            os.makedirs(f"{folder}/frames/{projector}/{name}", exist_ok=True)
            for i, frame in enumerate(camera(seen[name], disturb, ideal, lamp, room, rng)):
                Image.fromarray(frame).save(f"{folder}/frames/{projector}/{name}/{i:03}.png", compress_level=1)
        text += f'[[projector]]\nname = "{projector}"\nwidth_px = {PROJECTOR[0]}\nheight_px = {PROJECTOR[1]}\ncameras = {json.dumps(names)}\nsequence = [\n  '
        text += ",\n  ".join(patterns.sets) + ",\n]\n"
    with open(f"{folder}/recording.toml", "w") as file:
        file.write(text)


def measure(args, folder, method, faces, clouds, features, told):
    """What a user types, and what came of it."""
    path, result, said = f"{folder}-{method}.ply", f"{folder}-{method}.json", []
    for command in (("reconstruct", "--rig", f"{args.folder}/rig.toml", "--method", method, "--out", path, folder), ("measure", f"{folder.rsplit('-', 1)[0]}.plan.toml", path, "--json", result)):
        done = subprocess.run((args.fringetool, *command, "--force"), capture_output=True, text=True)
        said += [f"{command[0]}: {line}" for line in (done.stdout + done.stderr).splitlines() if any(word in line for word in ("warning", "error", "look at"))]
        if done.returncode > 1:
            break
    told.append(said)
    if done.returncode > 1:
        return
    judge(path, *faces, clouds)
    with open(result) as file:
        for feature in json.load(file)["features"]:
            nominal, value = next(v for k, v in feature.items() if k.startswith("nominal")), feature.get("value")
            features.setdefault(feature["name"], []).append((math.nan, math.nan) if value is None else (value - nominal, feature["u"]))


def report(method, clouds, features, told):
    print(f"\n{method}: {summary.__doc__}")
    for name, v in ((name, summary(parts)) for name, parts in clouds.items()):
        print(f"  {name:9} {v[0]:8d}  {v[1]:+7.2f} {v[2]:7.2f}  {v[3]:6.3f} {v[4]:7.3f}  {v[5]:6.3f}  {v[6]:4d}")
    each = [summary([parts]) for parts in clouds.get("all", [])]
    print("  each cloud (error over sigma, beyond 3, gross):", "; ".join(f"{v[3]:.3f} {v[5]:.2f}% {v[6]}" for v in each))
    print("  feature: measured of, mean error, scatter, u (um or mdeg, median), error over u (rms), largest")
    for name, values in features.items():
        error, u = 1e3 * np.array(values).T
        e, z = error[np.isfinite(error)], (error / u)[np.isfinite(error)]
        if len(e):
            print(f"  {name:9} {len(e)}/{len(u)}  {e.mean():+7.2f} {e.std():6.2f} {np.nanmedian(u):6.2f}  {math.sqrt(np.mean(z**2)):5.2f} {np.abs(z).max():5.2f}")
    for line in sorted(set(sum(told, []))):
        print(f"  {sum(told, []).count(line)} x {line[:300]}")


def main():
    parser = arguments(__doc__)
    parser.add_argument("--rig", choices=RIGS, default="two")
    for name, number in {"placements": 3, "first": 0, "recordings": 1, "fine": 4}.items():
        parser.add_argument(f"--{name}", type=int, default=number)
    parser.add_argument("--method", choices=("phase", "projector", "both"), default="both")
    parser.add_argument("--disturb", action="append", default=[], metavar="NAME[=AMOUNT]")
    parser.add_argument("--rows", action="store_true", help="fringes along the rows as well")
    parser.add_argument("--ideal", action="store_true", help="no noise, no blur of the camera, 16 bits, patterns that are not rounded")
    args = parser.parse_args()
    asked = [text.partition("=") for text in args.disturb]
    disturb = {name: float(amount) if amount else DISTURBANCES[name] for name, _, amount in asked}
    cell, patterns = RIGS[args.rig], Patterns(args.rows, disturb, args.ideal)
    eyes = {name: eye(*c[:4], SIZE, FOCAL) for name, c in cell["cameras"].items()}
    lights = {name: eye(*c, PROJECTOR, PROJECTOR_FOCAL) for name, c in cell["projectors"].items()}
    os.makedirs(args.folder, exist_ok=True)
    with open(f"{args.folder}/rig.toml", "w") as file:
        file.write(rig(cell, eyes, lights, args.ideal))
    waves = np.random.default_rng(9).normal(size=(4, 4)) * 2.0 if "texture" in disturb else np.zeros((0, 4))
    surface = np.array([disturb.get("gloss", 0.0), disturb.get("texture", 0.0), disturb.get("bright", 1.0)])
    methods = {method: ({}, {}, []) for method in (("phase", "projector") if args.method == "both" else (args.method,))}
    for seed in range(args.first, args.first + args.placements):
        turn, shift = place(seed)
        faces, seen = bodies(turn, shift), {}

        def pictures(name, projector):
            sigma = np.array([1e-3, 1e-3] if args.ideal else cell["cameras"][name][4])
            return picture(eyes[name].numbers, lights[projector].numbers, SIZE, args.fine, sigma, patterns.table, patterns.axis_of, *faces, surface, waves)

        with open(f"{args.folder}/p{seed}.plan.toml", "w") as file:
            file.write(plan(turn, shift))
        for number in range(args.recordings):
            folder = f"{args.folder}/p{seed}-{number}"
            if not (args.keep and os.path.exists(f"{folder}/recording.toml")):
                draw(folder, cell, patterns, disturb, args.ideal, pictures, seen, np.random.default_rng((seed, number)))
            for method, found in methods.items():
                measure(args, folder, method, faces, *found)
    for method, found in methods.items():
        report(method, *found)


if __name__ == "__main__":
    main()
