// Tolerance bars, run charts with the performance of the features, and the stages of a cycle over time; all as SVG.
import { el, svg, num, digitsOf, milliseconds } from "./text.js";

/** Value, its expanded uncertainty and its limits: the tolerance is the green part. */
export function toleranceBar(feature) {
  const width = 100, height = 20;
  const { value, lower, upper, u } = feature;
  const picture = svg("svg", { width, height, role: "img", "aria-label": `within ${num(lower, 3)} and ${num(upper, 3)}` });
  if (lower == null || upper == null || !(upper > lower)) return picture;
  const margin = 0.25 * (upper - lower);
  const x = (v) => Math.max(2, Math.min(width - 2, (width * (v - lower + margin)) / (upper - lower + 2 * margin)));
  picture.append(
    svg("rect", { class: "over", x: 0, y: 5, width, height: 10, rx: 2 }),
    svg("rect", { class: "ok", x: x(lower), y: 5, width: x(upper) - x(lower), height: 10 }));
  if (value == null) return picture;
  const [left, right] = [x(value - 2 * u), x(value + 2 * u)];
  picture.append(
    svg("path", { class: "u", d: `M${left} 10H${right}M${left} 6v8M${right} 6v8` }),
    svg("path", { class: "at", d: `M${x(value)} 2v16` }));
  return picture;
}

const mean = (values) => values.reduce((sum, v) => sum + v, 0) / values.length;

/** Values of one feature in the last cycles of a recipe, the oldest first: number, value, verdict. */
function series(know, name, count) {
  const recipe = know.last.brief.recipe;
  const found = know.history.filter((b) => b.recipe === recipe).slice(-count).map((b) => {
    const f = b.features.find((one) => one[0] === name);
    return f && f[1] != null ? [b.number, f[1], f[3]] : null;
  });
  return found.filter(Boolean);
}

/** Run chart of a feature, drift of the overlaps, and the performance of all features. */
export function trend(know, feature, count, choose) {
  if (!feature) return el("p", { class: "empty" }, "no features yet");
  const points = series(know, feature.name, count);
  const unit = feature.unit === "deg" ? "°" : feature.unit;
  const limits = [feature.lower, feature.upper].filter((v) => v != null);
  const chart = runChart([{ points, kind: "run" }], { limits, unit, digits: digitsOf(2 * feature.u), middle: true });
  return el("div", { class: "row" },
    el("figure", {}, chart, el("figcaption", {}, `${feature.name}, ${unit}, over the cycles; dashed: limits, grey: mean`)),
    drift(know, count), performance(know, choose));
}

/** Mean distance of each two clouds where they overlap, over the cycles. */
function drift(know, count) {
  const lines = new Map();
  for (const brief of know.history.slice(-count)) {
    for (const [a, b, n, mean_mm] of brief.overlaps) {
      if (!n) continue;
      const name = `${know.cell.pairs[a] ?? a} – ${know.cell.pairs[b] ?? b}`;
      if (!lines.has(name)) lines.set(name, []);
      lines.get(name).push([brief.number, 1000 * mean_mm, null]);
    }
  }
  const text = lines.size ? `mean distance where ${[...lines.keys()].join("; ")} overlap, µm: a drift means that the rig moved` : "one pair: nothing overlaps, so nothing shows a drift of the rig";
  if (!lines.size) return el("p", { class: "empty" }, text);
  return el("figure", {}, runChart([...lines.values()].map((points) => ({ points, kind: "run" })), { limits: [0], unit: "µm", digits: 1 }), el("figcaption", {}, text));
}

/** Performance of all features, as the cell computes it. */
function performance(know, choose) {
  const rows = know.last.features.map((feature) => {
    const found = know.performance?.find((one) => one.name === feature.name);
    const digits = digitsOf(2 * feature.u);
    const [ppk, value] = [found?.ppk, (v) => (v == null ? "–" : num(v, digits))];
    const text = ppk == null ? "–" : `${num(ppk.value, 2)} (${num(ppk.low, 2)} … ${num(ppk.high, 2)})`;
    return el("tr", {}, el("td", { class: "name" }, el("button", { type: "button", onclick: () => choose(feature.name) }, feature.name)),
      el("td", { class: "n" }, found?.count ?? 0), el("td", { class: "n" }, value(found?.mean)), el("td", { class: "n" }, value(found?.sd)),
      el("td", { class: "n", title: ppk == null ? "from ten parts on" : "95 % interval" }, text));
  });
  const head = el("tr", {}, ...["Feature", "n", "Mean", "s", "Ppk (95 %)"].map((t, n) => el("th", { class: n ? "n" : null }, t)));
  return el("div", {}, el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows)));
}

