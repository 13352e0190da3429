#!/usr/bin/env python3
"""Diameters of small spheres in pictures that another program draws: error, scatter and error over stated uncertainty.

    second_simulation.py FRINGETOOL FOLDER [--placements N] [--first N] [--no-noise] [--estimate] [--incidence DEG] [--period PX] [--steps N]
        [--texture SHARE] [--grain MM] [--vignetting SHARE] [--unequal SHARE]

Nothing of the program is used but its file formats. Rays are cast through pinholes with one radial coefficient; light is gathered at 4 x 4 places of each
pixel and spread by a Gaussian that differs from camera to camera (0.35 to 0.70 px) and grows towards the corners; the projector's levels have
8 bits, a gamma of 1.05 and its pixels' area. The cell: three cameras around one projector, two beside it and one in its azimuth, so that there the phase
hardly bends. The part: three spheres of 20 mm, together 2 % of a picture. The rig file states geometry, footprint (its mean and its growth over the
field, as a calibration finds them; --one-value leaves the growth out) and noise; --estimate leaves the latter two to the recording. Needs numpy, numba and Pillow.
"""
import json
import math
import os

import numba
import numpy as np
from PIL import Image
from common import arguments, run

SIZE, FOCAL = (1124, 750), 2330.0
PROJECTOR, PROJECTOR_FOCAL = (608, 684), 1500.0
# Azimuth, elevation, radial coefficient; blur along x and y in the middle, px; growth of the variance up to the corner, px2.
CAMERAS = {
    "cam1": (-14.0, 48.0, -0.08, (0.35, 0.40), 0.10),
    "cam2": (14.0, 48.0, -0.07, (0.70, 0.62), 0.0),
    "cam3": (0.0, 74.0, -0.06, (0.50, 0.50), 0.15),
}
PAIRS = {"beside": ("cam1", "cam2"), "azimuth1": ("cam3", "cam1"), "azimuth2": ("cam3", "cam2")}
DIAMETER = 20.0
CENTRES = np.array([[-14.0, -13.0, 2.0], [15.0, -9.0, -3.0], [-2.0, 15.0, 6.0]])
FINE, REACH = 4, 3
READ_DN, GAIN_DN, WHITE_DN = 0.4, 0.024, 190.0


class Eye:
    """A camera or projector at an azimuth and an elevation about the origin, 500 mm away."""

    def __init__(self, azimuth, elevation, size, focal, k1):
        a, e = math.radians(azimuth), math.radians(elevation)
        self.centre = 500.0 * np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
        forward = -self.centre / 500.0
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        self.axes = np.array([right, np.cross(forward, right), forward])
        self.size, self.focal, self.k1 = size, focal, k1
        self.middle = np.array([0.5 * size[0] + 2.3, 0.5 * size[1] - 3.1])

    def rays(self, x, y):
        seen = (np.stack([x, y], -1) - self.middle) / self.focal
        ideal = seen.copy()
        for _ in range(12):
            ideal = seen / (1.0 + self.k1 * (ideal**2).sum(-1, keepdims=True))
        rays = np.concatenate([ideal, np.ones(ideal.shape[:-1] + (1,))], -1) @ self.axes
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def pixels(self, points):
        at = (points - self.centre) @ self.axes.T
        ideal = at[..., :2] / at[..., 2:]
        return self.focal * ideal * (1.0 + self.k1 * (ideal**2).sum(-1, keepdims=True)) + self.middle

    def toml(self, kind, name, more=""):
        rows = ", ".join(str([float(v) for v in row]) for row in self.axes)
        shift = [float(v) for v in -self.axes @ self.centre]
        return (
            f'[[{kind}]]\nname = "{name}"\nwidth_px = {self.size[0]}\nheight_px = {self.size[1]}\nfocal_px = [{self.focal}, {self.focal}]\n'
            f"principal_point_px = [{self.middle[0]}, {self.middle[1]}]\n{more}"
            f'distortion = {{ model = "brown-conrady", k = [{self.k1}, 0.0, 0.0], p = [0.0, 0.0] }}\n'
            f"from_world = {{ rotation = [{rows}], translation_mm = {shift} }}\n\n"
        )


