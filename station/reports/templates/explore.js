// Explore: a place of the frame with its PSF, MTF and budget; other units; other results; a limit and its probability.
(() => {
const data = JSON.parse(document.getElementById("explore-data").textContent), root = document.getElementById("explore");
const CYCLES = "cycles/pixel", UNITS = [CYCLES, "lp/mm", "lw/ph"], CONFIDENT = 1.96, COVERAGE = 2;
const NAMES = { horizontal: "along rows", vertical: "along columns", mtf: "across the edge" };
const DASHES = { vertical: "6 3" }, OTHERS = ["#8a4fbf", "#c9791a", "#0e8a8a", "#b3386b", "#5d6b1e", "#444"];
const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];  // viridis
const state = { plane: data.planes[0], spot: null, unit: data.unit, at: 0.25, others: [...data.others] };

// --- elements, numbers ---
function make(name, attributes = {}, ...children) {
  const svg = ["svg", "path", "rect", "line", "text", "circle", "g", "title"].includes(name);
  const one = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  one.append(...children);
  return one;
}
const minus = text => text.replace(/-/g, "−");
function stated(value, uncertainty) {
  if (!Number.isFinite(value)) return "—";
  if (!(uncertainty > 0 && Number.isFinite(uncertainty))) return minus(String(Number(value.toPrecision(4))));
  const decimals = Math.max(0, 1 - Math.floor(Math.log10(uncertainty)));
  return minus(`${value.toFixed(decimals)} ± ${uncertainty.toFixed(decimals)}`);
}
function factor(unit, plane = state.plane) {
  if (unit === CYCLES) return 1;
  return unit === "lp/mm" ? 1000 / (plane.pitch * data.pitch_um) : 2 * plane.height;
}
const known = unit => Number.isFinite(factor(unit)) && factor(unit) > 0;
const scale = unit => (UNITS.includes(unit) ? factor(state.unit) : 1);
const unitOf = unit => (UNITS.includes(unit) ? state.unit : unit === "1" ? "" : unit);
function ticks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(one => one * power).find(one => one >= rough);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high * (1 + 1e-9); n++) found.push(Number((n * step).toPrecision(6)));
  return found;
}
function erf(x) {  // M. Abramowitz, I. Stegun, Handbook of Mathematical Functions, 7.1.26
  const t = 1 / (1 + 0.3275911 * Math.abs(x));
  const sum = [0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429].reduceRight((all, one) => t * (one + all), 0);
  return Math.sign(x) * (1 - sum * Math.exp(-x * x));
}
const below = z => 0.5 * (1 + erf(z / Math.SQRT2));
const spots = () => state.plane.spots;
const numbers = () => (state.spot ?? state.plane).numbers;
const number = () => numbers().find(one => one.label === controls.number.value) ?? numbers()[0];
const curves = () => (state.spot ?? state.plane).curves;

// --- controls ---
const controls = {};
function control(words, name, element) {
  controls[name] = element;
  element.addEventListener("input", () => draw(name));
  return make("label", {}, `${words} `, element);
}
const choice = texts => make("select", {}, ...texts.map(one => make("option", {}, one)));
const parts = {};
const panel = (name, caption) => make("figure", { class: name }, (parts[name] = make("div")), (parts[`${name}Words`] = make("figcaption", {}, caption)));
function build() {
  const box = make("div", { class: "controls" },
    control("Plane", "plane", choice(data.planes.map(one => one.name))),
    control("Number", "number", choice(data.planes[0].numbers.map(one => one.label))),
    control("Unit of frequencies", "unit", choice(UNITS)),
    control("Pixel pitch, µm", "pitch", make("input", { type: "number", step: "any", min: "0", value: data.pitch_um ?? "" })));
  const frame = panel("frame", ""), psf = panel("psf", ""), mtf = panel("mtf", "");
  mtf.append(control("Frequency", "at", make("input", { type: "range", min: 0, max: 1, step: 0.001, value: 0.25 })),
    control("Other results to draw over it (report.html, mtf_*.csv, result.json)", "files",
      make("input", { type: "file", multiple: "", accept: ".html,.csv,.json" })));
  const limit = panel("limit", "");
  limit.prepend(make("div", { class: "controls" }, control("Limit", "kind", choice(["at least", "at most"])),
    control("", "limit", make("input", { type: "number", step: "any", "aria-label": "Limit" })),
    control("", "slide", make("input", { type: "range", min: -8, max: 8, step: 0.01, value: 0, "aria-label": "Move the limit" }))));
  parts.table = make("div", { class: "scroll gap" });
  root.append(make("h2", {}, "Explore"), make("p", { class: "note" },
    data.planes.some(one => one.spots.length) ? "Point at a place of the frame, or move to it with the tabulator key." :
    frequencies() ? "Point at a frequency, move the limit, choose a unit." : "Move the limit."), box,
    make("div", { class: "two gap" }, frame, psf, mtf, limit), parts.table);
  root.hidden = false;
  controls.number.value = (numbers().find(one => one.name.startsWith("mtf50")) ?? number()).label;
  controls.unit.value = state.unit;
  controls.unit.parentElement.hidden = !frequencies();
  controls.pitch.parentElement.hidden = !frequencies();
  setLimit(true);
}
const frequencies = () => data.planes.some(one => one.curves.frequency || one.numbers.some(each => UNITS.includes(each.unit)));

