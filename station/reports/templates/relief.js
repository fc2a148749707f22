// Blocks of the class `relief` show a picture over its depth, turned by dragging or by the arrow keys.
async function raise(block) {
  const [shown, depth] = block.querySelectorAll("img"), canvas = block.querySelector("canvas"), context = canvas.getContext("2d");
  await Promise.all([shown.decode(), depth.decode()]);
  const [width, height] = [canvas.width, canvas.height] = [shown.naturalWidth, shown.naturalHeight], size = width * height;
  const samples = image => { context.drawImage(image, 0, 0); return context.getImageData(0, 0, width, height).data; };
  const colours = samples(shown), near = samples(depth), nearest = new Float32Array(size);
  let yaw = 0.5, pitch = 0.25, waiting = false;
  const draw = () => {
    waiting = false;
    const out = context.createImageData(width, height), [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    nearest.fill(-1e9);
    for (let i = 0, row = 0; row < height; row++) {
      for (let column = 0; column < width; column++, i++) {
        const x = 0.8 * (column - width / 2), y = 0.8 * (row - height / 2), z = 0.4 * width * (near[4 * i] / 255 - 0.5);
        const depth_ = cy * z - sy * x, to = Math.round(width / 2 + cy * x + sy * z), down = Math.round(height / 2 + cp * y - sp * depth_);
        const towards = cp * depth_ + sp * y;
        for (let k = 0; k < 4; k++) {
          const at = to + (k & 1), line = down + (k >> 1), j = line * width + at;
          if (at < 0 || at >= width || line < 0 || line >= height || towards <= nearest[j]) continue;
          nearest[j] = towards;
          for (let c = 0; c < 3; c++) out.data[4 * j + c] = colours[4 * i + c];
          out.data[4 * j + 3] = 255;
        }
      }
    }
    context.putImageData(out, 0, 0);
  };
  const turn = (across, down) => {
    [yaw, pitch] = [yaw + across, pitch + down].map(angle => Math.min(Math.max(angle, -1.3), 1.3));
    if (!waiting) { waiting = true; requestAnimationFrame(draw); }
  };
  canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", event => { if (event.buttons) turn(event.movementX / 150, event.movementY / 150); });
  canvas.addEventListener("keydown", event => {
    const [across, down] = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key] ?? [0, 0];
    if (across || down) { event.preventDefault(); turn(across, down); }
  });
  block.hidden = false;
  draw();
}

for (const block of document.querySelectorAll("div.relief")) raise(block);
