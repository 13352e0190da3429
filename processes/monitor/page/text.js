// Elements and numbers. Names from the cell become text nodes only, so that no markup in them is ever markup.

/** An element; `properties` are attributes, `on…` are listeners, children are elements or text. */
export function el(tag, properties = {}, ...children) {
  return fill(document.createElement(tag), properties, children);
}

/** The same for SVG. */
export function svg(tag, properties = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", tag), properties, children);
}

function fill(element, properties, children) {
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value != null) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child != null).map((child) => (child instanceof Node ? child : String(child))));
  return element;
}

/** Sets the text of an element, only where it differs. */
export function say(id, text) {
  const element = typeof id === "string" ? document.getElementById(id) : id;
  if (element.textContent !== text) element.textContent = text;
}

/** A number with a fixed number of digits and a true minus; a dash where there is none. */
export function num(value, digits) {
  if (value == null || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "−");
}

/** Digits that an uncertainty leaves: two of the uncertainty, at most six. */
export function digitsOf(u) {
  if (!(u > 0)) return 3;
  return Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(u))));
}

export const milliseconds = (ns) => (ns == null ? "–" : `${num(ns / 1e6, ns < 1e7 ? 1 : 0)} ms`);

/** The time of day of an ISO date, in the browser's time zone. */
export function clock(date) {
  const time = new Date(date);
  return Number.isNaN(time.getTime()) ? String(date ?? "") : time.toLocaleTimeString([], { hour12: false });
}

/** What became of a cycle: a class and a word. */
export function outcomeOf(brief) {
  if (brief.outcome !== "ok") return ["not_ok", "NOT OK"];
  if (brief.verdict === "pass") return ["pass", "PASS"];
  if (brief.verdict === "fail") return ["fail", "FAIL"];
  if (brief.verdict === "indeterminate") return ["indeterminate", "INDETERMINATE"];
  return ["none", "MEASURED"];
}

/** A coloured word with its sign: colour is never the only difference. */
export function mark(kind, word) {
  const sign = { pass: "✓ ", fail: "✕ ", not_ok: "✕ ", indeterminate: "? " }[kind] ?? "";
  return el("span", { class: `v ${kind}` }, sign + word);
}