// --- drawing ---
function draw(changed) {
  if (changed === "plane") {
    state.plane = data.planes.find(one => one.name === controls.plane.value);
    state.spot = null;
    fillNumbers();
  }
  if (changed === "pitch") data.pitch_um = Number(controls.pitch.value) || null;
  for (const option of controls.unit.options) option.disabled = !known(option.value);
  if (!known(controls.unit.value)) controls.unit.value = CYCLES;
  state.unit = controls.unit.value;
  if (changed === "at") state.at = Number(controls.at.value);
  if (changed === "files") read(controls.files.files);
  if (["plane", "number", "spot", "unit", "pitch", undefined].includes(changed)) setLimit(changed !== "spot");
  if (changed === "slide") controls.limit.value = Number((middle() + controls.slide.value * spread()).toPrecision(4));
  drawFrame();
  drawPsf();
  drawMtf();
  drawLimit();
  drawTable();
  convertPage();
}
function fillNumbers() {
  const before = controls.number.value;
  controls.number.replaceChildren(...numbers().map(one => make("option", {}, one.label)));
  if (numbers().some(one => one.label === before)) controls.number.value = before;
}
function colour(share) {
  const place = 4 * Math.min(Math.max(share, 0), 1), low = Math.min(Math.floor(place), 3);
  const mixed = RAMP[low].map((one, i) => Math.round(one + (place - low) * (RAMP[low + 1][i] - one)));
  return `rgb(${mixed})`;
}
function drawFrame() {
  const figure = parts.frame.parentElement;
  figure.hidden = !spots().length;
  if (figure.hidden) return;
  const measured = spots()[0].numbers, example = measured.find(one => one.label === number().label) ?? measured[0];
  if (!example) return;
  const [rows, columns] = state.plane.shape, label = example.label;
  const values = spots().map(one => one.numbers.find(each => each.label === label)?.value ?? NaN);
  const finite = values.filter(Number.isFinite), low = Math.min(...finite), high = Math.max(...finite);
  const across = [...new Set(spots().map(one => one.x))].length, down = [...new Set(spots().map(one => one.y))].length;
  const wide = columns / across, tall = rows / down, chosen = state.spot;
  const map = make("svg", { viewBox: `0 0 ${columns} ${rows}`, role: "group", "aria-label": `Places of the frame, ${label}` });
  spots().forEach((one, i) => {
    const value = one.numbers.find(each => each.label === label);
    const words = `x ${one.x}, y ${one.y}: ${value ? `${label} ${shown(value)}` : "not measured"}${one.inside ? "" : ", beyond the charts"}`;
    const cell = make("rect", { x: one.x + 0.5 - wide / 2, y: one.y + 0.5 - tall / 2, width: wide, height: tall, tabindex: 0,
      role: "button", "aria-label": words, class: one === chosen ? "chosen" : "", "fill-opacity": one.inside ? 1 : 0.55,
      fill: Number.isFinite(values[i]) ? colour((values[i] - low) / (high - low || 1)) : "none" }, make("title", {}, words));
    for (const event of ["pointerenter", "focus", "click"]) cell.addEventListener(event, () => choose(one, i));
    map.append(cell);
  });
  const refocus = parts.frame.contains(document.activeElement);
  parts.frame.replaceChildren(map);
  if (refocus && chosen) map.children[spots().indexOf(chosen)].focus();
  const [from, to] = [low, high].map(one => stated(one * scale(example.unit)));
  parts.frameWords.textContent = `${label}, from ${from} (dark) to ${to} (bright) ${unitOf(example.unit)}. ` +
    "Pale: beyond the charts, where the uncertainty grows.";
}
function choose(one) {
  if (state.spot === one) return;
  state.spot = one;
  fillNumbers();
  draw("spot");
}
const shown = one => `${stated(one.value * scale(one.unit), one.uncertainty * scale(one.unit))} ${unitOf(one.unit)}`.trim();
const where = () => (state.spot ? `at x ${state.spot.x}, y ${state.spot.y}` : spots().length ? "at the frame’s centre" : "at this place");
function drawPsf() {
  const psf = (state.spot ?? state.plane).psf, figure = parts.psf.parentElement;
  figure.hidden = !psf;
  if (!psf) return;
  const levels = Uint8Array.from(atob(psf.levels), one => one.charCodeAt(0)), side = Math.sqrt(levels.length);
  const canvas = make("canvas", { width: side, height: side, role: "img", "aria-label": `PSF ${where()}` });
  const context = canvas.getContext("2d");
  levels.forEach((level, i) => {
    context.fillStyle = colour(level / 255);
    context.fillRect(i % side, Math.floor(i / side), 1, 1);
  });
  parts.psf.replaceChildren(canvas);
  parts.psfWords.textContent = `PSF of ${state.plane.name} ${where()}, ${psf.s} samples per pixel; square root of the samples, its own scale.`;
}
function interpolated(x, y, at) {
  const i = x.findIndex(one => one >= at);
  if (i < 0 || at < x[0]) return NaN;
  return i === 0 ? y[0] : y[i - 1] + (y[i] - y[i - 1]) * (at - x[i - 1]) / (x[i] - x[i - 1]);
}
function lines() {
  const own = curves(), drawn = [];
  const add = (set, title, colours, plain) => {
    for (const [name, words] of Object.entries(NAMES)) {
      if (set[name]) drawn.push({ x: set.frequency, y: set[name], u: plain ? null : set[`${name}_uncertainty`], colour: colours,
        dash: DASHES[name] ?? "", title: `${title} ${words}` });
    }
  };
  if (own.frequency) add(own, state.plane.name, state.plane.colour, false);
  state.others.forEach((other, i) => {
    const set = other.planes[state.plane.name] ?? Object.values(other.planes)[0];
    if (set?.frequency) add(set, other.name, OTHERS[i % OTHERS.length], false);
  });
  return drawn;
}
function drawMtf() {
  const figure = parts.mtf.parentElement, drawn = lines();
  figure.hidden = !drawn.length;
  if (figure.hidden) return;
  const unit = factor(state.unit), end = Math.max(...drawn.map(one => one.x.at(-1))), W = 480, H = 300, L = 44, B = 44;
  controls.at.max = end;
  const X = f => L + (W - L - 10) * f / end, Y = v => H - B - (H - B - 10) * v / 1.05;
  const plot = make("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": "MTF over frequency" });
  const axis = (x1, y1, x2, y2, text, x, y, anchor) => plot.append(make("line", { x1, y1, x2, y2, class: "grid" }),
    make("text", { x, y, "text-anchor": anchor }, text));
  for (const f of ticks(0, end * unit, 6)) axis(X(f / unit), H - B, X(f / unit), 10, f, X(f / unit), H - B + 18, "middle");
  for (const v of [0, 0.2, 0.4, 0.6, 0.8, 1]) axis(L, Y(v), W - 10, Y(v), v, L - 6, Y(v) + 4, "end");
  plot.append(make("text", { x: (L + W) / 2, y: H - 6, "text-anchor": "middle" }, `frequency, ${state.unit}`));
  const path = (x, y) => x.map((one, i) => `${i ? "L" : "M"}${X(one).toFixed(1)} ${Y(y[i]).toFixed(1)}`).join("");
  for (const one of drawn) {
    if (one.u) {
      const band = sign => one.y.map((y, i) => y + sign * CONFIDENT * one.u[i]);
      const back = path([...one.x].reverse(), band(-1).reverse()).replace("M", "L");
      plot.append(make("path", { d: `${path(one.x, band(1))}${back}Z`, fill: one.colour, "fill-opacity": 0.2 }));
    }
    plot.append(make("path", { d: path(one.x, one.y), fill: "none", stroke: one.colour, "stroke-width": 1.8, "stroke-dasharray": one.dash }));
  }
  state.others.forEach((other, i) => {
    for (const [f, v, u] of other.points?.[state.plane.name] ?? []) {
      const ends = u ? [X(f - CONFIDENT * u), X(f + CONFIDENT * u)] : [X(f), X(f)];
      plot.append(make("line", { x1: ends[0], x2: ends[1], y1: Y(v), y2: Y(v), stroke: OTHERS[i % OTHERS.length], "stroke-width": 1.5 }),
        make("circle", { cx: X(f), cy: Y(v), r: 3.5, fill: OTHERS[i % OTHERS.length] }));
    }
  });
  plot.append(make("line", { x1: X(state.at), x2: X(state.at), y1: 10, y2: H - B, class: "cursor" }));
  plot.addEventListener("pointermove", event => {
    const box = plot.getBoundingClientRect(), f = ((event.clientX - box.left) * W / box.width - L) / (W - L - 10) * end;
    if (f < 0 || f > end) return;
    controls.at.value = state.at = f;
    plot.querySelector(".cursor").setAttribute("x1", X(f));
    plot.querySelector(".cursor").setAttribute("x2", X(f));
    readout(drawn);
  });
  parts.mtf.replaceChildren(plot);
  readout(drawn);
}
function readout(drawn) {
  const rows = drawn.map(one => make("div", {}, swatch(one.colour, one.dash),
    `${one.title}: ${stated(interpolated(one.x, one.y, state.at), one.u ? interpolated(one.x, one.u, state.at) : 0)}`));
  const points = state.others.map((one, i) => (one.points ? make("div", {}, swatch(OTHERS[i % OTHERS.length], ""), `${one.name}: numbers of its record`) : ""));
  parts.mtfWords.replaceChildren(`MTF ${where()} with its 95 % band; at ${stated(state.at * factor(state.unit))} ${state.unit}:`, ...rows, ...points);
}
const swatch = (colours, dash) => make("span", { class: "swatch", style: `background: ${dash ? "none" : colours}; border: 2px solid ${colours}` });

