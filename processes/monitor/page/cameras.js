// What the cameras saw: white frame with saturation, histogram, planes of the phase map, and what became of the pixels.
import { el, num } from "./text.js";

const LAYERS = [["grey", "picture"], ["modulation", "modulation, DN"], ["phase", "phase, wrapped"], ["noise", "phase noise, mrad"],
  ["risk", "risk of a wrong order, power of ten"]];

/** Pixels of a phase map by what became of them: word, key, what it means. */
const COUNTS = [["valid", "valid"], ["saturated", "saturated"], ["dark", "too dark"], ["noisy", "too noisy"],
  ["ambiguous", "order at risk"], ["resolved", "order settled by neighbours"], ["spikes_masked", "spikes masked"]];

export class Cameras {
  constructor(place) {
    this.place = place;
    this.layer = "grey";
    this.overlay = true;
  }

  show(know) {
    this.know = know;
    const scan = know.scan;
    const drawn = `${scan?.number}/${this.layer}/${this.overlay}/${know.last?.brief.number}`;
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    if (!scan?.pictures.length) {
      this.place.replaceChildren(el("p", { class: "empty" }, "no pictures yet: they come with the next cycle"));
      return;
    }
    const select = el("select", { onchange: (event) => { this.layer = event.target.value; this.show(this.know); } },
      ...LAYERS.map(([value, word]) => el("option", { value, selected: value === this.layer }, word)));
    const overlay = el("input", { type: "checkbox", checked: this.overlay, onchange: (event) => { this.overlay = event.target.checked; this.show(this.know); } });
    const list = this.layer === "grey" ? scan.pictures : scan.maps;
    this.place.replaceChildren(
      el("div", { class: "row" }, el("label", {}, "Show ", select), this.layer === "grey" ? el("label", {}, overlay, " saturation in red, too dark in blue") : null),
      el("div", { class: "row" }, ...list.map((raster) => this.figure(raster)), this.counts(know.last)));
  }

  figure(raster) {
    const path = `/api/picture/${this.know.scan.number}/${raster.path}/${this.layer}`;
    const name = `${raster.camera} under ${raster.projector}, cycle ${raster.number}`;
    if (this.layer !== "grey") return el("figure", {}, el("img", { src: path, alt: name }), el("figcaption", {}, name));
    const picture = el("canvas", { width: raster.width_px, height: raster.height_px, role: "img", "aria-label": name });
    const histogram = el("canvas", { class: "hist", width: 256, height: 60, role: "img", "aria-label": `histogram of ${raster.camera}` });
    const share = el("span");
    paint(path, picture, histogram, share, this.overlay).catch(() => { share.textContent = "; replaced by a newer one"; });
    return el("figure", {}, picture, histogram, el("figcaption", {}, name, share));
  }

  counts(last) {
    if (!last?.decode.length) return null;
    const head = el("tr", {}, el("th", {}, "Phase map, ‰ of pixels"), ...COUNTS.map(([, word]) => el("th", { class: "n" }, word)));
    const rows = last.decode.map(([name, counts]) => {
      const all = ["valid", "saturated", "dark", "noisy", "ambiguous"].reduce((sum, key) => sum + (counts[key] ?? 0), 0);
      return el("tr", {}, el("td", { class: "name" }, name), ...COUNTS.map(([key]) => el("td", { class: "n" }, num((1000 * (counts[key] ?? 0)) / all, 1))));
    });
    return el("table", {}, el("thead", {}, head), el("tbody", {}, ...rows));
  }
}

/** Grey values from 250 on are saturated, below 8 too dark for fringes. */
async function paint(path, picture, histogram, share, overlay) {
  const answer = await fetch(path);
  if (!answer.ok) throw new Error("gone");
  const bitmap = await createImageBitmap(await answer.blob());
  const context = picture.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  const image = context.getImageData(0, 0, picture.width, picture.height);
  const counts = new Uint32Array(256);
  for (let n = 0; n < image.data.length; n += 4) {
    const grey = image.data[n];
    counts[grey] += 1;
    if (overlay && grey >= 250) image.data.set([255, 40, 40], n);
    else if (overlay && grey < 8) image.data.set([20, 40, 150], n);
  }
  context.putImageData(image, 0, 0);
  const total = picture.width * picture.height;
  const saturated = counts.slice(250).reduce((sum, c) => sum + c, 0);
  share.textContent = `; ${num((1000 * saturated) / total, 1)} ‰ saturated`;
  const bars = histogram.getContext("2d");
  const top = Math.log1p(Math.max(...counts));
  for (let grey = 0; grey < 256; grey++) {
    bars.fillStyle = grey >= 250 ? "#c3262b" : grey < 8 ? "#2846b0" : "#7b8794";
    const height = (58 * Math.log1p(counts[grey])) / top;
    bars.fillRect(grey, 60 - height, 1, height);
  }
}
