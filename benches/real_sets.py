#!/usr/bin/env python3
"""Compares clouds of `fringetool reconstruct` with a plain NumPy/OpenCV pipeline on recordings by other people.

    real_sets.py RECORDING RIG CLOUD.ply [--single UNSMOOTHED.ply] [--pair NAME]

Plain pipeline: phase by least squares, order by Gray code (or the code alone, averaged over 5 x 5 pixels where its inverse tells
the bits), undistortion, row-wise matching (two cameras) or ray and light plane (camera and projector); no filter. A point of it is
right where it lies within three robust standard deviations of the quadratic surface of its 21 x 21 neighbourhood. Printed: points, the
share of the right ones that our cloud has too (within one pixel), robust scatter about the surface for both, and gross errors
(beyond 20 of the plain pipeline's standard deviations). With a cloud made with `--smoothing-px 1`, whose points share no noise: their
scatter about the quadratic of 9 x 9 pixels over the stated sigma, and that of third differences over --apart pixels, for points between
the edges of a code share the noise of the same edges.
Needs numpy, scipy and opencv.
"""
import argparse
import tomllib
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import uniform_filter

TAU = 2 * np.pi
# Part of the variance of the centre of a 9 x 9 window that a fitted quadratic takes up.
LEVERAGE_9 = 0.0444


def frames_of(folder, projector, camera):
    files = sorted(Path(folder, "frames", projector, camera).glob("*.png"))
    return [cv2.imread(str(f), cv2.IMREAD_UNCHANGED).astype(np.float32) for f in files]


def bits_of(frames, threshold, count, inverse):
    planes = [(f > (inverse[i] if inverse is not None else threshold)) for i, f in enumerate(frames[:count])]
    code = np.zeros(planes[0].shape, np.int64)
    last = np.zeros(planes[0].shape, bool)
    for plane in planes:
        last = last ^ plane
        code = (code << 1) | last
    return code


def absolute(frames, sequence, extent):
    """Coordinate along x in projector pixels, and where it holds."""
    at, sets = 0, []
    for item in sequence:
        kind = item["set"]
        n = {"sine": item.get("steps", 1), "gray": item.get("bits", 0)}.get(kind, 1)
        sets.append((item, frames[at:at + n]))
        at += n
    white = next((f[0] for s, f in sets if s["set"] == "white"), None)
    black = next((f[0] for s, f in sets if s["set"] == "black"), None)
    along = [(s, f) for s, f in sets if s.get("axis") == "x"]
    sines = [(s, f) for s, f in along if s["set"] == "sine"]
    codes = [(s, f) for s, f in along if s["set"] == "gray"]
    wrapped = []
    for s, f in sines:
        sign = -1.0 if s.get("direction") == "-" else 1.0
        shift = sign * (s.get("first_step_rad", 0.0) * sign + TAU * np.arange(len(f)) / len(f))
        c = sum(i * np.cos(d) for i, d in zip(f, shift))
        q = sum(i * np.sin(d) for i, d in zip(f, shift))
        modulation = 2 / len(f) * np.hypot(c, q)
        wrapped.append((s["period_px"], np.mod(np.arctan2(q, c), TAU), modulation, sum(f) / len(f)))
    wrapped.sort(key=lambda w: w[0])
    normal = next((c for c in codes if not c[0].get("invert")), None)
    inverse = next((c for c in codes if c[0].get("invert")), None)
    if not wrapped:
        s, f = normal
        threshold = (white + black) / 2 if inverse is None else None
        other = [threshold] * len(f) if inverse is None else inverse[1]
        code = bits_of(f, threshold, s["bits"], inverse[1] if inverse else None)
        contrast = np.min([np.abs(a - b) for a, b in zip(f, other)], axis=0)
        seen = (white - black > 20) & (contrast > 1)
        x = (code + 0.5) * s["stripe_px"]
        weight = uniform_filter(seen.astype(np.float64), 5)
        mean = uniform_filter(np.where(seen, x, 0.0), 5) / np.maximum(weight, 1e-9)
        near = np.abs(mean - x) < 2 * s["stripe_px"]
        return mean, seen & near & (weight > 0.5)
    period, phase, modulation, background = wrapped[0]
    seen = modulation > 8
    if normal is not None:
        s, f = normal
        threshold = (white + black) / 2 if white is not None and black is not None else background
        code = bits_of(f, threshold, s["bits"], inverse[1] if inverse else None)
        stripe, shift = s["stripe_px"], s.get("shift_px", 0.0)
        centre = (code + 0.5) * stripe - shift
        fine = phase / TAU * period
        # A code finer than the period names its half; the order follows from the nearest one.
        return fine + period * np.round((centre - fine) / period), seen
    if len(wrapped) == 1:
        return phase / TAU * period, seen
    if len(wrapped) == 2:
        long, coarse = wrapped[1][0], wrapped[1][1]
        fine = phase / TAU * period
        return fine + period * np.round((coarse / TAU * long - fine) / period), seen
    # Three close periods: beats, from the longest to the shortest.
    (p1, a, _, _), (p2, b, _, _), (p3, c, _, _) = wrapped[:3]
    ab, bc = np.mod(a - b, TAU), np.mod(b - c, TAU)
    p12, p23 = p1 * p2 / (p2 - p1), p2 * p3 / (p3 - p2)
    p123 = p12 * p23 / abs(p23 - p12)
    abc = np.mod(ab - bc, TAU) if p23 > p12 else np.mod(bc - ab, TAU)
    x = abc / TAU * p123
    for fine, p in ((ab, p12), (a, p1)):
        f = fine / TAU * p
        x = f + p * np.round((x - f) / p)
    return x, seen