// --- a limit: JCGM 106:2012, section 7, the value as the mean of a normal distribution ---
const middle = () => number().value * scale(number().unit);
const spread = () => (number().uncertainty * scale(number().unit)) || Math.abs(middle()) / 100 || 1;
function setLimit(renew) {
  const limits = state.plane.limits[number().name];
  if (renew && limits) {
    controls.kind.value = limits[0] !== null ? "at least" : "at most";
    controls.limit.value = Number(((limits[0] ?? limits[1]) * scale(number().unit)).toPrecision(4));
  } else if (renew) {
    controls.limit.value = Number((middle() - (controls.kind.value === "at least" ? 1 : -1) * spread()).toPrecision(4));
  }
}
function drawLimit() {
  const one = number(), u = spread(), limit = Number(controls.limit.value), least = controls.kind.value === "at least";
  const z = (least ? 1 : -1) * (middle() - limit) / u, probability = below(z);
  controls.slide.value = (limit - middle()) / u;
  const verdict = z >= COVERAGE ? "meets" : z <= -COVERAGE ? "does not meet" : "undecided";
  const W = 480, H = 130, X = v => W / 2 + 26 * (v - middle()) / u, Y = p => H - 30 - (H - 40) * p;
  const plot = make("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": "Distribution of the value, and the limit" });
  const bell = (from, to) => {
    const steps = Array.from({ length: 81 }, (_, i) => from + (to - from) * i / 80);
    return steps.map((v, i) => `${i ? "L" : "M"}${X(middle() + v * u).toFixed(1)} ${Y(Math.exp(-v * v / 2)).toFixed(1)}`).join("");
  };
  const edge = Math.min(Math.max((limit - middle()) / u, -9), 9), [from, to] = least ? [edge, 9] : [-9, edge];
  plot.append(make("path", { d: `${bell(from, to)}L${X(middle() + to * u)} ${Y(0)}L${X(middle() + from * u)} ${Y(0)}Z`, class: "inside" }),
    make("path", { d: bell(-9, 9), fill: "none", class: "bell" }),
    make("line", { x1: X(middle() + edge * u), x2: X(middle() + edge * u), y1: 6, y2: H - 30, class: "cursor" }));
  for (const v of ticks(middle() - 8 * u, middle() + 8 * u, 6)) plot.append(make("text", { x: X(v), y: H - 12, "text-anchor": "middle" }, minus(String(v))));
  parts.limit.replaceChildren(plot);
  const percent = probability > 0.9995 ? "above 99.9" : probability < 0.0005 ? "below 0.1" : (100 * probability).toFixed(1);
  parts.limitWords.replaceChildren(`${one.label} ${where()}: ${shown(one)}. `,
    make("strong", {}, `Probability of conformity: ${percent} %. `),
    `With a guard band of ${COVERAGE} standard uncertainties: `, make("strong", { class: `tag large ${verdict.replace(/ /g, "-")}` }, verdict), ".",
    budgetOf(one) ? ` Its budget: ${budgetOf(one)}.` : "");
}
const budgetOf = one => Object.entries(one.budget).sort(([, a], [, b]) => b - a)
  .map(([name, size]) => `${name} ${Number((size * scale(one.unit)).toPrecision(2))}`).join(", ");