def nearest(origin, rays, centres, radius):
    """Length of each ray to the first sphere; infinite where it meets none."""
    best = np.full(rays.shape[:-1], np.inf)
    which = np.full(rays.shape[:-1], -1)
    for i, centre in enumerate(centres):
        to = centre - origin
        along = rays @ to
        square = radius**2 - (to**2).sum(-1) + along**2
        length = along - np.sqrt(np.maximum(square, 0.0))
        hit = (square > 0) & (length > 1e-3) & (length < best)
        best, which = np.where(hit, length, best), np.where(hit, i, which)
    return best, which


def lit(points, normals, light, centres, radius):
    """Share of the projector's light that a place throws back, 0 in the shade."""
    to = light - points
    far = np.linalg.norm(to, axis=-1)
    cosine = (normals * to).sum(-1) / far
    shade = np.zeros(far.shape, bool)
    for centre in centres:
        away = centre - points
        along = (away * to).sum(-1) / far
        shade |= (along > 1e-3) & ((away**2).sum(-1) - along**2 < (radius - 1e-9) ** 2) & ((away**2).sum(-1) > radius**2 * 1.0001)
    return np.where(shade, 0.0, np.maximum(cosine, 0.0)) * (500.0 / far) ** 2


class Sequence:
    """Fringes of so many columns in so many steps, and a Gray code of stripes of half a fringe."""

    def __init__(self, period, steps):
        self.period, self.steps, self.stripe = period, steps, period / 2
        self.bits = math.ceil(math.log2(PROJECTOR[0] / self.stripe))

    def toml(self):
        return (
            f'sequence = [\n  {{ set = "sine", axis = "x", period_px = {self.period}, steps = {self.steps} }},\n'
            f'  {{ set = "gray", axis = "x", bits = {self.bits}, stripe_px = {self.stripe} }},\n  {{ set = "white" }}, {{ set = "black" }},\n]\n'
        )