def camera(rig, name):
    c = next(d for d in rig.get("camera", []) + rig.get("projector", []) if d["name"] == name)
    k = np.array([[c["focal_px"][0], c.get("skew", 0.0), c["principal_point_px"][0]],
                  [0, c["focal_px"][1], c["principal_point_px"][1]], [0, 0, 1]])
    d = c.get("distortion", {"k": [0, 0, 0], "p": [0, 0]})
    kk = list(d["k"]) + [0] * (3 - len(d["k"]))
    dist = np.array([kk[0], kk[1], d["p"][0], d["p"][1], kk[2]])
    pose = c["from_world"]
    return k, dist, np.array(pose["rotation"]), np.array(pose["translation_mm"]), (c["width_px"], c["height_px"])


def stereo(recording, rig, pair, projector, extent):
    (kl, dl, rl, tl, size), (kr, dr, rr, tr, _) = camera(rig, pair["left"]), camera(rig, pair["right"])
    r, t = rr @ rl.T, tr - rr @ rl.T @ tl
    r1, r2, p1, p2, q, _, _ = cv2.stereoRectify(kl, dl, kr, dr, size, r, t.reshape(3, 1), alpha=-1, flags=0)
    maps = []
    for name, k, d, rect, p in ((pair["left"], kl, dl, r1, p1), (pair["right"], kr, dr, r2, p2)):
        x, ok = absolute(frames_of(recording, projector["name"], name), projector["sequence"], extent)
        mx, my = cv2.initUndistortRectifyMap(k, d, rect, p, size, cv2.CV_32FC1)
        value = cv2.remap(x.astype(np.float32), mx, my, cv2.INTER_LINEAR)
        near = cv2.remap(x.astype(np.float32), mx, my, cv2.INTER_NEAREST)
        good = cv2.remap(ok.astype(np.float32), mx, my, cv2.INTER_LINEAR) > 0.99
        maps.append((value, good & (np.abs(value - near) < 5)))
    (xl, gl), (xr, gr) = maps
    disparity = np.full(xl.shape, np.nan)
    for row in range(xl.shape[0]):
        u = np.flatnonzero(gr[row])
        if len(u) < 2:
            continue
        a, b = xr[row, u[:-1]], xr[row, u[1:]]
        up = (np.diff(u) == 1) & (b > a) & (b - a < 8)
        if not up.any():
            continue
        a, b, at = a[up], b[up], u[:-1][up]
        order = np.argsort(a, kind="stable")
        a, b, at = a[order], b[order], at[order]
        v = np.flatnonzero(gl[row])
        want = xl[row, v]
        i = np.searchsorted(a, want, side="right") - 1
        hit = (i >= 0) & (want < b[np.maximum(i, 0)] + 1e-6)
        i = i[hit]
        disparity[row, v[hit]] = v[hit] - (at[i] + (want[hit] - a[i]) / (b[i] - a[i]))
    rows, cols = np.nonzero(np.isfinite(disparity))
    h = np.stack([cols, rows, disparity[rows, cols], np.ones(len(rows))])
    xyz = (q @ h)
    xyz = (xyz[:3] / xyz[3]).T
    ok = (xyz[:, 2] > 0)
    depth = np.full(xl.shape, np.nan)
    depth[rows[ok], cols[ok]] = xyz[ok, 2]

    def project(points):
        local = (r1 @ (rl @ points.T + tl[:, None])).T
        return local[:, 0] / local[:, 2] * p1[0, 0] + p1[0, 2], local[:, 1] / local[:, 2] * p1[1, 1] + p1[1, 2], local[:, 2]

    return depth, project, -rl.T @ tl


