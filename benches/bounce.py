#!/usr/bin/env python3
"""What light that bounces between faces does to points, and what `max_bounce_rad` finds of it, on the digital twin.

    bounce.py FRINGETOOL FOLDER [--rays N] [--limit RAD] [--width PX] [--keep]

Two parts, that of the demo and a groove of 84 degrees, before the demo's cell, each with and without the first bounce, with and without noise. The
error of a point is its distance along the normal from the point of the same pixel in the picture without noise and bounce. Wrong are points that bounce
alone, without noise, moves by more than three of the uncertainties stated without any test; flagged are those whose uncertainty is a tenth or more above
that of the same pixel without bounce. A false alarm of `max_bounce_rad` is a point of the picture without bounce that it flags or leaves out; one of the second
witness, that pairs disagree, is a point there with a raised uncertainty that is within two of the uncertainties that its pair alone states. Needs numpy.
"""
import json
import os
import re
import tomllib

import numpy as np
from common import arguments, cloud, places, run

HERE = os.path.dirname(os.path.abspath(__file__))
CONFIGS = os.path.join(HERE, "..", "configs")
GROOVE = """format = "fringecell-scene/1"
name = "groove"

[[material]]
name = "matte"
albedo = 0.7
texture = 0.03
texture_mm = 0.5

[[body]]
name = "left"
material = "matte"
position_mm = [-20.5, 0.0, 20.0]
rotation_deg = [0.0, 92.0, 0.0]
geometry = { shape = "plane", size_mm = [60.0, 80.0], thickness_mm = 3.0 }

[[body]]
name = "right"
material = "matte"
position_mm = [20.5, 0.0, 20.0]
rotation_deg = [0.0, 8.0, 0.0]
geometry = { shape = "plane", size_mm = [60.0, 80.0], thickness_mm = 3.0 }
"""
CLEAN = "shot_noise = false\nread_noise_e = 0.0\nbits = 16\nvibration_um = 0.0\n"


def scaled_rig(width, path):
    """The demo's rig with cameras of another width."""
    with open(os.path.join(CONFIGS, "demo-rig.toml")) as file:
        lines = file.read().splitlines()
    part, camera, out = width / 1124, False, []
    for line in lines:
        if line.startswith("[["):
            camera = line == "[[camera]]"
        size = re.match(r"(width|height)_px = (\d+)", line)
        pair = re.match(r"(focal_px|principal_point_px) = \[(.*), (.*)\]", line)
        if camera and size:
            line = f"{size[1]}_px = {round(int(size[2]) * part)}"
        if camera and pair:
            half = 0.5 if pair[1].startswith("principal") else 0.0
            line = f"{pair[1]} = [{(float(pair[2]) + half) * part - half}, {(float(pair[3]) + half) * part - half}]"
        out.append(line)
    with open(path, "w") as file:
        file.write("\n".join(out) + "\n")


def configuration(path, scene, clean, rays, limit, more=""):
    with open(os.path.join(CONFIGS, "demo.toml")) as file:
        text = file.read()
    text = text.replace('"demo-rig.toml"', '"rig.toml"').replace('"complex-artefact.scene.toml"', f'"{scene}"')
    text = re.sub(r"plan = .*\n", "", text)
    text += f"\n[twin.settings]\nbounce_rays = {rays}\n{CLEAN if clean else ''}\n[decode]\nmax_bounce_rad = {limit}\n{more}"
    with open(path, "w") as file:
        file.write(text)


class View:
    """Depth along the ray, normal's share of it and uncertainty of each pixel of a pair's first camera; NaN where there is no point."""

    def __init__(self, points, camera):
        rotation, shift = np.array(camera["from_world"]["rotation"]), np.array(camera["from_world"]["translation_mm"])
        place = places(points)
        normal = np.c_[points["nx"], points["ny"], points["nz"]]
        at = place @ rotation.T + shift
        x, y = at[:, 0] / at[:, 2], at[:, 1] / at[:, 2]
        k, p = camera["distortion"]["k"], camera["distortion"]["p"]
        r2 = x * x + y * y
        radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))
        u = x * radial + 2 * p[0] * x * y + p[1] * (r2 + 2 * x * x)
        v = y * radial + p[0] * (r2 + 2 * y * y) + 2 * p[1] * x * y
        column = np.rint(camera["focal_px"][0] * u + camera["principal_point_px"][0]).astype(int)
        row = np.rint(camera["focal_px"][1] * v + camera["principal_point_px"][1]).astype(int)
        far = np.linalg.norm(at, axis=1)
        cosine = np.abs(((place + rotation.T @ shift) / far[:, None] * normal).sum(1))
        self.planes = np.full((3, camera["height_px"], camera["width_px"]), np.nan)
        name = "sigma_mm" if "sigma_mm" in points.dtype.names else next(n for n in points.dtype.names if "sigma" in n)
        self.planes[:, row, column] = far, cosine, points[name]


def stated(u, quiet):
    """Uncertainty that points would state without any test: that of the same pixels without bounce, as far as light changes it."""
    ratio = u / quiet
    return quiet * np.nanmedian(ratio[ratio < 1.3])


def views(path, rig):
    points = cloud(path)
    cameras = {camera["name"]: camera for camera in rig["camera"]}
    name = next(n for n in points.dtype.names if "pair" in n)
    return [View(points[points[name] == i], cameras[pair["left"]]) for i, pair in enumerate(rig["pair"])]


def planes(views):
    return np.concatenate([view.planes.reshape(3, -1) for view in views], axis=1)