def patterns(sequence):
    """Light over the projector's columns of each frame, at 32 places of a column, from half a column before the first."""
    columns = np.arange(PROJECTOR[0])
    frames = [0.5 + 0.5 * np.cos(2 * np.pi * (columns / sequence.period - i / sequence.steps)) for i in range(sequence.steps)]
    stripe = (columns // sequence.stripe).astype(int)
    gray = stripe ^ (stripe >> 1)
    frames += [(gray >> (sequence.bits - 1 - bit)) & 1 for bit in range(sequence.bits)]
    frames += [np.ones(PROJECTOR[0]), np.zeros(PROJECTOR[0])]
    out = []
    kernel = np.exp(-0.5 * (np.arange(-128, 129) / 32 / 0.6) ** 2)
    kernel /= kernel.sum()
    for frame in frames:
        level = (np.round(255 * np.asarray(frame, float)) / 255) ** 1.05
        out.append(np.convolve(np.pad(np.repeat(level, 32), 128, mode="edge"), kernel, mode="valid"))
    return np.array(out)


@numba.njit(cache=True, fastmath=False)
def gather(share, column, table, first, fine_shape, pixels, sigma_x, sigma_y, out):
    """Pixels of all frames from light at fine places, each through its own point spread and its area."""
    frames = table.shape[0]
    half = REACH * FINE
    size = 2 * half + FINE
    wx, wy = np.zeros(size), np.zeros(size)
    for p in range(pixels.shape[0]):
        for weights, sigma in ((wx, sigma_x[p]), (wy, sigma_y[p])):
            total = 0.0
            for k in range(size):
                at = (k - half + 0.5) / FINE - 0.5
                value = math.erf((at + 0.5) / (math.sqrt(2.0) * sigma)) - math.erf((at - 0.5) / (math.sqrt(2.0) * sigma))
                weights[k] = value
                total += value
            for k in range(size):
                weights[k] /= total
        x0, y0 = (pixels[p, 0] - first[0] - REACH) * FINE, (pixels[p, 1] - first[1] - REACH) * FINE
        for f in range(frames):
            out[f, p] = 0.0
        for j in range(size):
            for i in range(size):
                at = (y0 + j) * fine_shape[1] + x0 + i
                if share[at] <= 0.0:
                    continue
                weight = wx[i] * wy[j] * share[at]
                place = (column[at] + 0.5) * 32 - 0.5
                low = int(math.floor(place))
                if low < 0 or low + 1 >= table.shape[1]:
                    continue
                part = place - low
                for f in range(frames):
                    out[f, p] += weight * (table[f, low] * (1 - part) + table[f, low + 1] * part)


class Optics:
    """What paint, lens and sensor do to the light: a texture of two grains, a picture that darkens towards its corners, pixels of unequal gain."""

    def __init__(self, texture, grain_mm, vignetting, unequal):
        self.texture, self.grain_mm, self.vignetting, self.unequal = texture, grain_mm, vignetting, unequal
        self.lattice = np.random.default_rng(77).normal(size=(64, 64, 64))

    def albedo(self, places, sphere):
        """Relative reflectance at places of spheres, mm from their centres."""
        if self.texture == 0.0:
            return 1.0
        values = sum(self.between(places / grain + 17.3 * (sphere[:, None] + 1)) for grain in (self.grain_mm, 4 * self.grain_mm))
        return np.maximum(1.0 + self.texture * values, 0.05)

    def between(self, places):
        """Lattice of random numbers, linear between its places; its standard deviation is about a half."""
        low = np.floor(places).astype(int)
        part = places - low
        total = np.zeros(len(places))
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, part, 1 - part), -1)
            x, y, z = ((low + corner) % 64).T
            total += weight * self.lattice[x, y, z]
        return total

    def gains(self, name):
        """Relative gain of each pixel of a camera, the same in every placement."""
        x, y = np.meshgrid(np.linspace(-1, 1, SIZE[0]), np.linspace(-1, 1, SIZE[1]))
        each = np.random.default_rng(list(name.encode())).normal(size=SIZE[::-1])
        return (1.0 - self.vignetting * 0.5 * (x**2 + y**2)) * (1.0 + self.unequal * each)


def picture(name, eye, light, table, centres, rng, noise, optics):
    """All frames of a camera."""
    _, _, _, sigma, growth = CAMERAS[name]
    frames = np.zeros((len(table), eye.size[1], eye.size[0]))
    middles = eye.pixels(centres)
    reach = 0.5 * DIAMETER * eye.focal / 480.0 + 3
    corner = (np.array(eye.size) / 2) @ (np.array(eye.size) / 2)
    for middle in middles:
        low, high = np.floor(middle - reach).astype(int), np.ceil(middle + reach).astype(int)
        first, size = low - REACH, high - low + 1 + 2 * REACH
        x = first[0] - 0.5 + (np.arange(size[0] * FINE) + 0.5) / FINE
        y = first[1] - 0.5 + (np.arange(size[1] * FINE) + 0.5) / FINE
        gx, gy = np.meshgrid(x, y)
        rays = eye.rays(gx.ravel(), gy.ravel())
        length, which = nearest(eye.centre, rays, centres, 0.5 * DIAMETER)
        hit = which >= 0
        share, column = np.zeros(len(rays)), np.zeros(len(rays))
        points = eye.centre + rays[hit] * length[hit, None]
        normals = (points - centres[which[hit]]) / (0.5 * DIAMETER)
        share[hit] = lit(points, normals, light.centre, centres, 0.5 * DIAMETER) * optics.albedo(points - centres[which[hit]], which[hit])
        column[hit] = light.pixels(points)[:, 0]
        px, py = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        pixels = np.stack([px.ravel(), py.ravel()], -1)
        field = ((pixels - np.array(eye.size) / 2) ** 2).sum(-1) / corner
        sx, sy = (np.sqrt(s**2 + growth * field) for s in sigma)
        out = np.zeros((len(table), len(pixels)))
        gather(share, column, table, first, np.array([len(y), len(x)]), pixels, sx, sy, out)
        # Spheres whose windows overlap are drawn in full in each: the brighter counts.
        old = frames[:, pixels[:, 1], pixels[:, 0]]
        frames[:, pixels[:, 1], pixels[:, 0]] = np.maximum(old, out)
    frames = 3.0 + WHITE_DN * frames * optics.gains(name)
    if noise:
        frames += rng.normal(size=frames.shape) * np.sqrt(READ_DN**2 - 1 / 12 + GAIN_DN * frames)
    return np.clip(np.round(frames), 0, 255).astype(np.uint8)


