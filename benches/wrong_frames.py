#!/usr/bin/env python3
"""Makes single frames of a recording wrong and counts what `fringetool decode` says and does.

    wrong_frames.py RECORDING CAMERA FIRST BITS [--fringetool PATH]

FIRST is the number of the code's first frame, BITS those of its frames that are made wrong in turn, as 1,3,5. Each becomes black, blurred,
shifted by 12 px, a copy of the frame before, exchanged with it, 30 DN brighter, half as bright, or covered on the left half. Orders are
compared with those of the recording as it is. Needs numpy and opencv.
"""
import argparse
import json
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np

KINDS = ["black", "blurred", "shifted", "twice", "swapped", "brighter", "dimmer", "hand"]


def spoiled(frames, i, kind):
    """Pictures by the number of the frame that they replace."""
    old = frames[i]
    covered = old.copy()
    covered[:, : old.shape[1] // 2] = 60
    return {
        "black": {i: np.full_like(old, 3)},
        "blurred": {i: cv2.GaussianBlur(old, (0, 0), 12)},
        "shifted": {i: np.roll(old, 12, 1)},
        "twice": {i: frames[i - 1]},
        "swapped": {i: frames[i - 1], i - 1: old},
        "brighter": {i: np.clip(old.astype(float) + 30, 0, 255).astype(np.uint8)},
        "dimmer": {i: (old * 0.5).astype(np.uint8)},
        "hand": {i: covered},
    }[kind]


def decoded(args, recording, folder):
    out, report = folder / "out", folder / "decode.json"
    shutil.rmtree(out, ignore_errors=True)
    command = [args.fringetool, "decode", str(recording), "--camera", args.camera, "--out", str(out), "--json", str(report)]
    ran = subprocess.run(command, capture_output=True, text=True)
    if ran.returncode != 0:
        return None, ran.stderr.strip()
    found = [fault["text"] for view in json.loads(report.read_text())["views"] for fault in view["findings"]]
    return np.load(next(out.glob("*-x-phase.npy"))), found


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("recording")
    arguments.add_argument("camera")
    arguments.add_argument("first", type=int)
    arguments.add_argument("bits")
    arguments.add_argument("--fringetool", default="fringetool")
    args = arguments.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy = folder / "recording"
        shutil.copytree(args.recording, copy)
        files = sorted(next((copy / "frames").iterdir()).joinpath(args.camera).glob("*.png"))
        frames = [cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in files]
        clean, _ = decoded(args, copy, folder)
        refused, named, silent = 0, [], []
        for kind in KINDS:
            for bit in (int(bit) for bit in args.bits.split(",")):
                changed = spoiled(frames, args.first + bit, kind)
                for i, picture in changed.items():
                    cv2.imwrite(str(files[i]), picture)
                phase, found = decoded(args, copy, folder)
                for i in changed:
                    cv2.imwrite(str(files[i]), frames[i])
                if phase is None:
                    refused += 1
                    print(f"{kind} {bit}: refused: {found}")
                    continue
                both = np.isfinite(phase) & np.isfinite(clean)
                wrong = np.mean(np.abs(phase[both] - clean[both]) > 3.0)
                (named if found else silent).append(wrong)
                print(f"{kind} {bit}: {100 * wrong:.2f} % of {both.sum()} pixels of {np.isfinite(clean).sum()} wrong; {found}")
    share = lambda list_: f"{len(list_)}, wrong {100 * statistics.median(list_):.2f} % (median), {100 * max(list_):.2f} % (most)" if list_ else "0"
    print(f"refused {refused}; named {share(named)}; not named {share(silent)}")


if __name__ == "__main__":
    main()
