#!/usr/bin/env python3
"""Counts the instructions of each kernel with callgrind and compares them with those kept in benches/results/instructions.json.

    counts.py            # exits with 1 where a kernel takes 3 % more than it did; less is printed as well
    counts.py --write    # keeps the counts of this build

Counts do not depend on what else the machine does, but on the compiler: another version of it is named, and then nothing is judged.
Needs valgrind, which knows no vectors wider than AVX2: the counts are those of that level.
"""
import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "benches/results/instructions.json"
LIMIT = 0.03


def program():
    command = ["cargo", "build", "--release", "--bench", "counts", "--message-format", "json"]
    lines = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    built = [json.loads(line) for line in lines if line.startswith("{")]
    return next(b["executable"] for b in built if b.get("executable") and b["target"]["name"] == "counts")


def count(path):
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "counts")
        command = ["valgrind", "--tool=callgrind", "--toggle-collect=*counted_*", f"--callgrind-out-file={out}", path]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true")
    write = parser.parse_args().write
    compiler = subprocess.run(["rustc", "--version"], check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
    counts = count(program())
    if write:
        KEPT.parent.mkdir(exist_ok=True)
        KEPT.write_text(json.dumps({"compiler": compiler, "instructions": counts}, indent=2) + "\n")
    kept = json.loads(KEPT.read_text())
    worse = []
    for name, now in counts.items():
        before = kept["instructions"].get(name, now)
        print(f"{name:8} {now:>13,} instructions, {100 * (now / before - 1):+.1f} %")
        if now > before * (1 + LIMIT):
            worse.append(name)
    if kept["compiler"] != compiler:
        print(f"kept for {kept['compiler']}, this is {compiler}: not judged; keep new counts with --write")
    elif worse:
        sys.exit(f"{', '.join(worse)}: more than {100 * LIMIT:.0f} % above {KEPT.name}; mend it, or keep the new counts with --write")


if __name__ == "__main__":
    main()