def rig(eyes, light, estimate, one_value):
    text = 'format = "fringecell-rig/1"\n\n'
    for name, (_, _, _, sigma, growth) in CAMERAS.items():
        # Over the field the mean of r2 over that of the corner is a third.
        mean = [math.sqrt(s**2 + growth / 3 + 1 / 12) for s in sigma]
        field = "" if one_value else f"footprint_field_px2 = {growth}\n"
        more = f"footprint_px = {mean}\n{field}noise = {{ read_dn = {READ_DN}, gain_dn = {GAIN_DN} }}\n"
        text += eyes[name].toml("camera", name, "" if estimate else more)
    text += light.toml("projector", "proj1")
    for pair, (left, right) in PAIRS.items():
        text += f'[[pair]]\nname = "{pair}"\nleft = "{left}"\nright = "{right}"\nprojector = "proj1"\n\n'
    return text


def recording(folder, eyes, light, sequence, table, centres, rng, noise, optics):
    os.makedirs(folder, exist_ok=True)
    for name in CAMERAS:
        place = f"{folder}/frames/proj1/{name}"
        os.makedirs(place, exist_ok=True)
        for number, frame in enumerate(picture(name, eyes[name], light, table, centres, rng, noise, optics)):
            Image.fromarray(frame).save(f"{place}/{number:03}.png", compress_level=1)
    names = ", ".join(f'"{name}"' for name in CAMERAS)
    with open(f"{folder}/recording.toml", "w") as file:
        file.write(
            f'format = "fringecell-recording/1"\n[[projector]]\nname = "proj1"\nwidth_px = {PROJECTOR[0]}\nheight_px = {PROJECTOR[1]}\ncameras = [{names}]\n{sequence.toml()}'
        )


def plan(path, centres):
    text = 'format = "fringecell-plan/1"\nname = "spheres"\n\n'
    for i, centre in enumerate(centres, 1):
        text += (
            f'[[element]]\nkind = "sphere"\nname = "s{i}"\ncenter_mm = {[float(v) for v in centre]}\ndiameter_mm = {DIAMETER}\nmax_polar_deg = 110.0\n'
            f"margin_mm = 0.8\nnormal_tolerance_deg = 25.0\nmin_points = 200\nmax_reject_fraction = 0.003\n\n"
        )
    for i in range(1, len(centres) + 1):
        text += f'[[feature]]\nkind = "sphere-diameter"\nname = "d{i}"\nelement = "s{i}"\nnominal_mm = {DIAMETER}\ntolerance_mm = [-1.0, 1.0]\n\n'
    with open(path, "w") as file:
        file.write(text)


def configuration(path, rig_path, sequence, incidence):
    """What `reconstruct` needs to leave out points seen more steeply than that."""
    cameras = "".join(f'[[camera]]\nname = "{name}"\ndriver = "twin"\n' for name in CAMERAS)
    names = ", ".join(f'"{name}"' for name in CAMERAS)
    scene = os.path.abspath(os.path.join(os.path.dirname(__file__), "..", "configs", "sphere.scene.toml"))
    with open(path, "w") as file:
        file.write(
            f'format = "fringecell-config/1"\nname = "second"\nrig = "{os.path.basename(rig_path)}"\n[[projector]]\nname = "proj1"\ndriver = "twin"\n'
            f"width_px = {PROJECTOR[0]}\nheight_px = {PROJECTOR[1]}\ncameras = [{names}]\n{sequence.toml()}"
            f'{cameras}[twin]\nscene = "{scene}"\n[matching.surface]\nmax_incidence_deg = {incidence}\n'
        )


