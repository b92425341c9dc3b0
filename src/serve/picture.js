// The live picture: a frame with outline, centre, scale bar and a zebra over saturated pixels.
"use strict";

const livePicture = (() => {
  const SATURATED = 245;
  const STALE_MS = 1000;
  const canvas = document.getElementById("picture");
  const note = document.getElementById("picture-note");
  const context = canvas.getContext("2d");
  const frame = document.createElement("canvas");
  let shown = 0;
  let arrivals = [];

  /** Splits a message into its header and its JPEG file. */
  function parse(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    return { header, file: new Blob([new Uint8Array(buffer, 4 + length)], { type: "image/jpeg" }) };
  }

  /** Draws stripes over saturated pixels, because brighter ones would look the same. */
  function drawZebra(header) {
    if (header.saturated_fraction === 0) return;
    const inner = frame.getContext("2d", { willReadFrequently: true });
    const image = inner.getImageData(0, 0, frame.width, frame.height);
    const data = image.data;
    for (let at = 0, pixel = 0; at < data.length; at += 4, pixel += 1) {
      if (data[at] < SATURATED) continue;
      const isDark = (pixel % frame.width + Math.floor(pixel / frame.width)) % 8 < 4;
      [data[at], data[at + 1], data[at + 2]] = isDark ? [214, 39, 120] : [255, 255, 255];
    }
    inner.putImageData(image, 0, 0);
  }

  /** Strokes a path in a colour with a dark casing, so that it is visible on any picture. */
  function stroke(path, colour, width) {
    context.strokeStyle = "#000a";
    context.lineWidth = width + 3;
    context.stroke(path);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke(path);
  }

  function drawBody(body, perPx, thin) {
    const at = (px) => (px + 0.5) * perPx;
    const path = new Path2D();
    for (const [from, to] of body.lines_px || []) {
      path.moveTo(at(from[0]), at(from[1]));
      path.lineTo(at(to[0]), at(to[1]));
    }
    if (body.x_px !== null && body.y_px !== null) {
      const [x, y, arm] = [at(body.x_px), at(body.y_px), 7 * thin];
      if (body.radius_px !== null && !body.lines_px) {
        path.moveTo(x + body.radius_px * perPx, y);
        path.arc(x, y, body.radius_px * perPx, 0, 2 * Math.PI);
      }
      path.moveTo(x - arm, y);
      path.lineTo(x + arm, y);
      path.moveTo(x, y - arm);
      path.lineTo(x, y + arm);
    }
    stroke(path, body.status === "valid" ? "#35e06f" : "#ffb000", 2 * thin);
  }

  /** Draws a bar of 1, 2 or 5 times a power of ten, about a quarter of the picture long. */
  function drawScale(header, perPx, thin) {
    const perUnit = header.mm_per_px ? 1 / header.mm_per_px : 1;
    const wanted = header.width_px / 4 / perUnit;
    const power = 10 ** Math.floor(Math.log10(wanted));
    const length = [5, 2, 1].map((step) => step * power).find((step) => step <= wanted);
    const [left, bottom] = [14 * thin, canvas.height - 14 * thin];
    const right = left + length * perUnit * perPx;
    const path = new Path2D();
    path.moveTo(left, bottom);
    path.lineTo(right, bottom);
    stroke(path, "#ffffff", 4 * thin);
    const text = `${length} ${header.mm_per_px ? "mm" : "px"}`;
    context.font = `600 ${15 * thin}px sans-serif`;
    context.lineWidth = 4 * thin;
    context.strokeStyle = "#000a";
    context.strokeText(text, left, bottom - 9 * thin);
    context.fillStyle = "#ffffff";
    context.fillText(text, left, bottom - 9 * thin);
  }

  async function show(buffer) {
    const { header, file } = parse(buffer);
    const bitmap = await createImageBitmap(file);
    [frame.width, frame.height] = [bitmap.width, bitmap.height];
    frame.getContext("2d", { willReadFrequently: true }).drawImage(bitmap, 0, 0);
    drawZebra(header);
    const size = canvas.getBoundingClientRect();
    const zoom = Math.max(1, Math.min(4, (size.width * devicePixelRatio) / bitmap.width));
    [canvas.width, canvas.height] = [Math.round(bitmap.width * zoom), Math.round(bitmap.height * zoom)];
    context.imageSmoothingEnabled = zoom < 2;
    context.drawImage(frame, 0, 0, canvas.width, canvas.height);
    const perPx = canvas.width / (bitmap.width * header.scale);
    const thin = Math.max(1, canvas.width / Math.max(1, size.width));
    header.bodies.forEach((body) => drawBody(body, perPx, thin));
    drawScale(header, perPx, thin);
    shown = performance.now();
    arrivals = [...arrivals.filter((time) => shown - time < 2000), shown];
    const brightest = header.saturated_fraction;
    const share = brightest >= 0.001 ? ` – ${(100 * brightest).toFixed(1)} % saturated` : "";
    note.textContent = `frame ${header.frame}${share}`;
    canvas.dataset.rate = (arrivals.length / 2).toFixed(1);
  }

  function connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/ws/picture`);
    socket.binaryType = "arraybuffer";
    let busy = false;
    socket.onmessage = async (message) => {
      // A picture that comes while the last one is drawn is left out.
      if (busy) return;
      busy = true;
      await show(message.data).catch(() => {});
      busy = false;
    };
    socket.onclose = () => setTimeout(connect, 1000);
  }

  setInterval(() => {
    const isStale = performance.now() - shown > STALE_MS;
    canvas.style.opacity = isStale ? 0.35 : 1;
    if (isStale) note.textContent = "no picture";
  }, 200);
  connect();
  return { canvas };
})();
