#!/usr/bin/env python3
"""Reference fits of every element and criterion, independent of the crate: 50 digits, other parameters, other algorithms.

Least squares: Gauss and Newton with 50 digits (mpmath). Minimum zone, maximum inscribed, minimum circumscribed: SLSQP (SciPy)
finds the points that touch, Newton's method with 50 digits solves the conditions of Karush, Kuhn and Tucker on them; a
multiplier below zero, or a point beyond, stops the program. The narrowest strip and slab are the least over all pairs and triples.

    pip install mpmath scipy
    benches/reference_fits.py > shared/metrology/src/fit/tests/independent.json
"""
import itertools
import json
import math
import sys

import mpmath
import numpy
from mpmath import mp
from scipy.optimize import minimize, nnls

mp.dps = 50
COUNT = 24


def frame(random):
    """A random frame with 50 digits: origin, three unit directions."""
    u, v = (mpmath.matrix([mp.mpf(x) for x in random.normal(size=3)]) for _ in range(2))
    w = unit(u)
    v = unit(v - w * dot(w, v))
    return mpmath.matrix([mp.mpf(round(x, 3)) for x in random.uniform(-200, 200, 3)]), [v, cross(w, v), w]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def cross(a, b):
    return mpmath.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def unit(a):
    return a / mp.sqrt(dot(a, a))


# Signed distances in the frame of an element, for numbers of any kind: `m` is math or mpmath.

def axial(m, q, p):
    """Distance from the axis through (q0, q1, 0) along (q2, q3, 1), and the height along it."""
    length = m.sqrt(q[2] * q[2] + q[3] * q[3] + 1)
    x, y, z = p[0] - q[0], p[1] - q[1], p[2]
    height = (x * q[2] + y * q[3] + z) / length
    square = x * x + y * y + z * z - height * height
    return m.sqrt(square if square > 0 else square * 0), height


def sphere(m, q, p):
    return [m.sqrt(sum((p[i] - q[i]) ** 2 for i in range(3))) - q[3]]


def plane(m, q, p):
    return [(q[0] * p[0] + q[1] * p[1] + p[2] - q[2]) / m.sqrt(1 + q[0] ** 2 + q[1] ** 2)]


def cylinder(m, q, p):
    return [axial(m, q, p)[0] - q[4]]


def cone(m, q, p):
    radius, height = axial(m, q, p)
    return [(radius - q[4]) * m.cos(q[5]) - height * m.sin(q[5])]


def torus(m, q, p):
    radius, height = axial(m, [q[0], q[1], q[3], q[4]], [p[0], p[1], p[2] - q[2]])
    return [m.sqrt((radius - q[5]) ** 2 + height**2) - q[6]]


def circle(m, q, p):
    radius, height = axial(m, [q[0], q[1], q[3], q[4]], [p[0], p[1], p[2] - q[2]])
    return [radius - q[5], height]


def line(m, q, p):
    length = m.sqrt(q[2] * q[2] + q[3] * q[3] + 1)
    d = [q[2] / length, q[3] / length, 1 / length]
    a = [p[0] - q[0], p[1] - q[1], p[2]]
    return [a[1] * d[2] - a[2] * d[1], a[2] * d[0] - a[0] * d[2], a[0] * d[1] - a[1] * d[0]]


def ring(m, q, p):
    return [m.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2) - q[2]]


def turned(m, q, p):
    sin, cos = m.sin(q[2]), m.cos(q[2])
    x, y = p[0] - q[0], p[1] - q[1]
    return x * cos + y * sin, y * cos - x * sin


def slot(m, q, p):
    u, v = turned(m, q, p)
    beyond = abs(u) - q[3]
    return [abs(v) - q[4] if beyond <= 0 else m.sqrt(beyond * beyond + v * v) - q[4]]


def rectangle(m, q, p):
    u, v = turned(m, q, p)
    # The side of a point stands as its third coordinate: across the length, or along it.
    return [abs(u) - q[3] if p[2] == 1 else abs(v) - q[4]]


def edge(m, q, p):
    return [p[1] * m.cos(q[1]) - p[0] * m.sin(q[1]) - q[0]]


def least_squares(residual, start, points):
    """Gauss and Newton until nothing moves in 40 digits."""
    q, step = [mp.mpf(x) for x in start], mp.mpf(10) ** -18
    for _ in range(200):
        rows, right = [], []
        for p in points:
            here = residual(mp, q, p)
            ends = []
            for k in range(len(q)):
                high, low = list(q), list(q)
                high[k], low[k] = high[k] + step, low[k] - step
                ends.append([(a - b) / (2 * step) for a, b in zip(residual(mp, high, p), residual(mp, low, p))])
            for i, value in enumerate(here):
                rows.append([column[i] for column in ends])
                right.append(-value)
        a, b = mpmath.matrix(rows), mpmath.matrix(right)
        move = mpmath.lu_solve(a.T * a, a.T * b)
        q = [x + d for x, d in zip(q, move)]
        if max(abs(d) for d in move) < mp.mpf(10) ** -30:
            return q
    sys.exit("Gauss and Newton do not settle")


