// The page: what the cell tells, and what a person asks of it.
import { el, say, num, digitsOf, milliseconds, clock, outcomeOf, mark } from "./text.js";
import { toleranceBar, trend, timeline } from "./charts.js";
import { Cameras } from "./cameras.js";

const KEPT = 200;
const $ = (id) => document.getElementById(id);
const know = { cell: null, state: null, last: null, history: [], scan: null, status: null, connected: false };
const cameras = new Cameras($("cameras"));
let cloud = null;
let shownTab = "log";
let trended = null;
let window_ = 50;

// ---- what the cell tells ----

async function load() {
  const answer = await fetch("/api/state");
  if (!answer.ok) throw new Error((await answer.json()).refused);
  Object.assign(know, await answer.json());
  know.connected = true;
  document.title = know.cell.cell;
  say("cell", know.cell.cell);
  $("demo").hidden = !know.cell.demo;
  show();
  showScan();
  poll();
}

function listen() {
  const events = new EventSource("/api/events");
  const on = (kind, handle) => events.addEventListener(kind, (event) => handle(JSON.parse(event.data)));
  events.onopen = () => load().catch(() => lost("no answer"));
  events.onerror = () => {
    lost("no connection");
    // A browser gives up after an answer that is no stream.
    if (events.readyState === EventSource.CLOSED) setTimeout(listen, 2000);
  };
  on("state", (state) => { know.state = state; showState(); showBand(); });
  on("ended", (last) => { know.last = last; know.history = [...know.history, last.brief].slice(-KEPT); show(); });
  on("scan", (scan) => { know.scan = scan; showScan(); });
  on("lost", () => load().catch(() => lost("no answer")));
  on("bye", () => lost("the cell has ended"));
}

function lost(why) {
  know.connected = false;
  know.why = why;
  showState();
  showBand();
}

async function poll() {
  if (document.hidden || !know.connected) return;
  try {
    const answer = await fetch("/api/status");
    if (answer.ok) { know.status = await answer.json(); showStatus(); }
  } catch { /* the stream of events tells of a lost connection */ }
}

// ---- what is shown ----

function show() {
  showState();
  showBand();
  showFeatures();
  showLog();
  showTab();
  cloud?.annotate(know.last);
}

function showState() {
  const state = know.connected ? know.state : null;
  say("state", know.connected ? state?.state ?? "starting" : "offline");
  say("reason", know.connected ? state?.reason ?? "" : know.why ?? "");
  const serves = Boolean(state?.serves);
  for (const control of $("job").elements) control.disabled = !serves;
  if (!know.connected) return;
  $("job").title = serves ? "" : "this run does its own cycles; `fringecell run --serve` takes jobs";
  const recipes = (state?.recipes ?? []).map((recipe) => recipe.name + (recipe.prepared ? "" : " (not prepared)"));
  const select = $("recipe");
  if ([...select.options].map((option) => option.textContent).join("\n") !== recipes.join("\n")) {
    const chosen = select.value;
    select.replaceChildren(...state.recipes.map((recipe, n) =>
      el("option", { value: recipe.name }, recipes[n])));
    if (state.recipes.some((recipe) => recipe.name === chosen)) select.value = chosen;
  }
  showPrepared();
}

/** Whether the chosen recipe is prepared decides what can be done with it. */
function showPrepared() {
  const recipe = know.state?.recipes.find((one) => one.name === $("recipe").value);
  const prepared = recipe?.prepared ?? true;
  $("prepare").textContent = prepared ? "Unprepare" : "Prepare";
  $("prepare").title = prepared ? "no more jobs with this recipe" : "allow jobs with this recipe";
  for (const control of [$("inspect"), document.querySelector("[data-command=start]")]) control.disabled = !know.state?.serves || !prepared;
}

function showBand() {
  const band = $("band");
  const brief = know.last?.brief;
  const single = know.state?.state === "SingleExecution";
  let [kind, word] = brief ? outcomeOf(brief) : ["none", "—"];
  let part = brief?.part ?? (brief ? `cycle ${brief.number}` : "no part yet");
  let line = brief ? about(brief) : "";
  // A verdict that is not of the part in the cell must not look as if it were.
  if (!know.connected) [kind, word, part, line] = ["none", "NO CONNECTION", know.why ?? "", ""];
  else if (single) [kind, word, part, line] = ["none", "MEASURING", know.state.part ?? "", ""];
  else if (know.state?.state === "Error") [kind, word, line] = ["not_ok", "ERROR", know.state.reason ?? ""];
  else if (know.state?.state === "Halted") [kind, word, line] = ["none", "HALTED", "reset to go on"];
  band.className = kind;
  band.classList.toggle("running", know.connected && know.state?.state === "ContinuousExecution");
  say("verdict", word);
  say("partline", part);
  say("cycleline", line);
}

