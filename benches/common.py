"""What several of these programs need: clouds of binary PLY, the program itself, arguments that they share. Needs numpy."""
import argparse
import subprocess

import numpy as np

TYPES = {"double": "<f8", "float": "<f4", "uint": "<u4", "int": "<i4", "uchar": "u1"}


def cloud(path):
    """Points of a binary PLY with all of its properties."""
    with open(path, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + 11
    fields, count = [], 0
    for words in (line.split() for line in data[:end].decode().splitlines()):
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words[0] == "property":
            fields.append((words[2], TYPES[words[1]]))
    return np.frombuffer(data, np.dtype(fields), count, end)


def places(points):
    """Positions of the points, mm."""
    return np.c_[points["x"], points["y"], points["z"]]


def run(*command, verdicts=(0,)):
    """What a command prints; ends with what it says where its exit code is none of the verdicts."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in verdicts:
        raise SystemExit(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


def arguments(about):
    """A parser of the program and the folder to work in."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fringetool")
    parser.add_argument("folder")
    parser.add_argument("--keep", action="store_true", help="use the pictures that are there")
    return parser
