// Blocks of the class `refocus` show a restored picture through any aperture, as procedures.restoration.refocus computes it.
const PLASTIC = 1.32471795724474602596;

const BOKEH = {
  circle: () => (y, x) => (y * y + x * x <= 1 ? 1 : 0),
  gaussian: () => (y, x) => (y * y + x * x <= 1 ? Math.exp(-4.5 * (y * y + x * x)) : 0),
  polygon: blades => (y, x) => {
    for (let n = 0; n < blades; n++) {
      const middle = Math.PI * (2 * n + 1) / blades;
      if (x * Math.cos(middle) + y * Math.sin(middle) > Math.cos(Math.PI / blades)) return 0;
    }
    return 1;
  },
};

// The mean of the views from points of the aperture: light (rows, columns, channels), signed radius of the blur (rows, columns).
function meanOfViews(light, radius, rows, columns, aperture, count) {
  const size = rows * columns, channels = light.length / size;
  const total = new Float64Array(light.length), cover = new Float64Array(size);
  const nearest = new Float64Array(size), source = new Int32Array(size);
  for (let n = 1; n <= count; n++) {
    const y = 2 * ((n / PLASTIC) % 1) - 1, x = 2 * ((n / PLASTIC ** 2) % 1) - 1, weight = aperture(y, x);
    if (weight <= 0) continue;
    source.fill(-1);
    for (let i = 0, row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++, i++) {
        const r = radius[i], toRow = row + Math.floor(y * r + 0.5), toColumn = column + Math.floor(x * r + 0.5);
        if (toRow < 0 || toRow >= rows || toColumn < 0 || toColumn >= columns) continue;
        const to = toRow * columns + toColumn;
        if (source[to] < 0 || r > nearest[to]) { source[to] = i; nearest[to] = r; }
      }
    }
    for (let to = 0; to < size; to++) {
      if (source[to] < 0) continue;
      cover[to] += weight;
      for (let c = 0; c < channels; c++) total[to * channels + c] += weight * light[source[to] * channels + c];
    }
  }
  for (let i = 0; i < total.length; i++) total[i] /= Math.max(cover[Math.floor(i / channels)], 1e-12);
  return total;
}

// Radius of the blur circle, pixels, for each inverse distance (1/m): Gaussian optics, as CameraSetting.blur_radius_px.
function blurRadius(inverse, lens, fNumber, inverseFocus) {
  const image = 1 / (1 / lens.focal_length_mm - inverseFocus / 1000);
  const scale = lens.focal_length_mm / (2 * fNumber) * image / (lens.pitch_um * 1e-3);
  return inverse.map(one => scale * (one - inverseFocus) / 1000);
}

function pixels(image) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, canvas.width, canvas.height);
}

async function explore(block) {
  const lens = JSON.parse(block.dataset.lens), [sharp, depth] = block.querySelectorAll("img");
  await Promise.all([sharp.decode(), depth.decode()]);
  const seen = pixels(sharp), coded = pixels(depth).data, { width, height } = seen, size = width * height;
  const linear = new Float64Array(size * 3), inverse = new Float64Array(size);
  for (let i = 0; i < size; i++) {
    inverse[i] = lens.least + (256 * coded[4 * i] + coded[4 * i + 1]) / 65535 * (lens.most - lens.least);
    for (let c = 0; c < 3; c++) {
      const v = seen.data[4 * i + c] / 255;
      linear[3 * i + c] = v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
    }
  }
  const canvas = block.querySelector("canvas"), context = canvas.getContext("2d");
  const [aperture, focus, bokeh] = ["aperture", "focus", "bokeh"].map(name => block.querySelector(`[name=${name}]`));
  const words = block.querySelector("output");
  [canvas.width, canvas.height] = [width, height];
  let waiting = false;
  const draw = () => {
    waiting = false;
    const fNumber = 2 ** (+aperture.value / 2), inverseFocus = lens.least + focus.value * (lens.most - lens.least);
    const [kind, blades] = bokeh.value.split(":"), spread = kind === "gaussian" ? lens.gaussian : 1;
    const radius = blurRadius(inverse, lens, fNumber, inverseFocus).map(one => spread * one);
    const widest = radius.reduce((a, b) => Math.max(a, Math.abs(b)), 0);
    const count = Math.round(Math.min(Math.max(16 * Math.PI * widest * widest, 256), 1024));
    const mean = meanOfViews(linear, radius, height, width, BOKEH[kind](+blades), count), picture = context.createImageData(width, height);
    for (let i = 0; i < size; i++) {
      for (let c = 0; c < 3; c++) {
        const v = Math.min(Math.max(mean[3 * i + c], 0), 1);
        picture.data[4 * i + c] = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055) + 0.5;
      }
      picture.data[4 * i + 3] = 255;
    }
    context.putImageData(picture, 0, 0);
    words.textContent = `f/${fNumber.toPrecision(2)}, focused at ${(1 / inverseFocus).toPrecision(3)} m; widest blur ${(2 * widest).toFixed(1)} pixels of this picture`;
  };
  const later = () => { if (!waiting) { waiting = true; requestAnimationFrame(draw); } };
  for (const control of [aperture, focus, bokeh]) control.addEventListener("input", later);
  block.hidden = false;
  draw();
}

for (const block of document.querySelectorAll("div.refocus")) explore(block);