def extremal(bounds, start):
    """Least t with f(q) <= t for all f: parameters and t, by the conditions of Karush, Kuhn and Tucker."""
    size = len(start)
    values = lambda q: numpy.array([float(f(math, q)) for f in bounds])
    scaled = [{"type": "ineq", "fun": lambda x: x[-1] - values(x[:-1])}]
    first = numpy.append(numpy.array([float(x) for x in start]), values([float(x) for x in start]).max())
    found = minimize(lambda x: x[-1], first, method="SLSQP", constraints=scaled, options={"ftol": 1e-16, "maxiter": 2000})
    q, t = found.x[:-1], values(found.x[:-1]).max()
    touching = [i for i, value in enumerate(values(q)) if value > t - 1e-6]
    gradient = lambda m, f, q, h: [(f(m, bumped(q, k, h)) - f(m, bumped(q, k, -h))) / (2 * h) for k in range(size)]
    slopes = numpy.array([[float(g) for g in gradient(math, bounds[i], list(q), 1e-6)] + [1.0] for i in touching]).T
    weights, _ = nnls(slopes, numpy.append(numpy.zeros(size), 1.0))
    touching = [i for i, weight in zip(touching, weights) if weight > 1e-9]
    weights = [weight for weight in weights if weight > 1e-9]
    tiny = mp.mpf(10) ** -18

    def conditions(*x):
        q, t, weights = list(x[:size]), x[size], x[size + 1 :]
        slopes = [gradient(mp, bounds[i], q, tiny) for i in touching]
        balance = [sum(w * s[k] for w, s in zip(weights, slopes)) for k in range(size)]
        return balance + [sum(weights) - 1] + [bounds[i](mp, q) - t for i in touching]

    x = mpmath.findroot(conditions, [*map(mp.mpf, map(float, q)), mp.mpf(t), *map(mp.mpf, weights)], tol=1e-50, maxsteps=60)
    x = list(x)
    q, t, weights = x[:size], x[size], x[size + 1 :]
    if min(weights) <= 0 or max(f(mp, q) for f in bounds) > t + mp.mpf(10) ** -25:
        sys.exit("the touching points hold no optimum")
    return q, t


def bumped(q, k, by):
    q = list(q)
    q[k] = q[k] + by
    return q


def seen(points, origin, axes):
    """Places of points, as written with six digits, in the frame of the element."""
    return [[dot(a, mpmath.matrix([mp.mpf(x) for x in p]) - origin) for a in axes] for p in points]


def written(local, origin, axes):
    world = origin + sum((a * mp.mpf(float(x)) for a, x in zip(axes, local)), mpmath.zeros(3, 1))
    return [round(float(x), 6) for x in world]


def position(local, origin, axes):
    return [float(x) for x in origin + sum((a * x for a, x in zip(axes, local)), mpmath.zeros(3, 1))]


def direction(local, axes):
    return [float(x) for x in unit(sum((a * x for a, x in zip(axes, local)), mpmath.zeros(3, 1)))]


def spread(values):
    return float(max(values) - min(values))


# Points on each element with noise, in its own frame: `part` is the share of the turn or cap that is seen.

def on_sphere(random, part, noise):
    for i in range(COUNT):
        up, angle = 1 - 2 * part * (i + 0.5) / COUNT, 2.4 * i + random.normal() * 0.1
        across, radius = math.sqrt(1 - up * up), 12.5 + noise * random.normal()
        yield [radius * across * math.cos(angle), radius * across * math.sin(angle), radius * up]


def on_plane(random, part, noise):
    for _ in range(COUNT):
        yield [40 * random.uniform(-1, 1), 30 * part * random.uniform(-1, 1), noise * random.normal()]


def on_cylinder(random, part, noise):
    for i in range(COUNT):
        angle, radius = 2 * math.pi * part * (i + 0.5) / COUNT, 8 + noise * random.normal()
        yield [radius * math.cos(angle), radius * math.sin(angle), 20 * random.uniform(-1, 1)]


def on_cone(random, part, noise):
    for i in range(COUNT):
        angle, height = 2 * math.pi * part * (i + 0.5) / COUNT, 10 * random.uniform(-1, 1)
        radius = 15 + height * math.tan(0.4) + noise * random.normal()
        yield [radius * math.cos(angle), radius * math.sin(angle), height]