def false_alarms(args, here, rig, part, ideal, told):
    """Share of the points of the noisy picture without bounce whose uncertainty is raised though they err by less than two of those that their pair states."""
    config, name = here(f"{part}-alone.toml"), here(f"{part}-noisy-0")
    configuration(config, f"{part}.scene.toml", False, 0, args.limit, "[fusion]\nmin_overlap_neighbours = 1000000\n")
    run(args.fringetool, "reconstruct", "--config", config, name, "--out", f"{name}-alone.ply", "--force")
    far, cosine, u = planes(views(f"{name}-alone.ply", rig))
    right = abs(far - ideal[0]) * cosine < 2 * u
    return ((told[2] > 1.001 * u) & right).sum() / np.isfinite(u).sum()


def judged(part, found, rays, limit, disagreeing=None, alarms=""):
    """Prints what bounce did to the points; `found` has planes by: without noise or not, rays of the bounce (0: none), `max_bounce_rad`."""
    ideal = found[True, 0, 0.0]
    rms = {}
    for bounce in (0, rays):
        for tested in (0.0, limit):
            far, cosine, u = found[False, bounce, tested]
            error = (far - ideal[0]) * cosine
            error, u = error[np.isfinite(error)], u[np.isfinite(error)]
            # Wrong orders and edges, beyond a millimetre, count as wrong, but not in the root mean square.
            rms[bounce, tested] = 1e3 * np.sqrt(np.mean(error[abs(error) < 1] ** 2))
            wrong = 100 * np.mean(abs(error) > 3 * u)
            pairs = f", {100 * disagreeing[False, bounce, tested] / np.isfinite(far).sum():.2f}" if disagreeing else ""
            print(f"{part}, {bounce} rays, {tested}: {np.isfinite(far).sum()}, {rms[bounce, tested]:.1f}, {wrong:.2f}, {1e3 * np.median(u):.1f}{pairs}")
    by_bounce = [np.sqrt(max(rms[rays, l] ** 2 - rms[0, l] ** 2, 0.0)) for l in (0.0, limit)]
    # What bounce does without noise, over the uncertainty stated where the test is off.
    moved = (found[True, rays, 0.0][0] - ideal[0]) * ideal[1]
    plain, tested = found[False, rays, 0.0], found[False, rays, limit]
    quiet, quiet_tested = found[False, 0, 0.0][2], found[False, 0, limit][2]
    known = np.isfinite(moved) & np.isfinite(plain[2]) & np.isfinite(quiet)
    wrong = known & (abs(moved) > 3 * stated(plain[2], quiet))
    flagged = ~(tested[2] < 1.1 * stated(tested[2], quiet))
    there = np.isfinite(quiet)
    false, lost = (~(quiet_tested < 1.1 * quiet))[there].mean(), np.isnan(quiet_tested[there]).mean()
    lying = known & (abs(moved) > 3 * tested[2])
    print(
        f"{part}: bounce moves points by {by_bounce[0]:.1f} um rms, delivered ones by {by_bounce[1]:.1f} um; of {wrong.sum()} wrong points "
        f"{100 * (wrong & flagged).sum() / max(wrong.sum(), 1):.1f} % flagged or left out, {100 * (wrong & np.isnan(tested[2])).sum() / max(wrong.sum(), 1):.1f} % left out; "
        f"{100 * lying.sum() / np.isfinite(tested[2]).sum():.2f} % of the delivered ones moved by more than 3 u; of the others "
        f"{100 * (known & ~wrong & flagged).sum() / max((known & ~wrong).sum(), 1):.1f} % flagged; without bounce {100 * false:.2f} % of the points flagged or left out, {100 * lost:.2f} % left out{alarms}"
    )


def main():
    parser = arguments(__doc__)
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--limit", type=float, default=0.05)
    parser.add_argument("--width", type=int, default=1124)
    parser.add_argument("--part", choices=["demo", "groove"], action="append")
    args = parser.parse_args()
    os.makedirs(args.folder, exist_ok=True)
    here = lambda name: os.path.join(args.folder, name)
    scaled_rig(args.width, here("rig.toml"))
    with open(here("rig.toml"), "rb") as file:
        rig = tomllib.load(file)
    with open(here("groove.scene.toml"), "w") as file:
        file.write(GROOVE)
    with open(os.path.join(CONFIGS, "complex-artefact.scene.toml")) as source, open(here("demo.scene.toml"), "w") as file:
        file.write(source.read())
    print("part, bounce, max_bounce_rad: points, rms error um, wrong by more than 3 u %, median u um, where pairs disagree %")
    for part in args.part or ("demo", "groove"):
        found, disagreeing = {}, {}
        for clean in (True, False):
            for rays in (0, args.rays):
                name = here(f"{part}-{'clean' if clean else 'noisy'}-{rays}")
                for limit in (0.0,) if clean else (0.0, args.limit):
                    config = here(f"{part}-{clean}-{rays}-{limit}.toml")
                    configuration(config, f"{part}.scene.toml", clean, rays, limit)
                    if limit == 0.0 and not (args.keep and os.path.exists(f"{name}/recording.toml")):
                        run("rm", "-rf", name)
                        run(args.fringetool, "simulate", config, "--out", name)
                    ply = f"{name}-{limit}.ply"
                    told = f"{name}-{limit}.json"
                    run(args.fringetool, "reconstruct", "--config", config, name, "--out", ply, "--json", told, "--force")
                    found[clean, rays, limit] = planes(views(ply, rig))
                    with open(told) as file:
                        disagreeing[clean, rays, limit] = json.load(file)["fusion"]["disagreeing"]
        falsely = false_alarms(args, here, rig, part, found[True, 0, 0.0], found[False, 0, args.limit])
        judged(part, found, args.rays, args.limit, disagreeing, f", {100 * falsely:.2f} % falsely where pairs disagree")


if __name__ == "__main__":
    main()