function about(brief) {
  if (brief.outcome !== "ok") return `cycle ${brief.number}: ${brief.outcome}`;
  const bad = know.last.features.filter((f) => f.verdict !== "pass").map((f) => f.name);
  const which = bad.length && brief.verdict !== "pass" ? `; ${bad.join(", ")}` : "";
  return `cycle ${brief.number}, ${clock(brief.date)}, verdict ${milliseconds(brief.latency_ns)} after the last frame${which}`;
}

function showFeatures() {
  const last = know.last;
  const table = $("featuretable");
  if (!last?.features.length) {
    const why = last?.alignment_failure ?? (last ? "this cycle has no features" : "no cycle yet");
    table.replaceChildren(el("tbody", {}, el("tr", {}, el("td", { class: "empty" }, why))));
    say("planline", "");
    return;
  }
  say("planline", `${last.plan ?? ""} · U: k = 2 · guard band ${num(last.guard_factor, 1)} u`);
  const head = el("tr", {}, ...["Feature", "Value ± U", "Deviation", "Tolerance", "Verdict"].map((t, n) =>
    el("th", { class: n === 1 || n === 2 ? "n" : null }, t)));
  table.replaceChildren(el("thead", {}, head), el("tbody", {}, ...last.features.map(featureRow)));
}

function featureRow(feature) {
  const unit = feature.unit === "deg" ? "°" : feature.unit;
  const digits = digitsOf(2 * feature.u);
  const value = feature.value == null ? "–" : `${num(feature.value, digits)} ± ${num(2 * feature.u, digits)} ${unit}`;
  const kind = feature.verdict ?? "none";
  const limits = `${num(feature.lower, 3)} … ${num(feature.upper, 3)} ${unit}`;
  return el("tr", { title: feature.reason ?? feature.detail ?? "" },
    el("td", { class: "name", title: feature.name }, feature.name), el("td", { class: "n" }, value),
    el("td", { class: "n" }, num(feature.deviation, digits)),
    el("td", { title: limits }, toleranceBar(feature)),
    el("td", {}, mark(kind, feature.verdict ?? feature.reason ?? "not measured")));
}

function showLog() {
  const head = el("tr", {}, ...["Cycle", "Time", "Part", "Recipe", "Outcome", "Why", "Cycle time", "Report"].map((t) => el("th", {}, t)));
  const rows = know.history.slice(-KEPT).reverse().map((brief) => {
    const [kind, word] = outcomeOf(brief);
    const why = brief.outcome !== "ok" ? brief.outcome
      : brief.features.filter((f) => f[3] !== "pass").map((f) => `${f[0]}: ${f[3] ?? "not measured"}`).join(", ");
    return el("tr", {}, el("td", { class: "n" }, brief.number), el("td", {}, clock(brief.date)), el("td", { class: "name" }, brief.part ?? ""),
      el("td", { class: "name" }, brief.recipe ?? ""), el("td", {}, mark(kind, word.toLowerCase())), el("td", { class: "why" }, why),
      el("td", { class: "n" }, milliseconds(brief.duration_ns)),
      el("td", {}, el("a", { href: `/report/${brief.number}`, target: "_blank", rel: "noopener" }, "report")));
  });
  $("logtable").replaceChildren(el("thead", {}, head), el("tbody", {}, ...rows));
}

function showTab() {
  if (shownTab === "cameras") cameras.show(know);
  if (shownTab === "trend") showTrend();
  if (shownTab === "stages") showStages();
}

/** What the chart of the trend needs beside the history, once for each cycle and number of parts. */
async function loadPerformance() {
  const wanted = `${know.last?.brief.number} ${window_}`;
  if (!know.last || know.performed === wanted) return;
  know.performed = wanted;
  try {
    const answer = await fetch(`/api/performance/${window_}`);
    if (answer.ok) know.performance = await answer.json();
  } catch { return; /* the stream of events tells of a lost connection */ }
  if (shownTab === "trend") showTrend();
}

function showTrend() {
  loadPerformance();
  const features = know.last?.features ?? [];
  const names = [...new Set(features.map((f) => f.name))];
  if (!names.includes(trended)) trended = names[0] ?? null;
  const pick = (values, chosen, label, change) => el("label", {}, `${label} `, el("select", { onchange: (event) => { change(event.target.value); showTrend(); } },
    ...values.map((value) => el("option", { value, selected: String(value) === String(chosen) }, value))));
  const bar = el("div", { class: "row" }, pick(names, trended, "Feature", (value) => { trended = value; }),
    pick([25, 50, 100, 200], window_, "Last parts", (value) => { window_ = Number(value); }));
  $("trend").replaceChildren(bar, trend(know, features.find((f) => f.name === trended), window_, (name) => { trended = name; showTrend(); }));
}