def on_torus(random, part, noise):
    for i in range(2 * COUNT):
        angle, turn = 2 * math.pi * part * (i + 0.5) / COUNT / 2, 2.4 * i
        tube = 4 + noise * random.normal()
        radius = 20 + tube * math.cos(turn)
        yield [radius * math.cos(angle), radius * math.sin(angle), tube * math.sin(turn)]


def on_circle(random, part, noise):
    for i in range(COUNT):
        angle, radius = 2 * math.pi * part * (i + 0.5) / COUNT, 9 + noise * random.normal()
        yield [radius * math.cos(angle), radius * math.sin(angle), noise * random.normal()]


def on_line(random, part, noise):
    for _ in range(COUNT):
        yield [noise * random.normal(), noise * random.normal(), 30 * part * random.uniform(-1, 1)]


SOLIDS = {
    "sphere": (sphere, on_sphere, [0, 0, 0, 12.5], [1.0, 0.12]),
    "plane": (plane, on_plane, [0, 0, 0], [1.0, 0.1]),
    "cylinder": (cylinder, on_cylinder, [0, 0, 0, 0, 8], [1.0, 0.3]),
    "cone": (cone, on_cone, [0, 0, 0, 0, 15, 0.4], [1.0, 0.4]),
    "torus": (torus, on_torus, [0, 0, 0, 0, 0, 20, 4], [1.0, 0.35]),
    "circle": (circle, on_circle, [0, 0, 0, 0, 0, 9], [1.0, 0.3]),
    "line": (line, on_line, [0, 0, 0, 0], [1.0, 0.2]),
}


def solid(element, q, origin, axes):
    """What a reader compares, in the frame of the points."""
    at = lambda x, y, z: position([x, y, z], origin, axes)
    along = lambda a, b: direction([a, b, 1], axes)
    if element == "sphere":
        return {"point": at(*q[:3]), "sizes": [float(2 * q[3])]}
    if element == "plane":
        return {"point": at(0, 0, q[2]), "direction": along(q[0], q[1])}
    if element == "cylinder":
        return {"point": at(q[0], q[1], 0), "direction": along(q[2], q[3]), "sizes": [float(2 * q[4])]}
    if element == "cone":
        sizes = [float(2 * q[4]), float(q[5] * 180 / mp.pi)]
        return {"point": at(q[0], q[1], 0), "direction": along(q[2], q[3]), "sizes": sizes}
    if element == "torus":
        return {"point": at(*q[:3]), "direction": along(q[3], q[4]), "sizes": [float(2 * q[5]), float(2 * q[6])]}
    if element == "circle":
        return {"point": at(*q[:3]), "direction": along(q[3], q[4]), "sizes": [float(2 * q[5])]}
    return {"point": at(q[0], q[1], 0), "direction": along(q[2], q[3])}


def least_squares_sets():
    for element, (residual, points_on, start, parts) in SOLIDS.items():
        for number, part in enumerate(parts):
            random = numpy.random.default_rng([7, len(element), number, ord(element[0])])
            origin, axes = frame(random)
            points = [written(p, origin, axes) for p in points_on(random, part, [0.02, 0.004][number])]
            local = seen(points, origin, axes)
            q = least_squares(residual, start, local)
            found = solid(element, q, origin, axes)
            if element not in ("circle", "line"):
                found["range"] = spread([residual(mp, q, p)[0] for p in local])
            yield element, "least-squares", points, found


def touching_sets():
    """Zones and touching elements, of single sided lists of bounds."""
    for element in ("sphere", "cylinder", "circle", "plane"):
        for number in range(2):
            random = numpy.random.default_rng([11, len(element), number, ord(element[0])])
            residual, points_on, start, _ = SOLIDS[element]
            origin, axes = frame(random)
            points = [written(p, origin, axes) for p in points_on(random, 1.0, [0.05, 0.008][number])]
            local = seen(points, origin, axes)
            fitted = least_squares(residual, start, local)
            if element == "circle":
                # Seen along the normal of the least-squares circle, in whose plane the centre lies.
                w = unit(sum((a * x for a, x in zip(axes, [fitted[3], fitted[4], 1])), mpmath.zeros(3, 1)))
                u = unit(cross(w, axes[1]))
                origin = origin + sum((a * x for a, x in zip(axes, fitted[:3])), mpmath.zeros(3, 1))
                axes = [u, cross(w, u), w]
                local = seen(points, origin, axes)
                residual, fitted = ring, least_squares(ring, [0, 0, fitted[5]], local)
            size = {"sphere": 3, "cylinder": 4, "circle": 2, "plane": None}[element]
            for criterion in ("minimum-zone", "maximum-inscribed", "minimum-circumscribed"):
                if criterion == "minimum-zone":
                    bounds = [bound(residual, p, s) for p in local for s in (1, -1)]
                    q, t = extremal(bounds, fitted)
                elif size is None:
                    continue
                else:
                    s = -1 if criterion == "maximum-inscribed" else 1
                    bounds = [bound(residual, p, s, [0]) for p in local]
                    q, t = extremal(bounds, fitted[:size])
                    q = [*q, s * t]
                found = solid(element, q, origin, axes) if element != "circle" else {
                    "point": position([q[0], q[1], 0], origin, axes), "sizes": [float(2 * q[2])]}
                if criterion == "minimum-zone":
                    found["zone"] = float(2 * t)
                yield element, criterion, points, found


