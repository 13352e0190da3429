// The cloud in 3D: coloured, turned, picked, annotated. Any beginning of its points shows the whole part, so a slow machine
// draws fewer of them while it turns.
import { BufferAttribute, BufferGeometry, OrbitControls, PerspectiveCamera, Points, Scene, ShaderMaterial, Vector3, WebGLRenderer } from "./three.js";
import { el, num, say } from "./text.js";

const $ = (id) => document.getElementById(id);

/** Times between frames while the cloud turns, ms: above the first fewer points are drawn, below the second more. */
const SLOW_MS = 45, FAST_MS = 28;

/** The fewest points drawn then, and the pause after which all are drawn, ms. */
const FEWEST = 20000, PAUSE_MS = 300;

/** Points that are looked at under the cursor. */
const PICKED = 150000, PICK_PX = 7;

// vik (F. Crameri, Scientific colour maps 8.0, MIT) and viridis (CC0), sampled; pairs after Okabe and Ito.
const VIK = [[0, 18, 97], [2, 63, 125], [37, 113, 158], [128, 172, 199], [236, 229, 224], [220, 175, 150], [192, 113, 70], [149, 51, 10], [89, 0, 8]];
const VIRIDIS = [[68, 1, 84], [71, 45, 123], [59, 82, 139], [44, 114, 142], [33, 145, 140], [40, 174, 128], [94, 201, 98], [173, 220, 48], [253, 231, 37]];
const PAIRS = [[0, 114, 178], [230, 159, 0], [0, 158, 115], [204, 121, 167], [213, 94, 0], [86, 180, 233], [240, 228, 66]];
const NONE = [150, 156, 164];

function colour(table, t, into, at) {
  const place = Math.max(0, Math.min(1, t)) * (table.length - 1);
  const n = Math.min(table.length - 2, Math.floor(place)), share = place - n;
  for (let c = 0; c < 3; c++) into[at + c] = table[n][c] + share * (table[n + 1][c] - table[n][c]);
}

const VERTEX = `
attribute vec3 tint; attribute vec3 way; uniform float size; varying vec3 shade;
void main() {
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  vec3 normal = normalMatrix * way;
  float light = dot(normal, normal) > 0.01 ? 0.45 + 0.55 * abs(normalize(normal).z) : 1.0;
  shade = tint * light;
  gl_PointSize = size;
  gl_Position = projectionMatrix * seen;
}`;
const FRAGMENT = "varying vec3 shade; void main() { gl_FragColor = vec4(shade, 1.0); }";

/** Height at or below `top` where a label is clear of those `taken`, in whole pixels: the rounding of fractions would leave a label a hair
    nearer to its neighbour than it was put, and moved down for ever. */
export function below(taken, x, top, wide) {
  let y = Math.round(top);
  const hit = () => taken.find((t) => Math.abs(t.y - y) < 20 && x < t.x + t.wide && t.x < x + wide);
  for (let other = hit(); other; other = hit()) y = other.y + 20;
  return y;
}

/** Planes of the cloud as the monitor packs them. */
export function unpack(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== 0x31434346) throw new Error("not a cloud");
  const n = view.getUint32(4, true);
  const plane = (at, count) => new Float32Array(buffer, at, count);
  return {
    n, all: view.getUint32(8, true),
    middle: [16, 24, 32].map((at) => view.getFloat64(at, true)),
    positions: plane(40, 3 * n), deviations: plane(40 + 12 * n, n), sigmas: plane(40 + 16 * n, n),
    ways: new Int8Array(buffer, 40 + 20 * n, 4 * n), bytes: new Uint8Array(buffer, 40 + 20 * n, 4 * n),
  };
}

