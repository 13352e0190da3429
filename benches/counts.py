#!/usr/bin/env python3
"""Counts the instructions of each kernel with callgrind and compares them with those kept in benches/results/instructions.json.

    counts.py            # exits with 1 where a kernel takes 3 % more than it did; less is printed as well
    counts.py --dev      # the build of the tests, which CI has made anyway, with counts of its own
    counts.py --write    # keeps the counts of this build

Counts do not depend on what else the machine does, but on the compiler: another version of it is named, and then nothing is judged.
Needs valgrind, which knows no vectors wider than AVX2: the counts are those of that level, and a processor without it is not judged.
"""
import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "benches/results/instructions.json"
LIMIT = 0.03
# The features of the tests: with others, what they depend on would be compiled once more.
BUILDS = {"release": ["--release"], "dev": ["--features", "opcua"]}


def program(build):
    command = ["cargo", "build", "--bench", "counts", "--message-format", "json", *BUILDS[build]]
    lines = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    built = [json.loads(line) for line in lines if line.startswith("{")]
    return next(b["executable"] for b in built if b.get("executable") and b["target"]["name"] == "counts")


def count(path):
    """The instructions of each kernel; None where valgrind does not know one of them."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "counts")
        # Draws the frames, which would take longer under valgrind than all that is counted.
        subprocess.run([path, folder], check=True, stdout=subprocess.DEVNULL)
        command = ["valgrind", "--tool=callgrind", "--toggle-collect=*counted_*", f"--callgrind-out-file={out}", path, folder]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if "unhandled instruction" in done.stderr:
            return None
        if done.returncode != 0:
            sys.exit(f"{path}: failed under valgrind:\n{done.stderr}")
        command = ["callgrind_annotate", "--inclusive=yes", "--auto=no", "--threshold=100", out]
        lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        found = re.findall(r"^ *([\d,]+) .*:counts::counted_(\w+)", lines, re.M)
        counts = {}
        for total, name in found:
            counts[name] = max(counts.get(name, 0), int(total.replace(",", "")))
        if len(counts) != 4:
            sys.exit(f"{path}: {len(counts)} of 4 kernels were found")
        return counts


def kept_as(build):
    """What counts of a build are kept under: loops that are compiled for one level less are inlined elsewhere."""
    return build + " without AVX-512" * ("disable_dispatch_avx512" in os.environ.get("CARGO_BUILD_RUSTFLAGS", ""))


def not_judged(kept, compiler):
    """Why these counts and those kept cannot be compared, if they cannot."""
    if kept.get("compiler") != compiler:
        return f"kept for {kept.get('compiler')}, this is {compiler}; keep new counts with --write"
    if not re.search(r"\bavx2\b", Path("/proc/cpuinfo").read_text()):
        return "this processor has no AVX2, with which the kept ones were counted"
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--dev", action="store_const", dest="build", const="dev", default="release", help="count the build of the tests")
    parser.add_argument("--write", action="store_true", help="keep the counts of this build")
    args = parser.parse_args()
    compiler = subprocess.run(["rustc", "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
    counts = count(program(args.build))
    if counts is None:
        # Compilers and valgrind are versions apart: a move between registers that one writes, the other may not read.
        unknown = "valgrind does not know an instruction of this build; nothing was counted"
        if args.write:
            sys.exit(unknown)
        print(f"not judged: {unknown}")
        return
    all_kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    if args.write:
        all_kept[kept_as(args.build)] = {"compiler": compiler, "instructions": counts}
        KEPT.write_text(json.dumps(all_kept, indent=2, sort_keys=True) + "\n")
    kept = all_kept.get(kept_as(args.build), {})
    worse = []
    for name, now in sorted(counts.items()):
        before = kept.get("instructions", {}).get(name, now)
        print(f"{name:8} {now:>13,} instructions, {100 * (now / before - 1):+.1f} %")
        if now > before * (1 + LIMIT):
            worse.append(name)
    if reason := not_judged(kept, compiler):
        print(f"not judged: {reason}")
    elif worse:
        sys.exit(f"{', '.join(worse)}: more than {100 * LIMIT:.0f} % above {KEPT.name}; mend it, or keep the new counts with --write")


if __name__ == "__main__":
    main()