def bound(residual, place, sign, more=()):
    """sign · residual as a function of the free parameters, of floats or of 50 digits."""
    floats = [float(x) for x in place]
    return lambda m, q: sign * residual(m, [*q, *more], floats if m is math else place)[0]


def outline_sets():
    """Outlines in a plane: points of the border, and the least-squares outline."""
    for number in range(2):
        noise = [0.02, 0.003][number]
        random = numpy.random.default_rng([13, number])
        place = [round(float(x), 3) for x in random.uniform(-50, 50, 2)] + [round(float(random.uniform(-1, 1)), 3)]
        out = lambda: noise * random.normal()

        def put(u, v):
            sin, cos = math.sin(place[2]), math.cos(place[2])
            return [round(place[0] + u * cos - v * sin, 6), round(place[1] + u * sin + v * cos, 6)]

        rounds = [2 * math.pi * (i + 0.5) / COUNT for i in range(COUNT)]
        points = [put((6 + out()) * math.cos(a), (6 + out()) * math.sin(a)) for a in rounds]
        q = least_squares(ring, [place[0], place[1], 6], points)
        yield "outline-circle", "least-squares", points, {"point": [float(q[0]), float(q[1])], "sizes": [float(2 * q[2])], "near": [*place, 6, 0]}
        straight = [(x, s * (4 + out())) for x in [-6.1, -4.2, -2.3, -0.7, 1.9, 3.8, 5.7] for s in (1, -1)]
        ends = [(s * (7 + (4 + out()) * math.cos(a)), (4 + out()) * math.sin(a)) for a in (-1.3, -0.8, -0.3, 0.3, 0.8, 1.3) for s in (1, -1)]
        points = [put(u, v) for u, v in straight + ends]
        q = least_squares(slot, [*place, 7, 4], points)
        yield "slot", "least-squares", points, {"point": [float(q[0]), float(q[1])], "turn": float(q[2]), "sizes": [float(2 * (q[3] + q[4])), float(2 * q[4])], "near": [*place, 7, 4]}
        sides = [(s * (9 + out()), v, 1) for v in (-4, -2.1, 0.3, 1.9, 4.2) for s in (1, -1)]
        sides += [(u, s * (5 + out()), 0) for u in (-8, -5.3, -2.2, 0.4, 3.1, 5.9, 8.2) for s in (1, -1)]
        points = [put(u, v) for u, v, _ in sides]
        q = least_squares(rectangle, [*place, 9, 5], [[*p, side] for p, (_, _, side) in zip(points, sides)])
        yield "rectangle", "least-squares", points, {"point": [float(q[0]), float(q[1])], "turn": float(q[2]), "sizes": [float(2 * q[3]), float(2 * q[4])], "near": [*place, 9, 5]}
        points = [put(u, out()) for u in numpy.linspace(-20, 20, COUNT)]
        offset = place[1] * math.cos(place[2]) - place[0] * math.sin(place[2])
        q = least_squares(edge, [offset, place[2]], points)
        foot = [float(-q[0] * mp.sin(q[1])), float(q[0] * mp.cos(q[1]))]
        strip = min(width for width in map(lambda pair: across(points, *pair), itertools.combinations(points, 2)))
        yield "edge", "least-squares", points, {"point": foot, "turn": float(q[1]), "strip": float(strip), "near": [*place, 20, 0]}


def across(points, a, b):
    """Width of the points across the direction of two of them."""
    dx, dy = mp.mpf(b[0]) - mp.mpf(a[0]), mp.mpf(b[1]) - mp.mpf(a[1])
    length = mp.sqrt(dx * dx + dy * dy)
    offsets = [(mp.mpf(p[1]) * dx - mp.mpf(p[0]) * dy) / length for p in points]
    return max(offsets) - min(offsets)


def main():
    names, sets = {}, []
    for element, criterion, points, found in itertools.chain(least_squares_sets(), touching_sets(), outline_sets()):
        number = names[element, criterion] = names.get((element, criterion), 0) + 1
        one = {"name": f"{element} {criterion} {number}", "element": element, "criterion": criterion, "found": found, "points": points}
        sets.append(json.dumps(one))
        print(one["name"], file=sys.stderr)
    print("[\n" + ",\n".join(sets) + "\n]")


main()