def main():
    parser = arguments(__doc__)
    parser.add_argument("--placements", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--no-noise", action="store_true")
    parser.add_argument("--estimate", action="store_true")
    parser.add_argument("--one-value", action="store_true", help="state the footprint as its mean over the field only")
    parser.add_argument("--incidence", type=float, default=70.0, help="max_incidence_deg of the reconstruction")
    parser.add_argument("--period", type=float, default=16.0, help="columns of a fringe")
    parser.add_argument("--steps", type=int, default=10)
    parser.add_argument("--texture", type=float, default=0.0, help="standard deviation of the reflectance, about")
    parser.add_argument("--grain", type=float, default=0.3, help="grain of the texture, mm (a pixel sees 0.21); a second one is four times as coarse")
    parser.add_argument("--vignetting", type=float, default=0.0, help="share of the light that the corners lose")
    parser.add_argument("--unequal", type=float, default=0.0, help="standard deviation of the pixels' gain")
    args = parser.parse_args()
    optics = Optics(args.texture, args.grain, args.vignetting, args.unequal)
    sequence = Sequence(args.period, args.steps)
    os.makedirs(args.folder, exist_ok=True)
    eyes = {name: Eye(a, e, SIZE, FOCAL, k1) for name, (a, e, k1, _, _) in CAMERAS.items()}
    light = Eye(0.0, 48.0, PROJECTOR, PROJECTOR_FOCAL, 0.0)
    table = patterns(sequence)
    rig_path = f"{args.folder}/{'estimate' if args.estimate else 'rig'}.toml"
    with open(rig_path, "w") as file:
        file.write(rig(eyes, light, args.estimate, args.one_value))
    configuration(f"{args.folder}/cell.toml", rig_path, sequence, args.incidence)
    # Each pair alone, and all of them fused.
    clouds = {**{pair: ("--pair", pair) for pair in PAIRS}, "fused": ()}
    found = {cloud: [] for cloud in clouds}
    for number in range(args.first, args.first + args.placements):
        rng = np.random.default_rng(number)
        angle, shift = rng.uniform(0, 2 * np.pi), rng.uniform(-12, 12, 3)
        turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]])
        centres = CENTRES @ turn.T + shift
        folder = f"{args.folder}/p{number}"
        if not (args.keep and os.path.exists(f"{folder}/recording.toml")):
            recording(folder, eyes, light, sequence, table, centres, rng, not args.no_noise, optics)
        plan(f"{folder}.plan.toml", centres)
        for cloud, pair in clouds.items():
            ply, out = f"{folder}-{cloud}.ply", f"{folder}-{cloud}.json"
            run(args.fringetool, "reconstruct", "--config", f"{args.folder}/cell.toml", *pair, "--out", ply, "--force", folder)
            run(args.fringetool, "measure", f"{folder}.plan.toml", ply, "--json", out, "--force", verdicts=(0, 1))
            with open(out) as file:
                features = json.load(file)["features"]
            for feature in features:
                if feature.get("value") is not None:
                    found[cloud].append((1e3 * (feature["value"] - DIAMETER), 1e3 * feature["u"]))
    print("cloud: spheres, mean error, scatter, stated u (rms), rms of error over u; um")
    for cloud, values in found.items():
        if values:
            error, u = np.array(values).T
            scatter = error.std(ddof=1) if len(error) > 1 else 0.0
            ratio = math.sqrt(np.mean((error / u) ** 2))
            print(f"{cloud}: {len(error)}, {error.mean():+.2f}, {scatter:.2f}, {math.sqrt(np.mean(u**2)):.2f}, {ratio:.2f}")


if __name__ == "__main__":
    main()