def single(recording, rig, pair, projector, extent):
    (k, d, r, t, size), (kp, dp, rp, tp, psize) = camera(rig, pair["left"]), camera(rig, pair["right"])
    x, ok = absolute(frames_of(recording, projector["name"], pair["left"]), projector["sequence"], extent)
    # Rows with y alone carry nothing here: the plane of light of one column, undistorted once around the camera's first guess.
    v, u = np.nonzero(ok)
    ray = cv2.undistortPoints(np.stack([u, v], 1).astype(np.float64)[:, None], k, d)[:, 0]
    ray = np.column_stack([ray, np.ones(len(ray))])
    rel, shift = rp @ r.T, tp - rp @ r.T @ t
    depth = np.full(len(u), 500.0)
    for _ in range(6):
        local = (rel @ (ray * depth[:, None]).T).T + shift
        flat = local[:, :2] / local[:, 2:]
        px, _ = cv2.projectPoints(local[:, None], np.zeros(3), np.zeros(3), kp, dp)
        offset = px[:, 0, 0] - (flat[:, 0] * kp[0, 0] + kp[0, 2])
        xn = (x[v, u] - offset - kp[0, 2]) / kp[0, 0]
        a = rel[0] @ ray.T - xn * (rel[2] @ ray.T)
        depth = (xn * shift[2] - shift[0]) / a
        depth = np.where(np.isfinite(depth) & (depth > 1) & (depth < 1e5), depth, 500.0)
    good = (depth > 1) & (depth < 1e5) & (depth != 500.0)
    out = np.full(x.shape, np.nan)
    out[v[good], u[good]] = depth[good]

    def project(points):
        local = (r @ points.T + t[:, None]).T
        px, _ = cv2.projectPoints(local[:, None], np.zeros(3), np.zeros(3), k, d)
        return px[:, 0, 0], px[:, 0, 1], local[:, 2]

    return out, project, -r.T @ t


def surface(depth, side=21, hole=0):
    """Residual from the quadratic of the neighbourhood, fitted twice: the second time without what was far off."""
    ok = np.isfinite(depth)
    h, w = depth.shape
    c = (side - 1) // 2
    ax = np.arange(-c, c + 1, dtype=np.float64) / c
    gx, gy = np.meshgrid(ax, ax)
    basis = [np.ones_like(gx), gx, gy, gx * gx, gx * gy, gy * gy]
    use, residual = ok.copy(), np.full(depth.shape, np.nan)
    for turn in range(3):
        values = np.where(use, depth, 0.0)
        centre = np.nanmedian(depth)
        values = np.where(use, depth - centre, 0.0)
        weight = use.astype(np.float64)
        cut = np.ones_like(gx)
        if hole:
            cut[c - hole:c + hole + 1, c - hole:c + hole + 1] = 0
        filt = lambda image, kernel: cv2.filter2D(image, cv2.CV_64F, kernel, borderType=cv2.BORDER_CONSTANT)
        n = filt(weight, cut)
        m = np.empty((6, 6, h, w), np.float64)
        rhs = np.empty((6, h, w))
        for i in range(6):
            rhs[i] = filt(values, basis[i] * cut)
            for j in range(i, 6):
                m[i, j] = m[j, i] = filt(weight, basis[i] * basis[j] * cut)
        where = ok & (n > 0.5 * cut.sum())
        rows, cols = np.nonzero(where)
        a = m[:, :, rows, cols].transpose(2, 0, 1)
        solved = np.linalg.solve(a + 1e-9 * np.eye(6), rhs[:, rows, cols].T[..., None])[:, 0, 0]
        residual[:] = np.nan
        residual[rows, cols] = depth[rows, cols] - centre - solved
        mad = 1.4826 * np.nanmedian(np.abs(residual))
        use = ok & (np.abs(residual) < 4 * mad)
    return residual, mad