export class Cloud {
  constructor() {
    this.canvas = $("cloud");
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: false, alpha: true, preserveDrawingBuffer: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(30, 1, 0.1, 1e5);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.material = new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: { size: { value: 2 } } });
    this.drawn = 5 * FEWEST;
    this.places = [];
    this.controls.addEventListener("change", () => this.draw());
    $("colouring").addEventListener("change", () => { this.paint(); this.draw(); });
    $("labels").addEventListener("change", () => this.draw());
    $("home").addEventListener("click", () => { this.home(); this.draw(); });
    this.canvas.addEventListener("pointermove", (event) => this.pick(event));
    this.canvas.addEventListener("pointerleave", () => { $("pick").hidden = true; });
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.draw()).observe($("stage"));
  }

  async show(scan, pairs) {
    this.wanted = scan.number;
    const answer = await fetch(`/api/cloud/${scan.number}`);
    // A newer one is announced already.
    if (!answer.ok || this.wanted !== scan.number) return;
    const first = !this.cloud;
    this.cloud = unpack(await answer.arrayBuffer());
    this.pairs = pairs;
    const { n, positions, ways } = this.cloud;
    this.points?.geometry.dispose();
    if (this.points) this.scene.remove(this.points);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    this.tints = new Uint8Array(4 * n);
    geometry.setAttribute("tint", new BufferAttribute(this.tints, 4, true));
    geometry.setAttribute("way", new BufferAttribute(ways, 4, true));
    geometry.computeBoundingSphere();
    this.points = new Points(geometry, this.material);
    this.points.frustumCulled = false;
    this.scene.add(this.points);
    if (first) this.home();
    this.paint();
    const shown = n < this.cloud.all ? `${n.toLocaleString()} of ${this.cloud.all.toLocaleString()}` : n.toLocaleString();
    say("cloudline", `cycle ${scan.cloud_number}: ${shown} points`);
    this.draw();
  }

  home() {
    if (!this.points) return;
    const { center, radius } = this.points.geometry.boundingSphere;
    this.controls.target.copy(center);
    // From where the cameras look: against the mean of the normals.
    const { n, ways } = this.cloud;
    const mean = new Vector3();
    for (let i = 0; i < Math.min(n, 5000); i++) mean.add(new Vector3(ways[4 * i], ways[4 * i + 1], ways[4 * i + 2]));
    if (mean.length() === 0) mean.set(0, 0, 1);
    mean.normalize();
    this.camera.up.set(0, Math.abs(mean.y) > 0.9 ? 0 : 1, Math.abs(mean.y) > 0.9 ? 1 : 0);
    this.camera.position.copy(center).addScaledVector(mean, 3.1 * (radius || 1));
    this.camera.near = 0.01 * (radius || 1);
    this.camera.far = 100 * (radius || 1);
    this.controls.update();
  }

  /** Colours of all points, and the legend. */
  paint() {
    if (!this.cloud) return;
    const { n, deviations, sigmas, bytes } = this.cloud;
    const by = $("colouring").value;
    const [low, high] = by === "deviation" ? symmetric(deviations) : by === "sigma" ? ends(sigmas) : [0, 1];
    for (let i = 0; i < n; i++) {
      const value = by === "deviation" ? deviations[i] : sigmas[i];
      if (by === "pair") this.tints.set(PAIRS[bytes[4 * i + 3] % PAIRS.length], 4 * i);
      else if (Number.isNaN(value)) this.tints.set(NONE, 4 * i);
      else colour(by === "deviation" ? VIK : VIRIDIS, (value - low) / (high - low), this.tints, 4 * i);
    }
    this.points.geometry.attributes.tint.needsUpdate = true;
    this.legend(by, low, high);
  }

  legend(by, low, high) {
    if (by === "pair") {
      const name = (name, n) => el("div", {}, el("span", { class: "v" }, "■"), ` ${name}`);
      const rows = this.pairs.map(name);
      rows.forEach((row, n) => { row.firstChild.style.background = row.firstChild.style.color = `rgb(${PAIRS[n % PAIRS.length]})`; });
      $("legend").replaceChildren(...rows);
      return;
    }
    const bar = el("canvas", { width: 180, height: 1 });
    const context = bar.getContext("2d"), rgb = [0, 0, 0];
    for (let x = 0; x < 180; x++) {
      colour(by === "deviation" ? VIK : VIRIDIS, x / 179, rgb, 0);
      context.fillStyle = `rgb(${rgb.map(Math.round)})`;
      context.fillRect(x, 0, 1, 1);
    }
    const what = by === "deviation" ? "µm from the fitted element; grey: belongs to none" : "µm standard uncertainty along the normal";
    $("legend").replaceChildren(bar, el("div", {}, `${num(1000 * low, 0)} … ${num(1000 * high, 0)} ${what}`));
  }

  /** Draws with the next frame; while the cloud turns no more points than the machine can, all of them at rest. */
  draw() {
    if (this.due || !this.points) return;
    clearTimeout(this.rest);
    this.due = requestAnimationFrame((now) => {
      this.due = null;
      this.adapt(now - this.before);
      this.before = now;
      this.render(Math.min(this.drawn, this.cloud.n));
      this.rest = setTimeout(() => this.render(this.cloud.n), PAUSE_MS);
    });
  }

  /** Number of points of the next frame, by the time since the last one. After a pause that time means nothing. */
  adapt(took) {
    if (!(took < 1000) || this.canvas.dataset.points !== String(Math.min(this.drawn, this.cloud.n))) return;
    if (took > SLOW_MS) this.drawn = Math.max(FEWEST, Math.floor(this.drawn / 2));
    else if (took < FAST_MS) this.drawn = Math.min(this.cloud.n, Math.ceil(this.drawn * 1.2));
    this.canvas.dataset.frame_ms = took.toFixed(1);
  }

  render(count) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.points.geometry.setDrawRange(0, count);
    this.material.uniforms.size.value = count < 60000 ? 3 : 2;
    this.renderer.render(this.scene, this.camera);
    this.canvas.dataset.points = count;
    this.tag();
  }

  project(point) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const p = point.project(this.camera);
    return [0.5 * width * (1 + p.x), 0.5 * height * (1 - p.y), p.z];
  }

  /** Labels of the features of the cycle that the cloud belongs to. */
  annotate(last) {
    if (!last) return;
    this.places = last.features.map((feature, n) => ({ feature, place: last.places[n] })).filter((one) => one.place);
    this.draw();
  }

  tag() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const taken = [];
    const tags = $("labels").checked ? this.places.map(({ feature, place }) => {
      const [x, top, z] = this.project(new Vector3(...place.map((v, axis) => v - this.cloud.middle[axis])));
      if (z > 1 || x < 0 || top < 0 || x > width || top > height) return null;
      const wide = Math.min(22, feature.name.length + 2) * 7.5;
      const y = below(taken, x, top, wide);
      if (y > height - 20) return null;
      taken.push({ x, y, wide });
      const sign = { pass: "✓", fail: "✕", indeterminate: "?" }[feature.verdict] ?? "·";
      const tag = el("span", { title: feature.name }, `${sign} ${feature.name}`);
      tag.style.transform = `translate(${x + 6}px, ${y - 9}px)`;
      return tag;
    }) : [];
    $("tags").replaceChildren(...tags.filter(Boolean));
  }

  /** The values of the point under the cursor. */
  pick(event) {
    if (this.picking || !this.cloud || event.buttons) { if (event.buttons) $("pick").hidden = true; return; }
    this.picking = requestAnimationFrame(() => {
      this.picking = null;
      const box = this.canvas.getBoundingClientRect();
      const at = this.nearest(event.clientX - box.left, event.clientY - box.top);
      $("pick").hidden = at < 0;
      if (at < 0) return;
      const { positions, middle, deviations, sigmas, bytes } = this.cloud;
      const [x, y, z] = [0, 1, 2].map((axis) => num(positions[3 * at + axis] + middle[axis], 3));
      const from = Number.isNaN(deviations[at]) ? "no element" : `deviation ${num(1000 * deviations[at], 1)} µm`;
      say("pick", `${x}, ${y}, ${z} mm\n${from}\nσ ${num(1000 * sigmas[at], 1)} µm, ${this.pairs[bytes[4 * at + 3]] ?? "pair ?"}`);
      $("pick").style.transform = `translate(${Math.min(event.clientX - box.left + 14, box.width - 190)}px, ${event.clientY - box.top + 10}px)`;
    });
  }

  nearest(x, y) {
    this.camera.updateMatrixWorld();
    const m = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse).elements;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const p = this.cloud.positions;
    let best = -1, front = Infinity;
    for (let i = 0, end = Math.min(this.cloud.n, PICKED); i < end; i++) {
      const [a, b, c] = [p[3 * i], p[3 * i + 1], p[3 * i + 2]];
      const w = m[3] * a + m[7] * b + m[11] * c + m[15];
      if (w <= 0) continue;
      const dx = 0.5 * width * (1 + (m[0] * a + m[4] * b + m[8] * c + m[12]) / w) - x;
      const dy = 0.5 * height * (1 - (m[1] * a + m[5] * b + m[9] * c + m[13]) / w) - y;
      const d = dx * dx + dy * dy;
      // The nearest on the screen; of those about as near, the one in front.
      if (d < PICK_PX ** 2 && d + 0.02 * w * w < front) { front = d + 0.02 * w * w; best = i; }
    }
    return best;
  }

  key(event) {
    const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    const zoom = { "+": 0.9, "=": 0.9, "-": 1.1 }[event.key];
    if (!turn && !zoom) return;
    event.preventDefault();
    const from = this.camera.position.clone().sub(this.controls.target);
    if (zoom) from.multiplyScalar(zoom);
    else {
      const side = new Vector3().crossVectors(this.camera.up, from).normalize();
      from.applyAxisAngle(this.camera.up, turn[0]).applyAxisAngle(side, turn[1]);
    }
    this.camera.position.copy(this.controls.target).add(from);
    this.controls.update();
    this.draw();
  }
}

/** Ends that leave out the outermost hundredth, from a sample. */
function ends(values) {
  const step = Math.max(1, Math.floor(values.length / 20000)), some = [];
  for (let i = 0; i < values.length; i += step) if (Number.isFinite(values[i])) some.push(values[i]);
  if (!some.length) return [0, 1e-6];
  some.sort((a, b) => a - b);
  const at = (share) => some[Math.round(share * (some.length - 1))];
  return [at(0.01), Math.max(at(0.99), at(0.01) + 1e-6)];
}

function symmetric(values) {
  const [low, high] = ends(values);
  const most = Math.max(Math.abs(low), Math.abs(high));
  return [-most, most];
}
