#!/usr/bin/env python3
"""Error over stated uncertainty of `fringetool register` on the twin: the bracket of docs/first-measurement.md is simulated,
reconstructed and registered to its CAD data, with other noise and at another place each time.

    benches/register_pulls.py [--seeds 30] [--fringetool target/release/fringetool] [--smoothing 1 5]

The true pose is that of the twin's truth file. A pull is a shift or turn of the registered cloud, about its middle, over its
stated uncertainty; the root mean square over six parameters and all seeds is 1 where the uncertainty is right.
"""
import argparse
import json
import math
import pathlib
import subprocess
import tempfile
import tomllib

import numpy

ROOT = pathlib.Path(__file__).resolve().parent.parent


def run(*words):
    subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL, cwd=ROOT)


def truth_of(path):
    """World from part, by the twin: the cloud lies in the world, the mesh in the part."""
    pose = tomllib.loads(path.read_text())["world_from_part"]
    return numpy.array(pose["rotation"]), numpy.array(pose["translation_mm"])


def pulls(result, truth):
    """Six errors over their uncertainties, in the frame of the mesh, about the middle of the matches."""
    found = numpy.array(result["matrix"]).reshape(4, 4)
    world_from_part = numpy.eye(4)
    world_from_part[:3, :3], world_from_part[:3, 3] = truth
    off, middle = found @ world_from_part, numpy.array(result["centre_mm"])
    shift = off[:3, :3] @ middle + off[:3, 3] - middle
    turn = numpy.array([off[2, 1], off[0, 2], off[1, 0]])
    return numpy.concatenate([shift / result["u_translation_mm"], turn / result["u_rotation_rad"]])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--fringetool", default=ROOT / "target/release/fringetool")
    parser.add_argument("--smoothing", type=int, nargs="+", default=[1, 5])
    arguments = parser.parse_args()
    tool, mesh = arguments.fringetool, ROOT / "configs/bracket/bracket.stl"
    all_pulls = {side: [] for side in arguments.smoothing}
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for seed in range(arguments.seeds):
            recording = folder / f"r{seed}"
            run(tool, "simulate", "configs/bracket/pictures.toml", "--cycle", seed, "--out", recording)
            truth = truth_of(pathlib.Path(f"{recording}.truth.toml"))
            for side in arguments.smoothing:
                cloud, out, report = folder / "c.ply", folder / "o.ply", folder / "r.json"
                run(tool, "reconstruct", "--rig", "configs/demo-rig.toml", "--smoothing-px", side, "--force", "--out", cloud, recording)
                run(tool, "register", cloud, "--to", mesh, "--start", "search", "--force", "--out", out, "--json", report)
                result = json.loads(report.read_text())
                all_pulls[side].append(pulls(result, truth))
    for side, values in all_pulls.items():
        values = numpy.array(values)
        pull = math.sqrt((values**2).mean())
        each = ", ".join(f"{v:.2f}" for v in numpy.sqrt((values**2).mean(axis=0)))
        mean = ", ".join(f"{v:+.2f}" for v in values.mean(axis=0))
        print(f"smoothing {side} px: pull {pull:.3f} over {len(values)} seeds; by parameter {each}; mean {mean}")


main()