def cloud_of(path):
    with open(path, "rb") as f:
        kinds = {"double": "<f8", "float": "<f4", "uchar": "u1", "uint": "<u4", "int": "<i4", "ushort": "<u2"}
        fields = []
        for line in iter(f.readline, b"end_header\n"):
            words = line.split()
            if words[0] == b"property":
                fields.append((words[2].decode(), kinds[words[1].decode()]))
        return np.frombuffer(f.read(), dtype=fields)


def raster(cloud, project, centre, shape):
    """Depths by the pixel of the left camera, and what one stated standard deviation along the normal is in depth."""
    points = np.stack([cloud["x"], cloud["y"], cloud["z"]], 1)
    u, v, z = project(points)
    normals = np.stack([cloud["nx"], cloud["ny"], cloud["nz"]], 1)
    along = np.abs(np.sum(normals * (points - centre), 1)) / z
    u, v = np.rint(u).astype(int), np.rint(v).astype(int)
    inside = (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0])
    depth, stated = np.full(shape, np.nan), np.full(shape, np.nan)
    depth[v[inside], u[inside]] = z[inside]
    stated[v[inside], u[inside]] = (cloud["sigma"] / along)[inside]
    return depth, stated


def third_differences(grid, stated, apart):
    """Robust ratio of third differences of points so many pixels apart, along rows and columns, to what sigma says of them: free of
    slopes and of even curvature, and of noise that neighbours share over a shorter way."""
    ratios = []
    for z, s in ((grid, stated), (grid.T, stated.T)):
        length = z.shape[0] - 3 * apart
        at = [slice(i * apart, i * apart + length) for i in range(4)]
        weights = (1, -3, 3, -1)
        difference = sum(w * z[a] for w, a in zip(weights, at))
        sigma = np.sqrt(sum((w * s[a]) ** 2 for w, a in zip(weights, at)))
        ratios.append(1.4826 * np.nanmedian(np.abs(difference / sigma)))
    return ratios


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("recording")
    arguments.add_argument("rig")
    arguments.add_argument("cloud")
    arguments.add_argument("--single")
    arguments.add_argument("--pair")
    arguments.add_argument("--apart", type=int, default=6)
    args = arguments.parse_args()
    rig = tomllib.loads(Path(args.rig).read_text())
    recording = tomllib.loads(Path(args.recording, "recording.toml").read_text())
    projector = recording["projector"][0]
    pairs = rig.get("pair", [])
    pair = next((p for p in pairs if args.pair in (None, p["name"])), None)
    names = {c["name"] for c in rig.get("camera", [])}
    if pair is None or pair["right"] not in names:
        pair = {"left": projector["cameras"][0], "right": projector["name"]}
    extent = (projector["width_px"], projector["height_px"])
    method = stereo if pair["right"] in names else single
    depth, project, centre = method(args.recording, rig, pair, projector, extent)
    residual, sigma = surface(depth)
    right = np.abs(residual) < 3 * sigma
    grid, _ = raster(cloud_of(args.cloud), project, centre, depth.shape)
    near = cv2.dilate(np.isfinite(grid).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    mine, my_sigma = surface(grid)
    gross = lambda r: int(np.sum(np.abs(r) > 20 * sigma))
    print(f"plain: {np.isfinite(depth).sum()} points, {right.sum()} right, robust scatter {1e3 * sigma:.1f} um, {gross(residual)} gross")
    print(f"ours:  {np.isfinite(grid).sum()} pixels, share of the right ones {np.mean(near[right]):.4f}, robust scatter {1e3 * my_sigma:.1f} um, "
          f"{gross(mine)} gross")
    if args.single:
        grid, stated = raster(cloud_of(args.single), project, centre, depth.shape)
        residual, _ = surface(grid, 9)
        ratio = 1.4826 * np.nanmedian(np.abs(residual / stated)) / np.sqrt(1 - LEVERAGE_9)
        along = third_differences(grid.T, stated.T, args.apart)
        print(f"single points: scatter over stated {ratio:.2f}; third differences over {args.apart} px: "
              f"{along[0]:.2f} along rows, {along[1]:.2f} along columns")


if __name__ == "__main__":
    main()
