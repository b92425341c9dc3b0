// The live picture: a frame with outline, centre, displacements, axes, scale bar and a zebra over saturated pixels.
"use strict";

const livePicture = (() => {
  const SATURATED = 245;
  const STALE_MS = 1000;
  const canvas = document.getElementById("picture");
  const note = document.getElementById("picture-note");
  const context = canvas.getContext("2d");
  const frame = document.createElement("canvas");
  const focus = document.getElementById("focus");
  let shown = 0;
  let sharpest = 0;
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

  /** Draws the displacements of subsets, all enlarged by the same 1, 2 or 5 times a power of ten; returns that factor. */
  function drawVectors(vectors, perPx, thin) {
    const longest = Math.max(0, ...vectors.map(([, , u, v]) => Math.hypot(u, v))) * perPx;
    if (longest === 0) return 0;
    const wanted = (28 * thin) / longest;
    const power = 10 ** Math.floor(Math.log10(wanted));
    const factor = [5, 2, 1].map((step) => step * power).find((step) => step <= wanted) || power;
    const at = (px) => (px + 0.5) * perPx;
    const path = new Path2D();
    for (const [x, y, u, v] of vectors) {
      const [fromX, fromY] = [at(x), at(y)];
      const [toX, toY] = [fromX + u * factor * perPx, fromY + v * factor * perPx];
      path.moveTo(fromX, fromY);
      path.lineTo(toX, toY);
      addHead(path, [fromX, fromY], [toX, toY], 5 * thin);
    }
    stroke(path, "#5cc8ff", 1.5 * thin);
    return factor;
  }

  /** Adds the head of an arrow to a path. */
  function addHead(path, [fromX, fromY], [toX, toY], length) {
    const angle = Math.atan2(toY - fromY, toX - fromX);
    for (const turn of [-0.5, 0.5]) {
      path.moveTo(toX, toY);
      path.lineTo(toX - length * Math.cos(angle + turn), toY - length * Math.sin(angle + turn));
    }
  }

  /** Draws the axes of the velocities at the lower right: n away from the surface and t along it. */
  function drawAxes(header, thin) {
    const origin = [canvas.width - 62 * thin, canvas.height - 62 * thin];
    const tangent = (header.surface_deg * Math.PI) / 180;
    context.font = `600 ${15 * thin}px sans-serif`;
    context.textAlign = "center";
    for (const [name, angle] of [["t", tangent], ["n", tangent + Math.PI / 2]]) {
      const end = [origin[0] + 34 * thin * Math.cos(angle), origin[1] - 34 * thin * Math.sin(angle)];
      const path = new Path2D();
      path.moveTo(...origin);
      path.lineTo(...end);
      addHead(path, origin, end, 8 * thin);
      stroke(path, "#ffffff", 2 * thin);
      const [x, y] = [end[0] + 13 * thin * Math.cos(angle), end[1] - 13 * thin * Math.sin(angle) + 5 * thin];
      drawText(name, x, y, thin);
    }
    context.textAlign = "left";
  }

  function drawText(text, x, y, thin) {
    context.lineWidth = 4 * thin;
    context.strokeStyle = "#000a";
    context.strokeText(text, x, y);
    context.fillStyle = "#ffffff";
    context.fillText(text, x, y);
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
    drawText(text, left, bottom - 9 * thin, thin);
  }

  /** Hatches the squares of subsets that something covers. */
  function drawOccluded(header, perPx, thin) {
    const side = header.step_px * perPx;
    const path = new Path2D();
    for (const [x, y] of header.occluded) {
      const [left, bottom] = [(x + 0.5) * perPx - side / 2, (y + 0.5) * perPx + side / 2];
      path.moveTo(left, bottom);
      path.lineTo(left + side, bottom - side);
    }
    if (header.occluded.length > 0) stroke(path, "#ff7a5c", 1.5 * thin);
  }

  /** Describes the uncertainty that a speed measured now has, and the visible share of each body. */
  function nowText(header) {
    const digits = (number) => number.toPrecision(2);
    const parts = header.now.map((body) => {
      const spin = body.sigma_omega_rad_s === null ? "" : `, spin ± ${digits(body.sigma_omega_rad_s)} rad/s`;
      const isCovered = body.visible_fraction !== null && body.visible_fraction < 0.995;
      const visible = isCovered ? `, ${Math.round(100 * body.visible_fraction)} % visible` : "";
      return `${body.name}: speed ± ${digits(body.sigma_v_m_s)} m/s${spin}${visible}`;
    });
    return parts.length === 0 ? "" : `Now ${parts.join("; ")}`;
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
    drawOccluded(header, perPx, thin);
    const factor = drawVectors(header.vectors, perPx, thin);
    drawScale(header, perPx, thin);
    drawAxes(header, thin);
    // The sharpest picture falls slowly, so that the bar is about the present scene.
    sharpest = Math.max(header.sharpness, 0.995 * sharpest);
    focus.value = sharpest > 0 ? header.sharpness / sharpest : 0;
    shown = performance.now();
    arrivals = [...arrivals.filter((time) => shown - time < 2000), shown];
    const brightest = header.saturated_fraction;
    const share = brightest >= 0.001 ? ` – ${(100 * brightest).toFixed(1)} % saturated` : "";
    const vectors = factor > 0 ? ` – displacements x ${Number(factor.toPrecision(1))}` : "";
    note.textContent = `frame ${header.frame}${share}${vectors}`;
    setText("picture-now", nowText(header));
    [canvas.dataset.frameWidth, canvas.dataset.frameHeight] = [header.width_px, header.height_px];
    [canvas.dataset.shownWidth, canvas.dataset.shownHeight] = [bitmap.width * header.scale, bitmap.height * header.scale];
    canvas.dataset.occluded = header.occluded.length;
    canvas.dataset.vectors = header.vectors.length;
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