function drawTable() {
  parts.table.hidden = !state.spot;  // elsewhere the page has the same table
  const rows = numbers().map(one => make("tr", {}, make("th", { class: "word" }, one.label), make("td", {}, shown(one)),
    make("td", { class: "word reason" }, budgetOf(one))));
  const heads = [`${state.plane.name} ${where()}`, "value ± standard uncertainty", "its budget"];
  const head = make("tr", {}, ...heads.map((one, i) => make("th", { class: i === 1 ? "" : "word" }, one)));
  parts.table.replaceChildren(make("table", { class: "numbers" }, make("thead", {}, head), make("tbody", {}, ...rows)));
}
function convertPage() {
  const ratio = factor(state.unit, data.planes[0]) / data.factor;
  for (const one of document.querySelectorAll("[data-q]")) {
    const [value, uncertainty] = one.dataset.q.split(" ").map(Number);
    one.textContent = stated(value * ratio, uncertainty * ratio);
  }
  for (const one of document.querySelectorAll("[data-unit]")) one.textContent = state.unit;
  for (const one of document.querySelectorAll(".own-unit")) one.hidden = state.unit !== data.unit;
}

// --- other results ---
async function read(files) {
  for (const file of files) {
    const text = await file.text(), name = file.name;
    try {
      state.others.push(name.endsWith(".csv") ? ofTable(name, text) : name.endsWith(".json") ? ofRecord(name, JSON.parse(text)) : ofPage(text));
    } catch (error) {
      parts.mtfWords.textContent = `${name} is no page with an MTF, no mtf_*.csv and no result.json: ${error.message}`;
      return;
    }
  }
  draw("others");
}
function ofPage(text) {
  const other = JSON.parse(new DOMParser().parseFromString(text, "text/html").getElementById("explore-data").textContent);
  return { name: other.name, planes: Object.fromEntries(other.planes.map(one => [one.name, one.curves])) };
}
function ofTable(name, text) {
  const [head, ...rows] = text.trim().split(/\r?\n/).map(line => line.split(","));
  const unit = UNITS.find(one => head[0].includes(one)) ?? CYCLES;
  const columns = Object.fromEntries(head.map((title, i) => [title.split(" [")[0], rows.map(row => Number(row[i]) / (i ? 1 : factor(unit)))]));
  if (!columns.frequency?.every(Number.isFinite)) throw new Error(`its first column is ${head[0]}, not frequency`);
  return { name, planes: { [name.replace(/^mtf_|\.csv$/g, "")]: columns } };
}
function ofRecord(name, record) {
  const points = {};
  for (const [plane, entry] of Object.entries(record.planes)) {
    const each = (prefix, value) => Object.keys(entry).filter(one => one.startsWith(prefix)).flatMap(one => value(one, entry[one]) ?? []);
    points[plane] = each("mtf", (key, one) => {
      const share = /^mtf(\d\d)(_horizontal|_vertical|)$/.exec(key), at = /^mtf_at_([\d.]+?)(_horizontal|_vertical|)$/.exec(key);
      if (share && UNITS.includes(one.unit)) return [[one.value / factor(one.unit), share[1] / 100, one.uncertainty / factor(one.unit)]];
      return at ? [[Number(at[1]) / factor(record.parameters?.unit ?? CYCLES), one.value, 0]] : null;
    });
  }
  if (!Object.values(points).some(one => one.length)) throw new Error("it has no number of an MTF");
  return { name: record.input?.[0]?.path?.split("/").at(-1) ?? name, planes: {}, points };
}

build();
draw();
})();