function showStages() {
  const stages = know.status?.stages ?? [];
  const cells = (stage) => [stage.state, stage.restarts, num(stage.wait.p50_ms, 1), num(stage.compute.p50_ms, 1), num(stage.send.p50_ms, 2)];
  const head = el("tr", {}, ...["Stage", "State", "Restarts", "Wait, ms", "Compute, ms", "Send, ms", ""].map((t) => el("th", {}, t)));
  const rows = stages.map((stage) => el("tr", {}, el("td", { class: "name" }, stage.name), ...cells(stage).map((t) => el("td", {}, t)),
    el("td", {}, el("button", { type: "button", onclick: () => send({ command: "restart", stage: stage.name }) }, "Restart"))));
  const scrolled = $("stages").scrollTop;
  $("stages").replaceChildren(el("div", { class: "row" }, timeline(know), el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows))));
  $("stages").scrollTop = scrolled;
}

function showStatus() {
  const status = know.status;
  const rate = status.cycles_per_minute == null ? "" : `${num(status.cycles_per_minute, 1)} parts/min · `;
  const o = status.outcomes;
  say("rateline", `${rate}${o.pass} pass, ${o.indeterminate} indeterminate, ${o.fail} fail, ${o.not_ok} not ok` +
    ` · cycle p50 ${num(status.cycle_time.p50_ms, 0)} ms, p99 ${num(status.cycle_time.p99_ms, 0)} ms` +
    (status.deadline_misses ? ` · ${status.deadline_misses} deadlines missed` : ""));
  if (shownTab === "stages" && !$("stages").contains(document.activeElement)) showStages();
}

async function showScan() {
  if (shownTab === "cameras") cameras.show(know);
  if (!know.scan?.points) return;
  try {
    if (!cloud) cloud = new (await import("./cloud.js")).Cloud();
    await cloud.show(know.scan, know.cell.pairs);
    cloud.annotate(know.last);
  } catch (error) {
    say("cloudline", `no 3D view: ${error.message}`);
  }
}

// ---- what a person asks ----

async function send(request) {
  let text;
  try {
    const answer = await fetch("/api/command", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(request) });
    const said = await answer.json();
    text = said.done ?? said.refused ?? (said.not_ready && `not now: ${said.not_ready.reason}`);
  } catch {
    text = "no connection: the command may not have arrived";
  }
  if (text) notice(text);
}

let noticed;
function notice(text) {
  say("said", text);
  $("said").hidden = false;
  clearTimeout(noticed);
  noticed = setTimeout(() => { $("said").hidden = true; }, 6000);
}

function selectTab(name, focus) {
  shownTab = name;
  for (const tab of document.querySelectorAll("[role=tab]")) {
    const chosen = tab.getAttribute("aria-controls") === name;
    tab.setAttribute("aria-selected", chosen);
    tab.tabIndex = chosen ? 0 : -1;
    if (chosen && focus) tab.focus();
    $(tab.getAttribute("aria-controls")).hidden = !chosen;
  }
  showTab();
}

function start() {
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const names = tabs.map((tab) => tab.getAttribute("aria-controls"));
  tabs.forEach((tab, n) => {
    tab.addEventListener("click", () => selectTab(names[n]));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (step) selectTab(names[(n + step + names.length) % names.length], true);
    });
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
    if (names[Number(event.key) - 1]) selectTab(names[Number(event.key) - 1], true);
  });
  $("job").addEventListener("submit", (event) => {
    event.preventDefault();
    send({ command: "inspect", part: $("part").value.trim() || "unnamed", recipe: $("recipe").value || null });
  });
  $("recipe").addEventListener("change", showPrepared);
  $("prepare").addEventListener("click", () => send({ command: $("prepare").textContent.toLowerCase(), recipe: $("recipe").value }));
  for (const button of document.querySelectorAll("[data-command]")) {
    const command = button.dataset.command;
    button.addEventListener("click", () => send(command === "start" ? { command, recipe: $("recipe").value || null, cycles: null } : { command }));
  }
  const dark = localStorage.getItem("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  document.documentElement.dataset.theme = dark;
  $("theme").addEventListener("click", () => {
    const theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    document.documentElement.dataset.theme = theme;
    localStorage.setItem("theme", theme);
    cloud?.draw();
  });
  listen();
  setInterval(poll, 2000);
}

start();