function runChart(lines, { limits, unit, digits, middle }) {
  const [width, height, left, bottom] = [380, 160, 62, 20];
  const all = lines.flatMap((line) => line.points);
  const values = [...all.map((p) => p[1]), ...limits];
  const span = Math.max(...values) - Math.min(...values) || 1;
  const [low, high] = [Math.min(...values) - 0.06 * span, Math.max(...values) + 0.06 * span];
  const [first, last] = [Math.min(...all.map((p) => p[0])), Math.max(...all.map((p) => p[0]))];
  const x = (n) => left + ((width - left - 8) * (n - first)) / Math.max(1, last - first);
  const y = (v) => 6 + ((height - bottom - 6) * (high - v)) / (high - low);
  const picture = svg("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img" });
  const across = (v, kind) => picture.append(svg("path", { class: kind, d: `M${left} ${y(v)}H${width}` }),
    svg("text", { x: left - 5, y: y(v) + 4, "text-anchor": "end" }, num(v, Math.min(4, digits))));
  picture.append(svg("path", { class: "axis", d: `M${left} 6V${height - bottom}H${width}` }));
  limits.forEach((limit) => across(limit, "limit"));
  if (!all.length) return picture;
  // With one limit only, the value farthest from it gives the scale.
  const far = all.map((p) => p[1]).reduce((a, b) => (Math.abs(b - limits[0]) > Math.abs(a - limits[0]) ? b : a));
  if (limits.length === 1 && Math.abs(y(far) - y(limits[0])) > 12) {
    picture.append(svg("text", { x: left - 5, y: y(far) + 4, "text-anchor": "end" }, num(far, Math.min(4, digits))));
  }
  if (middle) picture.append(svg("path", { class: "mean", d: `M${left} ${y(mean(all.map((p) => p[1])))}H${width}` }));
  for (const { points, kind } of lines) {
    picture.append(svg("path", { class: kind, d: points.map((p, n) => `${n ? "L" : "M"}${x(p[0])} ${y(p[1])}`).join("") }));
    for (const p of points) {
      picture.append(svg("circle", { class: `dot ${p[2] ?? ""}`, cx: x(p[0]), cy: y(p[1]), r: 3 },
        svg("title", {}, `cycle ${p[0]}: ${num(p[1], digits)} ${unit}`)));
    }
  }
  picture.append(svg("text", { x: left, y: height - 5 }, `cycle ${first}`), svg("text", { x: width - 4, y: height - 5, "text-anchor": "end" }, last));
  return picture;
}

/** When each stage waited, computed and sent in the last cycle. */
export function timeline(know) {
  const spans = know.last?.spans ?? [];
  if (!spans.length) return el("p", { class: "empty" }, "no cycle yet");
  const names = know.cell.stages;
  const [width, left, row] = [560, 110, 15];
  const height = names.length * row + 22;
  const end = Math.max(...spans.map((s) => s[4]));
  const x = (us) => left + ((width - left - 8) * us) / end;
  const picture = svg("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "stages of the last cycle over time" });
  names.forEach((name, n) => picture.append(svg("text", { x: 0, y: n * row + 11 }, name.length > 18 ? `${name.slice(0, 17)}…` : name)));
  for (const [stage, name, wait, start, stop, sent] of spans) {
    const bar = (kind, from, to) => to > from && picture.append(svg("rect", { class: kind, x: x(from), y: stage * row + 2, width: Math.max(0.6, x(to) - x(from)), height: row - 4 },
      svg("title", {}, `${name}: ${kind} ${milliseconds(1000 * (to - from))}`)));
    bar("wait", Math.max(0, start - wait), start);
    bar("compute", start, stop - sent);
    bar("send", stop - sent, stop);
  }
  picture.append(svg("text", { x: left, y: height - 6 }, "0 ms"), svg("text", { x: width - 4, y: height - 6, "text-anchor": "end" }, milliseconds(1000 * end)));
  return el("figure", {}, picture, el("figcaption", {}, `cycle ${know.last.brief.number}: blue computes, amber sends, grey waits`));
}
